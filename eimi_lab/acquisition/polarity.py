"""Reverse the current in a coil whose supply cannot reverse it, by swapping the leads of the coil.

A person swaps the leads in a pause of the run, or a relay swaps them.
"""

from __future__ import annotations

from collections.abc import Callable

from eimi_drivers.supplies.supply_names import is_bipolar
from eimi_lab.acquisition.events import Warned
from eimi_lab.acquisition.pausing import Pauses
from eimi_lab.acquisition.stepping import Stepping
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import Rig


def cannot_reverse(rig: Rig) -> bool:
    """Return whether the supply in a rig file can give currents of only one sign.

    Raises InstrumentError for an unknown driver.
    """
    return rig.simulated or not is_bipolar(rig.supply.driver)


def swaps_leads(protocol: Protocol, rig: Rig) -> bool:
    """Return whether the leads of the coil have to be swapped during a run.

    Raises InstrumentError for an unknown driver.
    """
    return protocol.current.both_polarities and cannot_reverse(rig)


class Polarity:
    """Swaps the leads of the coil during a run.

    Parameters
    ----------
    pauses : Pauses or None
        Pauses in which a person swaps the leads; None if no swap is necessary.
    relay : callable or None
        Swaps the leads without a person; None without a relay.
    """

    def __init__(self, pauses: Pauses | None, relay: Callable[[], None] | None) -> None:
        self._pauses, self._relay = pauses, relay

    def prepare(self, run: Stepping, state: int, stop_if_asked: Callable[[], None]) -> bool:
        """Swap the leads if a state (load step) needs the opposite current, then ramp through the earlier states again.

        Parameters
        ----------
        run : Stepping
            The run.
        state : int
            Number of the next state; the number of all states if the ring-downs are next.
        stop_if_asked : callable
            Called between the operations; raises an exception if the run has to stop.

        Returns
        -------
        bool
            Whether the leads were swapped.

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
        currents_A = run.protocol.currents_A
        current_A = currents_A[state] if state < len(currents_A) else run.protocol.ring_down_from_A
        if self._pauses is None or current_A == 0 or (current_A < 0) == run.coil.leads_swapped:
            return False
        if self._relay is None:
            self._pauses.wait(run, state, stop_if_asked, swap_leads=True)
            return True
        run.coil.ramp_to(0.0, stop_if_asked)
        run.coil.wait_until_reached(stop_if_asked)
        self._relay()
        run.coil.leads_swapped = not run.coil.leads_swapped
        run.go_back_to(state, stop_if_asked)
        return True

    def remind(self, run: Stepping) -> None:
        """Send a warning if the leads of the coil are still swapped and a person has to swap them back."""
        if self._relay is None and run.coil.leads_swapped:
            run.on_event(Warned(message="the leads of the coil are still swapped; swap them back before the next run"))
