"""What a law is, to everything that uses one: an interface, and the values that pass through it.

A planar deformation enters an isotropic energy through two numbers only: a = F:F and J = det F of the in-plane
deformation gradient. What a planar element needs is therefore psi(a, J) with its five derivatives, for two sections:

plane strain   third stretch 1; isochoric invariants I1 = J^(-2/3) (a + 1), I2 = J^(-4/3) (a + J^2);
               the volume term is the element's (a pressure unknown).
plane stress   incompressible, third stretch 1/J: I1 = a + J^-2, I2 = J^2 + a J^-2; no pressure is left.

Stability, tensile tests and three-dimensional elements ask for the energy in principal stretches instead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Section = Literal["plane-strain", "plane-stress"]

SHEAR_MODULUS_PA = (1e3, 1e6)  # casting silicones, with room to spare; a search takes its bounds from the data


class PlanarEnergy(NamedTuple):
    """psi(a, J) and its derivatives, each an array of the shape of a."""

    value: Array
    a: Array
    J: Array
    aa: Array
    aJ: Array
    JJ: Array


@dataclass(frozen=True)
class Coordinate:
    """What a search moves, and between which bounds. Bounds are this project's own choice unless a source stands."""

    name: str
    lower: float
    upper: float


@dataclass(frozen=True)
class StressFit:
    """Least squares on a tensile curve.

    parameters: (n,); intervals: (n, 2), 95 %; held_by_bounds: (n,) whether only the search's bounds hold a parameter;
    modulus_half_width: of the interval of the initial shear modulus, Pa; correlation_rows: how many rows count as one;
    correlation: (n, n) of the parameters' errors.
    """

    parameters: Array
    intervals: Array
    held_by_bounds: Sequence[bool]
    modulus_half_width: float
    correlation_rows: float
    correlation: Array


@dataclass(frozen=True)
class CardConstants:
    """A law in the words of one program, see `laws.cards` for what each writes.

    constants: name to value, or to an expression, in the program's order; dimensionless: those that are no moduli;
    meaning: words for a constant whose name says too little; volume: the energy of a change of volume where it is not
    the program's usual one; notes: what a reader of the card must know.
    """

    keyword: str
    constants: Mapping[str, float | str]
    dimensionless: Sequence[str] = ()
    meaning: Mapping[str, str] = field(default_factory=dict)
    volume: str | None = None
    notes: Sequence[str] = ()


class CannotFit(Exception):
    """The window holds too few rows, or stresses that the law cannot have."""


class NotInSolver(Exception):
    """The program has no such law, or not in full."""


class Law(Protocol):
    """A hyperelastic law. Parameters come as (..., n) arrays whose leading axes broadcast against the states.

    Moduli may be in any one unit of stress; the energy is then in that unit too. `laws.invariants.InvariantLaw` has all
    of it but the energy for a law in the invariants.

    Examples
    --------
    >>> import numpy as np
    >>> from eimi_fitting.laws import LAWS
    >>> law = LAWS["mooney-rivlin"]
    >>> law.parameter_names
    ('C10', 'C01')
    >>> float(law.initial_shear_modulus(np.array([20e3, 4e3])))
    48000.0
    """

    @property
    def name(self) -> str:
        """As the command line has it."""

    @property
    def formula(self) -> str:
        """The energy, in a line for people."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """In the order of the parameter arrays."""

    @property
    def units(self) -> tuple[str, ...]:
        """Pa or 1, one a parameter."""

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """What a search moves: the initial shear modulus in Pa (by its logarithm), then numbers without a unit."""

    def from_coordinates(self, x: Array) -> Array:
        """Coordinates (P, m) to parameters (P, n), whose moduli are in proportion to the first coordinate."""

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """(..., n) -> (...): shear modulus at zero strain, in the unit of the moduli."""

    def planar(self, parameters: Array, a: Array, J: Array, section: Section) -> PlanarEnergy:
        """Energy density and derivatives of a planar state."""

    def principal(self, parameters: Array, stretches: Array) -> tuple[Array, Array, Array]:
        """Energy, gradient (..., 3) and Hessian (..., 3, 3) in the logarithms of the isochoric principal stretches."""

    def drucker_limit(self, parameters: Array, most: Array) -> Array:
        """(P, n) and (P,) >= 1 -> (P,): the stretch up to which a law is stable, see `laws.stability`.

        Nothing beyond ``most`` need be looked at: any larger number says that no limit was met. 0 at rest already.
        """

    def fit_stress(self, strain: Array, stress: Array, weight: Array) -> StressFit:
        """Least squares on ``weight`` times the engineering stress, all (m,). Raises CannotFit."""

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """What a card for one of `laws.cards.SOLVERS` holds; p: parameters by name, moduli in the unit of ``bulk``.

        Raises NotInSolver for a program that has no such law: also for one that this law has never heard of.
        """
