"""The search for attached instruments lists each instrument with its driver, and notes what could not be searched."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import pyvisa
import serial
from serial.tools import list_ports

from eimi_drivers import discovery
from eimi_drivers.discovery import Found
from eimi_drivers.lan_instruments import LanInstrument
from eimi_drivers.supplies.address import usb_serial_number
from eimi_drivers.supplies.recognised import recognise


def test_without_instruments_the_search_gives_notes_and_opens_no_port(monkeypatch, tmp_path):
    def never(*arguments, **options):
        pytest.fail("a port was opened")

    monkeypatch.setattr(serial, "Serial", never)
    monkeypatch.setattr(list_ports, "comports", list)
    monkeypatch.setattr(discovery, "VIDEO_DEVICES", tmp_path / "absent")
    monkeypatch.setattr(discovery, "list_basler_cameras", tuple)
    monkeypatch.setattr(discovery, "list_genicam_cameras", tuple)
    result = discovery.discover()
    assert not [found for found in result.found if not found.address.startswith("TCPIP")]
    assert discovery.NO_SUPPLY in result.notes or result.found
    assert discovery.UNLISTED_CAMERAS in result.notes


def test_serial_ports_are_listed_with_their_driver(monkeypatch):
    ports = [
        SimpleNamespace(device="/dev/ttyUSB0", vid=0x0403, pid=0x6001, description=None, serial_number=None),
        SimpleNamespace(device="COM12", vid=0x0416, pid=0x5011, description="USB Virtual COM", serial_number="A7"),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    assert discovery.list_serial_ports() == (
        Found("supply", discovery.SERIAL_DRIVERS, "/dev/ttyUSB0", "serial port"),
        Found("supply", "korad", "COM12", "USB Virtual COM, serial number A7"),
    )


def test_gaussmeters_and_boards_are_recognised_by_their_usb_numbers(monkeypatch):
    ports = [
        SimpleNamespace(device="COM3", vid=0x1FB9, pid=0x0401, description="Model 425", serial_number="LSA12"),
        SimpleNamespace(device="COM4", vid=0x2341, pid=0x0043, description=None, serial_number=None),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    assert discovery.list_serial_ports() == (
        Found("sensor", "lakeshore-425", "COM3", "Model 425, serial number LSA12"),
        Found("sensor", "text-line", "COM4", "Arduino board: serial port"),
    )


def test_a_host_that_announces_itself_and_answers_a_broadcast_is_listed_once(monkeypatch):
    def announced():
        instrument = LanInstrument("192.0.2.1", "TCPIP::192.0.2.1::9221::SOCKET", "TTi", recognise("CPX400DP"))
        silent = LanInstrument("192.0.2.3", "", "a scope", None)
        return instrument, silent

    names = ("TCPIP::192.0.2.1::INSTR", "TCPIP::192.0.2.2::INSTR", "USB0::1::2::3::INSTR")
    monkeypatch.setattr(pyvisa.ResourceManager, "list_resources", lambda self, query: names)
    monkeypatch.setattr(discovery, "list_lan_instruments", announced)
    monkeypatch.setattr(list_ports, "comports", list)
    supplies = [(found.driver, found.address) for found in discovery.discover().found if found.kind == "supply"]
    assert supplies == [
        ("aim-tti", "TCPIP::192.0.2.1::9221::SOCKET"),
        (discovery.SCPI_DRIVERS, "TCPIP::192.0.2.3::5025::SOCKET"),
        (discovery.SCPI_DRIVERS, "TCPIP::192.0.2.2::INSTR"),
        (discovery.SCPI_DRIVERS, "USB0::1::2::3::INSTR"),
    ]


def test_no_note_asks_the_user_to_install_a_package(monkeypatch):
    assert not [note for note in discovery.list_visa_resources()[1] if "install" in note]


def test_ports_that_the_system_cannot_list_are_a_note(monkeypatch):
    def fail():
        raise OSError("no such service")

    monkeypatch.setattr(list_ports, "comports", fail)
    assert any(note.startswith("serial ports: ") and "no such service" in note for note in discovery.discover().notes)
    assert usb_serial_number("COM3") == ""


@pytest.mark.parametrize("address", ["COM12", "com12", "ASRL12::INSTR", r"\\.\COM12", "COM12#1"])
def test_the_serial_number_of_a_usb_port_is_found_by_every_name_of_the_port(monkeypatch, address):
    ports = [SimpleNamespace(device="COM1", serial_number="A1"), SimpleNamespace(device="COM12", serial_number="A12")]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    assert usb_serial_number(address) == "A12"


def test_visa_resources_are_listed_without_serial_ports(monkeypatch):
    names = ("ASRL/dev/ttyS0::INSTR", "TCPIP::192.0.2.1::INSTR")
    monkeypatch.setattr(pyvisa.ResourceManager, "list_resources", lambda self, query: names)
    resources, _ = discovery.list_visa_resources()
    assert resources == (Found("supply", discovery.SCPI_DRIVERS, "TCPIP::192.0.2.1::INSTR", "VISA resource"),)


def test_a_bus_that_cannot_be_searched_is_a_note(monkeypatch):
    def fail(self, query):
        raise OSError("network is unreachable")

    monkeypatch.setattr(pyvisa.ResourceManager, "list_resources", fail)
    assert discovery.list_visa_resources() == ((), ("VISA: the search failed: OSError: network is unreachable",))


def test_cameras_are_listed_in_order_without_metadata_nodes(tmp_path):
    for node, index, name in (
        ("video10", "0", "Side camera"),
        ("video2", "0", "Webcam"),
        ("video3", "1", "Webcam"),
    ):
        (tmp_path / node).mkdir()
        (tmp_path / node / "index").write_text(f"{index}\n")
        (tmp_path / node / "name").write_text(f"{name}\n")
    assert discovery.list_cameras(tmp_path) == (
        Found("camera", "opencv", "2", "Webcam"),
        Found("camera", "opencv", "10", "Side camera"),
    )


def test_a_port_that_this_user_may_not_open_is_noted_with_the_remedy(monkeypatch, tmp_path):
    port = tmp_path / "ttyUSB0"
    port.touch()
    listed = SimpleNamespace(device=str(port), vid=None, pid=None, description="adapter", serial_number=None)
    monkeypatch.setattr(list_ports, "comports", lambda: [listed])
    monkeypatch.setattr(discovery.os, "access", lambda path, mode: False)
    monkeypatch.setattr(discovery, "list_basler_cameras", tuple)
    monkeypatch.setattr(discovery, "list_genicam_cameras", tuple)
    assert any(str(port) in note and "dialout" in note for note in discovery.discover().notes)
