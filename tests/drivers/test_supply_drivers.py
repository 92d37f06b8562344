"""Supply drivers handle faulty connections and unexpected answers without a wrong current."""

from __future__ import annotations

import termios
from contextlib import suppress
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import DIALECTS, CoilSupply, open_in_process
from eimi_drivers.emulators.faults import Fault
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    Limits,
    ProtectionTripped,
    ReplyNotUnderstood,
    SetPointNotTaken,
    SetPointRefused,
    SwitchOffFailed,
)
from eimi_drivers.supplies import SUPPLIES, open_supply
from eimi_drivers.supplies.korad import MESSAGE_GAP_S, KoradSupply
from eimi_drivers.supplies.transport import InProcessTransport

LIMITS = Limits(current_A=1.0, voltage_V=12.0)


STAGES = {
    "korad": {"zero": (b"ISET1",), "off": (b"OUT0",), "verify": (b"STATUS?",)},
    "scpi": {"zero": (b"CURR",), "off": (b"OUTP 0",), "verify": (b"OUTP?",)},
    "keysight-e36312a": {"zero": (b"CURR",), "off": (b"OUTP 0",), "verify": (b"OUTP?",)},
    "keysight-e3632a": {"zero": (b"CURR ", b"CURR?"), "off": (b"OUTP 0",), "verify": (b"OUTP?",)},
    "keysight-e364x": {"zero": (b"CURR ", b"CURR?"), "off": (b"OUTP 0",), "verify": (b"OUTP?",)},
    "rigol-dp800": {"zero": (b":SOUR:CURR",), "off": (b":OUTP OFF",), "verify": (b":OUTP?",)},
    "siglent-spd": {"zero": (b"CH1:CURR",), "off": (b"OUTP CH1,OFF",), "verify": (b"SYST:STAT?",)},
    "rs-hmp": {"zero": (b"CURR",), "off": (b"OUTP OFF",), "verify": (b"OUTP?",)},
    "genesys": {"zero": (b"PC",), "off": (b"OUT OFF",), "verify": (b"OUT?",)},
    "aim-tti": {"zero": (b"I1 ", b"I1?"), "off": (b"OP1 0",), "verify": (b"OP1?",)},
    "keysight-n6900": {"zero": (b"CURR ", b"CURR?"), "off": (b"OUTP 0",), "verify": (b"OUTP?",)},
    "keithley-2260b": {"zero": (b"CURR ", b"CURR?"), "off": (b"OUTP 0",), "verify": (b"OUTP?",)},
    "delta-sm15k": {"zero": (b"SOURCE:CURRENT",), "off": (b"OUTPUT 0",), "verify": (b"OUTPUT?",)},
    "bk-xln": {"zero": (b"CURR ", b"CURR?"), "off": (b"OUT 0",), "verify": (b"STATUS?",)},
    "owon-spe": {"zero": (b"CURR ", b"CURR?"), "off": (b"OUTP OFF",), "verify": (b"OUTP?",)},
}
"""The first bytes of the messages in each stage of switching off, by driver.

`test_families` tests Kepco supplies, which are switched off by a current of zero.
"""


@pytest.fixture(params=STAGES)
def staged_bench(request, bench_of):
    return bench_of(f"{request.param} in process")


@pytest.mark.parametrize("stage", ["zero", "verify"])
def test_every_stage_of_switching_off_is_tried_when_another_fails(staged_bench, stage):
    staged_bench.energise()
    staged_bench.line.inject(Fault.SILENCE, lambda message: message.startswith(STAGES[staged_bench.supply.name][stage]))
    with pytest.raises(SwitchOffFailed) as caught:
        staged_bench.supply.safe_off()
    outcomes = str(caught.value)
    for each, words in (("zero", "current to zero"), ("off", "output off"), ("verify", "read back")):
        assert f"{words}: {'failed' if each == stage else 'done'}" in outcomes
    assert not staged_bench.coil.state.output
    assert staged_bench.coil.state.set_current_A == (0.7 if stage == "zero" else 0.0)


