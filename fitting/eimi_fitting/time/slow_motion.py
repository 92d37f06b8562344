"""The slow rotation of a beam's tip after a step of its load.

The measured displacements of points are divided by their displacements for a rotation of the tip by one rad. The fitted
vibrations are subtracted, and the remaining motion is averaged over at least one period.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.time.channels import Signals
from eimi_fitting.time.decay import Decay
from eimi_fitting.time.measured import Motion
from eimi_fitting.time.ringing_beam import RingingBeam

Array = NDArray[np.float64]

_MOST_BINS = 16
_FEWEST_FRAMES = 2
_FEWEST_FOR_RINGING = 8  # fewer frames do not tell the size of a vibration that was not fitted
_RINGS_S = 3.0  # without a fitted vibration, the beam counts as ringing for this time
_SHAPES, _NODES = 9, 97  # computed shapes, and places at which they are interpolated
_SEEN_RANGE = (0.4, 1.25)
_LEAST_TURN = 1e-3  # rad
_STEP = 1.05  # ratio of the two moduli or loads whose difference gives the displacement for a rotation


def displacement_per_rad(beam: RingingBeam, modulus_Pa: float, loads: Loads, before: Loads, rest_mm: Array) -> Array:
    """Return the displacement of points of a beam for a rotation of its tip by one rad."""
    # ``loads``, ``before``: the loads after and before a step. ``rest_mm`` (p, 2): positions (x, y) of the points at
    # rest. The result is (p, 2) in mm per rad.
    model = beam.planar()
    places = model.grid.strip.nearest(rest_mm)

    def difference(
        moduli: Array, of_loads: Loads, states: tuple[int, int], rows: tuple[int, int]
    ) -> tuple[Array, float]:
        shapes = model.solve(beam.law, beam.parameters(moduli), of_loads)
        moved, angle = model.positions(shapes, places), np.radians(model.tip_angle_deg(shapes))
        change = moved[rows[1], states[1]] - moved[rows[0], states[0]]
        return change, float(angle[rows[1], states[1]] - angle[rows[0], states[0]])

    change, turn = difference(modulus_Pa * np.array([_STEP, 1 / _STEP]), loads, (0, 0), (0, 1))
    if abs(turn) < 1e-4:
        field, force = loads.field_T[0], loads.tip_force_N[0]
        small = replace(
            loads.take(np.zeros(2, np.intp)),
            field_T=np.stack([field, field + 0.1 * (before.field_T[0] - field)]),
            tip_force_N=np.stack([force, force + 0.1 * (before.tip_force_N[0] - force)]),
        )
        change, turn = difference(np.array([modulus_Pa]), small, (0, 1), (0, 0))
    return change / turn if abs(turn) > 1e-7 else np.zeros_like(change)


def shown_rotations(
    beam: RingingBeam, modulus_Pa: float, rest_mm: Array, signals: Signals, per_rad_mm: Array
) -> tuple[Array, Array] | None:
    """Tabulate the measured tip rotation (displacement of points / `per_rad_mm`) against the true rotation, rad."""
    # The first array has the true rotations. Both differ if the beam is strongly bent. None if the rotations of soft
    # and stiff beams hardly differ.
    # ``modulus_Pa``: a typical shear modulus; the equilibria are those of softer and stiffer beams. ``rest_mm`` (p, 2):
    # positions (x, y) of p points at rest. ``per_rad_mm`` (p, 2): their displacements for a rotation by one rad.
    model = beam.planar()
    places = model.grid.strip.nearest(rest_mm)
    moduli = modulus_Pa * np.geomspace(0.4, 2.5, _SHAPES)
    shapes = model.solve(beam.law, beam.parameters(moduli), beam.loads)
    sound = shapes.status[:, 0] == 0
    angle = np.radians(model.tip_angle_deg(shapes))[sound, 0]
    if sound.sum() < 4 or np.ptp(angle) < _LEAST_TURN:
        return None
    moved = model.positions(shapes, places)[sound, 0][:, signals.points, signals.axis]
    gain = per_rad_mm[signals.points, signals.axis] / signals.sigma_mm
    order = np.argsort(angle)
    even = np.linspace(angle.min(), angle.max(), _NODES)
    return even, scipy.interpolate.CubicSpline(
        angle[order], ((moved / signals.sigma_mm) @ gain / (gain @ gain))[order]
    )(even)


def modulus_in_pictures(beam: RingingBeam, modulus_Pa: float, motion: Motion) -> float:
    """Find the shear modulus (Pa) for which the computed beam is bent as far as the recorded beam."""
    # ``modulus_Pa``: a typical shear modulus, which is returned if the frames do not determine a modulus.
    model = beam.planar()
    places = model.grid.strip.nearest(motion.rest_mm)
    # A beam that creeps is softer than one that vibrates.
    moduli = modulus_Pa * np.geomspace(*_SEEN_RANGE, _SHAPES)
    shapes = model.solve(beam.law, beam.parameters(moduli), beam.loads)
    sound = shapes.status[:, 0] == 0
    if sound.sum() < 4 or np.ptp(np.radians(model.tip_angle_deg(shapes))[sound, 0]) < _LEAST_TURN:
        return modulus_Pa
    half = len(motion.points_mm) // 2
    is_seen = motion.seen[half:]
    points = is_seen.any(axis=0)
    if not points.any():
        return modulus_Pa
    late = np.ma.median(np.ma.array(motion.points_mm[half:], mask=~np.repeat(is_seen[..., None], 2, axis=2)), axis=0)
    moved = (np.asarray(late) - motion.rest_mm)[points]
    computed = (model.positions(shapes, places)[sound, 0] - places)[:, points]
    logs = np.log(moduli[sound])
    fine = np.linspace(logs[0], logs[-1], _NODES)
    gaps = scipy.interpolate.CubicSpline(logs, computed)(fine) - moved
    return float(np.exp(fine[np.argmin((gaps**2).sum(axis=(1, 2)))]))


def slow_rotations(
    motion: Motion, signals: Signals, decay: Decay | None, per_rad_mm: Array
) -> tuple[Array, Array, Array, Array] | None:
    """Measure the slow rotation of the tip after a step of the load, without the vibrations."""
    # The results for each time interval: time in s, rotation and its standard uncertainty in rad, and the squared
    # amplitude of the vibration in rad². None for fewer than three intervals, or if no point moves.
    # ``decay``: the vibrations, or None. ``per_rad_mm`` (p, 2): displacements of p points for a rotation by one rad.
    gain = per_rad_mm[signals.points, signals.axis] / signals.sigma_mm
    if not gain @ gain > 0:
        return None
    times, rotation, rings = _slow_frames(signals, decay, gain)
    if len(times) < 3:
        return None
    shortest = 1 / decay.modes[0].frequency_Hz if decay is not None and len(decay.baseline_mm) else 0.0
    # The rotations contain an unknown constant.
    ends = np.geomspace(times[0], times[-1] * (1 + 1e-9), _MOST_BINS + 1)
    merged = [ends[0]]
    for end in ends[1:]:
        if end - merged[-1] >= shortest and np.sum((times >= merged[-1]) & (times < end)) >= _FEWEST_FRAMES:
            merged.append(end)
    merged[-1] = ends[-1]
    place = np.clip(np.searchsorted(merged, times, side="right") - 1, 0, len(merged) - 2)
    count = np.bincount(place, minlength=len(merged) - 1)
    if len(count) < 3:
        return None
    mean_time = np.exp(np.bincount(place, np.log(times)) / count)
    mean = np.bincount(place, rotation) / count
    white = 1 / np.sqrt(gain @ gain)
    scatter = np.sqrt(np.bincount(place, (rotation - mean[place]) ** 2) / np.maximum(count - 1, 1))
    # Neighbouring frames share the rest of the vibration; a quarter of the frames count as independent.
    sigma = np.hypot(
        white / np.sqrt(count), 0.5 * np.minimum(scatter, np.ptp(mean)) / np.sqrt(np.maximum(count / 4, 1))
    )
    of_vibration = np.sqrt(np.bincount(place, rings**2)) / count
    squares = np.zeros(len(mean)) if decay is None else np.interp(mean_time, *_squares(signals, decay, gain), right=0.0)
    return mean_time, mean, np.asarray(np.hypot(sigma, of_vibration)), squares


def _squares(signals: Signals, decay: Decay, gain: Array) -> tuple[Array, Array]:
    """Return times in s, and the squared amplitude of the tip's rotation in the fitted vibration in rad²."""
    # ``gain``: for each coordinate of a point, the displacement for a tip rotation of one rad, divided by the noise.
    rows = (signals.time_s >= decay.from_s) & (signals.time_s <= decay.to_s)
    if not rows.any() or rows.sum() != len(decay.baseline_mm):
        return np.zeros(1), np.zeros(1)
    vibration = ((signals.channels_mm[rows] - decay.baseline_mm) / signals.sigma_mm) @ gain / (gain @ gain)
    envelope = decay.envelope_mm**2
    return decay.time_s, 2 * envelope * np.mean(vibration**2) / max(float(envelope.mean()), 1e-12)


