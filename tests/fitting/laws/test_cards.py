"""Material cards (inputs of finite-element programs) have the right constants; a law without a card is refused."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from eimi_fitting.laws import LAWS, Law
from eimi_fitting.laws.cards import SOLVERS, Material, NotInSolver, material_card
from eimi_fitting.laws.prony import Prony
from eimi_fitting.laws.tensile import engineering_stress
from tests.patience import PATIENCE_S

PARAMETERS = {  # in Pa; typical of a soft silicone; no constant is zero
    "neo-hookean": [46e3],
    "mooney-rivlin": [20e3, 4e3],
    "yeoh": [19.5e3, 3e3, 400.0],
    "ogden": [20e3, 1.7, 300.0, 5.0, -6e3, -2.0],
}
NEEDS_CCX = pytest.mark.skipif(shutil.which("ccx") is None, reason="needs ccx (Debian package calculix-ccx)")


def material(model: str, parameters: list[float] | None = None, ratio: float = 2000.0) -> Material:
    return card_of(LAWS[model], parameters or PARAMETERS[model], ratio)


def card_of(law: Law, parameters: list[float], ratio: float = 2000.0) -> Material:
    values = np.array(parameters)
    bulk = ratio * float(law.initial_shear_modulus(values))
    return Material(law, values, bulk, "SILICONE", ("fitted up to a strain of 0.5", "from test.csv"))


def numbers(lines: list[str]) -> list[float]:
    return [float(x) for line in lines for x in line.split(",")]


def keyword_constants(card: str) -> list[float]:
    # Return the constants in a card below the line *HYPERELASTIC.
    return numbers(card.partition("*HYPERELASTIC")[2].splitlines()[1:])


UNIT_CUBE = """*NODE, NSET=ALL
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
*ELEMENT, TYPE=C3D8, ELSET=CUBE
1, 1, 2, 3, 4, 5, 6, 7, 8
*NSET, NSET=END
2, 3, 6, 7
"""
STRETCHES = np.array([1.2, 1.5, 2.0])
HELD = {
    1: (1, 4, 5, 8),
    2: (1, 2, 5, 6),
    3: (1, 2, 3, 4),
}  # for each axis, the nodes of the face that is fixed along this axis


def calculix_reactions(folder: Path, chosen: Material) -> np.ndarray:
    # Run CalculiX; return the forces (N) that pull a cube of 1 mm to the stretches in STRETCHES.
    held = "".join(f"{node}, {axis}\n" for axis, face in HELD.items() for node in face)
    steps = "".join(
        "*STEP, NLGEOM, INC=1000\n*STATIC\n0.05, 1.0, 1e-5, 0.1\n*BOUNDARY\n"
        f"END, 1, 1, {stretch - 1}\n*NODE PRINT, NSET=END, TOTALS=ONLY, FREQUENCY=1000\nRF\n*END STEP\n"
        for stretch in STRETCHES
    )
    card = material_card("calculix", chosen)
    deck = f"{UNIT_CUBE}{card}*SOLID SECTION, ELSET=CUBE, MATERIAL=SILICONE\n*BOUNDARY\n{held}{steps}"
    (folder / "cube.inp").write_text(deck)
    command = ["ccx", "cube"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, env=environment)
    assert done.returncode == 0, done.stdout[-2000:]
    totals = re.findall(r"total force.*?\n\s*\n?\s*([-+0-9.E]+)\s", (folder / "cube.dat").read_text())
    return np.array([float(x) for x in totals])


@NEEDS_CCX
def test_calculix_reproduces_the_stress_of_the_incompressible_law(tmp_path: Path, row) -> None:
    if "calculix" in row.refused:
        pytest.skip("has no such law")
    chosen = card_of(row.law, row.silicone, ratio=1e4)
    expected = 1e-6 * engineering_stress(chosen.law, chosen.parameters, STRETCHES - 1)
    ratio = calculix_reactions(tmp_path, chosen) / expected
    print(row.law.name, ratio)
    assert ratio == pytest.approx(1, abs=1e-3)


@NEEDS_CCX
def test_calculix_uses_the_volume_term_that_the_card_contains(tmp_path: Path, row) -> None:
    if "calculix" in row.refused:
        pytest.skip("has no such law")
    chosen = card_of(row.law, row.silicone, ratio=20.0)
    expected = [1e-6 * compressible_force(chosen, row.volume_pressure, stretch) for stretch in STRETCHES]
    ratio = calculix_reactions(tmp_path, chosen) / expected
    print(row.law.name, ratio)
    assert ratio == pytest.approx(1, abs=1e-3)


def compressible_force(chosen: Material, pressure: Callable[[float, float], float], stretch: float) -> float:
    # Return the engineering stress (Pa) of a compressible material in uniaxial tension.
    # pressure : function from bulk modulus (Pa) and volume ratio J to dU/dJ, with the volume energy U (Pa)
    def kirchhoff(side: float) -> np.ndarray:
        stretches = np.array([stretch, side, side])
        J = stretches.prod()
        _, gradient, _ = chosen.law.principal(chosen.parameters, stretches * J ** (-1 / 3))
        return gradient - gradient.mean() + J * pressure(chosen.bulk_modulus_Pa, J)

    side = optimize.brentq(lambda trial: kirchhoff(trial)[1], 0.9 * stretch**-0.5, 1.1 * stretch**-0.5, xtol=1e-14)
    return float(kirchhoff(side)[0] / stretch)


def test_a_card_for_abaqus_has_the_constants_of_its_manual() -> None:
    mu, c = 46e-3, 2 / (2000 * 46e-3)
    assert keyword_constants(material_card("abaqus", material("neo-hookean"))) == pytest.approx([mu / 2, c])
    card = material_card("abaqus", material("ogden"))
    # Abaqus writes W = sum 2 mu_i/alpha_i^2 (...), so the initial shear modulus is the sum of mu_i.
    values = keyword_constants(card)
    assert "*HYPERELASTIC, OGDEN, N=3" in card
    assert values[:6] == pytest.approx([17e-3, 1.7, 0.75e-3, 5.0, 6e-3, -2.0])
    assert values[6:] == pytest.approx([2 / (2000 * 23.75e-3), 0, 0])
    assert max(len(line) for line in card.splitlines()) <= 256
    yeoh = keyword_constants(material_card("abaqus", material("yeoh")))
    assert yeoh == pytest.approx([19.5e-3, 3e-3, 0.4e-3, 2 / (2000 * 39e-3), 0, 0])


def test_a_card_for_ansys_has_the_constants_of_its_manual() -> None:
    card = material_card("ansys", material("ogden"))
    rows = [line.split(",") for line in card.splitlines() if line.startswith("TBDATA")]
    assert [row[1] for row in rows] == ["1", "7"]
    assert [float(x) for x in rows[0][2:]] == pytest.approx([20e-3, 1.7, 0.3e-3, 5.0, -6e-3, -2.0])
    assert float(rows[1][2]) == pytest.approx(2 / (2000 * 23.75e-3))
    assert "TB,HYPER,1,1,3,OGDEN" in card


def test_the_table_for_comsol_has_three_columns_and_units() -> None:
    rows = [shlex.split(line) for line in material_card("comsol", material("yeoh")).splitlines()]
    assert {len(row) for row in rows} == {3}
    values = {name: value for name, value, _ in rows}
    assert values["c2"] == "3000[Pa]"
    assert values["kappa"] == "78000000[Pa]"


def test_the_yeoh_card_for_febio_contains_the_energy() -> None:
    element = ET.fromstring(material_card("febio", material("yeoh")))
    assert element.get("type") == "uncoupled hyperelastic"
    assert (element.findtext("pressure_model"), element.findtext("k")) == ("2", "78")
    energy = (element.findtext("W") or "").replace("^", "**")
    for first in (3.01, 4.0, 6.5):
        x = first - 3
        assert eval(energy, {"I1": first}) == pytest.approx(19.5e-3 * x + 3e-3 * x**2 + 0.4e-3 * x**3)


def test_the_ogden_card_for_febio_has_the_constants_of_its_manual() -> None:
    element = ET.fromstring(material_card("febio", material("ogden")))
    constants = [float(element.findtext(tag) or "nan") for tag in ("c1", "m1", "c2", "m2", "c3", "m3")]
    assert constants == pytest.approx([34e-3, 1.7, 1.5e-3, 5.0, 12e-3, -2.0])


def test_a_card_for_sofa_has_the_constants_of_its_source_or_is_refused() -> None:
    def parameters(chosen: Material) -> list[float]:
        return [float(x) for x in (ET.fromstring(material_card("sofa", chosen)).get("ParameterSet") or "").split()]

    assert parameters(material("neo-hookean")) == pytest.approx([46e-3, 92 - 2 / 3 * 46e-3])
    assert parameters(material("mooney-rivlin")) == pytest.approx([20e-3, 4e-3, 96])
    one_term = material("ogden", [20e3, 1.7, 0.0, 5.0, -0.0, -2.0])
    assert parameters(one_term) == pytest.approx([34e-3, 1.7, 34])
    for constant in ("mu = mu1", "alpha = alpha1", "kappa = k0"):
        assert constant in material_card("sofa", one_term).partition("OgdenMaterial with ")[2]
    with pytest.raises(NotInSolver, match="sofa has an ogden law with one term only, but this law has 3"):
        material_card("sofa", material("ogden"))
    with pytest.raises(NotInSolver, match="sofa has no yeoh law"):
        material_card("sofa", material("yeoh"))


def test_a_card_for_sofa_names_the_versions_for_which_it_is_valid() -> None:
    # SOFA v25.12 changed the order of the Ogden constants; versions after v26.06 have HyperelasticityFEMForceField.
    one_term = material("ogden", [20e3, 1.7, 0.0, 5.0, -0.0, -2.0])
    for chosen, component in (
        (material("neo-hookean"), "NeoHookeanMaterial"),
        (material("mooney-rivlin"), "MooneyRivlinMaterial"),
        (one_term, "OgdenMaterial"),
    ):
        card = material_card("sofa", chosen)
        assert "up to v26.06" in card
        assert f"the component beside HyperelasticityFEMForceField is {component} with " in card
        assert ("needs SOFA v25.12 or later" in card) == (chosen is one_term)


def test_the_young_modulus_for_sofa_gives_the_constants_of_the_card() -> None:
    # Lamé constants: mu = E/2/(1 + nu) and lambda = E nu/(1 + nu)/(1 - 2 nu).
    card = material_card("sofa", material("neo-hookean"))
    mu, lame = (float(x) for x in (ET.fromstring(card).get("ParameterSet") or "").split())
    young, poisson = (float(x) for x in re.findall(r"(?:youngModulus|poissonRatio) = ([0-9.e-]+)", card))
    assert young / 2 / (1 + poisson) == pytest.approx(mu, rel=1e-8)
    assert young * poisson / (1 + poisson) / (1 - 2 * poisson) == pytest.approx(lame, rel=1e-5)


@pytest.mark.parametrize("solver", SOLVERS)
@settings(max_examples=25)
@given(mu=st.floats(1e2, 1e7), ratio=st.floats(2, 1e5))
def test_every_card_names_its_law_and_units_and_keeps_nine_digits(solver: str, mu: float, ratio: float) -> None:
    chosen = Material(LAWS["neo-hookean"], np.array([mu]), ratio * mu, "S", ("from a -- b", "line\nbreak"))
    card = material_card(solver, chosen)
    for words in ("neo-hookean", "mu/2 (I1 - 3)", "units: ", "bulk modulus", "chosen for this card", "line break"):
        assert words in card
    if solver in ("febio", "sofa"):
        ET.fromstring(card)
    numbers_in_card = [float(x) for x in re.findall(r"(?<![\w.])[0-9]+(?:\.[0-9]+)?(?:e[-+]?[0-9]+)?", card)]
    assert min(abs(np.array(numbers_in_card) / (mu * 1e-6) - 1)) < 1e-9


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_program_gets_the_complete_law_or_the_refusal_names_the_program(solver: str, row) -> None:
    chosen = card_of(row.law, row.silicone)
    if solver in row.refused:
        with pytest.raises(NotInSolver, match=solver):
            material_card(solver, chosen)
        return
    card = material_card(solver, chosen)
    assert f"identified as {row.law.formula}" in card
    if solver in ("febio", "sofa"):
        ET.fromstring(card)
    if solver == "febio" and (energy := ET.fromstring(card).findtext("W")):
        first = 4.5
        stretch = optimize.brentq(lambda x: x**2 + 2 / x - first, 1.0, 3.0)
        expected, _, _ = row.law.principal(chosen.parameters, np.array([stretch, stretch**-0.5, stretch**-0.5]))
        assert eval(energy.replace("^", "**"), {"I1": first}) == pytest.approx(1e-6 * expected, rel=1e-8)


def test_a_program_unknown_to_the_law_is_refused(row) -> None:
    with pytest.raises(NotInSolver, match=re.escape(f"the {row.law.name} law cannot be exported to elmer")):
        row.law.card("elmer", dict(zip(row.law.parameter_names, row.silicone, strict=True)), 1e8)


@pytest.mark.parametrize("parameters", [[-1e4], [0.0]])
def test_a_law_without_stiffness_is_refused(parameters: list[float]) -> None:
    chosen = Material(LAWS["neo-hookean"], np.array(parameters), 1e8, "S", ())
    with pytest.raises(NotInSolver, match="initial shear modulus is"):
        material_card("abaqus", chosen)


def test_a_bulk_modulus_below_two_thirds_of_the_shear_modulus_is_refused() -> None:
    with pytest.raises(ValueError, match="should be above two thirds"):
        material_card("ansys", material("yeoh", ratio=0.6))


@pytest.mark.parametrize(
    ("solver", "lines"),
    [
        ("abaqus", ["*HYPERELASTIC, NEO HOOKE, MODULI=INSTANTANEOUS", "*VISCOELASTIC, TIME=PRONY", "0.2, 0., 1.5"]),
        ("ansys", ["TB,PRONY,1,1,1,SHEAR", "TBDATA,1,0.2,1.5"]),
        ("febio", ['type="uncoupled viscoelastic"', "<g1>0.25</g1>", "<t1>1.5</t1>", "<G>0.04</G>"]),
        ("calculix", ["no Prony series", "0.02, "]),
        ("comsol", ["no Prony series", "mu 40000[Pa]"]),
        ("sofa", ["no Prony series", 'ParameterSet="0.04 ']),
    ],
)
def test_a_card_contains_the_prony_series_or_says_that_the_program_has_none(solver: str, lines: list[str]) -> None:
    # Abaqus and ANSYS take instantaneous moduli; FEBio and programs without a Prony series take long-term moduli.
    series = Prony(np.array([0.2]), np.array([1.5]))
    material = Material(LAWS["neo-hookean"], np.array([50e3]), 50e6, "SILICONE", (), series)
    card = material_card(solver, material)
    for line in lines:
        assert line in card
