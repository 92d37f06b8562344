"""Answers that instruments give seldom: each is refused in words that name the instrument, the query and the answer."""

from __future__ import annotations

import math
import re
import statistics
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from eimi_drivers.cameras.settings import NO_SETTINGS, settings_of
from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import emulate
from eimi_drivers.emulators.aim_tti import MX100TP, QL355TP, AimTtiDialect
from eimi_drivers.emulators.channel_selected import KeysightE3631ADialect, RigolDp800Dialect, RohdeSchwarzHmpDialect
from eimi_drivers.emulators.coil_line import RemoteCoil
from eimi_drivers.emulators.faults import Fault
from eimi_drivers.emulators.keithley import Keithley2260BDialect
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.emulators.owon import OwonSpeDialect
from eimi_drivers.emulators.scpi_families import KepcoBit4886Dialect, KepcoBopDialect, KeysightE36312ADialect
from eimi_drivers.emulators.sensors import EmulatedQuantity, SensorDialect, SensorFault, emulate_sensor
from eimi_drivers.emulators.session import EmulatedSession
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.emulators.xln import XlnDialect
from eimi_drivers.interfaces import (
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    Limits,
    Reading,
    ReplyNotUnderstood,
    SwitchOffFailed,
    UnusableDriver,
)
from eimi_drivers.sensors import SENSORS
from eimi_drivers.sensors.coil_thermometer import CoilThermometer
from eimi_drivers.serial_ports import attached_ports
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.logged import LoggedTransport
from eimi_drivers.supplies.transcript import RecordingTransport
from eimi_drivers.supplies.transport import InProcessTransport

LIMITS = Limits(1.6, 12.0)


def supply_with(driver: str, changed: dict[bytes, bytes]) -> tuple[Any, CoilSupply]:
    # Return a driver and its emulated supply, some of whose messages have other answers.
    coil = CoilSupply(SimulatedClock())
    line = emulate(driver, coil)
    answers = line.receive
    line.receive = lambda data: changed[data] if data in changed else answers(data)  # type: ignore[method-assign]
    return SUPPLIES[driver](InProcessTransport(line, coil.clock), LIMITS, coil.clock), coil


# Supplies


@pytest.mark.parametrize(
    ("message", "answer", "words"),
    [
        (b"STT?\r", b"MV(1)\r", r"the answer to STT\? must be a status that ends with FR\(00\), but it is b'MV\(1\)"),
        (b"FLD?\r", b"ON\r", r"the answer to FLD\? must be OFF, but it is b'ON"),
        (b"IDN?\r", b"LAMBDA,X\r", r"the answer to IDN\? must contain a model with a rating such as GEN40-38"),
        (b"FLD OFF\r", b"C05\r", "C05|out of range"),
    ],
)
def test_an_answer_of_a_genesys_that_is_not_understood_is_named(message: bytes, answer: bytes, words: str) -> None:
    supply, coil = supply_with("genesys", {message: answer})

    def begin() -> None:
        supply.set_voltage(10.0)
        supply.set_current(0.5)
        supply.set_output(True)
        supply.check()

    with pytest.raises(InstrumentError, match=words):
        begin()
    assert not coil.state.output or message == b"STT?\r"


ACCEPTED = {b"*IDN?", b"IDN?", b"SN?", b"MODEL?", b"VERSION?", b"STATUS?"}
"""Queries whose answer may be any text; the status of a Korad is any byte."""


@pytest.mark.parametrize("driver", [name for name in SUPPLIES if name != "virtual"])
def test_each_answer_that_is_garbled_is_named_with_its_query(driver: str) -> None:
    answers: dict[bytes, bytes] = {}

    def use(garbled: bytes) -> None:
        coil = CoilSupply(SimulatedClock())
        line = emulate(driver, coil)
        right = line.receive

        def receive(data: bytes) -> bytes:
            answer = right(data)
            if answer:
                answers.setdefault(data, answer)
            if data != garbled:
                return answer
            content = answer.rstrip(b"\r\n")
            return b"@#!".ljust(len(content), b"!") + answer[len(content) :]

        line.receive = receive  # type: ignore[method-assign]
        supply = SUPPLIES[driver](InProcessTransport(line, coil.clock), LIMITS, coil.clock)
        supply.identify()
        supply.set_voltage(10.0)
        supply.set_current(0.5)
        supply.set_output(True)
        assert supply.output_on()
        supply.measure()
        supply.check()

    use(b"")
    for query in tuple(answers):
        words = query.strip()
        if words in ACCEPTED and not (driver == "bk-xln" and words == b"STATUS?"):
            continue
        with pytest.raises(InstrumentError, match=re.escape(words.decode())) as caught:
            use(query)
        assert "@#!" in str(caught.value)


