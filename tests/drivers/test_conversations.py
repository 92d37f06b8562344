"""Emulated supplies with other commands than SCPI answer as their manuals describe."""

from __future__ import annotations

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.aim_tti import CPX400DP, MX100TP, QL355TP, AimTtiDialect, Model
from eimi_drivers.emulators.serve import emulate
from eimi_drivers.emulators.supply import CoilSupply
from tests.drivers.conversations import SETTLE, TRIP, Conversation, InPieces, hold

KORAD: Conversation = [
    ("*IDN?", "KORADKA3005PV2.0"),
    ("VSET1:12.50", ""),
    ("ISET1:0.700", ""),
    ("VSET1?", "12.50"),
    ("ISET1?", "0.700K"),
    ("STATUS?", "\0"),
    ("OUT1", ""),
    (SETTLE, ""),
    ("STATUS?", "\x40"),
    ("IOUT1?", "0.700"),
    ("VOUT1?", "02.80"),
    ("VSET1:2.00", ""),
    ("STATUS?", "\x41"),  # bit 0: constant voltage
    ("VSET1:12.00", ""),
    (TRIP, ""),
    ("STATUS?", "\x20"),
    ("OUT1", ""),  # clears the trip
    ("OCP1", ""),
    (SETTLE, ""),
    ("STATUS?", "\x20"),  # armed at the set-point, which the current reaches
    ("OCP0", ""),
    ("OUT1", ""),
    (SETTLE, ""),
    ("STATUS?", "\x40"),
    ("OUT0", ""),
    ("STATUS?", "\0"),
    ("ISET1:5.001", ""),  # out of range
    ("ISET1?", "0.700K"),
    ("ISET1:5.000", ""),
    ("ISET1?", "5.000K"),
    ("VSET1:30.00VSET1?", "30.00"),
]

GENESYS: Conversation = [
    ("IDN?", ""),  # not addressed yet
    ("ADR 5", ""),
    ("IDN?", ""),
    ("ADR 6", "OK"),
    ("IDN?", "LAMBDA,GEN30-50"),
    ("SN?", "0000000-0001"),
    ("REV?", "1U1K5:4.3"),
    ("RMT?", "LOC"),
    ("PV 5", "C01"),  # refused in local mode
    ("RMT 3", "C03"),
    ("RMT 2", "OK"),
    ("RMT?", "LLO"),
    ("RMT REM", "OK"),
    ("RMT?", "REM"),
    ("NONSENSE?", "C01"),
    ("NONSENSE", "C01"),
    ("PV five", "C03"),
    ("PV 12.5", "OK"),
    ("PV?", "12.500"),
    ("\\", "12.500"),  # repeats the previous message
    ("PC 0.7", "OK"),
    ("PC?", "00.700"),
    ("PC 5.01", "C05"),
    ("PC 5", "OK"),
    ("PC 0.7", "OK"),
    ("MODE?", "OFF"),
    ("STT?", "MV(00.000),PV(12.500),MC(00.000),PC(00.700),SR(02),FR(40)"),
    ("OUT 1", "OK"),
    (SETTLE, ""),
    ("OUT?", "ON"),
    ("MODE?", "CC"),
    ("MV?", "02.800"),
    ("MC?", "00.700"),
    ("STT?", "MV(02.800),PV(12.500),MC(00.700),PC(00.700),SR(02),FR(00)"),
    ("PV 2", "OK"),
    (SETTLE, ""),
    ("MODE?", "CV"),
    ("STT?", "MV(02.000),PV(02.000),MC(00.500),PC(00.700),SR(01),FR(00)"),
    ("PV 12.5", "OK"),
    (TRIP, ""),
    (SETTLE, ""),
    ("STT?", "MV(00.000),PV(12.500),MC(00.000),PC(00.700),SR(02),FR(50)"),
    ("OUT 0", "OK"),
    ("OVP?", "33.000"),
    ("OVP 33.1", "C05"),
    ("OVP 13.9", "E04"),  # below the set voltage and 5 % of 30 V
    ("OVP 14", "OK"),
    ("PV 13.31", "E01"),  # above 95 % of the protection
    ("PV 13.29", "OK"),
    ("OVM", "OK"),
    ("OVP?", "33.000"),
    ("PV 31.4", "E01"),  # above 95 % of 33 V
    ("PV 10", "OK"),
    ("UVL 10.1", "E06"),
    ("UVL 9", "OK"),
    ("UVL?", "09.000"),
    ("PV 8.9", "E02"),
    ("UVL 0", "OK"),
    ("DVC?", "00.000, 10.000, 00.000, 00.700, 33.000, 00.000"),
    ("FLD?", "OFF"),
    ("FLD ON", "OK"),
    ("FLD?", "ON"),
    ("FLD 0", "OK"),
    ("FLD?", "OFF"),
    ("OUT ON", "OK"),
    ("OUT?", "ON"),
    ("OUT OFF", "OK"),
    ("OUT?", "OFF"),
    ("OUT MAYBE", "C01"),
]

