"""Load the library Aravis 0.8 with ctypes and declare the functions that this package calls.

Aravis (LGPL-2.1) controls GigE Vision and USB3 Vision cameras:
https://aravisproject.github.io/aravis/aravis-stable/.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from collections.abc import Callable
from ctypes import POINTER, byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint, c_uint32, c_uint64
from ctypes import c_void_p as pointer
from typing import Any

from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError, SetPointRefused

MISSING = (
    "the library Aravis 0.8 is not installed: `apt install libaravis-0.8-0` on Debian and Ubuntu, `brew install "
    "aravis` on macOS; on Windows, use driver = 'gentl'"
)

_SHARED_OBJECTS = {
    "linux": ("libaravis-0.8.so.0", "libgobject-2.0.so.0", "libglib-2.0.so.0"),
    "darwin": ("libaravis-0.8.0.dylib", "libgobject-2.0.0.dylib", "libglib-2.0.0.dylib"),
}
_FOLDERS = {"linux": ("",), "darwin": ("", "/opt/homebrew/lib/", "/usr/local/lib/")}

_DEVICE_ERRORS = "arv-device-error-quark"
_NOT_THERE = frozenset({2, 5, 6, 10})
"""Values of ArvDeviceError for a camera that does not answer or is controlled by another program.

The values mean: not connected, timeout, not found, not controller (arvdevice.h of Aravis 0.8).
"""

BUFFER_STATUS = {
    -1: "unknown status",
    0: "success",
    1: "cleared",
    2: "timeout before all packets came",
    3: "missing packets",
    4: "wrong packet number",
    5: "size mismatch",
    6: "still being filled",
    7: "aborted",
    8: "payload not supported",
}
"""The meaning of each value of ArvBufferStatus, the status of a received frame (arvbuffer.h of Aravis 0.8)."""

SUCCESS = 0

PACKET_SOCKET_DISABLED = 1
"""The value of ArvGvStreamOption that makes Aravis read frames from a UDP socket (arvgvstream.h of Aravis 0.8)."""


class _GError(ctypes.Structure):
    _fields_ = (("domain", c_uint32), ("code", c_int), ("message", c_char_p))


class GValue(ctypes.Structure):
    """The C structure GValue, which contains the value of a property of a GObject (gvalue.h)."""

    _fields_ = (("type", c_size_t), ("data", c_uint64 * 2))


_int_p, _double_p, _uint_p = POINTER(c_int), POINTER(c_double), POINTER(c_uint)
_size_p, _u64_p = POINTER(c_size_t), POINTER(c_uint64)

_WITH_ERROR: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "arv_camera_new": (pointer, (c_char_p,)),
    "arv_camera_get_vendor_name": (c_char_p, (pointer,)),
    "arv_camera_get_model_name": (c_char_p, (pointer,)),
    "arv_camera_get_device_serial_number": (c_char_p, (pointer,)),
    "arv_camera_set_region": (None, (pointer, c_int, c_int, c_int, c_int)),
    "arv_camera_get_region": (None, (pointer, _int_p, _int_p, _int_p, _int_p)),
    "arv_camera_set_exposure_time": (None, (pointer, c_double)),
    "arv_camera_get_exposure_time": (c_double, (pointer,)),
    "arv_camera_get_exposure_time_bounds": (None, (pointer, _double_p, _double_p)),
    "arv_camera_is_exposure_auto_available": (c_bool, (pointer,)),
    "arv_camera_set_exposure_time_auto": (None, (pointer, c_int)),
    "arv_camera_set_gain": (None, (pointer, c_double)),
    "arv_camera_get_gain": (c_double, (pointer,)),
    "arv_camera_get_gain_bounds": (None, (pointer, _double_p, _double_p)),
    "arv_camera_is_gain_available": (c_bool, (pointer,)),
    "arv_camera_is_exposure_time_available": (c_bool, (pointer,)),
    "arv_camera_is_gain_auto_available": (c_bool, (pointer,)),
    "arv_camera_set_gain_auto": (None, (pointer, c_int)),
    "arv_camera_set_frame_rate": (None, (pointer, c_double)),
    "arv_camera_get_frame_rate": (c_double, (pointer,)),
    "arv_camera_get_frame_rate_bounds": (None, (pointer, _double_p, _double_p)),
    "arv_camera_dup_available_pixel_formats_as_strings": (POINTER(c_char_p), (pointer, _uint_p)),
    "arv_camera_dup_available_trigger_sources": (POINTER(c_char_p), (pointer, _uint_p)),
    "arv_camera_set_pixel_format_from_string": (None, (pointer, c_char_p)),
    "arv_camera_get_pixel_format_as_string": (c_char_p, (pointer,)),
    "arv_camera_set_trigger": (None, (pointer, c_char_p)),
    "arv_camera_get_trigger_source": (c_char_p, (pointer,)),
    "arv_camera_clear_triggers": (None, (pointer,)),
    "arv_camera_software_trigger": (None, (pointer,)),
    "arv_camera_set_acquisition_mode": (None, (pointer, c_int)),
    "arv_camera_get_payload": (c_uint, (pointer,)),
    "arv_camera_start_acquisition": (c_bool, (pointer,)),
    "arv_camera_stop_acquisition": (c_bool, (pointer,)),
    "arv_camera_is_feature_available": (c_bool, (pointer, c_char_p)),
    "arv_camera_get_string": (c_char_p, (pointer, c_char_p)),
    "arv_camera_get_float": (c_double, (pointer, c_char_p)),
    "arv_camera_set_float": (None, (pointer, c_char_p, c_double)),
    "arv_gv_device_take_control": (c_bool, (pointer,)),
    "arv_camera_create_stream": (pointer, (pointer, pointer, pointer)),
}
"""Result type and argument types of the functions whose last argument is a GError.

