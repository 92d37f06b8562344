"""The messages of all families of SCPI supplies, each family as a `Profile`."""

from __future__ import annotations

from dataclasses import replace

from eimi_drivers.supplies.profile import Profile, Register, Watchdog

GENERIC = Profile("scpi")

OVER_VOLTAGE = "over-voltage protection 10 % above the limit"
OVER_BOTH = "over-voltage and over-current protection 10 % above the limits"

OVER_VOLTAGE_TRIPPED = "over-voltage protection tripped"
OVER_CURRENT_TRIPPED = "over-current protection tripped"
MAINS_FAILED, TOO_HOT = "the mains failed", "the supply is too hot"
INHIBITED = "the output was inhibited at the rear connector of the supply"

KEYSIGHT_WATCHDOG = Watchdog(
    arm=("OUTP:PROT:WDOG:DEL {seconds}", "OUTP:PROT:WDOG 1"),
    verify=(("OUTP:PROT:WDOG:DEL?", None), ("OUTP:PROT:WDOG?", 1)),
    disarm="OUTP:PROT:WDOG 0",
)

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
    registers=(
        Register(
            "STAT:QUES:COND? (@{channel})",
            (
                *((1, OVER_VOLTAGE_TRIPPED), (2, OVER_CURRENT_TRIPPED), (4, MAINS_FAILED), (16, TOO_HOT)),
                (64, "negative over-voltage protection tripped"),
                (512, INHIBITED),
                (2048, "the watchdog, or a protection of another channel, switched the output off"),
                (4096, "the oscillation detector tripped"),
            ),
        ),
    ),
    watchdog=KEYSIGHT_WATCHDOG,
)

_N6900_TRIPS = (
    *((1, OVER_VOLTAGE_TRIPPED), (2, OVER_CURRENT_TRIPPED), (4, MAINS_FAILED), (16, TOO_HOT)),
    (8, "the limit of positive power switched the output off"),
    (32, "the limit of negative power switched the output off"),
    (64, "the sense leads are reversed"),
    (512, INHIBITED),
    (2048, "the watchdog of the supply switched the output off"),
    (4096, "the protection against excessive dynamics tripped"),
)

KEYSIGHT_N6900 = Profile(
    # Keysight N6900/N7900 Operating and Service Guide: protections page 251, watchdog page 252, status bits pages 286
    # and 287. In current priority (FUNC CURR) the supply regulates the current, and VOLT:LIM limits the voltage; the
    # pages about both were not available. A change of the priority switches the output off, so that the driver first
    # asks for it. Clearing a protection restores the output, so that the output is switched off first. The offset of
    # the meter is assumed.
    "keysight-n6900",
    modes=(("FUNC?", "CURR", "FUNC CURR"),),
    set_voltage="VOLT:LIM {value}",
    voltage_set="VOLT:LIM?",
    protect=("OUTP 0", "OUTP:PROT:CLE", "CURR:PROT:STAT 0", "VOLT:PROT {voltage}"),
    armed=(("CURR:PROT:STAT?", "0"), ("VOLT:PROT?", "{voltage}")),
    protections=OVER_VOLTAGE,
    registers=(
        Register("STAT:QUES1:COND?", _N6900_TRIPS),
        Register(
            "STAT:QUES2:COND?",
            (
                (1, "a protection that the user of the supply defined switched the output off"),
                (8, "current sharing failed"),
            ),
        ),
    ),
    watchdog=KEYSIGHT_WATCHDOG,
    reads_zero_within_A=0.05,
)

KEYSIGHT_RP7900 = replace(
    # Keysight RP7900 Operating and Service Guide: status bits pages 241 and 242; otherwise as the N6900.
    KEYSIGHT_N6900,
    driver="keysight-rp7900",
    registers=(
        Register("STAT:QUES1:COND?", _N6900_TRIPS),
        Register(
            "STAT:QUES2:COND?",
            (
                *(
                    (8, "current sharing failed"),
                    (16, "another supply of the group of parallel supplies switched the output off"),
                ),
                (32, "the safety disconnect system switched the output off"),
                (64, "under-voltage protection tripped"),
            ),
        ),
    ),
    reads_zero_within_A=0.1,
)

# On RS-232 the E363x and E364x have 2 stop bits and must be sent SYST:REM before other messages: Keysight E3631A User's
# Guide (E3631-90002, edition 10), pages 72, 75 and 108. Of the other models only the command was looked up.
KEYSIGHT_E3631A = Profile(
    # Agilent E3631A User's Guide (E3631-90002, October 2007): ranges page 72, selection page 74, outputs page 77. One
    # switch serves all outputs. Disabled outputs carry up to 60 mA in the opposite direction through a short circuit
    # (page 77). Output 3 is negative and is not supported. The supply has no protection with a level.
    "keysight-e3631a",
    channels=(1, 2),
    stop_bits=2,
    remote="SYST:REM",
    select="INST:NSEL {channel}",
    on=("OUTP ON",),
    off=("OUTP OFF",),
    reads_zero_within_A=0.06,
)

KEYSIGHT_E364X = Profile(
    "keysight-e364x",  # E3640A to E3649A have no CURR:PROT (Agilent E3640-90001, pages 80 and 81)
    stop_bits=2,
    remote="SYST:REM",
    protect=("VOLT:PROT:CLE", "VOLT:PROT {voltage}", "VOLT:PROT:STAT ON"),
    armed=(("VOLT:PROT?", "{voltage}"), ("VOLT:PROT:STAT?", "1")),
    protections=OVER_VOLTAGE,
    trip=("VOLT:PROT:TRIP?",),
)

