"""Each family of supplies behaves as its manual describes where it differs from other families."""

from __future__ import annotations

import sys

import pytest
import serial

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_drivers.emulators import DIALECTS, emulate
from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.emulators.genesys import GenesysDialect
from eimi_drivers.emulators.serve import serve_pty
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    Limits,
    ProtectionTripped,
    SetPointNotTaken,
    SwitchOffFailed,
)
from eimi_drivers.supplies import SUPPLIES, open_supply
from eimi_drivers.supplies.transport import InProcessTransport

LIMITS = Limits(current_A=1.0, voltage_V=12.0)


def test_a_kepco_is_never_switched_off_by_command(bench_of):
    bench = bench_of("kepco-bop in process")
    bench.energise(-0.7)
    bench.supply.safe_off()
    bench.supply.set_output(True)
    bench.supply.set_output(False)
    assert not [message for message in bench.sent if message.startswith(b"OUTP 0") or b"OFF" in message]
    assert bench.coil.state.output
    assert bench.coil.state.set_current_A == 0.0


@pytest.mark.parametrize("driver", ["kepco-bop", "kepco-bit4886"])
def test_a_kepco_whose_output_is_off_is_switched_on(bench_of, driver):
    bench = bench_of(f"{driver} in process")
    bench.coil.switch(False)
    bench.energise()
    assert bench.coil.state.output
    assert bench.supply.output_on()


def test_a_trip_of_a_kepco_at_zero_current_is_noticed(bench_of):
    bench = bench_of("kepco-bop in process")
    bench.energise(0.0)
    assert not bench.supply.output_on()
    bench.supply.check()
    bench.coil.trip()
    with pytest.raises(ProtectionTripped):
        bench.supply.check()


@pytest.mark.parametrize(
    ("lost", "failed"), [(b"CURR 0.00\n", "read back: failed"), (b"MEAS:CURR?\n", "measured current: failed")]
)
def test_a_lost_zero_command_of_a_kepco_is_reported(bench_of, lost, failed):
    bench = bench_of("kepco-bop in process")
    bench.energise()
    bench.line.inject(Fault.SILENCE, lambda message: message == lost)
    with pytest.raises(SwitchOffFailed, match=failed):
        bench.supply.safe_off()
    bench.line.inject(None)
    bench.supply.safe_off()


def test_a_current_that_flows_at_a_kepcos_zero_is_reported(bench_of):
    bench = bench_of("kepco-bop in process")
    bench.energise()
    answers = bench.line.receive
    bench.line.receive = lambda data: b"0.3\n" if data == b"MEAS:CURR?\n" else answers(data)
    with pytest.raises(SwitchOffFailed, match=r"0\.300 A measured although the output was switched off"):
        bench.supply.safe_off()


@pytest.mark.parametrize("driver", ["keysight-n6900", "delta-sm15k", "delta-psc-eth"])
def test_a_mode_that_was_changed_at_the_front_panel_is_set_again(bench_of, driver):
    bench = bench_of(f"{driver} in process")
    bench.energise()
    message = {"keysight-n6900": b"FUNC VOLT\n"}.get(driver, b"SYSTEM:REMOTE:CC FRONT\n")
    bench.line.receive(message)
    bench.supply.safe_off()
    bench.energise(0.5)
    assert bench.coil.coil_current_A() == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("driver", ["keysight-n6900", "delta-sm15k"])
def test_a_mode_that_the_supply_does_not_take_is_an_error_before_any_set_point_is_sent(bench_of, driver):
    bench = bench_of(f"{driver} in process")
    mode = {"keysight-n6900": b"FUNC CURR\n", "delta-sm15k": b"SYSTEM:REMOTE:CC REMOTE\n"}[driver]
    bench.line.inject(Fault.SILENCE, lambda message: message == mode)
    with pytest.raises(SetPointNotTaken, match=r"was sent, but the answer to .*\? is"):
        bench.supply.set_current(0.5)
    assert bench.coil.state.set_current_A == 0.0


def test_limits_of_a_delta_that_are_off_are_an_error(bench_of):
    bench = bench_of("delta-sm15k in process")
    answers = bench.line.receive
    question = b"SYSTEM:LIMITS:CURRENT?\n"
    bench.line.receive = lambda data: b"1.1000,OFF\n" if data == question else answers(data)
    with pytest.raises(SetPointNotTaken, match=r"was not switched on, as the answer to SYSTEM:LIMITS:CURRENT\?"):
        bench.energise()
    assert not bench.coil.state.output


