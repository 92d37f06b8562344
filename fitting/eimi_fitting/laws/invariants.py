"""Base classes for hyperelastic laws whose strain energy W is a function of the isochoric invariants I1 and I2."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.law import CardConstants, Coordinate, NotInSolver, PlanarEnergy, Section, StressFit
from eimi_fitting.laws.stability import scanned_limit
from eimi_fitting.laws.tensile import bounded_least_squares

Array = NDArray[np.float64]


class _Invariant(NamedTuple):
    """The value of the invariant I1 or I2 of a planar deformation, and its derivatives by a = F : F and J = det F.

    F is the deformation gradient in the plane. The field ``aJ`` is the mixed second derivative.
    """

    value: Array
    a: Array
    J: Array
    aJ: Array
    JJ: Array


def _first_invariant(a: Array, J: Array, section: Section) -> _Invariant:
    """Return the isochoric invariant I1 and its derivatives by a = F : F and J = det F.

    F is the deformation gradient in the plane.
    """
    if section == "plane-stress":
        s = 1 / J**2
        return _Invariant(a + s, np.ones_like(a), -2 * s / J, np.zeros_like(a), 6 * s**2)
    c = J ** (-2 / 3)
    value, over = c * (a + 1), 1 / J
    return _Invariant(value, c, -2 / 3 * value * over, -2 / 3 * c * over, 10 / 9 * value * over * over)


def _second_invariant(a: Array, J: Array, section: Section) -> _Invariant:
    """Return the isochoric invariant I2 and its derivatives by a = F : F and J = det F.

    F is the deformation gradient in the plane.
    """
    if section == "plane-stress":
        s = 1 / J**2
        return _Invariant(J**2 + a * s, s, 2 * J - 2 * a * s / J, -2 * s / J, 2 + 6 * a * s**2)
    c = J ** (-4 / 3)
    return _Invariant(
        c * (a + J**2),
        c,
        c * (2 / 3 * J - 4 / 3 * a / J),
        -4 / 3 * c / J,
        c * (28 / 9 * a / J**2 - 2 / 9),
    )


class InvariantEnergy(ABC):
    """The base class of a strain energy that is the sum of a function of I1 - 3 and a multiple of I2 - 3.

    Attributes
    ----------
    needs_second
        Whether the energy depends on I2.
    """

    needs_second = False

    @abstractmethod
    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return the strain energy W(x, y) and its derivatives dW/dx, dW/dy and d²W/dx².

        Parameters
        ----------
        parameters
            (..., n) parameters of the law.
        x, y
            (...) x = I1 - 3 and y = I2 - 3, with the isochoric invariants I1 and I2.
        """

    def planar(self, parameters: Array, a: Array, J: Array, section: Section) -> PlanarEnergy:
        """Return the strain energy density and its derivatives by a = F : F and J = det F.

        F is the deformation gradient in the plane.
        """
        i1 = _first_invariant(a, J, section)
        if not self.needs_second:
            w, w1, _, w11 = self.coefficients(parameters, i1.value - 3, np.zeros(()))
            slope = w11 * i1.a
            return PlanarEnergy(
                w, w1 * i1.a, w1 * i1.J, slope * i1.a, w1 * i1.aJ + slope * i1.J, w1 * i1.JJ + w11 * i1.J**2
            )
        i2 = _second_invariant(a, J, section)
        w, w1, w2, w11 = self.coefficients(parameters, i1.value - 3, i2.value - 3)
        return PlanarEnergy(
            w,
            w1 * i1.a + w2 * i2.a,
            w1 * i1.J + w2 * i2.J,
            w11 * i1.a**2,
            w1 * i1.aJ + w2 * i2.aJ + w11 * i1.a * i1.J,
            w1 * i1.JJ + w2 * i2.JJ + w11 * i1.J**2,
        )

    def principal(self, parameters: Array, stretches: Array) -> tuple[Array, Array, Array]:
        """Return the strain energy, and its gradient and Hessian by the logarithmic principal stretches."""
        q, r = stretches**2, stretches**-2
        w, w1, w2, w11 = self.coefficients(parameters, q.sum(-1) - 3, r.sum(-1) - 3)
        gradient = 2 * w1[..., None] * q - 2 * w2[..., None] * r
        diagonal = 4 * w1[..., None] * q + 4 * w2[..., None] * r
        hessian = diagonal[..., None] * np.eye(3) + 4 * w11[..., None, None] * q[..., :, None] * q[..., None, :]
        return w, gradient, hessian


class InvariantLaw(InvariantEnergy):
    """The base class of laws whose strain energy is a function of the invariants I1 and I2.

    A subclass defines the energy with its derivatives (`coefficients`), the initial shear modulus and the coordinates
    of the search.

    Examples
    --------
    The law of Gent, W = -mu Jm/2 ln(1 - (I1 - 3)/Jm) (Gent 1996, Rubber Chem. Technol. 69:59), as a subclass. Its
    method ``coefficients`` returns W, dW/dx, dW/dy and d²W/dx², with x = I1 - 3 and y = I2 - 3:

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Gent(InvariantLaw):
    ...     name: str = "gent"
    ...     formula: str = "W = -mu Jm/2 ln(1 - (I1 - 3)/Jm)"
    ...     parameter_names: tuple[str, ...] = ("mu", "Jm")
    ...     units: tuple[str, ...] = ("Pa", "1")
    ...     coordinates: tuple[Coordinate, ...] = (Coordinate("mu", 1e3, 1e6), Coordinate("Jm", 5.0, 200.0))
    ...     def from_coordinates(self, x):
    ...         return x
    ...     def initial_shear_modulus(self, parameters):
    ...         return parameters[..., 0]
    ...     def coefficients(self, parameters, x, y):
    ...         mu, room = parameters[..., 0], parameters[..., 1] - x
    ...         jm = parameters[..., 1]
    ...         slope = 0.5 * mu * jm / room
    ...         return -0.5 * mu * jm * np.log(room / jm), slope, np.zeros_like(x), slope / room
    >>> from eimi_fitting.laws import fit_tensile, engineering_stress
    >>> strain = np.linspace(0.1, 2.0, 20)
    >>> fit = fit_tensile(Gent(), strain, engineering_stress(Gent(), np.array([46e3, 30.0]), strain))
    >>> [round(float(x), 3) for x in fit.parameters]
    [46000.0, 30.0]
    """

    name: str
    formula: str
    parameter_names: tuple[str, ...]
    units: tuple[str, ...]
    coordinates: tuple[Coordinate, ...]

    @abstractmethod
    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the initial shear modulus, 2 (dW/dI1 + dW/dI2) at rest."""

    @abstractmethod
    def from_coordinates(self, x: Array) -> Array:
        """Convert coordinates (the quantities that the search varies) into parameters."""

    def drucker_limit(self, parameters: Array, largest_stretch: Array) -> Array:
        """Return the smallest stretch at which a sampled deformation is unstable, for P sets of parameters, (P,).

        The result is infinity if all sampled deformations are stable.
        """
        return scanned_limit(self, parameters, largest_stretch)

    def fit_stress(self, strain: Array, stress: Array, weight: Array) -> StressFit:
        """Fit the law to a tensile curve by least squares, within the bounds of the search."""
        return bounded_least_squares(self, strain, stress, weight)

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """Raise NotInSolver: no finite-element program is known to have the law."""
        raise NotInSolver(f"the {self.name} law cannot be exported to {solver}; choose another program")
