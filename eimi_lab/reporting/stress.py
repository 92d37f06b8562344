"""Stress against strain: what each fit says of it in three ways of stretching, and the tensile tests themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.law import Law
from eimi_lab.fits.records import FitRecord, TensileRecord
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.process.errors import InputError
from eimi_lab.reporting.shown import ShownFit

Array = NDArray[np.float64]

_LARGEST_STRAIN = 1.0  # drawn; silicones tear at ten times that, and bending reaches a tenth
_BENDING_ALONE = 3.0  # how far beyond the bent specimen's largest strain to draw where there is no tensile fit
_DRAWS = 200  # of a fit's, evenly over the modulus: enough for the ends of 95 %
BAND = "Bands: 95 % of the draws of each fit, of tensile fits as far as their data went."


@dataclass(frozen=True)
class Mode:
    """A way of stretching an incompressible law, and the stress that its energy gives by the chain rule.

    ratios: of the three logarithmic strains to the first; log, slope: the first one of strains (m,) and its derivative.
    """

    words: str
    strain: str
    ratios: tuple[float, float, float]
    log: Callable[[Array], Array]
    slope: Callable[[Array], Array]

    def at_stretch(self, stretch: float) -> float:
        """The strain at which the largest principal stretch is this."""
        return stretch - 1 / stretch if self.strain == "shear" else stretch - 1

    def stress_Pa(self, law: Law, parameters: Array, strain: Array) -> Array:
        """Engineering stress of parameters (..., n) at strains (m,): (..., m)."""
        stretches = np.exp(np.outer(self.log(strain), self.ratios))
        _, gradient, _ = law.principal(np.asarray(parameters)[..., None, :], stretches)
        return np.asarray(gradient @ np.array(self.ratios) * self.slope(strain))


def _inverse(strain: Array) -> Array:
    return np.asarray(1 / (1 + strain))


UNIAXIAL = Mode("uniaxial tension", "strain", (1.0, -0.5, -0.5), np.log1p, _inverse)
PLANAR = Mode("planar tension", "strain", (1.0, -1.0, 0.0), np.log1p, _inverse)
# A simple shear by s turns, and stretches by exp(h) with 2 sinh(h) = s.
SHEAR = Mode(
    "simple shear",
    "shear",
    (1.0, -1.0, 0.0),
    lambda strain: np.arcsinh(0.5 * strain),
    lambda strain: 0.5 / np.sqrt(1 + 0.25 * strain**2),
)
MODES = (UNIAXIAL, PLANAR, SHEAR)


@dataclass(frozen=True)
class StressCurve:
    """A fit's engineering stress (m,) in Pa at strains (m,) in one mode, and its band (m, 2)."""

    shown: ShownFit
    mode: Mode
    strain: Array
    stress_Pa: Array
    band_Pa: Array


@dataclass(frozen=True)
class TensilePoints:
    """The rows of a tensile test as far as they are drawn."""

    label: str
    strain: Array
    stress_Pa: Array


def bending_strain(every: Sequence[ShownFit]) -> float | None:
    """The largest engineering strain that a bent specimen reached in any fit; None without such a fit."""
    return max((s.fit.max_stretch - 1 for s in every if isinstance(s.fit, FitRecord)), default=None)


def largest_strain(every: Sequence[ShownFit]) -> float:
    """How far to draw: up to the largest strain of the tensile fits, or a little beyond what bending reached."""
    tensile = [s.fit.max_stretch - 1 for s in every if isinstance(s.fit, TensileRecord)]
    return min(max(tensile), _LARGEST_STRAIN) if tensile else _BENDING_ALONE * (bending_strain(every) or 0.0)


def reached(shown: ShownFit, mode: Mode) -> float:
    """The strain of this mode at the largest stretch in the fit's data, of a tensile curve in a bending fit too."""
    curves = shown.fit.tensile if isinstance(shown.fit, FitRecord) else ()
    return mode.at_stretch(max([shown.fit.max_stretch, *(1 + curve.largest_strain for curve in curves)]))


def stress_curve(shown: ShownFit, strain: Array, mode: Mode = UNIAXIAL) -> StressCurve:
    """A fit's stress at strains (m,), with the band of its draws; without any, the band is NaN."""
    fit = shown.fit
    law, drawn = LAWS[fit.model], fit.drawn(_DRAWS)
    stress = mode.stress_Pa(law, np.array(fit.values()), strain)
    band = np.full((2, len(strain)), np.nan)
    if len(drawn):
        band = np.quantile(mode.stress_Pa(law, drawn, strain), [0.025, 0.975], axis=0)
    return StressCurve(shown, mode, strain, stress, band.T)


def tensile_points(every: Sequence[ShownFit], largest_strain: float) -> tuple[list[TensilePoints], list[str]]:
    """The tensile tests behind the fits, each once, and a sentence for each thing that cannot be drawn."""
    points = []
    missing = [
        f"{s.path} is of an earlier release and holds no draws: no band for {s.label}."
        for s in every
        if not s.fit.draws
    ]
    sources = [(s.fit.source.path, s.fit.source.sha256) for s in every if isinstance(s.fit, TensileRecord)]
    curves = [c for s in every if isinstance(s.fit, FitRecord) for c in s.fit.tensile]
    sources += [(c.path, c.sha256) for c in curves if c.path]
    missing += [f"Not drawn: {name}." for name in dict.fromkeys(c.name for c in curves if not c.path)]
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
