"""The amplitudes of a vibration, corrected for the exposure of the frames.

A frame that is exposed for the time T shows the mean place of the beam in this time. The amplitude of a vibration of
frequency f is thereby smaller by the factor sin(pi f T) / (pi f T). Frequency and loss do not change.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eimi_fitting.time.decay import Decay

_LEAST = 0.3  # exposures near a whole period leave almost no amplitude, and are not corrected


def without_blur(decay: Decay, exposure_s: float | None) -> Decay:
    """Return a decay with the amplitudes of the beam instead of those of the frames.

    Parameters
    ----------
    decay : Decay
    exposure_s : float or None
        Exposure of a frame; None if it is not known, which leaves the decay as it is.
    """
    shown = float(np.sinc(decay.modes[0].frequency_Hz * (exposure_s or 0.0)))
    if not _LEAST < shown < 1:
        return decay
    windows = tuple(replace(window, amplitude_mm=window.amplitude_mm / shown) for window in decay.windows)
    return replace(decay, amplitude_mm=decay.amplitude_mm / shown, windows=windows)
