"""What a run does to the coil's temperature, before it begins.

The coil's heat is I² smoothed over its thermal time constant, and the coil bears its continuous current for ever. So a
protocol is refused when smoothed I² would pass continuous_current_A².

This is the first-order model of a body that loses heat in proportion to its temperature; resistance is taken as
constant. Every state is counted as long as it can last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from eimi_lab.acquisition.coil import REACHED_WITHIN_S
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import CoilRating
from eimi_lab.errors import InputError

FRAME_WITHIN_S = 0.5  # a frame and the current measured beside it


@dataclass(frozen=True)
class Heating:
    """The hottest moment of a run: the state at whose end it comes, and smoothed I² there over what is allowed."""

    state: int
    share: float


def hottest(protocol: Protocol, rating: CoilRating) -> Heating:
    """Where the coil is hottest, when every state takes as long as it may; a ramp counts as its mean square."""
    held_s = protocol.settle.timeout_s + REACHED_WITHIN_S + protocol.frames_per_state * FRAME_WITHIN_S
    heat_A2, before_A, worst = 0.0, 0.0, Heating(0, 0.0)
    for state, current_A in enumerate(protocol.currents_A):
        ramp_s = abs(current_A - before_A) / protocol.ramp.rate_A_per_s
        ramp_A2 = (before_A**2 + before_A * current_A + current_A**2) / 3
        for squared_A2, seconds in ((ramp_A2, ramp_s), (current_A**2, held_s)):
            heat_A2 = squared_A2 + (heat_A2 - squared_A2) * math.exp(-seconds / rating.thermal_time_constant_s)
            share = heat_A2 / rating.continuous_current_A**2
            if share > worst.share:
                worst = Heating(state, share)
        before_A = current_A
    return worst


def refuse_overheating(protocol: Protocol, rating: CoilRating) -> None:
    """Raise InputError when the coil could become hotter than it bears."""
    worst = hottest(protocol, rating)
    if worst.share > 1:
        raise InputError(
            f"protocol {protocol.name}: could overheat the coil at state {worst.state} "
            f"({protocol.currents_A[worst.state]:g} A): {100 * worst.share:.0f} % of the heat of "
            f"coil.continuous_current_A = {rating.continuous_current_A:g}; lower the currents, settle.timeout_s or "
            "the number of states"
        )
