"""Tables, frames, plots and copies of a dataset are right, and so are imported pictures."""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from eimi_drivers.interfaces import SensorReading
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.csv_tables import Row
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset import (
    default_plots,
    importing,
    labelled,
    listing,
    lost_name,
    neighbouring_states,
    reading,
    recordings,
    restating,
    rewriting,
    stored_edges,
    stored_frames,
    videos,
)
from eimi_lab.dataset.frame_chunk import append_image
from eimi_lab.dataset.frame_stream import FrameStream
from eimi_lab.dataset.layout import (
    FORMAT,
    FORMAT_ATTRIBUTE,
    FRAME_COLUMNS,
    START_ATTRIBUTE,
    STATE_COLUMNS,
    Header,
    append,
    columns,
    flags_from_text,
    flags_to_text,
    frame_stack,
    get_start,
    get_text,
    group,
    identity_text,
    note,
    put_date,
    put_text,
    to_stored,
    write_state_columns,
)
from eimi_lab.dataset.logged_sensor import LoggedSensor
from eimi_lab.dataset.measured_columns import measured_column, write_measured_columns
from eimi_lab.dataset.points import Load, TrackedPoints, read_points, write_points
from eimi_lab.dataset.reading import Dataset
from eimi_lab.dataset.recorded_frames import creep_frames, recorded_ring_downs
from eimi_lab.dataset.sensor_logs import make_sensor_logs, read_sensor_logs, rows_of, sensor_names
from eimi_lab.dataset.state import State
from eimi_lab.dataset.steps import (
    RingDownStep,
    SetPoint,
    append_set_points,
    append_step,
    make_steps,
    read_set_points,
    read_steps,
    records_steps,
)
from eimi_lab.dataset.storage_failure import StorageFailed
from eimi_lab.dataset.stored_states import mean_by_state, read_states
from eimi_lab.dataset.tip_force_angles import store_tip_force_angles, tip_force_angles, write_tip_force_angles
from eimi_lab.process.errors import InputError
from eimi_lab.process.writer_lock import is_being_written
from eimi_lab.vision.check import Flag, Severity
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.projection import Projection

SPECIMEN = load_specimen(Path(__file__).parents[2] / "protocols" / "specimens" / "type1.toml")
Array = NDArray[np.float64]
NAN = math.nan
GREY = np.zeros((2, 3), np.uint8)


@pytest.fixture
def entry() -> Iterator[h5py.Group]:
    with h5py.File("memory.h5", "w", driver="core", backing_store=False, libver=("v110", "latest")) as file:
        made = file.create_group("entry")
        put_date(made, "start_time", "2026-01-02T03:04:05+00:00")
        yield made


def same(found: Any, expected: Any) -> None:
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def edge_set(tip: tuple[float, float] | None, *flags: str, severity: Severity = Severity.UNUSABLE) -> EdgeSet:
    # Return the edges of a beam 2 mm wide from the clamp to a tip; no points without a tip.
    line = np.zeros((0, 2)) if tip is None else np.array([[0.0, 0.0], [tip[0] / 2, tip[1] / 2], list(tip)])
    sides = [
        EdgePoints(line + np.array([0.0, across]) if len(line) else line, np.full(len(line), 0.1))
        for across in (-1.0, 1.0)
    ]
    made = tuple(Flag(name, "finding", 1.0, 0.0, severity) for name in flags)
    return EdgeSet(*sides, made, np.full((4, 2), NAN))


# The table of states


def state_table(entry: h5py.Group, kind: Any = "frames") -> dict[str, h5py.Dataset]:
    table = write_state_columns(entry, kind)
    for name, values in {"current": [0.0, 0.5, NAN], "field": [0.0, 2.0, 3.0], "tip_force": [0.1, 0.2, 0.3]}.items():
        append(table[name], values)
    append(table["flags"], [flags_to_text(())] * 3)
    append(table["index"], [0, 1, 2])
    return table


def frame_rows(entry: h5py.Group, state: list[int], **values: list[float]) -> None:
    table = columns(group(entry, "data", "NXdata"), FRAME_COLUMNS)
    append(table["state"], state)
    for name, cells in values.items():
        append(table[name], cells)


def test_the_states_have_the_values_of_their_row(entry: h5py.Group) -> None:
    state_table(entry)
    frame_rows(entry, [0, 0, 2, 3], measured_current=[0.1, 0.3, 7.0, 9.0])
    write_tip_force_angles(entry["states"], [None, 30.0, None])
    loads = [Load(0.0, 0.0, 0.0, temperature_degC=20.0), Load(0.0, 0.0, 0.0), Load(0.0, 0.0, 0.0, None, 0.05)]
    write_measured_columns(entry["states"], loads)
    states, line = read_states(Path("run.h5"), entry, "frames")
    assert line is None
    assert states == (
        State(0, 0.0, 0.2, 0.0, 0.1, (), None, None, 20.0),
        State(1, 0.5, None, 2.0, 0.2, (), 30.0, None, None),
        State(2, None, 7.0, 3.0, 0.3, (), None, 0.05, None),
    )
    same(measured_column(entry["states"], "temperature", 3), [20.0, NAN, NAN])
    assert entry["states/temperature"].attrs["units"] == "degC"
    assert entry["states/field_sigma"].attrs["units"] == "mT"
    assert entry["states/tip_force_angle"].attrs["units"] == "deg"
    entry["states/index"][1] = 5
    with pytest.raises(InputError, match=r"^run\.h5: the numbers of the states in the file are damaged"):
        read_states(Path("run.h5"), entry, "frames")


def test_quantities_that_were_not_measured_have_no_column(entry: h5py.Group) -> None:
    table = entry.create_group("states")
    write_tip_force_angles(table, [None, None])
    write_measured_columns(table, [Load(0.0, 0.0, 0.0)] * 2)
    assert list(table) == []
    same(tip_force_angles(table, 2), [NAN, NAN])
    same(measured_column(table, "field_sigma", 2), [NAN, NAN])


def test_sensors_give_the_field_and_the_temperature_of_a_state(entry: h5py.Group) -> None:
    # The line through (0 A, 0.5 mT) and (0.5 A, 2.5 mT) has 4 mT/A; the offset is no field of the coil.
    state_table(entry)
    group(entry, "sample", "NXsample")
    probe = LoggedSensor("probe", "F41", "field", "mT", 1.0, 0.01, None)
    skin = LoggedSensor("skin", "Pt100", "specimen_temperature", "degC")
    make_sensor_logs(entry, [probe, skin])
    frame_rows(entry, [0, 1, 1, 3], measured_current=[0.0, 0.5, 0.5, 0.9])
    for name, values in (("probe", [0.5, 2.5, 2.5, 99.0]), ("skin", [20.0, 22.0, NAN, 99.0])):
        log = entry["sample/environment"][name]["value_log"]
        for column, cells in {"time": [1.0, 2.0, 3.0, 4.0], "value": values, "value_errors": [NAN] * 4}.items():
            append(log[column], cells)
    states, line = read_states(Path("run.h5"), entry, "frames")
    assert line is not None
    same([state.field_mT for state in states], [0.0, 2.0, NAN])
    assert [state.temperature_degC for state in states] == [20.0, 22.0, None]
    first, second = read_sensor_logs(entry, 3)
    assert (first.sensor, second.sensor) == (probe, skin)
    same(first.time_s, [1.0, 2.0, 3.0])
    same(first.value, [0.5, 2.5, 2.5])
    assert first.state.tolist() == [0, 1, 1]
    assert sensor_names(entry) == ("probe", "skin")
    place = entry["sample/environment/probe"]
    assert get_text(entry["sample/environment"], "name") == "sensors of the bench"
    assert get_text(place, "measurement") == "magnetic_field"
    assert [place["value_log"][name].attrs["units"] for name in ("time", "value", "value_errors")] == ["s", "mT", "mT"]
    assert get_text(entry["sample/environment/skin"], "measurement") == "temperature"


