"""Material cards: an identified law in the words of a finite-element program.

Each program writes the same energies with other constants. The conversions from the canonical form (see
`eimi_fitting.materials`), with K the bulk modulus:

abaqus, calculix   C10 = mu/2; D1 = 2/K for (J-1)^2/D1; Ogden's W = sum 2 mu_i/alpha_i^2 (...): mu_i = mu_p alpha_p / 2
ansys              constants unchanged; d = 2/K
comsol             constants unchanged; K/2 (J-1)^2
febio              Ogden's W = sum c_i/m_i^2 (...): c_i = mu_p alpha_p; pressure_model 2 is K/2 (J-1)^2
sofa               Neo-Hookean "mu lambda" with lambda = K - 2 mu/3; one Ogden term, mu1 = mu alpha; K/2 ln(J)^2

Sources: Abaqus Analysis User's Guide, hyperelastic behavior of rubberlike materials; CalculiX CrunchiX User's Manual,
*HYPERELASTIC; ANSYS Material Reference, TB,HYPER; COMSOL Structural Mechanics Module User's Guide, hyperelastic
materials; FEBio User's Manual, uncoupled materials; SOFA, TetrahedronHyperelasticityFEMForceField.

What a program lacks is refused; no term is ever dropped. Moduli are in MPa (lengths in mm, forces in N) except in
COMSOL's card, where each value carries its own unit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.materials import Law

Array = NDArray[np.float64]


class NotInSolver(Exception):
    """The program has no such law, or not in full."""


@dataclass(frozen=True)
class Material:
    """What a card is made of: parameters (n,) in Pa and 1 in the law's order; bulk_modulus_Pa is the user's choice.

    name: letters, digits, `_` and `-`; origin: lines on where the numbers came from and the strains they hold for.
    """

    law: Law
    parameters: Array
    bulk_modulus_Pa: float
    name: str
    origin: tuple[str, ...]

    def named_MPa(self) -> dict[str, float]:
        """Parameters by name, moduli in MPa."""
        return {
            name: float(value) * (1e-6 if unit == "Pa" else 1.0) + 0.0  # no negative zeros
            for name, unit, value in zip(self.law.parameter_names, self.law.units, self.parameters, strict=True)
        }

    def terms_MPa(self) -> list[tuple[float, float]]:
        """Ogden's terms (mu_p in MPa, alpha_p)."""
        values = list(self.named_MPa().values())
        return list(zip(values[0::2], values[1::2], strict=True))


_CONVENTIONS = {
    "neo-hookean": "W = mu/2 (I1 - 3)",
    "mooney-rivlin": "W = C10 (I1 - 3) + C01 (I2 - 3)",
    "yeoh": "W = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3",
    "ogden": "W = sum of mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3), p = 1..3",
}


def material_card(solver: str, material: Material) -> str:
    """The text of a card for one of SOLVERS.

    Raises NotInSolver, KeyError for an unknown solver, and ValueError where the bulk modulus is not above two thirds of
    the initial shear modulus (Poisson's ratio would be below zero).
    """
    modulus = float(material.law.initial_shear_modulus(material.parameters))
    if not modulus > 0:
        raise NotInSolver(f"its initial shear modulus is {modulus:.4g} Pa: no program can use such a law")
    if not material.bulk_modulus_Pa > 2 * modulus / 3:
        raise ValueError(
            f"a bulk modulus of {material.bulk_modulus_Pa:.4g} Pa should be above two thirds of the initial shear "
            f"modulus, {2 * modulus / 3:.4g} Pa; silicones have 1000 times that modulus and more"
        )
    return SOLVERS[solver](material)


def _notes(material: Material, units: str, volume: str, *more: str) -> list[str]:
    """What every card says, in lines for its comments."""
    modulus = float(material.law.initial_shear_modulus(material.parameters))
    values = ", ".join(f"{name} = {_number(value)}" for name, value in material.named_MPa().items())
    notes = [
        f"{material.name}: {material.law.name}",
        f"identified as {_CONVENTIONS[material.law.name]}, isochoric invariants and stretches",
        f"with, moduli in MPa, {values}",
        f"initial shear modulus {_number(1e-6 * modulus)} MPa",
        f"bulk modulus {_number(1e-6 * material.bulk_modulus_Pa)} MPa, {material.bulk_modulus_Pa / modulus:.4g} times "
        "that: chosen for this card, not identified",
        f"volume term {volume}",
        f"units: {units}",
        *material.origin,
        *more,
    ]
    return [" ".join(note.split()) for note in notes]  # each is one line of a comment


