"""Measure the stress-free shape of a specimen from the edges of the beam without load."""

# The stress-free shape is the shape in the specimen file, plus a few smooth deviations (modes) with amplitudes in mm.
# The amplitudes are fitted so that the edges of the beam, which its weight bends, agree with the measured edges. A mode
# is used if its amplitude exceeds three standard deviations, and 0.005 mm for a bend or 0.003 mm for a change of width.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.rest_modes import BENDS, TAPER, WAIST, WIDTHS, bend_offset, with_modes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.correlation import correlation_length
from eimi_fitting.inference.evidence._coarse import coarsened, on_coarse_mesh
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM, Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.evidence.unknowns import Setup, Unknowns
from eimi_fitting.inference.searching.modulus_range import NothingActs, NothingConverged, narrowed, scanned
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space

Array = NDArray[np.float64]

_LAW = LAWS["neo-hookean"]
_MODES = BENDS + WIDTHS
_STEPS_MM = np.array([0.02] * BENDS + [0.005] * WIDTHS)  # of the difference quotients
_LEAST_MM = np.array([0.005] * BENDS + [0.003] * WIDTHS)  # worth about 0.05 and 0.2 % of the modulus
_PRIOR_MM = np.array([5.0] * BENDS + [0.5] * WIDTHS)  # no cast beam is assumed to deviate farther
_TURN_DEG, _SHIFT_MM = 1.0, 0.2  # prior standard deviations of the picture's turn and shift
_PICTURE_STEPS = 0.01 * np.eye(2)  # of the difference quotients, in degrees and mm
_SURE = 3.0  # standard deviations
_SYSTEMATIC_MM = 1e-3  # an error of the edges that does not average out
_OF_AMPLITUDE = 0.015  # error of the planar model's weight: a bend of 1 mm of a hidden solid is measured as 0.985 mm
# Share of the largest field or tip force up to which a state counts as unloaded. The simulation contains this small
# field or force, as it contains the weight.
_NO_LOAD = 0.02
_ACROSS = 0.05  # share of gravity across the clamp up to which the weight is not taken for a bend, about 3 degrees
_BENT_STATES, _ROUNDS, _STEPS = 4, 3, 2
_STIFF_PA = 1e6
_WORST_MM = 0.2  # a larger root mean square residual has another cause than the shape at rest; no shape is returned
_POINTS_A_STATE = 20.0  # independent points in a state; a guess that only the scan of moduli uses
_TOLERANCE_MM = 1e-4


@dataclass(frozen=True)
class MeasuredRestShape:
    """The stress-free shape of a specimen, measured without load."""

    # The specimen with the measured shape.
    specimen: Specimen
    # bends_mm, widths_mm: differences of the middle line and of the width from the specimen file, as coefficients of
    # smooth functions.
    bends_mm: tuple[float, ...]
    widths_mm: tuple[float, ...]
    # bend_sigma_mm, width_sigma_mm: largest standard uncertainties of these coefficients.
    bend_sigma_mm: float
    width_sigma_mm: float

    def applied(self, experiment: Experiment, of: str = "states without load") -> Experiment:
        """Return the experiment with the measured stress-free shape and its uncertainty."""
        # `of` is the name of the measurement. Datasets with equal names share one error of the shape.
        sigmas = {"rest-shape": self.bend_sigma_mm, "taper": TAPER * self.width_sigma_mm}
        taper, waist = (of_width * mode for of_width, mode in zip((TAPER, WAIST), self.widths_mm, strict=True))
        others = (stated for stated in experiment.stated if stated.source not in sigmas)
        return replace(
            experiment,
            model=experiment.model.of(self.specimen),
            solid=None if experiment.solid is None else experiment.solid.of(self.specimen),
            stated=(*others, *(StatedSource(source, sigma, of) for source, sigma in sigmas.items() if sigma)),
            measured={"rest-shape": self.bends_mm, "taper": (taper, waist)},
        )

    @property
    def in_words(self) -> str:
        """The measured deviations from the specimen file as text, such as "bent by up to 0.9 mm"."""
        words = []
        if any(self.bends_mm):
            along = np.linspace(0, 1, 51)
            offset_mm = bend_offset(self.bends_mm, along)
            words.append(f"bent by up to {np.abs(offset_mm).max():.2g} mm")
        if any(self.widths_mm):
            words.append(f"its width varies by up to {2 * np.abs(self.widths_mm).max():.2g} mm")
        return ", ".join(words)


