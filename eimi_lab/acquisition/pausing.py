"""Pause a run when a person types `p` and Enter on its terminal.

The run pauses only between two states (load steps). If it paused within a state, it would have to measure this state
again, and the coil would become warmer than predicted before the run. During the pause the coil is off, because a pause
may last for any time and a person may work at the bench. After the pause, the current ramps through all previous states
again, as in a resumed run. To interrupt a run within a state, a person presses Ctrl-C; --resume continues the run.
"""

from __future__ import annotations

from collections.abc import Callable

from eimi_lab.acquisition.events import OnEvent, OutputSwitched, Paused, PauseRequested, Resumed
from eimi_lab.acquisition.stepping import Stepping
from eimi_lab.acquisition.switching_off import ramp_down_and_switch_off

PAUSE_KEY = "p"
LOOK_EVERY_S = 0.1


def no_input() -> str | None:
    """Return None: no line was typed. A run without a terminal has this function as its argument `typed`."""
    return None


class Pauses:
    """The pauses of a run, which a person asks for and ends at the terminal.

    Parameters
    ----------
    typed : callable
        Returns the next line that a person typed; None if no line was typed.
    on_event : OnEvent
        Receives the events (records of what happened) of the pause.

    Attributes
    ----------
    asked : bool
        Whether a person has asked for a pause that has not begun yet.
    """

    def __init__(self, typed: Callable[[], str | None], on_event: OnEvent) -> None:
        self._typed, self._on_event = typed, on_event
        self.asked = False

    def heeded_by(self, stop_if_asked: Callable[[], None]) -> Callable[[], None]:
        """Return a function that checks for a request to pause, and then for a request to end the run.

        The run calls the returned function in every step. If a person has typed `p` (a request to pause), the function
        sets the attribute `asked` and sends the event `PauseRequested`; the run pauses later, between two states. In
        every call, the function then calls `stop_if_asked`, which raises an exception if the run has to end.
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
            Number of the next state (load step). The currents of all states before it are passed again.
        stop_if_asked : callable
            Called repeatedly during the pause. It raises an exception if the run has to stop.
        swap_leads : bool
            Whether the person has to swap the leads of the coil in this pause. A line that was typed before the pause
            is then ignored.

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
