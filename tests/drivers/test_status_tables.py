"""The drivers interpret error numbers, tripped protections and status bits as the manuals describe."""

from __future__ import annotations

from typing import Any

import pytest

from eimi_drivers.emulators.aim_tti import CPX400DP, MX100TP, QL355TP, QPX1200SP, AimTtiDialect
from eimi_drivers.emulators.serve import DIALECTS
from eimi_drivers.interfaces import InstrumentError, ProtectionTripped, SetPointNotTaken
from eimi_drivers.supplies import SUPPLIES, aim_tti, genesys, owon, xln
from eimi_drivers.supplies.scpi_profiles import PROFILES
from eimi_drivers.testing import supply_bench

GENESYS_TRIPS = {  # user manual 83-507-013, fault register
    0x02: "mains",
    0x04: "hot",
    0x08: "foldback",
    0x10: "over-voltage",
    0x20: "shut off at its rear connector",
    0x80: "enable contact",
}
GENESYS_REFUSALS = {  # tables 7-1 and 7-2
    "E01": "above the range",
    "E02": "below the under-voltage limit",
    "E04": "over-voltage protection is below",
    "E06": "under-voltage limit is above",
    "E07": "during a fault",
    "C01": "does not know",
    "C02": "missing",
    "C03": "parameter is wrong",
    "C04": "checksum",
    "C05": "out of range",
}
SCPI_TRIPS = {
    "keysight-n6700": {  # Operating and Service Guide, page 309
        1: "over-voltage",
        2: "over-current",
        4: "mains",
        16: "hot",
        64: "negative over-voltage",
        512: "inhibited",
        2048: "watchdog",
        4096: "oscillation",
    },
    "keithley-2260b": {  # GW Instek PSU manual, page 107
        1: "over-voltage",
        2: "over-current",
        8: "power switch",
        16: "hot",
        2048: "shut off",
    },
}
_N6900 = {  # Operating and Service Guide, page 286
    **{1: "over-voltage", 2: "over-current", 4: "mains", 8: "positive power", 16: "hot", 32: "negative power"},
    **{64: "reversed", 512: "inhibited", 2048: "watchdog", 4096: "dynamics"},
}
N6900_TRIPS = {
    ("keysight-n6900", 0): _N6900,
    ("keysight-n6900", 1): {1: "user", 8: "sharing"},  # page 287
    ("keysight-rp7900", 0): _N6900,  # page 241
    ("keysight-rp7900", 1): {8: "sharing", 16: "group", 32: "safety", 64: "under-voltage"},  # page 242
}
REGISTERS = {(driver, 0): rows for driver, rows in SCPI_TRIPS.items()} | N6900_TRIPS
"""The trips of each register, by the driver and the index of the register in the profile."""

NO_TRIPS = {
    ("keysight-n6700", 0): (8, 32, 128, 256, 1024, 8192),
    ("keithley-2260b", 0): (4, 256, 512, 4096),
    ("keysight-n6900", 0): (128, 256, 1024, 8192),
    ("keysight-n6900", 1): (2, 4),
    ("keysight-rp7900", 0): (128, 256, 1024),
    ("keysight-rp7900", 1): (2, 4),
}
"""Bits of the registers in `REGISTERS` that report no trip but, for example, constant current."""

TTI_MODELS = {"QL": QL355TP, "MX": MX100TP, "QPX": QPX1200SP, "CPX": CPX400DP}
TTI_TRIPS = {
    "QL": {4: "over-voltage", 8: "over-current", 16: "hot", 32: "sense", 128: "auxiliary"},  # XDL series II, page 33
    "MX": {4: "over-voltage", 8: "over-current", 64: "mains"},
    "QPX": {8: "over-voltage", 16: "over-current", 32: "sense", 64: "mains"},  # QPX600D, page 30
    "CPX": {4: "over-voltage", 8: "over-current", 64: "mains"},
}
TTI_NO_TRIPS = {"QL": (1, 2, 64), "MX": (1, 2), "QPX": (1, 2, 4), "CPX": (1, 2, 16)}
"""Bits that do not report a trip: constant voltage, constant current, and the limit of the power."""

_TTI_ERRORS = {
    100: "outside the permitted range",
    101: "damaged",
    102: "no settings",
    103: "not valid in the present state",
    104: "not valid while the output is on",
    200: "lock",
}
TTI_ERRORS = {
    "QL": {
        **{116: "no settings", 117: "damaged", 120: "too large or too small"},
        **{123: "cannot be recalled", 124: "range cannot be changed", 200: "lock"},
    },
    **{series: _TTI_ERRORS for series in ("MX", "QPX", "CPX")},
}
TTI_EVENTS = {0x20: "did not understand", 0x08: "within 5 s", 0x04: "was not read"}


