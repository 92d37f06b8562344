"""Check that a camera image has the size, bit depth and colours of the first image."""

from __future__ import annotations

from typing import Any

import numpy as np

from eimi_drivers.interfaces import Frame, ReplyNotUnderstood


def check_frame(camera: str, frame: Any, first: Frame | None) -> Frame:
    """Return `frame` if its image has the size, bit depth and colours of the first image.

    Parameters
    ----------
    camera : str
        The name of the camera in messages.
    frame : Frame
        The object that the driver returned.
    first : Frame or None
        The first frame of the run; None if `frame` is the first frame.

    Raises
    ------
    ReplyNotUnderstood
        The image has a wrong shape or type.
    """
    image = getattr(frame, "image", None)
    if not isinstance(image, np.ndarray) or not image.size:
        raise ReplyNotUnderstood(f"{camera}: the camera returned {_named(image)} instead of an image")
    if image.dtype not in (np.uint8, np.uint16) or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
        raise ReplyNotUnderstood(
            f"{camera}: the camera returned {_named(image)}; it should be an array of shape (height, width) or "
            "(height, width, 3) with 8 or 16 bits"
        )
    if first is not None and (image.shape, image.dtype) != (first.image.shape, first.image.dtype):
        raise ReplyNotUnderstood(
            f"{camera}: frame {frame.number} is {_named(image)}, the earlier frames are {_named(first.image)}; size, "
            "bit depth and colours must stay the same for a whole run"
        )
    return frame


def _named(image: Any) -> str:
    if not isinstance(image, np.ndarray):
        return "nothing" if image is None else f"a {type(image).__name__}"
    if not image.size:
        return "an empty image"
    colour = " in colour" if image.ndim == 3 else ""
    return f"{' x '.join(map(str, image.shape[1::-1]))} {image.dtype}{colour}"
