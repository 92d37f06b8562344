"""Sensor readings are stored with every frame; a reading outside the bounds of an interlock ends the run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.emulators.faults import Fault, FaultyInstrument
from eimi_drivers.emulators.sensors import EmulatedQuantity, SensorFault, emulate_sensor
from eimi_drivers.interfaces import InstrumentError
from eimi_drivers.sensors import SENSORS
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_lab.acquisition.events import Event, InterlockOpened, OutputSwitched, Warned
from eimi_lab.acquisition.interlocks import BeyondInterlock
from eimi_lab.acquisition.sensing import OpenSensor
from eimi_lab.config.rig import load_rig
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recovery import recover
from eimi_lab.process.errors import InputError
from tests.lab.test_watched_current import restless, spoil_at

TRUE_MT_PER_A, REMANENT_MT = 4.5, 0.03


class Emulated:
    # Emulated sensors of a bench, to which a test can add faults.
    # line, quantity: connection and measured quantity, by the name of the sensor.

    def __init__(self, setup: Any, *tables: str) -> None:
        self.line: dict[str, FaultyInstrument] = {}
        self.quantity: dict[str, EmulatedQuantity] = {}
        path = setup.path.with_name("rig.toml")
        path.write_text(setup.rig.text + "".join(f"\n{table}\n" for table in tables))
        setup.rig = load_rig(path)
        setup.bench = replace(setup.bench, sensors=tuple(self._opened(setup, rule) for rule in setup.rig.sensors))

    def _opened(self, setup: Any, rule: Any) -> OpenSensor:
        clock, unit = setup.bench.clock, "mT" if rule.measures == "field" else "degC"

        def true() -> float:
            return TRUE_MT_PER_A * setup.coil.coil_current_A() + REMANENT_MT if unit == "mT" else 24.5

        self.quantity[rule.name] = EmulatedQuantity(clock, true, unit, 0.002)
        self.line[rule.name] = FaultyInstrument(emulate_sensor(rule.driver, self.quantity[rule.name]), clock)
        link = InProcessTransport(self.line[rule.name], clock, rule.address)
        return OpenSensor(rule, SENSORS[rule.driver](link, clock))


HALL = '[[sensors]]\nname = "hall"\ndriver = "lakeshore-425"\naddress = "/dev/ttyHALL"\nmeasures = "field"'
ROOM = '[[sensors]]\nname = "beam"\ndriver = "text-line"\naddress = "/dev/ttyT"\nmeasures = "specimen_temperature"'


def test_the_values_of_sensors_are_stored_with_every_frame(setup: Any) -> None:
    Emulated(setup, HALL, ROOM)
    setup.run()
    with open_dataset(setup.path) as dataset:
        beam, hall = dataset.sensors()
        assert len(dataset.instruments()) == 4
    assert (hall.sensor.name, hall.sensor.unit, hall.sensor.model) == ("hall", "mT", "LSCI,MODEL425,4250022,1.0")
    assert hall.state.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert hall.value == pytest.approx(TRUE_MT_PER_A * np.repeat([0.0, 0.1, 0.2, 0.3], 2) + REMANENT_MT, abs=0.02)
    assert np.isnan(hall.standard_uncertainty).all()
    assert (np.diff(hall.time_s) > 0).all()
    assert beam.by_state(4) == pytest.approx(24.5, abs=0.02)
    assert beam.standard_uncertainty == pytest.approx(0.002)


def test_a_sensor_that_stops_answering_leaves_gaps_and_one_warning(setup: Any) -> None:
    emulated = Emulated(setup, HALL, ROOM)
    setup.camera.event = lambda number: emulated.line["hall"].inject(Fault.SILENCE) if number == 15 else None
    events: list[Event] = []
    setup.run(remark=lambda line: None, on_event=events.append)
    warnings = [event.message for event in events if isinstance(event, Warned)]
    assert len(warnings) == 1
    assert warnings[0].startswith("the sensor hall gives no value: /dev/ttyHALL: no complete answer")
    with open_dataset(setup.path) as dataset:
        assert len(dataset.states) == 4
        beam, hall = dataset.sensors()
    assert np.isnan(hall.value[-2:]).all()
    assert np.isfinite(beam.value).all()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda emulated: setattr(emulated.quantity["beam"], "fault", SensorFault.JUMP), "interlock beam: 24"),
        (lambda emulated: emulated.line["beam"].inject(Fault.SILENCE), "interlock beam: no reading for"),
    ],
)
def test_an_interlock_on_a_sensor_ends_the_run(setup: Any, spoil: Callable[[Emulated], None], words: str) -> None:
    emulated = Emulated(setup, ROOM, '[[interlocks]]\nreading = "beam"\nmaximum = 40.0\nlongest_silence_s = 4.0')
    restless(setup)
    spoil_at(setup, 0.2, lambda: spoil(emulated))
    events: list[Event] = []
    with pytest.raises(InstrumentError, match=words):
        setup.run(remark=lambda line: None, on_event=events.append)
    assert setup.is_off()
    assert [event.reading for event in events if isinstance(event, InterlockOpened)] == ["beam"]
    assert setup.stored() == [0.0, 0.1]


def test_a_sensor_that_never_answers_while_the_output_is_on_ends_the_run(setup: Any) -> None:
    emulated = Emulated(setup, ROOM, '[[interlocks]]\nreading = "beam"\nmaximum = 40.0\nlongest_silence_s = 4.0')

    def unplug(event: Event) -> None:
        if isinstance(event, OutputSwitched) and event.on:
            setup.camera.repeats = True  # without new frames, each state lasts 5 s
            emulated.line["beam"].inject(Fault.SILENCE)

    with pytest.raises(BeyondInterlock, match=r"interlock beam: no reading for .* longer than longest_silence_s = 4"):
        setup.run(remark=lambda line: None, on_event=unplug)
    assert setup.is_off()


def test_a_run_does_not_begin_without_the_answer_of_a_sensor(setup: Any) -> None:
    emulated = Emulated(setup, HALL)
    emulated.line["hall"].inject(Fault.SILENCE)
    with pytest.raises(InstrumentError, match="/dev/ttyHALL: no complete answer"):
        setup.run(remark=lambda line: None)
    assert not setup.path.exists()
    assert setup.is_off()


def test_a_run_does_not_begin_with_a_sensor_beyond_its_interlock(setup: Any) -> None:
    Emulated(setup, ROOM, '[[interlocks]]\nreading = "beam"\nmaximum = 20.0')
    with pytest.raises(BeyondInterlock, match=r"beam: 24\.\d* measured, above maximum = 20"):
        setup.run(remark=lambda line: None)
    assert not setup.path.exists()


def test_a_thermometer_cannot_measure_a_field(setup: Any) -> None:
    emulated = Emulated(setup, HALL.replace("lakeshore-425", "text-line"))
    emulated.quantity["hall"].unit = "degC"
    with pytest.raises(InstrumentError, match="hall reads in degC, but measures = 'field' needs mT"):
        setup.run(remark=lambda line: None)


def test_a_value_in_another_unit_than_at_the_beginning_of_the_run_is_no_value(setup: Any) -> None:
    emulated = Emulated(setup, ROOM, '[[interlocks]]\nreading = "beam"\nmaximum = 40.0\nlongest_silence_s = 4.0')

    def change(event: Event) -> None:
        events.append(event)
        if isinstance(event, OutputSwitched) and event.on:
            setup.camera.repeats = True  # without new frames, each state lasts 5 s
            emulated.quantity["beam"].unit = "mT"

    events: list[Event] = []
    with pytest.raises(BeyondInterlock, match="interlock beam: no reading for"):
        setup.run(remark=lambda line: None, on_event=change)
    (warning,) = [event.message for event in events if isinstance(event, Warned)]
    assert warning == (
        "the sensor beam gives no value: /dev/ttyT: reads in mT, but read in degC at the beginning of the run"
    )


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (HALL.replace('"hall"', '"Hall probe"'), "sensors.0.name"),
        (HALL.replace("lakeshore-425", "lakeshore"), "'lakeshore' is not a driver; .* did you mean 'lakeshore-4"),
        (HALL + "\n" + HALL, "another sensor has this name"),
        (
            HALL + "\n" + HALL.replace('"hall"', '"other"'),
            'measures = "field": the sensor hall already measures this quantity',
        ),
        (HALL.replace("/dev/ttyHALL", "virtual"), "address = 'virtual' should be the address of an instrument"),
        (HALL.replace('"hall"', '"coil_current_A"'), "sensors.0.name"),
        (ROOM + "\nat_magnet = 2.0", "at_magnet = 2 should be the field at the magnet divided by the field at "),
        ('[[interlocks]]\nreading = "hal"\nmaximum = 1.0\n' + HALL, "'hal' is not a reading; .*did you mean 'hall'"),
    ],
)
def test_a_wrong_table_of_a_sensor_is_refused_in_one_line(setup: Any, table: str, words: str) -> None:
    path = setup.path.with_name("rig.toml")
    path.write_text(f"{setup.rig.text}\n{table}\n")
    with pytest.raises(InputError, match=words) as raised:
        load_rig(path)
    assert "\n" not in str(raised.value)


def test_the_values_of_sensors_are_in_a_recovered_copy(setup: Any) -> None:
    Emulated(setup, HALL)
    setup.run()
    copy = setup.path.with_name("copy.h5")
    recover(setup.path, copy)
    with open_dataset(copy) as dataset:
        (hall,) = dataset.sensors()
    assert hall.by_state(4) == pytest.approx([0.03, 0.48, 0.93, 1.38], abs=0.02)
