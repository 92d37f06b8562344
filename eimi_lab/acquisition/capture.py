"""Take the frames of one state (load step), and flag frames with defects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from eimi_drivers.interfaces import Camera, Clock, Frame, SensorReading
from eimi_lab.acquisition.settling import GRAB_TIMEOUT_S, ignore_frame
from eimi_lab.vision.check import Flag
from eimi_lab.vision.frame_checks import frame_flags
from eimi_lab.vision.settling_statistic import Noise


@dataclass(frozen=True)
class Capture:
    """The frames of one state (load step), with their readings and defects.

    Attributes
    ----------
    frames : tuple of Frame
        The frames, in the order of their exposure.
    measured_A : tuple of float
        Current measured after each frame, A.
    time_s : tuple of float
        Time at which each frame arrived, s on the clock of the run.
    sensed : tuple of mapping
        Readings of the sensors after each frame, by the name of the sensor.
    flags : tuple of Flag
        Names of the defects of the frames.
    """

    frames: tuple[Frame, ...]
    measured_A: tuple[float, ...]
    time_s: tuple[float, ...]
    sensed: tuple[Mapping[str, SensorReading], ...]
    flags: tuple[Flag, ...]


def capture(
    camera: Camera,
    clock: Clock,
    count: int,
    measured_A: Callable[[], float],
    sense: Callable[[], Mapping[str, SensorReading]],
    noise: Noise,
    stop_if_asked: Callable[[], None],
    see: Callable[[Frame, float], None] = ignore_frame,
) -> Capture:
    """Take `count` frames that are exposed after this call.

    Parameters
    ----------
    camera : Camera
        Takes the frames.
    clock : Clock
        Gives the time of each frame.
    count : int
        Number of frames.
    measured_A : callable
        Measures the current, A, after each frame.
    sense : callable
        Reads the sensors after each frame.
    noise : Noise
        Noise of the camera.
    stop_if_asked : callable
        Called before each frame; raises an exception if the run has to stop.
    see : callable
        Receives every frame and its time (s).

    Returns
    -------
    Capture
        The frames with their currents, times, sensor readings and defects.
    """
    camera.flush()
    frames, currents, times, sensed = [], [], [], []
    for _ in range(count):
        stop_if_asked()
        frames.append(camera.grab(GRAB_TIMEOUT_S))
        times.append(clock.now())
        see(frames[-1], times[-1])
        currents.append(measured_A())
        sensed.append(sense())
    return Capture(tuple(frames), tuple(currents), tuple(times), tuple(sensed), frame_flags(frames, noise))
