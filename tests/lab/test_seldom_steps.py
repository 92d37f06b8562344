"""Steps that a run takes seldom: refusals before it, messages during it, and messages to other processes."""

from __future__ import annotations

import base64
import json
import os
import pickle
import sys
import threading
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.interfaces import (
    AnotherSupply,
    Frame,
    Identity,
    InstrumentError,
    InstrumentTimeout,
    Off,
    Reading,
    SwitchOffFailed,
)
from eimi_drivers.sensors.coil_thermometer import CoilThermometer
from eimi_drivers.supplies import SUPPLIES
from eimi_lab.acquisition import added_driver, coil_calibration, conditioning, guardian_process, open_bench, resuming
from eimi_lab.acquisition import ring_downs as ring_downs_module
from eimi_lab.acquisition.coil import POLL_S, Coil
from eimi_lab.acquisition.dry_run import dry_run
from eimi_lab.acquisition.event_lines import EventLines, sending_events
from eimi_lab.acquisition.events import EmulatedSupplyGone, Event, ShapeChange, Warned
from eimi_lab.acquisition.guardian import Ward
from eimi_lab.acquisition.run import check_request
from eimi_lab.acquisition.sensing import Sensing
from eimi_lab.acquisition.settling import wait_until_settled
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.protocol import Conditioning, Ramp, RingDown, Settle
from eimi_lab.config.sensor import RigSensor
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recordings import Moment
from eimi_lab.dataset.steps import SetPoint
from eimi_lab.dataset.storage_failure import StorageFailed
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError
from eimi_lab.process.writer_lock import is_being_written
from tests.shared.noted import Noted

WARD = Ward("korad", "/dev/pts/987654", 1.0, 10.0)


# Before a run


def test_a_thermometer_of_the_coil_uses_no_more_than_the_stricter_limit(setup: Any) -> None:
    limit_A = setup.protocol.limits.current_A
    assert limit_A <= setup.rig.supply.limits.current_A

    def check(at_rest_A: float) -> None:
        keys = {"address": "supply", "measures": "coil_temperature", "at_rest_degC": 20.0, "at_rest_A": at_rest_A}
        sensor = RigSensor(name="coil", driver="coil-resistance", **keys)
        check_request(setup.protocol, setup.specimen, setup.rig.model_copy(update={"sensors": (sensor,)}))

    check(limit_A)
    with pytest.raises(
        InputError, match=rf"sensor coil .* at_rest_A = .* A; it should be at most {limit_A:g} A, the sm"
    ):
        check(limit_A + 0.01)


def test_a_weight_at_the_tip_of_a_virtual_beam_is_refused(setup: Any) -> None:
    loaded = setup.protocol.model_copy(update={"tip_force_N": 0.25})
    check_request(loaded, setup.specimen, setup.rig)
    virtual = setup.rig.model_copy(update={"virtual": "a table"})
    check_request(setup.protocol, setup.specimen, virtual)
    with pytest.raises(
        InputError, match=r"^protocol short: tip_force_N = 0\.25, but a virtual beam has no weight at its"
    ):
        check_request(loaded, setup.specimen, virtual)


def test_a_ring_down_is_not_faster_than_the_camera(setup: Any) -> None:
    def check(rate_Hz: float | None, frame_rate_Hz: float | None) -> None:
        ring_down = RingDown(seconds=1.0, rate_Hz=rate_Hz) if rate_Hz else None
        protocol = setup.protocol.model_copy(update={"ring_down": ring_down})
        camera = setup.rig.camera.model_copy(update={"frame_rate_Hz": frame_rate_Hz})
        check_request(protocol, setup.specimen, setup.rig.model_copy(update={"camera": camera}))

    check(50.0, 50.0)
    check(50.0, None)
    check(None, 10.0)
    with pytest.raises(
        InputError, match=r"short: ring_down\.rate_Hz = 50, but rig bench sets camera\.frame_rate_Hz = 49\.5"
    ):
        check(50.0, 49.5)


