"""The identified viscoelastic law, in the form in which a result file stores it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.quantity import NORMAL_95, Quantity
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.interval.budget import BudgetEntry
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.decay import Window
from eimi_fitting.time.evidence import RingEvidence
from eimi_fitting.time.law_of_time import TimeOptimum
from eimi_fitting.time.slow_evidence import CreepEvidence, StaticEvidence
from eimi_fitting.time.small_effects import SmallEffect, small_effects
from eimi_fitting.time.terms import Terms

Array = NDArray[np.float64]

_KNOWN = 0.05  # mu(t) is determined if the 95 % interval of ln mu(t), from noise alone, has at most this half-width
_CURVE = np.geomspace(1e-3, 1e3, 61)
_MOST_FRAMES = 240  # of a decay that are stored for a figure
_CONTRADICTION = 3.0  # standard deviations


@dataclass(frozen=True)
class PronyTerm:
    """A term of the Prony series."""

    # Fraction of the instantaneous modulus that the term loses.
    g: float
    # Relaxation time.
    tau_s: float


@dataclass(frozen=True)
class ModulusAt:
    """The shear modulus in Pa at a time in s after a sudden strain, with its 95 % interval."""

    time_s: float
    value: float
    interval_95: tuple[float, float]


@dataclass(frozen=True)
class RingDown:
    """The result for one free vibration: frequency, loss factor, and displacement over time."""

    # The name of the recording.
    label: str
    # `frequency_Hz`, `frequency_sigma_Hz`: frequency at small amplitudes and its standard uncertainty.
    frequency_Hz: float
    frequency_sigma_Hz: float
    # `decay_loss`, `decay_loss_sigma`: loss factor of the decay and its standard uncertainty. The loss factor is twice
    # the decay rate divided by the angular frequency. Weight and field make it differ from that of the material.
    decay_loss: float
    decay_loss_sigma: float
    # Amplitude at the start of the fitted part, where the beam moves most.
    amplitude_mm: float
    # `frequency_change`, `loss_change`: relative change of the frequency, and change of the loss factor, from small
    # amplitudes to ``amplitude_mm``.
    frequency_change: float
    loss_change: float
    # Frequencies of the higher modes.
    higher_Hz: tuple[float, ...]
    # Frequency and loss factor in parts of the recording.
    windows: tuple[Window, ...]
    # Times of the frames.
    time_s: tuple[float, ...]
    # `displacement_mm`, `envelope_mm`: displacement in the vibration, and amplitude, where the beam moves most.
    displacement_mm: tuple[float, ...]
    envelope_mm: tuple[float, ...]


@dataclass(frozen=True)
class CreepCurve:
    """The measured and the fitted rotation of the tip in a recording of creep."""

    # In degrees, each minus its mean over time.

    label: str
    time_s: tuple[float, ...]
    measured_deg: tuple[float, ...]
    # The standard uncertainty of the rotation.
    sigma_deg: tuple[float, ...]
    fitted_deg: tuple[float, ...]


@dataclass(frozen=True)
class LawOfTime:
    """The identified viscoelastic law: a shear modulus that depends on time."""

    # mu* is the complex modulus, and mu(t) the modulus at the time t after a sudden strain.

    # Frequency of the first free vibration.
    frequency_Hz: float
    # Loss factor Im mu* / Re mu* at ``frequency_Hz``.
    loss_factor: float
    # 95 % interval of the loss factor.
    loss_interval_95: tuple[float, float]
    # Storage modulus Re mu* at ``frequency_Hz``.
    dynamic_shear_modulus: Quantity
    # The terms of the Prony series.
    prony: tuple[PronyTerm, ...]
    # `instantaneous_shear_modulus`, `long_term_shear_modulus`: the modulus mu(0), and the limit of mu(t) for long
    # times.
    instantaneous_shear_modulus: Quantity
    long_term_shear_modulus: Quantity
    # Range of times in which the data determine mu(t) to 5 %; None if they determine it to 5 % at no time.
    known_between_s: tuple[float, float] | None
    # Factor on the given magnetic moment with which static states and motions give the same modulus.
    moment: Quantity | None
    # Median time from a static load to the measurement of the edges.
    static_age_s: float | None
    # The modulus mu(t) at several times.
    modulus_by_time: tuple[ModulusAt, ...]
    # The result for each free vibration.
    ring_downs: tuple[RingDown, ...]
    # The measured and fitted rotations of each recording of creep.
    creep: tuple[CreepCurve, ...]
    # Contributions to the uncertainty of the dynamic modulus, the largest first.
    budget: tuple[BudgetEntry, ...]
    # Effects that are estimated but not corrected, such as the air.
    small_effects: tuple[SmallEffect, ...]
    # Logarithm of the evidence (probability density of the data) for one, two, ... terms.
    log_evidence: tuple[float, ...]
    # `chi2`, `rows`: sum of the squared residuals, and number of residuals.
    chi2: float
    rows: int
    # Reasons to distrust the result.
    doubts: tuple[str, ...]
    # Number of laws for which the residuals were computed.
    evaluations: int
    # Duration of the identification.
    wall_s: float


def storage_modulus(terms: Terms, unknowns: Array, omega: float) -> Array:
    """Return the storage modulus of many candidate laws at an angular frequency in rad/s."""
    # ``unknowns``: (P, m) for P laws with m unknowns.
    instantaneous, series = terms.split(unknowns[:, :-1])
    return np.asarray(instantaneous * series.complex_ratio(np.full((len(unknowns), 1), 1j * omega))[:, 0].real)


def _loss(terms: Terms, unknowns: Array, omega: float) -> Array:
    _, series = terms.split(unknowns[:, :-1])
    value = series.complex_ratio(np.full((len(unknowns), 1), 1j * omega))[:, 0]
    return np.asarray(value.imag / value.real)


def result_of(
    *,
    specimen: Specimen,
    optimum: TimeOptimum,
    optima: Sequence[TimeOptimum],
    rings: tuple[RingEvidence, ...],
    creeps: tuple[CreepEvidence, ...],
    static: StaticEvidence | None,
    data_s: tuple[float, float],
    sources: Mapping[str, float],
    effects: Mapping[str, Array],
    steps: Mapping[str, Array],
    load_sigmas: Mapping[str, float],
    draws: Array,
    draws_fit: Array,
    doubts: tuple[str, ...],
    exposure_s: float | None,
    wall_s: float,
) -> LawOfTime:
    """Collect the identified viscoelastic law with its intervals, its budget of uncertainties and its warnings."""
    # ``specimen``: the specimen of all motions.
    # ``optimum``, ``optima``: the chosen optimum, and the optima for all numbers of terms.
    # ``rings``, ``creeps``, ``static``: the data.
    # ``data_s``: shortest and longest time about which the data give information.
    # ``sources``: standard uncertainties of the inputs.
    # ``effects``, ``steps``: changes of the residuals and of the unknowns by these uncertainties.
    # ``load_sigmas``: relative standard uncertainties of the magnetic loads.
    # ``draws``, ``draws_fit``: random draws of the unknowns, one row each, with the errors of the inputs and without.
    # ``doubts``: warnings about the recordings.
    # ``exposure_s``: exposure time of a frame.
    # ``wall_s``: duration of the identification.
    terms, at = optimum.problem.terms, optimum.unknowns[None]
    frequency = rings[0].decay.modes[0].frequency_Hz
    omega = 2 * np.pi * frequency
    table = rings[0].table
    gain = _gain(table.beam.undamped_Hz(table.middle_Pa)[0], table.beam.undamped_Hz(1.05 * table.middle_Pa)[0])
    small = small_effects(specimen, table.beam.loads, frequency, rings[0].decay.modes[0].loss, gain, exposure_s)
    factor = _factors(len(draws), small)
    instantaneous, series = terms.split(at[:, :-1])
    of_draws, series_of_draws = terms.split(draws[:, :-1])
    of_fit, series_of_fit = terms.split(draws_fit[:, :-1])

    def quantity(value: float, drawn: Array, of_noise: Array) -> Quantity:
        return Quantity(value, "Pa", _interval(value, drawn * factor), _interval(value, of_noise))

    dynamic = float(storage_modulus(terms, at, omega)[0])
    loss = float(_loss(terms, at, omega)[0])
    loss_of_draws = _loss(terms, draws, omega)
    loss_of_draws = loss_of_draws + np.sqrt(sum(effect.loss**2 for effect in small)) * _standard(len(draws))
    curve = instantaneous[:, None] * series.ratio(_CURVE)
    curves = of_draws[:, None] * series_of_draws.ratio(_CURVE) * factor[:, None]
    curves_of_fit = of_fit[:, None] * series_of_fit.ratio(_CURVE)
    long_term = float((instantaneous * series.long_term)[0])
    moment = None
    doubts_found = list(doubts)
    if specimen.magnet is not None and static is not None:
        moment = _moment(optimum.with_free_load(), effects)
        half_width = np.log(moment.interval_95[1] / moment.value)
        stated = NORMAL_95 * float(np.hypot.reduce([0.0, *load_sigmas.values()]))
        if abs(np.log(moment.value)) > np.hypot(half_width, stated):
            doubts_found.append(
                f"static states and motions agree only if the magnetic moment is {moment.value:.3f} times the given "
                f"moment (95 % interval {moment.interval_95[0]:.3f} to {moment.interval_95[1]:.3f})"
            )
    rows = optimum.problem.rows(at).shape[1]
    if optimum.chi2 > rows + _CONTRADICTION * np.sqrt(2 * rows) + 4:
        doubts_found.append(
            f"ring-downs, creep and static states do not agree within their uncertainties "
            f"(chi-square {optimum.chi2:.0f} of {rows} residuals): the material may not be quasi-linear, or a load is "
            "wrong"
        )
    order = np.argsort(series.tau_s[0])
    return LawOfTime(
        frequency_Hz=frequency,
        loss_factor=loss,
        loss_interval_95=_interval(loss, loss_of_draws),
        dynamic_shear_modulus=quantity(
            dynamic, storage_modulus(terms, draws, omega), storage_modulus(terms, draws_fit, omega)
        ),
        prony=tuple(PronyTerm(float(series.g[0, i]), float(series.tau_s[0, i])) for i in order),
        instantaneous_shear_modulus=quantity(float(instantaneous[0]), of_draws, of_fit),
        long_term_shear_modulus=quantity(
            long_term, of_draws * series_of_draws.long_term, of_fit * series_of_fit.long_term
        ),
        known_between_s=_known_between(curves_of_fit, 1 / omega, data_s),
        moment=moment,
        static_age_s=static.age_s if static else None,
        modulus_by_time=tuple(
            ModulusAt(float(t), float(value), _interval(float(value), drawn))
            for t, value, drawn in zip(_CURVE, curve[0], curves.T, strict=True)
        ),
        ring_downs=tuple(_ring_down(ring) for ring in rings),
        creep=tuple(_creep_curve(one, instantaneous, series, optimum.unknowns[-1:]) for one in creeps),
        budget=_budget(terms, optimum, omega, dynamic, draws_fit, sources, steps, load_sigmas, small),
        small_effects=small,
        log_evidence=tuple(one.log_evidence for one in optima),
        chi2=optimum.chi2,
        rows=rows,
        doubts=tuple(doubts_found),
        evaluations=sum(one.evaluations for one in optima),
        wall_s=wall_s,
    )


def _moment(free: TimeOptimum, effects: Mapping[str, Array]) -> Quantity:
    """Return the factor on the magnetic moment that the data of a fit give."""
    # With this factor, static shapes and motions give the same modulus.
    # The moment is unknown in the fit ``free``.
    value, noise = float(np.exp(free.unknowns[-1])), float(free.covariance[-1, -1])
    total = noise + sum(float((moves[:, -1] ** 2).sum()) for moves in free.steps(effects).values())

    def interval(variance: float) -> tuple[float, float]:
        reach = float(np.exp(NORMAL_95 * np.sqrt(variance)))
        return value / reach, value * reach

    return Quantity(value, "1", interval(total), interval(noise))


def _gain(before_Hz: float, after_Hz: float) -> float:
    # Return d ln(modulus) / d ln(frequency). ``after_Hz`` is the frequency with a 5 % higher modulus.
    return float(np.log(1.05) / np.log(after_Hz / before_Hz))


def _standard(count: int) -> Array:
    return np.asarray(np.random.default_rng(count).standard_normal(count))


def _factors(count: int, small: Sequence[SmallEffect]) -> Array:
    """Draw random factors on the modulus, with the uncertainty due to small effects such as the air."""
    total = np.sqrt(sum(effect.modulus_percent**2 for effect in small)) / 100
    return np.asarray(1 + total * _standard(count + 1)[:count])


def _interval(value: float, drawn: Array) -> tuple[float, float]:
    """Return the 95 % interval of random draws, extended if necessary so that it contains ``value``."""
    low, high = np.quantile(drawn[np.isfinite(drawn)], [0.025, 0.975])
    return float(min(low, value)), float(max(high, value))


def _known_between(curves: Array, start_s: float, data_s: tuple[float, float]) -> tuple[float, float] | None:
    """Return the range of times in which the data determine the modulus to 5 %, or None."""
    # ``curves`` (D, m): the modulus at m times for D random draws. Of several ranges, the result is the one around
    # ``start_s``, or else the longest one.
    is_known = NORMAL_95 * np.log(np.maximum(curves, 1e-3)).std(axis=0) < _KNOWN
    here = int(np.argmin(np.abs(np.log(_CURVE / start_s))))
    runs = np.split(np.arange(len(_CURVE)), np.flatnonzero(np.diff(is_known)) + 1)
    ranges = [
        (here in run, max(float(_CURVE[run[0]]), data_s[0]), min(float(_CURVE[run[-1]]), data_s[1]))
        for run in runs
        if is_known[run[0]]
    ]
    _, first_s, last_s = max(ranges, key=lambda one: (one[0], one[2] / one[1]), default=(False, np.inf, 0.0))
    return (first_s, last_s) if first_s <= last_s else None


def _ring_down(ring: RingEvidence) -> RingDown:
    decay, mode = ring.decay, ring.decay.modes[0]
    sigma = ring.inflation * np.sqrt(np.diag(mode.covariance))
    every = max(1, -(-len(decay.time_s) // _MOST_FRAMES))
    shown = slice(0, None, every)
    return RingDown(
        decay.label,
        mode.frequency_Hz,
        float(mode.frequency_Hz * sigma[0]),
        mode.loss,
        float(sigma[1]),
        decay.amplitude_mm,
        decay.frequency_change,
        decay.loss_change,
        tuple(other.frequency_Hz for number, other in ring.modes if number),
        decay.windows,
        tuple(decay.time_s[shown].round(5).tolist()),
        tuple(decay.displacement_mm[shown].round(6).tolist()),
        tuple(decay.envelope_mm[shown].round(6).tolist()),
    )


def _creep_curve(one: CreepEvidence, instantaneous: Array, series: Prony, load_log: Array) -> CreepCurve:
    predicted = np.degrees(one.predicted(instantaneous, series, load_log)[0])
    measured = np.degrees(one.rotation)
    return CreepCurve(
        one.label,
        tuple(one.time_s.tolist()),
        tuple((measured - measured.mean()).tolist()),
        tuple(np.degrees(one.sigma).tolist()),
        tuple((predicted - predicted.mean()).tolist()),
    )


def _budget(
    terms: Terms,
    optimum: TimeOptimum,
    omega: float,
    dynamic: float,
    draws_fit: Array,
    sources: Mapping[str, float],
    steps: Mapping[str, Array],
    load_sigmas: Mapping[str, float],
    small: Sequence[SmallEffect],
) -> tuple[BudgetEntry, ...]:
    """Return the uncertainty of the dynamic modulus due to each input, to the noise and to small effects."""
    entries = []

    def effect_percent(moves: Array) -> float:
        ends = [storage_modulus(terms, optimum.unknowns + sign * moves, omega) for sign in (1, -1)]
        return float(50 * np.sqrt(((ends[0] - ends[1]) ** 2).sum()) / dynamic)

    for key, sigma in sources.items():
        effect = effect_percent(steps[key])
        entries.append(BudgetEntry(key, SOURCES[key].words, sigma, SOURCES[key].unit, (0,), effect))
    of_loads = 0.0
    for key, sigma in load_sigmas.items():
        effect = effect_percent(optimum.load_step(sigma)[None])
        of_loads += effect**2
        entries.append(BudgetEntry(key, SOURCES[key].words, sigma, "1", (0,), effect))
    # The draws contain the prior of the load factor, which is not noise.
    noise = 100 * float(np.std(np.log(storage_modulus(terms, draws_fit, omega))))
    noise = float(np.sqrt(max(noise**2 - of_loads, 0.0)))
    entries.append(BudgetEntry("noise", "noise of the recordings, mesh and depth", noise / 100, "1", (0,), noise))
    entries += [
        BudgetEntry(effect.source, effect.words, effect.modulus_percent / 100, "1", (0,), effect.modulus_percent)
        for effect in small
    ]
    return tuple(sorted(entries, key=lambda entry: -entry.effect_percent))