def test_a_run_without_sensors_has_no_group_for_them(entry: h5py.Group) -> None:
    make_sensor_logs(entry, [])
    assert list(entry) == ["start_time"]
    assert sensor_names(entry) == ()


def test_a_state_adds_one_row_for_each_frame_to_a_log() -> None:
    sensed = [
        {"a": SensorReading(2.0, "mT", 5.0, 0.1)},
        {"b": SensorReading(9.0, "mT", 9.0, 0.9)},
        {"a": SensorReading(3.0, "mT", 6.0)},
    ]
    rows = rows_of("a", sensed, 3)
    same(rows["time"], [5.0, NAN, 6.0])
    same(rows["value"], [2.0, NAN, 3.0])
    same(rows["value_errors"], [0.1, NAN, NAN])
    same(rows_of("a", [], 2)["value"], [NAN, NAN])


def test_the_mean_of_a_state_leaves_incomplete_rows_out(entry: h5py.Group) -> None:
    frame_rows(entry, [0, 0, 2, 5, 2], time=[1.0, 2.0, 10.0, 77.0])
    same(mean_by_state(entry, "time", 3), [1.5, NAN, 10.0])
    same(mean_by_state(entry, "measured_current", 3), [NAN] * 3)


# Texts, flags and frames of the layout


def test_texts_and_flags_are_read_as_they_were_written(entry: h5py.Group) -> None:
    for text in ("", "µ", "two\nlines"):
        put_text(entry, f"text{len(text)}", text)
        assert get_text(entry, f"text{len(text)}") == text
    flags = (Flag("A", "finding", 0.5, 0.1, Severity.NOTE), Flag("B", "other", 2.0, 3.0, Severity.UNUSABLE))
    assert flags_from_text(flags_to_text(flags)) == flags
    assert flags_from_text(b'[["A", "finding", 0.5, 0.1]]')[0].severity is Severity.UNUSABLE
    one = len(flags_to_text(flags[:1])) - 2
    room = 4096 - 2 - one
    long = (flags[0], Flag("A" * (1 + room - 2 - one), *("finding", 0.5, 0.1), Severity.NOTE))
    assert len(flags_to_text(long)) == 4096 == int(STATE_COLUMNS["flags"][0][1:])
    with pytest.raises(
        ValueError, match="the 2 flags of a state need 4097 bytes as JSON, but a dataset has room for 4096"
    ):
        flags_to_text((flags[0], Flag("A" + long[1].name, *("finding", 0.5, 0.1), Severity.NOTE)))
    identity = SimpleNamespace(driver="scpi", text="ACME 1", address="COM3")
    assert identity_text(identity) == "scpi: ACME 1 at COM3"  # type: ignore[arg-type]


def test_the_start_of_a_run_is_in_an_attribute_or_in_the_text_of_early_versions(entry: h5py.Group) -> None:
    write_state_columns(entry, "frames")
    assert get_start(entry) == "2026-01-02T03:04:05+00:00"
    del entry["states"].attrs["eimi_start_time"]
    with pytest.raises(ValueError, match="the attribute eimi_start_time of the group entry/states"):
        get_start(entry)
    entry["states"].attrs["eimi_start_time"] = "of variable length"
    with pytest.raises(ValueError, match="is missing"):
        get_start(entry)
    del entry["start_time"]
    put_text(entry, "start_time", "2020")
    assert get_start(entry) == "2020"


def test_colours_are_stored_in_the_order_red_green_blue() -> None:
    colour = np.arange(12).reshape(2, 2, 3)
    assert to_stored(colour)[0, 0].tolist() == [2, 1, 0]
    assert to_stored(GREY) is GREY


def test_a_stack_has_one_chunk_for_each_frame(entry: h5py.Group) -> None:
    grey, colour = frame_stack(entry, "grey", GREY), frame_stack(entry, "colour", np.zeros((2, 3, 3), np.uint16))
    assert (grey.shape, grey.maxshape, grey.chunks, grey.dtype) == ((0, 2, 3), (None, 2, 3), (1, 2, 3), np.uint8)
    assert (colour.chunks, colour.dtype) == ((1, 2, 3, 3), np.uint16)
    assert (grey.compression, grey.compression_opts, grey.fletcher32) == ("gzip", 1, True)
    assert grey.attrs["units"] == "counts"
    assert "interpretation" not in grey.attrs
    assert colour.attrs["interpretation"] == "rgb-image"
    image = np.arange(6, dtype=np.uint8).reshape(2, 3)
    append_image(grey, image)
    append_image(grey, image + 1)
    np.testing.assert_array_equal(grey[()], [image, image + 1])


# Frames that are written by threads


def test_a_stream_appends_its_frames_in_order_and_keeps_their_number(entry: h5py.Group) -> None:
    stack = frame_stack(entry, "frames", np.zeros((2, 3, 3), np.uint8))
    first = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
    append_image(stack, to_stored(first))
    with FrameStream(stack, ring_bytes=1) as stream:
        for number in range(70):
            stream.put(first + np.uint8(number))
        assert 0 <= stream.waiting <= 2
    assert (stream.written, stream.waiting, len(stack)) == (70, 0, 71)
    np.testing.assert_array_equal(to_stored(stack[70]), first + np.uint8(69))
    np.testing.assert_array_equal(to_stored(stack[0]), first)


def test_a_frame_of_another_form_or_after_a_failed_write_is_refused(
    entry: h5py.Group, monkeypatch: pytest.MonkeyPatch
) -> None:
    stack = frame_stack(entry, "frames", GREY)
    with FrameStream(stack) as stream:
        for wrong in (np.zeros((2, 4), np.uint8), np.zeros((2, 3), np.uint16)):
            with pytest.raises(ValueError, match="all frames of a recording should have the same shape and type"):
                stream.put(wrong)
    assert len(stack) == 0

    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left")

    monkeypatch.setattr("eimi_lab.dataset.frame_stream.write_chunk", fail)

    def filled() -> None:
        with FrameStream(stack, ring_bytes=1) as stream:
            for _ in range(5):
                stream.put(GREY)

    with pytest.raises(OSError, match="No space left"):
        filled()

    def interrupted() -> None:
        with FrameStream(stack) as stream:
            stream.put(GREY)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()

    def one() -> None:
        with FrameStream(stack) as stream:
            stream.put(GREY)

    with pytest.raises(OSError, match="No space left"):
        one()


@pytest.mark.parametrize(("ring_bytes", "frames"), [(0, 2), (17, 2), (18, 3), (59, 9)])
def test_the_ring_holds_whole_frames_and_at_least_two(entry: h5py.Group, ring_bytes: int, frames: int) -> None:
    # A frame of 2 x 3 pixels of 8 bits has 6 bytes.
    waits: list[str] = []
    stream = FrameStream(frame_stack(entry, "frames", GREY), ring_bytes)
    with pytest.MonkeyPatch.context() as held:
        held.setattr(stream, "_write", lambda number, chunk: None)  # nothing is written, so that no room becomes free
        for _ in range(frames):
            stream.put(GREY)
        assert stream.waiting == frames

        def meanwhile() -> None:
            waits.append("waits")
            if len(waits) == 2:
                stream._room.release()

        stream.put(GREY, meanwhile)
    assert waits == ["waits", "waits"]