_MPA = "mm, N, MPa, tonne, s"


def _number(value: float) -> str:
    """Ten significant digits in plain or scientific notation."""
    return f"{value:.10g}"


def _plain(value: float) -> str:
    """Ten significant digits without an exponent, for a formula in a card."""
    return np.format_float_positional(value, precision=10, fractional=False, trim="0")


_ABAQUS_NAMES = {"neo-hookean": "NEO HOOKE", "mooney-rivlin": "MOONEY-RIVLIN", "yeoh": "YEOH", "ogden": "OGDEN, N=3"}


def _keyword_card(material: Material, *more: str) -> str:
    """*MATERIAL with *HYPERELASTIC, eight values a line, as Abaqus and CalculiX read it."""
    p, d = material.named_MPa(), 2e6 / material.bulk_modulus_Pa
    match material.law.name:
        case "neo-hookean":
            values = [p["mu"] / 2, d]
        case "mooney-rivlin":
            values = [p["C10"], p["C01"], d]
        case "yeoh":
            values = [p["C10"], p["C20"], p["C30"], d, 0.0, 0.0]
        case _:
            values = [x for mu, alpha in material.terms_MPa() for x in (mu * alpha / 2, alpha)] + [d, 0.0, 0.0]
    convention = {
        "neo-hookean": "card: C10 = mu/2, D1",
        "mooney-rivlin": "card: C10, C01, D1",
        "yeoh": "card: C10, C20, C30, D1, D2, D3",
        "ogden": "card: W = sum 2 mu_i/alpha_i^2 (...), mu_i = mu_p alpha_p / 2; mu1, alpha1, ..., D1, D2, D3",
    }[material.law.name]
    lines = [f"** {note}" for note in _notes(material, _MPA, "(J - 1)^2/D1, D1 = 2/K", convention, *more)]
    lines += [f"*MATERIAL, NAME={material.name}", f"*HYPERELASTIC, {_ABAQUS_NAMES[material.law.name]}"]
    rows = [values[i : i + 8] for i in range(0, len(values), 8)]
    return "\n".join(lines + [", ".join(_number(v) for v in row) for row in rows]) + "\n"


def _abaqus(material: Material) -> str:
    return _keyword_card(material, "use hybrid elements (C3D8H, C3D20RH)")


def _calculix(material: Material) -> str:
    return _keyword_card(material, "cards of this form were checked by running CalculiX 2.20 in uniaxial tension")


def _ansys(material: Material) -> str:
    p, d = material.named_MPa(), 2e6 / material.bulk_modulus_Pa
    match material.law.name:
        case "neo-hookean":
            table, values = "TB,HYPER,1,1,2,NEO", [p["mu"], d]
        case "mooney-rivlin":
            table, values = "TB,HYPER,1,1,2,MOONEY", [p["C10"], p["C01"], d]
        case "yeoh":
            table, values = "TB,HYPER,1,1,3,YEOH", [p["C10"], p["C20"], p["C30"], d]
        case _:
            table, values = "TB,HYPER,1,1,3,OGDEN", [*p.values(), d]
    lines = [f"! {note}" for note in _notes(material, _MPA, "(J - 1)^2/d, d = 2/K")]
    lines.append(table)
    for first in range(0, len(values), 6):  # TBDATA takes six constants
        lines.append(f"TBDATA,{first + 1}," + ",".join(_number(v) for v in values[first : first + 6]))
    return "\n".join(lines) + "\n"


_COMSOL_NAMES = {"C10": "c1", "C20": "c2", "C30": "c3"}  # of the Yeoh node


