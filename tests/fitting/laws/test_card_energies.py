"""The energy that a finite-element program computes from a material card is the energy of the law.

Sources: Abaqus Analysis User's Guide; ANSYS Material Reference, TB,HYPER; COMSOL Structural Mechanics Module User's
Guide; FEBio User's Manual; SOFA, TetrahedronHyperelasticityFEMForceField.
"""

from __future__ import annotations

import re
import shlex
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from eimi_fitting.laws.cards import SOLVERS, Material, material_card

Numbers = Sequence[float]
Energy = Callable[[Numbers, np.ndarray], float]
BULK_PA = 7e7
_CHAIN = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)


def first(s: np.ndarray) -> float:
    return float((s**2).sum())


def second(s: np.ndarray) -> float:
    return float((s**-2).sum())


def neo_hooke(half_mu: float, s: np.ndarray) -> float:
    return half_mu * (first(s) - 3)


def yeoh(c: Numbers, s: np.ndarray) -> float:
    return sum(c[i] * (first(s) - 3) ** (i + 1) for i in range(3))


def ogden(factors: Numbers, exponents: Numbers, s: np.ndarray) -> float:
    return sum(factor * float((s**a).sum() - 3) for factor, a in zip(factors, exponents, strict=True))


def arruda_boyce(mu: float, locking: float, s: np.ndarray) -> float:
    return mu * sum(c / locking ** (2 * i - 2) * (first(s) ** i - 3**i) for i, c in enumerate(_CHAIN, 1))


def two_over(numbers: Numbers) -> float:
    # Return the bulk modulus 2/D (MPa), where D is the last constant of a card.
    return 2 / numbers[-1]


def two_over_first_of_three(numbers: Numbers) -> float:
    # Return the bulk modulus 2/D_1 (MPa), where D_1, D_2 and D_3 are the last three constants of a card.
    assert list(numbers[-2:]) == [0.0, 0.0]
    return 2 / numbers[-3]


@dataclass(frozen=True)
class Reading:
    # The material in a card: isochoric energy, bulk modulus (MPa) and number of constants.

    energy: Energy
    bulk: Callable[[Numbers], float]
    count: int


def _keyword(
    *, of_yeoh: Callable[[Numbers], float], of_ogden: Callable[[Numbers], float], ansys: bool
) -> list[Reading]:
    # Return, for each law, how Abaqus (or ANSYS, if `ansys`) interprets the constants of a material card (input).
    # of_yeoh, of_ogden : bulk modulus from the constants of Yeoh's and of Ogden's law, which differs between the
    # programs
    half = 0.5 if ansys else 1.0
    per_term = (lambda mu, a: mu / a) if ansys else (lambda mu, a: 2 * mu / a**2)
    more = 0 if ansys else 2
    return [
        Reading(lambda c, s: neo_hooke(half * c[0], s), two_over, 2),
        Reading(lambda c, s: c[0] * (first(s) - 3) + c[1] * (second(s) - 3), two_over, 3),
        Reading(yeoh, of_yeoh, 4 + more),
        Reading(lambda c, s: ogden([per_term(c[i], c[i + 1]) for i in (0, 2, 4)], c[1:6:2], s), of_ogden, 7 + more),
        Reading(lambda c, s: arruda_boyce(c[0], c[1], s), two_over, 3),
    ]


_NAMES = {
    "abaqus": ["NEO HOOKE", "MOONEY-RIVLIN", "YEOH", "OGDEN, N=3", "ARRUDA-BOYCE"],
    "ansys": ["1,1,2,NEO", "1,1,2,MOONEY", "1,1,3,YEOH", "1,1,3,OGDEN", "1,1,3,BOYCE"],
}
_ABAQUS = _keyword(of_yeoh=two_over_first_of_three, of_ogden=two_over_first_of_three, ansys=False)
_ANSYS = _keyword(of_yeoh=two_over, of_ogden=two_over, ansys=True)

