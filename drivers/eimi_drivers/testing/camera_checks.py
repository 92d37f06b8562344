"""Checks of a camera driver. The name of each check describes the required behaviour."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from eimi_drivers.cameras.camera_names import open_with
from eimi_drivers.cameras.settings import NO_SETTINGS, CameraSettings, settings_of
from eimi_drivers.cameras.timed import TimedCamera
from eimi_drivers.interfaces import (
    Camera,
    CameraDriver,
    Frame,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
)
from eimi_drivers.testing.claims import claim, must_raise, run_checks, within

FRAME_WITHIN_S = 10.0
SHORT_S = 0.2
ENDS_WITHIN_S = 30.0
"""Time limit (s) of a call, after which the check fails."""

FRAMES = 3
STORED = 8
"""Largest number of stored frames that a camera may still return after it was unplugged or exposes no more frames."""


@dataclass
class CameraBench:
    """An open camera, and the functions that disturb the camera.

    Attributes
    ----------
    open : callable
        Opens the camera again and returns it.
    camera : Camera
        Open camera.
    settings : CameraSettings
        Settings of the open camera.
    absent : str, int or None
        Source without a camera; None if not known.
    freeze : callable or None
        Stops the frames of the camera; None if not possible.
    unplug : callable or None
        Disconnects the camera; None if not possible.
    """

    open: Callable[..., Camera]
    camera: Camera
    settings: CameraSettings
    absent: str | int | None
    freeze: Callable[[], object] | None
    unplug: Callable[[], object] | None


def says_who_it_is(bench: CameraBench) -> None:
    """Check that `identify` returns the name of the driver and a text that describes the camera."""
    identity = bench.camera.identify()
    claim(isinstance(identity, Identity), f"identify() should return an Identity, not {identity!r}")
    claim(bool(identity.driver and identity.text), f"identify() should return a driver and a text, not {identity}")


def gives_frames_in_order(bench: CameraBench) -> None:
    """Check that frames have one shape, increasing numbers, and time stamps that do not decrease."""
    frames = _grab(bench.camera)
    for frame in frames:
        _is_a_frame(frame)
    claim(
        len({frame.image.shape for frame in frames}) == 1,
        "all frames should have the same shape, but their shapes differ",
    )
    numbers = [frame.number for frame in frames]
    claim(all(a < b for a, b in pairwise(numbers)), f"frame numbers should increase, but are {numbers}")
    stamps_s = [frame.timestamp_s for frame in frames]
    claim(all(a <= b for a, b in pairwise(stamps_s)), f"time stamps should not decrease, but are {stamps_s} s")


def keeps_frames_apart(bench: CameraBench) -> None:
    """Check that the next frame does not overwrite the image of a frame that was returned earlier."""
    first = bench.camera.grab(FRAME_WITHIN_S).image
    before = first.copy()
    _grab(bench.camera, FRAMES - 1)
    claim(np.array_equal(first, before), "a frame changed when the next frame was grabbed; its image should be a copy")


def goes_on_after_a_flush(bench: CameraBench) -> None:
    """Check that the first frame after `flush` has a larger number than the last frame before `flush`."""
    before = bench.camera.grab(FRAME_WITHIN_S).number
    bench.camera.flush()
    after = bench.camera.grab(FRAME_WITHIN_S).number
    claim(after > before, f"the frame after flush() should have a number above {before}, but it is frame {after}")


def reads_its_settings_back(bench: CameraBench) -> None:
    """Check that the attribute `settings` and the size of the frames agree with the requested settings."""
    bench.settings.verify("the camera", settings_of(bench.camera))
    if bench.settings.region is not None:
        width, height = bench.settings.region[2:]
        shape = bench.camera.grab(FRAME_WITHIN_S).image.shape
        claim(
            shape[:2] == (height, width),
            f"a region of {width} x {height} pixels should give images of this size, not {shape}",
        )


def refuses_a_setting_that_cannot_be(bench: CameraBench) -> None:
    """Check that an empty region raises InstrumentError, and that valid settings are then accepted."""
    bench.camera.close()
    impossible = CameraSettings(region=(0, 0, 0, 0))
    must_raise((InstrumentError,), f"opening with {impossible}", lambda: bench.open(settings=impossible))
    bench.camera = bench.open()
    bench.camera.grab(FRAME_WITHIN_S)


def works_in_a_thread_of_its_own(bench: CameraBench) -> None:
    """Check that the camera works outside the main thread."""
    bench.camera.close()
    camera = TimedCamera("the camera", bench.open)
    try:
        camera.flush()
        _is_a_frame(camera.grab(FRAME_WITHIN_S))
    finally:
        camera.close()


def is_closed_when_it_is_closed(bench: CameraBench) -> None:
    """Check that closing twice is allowed, that a closed camera raises InstrumentError, and that it can be reopened."""
    bench.camera.close()
    bench.camera.close()
    must_raise((InstrumentError,), "grab() of a closed camera", lambda: _in_time(bench.camera))
    bench.camera = bench.open()
    bench.camera.grab(FRAME_WITHIN_S)


def says_that_no_camera_is_there(bench: CameraBench) -> None:
    """Check that opening raises InstrumentDisconnected if no camera is at the source."""
    if bench.absent is not None:
        must_raise(
            (InstrumentDisconnected,), f"opening {bench.absent!r}", lambda: bench.open(source=bench.absent).close()
        )


def gives_up_on_a_camera_that_hangs(bench: CameraBench) -> None:
    """Check that `grab` raises InstrumentTimeout if the camera delivers no frame."""
    if bench.freeze is not None:
        bench.freeze()
        must_raise((InstrumentTimeout,), "grab() of a camera without new frames", lambda: _grab_new(bench.camera))


def says_that_it_was_unplugged(bench: CameraBench) -> None:
    """Check that `grab` raises InstrumentDisconnected after the camera was unplugged."""
    if bench.unplug is not None:
        bench.unplug()
        must_raise((InstrumentDisconnected,), "grab() of an unplugged camera", lambda: _grab_new(bench.camera))


CAMERA_CHECKS: tuple[Callable[[CameraBench], None], ...] = (
    says_who_it_is,
    gives_frames_in_order,
    keeps_frames_apart,
    goes_on_after_a_flush,
    reads_its_settings_back,
    refuses_a_setting_that_cannot_be,
    works_in_a_thread_of_its_own,
    is_closed_when_it_is_closed,
    says_that_no_camera_is_there,
    gives_up_on_a_camera_that_hangs,
    says_that_it_was_unplugged,
)
"""The checks that `check_camera` runs."""


def check_camera(
    open: CameraDriver,
    source: str | int,
    *,
    settings: CameraSettings = NO_SETTINGS,
    absent: str | int | None = None,
    freeze: Callable[[], object] | None = None,
    unplug: Callable[[], object] | None = None,
    checks: Iterable[Callable[[CameraBench], None]] = CAMERA_CHECKS,
) -> None:
    """Check a camera driver with a camera or an object that replaces a camera.

    Parameters
    ----------
    open : CameraDriver
        Driver: a class or a function that opens a camera.
    source : str or int
        Source of a camera that delivers at least three frames each time it is opened.
    settings : CameraSettings, optional
        Settings that the camera accepts.
    absent : str or int, optional
        Source without a camera; None omits the check of this source.
    freeze : callable, optional
        Stops the frames of the open camera; None omits the check of a camera without new frames.
    unplug : callable, optional
        Disconnects the open camera; None omits the check of a disconnected camera.
    checks : iterable of functions, optional
        Selection of `CAMERA_CHECKS`; all checks by default.

    Raises
    ------
    AssertionError
        At least one check failed; the message lists all failed checks.
    """
    name = str(getattr(open, "name", getattr(open, "__name__", "camera")))

    @contextmanager
    def bench() -> Iterator[CameraBench]:
        def open_it(source: str | int = source, settings: CameraSettings = settings) -> Camera:
            return open_with(open, name, source, settings)

        opened = CameraBench(open_it, open_it(), settings, absent, freeze, unplug)
        try:
            yield opened
        finally:
            opened.camera.close()

    run_checks(f"the camera driver {getattr(open, '__name__', open)}", checks, bench)


def _grab(camera: Camera, count: int = FRAMES) -> list[Frame]:
    return [camera.grab(FRAME_WITHIN_S) for _ in range(count)]


def _in_time(camera: Camera) -> Frame:
    return within(ENDS_WITHIN_S, f"grab({SHORT_S:g})", lambda: camera.grab(SHORT_S))


def _grab_new(camera: Camera) -> Frame:
    """Discard the frames that were exposed before the camera was disturbed, and return the next frame."""
    for _ in range(STORED):
        _in_time(camera)
    return _in_time(camera)


def _is_a_frame(frame: Frame) -> None:
    claim(isinstance(frame, Frame), f"grab() should return a Frame, not {frame!r}")
    image = frame.image
    claim(isinstance(image, np.ndarray), f"the image of a frame should be an array, not {type(image).__name__}")
    claim(
        image.dtype in (np.uint8, np.uint16) and (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)),
        f"an image should be (height, width) or (height, width, 3) of uint8 or uint16, not "
        f"{image.shape} of {image.dtype}",
    )
    claim(math.isfinite(frame.timestamp_s), f"a time stamp should be a number of seconds, not {frame.timestamp_s}")