def test_a_korad_gets_a_message_each_0_08_s() -> None:
    # The supply ignores messages that follow too soon; the driver waits 80 ms after each message.
    coil = CoilSupply(SimulatedClock())
    link = InProcessTransport(KoradDialect(coil), coil.clock)
    supply = SUPPLIES["korad"](link, LIMITS, coil.clock)
    began_s = coil.clock.now()
    before = len(link.sent)
    supply.set_voltage(10.0)
    assert coil.clock.now() - began_s == pytest.approx(0.08 * (len(link.sent) - before))


def test_the_output_of_a_kepco_that_should_be_on_is_read_back() -> None:
    supply, _ = supply_with("kepco-bop", {b"OUTP?\n": b"0\n"})
    supply.set_voltage(10.0)
    with pytest.raises(InstrumentError, match="in-process"):
        supply.set_output(True)


@pytest.mark.parametrize("serial_number", ["", "17"])
def test_a_supply_without_a_serial_number_is_not_confirmed_after_a_lost_line(serial_number: str) -> None:
    supply, _ = supply_with("scpi", {b"*IDN?\n": f"EIMI,X,{serial_number or 0},1\n".encode()})
    supply.identify()
    if serial_number:
        supply._confirm_identity()
        assert not supply._unconfirmed
    else:
        with pytest.raises(SwitchOffFailed, match="was then switched off, but has no serial number"):
            supply._confirm_identity()
        assert supply._unconfirmed


# Sensors


class Line:
    # A line on which each query has a prepared answer; the rest of an answer is lost with the next query.

    address = "COM7"

    def __init__(self, **answers: bytes) -> None:
        self.answers = {name.replace("_", " "): answer for name, answer in answers.items()}
        self.sent: list[bytes] = []
        self.reopens = True

    def write(self, message: bytes) -> None:
        self.sent.append(message)

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        question = self.sent[-1].decode().strip().rstrip("?").lstrip(":*").replace(":", " ")
        return self.answers[question]

    def reopen(self) -> bool:
        return self.reopens

    def close(self) -> None:
        self.sent.append(b"closed")


