"""Correct the amplitudes of a vibration for the exposure time of the frames.

A frame with the exposure time T shows the mean position during T. The amplitude of a vibration of frequency f appears
smaller by the factor sin(pi f T) / (pi f T).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eimi_fitting.time.decay import Decay

_LEAST = 0.3  # exposures near a whole period leave almost no amplitude, and are not corrected


def without_blur(decay: Decay, exposure_s: float | None) -> Decay:
    """Correct the amplitudes of fitted vibrations for the exposure time of the frames."""
    shown = float(np.sinc(decay.modes[0].frequency_Hz * (exposure_s or 0.0)))
    if not _LEAST < shown < 1:
        return decay
    windows = tuple(replace(window, amplitude_mm=window.amplitude_mm / shown) for window in decay.windows)
    return replace(decay, amplitude_mm=decay.amplitude_mm / shown, windows=windows)
