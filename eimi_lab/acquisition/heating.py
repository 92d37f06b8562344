"""Predict the heat of the coil during a run, and refuse a protocol that would overheat the coil.

The heat h (A²) is proportional to the temperature rise: τ dh/dt = I² − h, with the current I and the thermal time
constant τ of the coil. The allowed heat is I₀², with the current I₀ that the coil can carry without a time limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from eimi_lab.acquisition.coil import REACHED_WITHIN_S
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import CoilRating
from eimi_lab.process.errors import InputError

FRAME_WITHIN_S = 0.5  # longest time for one frame and the measurement of its current
STORED_WITHIN_S = 0.1  # longest time for storing one frame of a transient


@dataclass(frozen=True)
class Heating:
    """The largest heat of the coil during a run, and the stage of the run in which this heat occurs.

    Attributes
    ----------
    stage : str
        The stage of the run, in words.
    share : float
        The largest heat divided by the allowed heat; above 1 the coil may become too hot.
    """

    stage: str
    share: float


def hottest(protocol: Protocol, rating: CoilRating) -> Heating:
    """Return the largest heat of the coil in a run in which every stage takes its longest time, without pauses.

    Parameters
    ----------
    protocol : Protocol
        The currents and the longest times of the run.
    rating : CoilRating
        The continuous current (A) and the thermal time constant (s) of the coil.
    """
    heat_A2, before_A, worst = 0.0, 0.0, Heating("the beginning", 0.0)
    for stage, current_A, held_s in _stages(protocol):
        ramp_s = abs(current_A - before_A) / protocol.ramp.rate_A_per_s
        ramp_A2 = (before_A**2 + before_A * current_A + current_A**2) / 3
        for squared_A2, seconds in ((ramp_A2, ramp_s), (current_A**2, held_s)):
            heat_A2 = squared_A2 + (heat_A2 - squared_A2) * math.exp(-seconds / rating.thermal_time_constant_s)
            share = heat_A2 / rating.continuous_current_A**2
            if share > worst.share:
                worst = Heating(stage, share)
        before_A = current_A
    return worst


def _stages(protocol: Protocol) -> Iterator[tuple[str, float, float]]:
    """Yield the description, the current (A) and the longest duration (s) of each stage of a run."""
    at_rest_s = protocol.settle.timeout_s + REACHED_WITHIN_S
    if rule := protocol.conditioning:
        for cycle in range(1, rule.cycles + 1):
            is_recorded = cycle in (1, rule.cycles)
            for current_A in (rule.current_A, 0.0):
                held_s = at_rest_s + FRAME_WITHIN_S if is_recorded else REACHED_WITHIN_S
                yield f"conditioning cycle {cycle} ({current_A:g} A)", current_A, held_s
    state_s = max(at_rest_s, protocol.settle.dwell_s)
    taken_s = protocol.frames_per_state * FRAME_WITHIN_S + protocol.transients.frames_per_state * STORED_WITHIN_S
    for state, current_A in enumerate(protocol.currents_A):
        yield f"state {state} ({current_A:g} A)", current_A, state_s + taken_s
    if protocol.ring_down:
        from_A = protocol.ring_down_from_A
        for number in range(protocol.ring_down.repeats):
            stage = f"ring-down {number} (from {from_A:g} A)"
            yield stage, from_A, at_rest_s
            yield stage, 0.0, protocol.ring_down.seconds


class Warming:
    """The heat h (A²) of a coil with the current I and the thermal time constant τ: τ dh/dt = I² − h.

    The coil is cold (h = 0) until the first current is recorded with `flows`.
    """

    def __init__(self, rating: CoilRating) -> None:
        self._rating = rating
        self._heat_A2 = self._current_A = 0.0
        self._since_s: float | None = None

    def flows(self, now_s: float, current_A: float) -> None:
        """Record that the current `current_A` (A) flows from the time `now_s` (s on a monotonic clock) on."""
        self._heat_A2, self._since_s, self._current_A = self._heat(now_s), now_s, current_A

    def share(self, now_s: float) -> float:
        """Return the heat of the coil at the time `now_s` (s) divided by the allowed heat."""
        return self._heat(now_s) / self._rating.continuous_current_A**2

    def _heat(self, now_s: float) -> float:
        elapsed_s = 0.0 if self._since_s is None else now_s - self._since_s
        squared_A2 = self._current_A**2
        return squared_A2 + (self._heat_A2 - squared_A2) * math.exp(-elapsed_s / self._rating.thermal_time_constant_s)


def refuse_overheating(protocol: Protocol, rating: CoilRating) -> None:
    """Raise InputError if a protocol could overheat the coil."""
    worst = hottest(protocol, rating)
    if worst.share > 1:
        raise InputError(
            f"protocol {protocol.name}: could overheat the coil at {worst.stage}: {100 * worst.share:.0f} % of the "
            f"heat at coil.continuous_current_A = {rating.continuous_current_A:g}; reduce the currents, "
            "settle.timeout_s, settle.dwell_s, or the number of states or cycles"
        )
