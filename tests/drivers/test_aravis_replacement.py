"""The camera driver `aravis` calls its library in the right order and waits as long as it should."""

from __future__ import annotations

import ctypes
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.cameras import aravis as driver
from eimi_drivers.cameras.aravis import AravisCamera, Attached, attached_cameras
from eimi_drivers.cameras.aravis_settings import set_up
from eimi_drivers.cameras.settings import SOFTWARE, CameraSettings
from eimi_drivers.clock import SimulatedClock
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    ReplyNotUnderstood,
    SetPointNotTaken,
    SetPointRefused,
)
from tests.patience import PATIENCE_S

CAMERA, DEVICE, STREAM, PAYLOAD = 7, 8, 9, 12
MONO8 = 0x01080001
TRIGGERED = CameraSettings(trigger=SOFTWARE, region=(0, 0, 4, 3))
FREE = CameraSettings(frame_rate_Hz=100.0, region=(0, 0, 4, 3))


class Library:
    # A replacement for the library Aravis; it records the calls of the driver.
    # coming : answers to requests for a frame: the values of a frame, or the time (s) after which no frame has come

    def __init__(self, clock: SimulatedClock) -> None:
        self.clock = clock
        self.calls: list[tuple[Any, ...]] = []
        self.answers: dict[str, Any] = {
            "camera_new": CAMERA,
            "camera_get_device": DEVICE,
            "camera_create_stream": STREAM,
            "camera_get_payload": PAYLOAD,
            "camera_is_gv_device": True,
            "gv_device_is_controller": True,
            "camera_get_vendor_name": b"Maker",
            "camera_get_model_name": b"Model",
            "camera_get_device_serial_number": b"S1",
        }
        self.coming: list[dict[str, Any]] = []
        self.taken: dict[int, dict[str, Any]] = {}
        self.pixels = (ctypes.c_uint8 * PAYLOAD)(*range(PAYLOAD))
        self.waits_us: list[int] = []

    def named(self, name: str) -> list[tuple[Any, ...]]:
        # Return the arguments of all calls of the function `name`.
        return [arguments for called, *arguments in self.calls if called == name]  # type: ignore[misc]

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            self.calls.append((name, *arguments))
            answer = self.answers.get(name)
            if isinstance(answer, Exception):
                raise answer
            return answer(*arguments) if callable(answer) else answer

        return call

    def strings(self, name: str, camera: int) -> tuple[str, ...]:
        return tuple(self.answers[name])

    def stream_timeout_pop_buffer(self, stream: int, wait_us: int) -> int | None:
        self.waits_us.append(wait_us)
        if not self.coming:
            self.clock.sleep(wait_us / 1e6)
        return self.stream_try_pop_buffer(stream)

    def stream_try_pop_buffer(self, stream: int) -> int | None:
        assert stream == STREAM
        if not self.coming:
            return None
        buffer = 1000 + len(self.taken)
        self.taken[buffer] = {"status": 0, "id": len(self.taken) + 1, **self.coming.pop(0)}
        return buffer

    def buffer_get_status(self, buffer: int) -> int:
        return int(self.taken[buffer]["status"])

    def buffer_get_frame_id(self, buffer: int) -> int:
        return int(self.taken[buffer]["id"])

    def buffer_get_image_region(self, buffer: int, *place: Any) -> None:
        for pointer, number in zip(place, self.taken[buffer].get("region", (0, 0, 4, 3)), strict=True):
            pointer._obj.value = number

    def buffer_get_data(self, buffer: int, size: Any) -> int:
        size._obj.value = PAYLOAD
        return ctypes.addressof(self.pixels)

    def buffer_get_image_pixel_format(self, buffer: int) -> int:
        return int(self.taken[buffer].get("format", MONO8))

    def buffer_get_timestamp(self, buffer: int) -> int:
        return int(self.taken[buffer].get("stamp_ns", 0))

    def buffer_get_system_timestamp(self, buffer: int) -> int:
        return 5_000_000_000


