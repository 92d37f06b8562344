"""Change photographs as a camera, a lamp or a picture program may change them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.shared.real_pictures import Picture

Image = NDArray[Any]
Change = Callable[[Image], Image]


def _scaled(share: float) -> Change:
    kind = cv2.INTER_AREA if share < 1.0 else cv2.INTER_CUBIC
    return lambda image: cv2.resize(image, None, fx=share, fy=share, interpolation=kind)


def _brighter(factor: float, added: float = 0.0) -> Change:
    return lambda image: _in_range(factor * image.astype(np.float32) + added)


def _with_gamma(power: float) -> Change:
    return lambda image: _in_range(255.0 * (image / np.float32(255.0)) ** power)


def _noisy(deviation: float) -> Change:
    def change(image: Image) -> Image:
        return _in_range(image + deviation * np.random.default_rng(1).standard_normal(image.shape, dtype=np.float32))

    return change


def _lit_from(direction: tuple[float, float]) -> Change:
    """Return a change of a picture: light that increases from one side (factor 0.5) to the other (factor 1.3).

    direction : unit vector (right, down) toward the bright side
    """

    def change(image: Image) -> Image:
        high, wide = image.shape[:2]
        y, x = np.mgrid[-1.0 : 1.0 : high * 1j, -1.0 : 1.0 : wide * 1j]
        light = 0.9 + 0.4 * (direction[0] * x + direction[1] * y)
        return _in_range(image * (light[..., None] if image.ndim == 3 else light))

    return change


def _of_hue(turn_deg: float) -> Change:
    def change(image: Image) -> Image:
        if image.ndim == 2:
            return image
        hue, saturation, value = cv2.split(cv2.cvtColor(image, cv2.COLOR_BGR2HSV))
        turned = ((hue.astype(int) + round(turn_deg / 2.0)) % 180).astype(np.uint8)  # OpenCV stores half degrees
        return np.asarray(cv2.cvtColor(cv2.merge([turned, saturation, value]), cv2.COLOR_HSV2BGR))

    return change


def _stored(quality: int) -> Change:
    def change(image: Image) -> Image:
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))

    return change


def _blurred(deviation_px: float) -> Change:
    return lambda image: np.asarray(cv2.GaussianBlur(image, (0, 0), deviation_px))


def _in_range(values: Image) -> Image:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def _mirrored(image: Image) -> Image:
    return np.ascontiguousarray(image[:, ::-1])


CHANGES: dict[str, Change] = {
    "scale 0.5": _scaled(0.5),
    "scale 0.7": _scaled(0.7),
    "scale 1.4": _scaled(1.4),
    "scale 2": _scaled(2.0),
    "half as bright": _brighter(0.5),
    "brighter by 40": _brighter(1.0, 40.0),
    "1.4 times as bright": _brighter(1.4),
    "gamma 0.6": _with_gamma(0.6),
    "gamma 1.6": _with_gamma(1.6),
    "noise 6": _noisy(6.0),
    "noise 12": _noisy(12.0),
    "light from the right": _lit_from((1.0, 0.0)),
    "light from below": _lit_from((0.0, 1.0)),
    "hue + 40 deg": _of_hue(40.0),
    "hue - 60 deg": _of_hue(-60.0),
    "mirrored": _mirrored,
    "JPEG 30": _stored(30),
    "JPEG 60": _stored(60),
    "blur 1 px": _blurred(1.0),
    "blur 2 px": _blurred(2.0),
}
"""Functions that change a photograph, by the name of the change."""


def perturbed(picture: Picture, name: str) -> Picture:
    """Return a picture after the change `name` (a key of `CHANGES`), with the calibration of the changed picture."""
    image = CHANGES[name](picture.image)
    x, y = picture.calibration.clamp_midpoint_px
    changes: dict[str, object] = {}
    if name == "mirrored":
        changes = {
            "clamp_midpoint_px": (image.shape[1] - 1.0 - x, y),
            "axis_angle_deg": 180.0 - picture.calibration.axis_angle_deg,
            "field_angle_deg": 180.0 - (picture.calibration.field_angle_deg or 0.0),
        }
    elif name.startswith("scale"):
        share = image.shape[1] / picture.image.shape[1]
        changes = {
            "clamp_midpoint_px": ((x + 0.5) * share - 0.5, (y + 0.5) * share - 0.5),
            "pixels_per_mm": share * picture.calibration.pixels_per_mm,
        }
    return replace(picture, image=image, calibration=picture.calibration.model_copy(update=changes))
