"""Creep of a loaded beam: the rotation of the tip while the modulus relaxes."""

# The rotation theta of the tip represents the curvature of the whole beam, which is assumed to keep its distribution.
# With the relaxing shear modulus mu(t), the integral of mu(t - t') d theta(t') equals m(theta), the moment of the
# loads. Moments are divided by a constant of the beam in m³; their unit is Pa rad. Static solutions with several moduli
# mu give points of the function m(theta), because m = mu theta in equilibrium.

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.laws.prony import Prony

Array = NDArray[np.float64]

# The error of the constant distribution is measured in `tests/fitting/time` by finite elements with internal variables.
_FIRST_STEP_S = 2e-3  # length of the first time step after a change of the load
_STEPS_PER_DECADE = 8  # after the last change of the load
_EARLIER_STEPS_PER_DECADE = 4
_NEWTON_STEPS = 2
_NODES = 65  # of a curve


@dataclass(frozen=True)
class LoadCurve:
    """The moment of the loads on a beam as a function of the rotation of the tip."""

    # Moments are divided by a constant of the beam in m³ and have the unit Pa rad.

    # (m,): increasing rotations in rad.
    rotation: Array
    # (m,): moment at each rotation; in equilibrium it equals the shear modulus times the rotation.
    moment: Array
    # (m,): part of ``moment`` that is proportional to the magnetic field.
    of_field: Array

    @staticmethod
    def through(nominal: tuple[Array, Array], stronger: tuple[Array, Array], factor: float) -> LoadCurve:
        """Interpolate the moment of the loads from (tip rotations, moments) in a nominal and a stronger field."""
        # The stronger field is ``factor`` times the nominal one.
        # The difference gives the part of the moment that is due to the field.
        spline = _spline(*nominal)
        even = np.linspace(nominal[0].min(), nominal[0].max(), _NODES)
        moment = spline(even)
        if len(stronger[0]) < 2:
            return LoadCurve(even, moment, moment)

        more, of_more = stronger
        return LoadCurve(even, moment, _spline(more, (of_more - spline(more)) / (factor - 1))(even))

    @staticmethod
    def of_gravity(stiffness_Pa: float) -> LoadCurve:
        """Return a moment of gravity that is linear in the tip rotation: -stiffness_Pa * rotation, in Pa rad."""
        ends = np.array([-3.0, 3.0])
        return LoadCurve(ends, -stiffness_Pa * ends, 0 * ends)

    def at(self, rotation: Array) -> tuple[Array, Array]:
        """Return the moment of the loads on the beam, and its derivative, at many rotations of the tip in rad."""
        x, y, slopes = self.rotation, self.moment, self._slopes
        i = np.searchsorted(x[1:-1], rotation)
        return y[i] + slopes[i] * (rotation - x[i]), slopes[i]

    def at_even_rotations(self) -> LoadCurve:
        """Interpolate the moment of the loads at equally spaced rotations of the tip."""
        even = np.linspace(self.rotation[0], self.rotation[-1], _NODES)
        return LoadCurve(even, self.at(even)[0], np.interp(even, self.rotation, self.of_field))

    @cached_property
    def _slopes(self) -> Array:
        return np.asarray(np.diff(self.moment) / np.diff(self.rotation))


def _spline(x: Array, y: Array) -> Callable[[Array], Array]:
    """Return an interpolating spline, cubic if there are at least four points."""
    order = np.argsort(x)
    spline: Callable[[Array], Array] = scipy.interpolate.make_interp_spline(x[order], y[order], k=min(3, len(x) - 1))
    return spline


@dataclass(frozen=True)
class LoadStep:
    """Loads on a beam that act from a given time until the next loads begin."""

    # Time at which the loads begin.
    time_s: float
    # Their moment as a function of the rotation of the tip.
    curve: LoadCurve


def creep(
    instantaneous_Pa: Array,
    series: Prony,
    steps: tuple[LoadStep, ...],
    times_s: Array,
    load_factor: Array,
) -> Array:
    """Compute the rotation of the tip of a creeping beam over time for many candidate laws."""
    # ``instantaneous_Pa``, ``load_factor`` (P,): instantaneous shear moduli, and factors on the magnetic loads, of P
    # laws. ``times_s`` (m,): increasing times. The result is (P, m) in rad.
    return CreepHistories([(steps, times_s)]).rotations(instantaneous_Pa, series, load_factor)[0]