class AtOnce:
    # A replacement for the thread of camera calls: it makes each call at once, or never returns if `hangs`.

    hangs = False

    def __init__(self, name: str) -> None:
        self.name, self.ended = name, False

    def begin(self, call: Callable[[], None]) -> Future[None]:
        future: Future[None] = Future()
        if not self.hangs:
            try:
                future.set_result(call())
            except Exception as error:
                future.set_exception(error)
        return future

    def end(self) -> None:
        self.ended = True


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Library:
    clock = SimulatedClock()
    made = Library(clock)
    monkeypatch.setattr(driver, "load_aravis", lambda: made)
    monkeypatch.setattr(driver, "set_up", lambda aravis, camera, settings: settings)
    monkeypatch.setattr(driver, "time", SimpleNamespace(monotonic=clock.now))
    monkeypatch.setattr(driver, "_ControlChannel", AtOnce)
    monkeypatch.setattr(AtOnce, "hangs", False)
    return made


def listed(library: Library, *cameras: tuple[bytes, bytes, bytes]) -> None:
    # Let the library list cameras by identifier, serial number and address.
    library.answers |= {
        "get_n_devices": len(cameras),
        "get_device_id": lambda place: cameras[place][0],
        "get_device_serial_nbr": lambda place: cameras[place][1],
        "get_device_address": lambda place: cameras[place][2],
        "get_device_protocol": b"GigEVision",
        "get_device_vendor": b"Maker",
        "get_device_model": None,
    }


def test_each_attached_camera_is_listed_with_its_own_values_after_a_new_search(library: Library) -> None:
    listed(library, (b"id-1", b"S1", b"10.0.0.1"), (b"id-2", b"S2", b""))
    assert attached_cameras(library) == (  # type: ignore[arg-type]
        Attached("id-1", "S1", "10.0.0.1", "GigEVision", "Maker"),
        Attached("id-2", "S2", "", "GigEVision", "Maker"),
    )
    assert library.calls[0] == ("update_device_list",)


def test_a_camera_is_opened_by_its_address_or_by_the_identifier_of_its_serial_number(library: Library) -> None:
    listed(library, (b"id-1", b"S1", b"10.0.0.1"), (b"id-2", b"S2", b""))
    AravisCamera("10.0.0.9", FREE)
    assert library.named("camera_new") == [[b"10.0.0.9"]]
    assert not library.named("update_device_list")
    identity = AravisCamera("S2", FREE).identify()
    assert library.named("camera_new")[1:] == [[b"id-2"]]
    assert (identity.driver, identity.text, identity.address) == ("aravis", "Maker Model S1", "S2")
    assert identity.serial_number == "S1"
    with pytest.raises(
        InstrumentDisconnected,
        match=r"^camera 17: no camera has this serial number; attached cameras: S1 \(Maker\), S2 \(Maker\)$",
    ):
        AravisCamera(17, FREE)
    listed(library)
    with pytest.raises(InstrumentDisconnected, match=r"attached cameras: none$"):
        AravisCamera("S1", FREE)


def test_the_acquisition_begins_after_32_buffers_of_the_payload_are_ready(library: Library) -> None:
    library.answers["buffer_new_allocate"] = lambda size: 100 + size
    AravisCamera("10.0.0.9", FREE)
    names = [call[0] for call in library.calls]
    assert names.index("camera_create_stream") < names.index("camera_get_payload") < names.index("stream_push_buffer")
    assert library.named("buffer_new_allocate") == [[PAYLOAD]] * 32
    assert library.named("stream_push_buffer") == [[STREAM, 100 + PAYLOAD]] * 32
    assert library.named("set_int") == [[STREAM, "socket-buffer-size", 6 * 2**20]]
    assert library.calls[-1] == ("camera_start_acquisition", CAMERA)


def test_a_camera_on_usb_needs_no_control_of_the_network(library: Library) -> None:
    library.answers |= {"camera_is_gv_device": False, "gv_device_is_controller": False}
    library.coming.append({})
    AravisCamera("10.0.0.9", FREE)._next_frame(1.0)
    assert not library.named("gv_device_is_controller")
    assert not library.named("gv_device_take_control")