@pytest.mark.parametrize(
    ("driver", "answers", "words"),
    [
        ("lakeshore-425", {"UNIT": b"9\n"}, r"^COM7: the answer to UNIT\? must be one of 1, 2, 3, 4, but it is '9'$"),
        ("lakeshore-425", {"UNIT": b"1"}, r"the answer to UNIT\? must be a line that ends, but it is b'1'"),
        ("lakeshore-425", {"UNIT": b"\xff\n"}, r"the answer to UNIT\? must be a line of text, but it is b'\\xff"),
        (
            "lakeshore-425",
            {"UNIT": b"1\n", "RDGFIELD": b"nan\n"},
            r"RDGFIELD\? must be a number such as \+123\.450E-03",
        ),
        (
            "fwbell-5080",
            {"MEASure_FLUX": b"12.3\n"},
            "must be a field in gauss or tesla such as 12.34G, but it is '12.3'",
        ),
        ("text-line", {"READ": b"1\n"}, "must be value, unit and standard uncertainty"),
        ("text-line", {"READ": b"1 mT 2 3\n"}, "must be value, unit and standard uncertainty"),
        ("text-line", {"READ": b"1 5 2\n"}, "must be value, unit and standard uncertainty"),
        ("text-line", {"READ": b"1 mT -0.1\n"}, "must be a standard uncertainty of 0 or above"),
        ("text-line", {"READ": b"x mT\n"}, r"must be a number such as 1\.2345"),
    ],
)
def test_an_answer_of_a_sensor_that_is_not_understood_is_named(
    driver: str, answers: dict[str, bytes], words: str
) -> None:
    with pytest.raises(ReplyNotUnderstood, match=words):
        SENSORS[driver](Line(**answers), SimulatedClock()).read()  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("driver", "answers", "value"),
    [
        ("lakeshore-425", {"UNIT": b"1\r\n", "RDGFIELD": b"+2.5E+01\r\n"}, 2.5),
        ("lakeshore-475", {"UNIT": b"2\n", "RDGFIELD": b"-1E-03\n"}, -1.0),
        ("lakeshore-425", {"UNIT": b"3\n", "RDGFIELD": b"10\n"}, 1.0),
        ("lakeshore-425", {"UNIT": b"4\n", "RDGFIELD": b"1000\n"}, 4e-1 * math.pi),
        ("fwbell-5080", {"MEASure_FLUX": b"25G;\n"}, 2.5),
        ("fwbell-5080", {"MEASure_FLUX": b"-0.001T;\n"}, -1.0),
        ("text-line", {"READ": b"1.5 mT\n"}, 1.5),
    ],
)
def test_the_field_is_converted_to_mT(driver: str, answers: dict[str, bytes], value: float) -> None:
    # 1 G and 1 Oe are 0.1 mT, 1 T is 1000 mT, and 1 A/m in air is 4 pi 1e-4 mT.
    clock = SimulatedClock(5.0)
    reading = SENSORS[driver](Line(**answers), clock).read()  # type: ignore[call-arg]
    assert (reading.value, reading.unit, reading.time_s) == (pytest.approx(value), "mT", 5.0)
    assert reading.standard_uncertainty is None


@pytest.mark.parametrize("answer", [b"\n", b"a\x07b\n"])
def test_an_identity_is_a_line_of_text(answer: bytes) -> None:
    with pytest.raises(ReplyNotUnderstood, match=r"the answer to \*IDN\? must be a line of text"):
        SENSORS["lakeshore-425"](Line(IDN=answer), SimulatedClock()).identify()  # type: ignore[call-arg]


def test_a_board_may_be_silent_twice_while_it_starts() -> None:
    class Starting(Line):
        silent, answered = 2, 0

        def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
            if self.silent or self.answered == len(self.sent):
                self.silent = max(self.silent - 1, 0)
                raise InstrumentTimeout("COM7: no answer")
            self.answered = len(self.sent)
            return super().read(size, timeout_s, end)

    line = Starting(IDN=b"lab,board,12,1.0\n")
    board = SENSORS["text-line"](line, SimulatedClock())  # type: ignore[call-arg]
    assert board.identify() == Identity("text-line", "lab,board,12,1.0", "COM7", "12")
    assert len(line.sent) == 3
    line.silent = 1
    with pytest.raises(InstrumentError, match="no answer"):
        board.identify()  # it has started already


# The coil as thermometer


def thermometer(*readings: tuple[float, float]) -> tuple[CoilThermometer, SimulatedClock]:
    # Return a thermometer of a coil, whose supply measures the given voltages (V) and currents (A).
    clock = SimulatedClock()
    measured = iter(readings)
    coil = CoilThermometer(lambda: Reading(*reversed(next(measured))), clock, at_rest_degC=20.0, at_rest_A=0.5)
    return coil, clock


def test_the_resistance_at_rest_is_a_mean_of_spaced_readings() -> None:
    from eimi_drivers.sensors import coil_thermometer as module

    count = module.READINGS_AT_REST
    coil, clock = thermometer(*[(2.0, 0.5)] * count, (2.0 * 1.0393, 0.5), (9.9, 0.01))
    asked: list[float] = []
    coil.measure_at_rest(lambda: asked.append(clock.now()))
    spaces = [later - earlier for earlier, later in pairwise(asked)]
    assert len(asked) == count
    assert spaces == pytest.approx([spaces[0]] * (count - 1))
    assert spaces[0] > 0.0
    assert clock.now() == pytest.approx(count * spaces[0])
    warm = coil.read()
    assert warm.value == pytest.approx(30.0)  # 3.93 % more resistance are 10 K for copper
    assert warm.standard_uncertainty is not None
    assert coil.read() is warm  # the current is too small
    assert coil.identify().text == "copper coil, 20 °C at rest"


