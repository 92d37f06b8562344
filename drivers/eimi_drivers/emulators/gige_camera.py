"""Emulate a GigE Vision camera on this computer with the fake camera of the library Aravis."""

from __future__ import annotations

import ctypes
import socket
import struct
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from ctypes import byref, c_int, c_uint32, c_void_p
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.cameras.aravis_library import load_aravis
from eimi_drivers.cameras.pixel_formats import PIXEL_FORMATS, PixelFormat
from eimi_drivers.emulators.gige_features import (
    GAIN,
    HEIGHT,
    SENSOR_HEIGHT,
    SENSOR_WIDTH,
    TRIGGER_SOURCE,
    WIDTH,
    describe,
)
from eimi_drivers.emulators.gige_stream import (
    PACKET_SIZE,
    STREAM_ADDRESS,
    STREAM_PORT,
    FrameSender,
    StreamedFrame,
)
from eimi_drivers.interfaces import InstrumentError

LOOPBACK = "127.0.0.1"
CONTROL_PORT = 3956
"""The UDP port of the control protocol of GigE Vision (GVCP)."""

_Fill = ctypes.CFUNCTYPE(None, c_void_p, c_void_p, c_uint32, c_uint32, c_uint32)


class GigECamera:
    """An emulated GigE Vision camera.

    Parameters
    ----------
    sender : FrameSender
        The sender of the frames.
    """

    def __init__(self, sender: FrameSender) -> None:
        self._sender = sender
        self.failure: Exception | None = None
        """The error that the function `picture` raised; None without an error. All later pictures are black."""

    def lose_packets(self, share: float) -> None:
        """Lose a share (0 to 1) of the network packets of all further pictures."""
        self._sender.lost_share = share


@contextmanager
def serve_gige(
    picture: Callable[[], NDArray[np.uint8]],
    size_px: tuple[int, int],
    *,
    address: str = LOOPBACK,
    serial_number: str = "EIMI01",
    rows_step: int = 1,
    shutter: str = "Global",
    triggers_per_s: float = 100.0,
) -> Iterator[GigECamera]:
    """Serve an emulated GigE Vision camera while the `with` block runs, and yield the camera.

    Parameters
    ----------
    picture : callable
        Returns the picture of the whole sensor at the moment of the exposure, shape (height, width), within a second.
    size_px : tuple of int
        Width and height of the sensor, px.
    address : str
        An IP address of this computer that no other emulated camera uses.
    serial_number : str
        The serial number, at most 15 characters.
    rows_step : int
        The height of the region is rounded down to a multiple of this number.
    shutter : str
        The kind of shutter that the camera reports: "Global" or "Rolling".
    triggers_per_s : float
        The highest rate of triggered frames, Hz.

    Yields
    ------
    GigECamera
        The camera.

    Raises
    ------
    InstrumentError
        Aravis is not installed, or another camera uses the address.
    """
    aravis = load_aravis()
    _refuse_taken(address)
    with tempfile.TemporaryDirectory(prefix="eimi-gige-") as folder:
        description = Path(folder) / "camera.xml"
        description.write_text(describe(rows_step, shutter), encoding="utf-8")
        gv_camera = aravis.gv_fake_camera_new_full(address.encode(), serial_number.encode(), str(description).encode())
    fake = aravis.gv_fake_camera_get_fake_camera(gv_camera)
    aravis.set_double(gv_camera, "gvsp-lost-ratio", 1.0)  # Aravis sends no packet; `sender` sends all packets
    width, height = size_px
    for register, value in (
        (SENSOR_WIDTH, width),
        (SENSOR_HEIGHT, height),
        (WIDTH, width),
        (HEIGHT, height),
        (TRIGGER_SOURCE, 1),
        (GAIN, 0),
    ):
        aravis.fake_camera_write_register(fake, register, value)
    aravis.fake_camera_set_trigger_frequency(fake, triggers_per_s)
    black = np.zeros((height, width), np.uint8)

    def read(register: int) -> int:
        number = c_uint32()
        aravis.fake_camera_read_register(fake, register, byref(number))
        return number.value

    def expose(buffer: int, _data: int, _exposure_us: int, _gain: int, code: int) -> None:
        whole = black
        if camera.failure is None:
            try:
                whole = picture()
            except Exception as error:  # Aravis calls this function, so no exception may leave it
                camera.failure = error
        left, top, columns, rows = (c_int() for _ in range(4))
        aravis.buffer_get_image_region(buffer, byref(left), byref(top), byref(columns), byref(rows))
        region = (left.value, top.value, columns.value, rows.value)
        part = whole[top.value : top.value + rows.value, left.value : left.value + columns.value]
        number, stamp_ns = aravis.buffer_get_frame_id(buffer), aravis.buffer_get_timestamp(buffer)
        frame = StreamedFrame(number, stamp_ns, code, region, encode(PIXEL_FORMATS[code], part))
        receiver = (socket.inet_ntoa(struct.pack(">I", read(STREAM_ADDRESS))), read(STREAM_PORT))
        sender.send(frame, receiver, read(PACKET_SIZE) & 0xFFFF)

    callback = _Fill(expose)  # this name keeps the callback alive, because Aravis holds no reference
    try:
        if not aravis.gv_fake_camera_is_running(gv_camera):
            raise InstrumentError(f"cannot serve a GigE camera on {address}: no network interface has this address")
        with closing(FrameSender(address)) as sender:
            camera = GigECamera(sender)
            aravis.fake_camera_set_fill_pattern(fake, callback, None)
            yield camera
    finally:
        aravis.release(gv_camera)


def _refuse_taken(address: str) -> None:
    """Raise InstrumentError if `CONTROL_PORT` at the address is in use."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        try:
            line.bind((address, CONTROL_PORT))
        except OSError as error:
            raise InstrumentError(f"cannot serve a GigE camera on {address}, port {CONTROL_PORT}: {error}") from error


def encode(pixel_format: PixelFormat, image: NDArray[np.uint8]) -> bytes:
    """Return an 8-bit picture as the data of a frame in a pixel format.

    In a format with b bits the grey values are multiplied by 2^(b - 8).
    """
    if pixel_format.bits == 8:
        return image.tobytes()
    values = image.astype(np.uint16).ravel() << pixel_format.bits - 8
    if not pixel_format.packing:
        return values.astype("<u2").tobytes()
    pairs = np.pad(values, (0, len(values) % 2)).reshape(-1, 2).T
    data = np.empty((pairs.shape[1], 3), np.uint8)
    if pixel_format.packing == "p":
        data[:, 0], data[:, 1], data[:, 2] = pairs[0] & 0xFF, pairs[0] >> 8 | (pairs[1] & 0x0F) << 4, pairs[1] >> 4
    else:
        data[:, 0], data[:, 1], data[:, 2] = pairs[0] >> 4, pairs[0] & 0x0F | (pairs[1] & 0x0F) << 4, pairs[1] >> 4
    return data.tobytes()[: len(values) * 3 // 2]