# Frames of a state, and of recordings


def frames_of(entry: h5py.Group, state: list[int], image: Any = GREY) -> h5py.Dataset:
    frame_rows(entry, state)
    stack = frame_stack(entry["data"], "frames", image)
    for number in range(len(state)):
        append_image(stack, image + np.asarray(number, image.dtype))
    return stack


def test_the_frames_of_a_state_are_read_in_order(entry: h5py.Group) -> None:
    colour = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
    frames_of(entry, [0, 1, 1, 1, 2], colour)
    path = Path("run.h5")
    images = stored_frames.images_of_state(path, entry, 1, None)
    np.testing.assert_array_equal(images, [to_stored(colour + np.uint8(k)) for k in (1, 2, 3)])
    assert len(stored_frames.images_of_state(path, entry, 1, 2)) == 2
    each = list(stored_frames.each_image_of_state(path, entry, 1))
    np.testing.assert_array_equal(each, images)


def test_grey_frames_need_no_change_of_colours(entry: h5py.Group) -> None:
    frames_of(entry, [0, 0])
    np.testing.assert_array_equal(stored_frames.images_of_state(Path("run.h5"), entry, 0, None), [GREY, GREY + 1])


@pytest.mark.parametrize(("quarter", "refused"), [(12, False), (11, True)])
def test_frames_beyond_a_quarter_of_the_free_memory_are_refused(
    entry: h5py.Group, monkeypatch: pytest.MonkeyPatch, quarter: int, refused: bool
) -> None:
    # Two frames of 6 bytes claim 12 bytes.
    frames_of(entry, [0, 0])
    monkeypatch.setattr("eimi_lab.process.limits.free_memory_bytes", lambda: 4 * quarter)
    if refused:
        with pytest.raises(
            InputError, match=r"^run\.h5: according to the file, state 0 has 2 frames, which would take"
        ):
            stored_frames.images_of_state(Path("run.h5"), entry, 0, None)
    else:
        assert len(stored_frames.images_of_state(Path("run.h5"), entry, 0, None)) == 2


def test_damaged_frames_are_counted_from_the_first_of_their_state() -> None:
    class Stack:
        shape, dtype, ndim = (5, 2, 3), np.dtype(np.uint8), 3

        def __len__(self) -> int:
            return 5

        def __getitem__(self, row: Any) -> Any:
            if isinstance(row, slice) or row in (2, 4):
                raise OSError("checksum")
            return GREY

    made: Any = {"data/state": np.array([0, 1, 1, 1, 1]), "data/frames": Stack()}
    words = (
        r"^run\.h5: frame 1, 3 of the 4 frames of state 1 \(counted from 0\) is damaged \(checksum\); `eimi recover`"
    )
    with pytest.raises(InputError, match=words):
        stored_frames.images_of_state(Path("run.h5"), made, 1, None)
    with pytest.raises(InputError, match=words):
        list(stored_frames.each_image_of_state(Path("run.h5"), made, 1))
    assert stored_frames.damaged_frames(Stack()) == (2, 4)  # type: ignore[arg-type]


def recording(entry: h5py.Group, name: str, belongs_to: list[int], **values: list[float]) -> h5py.Group:
    recordings.make_recordings(entry, [name], GREY)
    store = entry[name]
    given: dict[str, Any] = {recordings.BELONGS_TO[name]: belongs_to, **values}
    for column in (recordings.BELONGS_TO[name], *recordings.COLUMNS):
        append(store[column], given.get(column, np.arange(len(belongs_to)) + 0.5))
    for number in range(len(belongs_to)):
        append_image(store["frames"], GREY + np.uint8(number))
    return store


def test_creep_belongs_to_one_state(entry: h5py.Group) -> None:
    assert creep_frames(entry, 3, 1) is None
    store = recording(entry, "transients", [0, 1, 1, 2], time=[1.0, 2.0, 3.0, 4.0], elapsed=[0.1, 0.2, 0.3, 0.4])
    assert creep_frames(entry, 3, 1) is None
    group(entry, "set_points", "NXcollection")
    found = creep_frames(entry, 3, 1)
    assert found is not None
    assert len(found) == 2
    same(found.time_s, [2.0, 3.0])
    same(found.elapsed_s, [0.2, 0.3])
    assert [image[0, 0] for image in found.images()] == [1, 2]
    assert creep_frames(entry, 2, 2) is None
    assert creep_frames(entry, 3, 7) is None
    assert store.attrs["signal"] == "frames"


def test_the_ring_down_of_an_early_version_has_its_step_computed(entry: h5py.Group) -> None:
    # Frames 3, 4, 7, 8 at 0.1 s: two are lost. The step came 0.2 s before the first frame, which is at 10 s.
    state_table(entry)
    given = {"number": [3, 4, 7, 8], "time": [10.0, 10.1, 10.4, 10.5], "elapsed": [0.2, 0.3, 0.6, 0.7]}
    recording(entry, "release", [0, 0, 0, 0], **given)
    ((step, frames),) = recorded_ring_downs(entry, 2)
    assert (step.ring_down, step.from_A, step.to_A, step.frames, step.lost) == (0, 0.5, 0.0, 4, 2)
    assert (step.time_s, step.uncertainty_s, step.rate_Hz) == (
        pytest.approx(9.8),
        pytest.approx(0.1),
        pytest.approx(10),
    )
    assert len(frames) == 4
    recordings.keep_rows(entry, "release", np.array([2]))
    ((step, frames),) = recorded_ring_downs(entry, 2)
    assert (step.uncertainty_s, step.rate_Hz, step.lost, len(frames)) == (0.0, 0.0, 0, 1)
    same(frames.time_s, [10.4])
    assert next(iter(frames.images()))[0, 0] == 2
    recordings.keep_rows(entry, "release", np.array([], dtype=int))
    assert recorded_ring_downs(entry, 2) == ()


def test_ring_downs_and_set_points_are_read_as_they_were_written(entry: h5py.Group) -> None:
    assert recorded_ring_downs(entry, 3) == ()
    assert read_set_points(entry) == read_steps(entry) == ()
    recording(entry, "ring_down", [0, 1, 1])
    protocol: Any = SimpleNamespace(creep=False, ring_down=object())
    make_steps(entry, protocol)
    steps = (RingDownStep(0, 0.5, 0.0, 3.0, 0.01, 1, 0, 50.0), RingDownStep(1, 0.7, 0.1, 9.0, 0.02, 2, 1, 60.0))
    for step in steps:
        append_step({name: entry["ring_down_steps"][name] for name in entry["ring_down_steps"]}, step)
    points = (SetPoint(1.0, 0.5, 0.01), SetPoint(2.0, 0.0, 0.02))
    append_set_points({name: entry["set_points"][name] for name in entry["set_points"]}, points)
    append_set_points({}, points)
    append_set_points({name: entry["set_points"][name] for name in entry["set_points"]}, [])
    assert read_set_points(entry) == points
    assert read_steps(entry) == steps
    assert isinstance(read_steps(entry)[1].lost, int)
    found = recorded_ring_downs(entry, 0)
    assert [(step, len(frames)) for step, frames in found] == [(steps[0], 1), (steps[1], 2)]
    for creep, ring_down, records in ((False, None, False), (True, None, True), (False, 1, True)):
        assert records_steps(SimpleNamespace(creep=creep, ring_down=ring_down)) is records  # type: ignore[arg-type]
    assert not records_steps(None)


