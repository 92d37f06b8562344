"""Record frames of the moving beam: while it settles at each state, and while it swings back after the last state."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from eimi_drivers.interfaces import Camera, Clock, Frame
from eimi_lab.acquisition.coil import Coil
from eimi_lab.acquisition.settling import GRAB_TIMEOUT_S
from eimi_lab.dataset.recordings import Moment
from eimi_lab.process.stopping import Stopped

SHORTEST_S = 1e-3  # smallest time between a set-point and a frame
MOST_RELEASE_BYTES = 2 << 30  # the frames of a release stay in memory until the coil is off


class Transient:
    """Keeps at most `budget` frames, spaced logarithmically in the time since the current last changed.

    Creep proceeds with the logarithm of time. After every frame, the remaining frames are distributed again over the
    remaining time, so that the whole budget is used even if the camera is slower than the first intervals.

    Parameters
    ----------
    budget : int
        Largest number of frames.
    timeout_s : float
        Longest time that the beam may take to settle, s.
    coil : Coil
        The coil, for the time of the last set-point.
    """

    def __init__(self, budget: int, timeout_s: float, coil: Coil) -> None:
        self.moments: list[Moment] = []
        self._left, self._timeout_s, self._coil = budget, timeout_s, coil
        self._last_s = self._next_s = 0.0

    def see(self, frame: Frame, at_s: float) -> None:
        """Keep a frame, taken at `at_s` on the run's clock, if the next logarithmic interval has passed."""
        elapsed_s = max(at_s - self._coil.changed_s, SHORTEST_S)
        if not self._last_s:
            self._last_s = elapsed_s + self._timeout_s
        if self._left and elapsed_s >= self._next_s:
            self.moments.append(Moment(frame, at_s, elapsed_s, self._coil.asked_A))
            self._left -= 1
            self._next_s = elapsed_s * (self._last_s / elapsed_s) ** (1 / (self._left + 1))


def record_release(
    camera: Camera, clock: Clock, coil: Coil, seconds: float, stop_if_asked: Callable[[], None]
) -> list[Moment]:
    """Set the current to zero in one step, and record every frame of the camera for `seconds` after that.

    A ramp would be slower than the beam and would suppress its oscillation. Another thread sets the current, because
    the exchange with the supply takes longer than a frame. The times of the frames count from the beginning of this
    exchange. The recording ends early, and keeps its frames, if they fill `MOST_RELEASE_BYTES` or if the run is asked
    to stop. Raises the errors of the camera and of `PowerSupply.set_current`.
    """
    moments: list[Moment] = []
    camera.flush()
    began, stored_bytes = clock.now(), 0
    with ThreadPoolExecutor(1, "release") as aside:
        step = aside.submit(coil.step_to, 0.0)
        while not step.done() or (not step.exception() and clock.now() - coil.changed_s < seconds):
            try:
                stop_if_asked()
                frame = camera.grab(GRAB_TIMEOUT_S)
            except Stopped:  # `switching_off` raises it again
                break
            at_s = clock.now()
            moments.append(Moment(frame, at_s, at_s - began, 0.0))
            stored_bytes += frame.image.nbytes
            if stored_bytes > MOST_RELEASE_BYTES:
                break
    step.result()
    return moments
