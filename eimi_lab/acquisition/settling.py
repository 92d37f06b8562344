"""Whether the beam is at rest: consecutive frames then differ by the camera's noise alone.

The measure is that of `eimi_lab.vision.settling_statistic`; the noise is measured before the run, with the coil off.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.interfaces import Camera, Clock, Frame
from eimi_lab.config.protocol import Settle
from eimi_lab.vision.check import Flag
from eimi_lab.vision.flags import CHECK_OF
from eimi_lab.vision.intensity import mean_grey
from eimi_lab.vision.settling_statistic import Noise

GRAB_TIMEOUT_S = 5.0


@dataclass(frozen=True)
class Settling:
    """How the wait ended: last ratio of two neighbours, last ratio over the drift window, seconds, a flag if vain."""

    ratio: float
    drift_ratio: float
    waited_s: float
    flags: tuple[Flag, ...]


def unseen(frame: Frame, at_s: float) -> None:
    """For a beam that settles unwatched."""


def wait_until_settled(
    camera: Camera,
    clock: Clock,
    rule: Settle,
    noise: Noise,
    stop_if_asked: Callable[[], None],
    see: Callable[[Frame, float], None] = unseen,
) -> Settling:
    """Watch the beam until it rests or the time is out. Raises what `Camera.grab` raises.

    see: is given every new frame and the clock's time of it.

    At rest is: `pairs` neighbouring frames in a row below `noise_ratio`, and the same for two frames
    `drift_window_s` apart, for silicone creeps. A frame that repeats the one before, noise and all, says nothing.
    """
    camera.flush()
    began = clock.now()
    past: deque[tuple[float, NDArray[Any]]] = deque()
    quiet, ratio, drift = 0, float("inf"), float("inf")
    while clock.now() - began <= rule.timeout_s:
        stop_if_asked()
        frame = camera.grab(GRAB_TIMEOUT_S)
        at, image = clock.now(), mean_grey(frame.image)
        if past:
            if noise.exceeds_rounding and np.array_equal(past[-1][1], image):
                continue
            ratio = noise.difference_ratio(past[-1][1], image)
            quiet = quiet + 1 if ratio <= rule.noise_ratio else 0
        see(frame, at)
        past.append((at, image))
        while len(past) > 1 and past[1][0] <= at - rule.drift_window_s:
            past.popleft()
        if quiet >= rule.pairs and past[0][0] <= at - rule.drift_window_s:
            drift = noise.difference_ratio(past[0][1], image)
            if drift <= rule.noise_ratio:
                return Settling(ratio, drift, at - began, ())
    worst = ratio if not np.isfinite(drift) else max(ratio, drift)
    flag = CHECK_OF["settling_ratio"].flag(worst if np.isfinite(worst) else 0.0, rule.noise_ratio)
    return Settling(ratio, drift, clock.now() - began, (flag,))
