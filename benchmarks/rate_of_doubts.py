"""Count how often a fit warns although all inputs are right within their stated uncertainties.

python -m benchmarks.rate_of_doubts [--experiments 100] [--seed 1] [--exact] [--one-polarity] [--record FILE]

Each experiment is a simulated measurement whose true inputs, such as a width, differ from the nominal values by random
errors. A warning may name a cause of the residuals, such as a tilted camera. A named cause counts as right if it was
really drawn and has about the true size.

--exact         All inputs have their nominal values.
--one-polarity  Use 8 increasing fields of one sign, not 13 fields of both signs.
--record        Append one line of JSON for each fit to a file for `benchmarks.ranked_causes`.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.imperfect_rigs import BOTH_MT, FIELD_MT, MODULUS_PA, STATED, Imperfection, bent, measured
from benchmarks.ranked_causes import Ranked
from eimi_fitting.inference.doubts.causes import NONE
from eimi_fitting.inference.doubts.table_of_causes import POSSIBLE_CAUSES
from eimi_fitting.inference.evidence.sources import loads_under, specimen_under
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.inference.searching.measured_rest_shape import measured_rest_shape
from tests.shared.virtual_measurements import deviations_drawn, stated

Array = NDArray[np.float64]

_NAMED = 0.9  # probability from which a cause counts as named
_NEGLIGIBLE = 0.3  # error of the value of a cause that is right in any case, in usual sizes of the cause


def drawn_bench(seed: int) -> Imperfection:
    """Return a bench whose true inputs differ from the stated ones by random errors with the stated uncertainties."""
    deviations = _deviations(seed)
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


def _deviations(seed: int) -> dict[str, Array]:
    return deviations_drawn(np.random.default_rng([seed, 29]), stated())


def fitted(seed: int, exact: bool, one_polarity: bool) -> Ranked:
    """Simulate and fit one experiment; return the result, with the possible causes of the residuals.

    exact: all inputs have their nominal values. one_polarity: the fields have one sign and only increase.
    """
    field_mT = FIELD_MT if one_polarity else BOTH_MT
    bench = Imperfection(NONE, "perfect rig") if exact else drawn_bench(seed)
    edges, _ = bent(bench, field_mT, planar=True)
    straight = replace(measured(edges[:, :, 8:-2], field_mT, seed, planar=True), stated=stated())
    shape = measured_rest_shape(straight)
    fit = identify("neo-hookean", [shape.applied(straight) if shape else straight])
    return Ranked.of(fit, NONE, seed, "measured" if shape else "straight", MODULUS_PA)


def drawn_values(seed: int) -> dict[str, float]:
    """Return the true sizes of possible causes of residuals, such as a wrong width, in the units that a fit reports."""
    drawn = {key: float(values[-1]) for key, values in _deviations(seed).items()}
    magnet = STATED.mechanics().magnet
    assert magnet is not None
    lengths = {"length": magnet.length_mm, "width": magnet.width_mm, "depth": magnet.depth_mm}
    shares = sum(drawn[f"magnet-{name}"] / length for name, length in lengths.items())
    between_deg = drawn["magnetisation-angle"] - drawn["field"]  # alone, neither direction bends the beam differently
    return {
        "moment": drawn["remanence"] / magnet.remanence_T + drawn["coil"] + shares,
        "background_field": drawn["offset"],
        "magnetisation_angle": between_deg,
        "field_direction": -between_deg,
        "width": drawn["width"],
        "scale": drawn["scale"],
        "clamp_angle": drawn["axis"],
    }


def wrong(one: Ranked, values: Mapping[str, float]) -> list[str]:
    """Return the causes of the residuals that a fit names wrongly.

    ``values`` contains the true size of each cause.
    """
    names = []
    for entry in one.causes:
        if entry.probability > _NAMED and entry.name != NONE:
            true = values.get(entry.name, 0.0)
            usual = next(cause.sizes[0] for cause in POSSIBLE_CAUSES if cause.name == entry.name)
            if abs(entry.value - true) > max(abs(true), _NEGLIGIBLE * usual):
                names.append(entry.name)
    return names


def counts(results: Sequence[Ranked], values: Sequence[Mapping[str, float]]) -> str:
    """Return lines of text: how many fits name a cause of their residuals, name a wrong one, or give a warning.

    ``values`` contains the true sizes of the causes for each fit.
    """

    def has(one: Ranked, is_within_stated: bool) -> bool:
        return any(
            e.probability > _NAMED and e.name != NONE and e.is_within_stated is is_within_stated for e in one.causes
        )

    lines = {
        f"name a deviation within its stated uncertainty with more than {_NAMED:g}": [has(o, True) for o in results],
        f"name a cause beyond the stated uncertainties with more than {_NAMED:g}": [has(o, False) for o in results],
        f"name a wrong cause with more than {_NAMED:g}": [
            bool(wrong(one, of_one)) for one, of_one in zip(results, values, strict=True)
        ],
        "have a doubt that names a cause": [one.doubted_percent is not None for one in results],
        "have any doubt": [one.doubts > 0 for one in results],
        "have an interval that holds the truth": [one.holds for one in results],
    }
    return "\n".join(f"{sum(flags)} of {len(results)} {words}" for words, flags in lines.items())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experiments", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1, help="seed of the first experiment")
    parser.add_argument("--exact", action="store_true", help="every input has its nominal value")
    parser.add_argument("--one-polarity", action="store_true", help="use increasing fields of one polarity")
    parser.add_argument("--record", type=Path, metavar="FILE", help="append one line of JSON for each fit to a file")
    asked = parser.parse_args()
    results, values = [], []
    for seed in range(asked.seed, asked.seed + asked.experiments):
        results.append(fitted(seed, asked.exact, asked.one_polarity))
        values.append({} if asked.exact else drawn_values(seed))
        print(f"{results[-1].in_words()}; {results[-1].doubts} doubts", flush=True)
        if asked.record:
            with asked.record.open("a", encoding="utf-8") as file:
                file.write(results[-1].as_json() + "\n")
    print(counts(results, values))


if __name__ == "__main__":
    main()
