"""The frames of one state, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from eimi_drivers.interfaces import Camera, Clock, Frame
from eimi_lab.acquisition.settling import GRAB_TIMEOUT_S, Noise
from eimi_lab.vision.edge_set import Flag


@dataclass(frozen=True)
class Capture:
    """Frames with the current measured (A) and the time on the run's clock (s) of each."""

    frames: tuple[Frame, ...]
    measured_A: tuple[float, ...]
    time_s: tuple[float, ...]
    flags: tuple[Flag, ...]


def capture(
    camera: Camera,
    clock: Clock,
    count: int,
    measured_A: Callable[[], float],
    noise: Noise,
    stop_if_asked: Callable[[], None],
) -> Capture:
    """Take `count` frames, none of them exposed before this call. Raises what camera and `measured_A` raise."""
    camera.flush()
    frames, currents, times = [], [], []
    for _ in range(count):
        stop_if_asked()
        frames.append(camera.grab(GRAB_TIMEOUT_S))
        times.append(clock.now())
        currents.append(measured_A())
    return Capture(tuple(frames), tuple(currents), tuple(times), frame_flags(frames, noise))


def frame_flags(frames: Sequence[Frame], noise: Noise) -> tuple[Flag, ...]:
    """Frames that are missing between neighbours, and neighbours that are the same, noise and all."""
    pairs = list(pairwise(frames))
    missing = sum(max(0, later.number - earlier.number - 1) for earlier, later in pairs)
    same = sum(noise.seen and np.array_equal(earlier.image, later.image) for earlier, later in pairs)
    flags = []
    if missing:
        flags.append(Flag("DROPPED", missing, 0, "Lower the camera's frame rate or free its bus of other devices."))
    if same:
        flags.append(Flag("DUPLICATE", same, 0, "Check that the camera delivers new frames, not one of them again."))
    return tuple(flags)
