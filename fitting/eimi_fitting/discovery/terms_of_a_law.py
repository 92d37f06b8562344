"""Find the terms of a hyperelastic law from bent beams and tensile curves, if the data determine the terms.

All small sets of terms are fitted. The result is the smallest sets that agree with the data apart from noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.discovery.bending_rows import BENT_STRAIN, bending_rows, scale_deviation
from eimi_fitting.discovery.rows import Rows, non_negative
from eimi_fitting.discovery.supports import Support, minimal, supports, upper_coefficients
from eimi_fitting.discovery.tensile_rows import largest_x, stress_columns, tensile_rows
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.laws.law import CannotFit
from eimi_fitting.laws.stability import stable_up_to
from eimi_fitting.laws.sum_of_terms import SumOfTerms, Term
from eimi_fitting.laws.tensile import strain_reached

Array = NDArray[np.float64]

LIBRARY = tuple(Term.of(name) for name in ("i1", "i2", "i1^2", "i1^3", "gent=20", "fung=0.2", "ogden=-4", "ogden=8"))
LOT = 0.02
MOST_TERMS = 3
_MOST_PASSES = 8  # of linearisation
_STANDS = 0.5  # the linearisation is repeated until the edges move by less than this, in units of the noise
_SAME_NOISE = 0.02  # the linearisation is repeated until the noise changes by less than this share
_ROOM = 1.02  # a Gent term is used if its limit of I1 - 3 exceeds that of the curves by this factor
_SHARE = 0.15  # a further term is reported if it could carry more than this share of the stress
_DEFAULT_STRAIN = 1.0  # at which the stress is compared if there is no tensile curve
_NOISE_ALONE = 1.5  # a held-out error above this cannot be noise alone


class UnusableLibrary(ValueError):
    """The error of a library that contains a term twice, or no usable term that adds to the initial shear modulus."""


@dataclass(frozen=True)
class Alternative:
    """A hyperelastic law that agrees with the data."""

    # The k terms.
    terms: tuple[Term, ...]
    # (k,): coefficients, Pa, if the law has exactly these terms.
    coefficients: Array
    # (k, 2): 95 % intervals of the coefficients, Pa.
    intervals: Array
    # Initial shear modulus, Pa.
    initial_shear_modulus_Pa: float
    # Root mean square prediction error of the cross-validation, in units of the noise.
    held_out_error: float
    # Largest stretch up to which the law is stable; None if the law is stable at all checked stretches.
    stable_to: float | None


@dataclass(frozen=True)
class Discovery:
    """The sets of terms that agree with the data.

    Parameters
    ----------
    alternatives : tuple of Alternative
        Sets that agree with the data and contain no smaller set that agrees; the smallest come first.
    open_terms : dict of Term to float
        Terms that the data neither require nor exclude, and the share of the stress at ``strain`` that each could
        carry; empty if there are several alternatives.
    strain : float
        Engineering strain of the tensile curves with the largest principal stretch; 1 without a curve.
    library : tuple of Term
        Terms that were tried.
    left_out : tuple of Term
        Terms that were not tried, because their stress is not defined at all strains of the curves.
    noise_mm : tuple of float
        Standard deviation of the noise of each beam, mm.
    noise_Pa : tuple of float
        Standard deviation of the noise of each tensile curve, Pa.
    compatible_sets : tuple of tuples of Term
        All sets that agree with the data.
    sets : int
        Number of fitted sets whose coefficients are all positive.
    """

    alternatives: tuple[Alternative, ...]
    open_terms: dict[Term, float]
    strain: float
    library: tuple[Term, ...]
    left_out: tuple[Term, ...]
    noise_mm: tuple[float, ...]
    noise_Pa: tuple[float, ...]
    compatible_sets: tuple[tuple[Term, ...], ...]
    sets: int

    @property
    def identified(self) -> bool:
        """Whether the data agree with exactly one set of terms of the library."""
        return len(self.alternatives) == 1 and not self.open_terms and self.explained

    @property
    def explained(self) -> bool:
        """Whether the law with the fewest terms has prediction errors below 1.5 times the noise."""
        return self.alternatives[0].held_out_error < _NOISE_ALONE

    @property
    def in_all(self) -> tuple[Term, ...]:
        """The terms that occur in all ``alternatives``."""
        return tuple(t for t in self.alternatives[0].terms if all(t in a.terms for a in self.alternatives))

    @property
    def statement(self) -> str:
        """One sentence that names the terms of the law, or says why the data do not determine them."""
        best = " + ".join(term.name for term in self.alternatives[0].terms)
        if not self.explained:
            return (
                f"not identifiable: the best set of terms, {best}, has a prediction error of "
                f"{self.alternatives[0].held_out_error:.2g} times the noise; the law is not in the library"
            )
        if self.identified:
            return f"identified among the terms of this library: {best}"
        if self.open_terms:
            shares = ", ".join(f"{term.name} {100 * min(share, 1):.0f} %" for term, share in self.open_terms.items())
            return (
                f"not identifiable: {best} agrees with the data, but at a strain of {100 * self.strain:.0f} % further "
                f"terms could carry these shares of the stress: {shares}"
            )
        common = ", ".join(term.name for term in self.in_all)
        return (
            f"not identifiable: {len(self.alternatives)} sets of terms agree equally well with the data, such as "
            f"{best}; {f'all of them contain {common}' if common else 'no term is in all of them'}"
        )


def discover(
    experiments: Sequence[Experiment],
    curves: Sequence[TensileCurve],
    *,
    library: Sequence[Term] = LIBRARY,
    most_terms: int = MOST_TERMS,
    lot: float = LOT,
    modulus_Pa: float | None = None,
    seed: int = 1,
) -> Discovery:
    """Find the terms of a hyperelastic law among the terms of a library.

    Parameters
    ----------
    experiments : sequence of Experiment
        Bending tests of one material; may be empty if there is a curve.
    curves : sequence of TensileCurve
        Tensile curves of the same material; may be empty if there is a bending test.
    library : sequence of Term
        Possible terms, with at least one that contributes to the initial shear modulus.
    most_terms : int
        Largest number of terms of a law.
    lot : float
        Relative standard deviation of the ratio (modulus of the beams) / (modulus of the tensile specimens), which may
        come from different production lots.
    modulus_Pa : float, optional
        Shear modulus of a Neo-Hookean fit to the bending tests, Pa; by default the fit is made here.
    seed : int
        Seed of the Neo-Hookean fit.

    Returns
    -------
    Discovery
        The sets of terms that agree with the data.

    Raises
    ------
    ValueError
        If there are no data.
    UnusableLibrary
        If the library contains a term twice, or if no usable term contributes to the initial shear modulus.
    CannotFit
        If a tensile curve cannot be used, if there are too few measured values, or if no set of terms with positive
        coefficients fits the data.
    NoEquilibrium
        If a beam has no equilibrium for a law close to the solution.
    Exception
        An exception of the Neo-Hookean fit.

    Examples
    --------
    >>> strain = np.linspace(0.02, 3.0, 150)
    >>> law = SumOfTerms.of("i1", "ogden=-4")
    >>> from eimi_fitting.laws import engineering_stress
    >>> stress = engineering_stress(law, np.array([20e3, 5e3]), strain)
    >>> noisy = stress + np.random.default_rng(1).normal(0, 100.0, len(strain))
    >>> discover([], [TensileCurve(strain, noisy)]).statement
    'identified among the terms of this library: i1 + ogden=-4'
    """
    terms, left_out = _usable(library, curves)
    has_modulus = np.array([term.has_modulus for term in terms])
    pulled = [tensile_rows(curve, terms) for curve in curves]
    curve_rows = [rows for rows, _ in pulled]
    parts = curve_rows
    noise_mm: list[float] = []
    if experiments:
        if not curves:
            _check_number(experiments, min(most_terms, len(terms)))
        about = _near(_modulus_Pa(experiments, modulus_Pa, seed), curve_rows, terms)
        bent, noise_mm = _linearised(experiments, terms, about, lot if curves else 0.0, curve_rows)
        parts = [bent, *curve_rows]
    if not parts:
        raise ValueError("give at least one bent beam or one tensile curve")
    rows, fitted, noise_factor = _supports(Rows.joined(parts), has_modulus, most_terms)
    strain = strain_reached(np.concatenate([curve.strain for curve in curves])) if curves else _DEFAULT_STRAIN
    smallest = minimal(fitted)
    return Discovery(
        alternatives=tuple(_alternative(support, terms, noise_factor) for support in smallest),
        open_terms=_open_terms(rows, smallest[0], terms, strain) if len(smallest) == 1 else {},
        strain=strain,
        library=terms,
        left_out=left_out,
        noise_mm=tuple(noise_mm),
        noise_Pa=tuple(noise for _, noise in pulled),
        compatible_sets=tuple(tuple(terms[i] for i in support.terms) for support in fitted if support.is_compatible),
        sets=len(fitted),
    )


def _supports(rows: Rows, has_modulus: NDArray[np.bool_], most_terms: int) -> tuple[Rows, tuple[Support, ...], float]:
    # Fit all small sets of terms. If even the best set has too large errors, the assumed noise is increased. The
    # results: the equations divided by the final noise, the fitted sets, and the factor (at least 1) of the noise.
    fitted = supports(rows, has_modulus, most_terms)
    if not fitted:
        raise CannotFit("no set of terms with positive coefficients fits the data")
    noise_factor = fitted[0].held_out_error
    if noise_factor <= 1.0:
        return rows, fitted, 1.0
    rescaled = rows.with_noise_times(noise_factor)
    return rescaled, supports(rescaled, has_modulus, most_terms), noise_factor


def _open_terms(rows: Rows, support: Support, terms: Sequence[Term], strain: float) -> dict[Term, float]:
    """Return the terms outside a set that could carry more than 15 % of the stress, with their shares."""
    columns = stress_columns(terms, np.array([strain]))[0]
    stress = upper_coefficients(rows, support.terms) * columns
    shares = stress / (stress + support.coefficients @ columns[list(support.terms)])
    return {term: float(share) for term, share in zip(terms, shares, strict=True) if not share <= _SHARE}


def _usable(library: Sequence[Term], curves: Sequence[TensileCurve]) -> tuple[tuple[Term, ...], tuple[Term, ...]]:
    """Divide the library into the terms whose stress is defined at all strains of the curves, and the others."""
    if len(set(library)) < len(library):
        raise UnusableLibrary("the library contains a term twice: give each term once")
    most = max((_ROOM * largest_x(curve.strain) for curve in curves), default=0.0)
    terms = tuple(term for term in library if term.largest_x > most)
    if not any(term.has_modulus for term in terms):
        raise UnusableLibrary(
            "the library contains no term that adds to the initial shear modulus and has a finite stress at all "
            "strains of the curves: add i1, for example"
        )
    return terms, tuple(term for term in library if term not in terms)


def _check_number(experiments: Sequence[Experiment], most_terms: int) -> None:
    values = sum(_measured_values(experiment) for experiment in experiments)
    if values <= most_terms:
        raise CannotFit(
            f"the data have {values} measured values; laws of up to {most_terms} terms need at least {most_terms + 1}"
        )


def _measured_values(experiment: Experiment) -> int:
    # The number of distances of edge points, or of coordinates of tracked points.
    states, points = len(experiment.loads), experiment.observed.sigma_mm.shape[-1]
    weights = experiment.observed.of_residuals(np.zeros((1, states, 2, points))).weights
    return int(np.count_nonzero(weights))


def _modulus_Pa(experiments: Sequence[Experiment], modulus_Pa: float | None, seed: int) -> float:
    return modulus_Pa or identify("neo-hookean", experiments, seed=seed).initial_shear_modulus.value


def _near(modulus_Pa: float, curve_rows: Sequence[Rows], terms: Sequence[Term]) -> Array:
    """Return rough coefficients of all terms (Pa), at which the linearisation starts."""
    about = np.zeros(len(terms))
    about[next(i for i, term in enumerate(terms) if term.has_modulus)] = 1.0
    if curve_rows:
        rows = Rows.joined(curve_rows)
        about = non_negative(rows.columns, rows.observed)
    stretch = 1 + BENT_STRAIN
    stress = float(stress_columns(terms, np.array([BENT_STRAIN]))[0] @ about)
    return np.asarray(about * modulus_Pa * (stretch - stretch**-2) / stress)


def _linearised(
    experiments: Sequence[Experiment], terms: Sequence[Term], about: Array, lot: float, curve_rows: Sequence[Rows]
) -> tuple[Rows, list[float]]:
    """Return linear equations for the coefficients from the edges of all beams, and the noise in mm."""
    # ``about``: the coefficients at the start, Pa. ``lot``: relative standard deviation between production lots.
    previous_noise_mm = np.zeros(0)
    rows, noise_mm = bending_rows(experiments, terms, about, lot)
    for _ in range(_MOST_PASSES):
        coefficients, amplitudes = Rows.joined([rows, *curve_rows]).fit_all_terms()
        solution = coefficients * (1 + scale_deviation(lot) * amplitudes[0])
        change = float(np.sqrt(np.mean((rows.columns @ (solution - about)) ** 2)))
        same_noise = len(previous_noise_mm) and np.allclose(noise_mm, previous_noise_mm, rtol=_SAME_NOISE)
        if change < _STANDS and same_noise:
            break
        about, previous_noise_mm = solution, np.array(noise_mm)
        rows, noise_mm = bending_rows(experiments, terms, about, lot)
    return rows, noise_mm


def _alternative(support: Support, terms: Sequence[Term], noise_factor: float) -> Alternative:
    chosen = tuple(terms[i] for i in support.terms)
    law, half = SumOfTerms(chosen), 1.96 * support.standard_errors
    return Alternative(
        terms=chosen,
        coefficients=support.coefficients,
        intervals=np.column_stack([support.coefficients - half, support.coefficients + half]),
        initial_shear_modulus_Pa=float(law.initial_shear_modulus(support.coefficients)),
        held_out_error=noise_factor * support.held_out_error,
        stable_to=stable_up_to(law, support.coefficients),
    )