class CreepHistories:
    """The creep of a beam under several histories of loads. Inertia is neglected.

    Parameters
    ----------
    histories : sequence of (tuple of LoadStep, ndarray)
        For each history, the loads, and increasing times at which the rotation of the tip is computed.
    """

    def __init__(self, histories: Sequence[tuple[tuple[LoadStep, ...], Array]]) -> None:
        # The beam is at rest until the first load of a history, and all times lie after it.
        plans = [_plan(steps, times_s) for steps, times_s in histories]
        longest = max(len(plan.curves) for plan in plans)
        curves: list[LoadCurve] = []
        # A shorter history begins with a load that leaves the beam straight, until all histories have equally many
        # time steps.
        straight = LoadCurve.of_gravity(1.0)
        rows, spans, self._wanted = [], [], []
        for plan in plans:
            early = longest - len(plan.curves)
            row = []
            for curve in [straight] * early + plan.curves:
                index = next((i for i, one in enumerate(curves) if one is curve), len(curves))
                if index == len(curves):
                    curves.append(curve)
                row.append(index)
            rows.append(row)
            spans.append(np.concatenate([np.ones(early), plan.spans_s]))
            self._wanted.append(early + plan.wanted)
        self._spans_s = np.array(spans).T[:, :, None]  # (time steps, E, 1)
        # With equal spacing, the interval of a rotation is computed without a search.
        even = [curve.at_even_rotations() for curve in curves]
        starts = np.array([curve.rotation[0] for curve in even])
        per_rad = np.array([(len(curve.rotation) - 1) / np.ptp(curve.rotation) for curve in even])
        of_step = np.array(rows).T  # (time steps, E)
        self._first = starts[of_step][..., None]
        self._per_rad = per_rad[of_step][..., None]
        self._base = (of_step * (_NODES - 1))[..., None]
        rotations = np.stack([curve.rotation for curve in even])
        of_field = np.stack([curve.of_field for curve in even])
        self._of_field = _lines(rotations, of_field)
        self._others = _lines(rotations, np.stack([curve.moment for curve in even]) - of_field)

    def rotations(self, instantaneous_Pa: Array, series: Prony, load_factor: Array) -> list[Array]:
        """Compute the rotation of the tip over time for many candidate laws, in rad, for each history of loads."""
        # ``instantaneous_Pa``, ``load_factor`` (P,): instantaneous shear moduli, and factors on the magnetic loads, of
        # P laws. Each result is (P, m) for the m times of the history.
        steps = len(self._spans_s)
        rates, terms = (1 / series.tau_s).T[:, None], (instantaneous_Pa[:, None] * series.g).T[:, None]
        decays = self._spans_s[:, None] * rates  # (time steps, n, E, P)
        fadings = np.exp(-decays)
        shares = terms * (1 - fadings) / decays
        remembering = shares.sum(axis=1)
        stiffnesses = instantaneous_Pa * series.long_term + remembering
        softest = 1e-3 * stiffnesses
        overstress, theta = np.zeros(shares.shape[1:]), np.zeros(stiffnesses.shape[1:])
        every = np.empty((steps, *theta.shape))
        # Internal variables integrate the Prony series exactly for rotations that change linearly within a time step
        # (Simo and Hughes 1998, Computational Inelasticity, section 10.3).
        for j in range(steps):
            stiffness = stiffnesses[j]
            overstress *= fadings[j]
            remembered = overstress.sum(axis=0) - remembering[j] * theta
            new = theta
            for _ in range(_NEWTON_STEPS):
                node = ((new - self._first[j]) * self._per_rad[j]).astype(np.intp)
                np.minimum(np.maximum(node, 0, out=node), _NODES - 2, out=node)
                node += self._base[j]
                slope, crossing = self._others.take(node, axis=1) + load_factor * self._of_field.take(node, axis=1)
                gap = (stiffness - slope) * new + remembered - crossing
                new = new - gap / np.maximum(stiffness - slope, softest[j])
            overstress += shares[j] * (new - theta)
            theta = every[j] = new
        return [every[wanted, k].T for k, wanted in enumerate(self._wanted)]


def _lines(rotations: Array, moments: Array) -> Array:
    """Return the slope and the value at 0 of each line between neighbouring points of the load curves."""
    # ``rotations`` in rad and ``moments`` in Pa rad: (curves, lines + 1). The result is (2, curves * lines).
    slopes = np.diff(moments, axis=1) / np.diff(rotations, axis=1)
    return np.stack([slopes.ravel(), (moments[:, :-1] - slopes * rotations[:, :-1]).ravel()])


@dataclass(frozen=True)
class _Plan:
    """The time steps in which the creep of a beam is computed."""

    # (m,): duration of each step.
    spans_s: Array
    # Moment of the loads in each step.
    curves: list[LoadCurve]
    # Steps at whose ends the rotation is needed.
    wanted: NDArray[np.intp]


def _plan(steps: tuple[LoadStep, ...], times_s: Array) -> _Plan:
    ends: list[float] = []
    curves: list[LoadCurve] = []
    is_straight = True  # until a load bends the beam
    for k, step in enumerate(steps):
        last = k + 1 == len(steps)
        end = float(times_s[-1]) if last else steps[k + 1].time_s
        inside = times_s[(times_s > step.time_s) & ((times_s <= end) if last else (times_s < end))]
        end = max(end, step.time_s + _FIRST_STEP_S)
        is_straight &= bool(step.curve.at(np.zeros(1))[0] == 0)
        times = [*inside.tolist(), end] if is_straight else _ends_of_steps(step.time_s, end, inside, last)
        times = sorted(set(np.round(times, 9).tolist()))
        ends += times
        curves += [step.curve] * len(times)
    spans = np.maximum(np.diff(np.append(steps[0].time_s, ends)), 1e-9)
    return _Plan(spans, curves, np.searchsorted(np.array(ends) + 1e-8, times_s).clip(max=len(ends) - 1))


def _ends_of_steps(first: float, last: float, wanted: Array, is_last: bool) -> list[float]:
    """Return the ends of the integration steps in s between two changes of the load."""
    decades = max(np.log10((last - first) / _FIRST_STEP_S), 0.1)
    per_decade = _STEPS_PER_DECADE if is_last else _EARLIER_STEPS_PER_DECADE
    regular = first + np.geomspace(_FIRST_STEP_S, last - first, int(np.ceil(decades * per_decade)) + 1)
    # The load acts at once: after the short first step the beam has its elastic rotation.
    return [float(time) for time in np.unique(np.concatenate([[first + 1e-6], regular, wanted]).round(9))]