def test_the_rating_of_the_coil_is_checked_before_a_run(setup: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr("eimi_lab.acquisition.run.refuse_overheating", lambda *given: asked.append(given))
    check_request(setup.protocol, setup.specimen, setup.rig.model_copy(update={"coil": None}))
    assert asked == []
    check_request(setup.protocol, setup.specimen, setup.rig.model_copy(update={"coil": "rating"}))
    assert asked == [(setup.protocol, "rating")]


def test_a_coil_as_thermometer_is_measured_once_its_current_is_reached() -> None:
    steps: list[Any] = []
    clock = SimulatedClock()
    thermometer = CoilThermometer(lambda: Reading(0.5, 2.0), clock, 20.0, 0.5)
    thermometer.measure_at_rest = lambda between: steps.append("measured")  # type: ignore[method-assign]
    coil = SimpleNamespace(
        ramp_to=lambda current_A, stop: steps.append(current_A), wait_until_reached=lambda stop: steps.append("reached")
    )
    others = [SimpleNamespace(sensor=SimpleNamespace()), SimpleNamespace(sensor=thermometer)]
    Sensing(others, clock).measure_at_rest(coil, print)  # type: ignore[arg-type]
    assert steps == [0.5, "reached", "measured", 0.0]


def test_a_dry_run_tells_its_load_cycles_and_sensors(setup: Any) -> None:
    setup.protocol = setup.protocol.model_copy(update={"conditioning": Conditioning(cycles=3, current_A=0.3)})
    sensor = RigSensor(name="hall", driver="lakeshore-425", address="COM7", measures="field")
    said: list[str] = []
    dry_run(setup.protocol, setup.specimen, setup.rig.model_copy(update={"sensors": (sensor,)}), said.append)
    assert "conditioning: 3 cycles to 0.3 A and back to 0" in said
    assert (
        "sensor hall: driver lakeshore-425 at the address COM7, measures field; a dry run does not read the sensor"
    ) in said


@pytest.mark.parametrize(("kind", "resumable"), [("points", True), ("frames", False)])
def test_only_the_file_of_a_run_can_be_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, resumable: bool
) -> None:
    class Dataset:
        def __enter__(self) -> Any:
            return SimpleNamespace(kind=kind, resumable=resumable)

        def __exit__(self, *error: object) -> None:
            pass

    path = tmp_path / "run.h5"
    path.touch()
    monkeypatch.setattr(resuming, "open_dataset", lambda path: Dataset())
    with pytest.raises(InputError, match=r"run\.h5: was not written by a run that can be resumed$"):
        resuming.take_up(path, None, None)  # type: ignore[arg-type]


def test_only_a_virtual_bench_has_a_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eimi_lab.virtual.virtual_rig.truth_of", lambda *given: {"given": given})
    assert open_bench._truth(SimpleNamespace(virtual=None), "specimen") is None  # type: ignore[arg-type]
    rig: Any = SimpleNamespace(virtual="a table")
    assert open_bench._truth(rig, "specimen") == {"given": (rig, "specimen")}  # type: ignore[arg-type]