XLN: Conversation = [
    ("MODEL?", "XLN3640"),
    ("VERSION?", "1.08"),
    ("VOLT 12.5", ""),
    ("VOLT?", "12.500"),
    ("VSET?", "12.500"),
    ("ISET 0.7", ""),
    ("CURR?", "0.700"),
    ("CURRENT?", "0.700"),
    ("CURR 5.1", ""),  # out of range, which is ignored
    ("CURR seven", ""),
    ("CURR?", "0.700"),
    ("OVSET?", "33.00"),
    ("OISET?", "5.500"),
    ("STATUS?", "000000"),
    ("OVP 1", ""),
    ("STATUS?", "000080"),
    ("OCP 1", ""),
    ("STATUS?", "0000C0"),
    ("OVP 0", ""),
    ("STATUS?", "000040"),
    ("OUT 1", ""),
    (SETTLE, ""),
    ("STATUS?", "000044"),
    ("IOUT?", "0.700"),
    ("VOUT?", "2.800"),
    ("OISET 0.6", ""),
    ("OISET?", "0.600"),
    ("STATUS?", "004040"),  # over-current protection tripped
    ("CLR", ""),
    ("STATUS?", "000040"),
    ("OCP 0", ""),
    ("OVSET 2.7", ""),
    ("OVP 1", ""),
    ("OUT 1", ""),
    (SETTLE, ""),
    ("STATUS?", "008080"),
    ("OUT 0", ""),
    ("STATUS?", "008080"),
    ("CLR", ""),
    ("STATUS?", "000080"),
    ("NONSENSE?", ""),
]

OWON: Conversation = [
    ("*IDN?", "OWON,SPE6103,EMULATED,FV:V3.0.0"),
    ("SYST:ERR?", "ERR"),
    ("VOLT 12.5", ""),
    ("VOLT?", "12.500"),
    ("CURR 0.7", ""),
    ("CURR?", "0.700"),
    ("CURR 5.1", "ERR"),
    ("CURR?", "0.700"),
    ("VOLT:LIM?", "31.000"),
    ("CURR:LIM?", "5.100"),
    ("VOLT:LIM 31.1", "ERR"),
    ("VOLT:LIM 13", ""),
    ("VOLT:LIM?", "13.000"),
    ("CURR:LIM 5.2", "ERR"),
    ("CURR:LIM 1", ""),
    ("CURR:LIM?", "1.000"),
    ("MEAS:ALL:INFO?", "0.000,0.000,0.000,OFF,OFF,OFF,0"),
    ("OUTP ON", ""),
    (SETTLE, ""),
    ("OUTP?", "ON"),
    ("MEAS:VOLT?", "2.800"),
    ("MEAS:CURR?", "0.700"),
    ("MEAS:ALL:INFO?", "2.800,0.700,1.960,OFF,OFF,OFF,2"),
    ("VOLT 2", ""),
    (SETTLE, ""),
    ("MEAS:ALL:INFO?", "2.000,0.500,1.000,OFF,OFF,OFF,1"),
    ("CURR:LIM 0.4", ""),
    ("OUTP?", "OFF"),
    (SETTLE, ""),
    ("MEAS:ALL:INFO?", "0.000,0.000,0.000,OFF,ON,OFF,3"),
    ("CURR:LIM 1", ""),
    ("VOLT:LIM 1.9", ""),
    ("OUTP ON", ""),
    ("OUTP?", "OFF"),
    (SETTLE, ""),
    ("MEAS:ALL:INFO?", "0.000,0.000,0.000,ON,OFF,OFF,3"),
    ("NONSENSE?", "ERR"),
]

CONVERSATIONS = {
    "korad": KORAD,
    "genesys": GENESYS,
    "bk-xln": XLN,
    "owon-spe": OWON,
}


@pytest.mark.parametrize("dialect", CONVERSATIONS)
def test_a_conversation_follows_the_manual(dialect: str) -> None:
    coil = CoilSupply(SimulatedClock())
    hold(CONVERSATIONS[dialect], dialect, emulate(dialect, coil), coil)


@pytest.mark.parametrize("dialect", [name for name in CONVERSATIONS if name != "korad"])
def test_a_message_may_arrive_in_pieces(dialect: str) -> None:
    coil = CoilSupply(SimulatedClock())
    hold(CONVERSATIONS[dialect], dialect, InPieces(emulate(dialect, coil)), coil)


