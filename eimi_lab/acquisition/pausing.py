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

    def __init__(self, typed: Callable[[], str | None], remark: Callable[[str], None]) -> None:
        """typed: gives the next line that a person typed, or None. remark: gets what is to be told, a line each."""
        self._typed, self._remark = typed, remark
        self.asked = False

    def heeded_by(self, stop_if_asked: Callable[[], None]) -> Callable[[], None]:
        """What to call between the operations of a state, in place of `stop_if_asked`: hears what is typed, too."""

        def move_on() -> None:
            if self._typed() == PAUSE_KEY and not self.asked:
                self.asked = True
                self._remark("the run pauses as soon as this state is stored")
            stop_if_asked()

        return move_on

    def wait(self, run: Stepping, state: int, stop_if_asked: Callable[[], None]) -> None:
        """Switch the coil off until a line is typed, then come back to where `state` begins.

        Raises Stopped, InstrumentError, SwitchOffFailed, StorageFailed.
        """
        supply = run.coil.supply
        ramp_down_and_switch_off(run.coil, run.guardian, stop_if_asked)
        self._remark(
            f"paused before state {state}: the coil is off, and {state} of {len(run.protocol.currents_A)} states are "
            f"in {run.writer.path}; Enter goes on, Ctrl-C ends the run"
        )
        while self._typed() is None:
            stop_if_asked()
            run.clock.sleep(LOOK_EVERY_S)
        self.asked = False
        self._remark("the run goes on, through the states before")
        if run.guardian:
            run.guardian.arm()
        supply.set_current(0.0)
        supply.set_voltage(supply.limits.voltage_V)
        supply.set_output(True)
        run.writer.begin_session()
        run.go_back_to(state, stop_if_asked)
