"""Read GigE Vision and USB3 Vision cameras with the library Aravis."""

from __future__ import annotations

import ctypes
import ipaddress
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NotYet
from contextlib import suppress
from ctypes import byref, c_int, c_size_t
from dataclasses import dataclass

from eimi_drivers.cameras.aravis_library import BUFFER_STATUS, PACKET_SOCKET_DISABLED, SUCCESS, Aravis, load_aravis
from eimi_drivers.cameras.aravis_settings import set_up
from eimi_drivers.cameras.labelled import labelled
from eimi_drivers.cameras.pixel_formats import decode
from eimi_drivers.cameras.settings import FRAMES_ON_THE_WAY, NO_SETTINGS, SOFTWARE, CameraSettings
from eimi_drivers.interfaces import (
    Frame,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    ReplyNotUnderstood,
)

BUFFERS = 32
"""Number of frames that Aravis stores while the program does something else and the camera continues to expose."""

RECEIVE_BUFFER_BYTES = 6 * 2**20
"""Memory (bytes) that the driver requests from the operating system for packets that Aravis has not read yet.

Linux gives at most twice net.core.rmem_max, and counts the memory that it needs for each packet (socket(7), SO_RCVBUF).
"""

ANSWER_WITHIN_S = 0.4
"""Additional time (s) for the answer to a command, if the camera sent no frame within the timeout."""

CLOSE_WITHIN_S = 2.0
"""Time (s) for which `AravisCamera.close` waits until the camera is released."""

CONTROL_FREE_WITHIN_S = 4.0
"""Time limit (s) for taking control of the camera.

If a program ended without releasing the camera, the camera ends this control after its heartbeat time, by default 3 s.
"""

LOOK_EVERY_S = 0.05
"""Longest wait (s) for a frame, before the answer of the camera to the last command is checked again."""

NO_IMAGE = "no image"
"""The reason for an incomplete frame if its status is success, but its size is 0 x 0."""

NO_FRAME = (NO_IMAGE, BUFFER_STATUS[1])
"""Reasons that a buffer without any frame can have too. Aravis 0.8 returned such buffers on a busy computer."""

LARGEST_ID = 65535
"""The largest frame number in GigE Vision 1, which numbers the frames from 1 to 65535 and then begins at 1 again."""


@dataclass(frozen=True)
class Attached:
    """A camera on the network or on USB.

    Parameters
    ----------
    identifier : str
        The text with which Aravis opens the camera.
    serial_number : str
        The serial number.
    address : str
        The IP address; empty for a camera on USB.
    protocol : str
        The protocol, such as "GigEVision".
    model : str
        The maker and the model, separated by a space.
    """

    identifier: str
    serial_number: str
    address: str
    protocol: str
    model: str


def attached_cameras(aravis: Aravis) -> tuple[Attached, ...]:
    """Return the cameras on the network and on USB."""
    aravis.update_device_list()

    def text(name: str, place: int) -> str:
        return (getattr(aravis, f"get_device_{name}")(place) or b"").decode("utf-8", "replace")

    return tuple(
        Attached(
            text("id", place),
            text("serial_nbr", place),
            text("address", place),
            text("protocol", place),
            f"{text('vendor', place)} {text('model', place)}".strip(),
        )
        for place in range(aravis.get_n_devices())
    )


