"""Count how often a fit has a doubt although the files of the bench are right.

python -m benchmarks.rate_of_doubts [--experiments 100] [--seed 1] [--exact] [--one-polarity] [--record FILE]

A doubt is a warning about a fit. Some doubts name a cause: a property of the bench that seems to differ from its files,
such as a tilted camera. Each experiment is a virtual measurement of the beam of the bench example, in plane stress. The
true value of every input, such as a width, is drawn about the nominal value with the standard uncertainty that the
files of the bench example give. The edges have white noise; no pictures are rendered. The fit knows only the nominal
values and their uncertainties, and it measures the shape at rest, as `eimi fit` does.

The files are right, so that every doubt is a false alarm. A cause that a doubt names can still be present, because the
inputs deviate within their uncertainties.

--exact         Every input has its nominal value.
--one-polarity  Eight increasing fields of one polarity (sign) replace the 13 fields of both polarities.
--record        One line of JSON is appended to a file for each fit (`benchmarks.ranked_causes`).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.imperfect_rigs import BOTH_MT, FIELD_MT, MODULUS_PA, Imperfection, bent, measured
from benchmarks.ranked_causes import Ranked
from eimi_fitting.inference.doubts.causes import NONE
from eimi_fitting.inference.evidence.sources import loads_under, specimen_under
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.inference.identification import identify
from eimi_fitting.inference.searching.measured_rest_shape import measured_rest_shape
from tests.shared.virtual_measurements import deviations_drawn, stated

_NAMED = 0.5  # probability from which a cause counts as named


def drawn_bench(seed: int) -> Imperfection:
    """Return a bench whose true inputs differ from the values in its files by random deviations.

    The deviations are drawn with the uncertainties that the files state.
    """
    deviations = deviations_drawn(np.random.default_rng([seed, 29]), stated())
    setup = Setup.of(((s, part, value) for s, values in deviations.items() for part, value in enumerate(values)), 1)
    return Imperfection(
        NONE,
        f"draw {seed}",
        lambda nominal: specimen_under(nominal, deviations),
        lambda loads: replace(
            loads_under(loads, deviations), field_T=setup.field_factor[0] * loads_under(loads, deviations).field_T
        ),
        setup.imaged,
    )


def fitted(seed: int, exact: bool, one_polarity: bool) -> Ranked:
    """Simulate and fit one experiment, and return its causes and doubts.

    Parameters
    ----------
    seed : int
        Seed of the drawn inputs and of the noise.
    exact : bool
        Whether every input has its nominal value.
    one_polarity : bool
        Whether the fields have one polarity and only increase.
    """
    field_mT = FIELD_MT if one_polarity else BOTH_MT
    bench = Imperfection(NONE, "perfect rig") if exact else drawn_bench(seed)
    edges, _ = bent(bench, field_mT, planar=True)
    straight = replace(measured(edges[:, :, 8:-2], field_mT, seed, planar=True), stated=stated())
    shape = measured_rest_shape(straight)
    fit = identify("neo-hookean", [shape.applied(straight) if shape else straight])
    return Ranked.of(fit, NONE, seed, "measured" if shape else "straight", MODULUS_PA)


def counts(results: Sequence[Ranked]) -> str:
    """Return four lines of text, each with a number of fits.

    The lines count the fits with a cause whose probability is above `_NAMED`, with a doubt that names a cause, with any
    doubt, and with a 95 % interval that contains the true modulus.
    """
    named = sum(any(e.probability > _NAMED and e.name != NONE for e in one.causes) for one in results)
    lines = {
        f"name a cause with more than {_NAMED:g}": named,
        "have a doubt that names a cause": sum(one.doubted_percent is not None for one in results),
        "have any doubt": sum(one.doubts > 0 for one in results),
        "have an interval that holds the truth": sum(one.holds for one in results),
    }
    return "\n".join(f"{count} of {len(results)} {words}" for words, count in lines.items())


def main() -> None:
    """Simulate and fit the experiments; print the causes and doubts of each fit, and the counts of fits with doubts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experiments", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1, help="seed of the first experiment")
    parser.add_argument("--exact", action="store_true", help="every input has its nominal value")
    parser.add_argument("--one-polarity", action="store_true", help="use increasing fields of one polarity")
    parser.add_argument("--record", type=Path, metavar="FILE", help="append one line of JSON for each fit to a file")
    asked = parser.parse_args()
    results = []
    for seed in range(asked.seed, asked.seed + asked.experiments):
        results.append(fitted(seed, asked.exact, asked.one_polarity))
        print(f"{results[-1].in_words()}; {results[-1].doubts} doubts", flush=True)
        if asked.record:
            with asked.record.open("a", encoding="utf-8") as file:
                file.write(results[-1].as_json() + "\n")
    print(counts(results))


if __name__ == "__main__":
    main()
