"""Refuse a fit with large residuals, and warn of residuals above the noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.inference.evidence.experiment import Comparison, Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_fitting.inference.evidence.tensile_curves import TensileEvidence
from eimi_fitting.inference.interval.estimate import Estimate
from eimi_fitting.inference.interval.identifiability import is_open
from eimi_fitting.inference.searching.named_causes import NamedCause

Array = NDArray[np.float64]

# The limits were chosen from four kinds of edges: those of virtual specimens fitted with the right law and with another
# one (Neo-Hookean for a Yeoh material), those of the real beam in docs/why/paper.md, and wrong ones (a scale that is
# wrong by 3, 10 and 30 %, exchanged sides, the wrong sign of the field).
#                                      right law      another law   real beam   wrong
# worst state over deflection          0.0001         0.0008        0.03        0.01, 0.03, 0.20, 0.52, 1.09
# median state over stated noise       1.2 to 1.8     4.9           0.5
# worst state over median state        1.3 to 1.8     4.2           1.1
_OF_DEFLECTION = 0.05
_OF_WIDTH = 0.5  # with a larger residual an edge lies nearer to the opposite simulated edge
OF_NOISE = 10.0
_OF_MEDIAN = 5.0
_WITHIN_NOISE = 3.0  # times the stated uncertainty: a smaller residual does not contradict the law
_CONTRADICTS = 3.0  # standard deviations


class NotExplained(Exception):
    """The exception for a fit that does not explain the measured edges of a load case."""

    def __init__(
        self,
        experiment: int,
        state: int,
        error_mm: float,
        deflection_mm: float,
        curves: bool = False,
        priors: Sequence[str] = (),
    ) -> None:
        self.experiment, self.state = experiment, state
        self._arguments = (experiment, state, error_mm, deflection_mm, curves, priors)
        of_priors = f" with the prior{'s' if len(priors) > 1 else ''} {' and '.join(priors)}" if priors else ""
        super().__init__(
            f"the smallest error of this state is {error_mm:.3g} mm (root mean square), but the largest deflection of "
            f"the beam is {deflection_mm:.3g} mm: no material explains the measured shape of the "
            f"beam{' and the tensile curves' if curves else ''}{of_priors}; check "
            + ("value and unit of the prior, " if priors else "")
            + "the edges of this state, the sign of the field, the scale of the picture, the specimen and the "
            "calibration" + (", and material, unit and weight of the curves" if curves else "")
        )

    def __reduce__(self) -> tuple[type[NotExplained], tuple[int, int, float, float, bool, Sequence[str]]]:
        # For pickle: the default would call the class with the message alone.
        return NotExplained, self._arguments


def deflection_mm(experiment: Experiment) -> float:
    """Return the largest distance in mm of a measured point from the undeformed beam."""
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
    without_clamp: Sequence[Array] | None = None,
    curves: bool = False,
    beyond: bool = False,
    priors: Sequence[str] = (),
) -> None:
    """Raise NotExplained if a fit does not explain the measured edges of a load case."""
    # without_clamp: (K,) for each experiment: root mean square residuals in mm after a correction of the place of the
    # clamp. curves: whether tensile curves were fitted too. beyond: whether tensile curves or priors contradict the
    # fitted parameters. priors: the priors on parameters in words, for the message.
    for index, (experiment, misfit) in enumerate(zip(experiments, final.misfits, strict=True)):
        error = misfit.error_mm[0]
        # A clamp at a wrong place in the picture is no reason to refuse a fit.
        if without_clamp is not None:
            error = np.minimum(error, without_clamp[index])
        moved = deflection_mm(experiment)
        limit = _OF_DEFLECTION * moved
        if isinstance(experiment.observed, EdgeObservation):
            limit = min(limit, _OF_WIDTH * experiment.model.specimen.width_mm)
        stated = _stated_mm(experiment, misfit)
        # A state is refused if its error exceeds both limits.
        limits = np.maximum(limit, np.where(np.isfinite(stated), _WITHIN_NOISE * stated, 0.0))
        # Tensile curves or priors contradict the optimum: no state counts as explained.
        limits = np.zeros_like(limits) if beyond else limits
        worst = int(np.argmax(error - limits))
        if not error[worst] <= limits[worst]:
            raise NotExplained(index, worst, float(error[worst]), moved, curves, priors)


# The subject of a doubt. "perspective" belongs to pictures, and the four subjects after it belong to tensile fits.
DoubtKind = Literal[
    "loads",
    "correction_missing",
    "beyond_noise",
    "state_stands_out",
    "cause",
    "curve_contradicts",
    "prior_contradicts",
    "perspective",
    "rows_left_out",
    "curve_shape",
    "modulus_open",
    "unstable",
]


@dataclass(frozen=True)
class Doubt:
    """A reason to distrust the result of a fit, which is shown as a warning."""

    # The reason, for people.
    words: str
    # Index of the dataset, of the load case in the dataset, and of the tensile curve.
    dataset: int | None = None
    state: int | None = None
    curve: int | None = None
    # Smallest and largest error of the initial shear modulus, in per cent.
    modulus_percent: tuple[float, float] | None = None
    # The reason in few words.
    short: str = ""
    # The subject, for programs.
    kind: DoubtKind | None = field(default=None, compare=False, kw_only=True)


class NotDetermined(Exception):
    """The exception for a fit to only one load case that does not determine the initial shear modulus."""


def check_determined(estimate: Estimate, experiments: Sequence[Experiment]) -> None:
    """Raise NotDetermined if there is only one load case and it does not determine the initial shear modulus."""
    if sum(len(experiment.loads) for experiment in experiments) == 1 and is_open(estimate.initial_shear_modulus):
        low, high = estimate.initial_shear_modulus.interval_95
        raise NotDetermined(
            f"a single state does not determine the initial shear modulus, which may lie anywhere from {low:.4g} to "
            f"{high:.4g} Pa; measure a state under another load"
        )


def curve_doubts(curves: Sequence[TensileEvidence], rmse_Pa: Sequence[float]) -> tuple[Doubt, ...]:
    """Return a warning for each tensile curve that the fitted law describes badly."""
    words = (
        "this curve and the edges contradict each other: check that both belong to the same material and that the unit "
        "of the curve is right"
    )
    return tuple(
        Doubt(words, curve=index, kind="curve_contradicts")
        for index, (curve, rmse) in enumerate(zip(curves, rmse_Pa, strict=True))
        if rmse > _CONTRADICTS * curve.noise_Pa  # the noise of a fit to this curve alone
    )


def prior_doubts(priors: Sequence[Prior], distances: Sequence[float]) -> tuple[Doubt, ...]:
    """Return a warning for each prior that differs from the measurements by more than three standard deviations."""
    return tuple(
        Doubt(
            f"the estimate from the data alone differs from the prior on {prior.parameter}, {prior.mean:.5g} ± "
            f"{prior.standard_deviation:.3g}, by {abs(distance):.1f} standard deviations: data or prior are wrong",
            kind="prior_contradicts",
        )
        for prior, distance in zip(priors, distances, strict=True)
        if abs(distance) > _CONTRADICTS
    )


def slip_doubts(slips: Sequence[NamedCause]) -> tuple[Doubt, ...]:
    """Return a warning for each probable mistake in the given loads, such as a reversed field."""
    return tuple(
        Doubt(
            f"check the loads in the files for {slip.words}: without this mistake the mean error would be about "
            f"{slip.error_without_mm:.2g} mm instead of {slip.error_mm:.2g} mm",
            slip.experiment,
            kind="loads",
        )
        for slip in slips
    )


def doubts(
    final: Comparison,
    experiments: Sequence[Experiment],
    missing: Sequence[str] = (),
    is_named: bool = False,
    is_as_stated: bool = False,
) -> tuple[Doubt, ...]:
    """Return the warnings about a fit that follow from its residuals."""
    # missing: a sentence for each missing correction. is_named: whether the intervals contain the errors that explain
    # the residuals. is_as_stated: whether the stated uncertainties of the inputs explain the residuals.
    result: list[Doubt] = []
    for index, (experiment, misfit) in enumerate(zip(experiments, final.misfits, strict=True)):
        result += [Doubt(words, index, kind="correction_missing") for words in missing]
        error, stated = misfit.error_mm[0], _noise_mm(experiment, misfit)
        ratio = noise_ratio(experiment, misfit)
        if ratio > OF_NOISE and not is_as_stated:
            words = (
                f"the residuals are {ratio:.0f} times the given uncertainty of the measured places: the law, the "
                "geometry, the scale or the loads of the fit differ from the specimen, and the intervals do not "
                "contain this error"
            )
            # The intervals then contain the error.
            if is_named:
                words = f"the residuals are {ratio:.0f} times the given uncertainty of the measured places"
            result.append(Doubt(words, index, kind="beyond_noise"))
        for k in np.flatnonzero((error > _OF_MEDIAN * np.median(error)) & (error > OF_NOISE * stated)):
            words = f"the error of this state is {error[k] / np.median(error):.0f} times the median error of all states"
            result.append(Doubt(words, index, int(k), kind="state_stands_out"))
    return tuple(result)


def pairs(experiments: Sequence[Experiment], final: Comparison) -> Iterator[tuple[Experiment, Misfit]]:
    """Yield each experiment with its residuals."""
    return zip(experiments, final.misfits, strict=True)


def noise_ratio(experiment: Experiment, misfit: Misfit) -> float:
    """Return the root mean square residual divided by the given noise (median of all load cases)."""
    return float(np.median(misfit.error_mm[0] / np.maximum(_noise_mm(experiment, misfit), 1e-9)))


def _noise_mm(experiment: Experiment, misfit: Misfit) -> Array:
    observed = experiment.observed
    if isinstance(observed, EdgeObservation) and observed.noise_mm is not None:
        # Without the increase for a defect of the picture, such as blur, which could hide a wrong law.
        observed = replace(observed, sigma_mm=observed.noise_mm)
    return _stated_mm(replace(experiment, observed=observed), misfit)


def _stated_mm(experiment: Experiment, misfit: Misfit) -> Array:
    # (K,): the root mean square of the stated uncertainties of the points that are used.
    sigma = experiment.observed.sigma_mm
    if not isinstance(experiment.observed, EdgeObservation):
        sigma = np.repeat(sigma[:, None], 2, axis=1)
    used = misfit.weights > 0
    return np.array([np.sqrt(np.mean(s[u] ** 2)) if u.any() else np.inf for s, u in zip(sigma, used, strict=True)])