def measured_rest_shape(experiment: Experiment) -> MeasuredRestShape | None:
    """Measure the stress-free shape of a specimen from the edges of the beam without load."""
    # The result is None if the shape cannot be measured, or hardly differs from the specimen file.
    unloaded = unloaded_states(experiment)
    bent = np.setdiff1d(np.arange(len(experiment.loads)), unloaded)
    if not isinstance(experiment.observed, EdgeObservation) or not len(unloaded) or not len(bent):
        return None
    gravity = experiment.loads.gravity[unloaded]
    if np.abs(gravity[:, 1]).max() > _ACROSS * max(float(np.linalg.norm(gravity, axis=1).max()), 1e-9):
        return None
    plain = replace(experiment, solid=None, change=None, stated=())
    (rest,) = on_coarse_mesh([plain.of_states(unloaded)])
    few = bent[np.unique(np.linspace(0, len(bent) - 1, _BENT_STATES).round().astype(int))]
    (chosen,) = coarsened([plain.of_states(few)])
    every = np.arange(_MODES)
    # A straight beam that hangs along gravity stays straight for every modulus. A fit with a stiff beam therefore shows
    # whether the stress-free shape differs from the shape in the specimen file at all.
    fitted = _amplitudes(rest, _STIFF_PA, np.zeros(_MODES), every)
    if fitted is None or not len(_significant(*fitted)):
        return None
    try:
        modulus_Pa = _scanned_modulus(_shaped(chosen, fitted[0]))
    except (NothingActs, NothingConverged):
        return None
    # The weight bends the beam, so that the shape depends on the modulus: both are computed in turn.
    for _ in range(_ROUNDS):
        fitted = _amplitudes(rest, modulus_Pa, fitted[0], every)
        if fitted is None:
            return None
        modulus_Pa = _nearby_modulus(_shaped(chosen, fitted[0]), modulus_Pa)
    # A deviation that is not significant gets the amplitude 0.
    used = _significant(*fitted)
    fitted = _amplitudes(rest, modulus_Pa, np.where(np.isin(every, used), fitted[0], 0.0), used) if len(used) else None
    if fitted is None:
        return None
    amplitudes, sigma = fitted
    sigma = np.hypot(sigma, _OF_AMPLITUDE * np.abs(amplitudes))
    bends, widths = (part[np.isin(part, used)] for part in np.split(np.arange(_MODES), [BENDS]))
    return MeasuredRestShape(
        _shaped(experiment, amplitudes).model.specimen,
        tuple(amplitudes[:BENDS].tolist()),
        tuple(amplitudes[BENDS:].tolist()),
        float(sigma[bends].max(initial=0.0)),
        float(sigma[widths].max(initial=0.0)),
    )


def _significant(amplitudes: Array, sigma: Array) -> NDArray[np.intp]:
    # Indices of the amplitudes (mm) that differ significantly from zero.
    # The standard deviations ``sigma`` are in mm.
    return np.flatnonzero(np.abs(amplitudes) > np.maximum(_LEAST_MM, _SURE * sigma))


def unloaded_states(experiment: Experiment) -> NDArray[np.intp]:
    """Return the indices of the load cases in which field and tip force are at most 2 % of their largest values."""
    loads = experiment.loads
    # The stress-free shape is not measured if a pressure acts in any state.
    if np.any(np.asarray(loads.pressure_Pa)):
        return np.zeros(0, np.intp)
    sizes = (np.linalg.norm(vectors, axis=1) for vectors in (loads.field_T, loads.tip_force_N))
    return np.flatnonzero(np.all([size <= _NO_LOAD * size.max() for size in sizes], axis=0))


def _shaped(experiment: Experiment, amplitudes: Array) -> Experiment:
    # Add smooth modes with these amplitudes (mm) to the stress-free shape.
    specimen = with_modes(experiment.model.specimen, amplitudes[:BENDS].tolist(), amplitudes[BENDS:].tolist())
    return replace(experiment, model=experiment.model.of(specimen))


