"""Set the current to zero in one step at the end of a run, and record every frame while the beam swings freely.

Another thread sets the current and watches the supply, because this takes longer than the time between two frames.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import pairwise

import numpy as np

from eimi_drivers.interfaces import Frame
from eimi_lab.acquisition.events import RingDownStored, Warned
from eimi_lab.acquisition.settling import GRAB_TIMEOUT_S, wait_until_settled
from eimi_lab.acquisition.stepping import Stepping
from eimi_lab.config.protocol import RingDown
from eimi_lab.dataset.frame_stream import FrameStream
from eimi_lab.dataset.moving.recording_checks import LOST, SLOW
from eimi_lab.dataset.recordings import Moment
from eimi_lab.dataset.steps import RingDownStep, SetPoint

# The second thread calls `Coil.watch` every _LOOK_EVERY_S. It checks the supply _EARLY_S before the check is due, so
# that the run itself never has to check the supply.
_LOOK_EVERY_S, _EARLY_S = 0.1, 0.5
_NO_IMAGE = np.zeros((0, 0), np.uint8)  # replaces the image of a kept frame, so that no image stays in memory
_SAME_PACE = 0.02  # largest relative difference of the rates of the camera's clock and the clock of the run
_WAITED_S = 1.0  # the first or the last frames may have waited in the camera's buffers for this time


def record_ring_downs(run: Stepping, rule: RingDown, unfinished: ExitStack, stop_if_asked: Callable[[], None]) -> None:
    """Record the ring-downs of the protocol that the dataset does not contain yet.

    In a ring-down the current is set to zero in one step, and every frame of the swinging beam is recorded.

    Parameters
    ----------
    run : Stepping
        The run. It sends `RingDownStored` after each ring-down.
    rule : RingDown
        Duration, frame rate and number of the ring-downs.
    unfinished : ExitStack
        Holds the recording in progress; the caller closes this stack after the coil is off.
    stop_if_asked : callable
        Called before each frame; raises an exception if the run has to stop.

    Raises
    ------
    InstrumentError
        If an instrument fails or the current is wrong.
    StorageFailed
        If the frames cannot be stored.
    Stopped
        If a signal asked the run to stop.
    """
    stored = run.writer.ring_downs
    if stored is None:
        reason = (
            "the dataset was begun by an earlier version of eimi-lab and has no place for ring-downs; no ring-down "
            "is recorded"
        )
        run.on_event(Warned(message=reason))
        return
    from_A = run.protocol.ring_down_from_A
    for number in range(stored, rule.repeats):
        run.coil.ramp_to(from_A, stop_if_asked)
        run.coil.wait_until_reached(stop_if_asked)
        wait_until_settled(run.camera, run.clock, run.protocol.settle, run.noise, stop_if_asked)
        recorded = unfinished.enter_context(_recording(run, rule, number, from_A))
        recorded.record(stop_if_asked)
        unfinished.close()


@contextmanager
def _recording(run: Stepping, rule: RingDown, number: int, from_A: float) -> Iterator[_Recorded]:
    """Yield an object that records one ring-down (free swinging of the beam after a step of the current to zero).

    At the end of the context, also after an error, the frames are stored. `from_A` is the current before the step, A.
    """
    failure: BaseException | None = None
    with run.writer.ring_down() as stream:
        recorded = _Recorded(run, rule, stream)
        try:
            yield recorded
        except BaseException as error:  # raised again when the frames are stored
            failure = error
    _store(run, rule, number, from_A, recorded)
    if failure:
        raise failure


def _store(run: Stepping, rule: RingDown, number: int, from_A: float, recorded: _Recorded) -> None:
    frames = recorded.frames
    step = recorded.step or SetPoint(recorded.began_s, 0.0, 0.0)
    times_s = frame_times([at_s for _, at_s in frames], [frame.timestamp_s for frame, _ in frames])
    lost = sum(max(0, later.number - earlier.number - 1) for (earlier, _), (later, _) in pairwise(frames))
    rate_Hz = float(1.0 / np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    flags = [LOST.flag(lost).name] if lost else []
    if rule.rate_Hz and rate_Hz < SLOW.limit * rule.rate_Hz:
        flags.append(SLOW.flag(rate_Hz / rule.rate_Hz).name)
    run.writer.end_ring_down(
        RingDownStep(number, from_A, 0.0, step.time_s - run.began_s, step.uncertainty_s, len(frames), lost, rate_Hz),
        [
            Moment(frame, at_s - run.began_s, at_s - step.time_s, 0.0 if at_s >= step.time_s else from_A)
            for (frame, _), at_s in zip(frames, times_s, strict=True)
        ],
        run.new_set_points(),
    )
    run.on_event(
        RingDownStored(
            ring_down=number,
            ring_downs=rule.repeats,
            from_A=from_A,
            frames=len(frames),
            lost=lost,
            rate_Hz=rate_Hz,
            step_uncertainty_s=step.uncertainty_s,
            flags=tuple(flags),
        )
    )


class _Recorded:
    """The recording of one ring-down (free swinging of the beam): the step of the current to zero, and the frames.

    `frames` contains each frame with its time of arrival, s.
    """

    def __init__(self, run: Stepping, rule: RingDown, stream: FrameStream) -> None:
        self._run, self._rule, self._stream = run, rule, stream
        self.began_s = run.clock.now()
        self.step: SetPoint | None = None
        self.frames: list[tuple[Frame, float]] = []

    def record(self, stop_if_asked: Callable[[], None]) -> None:
        """Set the current to zero, and take every frame until the time in the protocol has passed."""
        run, coil = self._run, self._run.coil
        run.camera.flush()
        if coil.simulated:  # with two threads on the simulated clock, runs could not be repeated exactly
            self.step = coil.step_to(0.0)
            self._take(lambda: run.clock.now() - coil.changed_s < self._rule.seconds, stop_if_asked)
            return
        over = threading.Event()

        def switch_off_and_watch() -> None:
            self.step = coil.step_to(0.0)
            while not over.wait(_LOOK_EVERY_S):
                coil.watch(early_s=_EARLY_S)

        with ThreadPoolExecutor(1, "ring-down") as thread:
            supply = thread.submit(switch_off_and_watch)
            try:
                self._take(
                    lambda: (
                        not supply.done()
                        and (self.step is None or run.clock.now() - coil.changed_s < self._rule.seconds)
                    ),
                    stop_if_asked,
                )
            finally:
                over.set()
        supply.result()

    def _take(self, goes_on: Callable[[], bool], stop_if_asked: Callable[[], None]) -> None:
        while goes_on():
            stop_if_asked()
            frame = self._run.camera.grab(GRAB_TIMEOUT_S)
            at_s = self._run.clock.now()
            self._stream.put(frame.image, stop_if_asked)
            self.frames.append((replace(frame, image=_NO_IMAGE), at_s))


def frame_times(arrived_s: Sequence[float], stamped_s: Sequence[float]) -> list[float]:
    """Return the times of frames (s) on the clock of the run.

    The time stamps of the camera are shifted so that the frame with the shortest delay keeps its time of arrival.
    Without usable time stamps, the times of arrival are returned.

    Parameters
    ----------
    arrived_s : sequence of float
        Times of arrival on the clock of the run, s.
    stamped_s : sequence of float
        Time stamps of the camera, s.

    Returns
    -------
    list of float
        The time of each frame, s.

    Examples
    --------
    >>> frame_times([10.02, 10.05, 10.07], [1.0, 1.02, 1.04])
    [10.02, 10.04, 10.06]
    """
    arrived, stamped = np.asarray(arrived_s, dtype=float), np.asarray(stamped_s, dtype=float)
    if len(arrived) < 2 or not np.isfinite(stamped).all() or (np.diff(stamped) <= 0).any():
        return arrived.tolist()
    delay = arrived - stamped
    if abs(np.ptp(arrived) - np.ptp(stamped)) > _SAME_PACE * np.ptp(arrived) + _WAITED_S:
        return arrived.tolist()
    return np.round(stamped + delay.min(), 9).tolist()
