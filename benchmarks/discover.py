"""Measure how often `eimi discover` names the terms of a simulated material's strain energy rightly or wrongly.

python -m benchmarks.discover [--laws 100] [--seed 2] [--workers 2] [--solid] [--off 1.3]

Each material has one to three terms, drawn from the library of terms. The table counts the results "right", "not
identifiable" (the program says that the data do not decide) and "wrong", once for bending and tension together and once
for bending alone. With ``--solid`` all beams are three-dimensional, not in plane stress. With ``--off 1.3`` the fixed
numbers in the terms (Jm, b, alpha) differ from the library by a factor of up to 1.3.
"""

# A law is a sum of terms of the strain energy. `eimi discover` chooses the terms from a library. Each hidden law has
# one, two or three terms of the library, drawn at random, and an initial shear modulus between 15 and 60 kPa. Every
# term carries at least 15 % of the stress at the end of the tensile test. The evidence for each law consists of
#
# - a tensile test to 300 % strain in 150 rows, with normal noise of 0.2 % of its largest stress;
# - a bent beam in six states (load steps), simulated on a finer mesh than the mesh of the fit, with 0.4 µm of noise on
#   its edge points. The dimensions are those of one of the specimen files type1, type2 and type3. The beam is stiffer
#   or softer than the law by a random 2 % (standard deviation), as if it came from another lot of the material than the
#   tensile test. The discovery knows this uncertainty.
#
# Hidden beams and fits are in plane stress, which takes a quarter of the time of the solid model. ``--solid`` uses the
# solid model for both. The search for the modulus at the beginning of a discovery is left out: the discovery starts
# within 10 % of the true value.
#
# With ``--off 1.3`` the constants Jm, b and alpha in the terms of the hidden laws differ from the constants of the
# library by a factor of up to 1.3. The named and the true terms are then compared by their kinds only.

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from eimi_fitting.discovery.bending_rows import NoEquilibrium
from eimi_fitting.discovery.terms_of_a_law import MOST_TERMS, Discovery, discover
from eimi_fitting.laws.sum_of_terms import Term
from tests.shared.hidden_laws import Hidden

TENSILE_NOISE = 0.002
BEGUN_WITHIN = 0.1  # largest error of the modulus (in its logarithm) with which a discovery starts
SEED = 2
BOTH, BENDING, TENSION = "bending and tension", "bending alone", "tension alone"


@dataclass(frozen=True)
class Case:
    # A material drawn at random, and the settings of its simulated measurements.
    # seed, number : int
    #     Seed of the benchmark and number of the material; together the seed of all random values.
    # solid : bool
    #     True for a three-dimensional beam, false for a beam in plane stress.
    # noise : float
    #     Standard deviation of the tensile noise, divided by the largest stress.
    # off : float
    #     Largest factor by which the fixed numbers (Jm, b, alpha) of the material differ from those of the terms that
    #     `eimi discover` tries.
    # evidence
    #     The kinds of data: the bent beam, the tensile test, or both.

    seed: int
    number: int
    noise: float
    solid: bool
    off: float
    evidence: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """A simulated material, and the terms that `eimi discover` names from the bent beam, the tensile test, and both.

    The result for one kind of data is None if a beam had no equilibrium.
    """

    number: int
    hidden: Hidden
    discoveries: dict[str, Discovery | None]


def outcome(case: Case) -> Outcome | None:
    """Draw a material, simulate its tensile test and bent beam, and search for its terms in each kind of data.

    The result is None if the drawn beam has no equilibrium.
    """
    rng = np.random.default_rng([case.seed, case.number])
    hidden = Hidden.drawn(rng, case.off)
    curve = hidden.curve(case.noise, rng)
    try:
        bent = [] if case.evidence == (TENSION,) else [hidden.bent(case.solid, rng)]
    except NoEquilibrium:
        return None
    modulus_Pa = hidden.modulus_Pa * np.exp(rng.uniform(-BEGUN_WITHIN, BEGUN_WITHIN))
    discoveries: dict[str, Discovery | None] = {}
    for kind in case.evidence:
        beams, curves = [] if kind == TENSION else bent, [] if kind == BENDING else [curve]
        try:
            discoveries[kind] = discover(beams, curves, modulus_Pa=modulus_Pa)
        except NoEquilibrium:
            discoveries[kind] = None
    return Outcome(case.number, hidden, discoveries)


def judged(discovery: Discovery | None, hidden: Hidden) -> str:
    """Return "right" or "wrong" for a result of the search, or "open" if the search does not decide or failed."""
    if discovery is None or not discovery.identified:
        return "open"
    return "right" if _kinds(discovery.alternatives[0].terms) == _kinds(hidden.terms) else "wrong"


def _kinds(terms: Sequence[Term]) -> list[tuple[str, bool]]:
    return [(term.kind, (term.number or 1.0) > 0) for term in terms]


def row(name: str, words: Sequence[str]) -> str:
    """Return a row of a Markdown table that counts the words "right", "open" and "wrong" in ``words``."""
    counts = " | ".join(str(words.count(word)) for word in ("right", "open", "wrong"))
    return f"| {name} | {len(words)} | {counts} |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--laws", type=int, default=100, help="number of hidden laws")
    parser.add_argument("--first", type=int, default=0, help="number of the first law")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of laws and noise")
    parser.add_argument(
        "--noise", type=float, default=TENSILE_NOISE, help="noise of the tensile test, as a share of its stress"
    )
    parser.add_argument("--off", type=float, default=1.0, help="largest factor on Jm, b and alpha of the library")
    parser.add_argument("--solid", action="store_true", help="use solid models instead of plane stress")
    parser.add_argument("--from", dest="evidence", choices=[BOTH, BENDING, TENSION], action="append", default=[])
    parser.add_argument("--workers", type=int, default=2, help="number of processes")
    parser.add_argument("--each", action="store_true", help="print the result of each law")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.laws)
    kinds = tuple(options.evidence) or (BOTH, BENDING)
    cases = [Case(options.seed, number, options.noise, options.solid, options.off, kinds) for number in numbers]
    done: list[Outcome] = []
    with ProcessPoolExecutor(options.workers) as pool:
        for one in pool.map(outcome, cases):
            if one is None:
                print("a hidden beam finds no equilibrium: not counted")
                continue
            done.append(one)
            if options.each:
                names = " + ".join(term.name for term in one.hidden.terms)
                for discovery in one.discoveries.values():
                    statement = discovery.statement if discovery else "no equilibrium"
                    print(one.number, judged(discovery, one.hidden), f"[{names}]", statement, flush=True)
    words = {name: [judged(o.discoveries[name], o.hidden) for o in done] for name in done[0].discoveries}
    print("| evidence | laws | right | not identifiable | wrong |\n| --- | --- | --- | --- | --- |")
    for name, verdicts in words.items():
        print(row(name, verdicts))
        if name != BENDING:
            for count in range(1, MOST_TERMS + 1):
                some = [word for word, o in zip(verdicts, done, strict=True) if len(o.hidden.terms) == count]
                print(row(f"of these, {count} term{'s' if count > 1 else ''}", some))
    both, alone = words.get(BOTH, []), words.get(BENDING, [])
    # The goals: at least 90 % right from bending and tension together, at most 5 % wrong from bending alone.
    return 0 if both.count("right") >= 0.9 * len(both) and alone.count("wrong") <= 0.05 * len(alone) else 1


if __name__ == "__main__":
    sys.exit(main())
