"""Compute the errors with which identified laws predict the bending of a specimen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.outline import points_on
from eimi_fitting.inference.evidence.corrections import Correction, by_better_model
from eimi_fitting.inference.evidence.experiment import Comparison, Experiment, compare
from eimi_fitting.laws import LAWS
from eimi_lab.study.routes import Route

Array = NDArray[np.float64]


def errors_of(routes: Sequence[Route], experiment: Experiment) -> list[dict[str, Any]]:
    """Compute the errors of identified laws on one specimen.

    Parameters
    ----------
    routes : sequence of Route
        Identified laws.
    experiment : Experiment
        Specimen with its measured edges.

    Returns
    -------
    list of dict
        For each law: `error_mm` and `deviation_mm` (root mean square and standard deviation of the distances of the
        measured points from the simulated edges) in each state, and the simulated `edges_mm` in the last state, with
        the axes left and right edge, point, x and y. The three values are None if the beam has no equilibrium.
    """
    stored: list[dict[str, Any]] = []
    depth: tuple[Correction, ...] = ()
    for route in routes:

        def against(experiments: Sequence[Experiment], route: Route = route) -> Comparison:
            return compare(LAWS[route.law], np.array([route.values]), experiments)

        better = by_better_model(experiment, against([experiment]), against, depth)
        if better is None:
            stored.append({"error_mm": None, "deviation_mm": None, "edges_mm": None})
            continue
        misfit, curves, correction = better
        depth = depth or ((correction,) if correction else ())
        stored.append(
            {
                "error_mm": misfit.error_mm[0].tolist(),
                "deviation_mm": misfit.deviation_mm[0].tolist(),
                "edges_mm": points_on(curves[-1:], 2)[0].round(4).tolist(),
            }
        )
    return stored


def mean_error_um(stored: dict[str, Any]) -> float:
    """Return the mean error of a law over all states (µm); infinity if the beam has no equilibrium.

    `stored` is an element of the result of `errors_of`.
    """
    return float("inf") if stored["error_mm"] is None else 1e3 * float(np.mean(stored["error_mm"]))


def mean_deviation_um(stored: dict[str, Any]) -> float:
    """Return the standard deviation of the distances of measured points from simulated edges (µm), mean over states.

    The result is infinity if a beam had no equilibrium. `stored` is an element of the result of `errors_of`.
    """
    return float("inf") if stored["deviation_mm"] is None else 1e3 * float(np.mean(stored["deviation_mm"]))
