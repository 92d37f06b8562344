"""The driver of Basler cameras writes and reads settings, with a replacement for pypylon."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.cameras import CameraSettings, open_camera
from eimi_drivers.cameras.basler import BaslerCamera
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    SetPointNotTaken,
    SetPointRefused,
)

SETTINGS = CameraSettings(exposure_s=0.002, gain=6.0, gamma=0.8, region=(16, 32, 64, 48), bit_depth=12)


FAILED, WITHOUT_STAMP = 90, 91
"""Numbers of frames that are not transferred, and that have no time stamp."""

MONO16, RGB8, BAYER_RG8 = 0x01100007, 0x02180014, 0x01080009
"""Codes of pixel formats (Pixel Format Naming Convention, EMVA)."""


class Unusable(Exception):
    pass


class OutOfRange(Unusable):
    pass


class Node:
    # A setting of a Basler camera, which accepts or ignores a new value.

    def __init__(self, value: Any, stuck: bool = False, readable: bool = True) -> None:
        self._value, self._stuck, self.readable = value, stuck, readable
        self.written: list[Any] = []

    @property
    def Value(self) -> Any:
        return self._value

    @Value.setter
    def Value(self, value: Any) -> None:
        self.written.append(value)
        self._value = self._value if self._stuck else value


class Result:
    # The result of a grab in pypylon: a frame number, or None if no frame arrived in time.

    def __init__(self, number: int | None) -> None:
        self._number = number

    def __enter__(self) -> Result:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def IsValid(self) -> bool:
        return self._number is not None

    def GrabSucceeded(self) -> bool:
        return self._number != FAILED

    def GetErrorDescription(self) -> str:
        return " packets are missing\n"

    def GetErrorCode(self) -> int:
        return 0xE1000014

    def GetTimeStamp(self) -> int:
        return 0 if self._number == WITHOUT_STAMP else 5_000_000_000

    def GetBlockID(self) -> int | None:
        return self._number

    def GetPixelType(self) -> int:
        return MONO16

    def GetWidth(self) -> int:
        return 64

    def GetHeight(self) -> int:
        return 48

    def GetBuffer(self) -> bytes:
        return np.full((48, 64), self._number, "<u2").tobytes()


class Device:
    # A Basler camera with an exposure of 10 ms, which delivers one frame for each trigger.
    # late : whether the next frame arrives too late

    def __init__(self, stuck: str = "") -> None:
        defaults = {"ExposureTime": 1e4, "Gain": 0.0, "Gamma": 1.0, "PixelFormat": "Mono8"}
        defaults |= {"OffsetX": 0, "OffsetY": 0, "Width": 1280, "Height": 1024}
        defaults |= {"AcquisitionFrameRateEnable": False, "AcquisitionFrameRate": 30.0, "SensorReadoutTime": 1680.0}
        defaults |= {"BslResultingAcquisitionFrameRate": 100.0, "SensorShutterMode": "Rolling"}
        for name, value in defaults.items():
            setattr(self, name, Node(value, name == stuck))
        self.GevTimestampTickFrequency = Node(1e9)
        self.TriggerSelector, self.TriggerMode, self.TriggerSource = Node(""), Node("Off"), Node("")
        self.MaxNumBuffer = Node(10)
        self.ready: list[int] = []
        self.triggered, self.late, self.grabbing, self.closed = 0, False, False, False
        self.waits_ms: list[int] = []
        self.attached: list[Any] = []
        self.created: list[Any] = []
        self.is_ready = True
        for name in ("ExposureTimeAbs", "AcquisitionFrameRateAbs", "ResultingFrameRate", "ResultingFrameRateAbs"):
            setattr(self, name, Node(0.0, readable=False))
        self.ShutterMode = Node("", readable=False)

    def Open(self) -> None: ...

    def GetDeviceInfo(self) -> SimpleNamespace:
        return SimpleNamespace(GetModelName=lambda: "acA1300", GetSerialNumber=lambda: "4711")

    def Close(self) -> None:
        self.closed = True

    def StartGrabbing(self, strategy: object) -> None:
        self.grabbing = True

    def StopGrabbing(self) -> None:
        self.grabbing = False

    def IsGrabbing(self) -> bool:
        return self.grabbing

    def IsCameraDeviceRemoved(self) -> bool:
        return False

    def WaitForFrameTriggerReady(self, timeout_ms: int, how: object) -> bool:
        self.waits_ms.append(timeout_ms)
        return self.is_ready

    def ExecuteSoftwareTrigger(self) -> None:
        self.triggered += 1
        self.ready.append(self.triggered)

    def RetrieveResult(self, timeout_ms: int, how: object) -> Result:
        self.waits_ms.append(timeout_ms)
        if self.late and timeout_ms:
            self.late = False
            return Result(None)
        return Result(self.ready.pop(0) if self.ready else None)


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Device:
    # The only camera that the replacement for pypylon lists.
    camera = Device()
    camera.attached = [SimpleNamespace(GetSerialNumber=lambda: "4711")]
    camera.created = []
    factory = SimpleNamespace(EnumerateDevices=lambda: camera.attached, CreateDevice=camera.created.append)
    package, pylon, genicam = ModuleType("pypylon"), ModuleType("pypylon.pylon"), ModuleType("pypylon.genicam")
    vars(pylon).update(
        TlFactory=SimpleNamespace(GetInstance=lambda: factory),
        InstantCamera=lambda device: camera,
        GrabStrategy_OneByOne=0,
        TimeoutHandling_Return=0,
    )
    vars(genicam).update(
        GenericException=Unusable, OutOfRangeException=OutOfRange, IsReadable=lambda node: node.readable
    )
    vars(package).update(pylon=pylon, genicam=genicam)
    for module in (package, pylon, genicam):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return camera


def test_every_setting_is_written_to_its_node_in_the_unit_of_the_camera(device: Device) -> None:
    camera = open_camera("basler", 0, SETTINGS)
    assert device.ExposureTime.Value == pytest.approx(2000.0)  # microseconds
    assert (device.Gain.Value, device.Gamma.Value, device.PixelFormat.Value) == (6.0, 0.8, "Mono12")
    region = (device.OffsetX.Value, device.OffsetY.Value, device.Width.Value, device.Height.Value)
    assert region == (16, 32, 64, 48)
    assert (device.TriggerMode.Value, device.TriggerSource.Value) == ("On", "Software")
    assert camera.settings.exposure_s == pytest.approx(0.002)
    assert camera.settings.bit_depth == 12


@pytest.mark.parametrize(
    ("node", "setting"),
    [
        ("ExposureTime", "exposure_s"),
        ("Gain", "gain"),
        ("Gamma", "gamma"),
        ("Width", "region"),
        ("OffsetY", "region"),
        ("PixelFormat", "bit_depth"),
    ],
)
def test_a_setting_that_reads_back_wrong_is_named(device: Device, node: str, setting: str) -> None:
    setattr(device, node, Node(getattr(device, node).Value, stuck=True))
    with pytest.raises(SetPointNotTaken, match=f"{setting} was set to .* but reads back"):
        BaslerCamera(0, SETTINGS)
    assert not device.grabbing
    assert device.closed


def test_with_a_frame_rate_the_camera_runs_freely_and_frames_that_were_exposed_before_a_flush_are_skipped(
    device: Device,
) -> None:
    camera = open_camera("basler", 0, CameraSettings(frame_rate_Hz=100.0))
    assert (device.AcquisitionFrameRateEnable.Value, device.AcquisitionFrameRate.Value) == (True, 100.0)
    assert (device.TriggerMode.Value, camera.settings.frame_rate_Hz) == ("Off", 100.0)
    device.ready = [1, 2]
    assert [camera.grab(1.0).number for _ in range(2)] == [1, 2]
    device.ready = [3, 4]
    camera.flush()
    device.ready = [5, 6, 7, 8]
    assert [camera.grab(1.0).number for _ in range(2)] == [7, 8]


def test_a_frame_rate_that_the_camera_does_not_reach_is_refused(device: Device) -> None:
    with pytest.raises(SetPointNotTaken, match=r"frame_rate_Hz was set to 200\.0 but reads back 100\.0"):
        open_camera("basler", 0, CameraSettings(frame_rate_Hz=200.0))


def test_a_trigger_input_is_refused_with_the_driver_that_has_one(device: Device) -> None:
    assert open_camera("basler", 0, CameraSettings(trigger="software")).settings.trigger == "software"
    with pytest.raises(
        SetPointRefused, match="trigger = 'Line1' must be 'software'; for a trigger input, use driver = 'aravis'"
    ):
        open_camera("basler", 0, CameraSettings(trigger="Line1"))


@pytest.mark.parametrize(("shutter", "row_time_s"), [("Rolling", 35e-6), ("Global", 0.0), ("GlobalReset", None)])
def test_the_row_time_of_the_shutter_is_read_from_the_camera(
    device: Device, shutter: str, row_time_s: float | None
) -> None:
    device.SensorShutterMode = Node(shutter)
    camera = open_camera("basler", 0, CameraSettings(region=(0, 0, 64, 48)))
    assert camera.settings.row_time_s == (None if row_time_s is None else pytest.approx(row_time_s))


def test_a_frame_of_an_earlier_trigger_is_not_returned(device: Device) -> None:
    camera = open_camera("basler", "4711")
    device.late = True
    with pytest.raises(InstrumentTimeout):
        camera.grab(0.01)
    assert device.ready == [1]  # the frame arrived after the timeout
    frame = camera.grab(1.0)
    assert (frame.number, int(frame.image[0, 0]), frame.timestamp_s) == (2, 2, 5.0)


@pytest.mark.parametrize(("ratio", "taken"), [(1.01, True), (0.99, True), (1.05, False), (0.95, False)])
def test_a_setting_may_differ_by_at_most_one_step(ratio: float, taken: bool) -> None:
    requested, answer = CameraSettings(exposure_s=0.01), CameraSettings(exposure_s=0.01 * ratio)
    if taken:
        requested.verify("camera", answer)
        return
    with pytest.raises(SetPointNotTaken, match="exposure_s was set to"):
        requested.verify("camera", answer)


@pytest.mark.parametrize("removed", [False, True])
def test_an_error_of_a_camera_that_was_unplugged_is_a_disconnection(removed: bool) -> None:
    camera: Any = object.__new__(BaslerCamera)
    camera.source, camera._errors = "7", (OutOfRange,)
    camera._camera = SimpleNamespace(IsCameraDeviceRemoved=lambda: removed)
    with pytest.raises(InstrumentError, match=r"^Basler camera 7: gone$") as caught, camera._errors_named():
        raise OutOfRange(" gone ")
    assert isinstance(caught.value, InstrumentDisconnected) is removed


@pytest.mark.parametrize(
    ("removed", "error", "words"),
    [(True, InstrumentDisconnected, "the camera was unplugged"), (False, InstrumentTimeout, "no frame within 0.2 s")],
)
def test_a_frame_that_does_not_come_is_a_disconnection_if_the_camera_is_gone(
    device: Device, monkeypatch: pytest.MonkeyPatch, removed: bool, error: type[Exception], words: str
) -> None:
    camera = open_camera("basler", 0, SETTINGS)
    device.late = True
    monkeypatch.setattr(device, "IsCameraDeviceRemoved", lambda: removed)
    with pytest.raises(error, match=f"^Basler camera 0: {words}"):
        camera.grab(0.2)


def test_a_camera_is_found_by_its_place_or_its_serial_number(device: Device) -> None:
    device.attached.append(SimpleNamespace(GetSerialNumber=lambda: "4712"))
    for source, place in (("4712", 1), ("0", 0), (1, 1), ("4711", 0)):
        BaslerCamera(source)
        assert device.created[-1] is device.attached[place]
    identity = BaslerCamera("4712").identify()
    assert (identity.driver, identity.text, identity.address) == ("basler", "acA1300 4711", "4712")
    with pytest.raises(
        InstrumentDisconnected, match=r"^Basler camera 2: not found; attached Basler cameras: 4711, 4712$"
    ):
        BaslerCamera(2)
    device.attached.clear()
    with pytest.raises(InstrumentDisconnected, match=r"attached Basler cameras: none$"):
        BaslerCamera(0)


def test_without_settings_only_the_trigger_is_set(device: Device) -> None:
    camera = BaslerCamera(0)
    written = {name: node.written for name, node in vars(device).items() if isinstance(node, Node) and node.written}
    assert written == {
        "TriggerSelector": ["FrameStart"],
        "TriggerSource": ["Software"],
        "TriggerMode": ["On"],
        "MaxNumBuffer": [32],
    }
    assert camera.settings == CameraSettings(
        exposure_s=0.01,
        gain=0.0,
        gamma=1.0,
        region=(0, 0, 1280, 1024),
        bit_depth=8,
        pixel_format="Mono8",
        trigger="software",
        row_time_s=pytest.approx(1680e-6 / 1024),
    )
    assert device.grabbing


def test_the_offsets_are_zero_while_the_size_is_set(device: Device) -> None:
    BaslerCamera(0, SETTINGS)
    assert (device.OffsetX.written, device.OffsetY.written) == ([0, 16], [0, 32])
    assert (device.Width.written, device.Height.written) == ([64], [48])


@pytest.mark.parametrize(("bit_depth", "name"), [(8, "Mono8"), (10, "Mono10"), (12, "Mono12"), (16, "Mono16")])
def test_each_bit_depth_has_its_pixel_format(device: Device, bit_depth: int, name: str) -> None:
    assert BaslerCamera(0, CameraSettings(bit_depth=bit_depth)).settings.bit_depth == bit_depth
    assert device.PixelFormat.Value == name


def test_a_pixel_format_is_set_by_its_name(device: Device) -> None:
    settings = BaslerCamera(0, CameraSettings(pixel_format="BayerRG12")).settings
    assert (device.PixelFormat.written, settings.pixel_format, settings.bit_depth) == (["BayerRG12"], "BayerRG12", 12)


@pytest.mark.parametrize(
    ("code", "pixels"),
    [
        (RGB8, np.tile(np.uint8([200, 20, 5]), (48, 64, 1))),
        (BAYER_RG8, np.tile(np.uint8([[200, 20], [20, 5]]), (24, 32))),
    ],
)
def test_the_colours_of_a_frame_are_in_the_order_blue_green_red(
    device: Device, monkeypatch: pytest.MonkeyPatch, code: int, pixels: np.ndarray
) -> None:
    monkeypatch.setattr(Result, "GetPixelType", lambda result: code)
    monkeypatch.setattr(Result, "GetBuffer", lambda result: pixels.tobytes())
    image = BaslerCamera(0).grab(1.0).image
    assert image.shape == (48, 64, 3)
    assert (image == [5, 20, 200]).all()


def test_a_bit_depth_without_a_pixel_format_is_refused(device: Device) -> None:
    with pytest.raises(SetPointRefused, match=r"^Basler camera 0: bit_depth = 9 must be one of 8, 10, 12, 16$"):
        BaslerCamera(0, CameraSettings(bit_depth=9))
    assert device.closed


def test_an_older_camera_has_other_names_for_its_settings(device: Device) -> None:
    for name in ("ExposureTime", "AcquisitionFrameRate", "BslResultingAcquisitionFrameRate", "SensorShutterMode"):
        getattr(device, name).readable = False
    for name in ("Gain", "Gamma", "AcquisitionFrameRateEnable"):
        getattr(device, name).readable = False
    device.ExposureTimeAbs, device.AcquisitionFrameRateAbs = Node(1e4), Node(30.0)
    settings = BaslerCamera(0, CameraSettings(exposure_s=0.002, frame_rate_Hz=20.0)).settings
    assert (device.ExposureTimeAbs.Value, device.AcquisitionFrameRateAbs.Value) == (2000.0, 20.0)
    assert (settings.exposure_s, settings.frame_rate_Hz) == (0.002, 20.0)
    assert (settings.gain, settings.gamma, settings.row_time_s) == (None, None, None)
    assert not device.AcquisitionFrameRateEnable.written
    device.ResultingFrameRateAbs = Node(19.9)
    assert BaslerCamera(0, CameraSettings(frame_rate_Hz=20.0)).settings.frame_rate_Hz == 19.9
    device.ResultingFrameRate = Node(20.1)
    device.ShutterMode, device.SensorReadoutTime = Node("Rolling"), Node(0.0, readable=False)
    settings = BaslerCamera(0, CameraSettings(frame_rate_Hz=20.0)).settings
    assert (settings.frame_rate_Hz, settings.row_time_s) == (20.1, None)
    with pytest.raises(InstrumentError, match=r"^Basler camera 0: the camera has no Gain$"):
        BaslerCamera(0, CameraSettings(gain=1.0))


def test_time_stamps_are_in_the_ticks_of_the_camera_or_of_the_computer(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = BaslerCamera(0, CameraSettings(frame_rate_Hz=100.0))
    device.ready = [1]
    assert camera.grab(1.0).timestamp_s == 5.0
    device.GevTimestampTickFrequency = Node(125e6)
    camera = BaslerCamera(0, CameraSettings(frame_rate_Hz=100.0))
    device.ready = [1]
    assert camera.grab(1.0).timestamp_s == 40.0
    device.GevTimestampTickFrequency.readable = False
    camera = BaslerCamera(0, CameraSettings(frame_rate_Hz=100.0))
    device.ready = [1, WITHOUT_STAMP]
    assert camera.grab(1.0).timestamp_s == 5.0
    monkeypatch.setattr("eimi_drivers.cameras.basler.time", SimpleNamespace(monotonic=lambda: 12.5))
    assert camera.grab(1.0).timestamp_s == 12.5


def test_a_frame_that_was_not_transferred_is_an_error_with_its_cause(device: Device) -> None:
    camera = BaslerCamera(0, CameraSettings(frame_rate_Hz=100.0))
    device.ready = [FAILED, 92]
    with pytest.raises(
        InstrumentError, match=r"^Basler camera 0: a frame was not transferred: packets are missing \(0xe1000014\)$"
    ):
        camera.grab(1.0)
    assert camera.grab(1.0).number == 92


def test_the_time_limit_of_a_frame_is_at_least_a_millisecond(device: Device) -> None:
    camera = BaslerCamera(0)
    device.waits_ms.clear()
    camera.grab(0.25)
    assert device.waits_ms == [0, 250, 250]  # the flush, the wait for the trigger, and the wait for the frame
    device.waits_ms.clear()
    camera.grab(1e-5)
    assert device.waits_ms == [0, 1, 1]


def test_skipped_frames_shorten_the_time_limit(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    retrieve = device.RetrieveResult

    def slowly(timeout_ms: int, how: object) -> Result:
        now_s[0] += 0.4
        return retrieve(timeout_ms, how)

    camera = BaslerCamera(0, CameraSettings(frame_rate_Hz=100.0))
    camera.flush()
    monkeypatch.setattr("eimi_drivers.cameras.basler.time", SimpleNamespace(monotonic=lambda: now_s[0]))
    monkeypatch.setattr(device, "RetrieveResult", slowly)
    device.ready, device.waits_ms = [1, 2, 3], []
    assert camera.grab(1.0).number == 3
    assert device.waits_ms == [1000, 600, 200]
    camera.flush()
    device.waits_ms.clear()
    with pytest.raises(InstrumentTimeout):
        camera.grab(1.0)
    assert device.waits_ms == [1000, 600, 200, 1]


def test_a_camera_that_is_not_ready_for_a_trigger_gives_no_frame(device: Device) -> None:
    camera = BaslerCamera(0)
    device.is_ready = False
    with pytest.raises(
        InstrumentTimeout,
        match=r"^Basler camera 0: no frame within 0\.2 s; check the trigger and the cable of the camera$",
    ):
        camera.grab(0.2)
    assert device.triggered == 0


def test_a_closed_or_removed_camera_gives_no_frame(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    camera = BaslerCamera(0)
    camera.close()
    camera.close()
    assert device.closed
    assert not device.grabbing
    camera.flush()  # returns, although no frame comes
    with pytest.raises(InstrumentDisconnected, match=r"^Basler camera 0: the camera was unplugged or closed$"):
        camera.grab(1.0)
    camera = BaslerCamera(0)
    monkeypatch.setattr(device, "IsCameraDeviceRemoved", lambda: True)
    with pytest.raises(InstrumentDisconnected, match="the camera was unplugged or closed"):
        camera.grab(1.0)
    assert device.triggered == 0


def test_errors_of_pypylon_are_named_after_the_camera_and_the_camera_is_closed(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(error: Exception) -> Any:
        def raising(*arguments: object) -> None:
            raise error

        return raising

    with monkeypatch.context() as patch:
        patch.setattr(device, "StartGrabbing", fail(Unusable(" no bandwidth ")))
        with pytest.raises(InstrumentError, match=r"^Basler camera 0: no bandwidth$"):
            BaslerCamera(0)
        assert device.closed
    with monkeypatch.context() as patch:
        patch.setattr(BaslerCamera, "_set", fail(OutOfRange(" too large ")))
        with pytest.raises(SetPointRefused, match=r"^Basler camera 0: too large$"):
            BaslerCamera(0)
    monkeypatch.setitem(sys.modules, "pypylon", None)
    with pytest.raises(InstrumentError, match=r"^Basler cameras need pypylon: pip install 'eimi-lab\[basler\]'$"):
        BaslerCamera(0)