def test_every_row_has_a_case() -> None:
    assert set(genesys.FAULTS) == set(GENESYS_TRIPS)
    assert set(genesys.REFUSALS) == set(GENESYS_REFUSALS)
    assert {
        (profile.driver, place): {bit for bit, _ in register.trips}
        for profile in PROFILES
        for place, register in enumerate(profile.registers)
    } == {key: set(rows) for key, rows in REGISTERS.items()}
    assert set(NO_TRIPS) == set(REGISTERS)
    assert {series: set(rows.trips) for series, rows in aim_tti.SERIES.items()} == {
        series: set(rows) for series, rows in TTI_TRIPS.items()
    }
    assert {series: set(rows.errors) for series, rows in aim_tti.SERIES.items()} == {
        series: set(rows) for series, rows in TTI_ERRORS.items()
    }
    assert set(aim_tti.EVENTS) == set(TTI_EVENTS)
    assert set(xln.TRIPS) == set(XLN_TRIPS)
    assert set(owon.TRIPS) == set(OWON_TRIPS)


def answering(bench: Any, question: bytes, answer: bytes) -> None:
    # Replace the emulated instrument's answer to one query.
    usual = bench.line.receive
    bench.line.receive = lambda data: answer if data == question else usual(data)


@pytest.mark.parametrize(("bit", "words"), GENESYS_TRIPS.items())
def test_every_fault_of_a_genesys_is_a_trip(bench_of: Any, bit: int, words: str) -> None:
    bench = bench_of("genesys in process")
    bench.energise()
    answering(bench, b"STT?\r", b"MV(2.8),PV(12.0),MC(0.7),PC(0.7),SR(02),FR(%02X)\r" % bit)
    with pytest.raises(ProtectionTripped, match=words):
        bench.supply.check()


@pytest.mark.parametrize(("code", "words"), GENESYS_REFUSALS.items())
def test_every_refusal_of_a_genesys_is_an_error_in_words(bench_of: Any, code: str, words: str) -> None:
    bench = bench_of("genesys in process")
    bench.supply.measure()
    answering(bench, b"PC 0.50\r", code.encode() + b"\r")
    with pytest.raises(InstrumentError, match=f"error {code}: .*{words}"):
        bench.supply.set_current(0.5)


def question_of(register: tuple[str, int]) -> bytes:
    # Return the message with which a driver asks for a status register.
    # register : name of the driver, and index of the register in its list
    driver, place = register
    (profile,) = (p for p in PROFILES if p.driver == driver)
    return profile.registers[place].question.format(channel=1).encode() + b"\n"


@pytest.mark.parametrize(("register", "bit"), [(key, bit) for key, rows in REGISTERS.items() for bit in rows])
def test_every_trip_bit_of_a_status_register_is_a_trip(bench_of: Any, register: tuple[str, int], bit: int) -> None:
    bench = bench_of(f"{register[0]} in process")
    bench.energise()
    answering(bench, question_of(register), b"%d\n" % (bit + NO_TRIPS[register][0]))
    with pytest.raises(ProtectionTripped, match=REGISTERS[register][bit]):
        bench.supply.check()


@pytest.mark.parametrize(("register", "bit"), [(key, bit) for key, bits in NO_TRIPS.items() for bit in bits])
def test_the_other_bits_of_a_status_register_are_no_trips(bench_of: Any, register: tuple[str, int], bit: int) -> None:
    bench = bench_of(f"{register[0]} in process")
    bench.energise()
    answering(bench, question_of(register), b"%d\n" % bit)
    bench.supply.check()


XLN_TRIPS = {  # user manual, page 74, byte 1
    0x8000: "over-voltage",
    0x4000: "over-current",
    0x2000: "over-power",
    0x1000: "from constant current",
    0x0800: "from constant voltage",
    0x0400: "mains",
    0x0200: "hot",
}
XLN_NO_TRIPS = (0x0100, 0x0080, 0x0040, 0x0020, 0x0010, 0x0008, 0x0002, 0x0001, 0x010000)


@pytest.mark.parametrize(("bit", "words"), XLN_TRIPS.items())
def test_every_flag_of_an_xln_is_a_trip(bench_of: Any, bit: int, words: str) -> None:
    bench = bench_of("bk-xln in process")
    bench.energise()
    answering(bench, b"STATUS?\r\n", b"%06X\r\n" % (bit | 0xC4))
    with pytest.raises(ProtectionTripped, match=words):
        bench.supply.check()


@pytest.mark.parametrize("bit", XLN_NO_TRIPS)
def test_the_other_bits_of_an_xln_are_no_trips(bench_of: Any, bit: int) -> None:
    bench = bench_of("bk-xln in process")
    bench.energise()
    answering(bench, b"STATUS?\r\n", b"%06X\r\n" % (bit | 0x04))
    bench.supply.check()


