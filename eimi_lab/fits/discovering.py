"""Discover the terms of the strain energy of a material from datasets and tensile tests, for `eimi discover`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eimi_fitting.discovery.bending_rows import NoEquilibrium
from eimi_fitting.discovery.terms_of_a_law import LIBRARY, Alternative, Discovery, UnusableLibrary, discover
from eimi_fitting.laws import CannotFit
from eimi_fitting.laws.sum_of_terms import SumOfTerms, Term
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.fitting import REFUSALS, check_evidence, refused
from eimi_lab.fits.records import package_versions
from eimi_lab.fits.tensile_files import FileCurve
from eimi_lab.process.errors import InputError

_SHOWN = 12  # alternatives that are printed


def discovered(evidence: Sequence[Evidence], curves: Sequence[FileCurve], **options: Any) -> Discovery:
    """Discover which terms of the strain energy the law of a material needs.

    Parameters
    ----------
    evidence : sequence of Evidence
        Datasets of bending beams.
    curves : sequence of FileCurve
        Tensile curves.
    **options
        Options of `eimi_fitting.discovery.terms_of_a_law.discover`.

    Raises
    ------
    InputError
        If the data cannot be used, or if an option is wrong.
    """
    if not evidence and not curves:
        raise InputError("discover: datasets is an empty list; give at least one dataset or one tensile curve")
    check_evidence(evidence)
    try:
        return discover([dataset.experiment for dataset in evidence], curves, **options)
    except CannotFit as error:
        names = ", ".join(curve.path for curve in curves) or _names(evidence)
        raise InputError(f"{names}: {error}") from error
    except REFUSALS as error:
        raise refused(error, evidence) from error
    except NoEquilibrium as error:
        raise InputError(
            f"{_names(evidence)}: the beam has no equilibrium with the law fitted to the tensile curves"
        ) from error
    except UnusableLibrary as error:
        raise InputError(f"--term: {error}") from error


def _names(evidence: Sequence[Evidence]) -> str:
    return ", ".join(str(dataset.path) for dataset in evidence)


def library_of(names: Sequence[str]) -> tuple[Term, ...]:
    """Return the terms of the strain energy with these names; all known terms if there are no names.

    Raises InputError for a wrong name.
    """
    try:
        return tuple(Term.of(name) for name in names) or LIBRARY
    except ValueError as error:
        raise InputError(f"--term {error}") from error


def content(
    discovery: Discovery, evidence: Sequence[Evidence], curves: Sequence[FileCurve], **numbers: float
) -> dict[str, Any]:
    """Return the content of discovery.json: the discovered terms of a law, and further entries from `numbers`."""
    return {
        "statement": discovery.statement,
        "identified": discovery.identified,
        "alternatives": [_alternative(alternative) for alternative in discovery.alternatives],
        "terms_in_all": [term.name for term in discovery.in_all],
        "terms_that_could_be_there": {term.name: share for term, share in discovery.open_terms.items()},
        "at_strain": discovery.strain,
        "library": [{"term": term.name, "energy": term.formula} for term in discovery.library],
        "terms_left_out": [term.name for term in discovery.left_out],
        "sets_in_play": [[term.name for term in terms] for terms in discovery.compatible_sets],
        "sets_fitted": discovery.sets,
        "datasets": [
            {"path": str(one.path), "sha256": one.sha256, "noise_mm": noise, "taken_as_exact": one.taken_as_exact}
            for one, noise in zip(evidence, discovery.noise_mm, strict=True)
        ],
        "tensile": [
            {"path": curve.path, "sha256": curve.sha256, "window_percent": curve.window_percent, "noise_Pa": noise}
            for curve, noise in zip(curves, discovery.noise_Pa, strict=True)
        ],
        **numbers,
        "versions": package_versions(),
    }


def _alternative(law: Alternative) -> dict[str, Any]:
    names = SumOfTerms(law.terms).parameter_names
    return {
        "terms": [term.name for term in law.terms],
        "coefficients_Pa": dict(zip(names, law.coefficients.tolist(), strict=True)),
        "intervals_95_Pa": dict(zip(names, law.intervals.tolist(), strict=True)),
        "initial_shear_modulus_Pa": law.initial_shear_modulus_Pa,
        "held_out_error_over_noise": law.held_out_error,
        "stable_to": law.stable_to,
    }


def lines(discovery: Discovery, output: Path) -> list[str]:
    """Return the lines that `eimi discover` prints about the discovered law and its alternatives.

    `output` is the file that lists all alternatives.
    """
    printed = [discovery.statement]
    for law in discovery.alternatives[:_SHOWN]:
        names = SumOfTerms(law.terms).parameter_names
        parts = [
            f"{name} {c / 1e3:.4g} kPa, 95 % interval {low / 1e3:.4g} to {high / 1e3:.4g} kPa"
            for name, c, (low, high) in zip(names, law.coefficients, law.intervals, strict=True)
        ]
        printed.append(
            f"  {', '.join(parts)}; the error on data that were left out of the fit is {law.held_out_error:.2f} times "
            "the noise"
        )
    if len(discovery.alternatives) > _SHOWN:
        printed.append(f"  and {len(discovery.alternatives) - _SHOWN} further laws in {output}")
    printed += [
        f"  the term {term.name} was left out, because a curve exceeds the limiting stretch of this term"
        for term in discovery.left_out
    ]
    return printed