def test_rows_of_incomplete_states_and_columns_do_not_count(entry: h5py.Group) -> None:
    store = recording(entry, "transients", [0, 1, 2, 2])
    assert recordings.complete_rows(entry, "transients", 3).tolist() == [0, 1, 2, 3]
    assert recordings.complete_rows(entry, "transients", 2).tolist() == [0, 1]
    store["time"].resize(3, axis=0)
    assert recordings.complete_rows(entry, "transients", 3).tolist() == [0, 1, 2]
    read = recordings.read_recording(entry, "transients", 3)
    assert read is not None
    assert read.belongs_to.tolist() == [0, 1, 2]
    assert [image[0, 0] for image in read.images] == [0, 1, 2]
    only = recordings.read_recording(entry, "transients", 3, only=1)
    assert only is not None
    assert (only.images[0][0, 0], only.time_s.tolist(), only.set_A.tolist()) == (1, [1.5], [1.5])
    assert recordings.read_recording(entry, "transients", 3, only=9) is None
    assert recordings.read_recording(entry, "ring_down", 3) is None
    recordings.keep_rows(entry, "transients", np.array([0, 2]))
    kept = recordings.read_recording(entry, "transients", 3)
    assert kept is not None
    assert [image[0, 0] for image in kept.images] == [0, 2]
    assert kept.belongs_to.tolist() == [0, 2]
    assert len(store["frames"]) == len(store["number"]) == 2


@pytest.mark.parametrize(
    ("per_state", "ring_down", "conditioning"), [(0, None, None), (1, None, None), (0, 1, None), (0, None, 1)]
)
def test_a_protocol_asks_for_its_recordings(per_state: int, ring_down: Any, conditioning: Any) -> None:
    transients = SimpleNamespace(frames_per_state=per_state)
    protocol: Any = SimpleNamespace(transients=transients, ring_down=ring_down, conditioning=conditioning)
    wanted = (("transients", per_state), ("ring_down", ring_down), ("conditioning", conditioning))
    assert recordings.planned(protocol) == tuple(name for name, asked in wanted if asked)
    assert recordings.planned(None) == ()


# Tracked points


def test_points_are_read_as_they_were_written(tmp_path: Path) -> None:
    rest, places = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[5.0, 6.0], [7.0, 8.0]])
    tracked = [
        TrackedPoints(("a", "bµ"), rest, places, np.array([0.1, 0.2]), np.array([0.5, -0.5])),
        TrackedPoints(("a",), rest[:1], places[:1], np.array([0.3])),
    ]
    path = tmp_path / "points.h5"
    write_points(path, Header(SPECIMEN), 30.0, [Load(None, 1.0, 0.1, 5.0), Load(0.5, 2.0, 0.2)], tracked, False)
    with h5py.File(path) as file:
        made = file["entry"]
        first, second = read_points(made, 2)
        assert (first.names, second.names) == (("a", "bµ"), ("a",))
        same(first.rest_mm, rest)
        same(first.points_mm, places)
        same(first.sigma_mm, [0.1, 0.2])
        same(first.depth_mm, [0.5, -0.5])
        same(second.depth_mm, [0.0])
        attributes = made["states"].attrs
        assert (attributes["gravity_angle_deg"], attributes["gravity"], attributes["field_angle_deg"]) == (
            30.0,
            False,
            90.0,
        )
        assert (made["data"].attrs["signal"], list(made["data"].attrs["axes"])) == ("y", ["x"])
        states, _ = read_states(path, made, "points")
        assert states == (State(0, None, None, 1.0, 0.1, (), 5.0), State(1, 0.5, None, 2.0, 0.2, ()))
        assert "end_time" in made
    assert Load(0.0, 0.0, 0.0, temperature_degC=1.0) == Load(0.0, 0.0, 0.0, temperature_degC=2.0)


# Tables and plots for other programs


class Labelled:
    # A replacement for the package xarray, which keeps variables, coordinates and attributes of a Dataset.

    def Dataset(self, *given: Any) -> Any:
        return SimpleNamespace(**dict(zip(("variables", "coordinates", "attributes"), given, strict=True)))


STATES = (
    State(0, None, None, 1.0, 0.1, ()),
    State(1, 0.5, None, 2.0, 0.2, (Flag("A", "finding", 1.0, 0.0, Severity.NOTE),)),
)


