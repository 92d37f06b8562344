"""The tables in the drivers agree with tables that this file copies from manuals and standards."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest

from eimi_drivers.cameras.aravis_library import BUFFER_STATUS
from eimi_drivers.cameras.basler import PIXEL_FORMATS as BASLER_FORMATS
from eimi_drivers.cameras.pixel_formats import GREY_BY_DEPTH, PIXEL_FORMATS, choose_format, depth_of
from eimi_drivers.clock import SimulatedClock
from eimi_drivers.discovery import BOARD_USB_VENDORS, KORAD_USB_IDS, SENSOR_USB_IDS
from eimi_drivers.emulators import hislip
from eimi_drivers.emulators.serve import DIALECTS, emulate
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import InstrumentError, Limits
from eimi_drivers.sensors import fw_bell, lake_shore
from eimi_drivers.supplies import SUPPLIES, recognised
from eimi_drivers.supplies.off import LEAST_OFF_A, off_limit_A
from eimi_drivers.supplies.recognised import recognise
from eimi_drivers.supplies.scpi_profiles import PROFILES
from eimi_drivers.supplies.transport import InProcessTransport


@dataclass(frozen=True)
class Family:
    # The numbers in the manual of one family of supplies.
    # channels : lowest and highest channel
    # off_A : largest measured current of a supply that is off
    # line : speed (bit/s) and stop bits of the serial line
    # watchdog_s : time of the watchdog (automatic switch-off); None without a watchdog
    # steps : smallest steps of current (A) and voltage (V)
    # bipolar : whether the supply accepts negative currents
    # query_delay_s : time that the driver waits before an answer

    channels: tuple[int, int] = (1, 1)
    off_A: float = LEAST_OFF_A
    line: tuple[int, int] = (9600, 1)
    watchdog_s: int | None = None
    steps: tuple[float, float] = (0.001, 0.01)
    bipolar: bool = False
    default_channel: int = 1
    query_delay_s: float = 0.0


FAMILIES = {
    "korad": Family(),
    "scpi": Family(),
    "keysight-e36312a": Family(channels=(1, 3)),
    "keysight-n6700": Family(channels=(1, 4), watchdog_s=10),  # four slots for modules
    "keysight-e3631a": Family(channels=(1, 2), off_A=0.06, line=(9600, 2)),  # User's Guide, pages 72 to 77
    "keysight-e3632a": Family(line=(9600, 2)),
    "keysight-e364x": Family(line=(9600, 2)),
    "rigol-dp800": Family(channels=(1, 3)),
    "siglent-spd": Family(channels=(1, 2), query_delay_s=0.01),
    "rs-hmp": Family(channels=(1, 4)),
    "keysight-n6900": Family(off_A=0.05, watchdog_s=10),
    "keysight-rp7900": Family(off_A=0.1, watchdog_s=10),
    "keithley-2200": Family(watchdog_s=14400),
    "keithley-2260b": Family(off_A=0.072),  # 0.1 % of 72 A
    "delta-sm15k": Family(off_A=0.1, watchdog_s=10),
    "delta-psc-eth": Family(off_A=0.05, watchdog_s=10),
    "genesys": Family(channels=(0, 30), default_channel=6, off_A=0.003 * 50.0, steps=(0.01, 0.01)),  # 0.3 % of 50 A
    "kepco-bop": Family(off_A=0.05, steps=(0.01, 0.01), bipolar=True),
    "kepco-bit4886": Family(off_A=0.05, steps=(0.01, 0.01), bipolar=True),
    "aim-tti": Family(channels=(1, 3), steps=(0.01, 0.01)),
    "bk-xln": Family(off_A=0.04, line=(57600, 1), steps=(0.01, 0.01)),
    "owon-spe": Family(line=(115200, 1)),
}


@pytest.mark.parametrize("driver", SUPPLIES)
def test_the_numbers_of_every_family_are_those_of_its_manual(driver: str) -> None:
    expected = FAMILIES[driver]
    kind = SUPPLIES[driver]
    assert (kind.channels, kind.default_channel, kind.bipolar) == (
        expected.channels,
        expected.default_channel,
        expected.bipolar,
    )
    assert (float(kind.current_step_A), float(kind.voltage_step_V)) == expected.steps
    profile = getattr(kind, "profile", None)
    if profile is not None:
        assert (profile.baud_rate, profile.stop_bits) == expected.line
        assert profile.query_delay_s == expected.query_delay_s
        assert (profile.watchdog.seconds if profile.watchdog else None) == expected.watchdog_s
    clock = SimulatedClock()
    limits = Limits(1.0, 10.0)
    supply = kind(InProcessTransport(emulate(driver, CoilSupply(clock)), clock), limits, clock)
    supply.identify()
    assert off_limit_A(supply) == pytest.approx(expected.off_A)


@pytest.mark.parametrize("driver", SUPPLIES)
def test_a_channel_that_the_family_does_not_have_is_refused(driver: str) -> None:
    first, last = FAMILIES[driver].channels
    clock = SimulatedClock()

    def opened(channel: int) -> object:
        link = InProcessTransport(emulate(driver, CoilSupply(clock)), clock, f"memory#{channel}")
        return SUPPLIES[driver](link, Limits(1.0, 10.0), clock)

    for channel in (first, last):
        assert opened(channel) is not None
    for channel in {first - 1, last + 1} - {-1}:
        with pytest.raises(
            InstrumentError, match=f"there is no channel {channel}; {driver} has the channels {first} to {last}"
        ):
            opened(channel)


def test_every_profile_that_arms_a_protection_reads_it_back() -> None:
    for profile in PROFILES:
        queries = {question for question, _ in profile.armed}
        for message in profile.protect:
            command, _, value = message.partition(" ")
            if value in ("{voltage}", "{current}", "ON", "1") and not command.startswith("OUTP "):
                assert f"{command}?" in queries, (profile.driver, message)
        expected = {question: answer for question, answer in profile.armed}
        for message in profile.protect:
            command, _, value = message.partition(" ")
            if f"{command}?" in expected:
                assert expected[f"{command}?"] == {"ON": "1"}.get(value, value.removesuffix(",ON")), profile.driver
        assert bool(profile.armed) == bool(profile.protections), profile.driver


IDENTITIES = {  # identifications as the manuals print them, and the TCP port on which the family serves its messages
    "THURLBY THANDAR, QL355TP, 0, 1.00": ("aim-tti", 9221),
    "THURLBY THANDAR, MX100TP, 0, 1.00": ("aim-tti", 9221),
    "THURLBY THANDAR, QPX1200SP, 0, 1.00": ("aim-tti", 9221),
    "THURLBY THANDAR, CPX400DP, 0, 1.00": ("aim-tti", 9221),
    "KEITHLEY,2260B-30-72,1403278,01.80": ("keithley-2260b", 2268),
    "Keithley instruments, 2200-32-3, 9014, 1.10-1.04": ("keithley-2200", 0),
    "KEYSIGHT TECHNOLOGIES,E36311A,MY1,1.0": ("keysight-e36312a", 5025),
    "KEYSIGHT TECHNOLOGIES,E36312A,MY1,1.0": ("keysight-e36312a", 5025),
    "KEYSIGHT TECHNOLOGIES,E36313A,MY1,1.0": ("keysight-e36312a", 5025),
    "AGILENT TECHNOLOGIES,N6700B,MY1,D.01": ("keysight-n6700", 5025),
    "KEYSIGHT TECHNOLOGIES,N6701C,MY1,D.01": ("keysight-n6700", 5025),
    "KEYSIGHT TECHNOLOGIES,N6900A,MY1,A.01": ("keysight-n6900", 5025),
    "KEYSIGHT TECHNOLOGIES,N7951A,MY1,A.01": ("keysight-n6900", 5025),
    "KEYSIGHT TECHNOLOGIES,RP7931A,MY1,A.01": ("keysight-rp7900", 5025),
    "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0": ("keysight-e3631a", 0),
    "HEWLETT-PACKARD,E3632A,0,1.1-5.0-1.0": ("keysight-e3632a", 0),
    "HEWLETT-PACKARD,E3633A,0,1.1-5.0-1.0": ("keysight-e3632a", 0),
    "HEWLETT-PACKARD,E3634A,0,1.1-5.0-1.0": ("keysight-e3632a", 0),
    "Agilent Technologies,E3640A,0,1.4-5.0-1.0": ("keysight-e364x", 0),
    "Agilent Technologies,E3645A,0,1.4-5.0-1.0": ("keysight-e364x", 0),
    "RIGOL TECHNOLOGIES,DP832A,DP8A1,00.01.14": ("rigol-dp800", 5555),
    "Siglent Technologies,SPD3303X-E,SPD3,1.01": ("siglent-spd", 5025),
    "ROHDE&SCHWARZ,HMP4040,103781,HW50020001/SW2.62": ("rs-hmp", 5025),
    "DELTA ELEKTRONIKA BV,SM500-CP-90,000001,H0": ("delta-sm15k", 8462),
    "DELTA ELEKTRONIKA BV,SM 66-AR-110,PSC-ETH": ("delta-psc-eth", 8462),
    "KEPCO,BIT 4886 20-20M,H1,1.0": ("kepco-bit4886", 0),
    "KEPCO,BIT4886 20-20M,H1,1.0": ("kepco-bit4886", 0),
    "KEPCO,BOP 1KW 20-50,H1,1.0": ("kepco-bop", 0),
    "B&K PRECISION,XLN3640,1,1.0": ("bk-xln", 0),
    "OWON,SPE6103,2236,FV:V3.9.0": ("owon-spe", 0),
    "OWON,SPM3103,2236,FV:V3.9.0": ("owon-spe", 0),
    "KIPRIM,DC310S,2236,FV:V3.9.0": ("owon-spe", 0),
    "LAMBDA,GEN40-38": ("genesys", 0),
    "TDK-LAMBDA,GENH30-25-LAN": ("genesys", 0),
    "KORADKA3005PV2.0": ("korad", 0),
    "TENMA 72-2540 V2.1": ("korad", 0),
    "VELLEMANLABPS3005DV2.0": ("korad", 0),
    "RND 320-KA3005P V2.0": ("korad", 0),
}


def test_every_model_is_recognised() -> None:
    assert {text: (found.driver, found.port) for text in IDENTITIES if (found := recognise(text))} == IDENTITIES
    assert recognise("Agilent Technologies,E3646A,0,1.4-5.0-1.0") is None  # it has two outputs
    assert {known.driver for _, known in recognised.MODELS} == {driver for driver, _ in IDENTITIES.values()}
    assert {driver for driver, _ in IDENTITIES.values()} == SUPPLIES.keys() - {"scpi"} == DIALECTS.keys() - {"scpi"}


# GenICam Pixel Format Naming Convention, values of the formats (PFNC.h)
FORMATS = {
    **{0x01080001: "Mono8", 0x01100003: "Mono10", 0x010C0004: "Mono10Packed", 0x010A0046: "Mono10p"},
    **{0x01100005: "Mono12", 0x010C0006: "Mono12Packed", 0x010C0047: "Mono12p"},
    **{0x01100025: "Mono14", 0x01100007: "Mono16", 0x02180014: "RGB8", 0x02180015: "BGR8"},
    **{0x01080008: "BayerGR8", 0x01080009: "BayerRG8", 0x0108000A: "BayerGB8", 0x0108000B: "BayerBG8"},
    **{0x0110000C: "BayerGR10", 0x0110000D: "BayerRG10", 0x0110000E: "BayerGB10", 0x0110000F: "BayerBG10"},
    **{0x01100010: "BayerGR12", 0x01100011: "BayerRG12", 0x01100012: "BayerGB12", 0x01100013: "BayerBG12"},
    **{0x010C0026: "BayerGR10Packed", 0x010C0027: "BayerRG10Packed", 0x010C0028: "BayerGB10Packed"},
    **{0x010C0029: "BayerBG10Packed", 0x010C002A: "BayerGR12Packed", 0x010C002B: "BayerRG12Packed"},
    **{0x010C002C: "BayerGB12Packed", 0x010C002D: "BayerBG12Packed"},
    **{0x0110002E: "BayerGR16", 0x0110002F: "BayerRG16", 0x01100030: "BayerGB16", 0x01100031: "BayerBG16"},
    **{0x010A0052: "BayerBG10p", 0x010C0053: "BayerBG12p", 0x010A0054: "BayerGB10p", 0x010C0055: "BayerGB12p"},
    **{0x010A0056: "BayerGR10p", 0x010C0057: "BayerGR12p", 0x010A0058: "BayerRG10p", 0x010C0059: "BayerRG12p"},
}


def test_the_codes_of_the_pixel_formats_are_those_of_the_standard() -> None:
    assert {code: pixel_format.name for code, pixel_format in PIXEL_FORMATS.items()} == FORMATS
    for code, pixel_format in PIXEL_FORMATS.items():
        # Bits 16 to 23 of a code are the bits that a pixel occupies; an unpacked value takes whole bytes.
        occupied = (code >> 16) & 0xFF
        values = 3 if pixel_format.kind in ("RGB", "BGR") else 1
        whole_bytes = 8 * math.ceil(pixel_format.bits / 8)
        # The old packed formats put two values of 10 bits into three bytes.
        packed = {"": whole_bytes, "p": pixel_format.bits, "Packed": 12}[pixel_format.packing]
        assert occupied == values * packed, pixel_format.name
        assert pixel_format.bits == int("".join(c for c in pixel_format.name if c.isdigit()))
        assert depth_of(pixel_format.name) == pixel_format.bits
    assert depth_of("Coord3D_C16") is None


def test_the_smallest_grey_format_of_a_depth_is_chosen() -> None:
    grey = {name for name in FORMATS.values() if name.startswith("Mono")}
    assert sorted(name for names in GREY_BY_DEPTH.values() for name in names) == sorted(grey)
    size = {name: (code >> 16) & 0xFF for code, name in FORMATS.items()}
    for bits, names in GREY_BY_DEPTH.items():
        assert {depth_of(name) for name in names} == {bits}
        assert [size[name] for name in names] == sorted(size[name] for name in names)
        assert choose_format(None, bits, "Mono8", names[::-1]) == names[0]
    assert BASLER_FORMATS == {8: "Mono8", 10: "Mono10", 12: "Mono12", 16: "Mono16"}


def test_the_states_of_a_buffer_are_those_of_aravis() -> None:
    # Source: arvbuffer.h (ArvBufferStatus) of Aravis 0.8.
    assert {code: words.split()[0] for code, words in BUFFER_STATUS.items()} == {
        **{-1: "unknown", 0: "success", 1: "cleared", 2: "timeout", 3: "missing", 4: "wrong"},
        **{5: "size", 6: "still", 7: "aborted", 8: "payload"},
    }


def test_the_units_of_gaussmeters() -> None:
    # 1 T is 1000 mT and 1 G is 0.1 mT. In air, 1 Oe corresponds to 1 G, and 1 A/m to 4 pi 10^-7 T.
    assert fw_bell._MILLITESLA == {"G": 0.1, "T": 1000.0}
    # Model 425 User's Manual, UNIT: 1 gauss, 2 tesla, 3 oersted, 4 ampere per metre
    assert lake_shore.MILLITESLA.keys() == {"1", "2", "3", "4"}
    assert [lake_shore.MILLITESLA[code] for code in "1234"] == pytest.approx([0.1, 1000.0, 0.1, 4e-4 * math.pi])


def test_the_numbers_of_usb_devices() -> None:
    # Sources: usb.ids; for gaussmeters cp210x.c of Linux.
    assert {(0x0416, 0x5011)} == KORAD_USB_IDS
    assert SENSOR_USB_IDS == {(0x1FB9, 0x0401): "lakeshore-425", (0x1FB9, 0x0403): "lakeshore-475"}
    assert BOARD_USB_VENDORS == {
        **{0x2341: "Arduino", 0x2A03: "Arduino", 0x239A: "Adafruit", 0x1B4F: "SparkFun"},
        **{0x2E8A: "Raspberry Pi", 0x303A: "Espressif", 0x16C0: "Teensy"},
    }


LEVELS_AFTER_POWER_UP = {  # shares of the rated voltage and of the rated current; no entry: no protection is on
    **dict.fromkeys(["keysight-e36312a", "keysight-n6700", "keysight-e364x", "rs-hmp"], (1.1, math.inf)),
    **dict.fromkeys(["keysight-n6900", "keysight-rp7900"], (1.2, math.inf)),
    **dict.fromkeys(["keysight-e3632a", "aim-tti", "keithley-2260b"], (1.1, 1.1)),
    "owon-spe": (31.0 / 30.0, 5.1 / 5.0),  # 1 V and 0.1 A above the rating
}
HIGHEST_LEVELS = {  # the message that sets a level, and the highest level that the emulated supply accepts
    "keysight-e3632a": (b"CURR:PROT %.3f\n", 5.5),
    "keysight-e364x": (b"VOLT:PROT %.3f\n", 33.0),
    "keithley-2260b": (b"VOLT:PROT %.3f\n", 33.0),
    "owon-spe": (b"VOLT:LIM %.3f\n", 31.0),
}


@pytest.mark.parametrize("driver", DIALECTS)
def test_the_protections_of_every_emulated_supply_after_power_up(driver: str) -> None:
    coil = CoilSupply(SimulatedClock(), max_voltage_V=30.0, max_current_A=5.0)
    emulate(driver, coil)
    of_voltage, of_current = LEVELS_AFTER_POWER_UP.get(driver, (math.inf, math.inf))
    assert coil.state.trip_voltage_V == pytest.approx(30.0 * of_voltage)
    assert coil.state.trip_current_A == pytest.approx(5.0 * of_current)


@pytest.mark.parametrize("driver", HIGHEST_LEVELS)
def test_an_emulated_supply_accepts_levels_of_a_protection_up_to_its_highest(driver: str) -> None:
    message, highest = HIGHEST_LEVELS[driver]
    question = message.partition(b" ")[0] + b"?\n"
    instrument = emulate(driver, CoilSupply(SimulatedClock(), max_voltage_V=30.0, max_current_A=5.0))
    instrument.receive(message % (0.9 * highest))
    instrument.receive(message % (1.001 * highest))
    assert float(instrument.receive(question)) == pytest.approx(0.9 * highest, rel=1e-3)
    instrument.receive(message % highest)
    assert float(instrument.receive(question)) == pytest.approx(highest, rel=1e-3)


def test_the_types_of_messages_and_of_their_answers_are_those_of_hislip() -> None:
    # Source: standard IVI-6.1, table 4.
    assert (hislip.INITIALIZE, hislip.DATA, hislip.DATA_END) == (0, 6, 7)
    assert (hislip.ASYNC_MESSAGE_SIZE, hislip.ASYNC_INITIALIZE) == (15, 17)
    assert hislip.ANSWER_TO == {0: 1, 15: 16, 17: 18}


@pytest.mark.parametrize("driver", ["keysight-e36312a", "keysight-n6700"])
def test_an_emulated_over_current_protection_is_on_or_off(driver: str) -> None:
    instrument = emulate(driver, CoilSupply(SimulatedClock()))
    answers = []
    for state in (b"ON", b"OFF", b"1", b"0"):
        instrument.receive(b"CURR:PROT:STAT %s, (@1)\n" % state)
        answers.append(instrument.receive(b"CURR:PROT:STAT? (@1)\n"))
    assert answers == [b"1\n", b"0\n", b"1\n", b"0\n"]
