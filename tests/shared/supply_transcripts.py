"""The exact messages that every supply driver sends, with the replies according to the manuals."""

from __future__ import annotations

NONE = '0,"No error"'
"""The reply to SYST:ERR? if the error queue is empty."""


class Transcript:
    """A replacement for an instrument: expected messages with their replies; any other message raises AssertionError.

    Parameters
    ----------
    exchanges : list of (str, str)
        Messages and replies in their order; an empty text means no reply.
    end : str
        End of every message.
    reply_end : str
        End of every reply.
    """

    def __init__(self, exchanges: list[tuple[str, str]], end: str, reply_end: str) -> None:
        self._exchanges = [
            (f"{message}{end}".encode("ascii"), f"{reply}{reply_end}".encode("latin-1") if reply else b"")
            for message, reply in exchanges
        ]
        self._place = 0

    def receive(self, data: bytes) -> bytes:
        assert self._place < len(self._exchanges), f"{data!r} was sent after the end"
        expected, reply = self._exchanges[self._place]
        assert data == expected, f"message {self._place + 1} is {data!r}, not {expected!r}"
        self._place += 1
        return reply

    def assert_complete(self) -> None:
        unsent = [message for message, _ in self._exchanges[self._place :]]
        assert not unsent, f"these messages were never sent: {unsent}"


def scpi(
    select: str = "",
    armed: tuple[tuple[str, str], ...] = (),
    disarmed: tuple[tuple[str, str], ...] = (),
    **strings: str,
) -> list[tuple[str, str]]:
    """Return the messages of the driver of a SCPI supply during a run, with the replies.

    Parameters
    ----------
    select : str
        The message that selects the channel; empty if there is none.
    armed, disarmed : tuple of (str, str)
        The messages that start and stop the watchdog, with the replies.
    **strings : str
        Texts that replace the usual SCPI messages and replies, such as ``volt="VOLT 12"``. A ``|`` separates messages.
        The keys "protected?" and "mode" contain queries with replies, such as "VOLT:PROT?=13". The key "remote" adds a
        first message.
    """
    family = {
        "volt": "VOLT 12.00",
        "volt?": "VOLT?",
        "curr": "CURR 0.700",
        "zero": "CURR 0.000",
        "curr?": "CURR?",
        "on": "OUTP 1",
        "off": "OUTP 0",
        "out?": "OUTP?",
        "is_on": "1",
        "is_off": "0",
        "protect": "",
        "protected?": "",
        "mode": "",
        "meas_curr?": "MEAS:CURR?",
        "meas_volt?": "MEAS:VOLT?",
        "err?": "SYST:ERR?",
        "none": NONE,
        "trip?": "",
        "no_trip": "0",
    } | strings

    def channel(messages: str, reply: str = "") -> list[tuple[str, str]]:
        return [*([(select, "")] if select else []), *((message, reply) for message in messages.split("|"))]

    no_error = [(family["err?"], family["none"])] if family["err?"] else []
    modes: list[tuple[str, str]] = [
        exchange for mode in family["mode"].split("|") if mode for exchange in [tuple(mode.split("="))]
    ]  # type: ignore[misc]
    return [
        *([(family["remote"], "")] if "remote" in family else []),
        ("*IDN?", "MAKER,MODEL,0,1"),
        *modes,
        *channel(family["volt"]),
        *no_error,
        *channel(family["volt?"], "12.00"),
        *modes,
        *channel(family["curr"]),
        *no_error,
        *channel(family["curr?"], "0.700"),
        *([*channel(family["protect"]), *no_error] if family["protect"] else []),
        *(exchange for pair in family["protected?"].split("|") if pair for exchange in channel(*pair.split("="))),
        *armed,
        *channel(family["on"]),
        *no_error,
        *channel(family["out?"], family["is_on"]),
        *channel(family["meas_curr?"], "0.6990"),
        *channel(family["meas_volt?"], "2.80"),
        *no_error,
        *(asked for query in family["trip?"].split("|") if query for asked in channel(query, family["no_trip"])),
        *channel(family["out?"], family["is_on"]),
        *channel(family["zero"]),
        *channel(family["off"]),
        *no_error,
        *channel(family["curr?"], "0.000"),
        *channel(family["out?"], family["is_off"]),
        *channel(family["meas_curr?"], "0.0012"),
        *channel(family["meas_volt?"], "0.00"),
        *disarmed,
    ]