KEYSIGHT_E3632A = Profile(
    "keysight-e3632a",  # E3632A to E3634A (Keysight E3632A User's Guide, pages 87 to 91)
    stop_bits=2,
    remote="SYST:REM",
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

KEITHLEY_2200 = Profile(
    # Keithley Series 2200 (one channel) Reference Manual, 2200S-901-01: over-voltage protection pages 4-24 and 4-25
    # (Rev. C), output timer pages 4-21 and 4-22 (Rev. C; 4-23 and 4-24 in Rev. A). The timer is no watchdog: it counts
    # from switching on, messages do not restart it, and it must be started before the output is switched on. The page
    # of the status registers was not available; a trip is noticed because the output is off.
    "keithley-2200",
    protect=("OUTP 0", "OUTP:PROT:CLE", "VOLT:PROT {voltage}", "VOLT:PROT:STAT 1"),
    armed=(("VOLT:PROT?", "{voltage}"), ("VOLT:PROT:STAT?", "1")),
    protections=OVER_VOLTAGE,
    watchdog=Watchdog(
        arm=("OUTP:TIM:DEL {seconds}", "OUTP:TIM 1"),
        verify=(("OUTP:TIM:DEL?", None), ("OUTP:TIM?", 1)),
        disarm="OUTP:TIM 0",
        seconds=14400,
        effect="the supply's timer switches the output off {seconds} s after it was switched on, also during a run",
    ),
)

KEITHLEY_2260B = Profile(
    # Keithley 2260B Reference Manual, page 57 (CURR:PROT:STAT). The 2260B is a GW Instek PSW. Its other commands and
    # its status register are those of the GW Instek PSU: manual pages 103 (VOLT:PROT), 107 (register). The over-current
    # protection cannot be set below 10 % of the rating and is switched off. Socket: TCP port 2268. The offset of the
    # meter, 0.1 % of 72 A, is assumed.
    "keithley-2260b",
    protect=("OUTP 0", "OUTP:PROT:CLE", "CURR:PROT:STAT 0", "VOLT:PROT {voltage}"),
    armed=(("CURR:PROT:STAT?", "0"), ("VOLT:PROT?", "{voltage}")),
    protections=OVER_VOLTAGE,
    registers=(
        Register(
            "STAT:QUES:COND?",
            (
                *((1, OVER_VOLTAGE_TRIPPED), (2, OVER_CURRENT_TRIPPED), (16, TOO_HOT)),
                *((8, "the power switch is off"), (2048, "the supply was shut off at its rear connector")),
            ),
        ),
    ),
    reads_zero_within_A=0.072,
)

DELTA_SM15K = Profile(
    # Delta Elektronika, Ethernet & Sequencer Programming SM15K (rev. Aug. 2019): set-points page 9, limits page 13,
    # programming source pages 14 and 15, errors page 15, watchdog page 16, output page 17. TCP port 8462. Its limits
    # bound the set-points; the levels of its protections cannot be set. The offset of the meter is assumed.
    "delta-sm15k",
    modes=(
        ("SYSTEM:REMOTE:CV?", "REM|ETH", "SYSTEM:REMOTE:CV REMOTE"),
        ("SYSTEM:REMOTE:CC?", "REM|ETH", "SYSTEM:REMOTE:CC REMOTE"),
    ),
    set_voltage="SOURCE:VOLTAGE {value}",
    voltage_set="SOURCE:VOLTAGE?",
    set_current="SOURCE:CURRENT {value}",
    current_set="SOURCE:CURRENT?",
    measure_voltage="MEASURE:VOLTAGE?",
    measure_current="MEASURE:CURRENT?",
    protect=("SYSTEM:LIMITS:VOLTAGE {voltage},ON", "SYSTEM:LIMITS:CURRENT {current},ON"),
    armed=(("SYSTEM:LIMITS:VOLTAGE?", "{voltage}"), ("SYSTEM:LIMITS:CURRENT?", "{current}")),
    protections="limits of the supply's set-points 10 % above the limits of the run",
    on=("OUTPUT 1",),
    off=("OUTPUT 0",),
    output="OUTPUT?",
    errors="SYSTEM:ERROR?",
    watchdog=Watchdog(
        arm=("SYSTEM:COMMUNICATE:WATCHDOG SET,10000",),
        verify=(("SYSTEM:COMMUNICATE:WATCHDOG SET?", 10000),),
        disarm="SYSTEM:COMMUNICATE:WATCHDOG STOP",
        expired=("SYSTEM:COMMUNICATE:WATCHDOG?", 0),
    ),
    reads_zero_within_A=0.1,
)

DELTA_PSC_ETH = replace(
    # Delta Elektronika PSC-ETH and PSC-ETH-2, the Ethernet cards of the SM series. Their manuals were not available.
    # The set-points and the programming source are taken from drivers of other projects (labtoys, bliss). The watchdog
    # is the watchdog of the SM15K. A card without this watchdog reports an error, and the output stays off.
    DELTA_SM15K,
    driver="delta-psc-eth",
    protect=(),
    armed=(),
    protections="",
    reads_zero_within_A=0.05,
)

PROFILES = (
    *(GENERIC, KEYSIGHT_E36312A, KEYSIGHT_N6700, KEYSIGHT_E3631A, KEYSIGHT_E3632A, KEYSIGHT_E364X),
    *(RIGOL_DP800, SIGLENT_SPD, ROHDE_SCHWARZ_HMP, KEYSIGHT_N6900, KEYSIGHT_RP7900),
    *(KEITHLEY_2200, KEITHLEY_2260B, DELTA_SM15K, DELTA_PSC_ETH),
)
"""The profiles of the families whose drivers `scpi_driver` makes from the profile alone."""
