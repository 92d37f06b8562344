"""Interlocks: if a reading of the supply leaves the bounds in the rig file, the run ends with the coil off."""

from __future__ import annotations

from typing import Any

import pytest

from eimi_drivers.interfaces import InstrumentError
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import Event, InterlockOpened, OffConfirmed
from eimi_lab.acquisition.interlocks import BeyondInterlock, Interlocks
from eimi_lab.config.interlock import Interlock
from eimi_lab.config.rig import load_rig
from eimi_lab.process.errors import InputError
from tests.lab.test_watched_current import WITHIN_S, restless, spoil_at


def with_interlocks(setup: Any, *tables: str) -> None:
    # Add interlocks (bounds of readings) to the rig file of a bench, and read the file.
    path = setup.path.with_name("rig.toml")
    path.write_text(setup.rig.text + "".join(f"\n[[interlocks]]\n{table}\n" for table in tables))
    setup.rig = load_rig(path)


@pytest.mark.parametrize(
    ("table", "factor", "words"),
    [
        ('reading = "coil_voltage_V"\nmaximum = 2.0', 3.0, r"interlock coil_voltage_V: 2\.4\d* .*above maximum = 2$"),
        (
            'reading = "coil_power_W"\nminimum = -0.1\nmaximum = 0.3',
            3.0,
            r"coil_power_W: 0\.4\d* .*above maximum = 0.3$",
        ),
        ('reading = "coil_voltage_V"\nminimum = -0.1', -1.0, r"coil_voltage_V: -0\.8\d* .*below minimum = -0.1$"),
    ],
)
def test_a_reading_that_leaves_its_bounds_ends_the_run(setup: Any, table: str, factor: float, words: str) -> None:
    with_interlocks(setup, table)
    restless(setup)
    measure, factors = setup.bench.supply.measure, [1.0]

    def with_another_voltage() -> Any:
        reading = measure()
        return type(reading)(reading.current_A, factors[-1] * reading.voltage_V)

    setup.bench.supply.measure = with_another_voltage
    times_s = spoil_at(setup, 0.2, lambda: factors.append(factor))
    events: list[Event] = []
    with pytest.raises(InstrumentError, match=words):
        setup.run(remark=lambda line: None, on_event=events.append)
    began_s, off_s = times_s
    assert off_s - began_s < WITHIN_S
    assert setup.is_off()
    names = [type(event) for event in events]
    assert names.index(InterlockOpened) < names.index(OffConfirmed)
    assert setup.stored() == [0.0, 0.1]


def test_a_reading_within_its_bounds_changes_nothing(setup: Any) -> None:
    with_interlocks(setup, 'reading = "coil_current_A"\nminimum = -0.1\nmaximum = 0.5')
    setup.run()
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]


def test_a_run_does_not_begin_outside_the_bounds_of_an_interlock(setup: Any) -> None:
    with_interlocks(setup, 'reading = "coil_voltage_V"\nminimum = 1.0')
    with pytest.raises(BeyondInterlock, match="coil_voltage_V: 0 measured, below minimum = 1"):
        setup.run(remark=lambda line: None)
    assert not setup.path.exists()
    assert setup.is_off()


def test_a_missing_reading_ends_the_run_as_a_reading_out_of_bounds_does() -> None:
    events: list[Event] = []
    interlocks = Interlocks([Interlock(reading="coil_voltage_V", maximum=9.0, longest_silence_s=4.0)], events.append)
    interlocks.check_silence(100.0)
    interlocks.check({"coil_voltage_V": 3.0}, 101.0)
    interlocks.check_silence(105.0)
    with pytest.raises(BeyondInterlock, match=r"no reading for 4\.1 s, longer than longest_silence_s = 4"):
        interlocks.check_silence(105.1)
    (event,) = events
    assert in_words(event).startswith("interlock coil_voltage_V")
    interlocks.restart()
    interlocks.check_silence(200.0)
    interlocks.check_silence(204.0)
    with pytest.raises(BeyondInterlock, match=r"no reading for 4\.1 s"):
        interlocks.check_silence(204.1)
    with pytest.raises(BeyondInterlock, match="the sensor gives no reading"):
        interlocks.refuse_to_begin({})
    with pytest.raises(BeyondInterlock, match="nan measured"):
        interlocks.check({"coil_voltage_V": float("nan")}, 106.0)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            'reading = "coil_volts"\nmaximum = 1.0',
            "interlocks.0.reading = 'coil_volts' is not a reading; the readings are coil_current_A, coil_voltage_V",
        ),
        ('reading = "coil_voltage_V"', "on coil_voltage_V needs minimum, maximum or both"),
        ('reading = "coil_voltage_V"\nminimum = 2\nmaximum = 1.0', "minimum = 2 must be less than maximum = 1"),
        ('reading = "coil_voltage_V"\nmaximum = 1.0\nlongest_silence_s = 1.0', "greater than or equal to 2"),
        ('reading = "coil_voltage_V"\nmaximun = 1.0', "maximun is not a known key; did you mean maximum?"),
    ],
)
def test_an_interlock_that_cannot_be_obeyed_is_refused_when_the_rig_is_read(setup: Any, table: str, words: str) -> None:
    with pytest.raises(InputError, match=r"rig\.toml") as caught:
        with_interlocks(setup, table)
    assert words in str(caught.value)