def test_a_coil_is_a_thermometer_from_a_fifth_of_its_current_at_rest_upwards() -> None:
    coil, _ = thermometer(*[(2.0, 0.5)] * 10, (0.4 * 1.0393, 0.0999), (0.4 * 1.0393, 0.1), (-0.4 * 1.0786, -0.1))
    coil.measure_at_rest(lambda: None)
    assert [coil.read().value for _ in range(3)] == pytest.approx([20.0, 30.0, 40.0])


@pytest.mark.parametrize(("voltage_V", "current_A"), [(0.0, 0.5), (2.0, 0.0), (-2.0, 0.5)])
def test_a_resistance_that_is_not_positive_is_refused(voltage_V: float, current_A: float) -> None:
    coil, _ = thermometer(*[(voltage_V, current_A)] * 50)
    with pytest.raises(
        InstrumentError, match=rf"^supply: the measured {voltage_V:g} V and {current_A:g} A give no pos"
    ):
        coil.measure_at_rest(lambda: None)


# Emulators


def talk(dialect: Any, *messages: str, end: str = "\n") -> list[str]:
    return [dialect.receive((message + end).encode()).decode().strip() for message in messages]


def test_a_kepco_refuses_negative_limits_and_limits_above_its_rating() -> None:
    coil = CoilSupply(SimulatedClock())
    bit, bop = KepcoBit4886Dialect(coil), KepcoBopDialect(coil)
    assert bit.commands["CURR"]("0")  # in voltage mode, CURR is the largest current
    assert not bit.commands["CURR"]("-0.001")
    for side in ("POS", "NEG"):
        limit, bound = bop.commands[f"CURR:LIM:{side}"], bop.commands[f"VOLT:PROT:{side}"]
        assert limit("0")
        assert limit(str(coil.max_current_A))
        assert not limit("-0.001")
        assert not limit(str(coil.max_current_A + 0.001))
        assert bound("0")
        assert not bound("-0.001")


def coil_at(**options: Any) -> CoilSupply:
    return CoilSupply(SimulatedClock(), **options)


def test_noise_of_current_and_voltage_have_their_own_sizes() -> None:
    coil = coil_at(current_noise_A=0.01, voltage_noise_V=0.5, seed=3)
    readings = [coil.read() for _ in range(400)]
    assert statistics.stdev(reading.current_A for reading in readings) == pytest.approx(0.01, rel=0.1)
    assert statistics.stdev(reading.voltage_V for reading in readings) == pytest.approx(0.5, rel=0.1)


def test_an_owon_has_no_error_queue_and_reports_its_state() -> None:
    owon = OwonSpeDialect(coil_at())
    assert talk(owon, "SYST:ERR?", "NONSENSE", "VOLT 99", "VOLT:LIM?", "CURR:LIM?") == [
        "ERR",
        "ERR",
        "ERR",
        "31.000",
        "5.100",
    ]
    assert talk(owon, "MEAS:ALL:INFO?") == ["0.000,0.000,0.000,OFF,OFF,OFF,0"]
    talk(owon, "VOLT 12", "CURR 1.5", "OUTP ON")
    owon.supply.clock.sleep(10.0)
    assert talk(owon, "MEAS:ALL:INFO?", "OUTP?") == ["6.000,1.500,9.000,OFF,OFF,OFF,2", "ON"]
    talk(owon, "VOLT 2")
    owon.supply.clock.sleep(10.0)
    assert talk(owon, "MEAS:ALL:INFO?") == ["2.000,0.500,1.000,OFF,OFF,OFF,1"]
    talk(owon, "VOLT 12", "VOLT:LIM 5")
    assert talk(owon, "OUTP?") == ["OFF"]
    owon.supply.clock.sleep(10.0)
    assert talk(owon, "OUTP?", "MEAS:ALL:INFO?") == ["OFF", "0.000,0.000,0.000,ON,OFF,OFF,3"]


