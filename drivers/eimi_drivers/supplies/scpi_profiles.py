"""State the messages of each family of SCPI supplies.

In a message ``{value}`` is a set-point, ``{channel}`` the channel in use and ``{limit}`` the driver's limit of the
current. ``{voltage}`` and ``{current}`` are the driver's limits times `PROTECTION_MARGIN`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Watchdog:
    """State the messages of a timer in the supply, which switches the output off if no message arrives.

    Parameters
    ----------
    arm : tuple of str
        Messages that start the timer, sent in this order; ``{seconds}`` is its time.
    verify : tuple of (str, float or None)
        Queries, each with the number that must be answered; None stands for the seconds.
    disarm : str
        Message that stops the timer, sent after the output was switched off.
    """

    arm: tuple[str, ...]
    verify: tuple[tuple[str, float | None], ...]
    disarm: str


@dataclass(frozen=True)
class Profile:
    """State the messages of one family.

    Parameters
    ----------
    driver : str
        The name in a rig file.
    channels : tuple of int
        The lowest and the highest channel.
    select : str
        Message that selects the channel, sent before every message that concerns a channel; empty if the family names
        the channel in each message or has one channel.
    set_voltage, voltage_set, set_current, current_set, measure_voltage, measure_current : str
        The commands that set a quantity, and the queries for the set-points and the measured values.
    protect : tuple of str
        Messages that arm the supply's own protections, sent before `on`.
    armed : tuple of (str, str)
        Queries that read the protections back, each with the level or the switch (0 or 1) that must be answered.
    protections : str
        The armed protections in words, for the user.
    on, off : tuple of str
        Messages that switch the output, sent in this order.
    output : str
        The query whether the output is on, answered by 1 or 0, ON or OFF.
    output_bit : int
        If it is not 0, `output` is answered by a hexadecimal status word. This bit belongs to channel 1, and the next
        higher bit to channel 2.
    trip : tuple of str
        The queries whether a protection tripped, answered by 1 or 0, YES or NO.
    trip_register : str
        A query that is answered by a number; `trip_bits` lists the bits that are trips, in words.
    errors : str
        The query for the oldest entry of the error queue.
    query_delay_s : float
        Wait between a query and reading its answer, s.
    watchdog : Watchdog, optional
        The supply's own watchdog.
    reads_zero_within_A : float
        The largest current (A) that a healthy unit shows when no current is set. It is used only if it is above 20 mA,
        see `eimi_drivers.supplies.off`. The value 0 means that it is smaller, or that it was not looked up.
    """

    driver: str
    channels: tuple[int, int] = (1, 1)
    select: str = ""
    set_voltage: str = "VOLT {value}"
    voltage_set: str = "VOLT?"
    set_current: str = "CURR {value}"
    current_set: str = "CURR?"
    measure_voltage: str = "MEAS:VOLT?"
    measure_current: str = "MEAS:CURR?"
    protect: tuple[str, ...] = ()
    armed: tuple[tuple[str, str], ...] = ()
    protections: str = ""
    on: tuple[str, ...] = ("OUTP 1",)
    off: tuple[str, ...] = ("OUTP 0",)
    output: str = "OUTP?"
    output_bit: int = 0
    trip: tuple[str, ...] = ()
    trip_register: str = ""
    trip_bits: tuple[tuple[int, str], ...] = ()
    errors: str = "SYST:ERR?"
    query_delay_s: float = 0.0
    watchdog: Watchdog | None = None
    reads_zero_within_A: float = 0.0


GENERIC = Profile("scpi")

OVER_VOLTAGE = "over-voltage protection 10 % above the limit"
OVER_BOTH = "over-voltage and over-current protection 10 % above the limits"

KEYSIGHT_E36312A = Profile(
    # Keysight E36300 Series Programming Guide (E36311-90008), subsystems OUTPut and SOURce. Over-current protection is
    # switched off, because it trips in constant current, in which a supply that feeds a coil always works.
    "keysight-e36312a",
    channels=(1, 3),
    set_voltage="VOLT {value}, (@{channel})",
    voltage_set="VOLT? (@{channel})",
    set_current="CURR {value}, (@{channel})",
    current_set="CURR? (@{channel})",
    measure_voltage="MEAS:VOLT? (@{channel})",
    measure_current="MEAS:CURR? (@{channel})",
    protect=("CURR:PROT:STAT 0, (@{channel})", "VOLT:PROT {voltage}, (@{channel})"),
    armed=(("CURR:PROT:STAT? (@{channel})", "0"), ("VOLT:PROT? (@{channel})", "{voltage}")),
    protections=OVER_VOLTAGE,
    on=("OUTP 1, (@{channel})",),
    off=("OUTP 0, (@{channel})",),
    output="OUTP? (@{channel})",
    trip=("VOLT:PROT:TRIP? (@{channel})",),
)

KEYSIGHT_N6700 = replace(
    # Keysight N6700C Operating and Service Guide: watchdog page 158, status bits page 309. Clearing a protection
    # restores the output, so the output is switched off first.
    KEYSIGHT_E36312A,
    driver="keysight-n6700",
    channels=(1, 4),
    protect=(
        "OUTP 0, (@{channel})",
        "OUTP:PROT:CLE (@{channel})",
        "CURR:PROT:STAT 0, (@{channel})",
        "VOLT:PROT {voltage}, (@{channel})",
    ),
    trip=(),
    trip_register="STAT:QUES:COND? (@{channel})",
    trip_bits=(
        (1, "over-voltage protection tripped"),
        (2, "over-current protection tripped"),
        (4, "the mains failed"),
        (16, "it is too hot"),
        (64, "negative over-voltage protection tripped"),
        (512, "it was inhibited at its rear connector"),
        (2048, "its watchdog, or a protection of another channel, switched it off"),
        (4096, "its oscillation detector tripped"),
    ),
    watchdog=Watchdog(
        arm=("OUTP:PROT:WDOG:DEL {seconds}", "OUTP:PROT:WDOG 1"),
        verify=(("OUTP:PROT:WDOG:DEL?", None), ("OUTP:PROT:WDOG?", 1)),
        disarm="OUTP:PROT:WDOG 0",
    ),
)

KEYSIGHT_E3631A = Profile(
    # Agilent E3631A User's Guide (E3631-90002, October 2007): ranges page 72, selection page 74, outputs page 77. One
    # switch serves all outputs. Disabled outputs carry up to 60 mA in the opposite direction through a short circuit
    # (page 77). Output 3 is negative and is not supported. The supply has no protection with a level.
    "keysight-e3631a",
    channels=(1, 2),
    select="INST:NSEL {channel}",
    on=("OUTP ON",),
    off=("OUTP OFF",),
    reads_zero_within_A=0.06,
)

KEYSIGHT_E364X = Profile(
    "keysight-e364x",  # E3640A to E3649A have no CURR:PROT (Agilent E3640-90001, pages 80 and 81)
    protect=("VOLT:PROT:CLE", "VOLT:PROT {voltage}", "VOLT:PROT:STAT ON"),
    armed=(("VOLT:PROT?", "{voltage}"), ("VOLT:PROT:STAT?", "1")),
    protections=OVER_VOLTAGE,
    trip=("VOLT:PROT:TRIP?",),
)

KEYSIGHT_E3632A = Profile(
    "keysight-e3632a",  # E3632A to E3634A (Keysight E3632A User's Guide, pages 87 to 91)
    protect=(
        *("CURR:PROT:CLE", "CURR:PROT {current}", "CURR:PROT:STAT ON"),
        *("VOLT:PROT:CLE", "VOLT:PROT {voltage}", "VOLT:PROT:STAT ON"),
    ),
    armed=(
        *(("CURR:PROT?", "{current}"), ("CURR:PROT:STAT?", "1")),
        *(("VOLT:PROT?", "{voltage}"), ("VOLT:PROT:STAT?", "1")),
    ),
    protections=OVER_BOTH,
    trip=("CURR:PROT:TRIP?", "VOLT:PROT:TRIP?"),
)

RIGOL_DP800 = Profile(
    # Rigol DP800 Programming Guide: over-current protection pages 2-56 and 2-57 (edition for the DP832A), over-voltage
    # protection page 2-35 (first edition). Both are off unless they are switched on.
    "rigol-dp800",
    channels=(1, 3),
    select=":INST:NSEL {channel}",
    set_voltage=":SOUR:VOLT {value}",
    voltage_set=":SOUR:VOLT?",
    set_current=":SOUR:CURR {value}",
    current_set=":SOUR:CURR?",
    measure_voltage=":MEAS:VOLT?",
    measure_current=":MEAS:CURR?",
    protect=(
        *(":OUTP:OVP:VAL {voltage}", ":OUTP:OVP:STAT ON"),
        *(":OUTP:OCP:VAL {current}", ":OUTP:OCP:STAT ON"),
    ),
    armed=(
        *((":OUTP:OVP:VAL?", "{voltage}"), (":OUTP:OVP:STAT?", "1")),
        *((":OUTP:OCP:VAL?", "{current}"), (":OUTP:OCP:STAT?", "1")),
    ),
    protections=OVER_BOTH,
    on=(":OUTP ON",),
    off=(":OUTP OFF",),
    output=":OUTP?",
    trip=(":OUTP:OVP:QUES?", ":OUTP:OCP:QUES?"),
    errors=":SYST:ERR?",
)

SIGLENT_SPD = Profile(
    "siglent-spd",
    channels=(1, 2),
    set_voltage="CH{channel}:VOLT {value}",
    voltage_set="CH{channel}:VOLT?",
    set_current="CH{channel}:CURR {value}",
    current_set="CH{channel}:CURR?",
    measure_voltage="MEAS:VOLT? CH{channel}",
    measure_current="MEAS:CURR? CH{channel}",
    on=("OUTP CH{channel},ON",),
    off=("OUTP CH{channel},OFF",),
    output="SYST:STAT?",
    output_bit=0x10,
    query_delay_s=0.01,
)

ROHDE_SCHWARZ_HMP = Profile(
    "rs-hmp",
    channels=(1, 4),
    select="INST:NSEL {channel}",
    protect=("VOLT:PROT:LEV {voltage}",),
    armed=(("VOLT:PROT:LEV?", "{voltage}"),),
    protections=OVER_VOLTAGE,
    on=("OUTP ON", "OUTP:GEN 1"),
    off=("OUTP OFF",),  # OUTP:GEN 0 would also switch the other channels off
    trip=("VOLT:PROT:TRIP?",),
)

PROFILES = (
    *(GENERIC, KEYSIGHT_E36312A, KEYSIGHT_N6700, KEYSIGHT_E3631A, KEYSIGHT_E3632A, KEYSIGHT_E364X),
    *(RIGOL_DP800, SIGLENT_SPD, ROHDE_SCHWARZ_HMP),
)
