"""Write fits as material cards of other programs: the work of `eimi export`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.cards import INSTANTANEOUS, SOLVERS, Material, NotInSolver, material_card
from eimi_fitting.laws.prony import Prony
from eimi_lab.fits.law_record import HELD
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import LawOfTime, RingDownRecord
from eimi_lab.process.errors import InputError

AnyFit = FitRecord | TensileRecord | RingDownRecord


def check_solver(solver: str) -> str:
    """Check the name of a finite-element program, and return it. Raises InputError if there are no cards for it."""
    if solver not in SOLVERS:
        raise InputError(f"--to {solver}: should be one of {', '.join(SOLVERS)}")
    return solver


def choose_fit(path: Path, fits: Sequence[AnyFit], model: str, index: int | None) -> AnyFit:
    """Return the fit of a law from the fits of a file.

    Parameters
    ----------
    path : Path
        File, for messages.
    fits : sequence of FitRecord or TensileRecord
        Fits in the file.
    model : str
        Name of the law.
    index : int or None
        Index of the fit in the file; None if the file has one fit of the law.

    Raises
    ------
    InputError
        If no fit matches, or if several fits match.
    """
    of_model = {i: fit for i, fit in enumerate(fits) if fit.model == model}
    in_file = ", ".join(f"{i} ({fit.model}{_window(fit)})" for i, fit in enumerate(fits))
    if not of_model:
        raise InputError(f"{path}: --model {model}: should be one of the file's fits: {in_file}")
    if index is None and len(of_model) > 1:
        choices = ", ".join(f"--index {i} ({fit.model}{_window(fit)})" for i, fit in of_model.items())
        raise InputError(f"{path}: holds {len(of_model)} fits of the law {model}; give one of {choices}")
    chosen = next(iter(of_model)) if index is None else index
    if chosen not in of_model:
        raise InputError(f"{path}: --index {chosen}: should be the index of a {model} fit; the file contains {in_file}")
    return of_model[chosen]


def _window(fit: AnyFit) -> str:
    return f", window {fit.window()}" if isinstance(fit, TensileRecord) else ""


def bulk_modulus_Pa(fit: AnyFit, solver: str, bulk_modulus_kPa: float | None, bulk_ratio: float | None) -> float:
    """Return the bulk modulus (Pa), from a value in kPa or from the ratio of bulk modulus to initial shear modulus.

    The initial shear modulus is that of the card for the program `solver`.

    Raises
    ------
    InputError
        If neither or both of `bulk_modulus_kPa` and `bulk_ratio` are given, or if the given number is not positive.
    """
    if (bulk_modulus_kPa is None) == (bulk_ratio is None):
        raise InputError(
            "give either --bulk-modulus-kPa or --bulk-ratio (bulk modulus divided by initial shear modulus, such as "
            "2000), because a card needs a bulk modulus, which is never taken from a fit"
        )
    name, stated = (
        ("--bulk-ratio", bulk_ratio) if bulk_modulus_kPa is None else ("--bulk-modulus-kPa", bulk_modulus_kPa)
    )
    if stated is None or not 0 < stated < np.inf:
        raise InputError(f"{name} {stated}: should be a finite number above 0")
    return stated * (_shear_modulus_Pa(fit, solver) if bulk_modulus_kPa is None else 1e3)


def _time(fit: AnyFit) -> LawOfTime | None:
    return None if isinstance(fit, TensileRecord) else fit.time


def _series(time: LawOfTime) -> Prony:
    return Prony(np.array([term.g for term in time.prony]), np.array([term.tau_s for term in time.prony]))


def _shear_modulus_Pa(fit: AnyFit, solver: str) -> float:
    """Return the initial shear modulus in the card of a fit: that of the fit, instantaneous, or of the long term."""
    time = _time(fit)
    if time is None:
        return fit.initial_shear_modulus.value
    instantaneous = time.instantaneous_shear_modulus.value
    return instantaneous if solver in INSTANTANEOUS else instantaneous * float(_series(time).long_term)


def card(path: Path, fit: AnyFit, solver: str, bulk_Pa: float) -> str:
    """Return the material card of a fit (the input of a finite-element program) as text.

    Raises InputError if the program lacks the law, or if the bulk modulus is wrong.
    """
    material = Material(
        LAWS[fit.model],
        np.array(fit.values()),
        bulk_Pa,
        re.sub(r"[^A-Za-z0-9_-]", "_", f"EIMI_{fit.model}").upper().replace("-", "_"),
        tuple(_origin(path, fit, solver)),
    )
    time = _time(fit)
    if time is not None:
        # The proportions of the parameters are those of the fit, their size is that of the instantaneous modulus.
        factor = time.instantaneous_shear_modulus.value / fit.initial_shear_modulus.value
        is_modulus = np.array([unit == "Pa" for unit in material.law.units])
        parameters = np.where(is_modulus, factor * material.parameters, material.parameters)
        material = replace(material, parameters=parameters, relaxation=_series(time))
    try:
        return material_card(solver, material)
    except (NotInSolver, ValueError) as error:
        raise InputError(f"{path}: {fit.model}: {error}") from error


def _origin(path: Path, fit: AnyFit, solver: str) -> list[str]:
    """Return the comment lines of a material card: data, largest strain, intervals and doubts."""
    lines = fit.caveats()
    if _time(fit) is not None:
        of_fit = fit.initial_shear_modulus.value
        lines.insert(
            0,
            f"the moduli above are {_shear_modulus_Pa(fit, solver) / of_fit:.4g} times those of the fit, whose initial "
            f"shear modulus is {of_fit:.6g} Pa; the intervals below are those of the fit",
        )
    held = fit.held_by_bounds()
    for name, quantity in fit.parameters.items():
        low, high = (end + 0.0 for end in quantity.interval_95)  # no negative zeros
        unit = "" if quantity.unit == "1" else f" {quantity.unit}"
        lines.append(f"{name} 95 % interval {low:.6g} to {high:.6g}{unit}{', ' + HELD if name in held else ''}")
    if isinstance(fit, TensileRecord):
        lines.append(f"fitted to a uniaxial test up to a largest principal stretch of {fit.max_stretch:.4g}")
        lines.append(f"from {fit.source.path} (sha256 {fit.source.sha256}), window {fit.window()}")
    elif isinstance(fit, RingDownRecord):
        lines += [f"from {d.in_words()} (sha256 {d.sha256}), {d.section}" for d in fit.datasets]
    else:
        lines.append(f"fitted to bending up to a largest principal stretch of {fit.max_stretch:.4g}")
        lines += [f"from {d.in_words()} (sha256 {d.sha256}), {d.section}" for d in fit.datasets]
        lines += [f"and from the tensile test {c.name} (sha256 {c.sha256})" for c in fit.tensile]
    lines.append(f"taken from {path.name} by eimi-lab {fit.versions.get('eimi-lab', '')}".rstrip())
    return lines