def test_labelled_points_and_edges_fill_missing_points(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(labelled, "installed", lambda name: Labelled())
    one, two = np.array([[1.0, 2.0]]), np.array([[3.0, 4.0], [5.0, 6.0]])
    tracked = [
        TrackedPoints(("a",), one, one + 1, np.array([0.1])),
        TrackedPoints(("a", "b"), two, two + 1, np.array([0.2, 0.3])),
    ]
    made = labelled.labelled_points(STATES, tracked, {"title": "t"})
    same(made.variables["rest"][1], [[[1, 2], [NAN, NAN]], two])
    same(made.variables["place"][1], [[[2, 3], [NAN, NAN]], two + 1])
    same(made.variables["sigma"][1], [[0.1, NAN], [0.2, 0.3]])
    assert made.variables["rest"][0] == ("state", "point", "axis")
    assert "point" not in made.coordinates
    assert made.coordinates["state"] == [0, 1]
    assert made.coordinates["field"] == ("state", [1.0, 2.0], {"units": "mT"})
    same(made.coordinates["current"][1], [NAN, 0.5])
    assert made.coordinates["tip_force"] == ("state", [0.1, 0.2], {"units": "N"})
    assert made.coordinates["flagged"] == ("state", [False, True])
    assert made.attributes == {"title": "t"}
    equal = labelled.labelled_points(STATES, [tracked[1], tracked[1]], {})
    assert equal.coordinates["point"] == ["a", "b"]
    edges = labelled.labelled_edges(STATES, [edge_set(None, "B"), edge_set((10.0, 2.0))], {})
    assert edges.variables["edge"][1].shape == (2, 2, 3, 2)
    assert np.isnan(edges.variables["edge"][1][0]).all()
    same(edges.variables["edge"][1][1, 0, 2], [10.0, 1.0])
    same(edges.variables["edge"][1][1, 1, 2], [10.0, 3.0])
    same(edges.variables["sigma"][1][1], np.full((2, 3), 0.1))
    assert edges.coordinates["flagged"] == ("state", [True, True])
    made_of = [edge_set((10.0, 2.0)), edge_set((20.0, 2.0)), edge_set((30.0, 2.0))]
    edges = labelled.labelled_edges((STATES[0], *STATES), made_of, {})
    same(edges.variables["edge"][1][:, :, 2, 0], [[10.0, 10.0], [20.0, 20.0], [30.0, 30.0]])
    assert edges.variables["sigma"][1].shape == (3, 2, 3)
    assert edges.coordinates["flagged"] == ("state", [False, False, True])
    assert edges.coordinates["side"] == ["left", "right"]
    assert edges.coordinates["axis"] == ["x", "y"]
    assert edges.coordinates["state"] == [0, 0, 1]
    assert edges.coordinates["side"] == ["left", "right"]


def test_the_plots_of_a_dataset(entry: h5py.Group) -> None:
    # The tip is the last point of the middle line, and the plot is in the order of the field.
    table = state_table(entry)
    table["field"][:] = [3.0, 1.0, 2.0]
    process = group(entry, "segmentation", "NXprocess")
    default_plots.write_plots(entry, process, [edge_set((9.0, 4.0)), edge_set(None), edge_set((9.0, -2.0))])
    plot = process["tip"]
    same(plot["field"][()], [1.0, 2.0, 3.0])
    same(plot["tip_deflection"][()], [NAN, -2.0, 4.0])
    assert (plot.attrs["signal"], list(plot.attrs["axes"]), list(plot.attrs["field_indices"])) == (
        "tip_deflection",
        ["field"],
        [0],
    )
    assert (process.attrs["default"], entry.attrs["default"]) == ("tip", "segmentation")
    assert (plot["field"].attrs["units"], plot["tip_deflection"].attrs["units"]) == ("mT", "mm")
    assert "outline" not in process


def dataset_of(kind: str, edges: Any = None) -> Dataset:
    # Return a dataset of STATES, stored as "points" or "frames" (`kind`), with an angle of gravity of 90 degrees.
    made = Dataset.__new__(Dataset)
    vars(made).update(kind=kind, states=STATES, specimen=SPECIMEN, path=Path("runs/run.h5"), calibration=None)
    vars(made).update(gravity=True, gravity_angle_deg=90.0, edges=lambda: edges)
    return made


def test_a_notebook_shows_the_states_with_the_flags_of_states_and_edges() -> None:
    assert repr(dataset_of("points")) == "<Dataset runs/run.h5: type1, 2 states of points>"
    text = dataset_of("points")._repr_html_()
    assert "run.h5: type1, Dragon Skin 10, 2 states of points<" in text
    for cell in ("state", "field, mT", "tip force, N", "flags", "1.000", "2.000", "0.1", "0.2", ">A<"):
        assert cell in text
    assert "2 states of frames; no edges yet<" in dataset_of("frames")._repr_html_()
    found = (edge_set((9.0, 0.0), "B"), edge_set((9.0, 0.0), "A", "C"))
    text = dataset_of("frames", found)._repr_html_()
    assert "2 states of frames; with edges<" in text
    assert ">B<" in text
    assert ">A, C<" in text


def test_what_a_dataset_does_not_have_is_refused() -> None:
    with pytest.raises(InputError, match=r"^runs/run\.h5: has no edges yet; `eimi segment` finds the edges$"):
        dataset_of("frames").to_xarray()
    with pytest.raises(ValueError, match=r"run\.h5 holds frames of a camera and no tracked points; `edges\(\)` gives"):
        dataset_of("frames").points()
    assert dataset_of("points").times_of_states().tolist() == []
    same(dataset_of("points").upright([[0.0, 1.0], [2.0, 0.0]]), [[0.0, -1.0], [-2.0, 0.0]])
    assert dataset_of("points").sensors() == ()


@pytest.mark.parametrize("kind", ["frames", "points"])
def test_a_dataset_without_its_texts_is_refused(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    texts = {"specimen": None, "calibration": None}
    monkeypatch.setattr(Dataset, "text", lambda self, name: texts[name])
    monkeypatch.setattr(reading, "refuse_links_and_absurd_sizes", lambda path, file: None)
    with h5py.File("memory.h5", "w", driver="core", backing_store=False) as file:
        states, data = file.create_group("entry/states"), file.create_group("entry/data")
        states.attrs.update({FORMAT_ATTRIBUTE: FORMAT, "gravity_angle_deg": 30, "field_angle_deg": 60})
        if kind == "frames":
            data["frames"] = np.zeros((1, 2, 2))
        words = r"^run\.h5: holds no specimen, so the dimensions of the beam are unknown; use another copy of the file$"
        with pytest.raises(InputError, match=words):
            Dataset(Path("run.h5"), file, True)
        texts["specimen"] = SPECIMEN.text  # type: ignore[assignment]
        monkeypatch.setattr(reading, "read_states", lambda *given: ([], None))
        if kind == "frames":
            words = r"^run\.h5: holds frames but no calibration, so their scale is unknown; use another copy of the"
            with pytest.raises(InputError, match=words):
                Dataset(Path("run.h5"), file, True)
            return
        made = Dataset(Path("run.h5"), file, True)
        assert (made.kind, made.calibration, made.gravity_angle_deg, made.field_angle_deg) == (
            "points",
            None,
            30.0,
            60.0,
        )
        assert made.gravity is True
        states.attrs["gravity"] = False
        assert Dataset(Path("run.h5"), file, True).gravity is False


def test_texts_of_tracked_points_cannot_be_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(restating, "open_dataset", lambda path: nullcontext(dataset_of("points")))
    with pytest.raises(InputError, match=r"^run\.h5: holds tracked points, so its specimen and calibration cannot be"):
        restating.restate(Path("run.h5"))


def test_directions_of_tip_forces_are_added_to_a_file_if_one_is_not_that_of_gravity(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file.create_group("entry/states")
    before = path.read_bytes()
    store_tip_force_angles(path, [None, None])
    assert path.read_bytes() == before
    store_tip_force_angles(path, [None, 30.0])
    with h5py.File(path) as file:
        same(file["entry/states/tip_force_angle"][()], [NAN, 30.0])
        assert file["entry/states/tip_force_angle"].attrs["units"] == "deg"


def stored_dataset(entry: h5py.Group, kind: str = "frames") -> Dataset:
    made = dataset_of(kind)
    del vars(made)["edges"]
    vars(made).update(_entry=entry, _if_damaged="advice")
    return made


def test_each_part_of_the_file_of_a_run_is_returned(entry: h5py.Group) -> None:
    write_state_columns(entry, "frames")
    frame_rows(entry, [0, 0, 1], time=[1.0, 2.0, 7.0])
    frame_stack(entry["data"], "frames", np.zeros((2, 3, 3), np.uint16))
    dataset = stored_dataset(entry)
    for missing in (dataset.text("rig"), dataset.truth(), dataset.projection(), dataset.correction(), dataset.edges()):
        assert missing is None
    assert (dataset.camera_setting("gain"), dataset.corrections(), dataset.resumable) == (None, (), False)
    assert (dataset.ring_downs(), dataset.creeps(), dataset.conditioning(), dataset.transient(0)) == (
        (),
        (),
        None,
        None,
    )
    assert (dataset.set_points(), dataset.recorded_ring_downs(), dataset.creep_frames(0)) == ((), (), None)
    assert dataset.frame_format() == ((2, 3, 3), np.uint16)
    assert (dataset.last_time_s(), dataset.times_of_states().tolist()) == (7.0, [1.5, 7.0])
    assert dataset.start_time() == datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    instrument = group(entry, "instrument", "NXinstrument")
    for number, text in ((1, "camera"), (0, "supply")):
        note(instrument, f"identity_{number}", text, "text/plain")
    instrument["detector/settings/gain"] = 2.5
    note(entry, "rig", "x = 1", "application/toml")
    note(entry, "truth", '{"mu": 3}', "application/json")
    process = group(entry, "segmentation", "NXprocess")
    note(process, "projection", Projection("red", (0.0, 0.0, 1.0)).to_json(), "application/json")
    group(entry, "sessions", "NXcollection")
    entry["states"].attrs["eimi_start_time"] = np.bytes_("2026-01-02T03:04:05")
    assert dataset.instruments() == ("supply", "camera")
    assert (dataset.camera_setting("gain"), dataset.text("rig"), dataset.truth()) == (2.5, "x = 1", {"mu": 3})
    assert dataset.projection() == Projection("red", (0.0, 0.0, 1.0))
    assert dataset.resumable
    assert dataset.start_time().tzinfo is UTC
    former = group(entry, "former", "NXcollection")
    for name, date, text in (("rig_0", "2026-02-03T00:00", "x = 3"), ("rig_1", "2026-02-04T00:00", "x = 2")):
        note(former, name, text, "application/toml")
        put_text(former[name], "date", date)
    assert dataset.corrections() == (
        "rig on 2026-02-03: x was 3, and is 2 now",
        "rig on 2026-02-04: x was 2, and is 1 now",
    )
    del entry["truth/data"]
    with pytest.raises(InputError, match=r"^runs/run\.h5: is damaged, or does not have the contents .*; advice$"):
        dataset.truth()


# Search beside neighbours


class Search:
    # A replacement for the search: it finds given edges in some states, and records its arguments.

    def __init__(self, edge_sets: list[EdgeSet], found: dict[int, EdgeSet]) -> None:
        self.edge_sets, self.found = list(edge_sets), found
        self.asked: list[tuple[int, int, int]] = []

    def __call__(self, index: int, guide: EdgeSet, *lines_mm: Array) -> EdgeSet:
        known = [*self.edge_sets, *self.found.values()]
        self.asked.append((index, next(k for k, one in enumerate(known) if one is guide), len(lines_mm)))
        return self.found.get(index, edge_set(None))


def test_a_beam_is_searched_with_the_nearest_earlier_and_then_later_state() -> None:
    nothing, here, there = edge_set(None), edge_set((10.0, 0.0)), edge_set((10.0, 3.0))
    sets = [nothing, here, nothing, nothing, there, nothing]
    search = Search(sets, {2: edge_set((10.0, 1.0))})
    neighbouring_states.search_beside_neighbours(sets, search, 1.0)
    assert sets[2] is search.found[2]
    # Forward: 2 beside 1, 3 beside the new 2 (number 6), 5 beside 4. Backward: 5 has no later state, 3 beside 4, 0
    # beside 1. Between two: 3 between 2 and 4.
    assert search.asked == [(2, 1, 1), (3, 6, 1), (5, 4, 1), (3, 4, 1), (0, 1, 1), (3, 6, 2)]


@pytest.mark.parametrize(("across", "accepted"), [(1.5, True), (3.2, True), (3.3, False), (-0.3, False)])
def test_a_beam_between_two_states_lies_between_them(across: float, accepted: bool) -> None:
    # Between lines at 0 and 3 mm, with half of the width of 1 mm as tolerance of both distances together.
    first, last = edge_set((10.0, 0.0)), edge_set((10.0, 3.0))
    sets = [first, edge_set(None), last]
    between = edge_set((10.0, across))
    search = Search(sets, {})
    answers = iter([edge_set(None), edge_set(None), between])
    neighbouring_states.search_beside_neighbours(sets, lambda *given: (search(*given), next(answers))[1], 1.0)
    assert (sets[1] is between) is accepted


def test_a_guess_before_the_first_reliable_state_is_searched_again() -> None:
    guess = edge_set((10.0, 9.0), "ROOT_AMBIGUOUS", severity=Severity.NOTE)
    bad = edge_set((10.0, 9.0), "WIDTH_ANOMALY")
    reliable = edge_set((10.0, 0.0))
    sets = [guess, bad, reliable, guess]
    search = Search(sets, {0: edge_set((10.0, 0.2))})
    neighbouring_states.search_beside_neighbours(sets, search, 1.0)
    assert search.asked == [(0, 2, 0), (1, 4, 2)]  # state 1 between the found state 0 and 2
    assert sets == [search.found[0], bad, reliable, guess]
    assert [neighbouring_states.is_reliable(one) for one in (guess, bad, reliable, edge_set(None))] == [
        False,
        False,
        True,
        False,
    ]


# A file that another program changed


def test_what_happened_to_an_open_file(tmp_path: Path) -> None:
    path, other = tmp_path / "run.h5", tmp_path / "other.h5"
    path.write_bytes(bytes(range(256)) * 20)
    descriptor = os.open(path, os.O_RDWR)
    os.lseek(descriptor, 700, os.SEEK_SET)
    assert lost_name.head_of(descriptor) == (bytes(range(256)) * 20)[:4096]
    assert os.lseek(descriptor, 0, os.SEEK_CUR) == 700
    assert lost_name.fate_of(path, descriptor) == ""
    path.rename(other)
    assert lost_name.fate_of(path, descriptor) == "was moved"
    path.write_bytes(b"new")
    assert lost_name.fate_of(path, descriptor) == "was moved, and another file now has the name of the dataset"
    other.unlink()
    assert lost_name.fate_of(path, descriptor) == "was replaced"
    path.unlink()
    assert lost_name.fate_of(path, descriptor) == "was deleted"
    os.close(descriptor)
    assert lost_name.fate_of(path, descriptor) == ""


def test_a_copy_gets_the_next_free_name_and_a_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = bytes(range(256)) * 9000  # more than two pieces of a MiB
    source = tmp_path / "source"
    source.write_bytes(content)
    descriptor = os.open(source, os.O_RDONLY)
    os.lseek(descriptor, 99, os.SEEK_SET)
    beats: list[int] = []
    for name in ("run-continued.h5", "run-continued-2.h5", "run-continued-3.h5"):
        copy, lock = lost_name.copy_beside(
            tmp_path / "gone" / "run.h5", descriptor, "was deleted", lambda: beats.append(1)
        )
        assert copy == tmp_path / "gone" / name
        assert copy.read_bytes() == content
        assert is_being_written(copy)
        lock.release()
    assert len(beats) == 3 * 3
    spare = tmp_path / "spare"
    monkeypatch.setattr(lost_name.tempfile, "gettempdir", lambda: str(spare))
    (tmp_path / "file").touch()
    copy, lock = lost_name.copy_beside(tmp_path / "file" / "run.h5", descriptor, "was moved", lambda: None)
    assert copy == spare / "run-continued.h5"
    lock.release()

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left")

    monkeypatch.setattr(os, "read", full)
    with pytest.raises(
        StorageFailed, match=r"run\.h5: was moved during the run, and no copy can be made: .*; .*No space"
    ):
        lost_name.copy_beside(tmp_path / "run.h5", descriptor, "was moved", lambda: None)
    assert not is_being_written(tmp_path / "run-continued.h5")
    assert not is_being_written(spare / "run-continued-2.h5")
    os.close(descriptor)


def test_room_is_reserved_before_a_dataset_is_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w", libver=("v110", "latest")) as file:
        file.create_group("entry")
    reserved: list[tuple[int, int]] = []
    monkeypatch.setattr(os, "posix_fallocate", lambda descriptor, *given: reserved.append(given), raising=False)
    size = path.stat().st_size
    with rewriting.rewritten(path, 1000) as made:
        made["x"] = 5
    assert reserved == [(0, size + 1000 + 16384)]
    with h5py.File(path) as file:
        assert file["entry/x"][()] == 5

    def interrupted() -> None:
        with rewriting.rewritten(path) as made:
            made["y"] = 6
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with h5py.File(path) as file:
        assert "y" not in file["entry"]
    monkeypatch.delattr(os, "posix_fallocate")
    with rewriting.rewritten(path) as made:
        made["z"] = 7
    path.write_bytes(b"damaged")
    with (
        pytest.raises(InputError, match=r"run\.h5: is still being written, or its writer crashed"),
        rewriting.rewritten(path),
    ):
        pass


@pytest.mark.parametrize(
    ("before", "after", "fields", "imported", "refused"),
    [
        (4.0, 6.0, [1.0], False, ""),
        (0.0, 0.0, [0.0], True, ""),
        (0.0, 0.0, [1.0], True, ""),
        (4.0, 0.0, [0.0], True, ""),
        (4.0, 4.0, [1.0], True, ""),
        (0.0, 5.0, [1.0], False, ""),
        (4.0, 0.0, [1.0], False, "is missing; the run used 4; give the coil constant"),
        (4.0, 6.0, [1.0], True, r"= 6, but run\.h5 was imported with 4; .*so repeat the import"),
        (4.0, 0.0, [1.0], True, r"= 0, but run\.h5 was imported with 4; .*so repeat the import"),
        (0.0, 5.0, [0.0], True, r"= 5, but run\.h5 was imported with 0; .*so repeat the import"),
    ],
)
def test_a_coil_constant_that_does_not_give_the_fields_is_refused(
    before: float, after: float, fields: list[float], imported: bool, refused: str
) -> None:
    states = [SimpleNamespace(field_mT=field) for field in fields]
    dataset: Any = SimpleNamespace(states=states, text=lambda name: None if imported else "text", path="run.h5")
    given: Any = [SimpleNamespace(mT_per_A=constant) for constant in (before, after)]
    expected: Any = nullcontext()
    if refused:
        expected = pytest.raises(InputError, match=rf"^c\.toml: coil_constant_mT_per_A {refused}$")
    with expected:
        restating._check_coil_constant(dataset, *given, Path("c.toml"))


# Videos


class Video:
    # A replacement for OpenCV's video, with numbered frames at 10 per second.

    def __init__(self, frames: int, opened: bool = True, **properties: float) -> None:
        self.frames, self.at, self.opened, self.released = frames, -1, opened, False
        self.properties = properties

    def isOpened(self) -> bool:
        return self.opened

    def release(self) -> None:
        self.released = True

    def grab(self) -> bool:
        self.at += 1
        return self.at < self.frames

    def retrieve(self) -> tuple[bool, Any]:
        return True, np.full((1, 1), self.at)

    def read(self) -> tuple[bool, Any]:
        return (True, self.retrieve()[1]) if self.grab() else (False, None)

    def get(self, number: int) -> float:
        return 100.0 * self.at if number == cv2.CAP_PROP_POS_MSEC else self.properties[str(number)]


@pytest.fixture
def film(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Video]:
    # A function that lets OpenCV open a video of some frames.
    def made(frames: int, **options: Any) -> Video:
        video = Video(frames, **options)
        monkeypatch.setattr(videos.cv2, "VideoCapture", lambda path: video)
        return video

    return made


PATH = Path("v.mp4")


def test_frames_and_times_of_a_video(film: Callable[..., Video]) -> None:
    video = film(3)
    same(videos.frame_times(PATH), [0.0, 0.1, 0.2])
    assert video.released
    film(3)
    assert [(int(image[0, 0]), time) for image, time in videos.timed_frames(PATH)] == [(0, 0.0), (1, 0.1), (2, 0.2)]
    film(9)
    assert [int(image[0, 0]) for image in videos.read_video(PATH, [0, 1, 5, 8])] == [0, 1, 5, 8]
    for frames, wanted, words in (
        (3, [1, 3], "has no frame 3 .*the video ends after 3 frames"),
        (3, [7], "has no frame 7 .*after 3 frames"),
    ):
        film(frames)
        with pytest.raises(InputError, match=rf"^v\.mp4: {words}"):
            list(videos.read_video(PATH, wanted))
    for read in (
        videos.frame_times,
        lambda path: list(videos.timed_frames(path)),
        lambda path: videos.looked_through(path, 1),
    ):
        film(0)
        with pytest.raises(InputError, match=r"^v\.mp4: holds no frame that OpenCV can read, or is damaged$"):
            read(PATH)
        closed = film(3, opened=False)
        with pytest.raises(InputError, match=r"^v\.mp4: is not a video that OpenCV can read, or is damaged$"):
            read(PATH)
        assert closed.released


@pytest.mark.parametrize(
    ("frames", "every", "step"), [(5, 2, 2), (16, 1, 1), (17, 1, 2), (33, 1, 4), (33, 2, 4), (32, 2, 2)]
)
def test_at_most_16_frames_at_equal_intervals_are_kept(
    film: Callable[..., Video], frames: int, every: int, step: int
) -> None:
    film(frames)
    times, kept = videos.looked_through(PATH, every)
    same(times, 0.1 * np.arange(frames))
    assert sorted(kept) == list(range(0, frames, step))
    assert all(int(image[0, 0]) == number for number, image in kept.items())


@pytest.mark.parametrize(
    ("turned", "rows"),
    [
        (0, (0.0, 1.0, 0.0)),
        (90, (-1.0, 0.0, 639.0)),
        (180, (0.0, -1.0, 479.0)),
        (270, (1.0, 0.0, 0.0)),
        (-90, (1.0, 0.0, 0.0)),
        (360, (0.0, 1.0, 0.0)),
    ],
)
def test_the_rows_of_a_turned_sensor(film: Callable[..., Video], turned: int, rows: tuple[float, float, float]) -> None:
    properties = {cv2.CAP_PROP_ORIENTATION_META: turned, cv2.CAP_PROP_FRAME_WIDTH: 640, cv2.CAP_PROP_FRAME_HEIGHT: 480}
    film(1, **{str(number): value for number, value in properties.items()})
    assert videos.row_direction(PATH) == rows


# The pictures that a table lists


@contextmanager
def listed(tmp_path: Path, text: str, images: tuple[str, ...] = ()) -> Iterator[Path]:
    folder = tmp_path / "frames"
    folder.mkdir(exist_ok=True)
    for name in images:
        (folder / name).touch()
    (tmp_path / "states.csv").write_text(text)
    yield folder


IMAGES = ("shot_2.png", "shot_10.png", "shot_7.PNG", "other.jpg", "a.b.png")


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        (["shot_10.png", "shot_2"], ["shot_2.png", "shot_10.png"]),
        (["7", "10"], ["shot_7.PNG", "shot_10.png"]),
        (["a.b", "frames/other.jpg"], ["a.b.png", "other.jpg"]),
        (["frames\\\\other.jpg"], ["other.jpg"]),
        (["007"], ["shot_7.PNG"]),
    ],
)
def test_a_row_names_an_image(tmp_path: Path, rows: list[str], found: list[str]) -> None:
    text = "frame,field_mT\n" + "".join(f"{row},{k}\n" for k, row in enumerate(rows))
    with listed(tmp_path, text.replace("\\\\", "\\"), IMAGES) as folder:
        made = listing.list_frames(folder, tmp_path / "states.csv")
    assert [frame.path.name for frame in made.frames] == found
    assert {path.name for path in made.left_out} == set(IMAGES) - set(found)
    assert made.files() == [folder / name for name in found]
    assert math.isnan(made.frames[0].time_s)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (["nine"], r"row 2: frame = 'nine' should be an image in .*frames; no image has this name$"),
        (["SHOT_2.png"], r"no image has this name; did you mean shot_2\.png\?"),
        (["x/SHOT_7.png"], r"did you mean shot_7\.PNG\?"),
        (["shot_2", *(f"a{k}" for k in range(7))], r"row 3: .*; the same holds for rows 4, 5, 6, 7, 8 and 1 more"),
        (["shot_2", "2"], "row 3: frame = '2' should be listed once; row 2 lists the same image"),
        (["\x00"], "no image has this name|is not"),
        (["a" * 300], "no image has this name$"),
        (["a" * 300 + ".png"], "no image has this name$"),
    ],
)  # fmt: skip
def test_a_row_without_its_image_is_named(tmp_path: Path, rows: list[str], words: str) -> None:
    text = "frame,field_mT\n" + "".join(f"{row},{k}\n" for k, row in enumerate(rows))
    with listed(tmp_path, text, IMAGES) as folder, pytest.raises(InputError, match=words):
        listing.list_frames(folder, tmp_path / "states.csv")


