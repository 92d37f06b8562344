"""The emulated supply and its coil behave alike in the same process, on a pseudo-terminal and on a TCP port."""

from __future__ import annotations

import math
import os
import socket
import threading

import pytest

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_drivers.emulators import DIALECTS, CoilSupply, emulate, open_in_process, serve_pty, serve_tcp
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError, Limits
from eimi_drivers.supplies import open_supply

LIMITS = Limits(current_A=1.0, voltage_V=12.0)


def energised(clock: SimulatedClock, **options: float) -> CoilSupply:
    coil = CoilSupply(clock, resistance_ohm=4.0, time_constant_s=0.5, **options)
    coil.set_voltage(12.0)
    coil.set_current(0.8)
    coil.switch(True)
    return coil


def test_current_follows_with_the_time_constant():
    clock = SimulatedClock()
    coil = energised(clock)
    assert coil.coil_current_A() == 0.0
    clock.sleep(0.5)
    assert coil.coil_current_A() == pytest.approx(0.8 * (1 - math.exp(-1)))
    coil.set_current(0.2)  # while the current still rises
    clock.sleep(1.0)
    assert coil.coil_current_A() == pytest.approx(0.2 + (0.8 * (1 - math.exp(-1)) - 0.2) * math.exp(-2))
    coil.switch(False)
    clock.sleep(50.0)
    assert coil.coil_current_A() == pytest.approx(0.0, abs=1e-12)


def test_a_pseudo_terminal_leaves_no_open_file_and_no_thread():
    before = set(os.listdir("/dev/fd")), set(threading.enumerate())
    with serve_pty(emulate("scpi", CoilSupply(WallClock()))) as address:
        supply = open_supply("scpi", address, LIMITS)
        assert not supply.output_on()
        supply.close()
    # Some files and threads of earlier tests may have been closed during this test.
    assert set(os.listdir("/dev/fd")) <= before[0]
    assert set(threading.enumerate()) <= before[1]


def test_the_voltage_set_point_bounds_the_current():
    clock = SimulatedClock()
    coil = energised(clock)
    coil.set_voltage(2.0)
    clock.sleep(50.0)
    assert coil.coil_current_A() == pytest.approx(0.5)
    assert coil.constant_voltage()


def test_the_same_seed_gives_the_same_noise():
    def readings(seed: int) -> list[float]:
        clock = SimulatedClock()
        coil = energised(clock, current_noise_A=0.01, seed=seed)
        clock.sleep(50.0)
        return [coil.read().current_A for _ in range(500)]

    assert readings(1) == readings(1)
    assert readings(1) != readings(2)
    mean = sum(readings(1)) / 500
    spread = math.sqrt(sum((value - mean) ** 2 for value in readings(1)) / 499)
    assert mean == pytest.approx(0.8, abs=0.002)
    assert spread == pytest.approx(0.01, rel=0.15)


def test_armed_protection_trips_at_the_current_set_point():
    clock = SimulatedClock()
    coil = energised(clock)
    coil.arm(True)
    assert coil.output_on()
    clock.sleep(50.0)
    assert not coil.output_on()
    assert coil.state.tripped


@pytest.mark.parametrize("driver", sorted(DIALECTS))
def test_an_hour_in_process_is_simulated(driver):
    clock = SimulatedClock()
    supply = open_in_process(driver, CoilSupply(clock), LIMITS)
    supply.set_voltage(12.0)
    supply.set_current(0.5)
    supply.set_output(True)
    clock.sleep(3600.0)
    assert supply.measure().current_A == pytest.approx(0.5, abs=0.001)


def test_a_served_supply_keeps_its_state_between_connections():
    coil = CoilSupply(WallClock())
    with serve_pty(emulate("korad", coil)) as port:
        for current_A in (0.3, 0.4):
            supply = open_supply("korad", port, LIMITS)
            supply.set_current(current_A)
            supply.close()
    assert coil.state.set_current_A == 0.4
    with serve_tcp(emulate("scpi", coil)) as address:
        for _ in range(2):
            supply = open_supply("scpi", address, LIMITS)
            supply.set_voltage(7.0)
            supply.close()
    assert coil.state.set_voltage_V == 7.0


def test_a_port_in_use_is_refused_to_a_second_driver():
    with serve_pty(emulate("korad", CoilSupply(WallClock()))) as port:
        first = open_supply("korad", port, LIMITS)
        with pytest.raises(InstrumentDisconnected, match=port):
            open_supply("korad", port, LIMITS)
        first.close()
        open_supply("korad", port, LIMITS).close()


