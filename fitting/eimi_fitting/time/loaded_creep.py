"""Creep of a loaded beam: the rotation of the tip while the modulus relaxes.

The rotation theta of the tip represents the curvature of the whole beam. The moment of the material is the integral of
mu(t - t') d theta(t'), with the relaxing shear modulus mu(t). This moment is in equilibrium with the moment m(theta) of
the loads. Both moments have the unit Pa rad. The function m(theta) is computed from static solutions with several
moduli. With the modulus mu the tip rotates by theta(mu), and therefore m = mu theta(mu). Without a field m = -k theta,
with the stiffness k of gravity in Pa (`LoadCurve.of_gravity`).

The method assumes that the curvature keeps its distribution along the beam and changes only by a factor. The error of
this assumption is measured in `tests/fitting/time` by comparison with finite elements with internal variables.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.laws.prony import Prony

Array = NDArray[np.float64]

_FIRST_STEP_S = 2e-3  # length of the first time step after a change of the load
_STEPS_PER_DECADE = 8  # after the last change of the load
_EARLIER_STEPS_PER_DECADE = 4
_NEWTON_STEPS = 2
_NODES = 65  # of a curve


@dataclass(frozen=True)
class LoadCurve:
    """The moment of the loads on a beam in one state, as a function of the rotation theta of the tip.

    Attributes
    ----------
    rotation : ndarray, shape (m,)
        Rotations theta in rad, increasing.
    moment : ndarray, shape (m,)
        Moments mu theta in Pa rad. With the modulus mu the tip rotates by theta in equilibrium; see the module
        `time.loaded_creep`.
    """

    rotation: Array
    moment: Array

    @staticmethod
    def through(rotation: Array, moment: Array) -> LoadCurve:
        """Return the curve through the moments (Pa rad) at a few rotations (rad), by a cubic spline."""
        order = np.argsort(rotation)
        if len(order) < 4:
            return LoadCurve(rotation[order], moment[order])
        even = np.linspace(rotation[order[0]], rotation[order[-1]], _NODES)
        return LoadCurve(even, scipy.interpolate.CubicSpline(rotation[order], moment[order])(even))

    @staticmethod
    def of_gravity(stiffness_Pa: float) -> LoadCurve:
        """Return the curve of a beam without a field: moment = -stiffness * rotation.

        stiffness_Pa: stiffness of gravity against a rotation of the tip, in Pa.
        """
        ends = np.array([-3.0, 3.0])
        return LoadCurve(ends, -stiffness_Pa * ends)

    def at(self, rotation: Array) -> tuple[Array, Array]:
        """Return the moments (Pa rad) and the derivatives of the moments (Pa) at P rotations in rad, (P,) each.

        Beyond its ends the curve continues as a straight line.
        """
        x, y, slopes = self.rotation, self.moment, self._slopes
        i = np.searchsorted(x[1:-1], rotation)
        return y[i] + slopes[i] * (rotation - x[i]), slopes[i]

    @cached_property
    def _slopes(self) -> Array:
        return np.asarray(np.diff(self.moment) / np.diff(self.rotation))


@dataclass(frozen=True)
class LoadStep:
    """Loads on a beam that begin at the time ``time_s`` and act until the next loads begin.

    Attributes
    ----------
    time_s : float
        Time in s at which the loads begin.
    curve : LoadCurve
        The moment of the loads as a function of the rotation of the tip.
    """

    time_s: float
    curve: LoadCurve


def creep(
    instantaneous_Pa: Array,
    series: Prony,
    steps: tuple[LoadStep, ...],
    times_s: Array,
    load_factor: Array,
) -> Array:
    """Return the rotation of the tip at m times for P candidate laws, (P, m) in rad.

    Internal variables integrate the Prony series exactly for rotations that change linearly within a time step (Simo
    and Hughes 1998, Computational Inelasticity, section 10.3). Inertia is neglected.

    Parameters
    ----------
    instantaneous_Pa : ndarray, shape (P,)
        Instantaneous shear modulus of each candidate.
    series : Prony
        A Prony series with n terms for each candidate, (P, n).
    steps : tuple of LoadStep
        The loads in the order of time. The beam is at rest before the first loads.
    times_s : ndarray, shape (m,)
        Increasing times in s after the first of ``steps``.
    load_factor : ndarray, shape (P,)
        Factor on the moments of all loads, for each candidate.

    Returns
    -------
    ndarray, shape (P, m)
        The rotations in rad.
    """
    p, n = series.g.shape
    terms, rates, ones = instantaneous_Pa[:, None] * series.g, 1 / series.tau_s, np.ones(n)
    long_term = instantaneous_Pa * series.long_term
    overstress, theta = np.zeros((p, n)), np.zeros(p)
    result = np.empty((p, len(times_s)))
    wanted = 0
    for k, step in enumerate(steps):
        end = steps[k + 1].time_s if k + 1 < len(steps) else float(times_s[-1])
        last = k + 1 == len(steps)
        inside = times_s[(times_s > step.time_s) & ((times_s <= end) if last else (times_s < end))]
        now = step.time_s
        for time in _moments(step.time_s, max(end, step.time_s + _FIRST_STEP_S), inside, last):
            span = max(time - now, 1e-9)
            fading = np.exp(-span * rates)
            share = terms * (1 - fading) / (span * rates)
            stiffness = long_term + share @ ones
            overstress *= fading
            remembered = (overstress - share * theta[:, None]) @ ones
            new = theta.copy()
            for _ in range(_NEWTON_STEPS):
                moment, slope = step.curve.at(new)
                gap = stiffness * new + remembered - load_factor * moment
                new = new - gap / np.maximum(stiffness - load_factor * slope, 1e-3 * stiffness)
            overstress += share * (new - theta)[:, None]
            theta, now = new, time
            while wanted < len(times_s) and times_s[wanted] <= time + 1e-8:
                result[:, wanted] = theta
                wanted += 1
    result[:, wanted:] = theta[:, None]
    return result


def _moments(first: float, last: float, wanted: Array, is_last: bool) -> list[float]:
    """Return the times in s at which the integration steps end; they are close together after a change of the load.

    The result includes all times in ``wanted``.
    """
    decades = max(np.log10((last - first) / _FIRST_STEP_S), 0.1)
    per_decade = _STEPS_PER_DECADE if is_last else _EARLIER_STEPS_PER_DECADE
    regular = first + np.geomspace(_FIRST_STEP_S, last - first, int(np.ceil(decades * per_decade)) + 1)
    # The load acts at once: after the short first step the beam has its elastic rotation.
    return [float(time) for time in np.unique(np.concatenate([[first + 1e-6], regular, wanted]).round(9))]