@pytest.mark.parametrize(("free_after", "is_opened"), [(0, True), (4, True), (5, True), (6, False)])
def test_a_camera_that_another_program_controls_is_awaited_for_4_s(
    library: Library, free_after: int, is_opened: bool
) -> None:
    def take_control(device: int) -> None:
        assert device == DEVICE
        library.clock.sleep(1.0)
        raise InstrumentError("denied")

    library.answers["gv_device_take_control"] = take_control
    library.answers["gv_device_is_controller"] = lambda device: (
        len(library.named("gv_device_take_control")) >= free_after
    )
    if is_opened:
        AravisCamera("10.0.0.9", FREE)
    else:
        with pytest.raises(InstrumentError, match=r"^camera 10\.0\.0\.9: another program controls this camera; close"):
            AravisCamera("10.0.0.9", FREE)
        assert library.named("release") == [[CAMERA]]
    assert len(library.named("gv_device_take_control")) == min(free_after, 5)


def test_after_a_failed_setting_the_stream_is_not_begun_and_the_camera_is_released(
    library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "set_up", lambda aravis, camera, settings: CameraSettings(frame_rate_Hz=50.0))
    with pytest.raises(
        SetPointNotTaken, match=r"^camera 10\.0\.0\.9: region was set to .*; frame_rate_Hz was set to 100"
    ):
        AravisCamera("10.0.0.9", FREE)
    assert not library.named("camera_create_stream")
    assert library.calls[-2:] == [("camera_stop_acquisition", CAMERA), ("release", CAMERA)]


def test_a_closed_camera_has_released_the_stream_before_the_camera_and_gives_no_frame(library: Library) -> None:
    library.answers["camera_stop_acquisition"] = InstrumentDisconnected("no answer")
    camera = AravisCamera("10.0.0.9", FREE)
    begun = len(library.calls)
    camera.close()
    assert library.calls[begun:] == [
        ("camera_stop_acquisition", CAMERA),
        ("release", STREAM),
        ("release", CAMERA),
    ]
    assert camera._control.ended  # type: ignore[attr-defined]
    camera.close()
    assert len(library.calls) == begun + 3
    library.coming.append({})
    camera.flush()
    assert len(library.coming) == 1  # the stream of a closed camera is not read
    with pytest.raises(InstrumentDisconnected, match=r"^camera 10\.0\.0\.9: the camera was closed; open the camera"):
        camera.grab(1.0)


