"""A run that waits for a person: `p` and Enter on its terminal.

It pauses between two states, since one that was broken off would have to be taken again, and the coil would be warmer
by that than `heating` counts. Meanwhile the coil is off: a pause may last for as long as it likes, and nobody can say
what is done at the bench in it. The run then comes back through the states before, as one that is resumed does. Who
cannot wait for the end of a state has Ctrl-C and --resume.
"""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable

from eimi_lab.acquisition.events import OnEvent, OutputSwitched, Paused, PauseRequested, Resumed
from eimi_lab.acquisition.stepping import Stepping
from eimi_lab.acquisition.switching_off import ramp_down_and_switch_off

PAUSE_KEY = "p"
LOOK_EVERY_S = 0.1


def nobody_types() -> str | None:
    """For a run without a terminal."""
    return None


def typed_line() -> str | None:
    """The line that was typed on the terminal; None for none yet. Never waits.

    In the background of a terminal nothing is read: that would stop the program.
    """
    try:
        terminal = sys.stdin.fileno()
        if os.tcgetpgrp(terminal) != os.getpgrp() or not select.select([terminal], [], [], 0)[0]:
            return None
        return os.read(terminal, 1024).decode("utf-8", "replace").strip()
    except (OSError, ValueError, AttributeError):  # no terminal, closed, or a system without them
        return None


class Pauses:
    """Whether a person asked for a pause, and the pause itself."""

    def __init__(self, typed: Callable[[], str | None], on_event: OnEvent) -> None:
        """typed: gives the next line that a person typed, or None. on_event: hears of the pause."""
        self._typed, self._on_event = typed, on_event
        self.asked = False

    def heeded_by(self, stop_if_asked: Callable[[], None]) -> Callable[[], None]:
        """What to call between the operations of a state, in place of `stop_if_asked`: hears what is typed, too."""

        def move_on() -> None:
            if self._typed() == PAUSE_KEY and not self.asked:
                self.asked = True
                self._on_event(PauseRequested())
            stop_if_asked()

        return move_on

    def wait(self, run: Stepping, state: int, stop_if_asked: Callable[[], None]) -> None:
        """Switch the coil off until a line is typed, then come back to where `state` begins.

        Raises Stopped, InstrumentError, SwitchOffFailed, StorageFailed.
        """
        ramp_down_and_switch_off(run.coil, run.guardian, stop_if_asked, self._on_event)
        self._on_event(Paused(state=state, states=len(run.protocol.currents_A), dataset=str(run.writer.path)))
        while self._typed() is None:
            stop_if_asked()
            run.clock.sleep(LOOK_EVERY_S)
        self.asked = False
        self._on_event(Resumed(state=state))
        if run.guardian:
            run.guardian.arm()
        supply = run.coil.supply
        supply.set_current(0.0)
        supply.set_voltage(supply.limits.voltage_V)
        supply.set_output(True)
        self._on_event(OutputSwitched(on=True))
        run.writer.begin_session()
        run.go_back_to(state, stop_if_asked)