class AravisCamera:
    """A GigE Vision or USB3 Vision camera that is controlled with the library Aravis.

    With a frame rate in the settings, the camera exposes at this rate. With a trigger input, the camera exposes at each
    signal on this input. Otherwise each call of `grab` triggers an exposure. Incomplete frames are discarded.

    Parameters
    ----------
    source : str or int
        The serial number, or the IP address of a GigE camera.
    settings : CameraSettings, optional
        The settings that are applied before the first frame.

    Attributes
    ----------
    settings : CameraSettings
        The settings that were read back from the camera.
    lost_frames : Counter
        The number of frames that did not arrive completely, by reason.
    """

    name = "aravis"

    def __init__(self, source: str | int, settings: CameraSettings = NO_SETTINGS) -> None:
        """Open the camera, apply the settings, and start the acquisition.

        Raises
        ------
        InstrumentDisconnected
            No camera has this IP address or serial number.
        SetPointRefused
            The camera does not permit the value of a setting.
        SetPointNotTaken
            A value that was read back differs from the requested value.
        InstrumentError
            Aravis is not installed, another program controls the camera, or the camera reports an error.
        """
        self.source = str(source)
        self._label = f"camera {self.source}"
        self._aravis = load_aravis()
        self.lost_frames: Counter[str] = Counter()
        self._incomplete: Counter[str] = Counter()
        self._last_id: int | None = None
        self._number = self._to_skip = self._awaited = 0
        self._counting = self._closed = False
        self._objects: list[int] = []
        self._control = _ControlChannel(self._label)
        try:
            with labelled(self._label):
                self._camera = self._open()
                self._objects.append(self._camera)
                self._gige = bool(self._aravis.camera_is_gv_device(self._camera))
                self._take_control()
                self._identity = self._ask_identity()
                self.settings = set_up(self._aravis, self._camera, settings)
                settings.verify(self._label, self.settings)
                self._triggered = self.settings.trigger == SOFTWARE
                self._stream = self._start()
        except InstrumentError:
            self.close()
            raise

    def _open(self) -> int:
        try:
            ipaddress.ip_address(self.source)
        except ValueError:
            identifier = self._identifier_of_serial_number()
        else:
            identifier = self.source
        return int(self._aravis.camera_new(identifier.encode()))

    def _identifier_of_serial_number(self) -> str:
        attached = attached_cameras(self._aravis)
        for camera in attached:
            if camera.serial_number == self.source:
                return camera.identifier
        listed = ", ".join(f"{camera.serial_number} ({camera.model})" for camera in attached) or "none"
        raise InstrumentDisconnected(f"no camera has this serial number; attached cameras: {listed}")

    def _controls(self) -> bool:
        if not self._gige:
            return True
        return bool(self._aravis.gv_device_is_controller(self._aravis.camera_get_device(self._camera)))

    def _take_control(self) -> None:
        """Take control of the camera; raise InstrumentError if another program still controls the camera."""
        until_s = time.monotonic() + CONTROL_FREE_WITHIN_S
        while not self._controls():
            if time.monotonic() > until_s:
                raise InstrumentError("another program controls this camera; close that program")
            with suppress(InstrumentError):
                self._aravis.gv_device_take_control(self._aravis.camera_get_device(self._camera))

    def _ask_identity(self) -> Identity:
        vendor, model, serial_number = (
            (getattr(self._aravis, f"camera_get_{name}")(self._camera) or b"").decode("utf-8", "replace")
            for name in ("vendor_name", "model_name", "device_serial_number")
        )
        return Identity(self.name, f"{vendor} {model} {serial_number}", self.source, serial_number)

    def _start(self) -> int:
        if self._gige:
            # If the program runs as root, Aravis 0.8 reads from a packet socket. Before Aravis has set the filter of
            # this socket, it takes packets of other programs for parts of frames, and can then discard real frames.
            device = self._aravis.camera_get_device(self._camera)
            self._aravis.gv_device_set_stream_options(device, PACKET_SOCKET_DISABLED)
        stream = int(self._aravis.camera_create_stream(self._camera, None, None))
        self._objects.append(stream)
        payload = self._aravis.camera_get_payload(self._camera)
        if self._gige:
            self._aravis.set_int(stream, "socket-buffer-size", RECEIVE_BUFFER_BYTES)
        for _ in range(BUFFERS):
            self._aravis.stream_push_buffer(stream, self._aravis.buffer_new_allocate(payload))
        self._aravis.camera_start_acquisition(self._camera)
        return stream

    def identify(self) -> Identity:
        """Return the maker, model and serial number of the camera."""
        return self._identity

    def flush(self) -> None:
        """Discard the frames that were exposed before this call."""
        self._counting = False
        self._to_skip = FRAMES_ON_THE_WAY if self.settings.frame_rate_Hz else 0
        while not self._closed and (buffer := self._popped(0.0)):
            self._aravis.stream_push_buffer(self._stream, buffer)

    def _popped(self, timeout_s: float) -> int | None:
        """Return the address of the next buffer with a frame; None if no frame arrives within `timeout_s` (s)."""
        if timeout_s > 0:
            buffer = self._aravis.stream_timeout_pop_buffer(self._stream, max(round(1e6 * timeout_s), 1))
        else:
            buffer = self._aravis.stream_try_pop_buffer(self._stream)
        if buffer is not None:
            self._awaited = max(self._awaited - 1, 0)
        return buffer

    def _discard_late_frames(self, until_s: float) -> None:
        """Wait for the frames of earlier triggers, at most until the time `until_s` (s), and discard these frames."""
        self.flush()
        while self._awaited and (left_s := until_s - time.monotonic()) > 0:
            if buffer := self._popped(left_s):
                self._aravis.stream_push_buffer(self._stream, buffer)
        self._awaited, self._counting = 0, True

    def grab(self, timeout_s: float) -> Frame:
        """Return the next complete frame, after triggering an exposure if the camera is triggered by software.

        Raises
        ------
        InstrumentTimeout
            No complete frame arrived within `timeout_s` (s).
        InstrumentDisconnected
            The camera does not answer, was restarted, or was closed.
        ReplyNotUnderstood
            The size of the frame is wrong, or the pixel format cannot be decoded.
        """
        if self._closed:
            raise InstrumentDisconnected(f"{self._label}: the camera was closed; open the camera again")
        with labelled(self._label):
            return self._next_frame(timeout_s)

    def _next_frame(self, timeout_s: float) -> Frame:
        began_s = time.monotonic()
        if not self._controls():
            raise InstrumentDisconnected(
                "this program no longer controls the camera: the camera was restarted, or another program took control"
            )
        if self._triggered:
            self._discard_late_frames(began_s + timeout_s / 2)
        pending_answer = self._trigger() if self._triggered else None
        while True:
            left_s = began_s + timeout_s - time.monotonic()
            if pending_answer is None and left_s < timeout_s / 2:
                pending_answer = self._control.begin(self._ask_size)  # to check that the camera still answers
            buffer = self._popped(min(left_s, LOOK_EVERY_S))
            if pending_answer is not None and pending_answer.done():
                pending_answer.result()
            if buffer is None:
                if left_s <= 0:
                    raise self._no_frame(pending_answer, timeout_s)
                continue
            frame = self._taken(buffer)
            if frame is None and self._triggered:
                pending_answer = self._trigger()
            elif frame is not None and self._to_skip:
                self._to_skip -= 1
            elif frame is not None:
                return frame

    def _trigger(self) -> Future[None]:
        self._awaited += 1
        return self._control.begin(lambda: self._aravis.camera_software_trigger(self._camera))

    def _ask_size(self) -> None:
        self._aravis.camera_get_payload(self._camera)

    def _no_frame(self, pending_answer: Future[None] | None, timeout_s: float) -> InstrumentError:
        try:
            if pending_answer is not None:
                pending_answer.result(ANSWER_WITHIN_S)  # the command may have been sent only a moment ago
        except NotYet:
            return InstrumentDisconnected(
                f"the camera did not answer within {timeout_s:g} s. Are its cable and its power plugged in?"
            )
        if not self._controls():
            return InstrumentDisconnected(
                "this program no longer controls the camera: the camera was restarted, or another program took control"
            )
        states = ", ".join(f"{count} with {status}" for status, count in self._incomplete.items())
        incomplete = f"; incomplete frames: {states}" if states else ""
        return InstrumentTimeout(f"no complete frame within {timeout_s:g} s{incomplete}")

    def _taken(self, buffer: int) -> Frame | None:
        """Return a copy of the frame in a buffer, and give the buffer back to Aravis; None if the frame is incomplete.

        `buffer` is the address of the buffer.
        """
        aravis = self._aravis
        try:
            status = aravis.buffer_get_status(buffer)
            if status != SUCCESS:  # the other values of an incomplete frame have no meaning
                self._incomplete[BUFFER_STATUS.get(status, f"status {status}")] += 1
                return None
            left, top, width, height = (c_int() for _ in range(4))
            aravis.buffer_get_image_region(buffer, byref(left), byref(top), byref(width), byref(height))
            if not (width.value and height.value):  # seen once with the status success, on a busy computer
                self._incomplete[NO_IMAGE] += 1
                return None
            number = self._numbered(aravis.buffer_get_frame_id(buffer))
            if self.settings.region is not None and (width.value, height.value) != self.settings.region[2:]:
                raise ReplyNotUnderstood(
                    f"frame {number} has {width.value} x {height.value} pixels, but the region in the settings is "
                    f"{self.settings.region} (left, top, width, height)"
                )
            size = c_size_t()
            address = aravis.buffer_get_data(buffer, byref(size))
            data = memoryview((ctypes.c_uint8 * size.value).from_address(address))
            image = decode(aravis.buffer_get_image_pixel_format(buffer), data, width.value, height.value)
            stamp_ns = aravis.buffer_get_timestamp(buffer) or aravis.buffer_get_system_timestamp(buffer)
            return Frame(image, number, stamp_ns / 1e9)
        finally:
            aravis.stream_push_buffer(self._stream, buffer)

    def _numbered(self, identifier: int) -> int:
        """Convert the frame number of the camera into a number that always increases, and count the missing frames."""
        if self._last_id is None:
            step = 1 + self._incomplete.total() - sum(self._incomplete[reason] for reason in NO_FRAME)
            self._number = identifier
        else:
            step = identifier - self._last_id
            if self._gige and step <= 0 and self._last_id <= LARGEST_ID:
                step += LARGEST_ID
            self._number += step
        if self._counting:
            for reason in NO_FRAME:  # if there are more incomplete buffers than missing frames, some contained no frame
                self._incomplete -= Counter({reason: max(self._incomplete.total() - (step - 1), 0)})
            self.lost_frames += self._incomplete + Counter({"no packet": step - 1 - self._incomplete.total()})
        self._incomplete.clear()
        self._last_id, self._counting = identifier, True
        return self._number

    def close(self) -> None:
        """Stop the acquisition and release the camera. Closing twice is allowed."""
        if self._closed:
            return
        self._closed = True
        with suppress(NotYet):
            self._control.begin(self._release).result(CLOSE_WITHIN_S)
        self._control.end()

    def _release(self) -> None:
        if self._objects:
            with suppress(InstrumentError):
                self._aravis.camera_stop_acquisition(self._camera)
        while self._objects:
            self._aravis.release(self._objects.pop())


# Aravis waits up to 5 s for the answer of a camera that was disconnected. Calls are therefore made in a separate
# thread, and the caller need not wait.
class _ControlChannel:
    """A thread that makes calls to a camera one after the other."""

    def __init__(self, name: str) -> None:
        self._calls: queue.SimpleQueue[tuple[Callable[[], None], Future[None]] | None] = queue.SimpleQueue()
        threading.Thread(target=self._make_calls, name=f"control of {name}", daemon=True).start()

    def begin(self, call: Callable[[], None]) -> Future[None]:
        """Queue a call, and return the future (the later result) of the call."""
        outcome: Future[None] = Future()
        self._calls.put((call, outcome))
        return outcome

    def end(self) -> None:
        """End the thread after the queued calls."""
        self._calls.put(None)

    def _make_calls(self) -> None:
        while queued := self._calls.get():
            call, outcome = queued
            try:
                outcome.set_result(call())
            except Exception as error:
                outcome.set_exception(error)
