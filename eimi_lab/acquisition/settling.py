"""Wait until the beam is at rest, which means that consecutive frames differ only by the noise of the camera."""

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
from eimi_lab.vision.settling_statistic import Noise, edge_pixels

GRAB_TIMEOUT_S = 5.0


@dataclass(frozen=True)
class Settling:
    """The result of a wait for the beam to come to rest.

    The difference ratio of two frames is their mean squared difference divided by the part due to noise. `settle.pairs`
    and `settle.drift_window_s` are values in the protocol.

    Attributes
    ----------
    ratio : float
        Difference ratio of the last two frames; if the beam still moved, the largest ratio of the last `settle.pairs`
        pairs of consecutive frames.
    drift_ratio : float
        Last difference ratio of two frames `settle.drift_window_s` apart; infinite if none was computed.
    waited_s : float
        Duration of the wait, s.
    flags : tuple of Flag
        Empty if the beam came to rest; otherwise NOT_SETTLED.
    """

    ratio: float
    drift_ratio: float
    waited_s: float
    flags: tuple[Flag, ...]


def ignore_frame(frame: Frame, at_s: float) -> None:
    """Do nothing with a frame."""


def wait_until_settled(
    camera: Camera,
    clock: Clock,
    rule: Settle,
    noise: Noise,
    stop_if_asked: Callable[[], None],
    see: Callable[[Frame, float], None] = ignore_frame,
    not_before_s: float = 0.0,
) -> Settling:
    """Take frames until the beam is at rest or `rule.timeout_s` has passed. Raises the errors of `Camera.grab`.

    The difference ratio of two frames is their mean squared difference divided by the part due to noise; it is small if
    it is at most `rule.noise_ratio`. The beam is at rest if the ratio is small for `rule.pairs` pairs of consecutive
    frames in a row, and for two frames `rule.drift_window_s` apart. Only pixels near the edges of the beam count.

    Parameters
    ----------
    camera : Camera
        Takes the frames.
    clock : Clock
        Measures the time.
    rule : Settle
        Table [settle] of the protocol, with the limits.
    noise : Noise
        Noise of the camera.
    stop_if_asked : callable
        Called before and after each frame; raises an exception if the run has to stop.
    see : callable
        Receives every new frame and its time (s).
    not_before_s : float
        Time on the clock (s) before which the wait does not end.

    Returns
    -------
    Settling
        The last ratios, the duration, and a flag if the beam did not come to rest.
    """
    camera.flush()
    began = at = clock.now()
    past: deque[tuple[float, NDArray[Any]]] = deque()
    quiet, ratio, drift = 0, float("inf"), float("inf")  # quiet: number of successive pairs with a small ratio
    recent: deque[float] = deque(maxlen=rule.pairs)  # several ratios, because one ratio may be small by chance
    band = None
    while at <= max(began + rule.timeout_s, not_before_s):
        stop_if_asked()
        frame = camera.grab(GRAB_TIMEOUT_S)
        at = clock.now()
        stop_if_asked()  # a frame may take long, and so does the computation of the band below
        image = mean_grey(frame.image)
        if past:
            previous = past[-1][1]
            if noise.exceeds_rounding and np.array_equal(previous, image):
                continue
            band = edge_pixels(image) if band is None else band
            ratio = noise.difference_ratio(previous, image, band)
            if ratio <= rule.noise_ratio and not quiet:  # the beam may have left the band
                band = edge_pixels(image)
                ratio = noise.difference_ratio(previous, image, band)
            quiet = quiet + 1 if ratio <= rule.noise_ratio else 0
            recent.append(ratio)
        see(frame, at)
        past.append((at, image))
        while len(past) > 1 and past[1][0] <= at - rule.drift_window_s:
            past.popleft()
        if quiet >= rule.pairs and past[0][0] <= at - rule.drift_window_s and at >= not_before_s:
            drift = noise.difference_ratio(past[0][1], image, band)
            if drift <= rule.noise_ratio:  # decide with the band along the edges of the last frame
                band = edge_pixels(image)
                ratio = noise.difference_ratio(previous, image, band)
                drift = noise.difference_ratio(past[0][1], image, band)
                if max(ratio, drift) <= rule.noise_ratio:
                    return Settling(ratio, drift, at - began, ())
                quiet = quiet if ratio <= rule.noise_ratio else 0
    largest = max(recent, default=ratio)
    worst = largest if not np.isfinite(drift) else max(largest, drift)
    flag = CHECK_OF["settling_ratio"].flag(worst if np.isfinite(worst) else 0.0, rule.noise_ratio)
    return Settling(largest, drift, clock.now() - began, (flag,))
