"""Compute the errors of identified laws on a specimen as `eimi validate` does.

The simulated edges are corrected for the error of the mesh, and for the difference between a planar and a solid model.
"""

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

    The edges are simulated with a planar beam model. They are then corrected by the difference between the edges of a
    solid and of a planar beam (the depth correction). The depth correction of the first law is the starting point for
    the other laws, which saves time.

    Parameters
    ----------
    routes : sequence of Route
        The identified laws.
    experiment : Experiment
        The specimen with its measured edges.

    Returns
    -------
    list of dict
        For each law: `error_mm` and `deviation_mm` by state (root mean square and standard deviation of the distances
        between measured and simulated edges), and the simulated edges `edges_mm` of the last state,
        shape (2, n, 2). The axes of the edges are: left or right edge, n points, x and y in mm. All entries are None if
        the beam has no equilibrium with the law.
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
    """Return the mean of a law's errors in all states in µm; infinity if the beam has no equilibrium with the law.

    The error in a state is the root mean square distance between measured and simulated edges. `stored` is the element
    for this law in the result of `errors_of`.
    """
    return float("inf") if stored["error_mm"] is None else 1e3 * float(np.mean(stored["error_mm"]))


def mean_deviation_um(stored: dict[str, Any]) -> float:
    """Return the mean of a law's deviations in all states in µm; infinity if the beam has no equilibrium.

    The deviation in a state is the standard deviation of the distances between measured and simulated edges. `stored`
    is the element for this law in the result of `errors_of`.
    """
    return float("inf") if stored["deviation_mm"] is None else 1e3 * float(np.mean(stored["deviation_mm"]))
