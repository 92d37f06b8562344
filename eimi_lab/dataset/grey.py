"""Grey images as they are stored: one number a pixel, of the camera's own depth."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from eimi_lab.vision import intensity


def grey(image: NDArray[Any]) -> NDArray[Any]:
    """(H, W) or (H, W, 3) to (H, W) of the same type, by the rule of `eimi_lab.vision.intensity.grey`."""
    return intensity.grey(image).astype(image.dtype, copy=False)