def test_an_scpi_supply_opens_on_a_bare_serial_port():
    with serve_pty(emulate("scpi", CoilSupply(WallClock()))) as port:
        supply = open_supply("scpi", port, LIMITS)
        assert supply.identify().address == port
        supply.close()


def test_a_tcp_port_that_is_taken_is_named():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with (
            pytest.raises(InstrumentError, match=str(port)),
            serve_tcp(emulate("scpi", CoilSupply(WallClock())), port=port),
        ):
            pass


def test_the_error_for_an_unknown_dialect_lists_the_dialects():
    with pytest.raises(InstrumentError, match=r"'gpib'.*korad, scpi, .*kepco-bop"):
        emulate("gpib", CoilSupply(SimulatedClock()))


def test_a_serial_server_on_the_network_is_reached_by_its_url():
    coil = CoilSupply(WallClock())
    with serve_tcp(emulate("korad", coil)) as address:
        supply = open_supply("korad", f"socket://127.0.0.1:{address.split('::')[2]}", LIMITS)
        supply.set_current(0.3)
        supply.close()
    assert coil.state.set_current_A == 0.3


def test_the_resistance_of_the_coil_grows_as_it_warms_up():
    clock = SimulatedClock()
    coil = energised(clock, thermal_resistance_K_per_W=10.0, thermal_time_constant_s=600.0)
    clock.sleep(600.0)
    warmer_K = 10.0 * 4.0 * 0.8**2 * (1 - math.exp(-1))
    assert coil.heating_K() == pytest.approx(warmer_K)
    assert coil.resistance_ohm() == pytest.approx(4.0 * (1 + 0.00393 * warmer_K))
    assert coil.read().voltage_V == pytest.approx(0.8 * coil.resistance_ohm())
    coil.switch(False)
    clock.sleep(600.0)
    assert coil.heating_K() == pytest.approx(warmer_K * math.exp(-1))


def test_the_current_of_a_warm_coil_falls_at_the_voltage_limit():
    clock = SimulatedClock()
    coil = energised(clock, thermal_resistance_K_per_W=40.0)
    coil.set_voltage(3.3)
    clock.sleep(1.0)
    assert not coil.constant_voltage()
    clock.sleep(6000.0)
    assert coil.constant_voltage()
    assert coil.coil_current_A() == pytest.approx(3.3 / coil.resistance_ohm())
    assert coil.coil_current_A() < 0.79


def test_the_inductance_shows_in_the_voltage():
    clock = SimulatedClock()
    coil = energised(clock)  # L = 4 ohm x 0.5 s = 2 H
    # No current flows yet, so that the whole voltage is L dI/dt.
    assert coil.read().voltage_V == pytest.approx(2.0 * 0.8 / 0.5)
    coil.set_current(0.0)
    clock.sleep(0.1)
    assert coil.read().voltage_V == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("driver", "messages"),
    [
        (
            "scpi",
            {
                ":SOURce:VOLTage 12": b"",
                "source:voltage:level:immediate:amplitude?": b"1.200000E+01\n",
                "SOUR:CURR:LEV 0.5": b"",
                "CURRENT?": b"5.000000E-01\n",
                "OUTPut:STATe ON": b"",
                "OUTPut?": b"1\n",
                "MEASure:CURRent:DC?": b"0.000000E+00\n",
                "SYSTem:ERRor:NEXT?": b'0,"No error"\n',
                "VOLTA?": b"",
                "SYST:ERR?": b'-113,"Undefined header"\n',
            },
        ),
        (
            "keysight-e364x",
            {
                "VOLTage:PROTection 13": b"",
                ":VOLT:PROT:LEV?": b"1.300000E+01\n",
                "SOURce:VOLTage:PROTection:STATe OFF": b"",
                "VOLT:PROT:STAT?": b"0\n",
            },
        ),
        ("rs-hmp", {"INSTrument:NSELect 1": b"", "INST:NSEL?": b"1\n", "VOLTage:PROTection:LEVel 13": b""}),
        ("rigol-dp800", {":INST:NSEL 1": b"", ":OUTPut:OCP:VALue 1": b"", ":OUTP:OCP:VAL?": b"1.0000\n"}),
        ("keysight-e36312a", {"SOURce:VOLTage 12, (@1)": b"", "VOLTage? (@1)": b"1.200000E+01\n"}),
    ],
)
def test_long_and_short_scpi_headers_are_understood(driver, messages):
    instrument = emulate(driver, CoilSupply(SimulatedClock()))
    for message, answer in messages.items():
        assert instrument.receive(f"{message}\n".encode()) == answer, message