TTI: dict[str, tuple[Model, Conversation]] = {
    "commands": (
        CPX400DP,
        [
            ("*ESR?", "128"),  # the power was switched on
            ("*ESR?", "0"),
            ("V1 12.5", ""),
            ("V1?", "V1 12.500"),
            ("V1V 12", ""),  # with verification
            ("V1?", "V1 12.000"),
            ("I1 0.7", ""),
            ("I1?", "I1 0.700"),
            ("I1 5.1", ""),
            ("*ESR?", "16"),
            ("EER?", "100"),
            ("EER?", "0"),
            ("V2 5", ""),
            ("*ESR?", "16"),
            ("EER?", "103"),
            ("NONSENSE", ""),
            ("*ESR?", "32"),
            ("V1 five", ""),
            ("*ESR?", "32"),
            ("*NONSENSE", ""),
            ("*ESR?", "32"),
            ("X1?", ""),
            ("*ESR?", "32"),
            ("X1 5", ""),
            ("*ESR?", "32"),
            ("LSR1?", "0"),
            ("OP1 2", ""),
            ("EER?", "100"),
            ("OP1 1", ""),
            (SETTLE, ""),
            ("OP1?", "1"),
            ("V1O?", "2.800V"),
            ("I1O?", "0.7000A"),
            ("LSR1?", "2"),  # constant current
            ("V1 2", ""),
            ("LSR1?", "3"),  # constant current before the command, constant voltage after it
            ("LSR1?", "1"),
            ("OPALL 0", ""),
            ("OP1?", "0"),
            ("OPALL 1", ""),
            ("OP1?", "1"),
            ("OVP1?", "VP1 33.000"),
            ("OCP1?", "CP1 5.500"),
            ("OCP1 OFF", ""),
            ("OCP1?", "CP1 OFF"),
            ("OCP1 ON", ""),
            ("OCP1 0.4", ""),
            (SETTLE, ""),
            ("OP1?", "0"),
            ("LSR1?", "9"),  # over-current, after constant voltage
            ("LSR1?", "0"),  # reading clears the register
            ("TRIPRST", ""),
            ("OCP1 5.5", ""),
            ("OVP1 1.9", ""),
            ("OP1 1", ""),
            (SETTLE, ""),
            ("OP1?", "0"),
            ("LSR1?", "4"),
            ("*OPC?", "1"),
            ("*STB?;QER?;*TST?;ADDRESS?", "0\r\n0\r\n0\r\n11"),
            ("*WAI", ""),
            ("LOCAL", ""),
            ("*ESR?", "16"),
            ("*RST", ""),
            ("V1?;I1?;OP1?", "V1 0.000\r\nI1 1.000\r\n0"),
        ],
    ),
    "lock": (
        CPX400DP,
        [
            ("IFLOCK?", "0"),
            ("IFLOCK", "1"),
            ("IFLOCK?", "1"),
            ("IFUNLOCK", "0"),
            ("IFLOCK?", "0"),
        ],
    ),
    "ranges of an MX": (
        MX100TP,
        [
            ("VRANGE1?", "1"),
            ("V1 16.1", ""),
            ("EER?", "100"),
            ("V1 16", ""),
            ("VRANGE1 2", ""),
            ("VRANGE1?", "2"),
            ("V1 17", ""),
            ("V1?", "V1 17.000"),
            ("I1 3.1", ""),
            ("EER?", "100"),
            ("I1 3", ""),
            ("I1?", "I1 3.000"),
            ("VRANGE1 3", ""),
            ("EER?", "100"),
            ("OP1 1", ""),
            ("VRANGE1 1", ""),
            ("EER?", "104"),
            ("VRANGE1?", "2"),
            ("RANGE1?", ""),
        ],
    ),
    "ranges of a QL": (
        QL355TP,
        [
            ("RANGE1?", "R1 0"),
            ("V1 15.1", ""),
            ("EER?", "120"),
            ("RANGE1 2", ""),
            ("I1 0.51", ""),
            ("EER?", "120"),
            ("I1 0.5", ""),
            ("I1?", "I1 0.500"),
            ("OP1 1", ""),
            ("RANGE1 0", ""),
            ("EER?", "124"),
        ],
    ),
}


@pytest.mark.parametrize("subject", TTI)
def test_a_conversation_with_an_aim_tti_follows_the_manual(subject: str) -> None:
    model, conversation = TTI[subject]
    coil = CoilSupply(SimulatedClock())
    hold(conversation, "aim-tti", AimTtiDialect(coil, model=model), coil)


def test_while_another_interface_has_the_lock_commands_are_refused_and_queries_are_answered() -> None:
    instrument = AimTtiDialect(CoilSupply(SimulatedClock()))
    instrument.lock = -1
    for message, answer in (
        (b"IFLOCK", b"-1\r\n"),
        (b"V1 5", b""),
        (b"EER?", b"200\r\n"),
        (b"V1?", b"V1 0.000\r\n"),
        (b"IFUNLOCK", b"-1\r\n"),
        (b"EER?", b"200\r\n"),
        (b"IFLOCK?", b"-1\r\n"),
        (b"EER?", b"0\r\n"),
    ):
        assert instrument.receive(message + b"\n") == answer, message