def test_a_name_that_several_images_have_is_refused(tmp_path: Path) -> None:
    with listed(tmp_path, "frame,field_mT\n3,1\n", ("a_3.png", "b_3.png")) as folder:
        with pytest.raises(InputError, match=r"the name of one image, but several images fit it: a_3\.png, b_3\.png"):
            listing.list_frames(folder, tmp_path / "states.csv")
        with pytest.raises(InputError, match=r"^--every 2: is for a video only, but .*frames is not a video"):
            listing.list_frames(folder, tmp_path / "states.csv", every=2)
        only = listing.list_frames(folder / "a_3.png", tmp_path / "states.csv")
        assert only.left_out == ()
        assert [frame.path for frame in only.frames] == [folder / "a_3.png"]


def test_words_and_numbers_of_names() -> None:
    assert [listing.last_number(stem) for stem in ("a_07", "7", "7a", "a1b22", "")] == [7, 7, None, 22, None]
    assert listing.some(["a", "b"]) == "a, b"
    assert listing.some(list("abcde")) == "a, b, c, d, e"
    assert listing.some(list("abcdefg")) == "a, b, c, d, e and 2 more"
    assert [listing.is_video(Path(name)) for name in ("a.MP4", "a.png")] == [True, False]
    assert [listing.is_image(Path(name)) for name in ("a.MP4", "a.PNG")] == [False, True]


