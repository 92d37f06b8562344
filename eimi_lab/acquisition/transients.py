"""What the beam does between states: frames kept while it settles, and while it swings back after the last state."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from eimi_drivers.interfaces import Camera, Clock, Frame
from eimi_lab.acquisition.coil import Coil
from eimi_lab.acquisition.settling import GRAB_TIMEOUT_S
from eimi_lab.dataset.recordings import Moment
from eimi_lab.process.stopping import Stopped

SHORTEST_S = 1e-3  # between a set-point and a frame
MOST_RELEASE_BYTES = 2 << 30  # in memory until the coil is off


class Transient:
    """Keeps `budget` frames at most, log-spaced in the time since the current last changed.

    Creep and ring-down go with the logarithm of time. What is left of the budget is spread anew over what is left of
    the time after every frame, so that a camera slower than the first intervals loses none of it.
    """

    def __init__(self, budget: int, timeout_s: float, coil: Coil) -> None:
        """timeout_s: how long the beam may take to settle."""
        self.moments: list[Moment] = []
        self._left, self._timeout_s, self._coil = budget, timeout_s, coil
        self._last_s = self._next_s = 0.0

    def see(self, frame: Frame, at_s: float) -> None:
        """Keep a frame taken at `at_s` on the run's clock, if it is one of those to keep."""
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
    """Let the current go to zero in one step; every frame of the camera from then on for so long.

    One step, since a ramp is slower than the beam and would leave nothing to see. The supply is talked to in another
    thread, for that takes longer than a frame; times count from when it was told. Ends early where the frames would
    fill MOST_RELEASE_BYTES, and when it is asked to stop: what was recorded is kept. Raises what the camera and
    `PowerSupply.set_current` raise.
    """
    moments: list[Moment] = []
    camera.flush()
    began, held = clock.now(), 0
    with ThreadPoolExecutor(1, "release") as aside:
        step = aside.submit(coil.step_to, 0.0)
        while not step.done() or (not step.exception() and clock.now() - coil.changed_s < seconds):
            try:
                stop_if_asked()
                frame = camera.grab(GRAB_TIMEOUT_S)
            except Stopped:  # whoever switches off asks again
                break
            at_s = clock.now()
            moments.append(Moment(frame, at_s, at_s - began, 0.0))
            held += frame.image.nbytes
            if held > MOST_RELEASE_BYTES:
                break
    step.result()
    return moments