def test_a_bit4886_keeps_its_output_on_and_limits_the_voltage_of_both_signs(bench_of):
    bench = bench_of("kepco-bit4886 in process")
    bench.energise(-0.7)
    assert bench.coil.state.set_voltage_V == 12.0
    bench.supply.safe_off()
    assert not [message for message in bench.sent if message.startswith(b"OUTP 0")]
    assert b"VOLT:PROT:POS 12.00\n" not in bench.sent


def test_a_genesys_asks_for_its_rating_once(bench_of):
    bench = bench_of("genesys in process")
    for _ in range(2):
        assert bench.supply.reads_zero_within_A == pytest.approx(0.003 * 50.0)  # 0.3 % of the rated 50 A
    assert sum(message.startswith(b"IDN?") for message in bench.sent) == 1


def test_a_genesys_is_addressed_again_after_it_did_not_answer():
    clock = SimulatedClock()
    coil = CoilSupply(clock)
    dialects = [GenesysDialect(coil), GenesysDialect(coil)]

    class Restarted:
        def receive(self, data: bytes) -> bytes:
            return dialects[0].receive(data)

    supply = SUPPLIES["genesys"](InProcessTransport(Restarted(), clock), LIMITS, clock)
    supply.set_current(0.5)
    del dialects[0]  # the supply is switched off and on
    with pytest.raises(InstrumentTimeout):
        supply.measure()
    supply.set_current(0.2)
    assert coil.state.set_current_A == 0.2


def test_a_genesys_is_switched_off_even_if_its_answers_are_lost(bench_of):
    bench = bench_of("genesys in process")
    bench.energise()
    answers = bench.line.receive
    bench.line.receive = lambda data: answers(data) and b""
    with pytest.raises(SwitchOffFailed, match="off: failed"):
        bench.supply.safe_off()
    assert not bench.coil.state.output


def test_a_genesys_names_its_faults(bench_of):
    bench = bench_of("genesys in process")
    bench.energise()
    bench.coil.trip()
    with pytest.raises(ProtectionTripped, match="over-voltage protection tripped"):
        bench.supply.check()


def test_an_error_that_a_genesys_answers_is_raised(bench_of):
    bench = bench_of("genesys in process")
    supply = bench.supply
    answers = bench.line.receive
    bench.line.receive = lambda data: b"C02\r" if data == b"MC?\r" else answers(data)
    with pytest.raises(InstrumentError, match=r"answers MC\? with error C02"):
        supply.measure()


@pytest.mark.parametrize(
    ("driver", "level_V"),
    [
        *((driver, 13.2) for driver in ("rigol-dp800", "rs-hmp", "keysight-e364x", "keysight-e3632a")),
        ("aim-tti", 13.2),
        *((driver, 13.2) for driver in ("keysight-e36312a", "keysight-n6700", "keysight-n6900", "keysight-rp7900")),
        *((driver, 13.2) for driver in ("keithley-2200", "keithley-2260b", "bk-xln", "owon-spe")),
        ("genesys", 13.53),  # the voltage limit plus 5.1 % of the rated 30 V
    ],
)
def test_over_voltage_protection_lies_above_the_limits_and_trips_beyond(bench_of, driver, level_V):
    bench = bench_of(f"{driver} in process")
    bench.energise()
    assert bench.coil.state.trip_voltage_V == pytest.approx(level_V)
    bench.coil.set_voltage(20.0)  # as a person does at the front panel
    bench.coil.set_current(4.0)
    bench.clock.sleep(1.0)
    with pytest.raises(ProtectionTripped):
        bench.supply.check()


LEVELS = {
    "keysight-e36312a": b"VOLT:PROT 13.20, (@1)\n",
    "keysight-n6700": b"VOLT:PROT 13.20, (@1)\n",
    "keysight-e3632a": b"CURR:PROT 1.100\n",
    "keysight-e364x": b"VOLT:PROT 13.20\n",
    "rigol-dp800": b":OUTP:OVP:VAL 13.20\n",
    "rs-hmp": b"VOLT:PROT:LEV 13.20\n",
    "kepco-bop": b"CURR:LIM:NEG 1.000\n",
    "aim-tti": b"OCP1 1.100\n",
    "keysight-n6900": b"VOLT:PROT 13.20\n",
    "keysight-rp7900": b"VOLT:PROT 13.20\n",
    "keithley-2200": b"VOLT:PROT 13.20\n",
    "keithley-2260b": b"VOLT:PROT 13.20\n",
    "delta-sm15k": b"SYSTEM:LIMITS:CURRENT 1.100,ON\n",
    "bk-xln": b"OISET 1.100\r\n",
    "owon-spe": b"CURR:LIM 1.100\n",
}
"""The message that sets the level of a protection, by family of supplies. Another test checks Genesys."""