def of_video(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, every: int | None = None) -> listing.Listing:
    # Return the frames, listed in a table, of a video of 11 frames at 0, 0.1, ..., 1 s.
    monkeypatch.setattr(listing, "frame_times", lambda path: 0.1 * np.arange(11))
    (tmp_path / "states.csv").write_text(text)
    return listing.list_frames(tmp_path / "v.mp4", tmp_path / "states.csv", every)


def numbers(made: listing.Listing) -> list[tuple[int, int]]:
    return [(int(frame.path.name), frame.row.line) for frame in made.frames]


def test_frames_of_a_video_are_listed_by_number_or_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = of_video(tmp_path, monkeypatch, "frame,field_mT\n5,1\n2,2\n")
    assert numbers(made) == [(2, 3), (5, 2)]
    assert math.isnan(made.frames[0].time_s)
    assert made.files() == [tmp_path / "v.mp4"]
    made = of_video(tmp_path, monkeypatch, "time_s,field_mT\n0.94,1\n0.14,2\n1.1,3\n")
    assert numbers(made) == [(1, 3), (9, 2), (10, 4)]
    assert made.frames[1].time_s == pytest.approx(0.9)
    assert numbers(of_video(tmp_path, monkeypatch, "time_s,field_mT\n0,1\n")) == [(0, 2)]
    for text, words in (
        ("time_s,field_mT\n1.11,1\n", r"row 2: time_s = '1\.11' should be within v\.mp4, which ends at 1\.100 s"),
        ("time_s,field_mT\n-0.1,1\n", "should be 0 or more, in seconds from the beginning of the video"),
        (
            "time_s,field_mT\n0.31,1\n0.29,2\n",
            r"row 3: time_s = '0\.29' should be listed once; row 2 lists the same frame",
        ),
        ("frame,field_mT\n3,1\n3,2\n", "row 3: frame = '3' should be listed once; row 2 lists the same frame"),
        ("frame,time_s,field_mT\n3,1,1\n", r"states\.csv: row 1: needs one of the columns frame and time_s"),
        ("field_mT\n3\n", r"row 1: needs one of the columns frame and time_s, which specify frames of v\.mp4"),
    ):
        with pytest.raises(InputError, match=words):
            of_video(tmp_path, monkeypatch, text)


