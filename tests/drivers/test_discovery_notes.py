"""The search for attached instruments lists each instrument once, and notes missing libraries and further drivers."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from zeroconf import ServiceInfo

from eimi_drivers import discovery
from eimi_drivers.cameras import CAMERAS
from eimi_drivers.discovery import Discovery, Found
from eimi_drivers.installed import Drivers
from eimi_drivers.lan_instruments import HISLIP, LXI, RAW, _by_host
from eimi_drivers.supplies import SUPPLIES

PORT = Found("supply", "korad", "/dev/ttyUSB0", "serial port")
VISA = Found("supply", "scpi", "TCPIP::192.0.2.1::INSTR", "VISA resource")
LAN = Found("supply", "aim-tti", "TCPIP::192.0.2.1::9221::SOCKET", "TTi")
CAMERA = Found("camera", "opencv", "0", "Webcam")


@pytest.fixture
def search(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Any]:
    # Return a function that searches for instruments with prepared results.
    # Its keywords are parts of the search, such as `serial_ports`; the values are instruments, or an exception to
    # raise.
    def run(**instruments: Any) -> Discovery:
        for name in ("serial_ports", "network", "cameras", "basler_cameras", "genicam_cameras", "gentl_cameras"):
            answer = instruments.get(name, ())

            def listed(answer: Any = answer) -> Any:
                if isinstance(answer, Exception):
                    raise answer
                return answer

            monkeypatch.setattr(discovery, f"list_{name}", listed)
        monkeypatch.setattr(discovery, "list_visa_resources", lambda: (instruments.get("visa", ()), ()))
        monkeypatch.setattr(
            discovery, "VIDEO_DEVICES", tmp_path if instruments.get("lists_cameras") else tmp_path / "none"
        )
        return discovery.discover()

    yield run
    for drivers in (SUPPLIES, CAMERAS):
        for name in drivers.added():
            del drivers[name]


def test_every_kind_of_instrument_is_listed_in_its_order(search: Any) -> None:
    others = [Found("camera", driver, "1", driver) for driver in ("basler", "aravis", "gentl")]
    result = search(
        serial_ports=(PORT,),
        network=(LAN,),
        cameras=(CAMERA,),
        basler_cameras=(others[0],),
        genicam_cameras=(others[1],),
        gentl_cameras=(others[2],),
    )
    assert result.found == (PORT, LAN, CAMERA, *others)
    assert result.notes == ()


def test_a_host_is_listed_once_with_its_announcement(search: Any) -> None:
    usb = Found("supply", "scpi", "USB0::1::2::INSTR", "VISA resource")
    elsewhere = Found("supply", "scpi", "TCPIP::192.0.2.2::INSTR", "VISA resource")
    assert search(network=(LAN,), visa=(VISA, usb, elsewhere), cameras=(CAMERA,)).found == (
        *(LAN, usb, elsewhere),
        CAMERA,
    )


@pytest.mark.parametrize("kind", ["serial_ports", "visa", "network"])
def test_with_a_supply_of_any_kind_there_is_no_note_about_a_missing_supply(search: Any, kind: str) -> None:
    one = {"serial_ports": PORT, "visa": VISA, "network": LAN}[kind]
    assert discovery.NO_SUPPLY not in search(**{kind: (one,)}).notes
    assert discovery.NO_SUPPLY in search(cameras=(CAMERA,)).notes


@pytest.mark.parametrize("lists_cameras", [True, False])
def test_the_note_about_a_missing_camera_depends_on_the_operating_system(search: Any, lists_cameras: bool) -> None:
    notes = search(serial_ports=(PORT,), lists_cameras=lists_cameras).notes
    assert notes == (discovery.NO_CAMERA if lists_cameras else discovery.UNLISTED_CAMERAS,)
    assert search(serial_ports=(PORT,), gentl_cameras=(CAMERA,), lists_cameras=lists_cameras).notes == ()


@pytest.mark.parametrize("kind", ["serial_ports", "network", "cameras", "basler_cameras", "genicam_cameras"])
def test_a_search_that_fails_is_a_note_and_the_others_go_on(search: Any, kind: str) -> None:
    instruments = {"serial_ports": (PORT,), "network": (LAN,), "cameras": (CAMERA,)} | {
        kind: RuntimeError("no\nservice")
    }
    result = search(**instruments)
    assert [note for note in result.notes if "RuntimeError: no service" in note]
    assert len(result.found) == 2 + (kind not in instruments or kind in ("basler_cameras", "genicam_cameras"))


def test_drivers_that_a_program_adds_are_noted(search: Any) -> None:
    SUPPLIES["mine"] = SUPPLIES["korad"]
    CAMERAS["other"] = CAMERAS["opencv"]
    notes = search(serial_ports=(PORT,), cameras=(CAMERA,)).notes
    assert notes == ("supply drivers of this program: mine", "camera drivers of this program: other")


def test_genicam_cameras_are_listed_with_protocol_and_address(monkeypatch: pytest.MonkeyPatch) -> None:
    attached = [
        SimpleNamespace(serial_number="S1", model="Maker Model", protocol="GigEVision", address="192.0.2.7"),
        SimpleNamespace(serial_number="S2", model="Maker Model", protocol="USB3Vision", address=""),
    ]
    monkeypatch.setattr(discovery, "aravis_is_installed", lambda: True)
    monkeypatch.setattr(discovery, "load_aravis", lambda: None)
    monkeypatch.setattr(discovery, "attached_cameras", lambda aravis: attached)
    assert discovery.list_genicam_cameras() == (
        Found("camera", "aravis", "S1", "Maker Model, GigEVision at 192.0.2.7"),
        Found("camera", "aravis", "S2", "Maker Model, USB3Vision"),
    )
    monkeypatch.setattr(discovery, "aravis_is_installed", lambda: False)
    assert discovery.list_genicam_cameras() == ()


def test_basler_cameras_are_listed_by_serial_number(monkeypatch: pytest.MonkeyPatch) -> None:
    device = SimpleNamespace(GetSerialNumber=lambda: "2345", GetModelName=lambda: "a2A")
    factory = SimpleNamespace(GetInstance=lambda: SimpleNamespace(EnumerateDevices=lambda: [device]))
    monkeypatch.setitem(sys.modules, "pypylon", SimpleNamespace(pylon=SimpleNamespace(TlFactory=factory)))
    assert discovery.list_basler_cameras() == (Found("camera", "basler", "2345", "a2A"),)
    monkeypatch.setitem(sys.modules, "pypylon", None)
    assert discovery.list_basler_cameras() == ()


def info(kind: str, host: str, port: int, **fields: str) -> ServiceInfo:
    parts = bytes(int(part) for part in host.split("."))
    return ServiceInfo(kind, f"box.{kind}", addresses=[parts], port=port, properties=fields, server="i.local.")


def test_instruments_of_the_network_are_sorted_by_the_numbers_of_their_addresses() -> None:
    hosts = ["192.0.2.10", "192.0.2.9", "10.0.0.1"]
    assert [found.host for found in _by_host([info(LXI, host, 80) for host in hosts])] == [
        *("10.0.0.1", "192.0.2.9"),
        "192.0.2.10",
    ]


def test_the_announcements_of_one_host_are_joined() -> None:
    (found,) = _by_host(
        [
            info(HISLIP, "192.0.2.9", 4880, Manufacturer="KEYSIGHT TECHNOLOGIES"),
            info(LXI, "192.0.2.9", 80, Model="E36312A", SerialNumber="MY1", Manufacturer=""),
            info(RAW, "192.0.2.9", 5555),
        ]
    )
    assert found.text == "KEYSIGHT TECHNOLOGIES E36312A, serial number MY1"
    assert found.address == "TCPIP::192.0.2.9::5555::SOCKET"
    assert found.recognised is not None
    assert found.recognised.driver == "keysight-e36312a"


def drivers() -> Drivers[Any]:
    return Drivers("supply", "eimi_drivers.nowhere", {"korad": print}, reserved=("virtual",))


def test_a_program_adds_replaces_and_removes_only_its_own_drivers() -> None:
    table = drivers()
    table["zoo"], table["mine"] = len, repr
    table["zoo"] = str
    assert (table["zoo"], table["korad"], table.added(), len(table)) == (str, print, ("mine", "zoo"), 3)
    assert list(table) == ["korad", "mine", "zoo"]
    del table["zoo"]
    assert "zoo" not in table
    assert "korad" in table
    for name, error, words in (
        ("korad", ValueError, "belongs to eimi"),
        ("virtual", ValueError, "belongs to eimi"),
        ("", TypeError, "should be a text"),
    ):
        with pytest.raises(error, match=words):
            table[name] = repr
    with pytest.raises(TypeError, match="should be a class or a function, not 5"):
        table["five"] = 5
    with pytest.raises(ValueError, match="cannot be removed"):
        del table["korad"]
    with pytest.raises(KeyError, match=r"there is no supply driver 'minu'; .* korad, mine; did you mean 'mine'"):
        del table["minu"]