def test_a_lost_off_command_is_found_by_the_read_back(staged_bench):
    staged_bench.energise()
    staged_bench.line.inject(Fault.SILENCE, lambda message: message.startswith(STAGES[staged_bench.supply.name]["off"]))
    with pytest.raises(
        SwitchOffFailed, match=r"zero: done; output off: .*; read back: failed .*reports that the output is on"
    ):
        staged_bench.supply.safe_off()
    assert staged_bench.coil.state.set_current_A == 0.0
    staged_bench.line.inject(None)
    staged_bench.supply.safe_off()
    assert not staged_bench.coil.state.output


def test_a_supply_set_above_the_limits_is_switched_off():
    clock = SimulatedClock()
    coil = CoilSupply(clock)
    coil.set_voltage(20.0)
    coil.set_current(3.0)
    coil.switch(True)
    open_in_process("korad", coil, Limits(current_A=-1.0, voltage_V=-1.0)).safe_off()
    assert not coil.state.output


def test_an_output_that_does_not_switch_on_is_reported(staged_bench):
    on = {
        b"OUT1",
        b"OUTP 1",
        b"OUTP 1, (@1)",
        b":OUTP ON",
        b"OUTP CH1,ON",
        b"OUTP ON",
        b"OUT ON",
        b"OP1 1",
        b"OUTPUT 1",
        b"OUT 1",
    }
    staged_bench.line.inject(Fault.SILENCE, lambda message: message.strip() in on)
    with pytest.raises((SetPointNotTaken, InstrumentTimeout)) as caught:
        staged_bench.supply.set_output(True)
    if staged_bench.supply.name != "genesys":  # a Genesys answers commands, so that a lost message is a timeout
        assert "switched on, but the supply reports that the output is off" in str(caught.value)


@given(current_A=st.floats(0.0, 0.7))
@pytest.mark.parametrize("driver", sorted(DIALECTS))
def test_a_rounded_set_point_is_within_one_step_and_never_above_the_limit(driver, current_A):
    coil = CoilSupply(SimulatedClock())
    open_in_process(driver, coil, Limits(0.7, 12.0)).set_current(current_A)
    assert coil.state.set_current_A <= 0.7
    assert -1e-6 < current_A - coil.state.set_current_A < float(SUPPLIES[driver].current_step_A)
    if SUPPLIES[driver].bipolar:
        open_in_process(driver, coil, Limits(0.7, 12.0)).set_current(-current_A)
        assert coil.state.set_current_A >= -0.7
        assert -1e-6 < current_A + coil.state.set_current_A < float(SUPPLIES[driver].current_step_A)


def test_a_set_point_is_not_one_step_too_low_because_of_binary_fractions(quick_bench):
    quick_bench.supply.set_current(0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1 + 0.1)  # the sum is 0.7999999999999999
    assert quick_bench.coil.state.set_current_A == 0.8


class Babbler:
    # An emulated instrument that returns prepared answers, whatever the messages are.

    def __init__(self, answers: list[bytes]) -> None:
        self._answers = answers
        self._count = 0

    def receive(self, data: bytes) -> bytes:
        self._count += 1
        return self._answers[self._count % len(self._answers)]


ANSWERS = st.one_of(
    st.binary(max_size=12),
    st.binary(max_size=12).map(lambda answer: answer + b"\n"),
    st.sampled_from([b"nan\n", b"9.91E+37\n", b"1_0.0", b"-inf\n", b"0\n", b'0,"No error"\n', b"0.700", b"1e400\n"]),
)


@given(answers=st.lists(ANSWERS, min_size=1, max_size=4))
@settings(max_examples=200)
@pytest.mark.parametrize("driver", sorted(DIALECTS))
def test_any_answer_of_an_instrument_gives_a_value_or_an_instrument_error(driver, answers):
    clock = SimulatedClock()
    supply = SUPPLIES[driver](InProcessTransport(Babbler(answers), clock, "somewhere"), LIMITS, clock)
    for act in (
        supply.identify,
        supply.output_on,
        supply.check,
        lambda: supply.set_voltage(5.0),
        lambda: supply.set_current(0.5),
        lambda: supply.set_output(True),
        supply.safe_off,
    ):
        with suppress(InstrumentError):
            act()
    with suppress(InstrumentError):
        reading = supply.measure()
        assert abs(reading.current_A) < 1e30
        assert abs(reading.voltage_V) < 1e30


