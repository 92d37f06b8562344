"""The instrument classes of the Python package dcps work with the emulated supplies over TCP."""

from __future__ import annotations

from typing import Any

import pytest

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_drivers.emulators import CoilSupply, emulate, serve_tcp


def dcps_client(name: str, address: str, **lines: str) -> Any:
    module = pytest.importorskip(f"dcps.{name}", reason="dcps is not installed (extra bench)")
    kind = {"KoradKAseries": "KAseries"}.get(name, name)
    client = getattr(module, kind)(address, wait=0.0, **lines)
    client.open()
    return client


def test_the_rigol_class_of_dcps_drives_the_coil_on_channel_1() -> None:
    coil = CoilSupply(WallClock(), resistance_ohm=4.0)
    with serve_tcp(emulate("rigol-dp800", coil)) as address:
        client = dcps_client("RigolDP800", address, read_termination="\n", write_termination="\n")
        client.rst(wait=0.0)
        client.setVoltage(12.0, channel=1)
        client.setCurrent(0.5)
        client.setVoltageProtection(13.2)
        client.voltageProtectionOn()
        client.setCurrentProtection(1.1)
        client.currentProtectionOn()
        client.outputOn()
        assert (client.queryVoltage(), client.queryCurrent(), client.isOutputOn()) == (12.0, 0.5, True)
        assert (client.isVoltageProtectionOn(), client.isCurrentProtectionOn()) == (True, True)
        assert not client.isVoltageProtectionTripped()
        assert client.measureCurrent() <= 0.5
        assert (coil.state.trip_voltage_V, coil.state.trip_current_A) == (13.2, 1.1)
        client.outputOff()
        client.setLocal()
        assert client.readError().startswith("0")
        client.close()
    assert not coil.state.output


def test_the_korad_class_of_dcps_drives_the_coil() -> None:
    coil = CoilSupply(WallClock())
    with serve_tcp(emulate("korad", coil)) as address:
        client = dcps_client("KoradKAseries", address)
        client.setVoltage(12.0)
        client.setCurrent(0.5)
        client.outputOn()
        assert (client.queryVoltage(), client.queryCurrent(), client.isOutputOn()) == (12.0, 0.5, True)
        client.outputOff()
        assert not client.isOutputOn()
        client.close()


def test_the_class_for_the_pl_series_of_dcps_drives_an_aim_tti() -> None:
    coil = CoilSupply(WallClock())
    with serve_tcp(emulate("aim-tti", coil)) as address:
        client = dcps_client("AimTTiPLP", address)
        client.setVoltage(12.0)
        client.setCurrent(0.5)
        client.outputOn()
        assert (client.queryVoltage(), client.queryCurrent(), client.isOutputOn()) == (12.0, 0.5, True)
        assert client.measureCurrent() <= 0.5
        client.outputOff()
        assert not client.isOutputOn()
        client.close()
    assert not coil.state.output


@pytest.mark.parametrize(
    ("driver", "channel", "exchanges"),
    [
        (
            "rigol-dp800",
            1,
            [
                (":INST CH1", None),
                (":INST?", "CH1"),
                (":INST:SEL CH1", None),
                (":APPL CH1,5,0.4", None),
                (":APPL? CH1", "CH1,5.000,0.4000"),
                (":OUTP CH1,ON", None),
                (":OUTP? CH1", "ON"),
                (":SOUR1:CURR 0.3", None),
                (":SOURce1:CURRent?", "3.000000E-01"),
                (":SOURce1:VOLTage:LEVel:IMMediate:AMPLitude?", "5.000000E+00"),
                (":OUTP:OVP:VAL CH1,8.8;:OUTP:OVP CH1,ON", None),
                (":OUTP:OVP:VAL? CH1", "8.8000"),
                ("*RST", None),
                (":OUTP? CH1", "OFF"),
                (":APPL? CH1", "CH1,0.000,3.0000"),
            ],
        ),
        (
            "rs-hmp",
            1,
            [
                ("INST OUT1", None),
                ("INST?", "OUTP1"),
                ("INST:NSEL?", "1"),
                ("APPL 5,0.4", None),
                ("APPL?", "5.000,0.4000"),
                ("INSTrument:SELect OUTPut1", None),
                ("OUTP:SEL 1;:OUTP:GEN 1", None),
                ("OUTP?", "1"),
            ],
        ),
        (
            "keysight-e3631a",
            2,
            [
                ("APPL P25V,5,0.4", None),
                ("APPL? P25V", '"5.000000,0.400000"'),
                ("INST:NSEL?;:VOLT?", "2;5.000000E+00"),
                ("OUTP:TRAC ON", None),
                ("OUTP:TRAC?", "1"),
                ("INST N25V;:VOLT -7", None),  # while tracking is on, the output +25 V follows the output -25 V
                ("INST P25V;:VOLT?", "7.000000E+00"),
                ("OUTP ON;:OUTP?", "1"),
                ("*RST;:OUTP:TRAC?;:OUTP?", "0;0"),
                ("INST P25V;:CURR?", "1.000000E+00"),
            ],
        ),
    ],
)
def test_messages_of_the_manual_are_obeyed(driver: str, channel: int, exchanges: list[tuple[str, str | None]]) -> None:
    instrument = emulate(driver, CoilSupply(SimulatedClock()), f"#{channel}")
    for message, answer in exchanges:
        expected = b"" if answer is None else f"{answer}\n".encode()
        assert instrument.receive(f"{message}\n".encode()) == expected, message
    assert instrument.receive(b"SYST:ERR?\n") == b'0,"No error"\n'


@pytest.mark.parametrize(
    ("driver", "message"),
    [
        ("rigol-dp800", "OUTP CH2,ON"),
        ("rigol-dp800", ":SOUR2:CURR 0.5"),
        ("rigol-dp800", ":INST CH4"),
        ("rs-hmp", "INST OUT5"),
        ("keysight-e3631a", "OUTP:TRAC 2"),
    ],
)
def test_a_message_for_a_channel_without_the_coil_is_an_error(driver: str, message: str) -> None:
    coil = CoilSupply(SimulatedClock())
    instrument = emulate(driver, coil)
    before = coil.state
    assert instrument.receive(f"{message}\n".encode()) == b""
    assert not instrument.receive(b"SYST:ERR?\n").startswith((b"0,", b"+0"))
    assert coil.state == before
