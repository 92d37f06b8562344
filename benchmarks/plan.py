"""Compare runs in planned fields with runs in equally spaced fields: the width of the 95 % interval of the modulus.

    python -m benchmarks.plan [--experiments 6] [--states 6] [--seed 1]

Each experiment is a simulated measurement with random errors of the inputs and of the edges. A plan is made from a
first run with equally spaced fields, and may also choose the mounting, the weight at the tip and the specimen. The
table shows the half-widths without a plan, predicted by the plan, and measured with the plan.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eimi_fitting.inference.planning.exchange import equally_spaced, exchange
from eimi_lab.config.specimen import load_specimen
from tests.shared.planned_states import FIELD_MT, Bench, Setting, fitted, half_percent, measured, planned
from tests.shared.virtual_measurements import stated

EXPLANATION = """\
equal steps: half-width with equally spaced fields; share: measured over equal steps; largest error: of the predicted
half-width; bound: computed lower bound, which is as uncertain as a prediction, so that a measured half-width may lie
slightly below it; noise alone: the inputs are exact; bench: the inputs have the uncertainties of the bench example;
last row: fields, mounting, tip weight and shape"""


def row(
    name: str, before: Setting, after: Sequence[Setting], bench: Bench, *, states: int, runs: int, seed: int
) -> None:
    """Plan and measure several runs, and print the averaged half-widths (%) of the 95 % interval of the modulus.

    Parameters
    ----------
    name : str
        Name of the row.
    before : Setting
        Mounting and specimen of the first run.
    after : sequence of Setting
        Mountings and specimens from which the plan chooses.
    bench : Bench
        Uncertainties of the inputs and noise of the edges.
    states, runs : int
        Number of states of a run, and number of runs.
    seed : int
        Seed of the random values.
    """
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
        resulting = half_percent(fitted(measured(setting, loads, bench, rng)))
        again = half_percent(fitted(measured(before, spaced, bench, rng)))
        every.append((again, plan.half_width_percent(choice), resulting, plan.least_percent(states)))
        chosen = f"{setting.name}: {', '.join(f'{1e3 * b:.2f}' for b in loads.field_T[:, 1])} mT"
    again, predicted, resulting, least = np.mean(every, axis=0)
    worst = max(abs(e[1] / e[2] - 1) for e in every)
    widths = (
        f"{again:.2f} | {predicted:.2f} | {resulting:.2f} | {resulting / again:.2f} | {100 * worst:.0f} % | {least:.2f}"
    )
    print(f"| {name} | {widths} | {chosen} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experiments", type=int, default=6, help="experiments for each row")
    parser.add_argument("--states", type=int, default=6, help="states of a plan")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    beam = replace(load_specimen("type1").mechanics(), section="plane-stress")
    thick = replace(beam, width_mm=5.0, length_mm=40.0, magnet=beam.magnet and replace(beam.magnet, width_mm=5.0))
    hanging = Setting("hanging", beam)
    mounted = [Setting("level", beam, 90.0), Setting("upright", beam, 180.0)]
    weighed = [Setting(f"level, {g:g} g", beam, 90.0, 9.81e-3 * g) for g in (0.5, 1.0, 2.0)]
    shaped = [Setting("thick, level, 5 g", thick, 90.0, 9.81e-3 * 5.0), Setting("thick", thick)]
    print("| what may be chosen | equal steps, ± % | predicted | measured | share | largest error | bound | chosen |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    noisy, bench = Bench((), 0.05), Bench(stated(), 0.005)
    common = {"states": options.states, "runs": options.experiments, "seed": options.seed}
    row("fields; noise alone", hanging, [hanging], noisy, **common)
    row("fields and mounting; noise alone", hanging, [hanging, *mounted], noisy, **common)
    row("fields; bench", hanging, [hanging], bench, **common)
    row("fields and mounting; bench", hanging, [hanging, *mounted], bench, **common)
    row("fields, mounting and a tip weight; bench", hanging, [hanging, *mounted, *weighed], bench, **common)
    row("… and another shape; bench", hanging, [hanging, *mounted, *weighed, *shaped], bench, **common)
    print(f"\n{EXPLANATION}")


if __name__ == "__main__":
    main()
