"""Verify frequencies, loss factors and viscoelastic (Prony) laws.

python -m benchmarks.time [--hidden N] [--seed SEED]

The first table compares computed frequencies with Euler-Bernoulli beams, with exact values of two oscillators, and with
a simulated free vibration. The second table shows the errors of fits of N simulated materials with two Prony terms.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from eimi_fitting import LAWS, BeamModel, Loads, Magnet, Specimen
from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.modal_motion import complex_roots
from eimi_fitting.beam.transient import Transient
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.inference.evidence.sources import StatedSource, specimen_under
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.channels import signals_of
from eimi_fitting.time.decay import decay_of
from eimi_fitting.time.identification import LawOfTime, RecordedMotion, StaticRun, StaticStates, identify_time
from eimi_fitting.time.measured import Kind, Motion
from eimi_lab.virtual.moving_beam import MovingBeam
from eimi_lab.virtual.rod import stiffness_of_solid
from tests.fitting.test_vibration import MU_PA, NO_LOAD, euler_bernoulli_Hz, thin

NEO = LAWS["neo-hookean"]
MAGNET = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, section="solid", magnet=MAGNET)
FLAT = replace(BEAM, section="plane-stress")
DOWN = np.array([9.80665, 0.0])
STATED = {"width": 0.02, "depth": 0.03, "length": 0.05, "magnet-density": 50.0, "remanence": 0.012}
FIELDS = ((5.0, 30.0), (0.0, 20.0), (7.0, 30.0), (0.0, 20.0))  # each field (mT) and its duration (s)
REST_MM = np.column_stack([np.linspace(4, 29, 8), np.zeros(8)])
NOISE_MM, FRAME_S, RINGING_S = 0.005, 0.015, 16.0
STEP_S, RELEASE_STEPS = 0.00125, 1600
TIMES_S = np.array([0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0])


def in_field(field_mT: float) -> Loads:
    """Return the loads of a hanging beam in a field (mT) across the beam."""
    return Loads.along([field_mT])


def print_references() -> None:
    """Print the errors of computed frequencies of beams and oscillators."""
    worst = 0.0
    for length in (50.0, 70.0, 90.0, 120.0):
        for density, tip_kg in ((None, 0.0), (7500.0, 0.0), (7500.0, 4e-4), (None, 2e-4)):
            specimen = thin(length, density)
            motion, _ = Vibration(BeamModel(specimen, 26, 1), tip_kg).about(NEO, np.array([[MU_PA]]), NO_LOAD)
            expected = euler_bernoulli_Hz(specimen, tip_kg)[0]
            worst = max(worst, abs(motion.frequencies_Hz()[0, 0] / expected - 1))
    print(f"Euler-Bernoulli with tip body, 16 beams: frequency within {100 * worst:.3f} %")
    stiffness, rest, mass = np.array([[[120.0]]]), np.array([[[30.0]]]), np.array([[[0.01]]])
    solid = Prony(np.array([0.3]), np.array([0.02]))
    cases = {
        "Kelvin-Voigt": (lambda s: 1 + 0.004 * s, [0.01, 0.48, 150.0]),
        "standard linear solid": (solid.complex_ratio, [2e-4, 0.01, 3.0, 114.0]),
    }
    for name, (ratio, polynomial) in cases.items():
        root = complex_roots(stiffness, rest, mass, ratio)[0, 0]
        exact = np.roots(polynomial)
        error = abs(root / exact[np.argmax(exact.imag)] - 1)
        print(f"{name}: complex root within {error:.1e}")
    series, instantaneous = Prony(np.array([0.12, 0.1]), np.array([0.05, 2.0])), 60e3
    model = BeamModel(FLAT, 16, 1)
    at_rest = instantaneous * float(series.long_term)
    for field in (0.0, 3.5, 7.0):
        motion_in_time = Transient(model, NEO, np.array([instantaneous]), series, in_field(field + 0.1))
        places = []
        for _ in range(RELEASE_STEPS):
            motion_in_time.advance(STEP_S, in_field(field))
            places.append(motion_in_time.rigid[:2].copy())
        time = STEP_S * (1 + np.arange(len(places)))[:, None]
        recorded = Motion("ring_down", np.array(places)[:, None], REST_MM[:1], time, np.full(time.shape, 1e-4))
        mode = decay_of(signals_of(recorded, 0.0), "release", BEAM.length_mm, is_stepped=True).modes[0]
        reduced, _ = Vibration(BeamModel(FLAT)).about(
            NEO, np.array([[at_rest]]), in_field(field), stiffenings=(1.0, 2.0)
        )
        (root, *_) = reduced.roots(lambda s: instantaneous / at_rest * series.complex_ratio(s))[0]
        frequency = 100 * (root.imag / (2 * np.pi * mode.frequency_Hz) - 1)
        loss = 100 * (-2 * root.real / root.imag / mode.loss - 1)
        print(f"transient solution at {field:g} mT: frequency {frequency:+.3f} %, loss {loss:+.2f} % of itself")


def _constant(value: float, _: float) -> float:
    return value


def hidden_run(rng: np.random.Generator) -> tuple[float, Prony, list[RecordedMotion], StaticStates]:
    """Draw a viscoelastic material at random, and simulate its measurement.

    Returns
    -------
    instantaneous : float
        Instantaneous shear modulus, Pa.
    series : Prony
        Prony series of the material.
    recorded : list of RecordedMotion
        Noisy free vibrations and creep.
    static : StaticStates
        Static states: fields, times, and the modulus of an elastic fit.
    """
    series = Prony(rng.uniform(0.06, 0.16, 2), np.exp(rng.uniform(np.log([0.03, 1.0]), np.log([0.1, 6.0]))))
    instantaneous = float(rng.uniform(40e3, 80e3))
    at_rest = instantaneous * float(series.long_term)
    wrong = {key: np.array([sigma * rng.standard_normal()]) for key, sigma in STATED.items()}
    specimen = specimen_under(BEAM, wrong)
    stiffness = stiffness_of_solid(specimen, "neo-hookean", (at_rest,), (12, 2, 1))
    beam = MovingBeam(specimen, stiffness, at_rest, series, lambda field_mT: (np.array([0.0, 1e-3 * field_mT]), DOWN))
    beam.start(0.0, 0.0)
    share = REST_MM[:, 0] / specimen.flexible_length_mm
    recorded, begins, ends, tips, now = [], [], [], [], 0.0
    for number, (field, seconds) in enumerate(FIELDS):
        begins.append(now)
        times = np.append(np.arange(FRAME_S, RINGING_S, FRAME_S), np.geomspace(RINGING_S, seconds, 20))
        coordinates = beam.advance(now + seconds, partial(_constant, field), now + times)
        now += seconds
        places = beam.rod.places_mm(coordinates, share, REST_MM[:, 1])
        ends.append(now)
        tips.append(float(np.degrees(beam.rod.end @ coordinates[-1])))
        noisy = places + NOISE_MM * rng.standard_normal((len(places), 8, 2))
        earlier = [(-1e3, in_field(0.0))] + [(begins[k] - begins[-1], in_field(FIELDS[k][0])) for k in range(number)]
        time = np.repeat(times[:, None], 8, axis=1)
        kind: Kind = "creep" if field else "ring_down"
        label = f"step {number}"
        recorded.append(
            RecordedMotion(
                Motion(kind, noisy, REST_MM, time, np.full(time.shape, NOISE_MM), to_A=field, label=label),
                in_field(field),
                tuple(earlier),
            )
        )
    nominal, moduli = SolidBeside(BEAM, 16, 2), at_rest * np.geomspace(0.8, 1.3, 5)
    bent = [k for k, (field, _) in enumerate(FIELDS) if field]
    fields = Loads.along([FIELDS[k][0] for k in bent])
    # The modulus that an elastic fit with the nominal dimensions would identify.
    angles = np.stack([nominal.tip_angle_deg(nominal.solve(NEO, np.array([[mu]]), fields))[0] for mu in moduli])
    logs = [CubicSpline(-angles[:, i], np.log(moduli))(-tips[k]) for i, k in enumerate(bent)]
    static = StaticStates(
        (StaticRun(Loads.along([field for field, _ in FIELDS]), np.array(begins), np.array(ends)),),
        float(np.exp(np.mean(logs))),
        0.002,
        {},
    )
    return instantaneous, series, recorded, static


def print_hidden(seed: int) -> bool:
    """Fit a random material, print the errors; return whether the dynamic modulus lies in its 95 % interval."""
    instantaneous, series, motions, static = hidden_run(np.random.default_rng(seed))
    stated = [StatedSource(key, sigma, "specimen") for key, sigma in STATED.items()]
    identified: LawOfTime = identify_time(NEO, np.array([static.modulus_Pa]), BEAM, motions, stated, static)
    truth = instantaneous * float(series.complex_ratio(np.array(2j * np.pi * identified.frequency_Hz)).real)
    modulus = identified.dynamic_shear_modulus
    holds = modulus.interval_95[0] <= truth <= modulus.interval_95[1]
    fitted = Prony(np.array([t.g for t in identified.prony]), np.array([t.tau_s for t in identified.prony]))
    fitted_Pa = identified.instantaneous_shear_modulus.value * fitted.ratio(TIMES_S)
    curve = fitted_Pa / (instantaneous * series.ratio(TIMES_S))
    # The dimensions cause an error that all moduli share. The error that remains is the error of the Prony series.
    shape = curve / curve[0]
    interval = 50 * (modulus.interval_95[1] - modulus.interval_95[0]) / modulus.value
    print(
        f"{seed:4d}: {len(fitted.g)} terms, dynamic modulus {100 * (modulus.value / truth - 1):+.2f} % "
        f"(±{interval:.1f} %)"
        f"{'' if holds else ' (outside)'}, mu(t) / mu(0.03 s) within {100 * np.abs(shape - 1).max():.2f} %, "
        f"moment {identified.moment.value if identified.moment else float('nan'):.3f}, {identified.wall_s:.1f} s"
    )
    return holds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hidden", type=int, default=2, help="number of hidden materials")
    parser.add_argument("--seed", type=int, default=1, help="seed of the first material")
    arguments = parser.parse_args()
    print_references()
    held = [print_hidden(arguments.seed + k) for k in range(arguments.hidden)]
    if held:
        print(f"95 % intervals of the dynamic modulus hold in {sum(held)} of {len(held)}")


if __name__ == "__main__":
    main()
