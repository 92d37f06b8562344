"""Count the wrong and the lost frames of an emulated GigE camera with faults, and time the driver's error message.

python -m benchmarks.camera_faults
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.cameras import CameraSettings, open_camera
from eimi_drivers.cameras.aravis import AravisCamera
from eimi_drivers.emulators.gige_camera import LOOPBACK
from eimi_drivers.emulators.gige_process import gige_process
from eimi_drivers.interfaces import InstrumentError
from tests.shared.emulated_gige import FIRST_NUMBER, only_gige_camera

FRAMES = 200
GRAB_S = 5.0
SIZES_PX = ((128, 96), (512, 512))
PAYLOAD_BYTES = 1400 - 36
"""Bytes of picture data in a packet: the packet size of the emulated camera without the headers of IP, UDP and GVSP."""


def picture(number: int, size_px: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a picture of noise, shape (height, width), with the seed ``number``."""
    return np.random.default_rng(number).integers(0, 256, size_px[::-1], dtype=np.uint8)


def pictures(size_px: tuple[int, int]) -> Callable[[], NDArray[np.uint8]]:
    """Return a function that returns the next picture of a series."""
    number = -1

    def expose() -> NDArray[np.uint8]:
        nonlocal number
        number += 1
        return picture(number, size_px)

    return expose


def lost_packets(size_px: tuple[int, int], share: float) -> str:
    """Return a table row: received, wrong and lost frames if a ``share`` (0 to 1) of all packets is lost."""
    with gige_process(partial(pictures, size_px), size_px) as process:
        camera = open_camera("aravis", LOOPBACK)
        assert isinstance(camera, AravisCamera)
        process.lose_packets(share)
        received, wrong, times_s, end = 0, 0, [], "continues"
        for _ in range(FRAMES):
            began_s = time.monotonic()
            try:
                frame = camera.grab(GRAB_S)
            except InstrumentError as error:
                end = f"{type(error).__name__} after {received} frames"
                break
            times_s.append(time.monotonic() - began_s)
            received += 1
            wrong += not np.array_equal(frame.image, picture(frame.number - FIRST_NUMBER, size_px))
        camera.close()
    packets = -(-size_px[0] * size_px[1] // PAYLOAD_BYTES) + 2
    # The driver counts lost frames when the next complete frame comes. Without a complete frame, the number is unknown.
    none = "none" if received else "not counted"
    lost = ", ".join(f"{count} ({reason})" for reason, count in camera.lost_frames.items() if count) or none
    spent = f"{1e3 * np.median(times_s):.0f} ms, at most {max(times_s):.2f} s" if times_s else "none"
    size = f"{size_px[0]} x {size_px[1]}, {packets} packets"
    return f"| {100 * share:g} % of the packets lost | {size} | {received} | {wrong} | {lost} | {spent} | {end} |"


def vanished(what: str, serial_number: str | None) -> str:
    """Kill an emulated camera, ask the driver for a frame, and return a table row with the driver's reaction.

    If `serial_number` is given, a camera with this number takes the address of the killed camera. `what` names the row.
    """
    size_px = SIZES_PX[0]

    def outcome() -> str:
        began_s = time.monotonic()
        try:
            camera.grab(GRAB_S)
        except InstrumentError as error:
            return f"{type(error).__name__} within {time.monotonic() - began_s:.1f} s"
        return "a frame"

    with gige_process(partial(pictures, size_px), size_px, serial_number="EIMI01") as first:
        camera = open_camera("aravis", LOOPBACK)
        camera.grab(GRAB_S)
        first.kill()
        if serial_number is None:
            words = outcome()
    if serial_number is not None:
        with gige_process(partial(pictures, size_px), size_px, serial_number=serial_number):
            words = outcome()
    camera.close()
    return f"| {what} | | 0 | 0 | | | {words} |"


def rounded_region() -> str:
    """Return a table row for a camera that rounds the requested height of the picture."""
    words = "| the camera reports another region"
    with gige_process(partial(pictures, SIZES_PX[0]), SIZES_PX[0], rows_step=16):
        try:
            open_camera("aravis", LOOPBACK, CameraSettings(region=(0, 0, 128, 90))).close()
        except InstrumentError as error:
            return f"{words} | | 0 | 0 | | | {type(error).__name__} when the camera is opened |"
    return f"{words} | | | | | | not noticed |"


def main() -> None:
    heads = (
        "fault",
        "frame size",
        "complete frames",
        "wrong frames",
        "lost frames",
        "time of a frame",
        "driver's reaction",
    )
    print(f"| {' | '.join(heads)} |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for size_px in SIZES_PX:
        for share in (0.0, 0.001, 0.02):
            print(lost_packets(size_px, share), flush=True)
    print(vanished("camera killed", None), flush=True)
    print(vanished("camera killed and back at once", "EIMI01"), flush=True)
    print(vanished("another camera at its address", "EIMI02"), flush=True)
    print(rounded_region())


if __name__ == "__main__":
    with only_gige_camera():
        main()
