"""Every way out of a run ends with the coil off: return, error, Ctrl-C, termination, hang-up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from eimi_drivers.interfaces import InstrumentError
from eimi_lab.acquisition.coil import Coil
from eimi_lab.acquisition.guardian import Guardian
from eimi_lab.stopping import TERMINATION, Stopped, raise_if_asked

SIGNALS = (signal.SIGINT, *TERMINATION)


@contextmanager
def switching_off(coil: Coil, guardian: Guardian | None = None) -> Iterator[Callable[[], None]]:
    """Yields `stop_if_asked`, which raises Stopped once a signal has come; on leaving, the coil is ramped down and off.

    The guardian is armed meanwhile, and disarmed only once the supply says that it is off.

    A signal is only noted when it arrives and acted on between operations, so that no exchange with an instrument
    and no write to a file is cut in two, and a second Ctrl-C cannot interrupt the switching off. The handlers that
    were there before are put back afterwards. Outside the main thread, where Python delivers no signals, only the
    switching off is left. Raises SwitchOffFailed where that failed.
    """
    noted: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)

    def stop_if_asked() -> None:
        raise_if_asked()
        if noted:
            raise Stopped(noted[0])

    previous = {}
    if threading.current_thread() is threading.main_thread():
        # What is ignored stays ignored: a run under nohup outlives its terminal.
        heeded = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
        previous = {number: signal.signal(number, note) for number in heeded}
    try:
        if guardian:
            guardian.arm()
        try:
            yield stop_if_asked
        finally:
            ramp_down_and_switch_off(coil, guardian)
        stop_if_asked()
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def ramp_down_and_switch_off(coil: Coil, guardian: Guardian | None = None) -> None:
    """Ramp down, then zero, off and verify, which the driver does; each is tried whatever became of the others."""
    try:
        coil.ramp_to(0.0)
    except InstrumentError as error:
        _off(coil, guardian)
        raise InstrumentError(f"the coil is off, but could not be ramped down before: {error}") from error
    except BaseException:
        _off(coil, guardian)
        raise
    _off(coil, guardian)


def _off(coil: Coil, guardian: Guardian | None) -> None:
    coil.supply.safe_off()
    if guardian:
        guardian.disarm()