def test_an_interlock_is_checked_before_the_coil_is_calibrated(monkeypatch: pytest.MonkeyPatch) -> None:
    # The first reading of the supply and of the sensors decides whether the calibration begins.
    refused: list[dict[str, float]] = []

    class Interlocks:
        def __init__(self, *_: object) -> None:
            pass

        def refuse_to_begin(self, readings: dict[str, float]) -> None:
            refused.append(readings)
            raise InstrumentError("the interlock is open")

    class Opened:
        def __enter__(self) -> Any:
            supply = SimpleNamespace(identify=lambda: "identity", measure=lambda: Reading(current_A=0.5, voltage_V=2.0))
            return SimpleNamespace(sensors=(), clock=None, supply=supply, guardian=None)

        def __exit__(self, *error: object) -> None:
            pass

    sensing = SimpleNamespace(begin=lambda: ((), ()), values=lambda: {"hall": 7.0})
    monkeypatch.setattr(coil_calibration, "Interlocks", Interlocks)
    monkeypatch.setattr(coil_calibration, "_opened", lambda *_: Opened())
    monkeypatch.setattr(coil_calibration, "Sensing", lambda *_: sensing)
    monkeypatch.setattr(coil_calibration, "begin_with_output_off", lambda *_: None)
    rig: Any = SimpleNamespace(
        sensors=[SimpleNamespace(measures="field")], interlocks=("x",), simulated=False, name="r"
    )
    with pytest.raises(InstrumentError, match="the interlock is open"):
        coil_calibration.calibrate_coil(rig, [0.0, 0.1], lambda event: None)
    assert refused == [{"coil_current_A": 0.5, "coil_voltage_V": 2.0, "coil_power_W": 1.0, "hall": 7.0}]


# During a run


def test_a_dataset_without_place_for_ring_downs_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[Event] = []
    run: Any = SimpleNamespace(writer=SimpleNamespace(ring_downs=None), on_event=events.append)
    with ExitStack() as unfinished:
        ring_downs_module.record_ring_downs(run, RingDown(seconds=1.0), unfinished, lambda: None)
    (event,) = events
    assert isinstance(event, Warned)
    assert "has no place for ring-downs; no ring-down is recorded" in event.message


def test_a_ring_down_without_its_step_begins_with_its_recording() -> None:
    # Frames 3, 4 and 7 at 0, 0.1 and 0.4 s: two are lost, and the median interval is 0.2 s.
    stored: list[Any] = []
    events: list[Any] = []
    writer = SimpleNamespace(end_ring_down=lambda *given: stored.append(given))
    run: Any = SimpleNamespace(writer=writer, began_s=100.0, new_set_points=lambda: ("points",), on_event=events.append)
    frames = [
        (Frame(np.zeros((1, 1)), number, 1.0 + at_s), 110.0 + at_s) for number, at_s in ((3, 0.0), (4, 0.1), (7, 0.4))
    ]
    recorded: Any = SimpleNamespace(frames=frames, step=None, began_s=110.05)
    ring_downs_module._store(run, RingDown(seconds=1.0, rate_Hz=5.3, repeats=2), 1, 0.3, recorded)
    ((step, moments, points),) = stored
    assert (step.ring_down, step.from_A, step.to_A, step.frames, step.lost) == (1, 0.3, 0.0, 3, 2)
    assert (step.time_s, step.uncertainty_s) == (pytest.approx(10.05), 0.0)
    assert step.rate_Hz == pytest.approx(5.0)
    assert points == ("points",)
    assert [moment.set_A for moment in moments] == [0.3, 0.0, 0.0]
    assert [moment.elapsed_s for moment in moments] == pytest.approx([-0.05, 0.05, 0.35])
    assert [moment.time_s for moment in moments] == pytest.approx([10.0, 10.1, 10.4])
    assert events[0].flags == ("RING_DOWN_LOST", "RING_DOWN_SLOW")
    assert (events[0].ring_down, events[0].ring_downs, events[0].lost) == (1, 2, 2)
    recorded.step = SetPoint(110.2, 0.0, 0.03)
    ring_downs_module._store(run, RingDown(seconds=1.0, rate_Hz=5.2), 0, 0.3, recorded)
    assert (stored[-1][0].time_s, stored[-1][0].uncertainty_s) == (pytest.approx(10.2), 0.03)
    assert events[-1].flags == ("RING_DOWN_LOST",)  # 5 of 5.2 frames a second are 96 %


