"""What a planned choice of states is worth: `eimi plan` before virtual experiments, and what then comes out.

    python -m benchmarks.plan [--experiments 6] [--states 6] [--seed 1]

Each experiment is one of `benchmarks.coverage`: every source that the bench examples state is drawn, the true beam is
simulated on a finer mesh, edges get white and correlated noise, and what is fitted knows the nominal numbers alone. A
first run has equally spaced fields; the plan knows its fit and nothing else. Then both choices are measured anew, as
many states each, and the half-widths of the 95 % intervals of the initial shear modulus are compared.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.coverage import stated, with_noise
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import edge_curves, points_on
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource, loads_under, specimen_under
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.inference.identification import refine
from eimi_fitting.inference.interval.estimate import Estimate
from eimi_fitting.inference.planning.design_of_experiment import (
    Candidates,
    EdgeNoise,
    KnownLaw,
    candidates,
    equally_spaced,
    exchange,
)
from eimi_fitting.laws import LAWS
from eimi_lab.config.specimen import load_specimen

Array = NDArray[np.float64]

TRUTH_PA = 46e3
FIELD_MT = np.linspace(0.0, 7.05, 31)
ALONG = 13  # elements of the fits: half of what `eimi fit` takes
POINTS = 3  # simulated ones from an element's corner to the next


@dataclass(frozen=True)
class Setting:
    """How the beam is mounted: gravity's angle in the beam frame and what hangs at its tip."""

    name: str
    specimen: Specimen
    gravity_angle_deg: float = 0.0
    tip_force_N: float = 0.0

    def loads(self, field_mT: Array = FIELD_MT) -> Loads:
        """Of so many fields."""
        return Loads.along(field_mT, gravity_angle_deg=self.gravity_angle_deg, tip_force_N=self.tip_force_N)


@dataclass(frozen=True)
class Bench:
    """What is stated as uncertain, and the standard deviation of each of the noise's two parts."""

    stated: tuple[StatedSource, ...]
    noise_mm: float


def measured(setting: Setting, loads: Loads, bench: Bench, rng: np.random.Generator) -> Experiment:
    """What is stated, with what was seen."""
    deviations = {
        s.source: s.standard_uncertainty * rng.normal(size=len(SOURCES[s.source].parts)) for s in bench.stated
    }
    setup = Setup.of(((s, part, value) for s, own in deviations.items() for part, value in enumerate(own)), 1)
    model = BeamModel(specimen_under(setting.specimen, deviations)).refined()
    shapes = model.solve(
        LAWS["neo-hookean"],
        np.array([[TRUTH_PA]]),
        loads_under(loads, deviations),
        field_factor=setup.field_factor,
    )
    seen = setup.imaged(points_on(edge_curves(model, shapes)[0], POINTS)[:, :, 4:-4])
    observed = with_noise(seen, bench.noise_mm, rng)
    return Experiment(BeamModel(setting.specimen, ALONG), loads, observed, stated=bench.stated)


def fitted(experiment: Experiment) -> Estimate:
    """As `eimi fit` ends, begun at the truth in place of the search's result."""
    unknowns, unit = KnownLaw(LAWS["neo-hookean"], np.array([TRUTH_PA])).unknowns()
    return refine(Problem(LAWS["neo-hookean"], unknowns, (experiment,)), unit, 1).estimate


def half_percent(estimate: Estimate) -> float:
    """Half-width of the modulus' interval."""
    modulus = estimate.initial_shear_modulus
    return 50 * (modulus.interval_95[1] - modulus.interval_95[0]) / modulus.value


def planned(setting: Setting, estimate: Estimate, bench: Bench, states: int) -> Candidates:
    """The states that could be measured in a setting, by a fit of an earlier run."""
    noise = EdgeNoise.of(estimate.identifiability, states)
    known = KnownLaw(LAWS["neo-hookean"], np.array([estimate.initial_shear_modulus.value]))
    return candidates(known, setting.specimen, setting.loads(), bench.stated, noise, along=ALONG)


def row(
    name: str, before: Setting, after: Sequence[Setting], bench: Bench, *, states: int, runs: int, seed: int
) -> None:
    """Plan and measure; prints the means over the runs."""
    every: list[tuple[float, float, float, float]] = []
    chosen = ""
    for number in range(runs):
        rng = np.random.default_rng([seed, number])
        even = equally_spaced(len(FIELD_MT), states)
        spaced = before.loads().take(even)
        first = fitted(measured(before, spaced, bench, rng))
        plans = [(setting, planned(setting, first, bench, states)) for setting in after]
        choices = [exchange(plan, states) for _, plan in plans]
        best = int(np.argmin([plan.half_width_percent(c) for (_, plan), c in zip(plans, choices, strict=True)]))
        setting, plan = plans[best]
        choice = choices[best]
        loads = plan.loads.take(choice)
        came = half_percent(fitted(measured(setting, loads, bench, rng)))
        again = half_percent(fitted(measured(before, spaced, bench, rng)))
        every.append((again, plan.half_width_percent(choice), came, plan.least_percent(states)))
        chosen = f"{setting.name}: {', '.join(f'{1e3 * b:.2f}' for b in loads.field_T[:, 1])} mT"
    again, foretold, came, least = np.mean(every, axis=0)
    worst = max(abs(e[1] / e[2] - 1) for e in every)
    widths = f"{again:.2f} | {foretold:.2f} | {came:.2f} | {came / again:.2f} | {100 * worst:.0f} % | {least:.2f}"
    print(f"| {name} | {widths} | {chosen} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experiments", type=int, default=6)
    parser.add_argument("--states", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    beam = replace(load_specimen("type1").mechanics(), section="plane-stress")
    thick = replace(beam, width_mm=5.0, length_mm=40.0, magnet=beam.magnet and replace(beam.magnet, width_mm=5.0))
    hanging = Setting("hanging", beam)
    mounted = [Setting("level", beam, 90.0), Setting("upright", beam, 180.0)]
    weighed = [Setting(f"level, {g:g} g", beam, 90.0, 9.81e-3 * g) for g in (0.5, 1.0, 2.0)]
    shaped = [Setting("thick, level, 5 g", thick, 90.0, 9.81e-3 * 5.0), Setting("thick", thick)]
    print("| what may be chosen | equal steps, ± % | foretold | came out | share | worst forecast | no less | chosen |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    noisy, bench = Bench((), 0.05), Bench(stated(), 0.005)
    common = {"states": options.states, "runs": options.experiments, "seed": options.seed}
    row("fields; noise alone", hanging, [hanging], noisy, **common)
    row("fields and mounting; noise alone", hanging, [hanging, *mounted], noisy, **common)
    row("fields; bench", hanging, [hanging], bench, **common)
    row("fields and mounting; bench", hanging, [hanging, *mounted], bench, **common)
    row("fields, mounting and a tip weight; bench", hanging, [hanging, *mounted, *weighed], bench, **common)
    row("… and another shape; bench", hanging, [hanging, *mounted, *weighed, *shaped], bench, **common)


if __name__ == "__main__":
    main()
