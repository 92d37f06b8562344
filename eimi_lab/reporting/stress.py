"""Compute stress against strain of each fit in three modes of deformation, and read the tensile tests.

The modes are uniaxial tension, planar tension and simple shear of an incompressible material.
"""

# The three modes are uniaxial tension, planar tension and simple shear of an incompressible material. In each mode, the
# deformation depends on one number, the strain e. The logarithmic principal stretches are h_i = r_i h(e), with constant
# ratios r_i whose sum is 0, because the volume is constant. The work done per volume is the strain energy W, so that
# the engineering stress is
#
#     dW/de = h'(e) Σ r_i ∂W/∂h_i
#
# where h' is the derivative of h, and the sum is over the three principal directions i (R. W. Ogden, Non-Linear Elastic
# Deformations, 1984, section 4.3).

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.law import Law
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.process.errors import InputError
from eimi_lab.reporting.shown import ShownFit

Array = NDArray[np.float64]

_LARGEST_STRAIN = 1.0  # largest strain in a figure
_BENDING_ALONE = 3.0  # without a tensile fit, the figure ends at this multiple of the largest strain in bending
_DRAWS = 200  # draws per fit, evenly spread over the modulus: enough for an interval of 95 %
BAND = (
    "Bands contain 95 % of the laws that were drawn at random within the uncertainty of each fit. The bands of "
    "tensile fits end where the data end."
)


@dataclass(frozen=True)
class Mode:
    """A mode of deformation of an incompressible material: uniaxial tension, planar tension or simple shear.

    The logarithms of the three principal stretches are r_1 h(e), r_2 h(e) and r_3 h(e): e is the strain, r_i are
    constant ratios, and h is a function.

    Attributes
    ----------
    words : str
        Name of the mode.
    strain : str
        Name of the strain e, for the axis of a figure.
    ratios : tuple of float
        The ratios r_1, r_2 and r_3; r_1 is 1.
    log, slope : callable
        Functions that return h(e) and its derivative h'(e) at m strains e, shape (m,).
    """

    words: str
    strain: str
    ratios: tuple[float, float, float]
    log: Callable[[Array], Array]
    slope: Callable[[Array], Array]

    def at_stretch(self, stretch: float) -> float:
        """Return the strain of a deformation of this mode whose largest principal stretch is `stretch`."""
        return stretch - 1 / stretch if self.strain == "shear" else stretch - 1

    def stress_Pa(self, law: Law, parameters: Array, strain: Array) -> Array:
        """Return the engineering stress of a law in Pa at m strains, shape (..., m).

        `parameters` has the shape (..., n) for the n parameters of the law.
        """
        stretches = np.exp(np.outer(self.log(strain), self.ratios))
        _, gradient, _ = law.principal(np.asarray(parameters)[..., None, :], stretches)
        return np.asarray(gradient @ np.array(self.ratios) * self.slope(strain))


def _inverse(strain: Array) -> Array:
    return np.asarray(1 / (1 + strain))


UNIAXIAL = Mode("uniaxial tension", "strain", (1.0, -0.5, -0.5), np.log1p, _inverse)
PLANAR = Mode("planar tension", "strain", (1.0, -1.0, 0.0), np.log1p, _inverse)
# The principal stretches of a simple shear s are exp(h), exp(-h) and 1, with 2 sinh(h) = s.
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
    """The stress of a fit against strain in one mode of deformation.

    The fields are m strains, shape (m,), the stresses in Pa, shape (m,), and the ends of the 95 % intervals of the
    stresses in Pa, shape (m, 2).
    """

    shown: ShownFit
    mode: Mode
    strain: Array
    stress_Pa: Array
    band_Pa: Array


@dataclass(frozen=True)
class TensilePoints:
    """The m points of a tensile test in a range of strain: strain, shape (m,), and stress in Pa, shape (m,)."""

    label: str
    strain: Array
    stress_Pa: Array


def bending_strain(fits: Sequence[ShownFit]) -> float | None:
    """Return the largest engineering strain in the data of any bending fit; None without a bending fit."""
    return max((s.fit.max_stretch - 1 for s in fits if isinstance(s.fit, FitRecord)), default=None)


def largest_strain(fits: Sequence[ShownFit]) -> float:
    """Return the largest strain on the axis of the plot of stress against strain."""
    tensile = [s.fit.max_stretch - 1 for s in fits if isinstance(s.fit, TensileRecord)]
    return min(max(tensile), _LARGEST_STRAIN) if tensile else _BENDING_ALONE * (bending_strain(fits) or 0.0)


def reached(shown: ShownFit, mode: Mode) -> float:
    """Return the strain in a mode of deformation at the largest stretch in the data of a fit."""
    return mode.at_stretch(shown.fit.stretch_reached)


def stress_curve(shown: ShownFit, strain: Array, mode: Mode = UNIAXIAL) -> StressCurve:
    """Return the stress of a fit at m strains, shape (m,), with the 95 % intervals of the stress."""
    fit = shown.fit
    law, drawn = LAWS[fit.model], fit.drawn(_DRAWS)
    stress = mode.stress_Pa(law, np.array(fit.values()), strain)
    band = np.full((2, len(strain)), np.nan)
    if len(drawn):
        band = np.quantile(mode.stress_Pa(law, drawn, strain), [0.025, 0.975], axis=0)
    return StressCurve(shown, mode, strain, stress, band.T)


def tensile_points(fits: Sequence[ShownFit], largest_strain: float) -> tuple[list[TensilePoints], list[str]]:
    """Read each tensile test to which a law was fitted, up to the largest strain of the figure.

    Parameters
    ----------
    fits : sequence of ShownFit
        All fits of the report.
    largest_strain : float
        The engineering strain at which the figure ends.

    Returns
    -------
    points : list of TensilePoints
        The tests that could be read.
    missing : list of str
        A sentence for each test, and for each 95 % interval, that cannot be drawn.
    """
    points = []
    missing = [
        f"{s.path} was written by an earlier release and holds no draws: the figure has no band for {s.label}."
        for s in fits
        if not s.fit.draws
    ]
    sources = [(s.fit.source.path, s.fit.source.sha256) for s in fits if isinstance(s.fit, TensileRecord)]
    curves = [c for s in fits if isinstance(s.fit, FitRecord) for c in s.fit.tensile]
    sources += [(c.path, c.sha256) for c in curves if c.path]
    missing += [
        f"{name} is not drawn, because its numbers are in no file."
        for name in dict.fromkeys(c.name for c in curves if not c.path)
    ]
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
        drawn = (test.strain >= 0) & (test.strain <= largest_strain)
        if not (drawn & (test.strain > 0)).any():
            missing.append(f"{path.name} is not drawn, because it has no strain in the range of the figure.")
            continue
        points.append(TensilePoints(path.name, test.strain[drawn], test.stress_Pa[drawn]))
    return points, missing
