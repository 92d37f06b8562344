"""The temperature of the coil, computed from its resistance, is stored, and can end the run."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import InstrumentError
from eimi_drivers.sensors.coil_thermometer import CoilThermometer
from eimi_lab.acquisition.sensing import OpenSensor, coil_thermometer
from eimi_lab.config.rig import load_rig
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process.errors import InputError

ROOM_DEGC = 22.0
COIL = (
    '[[sensors]]\nname = "coil"\ndriver = "coil-resistance"\naddress = "supply"\nmeasures = "coil_temperature"\n'
    f"at_rest_degC = {ROOM_DEGC}\nat_rest_A = 0.3\n"
)


def test_the_temperature_of_a_warming_coil_is_that_of_its_copper():
    clock = SimulatedClock()
    supply = CoilSupply(clock, thermal_resistance_K_per_W=6.0, thermal_time_constant_s=300.0, current_noise_A=1e-4)
    thermometer = CoilThermometer(supply.read, clock, 20.0, 0.5)
    assert thermometer.read().value == 20.0
    supply.set_voltage(30.0)
    supply.set_current(0.5)
    supply.switch(True)
    clock.sleep(1.0)
    watched: list[float] = []
    thermometer.measure_at_rest(lambda: watched.append(clock.now()))
    assert len(watched) == 10
    supply.set_current(2.0)
    clock.sleep(600.0)
    reading = thermometer.read()
    # In the model of the coil, R = R0 at 20 degC. The coil warmed a little while R0 was measured.
    assert reading.value == pytest.approx(20.0 + supply.heating_K(), abs=0.5)
    assert reading.value > 80.0
    # 10 mV of 2 V at rest and of 9.9 V now, each with a uniform distribution, divided by 0.393 % per kelvin.
    digits_K = np.hypot(0.01 / 2.0, 0.01 / 9.9) / np.sqrt(12.0) / 0.00393
    assert reading.standard_uncertainty == pytest.approx(1.25 * digits_K, rel=0.2)
    supply.set_current(0.0)
    clock.sleep(10.0)
    assert thermometer.read() == reading


def with_coil(setup: Any, more: str = "") -> None:
    # Change a bench: the coil warms up quickly, and its resistance gives its temperature.
    path = setup.path.with_name("rig.toml")
    path.write_text(f"{setup.rig.text}\n{COIL}\n{more}\n")
    setup.rig = load_rig(path)
    setup.coil._thermal_K_per_W, setup.coil._thermal_time_constant_s = 200.0, 5.0
    sensors = tuple(
        OpenSensor(rule, coil_thermometer(rule, setup.bench.supply, setup.bench.clock)) for rule in setup.rig.sensors
    )
    setup.bench = replace(setup.bench, sensors=sensors)


def test_the_temperature_of_the_coil_is_stored_with_every_frame(setup: Any) -> None:
    with_coil(setup)
    setup.run()
    with open_dataset(setup.path) as dataset:
        (coil,) = dataset.sensors()
    by_state = coil.by_state(4)
    assert np.isfinite(by_state).all()
    assert by_state[0] == ROOM_DEGC
    assert by_state[3] > by_state[1]


def test_an_interlock_on_the_temperature_of_the_coil_ends_the_run(setup: Any) -> None:
    with_coil(setup, '[[interlocks]]\nreading = "coil"\nmaximum = 30.0\nlongest_silence_s = 5.0')
    setup.coil._thermal_K_per_W = 2000.0
    setup.camera.swing_s = 3.0
    with pytest.raises(InstrumentError, match=r"interlock coil: \d+"):
        setup.run(remark=lambda line: None)
    assert setup.is_off()


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            COIL.replace("at_rest_A = 0.3\n", ""),
            "needs address = .supply., measures = .coil_temperature., at",
        ),
        (COIL.replace('"supply"', '"/dev/ttyX"'), "needs address = .supply."),
        (COIL.replace("coil-resistance", "text-line"), "at_rest_degC and at_rest_A are only for driver"),
    ],
)
def test_a_wrong_table_of_the_coil_is_refused(setup: Any, table: str, words: str) -> None:
    path = setup.path.with_name("rig.toml")
    path.write_text(f"{setup.rig.text}\n{table}\n")
    with pytest.raises(InputError, match=words):
        load_rig(path)


def test_a_current_at_rest_beyond_the_limits_is_refused(setup: Any) -> None:
    with_coil(setup)
    sensor = setup.rig.sensors[0].model_copy(update={"at_rest_A": 5.0})
    setup.rig = setup.rig.model_copy(update={"sensors": (sensor,)})
    with pytest.raises(InputError, match="at_rest_A = 5 A; it should be at most 1 A"):
        setup.run(remark=lambda line: None)