The argument types are listed without this last argument.
"""

_PLAIN: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "arv_update_device_list": (None, ()),
    "arv_get_n_devices": (c_uint, ()),
    "arv_get_device_id": (c_char_p, (c_uint,)),
    "arv_get_device_serial_nbr": (c_char_p, (c_uint,)),
    "arv_get_device_vendor": (c_char_p, (c_uint,)),
    "arv_get_device_model": (c_char_p, (c_uint,)),
    "arv_get_device_address": (c_char_p, (c_uint,)),
    "arv_get_device_protocol": (c_char_p, (c_uint,)),
    "arv_camera_get_device": (pointer, (pointer,)),
    "arv_camera_is_gv_device": (c_bool, (pointer,)),
    "arv_camera_set_range_check_policy": (None, (pointer, c_int)),
    "arv_gv_device_is_controller": (c_bool, (pointer,)),
    "arv_gv_device_set_stream_options": (None, (pointer, c_int)),
    "arv_buffer_new_allocate": (pointer, (c_size_t,)),
    "arv_buffer_get_status": (c_int, (pointer,)),
    "arv_buffer_get_frame_id": (c_uint64, (pointer,)),
    "arv_buffer_get_timestamp": (c_uint64, (pointer,)),
    "arv_buffer_get_system_timestamp": (c_uint64, (pointer,)),
    "arv_buffer_get_image_pixel_format": (c_uint32, (pointer,)),
    "arv_buffer_get_image_region": (None, (pointer, _int_p, _int_p, _int_p, _int_p)),
    "arv_buffer_get_data": (pointer, (pointer, _size_p)),
    "arv_stream_push_buffer": (None, (pointer, pointer)),
    "arv_stream_try_pop_buffer": (pointer, (pointer,)),
    "arv_stream_timeout_pop_buffer": (pointer, (pointer, c_uint64)),
    "arv_stream_get_statistics": (None, (pointer, _u64_p, _u64_p, _u64_p)),
    "arv_gv_fake_camera_new_full": (pointer, (c_char_p, c_char_p, c_char_p)),
    "arv_gv_fake_camera_is_running": (c_bool, (pointer,)),
    "arv_gv_fake_camera_get_fake_camera": (pointer, (pointer,)),
    "arv_fake_camera_set_fill_pattern": (None, (pointer, pointer, pointer)),
    "arv_fake_camera_write_register": (c_bool, (pointer, c_uint32, c_uint32)),
    "arv_fake_camera_read_register": (c_bool, (pointer, c_uint32, POINTER(c_uint32))),
    "arv_fake_camera_set_trigger_frequency": (None, (pointer, c_double)),
}

_GLIB: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "g_quark_to_string": (c_char_p, (c_uint32,)),
    "g_error_free": (None, (pointer,)),
    "g_free": (None, (pointer,)),
}
_GOBJECT: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "g_object_unref": (None, (pointer,)),
    "g_object_set_property": (None, (pointer, c_char_p, POINTER(GValue))),
    "g_value_init": (pointer, (POINTER(GValue), c_size_t)),
    "g_value_set_double": (None, (POINTER(GValue), c_double)),
    "g_value_set_int": (None, (POINTER(GValue), c_int)),
}
"""Result type and argument types of the functions of GLib and GObject.

