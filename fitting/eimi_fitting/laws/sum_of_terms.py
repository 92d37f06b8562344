"""A hyperelastic law whose strain energy is a sum of chosen terms, each with one coefficient mu or C.

Let x = I1 - 3 and y = I2 - 3, with the isochoric invariants I1 and I2, and let l1, l2, l3 be the principal stretches.

    i1, i2           mu/2 x and mu/2 y (Mooney 1940, J. Appl. Phys. 11:582)
    i1^2, i1^3       C x^2 and C x^3 (Rivlin and Saunders 1951, Phil. Trans. A 243:251)
    gent=Jm          -mu Jm/2 ln(1 - x/Jm) (Gent 1996, Rubber Chem. Technol. 69:59)
    fung=b           mu/(2b) (exp(b x) - 1) (after Fung 1967, Am. J. Physiol. 213:1532)
    ogden=alpha      2 mu/alpha^2 (l1^alpha + l2^alpha + l3^alpha - 3) (Ogden 1972, Proc. R. Soc. A 326:565)

Jm, b and alpha are fixed numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.invariants import InvariantEnergy
from eimi_fitting.laws.law import (
    SHEAR_MODULUS_PA,
    CardConstants,
    Coordinate,
    NotInSolver,
    PlanarEnergy,
    Section,
    StressFit,
)
from eimi_fitting.laws.ogden import Ogden
from eimi_fitting.laws.stability import scanned_limit
from eimi_fitting.laws.tensile import linear_least_squares

Array = NDArray[np.float64]

_TERMS_WITHOUT_NUMBER = {"i1": "I1 - 3", "i2": "I2 - 3", "i1^2": "(I1 - 3)^2", "i1^3": "(I1 - 3)^3"}
_WITHOUT_MODULUS = ("i1^2", "i1^3")
_NAME_OF_NUMBER = {"gent": "Jm", "fung": "b", "ogden": "alpha"}
_SMALLEST_ROOM = 1e-9  # lower limit of Jm - x in a Gent term: beyond it the stress is huge but finite
_UNUSED_EXPONENT = 2.0  # exponent of an Ogden term with zero modulus; any non-zero number would do


@dataclass(frozen=True)
class Term:
    """One term of a strain energy: a power of I1 - 3 or I2 - 3, or a term of the Gent, Fung or Ogden law.

    Parameters
    ----------
    kind
        ``"i1"``, ``"i2"``, ``"i1^2"``, ``"i1^3"``, ``"gent"``, ``"fung"`` or ``"ogden"``.
    number
        Jm of a Gent term, b of a Fung term or alpha of an Ogden term; None for the other kinds.

    Examples
    --------
    >>> Term.of("ogden=-4")
    Term(kind='ogden', number=-4.0)
    >>> Term.of("i1").name
    'i1'
    """

    kind: str
    number: float | None = None

    @staticmethod
    def of(name: str) -> Term:
        """Create a term from its name.

        Parameters
        ----------
        name
            For example ``"i1^2"`` or ``"gent=20"``.

        Raises
        ------
        ValueError
            If there is no such term.
        """
        kind, _, number = name.strip().lower().partition("=")
        if kind in _TERMS_WITHOUT_NUMBER and not number:
            return Term(kind)
        try:
            value = float(number)
        except ValueError:
            value = float("nan")
        if kind not in _NAME_OF_NUMBER or not np.isfinite(value) or value == 0 or (value < 0 and kind != "ogden"):
            possible = [*_TERMS_WITHOUT_NUMBER, *(f"{kind}={symbol}" for kind, symbol in _NAME_OF_NUMBER.items())]
            raise ValueError(f"{name}: should be one of {', '.join(possible)}, with Jm > 0, b > 0 and alpha not 0")
        return Term(kind, value)

    @property
    def name(self) -> str:
        """The name of the term, such as ``"i1^2"`` or ``"gent=20"``."""
        return self.kind if self.number is None else f"{self.kind}={self.number:g}"

    @property
    def formula(self) -> str:
        """The formula of the term's strain energy as text."""
        match self.kind:
            case "gent":
                return f"-mu {self.number:g}/2 ln(1 - (I1 - 3)/{self.number:g})"
            case "fung":
                return f"mu/(2*{self.number:g}) (exp({self.number:g} (I1 - 3)) - 1)"
            case "ogden":
                return f"2 mu/({self.number:g})^2 (sum of l^{self.number:g} - 3)"
            case _ if self.has_modulus:
                return f"mu/2 ({_TERMS_WITHOUT_NUMBER[self.kind]})"
            case _:
                return f"C {_TERMS_WITHOUT_NUMBER[self.kind]}"

    @property
    def has_modulus(self) -> bool:
        """Whether the term contributes to the initial shear modulus."""
        return self.kind not in _WITHOUT_MODULUS

    @property
    def largest_x(self) -> float:
        """The value of I1 - 3 at which the stress becomes infinite; infinity without such a value."""
        return float(self.number) if self.kind == "gent" and self.number else np.inf


