"""A look at what the camera sees while a run goes on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from eimi_drivers.cameras.frame_format import check_frame
from eimi_drivers.interfaces import Camera, Frame, Identity
from eimi_lab.acquisition.playback import Cue


@dataclass(frozen=True)
class Live:
    """The latest frame, and the state and current (A) that the run is at; None before the first."""

    frame: Frame
    state: int | None
    current_A: float | None


Show = Callable[[Live], None]


def show_nobody(live: Live) -> None:
    """For a run that nobody watches."""


class WatchedCamera:
    """A camera that shows every frame on its way to the run.

    `show` is called in the run's own thread: it must be quick, and an error in it ends the run.
    """

    def __init__(self, camera: Camera, show: Show, cue: Cue) -> None:
        self.watched = camera
        self._show, self._cue = show, cue
        self._first: Frame | None = None
        self._state: int | None = None
        self._current_A: float | None = None

    def at(self, state: int, current_A: float) -> None:
        """The frames from here on belong to this state."""
        self._state, self._current_A = state, current_A
        self._cue.state = state

    def identify(self) -> Identity:
        """See `Camera.identify`."""
        return self.watched.identify()

    def flush(self) -> None:
        """See `Camera.flush`."""
        self.watched.flush()

    def grab(self, timeout_s: float) -> Frame:
        """See `Camera.grab`. Raises ReplyNotUnderstood for what is no image, or not like the first."""
        frame = check_frame(self.watched.identify().address, self.watched.grab(timeout_s), self._first)
        self._first = self._first or frame
        self._show(Live(frame, self._state, self._current_A))
        return frame

    def close(self) -> None:
        """See `Camera.close`."""
        self.watched.close()
