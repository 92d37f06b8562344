"""The camera driver `gentl` opens a camera, writes its settings and releases it, with replacements for its packages."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from eimi_drivers.cameras.gentl import PRODUCERS, GenTLCamera, producer_files
from eimi_drivers.cameras.settings import SOFTWARE, CameraSettings
from eimi_drivers.discovery import Found, list_gentl_cameras
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentError,
    ReplyNotUnderstood,
    SetPointNotTaken,
    SetPointRefused,
)


class GenericException(Exception):
    pass


class OutOfRangeException(GenericException):
    pass


class AccessException(GenericException):
    pass


class ProducerError(Exception):
    pass


class Node:
    # A feature of a camera; `writing` receives the name and the value of each write.

    def __init__(self, value: Any, *symbolics: str, readable: bool = True, largest: float = 1e9) -> None:
        self._value, self.symbolics, self.readable, self.largest = value, symbolics, readable, largest
        self.name, self.writing = "", [("", None)]
        self.stuck = self.locked = False

    @property
    def value(self) -> Any:
        return self._value

    @value.setter
    def value(self, value: Any) -> None:
        self.writing.append((self.name, value))
        if self.locked:
            raise AccessException("is\n locked")
        if isinstance(value, int | float) and value > self.largest:
            raise OutOfRangeException("is\n  too large")
        if not self.stuck:
            self._value = value


class Nodes:
    # The features of a camera by name.

    def __init__(self, **features: Node) -> None:
        self.features = features
        self.written: list[tuple[str, Any]] = []
        for name, node in features.items():
            node.name, node.writing = name, self.written

    def has_node(self, name: str) -> bool:
        return name in self.features

    def get_node(self, name: str) -> Node:
        return self.features[name]

    def __getattr__(self, name: str) -> Node:
        return self.features[name]


def full_camera(**changed: Node | None) -> Nodes:
    features: dict[str, Node | None] = {
        "PixelFormat": Node("Mono8", "Mono8", "Mono12"),
        "OffsetX": Node(3),
        "OffsetY": Node(5),
        "Width": Node(640),
        "Height": Node(400),
        "ExposureAuto": Node("Continuous"),
        "ExposureTime": Node(2000.0),
        "GainAuto": Node("Continuous"),
        "Gain": Node(1.0, largest=24.0),
        "Gamma": Node(0.7),
        "TriggerMode": Node("Off"),
        "TriggerSource": Node("Line1", "Line1", "Software"),
        "TriggerSelector": Node("AcquisitionStart"),
        "AcquisitionFrameRateEnable": Node(False),
        "AcquisitionFrameRate": Node(30.0),
        "ResultingFrameRate": Node(25.0),
        "SensorShutterMode": Node("Rolling"),
        "SensorReadoutTime": Node(4000.0),
    }
    return Nodes(**{name: node for name, node in (features | changed).items() if node is not None})


class Bench(SimpleNamespace):
    # What stands in for a camera and for the Python packages of the driver: features, devices, and recorded calls.

    nodes: Nodes
    devices: list[Any]
    done: list[Any]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Bench]:
    made = Bench(nodes=full_camera(), done=[], fails=set())
    made.devices = [
        SimpleNamespace(vendor="Maker", model=f"Model {k}", serial_number=f"S{k}", id_=f"id-{k}") for k in (1, 2)
    ]

    def note(call: str) -> None:
        made.done.append(call)
        if call in made.fails:
            raise ProducerError("the producer\n failed")

    class Harvester:
        device_info_list: tuple[Any, ...] = ()

        def add_file(self, path: str) -> None:
            note(f"add {Path(path).name}")

        def update(self) -> None:
            note("update")
            self.device_info_list = tuple(made.devices)

        def create(self, device: Any) -> Any:
            note(f"create {device.serial_number}")
            made.acquirer = SimpleNamespace(
                remote_device=SimpleNamespace(node_map=made.nodes),
                **{name: lambda name=name: note(name) for name in ("start", "stop", "destroy")},
            )
            return made.acquirer

        def reset(self) -> None:
            note("reset")

    genicam, core = ModuleType("genicam"), ModuleType("harvesters.core")
    genicam.genapi = SimpleNamespace(  # type: ignore[attr-defined]
        OutOfRangeException=OutOfRangeException,
        InvalidArgumentException=ValueError,
        AccessException=AccessException,
        GenericException=GenericException,
        is_readable=lambda node: node.readable,
    )
    genicam.gentl = SimpleNamespace(TimeoutException=TimeoutError, GenericException=ProducerError)  # type: ignore[attr-defined]
    core.Harvester = Harvester  # type: ignore[attr-defined]
    for name, module in (("genicam", genicam), ("harvesters", ModuleType("harvesters")), ("harvesters.core", core)):
        monkeypatch.setitem(sys.modules, name, module)
    for name in ("b/second.cti", "b/first.cti", "a/third.cti", "a/none.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.setenv(PRODUCERS, os.pathsep.join([str(tmp_path / "b"), "", str(tmp_path / "a")]))
    return made


def test_the_producers_are_the_files_of_all_folders_in_their_order(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert [file.name for file in producer_files()] == ["first.cti", "second.cti", "third.cti"]
    monkeypatch.delenv(PRODUCERS)
    assert producer_files() == ()
    with pytest.raises(
        InstrumentError, match=f"^camera S1: there is no GenTL producer; install .* variable {PRODUCERS} to the folder"
    ):
        GenTLCamera("S1")
    assert bench.done == ["reset"]


@pytest.mark.parametrize("source", ["S2", "id-2"])
def test_a_camera_is_found_by_its_serial_number_or_its_identifier(bench: Bench, source: str) -> None:
    camera = GenTLCamera(source)
    identity = camera.identify()
    assert (identity.driver, identity.text, identity.address) == ("gentl", "Maker Model 2 S2", source)
    assert identity.serial_number == "S2"
    assert bench.done == ["add first.cti", "add second.cti", "add third.cti", "update", "create S2", "start"]
    assert bench.acquirer.num_buffers == 32
    assert camera.lost_frames.total() == 0
    camera.close()
    camera.close()
    assert bench.done[6:] == ["stop", "destroy", "reset"]


def test_an_unknown_camera_is_reported_with_the_attached_ones(bench: Bench) -> None:
    with pytest.raises(
        InstrumentDisconnected,
        match=r"^camera 7: no camera has this serial number; attached cameras: S1 \(Model 1\), S2 \(Model 2\)$",
    ):
        GenTLCamera(7)
    assert bench.done[-1] == "reset"
    bench.devices.clear()
    with pytest.raises(InstrumentDisconnected, match=r"attached cameras: none$"):
        GenTLCamera("S1")


def test_settings_are_written_in_an_order_that_the_camera_accepts(bench: Bench) -> None:
    wanted = CameraSettings(
        exposure_s=0.0015, gain=6.0, gamma=0.5, region=(2, 4, 40, 30), bit_depth=12, trigger="Line1"
    )
    settings = GenTLCamera("S1", wanted).settings
    assert bench.nodes.written == [
        ("PixelFormat", "Mono12"),
        ("OffsetX", 0),
        ("OffsetY", 0),
        ("Width", 40),
        ("Height", 30),
        ("OffsetX", 2),
        ("OffsetY", 4),
        ("ExposureAuto", "Off"),
        ("ExposureTime", 1500.0),
        ("GainAuto", "Off"),
        ("Gain", 6.0),
        ("Gamma", 0.5),
        ("TriggerSelector", "FrameStart"),
        ("TriggerMode", "On"),
        ("TriggerSource", "Line1"),
    ]
    assert settings == CameraSettings(
        exposure_s=0.0015,
        gain=6.0,
        gamma=0.5,
        region=(2, 4, 40, 30),
        bit_depth=12,
        pixel_format="Mono12",
        trigger="Line1",
        row_time_s=pytest.approx(4000e-6 / 30),
    )


def test_a_camera_with_a_software_trigger_uses_it_unless_a_rate_is_set(bench: Bench) -> None:
    camera = GenTLCamera("S1")
    assert camera.settings.trigger == SOFTWARE
    assert camera.settings.frame_rate_Hz is None
    assert camera._triggered
    assert bench.nodes.written[1:] == [
        ("TriggerSelector", "FrameStart"),
        ("TriggerMode", "On"),
        ("TriggerSource", "Software"),
    ]
    assert camera.settings.region == (3, 5, 640, 400)
    bench.nodes.written.clear()
    camera = GenTLCamera("S1", CameraSettings(frame_rate_Hz=25.0))
    assert (camera.settings.trigger, camera.settings.frame_rate_Hz) == (None, 25.0)
    assert not camera._triggered
    assert bench.nodes.written[1:] == [
        ("TriggerMode", "Off"),
        ("AcquisitionFrameRateEnable", True),
        ("AcquisitionFrameRate", 25.0),
    ]


def test_a_camera_with_few_features_is_read_as_far_as_possible(bench: Bench) -> None:
    bench.nodes = Nodes(
        PixelFormat=Node("Mono8", "Mono8"), Width=Node(640), Height=Node(400), Gain=Node(1, readable=False)
    )
    assert GenTLCamera("S1").settings == CameraSettings(region=(0, 0, 640, 400), bit_depth=8, pixel_format="Mono8")
    GenTLCamera("S1", CameraSettings(region=(0, 0, 320, 200)))
    assert bench.nodes.written[-2:] == [("Width", 320), ("Height", 200)]
    for wanted, message in (
        (CameraSettings(gain=3.0), r"gain = 3\.0: this camera has no Gain"),
        (CameraSettings(exposure_s=0.01), r"exposure_s = 0\.01: this camera has no ExposureTime or ExposureTimeAbs"),
        (CameraSettings(region=(8, 0, 320, 200)), r"region = \(8, 0, 320, 200\): this camera has no OffsetX"),
        (
            CameraSettings(trigger=SOFTWARE),
            r"trigger = 'software' must be one of the trigger sources of this camera: none",
        ),
    ):
        with pytest.raises(SetPointRefused, match=rf"^camera S1: {message}$"):
            GenTLCamera("S1", wanted)
        assert bench.done[-3:] == ["stop", "destroy", "reset"]
        assert "start" not in bench.done[-6:]


def test_a_camera_of_the_older_standard_has_other_names_for_its_features(bench: Bench) -> None:
    bench.nodes = full_camera(
        ExposureTime=None,
        ExposureTimeAbs=Node(2000.0),
        AcquisitionFrameRate=None,
        AcquisitionFrameRateAbs=Node(30.0),
        ResultingFrameRate=None,
        SensorShutterMode=None,
        ShutterMode=Node("Global"),
        TriggerMode=None,
        AcquisitionFrameRateEnable=None,
    )
    settings = GenTLCamera("S1", CameraSettings(exposure_s=0.001, frame_rate_Hz=20.0)).settings
    assert ("ExposureTimeAbs", 1000.0) in bench.nodes.written
    assert (settings.exposure_s, settings.frame_rate_Hz, settings.row_time_s) == (0.001, 20.0, 0.0)
    with pytest.raises(SetPointRefused, match="must be one of the trigger sources of this camera: none"):
        GenTLCamera("S1", CameraSettings(trigger="Line1"))
    assert GenTLCamera("S1").settings.trigger is None


@pytest.mark.parametrize(
    ("name", "wanted", "message"),
    [
        ("Gain", {"gain": 25.0}, r"gain = 25\.0: is too large"),
        ("Gamma", {"gamma": 0.4}, r"gamma = 0\.4: is locked"),
        ("Width", {"region": (0, 0, 8, 8)}, r"region = \(0, 0, 8, 8\): is locked"),
        ("TriggerSource", {"trigger": "Line9"}, r"trigger = 'Line9' must be one of .*: Line1, software"),
    ],
)
def test_a_refused_setting_is_named_with_its_value_and_the_camera_is_released(
    bench: Bench, name: str, wanted: dict[str, Any], message: str
) -> None:
    bench.nodes.features[name].locked = True
    if name == "Gain":
        bench.nodes.features[name].locked = False
    with pytest.raises(SetPointRefused, match=rf"^camera S1: {message}$"):
        GenTLCamera("S1", CameraSettings(**wanted))
    assert bench.done[-3:] == ["stop", "destroy", "reset"]


def test_a_setting_that_is_not_taken_is_reported(bench: Bench) -> None:
    bench.nodes.features["Gain"].stuck = True
    with pytest.raises(SetPointNotTaken, match=r"^camera S1: gain was set to 6\.0 but reads back 1\.0$"):
        GenTLCamera("S1", CameraSettings(gain=6.0))


def test_errors_of_the_producer_are_named_after_the_camera_and_never_prevent_the_release(bench: Bench) -> None:
    bench.fails = {"start", "stop", "reset"}
    with pytest.raises(InstrumentError, match=r"^camera S1: the producer failed$"):
        GenTLCamera("S1")
    assert bench.done[-2:] == ["stop", "reset"]
    bench.fails = {"create S1"}
    with pytest.raises(InstrumentError, match=r"^camera S1: the producer failed$"):
        GenTLCamera("S1")
    assert bench.done[-2:] == ["create S1", "reset"]
    bench.fails = set()
    bench.nodes.features["GainAuto"].locked = True
    with pytest.raises(InstrumentError, match=r"^camera S1: is locked$") as raised:
        GenTLCamera("S1", CameraSettings(gain=6.0))
    assert type(raised.value) is InstrumentError
    bench.nodes.features["PixelFormat"].locked = True
    with pytest.raises(InstrumentError, match=r"^camera S1: is locked$"):
        GenTLCamera("S1")


def test_a_value_beyond_the_range_of_the_camera_outside_the_settings_is_refused(bench: Bench) -> None:
    camera = GenTLCamera("S1")
    for error, kind in (
        (OutOfRangeException("too\n large"), SetPointRefused),
        (ValueError("too\n large"), SetPointRefused),
        (GenericException("too\n large"), InstrumentError),
        (ProducerError("too\n large"), InstrumentError),
    ):
        with pytest.raises(InstrumentError, match=r"^camera S1: too large$") as raised, camera._errors_named():
            raise error
        assert type(raised.value) is kind


def test_a_producer_without_time_stamps_and_offsets_gives_frames_with_the_time_of_the_computer(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Buffer(SimpleNamespace):
        @property
        def image_offset(self) -> int:
            raise ProducerError("unknown")

        @property
        def timestamp_ns(self) -> int:
            raise ProducerError("unknown")

    monkeypatch.setattr("eimi_drivers.cameras.gentl.time", SimpleNamespace(monotonic=lambda: 12.5))
    buffer = Buffer(payload_type=1, frame_id=4, width=3, height=2, raw_buffer=bytes(range(6)), pixel_format=0x01080001)
    camera = GenTLCamera("S1", CameraSettings(region=(0, 0, 3, 2)))
    frame = camera._taken(buffer)
    assert (frame.number, frame.timestamp_s, frame.image.tolist()) == (4, 12.5, [[0, 1, 2], [3, 4, 5]])
    buffer.pixel_format = 1
    with pytest.raises(ReplyNotUnderstood):
        camera._taken(buffer)


def test_attached_cameras_are_listed_and_the_producers_are_released(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert list_gentl_cameras() == (
        Found("camera", "gentl", "S1", "Maker Model 1"),
        Found("camera", "gentl", "S2", "Maker Model 2"),
    )
    assert bench.done == ["add first.cti", "add second.cti", "add third.cti", "update", "reset"]
    bench.fails = {"update"}
    with pytest.raises(ProducerError):
        list_gentl_cameras()
    assert bench.done[-1] == "reset"
    monkeypatch.setitem(sys.modules, "harvesters.core", None)
    assert list_gentl_cameras() == ()
    with pytest.raises(InstrumentError, match=r"need harvesters: pip install 'eimi-lab\[gentl\]'"):
        GenTLCamera("S1")
    monkeypatch.delenv(PRODUCERS)
    assert list_gentl_cameras() == ()