def test_the_change_of_a_shape_needs_two_frames_of_a_current(monkeypatch: pytest.MonkeyPatch) -> None:
    # The tip moves from (10, 20) to (13, 24) px, which are 5 px; at 2 px/mm they are 2.5 mm.
    corners = {1: (10.0, 20.0), 2: (13.0, 24.0), 3: (np.nan, np.nan)}
    monkeypatch.setattr(conditioning, "mean_grey", lambda image: image)
    monkeypatch.setattr(
        conditioning,
        "find_edges",
        lambda image, *_: SimpleNamespace(corners_px=np.array([corners[int(image[0, 0])]] * 4)),
    )
    monkeypatch.setattr(
        conditioning, "BeamFrame", lambda calibration: SimpleNamespace(to_mm=lambda px: np.array(px) / 2)
    )
    noise = SimpleNamespace(difference_ratio=lambda before, after: float(after[0, 0] - before[0, 0]))
    run: Any = SimpleNamespace(calibration=None, specimen=None, noise=noise)

    def shape(cycle: int, tip: int, set_A: float) -> tuple[int, Moment]:
        return cycle, Moment(Frame(np.full((1, 1), tip), 0, 0.0), 0.0, 0.0, set_A)

    asked: list[int] = []
    shapes = [shape(0, 1, 0.0), shape(1, 1, 0.5), shape(4, 3, 0.5), shape(4, 2, 0.0), shape(2, 1, 0.3)]
    changes = list(conditioning._changes(run, shapes, lambda: asked.append(1)))
    assert changes == [
        ShapeChange(current_A=0.5, since_cycle=1, difference_ratio=2.0),
        ShapeChange(current_A=0.0, since_cycle=0, tip_moved_px=5.0, tip_moved_mm=2.5),
    ]
    assert len(asked) == 4


class Clock:
    def __init__(self) -> None:
        self.s = 0.0

    def now(self) -> float:
        return self.s

    def sleep(self, seconds: float) -> None:
        self.s += seconds