@dataclass(frozen=True)
class _Invariants(InvariantEnergy):
    """The part of the strain energy that depends on the invariants I1 and I2."""

    terms: tuple[Term, ...]
    needs_second = True

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return the strain energy W(x, y) and its derivatives dW/dx, dW/dy and d²W/dx²; x = I1 - 3 and y = I2 - 3."""
        energy, w1, w2, w11 = (np.zeros(np.broadcast_shapes(np.shape(x), parameters.shape[:-1])) for _ in range(4))
        for i, term in enumerate(self.terms):
            c, number = parameters[..., i], term.number or 1.0
            match term.kind:
                case "i1":
                    energy, w1 = energy + 0.5 * c * x, w1 + 0.5 * c
                case "i2":
                    energy, w2 = energy + 0.5 * c * y, w2 + 0.5 * c
                case "i1^2":
                    energy, w1, w11 = energy + c * x**2, w1 + 2 * c * x, w11 + 2 * c
                case "i1^3":
                    energy, w1, w11 = energy + c * x**3, w1 + 3 * c * x**2, w11 + 6 * c * x
                case "gent":
                    room = np.maximum(number - x, _SMALLEST_ROOM)
                    energy = energy - 0.5 * c * number * np.log(room / number)
                    w1, w11 = w1 + 0.5 * c * number / room, w11 + 0.5 * c * number / room**2
                case "fung":
                    growth = np.expm1(np.minimum(number * x, 300.0))
                    energy = energy + 0.5 * c / number * growth
                    w1, w11 = w1 + 0.5 * c * (growth + 1), w11 + 0.5 * c * number * (growth + 1)
        return energy, w1, w2, w11


@dataclass(frozen=True)
class SumOfTerms:
    """A hyperelastic law whose strain energy is a sum of terms.

    Parameters
    ----------
    terms
        Terms; their coefficients (Pa) are the parameters of the law.

    Examples
    --------
    >>> law = SumOfTerms.of("i1", "gent=30")
    >>> law.parameter_names
    ('mu of i1', 'mu of gent=30')
    >>> float(law.initial_shear_modulus(np.array([20e3, 10e3])))
    30000.0
    """

    terms: tuple[Term, ...]

    @staticmethod
    def of(*names: str) -> SumOfTerms:
        """Create the law from the names of its terms. Raise ValueError for an unknown name."""
        return SumOfTerms(tuple(Term.of(name) for name in names))

    @property
    def name(self) -> str:
        """The names of the terms, joined by plus signs."""
        return " + ".join(term.name for term in self.terms)

    @property
    def formula(self) -> str:
        """The formula of the strain energy as one line of text."""
        return "W = " + " + ".join(term.formula for term in self.terms)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """The names of the law's parameters, one for each term."""
        return tuple(f"{'mu' if term.has_modulus else 'C'} of {term.name}" for term in self.terms)

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each parameter of the law: Pa for all parameters."""
        return ("Pa",) * len(self.terms)

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates of the search: the initial shear modulus (Pa), then coefficients divided by this modulus."""
        further = tuple(Coordinate(f"{term.name} over the modulus", 0.0, 1.0) for term in self._others)
        return (Coordinate("initial shear modulus", *SHEAR_MODULUS_PA), *further)

    @cached_property
    def _first(self) -> int:
        return next(i for i, term in enumerate(self.terms) if term.has_modulus)

    @cached_property
    def _others(self) -> list[Term]:
        return [term for i, term in enumerate(self.terms) if i != self._first]

    def from_coordinates(self, x: Array) -> Array:
        """Convert values of `coordinates` to coefficients of the m terms, both (P, m) for P candidates."""
        shares = np.insert(x[:, 1:], self._first, 0.0, axis=1)
        shares[:, self._first] = 1 - shares @ self._has_modulus
        return np.asarray(x[:, :1] * shares)

    @cached_property
    def _has_modulus(self) -> Array:
        return np.array([float(term.has_modulus) for term in self.terms])

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the initial shear modulus of the law: the sum of the coefficients mu of its terms."""
        return np.asarray(parameters @ self._has_modulus)

    @cached_property
    def _invariants(self) -> _Invariants:
        return _Invariants(self.terms)

    @cached_property
    def _ogden(self) -> list[int]:
        return [i for i, term in enumerate(self.terms) if term.kind == "ogden"]

    def _ogden_parameters(self, parameters: Array) -> list[Array]:
        """Return the Ogden terms in groups of three, each group as the parameters of an `Ogden` law, (..., 6)."""
        laws = []
        for first in range(0, len(self._ogden), 3):
            three_terms = np.zeros((*parameters.shape[:-1], 6))
            three_terms[..., 1::2] = _UNUSED_EXPONENT
            for place, i in enumerate(self._ogden[first : first + 3]):
                alpha = cast(float, self.terms[i].number)
                three_terms[..., 2 * place], three_terms[..., 2 * place + 1] = 2 * parameters[..., i] / alpha, alpha
            laws.append(three_terms)
        return laws

    def planar(self, parameters: Array, a: Array, J: Array, section: Section) -> PlanarEnergy:
        """Return the strain energy density and its derivatives by a = F : F and J = det F.

        F is the deformation gradient in the plane.
        """
        parts = [self._invariants.planar(parameters, a, J, section)]
        parts += [Ogden().planar(three_terms, a, J, section) for three_terms in self._ogden_parameters(parameters)]
        return PlanarEnergy(*(np.asarray(sum(of)) for of in zip(*parts, strict=True)))

    def principal(self, parameters: Array, stretches: Array) -> tuple[Array, Array, Array]:
        """Return the strain energy, and its gradient and Hessian by the logarithmic principal stretches."""
        parts = [self._invariants.principal(parameters, stretches)]
        parts += [Ogden().principal(three_terms, stretches) for three_terms in self._ogden_parameters(parameters)]
        energy, gradient, hessian = (np.asarray(sum(of)) for of in zip(*parts, strict=True))
        return energy, gradient, hessian

    def drucker_limit(self, parameters: Array, largest_stretch: Array) -> Array:
        """Return the smallest stretch at which a sampled deformation is unstable, for P sets of parameters, (P,).

        The result is infinity if no coefficient is negative, or if all sampled deformations are stable.
        """
        stable = (parameters >= 0).all(axis=1) & (self.initial_shear_modulus(parameters) > 0)
        limit = np.full(len(parameters), np.inf)
        if not stable.all():
            limit[~stable] = scanned_limit(self, parameters[~stable], largest_stretch[~stable])
        return limit

    def fit_stress(self, strain: Array, stress: Array, weight: Array) -> StressFit:
        """Fit the law to a tensile curve by linear least squares."""
        return linear_least_squares(self, strain, stress, weight)

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """Raise NotInSolver: no finite-element program has a law with a sum of such terms."""
        raise NotInSolver(f"the {self.name} law cannot be exported to {solver}; choose another program")
