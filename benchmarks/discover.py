"""Measure how often `eimi discover` identifies the terms of hidden laws, and how often the named terms are wrong.

python -m benchmarks.discover [--laws 100] [--seed 2] [--workers 2]

A law is a sum of terms of the strain energy. `eimi discover` chooses the terms from a library. Each hidden law has one,
two or three terms of the library, drawn at random, and an initial shear modulus between 15 and 60 kPa. Every term
carries at least 15 % of the stress at the end of the tensile test. The evidence for each law consists of

- a tensile test to 300 % strain in 150 rows, with normal noise of 0.2 % of its largest stress;
- a bent beam in six states (load steps), simulated on a finer mesh than the mesh of the fit, with 0.4 µm of noise on
  its edge points. The dimensions are those of one of the specimen files type1, type2 and type3. The beam is stiffer or
  softer than the law by a random 2 % (standard deviation), as if it came from another lot of the material than the
  tensile test. The discovery knows this uncertainty.

Hidden beams and fits are in plane stress, which takes a quarter of the time of the solid model. ``--solid`` uses the
solid model for both. The search for the modulus at the beginning of a discovery is left out: the discovery starts
within 10 % of the true value.

With ``--off 1.3`` the constants Jm, b and alpha in the terms of the hidden laws differ from the constants of the
library by a factor of up to 1.3. The named and the true terms are then compared by their kinds only.

The table counts the laws with each result: "right" if exactly the true terms are identified, "not identifiable" if the
discovery reports that the evidence does not determine the terms, and "wrong" if other terms are named. There is one row
for both kinds of evidence together, and one row for bending alone.
"""

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
    """One case of the benchmark: a hidden law, and the settings of its simulated measurements.

    A discovery has to find the terms of the hidden law from these measurements.

    Attributes
    ----------
    seed, number : int
        The seed of the benchmark and the number of the case. Both together are the seed of the random values, so that
        they determine the hidden law.
    solid : bool
        True if the beam is a solid, false if the beam is in plane stress.
    noise : float
        Standard deviation of the noise of the tensile test, as a share of the largest stress.
    off : float
        Largest factor by which the constants Jm, b and alpha of the hidden law differ from those of the terms that a
        discovery can choose.
    evidence
        The kinds of evidence: the beam alone, the tensile test alone, or both. One discovery is made from each kind.
    """

    seed: int
    number: int
    noise: float
    solid: bool
    off: float
    evidence: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """A hidden law, and one discovery (the search for its terms) from each kind of evidence.

    The kinds of evidence are the bent beam alone, the tensile test alone, and both. A discovery is None if a beam had
    no equilibrium during the search.
    """

    number: int
    hidden: Hidden
    discoveries: dict[str, Discovery | None]


def outcome(case: Case) -> Outcome | None:
    """Draw a law at random, simulate a tensile test and a bent beam with this law, and discover its terms.

    A discovery knows only the simulated measurements. The result contains the drawn law and one discovery for each
    kind of evidence in `case`. The result is None if the beam of the drawn law has no equilibrium.
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
    """Return "right" if a discovery names exactly the terms of the hidden law, and "wrong" if it names other terms.

    The hidden law is the law with which the measurements were simulated. The result is "open" (not identifiable) if
    the discovery does not identify the terms, or is None.
    """
    if discovery is None or not discovery.identified:
        return "open"
    return "right" if _kinds(discovery.alternatives[0].terms) == _kinds(hidden.terms) else "wrong"


def _kinds(terms: Sequence[Term]) -> list[tuple[str, bool]]:
    return [(term.kind, (term.number or 1.0) > 0) for term in terms]


def row(name: str, words: Sequence[str]) -> str:
    """Return a row of the table in Markdown.

    ``words`` has one result for each hidden law: "right", "wrong" or "open" (not identifiable). The row contains the
    number of times that each result occurs.
    """
    counts = " | ".join(str(words.count(word)) for word in ("right", "open", "wrong"))
    return f"| {name} | {len(words)} | {counts} |"


def main() -> int:
    """Print a table with the numbers of right, open (not identifiable) and wrong results; return the exit status.

    The status is 1 if less than 90 % of the results from bending and tension together are right, or if more than 5 % of
    the results from bending alone are wrong. Otherwise the status is 0.
    """
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
    return 0 if both.count("right") >= 0.9 * len(both) and alone.count("wrong") <= 0.05 * len(alone) else 1


if __name__ == "__main__":
    sys.exit(main())