def test_a_simulated_coil_is_waited_for_in_steps_of_the_simulated_time(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = iter([0.0, 0.3, 0.481, 0.5])
    coil = Coil.__new__(Coil)
    clock = Clock()
    vars(coil).update(
        _clock=clock, _rule=Ramp(rate_A_per_s=1.0, step_A=0.1, tolerance_A=0.02), simulated=True, asked_A=0.5
    )
    monkeypatch.setattr(Coil, "_measure_A", lambda self: next(measured))
    monkeypatch.setattr(Coil, "check", lambda self: None)
    coil.wait_until_reached()
    assert clock.s == pytest.approx(2 * POLL_S)
    assert next(measured) == 0.5
    measured = iter([0.0, 0.5])
    paused: list[float] = []
    monkeypatch.setattr(Coil, "_pause", lambda self, seconds, stop_if_asked: paused.append(seconds))
    coil.simulated = False
    coil.wait_until_reached()
    assert (paused, clock.s) == ([POLL_S], pytest.approx(2 * POLL_S))


class Bending:
    # A camera that takes a frame every 0.125 s.

    def __init__(self, clock: Clock) -> None:
        self.clock, self.number, self.flushed = clock, 0, 0

    def flush(self) -> None:
        self.flushed += 1

    def grab(self, timeout_s: float) -> Frame:
        self.clock.sleep(0.125)
        self.number += 1
        return Frame(np.full((4, 4), self.number % 250, np.uint8), self.number, self.clock.s)


@pytest.mark.parametrize(
    ("ratios", "drifts", "pairs", "took_s"),
    [
        ([1.0] * 30, [1.0] * 30, 3, 0.625),
        ([9.0, 9.0, 1.0, 1.0, 1.0, 1.0, 1.0], [1.5] * 30, 3, 0.75),
        ([9.0, 9.0, 9.0, 9.0, 9.0, 1.0, 1.0, 1.0, 1.0], [1.0] * 30, 3, 1.125),
        ([1.0] * 30, [9.0, 9.0, 1.0, 1.0, 1.0], 3, 0.875),
        ([2.0] * 30, [2.0] * 30, 3, 0.625),
        ([2.01] * 40, [1.0] * 30, 3, None),
    ],
)
def test_a_beam_is_at_rest_after_quiet_pairs_and_without_drift(
    monkeypatch: pytest.MonkeyPatch, ratios: list[float], drifts: list[float], pairs: int, took_s: float | None
) -> None:
    # Frames come every 0.125 s; 3 successive pairs and a window of 0.5 s must be quiet (ratio at most 2).
    clock = Clock()
    quiet, slow = iter(ratios), iter(drifts)
    given: dict[tuple[int, int], float] = {}

    class Noise:
        exceeds_rounding = False

        def difference_ratio(self, earlier: Any, later: Any, band: Any) -> float:
            key = (int(earlier[0, 0]), int(later[0, 0]))
            if key not in given:
                given[key] = next(quiet if key[1] - key[0] == 1 else slow)
            return given[key]

    monkeypatch.setattr("eimi_lab.acquisition.settling.edge_pixels", lambda image: "band")
    monkeypatch.setattr("eimi_lab.acquisition.settling.mean_grey", lambda image: image)
    rule = Settle(noise_ratio=2.0, pairs=pairs, drift_window_s=0.5, timeout_s=2.0)
    camera: Any = Bending(clock)
    settled = wait_until_settled(camera, clock, rule, Noise(), lambda: None)  # type: ignore[arg-type]
    values = list(vars(settled).values())
    if took_s is None:
        assert [flag.name for flag in values[-1]] == ["NOT_SETTLED"]
        assert 2.0 <= clock.s <= 2.3
    else:
        assert values[-1] == ()
        assert clock.s == pytest.approx(took_s)
        assert (settled.ratio, settled.drift_ratio) == (ratios[-1], drifts[-1])
        assert settled.waited_s == pytest.approx(took_s)
    assert camera.flushed == 1


# Other processes


def test_events_are_written_as_lines_and_passed_on(capfd: pytest.CaptureFixture[str]) -> None:
    reads, writes = os.pipe()
    heard: list[Event] = []
    with sending_events(heard.append, writes) as send:
        send(Warned(message="the µ of it"))
        assert [thread.daemon for thread in threading.enumerate() if thread.name == "events"] == [True]
    os.close(writes)  # the lines were written to a copy of this descriptor
    lines = b""
    while piece := os.read(reads, 4096):
        lines += piece
    os.close(reads)
    assert heard == [Warned(message="the µ of it")]
    (line,) = lines.decode().splitlines()
    assert json.loads(line)["message"] == "the µ of it"
    with sending_events(heard.append, None) as send:
        assert send == heard.append


class Own:
    """A driver of a user."""


def test_the_last_events_are_waited_for_for_a_second() -> None:
    calls: list[Any] = []
    lines: Any = EventLines.__new__(EventLines)
    lines._waiting, lines._writer = Noted(calls, "waiting"), Noted(calls, "writer")
    lines.finish()
    assert calls == [("waiting.put", None), ("writer.join", 1.0)]


def test_a_driver_of_the_user_is_added_in_the_other_process(monkeypatch: pytest.MonkeyPatch) -> None:
    table: dict[str, Any] = {}
    monkeypatch.setattr(added_driver, "SUPPLIES", table)
    monkeypatch.setattr(sys, "path", ["/a", "/b"])
    packed = json.dumps({"path": ["/b", "/c"], "driver": base64.b64encode(pickle.dumps(Own)).decode()})
    added_driver.unpack("own", packed)
    assert table == {"own": Own}
    assert sys.path == ["/a", "/b", "/c"]
    added_driver.unpack("other", "")
    assert list(table) == ["own"]
    assert SUPPLIES is not table


def test_a_driver_that_is_too_long_for_an_argument_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cloudpickle")

    class Table(dict[str, Any]):
        def added(self) -> set[str]:
            return {"own"}

    monkeypatch.setattr(added_driver, "SUPPLIES", Table(own=Own, known=Own))
    monkeypatch.setattr(sys, "path", [])
    monkeypatch.setattr(added_driver, "LONGEST_ARGUMENT", 120_000)
    assert added_driver.pack("known") == ""
    packed = added_driver.pack("own")
    monkeypatch.setattr(added_driver, "LONGEST_ARGUMENT", len(packed))
    assert added_driver.pack("own") == packed
    monkeypatch.setattr(added_driver, "LONGEST_ARGUMENT", len(packed) - 1)
    with pytest.raises(Exception, match="the supply driver 'own' is too large to be sent to the process that switches"):
        added_driver.pack("own")


def test_a_guardian_leaves_an_emulated_supply_that_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(ward: Ward, was_on: set[bool]) -> None:
        raise InstrumentTimeout("no answer")

    events: list[Event] = []
    monkeypatch.setattr(guardian_process, "_try_once", fail)
    run: Any = SimpleNamespace(runs=lambda: False)
    guardian_process.switch_off_for_the_run(WARD, "run_died", run, events.append)
    assert events == [EmulatedSupplyGone(takeover="run_died", address=WARD.address)]


class Named:
    def __init__(self, text: str, serial_number: str, on: bool | None = False) -> None:
        self.text, self.serial_number, self.on = text, serial_number, on

    def identify(self) -> Identity:
        if not self.text:
            raise InstrumentTimeout("no answer to *IDN?")
        return Identity("korad", self.text, "x", self.serial_number)

    def output_on(self) -> bool:
        if self.on is None:
            raise InstrumentTimeout("no answer")
        return self.on


def test_a_guardian_compares_text_and_serial_number() -> None:
    ward = replace(WARD, identity=("KORAD", "7"))
    compare: Any = guardian_process._compare
    assert compare(WARD, Named("anything", "")) == ""
    assert compare(ward, Named("KORAD", "7")) == ""
    assert compare(ward, Named("", "7")) == "no answer to *IDN?"
    for text, serial_number in (("KORAD", "8"), ("OTHER", "7")):
        with pytest.raises(
            AnotherSupply, match=rf"another supply answers: '{text}' {serial_number} instead of 'KORAD 7'"
        ):
            compare(ward, Named(text, serial_number))


def test_an_output_counts_as_found_off_only_if_it_never_was_on() -> None:
    find: Any = guardian_process._find_off
    seen: set[bool] = set()
    assert find(Named("x", ""), seen) is True
    assert find(Named("x", "", None), seen) is False
    assert seen == set()
    assert find(Named("x", "", True), seen) is False
    assert seen == {True}
    assert find(Named("x", ""), seen) is False
    known: Any = guardian_process._is_known_by_identity
    assert known(WARD)  # no identity was sent
    assert known(replace(WARD, identity=("KORAD", "7"), address="COM3"))
    assert known(replace(WARD, identity=("KORAD", "")))  # a pseudo-terminal
    assert not known(replace(WARD, identity=("KORAD", ""), address="COM3"))


@pytest.mark.parametrize(
    ("current_A", "found_off", "serial_number", "output_on", "confirmed"),
    [
        (None, False, "7", False, True),
        (5.0, False, "7", False, False),
        (None, True, "7", False, False),
        (None, False, "", False, False),
        (None, False, "7", True, False),
    ],
)
def test_a_guardian_measures_again_only_a_known_supply_whose_output_is_off(
    monkeypatch: pytest.MonkeyPatch,
    current_A: float | None,
    found_off: bool,
    serial_number: str,
    output_on: bool,
    confirmed: bool,
) -> None:
    supply = SimpleNamespace(output_on=lambda: output_on, measure=lambda: None, close=lambda: None)

    def fail(supply: Any, clock: Any) -> None:
        raise SwitchOffFailed("no answer to VSET", current_A, 0.02)

    monkeypatch.setattr(guardian_process, "open_supply", lambda *arguments: supply)
    monkeypatch.setattr(guardian_process, "_compare", lambda ward, supply: "")
    monkeypatch.setattr(guardian_process, "_find_off", lambda supply, was_on: found_off)
    monkeypatch.setattr(guardian_process, "switch_off", fail)
    monkeypatch.setattr(guardian_process, "off_limit_A", lambda supply: 0.02)
    monkeypatch.setattr(guardian_process, "measured_off", lambda *arguments: Off(0.001, 0.02))
    ward = replace(WARD, identity=("KORAD", serial_number), address="COM3")
    was_on: set[bool] = set()
    if confirmed:
        off, remark = guardian_process._try_once(ward, was_on)
        assert off == Off(0.001, 0.02)
        assert remark == "; one step of switching the supply off failed (no answer to VSET)"
    else:
        with pytest.raises(SwitchOffFailed, match="no answer to VSET"):
            guardian_process._try_once(ward, was_on)
    assert was_on == ({True} if current_A is not None else set())


# Storage


def writer_of(path: Path) -> DatasetWriter:
    header = Header(load_specimen("type1"), load_calibration("virtual_calibration"))
    return DatasetWriter(path, header, Frame(np.zeros((4, 4), np.uint8), 0, 0.0))


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError("write failed (errno = 28, error message = 'x')"), "No space left on device"),
        (RuntimeError("unknown"), "unknown"),
    ],
)
@pytest.mark.parametrize("stored", [0, 1])
def test_a_failed_write_keeps_the_stored_states(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, reason: str, stored: int
) -> None:
    path = tmp_path / "run.h5"
    frame = Frame(np.zeros((4, 4), np.uint8), 0, 0.0)

    def fail(*_: object) -> None:
        raise error

    def written() -> None:
        with writer_of(path) as writer:
            for _ in range(stored):
                writer.append_state([frame], current_A=0.0, field_mT=0.0)
            monkeypatch.setattr("eimi_lab.dataset.writing.synchronise", fail)
            writer.append_state([frame], current_A=0.1, field_mT=0.0)

    words = "the 1 states stored so far are safe, and" if stored else "no state was stored yet$"
    with pytest.raises(StorageFailed, match=rf"run\.h5: cannot be written any more: {reason}; {words}") as caught:
        written()
    assert caught.value.reason == reason
    assert path.exists() == bool(stored)
    assert not is_being_written(path)
    if stored:
        with open_dataset(path) as dataset:
            assert len(dataset.states) >= 1  # the failed state may be in the file, too


