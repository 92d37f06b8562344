"""`eimi emulate bench` writes a rig file with which another program can measure on the emulated bench."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import table_text
from eimi_lab.process.errors import InputError
from eimi_lab.virtual.client_rig import with_virtual_table, write_client_rig
from eimi_lab.virtual.served_bench import ServedBench, port_of
from eimi_lab.virtual.virtual_rig import truth_of

REAL = """
name = "my bench"
calibration = "virtual_calibration.toml"
camera = { driver = "basler", source = "40012345", exposure_s = 0.008, region = [320, 64, 640, 512] }
[supply]
driver = "keysight-e36312a"
address = "TCPIP::192.168.0.5::5025::SOCKET#2"
limits = { current_A = 1.0, voltage_V = 9.0 }
[[sensors]]
name = "hall"
driver = "lakeshore-425"
address = "/dev/ttyUSB3"
measures = "field"
[[interlocks]]
reading = "hall"
maximum = 20.0
"""


@pytest.fixture
def real(tmp_path: Path) -> Path:
    (tmp_path / "virtual_calibration.toml").write_text(load_rig("virtual").calibration.text)
    (tmp_path / "real.toml").write_text(REAL)
    return tmp_path / "real.toml"


def test_the_written_rig_file_has_the_served_addresses_and_all_other_keys(real: Path) -> None:
    client = real.with_name("client.toml")
    supply = "TCPIP::127.0.0.1::1234::SOCKET#2"
    write_client_rig(load_rig(real), client, supply, "127.0.0.1", {"hall": "/dev/pts/7"}, False)
    before, after = load_rig(real), load_rig(client)
    assert (after.supply.driver, after.supply.address) == ("keysight-e36312a", supply)
    assert (after.supply.limits, after.interlocks) == (before.supply.limits, before.interlocks)
    assert (after.camera.driver, after.camera.source) == ("aravis", "127.0.0.1")
    assert after.camera.settings == before.camera.settings
    assert [sensor.address for sensor in after.sensors] == ["/dev/pts/7"]
    assert after.calibration == before.calibration
    with pytest.raises(InputError, match=r"client_calibration\.toml: exists"):
        write_client_rig(before, client, "COM1", "127.0.0.1", {}, False)


def test_the_written_rig_file_does_not_contain_the_true_materials(tmp_path: Path) -> None:
    write_client_rig(load_rig("emulated_bench"), tmp_path / "client.toml", "/dev/pts/1", "127.0.0.1", {}, False)
    text = "".join(path.read_text() for path in tmp_path.iterdir())
    assert "46390" not in text
    assert "4.4" not in text
    assert "[virtual" not in text
    assert load_rig(tmp_path / "client.toml").virtual is None


def test_a_rig_without_a_virtual_table_shows_the_beam_in_the_region_of_its_camera(real: Path) -> None:
    specimen = load_specimen("type1")
    rig = with_virtual_table(load_rig(real), specimen)
    assert rig.virtual is not None
    assert rig.virtual.frame_size_px == (640, 512)
    assert truth_of(rig, specimen)["model"] == "neo-hookean"
    whole = load_rig(real).model_copy(update={"camera": load_rig(real).camera.model_copy(update={"region": None})})
    shown = with_virtual_table(whole, specimen).virtual
    assert shown is not None
    width, height = shown.frame_size_px
    assert width >= 640 + 0.6 * 25 * 30  # the beam: clamp at (640, 80), 25 px/mm, 30 mm long, hanging down
    assert height >= 80 + 25 * 30


def test_a_specimen_of_an_unknown_material_is_refused_before_anything_is_served(tmp_path: Path) -> None:
    shipped = load_specimen("type1")
    of_butter = shipped.specimen.model_copy(update={"material": "butter"})
    specimen = shipped.model_copy(update={"specimen": of_butter})
    with pytest.raises(InputError, match=r"material = .* is not defined in the virtual rig"):
        ServedBench(load_rig("emulated_bench"), specimen, tmp_path / "bench.toml", print)


@pytest.mark.parametrize(
    ("address", "port"),
    [
        ("TCPIP::127.0.0.1::9221::SOCKET", 9221),
        ("TCPIP0::localhost::5025::SOCKET#3", 5025),
        ("socket://127.0.0.1:7000", 7000),
        ("TCPIP::192.168.0.5::5025::SOCKET", 0),
        ("TCPIP::127.0.0.1::INSTR", 0),
        ("GPIB0::5::INSTR", 0),
        ("USB0::1::2::3::INSTR", 0),
        ("/dev/ttyUSB0", None),
        ("ASRL/dev/ttyUSB0::INSTR", None),
        ("virtual", None),
    ],
)
def test_an_address_is_served_at_its_port_if_it_is_one_of_this_computer(address: str, port: int | None) -> None:
    assert port_of(address) == port


def test_lists_of_tables_are_written_as_toml() -> None:
    table = {
        "name": "a",
        "pair": [1, 2],
        "inner": {"x": 1.5, "deep": {"y": True}},
        "rows": [{"k": "é", "in": {"z": 1}}, {}],
    }
    assert tomllib.loads(table_text(table)) == table
