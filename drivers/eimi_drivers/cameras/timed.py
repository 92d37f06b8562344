"""A deadline for every call of a camera, held from outside: a driver's own timeout is worth as much as the driver."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from eimi_drivers.cameras.settings import settings_of
from eimi_drivers.interfaces import Camera, Frame, Identity, InstrumentError, InstrumentTimeout, raised

OPEN_WITHIN_S = 60.0  # a network camera is looked for
ANSWER_WITHIN_S = 5.0
GRACE_S = 0.5
"""Beyond the timeout that a camera is given for a frame."""

LOOK_EVERY_S = 0.1
OPENING = "being opened"

_Answer = TypeVar("_Answer")

_callers: list[threading.Thread] = []


def calls_under_way() -> bool:
    """Whether a camera's driver has not come back from a call; the last one is given a moment to."""
    for caller in _callers:
        caller.join(LOOK_EVERY_S)
    return any(caller.is_alive() for caller in _callers)


class TimedCamera:
    """A camera whose calls are made by a thread of its own.

    One that does not come back in time is an InstrumentTimeout, and so is every call after it: the thread is lost, and
    the process can end without it.
    """

    def __init__(
        self,
        name: str,
        open_it: Callable[[], Camera],
        seconds: Callable[[], float] = time.monotonic,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Open the camera.

        Parameters
        ----------
        name : str
            The camera's name in errors.
        open_it : callable
            Opens the camera.
        seconds : callable
            The clock, in s, that measures the deadlines. A device's time is the host's. A simulated camera's time is
            what it computes, `time.process_time`: a busy host is not its fault.
        meanwhile : callable, optional
            Is called again and again during a call, in the caller's thread, and may raise. The call itself goes on
            then, and the next one waits for it.

        Raises
        ------
        InstrumentTimeout
            If it is not open within `OPEN_WITHIN_S`; and whatever `open_it` raises.
        """
        self._seconds = seconds
        self._name = name
        self._meanwhile = meanwhile
        self._lost = ""
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        caller = threading.Thread(target=self._make_calls, name=f"calls of {name}", daemon=True)
        _callers.append(caller)
        caller.start()
        try:
            self._camera = self._within(OPEN_WITHIN_S, OPENING, open_it)
        except BaseException:
            self._calls.put(None)
            raise
        self.settings = settings_of(self._camera)

    def identify(self) -> Identity:
        """See `Camera.identify`."""
        return self._within(ANSWER_WITHIN_S, "identify", self._camera.identify)

    def flush(self) -> None:
        """See `Camera.flush`."""
        self._within(ANSWER_WITHIN_S, "flush", self._camera.flush)

    def grab(self, timeout_s: float) -> Frame:
        """See `Camera.grab`."""
        return self._within(timeout_s + GRACE_S, "grab", lambda: self._camera.grab(timeout_s))

    def close(self) -> None:
        """See `Camera.close`. Nothing is left to be done for one that is lost."""
        try:
            if not self._lost:
                self._within(ANSWER_WITHIN_S, "close", self._camera.close)
        finally:
            self._calls.put(None)

    def _make_calls(self) -> None:
        while call := self._calls.get():
            call()

    def _within(self, seconds: float, what: str, call: Callable[[], _Answer]) -> _Answer:
        if self._lost:
            raise InstrumentTimeout(self._lost)
        answers: queue.SimpleQueue[tuple[_Answer | None, BaseException | None]] = queue.SimpleQueue()

        def answer() -> None:
            try:
                answers.put((call(), None))
            except BaseException as error:  # whatever it is, it is the caller's to handle
                answers.put((None, error))

        self._calls.put(answer)
        until = self._seconds() + seconds
        while True:
            try:
                found, error = answers.get(timeout=LOOK_EVERY_S)
            except queue.Empty:
                if self._seconds() >= until:
                    self._lost = f"{self._name}: its driver did not come back from {what} within {seconds:g} s"
                    raise InstrumentTimeout(self._lost) from None
                if self._meanwhile:
                    self._meanwhile()
                continue
            if isinstance(error, InstrumentError) or (error is not None and not isinstance(error, Exception)):
                raise error
            if error is not None and what != OPENING:  # a camera's library raises errors of its own
                raise InstrumentError(f"{self._name}: its driver raised {raised(error)} in {what}") from error
            if error is not None:
                raise error
            return found  # type: ignore[return-value]
