"""The emulated GigE camera starts, delivers pictures and ends. Stand-ins replace Aravis and the camera's process."""

from __future__ import annotations

import ctypes
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.cameras import aravis_library
from eimi_drivers.cameras.aravis_library import Aravis, load_aravis
from eimi_drivers.emulators import gige_camera, gige_process
from eimi_drivers.emulators.gige_camera import serve_gige
from eimi_drivers.emulators.gige_process import CameraProcess
from eimi_drivers.emulators.gige_stream import FrameSender, StreamedFrame
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError, SetPointRefused

GV_CAMERA, FAKE = 11, 12
SIZE_PX = (6, 4)
RECEIVER = {0xD18: 0x7F000001, 0xD00: 40000, 0xD04: 0x40000000 + 1400}
"""Address, port and packet size of the receiver in the registers (arvgvcpprivate.h of Aravis 0.8)."""
PICTURE = np.arange(24, dtype=np.uint8).reshape(4, 6)


class FakeAravis:
    # A replacement for the library Aravis with one emulated camera; it records the calls.

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.registers: dict[int, int] = {}
        self.region = (0, 0, *SIZE_PX)
        self.sent: list[tuple[StreamedFrame, tuple[str, int], int]] = []
        self.runs = True
        self.description = ""
        self.fill: Callable[..., None] = print

    def gv_fake_camera_new_full(self, address: bytes, serial_number: bytes, path: bytes) -> int:
        with open(path, encoding="utf-8") as file:
            self.description = file.read()
        self.calls.append(("new", address, serial_number))
        return GV_CAMERA

    def gv_fake_camera_get_fake_camera(self, gv_camera: int) -> int:
        assert gv_camera == GV_CAMERA
        return FAKE

    def fake_camera_write_register(self, fake: int, register: int, value: int) -> None:
        assert fake == FAKE
        self.registers[register] = value

    def fake_camera_read_register(self, fake: int, register: int, value: Any) -> None:
        assert fake == FAKE
        value._obj.value = RECEIVER[register]

    def fake_camera_set_trigger_frequency(self, fake: int, rate_Hz: float) -> None:
        self.calls.append(("rate", fake, rate_Hz))

    def fake_camera_set_fill_pattern(self, fake: int, callback: Callable[..., None], data: None) -> None:
        assert fake == FAKE
        self.fill = callback

    def gv_fake_camera_is_running(self, gv_camera: int) -> bool:
        return self.runs and gv_camera == GV_CAMERA

    def buffer_get_image_region(self, buffer: int, *place: Any) -> None:
        for pointer, number in zip(place, self.region, strict=True):
            pointer._obj.value = number

    def buffer_get_frame_id(self, buffer: int) -> int:
        return 65401

    def buffer_get_timestamp(self, buffer: int) -> int:
        return 5_000_000_000

    def set_double(self, gv_camera: int, name: str, number: float) -> None:
        self.calls.append(("set", gv_camera, name, number))

    def release(self, gobject: int) -> None:
        self.calls.append(("release", gobject))

    def exposed(self, code: int = 0x01080001) -> list[int]:
        # Expose one picture in the pixel format with this code, and return the bytes of the data that are sent.
        self.fill(1, None, 0, 0, code)
        frame, receiver, packet_size = self.sent.pop()
        assert (frame.number, frame.stamp_ns, frame.pixel_format) == (65401, 5_000_000_000, code)
        assert frame.region == self.region
        assert (receiver, packet_size) == (("127.0.0.1", 40000), 1400)
        return list(frame.data)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> FakeAravis:
    made = FakeAravis()
    monkeypatch.setattr(gige_camera, "load_aravis", lambda: made)
    monkeypatch.setattr(gige_camera, "_refuse_taken", lambda address: None)
    monkeypatch.setattr(FrameSender, "send", lambda sender, *sent: made.sent.append(sent))
    return made