OWON_TRIPS = {3: "over-voltage", 4: "over-current", 5: "hot"}


@pytest.mark.parametrize(("place", "words"), OWON_TRIPS.items())
@pytest.mark.parametrize("on", ["ON", "1"])
def test_every_protection_of_an_owon_is_a_trip(bench_of: Any, place: int, words: str, on: str) -> None:
    bench = bench_of("owon-spe in process")
    bench.energise()
    fields = ["2.8", "0.7", "1.96", "OFF", "OFF", "OFF", "3"]
    fields[place] = on
    answering(bench, b"MEAS:ALL:INFO?\n", ",".join(fields).encode() + b"\n")
    with pytest.raises(ProtectionTripped, match=words):
        bench.supply.check()


@pytest.mark.parametrize("answer", [b"2.8,0.7,1.96,OFF,OFF,OFF\n", b"2.8,0.7,1.96,OFF,2,OFF,2\n"])
def test_another_answer_of_an_owon_is_not_understood(bench_of: Any, answer: bytes) -> None:
    bench = bench_of("owon-spe in process")
    answering(bench, b"MEAS:ALL:INFO?\n", answer)
    with pytest.raises(InstrumentError, match="must be seven fields"):
        bench.supply.check()


def test_a_late_refusal_of_an_owon_is_not_taken_as_the_answer(bench_of: Any) -> None:
    bench = bench_of("owon-spe in process")
    answering(bench, b"CURR?\n", b"ERR\nERR\n0.000\n")
    with pytest.raises(SetPointNotTaken, match=r"set to 0\.7\S* A but reads back 0 A"):
        bench.supply.set_current(0.7)


def test_a_refused_question_of_an_owon_is_an_error(bench_of: Any) -> None:
    bench = bench_of("owon-spe in process")
    answering(bench, b"MEAS:CURR?\n", b"ERR\n")
    with pytest.raises(InstrumentError, match=r"answers ERR to MEAS:CURR\?"):
        bench.supply.measure()


@pytest.mark.parametrize("profile", PROFILES, ids=lambda profile: profile.driver)
@pytest.mark.parametrize("code", ["-222", "+1", "1", "32767", "-113"])
def test_positive_and_negative_numbers_of_scpi_errors_are_errors(bench_of: Any, profile: Any, code: str) -> None:
    bench = bench_of(f"{profile.driver} in process")
    answers = [f'{code},"Something failed"\n'.encode()]
    usual = bench.line.receive
    error_query = profile.errors.encode() + b"\n"
    bench.line.receive = lambda data: answers.pop() if answers and data == error_query else usual(data)
    with pytest.raises(InstrumentError, match=rf"reports: {code.replace('+', '[+]')} Something failed"):
        bench.supply.check()
    bench.supply.check()  # the queue is empty again


def tti(series: str) -> Any:
    # Return a context with the open driver of an emulated Aim-TTi supply of this series.
    return supply_bench(SUPPLIES["aim-tti"], lambda coil: AimTtiDialect(coil, model=TTI_MODELS[series]))


@pytest.mark.parametrize(("series", "bit"), [(series, bit) for series, rows in TTI_TRIPS.items() for bit in rows])
def test_every_trip_bit_of_an_aim_tti_is_a_trip(series: str, bit: int) -> None:
    with tti(series) as bench:
        bench.energise()
        answering(bench, b"LSR1?\n", b"%d\r\n" % (bit | 2))
        with pytest.raises(ProtectionTripped, match=TTI_TRIPS[series][bit]):
            bench.supply.check()
        # The first query has cleared the register, but the driver must still report the trip.
        answering(bench, b"LSR1?\n", b"0\r\n")
        with pytest.raises(ProtectionTripped, match=TTI_TRIPS[series][bit]):
            bench.supply.check()


@pytest.mark.parametrize(("series", "bit"), [(series, bit) for series, bits in TTI_NO_TRIPS.items() for bit in bits])
def test_the_other_bits_of_an_aim_tti_are_no_trips(series: str, bit: int) -> None:
    with tti(series) as bench:
        bench.energise()
        answering(bench, b"LSR1?\n", b"%d\r\n" % bit)
        bench.supply.check()


@pytest.mark.parametrize(("series", "number"), [(series, code) for series, rows in TTI_ERRORS.items() for code in rows])
def test_every_error_of_an_aim_tti_is_named(series: str, number: int) -> None:
    with tti(series) as bench:
        bench.energise()
        answering(bench, b"*ESR?\n", b"16\r\n")
        answering(bench, b"EER?\n", b"%d\r\n" % number)
        with pytest.raises(InstrumentError, match=f"error {number}: .*{TTI_ERRORS[series][number]}"):
            bench.supply.check()


