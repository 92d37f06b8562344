"""From beams and tensile curves to the terms of their law, or to "not identifiable"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.discovery.bending_rows import BENT_STRAIN, bending_rows, scale_deviation
from eimi_fitting.discovery.rows import Rows, non_negative
from eimi_fitting.discovery.supports import Support, could_be_added, minimal, supports
from eimi_fitting.discovery.tensile_rows import largest_x, stress_columns, tensile_rows
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.inference.identification import identify
from eimi_fitting.laws.stability import stable_up_to
from eimi_fitting.laws.sum_of_terms import SumOfTerms, Term

Array = NDArray[np.float64]

LIBRARY = tuple(Term.of(name) for name in ("i1", "i2", "i1^2", "i1^3", "gent=20", "fung=0.2", "ogden=-4", "ogden=8"))
LOT = 0.02
MOST_TERMS = 3
_MOST_PASSES = 8
_STANDS = 0.5  # times the noise: a law that bends the beams no further away is linear about the one before
_SAME_NOISE = 0.02  # from pass to pass
_ROOM = 1.02  # by which a Gent term's last stretch must exceed the curves'
_SHARE = 0.15  # of the stress: what a term that is said not to be there may carry
_ASKED_STRAIN = 1.0  # up to which a law is asked for where no curve says
_NOISE_ALONE = 1.5  # held-out error above which something other than noise is left


@dataclass(frozen=True)
class Alternative:
    """Terms that follow the data: coefficients (k,) and their 95 % intervals (k, 2), in Pa, if the terms are these.

    held_out_error: root mean square in units of the noise; stable_to: see `laws.stability`.
    """

    terms: tuple[Term, ...]
    coefficients: Array
    intervals: Array
    initial_shear_modulus_Pa: float
    held_out_error: float
    stable_to: float | None


@dataclass(frozen=True)
class Discovery:
    """Sets of terms that noise cannot tell from the best and none of whose terms can be spared, fewest terms first.

    open_terms: where that is one set alone, further terms that could carry more than 15 % of the stress at ``strain``,
    the largest of the curves or 100 % without any, with that share; library: the terms that were tried; left_out: those
    that the curves go beyond; noise_mm: of each experiment; noise_Pa: of each curve; in_play: all sets of terms, of any
    size, that noise cannot tell from the best; sets: how many were fitted.
    """

    alternatives: tuple[Alternative, ...]
    open_terms: dict[Term, float]
    strain: float
    library: tuple[Term, ...]
    left_out: tuple[Term, ...]
    noise_mm: tuple[float, ...]
    noise_Pa: tuple[float, ...]
    in_play: tuple[tuple[Term, ...], ...]
    sets: int

    @property
    def identified(self) -> bool:
        """Whether the data tell one set of terms from all others of the library."""
        return len(self.alternatives) == 1 and not self.open_terms and self.explained

    @property
    def explained(self) -> bool:
        """Whether the best leaves noise alone."""
        return self.alternatives[0].held_out_error < _NOISE_ALONE

    @property
    def in_all(self) -> tuple[Term, ...]:
        """Terms of every alternative."""
        return tuple(t for t in self.alternatives[0].terms if all(t in own.terms for own in self.alternatives))

    @property
    def statement(self) -> str:
        """In words."""
        best = " + ".join(term.name for term in self.alternatives[0].terms)
        if not self.explained:
            return (
                f"not identifiable: the best {best} leaves {self.alternatives[0].held_out_error:.2g} times the noise; "
                "the law is not in the library"
            )
        if self.identified:
            return f"identified among the terms of this library: {best}"
        if self.open_terms:
            shares = ", ".join(f"{term.name} {100 * min(share, 1):.0f} %" for term, share in self.open_terms.items())
            return (
                f"not identifiable: {best} follows the data, but at a strain of {100 * self.strain:.0f} % other terms "
                f"could carry as much of the stress: {shares}"
            )
        common = ", ".join(term.name for term in self.in_all)
        return (
            f"not identifiable: {len(self.alternatives)} sets of terms follow the data equally well, {best} among "
            f"them; {f'{common} is in all of them' if common else 'no term is in all of them'}"
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
    """Which terms of a library the law is made of.

    Parameters
    ----------
    experiments, curves
        Evidence of one material; either may be empty, not both.
    library
        Terms with fixed numbers, at least two with stiffness at rest.
    most_terms
        Of a law.
    lot
        Standard deviation by which all moduli of the beams may differ from the curves', as a share.
    modulus_Pa
        Of a Neo-Hookean fit to the experiments; sought where it is not given.
    seed
        Of that search.

    Raises
    ------
    ValueError
        For no evidence, or a library that holds no term with stiffness at rest, or one twice.
    CannotFit
        For a tensile curve.
    NoEquilibrium
        Beams of a law that is near bend no further.
    Whatever `identify` raises for experiments that no law explains.

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
        about = _near(_modulus_Pa(experiments, modulus_Pa, seed), curve_rows, terms)
        bent, noise_mm = _about_what_it_leads_to(experiments, terms, about, lot if curves else 0.0, curve_rows)
        parts = [bent, *curve_rows]
    if not parts:
        raise ValueError("there is neither a beam nor a curve")
    rows, found, noises = _supports(Rows.joined(parts), has_modulus, most_terms)
    strain = max((float(np.max(curve.strain)) for curve in curves), default=_ASKED_STRAIN)
    least = minimal(found)
    return Discovery(
        alternatives=tuple(_alternative(own, terms, noises) for own in least),
        open_terms=_open_terms(rows, least[0], terms, strain) if len(least) == 1 else {},
        strain=strain,
        library=terms,
        left_out=left_out,
        noise_mm=tuple(noise_mm),
        noise_Pa=tuple(noise for _, noise in pulled),
        in_play=tuple(tuple(terms[i] for i in own.terms) for own in found if own.in_play),
        sets=len(found),
    )


