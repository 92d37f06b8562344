"""The instrument classes of PyMeasure work with the emulated supplies and sensors over TCP."""

from __future__ import annotations

import importlib
import inspect
from typing import Any

import pytest

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators import CoilSupply, emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.sensors import EmulatedQuantity, emulate_sensor
from tests.patience import PATIENCE_S

pytest.importorskip("pymeasure", reason="PyMeasure is not installed (extra bench)")

CLIENTS = {
    "keysight-e36312a": ("keysight", "KeysightE36312A"),
    "kepco-bop": ("kepco", "KepcoBOP3612"),
    "keysight-e3631a": ("keysight", "KeysightE3631A"),
    "rs-hmp": ("rohdeschwarz.hmp", "HMP4040"),
    "siglent-spd": ("siglenttechnologies", "SPD1168X"),
    "genesys": ("tdk.tdk_gen40_38", "TDK_Gen40_38"),
    "keithley-2260b": ("keithley", "Keithley2260B"),
}
DEPRECATED = frozenset({"enabled", "error"})
"""Properties of Keithley2260B that PyMeasure has replaced. Reading one of them raises an error of PyMeasure."""

UNREADABLE = (LookupError, NotImplementedError)
"""The errors that PyMeasure raises for a property that its class does not have."""


def open_client(driver: str, address: str) -> Any:
    # Return PyMeasure's instrument for a driver, connected to the emulated supply at `address`.
    module, name = CLIENTS[driver]
    kind = getattr(importlib.import_module(f"pymeasure.instruments.{module}"), name)
    lines = {"genesys": {"read_termination": "\r", "write_termination": "\r"}, "kepco-bop": {}}
    ends = lines.get(driver, {"read_termination": "\n", "write_termination": "\n"})
    client = kind(address, visa_library="@py", timeout=2000, **ends)
    if driver == "kepco-bop":
        client.adapter.connection.read_termination = client.adapter.connection.write_termination = "\n"
    return client


def property_values(client: Any) -> dict[str, object]:
    # Return the values of all readable properties of a PyMeasure instrument by name.
    answers = {}
    for name in dir(type(client)):
        if name in DEPRECATED or not isinstance(inspect.getattr_static(type(client), name), property):
            continue
        try:
            answers[name] = getattr(client, name)
        except KeyError:  # PyMeasure does not know the answer
            raise
        except UNREADABLE:
            continue
    return answers


@pytest.mark.filterwarnings("ignore::FutureWarning")
@pytest.mark.parametrize("driver", CLIENTS)
def test_every_property_of_a_class_of_pymeasure_is_answered(driver: str) -> None:
    coil = CoilSupply(WallClock(), resistance_ohm=1.0, max_voltage_V=40.0)
    with serve_tcp(emulate(driver, coil)) as address:
        client = open_client(driver, address)
        match driver:
            case "genesys":
                client.remote = "REM"
                client.voltage_setpoint, client.current_setpoint, client.output_enabled = 5.0, 0.5, True
                assert (client.over_voltage, client.under_voltage, client.remote) == (44.0, 0.0, "REM")
            case "rs-hmp":
                client.selected_channel = 1
                client.voltage, client.current = 5.0, 0.5
                client.selected_channel_active = client.output_enabled = True
            case "keysight-e3631a":
                client.tracking_enabled = True
                assert client.tracking_enabled
                client.ch_1.voltage_setpoint, client.ch_1.current_limit = 5.0, 0.5
                client.output_enabled = True
            case "kepco-bop":
                client.operating_mode, client.current_setpoint, client.output_enabled = "CURR", 0.5, True
            case "keithley-2260b":
                client.voltage_setpoint, client.current_limit, client.output_enabled = 4.0, 0.4, True
                client.applied = (5.0, 0.5)
                assert list(client.applied) == [5.0, 0.5]
            case "keysight-e36312a":
                channel = client.ch_1
                channel.voltage_setpoint, channel.current_limit, channel.output_enabled = 5.0, 0.5, True
            case _:
                channel = client.ch_1
                channel.voltage_setpoint, channel.current_limit = 5.0, 0.5
                channel.enable_output(True)
        answers = property_values(client)
        for channel in getattr(client, "channels", {}).values():
            if not driver.startswith("keysight") or channel.id == 1:
                answers |= property_values(channel)
        assert len(answers) > 5
        assert not [name for name, answer in answers.items() if str(answer).startswith("C0")]
        if driver != "genesys":
            assert client.ask("SYST:ERR?").strip().startswith("0"), answers
        assert (coil.state.output, coil.state.set_current_A) == (True, 0.5)


@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_the_class_for_the_pl_series_drives_an_aim_tti() -> None:
    aimtti = importlib.import_module("pymeasure.instruments.aimtti")
    coil = CoilSupply(WallClock(), resistance_ohm=1.0)
    with serve_tcp(emulate("aim-tti", coil)) as address:
        client = aimtti.PL303P(address, visa_library="@py", read_termination="\r\n", write_termination="\n")
        channel = client.ch_1
        channel.voltage_setpoint, channel.current_limit, channel.output_enabled = 5.0, 0.5, True
        assert (channel.voltage_setpoint, channel.current_limit, channel.output_enabled) == (5.0, 0.5, True)
        assert 0.0 <= channel.current <= 0.5
        assert channel.voltage >= 0.0
        assert client.id.startswith("THURLBY THANDAR")
        assert (coil.state.output, coil.state.set_current_A) == (True, 0.5)
        client.all_outputs_enabled = False
        assert not channel.output_enabled
    assert not coil.state.output


@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_the_class_for_the_lake_shore_425_reads_the_emulated_field() -> None:
    lakeshore = importlib.import_module("pymeasure.instruments.lakeshore")
    quantity = EmulatedQuantity(WallClock(), lambda: 12.5)
    with serve_tcp(emulate_sensor("lakeshore-425", quantity)) as address:
        meter = lakeshore.LakeShore425(address, visa_library="@py", read_termination="\n", write_termination="\n")
        for unit, field in (("T", 0.0125), ("G", 125.0), ("Oe", 125.0), ("A/m", 9947.18)):
            meter.unit = unit
            assert (meter.unit, meter.field) == (unit, pytest.approx(field, rel=1e-5))
        meter.range = 350
        meter.dc_mode(wideband=False)
        assert (meter.range, meter.mode) == (350, (1, 0, 2))
        mean, deviation = meter.measure(3)
        assert (mean, deviation) == (pytest.approx(9947.2, rel=1e-4), 0.0)


@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_the_class_for_the_fw_bell_5080_reads_the_emulated_field() -> None:
    adapters = importlib.import_module("pymeasure.adapters")
    fwbell = importlib.import_module("pymeasure.instruments.fwbell")
    quantity = EmulatedQuantity(WallClock(), lambda: 12.5)
    with serve_pty(emulate_sensor("fwbell-5080", quantity)) as port:
        line = {"read_termination": "\r\n", "write_termination": "\r\n"}
        meter = fwbell.FWBell5080(adapters.SerialAdapter(port, baudrate=2400, timeout=PATIENCE_S, **line))
        for unit, field in (("gauss", 125.0), ("tesla", 0.0125)):
            meter.units = unit
            assert (meter.units, meter.field) == (unit, pytest.approx(field))
        meter.range = 2
        assert meter.range == 2
        assert meter.fields(3) == pytest.approx([0.0125] * 3)
