"""Show the frames of the camera to a viewer during a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from eimi_drivers.cameras.frame_format import check_frame
from eimi_drivers.interfaces import Camera, Frame, Identity
from eimi_lab.acquisition.playback import Cue


@dataclass(frozen=True)
class Live:
    """The latest frame of a run, with the number of the present state (load step) and its set-point (A).

    Before the first state, number and set-point are None.
    """

    frame: Frame
    state: int | None
    current_A: float | None


Show = Callable[[Live], None]


def show_nothing(live: Live) -> None:
    """Do nothing with a frame."""


class WatchedCamera:
    """A camera that passes every frame to a viewer before returning the frame.

    Parameters
    ----------
    camera : Camera
        Takes the frames.
    show : Show
        Receives every frame; must return quickly.
    cue : Cue
        Receives the number of the present state (load step).
    """

    def __init__(self, camera: Camera, show: Show, cue: Cue) -> None:
        self.watched = camera
        self._show, self._cue = show, cue
        self._first: Frame | None = None
        self._state: int | None = None
        self._current_A: float | None = None
        self._reported_lost: Counter[str] = Counter()

    def at(self, state: int, current_A: float) -> None:
        """Set the number of the state (load step) and the current (A) that the viewer receives with the next frames."""
        self._state, self._current_A = state, current_A
        self._cue.state = state

    def identify(self) -> Identity:
        """Return the identity of the camera."""
        return self.watched.identify()

    def flush(self) -> None:
        """Discard the frames that the camera has taken and that the program has not read yet."""
        self.watched.flush()

    def grab(self, timeout_s: float) -> Frame:
        """Return the next frame, after passing it to the viewer. Raises the errors of `Camera.grab`.

        Raises ReplyNotUnderstood if the frame is no image or if its format differs from the first frame.
        """
        frame = check_frame(self.watched.identify().address, self.watched.grab(timeout_s), self._first)
        self._first = self._first or frame
        self._show(Live(frame, self._state, self._current_A))
        return frame

    def newly_lost(self) -> Counter[str]:
        """Return the number of frames that the camera lost since the previous call, by the reason of the loss.

        The result is empty if the camera does not count lost frames.
        """
        lost = Counter(getattr(self.watched, "lost_frames", {}))
        new, self._reported_lost = lost - self._reported_lost, lost
        return new

    def close(self) -> None:
        """Close the camera."""
        self.watched.close()
