"""The comments of a material card of a material that relaxes agree with the moduli and the bulk modulus of the card."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.laws.cards import SOLVERS
from eimi_lab.fits.export import bulk_modulus_Pa, card

STATIC = Quantity(90e3, "Pa", (89e3, 91e3))
FIT: Any = SimpleNamespace(
    model="neo-hookean",
    values=lambda: [90e3],
    initial_shear_modulus=STATIC,
    parameters={"mu": STATIC},
    caveats=lambda: ["initial shear modulus 90000 Pa [89000, 91000], 95 % interval"],
    held_by_bounds=lambda: (),
    max_stretch=1.1,
    datasets=(),
    tensile=(),
    versions={},
    time=SimpleNamespace(
        instantaneous_shear_modulus=Quantity(125e3, "Pa", (124e3, 126e3)),
        prony=[SimpleNamespace(g=0.2, tau_s=0.05), SimpleNamespace(g=0.1, tau_s=10.0)],
    ),
)


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_moduli_of_a_card_are_told_apart_from_those_of_the_fit(solver: str) -> None:
    text = card(Path("fits.json"), FIT, solver, bulk_modulus_Pa(FIT, solver, None, 2000.0))
    modulus, factor = ("0.125", "1.389") if solver in ("abaqus", "ansys") else ("0.0875", "0.9722")
    assert f"initial shear modulus {modulus} MPa" in text
    assert f"bulk modulus {2000 * float(modulus):g} MPa, 2000 times the initial shear modulus" in text
    words = f"the moduli above are {factor} times those of the fit, whose initial shear modulus is 90000 Pa"
    assert text.index(modulus) < text.index(words) < text.index("90000 Pa [89000, 91000]")


def test_a_card_without_relaxation_has_the_moduli_of_the_fit() -> None:
    fit: Any = SimpleNamespace(**{**vars(FIT), "time": None})
    text = card(Path("fits.json"), fit, "abaqus", bulk_modulus_Pa(fit, "abaqus", None, 2000.0))
    assert "bulk modulus 180 MPa, 2000 times the initial shear modulus" in text
    assert "times those of the fit" not in text
