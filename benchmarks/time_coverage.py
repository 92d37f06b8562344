"""Measure which share of the 95 % intervals of viscoelastic quantities contains the true values.

    python -m benchmarks.time_coverage [--draws 500] [--first 1] [-o FILE.jsonl] [--table] [--whole]

Each draw is a simulated measurement of a random material with two Prony terms, and a simplified fit. --whole makes
fewer simplifications. A draw is written to the file as a line of JSON; draws in the file are not repeated. --table only
prints the table of the file.

The columns: "hold" is the share of intervals that contain the true value, "chance" its 95 % interval (Clopper and
Pearson), and "width over needed" the stated divided by the observed standard deviation of ln(fitted value / true
value). The row mu(1 s) shows the modulus at the time 1 s.
"""

# Each draw is a separate virtual measurement of another hidden material (unknown to the fit) with two Prony terms: two
# ring-downs in zero field, and creep and ring-down in two fields. The dimensions, the density of the magnet and the
# remanence differ from the nominal values by random errors of the size of their stated uncertainties. The static states
# (bent beams at rest) and the effect of the air, which moves with the beam and damps it, have errors of the size that
# the fit states for them. Every position gets noise. The motion is that of the rod of the virtual rig
# (`tests.shared.creeping_rod`), which shares no equation with the fit.
#
# Six simplifications make hundreds of draws affordable. With the option --whole, only the first three of them are made.
#
# - The creep of the rod is computed without inertia. Its vibration is computed separately, from the tangent stiffness,
#   and added. For one material, frequencies are within 0.03 % and losses within 0.1 % of those of `MovingBeam`, which
#   computes the whole motion in time.
# - The stiffness of the rod is computed by a solid model for the nominal dimensions and with each dimension changed by
#   1 %. The stiffness for other dimensions follows linearly in the logarithms.
# - A fit tabulates the frequencies of the beam and its deflection under the loads as functions of the modulus, around
#   its own modulus. Here these tables are computed around a few moduli, 0.1 apart in the logarithm. Each draw uses the
#   tables of the nearest modulus (`benchmarks.time_tables`).
# - The recordings are reduced: frequency and loss of the vibration are those of the rod, with noise, and the positions
#   show the creep alone. The frequency is corrected to that of a finely meshed solid, which is up to 0.1 % lower.
# - Only two terms are fitted. There is no global search; the least-squares fit starts at the hidden law.
# - The additional fit without a prior on the magnetic moment is left out, and so are the random draws from which a fit
#   computes the intervals from noise alone.

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.stats import beta

from benchmarks.time import (
    BEAM,
    DOWN,
    FIELDS,
    FRAME_S,
    NEO,
    NOISE_MM,
    REST_MM,
    RINGING_S,
    STATED,
    in_field,
)
from benchmarks.time_tables import once, tables_shared
from eimi_fitting import BeamModel, Loads
from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.modal_motion import ReducedMotion
from eimi_fitting.beam.path import candidates
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.evidence.sources import StatedSource, specimen_under
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time import identification, law_of_time, result
from eimi_fitting.time.channels import Signals
from eimi_fitting.time.decay import Decay, RingMode
from eimi_fitting.time.identification import LawOfTime, RecordedMotion, StaticRun, StaticStates, identify_time
from eimi_fitting.time.law_of_time import TimeOptimum
from eimi_fitting.time.measured import Kind, Motion
from eimi_lab.virtual.rod import Rod, Stiffness, stiffness_of_solid
from tests.shared.creeping_rod import CreepingRod

STATIC_SIGMA = 0.002
AMPLITUDE_MM = 8.0  # of the vibrations after the steps, approximately
FREQUENCY_SIGMA, LOSS_SIGMA = 2e-5, 5e-5  # noise of ln(frequency) and of the loss factor, as in whole recordings
AT_S = (0.03, 1.0, 30.0)
_SOLID = (12, 2, 1)
_FINE, _FINER_ACROSS = (32, 4, 1), 16  # mesh of the solid whose frequency the rod gets; planar elements that correct it
_CORRECTED_PA, _STIFFER = (30e3, 50e3, 75e3), 1.2


def drawn_material(rng: np.random.Generator) -> tuple[float, Prony]:
    """Return a random material: its instantaneous shear modulus in Pa and its Prony series of two terms."""
    series = Prony(rng.uniform(0.06, 0.16, 2), np.exp(rng.uniform(np.log([0.03, 1.0]), np.log([0.1, 6.0]))))
    return float(rng.uniform(40e3, 80e3)), series