KEYSIGHT_WATCHDOG = (
    *(("OUTP:PROT:WDOG:DEL 10", ""), ("OUTP:PROT:WDOG 1", ""), ("SYST:ERR?", '+0,"No error"')),
    *(("OUTP:PROT:WDOG:DEL?", "+10"), ("OUTP:PROT:WDOG?", "1")),
)
N6900 = {
    "mode": "FUNC?=CURR",
    "volt": "VOLT:LIM 12.00",
    "volt?": "VOLT:LIM?",
    "protect": "OUTP 0|OUTP:PROT:CLE|CURR:PROT:STAT 0|VOLT:PROT 13.20",
    "protected?": "CURR:PROT:STAT?=0|VOLT:PROT?=+1.32000000E+01",
    "trip?": "STAT:QUES1:COND?|STAT:QUES2:COND?",
    "none": '+0,"No error"',
}
DELTA_WATCHDOG = (
    *(("SYSTEM:COMMUNICATE:WATCHDOG SET,10000", ""), ("SYSTEM:ERROR?", "0,None")),
    ("SYSTEM:COMMUNICATE:WATCHDOG SET?", "10000"),
)
DELTA_STOPPED = (("SYSTEM:COMMUNICATE:WATCHDOG STOP", ""), ("SYSTEM:ERROR?", "0,None"))
DELTA = {
    "volt": "SOURCE:VOLTAGE 12.00",
    "volt?": "SOURCE:VOLTAGE?",
    "curr": "SOURCE:CURRENT 0.700",
    "zero": "SOURCE:CURRENT 0.000",
    "curr?": "SOURCE:CURRENT?",
    "on": "OUTPUT 1",
    "off": "OUTPUT 0",
    "out?": "OUTPUT?",
    "meas_curr?": "MEASURE:CURRENT?",
    "meas_volt?": "MEASURE:VOLTAGE?",
    "trip?": "SYSTEM:COMMUNICATE:WATCHDOG?",
    "no_trip": "9990",
    "err?": "SYSTEM:ERROR?",
    "none": "0,None",
}

