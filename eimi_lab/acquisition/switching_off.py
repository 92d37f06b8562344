"""Switch the coil off at the end of every run, also after an error, Ctrl-C, termination or hang-up."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from eimi_drivers.interfaces import InstrumentError, Off
from eimi_lab.acquisition.coil import Coil, never
from eimi_lab.acquisition.doubt import doubted_after
from eimi_lab.acquisition.events import (
    OffNotConfirmed,
    OnEvent,
    OutputSwitched,
    StopRequested,
    SuspendRefused,
    ignore_event,
    off_confirmed,
)
from eimi_lab.acquisition.guardian import Guardian, StoodStill
from eimi_lab.acquisition.interruption import Interruption
from eimi_lab.process.stopping import TERMINATION, Stopped, raise_if_asked

SIGNALS = (signal.SIGINT, *TERMINATION)
SUSPEND = getattr(signal, "SIGTSTP", None)
OFF_WITHIN_S = 30.0
"""Longest time (s) for which the run alone tries to switch the coil off. Afterwards its guardian process tries as well.
"""

DOUBTED_AFTER_S = 0.5
"""Time (s) of switching off after which the coil is reported as possibly on. This time applies if the ramp to zero or
the line failed.
"""

_log = logging.getLogger(__name__)


class _InHaste(Exception):
    """The error that ends the ramp of the current to zero after a second signal (Ctrl-C again)."""


class _SignalsHeeded:
    """The signals that came during a run, and the reactions of the run to these signals.

    The first signal ends the run with a ramp of the current to zero. After a second signal there is no ramp.
    """

    def __init__(self, coil: Coil, guardian: Guardian | None, on_event: OnEvent) -> None:
        self._coil, self._guardian, self._on_event = coil, guardian, on_event
        self._noted: list[int] = []
        self._suspended = self._stop_reported = self._off = False
        self._fault: InstrumentError | None = None

    def note(self, number: int, frame: FrameType | None) -> None:
        """Store a signal, and start the time limit for the ramp to zero current. This is the handler of the signals."""
        if number == SUSPEND:
            self._suspended = True
        else:
            self._noted.append(number)
            self._coil.count_the_end()

    def move_on(self) -> None:
        """Tell the guardian process that the run is alive; if Ctrl-Z was pressed, report that suspension is refused."""
        if self._guardian:
            self._guardian.beat()
        if self._suspended:
            self._suspended = False
            self._on_event(SuspendRefused())

    def stop_if_asked(self) -> None:
        """Raise an error after a signal, a fault of the supply, a wrong current, or the end of the guardian process."""
        self.move_on()
        self._refuse_a_gap()
        raise_if_asked()
        self._raise_if_noted()
        if self._fault:
            raise self._fault
        if self._guardian:
            try:
                self._guardian.check()
            except InstrumentError:
                self._coil.count_the_end(ago_s=self._guardian.silent_s())
                raise
        self._coil.watch(self._raise_if_noted)

    def _raise_if_noted(self) -> None:
        if self._noted:
            self._report_the_stop()
            raise Stopped(self._noted[0])

    def _refuse_a_gap(self) -> None:
        # After a sleep of the computer, or a stop of the process, the coil is switched off without a ramp.
        if self._guardian:
            try:
                self._guardian.refuse_a_gap()
            except StoodStill:
                self._coil.out_of_control = True
                raise

    def go_on_down(self) -> None:
        # Tell the guardian process that the run is alive; if Ctrl-C was pressed twice, raise _InHaste to end the ramp.
        # Other signals that end the program count as Ctrl-C.
        self.move_on()
        if len(self._noted) > 1:
            raise _InHaste

    def leave_in_haste(self) -> None:
        """Raise Stopped after a second signal, or StoodStill if the computer slept or the process was stopped.

        The supply calls the method between two messages. After the coil was switched off, the method does nothing.
        """
        if not self._off:
            self._refuse_a_gap()
        if len(self._noted) > 1 and not self._off and threading.current_thread() is threading.main_thread():
            raise Stopped(self._noted[0])

    def switch_off_in_haste(self) -> None:
        """Switch the coil off, at most once, if a second signal has come or the current is wrong. Raises nothing."""
        if not self._off and (len(self._noted) > 1 or self._current_is_wrong()):
            self._off = True
            _log.info(
                "while a state was stored, a second signal to stop came or the current was wrong: the coil is "
                "switched off at once"
            )
            if self._guardian:
                self._guardian.allow(OFF_WITHIN_S)
            try:
                off = self._coil.switch_off()
            except InstrumentError as error:  # the end of the run tries again and reports the failure
                _log.info("switching off failed: %s", error)
            else:
                _report_off(off, self._on_event)

    def _current_is_wrong(self) -> bool:
        try:
            self._coil.watch()
        except InstrumentError as error:  # raised by `stop_if_asked` once the state is stored
            self._fault = error
        return self._fault is not None

    def _report_the_stop(self) -> None:
        if not self._stop_reported:
            self._stop_reported = True
            self._on_event(StopRequested(signal=signal.Signals(self._noted[0]).name))


@contextmanager
def switching_off(
    coil: Coil,
    guardian: Guardian | None = None,
    interruption: Interruption | None = None,
    on_event: OnEvent = ignore_event,
) -> Iterator[Callable[[], None]]:
    """Ramp the coil down and switch it off at the end of the context, also after an error or a signal.

    The context yields a function, which the run calls in every step. The function raises Stopped after a signal, and
    InstrumentError if the guardian (the process that switches the coil off if the run dies) is gone, the supply reports
    a fault or the current is wrong. After a second signal there is no ramp. Ctrl-Z is refused. Signals are handled only
    in the main thread.

    Parameters
    ----------
    coil : Coil
        The coil.
    guardian : Guardian or None
        The connection to the guardian; None for a simulated supply.
    interruption : Interruption or None
        Lets a signal end long operations early.
    on_event : OnEvent
        Receives the events (records of what happened).

    Raises
    ------
    SwitchOffFailed
        If the coil could not be confirmed off.
    InstrumentError
        If the coil is off but the ramp down failed.
    """
    heeded = _SignalsHeeded(coil, guardian, on_event)
    with _noting(heeded):
        if guardian:
            guardian.arm()
        try:
            with (interruption or Interruption()).heeding(heeded):
                yield heeded.stop_if_asked
        finally:
            ramp_down_and_switch_off(coil, guardian, heeded.go_on_down, on_event)
        heeded.stop_if_asked()


@contextmanager
def _noting(heeded: _SignalsHeeded) -> Iterator[None]:
    previous = {}
    if threading.current_thread() is threading.main_thread():
        # An ignored signal stays ignored: a run under nohup outlives its terminal.
        numbers = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
        if SUSPEND is not None:
            numbers.append(SUSPEND)
        previous = {number: signal.signal(number, heeded.note) for number in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def ramp_down_and_switch_off(
    coil: Coil,
    guardian: Guardian | None = None,
    go_on_down: Callable[[], None] = never,
    on_event: OnEvent = ignore_event,
) -> None:
    """Ramp the coil down and switch it off. The coil is switched off even if the ramp down fails.

    Parameters
    ----------
    coil : Coil
        The coil.
    guardian : Guardian or None
        The process that switches the coil off if the run dies; None for a simulated supply.
    go_on_down : callable
        Called between the steps of the ramp. An exception ends the ramp early.
    on_event : OnEvent
        Receives the events (records of what happened).

    Raises
    ------
    SwitchOffFailed
        If the coil could not be confirmed off.
    InstrumentError
        If the coil is off but the ramp down failed.
    """
    try:
        coil.ramp_down(go_on_down)
    except _InHaste:
        _log.info("a second signal to stop came: the coil is switched off at once, without a ramp to zero")
        _off(coil, guardian, on_event)
    except InstrumentError as error:
        _off(coil, guardian, on_event, str(error))
        raise InstrumentError(f"the coil is off, but the ramp of its current to zero failed: {error}") from error
    except BaseException:
        _off(coil, guardian, on_event)
        raise
    else:
        _off(coil, guardian, on_event)


def _off(coil: Coil, guardian: Guardian | None, on_event: OnEvent, failed: str = "") -> None:
    """Switch the coil off, send the result as an event, and disarm the guardian process.

    If the coil could not be confirmed off, the guardian process continues to try. `failed` tells why the ramp failed.
    """
    if guardian:
        guardian.allow(OFF_WITHIN_S)
    reason = failed or coil.unreachable
    doubt = OffNotConfirmed(by="run", reason=reason, trying_process=os.getpid()) if reason else None
    try:
        with doubted_after(DOUBTED_AFTER_S, doubt, on_event):
            off = coil.switch_off()
    except Exception as error:
        measured_A, limit_A = getattr(error, "current_A", None), getattr(error, "limit_A", None)
        on_event(OffNotConfirmed(by="run", reason=str(error), current_A=measured_A, limit_A=limit_A))
        if guardian:
            with suppress(InstrumentError):  # an armed guardian continues to try; in a pause it is disarmed
                guardian.arm()
            if measured_A is not None:
                guardian.recognise()
        raise
    if guardian:
        guardian.disarm()
    _report_off(off, on_event)


def _report_off(off: Off | None, on_event: OnEvent) -> None:
    on_event(OutputSwitched(on=False))
    on_event(off_confirmed(off, "run"))
