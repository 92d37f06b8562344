"""A camera driver switches automatic exposure or gain off before it sets a requested value."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import cv2
import pytest

from eimi_drivers.cameras import CameraSettings, aravis_settings
from eimi_drivers.cameras.aravis_library import Aravis
from eimi_drivers.cameras.gentl import GenTLCamera
from eimi_drivers.cameras.opencv import V4L2, V4L2_MANUAL_EXPOSURE


class Calls:
    # A replacement for an Aravis camera; it records the calls that set a value.
    # automatic : quantities with an automatic control, "exposure" or "gain"

    def __init__(self, *automatic: str) -> None:
        self._automatic = automatic
        self.made: list[tuple[str, Any]] = []

    def strings(self, name: str, camera: int) -> list[str]:
        return {"camera_dup_available_trigger_sources": ["Software", "Line1"]}.get(name, ["Mono8"])

    def __getattr__(self, name: str) -> Any:
        name = name.removeprefix("camera_")

        def call(camera: int, *values: Any) -> Any:
            if name.startswith("set_"):
                self.made.append((name, values[-1] if len(values) < 3 else values))
            if name.endswith("_auto_available"):
                return name.removeprefix("is_").removesuffix("_auto_available") in self._automatic
            if name.startswith("is_"):
                return "feature" not in name
            if name == "get_pixel_format_as_string":
                return b"Mono8"
            return b"Software" if name == "get_trigger_source" else 1.0

        return call


@pytest.mark.parametrize("automatic", [(), ("exposure",), ("gain",), ("exposure", "gain")])
@pytest.mark.parametrize(
    ("settings", "requested"),
    [
        (CameraSettings(), ()),
        (CameraSettings(exposure_s=0.002), ("exposure",)),
        (CameraSettings(gain=3.0), ("gain",)),
        (CameraSettings(exposure_s=0.002, gain=3.0), ("exposure", "gain")),
    ],
)
def test_aravis_switches_automatic_controls_off(
    settings: CameraSettings, requested: tuple[str, ...], automatic: tuple[str, ...]
) -> None:
    aravis = Calls(*automatic)
    aravis_settings.set_up(cast(Aravis, aravis), 1, settings)
    expected: list[tuple[str, Any]] = []
    for quantity, off, value in (
        ("exposure", ("set_exposure_time_auto", 0), ("set_exposure_time", 2000.0)),
        ("gain", ("set_gain_auto", 0), ("set_gain", 3.0)),
    ):
        if quantity in requested:
            expected += [*([off] if quantity in automatic else []), value]
    assert [call for call in aravis.made if "exposure" in call[0] or "gain" in call[0]] == expected


class Node:
    # A camera setting that records new values in a log.

    def __init__(self, log: list[tuple[str, Any]], name: str, value: Any) -> None:
        self._log, self._name, self._value = log, name, value
        self.symbolics = ["Mono8", "Software"]

    @property
    def value(self) -> Any:
        return self._value

    @value.setter
    def value(self, value: Any) -> None:
        self._log.append((self._name, value))
        self._value = value


class Nodes:
    # Camera settings as attributes.

    def __init__(self, **values: Any) -> None:
        self.log: list[tuple[str, Any]] = []
        self._nodes = {name: Node(self.log, name, value) for name, value in values.items()}

    def has_node(self, name: str) -> bool:
        return name in self._nodes

    def get_node(self, name: str) -> Node:
        return self._nodes[name]

    def __getattr__(self, name: str) -> Node:
        return self._nodes[name]


FEATURES = {
    **{"PixelFormat": "Mono8", "OffsetX": 4, "OffsetY": 6, "Width": 640, "Height": 480},
    **{"ExposureTime": 1e4, "Gain": 0.0, "Gamma": 1.0},
}


def gentl(nodes: Nodes) -> GenTLCamera:
    # Return a GenTL camera with the settings `nodes`.
    camera = object.__new__(GenTLCamera)
    camera._nodes = nodes
    camera._api = SimpleNamespace(is_readable=lambda node: True, AccessException=KeyError)
    camera._out_of_range = (ValueError,)
    return camera


@pytest.mark.parametrize("automatic", [{}, {"ExposureAuto": "Continuous", "GainAuto": "Once"}])
def test_gentl_switches_automatic_controls_off(automatic: dict[str, str]) -> None:
    nodes = Nodes(**FEATURES, **automatic)
    read_back = gentl(nodes)._set_up(CameraSettings(exposure_s=0.002, gain=3.0))
    assert (read_back.exposure_s, read_back.gain, read_back.gamma) == (0.002, 3.0, 1.0)
    off = [(name, "Off") for name in automatic]
    set_now = [entry for entry in nodes.log if entry[0] in ("ExposureTime", "Gain", *automatic)]
    assert set_now == [*off[:1], ("ExposureTime", 2000.0), *off[1:], ("Gain", 3.0)]
    untouched = Nodes(**FEATURES, **automatic)
    gentl(untouched)._set_up(CameraSettings(gamma=0.8))
    assert [entry for entry in untouched.log if entry[0] != "PixelFormat"] == [("Gamma", 0.8)]


def test_a_gentl_region_is_set_with_its_offsets_at_zero_first() -> None:
    nodes = Nodes(**FEATURES)
    read_back = gentl(nodes)._set_up(CameraSettings(region=(8, 16, 700, 500)))
    assert read_back.region == (8, 16, 700, 500)
    names = ("OffsetX", "OffsetY", "Width", "Height")
    assert [entry for entry in nodes.log if entry[0] in names] == [
        *[("OffsetX", 0), ("OffsetY", 0), ("Width", 700), ("Height", 500)],
        *[("OffsetX", 8), ("OffsetY", 16)],
    ]


def test_a_gentl_camera_has_a_software_trigger_or_a_frame_rate() -> None:
    trigger = {"TriggerMode": "Off", "TriggerSource": "Line0", "TriggerSelector": "AcquisitionStart"}
    nodes = Nodes(**FEATURES, **trigger)
    assert gentl(nodes)._set_up(CameraSettings()).trigger == "software"
    assert nodes.log[1:] == [("TriggerSelector", "FrameStart"), ("TriggerMode", "On"), ("TriggerSource", "Software")]
    rate = {"AcquisitionFrameRateEnable": False, "AcquisitionFrameRate": 10.0, "ResultingFrameRate": 39.5}
    nodes = Nodes(**FEATURES, **trigger, **rate)
    read_back = gentl(nodes)._set_up(CameraSettings(frame_rate_Hz=40.0))
    assert (read_back.trigger, read_back.frame_rate_Hz) == (None, 39.5)
    assert nodes.log[1:] == [
        ("TriggerMode", "Off"),
        ("AcquisitionFrameRateEnable", True),
        ("AcquisitionFrameRate", 40.0),
    ]
    assert gentl(Nodes(**FEATURES))._set_up(CameraSettings()).trigger is None


def test_opencv_switches_to_manual_exposure_on_linux() -> None:
    from eimi_drivers.cameras import opencv

    set_now: list[tuple[int, float]] = []
    capture = SimpleNamespace(
        getBackendName=lambda: V4L2, set=lambda name, value: set_now.append((name, value)), get=lambda name: 20.0
    )
    device = next(kind for kind in vars(opencv).values() if hasattr(kind, "_set_exposure"))
    assert device._set_exposure(SimpleNamespace(_capture=capture, _name="camera 0"), 0.002) == pytest.approx(0.002)
    assert set_now == [(cv2.CAP_PROP_AUTO_EXPOSURE, V4L2_MANUAL_EXPOSURE), (cv2.CAP_PROP_EXPOSURE, 20)]
