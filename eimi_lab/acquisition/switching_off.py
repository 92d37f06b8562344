"""Every way out of a run ends with the coil off: return, error, Ctrl-C, termination, hang-up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from eimi_drivers.interfaces import InstrumentError
from eimi_lab.acquisition.coil import Coil, never
from eimi_lab.acquisition.guardian import Guardian
from eimi_lab.errors import tell
from eimi_lab.stopping import TERMINATION, Stopped, raise_if_asked

SIGNALS = (signal.SIGINT, *TERMINATION)
SUSPEND = getattr(signal, "SIGTSTP", None)
OFF_WITHIN_S = 30.0
"""Switching off may take so long where the line is bad; then the guardian tries, too."""


class _InHaste(Exception):
    """Asked to stop once more: the ramp down is left out."""


@contextmanager
def switching_off(coil: Coil, guardian: Guardian | None = None) -> Iterator[Callable[[], None]]:
    """Yields `stop_if_asked`; on leaving, the coil is ramped down and off.

    `stop_if_asked` is for every step that the run takes: the guardian hears that it moves on, and takes over where it
    does not; the supply is asked for faults now and then. It raises Stopped once a signal has come, and InstrumentError
    where the guardian is gone or the supply reports a fault.

    The guardian is armed meanwhile, and disarmed only once the supply says that it is off.

    A signal is only noted when it arrives and acted on between operations, so that no exchange with an instrument
    and no write to a file is cut in two; a second one cuts the ramp down short, and nothing else. Ctrl-Z is refused, in
    words: a run that is suspended would leave the coil on. The handlers that were there before are put back afterwards.
    Outside the main thread, where Python delivers no signals, only the switching off is left. Raises SwitchOffFailed
    where that failed.
    """
    noted: list[int] = []
    suspended: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        (suspended if number == SUSPEND else noted).append(number)

    def move_on() -> None:
        if guardian:
            guardian.beat()
        if suspended:
            suspended.clear()
            tell("Ctrl-Z is refused, since the coil would stay on; Ctrl-C ends the run with the coil off")

    def stop_if_asked() -> None:
        move_on()
        raise_if_asked()
        if noted:
            raise Stopped(noted[0])
        if guardian:
            guardian.check()
        coil.keep_in_touch()

    def go_on_down() -> None:
        move_on()
        if len(noted) > 1:
            raise _InHaste

    previous = {}
    if threading.current_thread() is threading.main_thread():
        # What is ignored stays ignored: a run under nohup outlives its terminal.
        heeded = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
        if SUSPEND is not None:
            heeded.append(SUSPEND)
        previous = {number: signal.signal(number, note) for number in heeded}
    try:
        if guardian:
            guardian.arm()
        try:
            yield stop_if_asked
        finally:
            ramp_down_and_switch_off(coil, guardian, go_on_down)
        stop_if_asked()
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def ramp_down_and_switch_off(
    coil: Coil, guardian: Guardian | None = None, go_on_down: Callable[[], None] = never
) -> None:
    """Ramp down, then zero, off and verify, which the driver does; each is tried whatever became of the others."""
    try:
        coil.ramp_down(go_on_down)
    except _InHaste:
        _off(coil, guardian)
    except InstrumentError as error:
        _off(coil, guardian)
        raise InstrumentError(f"the coil is off, but could not be ramped down before: {error}") from error
    except BaseException:
        _off(coil, guardian)
        raise
    else:
        _off(coil, guardian)


def _off(coil: Coil, guardian: Guardian | None) -> None:
    if guardian:
        guardian.allow(OFF_WITHIN_S)
    coil.supply.safe_off()
    if guardian:
        guardian.disarm()