def test_a_recording_is_kept_where_the_run_continues(tmp_path: Path) -> None:
    # After a state is stored, a recording also notices that the file was moved, and continues in a copy.
    path = tmp_path / "run.h5"
    frame = Frame(np.zeros((4, 4), np.uint8), 0, 0.0)
    protocol: Any = SimpleNamespace(
        transients=SimpleNamespace(frames_per_state=1), ring_down=None, conditioning=object(), creep=False, text="x = 1"
    )
    header = Header(load_specimen("type1"), load_calibration("virtual_calibration"), protocol)
    warned: list[str] = []
    with DatasetWriter(path, header, frame, warn=warned.append) as writer:
        writer.append_recording("conditioning", [0], [Moment(frame, 0.0, 0.0, 0.0)])
        writer.append_state([frame], current_A=0.0, field_mT=0.0)
        path.rename(tmp_path / "moved.h5")
        writer.append_recording("conditioning", [1], [Moment(frame, 1.0, 0.0, 0.0)])
        assert writer.path == tmp_path / "run-continued.h5"
        assert writer.ring_downs is None
    assert len(warned) == 1
    with open_dataset(tmp_path / "run-continued.h5") as dataset:
        conditioning_frames = dataset.conditioning()
        assert conditioning_frames is not None
        assert conditioning_frames.belongs_to.tolist() == [0, 1]
