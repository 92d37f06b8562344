"""What a run does to the coil's temperature, before it begins.

The coil's heat is I² smoothed over its thermal time constant, and the coil bears its continuous current for ever. So a
protocol is refused when smoothed I² would pass continuous_current_A².

This is the first-order model of a body that loses heat in proportion to its temperature; resistance is taken as
constant. Every state is counted as long as it can last.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from eimi_lab.acquisition.coil import REACHED_WITHIN_S
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import CoilRating
from eimi_lab.process.errors import InputError

FRAME_WITHIN_S = 0.5  # a frame and the current measured beside it
STORED_WITHIN_S = 0.1  # a frame of a transient, while the coil waits


@dataclass(frozen=True)
class Heating:
    """The hottest moment of a run: at the end of which stage, in words, and smoothed I² there over what is allowed."""

    stage: str
    share: float


def hottest(protocol: Protocol, rating: CoilRating) -> Heating:
    """Where the coil is hottest, when everything takes as long as it may; a ramp counts as its mean square."""
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
    """What the coil goes through: in words, the current (A) and for how long at most it is held (s)."""
    at_rest_s = protocol.settle.timeout_s + REACHED_WITHIN_S
    if rule := protocol.conditioning:
        for cycle in range(1, rule.cycles + 1):
            seen = cycle in (1, rule.cycles)
            for current_A in (rule.current_A, 0.0):
                held_s = at_rest_s + FRAME_WITHIN_S if seen else REACHED_WITHIN_S
                yield f"conditioning cycle {cycle} ({current_A:g} A)", current_A, held_s
    taken_s = protocol.frames_per_state * FRAME_WITHIN_S + protocol.transients.frames_per_state * STORED_WITHIN_S
    for state, current_A in enumerate(protocol.currents_A):
        yield f"state {state} ({current_A:g} A)", current_A, at_rest_s + taken_s


class Warming:
    """How warm a coil is while a current flows, by the model above; cold at the first reading."""

    def __init__(self, rating: CoilRating) -> None:
        self._rating = rating
        self._heat_A2 = self._current_A = 0.0
        self._since_s: float | None = None

    def flows(self, now_s: float, current_A: float) -> None:
        """From now on this current flows; `now_s` is on any clock that does not go back."""
        self._heat_A2, self._since_s, self._current_A = self._heat(now_s), now_s, current_A

    def share(self, now_s: float) -> float:
        """Smoothed I² over what the coil bears for ever."""
        return self._heat(now_s) / self._rating.continuous_current_A**2

    def _heat(self, now_s: float) -> float:
        elapsed_s = 0.0 if self._since_s is None else now_s - self._since_s
        squared_A2 = self._current_A**2
        return squared_A2 + (self._heat_A2 - squared_A2) * math.exp(-elapsed_s / self._rating.thermal_time_constant_s)


def refuse_overheating(protocol: Protocol, rating: CoilRating) -> None:
    """Raise InputError when the coil could become hotter than it bears."""
    worst = hottest(protocol, rating)
    if worst.share > 1:
        raise InputError(
            f"protocol {protocol.name}: could overheat the coil at {worst.stage}: {100 * worst.share:.0f} % of the "
            f"heat of coil.continuous_current_A = {rating.continuous_current_A:g}; lower the currents, "
            "settle.timeout_s or the number of states or cycles"
        )