def test_a_camera_that_does_not_answer_is_closed_nevertheless(
    library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = AravisCamera("10.0.0.9", FREE)
    monkeypatch.setattr(AtOnce, "hangs", True)
    monkeypatch.setattr(driver, "CLOSE_WITHIN_S", 0.01)
    camera.close()
    assert not library.named("release")
    assert camera._control.ended  # type: ignore[attr-defined]


def test_a_triggered_frame_is_newer_than_the_call_and_is_triggered_once(library: Library) -> None:
    camera = AravisCamera("10.0.0.9", TRIGGERED)
    library.coming = [{"id": 1}, {"id": 2}]  # frames that nobody asked for
    library.answers["camera_software_trigger"] = lambda camera: library.coming.append({"id": 3, "stamp_ns": 7})
    frame = camera.grab(1.0)
    assert (frame.number, frame.timestamp_s) == (3, 7e-9)
    np.testing.assert_array_equal(frame.image, np.arange(12).reshape(3, 4))
    assert library.named("camera_software_trigger") == [[CAMERA]]
    assert camera.lost_frames == Counter()
    returned = [buffer for _, buffer in library.named("stream_push_buffer")[32:]]
    assert returned == [1000, 1001, 1002]
    library.pixels[0] = 99
    assert frame.image[0, 0] == 0  # the frame does not share the memory of the buffer


def test_after_an_incomplete_frame_the_camera_is_triggered_again(library: Library) -> None:
    camera = AravisCamera("10.0.0.9", TRIGGERED)
    statuses = [3, 2, 3, 0]
    library.answers["camera_software_trigger"] = lambda camera: library.coming.append({"status": statuses.pop(0)})
    assert camera.grab(1.0).number == 4
    assert len(library.named("camera_software_trigger")) == 4
    # The first frame ever seen has the number 4; the three frames before it came incompletely.
    assert camera.lost_frames == Counter({"missing packets": 2, "timeout before all packets came": 1})


def test_a_frame_that_was_triggered_earlier_is_awaited_for_half_the_time_and_discarded(library: Library) -> None:
    camera = AravisCamera("10.0.0.9", TRIGGERED)
    with pytest.raises(InstrumentTimeout, match=r"^camera 10\.0\.0\.9: no complete frame within 1 s$"):
        camera.grab(1.0)
    began_s = library.clock.now()
    triggered_at_s: list[float] = []

    def trigger(camera: int) -> None:
        triggered_at_s.append(library.clock.now() - began_s)
        library.coming.append({"id": 2})

    library.answers["camera_software_trigger"] = trigger
    assert camera.grab(1.0).number == 2
    assert triggered_at_s == [pytest.approx(0.5)]
    library.answers["camera_software_trigger"] = None
    with pytest.raises(InstrumentTimeout):
        camera.grab(1.0)
    library.coming = [{"id": 3}]  # the late frame
    library.answers["camera_software_trigger"] = lambda camera: library.coming.append({"id": 4})
    assert camera.grab(1.0).number == 4


def test_a_freely_running_camera_gives_the_third_frame_after_a_flush(library: Library) -> None:
    camera = AravisCamera("10.0.0.9", FREE)
    library.coming = [{"id": number} for number in (1, 2, 3)]
    camera.flush()
    assert not library.coming
    assert [buffer for _, buffer in library.named("stream_push_buffer")[32:]] == [1000, 1001, 1002]
    library.coming = [{"id": number} for number in (4, 5, 6, 7)]
    assert [camera.grab(1.0).number, camera.grab(1.0).number] == [6, 7]
    assert camera.lost_frames == Counter()
    assert not library.named("camera_software_trigger")


def test_a_wait_for_a_frame_looks_often_and_at_last_asks_whether_the_camera_answers(library: Library) -> None:
    camera = AravisCamera("10.0.0.9", FREE)
    asked_at_s: list[float] = []
    library.answers["camera_get_payload"] = lambda camera: asked_at_s.append(library.clock.now())
    began_s = library.clock.now()
    with pytest.raises(InstrumentTimeout, match=r"no complete frame within 2 s$"):
        camera.grab(2.0)
    assert library.clock.now() - began_s == pytest.approx(2.0, abs=1e-5)
    assert max(library.waits_us) == 50_000
    assert min(library.waits_us) >= 1
    (asked_s,) = asked_at_s  # once, when less than half of the time is left
    assert 1.0 <= asked_s - began_s <= 1.1


def test_an_incomplete_frame_is_named_in_the_error_and_is_counted_with_the_next_frame(library: Library) -> None:
    camera = AravisCamera("10.0.0.9", FREE)
    library.coming = [{"id": 1}, {"status": 3}, {"status": 3}, {"status": 42}]
    camera.grab(1.0)
    with pytest.raises(InstrumentTimeout, match=r"; incomplete frames: 2 with missing packets, 1 with status 42$"):
        camera.grab(1.0)
    library.coming = [{"id": 7}]
    assert camera.grab(1.0).number == 7
    assert camera.lost_frames == Counter({"missing packets": 2, "status 42": 1, "no packet": 2})


def test_a_frame_without_an_image_counts_as_incomplete_although_its_status_is_success(library: Library) -> None:
    camera = AravisCamera("10.0.0.9", FREE)
    library.coming = [{"id": 1}, {"id": 0, "region": (0, 0, 0, 0)}, {"id": 3}]
    assert [camera.grab(1.0).number for _ in range(2)] == [1, 3]
    assert camera.lost_frames == Counter({"no image": 1})
    library.coming = [{"id": 0, "region": (0, 0, 4, 0)}]
    with pytest.raises(InstrumentTimeout, match=r"; incomplete frames: 1 with no image$"):
        camera.grab(1.0)
    assert set(library.taken) <= {buffer for _, buffer in library.named("stream_push_buffer")}


def test_a_buffer_without_a_frame_is_no_lost_frame(library: Library) -> None:
    # The status 1 is "cleared". No number is missing after the first frame, and two are missing after the second one.
    camera = AravisCamera("10.0.0.9", FREE)
    empty = {"id": 0, "region": (0, 0, 0, 0)}
    library.coming = [{"id": 1}, {"status": 1}, empty, {"id": 2}, {"status": 1}, {"status": 3}, empty, {"id": 5}]
    assert [camera.grab(1.0).number for _ in range(3)] == [1, 2, 5]
    assert camera.lost_frames == Counter({"missing packets": 1, "cleared": 1})


def test_before_the_first_frame_a_buffer_that_may_hold_no_frame_is_no_lost_frame(library: Library) -> None:
    camera = AravisCamera("10.0.0.9", TRIGGERED)
    coming: list[dict[str, Any]] = [{"status": 1}, {"status": 2}, {"region": (0, 0, 0, 0)}, {"status": 1}, {"id": 2}]
    library.answers["camera_software_trigger"] = lambda camera: library.coming.append(coming.pop(0))
    assert camera.grab(1.0).number == 2
    assert camera.lost_frames == Counter({"timeout before all packets came": 1})


def test_a_camera_that_hangs_is_reported_as_disconnected(library: Library, monkeypatch: pytest.MonkeyPatch) -> None:
    camera = AravisCamera("10.0.0.9", FREE)
    monkeypatch.setattr(AtOnce, "hangs", True)
    monkeypatch.setattr(driver, "ANSWER_WITHIN_S", 0.01)
    with pytest.raises(
        InstrumentDisconnected,
        match=r"^camera 10\.0\.0\.9: the camera did not answer within 1 s\. Are its cable and its power plugged in\?$",
    ):
        camera.grab(1.0)


def test_an_error_of_the_check_ends_the_wait(library: Library) -> None:
    camera = AravisCamera("10.0.0.9", FREE)
    library.answers["camera_get_payload"] = InstrumentDisconnected("no answer")
    began_s = library.clock.now()
    with pytest.raises(InstrumentDisconnected, match="no answer"):
        camera.grab(2.0)
    assert library.clock.now() - began_s < 1.2


@pytest.mark.parametrize("lost", ["before", "meanwhile"])
def test_a_camera_that_this_program_no_longer_controls_gives_no_frame(library: Library, lost: str) -> None:
    camera = AravisCamera("10.0.0.9", FREE)
    answers = [lost == "meanwhile", False]
    library.answers["gv_device_is_controller"] = lambda device: answers.pop(0)
    with pytest.raises(InstrumentDisconnected, match="this program no longer controls the camera: the camera was"):
        camera.grab(0.1)
    assert len(answers) == (1 if lost == "before" else 0)


def test_a_frame_of_another_size_or_format_is_refused_and_its_buffer_is_given_back(library: Library) -> None:
    camera = AravisCamera("10.0.0.9", FREE)
    library.coming = [{"id": 5, "region": (0, 0, 3, 4)}, {"format": 1}]
    with pytest.raises(ReplyNotUnderstood, match=r"frame 5 has 3 x 4 pixels, but the region in the settings is \(0, 0"):
        camera.grab(1.0)
    with pytest.raises(ReplyNotUnderstood, match="the pixel format 0x00000001 cannot be decoded"):
        camera.grab(1.0)
    assert [buffer for _, buffer in library.named("stream_push_buffer")[32:]] == [1000, 1001]


def test_without_a_region_in_the_settings_every_size_is_taken_and_the_time_is_that_of_the_computer(
    library: Library,
) -> None:
    camera = AravisCamera("10.0.0.9", CameraSettings(trigger="Line1"))
    library.coming = [{"region": (0, 0, 6, 2)}]
    frame = camera.grab(1.0)
    assert frame.image.shape == (2, 6)
    assert frame.timestamp_s == 5.0
    assert not library.named("camera_software_trigger")


def test_commands_are_made_one_after_the_other_in_a_thread_that_ends() -> None:
    channel = driver._ControlChannel("camera 1")
    (thread,) = (thread for thread in threading.enumerate() if thread.name == "control of camera 1")
    assert thread.daemon
    made: list[int] = []

    def fail() -> None:
        raise InstrumentError("no")

    first, failed, last = (
        channel.begin(lambda: made.append(1)),
        channel.begin(fail),
        channel.begin(lambda: made.append(2)),
    )
    channel.end()
    assert last.result(PATIENCE_S) is None
    assert first.done()
    assert made == [1, 2]
    with pytest.raises(InstrumentError, match=r"^no$"):
        failed.result(PATIENCE_S)
    thread.join(PATIENCE_S)
    assert not thread.is_alive()


class Features(Library):
    # A replacement for the library with a camera whose settings can be written and read.

    def __init__(self) -> None:
        super().__init__(SimulatedClock())
        self.features = {b"Gamma": 0.5, b"ResultingFrameRate": 25.0, b"ShutterMode": b"Rolling"}
        self.features[b"SensorReadoutTime"] = 3000.0
        self.answers |= {
            "camera_dup_available_pixel_formats_as_strings": ("Mono8", "Mono12"),
            "camera_dup_available_trigger_sources": ("Software", "Line1"),
            "camera_get_pixel_format_as_string": b"Mono8",
            "camera_get_trigger_source": b"Line1",
            "camera_get_exposure_time": 1500.0,
            "camera_get_gain": 6.0,
            "camera_get_frame_rate": 24.0,
            "camera_is_exposure_time_available": True,
            "camera_is_gain_available": True,
            "camera_is_exposure_auto_available": True,
            "camera_is_gain_auto_available": True,
            "camera_is_feature_available": lambda camera, name: name in self.features,
            "camera_get_float": lambda camera, name: self.features[name],
            "camera_get_string": lambda camera, name: self.features[name],
        }

    def camera_get_region(self, camera: int, *place: Any) -> None:
        for pointer, number in zip(place, (2, 4, 40, 30), strict=True):
            pointer._obj.value = number

    def written(self) -> list[tuple[Any, ...]]:
        # Return the calls that change the camera, in their order.
        return [call for call in self.calls if "set" in call[0].split("_")]


def test_settings_are_written_in_the_units_of_the_camera_after_the_automatics_are_off() -> None:
    camera = Features()
    wanted = CameraSettings(
        exposure_s=0.0015, gain=6.0, gamma=0.5, region=(2, 4, 40, 30), bit_depth=12, trigger="Line1"
    )
    set_up(camera, CAMERA, wanted)  # type: ignore[arg-type]
    assert camera.written() == [
        ("camera_set_range_check_policy", CAMERA, 1),
        ("camera_set_acquisition_mode", CAMERA, 0),
        ("camera_set_pixel_format_from_string", CAMERA, b"Mono12"),
        ("camera_set_region", CAMERA, 2, 4, 40, 30),
        ("camera_set_exposure_time_auto", CAMERA, 0),
        ("camera_set_exposure_time", CAMERA, 1500.0),
        ("camera_set_gain_auto", CAMERA, 0),
        ("camera_set_gain", CAMERA, 6.0),
        ("camera_set_float", CAMERA, b"Gamma", 0.5),
        ("camera_set_trigger", CAMERA, b"Line1"),
    ]


def test_settings_are_read_back_in_si_units() -> None:
    answered = set_up(Features(), CAMERA, CameraSettings(trigger="Line1"))  # type: ignore[arg-type]
    assert answered == CameraSettings(
        exposure_s=0.0015,
        gain=6.0,
        gamma=0.5,
        region=(2, 4, 40, 30),
        bit_depth=8,
        pixel_format="Mono8",
        trigger="Line1",
        row_time_s=0.0001,
    )


def test_a_camera_without_features_is_left_as_it_is_and_these_values_are_not_read_back() -> None:
    camera = Features()
    camera.features.clear()
    camera.answers |= dict.fromkeys(("camera_is_exposure_time_available", "camera_is_gain_available"), False) | {
        "camera_get_trigger_source": b"Software"
    }
    answered = set_up(camera, CAMERA, CameraSettings())  # type: ignore[arg-type]
    assert [name for name, *_ in camera.written()] == [
        "camera_set_range_check_policy",
        "camera_set_acquisition_mode",
        "camera_set_trigger",
    ]
    assert answered == CameraSettings(region=(2, 4, 40, 30), bit_depth=8, pixel_format="Mono8", trigger=SOFTWARE)
    camera.answers |= dict.fromkeys(("camera_is_exposure_auto_available", "camera_is_gain_auto_available"), False)
    set_up(camera, CAMERA, CameraSettings(exposure_s=0.0015, gain=6.0))  # type: ignore[arg-type]
    assert not camera.named("camera_set_exposure_time_auto")
    assert not camera.named("camera_set_gain_auto")


@pytest.mark.parametrize(
    ("features", "rate_Hz"),
    [
        ({b"ResultingFrameRate": 20.0, b"AcquisitionResultingFrameRate": 21.0}, 20.0),
        ({b"AcquisitionResultingFrameRate": 21.0}, 21.0),
        ({b"BslResultingAcquisitionFrameRate": 22.0}, 22.0),
        ({}, 24.0),
    ],
)
def test_the_frame_rate_is_the_one_that_the_camera_reaches(features: dict[bytes, Any], rate_Hz: float) -> None:
    camera = Features()
    camera.features = features
    answered = set_up(camera, CAMERA, CameraSettings(frame_rate_Hz=25.0))  # type: ignore[arg-type]
    assert (answered.frame_rate_Hz, answered.trigger) == (rate_Hz, None)
    assert camera.written()[-1] == ("camera_set_frame_rate", CAMERA, 25.0)


def test_a_frame_rate_beside_a_trigger_and_an_unknown_trigger_are_refused() -> None:
    with pytest.raises(SetPointRefused, match="trigger = 'Line1': a triggered camera has no frame_rate_Hz"):
        set_up(Features(), CAMERA, CameraSettings(frame_rate_Hz=25.0, trigger="Line1"))  # type: ignore[arg-type]
    with pytest.raises(SetPointRefused, match=r"trigger = 'Line9' must be one of .*: software, Line1$"):
        set_up(Features(), CAMERA, CameraSettings(trigger="Line9"))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("function", "wanted", "begins"),
    [
        ("camera_set_region", {"region": (0, 0, 8, 8)}, r"region = \(0, 0, 8, 8\)"),
        ("camera_set_exposure_time", {"exposure_s": 2.0}, r"exposure_s = 2\.0"),
        ("camera_set_gain", {"gain": 3.0}, r"gain = 3\.0"),
        ("camera_set_float", {"gamma": 9.0}, r"gamma = 9\.0"),
        ("camera_set_frame_rate", {"frame_rate_Hz": 9.0}, r"frame_rate_Hz = 9\.0"),
    ],
)
def test_a_refused_setting_is_named_with_its_value(function: str, wanted: dict[str, Any], begins: str) -> None:
    camera = Features()
    camera.answers[function] = SetPointRefused("not in the range")
    with pytest.raises(SetPointRefused, match=rf"^{begins}: not in the range$"):
        set_up(camera, CAMERA, CameraSettings(**wanted))  # type: ignore[arg-type]