READINGS: dict[tuple[str, str], Reading] = {
    **{("abaqus", name): reading for name, reading in zip(_NAMES["abaqus"], _ABAQUS, strict=True)},
    **{("calculix", name): reading for name, reading in zip(_NAMES["abaqus"], _ABAQUS, strict=True)},
    **{("ansys", name): reading for name, reading in zip(_NAMES["ansys"], _ANSYS, strict=True)},
    # COMSOL's table has no name of a law: a person chooses the law by the names of the constants.
    ("comsol", "mu"): Reading(lambda c, s: neo_hooke(c[0] / 2, s), lambda c: c[-1], 2),
    ("comsol", "C10 C01"): Reading(lambda c, s: c[0] * (first(s) - 3) + c[1] * (second(s) - 3), lambda c: c[-1], 3),
    ("comsol", "c1 c2 c3"): Reading(yeoh, lambda c: c[-1], 4),
    ("comsol", "mu1 alpha1 mu2 alpha2 mu3 alpha3"): Reading(
        lambda c, s: ogden([c[i] / c[i + 1] for i in (0, 2, 4)], c[1:6:2], s), lambda c: c[-1], 7
    ),
    ("comsol", "mu0 Nseg"): Reading(lambda c, s: arruda_boyce(c[0], c[1] ** 0.5, s), lambda c: c[-1], 3),
    ("febio", "incomp neo-Hookean"): Reading(lambda c, s: neo_hooke(c[0] / 2, s), lambda c: c[-1], 2),
    ("febio", "Mooney-Rivlin"): Reading(
        lambda c, s: c[0] * (first(s) - 3) + c[1] * (second(s) - 3), lambda c: c[-1], 3
    ),
    ("febio", "Ogden"): Reading(
        lambda c, s: ogden([c[i] / c[i + 1] ** 2 for i in (0, 2, 4)], c[1:6:2], s), lambda c: c[-1], 7
    ),
    ("sofa", "NeoHookean"): Reading(lambda c, s: neo_hooke(c[0] / 2, s), lambda c: c[1] + 2 * c[0] / 3, 2),
    ("sofa", "MooneyRivlin"): Reading(lambda c, s: c[0] * (first(s) - 3) + c[1] * (second(s) - 3), lambda c: c[-1], 3),
    ("sofa", "Ogden"): Reading(lambda c, s: ogden([c[0] / c[1] ** 2], [c[1]], s), lambda c: c[-1], 3),
}


def read(solver: str, card: str) -> tuple[str, Numbers]:
    # Return the name of the law in a material card, and its constants (moduli in MPa).
    if solver in ("abaqus", "calculix"):
        name, _, rows = card.partition("*HYPERELASTIC, ")[2].partition("\n")
        return name, [float(x) for row in rows.splitlines() for x in row.split(",")]
    if solver == "ansys":
        name = card.partition("TB,HYPER,")[2].partition("\n")[0]
        rows = [row.split(",") for row in card.splitlines() if row.startswith("TBDATA")]
        assert [int(row[1]) for row in rows] == [6 * i + 1 for i in range(len(rows))]
        return name, [float(x) for row in rows for x in row[2:]]
    if solver == "comsol":
        table = [shlex.split(row)[:2] for row in card.splitlines()]
        values = {name: value for name, value in table if name != "eimi_origin"}
        numbers = [float(v.removesuffix("[Pa]")) * (1e-6 if v.endswith("[Pa]") else 1.0) for v in values.values()]
        return " ".join(list(values)[:-1]), numbers
    element = ET.fromstring(card)
    if solver == "sofa":
        return element.get("materialName") or "", [float(x) for x in (element.get("ParameterSet") or "").split()]
    assert element.findtext("pressure_model") == "2"
    tags = {"incomp neo-Hookean": ["G"], "Mooney-Rivlin": ["c1", "c2"], "Ogden": ["c1", "m1", "c2", "m2", "c3", "m3"]}
    name = element.get("type") or ""
    return name, [float(element.findtext(tag) or "nan") for tag in [*tags.get(name, []), "k"]]


def febio_expression(card: str, s: np.ndarray) -> float:
    # Return the energy (MPa) of the formula in a FEBio card at the principal stretches s, shape (3,).
    text = (ET.fromstring(card).findtext("W") or "").replace("^", "**")
    assert re.fullmatch(r"[-+*() .\dI]+", text)
    return float(eval(text, {"I1": first(s)}))


SHAPES = [np.array(s) / np.prod(s) ** (1 / 3) for s in ([2.0, 0.7, 0.7], [1.4, 1.3, 0.6], [0.5, 1.1, 1.6])]


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_energy_of_a_card_is_that_of_the_law(solver: str, row) -> None:
    parameters = np.array([20e3, 1.7, 0.0, 5.0, 0.0, -2.0]) if (solver, row.law.name) == ("sofa", "ogden") else None
    if parameters is None and solver in row.refused:
        pytest.skip("the program has no such law")
    chosen = Material(row.law, np.array(row.silicone) if parameters is None else parameters, BULK_PA, "S", ())
    card = material_card(solver, chosen)
    name, numbers = read(solver, card)
    law = [1e-6 * float(row.law.principal(chosen.parameters, s)[0]) for s in SHAPES]
    if name == "uncoupled hyperelastic":
        assert numbers == pytest.approx([1e-6 * BULK_PA], rel=1e-9)
        assert [febio_expression(card, s) for s in SHAPES] == pytest.approx(law, rel=1e-8)
        return
    reading = READINGS[solver, name]  # a card of a new law needs its energy in this table
    assert len(numbers) == reading.count
    assert reading.bulk(numbers) == pytest.approx(1e-6 * BULK_PA, rel=1e-9)
    assert [reading.energy(numbers, s) for s in SHAPES] == pytest.approx(law, rel=1e-8)
