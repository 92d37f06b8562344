"""Material cards: an identified law in the input format of a finite-element program, with moduli in MPa.

With the determinant J of the deformation gradient and the bulk modulus K, the volumetric energies are:

    abaqus, calculix   (J-1)^2/D1, D1 = 2/K
    ansys              (J-1)^2/d, d = 2/K
    comsol, febio      K/2 (J-1)^2
    sofa               K/2 ln(J)^2

Sources: Abaqus Analysis User's Guide, hyperelastic behavior of rubberlike materials; CalculiX CrunchiX User's Manual,
*HYPERELASTIC; ANSYS Material Reference, TB,HYPER; COMSOL Structural Mechanics Module User's Guide, hyperelastic
materials; FEBio User's Manual, uncoupled materials; SOFA v26.06, TetrahedronHyperelasticityFEMForceField.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from html import escape

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.law import CardConstants, Law, NotInSolver
from eimi_fitting.laws.prony import Prony
from eimi_fitting.units import MPA_PER_PA, moduli_in_MPa

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Material:
    """An identified material, with all values that a material card needs.

    Parameters
    ----------
    law
        Hyperelastic law.
    parameters
        (n,) parameters in the order of the law; moduli in Pa.
    bulk_modulus_Pa
        Bulk modulus in Pa.
    name
        Name of the material in the program: letters, digits, ``_`` and ``-``.
    origin
        Comments on the origin of the parameters.
    relaxation
        Prony series; the moduli in ``parameters`` are then instantaneous. None for a material that does not relax.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> Material(LAWS["neo-hookean"], np.array([46e3]), 92e6, "SILICONE", ()).named_MPa()
    {'mu': 0.046}
    """

    law: Law
    parameters: Array
    bulk_modulus_Pa: float
    name: str
    origin: tuple[str, ...]
    relaxation: Prony | None = None

    @property
    def long_term(self) -> Material:
        """The same material with long-term moduli; unchanged without a Prony series."""
        if self.relaxation is None:
            return self
        is_modulus = np.array([unit == "Pa" for unit in self.law.units])
        scaled = np.where(is_modulus, float(self.relaxation.long_term) * self.parameters, self.parameters)
        return replace(self, parameters=scaled)

    def named_Pa(self) -> dict[str, float]:
        """Return the parameters of the law by name; moduli in Pa."""
        return self._named(self.parameters)

    def named_MPa(self) -> dict[str, float]:
        """Return the parameters of the law by name; moduli in MPa."""
        return self._named(moduli_in_MPa(self.parameters, self.law.units))

    def _named(self, parameters: Array) -> dict[str, float]:
        # Adding zero turns a negative zero into a positive one.
        return {name: float(x) + 0.0 for name, x in zip(self.law.parameter_names, parameters, strict=True)}

    def constants_for(self, solver: str) -> CardConstants:
        """Return the constants of the law in a finite-element program, in MPa.

        Raises
        ------
        NotInSolver
            If the program does not have the law.
        """
        return self.law.card(solver, self.named_MPa(), MPA_PER_PA * self.bulk_modulus_Pa)


def material_card(solver: str, material: Material) -> str:
    """Return the text of a material card (the input of a finite-element program).

    Parameters
    ----------
    solver
        One of `SOLVERS`: abaqus, calculix, ansys, comsol, febio or sofa.
    material
        Law, parameters and bulk modulus.

    Returns
    -------
    str
        Text of the card, with moduli in MPa.

    Raises
    ------
    NotInSolver
        If the program cannot represent the law, or if the law has no stiffness at rest.
    KeyError
        If the solver is unknown.
    ValueError
        If the bulk modulus is at most two thirds of the initial shear modulus.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> silicone = Material(LAWS["neo-hookean"], np.array([46e3]), 92e6, "SILICONE", ("fitted to bending",))
    >>> print(material_card("abaqus", silicone).partition("*")[2].splitlines()[-1])
    0.023, 0.02173913043
    """
    modulus = float(material.law.initial_shear_modulus(material.parameters))
    if not modulus > 0:
        raise NotInSolver(
            f"the initial shear modulus is {modulus:.4g} Pa, but a finite-element program needs a positive value"
        )
    if not material.bulk_modulus_Pa > 2 * modulus / 3:
        raise ValueError(
            f"the bulk modulus is {material.bulk_modulus_Pa:.4g} Pa, but should be above two thirds of the initial "
            f"shear modulus, {2 * modulus / 3:.4g} Pa; for silicones it is 1000 times the initial shear modulus or more"
        )
    return SOLVERS[solver](material)


def plain_number(value: float) -> str:
    """Format a number with ten significant digits and without an exponent, for a formula in a card."""
    return np.format_float_positional(value, precision=10, fractional=False, trim="0")


def _number(value: float | str) -> str:
    """Format a number with ten significant digits. An expression is returned unchanged."""
    return value if isinstance(value, str) else f"{value:.10g}"


def _notes(material: Material, units: str, volume: str, *more: str) -> list[str]:
    """Return the lines of comments that every card has: the material, its law, its moduli and its units."""
    modulus = float(material.law.initial_shear_modulus(material.parameters))
    values = ", ".join(f"{name} = {_number(value)}" for name, value in material.named_MPa().items())
    notes = [
        f"{material.name}: {material.law.name}",
        f"identified as {material.law.formula}, with isochoric invariants and stretches",
        f"parameters, moduli in MPa: {values}",
        f"initial shear modulus {_number(MPA_PER_PA * modulus)} MPa",
        f"bulk modulus {_number(MPA_PER_PA * material.bulk_modulus_Pa)} MPa, {material.bulk_modulus_Pa / modulus:.4g} "
        "times the initial shear modulus: chosen for this card, not identified",
        f"volume term {volume}",
        f"units: {units}",
        *material.origin,
        *more,
    ]
    return [" ".join(note.split()) for note in notes]  # a line break would end the comment


_MPA = "mm, N, MPa, tonne, s"


def _rows(constants: CardConstants, length: int) -> list[list[str]]:
    values = [_number(value) for value in constants.constants.values()]
    return [values[i : i + length] for i in range(0, len(values), length)]


_INSTANTANEOUS = "the moduli are instantaneous moduli; the Prony series relaxes the deviatoric stress"
_WITHOUT_TIME = "this program has no Prony series for a hyperelastic material; the moduli are long-term moduli"


def _keyword_card(solver: str, material: Material, advice: str, moduli: str = "", more: Sequence[str] = ()) -> str:
    """Return a card for Abaqus or CalculiX, with the keywords *MATERIAL and *HYPERELASTIC.

    ``advice`` is a comment, ``moduli`` an option of *HYPERELASTIC, and ``more`` are the last lines of the card.
    """
    constants = material.constants_for(solver)
    volume = constants.volume or "(J - 1)^2/D1, D1 = 2/K"
    lines = [f"** {note}" for note in _notes(material, _MPA, volume, *constants.notes, advice)]
    lines += [f"*MATERIAL, NAME={material.name}", f"*HYPERELASTIC, {constants.keyword}{moduli}"]
    return "\n".join([*lines, *(", ".join(row) for row in _rows(constants, 8)), *more]) + "\n"


def _terms(series: Prony) -> list[tuple[str, str]]:
    """Return the relative modulus g and the relaxation time tau (s) of each term of a Prony series, as text."""
    return [(_number(float(g)), _number(float(tau))) for g, tau in zip(series.g, series.tau_s, strict=True)]


def _abaqus(material: Material) -> str:
    advice = "use hybrid elements (C3D8H, C3D20RH)"
    if material.relaxation is None:
        return _keyword_card("abaqus", material, advice)
    rows = [f"{g}, 0., {tau}" for g, tau in _terms(material.relaxation)]
    series = ["*VISCOELASTIC, TIME=PRONY", *rows]
    return _keyword_card("abaqus", material, f"{_INSTANTANEOUS}; {advice}", ", MODULI=INSTANTANEOUS", series)


def _calculix(material: Material) -> str:
    advice = "cards of this form were checked by running CalculiX 2.20 in uniaxial tension"
    if material.relaxation is not None:
        advice = f"{_WITHOUT_TIME}; {advice}"
    return _keyword_card("calculix", material.long_term, advice)


def _ansys(material: Material) -> str:
    """Return a card for ANSYS: the TB command of the law, and TBDATA commands with six constants each."""
    constants = material.constants_for("ansys")
    volume = constants.volume or "(J - 1)^2/d, d = 2/K"
    time = [] if material.relaxation is None else [_INSTANTANEOUS]
    lines = [f"! {note}" for note in _notes(material, _MPA, volume, *constants.notes, *time)]
    lines.append(constants.keyword)
    lines += [f"TBDATA,{6 * i + 1},{','.join(row)}" for i, row in enumerate(_rows(constants, 6))]
    if material.relaxation is not None:
        pairs = [value for term in _terms(material.relaxation) for value in term]
        lines.append(f"TB,PRONY,1,1,{len(pairs) // 2},SHEAR")
        lines += [f"TBDATA,{i + 1},{','.join(pairs[i : i + 6])}" for i in range(0, len(pairs), 6)]
    return "\n".join(lines) + "\n"


def _comsol(material: Material) -> str:
    """Return a table of parameters for COMSOL: name, expression and description."""
    time = [] if material.relaxation is None else [_WITHOUT_TIME.replace("this program", "this card for COMSOL")]
    material = material.long_term
    constants = material.law.card("comsol", material.named_Pa(), material.bulk_modulus_Pa)
    rows = [
        (name, _number(value) + ("" if name in constants.dimensionless else "[Pa]"), constants.meaning.get(name, name))
        for name, value in constants.constants.items()
    ]
    rows.append(
        ("kappa", f"{_number(material.bulk_modulus_Pa)}[Pa]", "bulk modulus, nearly incompressible formulation")
    )
    volume = constants.volume or "kappa/2 (J - 1)^2, called quadratic in COMSOL"
    notes = _notes(material, "with each value", volume, *constants.notes, *time)
    rows.append(("eimi_origin", "1", ". ".join(notes).replace('"', "'")))
    return "".join(f'{name} {value} "{description}"\n' for name, value, description in rows)


def _comment(notes: Sequence[str]) -> str:
    # An XML comment must not contain two hyphens in a row.
    return "<!--\n" + "\n".join(f"  {note.replace('--', '- -')}" for note in notes) + "\n-->\n"


def _febio(material: Material) -> str:
    """Return a <material> element (XML) for FEBio."""
    series, material = material.relaxation, material.long_term
    constants = material.constants_for("febio")
    tags = {**constants.constants, "k": MPA_PER_PA * material.bulk_modulus_Pa, "pressure_model": "2"}
    lines = [f"  <{tag}>{_number(value)}</{tag}>" for tag, value in tags.items()]
    head = f'<material id="1" name="{escape(material.name)}" type="{constants.keyword}">'
    volume = constants.volume or "k/2 (J - 1)^2, which is pressure_model 2"
    notes = _notes(material, _MPA, volume, "for FEBio 4, uncoupled materials", *constants.notes)
    if series is not None:
        notes.append("the elastic moduli are long-term moduli; g1, g2, ... are relative to the long-term moduli")
        shares = series.g / float(series.long_term)
        terms = list(zip(shares, series.tau_s, strict=True))
        outer = [f"  <g{i}>{_number(float(g))}</g{i}>" for i, (g, _) in enumerate(terms, 1)]
        outer += [f"  <t{i}>{_number(float(tau))}</t{i}>" for i, (_, tau) in enumerate(terms, 1)]
        volumetric = len(constants.constants)
        inner = [f"  {line}" for line in lines[:volumetric]]
        lines = [*outer, *lines[volumetric:], f'  <elastic type="{constants.keyword}">', *inner, "  </elastic>"]
        head = f'<material id="1" name="{escape(material.name)}" type="uncoupled viscoelastic">'
    return _comment(notes) + "\n".join([head, *lines, "</material>"]) + "\n"


def _sofa(material: Material) -> str:
    """Return the element TetrahedronHyperelasticityFEMForceField (XML) for SOFA."""
    time = [] if material.relaxation is None else [_WITHOUT_TIME]
    material = material.long_term
    constants = material.constants_for("sofa")
    parameters = " ".join(_number(value) for value in constants.constants.values())
    name, keyword = escape(material.name), constants.keyword
    field = f'<TetrahedronHyperelasticityFEMForceField name="{name}" materialName="{keyword}"'
    versions = (
        "TetrahedronHyperelasticityFEMForceField is the element of SOFA up to v26.06; later versions (pull request "
        "6206 of 2026) also have HyperelasticityFEMForceField, whose law is a component beside it"
    )
    notes = _notes(material, _MPA, constants.volume or "k0/2 ln(J)^2", versions, *constants.notes, *time)
    return _comment(notes) + f'{field} ParameterSet="{parameters}"/>\n'


SOLVERS: dict[str, Callable[[Material], str]] = {
    "abaqus": _abaqus,
    "calculix": _calculix,
    "ansys": _ansys,
    "comsol": _comsol,
    "febio": _febio,
    "sofa": _sofa,
}

INSTANTANEOUS = ("abaqus", "ansys")
"""The programs whose cards contain the instantaneous moduli of a material that relaxes, not its long-term moduli."""
