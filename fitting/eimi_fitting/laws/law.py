"""The interface of a hyperelastic law, and the values that pass through it.

The energy of an isotropic law in a planar deformation depends on two numbers only: a = F:F and J = det F, where F is
the in-plane deformation gradient. A planar element therefore needs psi(a, J) and its five first and second
derivatives. There are two sections:

plane strain   The third principal stretch is 1. The isochoric invariants are I1 = J^(-2/3) (a + 1) and
               I2 = J^(-4/3) (a + J^2). The element adds the volume term, with the pressure as an unknown.
plane stress   The material is incompressible and the third principal stretch is 1/J, so I1 = a + J^-2 and
               I2 = J^2 + a J^-2. No pressure is needed.

Stability, tensile tests and three-dimensional elements use the energy as a function of the principal stretches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Section = Literal["plane-strain", "plane-stress"]

SHEAR_MODULUS_PA = (1e3, 1e6)  # wider than the range of casting silicones; a search narrows these bounds to its data


class PlanarEnergy(NamedTuple):
    """The planar energy density psi(a, J) and its derivatives.

    Parameters
    ----------
    value
        psi, in the unit of the moduli. All six arrays have the shape of ``a``.
    a, J
        First derivatives, d psi/d a and d psi/d J.
    aa, aJ, JJ
        Second derivatives.
    """

    value: Array
    a: Array
    J: Array
    aa: Array
    aJ: Array
    JJ: Array


@dataclass(frozen=True)
class Coordinate:
    """One coordinate of a search.

    Parameters
    ----------
    name
        Name for messages and reports.
    lower, upper
        Bounds of the search. They are this project's own choice unless a source is cited.
    """

    name: str
    lower: float
    upper: float


@dataclass(frozen=True)
class StressFit:
    """Result of a least-squares fit to a tensile curve of m rows.

    Parameters
    ----------
    parameters
        (n,) fitted parameters, moduli in the unit of the stress.
    intervals
        (n, 2) lower and upper ends of the 95 % intervals.
    held_by_bounds
        (n,) True where the bounds of the search, and not the data, limit the parameter.
    modulus_half_width
        Half the width of the 95 % interval of the initial shear modulus, in the unit of the stress.
    correlation_rows
        tau, the number of correlated rows that carry as much information as one independent row.
    correlation
        (n, n) correlation matrix of the parameters' errors.
    """

    parameters: Array
    intervals: Array
    held_by_bounds: Sequence[bool]
    modulus_half_width: float
    correlation_rows: float
    correlation: Array


@dataclass(frozen=True)
class CardConstants:
    """A law's constants as one finite-element program defines them; `laws.cards` writes them into a card.

    Parameters
    ----------
    keyword
        The program's name of the law.
    constants
        Value of each constant by name, in the program's order. A string is an expression.
    dimensionless
        Names of the constants that are not moduli.
    meaning
        Description of each constant whose name does not explain it.
    volume
        The volumetric energy as a formula; None if it is the usual one of the program.
    notes
        Lines that the reader of the card must know.
    """

    keyword: str
    constants: Mapping[str, float | str]
    dimensionless: Sequence[str] = ()
    meaning: Mapping[str, str] = field(default_factory=dict)
    volume: str | None = None
    notes: Sequence[str] = ()


class CannotFit(Exception):
    """The window contains too few rows, or the law cannot produce stresses of this sign."""


class NotInSolver(Exception):
    """The program does not have the law, or cannot represent it completely."""


class Law(Protocol):
    """A hyperelastic law with n parameters.

    Parameters are arrays of shape (..., n) whose leading axes broadcast against the states. Moduli may have any unit of
    stress, the same one for all; energies then have that unit. A law that is a function of the invariants can inherit
    everything except its energy from `laws.invariants.InvariantLaw`.

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
        """The name used on the command line."""

    @property
    def formula(self) -> str:
        """The strain energy as one line of text."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The parameters' names, in the order of the parameter arrays."""

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each parameter: ``"Pa"`` or ``"1"``."""

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates of a search: the initial shear modulus (Pa), then dimensionless numbers.

        The search moves the logarithm of the initial shear modulus, and the other coordinates linearly.
        """

    def from_coordinates(self, x: Array) -> Array:
        """Convert coordinates of the search into parameters.

        Parameters
        ----------
        x
            (P, m) coordinates of P candidates, in the order of `coordinates`.

        Returns
        -------
        Array
            (P, n) parameters. Every modulus is proportional to the first coordinate.
        """

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the shear modulus at zero strain.

        Parameters
        ----------
        parameters
            (..., n) parameters.

        Returns
        -------
        Array
            (...) shear moduli, in the unit of the parameters' moduli.
        """

    def planar(self, parameters: Array, a: Array, J: Array, section: Section) -> PlanarEnergy:
        """Return the energy density of planar states and its derivatives.

        Parameters
        ----------
        parameters
            (..., n) parameters.
        a, J
            (...) F:F and det F of the in-plane deformation gradient F.
        section
            Plane strain or plane stress.

        Returns
        -------
        PlanarEnergy
            psi(a, J) with its first and second derivatives.
        """

    def principal(self, parameters: Array, stretches: Array) -> tuple[Array, Array, Array]:
        """Return the energy of isochoric states and its derivatives in the logarithms of the principal stretches.

        Parameters
        ----------
        parameters
            (..., n) parameters.
        stretches
            (..., 3) isochoric principal stretches; their product is 1.

        Returns
        -------
        energy, gradient, hessian
            Arrays of shape (...), (..., 3) and (..., 3, 3).
        """

    def drucker_limit(self, parameters: Array, largest_stretch: Array) -> Array:
        """Return the largest stretch up to which each candidate is stable; `laws.stability` defines stability.

        Parameters
        ----------
        parameters
            (P, n) parameters of P candidates.
        largest_stretch
            (P,) stretches, at least 1. Larger stretches need not be examined.

        Returns
        -------
        Array
            (P,) limits: 0 if the candidate is unstable already at rest, any number above ``largest_stretch`` if no
            limit was met up to it.
        """

    def fit_stress(self, strain: Array, stress: Array, weight: Array) -> StressFit:
        """Fit the law to a uniaxial tensile curve by weighted least squares.

        Parameters
        ----------
        strain, stress
            (m,) engineering strains and engineering stresses.
        weight
            (m,) factors of the residuals.

        Raises
        ------
        CannotFit
            If the law cannot produce such stresses.
        """

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """Return the constants of the law in a finite-element program.

        Parameters
        ----------
        solver
            Name of the program, usually one of `laws.cards.SOLVERS`.
        p
            Parameters by name.
        bulk
            Bulk modulus, in the unit of the moduli in ``p``.

        Raises
        ------
        NotInSolver
            If the program lacks the law, or if this law does not know the program.
        """
