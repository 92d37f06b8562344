"""Which terms a law is made of, from datasets and tensile tests: what `eimi discover` does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eimi_fitting.discovery.bending_rows import NoEquilibrium
from eimi_fitting.discovery.terms_of_a_law import LIBRARY, Alternative, Discovery, discover
from eimi_fitting.laws import CannotFit
from eimi_fitting.laws.sum_of_terms import SumOfTerms, Term
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.fitting import REFUSALS, check_evidence, refused
from eimi_lab.fits.records import package_versions
from eimi_lab.fits.tensile_files import FileCurve
from eimi_lab.process.errors import InputError

_SHOWN = 12  # alternatives in a table


def discovered(evidence: Sequence[Evidence], curves: Sequence[FileCurve], **options: Any) -> Discovery:
    """Do what `discover` does, with its options. Raises InputError."""
    check_evidence(evidence)
    try:
        return discover([own.experiment for own in evidence], curves, **options)
    except CannotFit as error:
        raise InputError(f"{', '.join(own.path for own in curves)}: {error}") from error
    except REFUSALS as error:
        raise refused(error, evidence) from error
    except NoEquilibrium as error:
        names = ", ".join(str(own.path) for own in evidence)
        raise InputError(f"{names}: the beam finds no equilibrium with the law of the curves") from error
    except ValueError as error:
        raise InputError(f"--term: {error}") from error


def library_of(names: Sequence[str]) -> tuple[Term, ...]:
    """The terms asked for, or those of `LIBRARY`. Raises InputError."""
    try:
        return tuple(Term.of(name) for name in names) or LIBRARY
    except ValueError as error:
        raise InputError(f"--term {error}") from error


def content(
    found: Discovery, evidence: Sequence[Evidence], curves: Sequence[FileCurve], **numbers: float
) -> dict[str, Any]:
    """discovery.json. numbers: the options of `discovered` that are numbers."""
    return {
        "statement": found.statement,
        "identified": found.identified,
        "alternatives": [_of(own) for own in found.alternatives],
        "terms_in_all": [term.name for term in found.in_all],
        "terms_that_could_be_there": {term.name: share for term, share in found.open_terms.items()},
        "at_strain": found.strain,
        "library": [{"term": term.name, "energy": term.formula} for term in found.library],
        "terms_left_out": [term.name for term in found.left_out],
        "sets_in_play": [[term.name for term in own] for own in found.in_play],
        "sets_fitted": found.sets,
        "datasets": [
            {"path": str(own.path), "sha256": own.sha256, "noise_mm": noise, "taken_as_exact": own.taken_as_exact}
            for own, noise in zip(evidence, found.noise_mm, strict=True)
        ],
        "tensile": [
            {"path": own.path, "sha256": own.sha256, "window_percent": own.window_percent, "noise_Pa": noise}
            for own, noise in zip(curves, found.noise_Pa, strict=True)
        ],
        **numbers,
        "versions": package_versions(),
    }


def _of(own: Alternative) -> dict[str, Any]:
    names = SumOfTerms(own.terms).parameter_names
    return {
        "terms": [term.name for term in own.terms],
        "coefficients_Pa": dict(zip(names, own.coefficients.tolist(), strict=True)),
        "intervals_95_Pa": dict(zip(names, own.intervals.tolist(), strict=True)),
        "initial_shear_modulus_Pa": own.initial_shear_modulus_Pa,
        "held_out_error_over_noise": own.held_out_error,
        "stable_to": own.stable_to,
    }


def lines(found: Discovery, output: Path) -> list[str]:
    """For a person."""
    told = [found.statement]
    for own in found.alternatives[:_SHOWN]:
        names = SumOfTerms(own.terms).parameter_names
        parts = [
            f"{name} {c / 1e3:.4g} kPa [{low / 1e3:.4g}, {high / 1e3:.4g}]"
            for name, c, (low, high) in zip(names, own.coefficients, own.intervals, strict=True)
        ]
        told.append(f"  {', '.join(parts)}; held-out error {own.held_out_error:.2f} times the noise")
    if len(found.alternatives) > _SHOWN:
        told.append(f"  and {len(found.alternatives) - _SHOWN} more in {output}")
    told += [f"  {term.name} was left out: a curve goes beyond its last stretch" for term in found.left_out]
    return told
