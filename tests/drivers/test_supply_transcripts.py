"""Every supply driver sends exactly the messages in its transcript (`tests.shared.supply_transcripts`)."""

from __future__ import annotations

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.interfaces import Limits, Reading
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.aim_tti import SERIES
from eimi_drivers.supplies.transport import InProcessTransport
from tests.shared.supply_transcripts import AIM_TTI_TRANSCRIPTS, TRANSCRIPTS, Transcript


def open_on(transcript: Transcript, driver: str, address: str = "somewhere"):
    clock = SimulatedClock()
    return SUPPLIES[driver](InProcessTransport(transcript, clock, address), Limits(1.0, 12.0), clock)


def test_every_driver_has_a_transcript():
    assert set(TRANSCRIPTS) == set(SUPPLIES)


def test_every_series_of_aim_tti_has_a_transcript():
    assert set(AIM_TTI_TRANSCRIPTS) == set(SERIES)


@pytest.mark.parametrize(
    ("driver", "transcript"),
    [
        *((driver, Transcript(*row)) for driver, row in TRANSCRIPTS.items()),
        *(("aim-tti", Transcript(exchanges, "\n", "\r\n")) for exchanges in AIM_TTI_TRANSCRIPTS.values()),
    ],
    ids=[*TRANSCRIPTS, *(f"aim-tti {series}" for series in AIM_TTI_TRANSCRIPTS)],
)
def test_a_run_sends_exactly_these_messages(driver, transcript):
    supply = open_on(transcript, driver)
    supply.identify()
    supply.set_voltage(12.0)
    supply.set_current(0.7)
    supply.set_output(True)
    assert supply.measure() == Reading(0.699, 2.8)
    supply.check()
    supply.safe_off()
    transcript.assert_complete()


@pytest.mark.parametrize(
    ("driver", "address", "exchanges", "end"),
    [
        ("keysight-e36312a", "somewhere#2", [("MEAS:CURR? (@2)", "0.5"), ("MEAS:VOLT? (@2)", "2.0")], "\n"),
        (
            "rigol-dp800",
            "somewhere#3",
            [(":INST:NSEL 3", ""), (":MEAS:CURR?", "0.5"), (":INST:NSEL 3", ""), (":MEAS:VOLT?", "2.0")],
            "\n",
        ),
        ("siglent-spd", "somewhere#2", [("MEAS:CURR? CH2", "0.5"), ("MEAS:VOLT? CH2", "2.0")], "\n"),
        ("genesys", "somewhere#0", [("ADR 0", "OK"), ("RMT REM", "OK"), ("MC?", "0.5"), ("MV?", "2.0")], "\r"),
    ],
)
def test_the_channel_comes_from_the_address(driver, address, exchanges, end):
    transcript = Transcript(exchanges, end, end)
    assert open_on(transcript, driver, address).measure() == Reading(0.5, 2.0)
    transcript.assert_complete()


@pytest.mark.parametrize(("status", "on"), [("0x25", True), ("0x15", False), ("30", True), ("0x4", False)])
def test_the_status_word_of_a_siglent_has_a_bit_for_each_channel(status, on):
    transcript = Transcript([("SYST:STAT?", status)], "\n", "\n")
    assert open_on(transcript, "siglent-spd", "somewhere#2").output_on() is on