SCPI_TRANSCRIPTS = {
    "scpi": scpi(),
    "keysight-e36312a": scpi(
        **{
            "volt": "VOLT 12.00, (@1)",
            "volt?": "VOLT? (@1)",
            "curr": "CURR 0.700, (@1)",
            "zero": "CURR 0.000, (@1)",
            "curr?": "CURR? (@1)",
            "on": "OUTP 1, (@1)",
            "off": "OUTP 0, (@1)",
            "out?": "OUTP? (@1)",
            "protect": "CURR:PROT:STAT 0, (@1)|VOLT:PROT 13.20, (@1)",
            "protected?": "CURR:PROT:STAT? (@1)=0|VOLT:PROT? (@1)=+1.32000000E+01",
            "trip?": "VOLT:PROT:TRIP? (@1)",
            "meas_curr?": "MEAS:CURR? (@1)",
            "meas_volt?": "MEAS:VOLT? (@1)",
            "none": '+0,"No error"',
        }
    ),
    "keysight-n6700": scpi(
        armed=(
            ("OUTP:PROT:WDOG:DEL 10", ""),
            ("OUTP:PROT:WDOG 1", ""),
            ("SYST:ERR?", '+0,"No error"'),
            ("OUTP:PROT:WDOG:DEL?", "+10"),
            ("OUTP:PROT:WDOG?", "1"),
        ),
        disarmed=(("OUTP:PROT:WDOG 0", ""), ("SYST:ERR?", '+0,"No error"')),
        **{
            "volt": "VOLT 12.00, (@1)",
            "volt?": "VOLT? (@1)",
            "curr": "CURR 0.700, (@1)",
            "zero": "CURR 0.000, (@1)",
            "curr?": "CURR? (@1)",
            "protect": "OUTP 0, (@1)|OUTP:PROT:CLE (@1)|CURR:PROT:STAT 0, (@1)|VOLT:PROT 13.20, (@1)",
            "protected?": "CURR:PROT:STAT? (@1)=0|VOLT:PROT? (@1)=+1.32000000E+01",
            "on": "OUTP 1, (@1)",
            "off": "OUTP 0, (@1)",
            "out?": "OUTP? (@1)",
            "meas_curr?": "MEAS:CURR? (@1)",
            "meas_volt?": "MEAS:VOLT? (@1)",
            "trip?": "STAT:QUES:COND? (@1)",
            "no_trip": "128",
            "none": '+0,"No error"',
        },
    ),
    "keysight-e3631a": scpi(
        "INST:NSEL 1", **{"remote": "SYST:REM", "on": "OUTP ON", "off": "OUTP OFF", "none": '+0,"No error"'}
    ),
    "keysight-e364x": scpi(
        **{
            "remote": "SYST:REM",
            "protect": "VOLT:PROT:CLE|VOLT:PROT 13.20|VOLT:PROT:STAT ON",
            "protected?": "VOLT:PROT?=+1.32000000E+01|VOLT:PROT:STAT?=1",
            "trip?": "VOLT:PROT:TRIP?",
            "none": '+0,"No error"',
        }
    ),
    "keysight-e3632a": scpi(
        **{
            "remote": "SYST:REM",
            "protect": "CURR:PROT:CLE|CURR:PROT 1.100|CURR:PROT:STAT ON|"
            "VOLT:PROT:CLE|VOLT:PROT 13.20|VOLT:PROT:STAT ON",
            "protected?": "CURR:PROT?=+1.10000000E+00|CURR:PROT:STAT?=1|VOLT:PROT?=+1.32000000E+01|VOLT:PROT:STAT?=1",
            "trip?": "CURR:PROT:TRIP?|VOLT:PROT:TRIP?",
            "none": '+0,"No error"',
        }
    ),
    "rigol-dp800": scpi(
        ":INST:NSEL 1",
        **{
            "volt": ":SOUR:VOLT 12.00",
            "volt?": ":SOUR:VOLT?",
            "curr": ":SOUR:CURR 0.700",
            "zero": ":SOUR:CURR 0.000",
            "curr?": ":SOUR:CURR?",
            "protect": ":OUTP:OVP:VAL 13.20|:OUTP:OVP:STAT ON|:OUTP:OCP:VAL 1.100|:OUTP:OCP:STAT ON",
            "protected?": ":OUTP:OVP:VAL?=13.200|:OUTP:OVP:STAT?=ON|:OUTP:OCP:VAL?=1.1000|:OUTP:OCP:STAT?=ON",
            "on": ":OUTP ON",
            "off": ":OUTP OFF",
            "out?": ":OUTP?",
            "is_on": "ON",
            "is_off": "OFF",
            "meas_curr?": ":MEAS:CURR?",
            "meas_volt?": ":MEAS:VOLT?",
            "err?": ":SYST:ERR?",
            "trip?": ":OUTP:OVP:QUES?|:OUTP:OCP:QUES?",
            "no_trip": "NO",
        },
    ),
    "siglent-spd": scpi(
        **{
            "volt": "CH1:VOLT 12.00",
            "volt?": "CH1:VOLT?",
            "curr": "CH1:CURR 0.700",
            "zero": "CH1:CURR 0.000",
            "curr?": "CH1:CURR?",
            "on": "OUTP CH1,ON",
            "off": "OUTP CH1,OFF",
            "out?": "SYST:STAT?",
            "is_on": "0x15",
            "is_off": "0x4",
            "meas_curr?": "MEAS:CURR? CH1",
            "meas_volt?": "MEAS:VOLT? CH1",
            "none": "0  No Error",
        }
    ),
    "rs-hmp": scpi(
        "INST:NSEL 1",
        **{
            "protect": "VOLT:PROT:LEV 13.20",
            "protected?": "VOLT:PROT:LEV?=13.200",
            "on": "OUTP ON|OUTP:GEN 1",
            "off": "OUTP OFF",
            "trip?": "VOLT:PROT:TRIP?",
        },
    ),
    "keysight-n6900": scpi(
        armed=KEYSIGHT_WATCHDOG,
        disarmed=(("OUTP:PROT:WDOG 0", ""), ("SYST:ERR?", '+0,"No error"')),
        **N6900,
    ),
    "keysight-rp7900": scpi(
        armed=KEYSIGHT_WATCHDOG,
        disarmed=(("OUTP:PROT:WDOG 0", ""), ("SYST:ERR?", '+0,"No error"')),
        **N6900,
    ),
    "keithley-2200": scpi(
        armed=(
            *(("OUTP:TIM:DEL 14400", ""), ("OUTP:TIM 1", ""), ("SYST:ERR?", NONE)),
            *(("OUTP:TIM:DEL?", "14400.00"), ("OUTP:TIM?", "1")),
        ),
        disarmed=(("OUTP:TIM 0", ""), ("SYST:ERR?", NONE)),
        **{
            "protect": "OUTP 0|OUTP:PROT:CLE|VOLT:PROT 13.20|VOLT:PROT:STAT 1",
            "protected?": "VOLT:PROT?=13.20|VOLT:PROT:STAT?=1",
        },
    ),
    "keithley-2260b": scpi(
        **{
            "protect": "OUTP 0|OUTP:PROT:CLE|CURR:PROT:STAT 0|VOLT:PROT 13.20",
            "protected?": "CURR:PROT:STAT?=0|VOLT:PROT?=+13.200",
            "trip?": "STAT:QUES:COND?",
            "no_trip": "+512",
            "none": '+0, "No error"',
        },
    ),
    "delta-sm15k": scpi(
        armed=DELTA_WATCHDOG,
        disarmed=DELTA_STOPPED,
        **DELTA,
        **{
            "mode": "SYSTEM:REMOTE:CV?=Ethernet|SYSTEM:REMOTE:CC?=Ethernet",
            "protect": "SYSTEM:LIMITS:VOLTAGE 13.20,ON|SYSTEM:LIMITS:CURRENT 1.100,ON",
            "protected?": "SYSTEM:LIMITS:VOLTAGE?=13.2000,ON|SYSTEM:LIMITS:CURRENT?=1.1000,ON",
        },
    ),
    "delta-psc-eth": scpi(
        armed=DELTA_WATCHDOG,
        disarmed=DELTA_STOPPED,
        **DELTA,
        **{"mode": "SYSTEM:REMOTE:CV?=REM|SYSTEM:REMOTE:CC?=REM"},
    ),
    "owon-spe": scpi(
        **{
            "on": "OUTP ON",
            "off": "OUTP OFF",
            "is_on": "ON",
            "is_off": "OFF",
            "err?": "",
            "protect": "VOLT:LIM 13.20|CURR:LIM 1.100",
            "protected?": "VOLT:LIM?=13.200|CURR:LIM?=1.100",
            "trip?": "MEAS:ALL:INFO?",
            "no_trip": "2.800,0.699,1.957,OFF,OFF,OFF,2",
        },
    ),
    "kepco-bit4886": [
        ("*IDN?", "KEPCO,BIT 4886 36-12,0,1"),
        *(("FUNC:MODE CURR", ""), ("VOLT 12.00", ""), ("SYST:ERR?", NONE), ("VOLT?", "1.20E1")),
        *(("FUNC:MODE CURR", ""), ("CURR 0.70", ""), ("SYST:ERR?", NONE), ("CURR?", "7.0E-1")),
        *(("OUTP 1", ""), ("SYST:ERR?", NONE), ("OUTP?", "1")),
        *(("MEAS:CURR?", "6.99E-1"), ("MEAS:VOLT?", "2.8E0"), ("SYST:ERR?", NONE), ("OUTP?", "1")),
        *(("FUNC:MODE CURR", ""), ("CURR 0.00", ""), ("FUNC:MODE CURR", ""), ("CURR 0.00", ""), ("SYST:ERR?", NONE)),
        *(("CURR?", "0.0E0"), ("CURR?", "0.0E0"), ("MEAS:CURR?", "1.2E-3"), ("MEAS:VOLT?", "0.0E0")),
    ],
    "kepco-bop": [
        ("*IDN?", "KEPCO,BOP 1KW 36-28,0,1"),
        *(("FUNC:MODE CURR", ""), ("VOLT:PROT:POS 12.00", ""), ("VOLT:PROT:NEG 12.00", "")),
        *(("SYST:ERR?", NONE), ("VOLT:PROT:POS?", "1.20E1")),
        *(("FUNC:MODE CURR", ""), ("CURR 0.70", ""), ("SYST:ERR?", NONE), ("CURR?", "7.0E-1")),
        *(("CURR:LIM:POS 1.000", ""), ("CURR:LIM:NEG 1.000", ""), ("VOLT:PROT:MODE FIX", ""), ("SYST:ERR?", NONE)),
        *(("CURR:LIM:POS?", "1.000E0"), ("CURR:LIM:NEG?", "1.000E0"), ("VOLT:PROT:MODE?", "FIXED")),
        *(("OUTP 1", ""), ("SYST:ERR?", NONE), ("OUTP?", "1")),
        *(("MEAS:CURR?", "6.99E-1"), ("MEAS:VOLT?", "2.8E0")),
        *(("SYST:ERR?", NONE), ("OUTP?", "1")),
        *(("FUNC:MODE CURR", ""), ("CURR 0.00", ""), ("FUNC:MODE CURR", ""), ("CURR 0.00", "")),
        *(
            ("SYST:ERR?", NONE),
            ("CURR?", "0.0E0"),
            ("CURR?", "0.0E0"),
            ("MEAS:CURR?", "1.2E-3"),
            ("MEAS:VOLT?", "0.0E0"),
        ),
    ],
}