def test_an_xln_ignores_what_it_does_not_understand() -> None:
    xln = XlnDialect(coil_at())
    assert talk(xln, "VOLT x", "NONSENSE 3", "MODEL?", "VSET 12", "VOLT?", "OVSET?", "OISET?") == [
        *("", "", "XLN3640", "", "12.000", "33.00", "5.500")
    ]
    assert talk(xln, "STATUS?", "OVP 1", "OCP 1", "OUT 1", "STATUS?", "OUT 0", "STATUS?") == [
        *("000000", "", "", "", "0000C4", "", "0000C0")
    ]


def test_a_kepco_answers_the_set_point_of_voltage_mode_and_keeps_its_limits() -> None:
    kepco = KepcoBopDialect(coil_at())
    assert talk(kepco, "VOLT?", "FUNC:MODE?", "CURR 1", "SYST:ERR?") == [
        "0.000E+00",
        "0",
        "",
        '-221,"Settings conflict"',
    ]
    assert talk(kepco, "FUNC:MODE CURR", "CURR:LIM:POS 2", "CURR 2.1", "SYST:ERR?", "CURR -2.1", "CURR?") == [
        *("", "", "", '-222,"Data out of range"', "", "-2.100000E+00")
    ]
    assert talk(
        kepco,
        "VOLT:PROT:POS 9",
        "VOLT:PROT:POS?",
        "VOLT:PROT:NEG?",
        "VOLT:PROT:MODE?",
        "VOLT:PROT:MODE FIX",
        "VOLT:PROT:MODE?",
    ) == [*("", "9.000E+00", "3.000E+01", "EXT", "", "FIX")]
    assert (
        talk(kepco, "FUNC:MODE X", "SYST:ERR?", "VOLT:PROT:MODE X", "SYST:ERR?") == ["", '-104,"Data type error"'] * 2
    )


def test_channels_that_do_not_exist_are_refused() -> None:
    hmp = RohdeSchwarzHmpDialect(coil_at(), 1)
    assert talk(hmp, "INST:NSEL?", "INST:NSEL 9", "SYST:ERR?", "INST:NSEL 1", "INST?") == [
        *("2", "", '-222,"Data out of range"', "", "OUTP1")
    ]
    assert talk(hmp, "VOLT:STEP?", "CURR:STEP?", "ARB:REP?", "OUTP:SEL?", "OUTP:GEN?") == [
        "1.000",
        "0.1000",
        "0",
        "0",
        "0",
    ]
    assert talk(hmp, "OUTP:SEL 1", "OUTP?", "OUTP:GEN 1", "OUTP?", "OUTP:GEN?") == ["", "0", "", "1", "1"]
    rigol = RigolDp800Dialect(coil_at(), 2)
    assert talk(rigol, "APPL CH2,12,1.5", "APPL?", "OUTP CH2,ON", "OUTP? CH2", "OUTP:MODE? CH2") == [
        *("", "CH2,12.000,1.5000", "", "ON", "CC")
    ]
    assert talk(rigol, "OUTP? CH1", "SYST:ERR?", "INST:NSEL?") == ["", '-241,"Hardware missing"', "2"]
    tracked = KeysightE3631ADialect(coil_at(), 2)
    assert talk(tracked, "OUTP:TRAC ON", "OUTP:TRAC?", "INST N25V", "VOLT -7", "INST P25V", "VOLT?") == [
        *("", "1", "", "", "", "7.000000E+00")
    ]
    assert talk(tracked, "INST N25V", "VOLT 7", "SYST:ERR?", "*RST", "OUTP:TRAC?") == [
        "",
        "",
        '-222,"Data out of range"',
        "",
        "0",
    ]
    e36312a = KeysightE36312ADialect(coil_at(), 1)
    assert talk(e36312a, "VOLT 5", "SYST:ERR?", "VOLT 5,(@1)", "VOLT? (@1)") == [
        "",
        '-109,"Missing parameter"',
        "",
        "5.000000E+00",
    ]