def _slow_frames(signals: Signals, decay: Decay | None, gain: Array) -> tuple[Array, Array, Array]:
    """Return times in s, slow rotations of the tip, and amplitudes of the remaining vibration in rad."""
    # ``gain``: as in `_squares`.
    times = signals.time_s

    def turned(channels_mm: Array) -> Array:
        return np.asarray((channels_mm / signals.sigma_mm) @ gain / (gain @ gain))

    if decay is not None and len(decay.baseline_mm):
        after = times > decay.to_s
        rings = np.concatenate([np.zeros(len(decay.time_s)), _ringing_after(signals, decay, gain, times[after])])
        rotation = turned(np.concatenate([decay.baseline_mm, signals.channels_mm[after]]))
        times = np.concatenate([decay.time_s, times[after]])
        is_used = times > 0
    else:
        stepped = times > 0
        times, rotation = times[stepped], turned(signals.channels_mm[stepped])
        rings = _unseen_ringing(times, rotation, float(1 / np.sqrt(gain @ gain)))
        is_used = times > _RINGS_S
    return times[is_used], rotation[is_used], rings[is_used]


def _ringing_after(signals: Signals, decay: Decay, gain: Array, times_s: Array) -> Array:
    """Extrapolate the vibration of the tip (root mean square, in rad) to times after the fitted interval."""
    # ``gain``: as in `_squares`.
    rows = (signals.time_s >= decay.from_s) & (signals.time_s <= decay.to_s)
    vibration = signals.channels_mm[rows] - decay.baseline_mm if rows.sum() == len(decay.baseline_mm) else np.zeros(0)
    if not len(vibration) or not len(times_s):
        return np.zeros(len(times_s))
    mode = decay.modes[0]
    last = decay.time_s > decay.to_s - 2 / mode.frequency_Hz
    # The size is the root mean square over the last two fitted periods.
    size = float(np.sqrt(np.mean(((vibration[last] / signals.sigma_mm) @ gain / (gain @ gain)) ** 2)))
    return np.asarray(size * np.exp(np.maximum(mode.rate.real, -1e3) * (times_s - decay.to_s)))


def _unseen_ringing(times_s: Array, rotation: Array, white: float) -> Array:
    """Estimate the amplitude of a decaying vibration from the scatter of rotations of the tip in rad."""
    # ``white``: standard deviation of the noise of the rotations.
    if len(times_s) < _FEWEST_FOR_RINGING:
        return np.zeros(len(times_s))
    line = np.stack([np.ones(len(times_s)), np.log(times_s)], axis=1)

    def ringing(logs: Array) -> Array:
        return np.asarray(np.exp(logs[0] - np.exp(np.clip(logs[1], -20.0, 5.0)) * times_s))

    def cost(logs: Array) -> float:
        sigma = np.hypot(white, ringing(logs))
        fitted = np.linalg.lstsq(line / sigma[:, None], rotation / sigma, rcond=None)[0]
        return float(np.log(sigma).sum() + 0.5 * (((rotation - line @ fitted) / sigma) ** 2).sum())

    start = np.array([np.log(max(float(rotation.std()), white)), -np.log(times_s[-1])])
    optimum = scipy.optimize.minimize(cost, start, method="Nelder-Mead", options={"xatol": 0.01, "fatol": 0.01})
    return ringing(optimum.x)
