"""Material cards: an identified law in the words of a finite-element program.

Each program writes the same energies with other constants; every law converts its own (`Law.card`), from the canonical
form of its docstring, and refuses a program that lacks it: no term is ever dropped. What a program's card looks like
stands here. Volume terms, with K the bulk modulus:

abaqus, calculix   (J-1)^2/D1, D1 = 2/K
ansys              (J-1)^2/d, d = 2/K
comsol             K/2 (J-1)^2
febio              K/2 (J-1)^2, which is pressure_model 2
sofa               K/2 ln(J)^2

Sources: Abaqus Analysis User's Guide, hyperelastic behavior of rubberlike materials; CalculiX CrunchiX User's Manual,
*HYPERELASTIC; ANSYS Material Reference, TB,HYPER; COMSOL Structural Mechanics Module User's Guide, hyperelastic
materials; FEBio User's Manual, uncoupled materials; SOFA, TetrahedronHyperelasticityFEMForceField.

Moduli are in MPa (lengths in mm, forces in N) except in COMSOL's card, where each value carries its own unit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.law import CardConstants, Law, NotInSolver
from eimi_fitting.units import MPA_PER_PA, moduli_in_MPa

Array = NDArray[np.float64]


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

    def named_Pa(self) -> dict[str, float]:
        """Parameters by name, moduli in Pa."""
        return self._named(self.parameters)

    def named_MPa(self) -> dict[str, float]:
        """Parameters by name, moduli in MPa."""
        return self._named(moduli_in_MPa(self.parameters, self.law.units))

    def _named(self, parameters: Array) -> dict[str, float]:
        # Zero added: no negative zeros.
        return {name: float(x) + 0.0 for name, x in zip(self.law.parameter_names, parameters, strict=True)}

    def in_words_of(self, solver: str) -> CardConstants:
        """What a card in MPa holds. Raises NotInSolver."""
        return self.law.card(solver, self.named_MPa(), MPA_PER_PA * self.bulk_modulus_Pa)


def material_card(solver: str, material: Material) -> str:
    """The text of a material card.

    Parameters
    ----------
    solver
        One of `SOLVERS`: abaqus, calculix, ansys, comsol, febio or sofa.
    material
        The law, its parameters in Pa, the bulk modulus chosen for the card, and where the numbers came from.

    Returns
    -------
    The card, moduli in MPa (in COMSOL's each with its unit).

    Raises
    ------
    NotInSolver
        The program has no such law, or not in full, or the law has no stiffness at rest.
    KeyError
        For an unknown solver.
    ValueError
        The bulk modulus is not above two thirds of the initial shear modulus: Poisson's ratio would be below zero.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> silicone = Material(LAWS["neo-hookean"], np.array([46e3]), 92e6, "SILICONE", ("fitted to bending",))
    >>> print(material_card("abaqus", silicone).partition("*")[2].splitlines()[-1])
    0.023, 0.02173913043
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


def plain_number(value: float) -> str:
    """Ten significant digits without an exponent, for a formula in a card."""
    return np.format_float_positional(value, precision=10, fractional=False, trim="0")


def _number(value: float | str) -> str:
    """Ten significant digits in plain or scientific notation; an expression as it is."""
    return value if isinstance(value, str) else f"{value:.10g}"


def _notes(material: Material, units: str, volume: str, *more: str) -> list[str]:
    """What every card says, in lines for its comments."""
    modulus = float(material.law.initial_shear_modulus(material.parameters))
    values = ", ".join(f"{name} = {_number(value)}" for name, value in material.named_MPa().items())
    notes = [
        f"{material.name}: {material.law.name}",
        f"identified as {material.law.formula}, isochoric invariants and stretches",
        f"with, moduli in MPa, {values}",
        f"initial shear modulus {_number(MPA_PER_PA * modulus)} MPa",
        f"bulk modulus {_number(MPA_PER_PA * material.bulk_modulus_Pa)} MPa, "
        f"{material.bulk_modulus_Pa / modulus:.4g} times that: chosen for this card, not identified",
        f"volume term {volume}",
        f"units: {units}",
        *material.origin,
        *more,
    ]
    return [" ".join(note.split()) for note in notes]  # each is one line of a comment


_MPA = "mm, N, MPa, tonne, s"


def _rows(constants: CardConstants, length: int) -> list[list[str]]:
    """The values, so many a line."""
    values = [_number(value) for value in constants.constants.values()]
    return [values[i : i + length] for i in range(0, len(values), length)]


def _keyword_card(solver: str, material: Material, advice: str) -> str:
    """*MATERIAL with *HYPERELASTIC, eight values a line, as Abaqus and CalculiX read it. keyword: the law's name."""
    words = material.in_words_of(solver)
    volume = words.volume or "(J - 1)^2/D1, D1 = 2/K"
    lines = [f"** {note}" for note in _notes(material, _MPA, volume, *words.notes, advice)]
    lines += [f"*MATERIAL, NAME={material.name}", f"*HYPERELASTIC, {words.keyword}"]
    return "\n".join(lines + [", ".join(row) for row in _rows(words, 8)]) + "\n"


def _abaqus(material: Material) -> str:
    return _keyword_card("abaqus", material, "use hybrid elements (C3D8H, C3D20RH)")


def _calculix(material: Material) -> str:
    advice = "cards of this form were checked by running CalculiX 2.20 in uniaxial tension"
    return _keyword_card("calculix", material, advice)


def _ansys(material: Material) -> str:
    """keyword: the whole TB line. TBDATA takes six constants."""
    words = material.in_words_of("ansys")
    lines = [f"! {note}" for note in _notes(material, _MPA, words.volume or "(J - 1)^2/d, d = 2/K", *words.notes)]
    lines.append(words.keyword)
    lines += [f"TBDATA,{6 * i + 1},{','.join(row)}" for i, row in enumerate(_rows(words, 6))]
    return "\n".join(lines) + "\n"


def _comsol(material: Material) -> str:
    """A table for Parameters, Load from File: name, expression, description. What it says of itself is a row too."""
    words = material.law.card("comsol", material.named_Pa(), material.bulk_modulus_Pa)
    rows = [
        (name, _number(value) + ("" if name in words.dimensionless else "[Pa]"), words.meaning.get(name, name))
        for name, value in words.constants.items()
    ]
    rows.append(
        ("kappa", f"{_number(material.bulk_modulus_Pa)}[Pa]", "bulk modulus, nearly incompressible formulation")
    )
    volume = words.volume or "kappa/2 (J - 1)^2, the quadratic one"
    notes = _notes(material, "with each value", volume, *words.notes)
    rows.append(("eimi_origin", "1", ". ".join(notes).replace('"', "'")))
    return "".join(f'{name} {value} "{description}"\n' for name, value, description in rows)


def _comment(notes: Sequence[str]) -> str:
    # Two hyphens would end an XML comment.
    return "<!--\n" + "\n".join(f"  {note.replace('--', '- -')}" for note in notes) + "\n-->\n"


def _febio(material: Material) -> str:
    """keyword: the material's type; a constant is a tag."""
    words = material.in_words_of("febio")
    tags = {**words.constants, "k": MPA_PER_PA * material.bulk_modulus_Pa, "pressure_model": "2"}
    lines = [f"  <{tag}>{_number(value)}</{tag}>" for tag, value in tags.items()]
    head = f'<material id="1" name="{escape(material.name)}" type="{words.keyword}">'
    volume = words.volume or "k/2 (J - 1)^2, which is pressure_model 2"
    notes = _notes(material, _MPA, volume, "for FEBio 4, uncoupled materials", *words.notes)
    return _comment(notes) + "\n".join([head, *lines, "</material>"]) + "\n"


def _sofa(material: Material) -> str:
    """keyword: the materialName; the constants, that of the volume term too, are its ParameterSet."""
    words = material.in_words_of("sofa")
    parameters = " ".join(_number(value) for value in words.constants.values())
    field = f'<TetrahedronHyperelasticityFEMForceField name="{escape(material.name)}" materialName="{words.keyword}"'
    notes = _notes(material, _MPA, words.volume or "k0/2 ln(J)^2", *words.notes)
    return _comment(notes) + f'{field} ParameterSet="{parameters}"/>\n'


SOLVERS: dict[str, Callable[[Material], str]] = {
    "abaqus": _abaqus,
    "calculix": _calculix,
    "ansys": _ansys,
    "comsol": _comsol,
    "febio": _febio,
    "sofa": _sofa,
}
