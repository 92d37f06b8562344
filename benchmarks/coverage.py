"""Measure which share of the 95 % intervals of the initial shear modulus contains the true value.

python -m benchmarks.coverage [--experiments 2000] [--seed 1] [--workers 2]

Each experiment is a simulated measurement with random errors of the inputs, and a fit that knows only the nominal
inputs. The goals are a share of 93 to 97 %, apart from statistical errors, and intervals that are at most 15 % wider
than a share of 95 % requires. The column "drawn" is the share of experiments in which the errors of the inputs change
the modulus by less than 1.96 standard deviations, computed from the stated uncertainties (expected: 95 %).
"""

# Each experiment is a separate virtual measurement. A source is an input with an uncertainty that the files of
# specimen, calibration and rig can give, such as width, magnet, scale, coil, clamp, angles and zero of the current. In
# each experiment, the true value of every source is drawn at random with the standard uncertainty of the bench
# examples. The beam with the drawn values is simulated on 26 x 3 elements, and its edges are displaced by the drawn
# errors of the camera. Each edge point gets noise. Half of the variance of this noise is white. The other half has an
# exponential correlation along the edge, as blur and illumination cause. The fit knows only the nominal values and
# their uncertainties. Every fourth beam is simulated and fitted as a three-dimensional solid.
#
# Two simplifications make this number of experiments affordable:
#
# - The fit has four states and 13 x 1 elements. The global search of `eimi fit` is left out, because it does not change
#   the optimum. The local optimisation (polish) starts within 20 % of the true modulus, and the other parameters start
#   anywhere in the middle half of their ranges. All later steps are the same as in `eimi fit`: the corrections for mesh
#   and solid, the noise, the budget (the contribution of each source to the uncertainty of the modulus), and the random
#   draws of the interval.
# - The depth effect, the difference between the solid and the planar model, is computed once for each law and nominal
#   specimen. The hidden beams use this effect as a function of the rotation of the tip. The effect is a few hundredths
#   of the deflection, and the drawn values change the effect by a few hundredths.
#
# The intervals of a row of the table are called right under two conditions. First, 93 to 97 % of the intervals contain
# the true value; the share may be outside these limits by the statistical error that the number of experiments causes.
# Second, the intervals are at most 1.15 times as wide as 95 % coverage needs.

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from tests.shared.virtual_measurements import Case, Outcome, Row, outcome, row


def rows(outcomes: Iterable[Outcome]) -> Iterator[Row]:
    """Yield the rows of the table: statistics of a group of experiments, such as all planar beams."""
    groups: dict[str, list[Outcome]] = {}
    for o in outcomes:
        section = "solid" if o.case.is_solid else "planar"
        group = f"solid, {o.case.model}" if o.case.is_solid else f"{o.case.model}, {1e3 * o.case.noise_mm:g} µm"
        for name in (group, section, "all"):
            groups.setdefault(name, []).append(o)
    wholes = ("planar", "solid", "all")
    for name in sorted(groups, key=lambda name: (name in wholes and 2 + wholes.index(name), name.startswith("solid"))):
        yield row(name, groups[name])


HEADER = (
    "| rows | experiments | half-width, % | of noise and mesh alone | hold the truth, % | 95 % range | drawn | "
    "half-width over needed |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- |"
)


def line(row: Row) -> str:
    """Return a row of the table as text: the share of intervals that contain the true value, and their width."""
    low, high = row.chance_percent
    return (
        f"| {row.name} | {row.experiments} | {row.half_width_percent:.1f} | "
        f"{row.fit_alone_half_width_percent:.2f} | {row.held_percent:.1f} | {low:.1f} to {high:.1f} | "
        f"{row.drawn_percent:.1f} | "
        f"{row.over_needed:.2f}{'' if row.is_right else ' (not right)'} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experiments", type=int, default=2000, help="number of experiments")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2, help="number of processes")
    options = parser.parse_args()
    start_s = time.perf_counter()
    cases = [Case(number, options.seed) for number in range(options.experiments)]
    with ProcessPoolExecutor(options.workers) as pool:
        outcomes = list(pool.map(outcome, cases, chunksize=8))
    table = list(rows(outcomes))
    print("\n".join([HEADER, *map(line, table)]))
    print(
        f"\n{time.perf_counter() - start_s:.0f} s with {options.workers} processes; "
        f"{np.mean([o.seconds for o in outcomes]):.2f} s of processor time an experiment"
    )
    sys.exit(0 if all(r.is_right for r in table) else 1)


if __name__ == "__main__":
    main()
