"""Emulate a GigE Vision camera in a separate process; only one test on a computer can use it at a time."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from filelock import FileLock
from numpy.typing import NDArray

from eimi_drivers.cameras import CameraSettings, open_camera
from eimi_drivers.cameras.aravis import AravisCamera
from eimi_drivers.cameras.aravis_library import MISSING, aravis_is_installed
from eimi_drivers.cameras.settings import NO_SETTINGS
from eimi_drivers.emulators.gige_camera import LOOPBACK
from eimi_drivers.emulators.gige_process import CameraProcess, gige_process
from tests.patience import PATIENCE_S

SIZE_PX = (200, 120)
needs_aravis = pytest.mark.skipif(not aravis_is_installed(), reason=MISSING)


@contextmanager
def only_gige_camera() -> Iterator[None]:
    """Wait until no other test on this computer uses the emulated GigE camera, and lock it until the context ends."""
    with FileLock(Path(tempfile.gettempdir()) / "eimi-tests-gige.lock", timeout=PATIENCE_S):
        yield


_opened: list[AravisCamera] = []


def opened(settings: CameraSettings = NO_SETTINGS, source: str = LOOPBACK) -> AravisCamera:
    """Open a camera with Aravis; `close_all` closes it."""
    camera = open_camera("aravis", source, settings)
    assert isinstance(camera, AravisCamera)
    _opened.append(camera)
    return camera


def close_all() -> None:
    """Close all cameras of `opened`, also after a failed test, so that the next test can control the camera."""
    while _opened:
        _opened.pop().close()


def numbered() -> Callable[[], NDArray[np.uint8]]:
    """Return a function that returns uniform pictures with the grey values 0, 1, ... 249, 0, ...."""
    number = -1

    def picture() -> NDArray[np.uint8]:
        nonlocal number
        number = (number + 1) % 250
        return np.full(SIZE_PX[::-1], number, np.uint8)

    return picture


def ramp() -> Callable[[], NDArray[np.uint8]]:
    """Return a function that returns a picture with the grey values (column + 2 row) modulo 256."""
    columns, rows = np.meshgrid(np.arange(SIZE_PX[0]), np.arange(SIZE_PX[1]))
    picture = ((columns + 2 * rows) % 256).astype(np.uint8)
    return lambda: picture


@contextmanager
def gige_camera(
    prepare: Callable[[], Callable[[], NDArray[np.uint8]]] = numbered, size_px: tuple[int, int] = SIZE_PX, **camera: Any
) -> Iterator[CameraProcess]:
    """Run an emulated GigE camera on the loopback interface until the context ends; yield its process.

    prepare : returns the function that renders each picture. The caller must hold the lock `only_gige_camera`.
    """
    with gige_process(prepare, size_px, address=LOOPBACK, **camera) as process:
        yield process


class NoisyPictures:
    """A function that returns a new picture at each call: a dark vertical beam with camera noise."""

    def __init__(self) -> None:
        self._number = 0

    def __call__(self) -> NDArray[np.uint8]:
        """Return the picture of the next exposure, shape (height, width)."""
        self._number += 1
        return noisy_picture(self._number)


def noisy_picture(number: int) -> NDArray[np.uint8]:
    """Return a picture (height, width) of a dark vertical beam with noise; its seed is the exposure `number`."""
    across = np.abs(np.arange(SIZE_PX[0]) - SIZE_PX[0] // 2)
    profile = 30 + 170 / (1 + np.exp(-(across - 8) / 0.7))
    noise = np.random.default_rng(number).normal(0, 2, SIZE_PX[::-1])
    return np.clip(profile + noise, 0, 255).astype(np.uint8)


FIRST_NUMBER = 65401
"""The frame number that the emulated camera gives to its first exposure."""
