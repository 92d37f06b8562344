"""Pause a run when a person types `p` and Enter on its terminal.

The run pauses between two states. A pause within a state would mean that the state has to be taken again, and the coil
would become warmer than `heating` computes. The coil is off during the pause, because a pause may last for any time and
a person may work at the bench. Afterwards the run passes through the previous states again, as a resumed run does.
Ctrl-C and --resume interrupt a run within a state.
"""

from __future__ import annotations

from collections.abc import Callable

from eimi_lab.acquisition.events import OnEvent, OutputSwitched, Paused, PauseRequested, Resumed
from eimi_lab.acquisition.stepping import Stepping
from eimi_lab.acquisition.switching_off import ramp_down_and_switch_off

PAUSE_KEY = "p"
LOOK_EVERY_S = 0.1


def no_input() -> str | None:
    """Return None: the input of a run without a terminal."""
    return None


class Pauses:
    """The pauses of a run.

    Parameters
    ----------
    typed : callable
        Returns the next line that a person typed, or None.
    on_event : OnEvent
        Receives the events of the pause.

    Attributes
    ----------
    asked : bool
        Whether a person has asked for a pause, and the pause has not begun yet.
    """

    def __init__(self, typed: Callable[[], str | None], on_event: OnEvent) -> None:
        self._typed, self._on_event = typed, on_event
        self.asked = False

    def heeded_by(self, stop_if_asked: Callable[[], None]) -> Callable[[], None]:
        """Return a function that reads the typed lines and then calls `stop_if_asked`."""

        def move_on() -> None:
            if self._typed() == PAUSE_KEY and not self.asked:
                self.asked = True
                self._on_event(PauseRequested())
            stop_if_asked()

        return move_on

    def wait(self, run: Stepping, state: int, stop_if_asked: Callable[[], None], *, swap_leads: bool = False) -> None:
        """Switch the coil off until a line is typed, then return to the beginning of `state`.

        Parameters
        ----------
        run : Stepping
            The run.
        state : int
            The next state.
        stop_if_asked : callable
            Called while the run waits; it may raise.
        swap_leads : bool
            Whether the person is asked to swap the leads of the coil. A line that was typed before does not count.

        Raises
        ------
        Stopped, InstrumentError, SwitchOffFailed, StorageFailed
            For the reasons of a state.
        """
        ramp_down_and_switch_off(run.coil, run.guardian, stop_if_asked, self._on_event)
        if swap_leads:
            self._typed()
        states, dataset = len(run.protocol.currents_A), str(run.writer.path)
        self._on_event(Paused(state=state, states=states, dataset=dataset, swap_leads=swap_leads))
        while self._typed() is None:
            stop_if_asked()
            run.clock.sleep(LOOK_EVERY_S)
        self.asked = False
        if swap_leads:
            run.coil.leads_swapped = not run.coil.leads_swapped
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
