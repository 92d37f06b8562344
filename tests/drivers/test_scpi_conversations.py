"""Emulated SCPI supplies answer as their manuals describe.

The emulated coil has 4 ohm, and the emulated supply accepts at most 5 A and 30 V. Every answer depends on the messages
before.
"""

from __future__ import annotations

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.serve import emulate
from eimi_drivers.emulators.supply import CoilSupply
from tests.drivers.conversations import SETTLE, TRIP, Conversation, InPieces, hold

NO_ERROR = '0,"No error"'
OUT_OF_RANGE = '-222,"Data out of range"'

KEITHLEY_2200: Conversation = [
    ("VOLT:PROT?", "33.000"),
    ("VOLT:PROT:STAT?", "0"),
    ("VOLT:PROT 13.2", ""),
    ("VOLT:PROT:STAT 1", ""),
    ("VOLT:PROT?", "13.200"),
    ("VOLT:PROT:STAT?", "1"),
    ("OUTP:TIM?", "0"),
    ("OUTP:TIM:DEL?", "60.00"),
    ("OUTP:TIM:DEL 0.009", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("OUTP:TIM:DEL 60000", ""),
    ("OUTP:TIM:DEL?", "60000.00"),
    ("OUTP:TIM:DEL 60001", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("OUTP:TIM 1", ""),
    ("OUTP:TIM?", "1"),
    ("OUTP:TIM 2", ""),
    ("SYST:ERR?", '-104,"Data type error"'),
    ("SYST:ERR?", NO_ERROR),
]

KEITHLEY_2260B: Conversation = [
    ("VOLT:PROT?", "+33.000"),
    ("VOLT:PROT 2.99", ""),  # below a tenth of 30 V
    ("SYST:ERR?", OUT_OF_RANGE),
    ("VOLT:PROT 3", ""),
    ("VOLT:PROT?", "+3.000"),
    ("CURR:PROT?", "+5.500"),
    ("CURR:PROT 5", ""),  # below a tenth of 72 A
    ("SYST:ERR?", OUT_OF_RANGE),
    ("CURR:PROT:STAT?", "1"),
    ("CURR:PROT:STAT 0", ""),
    ("CURR:PROT:STAT?", "0"),
    ("STAT:QUES:COND?", "+0"),
    ("APPL 2.5,0.7", ""),
    ("APPL?", "+2.5000, +0.7000"),
    ("APPL 2.5,5.1", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("OUTP 1", ""),
    (SETTLE, ""),
    ("MEAS:POW?", "1.562500E+00"),
    (TRIP, ""),
    ("STAT:QUES:COND?", "+2048"),
    ("OUTP:PROT:CLE", ""),
    ("STAT:QUES:COND?", "+0"),
    ("VOLT 4", ""),
    ("CURR 1", ""),
    ("OUTP 1", ""),
    (SETTLE, ""),
    ("STAT:QUES:COND?", "+0"),
    ("OUTP?", "0"),  # over-voltage
    ("STAT:QUES:COND?", "+1"),
]

DELTA: Conversation = [
    ("*IDN?", "DELTA ELEKTRONIKA B.V.,SM70-CP-450,EMULATED,P0110"),
    ("SYSTEM:REMOTE:CV?", "Front"),
    ("SYS:REM:CC:STA?", "Front"),
    ("SOURCE:VOLTAGE 12", ""),
    ("SOU:VOL?", "12.0000"),
    ("SYST:REM:CV REM", ""),
    ("SYST:REM:CV?", "Ethernet"),
    ("SYST:REM:CC ETH", ""),
    ("SYST:REM:CC?", "Ethernet"),
    ("SYST:REM:CC RE", ""),  # too short
    ("SYST:ERR?", OUT_OF_RANGE),
    ("SYST:REM:CC WEB", ""),
    ("SYST:REM:CC?", "Web"),
    ("SYST:REM:CC REMOTE", ""),
    ("SOURCE:CURRENT 0.7", ""),
    ("SOU:CUR?", "0.7000"),
    ("SOU:CUR:MAX?", "5"),
    ("SOU:VOL:MAX?", "30"),
    ("OUTPUT 1", ""),
    (SETTLE, ""),
    ("OUTP?", "1"),
    ("MEA:CUR?", "0.7000"),
    ("MEASURE:VOLTAGE?", "2.8000"),
    ("SYST:LIM:VOL?", "30.0000,ON"),
    ("SYST:LIM:VOL 13.2,ON", ""),
    ("SYST:LIM:VOL?", "13.2000,ON"),
    ("SOU:VOL 13.3", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("SYST:LIM:VOL 13.2,OFF", ""),
    ("SYST:LIM:VOL?", "13.2000,OFF"),
    ("SOU:VOL 13.3", ""),
    ("SOU:VOL?", "13.3000"),
    ("SYST:LIM:CUR 1.1,ON", ""),
    ("SYST:LIM:CUR?", "1.1000,ON"),
    ("SOU:CUR 1.2", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("SOU:CUR 1.1", ""),
    ("SOU:CUR?", "1.1000"),
    ("SYST:COM:WAT?", "-1"),
    ("SYST:COM:WAT SET,5000", ""),
    ("SYST:COM:WAT?", "5000"),
    ("SYST:COM:WAT SET,19", ""),
    ("SYST:COM:WAT SET,20", ""),
    ("SYST:COM:WAT SET,10001", ""),
    ("SYST:COM:WAT SET?", "20"),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("SYST:COM:WAT START", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("SYST:COM:WAT STOP", ""),
    ("SYST:COM:WAT?", "-1"),
    ("SO:VO?", ""),
    ("SYST:ERR?", '-113,"Undefined header"'),
    ("SYST:ERR?", "0,None"),
    ("OUTPUT 0", ""),
    ("OUTPUT?", "0"),
]

KEPCO: Conversation = [
    ("OUTP?", "1"),  # on after power-up
    ("FUNC:MODE?", "0"),
    ("CURR 0.5", ""),
    ("SYST:ERR?", '-221,"Settings conflict"'),
    ("FUNC:MODE CURR", ""),
    ("FUNC:MODE?", "1"),
    ("FUNC:MODE BOTH", ""),
    ("SYST:ERR?", '-104,"Data type error"'),
    ("VOLT:PROT:MODE?", "EXT"),
    ("VOLT:PROT:MODE FIX", ""),
    ("VOLT:PROT:MODE?", "FIX"),
    ("VOLT:PROT:MODE ANY", ""),
    ("SYST:ERR?", '-104,"Data type error"'),
    ("CURR:LIM:POS 0.7", ""),
    ("CURR:LIM:POS?", "7.000E-01"),
    ("CURR:LIM:NEG?", "5.000E+00"),
    ("CURR:LIM:NEG 0.6", ""),
    ("CURR 0.71", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("CURR 0.7", ""),
    ("CURR -0.61", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("CURR?", "7.000000E-01"),
    ("CURR -0.6", ""),
    ("VOLT:PROT:POS 12", ""),
    ("VOLT:PROT:NEG 1.2", ""),
    ("VOLT:PROT:POS?", "1.200E+01"),
    ("VOLT:PROT:NEG?", "1.200E+00"),
    (SETTLE, ""),
    ("MEAS:CURR?", "-3.000000E-01"),  # the lower bound of the voltage limits the current
    ("MEAS:VOLT?", "-1.200000E+00"),
    ("VOLT:PROT:NEG -1", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("VOLT:PROT:NEG?", "1.200E+00"),
    ("CURR:LIM:POS 5.1", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("SYST:ERR?", NO_ERROR),
]

HMP: Conversation = [
    ("INST?", "OUTP2"),  # a channel without the coil
    ("VOLT 5", ""),
    ("SYST:ERR?", '-241,"Hardware missing"'),
    ("INST OUT1", ""),
    ("INST?", "OUTP1"),
    ("INST OUTPUT1", ""),
    ("INST:NSEL?", "1"),
    ("VOLT:PROT:LEV?", "33.000"),
    ("APPL 5,0.5", ""),
    ("APPL?", "5.000,0.5000"),
    ("APPL 6", ""),
    ("APPL?", "6.000,0.5000"),
    ("OUTP:GEN?", "0"),
    ("OUTP ON", ""),
    ("OUTP:SEL?", "1"),
    ("OUTP?", "0"),  # the general switch is off
    ("OUTP:GEN 1", ""),
    ("OUTP:GEN?", "1"),
    ("OUTP?", "1"),
    ("OUTP:SEL OFF", ""),
    ("OUTP?", "0"),
    ("OUTP ON", ""),
    ("OUTP:GEN 0", ""),
    ("OUTP?", "0"),
    ("VOLT:PROT:TRIP?", "0"),
    (TRIP, ""),
    ("VOLT:PROT:TRIP?", "1"),
    ("INST OUTP5", ""),
    ("INST:NSEL?", "1"),
]

N6900: Conversation = [
    ("FUNC?", "VOLT"),
    ("CURR 0.7", ""),  # only a limit in voltage priority
    ("CURR?", "0.000000E+00"),
    ("OUTP 1", ""),
    ("FUNC CURRENT", ""),
    ("FUNC?", "CURR"),
    ("OUTP?", "0"),  # the change switches the output off
    ("CURR 0.7", ""),
    ("CURR?", "7.000000E-01"),
    ("VOLT:LIM 12", ""),
    ("VOLT:LIM?", "1.200000E+01"),
    ("FUNC CURR", ""),
    ("CURR?", "7.000000E-01"),  # nothing changed
    ("FUNC POWER", ""),
    ("SYST:ERR?", '-104,"Data type error"'),
    ("VOLT:PROT?", "3.600000E+01"),
    ("VOLT -1", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("OUTP:PROT:WDOG?", "0"),
    ("OUTP:PROT:WDOG:DEL?", "60"),
    ("OUTP:PROT:WDOG:DEL 0.9", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("OUTP:PROT:WDOG:DEL 3601", ""),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("OUTP:PROT:WDOG:DEL 3600", ""),
    ("OUTP:PROT:WDOG:DEL?", "3600"),
    ("OUTP:PROT:WDOG:DEL 1", ""),
    ("OUTP:PROT:WDOG:DEL?", "1"),
    ("OUTP:PROT:WDOG 1", ""),
    ("OUTP:PROT:WDOG?", "1"),
    ("STAT:QUES1:COND?", "0"),
    ("STAT:QUES2:COND?", "0"),
    ("CURR:PROT:STAT?", "0"),
    ("CURR:PROT:STAT 1", ""),
    ("CURR:PROT:STAT?", "1"),
    ("CURR:PROT:STAT 0", ""),
    ("OUTP 1", ""),
    ("OUTP?", "1"),
    (SETTLE, ""),  # longer than the watchdog's second
    ("STAT:QUES1:COND?", "2048"),
    ("OUTP?", "1"),  # still programmed as on
    ("OUTP 0", ""),
    ("OUTP?", "0"),
    ("OUTP:PROT:CLE", ""),
    ("STAT:QUES1:COND?", "0"),
    ("OUTP?", "0"),
    ("SYST:ERR?", NO_ERROR),
]

E3631A: Conversation = [
    ("INST?", "P25V"),
    ("INST P6V", ""),
    ("INST:NSEL?", "1"),
    ("APPL P6V,5,0.5", ""),
    ("APPL?", '"5.000000,0.500000"'),
    ("APPL? P6V", '"5.000000,0.500000"'),
    ("OUTP:TRAC?", "0"),
    ("OUTP:TRAC ON", ""),
    ("OUTP:TRAC?", "1"),
    ("OUTP ON", ""),
    (SETTLE, ""),
    ("MEAS:CURR? P6V", "5.000000E-01"),
    ("MEAS:VOLT? P6V", "2.000000E+00"),
    ("*RST", ""),
    ("OUTP?", "0"),
    ("OUTP:TRAC?", "0"),
    ("APPL?", '"0.000000,5.000000"'),  # table 4-1: the +6 V output is reset to 5 A
]

RIGOL: Conversation = [
    (":INST?", "CH2"),
    (":INST CH1", ""),
    (":INST:NSEL?", "1"),
    (":APPL CH1,5,0.5", ""),
    (":APPL?", "CH1,5.000,0.5000"),
    (":OUTP:OVP?", "OFF"),
    (":OUTP:OVP:VAL?", "30.0000"),
    (":OUTP:OVP:VAL 33.1", ""),
    (":SYST:ERR?", OUT_OF_RANGE),
    (":OUTP:OVP:VAL 33", ""),
    (":OUTP:OVP ON", ""),
    (":OUTP:OVP?", "ON"),
    (":OUTP:OCP?", "OFF"),
    (":CURR:PROT 1", ""),
    (":OUTP:OCP:VAL?", "1.0000"),
    (":OUTP ON", ""),
    (":OUTP? CH1", "ON"),
    (":OUTP? CH3", ""),
    (":SYST:ERR?", '-241,"Hardware missing"'),
    (":OUTP:MODE?", "CC"),
    (":SOUR1:VOLT 1", ""),
    (":OUTP:MODE?", "CV"),
    (":OUTP CH1,OFF", ""),
    (":OUTP?", "OFF"),
    (":OUTP:OVP:QUES?", "NO"),
    (TRIP, ""),
    (":OUTP:OVP:QUES?", "YES"),
    ("*RST", ""),
    (":APPL?", "CH1,0.000,3.0000"),
    (":OUTP:OVP:QUES?", "NO"),
]

SIGLENT: Conversation = [
    ("INST?", "CH1"),
    ("CH1:VOLT 5", ""),
    ("CH1:CURR 0.5", ""),
    ("CH1:VOLT?", "5.000000E+00"),
    ("CH2:VOLT?", ""),
    ("SYST:ERR?", '-241,"Hardware missing"'),
    ("VOLT?", ""),
    ("SYST:ERR?", '-109,"Missing parameter"'),
    ("SYST:STAT?", "0x5"),
    ("OUTP CH1,ON", ""),
    ("SYST:STAT?", "0x15"),
    ("CH1:VOLT 1", ""),
    ("SYST:STAT?", "0x14"),  # constant voltage
    (SETTLE, ""),
    ("MEAS:CURR? CH1", "2.500000E-01"),
    ("OUTP CH1,OFF", ""),
    ("SYST:STAT?", "0x4"),
    ("SYST:ERR?", "0  No Error"),
]

SCPI: Conversation = [
    ("*IDN?", "EIMI,EMULATED SUPPLY,0,1.0"),
    ("VOLT 5;CURR 0.5;VOLT?;CURR?", "5.000000E+00;5.000000E-01"),
    ("VOLT? MAX", "3.000000E+01"),
    ("CURR? MAX", "5.000000E+00"),
    ("VOLT? MIN", "0.000000E+00"),
    ("*OPC?", "1"),
    ("*TST?", "0"),
    ("SYST:VERS?", "1999.0"),
    ("SYST:BEEP", ""),
    ("SYST:RWL", ""),
    ("OUTP 1", ""),
    (SETTLE, ""),
    ("MEAS:POWE?", "1.000000E+00"),
    ("OUTP MAYBE", ""),
    ("VOLT five", ""),
    ("*CLS", ""),
    ("SYST:ERR?", NO_ERROR),
    ("OUTP MAYBE", ""),
    ("VOLT 31", ""),
    ("SYST:ERR?", '-104,"Data type error"'),
    ("SYST:ERR?", OUT_OF_RANGE),
    ("SYST:ERR?", NO_ERROR),
    ("*RST", ""),
    ("OUTP?", "0"),
    ("VOLT?;CURR?", "0.000000E+00;0.000000E+00"),
]

CONVERSATIONS = {
    "keithley-2200": KEITHLEY_2200,
    "keithley-2260b": KEITHLEY_2260B,
    "delta-sm15k": DELTA,
    "kepco-bop": KEPCO,
    "rs-hmp": HMP,
    "keysight-n6900": N6900,
    "keysight-e3631a": E3631A,
    "rigol-dp800": RIGOL,
    "siglent-spd": SIGLENT,
    "scpi": SCPI,
}


@pytest.mark.parametrize("dialect", CONVERSATIONS)
def test_a_conversation_follows_the_manual(dialect: str) -> None:
    coil = CoilSupply(SimulatedClock())
    hold(CONVERSATIONS[dialect], dialect, emulate(dialect, coil), coil)


@pytest.mark.parametrize("dialect", CONVERSATIONS)
def test_a_message_may_arrive_in_pieces(dialect: str) -> None:
    coil = CoilSupply(SimulatedClock())
    hold(CONVERSATIONS[dialect], dialect, InPieces(emulate(dialect, coil)), coil)