GENESYS = [
    *(("ADR 6", "OK"), ("RMT REM", "OK"), ("IDN?", "LAMBDA,GEN40-38"), ("SN?", "123A456-0001")),
    *(("OVM", "OK"), ("PV 12.00", "OK"), ("PV?", "12.000"), ("PV?", "12.000")),
    *(("PC 0.70", "OK"), ("PC?", "00.700"), ("PC?", "00.700")),
    *(
        ("IDN?", "LAMBDA,GEN40-38"),
        ("FLD OFF", "OK"),
        ("OVP 14.04", "OK"),
        ("OVP?", "14.040"),
        ("FLD?", "OFF"),
        ("OUT ON", "OK"),
        ("OUT?", "ON"),
        ("OUT?", "ON"),
    ),
    *(("MC?", "00.699"), ("MV?", "02.800")),
    ("STT?", "MV(02.800),PV(12.000),MC(00.699),PC(00.700),SR(02),FR(00)"),
    *(("OUT?", "ON"), ("PC 0.00", "OK"), ("OUT OFF", "OK"), ("PC?", "00.000"), ("PC?", "00.000")),
    *(("OUT?", "OFF"), ("OUT?", "OFF"), ("MC?", "00.040"), ("MV?", "00.000")),
]


def aim_tti(model: str, current: str = "0.70", zero: str = "0.00", switched: bool = False) -> list[tuple[str, str]]:
    """Return the messages of the driver of an Aim-TTi supply during a run, with the replies.

    Parameters
    ----------
    model : str
        Model of the supply.
    current, zero : str
        Texts of 0.7 A and 0 A in the commands.
    switched : bool
        Whether the protections are switched on before their levels are set (MX180TP manual, page 34: OVP<N> ON).
    """
    ovp, ocp = ([(f"{word}1 ON", "")] if switched else [] for word in ("OVP", "OCP"))
    return [
        ("*IDN?", f"THURLBY THANDAR, {model}, 123456, 1.00 - 2.00"),
        *(("*CLS", ""), ("IFLOCK", "1"), ("V1 12.00", ""), ("*ESR?", "0"), ("V1?", "V1 12.000")),
        *((f"I1 {current}", ""), ("*ESR?", "0"), ("I1?", "I1 0.7000")),
        *(("TRIPRST", ""), ("LSR1?", "3"), *ovp, ("OVP1 13.20", ""), *ocp, ("OCP1 1.100", ""), ("*ESR?", "0")),
        *(("OVP1?", "VP1 13.2"), ("OCP1?", "CP1 1.10")),
        *(("OP1 1", ""), ("*ESR?", "0"), ("OP1?", "1")),
        *(("I1O?", "0.6990A"), ("V1O?", "2.800V")),
        *(("*ESR?", "0"), ("LSR1?", "2"), ("OP1?", "1")),
        *((f"I1 {zero}", ""), ("OP1 0", ""), ("*ESR?", "0"), ("I1?", "I1 0.0000"), ("OP1?", "0")),
        *(("I1O?", "0.0001A"), ("V1O?", "0.010V"), ("IFLOCK?", "1"), ("IFUNLOCK", "0")),
    ]


