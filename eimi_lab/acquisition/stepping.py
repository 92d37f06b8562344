"""Take one state (load step) after another: ramp, wait for the current and the beam, take and store the frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from eimi_drivers.interfaces import Clock, InstrumentError
from eimi_lab.acquisition.capture import capture
from eimi_lab.acquisition.coil import Coil
from eimi_lab.acquisition.events import FramesLost, OnEvent, Settled, StateStored
from eimi_lab.acquisition.guardian import Guardian
from eimi_lab.acquisition.live_view import WatchedCamera
from eimi_lab.acquisition.sensing import Sensing
from eimi_lab.acquisition.settling import ignore_frame, wait_until_settled
from eimi_lab.acquisition.transients import Transient
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.recordings import Moment
from eimi_lab.dataset.steps import SetPoint
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.vision.check import Flag
from eimi_lab.vision.flags import judge
from eimi_lab.vision.settling_statistic import Noise

MISSING = "missing_frames"
"""Name of the check that counts missing frames; a state with missing frames has the flag DROPPED."""


@dataclass(frozen=True, kw_only=True)
class Stepping:
    """A run in progress: its files, its open instruments, its writer and its clock.

    `noise` is the noise of the camera. `began_s` is the time on the clock (s) at which the run, or the first part of a
    resumed run, began. `on_event` receives the events (records of what happened). `guardian` is the connection to the
    process that switches the coil off if the run dies; None for a simulated supply.
    """

    protocol: Protocol
    specimen: SpecimenFile
    calibration: Calibration
    coil: Coil
    camera: WatchedCamera
    clock: Clock
    sensing: Sensing
    guardian: Guardian | None
    noise: Noise
    writer: DatasetWriter
    began_s: float
    on_event: OnEvent

    def go_back_to(self, state: int, stop_if_asked: Callable[[], None]) -> None:
        """Ramp through the currents of all earlier load steps, without taking frames."""
        # While the leads of the coil are swapped, only the negative currents are set.
        for current_A in self.protocol.currents_A[:state]:
            if current_A < 0 or not self.coil.leads_swapped:
                self.coil.ramp_to(current_A, stop_if_asked)

    def report_lost_frames(self, state: int | None) -> int:
        """Return the number of frames that the camera lost since the previous call.

        Send `FramesLost` if the number is not zero. `state` is the number of the present state (load step), if there is
        one.
        """
        reasons = self.camera.newly_lost()
        if reasons:
            self.on_event(FramesLost(state=state, frames=reasons.total(), reasons=dict(reasons)))
        return reasons.total()

    def take(self, state: int, stop_if_asked: Callable[[], None]) -> None:
        """Take the frames of the state (load step) with number `state`, and store the state.

        Parameters
        ----------
        state : int
            Number of the state, from 0.
        stop_if_asked : callable
            Called between the operations; raises an exception if the run has to stop.

        Raises
        ------
        InstrumentError
            If an instrument fails or the current is wrong.
        StorageFailed
            If the state cannot be stored.
        Stopped
            If a signal asked the run to stop.
        """
        self.report_lost_frames(None)
        try:
            self._take(state, stop_if_asked)
        except InstrumentError:
            self.report_lost_frames(state)
            raise

    def _take(self, state: int, stop_if_asked: Callable[[], None]) -> None:
        current_A, protocol = self.protocol.currents_A[state], self.protocol
        self.camera.at(state, current_A)
        self.coil.ramp_to(current_A, stop_if_asked)
        self.coil.wait_until_reached(stop_if_asked)
        rule = protocol.settle
        transient = Transient(protocol.transients.frames_per_state, rule.dwell_s or rule.timeout_s, self.coil)
        settled = wait_until_settled(
            self.camera,
            self.clock,
            rule,
            self.noise,
            stop_if_asked,
            transient.see,
            self.coil.changed_s + rule.dwell_s if rule.dwell_s else 0.0,
        )
        self.on_event(Settled(state=state, waited_s=settled.waited_s, at_rest=not settled.flags))
        self.coil.check()
        taken = capture(
            self.camera,
            self.clock,
            protocol.frames_per_state,
            self.coil.measured_A,
            self.sensing.read,
            self.noise,
            stop_if_asked,
            transient.see if protocol.creep else ignore_frame,
        )
        flags = settled.flags + _with_lost_frames(taken.flags, self.report_lost_frames(state))
        self.writer.append_state(
            taken.frames,
            current_A=current_A,
            field_mT=current_A * self.calibration.mT_per_A,
            measured_A=taken.measured_A,
            time_s=[at_s - self.began_s for at_s in taken.time_s],
            tip_force_N=self.protocol.tip_force_N,
            flags=flags,
            transient=self._on_the_run(transient.moments),
            sensed=[
                {name: replace(reading, time_s=reading.time_s - self.began_s) for name, reading in readings.items()}
                for readings in taken.sensed
            ],
            set_points=self.new_set_points(),
        )
        names = tuple(flag.name for flag in flags)
        self.on_event(StateStored(state=state, current_A=current_A, waited_s=settled.waited_s, flags=names))

    def store(self, recording: str, belongs_to: Sequence[int], moments: Sequence[Moment]) -> None:
        """Store additional frames, such as those of load cycles before the run. Raises StorageFailed.

        Parameters
        ----------
        recording : str
            Name under which the dataset stores the frames.
        belongs_to : sequence of int
            Number of the state or load cycle of each frame.
        moments : sequence of Moment
            The frames with their times.
        """
        if moments:
            self.writer.append_recording(recording, belongs_to, self._on_the_run(moments))

    def new_set_points(self) -> list[SetPoint]:
        """Return the set-points that were sent since the previous call, with times from the beginning of the run."""
        return [replace(point, time_s=point.time_s - self.began_s) for point in self.coil.new_set_points()]

    def _on_the_run(self, moments: Sequence[Moment]) -> list[Moment]:
        return [replace(moment, time_s=moment.time_s - self.began_s) for moment in moments]


def _with_lost_frames(flags: tuple[Flag, ...], lost: int) -> tuple[Flag, ...]:
    """Return the flags (failed checks) of a load step, with DROPPED if the camera lost frames."""
    if not lost:
        return flags
    (dropped,) = judge({MISSING: lost})
    return (*(flag for flag in flags if flag.name != dropped.name), dropped)
