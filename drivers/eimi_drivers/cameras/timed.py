"""Set a time limit for every call of a camera."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping
from typing import TypeVar

from eimi_drivers.cameras.settings import settings_of
from eimi_drivers.interfaces import Camera, Frame, Identity, InstrumentError, InstrumentTimeout, raised

OPEN_WITHIN_S = 60.0  # a long time, because the search for a camera on the network is slow
ANSWER_WITHIN_S = 5.0
GRACE_S = 0.5
"""Time (s) after the timeout of `grab` within which the driver must return."""

LOOK_EVERY_S = 0.1
HEED_EVERY_S = 0.02
"""Interval (s) at which the function `meanwhile` is called while a call has not returned."""

OPENING = "being opened"

_Answer = TypeVar("_Answer")

_callers: list[threading.Thread] = []


def calls_under_way() -> bool:
    """Return whether a call of any camera still runs in its thread."""
    for caller in _callers:
        caller.join(LOOK_EVERY_S)
    return any(caller.is_alive() for caller in _callers)


class TimedCamera:
    """A camera whose calls are made in a separate thread and have a time limit.

    A call that exceeds its time limit raises InstrumentTimeout, and so does every later call.
    """

    def __init__(
        self,
        name: str,
        open_it: Callable[[], Camera],
        seconds: Callable[[], float] = time.monotonic,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Open the camera in a separate thread.

        Parameters
        ----------
        name : str
            The name of the camera in messages.
        open_it : callable
            A function that opens and returns the camera.
        seconds : callable
            A function that returns the time (s) with which the time limits are measured.
        meanwhile : callable, optional
            A function that is called repeatedly while a call of the camera runs. An error that it raises ends the wait.

        Raises
        ------
        InstrumentTimeout
            The camera was not open within `OPEN_WITHIN_S` (s).
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
        """Return the identity of the camera."""
        return self._within(ANSWER_WITHIN_S, "identify", self._camera.identify)

    def flush(self) -> None:
        """Discard the frames that were exposed before this call."""
        self._within(ANSWER_WITHIN_S, "flush", self._camera.flush)

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame, for which the driver may wait `timeout_s` (s)."""
        return self._within(timeout_s + GRACE_S, "grab", lambda: self._camera.grab(timeout_s))

    @property
    def lost_frames(self) -> Mapping[str, int]:
        """The number of lost frames, by reason; empty if the driver does not count lost frames."""
        return dict(getattr(self._camera, "lost_frames", {}))

    def close(self) -> None:
        """Release the camera."""
        try:
            if not self._lost:
                self._within(ANSWER_WITHIN_S, "close", self._camera.close)
        finally:
            self._calls.put(None)

    def _make_calls(self) -> None:
        while call := self._calls.get():
            call()

    def _within(self, seconds: float, call_name: str, call: Callable[[], _Answer]) -> _Answer:
        if self._lost:
            raise InstrumentTimeout(self._lost)
        answers: queue.SimpleQueue[tuple[_Answer | None, BaseException | None]] = queue.SimpleQueue()

        def answer() -> None:
            try:
                answers.put((call(), None))
            except BaseException as error:  # passed on to the thread that waits
                answers.put((None, error))

        self._calls.put(answer)
        until = self._seconds() + seconds
        while True:
            try:
                answer_of_call, error = answers.get(timeout=HEED_EVERY_S)
            except queue.Empty:
                # Called before the check of the time limit: if the computer was asleep, the time limit is exceeded
                # although the driver is not slow, and the function can report this.
                if self._meanwhile:
                    self._meanwhile()
                if self._seconds() >= until:
                    self._lost = f"{self._name}: its driver did not return from {call_name} within {seconds:g} s"
                    raise InstrumentTimeout(self._lost) from None
                continue
            if isinstance(error, InstrumentError) or (error is not None and not isinstance(error, Exception)):
                raise error
            if error is not None and call_name != OPENING:  # a camera's library raises errors of its own
                raise InstrumentError(f"{self._name}: its driver raised {raised(error)} in {call_name}") from error
            if error is not None:
                raise error
            return answer_of_call  # type: ignore[return-value]
