"""The amplitudes of a beam's vibration, corrected for the exposure time of the frames.

A frame with the exposure time T shows the mean position of the beam during T. The amplitude of a vibration of frequency
f appears smaller by the factor sin(pi f T) / (pi f T). The exposure does not change the frequency and the loss factor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eimi_fitting.time.decay import Decay

_LEAST = 0.3  # exposures near a whole period leave almost no amplitude, and are not corrected


def without_blur(decay: Decay, exposure_s: float | None) -> Decay:
    """Return fitted vibrations with the amplitudes of the beam, which are larger than the amplitudes in the frames.

    A frame shows the mean position during its exposure, which makes an amplitude smaller.

    Parameters
    ----------
    decay : Decay
        The vibrations, fitted to the frames.
    exposure_s : float or None
        Exposure time of a frame; None if it is not known. The vibrations are then returned unchanged.
    """
    shown = float(np.sinc(decay.modes[0].frequency_Hz * (exposure_s or 0.0)))
    if not _LEAST < shown < 1:
        return decay
    windows = tuple(replace(window, amplitude_mm=window.amplitude_mm / shown) for window in decay.windows)
    return replace(decay, amplitude_mm=decay.amplitude_mm / shown, windows=windows)