def test_a_2260b_refuses_protections_below_a_tenth_of_its_rating() -> None:
    supply = Keithley2260BDialect(coil_at())
    assert talk(supply, "VOLT:PROT 2.9", "SYST:ERR?", "VOLT:PROT 3", "VOLT:PROT?", "CURR:PROT 7.1", "SYST:ERR?") == [
        *("", '-222,"Data out of range"', "", "+3.000", "", '-222,"Data out of range"')
    ]
    assert talk(supply, "APPL 2.5,1.5", "APPL?", "STAT:QUES:COND?") == ["", "+2.5000, +1.5000", "+0"]


def test_limits_and_ranges_of_an_aim_tti() -> None:
    # The status register LSR1 has the bits 1 (constant voltage), 2 (constant current), 4 and 8 (trips).
    supply = AimTtiDialect(coil_at(), 1, MX100TP)
    assert talk(
        supply, "LSR1?", "*ESR?", "*ESR?", "VRANGE1?", "V1 17", "EER?", "VRANGE1 2", "VRANGE1?", "V1 17", "V1?"
    ) == [*("0", "128", "0", "1", "", "100", "", "2", "", "V1 17.000")]
    assert talk(supply, "I1 3.1", "EER?", "I1 1", "OP1 1", "LSR1?", "LSR1?", "VRANGE1 1", "EER?") == [
        *("", "100", "", "", "2", "2", "", "104")
    ]
    supply.supply.clock.sleep(10.0)
    talk(supply, "OVP1 3")  # 1 A in 4 ohm need 4 V
    assert talk(supply, "OP1?", "LSR1?", "LSR1?") == ["0", "6", "0"]
    other = AimTtiDialect(coil_at(), 1, QL355TP)
    assert talk(other, "RANGE1?", "RANGE1 3", "EER?", "RANGE1 1", "RANGE1?") == ["R1 0", "", "120", "", "R1 1"]


def test_sensors_without_a_query_have_no_answer() -> None:
    board = emulate_sensor("text-line", EmulatedQuantity(SimulatedClock(), lambda: 1.5, "mT"))
    assert board.receive(b"WHAT?\nREAD?\n*IDN?\n") == b"1.50000 mT 0.00000\r\neimi-lab,hall-board,1,1.0\r\n"
    bell = emulate_sensor("fwbell-5080", EmulatedQuantity(SimulatedClock(), lambda: 1.5))
    assert bell.receive(b":MEASURE:FLUX?\n:UNIT:FLUX:DC:TESLA\n:MEAS:FLUX?\n:UNIT:FLUX?\n:UNIT:FLUX:DC:X\n") == (
        b"15G;\r\n0.0015T;\r\nDC TESLA;\r\n"
    )
    lake = emulate_sensor("lakeshore-475", EmulatedQuantity(SimulatedClock(), lambda: 1.5))
    assert lake.receive(b"UNIT?\nRDGFIELD?\nUNIT 2\nRDGFIELD?\nRANGE 3\nRANGE?\nRDGMODE?\nUNIT 7\nUNIT?\n") == (
        b"1\r\n+1.50000E+01\r\n+1.50000E-03\r\n3\r\n1,0,1\r\n2\r\n"
    )
    with pytest.raises(InstrumentError, match=r"there is no emulated sensor 'lakeshore'; the names are: lakeshore-425"):
        emulate_sensor("lakeshore", EmulatedQuantity(SimulatedClock(), lambda: 1.5))
    with pytest.raises(InstrumentError, match=r"SensorDialect has no method that answers READ\?"):
        SensorDialect(EmulatedQuantity(SimulatedClock(), lambda: 1.5)).receive(b"READ?\n")


def test_the_faults_of_a_sensor() -> None:
    values = iter([1.0, 2.0, 3.0])
    quantity = EmulatedQuantity(SimulatedClock(), lambda: next(values))
    assert quantity.read() == 1.0
    quantity.fault = SensorFault.STUCK
    assert [quantity.read(), quantity.read()] == [1.0, 1.0]
    quantity.fault = SensorFault.JUMP
    assert quantity.read() == 200.0
    quantity.fault = None
    assert quantity.read() == 3.0
    for fault in (*SensorFault, *Fault):
        assert " " in fault.effect
        assert " " in fault.correct
        assert fault.word == fault.word.lower()


