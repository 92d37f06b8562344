"""Record frames of the beam while it settles after a change of the current, or while it creeps at constant current."""

from __future__ import annotations

from eimi_drivers.interfaces import Frame
from eimi_lab.acquisition.coil import Coil
from eimi_lab.dataset.recordings import Moment

SHORTEST_S = 1e-3  # smallest time between a set-point and a frame


class Transient:
    """The frames of a state (load step) that are kept while the beam settles or creeps.

    The times of the kept frames since the last change of the current form a geometric series.

    Parameters
    ----------
    budget : int
        Largest number of kept frames.
    lasts_s : float
        Longest time from the first to the last kept frame, s.
    coil : Coil
        The coil, which gives the time of its last set-point.

    Attributes
    ----------
    moments : list of Moment
        The kept frames with their times.
    """

    def __init__(self, budget: int, lasts_s: float, coil: Coil) -> None:
        self.moments: list[Moment] = []
        self._left, self._lasts_s, self._coil = budget, lasts_s, coil
        self._last_s = self._next_s = 0.0

    def see(self, frame: Frame, at_s: float) -> None:
        """Add a new frame to `moments` if enough time has passed since the last kept frame.

        `at_s` is the time of the frame on the clock of the run, s.
        """
        elapsed_s = max(at_s - self._coil.changed_s, SHORTEST_S)
        if not self._last_s:
            self._last_s = elapsed_s + self._lasts_s
        if self._left and elapsed_s >= self._next_s:
            self.moments.append(Moment(frame, at_s, elapsed_s, self._coil.asked_A))
            self._left -= 1
            # Creep proceeds with the logarithm of time. The series begins again at each frame, so that a slow camera
            # does not reduce the number of kept frames.
            self._next_s = elapsed_s * (self._last_s / elapsed_s) ** (1 / (self._left + 1))