def test_the_emulated_camera_begins_with_the_size_of_its_sensor_and_a_software_trigger(fake: FakeAravis) -> None:
    with serve_gige(lambda: PICTURE, SIZE_PX):
        # Width, height and sizes of the sensor, trigger source and gain (arvfakecamera.h of Aravis 0.8).
        assert fake.registers == {0x11C: 6, 0x118: 4, 0x100: 6, 0x104: 4, 0x304: 1, 0x110: 0}
        silent = ("set", GV_CAMERA, "gvsp-lost-ratio", 1.0)  # Aravis itself sends no packet
        assert fake.calls == [("new", b"127.0.0.1", b"EIMI01"), silent, ("rate", FAKE, 100.0)]
        assert "FROM - FROM % 1<" in fake.description
        assert '<EnumEntry Name="Global">' in fake.description
    assert fake.calls[-1] == ("release", GV_CAMERA)
    with serve_gige(
        lambda: PICTURE,
        SIZE_PX,
        address="127.0.0.5",
        serial_number="S2",
        rows_step=8,
        shutter="Rolling",
        triggers_per_s=7.0,
    ) as camera:
        assert fake.calls[-3:] == [("new", b"127.0.0.5", b"S2"), silent, ("rate", FAKE, 7.0)]
        assert "FROM - FROM % 8<" in fake.description
        assert '<EnumEntry Name="Rolling">' in fake.description
        camera.lose_packets(0.25)
        assert camera._sender.lost_share == 0.25
        assert camera.failure is None


def test_a_picture_of_the_emulated_camera_is_the_region_of_the_sensor(fake: FakeAravis) -> None:
    with serve_gige(lambda: PICTURE, SIZE_PX):
        assert fake.exposed() == [*range(24)]
        fake.region = (1, 2, 3, 2)
        assert fake.exposed() == [13, 14, 15, 19, 20, 21]
        assert fake.exposed(0x01100005)[:4] == [13 << 4, 0, 14 << 4, 0]  # Mono12, little-endian


def test_after_an_error_of_the_picture_the_error_is_kept_and_all_pictures_are_black(fake: FakeAravis) -> None:
    errors: list[Exception] = [RuntimeError("first"), RuntimeError("second")]

    def fail() -> Any:
        raise errors.pop(0)

    with serve_gige(fail, SIZE_PX) as camera:
        for _ in range(2):
            assert fake.exposed() == [0] * 24
        assert str(camera.failure) == "first"
        assert len(errors) == 1  # the function is not called again


def test_an_emulated_camera_without_a_network_is_released_and_reported(fake: FakeAravis) -> None:
    fake.runs = False
    with (
        pytest.raises(InstrumentError, match=r"cannot serve a GigE camera on 1\.2\.3\.4: no network interface has"),
        serve_gige(lambda: PICTURE, SIZE_PX, address="1.2.3.4"),
    ):
        pytest.fail("a camera was served")
    assert fake.calls[-1] == ("release", GV_CAMERA)