def _residuals(experiment: Experiment, modulus_Pa: float, setups: Sequence[Setup]) -> list[Array] | None:
    # Distances (mm) of measured points from simulated edges, for each of several shifts of the picture.
    shapes = experiment.model.solve(_LAW, np.array([[modulus_Pa]]), experiment.loads, tolerance_mm=_TOLERANCE_MM)
    if not np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all():
        return None
    used = np.isfinite(experiment.observed.sigma_mm)
    misfits = (experiment.observed.misfit(experiment.model, shapes, setup) for setup in setups)
    return [misfit.residuals[0][used] for misfit in misfits]


def _amplitudes(
    rest: Experiment, modulus_Pa: float, start: Array, used: NDArray[np.intp]
) -> tuple[Array, Array] | None:
    # Fit the amplitudes of the modes `used` (indices). Returns the amplitudes of all modes and their uncertainties in
    # mm.
    # A small rotation and a small shift of the picture are fitted, too.
    amplitudes, picture = start.copy(), np.zeros(2)
    priors = np.concatenate([_PRIOR_MM[used], [_TURN_DEG, _SHIFT_MM]])
    tau, spread, inverse = 1.0, 0.0, np.zeros((len(priors), len(priors)))
    for _ in range(_STEPS):
        turned = [_picture(picture), *(_picture(picture + step) for step in _PICTURE_STEPS)]
        here = _residuals(_shaped(rest, amplitudes), modulus_Pa, turned)
        if here is None:
            return None
        columns = []
        for mode in used:
            ahead = amplitudes.copy()
            ahead[mode] += _STEPS_MM[mode]
            moved = _residuals(_shaped(rest, ahead), modulus_Pa, turned[:1])
            if moved is None:
                return None
            columns.append((moved[0] - here[0]) / _STEPS_MM[mode])
        columns += [(further - here[0]) / _PICTURE_STEPS[0, 0] for further in here[1:]]
        slopes = np.stack(columns, axis=1)
        # The noise is small beside the priors, so that its level hardly matters here.
        inverse = np.linalg.inv(slopes.T @ slopes + np.diag((_SYSTEMATIC_MM / priors) ** 2))
        step = -inverse @ (slopes.T @ here[0])
        amplitudes[used] += step[:-2]
        picture = picture + step[-2:]
        remaining = here[0] + slopes @ step
        spread = float(np.sqrt(np.mean(remaining**2)))
        tau = correlation_length(remaining[None], np.ones((1, len(remaining))))
    if spread > _WORST_MM:
        return None
    sigma = np.zeros(_MODES)
    sigma[used] = np.hypot(spread * np.sqrt(tau * np.diag(inverse)[:-2]), _SYSTEMATIC_MM)
    return amplitudes, sigma


def _picture(turn_deg_shift_mm: Array) -> Setup:
    turn_deg, shift_mm = turn_deg_shift_mm
    return Setup.of([("roll", 0, float(turn_deg)), ("clamp", 1, float(shift_mm))], 1)


def _scanned_modulus(bent: Experiment) -> float:
    # The shear modulus for which simulated edges are closest to measured edges.
    problem = Problem(_LAW, Unknowns(search_space(_LAW)), (bent,))
    points = _POINTS_A_STATE * len(bent.loads)
    return _nearby_modulus(bent, narrowed(problem, scanned(problem, points), points).best_Pa)


def _nearby_modulus(bent: Experiment, near_Pa: float) -> float:
    # The same near `near_Pa`.
    trial = near_Pa * np.exp(np.linspace(-0.2, 0.2, 5))
    errors = _errors_mm(bent, trial)
    if errors.max() >= DISCARDED_MM:
        return near_Pa
    # The mean square is close to a parabola in the logarithm of the modulus.
    _, slope, bend = np.polynomial.polynomial.polyfit(np.log(trial / near_Pa), errors**2, 2)
    return float(near_Pa * np.exp(np.clip(-0.5 * slope / bend, -0.3, 0.3))) if bend > 0 else near_Pa


def _errors_mm(bent: Experiment, moduli_Pa: Array) -> Array:
    # (S,): root mean square distance of measured points from simulated edges, for S shear moduli.
    shapes = bent.model.solve(_LAW, moduli_Pa[:, None], bent.loads, tolerance_mm=1e-3)
    error = np.sqrt(np.mean(bent.observed.misfit(bent.model, shapes).error_mm ** 2, axis=1))
    return np.where(shapes.converged, error, DISCARDED_MM)