SWITCHES = {
    "keysight-e3632a": b"CURR:PROT:STAT ON\n",
    "keysight-e364x": b"VOLT:PROT:STAT ON\n",
    "rigol-dp800": b":OUTP:OVP:STAT ON\n",
    "kepco-bop": b"VOLT:PROT:MODE FIX\n",
    "keithley-2200": b"VOLT:PROT:STAT 1\n",
    "bk-xln": b"OCP 1\r\n",
}
"""The message that switches a protection on, by family of supplies."""


def test_every_family_with_protections_is_tested():
    armed = {driver for driver in SUPPLIES if getattr(SUPPLIES[driver], "protections", "")}
    assert armed == {*LEVELS, "genesys"}


@pytest.mark.parametrize(("driver", "message"), [*LEVELS.items(), *SWITCHES.items()])
def test_a_protection_that_the_supply_does_not_take_is_an_error_and_the_output_stays_off(bench_of, driver, message):
    bench = bench_of(f"{driver} in process")
    if driver in {"keysight-e3632a", "keysight-e364x"} and message in SWITCHES.values():
        for word in (b"CURR", b"VOLT"):
            bench.line.receive(word + b":PROT:STAT OFF\n")  # the protection is on after power-up
            bench.line.receive(b"*CLS\n")
    bench.line.inject(Fault.SILENCE, lambda data: data == message)
    with pytest.raises(SetPointNotTaken, match=r"the (protections?|protection level|voltage limit) of the supply"):
        bench.energise()
    assert message not in bench.sent[-1:]
    assert bench.coil.coil_current_A() == 0.0


@pytest.mark.parametrize("answer", [b"31.0\r", b"12.0\r"])
def test_a_genesys_whose_protection_reads_back_wrong_stays_off(bench_of, answer):
    bench = bench_of("genesys in process")
    answers = bench.line.receive
    bench.line.receive = lambda data: answer if data == b"OVP?\r" else answers(data)
    with pytest.raises(SetPointNotTaken, match=r"protection level .* was set to 13\.53, but the answer to OVP\? is"):
        bench.energise()
    assert not bench.coil.state.output


def test_an_e3631a_counts_as_off_below_60_mA():
    coil = CoilSupply(SimulatedClock())
    supply = SUPPLIES["keysight-e3631a"](
        InProcessTransport(emulate("keysight-e3631a", coil), coil.clock), LIMITS, coil.clock
    )
    coil.offset_A = -0.055
    assert supply.safe_off().limit_A == 0.06


@pytest.mark.parametrize(
    ("driver", "address"), [("korad", "nowhere#2"), ("siglent-spd", "nowhere#3"), ("genesys", "nowhere#31")]
)
def test_a_channel_that_the_family_does_not_have_is_refused(driver, address):
    clock = SimulatedClock()
    with pytest.raises(InstrumentError, match=r"there is no channel .* has the channels . to "):
        SUPPLIES[driver](InProcessTransport(CoilSupply(clock), clock, address), LIMITS, clock)


@pytest.mark.parametrize("driver", [driver for driver in DIALECTS if len(set(SUPPLIES[driver].channels)) > 1])
def test_the_coil_may_be_on_any_channel(driver):
    for channel in SUPPLIES[driver].channels:
        address = f"in-process#{channel}"
        clock = SimulatedClock()
        coil = CoilSupply(clock)
        link = InProcessTransport(emulate(driver, coil, address), clock, address)
        supply = SUPPLIES[driver](link, LIMITS, clock)
        supply.set_voltage(12.0)
        supply.set_current(0.5)
        supply.set_output(True)
        clock.sleep(1.0)
        assert supply.output_on()
        assert supply.measure().current_A == pytest.approx(0.5, abs=1e-3)
        supply.check()
        supply.safe_off()
        assert not coil.state.output


@pytest.mark.parametrize("driver", [driver for driver in DIALECTS if len(set(SUPPLIES[driver].channels)) > 1])
def test_a_message_to_another_channel_does_not_reach_the_coil(driver):
    first, last = SUPPLIES[driver].channels
    clock = SimulatedClock()
    coil = CoilSupply(clock)
    link = InProcessTransport(emulate(driver, coil, f"#{first}"), clock, f"in-process#{last}")
    with pytest.raises(InstrumentError):
        SUPPLIES[driver](link, LIMITS, clock).set_current(0.5)
    assert coil.state.set_current_A == 0.0