def test_an_address_is_taken_if_its_control_port_is_in_use(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        port = line.getsockname()[1]
        monkeypatch.setattr(gige_camera, "CONTROL_PORT", port)
        with pytest.raises(InstrumentError, match=rf"cannot serve a GigE camera on 127\.0\.0\.1, port {port}: "):
            gige_camera._refuse_taken("127.0.0.1")
    gige_camera._refuse_taken("127.0.0.1")


def test_the_control_port_is_that_of_gige_vision() -> None:
    assert gige_camera.CONTROL_PORT == 3956  # registered for gvcp (IANA)


class Line:
    # One end of the connection between program and camera process, with the messages that arrive.

    def __init__(self, *coming: Any) -> None:
        self.coming = list(coming)
        self.sent: list[Any] = []
        self.polled_s: list[float] = []
        self.closed = False

    def poll(self, timeout_s: float = 0.0) -> bool:
        self.polled_s.append(timeout_s)
        return bool(self.coming)

    def recv(self) -> Any:
        message = self.coming.pop(0)
        if isinstance(message, BaseException):
            raise message
        return message

    def send(self, message: Any) -> None:
        self.sent.append(message)

    def close(self) -> None:
        self.closed = True


class Process:
    # A replacement for the camera process, which ends when it is joined, or never if `hangs`.

    def __init__(self, hangs: bool = False, exitcode: int | None = None) -> None:
        self.hangs, self.exitcode = hangs, exitcode
        self.runs = exitcode is None
        self.done: list[Any] = []
        self.made: dict[str, Any] = {}

    def start(self) -> None:
        self.done.append("start")

    def is_alive(self) -> bool:
        return self.runs

    def join(self, timeout_s: float | None = None) -> None:
        self.done.append(("join", timeout_s))
        self.runs = self.hangs and self.runs

    def kill(self) -> None:
        self.done.append("kill")
        self.hangs = False


@contextmanager
def started(monkeypatch: pytest.MonkeyPatch, process: Process, *answers: Any) -> Iterator[tuple[CameraProcess, Line]]:
    # answers : messages that arrive at the program's end of the connection
    here, there = Line(*answers), Line()

    def make(**options: Any) -> Process:
        process.made = options
        return process

    context = SimpleNamespace(Pipe=lambda: (here, there), Process=make)
    monkeypatch.setattr(gige_process.multiprocessing, "get_context", {"spawn": context}.__getitem__)
    monkeypatch.setattr(gige_process, "load_aravis", lambda: None)
    try:
        with gige_process.gige_process(int, SIZE_PX, address="127.0.0.2") as served:  # type: ignore[arg-type]
            yield served, here
    finally:
        assert process.made["args"] == (there, int, SIZE_PX, {"address": "127.0.0.2"})
        assert process.made["daemon"]
        assert there.closed
        assert here.closed
        assert here.polled_s[0] == gige_process.START_WITHIN_S == 120.0
        assert process.done[:2] == ["start", ("join", gige_process.END_WITHIN_S)]
        assert not process.runs


def test_the_process_of_a_camera_ends_with_its_context(monkeypatch: pytest.MonkeyPatch) -> None:
    process = Process()
    with started(monkeypatch, process, True, True) as (camera, line):
        assert camera.alive
        camera.raise_failure()
        camera.lose_packets(0.5)
        assert line.sent == [0.5]
        assert not line.coming  # the answer has been awaited
    assert process.done == ["start", ("join", 5.0)]


def test_a_process_that_does_not_end_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    process = Process(hangs=True)
    with started(monkeypatch, process, True):
        pass
    assert process.done[2:] == ["kill", ("join", None)]


@pytest.mark.parametrize(
    ("answers", "why"),
    [((), "no answer within 120 s"), ((EOFError(),), "its process ended"), (("no memory",), "no memory")],
)
def test_a_camera_that_does_not_start_is_reported(
    monkeypatch: pytest.MonkeyPatch, answers: tuple[Any, ...], why: str
) -> None:
    with (
        pytest.raises(InstrumentError, match=f"^the emulated camera could not be started: {why}$"),
        started(monkeypatch, Process(), *answers),
    ):
        pytest.fail("a camera was served")


def test_a_process_that_ended_is_reported_with_its_error_or_its_status() -> None:
    process = Process(exitcode=3)
    camera = CameraProcess(process, Line("RuntimeError: broken"))  # type: ignore[arg-type]
    with pytest.raises(InstrumentError, match=r"^the process of the emulated camera has ended: RuntimeError: broken$"):
        camera.raise_failure()
    with pytest.raises(InstrumentError, match=r"has ended: it ended with exit status 3$"):
        camera.raise_failure()
    running = Process(hangs=True)
    CameraProcess(running, Line()).kill()  # type: ignore[arg-type]
    assert running.done == ["kill", ("join", None)]


@pytest.fixture
def default_interrupt() -> Iterator[None]:
    # Restore the handler of Ctrl-C after a test.
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def serving(monkeypatch: pytest.MonkeyPatch, default_interrupt: None) -> SimpleNamespace:
    # Replace the function that serves an emulated camera, and return an object that records its arguments.
    camera = SimpleNamespace(failure=None, lost=[], given=())

    @contextmanager
    def serve(picture: Any, size_px: tuple[int, int], **options: Any) -> Iterator[SimpleNamespace]:
        camera.given = (picture, size_px, options)
        camera.lose_packets = camera.lost.append
        yield camera

    monkeypatch.setattr(gige_process, "serve_gige", serve)
    return camera


def test_the_process_of_a_camera_answers_each_command_until_the_other_end_is_closed(serving: SimpleNamespace) -> None:
    line = Line(0.25, 1.0, EOFError())
    gige_process._serve(line, lambda: print, SIZE_PX, {"shutter": "Rolling"})  # type: ignore[arg-type,return-value]
    assert serving.given == (print, SIZE_PX, {"shutter": "Rolling"})
    assert serving.lost == [0.25, 1.0]
    assert line.sent == [True, True, True]
    assert set(line.polled_s) == {gige_process.LOOK_EVERY_S}
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_the_process_of_a_camera_reports_a_failed_picture_and_ends(serving: SimpleNamespace) -> None:
    serving.failure = ValueError("no beam")
    line = Line()
    gige_process._serve(line, lambda: print, SIZE_PX, {})  # type: ignore[arg-type,return-value]
    assert line.sent[0] is True
    assert "ValueError" in line.sent[1]
    assert "no beam" in line.sent[1]


@pytest.mark.parametrize(
    ("error", "reported"),
    [(InstrumentError("no port"), "no port"), (ValueError("no beam"), "no beam"), (BrokenPipeError("gone"), "")],
)
def test_the_process_of_a_camera_reports_why_it_cannot_begin(
    serving: SimpleNamespace, error: Exception, reported: str
) -> None:
    def prepare() -> Any:
        raise error

    line = Line()
    gige_process._serve(line, prepare, SIZE_PX, {})  # type: ignore[arg-type]
    assert len(line.sent) == bool(reported)
    for message in line.sent:
        assert reported in message
        assert ("ValueError" in message) == isinstance(error, ValueError)


class Shared:
    # A replacement for a shared library, with a function of every name that does nothing.

    def __init__(self, **functions: Callable[..., Any]) -> None:
        self.__dict__ |= {name: Function(function) for name, function in functions.items()}

    def __getattr__(self, name: str) -> Function:
        function = Function(lambda *arguments: None)
        setattr(self, name, function)
        return function


class Function:
    restype: Any = "unset"
    argtypes: Any = "unset"

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.given: list[tuple[Any, ...]] = []

    def __call__(self, *arguments: Any) -> Any:
        self.given.append(arguments)
        return self.function(*arguments)


def test_every_function_of_the_libraries_is_declared_before_it_is_called() -> None:
    # Without a declaration, ctypes would cut a pointer to 32 bits.
    libraries = Shared(), Shared(), Shared()
    Aravis(*libraries)  # type: ignore[arg-type]
    declared = {name: function for library in libraries for name, function in vars(library).items()}
    assert not [name for name, function in declared.items() if "unset" in (function.restype, function.argtypes)]
    pointer = ctypes.c_void_p
    for name, result, arguments in (
        ("g_object_unref", None, (pointer,)),
        ("g_free", None, (pointer,)),
        ("g_error_free", None, (pointer,)),
        ("g_quark_to_string", ctypes.c_char_p, (ctypes.c_uint32,)),
        ("arv_camera_get_device", pointer, (pointer,)),
        ("arv_stream_timeout_pop_buffer", pointer, (pointer, ctypes.c_uint64)),
    ):
        assert (declared[name].restype, declared[name].argtypes) == (result, arguments), name
    # A function that can fail has a further argument for the error.
    assert len(declared["arv_camera_set_region"].argtypes) == 6
    assert declared["arv_camera_get_payload"].restype is ctypes.c_uint
    assert {name.partition("_")[0] for name in vars(libraries[0])} == {"arv"}
    assert {name.rpartition("_")[0] for name in vars(libraries[1])} >= {"g_object", "g_value"}
    assert set(vars(libraries[2])) == {"g_quark_to_string", "g_error_free", "g_free"}


@pytest.mark.parametrize(
    ("domain", "code", "kind"),
    [
        *[("arv-device-error-quark", code, InstrumentError) for code in (0, 1, 3, 4, 7, 8, 9, 11)],
        *[("arv-device-error-quark", code, InstrumentDisconnected) for code in (2, 5, 6, 10)],
        ("arv-gc-error-quark", 2, SetPointRefused),
        ("g-io-error-quark", 2, InstrumentError),
    ],
)
def test_an_error_of_aravis_is_raised_as_the_error_of_its_kind_and_freed(domain: str, code: int, kind: type) -> None:
    content = aravis_library._GError(1, code, b"cannot\n  do\xff that")

    def fail(camera: int, error: Any) -> None:
        error._obj.contents = content

    glib = Shared(g_quark_to_string=lambda quark: domain.encode())
    aravis = Aravis(Shared(arv_camera_start_acquisition=fail), Shared(), glib)  # type: ignore[arg-type]
    with pytest.raises(InstrumentError, match="cannot do") as raised:
        aravis.camera_start_acquisition(7)
    assert (type(raised.value), str(raised.value)) == (kind, "cannot do\ufffd that")
    assert glib.g_quark_to_string.given == [(1,)]
    ((freed,),) = glib.g_error_free.given
    assert ctypes.addressof(freed.contents) == ctypes.addressof(content)


def test_a_call_without_an_error_returns_its_result_and_texts_are_freed() -> None:
    def names(camera: int, count: Any, error: Any) -> Any:
        count._obj.value = 2
        return [b"Software", None]

    glib = Shared()
    aravis = Aravis(
        Shared(
            arv_camera_dup_available_trigger_sources=names,
            arv_camera_get_payload=lambda camera, error: 12,
            arv_get_n_devices=lambda: 3,
        ),  # type: ignore[arg-type]
        Shared(),  # type: ignore[arg-type]
        glib,  # type: ignore[arg-type]
    )
    assert aravis.camera_get_payload(7) == 12
    assert aravis.get_n_devices() == 3
    assert aravis.strings("camera_dup_available_trigger_sources", 7) == ("Software", "")
    assert glib.g_free.given == [([b"Software", None],)]


def test_a_property_is_set_as_an_integer() -> None:
    gobject = Shared()
    Aravis(Shared(), gobject, Shared()).set_int(7, "socket-buffer-size", 5000)  # type: ignore[arg-type]
    ((value, kind),) = gobject.g_value_init.given
    assert kind == 24  # G_TYPE_INT is the fundamental type 6, shifted by 2 (gtype.h)
    assert [number for _, number in gobject.g_value_set_int.given] == [5000]
    ((camera, name, given),) = gobject.g_object_set_property.given
    assert (camera, name) == (7, b"socket-buffer-size")
    assert value._obj is given._obj is gobject.g_value_set_int.given[0][0]._obj


def test_a_property_is_set_as_a_double() -> None:
    gobject = Shared()
    aravis = Aravis(Shared(), gobject, Shared())  # type: ignore[arg-type]
    aravis.set_double(7, "gvsp-lost-ratio", 0.5)
    aravis.release(9)
    ((value, kind),) = gobject.g_value_init.given
    assert kind == 60  # G_TYPE_DOUBLE is the fundamental type 15, shifted by 2 (gtype.h)
    assert [number for _, number in gobject.g_value_set_double.given] == [0.5]
    assert [(camera, name) for camera, name, _ in gobject.g_object_set_property.given] == [(7, b"gvsp-lost-ratio")]
    places = [value, gobject.g_value_set_double.given[0][0], gobject.g_object_set_property.given[0][2]]
    assert len({id(place._obj) for place in places}) == 1
    assert gobject.g_object_unref.given == [(9,)]


@pytest.mark.parametrize(
    ("platform", "loads_from", "looked_in"),
    [
        ("linux", "", ("libaravis-0.8.so.0",)),
        ("linux2", "", ("libaravis-0.8.so.0",)),
        ("darwin", "/usr/local/lib/", ("libaravis-0.8.0.dylib", "/opt/homebrew/lib/libaravis-0.8.0.dylib")),
        ("darwin", "nowhere", ("libaravis-0.8.0.dylib",)),
        ("win32", "", ()),
    ],
)
def test_the_library_is_looked_for_in_the_folders_of_the_system(
    monkeypatch: pytest.MonkeyPatch, platform: str, loads_from: str, looked_in: tuple[str, ...]
) -> None:
    asked: list[str] = []

    def load(path: str) -> Shared:
        asked.append(path)
        if not path.startswith(loads_from) or ("/" in path) != bool(loads_from):
            raise OSError("no such file")
        return Shared()

    monkeypatch.setattr(aravis_library.ctypes, "CDLL", load)
    monkeypatch.setattr(sys, "platform", platform)
    load_aravis.cache_clear()
    try:
        if platform == "win32" or loads_from == "nowhere":
            with pytest.raises(InstrumentError, match="the library Aravis"):
                load_aravis()
            assert not aravis_library.aravis_is_installed()
        else:
            assert load_aravis() is load_aravis()
            assert aravis_library.aravis_is_installed()
            assert len([path for path in asked if path.startswith(loads_from)]) >= 3
    finally:
        load_aravis.cache_clear()
    assert tuple(asked[: len(looked_in)]) == looked_in


def test_a_library_without_one_of_the_functions_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aravis_library.ctypes, "CDLL", lambda path: SimpleNamespace())
    monkeypatch.setattr(sys, "platform", "linux")
    load_aravis.cache_clear()
    with pytest.raises(InstrumentError, match="the library Aravis"):
        load_aravis()
    load_aravis.cache_clear()