def test_every_nth_frame_gets_the_load_that_acts_at_its_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = of_video(tmp_path, monkeypatch, "time_s,field_mT\n0.15,1\n0.55,2\n", 2)
    assert numbers(made) == [(2, 2), (4, 2), (6, 3), (8, 3), (10, 3)]
    assert made.frames[0].time_s == pytest.approx(0.2)
    made = of_video(tmp_path, monkeypatch, "frame,field_mT,until_s\n0,1,0.41\n6,2,\n", 2)
    assert numbers(made) == [(0, 2), (2, 2), (4, 2), (6, 3), (8, 3), (10, 3)]
    assert numbers(of_video(tmp_path, monkeypatch, "frame,field_mT,until_s\n0,1,0.39\n", 2)) == [(0, 2), (2, 2)]
    assert len(of_video(tmp_path, monkeypatch, "frame,field_mT\n0,1\n", 1).frames) == 11
    for text, every, words in (
        ("frame,field_mT\n4,1\n4,2\n", 1, "row 3: frame = '4' should be later than in the previous row"),
        ("time_s,field_mT\n0.5,1\n0.4,2\n", 1, r"row 3: time_s = '0\.4' should be later than in the previous row"),
        ("frame,field_mT\n1,1\n2,2\n", 3, "row 2: frame = '1' should be the beginning of a load with at least one of "
         r"the frames 0, 3, 6, \.\.\. of --every 3; the video has 11 frames and ends at 1\.000 s"),
        ("frame,field_mT\n0,1\n", 0, "^--every 0: should be 1 or more$"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=words):
            of_video(tmp_path, monkeypatch, text, every)


def test_the_images_of_a_listing_are_read_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    row = Row(Path("states.csv"), 2, {})
    monkeypatch.setattr(listing, "read_video", lambda path, numbers: [(path, number) for number in numbers])
    frames = tuple(listing.ListedFrame(PATH / str(number), row) for number in (3, 7))
    assert list(listing.Listing(PATH, frames).images()) == [(PATH, 3), (PATH, 7)]
    monkeypatch.setattr(listing, "read_image", lambda path: path.name)
    assert list(listing.Listing(tmp_path, frames).images()) == ["3", "7"]


# Before an import, and after a segmentation


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"picture": {"region_px": (0, 0, 641, 400)}}, r"region_px = .* should lie in the pictures of 640 x 400 px$"),
        ({"picture": {"region_px": (0, 0, 640, 400)}}, ""),
        ({"clamp_midpoint_px": (-0.6, 100.0)}, r"frame\.png: is 640 x 400 px; clamp_midpoint_px = .* is outside"),
        ({"clamp_midpoint_px": (639.6, 100.0)}, r"frame\.png: is 640 x 400 px; clamp_midpoint_px = .* is outside"),
        ({"clamp_midpoint_px": (100.0, -0.6)}, "is outside this picture"),
        ({"clamp_midpoint_px": (100.0, 399.6)}, "is outside this picture"),
        ({"pixels_per_mm": 81.0}, "which does not fit: correct pixels_per_mm"),
    ],
)
def test_a_picture_that_cannot_show_the_beam_is_refused_before_an_import(changes: Any, problem: str) -> None:
    values = {"pixels_per_mm": 8.0, "clamp_midpoint_px": (100.0, 100.0), "axis_angle_deg": 0.0}
    calibration = Calibration(gravity_angle_deg=90.0, **values | changes)
    with pytest.raises(InputError, match=problem) if problem else nullcontext():
        importing._check_against_picture(Path("frame.png"), SPECIMEN, calibration, 640, 400)


def test_a_run_without_an_end_gets_no_end_time(entry: h5py.Group) -> None:
    state_table(entry)
    put_text(entry, "end_time", "")
    stored_edges._comply_with_definition(entry)
    assert "end_time" not in entry
    assert entry["states"].attrs[START_ATTRIBUTE] == b"2026-01-02T03:04:05+00:00"
    assert get_text(entry, "start_time") == "2026-01-02T03:04:05+00:00"
    assert get_text(entry, "definition")