@pytest.mark.parametrize(("number", "words"), [(1, "hardware"), (99, "hardware"), (150, "does not list")])
def test_other_errors_of_an_aim_tti_are_errors_too(number: int, words: str) -> None:
    with tti("CPX") as bench:
        answering(bench, b"*ESR?\n", b"16\r\n")
        answering(bench, b"EER?\n", b"%d\r\n" % number)
        with pytest.raises(InstrumentError, match=f"error {number}: .*{words}"):
            bench.supply.check()


@pytest.mark.parametrize(("bit", "words"), TTI_EVENTS.items())
def test_every_event_of_an_aim_tti_is_an_error(bit: int, words: str) -> None:
    with tti("CPX") as bench:
        answering(bench, b"*ESR?\n", b"%d\r\n" % bit)
        with pytest.raises(InstrumentError, match=words):
            bench.supply.check()


@pytest.mark.parametrize("bit", [0, 1, 0x80])
def test_power_on_and_completed_operations_are_no_errors(bit: int) -> None:
    with tti("CPX") as bench:
        answering(bench, b"*ESR?\n", b"%d\r\n" % bit)
        bench.supply.check()


@pytest.mark.parametrize("model", TTI_MODELS.values(), ids=lambda model: model.name)
def test_the_emulated_models_answer_with_the_error_and_the_bit_of_their_series(model: Any) -> None:
    series = next(name for name in ("QL", "MX", "QPX", "CPX") if model.name.startswith(name))
    with tti(series) as bench:
        bench.coil.max_current_A = 0.5
        with pytest.raises(InstrumentError, match=f"error {model.out_of_range}: "):
            bench.supply.set_current(0.7)
        bench.coil.max_current_A = 5.0
        bench.energise()
        bench.coil.trip()
        with pytest.raises(ProtectionTripped, match="over-current"):
            bench.supply.check()


def test_a_set_point_outside_the_range_of_a_ql_names_the_range() -> None:
    with tti("QL") as bench:
        bench.line.receive(b"RANGE1 2\n")
        bench.supply.set_current(0.5)
        with pytest.raises(InstrumentError, match=r"error 120: .* \(the answer to RANGE1\? is R1 2\)"):
            bench.supply.set_current(0.7)
        assert bench.coil.state.set_current_A == 0.5


def test_an_aim_tti_that_another_interface_has_locked_is_refused_and_still_switched_off() -> None:
    with tti("CPX") as bench:
        bench.energise()
        bench.supply.safe_off()
        assert bench.line.instrument.lock == 0
        bench.line.instrument.lock = -1
        with pytest.raises(InstrumentError, match="another interface holds the lock"):
            bench.supply.set_current(0.5)
        with pytest.raises(InstrumentError, match="error 200"):
            bench.supply.safe_off()
        assert bench.sent.count(b"OP1 0\n") >= 2  # the message was sent although the lock forbids it
        bench.line.instrument.lock = 0
        bench.supply.safe_off()


def test_an_aim_tti_is_locked_from_the_first_set_point_until_it_is_off() -> None:
    with tti("CPX") as bench:
        bench.supply.identify()
        bench.supply.measure()
        assert bench.line.instrument.lock == 0
        bench.energise()
        assert bench.line.instrument.lock == 1
        bench.supply.safe_off()
        assert bench.line.instrument.lock == 0


def test_a_supply_of_another_series_is_refused(bench_of: Any) -> None:
    bench = bench_of("aim-tti in process")
    answering(bench, b"*IDN?\n", b"THURLBY THANDAR, PL303, 0, 1.00\r\n")
    with pytest.raises(InstrumentError, match="none of the series that the driver aim-tti supports: QL, MX, QPX, CPX"):
        bench.supply.identify()


@pytest.mark.parametrize(
    ("answers", "taken"), [(("0.500K", "0.400K"), False), (("0.400K", "0.500K", "0.500K", "0.500K"), True)]
)
def test_a_read_back_of_a_korad_must_be_right_twice_in_a_row(
    bench_of: Any, answers: tuple[str, ...], taken: bool
) -> None:
    bench = bench_of("korad in process")
    usual = bench.line.receive
    sent: list[bytes] = []

    def in_turn(data: bytes) -> bytes:
        if data != b"ISET1?":
            return usual(data)
        sent.append(data)
        return answers[(len(sent) - 1) % len(answers)].encode()

    bench.line.receive = in_turn
    if taken:
        bench.supply.set_current(0.5)
        assert len(sent) == 3
        return
    with pytest.raises(SetPointNotTaken, match=r"reads back 0\.4 A"):
        bench.supply.set_current(0.5)


def test_every_emulated_family_is_a_driver() -> None:
    assert set(DIALECTS) == set(SUPPLIES)
