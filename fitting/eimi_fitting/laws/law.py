"""The interface of a hyperelastic law, and the types of the arguments and results of its methods.

With the deformation gradient F in the plane, a = F : F and J = det F, the isochoric invariants are:

plane strain   I1 = J^(-2/3) (a + 1) and I2 = J^(-4/3) (a + J^2); the third principal stretch is 1
plane stress   I1 = a + J^-2 and I2 = J^2 + a J^-2; the material is incompressible
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
        psi, in the unit of the moduli.
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
    """A quantity that the search for a law's parameters varies.

    Parameters
    ----------
    name
        Name in messages and reports.
    lower, upper
        Bounds of the search.
    """

    name: str
    lower: float
    upper: float


@dataclass(frozen=True)
class StressFit:
    """The least-squares fit of a law with n parameters to a tensile curve.

    Parameters
    ----------
    parameters
        (n,) fitted parameters; moduli in the unit of the stress.
    intervals
        (n, 2) lower and upper end of the 95 % interval of each parameter.
    held_by_bounds
        (n,) True for a parameter that only the bounds of the search limit.
    modulus_half_width
        Half the width of the 95 % interval of the initial shear modulus.
    correlation_rows
        Correlation length of the residuals in rows.
    correlation
        (n, n) correlation matrix of the parameters.
    """

    parameters: Array
    intervals: Array
    held_by_bounds: Sequence[bool]
    modulus_half_width: float
    correlation_rows: float
    correlation: Array


@dataclass(frozen=True)
class CardConstants:
    """The constants of a law as a finite-element program defines them.

    Parameters
    ----------
    keyword
        The program's name of the law.
    constants
        Value of each constant by name; a string is a formula.
    dimensionless
        Names of the constants that are not moduli.
    meaning
        Description of constants by name.
    volume
        Formula of the volumetric energy; None for the usual formula of the program.
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
    """A finite-element program cannot represent a hyperelastic law."""


class Law(Protocol):
    """A hyperelastic law with n parameters.

    Parameters are arrays of shape (..., n). Moduli and strain energies have the same unit, which may be any unit.

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
        """The coordinates of the search for the parameters: the initial shear modulus (Pa), then dimensionless ones."""

    def from_coordinates(self, x: Array) -> Array:
        """Convert coordinates (the quantities that the search varies) into parameters of the law.

        Parameters
        ----------
        x
            (P, m) m coordinates of P points of the search, in the order of `coordinates`.

        Returns
        -------
        Array
            (P, n) parameters.
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
            (..., 3) isochoric principal stretches.

        Returns
        -------
        energy, gradient, hessian
            Energies (...), first derivatives (..., 3) and second derivatives (..., 3, 3).
        """

    def drucker_limit(self, parameters: Array, largest_stretch: Array) -> Array:
        """Return the largest stretch up to which a law fulfils Drucker's stability criterion.

        Parameters
        ----------
        parameters
            (P, n) P sets of parameters.
        largest_stretch
            (P,) stretches up to which the stability is examined.

        Returns
        -------
        Array
            (P,) stretches; 0 if the law is unstable at rest; at least ``largest_stretch`` if no instability occurs.
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
            Name of the program, such as abaqus.
        p
            Parameters of the law by name.
        bulk
            Bulk modulus, in the unit of the moduli in ``p``.

        Raises
        ------
        NotInSolver
            If the program cannot represent the law.
        """