def _stiffness_slopes() -> tuple[Stiffness, np.ndarray]:
    # Return the stiffness of a rod that bends like the nominal beam, and its derivatives by the sizes, (3, 3).
    # Rows: ln(width), ln(depth), ln(length) of the beam. Columns: ``length_m``, ``hinge_m3`` (both as logarithms) and
    # ``softening_m2`` of the stiffness.
    def rod(specimen: Specimen) -> Stiffness:
        return stiffness_of_solid(specimen, "neo-hookean", (50e3,), _SOLID)

    def numbers(stiffness: Stiffness) -> np.ndarray:
        return np.array([np.log(stiffness.length_m), np.log(stiffness.hinge_m3), stiffness.softening_m2])

    slopes = []
    for key in ("width_mm", "depth_mm", "length_mm"):
        larger, smaller = (replace(BEAM, **{key: factor * getattr(BEAM, key)}) for factor in (1.01, 1 / 1.01))
        slopes.append((numbers(rod(larger)) - numbers(rod(smaller))) / (2 * np.log(1.01)))
    return rod(BEAM), np.array(slopes)


def stiffness_near(specimen: Specimen) -> Stiffness:
    # Return the stiffness of the rod model of a specimen with nearly the nominal sizes.
    nominal, slopes = once("stiffness", _stiffness_slopes)
    change = np.log([getattr(specimen, key) / getattr(BEAM, key) for key in ("width_mm", "depth_mm", "length_mm")])
    length, hinge, softening = change @ slopes
    return replace(
        nominal,
        length_m=nominal.length_m * float(np.exp(length)),
        hinge_m3=nominal.hinge_m3 * float(np.exp(hinge)),
        softening_m2=nominal.softening_m2 + float(softening),
    )


def _solid_over_rod(field_mT: float, moduli_Pa: Sequence[float] = _CORRECTED_PA) -> np.ndarray:
    """Return ln(frequency of the solid model / frequency of the rod) of a beam for n moduli, shape (n,).

    ``moduli_Pa`` are moduli in equilibrium; a vibration is stiffer by the factor `_STIFFER`.
    """
    loads, ratios = in_field(field_mT), []
    rod = Rod(BEAM, stiffness_near(BEAM))
    relaxed = Prony(np.array([1 - 1 / _STIFFER]), np.array([1e3]))
    solid = SolidBeside(BEAM, *_FINE)

    def frequency_Hz(motion: ReducedMotion) -> float:
        roots = motion.roots(lambda s: np.full(s.shape, _STIFFER, complex))
        return float(roots[0, 0].imag / (2 * np.pi))

    for modulus in moduli_Pa:
        parameters = np.array([[modulus]])
        bent = solid.solve(NEO, parameters, loads, tolerance_mm=1e-5, options=SolidOptions(method="follow"))
        chosen = candidates(NEO, parameters, "solid", None, None)
        near = Vibration(solid.solid).near(chosen, loads, bent.last, stiffenings=(1.0, 2.0))
        coarse, fine = (
            Vibration(BeamModel(BEAM, _FINE[0], across, "plane-stress")).about(
                NEO, parameters, loads, stiffenings=(1.0, 2.0)
            )[0]
            for across in (_FINE[1], _FINER_ACROSS)
        )
        moving = CreepingRod(rod, modulus, relaxed, _loads, field_mT)
        (rate,), _, _ = moving.rates(moving.coordinates[None], field_mT)
        of_solid = frequency_Hz(near) * frequency_Hz(fine) / frequency_Hz(coarse)
        ratios.append(np.log(2 * np.pi * of_solid / rate.imag))
    return np.array(ratios)


