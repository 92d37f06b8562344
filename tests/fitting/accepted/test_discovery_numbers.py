"""Each step of the search for the terms of a law gives the accepted numbers, without simulations."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.discovery.bending_rows import bending_rows
from eimi_fitting.discovery.rows import Rows
from eimi_fitting.discovery.supports import minimal, supports, upper_coefficients
from eimi_fitting.discovery.tensile_rows import tensile_rows
from eimi_fitting.discovery.terms_of_a_law import LIBRARY, Discovery, discover
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress
from tests.shared.accepted_numbers import check, described
from tests.shared.quick_fits import BEAM, PARAMETERS, edges, experiment, points

ACCEPTED = Path(__file__).parent / "discovery"
STRIP = Specimen(25.0, 2.5, 8.0, 1070.0, "plane-stress")
UNDER_FORCE = Loads.along([0.0] * 3, gravity_angle_deg=80.0, tip_force_N=[4e-4, -9e-4, 2.1e-3])
SOLID = replace(BEAM, section="solid", depth_mm=4.0)


def curve(largest: float, noise_Pa: float, weight: float = 1.0, correlated: int = 1) -> TensileCurve:
    strain = np.linspace(0.02, largest, 40)
    stress = engineering_stress(LAWS["mooney-rivlin"], np.array([PARAMETERS["mooney-rivlin"]]), strain)[0]
    noise = np.random.default_rng(5).normal(0, noise_Pa, 40)
    return TensileCurve(strain, stress + np.convolve(noise, np.ones(correlated), "same"), weight)


def beams() -> list[Experiment]:
    return [
        experiment(edges(), width=0.02, clamp=0.01),
        experiment(points(STRIP, UNDER_FORCE, "mooney-rivlin"), STRIP, UNDER_FORCE, "2", length=0.05, width=0.01),
        experiment(edges(SOLID, seed=6), SOLID, remanence=0.02),
    ]


def of_rows(rows: Rows, name: str) -> Iterator[str]:
    # Only what does not depend on the arbitrary directions of the whitened equations.
    both = np.column_stack([rows.observed, rows.columns, rows.nuisances])
    yield from described((both.T @ both, rows.groups, rows.fit_all_terms()), name)


def of_discovery(found: Discovery, name: str) -> Iterator[str]:
    yield from described(
        replace(found, open_terms={}, library=(), left_out=(), compatible_sets=(), alternatives=()), name
    )
    yield from described({term.name: share for term, share in found.open_terms.items()}, f"{name} open")
    yield from described([[term.name for term in one] for one in found.compatible_sets], f"{name} compatible")
    for one in found.alternatives:
        # The prediction error of a cross-validation of beams depends on rounding.
        one = one if not found.noise_mm else replace(one, held_out_error=1.0)
        yield from described((replace(one, terms=()), [term.name for term in one.terms]), f"{name} alternative")
    yield from described(([term.name for term in found.left_out], found.statement, found.identified), name)


def bent_rows() -> Iterator[str]:
    about = np.zeros(len(LIBRARY))
    about[[0, 1, 2]] = 15e3, 6e3, 1e3
    for lot in (0.0, 0.02):
        rows, noise = bending_rows(beams(), LIBRARY, about, lot)
        yield from of_rows(rows, f"lot {lot}")
        yield from described(noise, f"lot {lot}")


def pulled_rows() -> Iterator[str]:
    for name, one in (
        ("white", curve(0.8, 200.0)),
        ("correlated", curve(2.0, 150.0, 0.5, 4)),
        ("exact", curve(0.8, 0.01)),
    ):
        rows, noise = tensile_rows(one, LIBRARY)
        yield from described((rows, noise), name)


def sets() -> Iterator[str]:
    rows = Rows.joined([tensile_rows(one, LIBRARY)[0] for one in (curve(2.0, 150.0), curve(0.8, 300.0, 0.7, 3))])
    nuisances = np.random.default_rng(7).normal(size=(len(rows.observed), 2))
    rows = replace(rows, nuisances=nuisances)
    found = supports(rows, np.array([term.has_modulus for term in LIBRARY]), 2)
    yield from described(found, "sets")
    smallest = minimal(found)
    yield from described([one.terms for one in smallest], "smallest")
    yield from described(upper_coefficients(rows, smallest[0].terms), "upper")


def laws() -> Iterator[str]:
    yield from of_discovery(discover([], [curve(2.0, 100.0)], most_terms=2), "curve")
    yield from of_discovery(discover(beams()[:1], [], most_terms=2, modulus_Pa=44e3), "beam")
    yield from of_discovery(discover(beams()[:2], [curve(1.2, 300.0)], most_terms=2, modulus_Pa=44e3), "both")
    yield from of_discovery(discover([], [curve(0.4, 30.0, 1.0, 6)], most_terms=1), "one term")


PARTS = {"bent rows": bent_rows, "pulled rows": pulled_rows, "sets": sets, "laws": laws}


@pytest.mark.parametrize("name", PARTS)
def test_the_terms_of_a_law_have_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    relative = 1e-3 if name == "laws" else 2e-5
    check(PARTS[name](), ACCEPTED / f"{name.replace(' ', '_')}.txt", tmp_path, relative, 1e-9)
