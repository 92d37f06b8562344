"""What tells one family of SCPI supplies from another: the strings, and nothing else.

`{value}` is a set-point, `{channel}` the channel in use, `{limit}` the driver's limit of the current, `{voltage}`
and `{current}` its limits with `PROTECTION_MARGIN`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Profile:
    """The messages of one family.

    driver: the name in a rig file. channels: the first and the last.
    select: sent before every message that concerns a channel, where the family selects one at a time.
    on, off: sent one after the other. protect: sent before `on`.
    output: the question whether the output is on, answered 1 or 0, ON or OFF; with output_bit, a hexadecimal
    status word, in which the bit of channel 1 is output_bit, and that of channel 2 the next.
    trip: the question whether a protection tripped, answered 1 or 0, YES or NO; empty where there is none.
    query_delay_s: to wait between a question and reading its answer.
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
    trip: str = ""
    errors: str = "SYST:ERR?"
    query_delay_s: float = 0.0


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

KEYSIGHT_E364X = Profile(
    "keysight-e364x",  # and E3632A
    protect=("CURR:PROT:CLE", "CURR:PROT:STAT ON"),
    trip="CURR:PROT:TRIP?",
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
    trip=":OUTP:OCP:QUES?",
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
    trip="VOLT:PROT:TRIP?",
)

PROFILES = (GENERIC, KEYSIGHT_E36312A, KEYSIGHT_E364X, RIGOL_DP800, SIGLENT_SPD, ROHDE_SCHWARZ_HMP)