def test_a_session_says_its_addresses() -> None:
    said: list[str] = []
    session = EmulatedSession("korad", None, None, 0.0, said.append, coil=coil_at())
    session._say_addresses("/dev/pts/3", "TCPIP::127.0.0.1::7::SOCKET")
    assert said == [
        'driver = "korad"\naddress = "/dev/pts/3"',
        '# for a virtual beam in its coil: camera = { driver = "virtual", source = "TCPIP::127.0.0.1::7::SOCKET" }',
        "# for an emulated gaussmeter in its coil: eimi emulate lakeshore-425 --coil TCPIP::127.0.0.1::7::SOCKET",
    ]


# Lines, records and the computer


def test_the_end_of_a_far_coil_is_an_interruption_with_its_address() -> None:
    coil = RemoteCoil.__new__(RemoteCoil)
    coil._address = "TCPIP::lab::7::SOCKET"
    coil._line = type("Ended", (), {"sendall": lambda self, data: None, "recv": lambda self, size: b""})()
    with pytest.raises(
        InstrumentDisconnected, match=r"^TCPIP::lab::7::SOCKET: the program with the emulated coil has ended$"
    ):
        coil.coil_current_A()

    def cut(self: object, data: bytes) -> None:
        raise ConnectionResetError("reset")

    coil._line = type("Cut", (), {"sendall": cut})()
    with pytest.raises(InstrumentDisconnected, match=r"has ended \(reset\)$"):
        coil.coil_current_A()


class Broken(Line):
    def write(self, message: bytes) -> None:
        raise InstrumentDisconnected("COM7: cut")

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        raise InstrumentDisconnected("COM7: cut")


def test_faults_of_a_line_are_recorded_and_raised(tmp_path: Path) -> None:
    clock = SimulatedClock()
    record = RecordingTransport(Broken(), tmp_path / "record.txt", clock)
    for act in (lambda: record.write(b"x\n"), lambda: record.read(1, 1.0)):
        with pytest.raises(InstrumentDisconnected):
            act()
    clock.sleep(1.5)
    assert record.reopen() is True
    record.close()
    lines = (tmp_path / "record.txt").read_text().splitlines()
    assert [line.split(" ", 1)[1] for line in lines if not line.startswith("#")] == [
        "open COM7",
        "> x\\n",
        ">! InstrumentDisconnected COM7: cut",
        "<! InstrumentDisconnected COM7: cut",
        "open COM7",
    ]
    assert lines[-1].startswith("1.500000 ")


def test_the_summary_of_a_line_counts_messages_answers_and_faults(caplog: pytest.LogCaptureFixture) -> None:
    class Slow(Line):
        def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
            clock.sleep(0.25 if len(self.sent) == 1 else 0.1)
            return b"1"

    clock = SimulatedClock()
    caplog.set_level("DEBUG", "eimi_drivers.supplies.logged")
    link = LoggedTransport(Slow(), clock)
    for _ in range(2):
        link.write(b"A?")
        assert link.read(1, 1.0) == b"1"
    assert link.reopen() is True
    link.close()
    assert caplog.messages[-1] == (
        "COM7: 2 messages, 2 answers, the slowest answer after 0.250 s; 0 faults, the line was reopened 1 times"
    )
    assert "COM7 > b'A?'" in caplog.messages
    assert "COM7 < b'1'" in caplog.messages
    broken = LoggedTransport(Broken(), clock)
    for act in (lambda: broken.write(b"x"), lambda: broken.read(1, 1.0)):
        with pytest.raises(InstrumentDisconnected):
            act()
    broken.close()
    assert "; 2 faults," in caplog.messages[-1]
    assert "COM7: InstrumentDisconnected: COM7: cut" in caplog.messages


def test_settings_of_another_type_are_refused() -> None:
    assert settings_of(object()) is NO_SETTINGS
    with pytest.raises(UnusableDriver, match="the attribute settings of a camera should be a CameraSettings, not 3"):
        settings_of(type("Camera", (), {"settings": 3})())


def test_a_system_without_a_list_of_ports_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial.tools", None)
    with pytest.raises(OSError, match="this operating system does not list its serial ports"):
        attached_ports()