The sources are gquark.h, gerror.h, gmem.h, gobject.h and gvalue.h.
"""


class Aravis:
    """The functions of Aravis as methods: ``aravis.camera_get_payload(camera)`` calls ``arv_camera_get_payload``.

    A method raises InstrumentDisconnected if the camera does not answer or is not controlled by this program,
    SetPointRefused if the camera does not permit a value, and InstrumentError for every other error of Aravis.
    """

    def __init__(self, aravis: ctypes.CDLL, gobject: ctypes.CDLL, glib: ctypes.CDLL) -> None:
        for name, (result, arguments) in (_PLAIN | _WITH_ERROR).items():
            function = getattr(aravis, name)
            function.restype = result
            function.argtypes = (*arguments, POINTER(POINTER(_GError))) if name in _WITH_ERROR else arguments
        for library, functions in ((glib, _GLIB), (gobject, _GOBJECT)):
            for name, (result, arguments) in functions.items():
                function = getattr(library, name)
                function.restype, function.argtypes = result, arguments
        self._aravis, self._gobject, self._glib = aravis, gobject, glib

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """Return the function of Aravis whose name is ``arv_`` followed by `name`."""
        function = getattr(self._aravis, f"arv_{name}")
        if f"arv_{name}" not in _WITH_ERROR:
            return function

        def call(*arguments: Any) -> Any:
            error = POINTER(_GError)()
            result = function(*arguments, byref(error))
            if error:
                raise self._error(error)
            return result

        return call

    def strings(self, name: str, camera: int) -> tuple[str, ...]:
        """Return the texts in the array that a function of Aravis returns.

        `name` is the name of the function, such as ``camera_dup_available_trigger_sources``.
        """
        count = c_uint()
        texts = getattr(self, name)(camera, byref(count))
        result = tuple((texts[place] or b"").decode() for place in range(count.value))
        self._glib.g_free(texts)
        return result

    def release(self, gobject: int) -> None:
        """Release a reference to a GObject."""
        self._gobject.g_object_unref(gobject)

    def set_double(self, gobject: int, name: str, number: float) -> None:
        """Set the property `name` of a GObject to a number."""
        value = GValue()
        self._gobject.g_value_init(byref(value), 15 << 2)  # G_TYPE_DOUBLE, gtype.h
        self._gobject.g_value_set_double(byref(value), number)
        self._gobject.g_object_set_property(gobject, name.encode(), byref(value))

    def set_int(self, gobject: int, name: str, number: int) -> None:
        """Set the property `name` of a GObject to an integer."""
        value = GValue()
        self._gobject.g_value_init(byref(value), 6 << 2)  # G_TYPE_INT, gtype.h
        self._gobject.g_value_set_int(byref(value), number)
        self._gobject.g_object_set_property(gobject, name.encode(), byref(value))

    def _error(self, error: Any) -> InstrumentError:
        content = error.contents
        domain, code = self._glib.g_quark_to_string(content.domain).decode(), content.code
        message = " ".join((content.message or b"").decode("utf-8", "replace").split())
        self._glib.g_error_free(error)
        if domain == _DEVICE_ERRORS:
            return InstrumentDisconnected(message) if code in _NOT_THERE else InstrumentError(message)
        return SetPointRefused(message) if domain.startswith("arv-gc") else InstrumentError(message)


@functools.cache
def load_aravis() -> Aravis:
    """Load the library Aravis and return its functions. Raises InstrumentError if Aravis is not installed."""
    system = "linux" if sys.platform.startswith("linux") else sys.platform
    for folder in _FOLDERS.get(system, ()):
        try:
            return Aravis(*(ctypes.CDLL(folder + name) for name in _SHARED_OBJECTS[system]))
        except (OSError, AttributeError):  # the library is not here, or is a version without one of the functions
            continue
    raise InstrumentError(MISSING)


def aravis_is_installed() -> bool:
    """Return whether the library Aravis can be loaded."""
    try:
        load_aravis()
    except InstrumentError:
        return False
    return True