def _supports(rows: Rows, has_modulus: NDArray[np.bool_], most_terms: int) -> tuple[Rows, tuple[Support, ...], float]:
    """The sets, with rows in whose unit the best one leaves noise alone, and how many times the noise that is."""
    found = supports(rows, has_modulus, most_terms)
    noises = found[0].held_out_error
    if noises <= 1.0:
        return rows, found, 1.0
    noisier = rows.noisier(noises)
    return noisier, supports(noisier, has_modulus, most_terms), noises


def _open_terms(rows: Rows, support: Support, terms: Sequence[Term], strain: float) -> dict[Term, float]:
    """Of the stress at this strain, what further terms could carry where it is more than a little."""
    columns = stress_columns(terms, np.array([strain]))[0]
    most = could_be_added(rows, support.terms) * columns
    shares = most / (most + support.coefficients @ columns[list(support.terms)])
    return {term: float(share) for term, share in zip(terms, shares, strict=True) if not share <= _SHARE}


def _usable(library: Sequence[Term], curves: Sequence[TensileCurve]) -> tuple[tuple[Term, ...], tuple[Term, ...]]:
    """The terms that have a stress everywhere on the curves, and the others."""
    if len(set(library)) < len(library):
        raise ValueError("the library holds a term twice")
    most = max((_ROOM * largest_x(curve.strain) for curve in curves), default=0.0)
    terms = tuple(term for term in library if term.largest_x > most)
    if not any(term.has_modulus for term in terms):
        raise ValueError("the library holds no term with stiffness at rest")
    return terms, tuple(term for term in library if term not in terms)


def _modulus_Pa(experiments: Sequence[Experiment], known: float | None, seed: int) -> float:
    return known or identify("neo-hookean", experiments, seed=seed).initial_shear_modulus.value


def _near(modulus_Pa: float, curve_rows: Sequence[Rows], terms: Sequence[Term]) -> Array:
    """Coefficients (J,) of a law about which the beams are linear: the curves', as stiff as the beams ask for."""
    about = np.zeros(len(terms))
    about[next(i for i, term in enumerate(terms) if term.has_modulus)] = 1.0
    if curve_rows:
        rows = Rows.joined(curve_rows)
        about = non_negative(rows.columns, rows.seen)
    stretch = 1 + BENT_STRAIN
    stress = float(stress_columns(terms, np.array([BENT_STRAIN]))[0] @ about)
    return np.asarray(about * modulus_Pa * (stretch - stretch**-2) / stress)


def _about_what_it_leads_to(
    experiments: Sequence[Experiment], terms: Sequence[Term], about: Array, lot: float, curve_rows: Sequence[Rows]
) -> tuple[Rows, list[float]]:
    """`bending_rows` about the law of all terms that they lead to. Raises NoEquilibrium."""
    before = np.zeros(0)
    rows, noise_mm = bending_rows(experiments, terms, about, lot)
    for _ in range(_MOST_PASSES):
        coefficients, sizes = Rows.joined([rows, *curve_rows]).of_all_terms()
        reached = coefficients * (1 + scale_deviation(lot) * sizes[0])
        moved = float(np.sqrt(np.mean((rows.columns @ (reached - about)) ** 2)))
        if moved < _STANDS and len(before) and np.allclose(noise_mm, before, rtol=_SAME_NOISE):
            break
        about, before = reached, np.array(noise_mm)
        rows, noise_mm = bending_rows(experiments, terms, about, lot)
    return rows, noise_mm


def _alternative(support: Support, terms: Sequence[Term], noises: float) -> Alternative:
    own = tuple(terms[i] for i in support.terms)
    law, half = SumOfTerms(own), 1.96 * support.standard_errors
    return Alternative(
        terms=own,
        coefficients=support.coefficients,
        intervals=np.column_stack([support.coefficients - half, support.coefficients + half]),
        initial_shear_modulus_Pa=float(law.initial_shear_modulus(support.coefficients)),
        held_out_error=noises * support.held_out_error,
        stable_to=stable_up_to(law, support.coefficients),
    )