def test_an_error_queue_is_read_to_its_end_and_reported(scpi):
    scpi.line.receive(b"NONSENSE\nCURR 99\n")
    with pytest.raises(InstrumentError, match=r"-113 Undefined header; -222 Data out of range"):
        scpi.supply.check()
    scpi.supply.check()


def test_an_endless_error_queue_does_not_block_the_driver():
    clock = SimulatedClock()
    link = InProcessTransport(Babbler([b'-350,"Queue overflow"\n']), clock)
    with pytest.raises(InstrumentError, match="-350 Queue overflow"):
        SUPPLIES["scpi"](link, LIMITS, clock).check()


class SlowFirmware(KoradDialect):
    # An emulated supply that reports a new set current only after 0.45 s.

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        self._shown, self._changed_s = b"0.000K", -1.0

    def receive(self, data: bytes) -> bytes:
        if data.startswith(b"ISET1:"):
            self._changed_s = self.supply.clock.now()
        answer = super().receive(data)
        if data == b"ISET1?":
            if self.supply.clock.now() - self._changed_s < 0.45:
                return self._shown
            self._shown = answer
        return answer


def test_the_driver_waits_for_firmware_that_reads_back_late():
    clock = SimulatedClock()
    coil = CoilSupply(clock)
    supply = KoradSupply(InProcessTransport(SlowFirmware(coil), clock), LIMITS, clock)
    supply.set_current(0.7)
    assert clock.now() >= 0.45


def test_the_korad_driver_leaves_a_gap_without_which_messages_fuse():
    clock = SimulatedClock()
    coil = CoilSupply(clock)
    dialect = KoradDialect(coil, fuse_within_s=0.02)
    dialect.receive(b"ISET1:0.500")
    dialect.receive(b"VSET1:5.00")  # without a pause, both messages are lost
    assert (coil.state.set_current_A, coil.state.set_voltage_V) == (0.0, 0.0)
    clock.sleep(MESSAGE_GAP_S)
    KoradSupply(InProcessTransport(dialect, clock), LIMITS, clock).set_current(0.5)
    assert coil.state.set_current_A == 0.5
    clock.sleep(MESSAGE_GAP_S)
    dialect.receive(b"ISET1:0.100ISET1:0.200")  # two messages without a pause
    assert coil.state.set_current_A == 0.5


@pytest.mark.parametrize("bit", [0x20, 0x80])
@pytest.mark.parametrize("output", [False, True])
def test_a_korad_trip_is_recognised_by_either_bit(bit, output):
    clock = SimulatedClock()
    coil = CoilSupply(clock)
    supply = KoradSupply(InProcessTransport(KoradDialect(coil, protection_bit=bit), clock), LIMITS, clock)
    supply.set_output(True)
    supply.check()
    coil.trip()
    if output:  # the protection bit is set although the output bit is still set
        coil.state = replace(coil.state, output=True)
    with pytest.raises(ProtectionTripped, match="status byte"):
        supply.check()


def test_armed_over_current_protection_of_a_korad_is_switched_off_before_a_run(korad):
    korad.coil.arm(True)
    korad.energise()
    korad.supply.check()
    assert korad.coil.coil_current_A() == pytest.approx(0.7, abs=1e-4)


def test_the_sixth_byte_of_a_korad_does_not_shift_later_answers(korad):
    for current_A in (0.1, 0.2, 0.3):
        korad.supply.set_current(current_A)
        korad.supply.set_voltage(10 * current_A)


@pytest.mark.parametrize("reply", [b"00.25", b"0.25\n", b" .700", b"7e-01", b"0,700", b"+0.70", b"12.00"])
def test_amperes_in_another_form_than_a_korads_are_refused(korad, reply):
    answers = korad.line.receive
    korad.line.receive = lambda data: reply if data == b"ISET1?" else answers(data)
    with pytest.raises((ReplyNotUnderstood, SetPointNotTaken)):
        korad.supply.set_current(float(reply.replace(b",", b".")) if reply != b"12.00" else 0.7)


def test_one_false_read_back_does_not_confirm_a_set_point(korad):
    korad.energise(0.2)
    korad.coil.locked = True
    answers, spoilt = korad.line.receive, [b"0.600K"]  # 0.200 with one flipped bit
    korad.line.receive = lambda data: spoilt.pop() if data == b"ISET1?" and spoilt else answers(data)
    with pytest.raises(SetPointNotTaken, match=r"set to 0\.600 A but reads back 0\.2 A"):
        korad.supply.set_current(0.6)


