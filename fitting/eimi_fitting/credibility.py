"""Whether a fit deserves to be believed: what is left of the edges against how far the beam moved and against noise.

A law that leaves a state's edges unexplained by a twentieth of the largest deflection, or by half the beam's width,
explains nothing: edges of another beam, a wrong scale, a wrong sign of the field, left taken for right. There is then
no result. Residuals many times the noise that the edges state are a result with a doubt, which is said.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.experiment import Comparison, Experiment
from eimi_fitting.forward import BeamModel, Shapes
from eimi_fitting.observation import EdgeObservation
from eimi_fitting.solid import Status

_OF_DEFLECTION = 0.05
_OF_WIDTH = 0.5
_OF_NOISE = 10.0
_OF_MEDIAN = 5.0
_NO_FINER_MESH = (
    "with these parameters a finer mesh finds no equilibrium: what the mesh does to the edges (often "
    "some tenths of a per cent of the modulus) is neither in the parameters nor in the intervals"
)


class NotExplained(Exception):
    """No candidate comes near the edges of one state; experiment and state count from 0.

    curves: it had to follow tensile curves as well, which may be what holds it off.
    """

    def __init__(
        self, experiment: int, state: int, error_mm: float, deflection_mm: float, curves: bool = False
    ) -> None:
        self.experiment, self.state = experiment, state
        self._found = (experiment, state, error_mm, deflection_mm, curves)
        super().__init__(
            f"the best candidate is {error_mm:.3g} mm off, where the beam moves by {deflection_mm:.3g} mm at most: "
            f"no material explains this{' and the tensile curves' if curves else ''}; check that state's edges, the "
            "sign of the field, the scale of the picture, and specimen and calibration"
            + (", and material, unit and weight of the curves" if curves else "")
        )

    def __reduce__(self) -> tuple[type[NotExplained], tuple[int, int, float, float, bool]]:
        """An error with more than words has to say how another process is told of it."""
        return NotExplained, self._found


def deflection_mm(experiment: Experiment) -> float:
    """Largest over the states of the distance, as the metric has it, from what was seen to the beam at rest."""
    model: BeamModel = experiment.model
    k = len(experiment.loads)
    rest = Shapes(
        np.zeros((1, k, len(model.mesh.nodes), 2)),
        np.zeros((1, k, 3)),
        np.full((1, k), Status.CONVERGED, np.int8),
        np.zeros((1, k), np.intp),
        np.ones((1, k)),
        model.solid.rest(1),
    )
    return float(experiment.observed.misfit(model, rest).error_mm.max())


def check_explained(final: Comparison, experiments: Sequence[Experiment], curves: bool = False) -> None:
    """Raises NotExplained for the worst state of the first experiment that the law does not explain."""
    for index, (experiment, misfit) in enumerate(zip(experiments, final.misfits, strict=True)):
        error = misfit.error_mm[0]
        moved = deflection_mm(experiment)
        limit = _OF_DEFLECTION * moved
        if isinstance(experiment.observed, EdgeObservation):
            limit = min(limit, _OF_WIDTH * experiment.model.specimen.width_mm)
        worst = int(np.argmax(error))
        if not error[worst] <= limit:
            raise NotExplained(index, worst, float(error[worst]), moved, curves)


def doubts(
    final: Comparison, experiments: Sequence[Experiment], finer_mesh: bool = True
) -> list[tuple[int, int | None, str]]:
    """What a reader of the result should know: (experiment, state or None for all, words).

    finer_mesh: whether what a finer mesh changes is in the result.
    """
    found: list[tuple[int, int | None, str]] = []
    for index, (experiment, misfit) in enumerate(zip(experiments, final.misfits, strict=True)):
        if not finer_mesh:
            found.append((index, None, _NO_FINER_MESH))
        error = misfit.error_mm[0]
        used = misfit.weights > 0
        if isinstance(experiment.observed, EdgeObservation):
            sigma = experiment.observed.sigma_mm
        else:
            sigma = np.repeat(experiment.observed.sigma_mm[:, None], 2, axis=1)
        stated = np.array(
            [np.sqrt(np.mean(s[u] ** 2)) if u.any() else np.inf for s, u in zip(sigma, used, strict=True)]
        )
        ratio = float(np.median(error / np.maximum(stated, 1e-9)))
        if ratio > _OF_NOISE:
            found.append(
                (
                    index,
                    None,
                    f"the residuals are {ratio:.0f} times the uncertainty that the measured places state: law, "
                    "geometry, scale or loads are not quite the specimen's, and the intervals do not hold that",
                )
            )
        for k in np.flatnonzero((error > _OF_MEDIAN * np.median(error)) & (error > _OF_NOISE * stated)):
            found.append(
                (index, int(k), f"its error is {error[k] / np.median(error):.0f} times that of the median state")
            )
    return found
