"""Whether a fit deserves to be believed: what is left of the edges against how far the beam moved and against noise.

A law that leaves a state's edges unexplained by a twentieth of the largest deflection, or by half the beam's width,
explains nothing: edges of another beam, a wrong scale, a wrong sign of the field, left taken for right. There is then
no result. Residuals many times the noise that the edges state are a result with a doubt, which is said. So is a clamp
that is not where it was stated to be: all states are off alike then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.inference.doubts.common_error import CommonError
from eimi_fitting.inference.evidence.experiment import Comparison, Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_fitting.inference.evidence.tensile_curves import TensileEvidence
from eimi_fitting.inference.interval.estimate import Estimate
from eimi_fitting.inference.interval.identifiability import is_open
from eimi_fitting.inference.searching.named_causes import NamedCause

Array = NDArray[np.float64]

# Measured on the virtual specimens' edges (the right law; Neo-Hookean on a Yeoh material), on the real beam of
# docs/why/paper.md, and on edges that are wrong: scale by 3, 10, 30 %, sides swapped, sign of the field.
#                                      right law      another law   real beam   wrong
# worst state over deflection          0.0001         0.0008        0.03        0.01, 0.03, 0.20, 0.52, 1.09
# median state over stated noise       1.2 to 1.8     4.9           0.5
# worst state over median state        1.3 to 1.8     4.2           1.1
_OF_DEFLECTION = 0.05
_OF_WIDTH = 0.5  # beyond this one edge lies nearer to the other's place than to its own
_OF_NOISE = 10.0
_OF_MEDIAN = 5.0
_WITHIN_NOISE = 3.0  # times what the places state: no more than that says nothing against a law
_OF_ERROR = 0.5  # noise alone leaves nearly all of it
_CONTRADICTS = 3.0  # times the misfit of the curve alone: as unlikely as three standard deviations are


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
            f"the best candidate is {error_mm:.3g} mm off (root mean square), where the beam moves by "
            f"{deflection_mm:.3g} mm at most: "
            f"no material explains this{' and the tensile curves' if curves else ''}; check that state's edges, the "
            "sign of the field, the scale of the picture, and specimen and calibration"
            + (", and material, unit and weight of the curves" if curves else "")
        )

    def __reduce__(self) -> tuple[type[NotExplained], tuple[int, int, float, float, bool]]:
        """An error with more than words has to say how another process is told of it."""
        return NotExplained, self._found


def deflection_mm(experiment: Experiment) -> float:
    """Largest distance of anything that was seen, in any state, from the beam at rest."""
    model: BeamModel = experiment.model
    k = len(experiment.loads)
    rest = Shapes(
        displacement=np.zeros((1, k, len(model.mesh.nodes), 2)),
        rigid=np.zeros((1, k, 3)),
        status=np.full((1, k), Status.CONVERGED, np.int8),
        iterations=np.zeros((1, k), np.intp),
        max_stretch=np.ones((1, k)),
        last=model.solid.rest(1),
    )
    residuals = experiment.observed.misfit(model, rest).residuals[0]
    if isinstance(experiment.observed, EdgeObservation):
        return float(np.abs(residuals).max())
    return float(np.sqrt((residuals**2).sum(axis=1)).max())


def check_explained(
    final: Comparison,
    experiments: Sequence[Experiment],
    alike: Sequence[CommonError],
    curves: bool = False,
    beyond: bool = False,
) -> None:
    """Raises NotExplained for the worst state of the first experiment that the law does not explain.

    alike: what all states of an experiment are off alike; a clamp that is elsewhere is a doubt and no refusal; beyond:
    see `Evaluation`, nothing is explained then.
    """
    for index, (experiment, misfit) in enumerate(zip(experiments, final.misfits, strict=True)):
        error = misfit.error_mm[0]
        if alike[index].kind == "clamp":
            error = np.minimum(error, alike[index].error_mm)
        moved = deflection_mm(experiment)
        limit = _OF_DEFLECTION * moved
        if isinstance(experiment.observed, EdgeObservation):
            limit = min(limit, _OF_WIDTH * experiment.model.specimen.width_mm)
        stated = _stated_mm(experiment, misfit)
        limits = np.maximum(limit, np.where(np.isfinite(stated), _WITHIN_NOISE * stated, 0.0))
        limits = np.zeros_like(limits) if beyond else limits
        worst = int(np.argmax(error - limits))
        if not error[worst] <= limits[worst]:
            raise NotExplained(index, worst, float(error[worst]), moved, curves)


DoubtKind = Literal[
    "loads",
    "correction_missing",
    "beyond_noise",
    "state_stands_out",
    "clamp",
    "roll",
    "scale",
    "curve_contradicts",
    "prior_contradicts",
    "perspective",
    "rows_left_out",
    "curve_shape",
    "modulus_open",
    "unstable",
]
"""What a doubt is about; the last four are of tensile fits, and the one before them is of pictures."""


@dataclass(frozen=True)
class Doubt:
    """Something a reader of the result should know: about a dataset, one state of it, or a tensile curve.

    Parameters
    ----------
    words : str
        The doubt in English, for a person. Programs decide by `kind`.
    dataset, state, curve : int, optional
        Counted from 0; all of them None for what is doubtful of the fit as a whole.
    kind : DoubtKind, optional
        What the doubt is about. None where the doubt was read from a file, which does not hold the kind.
    """

    words: str
    dataset: int | None = None
    state: int | None = None
    curve: int | None = None
    kind: DoubtKind | None = field(default=None, compare=False, kw_only=True)


class NotDetermined(Exception):
    """One state alone does not say how stiff the material is."""


def check_determined(found: Estimate, experiments: Sequence[Experiment]) -> None:
    """Raises NotDetermined where one state is all there is, and leaves the initial shear modulus open."""
    if sum(len(experiment.loads) for experiment in experiments) == 1 and is_open(found.initial_shear_modulus):
        low, high = found.initial_shear_modulus.interval_95
        raise NotDetermined(
            f"this one state leaves the initial shear modulus open: it may lie anywhere from {low:.4g} to {high:.4g} "
            "Pa; measure a state under another load"
        )


def curve_doubts(curves: Sequence[TensileEvidence], rmse_Pa: Sequence[float]) -> tuple[Doubt, ...]:
    """The curves that the law follows far worse in this fit, with such root mean squares, than it does alone."""
    words = "this curve and the edges contradict each other: is it the same material, and its unit right?"
    return tuple(
        Doubt(words, curve=index, kind="curve_contradicts")
        for index, (curve, rmse) in enumerate(zip(curves, rmse_Pa, strict=True))
        if rmse > _CONTRADICTS * curve.noise_Pa
    )


def prior_doubts(priors: Sequence[Prior], distances: Sequence[float]) -> tuple[Doubt, ...]:
    """Return a doubt for each prior from which the data alone lie more than three standard deviations."""
    return tuple(
        Doubt(
            f"the data alone lie {abs(distance):.1f} standard deviations from the prior on {prior.parameter}, "
            f"{prior.mean:.5g} ± {prior.standard_deviation:.3g}: one of the two is wrong",
            kind="prior_contradicts",
        )
        for prior, distance in zip(priors, distances, strict=True)
        if abs(distance) > _CONTRADICTS
    )


def slip_doubts(slips: Sequence[NamedCause]) -> tuple[Doubt, ...]:
    """The slips in the loads without which the errors would be far less."""
    return tuple(
        Doubt(
            f"is there {slip.words}? without it the mean error would be about {slip.error_without_mm:.2g} mm and not "
            f"{slip.error_mm:.2g} mm",
            slip.experiment,
            kind="loads",
        )
        for slip in slips
    )


def common_doubts(final: Comparison, alike: Sequence[CommonError]) -> tuple[Doubt, ...]:
    """The datasets whose states are all off alike, by what explains more than half of their error."""
    return tuple(
        Doubt(_in_words(own), index, kind=own.kind or None)
        for index, (misfit, own) in enumerate(zip(final.misfits, alike, strict=True))
        if own.error_mm.mean() < _OF_ERROR * misfit.error_mm[0].mean()
    )


def _in_words(own: CommonError) -> str:
    if own.kind == "clamp":
        x, y = own.sizes
        seen = f"lie ({x:+.2g}, {y:+.2g}) mm beside the simulated ones"
        remedy = (
            "the clamp is not where it is stated; correct its place (clamp_midpoint_px; eimi segment --calibration), "
            f"or free it (--free clamp={np.hypot(x, y):.1g})"
        )
    elif own.kind == "roll":
        degrees = float(np.degrees(own.sizes[0]))
        seen = f"are turned by {degrees:+.2g} degrees about the clamp"
        remedy = (
            "correct axis_angle_deg (eimi segment --calibration), "
            f"or free the camera's roll (--free roll={abs(degrees):.1g})"
        )
    else:
        seen = f"are {100 * own.sizes[0]:+.2g} % off in scale"
        size = abs(own.sizes[0])
        remedy = (
            "check pixels_per_mm, length_mm and width_mm (eimi segment takes the corrected file), "
            f"or free the scale (--free scale={size:.1g})"
        )
    return (
        f"the measured places {seen} in all states alike: {remedy}; as it is, the parameters take a part of that upon "
        "themselves"
    )


def doubts(final: Comparison, experiments: Sequence[Experiment], missing: Sequence[str] = ()) -> tuple[Doubt, ...]:
    """What is doubtful of the comparison's first candidate; missing: what is said of each correction not found."""
    found: list[Doubt] = []
    for index, (experiment, misfit) in enumerate(zip(experiments, final.misfits, strict=True)):
        found += [Doubt(words, index, kind="correction_missing") for words in missing]
        error, stated = misfit.error_mm[0], _stated_mm(experiment, misfit)
        ratio = float(np.median(error / np.maximum(stated, 1e-9)))
        if ratio > _OF_NOISE:
            words = (
                f"the residuals are {ratio:.0f} times the uncertainty that the measured places state: law, "
                "geometry, scale or loads are not quite the specimen's, and the intervals do not hold that"
            )
            found.append(Doubt(words, index, kind="beyond_noise"))
        for k in np.flatnonzero((error > _OF_MEDIAN * np.median(error)) & (error > _OF_NOISE * stated)):
            words = f"its error is {error[k] / np.median(error):.0f} times that of the median state"
            found.append(Doubt(words, index, int(k), kind="state_stands_out"))
    return tuple(found)


def _stated_mm(experiment: Experiment, misfit: Misfit) -> Array:
    """(K,): root mean square of the uncertainty that a state's measured places state, infinite for none."""
    sigma = experiment.observed.sigma_mm
    if not isinstance(experiment.observed, EdgeObservation):
        sigma = np.repeat(sigma[:, None], 2, axis=1)
    used = misfit.weights > 0
    return np.array([np.sqrt(np.mean(s[u] ** 2)) if u.any() else np.inf for s, u in zip(sigma, used, strict=True)])
