"""What tells one family of SCPI supplies from another: the strings, and nothing else.

`{value}` is a set-point, `{channel}` the channel in use, `{limit}` the driver's limit of the current, `{voltage}`
and `{current}` its limits with `PROTECTION_MARGIN`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Watchdog:
    """A timer in the supply that switches the output off when no message has come for `{seconds}`.

    arm: sent one after the other. verify: questions, and the number that each must be answered with; None stands for
    the seconds. disarm: sent once the output is off.
    """

    arm: tuple[str, ...]
    verify: tuple[tuple[str, float | None], ...]
    disarm: str


@dataclass(frozen=True)
class Profile:
    """The messages of one family.

    driver: the name in a rig file. channels: the first and the last.
    select: sent before every message that concerns a channel, where the family selects one at a time.
    on, off: sent one after the other. protect: sent before `on`.
    output: the question whether the output is on, answered 1 or 0, ON or OFF; with output_bit, a hexadecimal
    status word, in which the bit of channel 1 is output_bit, and that of channel 2 the next.
    trip: the questions whether a protection tripped, answered 1 or 0, YES or NO; none where there are none.
    trip_register: a question answered with a number, of whose bits `trip_bits` tells those that are trips, in words.
    query_delay_s: to wait between a question and reading its answer.
    reads_zero_within_A: the fixed part of the family's accuracy of measured current. It is used only if it is above
    20 mA, see `eimi_drivers.supplies.off`. 0 stands for an offset that is smaller, or that was not looked up.
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

KEYSIGHT_E36312A = Profile(
    "keysight-e36312a",
    channels=(1, 3),
    set_voltage="VOLT {value}, (@{channel})",
    voltage_set="VOLT? (@{channel})",
    set_current="CURR {value}, (@{channel})",
    current_set="CURR? (@{channel})",
    measure_voltage="MEAS:VOLT? (@{channel})",
    measure_current="MEAS:CURR? (@{channel})",
    on=("OUTP 1, (@{channel})",),
    off=("OUTP 0, (@{channel})",),
    output="OUTP? (@{channel})",
)

KEYSIGHT_N6700 = replace(
    # Keysight N6700C Operating and Service Guide: watchdog page 158, status bits page 309. Its protections restore the
    # output as they are cleared, so that it is switched off before. Over-current protection would trip in constant
    # current, where a coil always works.
    KEYSIGHT_E36312A,
    driver="keysight-n6700",
    channels=(1, 4),
    protect=(
        "OUTP 0, (@{channel})",
        "OUTP:PROT:CLE (@{channel})",
        "CURR:PROT:STAT 0, (@{channel})",
        "VOLT:PROT {voltage}, (@{channel})",
    ),
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

KEYSIGHT_E364X = Profile(
    "keysight-e364x",  # E3640A to E3649A have no CURR:PROT (Agilent E3640-90001, page 80 and after)
    protect=("VOLT:PROT:CLE", "VOLT:PROT {voltage}", "VOLT:PROT:STAT ON"),
    trip=("VOLT:PROT:TRIP?",),
)

KEYSIGHT_E3632A = Profile(
    "keysight-e3632a",  # E3632A to E3634A (Keysight E3632A User's Guide, pages 87 to 91)
    protect=(
        *("CURR:PROT:CLE", "CURR:PROT {current}", "CURR:PROT:STAT ON"),
        *("VOLT:PROT:CLE", "VOLT:PROT {voltage}", "VOLT:PROT:STAT ON"),
    ),
    trip=("CURR:PROT:TRIP?", "VOLT:PROT:TRIP?"),
)

RIGOL_DP800 = Profile(
    "rigol-dp800",
    channels=(1, 3),
    select=":INST:NSEL {channel}",
    set_voltage=":SOUR:VOLT {value}",
    voltage_set=":SOUR:VOLT?",
    set_current=":SOUR:CURR {value}",
    current_set=":SOUR:CURR?",
    measure_voltage=":MEAS:VOLT?",
    measure_current=":MEAS:CURR?",
    protect=(":OUTP:OVP:VAL {voltage}", ":OUTP:OCP:VAL {current}", ":OUTP:OCP:STAT ON"),
    on=(":OUTP ON",),
    off=(":OUTP OFF",),
    output=":OUTP?",
    trip=(":OUTP:OCP:QUES?",),
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
    on=("OUTP ON", "OUTP:GEN 1"),
    off=("OUTP OFF",),  # OUTP:GEN 0 would switch the other channels off, too
    trip=("VOLT:PROT:TRIP?",),
)

PROFILES = (
    *(GENERIC, KEYSIGHT_E36312A, KEYSIGHT_N6700, KEYSIGHT_E3632A, KEYSIGHT_E364X),
    *(RIGOL_DP800, SIGLENT_SPD, ROHDE_SCHWARZ_HMP),
)
