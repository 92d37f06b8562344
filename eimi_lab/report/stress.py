"""Stress against strain in uniaxial tension: what each fit says of it, and the tensile tests themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.materials import LAWS
from eimi_fitting.tensile import engineering_stress
from eimi_lab.errors import InputError
from eimi_lab.identification.records import FitRecord, TensileRecord
from eimi_lab.identification.tensile import read_tensile
from eimi_lab.report.shown import ShownFit

Array = NDArray[np.float64]

_LARGEST_STRAIN = 1.0  # drawn; silicones tear at ten times that, and bending reaches a tenth
_BENDING_ALONE = 3.0  # how far beyond the bent specimen's largest strain to draw where there is no tensile fit
_SAME_MODULUS = 0.01
BAND = (
    "Bands of tensile fits: 95 %, from the covariance of their parameters, as far as their data went. Bands of bending "
    "fits: the outermost of each parameter at the ends of its 95 % interval, the initial shear modulus held, and of "
    "that modulus at the ends of its own."
)


@dataclass(frozen=True)
class StressCurve:
    """A fit's engineering stress (m,) in Pa at engineering strains (m,), its band (m, 2), how far its data reached."""

    shown: ShownFit
    strain: Array
    stress_Pa: Array
    band_Pa: Array

    @property
    def reached(self) -> float:
        """The largest engineering strain in the fit's data, of a tensile curve in a bending fit as well."""
        fit = self.shown.fit
        curves = fit.tensile if isinstance(fit, FitRecord) else ()
        windows = [np.inf if c.window_percent is None else c.window_percent / 100 for c in curves]
        return max([fit.max_stretch - 1, *windows])


@dataclass(frozen=True)
class TensilePoints:
    """The rows of a tensile test as far as they are drawn."""

    label: str
    strain: Array
    stress_Pa: Array


def bending_strain(every: Sequence[ShownFit]) -> float | None:
    """The largest engineering strain that a bent specimen reached in any fit; None without such a fit."""
    return max((s.fit.max_stretch - 1 for s in every if isinstance(s.fit, FitRecord)), default=None)


def stress_curves(every: Sequence[ShownFit]) -> list[StressCurve]:
    """Uniaxial tension up to the largest strain of the tensile fits, or a little beyond what bending reached."""
    tensile = [s.fit.max_stretch - 1 for s in every if isinstance(s.fit, TensileRecord)]
    largest = min(max(tensile), _LARGEST_STRAIN) if tensile else _BENDING_ALONE * (bending_strain(every) or 0.0)
    strain = np.linspace(0, largest, 201)
    return [_curve(shown, strain) for shown in every]


def _curve(shown: ShownFit, strain: Array) -> StressCurve:
    fit = shown.fit
    law, values = LAWS[fit.model], np.array(fit.values())
    stress = engineering_stress(law, values, strain)
    if isinstance(fit, TensileRecord):
        half = _half_width_of(fit, strain)
        return StressCurve(shown, strain, stress, np.stack([stress - half, stress + half], axis=1))
    outermost = engineering_stress(law, np.stack([values, *_ends_of(fit)]), strain)
    return StressCurve(shown, strain, stress, np.stack([outermost.min(axis=0), outermost.max(axis=0)], axis=1))


def _half_width_of(fit: TensileRecord, strain: Array) -> Array:
    """(m,): half of the 95 % interval of the stress, linearised in the parameters; NaN without their correlation."""
    if fit.correlation is None:
        return np.full(len(strain), np.nan)
    law, values = LAWS[fit.model], np.array(fit.values())
    half = np.array([0.5 * (q.interval_95[1] - q.interval_95[0]) for q in fit.parameters.values()])
    step = np.diag(1e-4 * np.maximum(np.abs(values), half))
    slopes = engineering_stress(law, values + step, strain) - engineering_stress(law, values - step, strain)
    slopes *= (half / (2 * np.diag(step)))[:, None]
    return np.sqrt(np.maximum(np.einsum("im,ij,jm->m", slopes, np.array(fit.correlation), slopes), 0.0))


def _ends_of(fit: FitRecord) -> list[Array]:
    """Parameters (n,) with the modulus at an end of its interval, or a parameter, the other moduli scaled to keep it.

    An end that the others cannot make up for within their own intervals is left out.
    """
    law, values = LAWS[fit.model], np.array(fit.values())
    modulus = fit.initial_shear_modulus
    low, high = np.array([quantity.interval_95 for quantity in fit.parameters.values()]).T
    moduli = np.array([unit == "Pa" for unit in law.units])
    ends = [np.where(moduli, end / modulus.value, 1.0) * values for end in modulus.interval_95]
    for i, side in product(range(len(values)), (low, high)):
        others = moduli & (np.arange(len(values)) != i)
        moved = values.copy()
        moved[i] = side[i]
        # The initial shear modulus is linear in the moduli.
        held = float(law.initial_shear_modulus(np.where(others, 0.0, moved)))
        rest = float(law.initial_shear_modulus(moved)) - held
        if rest != 0:
            moved = np.where(others, np.clip((modulus.value - held) / rest * moved, low, high), moved)
        if abs(float(law.initial_shear_modulus(moved)) / modulus.value - 1) < _SAME_MODULUS:
            ends.append(moved)
    return ends


def tensile_points(every: Sequence[ShownFit], largest_strain: float) -> tuple[list[TensilePoints], list[str]]:
    """The tensile tests behind the fits, each once, and a sentence for each thing that cannot be drawn."""
    points = []
    missing = [
        f"{s.path} is of an earlier release and holds no correlation of the parameters: no band for {s.label}."
        for s in every
        if isinstance(s.fit, TensileRecord) and s.fit.correlation is None
    ]
    sources = [(s.fit.source.path, s.fit.source.sha256) for s in every if isinstance(s.fit, TensileRecord)]
    sources += [(c.path, c.sha256) for s in every if isinstance(s.fit, FitRecord) for c in s.fit.tensile]
    for name, sha256 in dict.fromkeys(sources):
        path = Path(name)
        try:
            test = read_tensile(path)
        except InputError as error:
            missing.append(f"The tensile test is not drawn: {error}.")
            continue
        if test.sha256 != sha256:
            missing.append(f"The tensile test is not drawn: {path} has changed since it was fitted.")
            continue
        drawn = test.strain <= largest_strain
        points.append(TensilePoints(path.name, test.strain[drawn], test.stress_Pa[drawn]))
    return points, missing
