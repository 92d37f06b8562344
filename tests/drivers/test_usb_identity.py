"""The serial number of a USB port identifies a supply, whatever name of the port the rig file gives."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from serial.tools import list_ports

from eimi_drivers.supplies.address import usb_serial_number


@pytest.fixture
def by_id(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    # The path of a link to the serial port /dev/ttyACM7, whose name contains the serial number A1.
    ports = [
        SimpleNamespace(device="/dev/ttyACM7", serial_number="A1"),
        SimpleNamespace(device="/dev/ttyACM8", serial_number="B2"),
        SimpleNamespace(device="/dev/ttyUSB0", serial_number=None),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    link = tmp_path / "usb-Nuvoton_USB_Virtual_COM_A1-if00"
    link.symlink_to("/dev/ttyACM7")
    return link


@pytest.mark.parametrize("form", ["{}", "{}#2", "ASRL{}::INSTR", "ASRL{}"])
def test_a_link_by_id_gives_the_serial_number_of_its_device(by_id: Path, form: str) -> None:
    assert usb_serial_number(form.format(by_id)) == "A1"
    assert usb_serial_number(form.format("/dev/ttyACM8")) == "B2"


def test_a_link_that_leads_to_another_device_gives_the_serial_number_of_that_device(by_id: Path) -> None:
    for target, serial_number in (("/dev/ttyACM8", "B2"), ("/dev/ttyUSB0", ""), ("/dev/ttyACM9", "")):
        by_id.unlink()
        os.symlink(target, by_id)
        assert usb_serial_number(str(by_id)) == serial_number


def test_a_link_that_no_longer_exists_has_no_serial_number(by_id: Path) -> None:
    by_id.unlink()
    assert usb_serial_number(str(by_id)) == ""