@pytest.mark.parametrize("reply", [b"\x0b0.7\n", b"0.7\x0c\n", b"0.7\x0b\n", b"0.7 A\n", b"\xa00.7\n", b"0.\x007\n"])
def test_a_number_with_further_characters_is_refused(reply):
    clock = SimulatedClock()
    link = InProcessTransport(Babbler([reply]), clock, "somewhere")
    with pytest.raises(ReplyNotUnderstood, match=r"the answer to MEAS:CURR\? must be a number"):
        SUPPLIES["scpi"](link, LIMITS, clock).measure()


def test_an_output_state_that_is_neither_on_nor_off_is_refused():
    clock = SimulatedClock()
    link = InProcessTransport(Babbler([b"2\n"]), clock, "somewhere")
    with pytest.raises(ReplyNotUnderstood, match=r"somewhere: the answer to OUTP\? must be 0 or 1"):
        SUPPLIES["scpi"](link, LIMITS, clock).output_on()


def test_a_port_that_fails_while_it_is_opened_is_reported_as_disconnected(bench_of, monkeypatch):
    port = bench_of("korad on a pty")
    port.supply.close()

    def hang_up(descriptor, *arguments):
        raise termios.error(5, "Input/output error")

    monkeypatch.setattr(termios, "tcflush", hang_up)  # pyserial does not convert this error
    with pytest.raises(InstrumentDisconnected, match=f"{port.address}: .*Input/output error"):
        open_supply("korad", port.address, LIMITS)


@pytest.mark.parametrize("scheme", ["spy://", "ASRLspy://", "SPY://", "alt://", "hwgrep://"])
def test_a_url_that_may_write_a_file_is_refused(tmp_path, scheme):
    diary = tmp_path / "diary.txt"
    diary.write_text("Dear diary")
    with pytest.raises(InstrumentError, match="is not supported; give a port"):
        open_supply("korad", f"{scheme}/dev/null?file={diary}", LIMITS)
    assert diary.read_text() == "Dear diary"


def test_the_error_for_an_unknown_name_lists_the_drivers():
    with pytest.raises(InstrumentError, match=r"'keithley'.*genesys, .*kepco-bop, .*korad, .*scpi, siglent-spd"):
        open_supply("keithley", "/dev/null", LIMITS)


@pytest.mark.parametrize(
    ("driver", "address"),
    [
        ("korad", "/dev/no-such-port"),
        ("korad", "nonsense://"),
        ("scpi", "/dev/no-such-port"),
        ("scpi", "TCPIP::127.0.0.1::1::SOCKET"),
        ("scpi", "TCPIP::nonsense"),
        ("scpi", "GPIB0::3::INSTR"),
        ("genesys", "/dev/no-such-port#7"),
        ("rigol-dp800", "TCPIP::127.0.0.1::1::SOCKET#2"),
    ],
)
def test_an_address_that_cannot_be_opened_is_named(driver, address):
    with pytest.raises(InstrumentError) as caught:
        open_supply(driver, address, LIMITS)
    assert address in str(caught.value)
    assert caught.value.__cause__ is not None


@pytest.mark.parametrize("url", ["socket://127.0.0.1", "socket://127.0.0.1:99999", "socket://:5", "rfc2217://host:0"])
def test_a_url_without_host_and_port_is_refused_with_an_example(url: str) -> None:
    kind = url.partition("://")[0]
    with pytest.raises(
        InstrumentError,
        match=rf"^{url}: needs a host and a port from 1 to 65535, such as {kind}://192\.168\.0\.5:8000$",
    ):
        open_supply("korad", url, Limits(1.0, 12.0))


def test_a_set_point_just_above_its_limit_is_written_with_all_its_digits() -> None:
    supply = open_in_process("scpi", CoilSupply(SimulatedClock()), Limits(1.0, 12.0))
    with pytest.raises(SetPointRefused, match=r"current 1\.0000001 A was refused .* from 0 to 1 A$"):
        supply.set_current(1.0000001)