def _comsol(material: Material) -> str:
    """A table for Parameters, Load from File: name, expression, description. What it says of itself is a row too."""
    yeoh = material.law.name == "yeoh"
    rows = [
        (_COMSOL_NAMES[name] if yeoh else name, f"{_number(value + 0.0)}{'[Pa]' if unit == 'Pa' else ''}", name)
        for name, unit, value in zip(
            material.law.parameter_names, material.law.units, map(float, material.parameters), strict=True
        )
    ]
    rows.append(
        ("kappa", f"{_number(material.bulk_modulus_Pa)}[Pa]", "bulk modulus, nearly incompressible formulation")
    )
    notes = _notes(material, "with each value", "kappa/2 (J - 1)^2, the quadratic one")
    rows.append(("eimi_origin", "1", ". ".join(notes).replace('"', "'")))
    return "".join(f'{name} {value} "{words}"\n' for name, value, words in rows)


def _comment(notes: Sequence[str]) -> str:
    # Two hyphens would end an XML comment.
    return "<!--\n" + "\n".join(f"  {note.replace('--', '- -')}" for note in notes) + "\n-->\n"


def _febio(material: Material) -> str:
    p = material.named_MPa()
    more = ["for FEBio 4, uncoupled materials"]
    match material.law.name:
        case "neo-hookean":
            kind, tags = "incomp neo-Hookean", {"G": _number(p["mu"])}
        case "mooney-rivlin":
            kind, tags = "Mooney-Rivlin", {"c1": _number(p["C10"]), "c2": _number(p["C01"])}
        case "yeoh":
            # FEBio's own Yeoh material leaves the factor i out of the stress of c_i (I1 - 3)^i.
            kind = "uncoupled hyperelastic"
            powers = (f"({_plain(p[name])})*(I1-3)^{i}" for i, name in enumerate(("C10", "C20", "C30"), 1))
            tags = {"W": " + ".join(powers)}
            more.append(
                "as an energy expression: the stress of FEBio's own Yeoh material is not the derivative of its energy"
            )
        case _:
            kind = "Ogden"
            tags = {}
            for i, (mu, alpha) in enumerate(material.terms_MPa(), 1):
                tags |= {f"c{i}": _number(mu * alpha), f"m{i}": _number(alpha)}
            more.append("card: W = sum c_i/m_i^2 (...), c_i = mu_p alpha_p")
    tags |= {"k": _number(1e-6 * material.bulk_modulus_Pa), "pressure_model": "2"}
    lines = [f"  <{tag}>{value}</{tag}>" for tag, value in tags.items()]
    head = f'<material id="1" name={quoteattr(material.name)} type="{kind}">'
    notes = _notes(material, _MPA, "k/2 (J - 1)^2, which is pressure_model 2", *more)
    return _comment(notes) + "\n".join([head, *lines, "</material>"]) + "\n"


def _sofa(material: Material) -> str:
    p, bulk = material.named_MPa(), 1e-6 * material.bulk_modulus_Pa
    volume, more = "k0/2 ln(J)^2", []
    match material.law.name:
        case "neo-hookean":
            kind, values = "NeoHookean", [p["mu"], bulk - 2 * p["mu"] / 3]
            volume = "-mu ln(J) + lambda/2 ln(J)^2, lambda = K - 2 mu/3"
            more = ["I1 is not isochoric in this law of SOFA: the same where J is 1"]
        case "mooney-rivlin":
            kind, values = "MooneyRivlin", [p["C10"], p["C01"], bulk]
        case "yeoh":
            raise NotInSolver("sofa has no yeoh law; neo-hookean, mooney-rivlin and one-term ogden are there")
        case _:
            there = [(mu, alpha) for mu, alpha in material.terms_MPa() if mu != 0]
            if len(there) != 1:
                raise NotInSolver(f"sofa has one ogden term, and this law {len(there)}: none can be left out")
            (mu, alpha) = there[0]
            kind, values = "Ogden", [mu * alpha, alpha, bulk]
            more = ["card: W = mu1/alpha1^2 (...), mu1 = mu_p alpha_p"]
    parameters = " ".join(_number(v) for v in values)
    field = f'<TetrahedronHyperelasticityFEMForceField name={quoteattr(material.name)} materialName="{kind}"'
    return _comment(_notes(material, _MPA, volume, *more)) + f'{field} ParameterSet="{parameters}"/>\n'


SOLVERS: dict[str, Callable[[Material], str]] = {
    "abaqus": _abaqus,
    "calculix": _calculix,
    "ansys": _ansys,
    "comsol": _comsol,
    "febio": _febio,
    "sofa": _sofa,
}