AIM_TTI_TRANSCRIPTS = {
    "QL": aim_tti("QL355P", "0.700", "0.000"),
    "MX": aim_tti("MX100TP", "0.700", "0.000", switched=True),
    "QPX": aim_tti("QPX1200S"),
    "CPX": aim_tti("CPX400DP"),
}

XLN = [
    *(("MODEL?", "XLN3640"), ("VERSION?", "1.08")),
    *(("VOLT 12.00", ""), ("VOLT?", "12.000"), ("CURR 0.70", ""), ("CURR?", "0.700")),
    *(("CLR", ""), ("OVSET 13.20", ""), ("OVP 1", ""), ("OISET 1.100", ""), ("OCP 1", "")),
    *(("OVSET?", "13.20"), ("OISET?", "1.100"), ("STATUS?", "0000C2"), ("OUT 1", ""), ("STATUS?", "0000CE")),
    *(("IOUT?", "0.699"), ("VOUT?", "2.800"), ("STATUS?", "0000CE"), ("STATUS?", "0000CE")),
    *(("CURR 0.00", ""), ("OUT 0", ""), ("CURR?", "0.000"), ("STATUS?", "0000C2")),
    *(("IOUT?", "0.002"), ("VOUT?", "0.01")),
]

KORAD = [
    ("*IDN?", "KORADKA3005PV2.0"),
    *(("VSET1:12.00", ""), ("VSET1?", "12.00"), ("VSET1?", "12.00")),
    *(("ISET1:0.700", ""), ("ISET1?", "0.700K"), ("ISET1?", "0.700K")),
    *(("OCP0", ""), ("OUT1", ""), ("STATUS?", "\x50"), ("STATUS?", "\x50"), ("STATUS?", "\x50")),
    *(("IOUT1?", "0.699"), ("VOUT1?", "02.80"), ("STATUS?", "\x50")),
    *(("ISET1:0.000", ""), ("OUT0", ""), ("ISET1?", "0.000K"), ("ISET1?", "0.000K")),
    *(("STATUS?", "\x10"), ("STATUS?", "\x10"), ("IOUT1?", "0.001"), ("VOUT1?", "00.00")),
]

TRANSCRIPTS = {
    "korad": (KORAD, "", ""),
    "genesys": (GENESYS, "\r", "\r"),
    "aim-tti": (AIM_TTI_TRANSCRIPTS["QL"], "\n", "\r\n"),
    "bk-xln": (XLN, "\r\n", "\r\n"),
    **{driver: (exchanges, "\n", "\n") for driver, exchanges in SCPI_TRANSCRIPTS.items()},
}
