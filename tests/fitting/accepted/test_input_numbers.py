"""Uncertain inputs, possible causes of residuals, and the effect of each input agree with stored reference values."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eimi_fitting.beam.coil_field import CoilShape
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.view import View
from eimi_fitting.inference.doubts.table_of_causes import POSSIBLE_CAUSES
from eimi_fitting.inference.evidence.sources import SOURCES, loads_under, specimen_under, view_under
from eimi_fitting.inference.evidence.unknowns import NuisancePrior, Setup, Unknowns, freed_number, nuisances, shared
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space
from tests.shared.accepted_numbers import check, described
from tests.shared.quick_fits import BEAM, experiment, points

ACCEPTED = Path(__file__).parent / "inputs"
CALLABLES = ("field", "image", "specimen", "loads", "lens")
PULLED = Loads.along([0.5, -3.0, 2.0], 80.0, 30.0, [1e-3, 2e-3, -1e-3], 2.0, 50.0)
VIEW = View(np.array([10.0, 1.0]), 200.0, (1.0, -2.0))


def table() -> Iterator[str]:
    for key, entry in SOURCES.items():
        plain = {name: value for name, value in vars(entry).items() if name not in CALLABLES}
        given = [name for name in CALLABLES if getattr(entry, name)]
        yield from described((plain, given, entry.changes_experiment, entry.changes_shapes), key)


def causes() -> Iterator[str]:
    for cause in POSSIBLE_CAUSES:
        yield from described((replace(cause, change=None), cause.change is None, cause.stated_as), cause.name)


def of_deviation(key: str, deviation: np.ndarray) -> list[str]:
    coil = replace(PULLED, coil=CoilShape((0.0, 1.0), (2.0, -1.0), 30.0))
    extended = replace(BEAM, tip_load_mm=(28.0, 0.5))
    given = {key: deviation}
    changed = (
        specimen_under(BEAM, given),
        specimen_under(extended, given).tip_load_mm,
        loads_under(PULLED, given),
        loads_under(coil, given).coil,
        view_under(VIEW, given),
    )
    setup = Setup.of([(key, part, np.array([1.0, -0.4]) * size) for part, size in enumerate(deviation)], 2)
    places = np.array([[10.0, 1.0], [25.0, -3.0]])
    through = (setup, setup.corrected(places), setup.imaged(places), setup.take(np.array([1])))
    return [*described(changed, "under"), *described(through, "setup")]


def effects() -> Iterator[str]:
    unchanged = of_deviation("roll", np.zeros(1))
    yield from unchanged
    for key, entry in SOURCES.items():
        for part in range(len(entry.parts)):
            deviation = 3.0 * entry.usual * np.eye(len(entry.parts))[part] + 0.1 * entry.usual
            yield f"{key} {part}: {freed_number(f'{entry.parts[part]} of dataset 2')}"
            yield from (line for line in of_deviation(key, deviation) if line not in unchanged)
    without = replace(BEAM, magnet=None)
    given = {key: np.array([1.0]) for key in ("remanence", "magnet-length", "length")}
    yield from described(specimen_under(without, given), "without a magnet")
    still = replace(PULLED, field_T=0 * PULLED.field_T)
    given = {"offset": np.array([0.1]), "field-gradient": np.array([1.0, 2.0])}
    yield from described(loads_under(still, given), "without a field")


def groups() -> Iterator[str]:
    strips = [
        experiment(points(BEAM, PULLED), BEAM, PULLED, "a", width=0.02, coil=0.01, axis=0.1),
        experiment(points(BEAM, PULLED), BEAM, PULLED, "b", width=0.03, coil=0.01),
        experiment(points(BEAM, PULLED), BEAM, PULLED, "a", width=0.02, tilt=0.2, coil=0.02),
        experiment(points(BEAM, PULLED), BEAM, PULLED, "c"),
    ]
    stated = [one.stated for one in strips]
    for source in ("width", "coil", "roll", "tilt"):
        found = shared(source, stated)
        yield from described((found, [group.part_name(0, 4) for group in found]), source)
    kinds = (
        ("width", 0.1),
        ("moment", 0.02),
        ("clamp", 0.1),
        ("tilt", 0.3),
        ("gravity", 0.5),
        ("axis", 0.2),
        ("scale", 0.01),
    )
    freed = nuisances([NuisancePrior(kind, spread) for kind, spread in kinds], 4, stated)
    unknowns = Unknowns(search_space(LAWS["yeoh"]).with_bulk(), freed)
    units = np.linspace(0.1, 0.9, 5)[:, None] * np.linspace(0.5, 1.1, len(unknowns.names))
    units[3, 4:] = units[1, 4:]
    for name in ("names", "searched", "ratios", "prior"):
        yield from described(getattr(unknowns, name), name)
    for name in ("parameters", "bulk_modulus_Pa", "standardised"):
        yield from described(getattr(unknowns, name)(units), name)
    yield from described((unknowns.setups(units, 4), unknowns.whole(units[:, :6])), "setups")
    yield from described((unknowns.grouped_by_beam(units, 4), unknowns.grouped_by_lens(units, 4)), "groups")
    yield from described([(one, one.unit) for one in freed], "freed")


PARTS: dict[str, Any] = {"table": table, "causes": causes, "effects": effects, "groups": groups}


@pytest.mark.parametrize("name", PARTS)
def test_inputs_have_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    check(PARTS[name](), ACCEPTED / f"{name}.txt", tmp_path, 2e-6, 1e-12)
