"""Every way out of a run ends with the coil off: return, error, Ctrl-C, termination, hang-up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from eimi_drivers.interfaces import InstrumentError, Interruptible
from eimi_lab.acquisition.coil import Coil, never
from eimi_lab.acquisition.guardian import Guardian
from eimi_lab.process.errors import tell
from eimi_lab.process.stopping import TERMINATION, Stopped, raise_if_asked

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
    and no write to a file is cut in two; a second one leaves out the ramp down, and is heeded `_in_haste`. Ctrl-Z is
    refused, in words: a run that is suspended would leave the coil on. The handlers that were there before are put back
    afterwards. Outside the main thread, where Python delivers no signals, only the switching off is left. Raises
    SwitchOffFailed where that failed.
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
            with _in_haste(coil, guardian, noted):
                yield stop_if_asked
        finally:
            ramp_down_and_switch_off(coil, guardian, go_on_down)
        stop_if_asked()
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextmanager
def _in_haste(coil: Coil, guardian: Guardian | None, noted: list[int]) -> Iterator[None]:
    """A second signal is heeded within an operation, too.

    Between two exchanges with the supply the rest is left out: on a slow line the read-backs of a set-point are most of
    what it takes. A state is stored to its end, with the coil switched off meanwhile.
    """
    off: list[bool] = []

    def leave() -> None:
        if len(noted) > 1 and not off and threading.current_thread() is threading.main_thread():
            raise Stopped(noted[0])

    def switch_off() -> None:
        if len(noted) > 1 and not off:
            off.append(True)
            if guardian:
                guardian.allow(OFF_WITHIN_S)
            with suppress(InstrumentError):  # it is tried again on the way out, and told of there
                coil.supply.safe_off()

    supply = getattr(coil.supply, "watched", coil.supply)
    coil.meanwhile = switch_off
    if isinstance(supply, Interruptible):
        supply.meanwhile = leave
    try:
        yield
    finally:
        coil.meanwhile = never
        if isinstance(supply, Interruptible):
            supply.meanwhile = never


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
