"""The interface of a hyperelastic law, and the types of the arguments and results of its methods.

In a planar deformation, let F be the deformation gradient in the plane (2, 2), a = F : F and J = det F. The strain
energy psi of an isotropic law depends only on a and J. A planar element therefore needs psi(a, J) and the five first
and second derivatives of psi. The third principal stretch follows from the section:

plane strain   The third principal stretch is 1. The isochoric invariants are I1 = J^(-2/3) (a + 1) and
               I2 = J^(-4/3) (a + J^2). The element adds the energy of the volume, with the pressure as an unknown.
plane stress   The material is incompressible and the third principal stretch is 1/J. The invariants are
               I1 = a + J^-2 and I2 = J^2 + a J^-2. No pressure is needed.

For stability, tensile tests and solid elements, the energy is a function of the principal stretches.
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
    """The strain energy density psi(a, J) in a planar deformation, and its derivatives.

    The variables are a = F : F and J = det F, with the deformation gradient F in the plane.

    Parameters
    ----------
    value
        Strain energy density psi, in the unit of the moduli. All six arrays have the same shape.
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
    """One coordinate of the search for a law's parameters: a quantity that the search varies.

    Parameters
    ----------
    name
        Name of the coordinate in messages and reports.
    lower, upper
        Bounds of the search. The bounds were chosen in this project unless a publication is cited.
    """

    name: str
    lower: float
    upper: float


@dataclass(frozen=True)
class StressFit:
    """Result of a least-squares fit of a law with n parameters to a tensile curve.

    Parameters
    ----------
    parameters
        (n,) fitted parameters; moduli in the unit of the stress.
    intervals
        (n, 2) lower end (column 0) and upper end (column 1) of the 95 % interval of each parameter.
    held_by_bounds
        (n,) True where the bounds of the search, and not the data, limit the parameter.
    modulus_half_width
        Half the width of the 95 % interval of the initial shear modulus, in the unit of the stress.
    correlation_rows
        Number of correlated rows of the curve that carry as much information as one independent row.
    correlation
        (n, n) correlation matrix of the errors of the parameters.
    """

    parameters: Array
    intervals: Array
    held_by_bounds: Sequence[bool]
    modulus_half_width: float
    correlation_rows: float
    correlation: Array


@dataclass(frozen=True)
class CardConstants:
    """The constants of a law as a finite-element program defines them; `laws.cards` writes a material card with them.

    Parameters
    ----------
    keyword
        The program's name of the law.
    constants
        Value of each constant by name, in the order of the program. A string is a formula.
    dimensionless
        Names of the constants that are not moduli.
    meaning
        Description of each constant whose name does not explain it.
    volume
        The volumetric energy as a formula; None if it is the usual formula of the program.
    notes
        Comments for the reader of the card.
    """

    keyword: str
    constants: Mapping[str, float | str]
    dimensionless: Sequence[str] = ()
    meaning: Mapping[str, str] = field(default_factory=dict)
    volume: str | None = None
    notes: Sequence[str] = ()


class CannotFit(Exception):
    """A tensile test has too few usable rows, or the law cannot produce the measured stresses."""


class NotInSolver(Exception):
    """A finite-element program does not have a hyperelastic law, or cannot represent the law completely."""


class Law(Protocol):
    """A hyperelastic law with n parameters.

    Parameters are arrays of shape (..., n). The leading axes are broadcast against the arrays of deformations. All
    moduli have the same unit of stress, which may be any unit, and strain energies have this unit too. A law that is a
    function of the invariants can inherit most methods from `laws.invariants.InvariantLaw`.

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
        """The name of the law on the command line."""

    @property
    def formula(self) -> str:
        """The formula of the strain energy as one line of text."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The names of the n parameters, in the order of the parameter arrays."""

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each parameter: ``"Pa"`` or ``"1"``."""

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates in which the law's parameters are searched: the initial shear modulus (Pa), then ratios.

        The ratios are dimensionless. The search uses a logarithmic scale for the initial shear modulus and a linear
        scale for the ratios.
        """

    def from_coordinates(self, x: Array) -> Array:
        """Convert coordinates (the quantities that the search varies) into parameters of the law.

        Parameters
        ----------
        x
            (P, m) m coordinates of P candidate laws, in the order of `coordinates`.

        Returns
        -------
        Array
            (P, n) parameters. Every modulus is proportional to the first coordinate.
        """

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the shear modulus of the law at zero strain.

        Parameters
        ----------
        parameters
            (..., n) parameters.

        Returns
        -------
        Array
            (...) shear moduli, in the unit of the moduli.
        """

    def planar(self, parameters: Array, a: Array, J: Array, section: Section) -> PlanarEnergy:
        """Return the strain energy density of planar deformations and its derivatives.

        Parameters
        ----------
        parameters
            (..., n) parameters.
        a, J
            (...) F : F and det F, with the deformation gradient F in the plane.
        section
            Plane strain or plane stress.

        Returns
        -------
        PlanarEnergy
            psi(a, J) with its first and second derivatives.
        """

    def principal(self, parameters: Array, stretches: Array) -> tuple[Array, Array, Array]:
        """Return the strain energy of isochoric deformations, and its derivatives by the logarithmic stretches.

        Parameters
        ----------
        parameters
            (..., n) parameters.
        stretches
            (..., 3) isochoric principal stretches; their product is 1.

        Returns
        -------
        energy, gradient, hessian
            Strain energies (...), first derivatives (..., 3) and second derivatives (..., 3, 3) by the logarithms of
            the three stretches.
        """

    def drucker_limit(self, parameters: Array, largest_stretch: Array) -> Array:
        """Return the largest stretch up to which each candidate law fulfils Drucker's criterion (`laws.stability`).

        Parameters
        ----------
        parameters
            (P, n) parameters of P candidates.
        largest_stretch
            (P,) stretches, at least 1, up to which the stability of each candidate is examined.

        Returns
        -------
        Array
            (P,) stretches; 0 for a candidate that is unstable even at rest. For a candidate that is stable up to
            ``largest_stretch``, the result may be any stretch that is not smaller than ``largest_stretch``.
        """

    def fit_stress(self, strain: Array, stress: Array, weight: Array) -> StressFit:
        """Fit the law to a uniaxial tensile curve of m rows by weighted least squares.

        Parameters
        ----------
        strain, stress
            (m,) engineering strains and engineering stresses.
        weight
            (m,) factors by which the residuals of the stress are multiplied.

        Raises
        ------
        CannotFit
            If the law cannot produce the given stresses.
        """

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """Return the constants of the law in a finite-element program.

        Parameters
        ----------
        solver
            Name of the program, usually one of `laws.cards.SOLVERS`.
        p
            Parameters of the law by name.
        bulk
            Bulk modulus, in the unit of the moduli in ``p``.

        Raises
        ------
        NotInSolver
            If the program does not have the law, or if the conversion to the constants of this program is not
            implemented.
        """
