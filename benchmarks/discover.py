"""Does `eimi discover` find the terms of hidden laws, and does it say so where the data do not tell?

python -m benchmarks.discover [--laws 100] [--seed 2] [--workers 2]

Each hidden law has one, two or three terms of the library, drawn at random, and an initial shear modulus between 15 and
60 kPa. Every term carries at least 15 % of the stress at the end of the tensile test. The evidence of each:

- a tensile test to 300 % in 150 rows, with normal noise of 0.2 % of its largest stress;
- type 1, 2 or 3 bent in six states, on a finer mesh than any of the fit's, with 0.4 µm of noise on its edge points; its
  lot is stiffer or softer than the other by 2 % (one standard deviation), which the discovery is told.

Hidden beams and fits are in plane stress, which costs a quarter of the solid; ``--solid`` takes both as solids. The
search for the modulus with which a discovery begins is left out: it begins within 10 % of it.

``--off 1.3`` hides laws whose Jm, b and alpha are up to so many times those of the library, or a part of them; terms
are compared by their kinds.

Counted are laws whose terms are all found and no others (right), those for which the answer is "not identifiable"
(open), and those with other terms than the true ones (wrong); from both together, and from bending alone.
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
BEGUN_WITHIN = 0.1  # of the modulus
SEED = 2
BOTH, BENDING, TENSION = "bending and tension", "bending alone", "tension alone"


@dataclass(frozen=True)
class Case:
    """One hidden law; noise: of the tensile test; off: see `_elsewhere`; evidence: kinds of it, each for itself."""

    seed: int
    number: int
    noise: float
    solid: bool
    off: float
    evidence: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """What was hidden, and what was found of it by kind of evidence; None where it was refused."""

    number: int
    hidden: Hidden
    found: dict[str, Discovery | None]


def outcome(case: Case) -> Outcome | None:
    """None where the hidden beam finds no equilibrium."""
    rng = np.random.default_rng([case.seed, case.number])
    hidden = Hidden.drawn(rng, case.off)
    curve = hidden.curve(case.noise, rng)
    try:
        seen = [] if case.evidence == (TENSION,) else [hidden.bent(case.solid, rng)]
    except NoEquilibrium:
        return None
    modulus_Pa = hidden.modulus_Pa * np.exp(rng.uniform(-BEGUN_WITHIN, BEGUN_WITHIN))
    found: dict[str, Discovery | None] = {}
    for kind in case.evidence:
        beams, curves = [] if kind == TENSION else seen, [] if kind == BENDING else [curve]
        try:
            found[kind] = discover(beams, curves, modulus_Pa=modulus_Pa)
        except NoEquilibrium:
            found[kind] = None
    return Outcome(case.number, hidden, found)


def judged(found: Discovery | None, hidden: Hidden) -> str:
    """In a word."""
    if found is None or not found.identified:
        return "open"
    return "right" if _kinds(found.alternatives[0].terms) == _kinds(hidden.terms) else "wrong"


def _kinds(terms: Sequence[Term]) -> list[tuple[str, bool]]:
    return [(term.kind, (term.number or 1.0) > 0) for term in terms]


def row(name: str, words: Sequence[str]) -> str:
    """Of the table."""
    counts = " | ".join(str(words.count(word)) for word in ("right", "open", "wrong"))
    return f"| {name} | {len(words)} | {counts} |"


def main() -> int:
    """Print the table; status 1 for fewer than 90 % right, or more than 5 % wrong from bending alone."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--laws", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="number of the first of them")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--noise", type=float, default=TENSILE_NOISE)
    parser.add_argument("--off", type=float, default=1.0, help="factor by which Jm, b and alpha may differ")
    parser.add_argument("--solid", action="store_true", help="beams as solids")
    parser.add_argument("--from", dest="evidence", choices=[BOTH, BENDING, TENSION], action="append", default=[])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--each", action="store_true", help="print what was found of each")
    asked = parser.parse_args()
    numbers = range(asked.first, asked.first + asked.laws)
    kinds = tuple(asked.evidence) or (BOTH, BENDING)
    cases = [Case(asked.seed, number, asked.noise, asked.solid, asked.off, kinds) for number in numbers]
    done: list[Outcome] = []
    with ProcessPoolExecutor(asked.workers) as pool:
        for one in pool.map(outcome, cases):
            if one is None:
                print("a hidden beam finds no equilibrium: not counted")
                continue
            done.append(one)
            if asked.each:
                names = " + ".join(term.name for term in one.hidden.terms)
                for found in one.found.values():
                    told = found.statement if found else "no equilibrium"
                    print(one.number, judged(found, one.hidden), f"[{names}]", told, flush=True)
    words = {name: [judged(o.found[name], o.hidden) for o in done] for name in done[0].found}
    print("| evidence | laws | right | not identifiable | wrong |\n| --- | --- | --- | --- | --- |")
    for name, own in words.items():
        print(row(name, own))
        if name != BENDING:
            for count in range(1, MOST_TERMS + 1):
                some = [word for word, o in zip(own, done, strict=True) if len(o.hidden.terms) == count]
                print(row(f"of these, {count} term{'s' if count > 1 else ''}", some))
    both, alone = words.get(BOTH, []), words.get(BENDING, [])
    return 0 if both.count("right") >= 0.9 * len(both) and alone.count("wrong") <= 0.05 * len(alone) else 1


if __name__ == "__main__":
    sys.exit(main())
