"""Set a deadline for every call of a camera, so that the suite does not depend on the timeouts of its driver."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping
from typing import TypeVar

from eimi_drivers.cameras.settings import settings_of
from eimi_drivers.interfaces import Camera, Frame, Identity, InstrumentError, InstrumentTimeout, raised

OPEN_WITHIN_S = 60.0  # finding a network camera takes long
ANSWER_WITHIN_S = 5.0
GRACE_S = 0.5
"""Extra time after the timeout of `grab` before the call counts as hanging, s."""

LOOK_EVERY_S = 0.1
OPENING = "being opened"

_Answer = TypeVar("_Answer")

_callers: list[threading.Thread] = []


def calls_under_way() -> bool:
    """Return whether a camera call is still running, after a short wait for each calling thread."""
    for caller in _callers:
        caller.join(LOOK_EVERY_S)
    return any(caller.is_alive() for caller in _callers)


class TimedCamera:
    """Call a camera from a separate thread and stop waiting at a deadline.

    If a call has not returned at its deadline, InstrumentTimeout is raised, and every later call raises it too. The
    thread that made the call is abandoned; it does not keep the process from ending.
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
            The clock (s) that measures the deadlines. For a real camera this is the host's clock. For a simulated
            camera it is the processor time, `time.process_time`, so that other programs on the host cause no timeout.
        meanwhile : callable, optional
            Is called repeatedly in the thread of the caller while a call of the camera runs. It may raise an error.
            The call of the camera then continues, and the next call waits for it.

        Raises
        ------
        InstrumentTimeout
            The camera is not open within `OPEN_WITHIN_S`. An error of `open_it` is passed on.
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
        """Ask the camera for its identity, see `Camera.identify`."""
        return self._within(ANSWER_WITHIN_S, "identify", self._camera.identify)

    def flush(self) -> None:
        """Discard old frames, see `Camera.flush`."""
        self._within(ANSWER_WITHIN_S, "flush", self._camera.flush)

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame, see `Camera.grab`."""
        return self._within(timeout_s + GRACE_S, "grab", lambda: self._camera.grab(timeout_s))

    @property
    def lost_frames(self) -> Mapping[str, int]:
        """The number of lost frames by reason; empty if the camera does not count them."""
        return dict(getattr(self._camera, "lost_frames", {}))

    def close(self) -> None:
        """Release the camera, see `Camera.close`; do nothing if an earlier call has not returned."""
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
            except BaseException as error:  # passed on to the thread that waits
                answers.put((None, error))

        self._calls.put(answer)
        until = self._seconds() + seconds
        while True:
            try:
                answer_of_call, error = answers.get(timeout=LOOK_EVERY_S)
            except queue.Empty:
                if self._meanwhile:  # first: after a sleep of the computer, the driver is not the cause
                    self._meanwhile()
                if self._seconds() >= until:
                    self._lost = f"{self._name}: its driver did not come back from {what} within {seconds:g} s"
                    raise InstrumentTimeout(self._lost) from None
                continue
            if isinstance(error, InstrumentError) or (error is not None and not isinstance(error, Exception)):
                raise error
            if error is not None and what != OPENING:  # a camera's library raises errors of its own
                raise InstrumentError(f"{self._name}: its driver raised {raised(error)} in {what}") from error
            if error is not None:
                raise error
            return answer_of_call  # type: ignore[return-value]
