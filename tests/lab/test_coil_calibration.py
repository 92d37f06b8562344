"""`eimi calibrate-coil` measures the field at several currents of the coil and writes a calibration of the coil."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.serve import emulate
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Limits, SensorReading
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.transport import InProcessTransport
from eimi_lab.acquisition import coil_calibration
from eimi_lab.acquisition.coil_calibration import CoilCalibration, calibration_currents, with_measured_coil
from eimi_lab.acquisition.events import Event
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.measured_field import FieldLine
from eimi_lab.process.errors import InputError
from eimi_lab.vision.field_at_beam import stated_coil
from tests.end_to_end.test_measured_field import OFFSET_MT, SENSORS, TRUE_MT_PER_A, write_bench

Run = Callable[..., tuple[int, str]]


def test_a_coil_is_calibrated_and_its_calibration_is_read_again(tmp_path: Path, run: Run) -> None:
    write_bench(tmp_path, SENSORS)
    status, message = run(
        "calibrate-coil", "--rig", tmp_path / "rig.toml", "-o", tmp_path / "new.toml", "--largest", 1.0
    )
    assert status == 0, message
    before, after = load_calibration(tmp_path / "virtual_calibration.toml"), load_calibration(tmp_path / "new.toml")
    uncertainty = after.uncertainty or {}
    sigma = uncertainty["coil_constant_mT_per_A"]
    assert 0.002 * TRUE_MT_PER_A < sigma < 0.004 * TRUE_MT_PER_A
    assert after.coil_constant_mT_per_A == pytest.approx(TRUE_MT_PER_A, abs=3 * sigma)
    assert after.background_field_mT == pytest.approx((OFFSET_MT, 0.0), abs=3 * uncertainty["background_field_mT"])
    assert after.pixels_per_mm == before.pixels_per_mm
    assert after.field is not None
    assert [row[0] for row in after.field.against_current or ()] == [0, 0.2, 0.4, 0.6, 0.8, 1.0, 0.8, 0.6, 0.4, 0.2, 0]
    assert not after.field.is_uneven


def test_thermometers_are_measured_at_rest_before_the_coil_is_heated(
    tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_bench(tmp_path, SENSORS)
    set_points_A: list[float] = []

    def at_rest(self: object, coil: Any, stop_if_asked: Callable[[], None]) -> None:
        stop_if_asked()
        set_points_A.append(coil.asked_A)
        assert coil.supply.output_on()

    monkeypatch.setattr(coil_calibration.Sensing, "measure_at_rest", at_rest)
    arguments = ("calibrate-coil", "--rig", tmp_path / "rig.toml", "-o", tmp_path / "new.toml", "--largest", 0.1)
    status, message = run(*arguments)
    assert (status, set_points_A) == (0, [0.0]), message


def test_a_real_coil_is_opened_with_its_rig_and_its_events(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, events, done = load_rig("bench_example"), list[Event](), list[object]()

    @contextmanager
    def opened(rig: object, on_event: object) -> Iterator[str]:
        done.extend((rig, on_event))
        yield "bench"
        done.append("closed")

    monkeypatch.setattr(coil_calibration, "open_coil", opened)
    with coil_calibration._opened(rig, events.append) as bench:
        done.append(bench)
    assert done == [rig, events.append, "bench", "closed"]


def test_an_existing_calibration_is_kept(tmp_path: Path, run: Run) -> None:
    write_bench(tmp_path, SENSORS)
    file = tmp_path / "virtual_calibration.toml"
    before = file.read_text()
    status, message = run("calibrate-coil", "--rig", tmp_path / "rig.toml", "-o", file)
    assert status == 2
    assert "--force" in message
    assert file.read_text() == before


@pytest.mark.parametrize(
    ("sensors", "options", "words"),
    [
        ("", (), 'has no sensor with measures = "field"'),
        (SENSORS, ("--largest", 3.0), "--largest = 3 should be above 0 and at most 2 A"),
    ],
)
def test_a_coil_that_cannot_be_calibrated_is_refused(
    tmp_path: Path, run: Run, sensors: str, options: tuple[object, ...], words: str
) -> None:
    write_bench(tmp_path, sensors)
    status, message = run("calibrate-coil", "--rig", tmp_path / "rig.toml", "-o", tmp_path / "new.toml", *options)
    assert status == 2
    assert words in message
    assert not (tmp_path / "new.toml").exists()


def test_a_current_beyond_the_rating_of_the_coil_is_refused() -> None:
    rig = load_rig("bench_example")
    assert calibration_currents(rig, 1.0, 3) == [0.0, 0.5, 1.0, 0.5, 0.0]
    with pytest.raises(InputError, match=r"coil\.continuous_current_A = 1\.6"):
        calibration_currents(rig, 1.7, 3)


def test_the_currents_of_a_calibration_go_up_and_back_and_then_the_other_way_on_a_bipolar_supply(
    tmp_path: Path,
) -> None:
    rig = load_rig("bench_example")
    assert calibration_currents(rig, None, 2) == [0.0, 1.6, 0.0]  # the rating of the coil is below that of the supply
    assert calibration_currents(rig.model_copy(update={"coil": None}), None, 2)[1] == rig.supply.limits.current_A
    assert calibration_currents(rig, 1.0, 4) == [0.0, 0.333, 0.666, 1.0, 0.666, 0.333, 0.0]
    bipolar = rig.model_copy(update={"supply": rig.supply.model_copy(update={"driver": "kepco-bop"})})
    assert calibration_currents(bipolar, 1.0, 3) == [0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0]
    assert calibration_currents(bipolar, 1.0, 4)[:4] == [0.0, 0.33, 0.66, 1.0]  # its step is 0.01 A
    with pytest.raises(InputError, match=r"--largest = 0\.009 should be at least 0\.01 A, the step in which"):
        calibration_currents(bipolar, 0.009, 3)
    for largest_A in (0.0, -0.5):
        with pytest.raises(InputError, match="should be above 0"):
            calibration_currents(rig, largest_A, 3)
    write_bench(tmp_path, SENSORS)
    virtual = load_rig(str(tmp_path / "rig.toml"))
    assert min(calibration_currents(virtual, None, 3)) == 0.0
    assert calibration_currents(virtual, 2.0, 2)[1] == 2.0  # the limit itself is permitted


def test_each_current_is_held_for_half_a_second_before_five_readings_that_are_a_tenth_of_a_second_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock, ramps, read_s = SimulatedClock(), list[Any](), list[float]()

    class FollowingCoil:
        def __init__(self, supply: Any, clock: Any, ramp: Any, **options: Any) -> None:
            ramps.append(ramp)

        def ramp_to(self, current_A: float, stop_if_asked: Any) -> None:
            ramps.append(current_A)

        def wait_until_reached(self, stop_if_asked: Any) -> None:
            clock.sleep(10.0)

    class Probe:
        def __init__(self, sensors: Any, clock: Any, warn: Any, beat: Any) -> None: ...

        def begin(self) -> Any:
            return None, [SimpleNamespace(name="hall")]

        def read(self) -> dict[str, SensorReading]:
            read_s.append(clock.now() - began_s)
            return {"hall": SensorReading(2.0 * (len(read_s) > 5), "mT", 0.0, 0.05)}

        def __getattr__(self, name: str) -> Any:
            return lambda *arguments: {}

    supply = CoilSupply(clock)
    bench = SimpleNamespace(
        supply=SUPPLIES["scpi"](InProcessTransport(emulate("scpi", supply), clock, "test"), Limits(1.0, 10.0), clock),
        clock=clock,
        sensors=(),
        guardian=None,
        interruption=None,
    )
    for name, replacement in (
        ("Coil", FollowingCoil),
        ("Sensing", Probe),
        ("_opened", lambda rig, on_event: nullcontext(bench)),
        ("begin_with_output_off", lambda *arguments: None),
        ("switching_off", lambda *arguments: nullcontext(lambda: None)),
        ("field_line", lambda sensor, *columns: line(2.0, 0.0)),
    ):
        monkeypatch.setattr(coil_calibration, name, replacement)
    rig: Any = SimpleNamespace(
        sensors=[SimpleNamespace(name="hall", measures="field")], interlocks=(), simulated=False, name="rig"
    )
    began_s = clock.now()
    found = coil_calibration.calibrate_coil(rig, [0.0, 1.0], lambda event: None)
    at_first = [read_s[0] + 0.1 * number for number in range(5)]
    assert read_s == pytest.approx([*at_first, *(second + 10.0 + 0.5 + 0.5 for second in at_first)])
    assert found.field_mT.tolist() == [0.0, 2.0]
    ramp, *currents = ramps
    assert currents == [0.0, 1.0]
    assert (ramp.rate_A_per_s, ramp.step_A, ramp.tolerance_A, ramp.down_within_s) == (0.5, 0.05, 0.02, 2.0)


def test_the_field_at_a_current_is_the_mean_of_its_readings_and_hysteresis_is_the_largest_difference() -> None:
    current_A = np.array([0.0, 0.5, 1.0, 0.5, 0.0])
    means_mT = np.array([0.1, 2.0, 4.0, 2.3, 0.2])
    scatter = np.array([-0.02, -0.01, 0.0, 0.01, 0.02])
    readings = [[SensorReading(float(mean + part), "mT", 0.0, 0.05) for part in scatter] for mean in means_mT]
    given: dict[str, Any] = {}

    def line_of(current: Any, field: Any, stated: Any) -> FieldLine:
        given.update(current=current, field=field, stated=stated)
        return line(4.0, 0.1)

    found = coil_calibration._evaluated(current_A, readings, line_of)
    np.testing.assert_allclose(found.field_mT, means_mT)
    assert found.hysteresis_mT == pytest.approx(0.3)
    np.testing.assert_array_equal(given["current"], np.repeat(current_A, 5))
    np.testing.assert_allclose(given["field"], np.add.outer(means_mT, scatter).ravel())
    np.testing.assert_array_equal(given["stated"], np.full(25, 0.05))


def line(mT_per_A: float, offset_mT: float) -> FieldLine:
    return FieldLine("hall (425)", mT_per_A, 0.0123456, offset_mT, 0.0456789, 0.01, 3, True)


def measured(mT_per_A: float, offset_mT: float) -> CoilCalibration:
    return CoilCalibration(np.array([0.0, 1.0]), np.array([0.3, 4.71234567]), line(mT_per_A, offset_mT), 0.0)


@pytest.mark.parametrize(
    ("angle_deg", "before_mT", "after_mT"),
    [
        (0.0, None, (0.3, 0.0)),
        (0.0, (0.1, 0.2), (0.3, 0.2)),  # only the part along the axis of the coil is measured
        (45.0, (0.2, 0.0), (0.1 + 0.3 / np.sqrt(2), -0.1 + 0.3 / np.sqrt(2))),
    ],
)
def test_the_measured_offset_replaces_the_background_along_the_axis_of_the_coil(
    files: Path, angle_deg: float, before_mT: tuple[float, float] | None, after_mT: tuple[float, float]
) -> None:
    given = load_calibration(files / "calibration.toml")
    given = given.model_copy(update={"field_angle_deg": angle_deg, "background_field_mT": before_mT})
    new = with_measured_coil(given, measured(4.5, 0.3), date(2026, 3, 4))
    assert new.background_field_mT == pytest.approx(after_mT, abs=1e-6)
    assert new.coil_constant_mT_per_A == 4.5
    assert new.calibrated_on == date(2026, 3, 4)
    assert new.uncertainty == {"coil_constant_mT_per_A": 0.0123, "background_field_mT": 0.0457}
    assert new.field is not None
    assert new.field.against_current == ((0.0, 0.3), (1.0, 4.712346))


def test_a_larger_stated_uncertainty_of_the_background_is_kept(files: Path) -> None:
    given = load_calibration(files / "calibration.toml")
    stated = {"background_field_mT": 0.2, "pixels_per_mm": 0.01, "coil_constant_mT_per_A": 1.0}
    new = with_measured_coil(given.model_copy(update={"uncertainty": stated}), measured(4.5, 0.0), date.today())
    assert new.uncertainty == stated | {"coil_constant_mT_per_A": 0.0123}


@pytest.mark.parametrize("mT_per_A", [-4.5, 0.0])
def test_a_field_that_does_not_increase_with_the_current_is_refused(files: Path, mT_per_A: float) -> None:
    with pytest.raises(InputError, match=r"hall \(425\): measured .* mT/A, but a positive current should give"):
        with_measured_coil(load_calibration(files / "calibration.toml"), measured(mT_per_A, 0.3), date.today())


def test_a_weak_coil_is_calibrated(files: Path) -> None:
    new = with_measured_coil(load_calibration(files / "calibration.toml"), measured(0.5, 0.0), date.today())
    assert new.coil_constant_mT_per_A == 0.5


def test_the_field_of_a_calibrated_coil_is_uniform(files: Path) -> None:
    text = (files / "calibration.toml").read_text()
    (files / "calibration.toml").write_text(text + "\n[field]\nagainst_current = [[0.0, 0.0], [1.0, 4.7]]\n")
    calibration = load_calibration(files / "calibration.toml")
    assert stated_coil(calibration, load_specimen("type1").mechanics()) is None
