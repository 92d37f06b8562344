"""What a law is off by on a specimen, as `eimi validate` measures it: with the corrections for mesh and section."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.inference.evidence.corrections import SOLID, Correction, correction, refinements
from eimi_fitting.inference.evidence.experiment import Comparison, Experiment, compare
from eimi_fitting.laws import LAWS
from eimi_lab.study.routes import Route

Array = NDArray[np.float64]


def errors_of(routes: Sequence[Route], experiment: Experiment) -> list[dict[str, Any]]:
    """Of each route, ready to be stored: error_mm and deviation_mm by state, edges_mm (2, n, 2) of the last state.

    All are None where the law finds no equilibrium. What depth does is found from what it did to the route before.
    """
    found: list[dict[str, Any]] = []
    depth = None
    for route in routes:
        one, solid = _errors_of(route, experiment, depth)
        found.append(one)
        depth = depth or solid
    return found


def _errors_of(
    route: Route, experiment: Experiment, depth: Correction | None
) -> tuple[dict[str, Any], Correction | None]:
    """With what the solid changed; depth: the same of another law."""
    law, values = LAWS[route.law], np.array([route.values])

    def against(experiments: Sequence[Experiment]) -> Comparison:
        return compare(law, values, experiments)

    nothing = {"error_mm": None, "deviation_mm": None, "edges_mm": None}
    plain = against([experiment])
    if plain.unconverged[0]:
        return nothing, None
    found = [
        correction(own, [experiment], plain, against, [depth] if depth and own is SOLID else ())
        for own in refinements([experiment])
    ]
    solid = experiment.model.specimen.section == "solid"
    if solid and found[-1] is None:
        return nothing, None
    made = [own for own in found if own]
    change = sum((own.changes[0] for own in made), start=np.zeros_like(plain.misfits[0].residuals[0]))
    misfit = experiment.observed.misfit(experiment.model, plain.shapes[0], None, change)
    model, shapes = (made[-1].models[0], made[-1].better.shapes[0]) if made else (experiment.model, plain.shapes[0])
    edges = points_on(outline(model, shapes)[0, -1:], 2)[0]
    errors = {
        "error_mm": misfit.error_mm[0].tolist(),
        "deviation_mm": misfit.deviation_mm[0].tolist(),
        "edges_mm": edges.round(4).tolist(),
    }
    return errors, found[-1] if solid else None


def mean_error_um(stored: dict[str, Any]) -> float:
    """Over the states, in µm; infinite where the law finds no equilibrium."""
    return float("inf") if stored["error_mm"] is None else 1e3 * float(np.mean(stored["error_mm"]))


def mean_deviation_um(stored: dict[str, Any]) -> float:
    """Likewise of the deviation."""
    return float("inf") if stored["deviation_mm"] is None else 1e3 * float(np.mean(stored["deviation_mm"]))
