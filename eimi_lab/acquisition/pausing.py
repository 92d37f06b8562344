"""Pause a run between two states or before its ring-downs, with the coil off, when a person types `p` and Enter."""

from __future__ import annotations

from collections.abc import Callable

from eimi_lab.acquisition.events import OnEvent, OutputSwitched, Paused, PauseRequested, Resumed
from eimi_lab.acquisition.stepping import Stepping
from eimi_lab.acquisition.switching_off import ramp_down_and_switch_off

PAUSE_KEY = "p"
LOOK_EVERY_S = 0.1


def no_input() -> str | None:
    """Return None: no line was typed."""
    return None


class Pauses:
    """The pauses of a run, which a person begins and ends at the terminal.

    Parameters
    ----------
    typed : callable
        Returns the next line that a person typed; None if no line was typed.
    on_event : OnEvent
        Receives the events (records of what happened).

    Attributes
    ----------
    asked : bool
        Whether a person has asked for a pause that has not begun yet.
    """

    def __init__(self, typed: Callable[[], str | None], on_event: OnEvent) -> None:
        self._typed, self._on_event = typed, on_event
        self.asked = False

    def heeded_by(self, stop_if_asked: Callable[[], None]) -> Callable[[], None]:
        """Return a function that the run calls often: it stores a typed request to pause, and calls `stop_if_asked`.

        The first request sets the attribute `asked` and sends the event `PauseRequested`; `wait` pauses the run later.
        `stop_if_asked` raises an exception if the run has to stop.
        """

        def move_on() -> None:
            if self._typed() == PAUSE_KEY and not self.asked:
                self.asked = True
                self._on_event(PauseRequested())
            stop_if_asked()

        return move_on

    def wait(self, run: Stepping, state: int, stop_if_asked: Callable[[], None], *, swap_leads: bool = False) -> None:
        """Switch the coil off until a person types a line, then ramp through the earlier currents of the run again.

        Parameters
        ----------
        run : Stepping
            The run.
        state : int
            Number of the next state (load step); the number of all states if the ring-downs are next.
        stop_if_asked : callable
            Called repeatedly; raises an exception if the run has to stop.
        swap_leads : bool
            Whether the person has to swap the leads of the coil in this pause.

        Raises
        ------
        Stopped
            If a signal asked the run to stop.
        InstrumentError
            If an instrument fails or the current is wrong.
        SwitchOffFailed
            If the coil could not be confirmed off.
        StorageFailed
            If the dataset cannot be written.
        """
        ramp_down_and_switch_off(run.coil, run.guardian, stop_if_asked, self._on_event)
        while self._typed() is not None:  # a line that was typed before the pause does not end it
            pass
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