def test_a_refused_channel_leaves_the_port_free(bench_of):
    port = bench_of("genesys on a pty")
    port.supply.close()
    with pytest.raises(InstrumentError, match="there is no channel 31"):
        open_supply("genesys", f"{port.address}#31", LIMITS)
    open_supply("genesys", f"{port.address}#6", LIMITS).close()


@pytest.mark.parametrize(("ovp_V", "set_V"), [(3.0, 1.0), (33.0, 28.0)])
def test_a_genesys_accepts_the_limits_with_any_earlier_level_of_its_protection(ovp_V, set_V):
    clock = SimulatedClock()
    coil = CoilSupply(clock)
    dialect = GenesysDialect(coil)
    link = InProcessTransport(dialect, clock)
    for message in ("ADR 6", "RMT REM", f"PV {set_V}", f"OVP {ovp_V}"):
        link.write(f"{message}\r".encode())
        assert link.read(16, 1.0, b"\r") == b"OK\r"
    link.write(b"PV 30\r")
    assert link.read(16, 1.0, b"\r") == (b"E01\r" if ovp_V == 3.0 else b"OK\r")
    supply = SUPPLIES["genesys"](link, LIMITS, clock)
    supply.set_voltage(12.0)
    supply.set_current(0.5)
    supply.set_output(True)
    assert dialect.ovp_V == pytest.approx(13.53)
    supply.safe_off()
    link.write(b"OVP 12.5\r")  # less than the voltage set-point plus 5 % of 30 V
    assert link.read(16, 1.0, b"\r") == b"E04\r"


def test_the_reason_of_a_refusal_by_a_genesys_is_in_the_message():
    clock = SimulatedClock()
    dialect = GenesysDialect(CoilSupply(clock))
    dialect.uvl_V = 13.0
    supply = SUPPLIES["genesys"](InProcessTransport(dialect, clock), LIMITS, clock)
    with pytest.raises(
        InstrumentError, match=r"PV 12\.00 with error E02: the voltage is below the under-voltage limit"
    ):
        supply.set_voltage(12.0)


def test_an_e364x_refuses_commands_for_over_current_protection():
    clock = SimulatedClock()
    link = InProcessTransport(emulate("keysight-e364x", CoilSupply(clock)), clock)
    link.write(b"CURR:PROT:STAT ON\n")
    with pytest.raises(InstrumentError, match="-113 Undefined header"):
        SUPPLIES["keysight-e364x"](link, LIMITS, clock).check()


@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
@pytest.mark.parametrize("driver", ["keysight-e3631a", "keysight-e3632a", "keysight-e364x"])
def test_a_supply_on_a_serial_line_is_moved_into_remote_mode(driver):
    coil = CoilSupply(WallClock())
    with serve_pty(FaultyInstrument(emulate(driver, coil))) as address:
        with serial.Serial(address, timeout=0.1) as port:
            port.write(b"*IDN?\n")
            assert port.read(100) == b""  # the query is lost, because the supply is still in local mode
        supply = open_supply(driver, address, LIMITS)
        supply.set_voltage(5.0)
        supply.set_current(0.5)
        supply.set_output(True)
        assert coil.state.output
        assert supply.safe_off().current_A < supply.limits.current_A
        assert not coil.state.output
        supply.close()


def test_a_guardian_on_a_reopened_serial_line_moves_the_supply_into_remote_mode_again():
    sent = []

    class SerialLine(InProcessTransport):
        lost = True

        def reopen(self):
            SerialLine.lost = False
            return True

        def write(self, message):
            if SerialLine.lost and message.startswith(b"OUTP"):
                raise InstrumentDisconnected("the line was lost")
            sent.append(message)
            super().write(message)

    coil = CoilSupply(SimulatedClock())
    line = SerialLine(emulate("keysight-e364x", coil), coil.clock, "/dev/ttyUSB0")
    supply = SUPPLIES["keysight-e364x"](line, LIMITS, coil.clock)
    supply.safe_off()
    assert sent[0] == b"SYST:REM\n"
    assert sent.count(b"SYST:REM\n") == 2


def test_a_supply_on_a_bus_gets_no_message_for_remote_mode():
    coil = CoilSupply(SimulatedClock())
    line = InProcessTransport(emulate("keysight-e3631a", coil), coil.clock, "GPIB0::5::INSTR")
    SUPPLIES["keysight-e3631a"](line, LIMITS, coil.clock).identify()
    assert line.sent == [b"*IDN?\n"]
