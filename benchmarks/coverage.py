"""Do 95 % of the 95 % intervals of the initial shear modulus hold the truth, with all that is uncertain drawn?

python -m benchmarks.coverage [--experiments 2000] [--seed 1] [--workers 2]

Each experiment is a measurement of its own. Every source of `eimi_fitting.inference.evidence.sources` that specimen,
calibration
and rig can state is drawn from its stated uncertainty, those of the bench examples: width, magnet, scale, coil, clamp,
angles, zero of the current. The beam that comes of it is simulated on 26 x 3 elements, the camera sees it as it is
wrongly set up, and each edge point gets noise: half of it white, half with an exponential correlation along the edge,
as blur, light and threshold give it. What is fitted states the nominal numbers and their uncertainties, and knows
nothing else. Every fourth hidden beam is a solid, and its fit the solid's.

What makes so many affordable, and what that leaves out:

- The fit is `eimi fit`'s own polish, corrections, noise, budget and draws, in four states on 13 x 1 elements. The
  search is left out: it is about the way to the optimum, and this about what the optimum is worth. The polish begins
  within 20 % of the true modulus, the law's ratios anywhere in the middle half of their ranges.
- What depth adds to a planar beam is solved once for each law and specimen as stated, and carried to the hidden beams
  by how far their tips turn: it is some hundredths of the deflection, and what is drawn changes it by hundredths of it.

A row is right where, within what chance does to so many experiments, 93 to 97 % of the intervals hold the truth, and
where none is wider than 1.15 times what holds 95 %. "Drawn" is how much of that chance lies in the draws: the share of
experiments whose drawn sources, times what the intervals say that each does, lie within 1.96 standard deviations.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from tests.shared.virtual_measurements import Case, Outcome, Row, outcome, row


def rows(outcomes: Iterable[Outcome]) -> Iterator[Row]:
    """By law and noise of the planar ones, by law of the solid ones, and of both and of all."""
    groups: dict[str, list[Outcome]] = {}
    for o in outcomes:
        section = "solid" if o.case.is_solid else "planar"
        own = f"solid, {o.case.model}" if o.case.is_solid else f"{o.case.model}, {1e3 * o.case.noise_mm:g} µm"
        for name in (own, section, "all"):
            groups.setdefault(name, []).append(o)
    wholes = ("planar", "solid", "all")
    for name in sorted(groups, key=lambda name: (name in wholes and 2 + wholes.index(name), name.startswith("solid"))):
        yield row(name, groups[name])


HEADER = (
    "| rows | experiments | half-width, % | of noise | hold the truth, % | chance | drawn | width over needed |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- |"
)


def line(found: Row) -> str:
    """Of the table."""
    low, high = found.chance_percent
    return (
        f"| {found.name} | {found.experiments} | {found.half_width_percent:.1f} | "
        f"{found.fit_alone_half_width_percent:.2f} | {found.held_percent:.1f} | {low:.1f} to {high:.1f} | "
        f"{found.drawn_percent:.1f} | "
        f"{found.over_needed:.2f}{'' if found.is_right else ' (not right)'} |"
    )


def main() -> None:
    """Print the coverage of each row; exit status 1 where one is not right."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experiments", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    begun = time.perf_counter()
    cases = [Case(number, asked.seed) for number in range(asked.experiments)]
    with ProcessPoolExecutor(asked.workers) as pool:
        outcomes = list(pool.map(outcome, cases, chunksize=8))
    found = list(rows(outcomes))
    print("\n".join([HEADER, *map(line, found)]))
    print(
        f"\n{time.perf_counter() - begun:.0f} s with {asked.workers} processes; "
        f"{np.mean([o.seconds for o in outcomes]):.2f} s of processor time an experiment"
    )
    sys.exit(0 if all(r.is_right for r in found) else 1)


if __name__ == "__main__":
    main()