def _loads(field_mT: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the field (2,) in T and gravity (2,) in m/s² for a field of the coil in mT."""
    return np.array([0.0, 1e-3 * field_mT]), DOWN


def _static_angles() -> tuple[np.ndarray, np.ndarray]:
    """Return M increasing moduli (Pa), (M,), and the tip rotations (degrees) of the beam in K fields, (M, K)."""
    moduli = np.geomspace(24e3, 90e3, 14)
    fields = Loads.along([field for field, _ in FIELDS if field])
    nominal = SolidBeside(BEAM, 16, 2)
    return moduli, np.stack([nominal.tip_angle_deg(nominal.solve(NEO, np.array([[mu]]), fields))[0] for mu in moduli])


def measured(
    rng: np.random.Generator, instantaneous_Pa: float, series: Prony, is_whole: bool
) -> tuple[list[RecordedMotion], StaticStates, float]:
    """Return a simulated measurement: recorded motions, static states, and the magnetic moment / nominal moment.

    The recordings show vibrations and creep if `is_whole` is true, else creep alone.
    """
    at_rest = instantaneous_Pa * float(series.long_term)
    HIDDEN.append(np.log([at_rest, *(series.g / series.long_term), *series.tau_s, 1.0]))
    wrong = {key: np.array([sigma * rng.standard_normal()]) for key, sigma in STATED.items()}
    specimen = specimen_under(BEAM, wrong)
    rod = Rod(specimen, stiffness_near(specimen))
    beam = CreepingRod(rod, at_rest, series, _loads)
    share = REST_MM[:, 0] / specimen.flexible_length_mm
    recorded, begins, ends, tips, now = [], [], [], [], 0.0
    for number, (field, seconds) in enumerate(FIELDS):
        begins.append(now)
        times = np.append(np.arange(FRAME_S, RINGING_S, FRAME_S), np.geomspace(RINGING_S, seconds, 20))
        coordinates, rate = beam.record(field, seconds, times, is_whole)
        now += seconds
        ends.append(now)
        tips.append(float(np.degrees(rod.end @ beam.coordinates)))
        places = rod.places_mm(coordinates, share, REST_MM[:, 1])
        noisy = places + NOISE_MM * rng.standard_normal(places.shape)
        earlier = [(-1e3, in_field(0.0))] + [(begins[k] - begins[-1], in_field(FIELDS[k][0])) for k in range(number)]
        time_s = np.repeat(times[:, None], len(REST_MM), axis=1)
        kind: Kind = "creep" if field else "ring_down"
        sigma, label = np.full(time_s.shape, NOISE_MM), f"step {number}"
        loss = -2 * rate.real / rate.imag + LOSS_SIGMA * rng.standard_normal()
        of_solid = once(("solid over rod", field), partial(_solid_over_rod, field))
        correction = np.interp(np.log(at_rest), np.log(_CORRECTED_PA), of_solid)
        frequency = rate.imag / (2 * np.pi) * np.exp(correction + FREQUENCY_SIGMA * rng.standard_normal())
        REDUCED[label] = RingMode(frequency, loss, np.diag([FREQUENCY_SIGMA**2, LOSS_SIGMA**2]))
        motion = Motion(kind, noisy, REST_MM, time_s, sigma, to_A=field, label=label)
        recorded.append(RecordedMotion(motion, in_field(field), tuple(earlier)))
    moduli, angles = once("static angles", _static_angles)
    bent = [k for k, (field, _) in enumerate(FIELDS) if field]
    logs = [CubicSpline(-angles[:, i], np.log(moduli))(-tips[k]) for i, k in enumerate(bent)]
    modulus = float(np.exp(np.mean(logs) + STATIC_SIGMA * rng.standard_normal()))
    run = StaticRun(Loads.along([field for field, _ in FIELDS]), np.array(begins), np.array(ends))
    assert specimen.magnet is not None
    assert BEAM.magnet is not None
    moment = specimen.magnet.moment_A_m2 / BEAM.magnet.moment_A_m2
    return recorded, StaticStates((run,), modulus, STATIC_SIGMA, {}), moment


REDUCED: dict[str, RingMode] = {}
HIDDEN: list[np.ndarray] = []


def _reduced_decay(signals: Signals, label: str, *_: Any, **__: Any) -> Decay:
    """Return the known vibration of a simulated recording ``label``; fits call this in place of `decay_of`."""
    mode = REDUCED[label]
    decays_per_s = -mode.rate.real
    first, last = (np.log(AMPLITUDE_MM / size) / decays_per_s for size in (0.05 * BEAM.length_mm, 0.4 * NOISE_MM))
    part = signals.between(first, min(last, RINGING_S))
    still = np.zeros(len(part.time_s))
    begin, end = float(part.time_s[0]), float(part.time_s[-1])
    size = np.exp(-decays_per_s * (part.time_s - begin)) * 0.05 * BEAM.length_mm
    return Decay(
        label, (mode,), (), begin, end, float(size[0]), 0.0, 0.0, part.time_s, still, size, still, 1.0, (),
        part.channels_mm,
    )  # fmt: skip


@contextmanager
def reduced() -> Iterator[None]:
    """Simplify all fits in the `with` block, so that they take less time."""
    draw, last = law_of_time.drawn, np.zeros((0, 0))

    def drawn(*arguments: Any, of_sources: bool = True) -> np.ndarray:
        nonlocal last
        last = draw(*arguments) if of_sources else last
        return last

    def two_terms(problems: Sequence[Any], _: int) -> Any:
        problem = problems[1]
        unknowns, jacobian, spent, converged = law_of_time._polished(problem, HIDDEN[-1])
        chi2 = float((problem.rows(unknowns[None]) ** 2).sum())
        optimum = TimeOptimum(problem, unknowns, jacobian, chi2, float("nan"), spent, converged)
        return optimum, (optimum,)

    def unknown(*_: Any) -> Quantity:
        return Quantity(1.0, "1", (0.0, np.inf))

    with (
        patch.object(identification, "decay_of", _reduced_decay),
        patch.object(identification, "best_number_of_terms", two_terms),
        patch.object(identification, "drawn", drawn),
        patch.object(result, "_moment", unknown),
        patch.object(TimeOptimum, "with_free_load", lambda one: one),
    ):
        yield


def outcome(seed: int, is_whole: bool) -> dict[str, Any]:
    """Draw a material from a seed, simulate its measurement, fit the measurement, and return the result.

    The result has the true value, the fitted value and the 95 % interval of each quantity, and the chi-square, the
    warnings and the processor time of the fit.
    """
    began, rng = time.process_time(), np.random.default_rng([seed, 31])
    instantaneous, series = drawn_material(rng)
    motions, static, moment = measured(rng, instantaneous, series, is_whole)
    stated = [StatedSource(key, sigma, "specimen") for key, sigma in STATED.items()]
    measured_s = time.process_time() - began
    law: LawOfTime = identify_time(NEO, np.array([static.modulus_Pa]), BEAM, motions, stated, static)
    omega = 2 * np.pi * law.frequency_Hz
    dynamic = instantaneous * series.complex_ratio(np.array(1j * omega))
    # The fit states the effect of the air on the modulus, and does not correct it.
    air = 1 + 0.01 * np.hypot.reduce([effect.modulus_percent for effect in law.small_effects]) * rng.standard_normal()
    of_air = np.hypot.reduce([effect.loss for effect in law.small_effects]) * rng.standard_normal()
    quantities = {
        "dynamic modulus": (
            float(dynamic.real) * air, law.dynamic_shear_modulus.value, law.dynamic_shear_modulus.interval_95
        ),
        "loss factor": (float(dynamic.imag / dynamic.real) + of_air, law.loss_factor, law.loss_interval_95),
    }  # fmt: skip
    for at_s in AT_S:
        nearest = min(law.modulus_by_time, key=lambda one: abs(np.log(one.time_s / at_s)))
        hidden = instantaneous * float(series.ratio(nearest.time_s)) * air
        quantities[f"mu({at_s:g} s)"] = (hidden, nearest.value, nearest.interval_95)
    assert law.moment is not None
    if is_whole:
        quantities["moment"] = (moment, law.moment.value, law.moment.interval_95)
    return {
        "seed": seed,
        "terms": len(law.prony),
        "chi2": law.chi2,
        "log_evidence": law.log_evidence,
        "rows": law.rows,
        "doubts": list(law.doubts),
        "cpu_s": [round(measured_s, 2), round(time.process_time() - began, 2)],
        "quantities": quantities,
    }


def table_of(outcomes: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table, one for each quantity."""
    yield "| quantity | draws | half-width, % | hold, % | chance | below, above | mean error, % | width over needed |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for name in outcomes[0]["quantities"]:
        values = [one["quantities"][name] for one in outcomes]
        errors = np.array([np.log(fitted / hidden) for hidden, fitted, _ in values])
        halves = np.array([0.5 * np.log(max(high, 1e-9) / max(low, 1e-9)) for _, _, (low, high) in values])
        below = sum(hidden < low for hidden, _, (low, _) in values)
        above = sum(hidden > high for hidden, _, (_, high) in values)
        n, k = len(values), len(values) - below - above
        low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
        high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
        needed = 1 / np.sqrt(np.mean((errors / (halves / 1.96)) ** 2))
        yield (
            f"| {name} | {n} | {100 * np.median(halves):.2f} | {100 * k / n:.1f} | {100 * low:.1f} to "
            f"{100 * high:.1f} | {below}, {above} | {100 * errors.mean():+.2f} | {needed:.2f} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=500, help="number of hidden materials in the file at the end")
    parser.add_argument("--first", type=int, default=1, help="seed of the first material")
    parser.add_argument("--seconds", type=float, default=np.inf, help="begin no further draw after this time")
    parser.add_argument("--whole", action="store_true", help="record the vibrations, and fit as `eimi fit` does")
    parser.add_argument("--table", action="store_true", help="print the table of the file, without further draws")
    parser.add_argument("-o", "--output", type=Path, default=Path("time_coverage.jsonl"))
    options = parser.parse_args()
    lines = options.output.read_text().splitlines() if options.output.exists() else []
    outcomes = [json.loads(line) for line in lines]
    done, began = {one["seed"] for one in outcomes}, time.monotonic()
    with tables_shared(options.output.with_suffix(".tables")), nullcontext() if options.whole else reduced():
        for seed in range(options.first, options.first + options.draws):
            if options.table or time.monotonic() - began > options.seconds:
                break
            if seed in done:
                continue
            outcomes.append(outcome(seed, options.whole))
            with options.output.open("a") as file:
                file.write(json.dumps(outcomes[-1]) + "\n")
    print("\n".join(table_of(outcomes)))
    print(f"{sum(one['cpu_s'][1] for one in outcomes) / len(outcomes):.2f} s of processor time a draw")


if __name__ == "__main__":
    main()
