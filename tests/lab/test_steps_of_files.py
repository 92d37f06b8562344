"""The functions that write, copy, repair and read a dataset call each other in the right order."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame, SensorReading
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset import (
    importing,
    lost_name,
    plotting,
    recovery,
    writing,
)
from eimi_lab.dataset.empty_file import empty_file
from eimi_lab.dataset.layout import (
    FRAME_COLUMNS,
    STATE_COLUMNS,
    Header,
    append,
    columns,
    flags_from_text,
    flags_to_text,
    get_text,
    put_date,
    write_state_columns,
)
from eimi_lab.dataset.logged_sensor import LoggedSensor
from eimi_lab.dataset.points import Load
from eimi_lab.dataset.reading import Dataset
from eimi_lab.dataset.recordings import Moment
from eimi_lab.dataset.repair import metadata
from eimi_lab.dataset.sensor_logs import LOG_COLUMNS, log_of, make_sensor_logs
from eimi_lab.dataset.steps import RingDownStep
from eimi_lab.dataset.storage_failure import StorageFailed
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError
from eimi_lab.vision.check import Flag, Severity
from tests.shared.noted import Noted, noted

NAN = float("nan")
PATH = Path("run.h5")
FLAG = Flag("A", 1.0, 0.0, "clean the lens", Severity.NOTE)


# Writing


class Written:
    # A writer whose file, arrays and functions note what they are given.

    def __init__(self, monkeypatch: pytest.MonkeyPatch, stored: int = 3) -> None:
        calls = self.calls = []  # type: list[Any]
        made: Any = DatasetWriter.__new__(DatasetWriter)
        self.writer = made
        self.fate = ""
        log = {column: Noted(calls, f"hall {column}") for column in LOG_COLUMNS}
        vars(made).update(
            path=PATH, _stored=stored, _abandoned=False, _descriptor=7, _head=b"head", _beat=noted(calls, "beat"),
            _warn=noted(calls, "warn"), _lock=Noted(calls, "lock"), _file=Noted(calls, "file"), _end_time=None,
            _frames=Noted(calls, "frames", shape=(9, 1, 2), dtype=np.dtype(np.uint8)),
            _columns={name: Noted(calls, name) for name in FRAME_COLUMNS},
            _states={name: Noted(calls, f"state {name}") for name in STATE_COLUMNS},
            _sensors={"hall": log}, _sessions={"end": {}},
            _recordings={"transients": "the transients", "ring_down": "the ring-downs", "conditioning": "c"},
            _set_points="points", _steps={"ring_down": [0, 1]}, _ring_downs=2,
        )  # fmt: skip
        monkeypatch.setattr(writing, "head_of", lambda descriptor: made._head)
        monkeypatch.setattr(writing, "fate_of", lambda path, descriptor: self.fate)
        monkeypatch.setattr(writing, "append_image", lambda frames, image: calls.append(("image", image.tolist())))
        monkeypatch.setattr(writing, "append", lambda column, values: calls.append(("append", column._name, values)))
        for name in ("append_moments", "append_set_points", "append_times", "append_step", "synchronise", "remove"):
            monkeypatch.setattr(writing, name, noted(calls, name))
        monkeypatch.setattr(writing, "now", lambda: "noon")


SYNCHRONISED = [("file.flush",), ("synchronise", 7)]


def only(calls: list[Any], *names: str) -> list[Any]:
    return [call for call in calls if call[0] in names]


def test_a_state_is_appended_row_by_row_and_its_table_last(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Written(monkeypatch)
    frames = [Frame(np.array([[k, k + 1]], np.uint8), 10 + k, 0.5 + k) for k in (0, 1)]
    moments = [Moment(frames[0], 1.0, 2.0, 0.3)]
    monkeypatch.setattr(writing, "append_moments", lambda name, store, images, *given: made.calls.append(
        ("append_moments", name, store, images.tolist(), *given)
    ))  # fmt: skip
    sensed = [{"hall": SensorReading(7.0, "mT", 40.0, 0.5)}, {}]
    made.writer.append_state(
        frames, current_A=0.5, field_mT=2.5, measured_A=[0.51, 0.52], time_s=[40.0, 41.0], tip_force_N=0.25,
        flags=(FLAG,), transient=moments, sensed=sensed, set_points=["a point"],
    )  # fmt: skip
    rows = {
        "state": [3, 3], "number": [10, 11], "timestamp": [0.5, 1.5], "time": [40.0, 41.0], "set_current": [0.5, 0.5],
        "measured_current": [0.51, 0.52], "field": [2.5, 2.5],
    }  # fmt: skip
    state = {"current": 0.5, "field": 2.5, "tip_force": 0.25, "flags": flags_to_text((FLAG,)), "index": 3}
    logged = {"time": [40.0, NAN], "value": [7.0, NAN], "value_errors": [0.5, NAN]}
    beat = made.writer._beat
    expected = [
        ("image", [[0, 1]]), ("beat",), ("image", [[1, 2]]), ("beat",),
        *[("append", name, rows[name]) for name in FRAME_COLUMNS],
        *[("append", f"hall {column}", logged[column]) for column in LOG_COLUMNS],
        ("frames.flush",),
        *[(f"{name}.flush",) for name in FRAME_COLUMNS],
        *[(f"hall {column}.flush",) for column in LOG_COLUMNS],
        ("append_moments", "transients", "the transients", [[[0, 1]]], [3], moments, beat),
        ("append_set_points", "points", ["a point"]),
        *[call for name in state for call in (("append", f"state {name}", [state[name]]), (f"state {name}.flush",))],
        ("file.flush",), ("synchronise", 7, beat),
    ]  # fmt: skip
    np.testing.assert_equal(made.calls, expected)
    assert made.writer.stored == 4
    made.calls.clear()
    made.writer.append_state(frames[:1], current_A=NAN, field_mT=0.0)
    np.testing.assert_equal(
        dict(call[1:] for call in only(made.calls, "append")),
        {
            "state": [4], "number": [10], "timestamp": [0.5], "time": [NAN], "set_current": [NAN], "field": [0.0],
            "measured_current": [NAN], **{f"hall {column}": [NAN] for column in LOG_COLUMNS}, "state current": [NAN],
            "state field": [0.0], "state tip_force": [0.0], "state flags": [flags_to_text(())], "state index": [4],
        },
    )  # fmt: skip
    assert only(made.calls, "append_moments") == []
    assert only(made.calls, "append_set_points") == [("append_set_points", "points", ())]


@pytest.mark.parametrize("image", [np.zeros((2, 2), np.uint8), np.zeros((1, 2), np.uint16)])
def test_frames_of_another_size_or_type_are_refused(monkeypatch: pytest.MonkeyPatch, image: Any) -> None:
    made = Written(monkeypatch)
    words = r"^the new frames have the shape .* and the type .*, but the frames before have \(1, 2\) and uint8; all"
    with pytest.raises(ValueError, match=words):
        made.writer.append_state([Frame(image, 0, 0.0)], current_A=0.0, field_mT=0.0)
    assert made.calls == []


@pytest.mark.parametrize("stored", [0, 2])
@pytest.mark.parametrize("what", ["recording", "ring-down", "unknown"])
def test_further_frames_are_synchronised_and_keep_the_name_of_stored_states(
    monkeypatch: pytest.MonkeyPatch, stored: int, what: str
) -> None:
    made = Written(monkeypatch, stored)
    kept: list[str] = []
    monkeypatch.setattr(DatasetWriter, "_keep_the_name", lambda self: kept.append("kept"))
    monkeypatch.setattr(DatasetWriter, "_refuse_overwritten", lambda self: made.calls.append("refuse"))
    moment = Moment(Frame(np.zeros((1, 2), np.uint8), 0, 0.0), 1.0, 2.0, 0.3)
    step = RingDownStep(1, 0.4, 0.0, 20.0, 0.05, 10, 3, 50.0)
    beat = made.writer._beat
    if what == "ring-down":
        made.writer.end_ring_down(step, [moment, moment], ["a point"])
        assert made.calls[:-2] == [
            ("append_set_points", "points", ["a point"]),
            ("append_times", writing.RING_DOWN, "the ring-downs", [1, 1], [moment, moment]),
            ("append_step", {"ring_down": [0, 1]}, step),
        ]
    else:
        made.writer.append_recording("conditioning" if what == "recording" else "other", [5], [moment])
        refused, *appended = made.calls[:-2]
        assert refused == "refuse"
        assert [call[:3] for call in appended] == [("append_moments", "conditioning", "c")] * (what == "recording")
    assert made.calls[-2:] == [("file.flush",), ("synchronise", 7, beat)]
    assert kept == ["kept"] * bool(stored)
    assert made.writer.ring_downs == 2 + (what == "ring-down")


def test_a_ring_down_is_streamed_to_its_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Written(monkeypatch)
    made.writer._recordings = {writing.RING_DOWN: {"frames": "its frames"}}
    monkeypatch.setattr(writing, "FrameStream", lambda frames: nullcontext(f"stream to {frames}"))
    monkeypatch.setattr(DatasetWriter, "_refuse_overwritten", lambda self: made.calls.append("refuse"))
    with made.writer.ring_down() as stream:
        assert stream == "stream to its frames"
        assert made.calls == ["refuse"]


@pytest.mark.parametrize(("has_end", "has_end_time"), [(True, True), (False, True), (False, False)])
def test_the_end_of_a_run_is_stored_in_its_session(
    monkeypatch: pytest.MonkeyPatch, has_end: bool, has_end_time: bool
) -> None:
    made = Written(monkeypatch)
    end, end_time = np.array([b"", b""], dtype="S4"), np.array(b"", dtype="S4")
    made.writer._sessions = {"end": end} if has_end else {}
    made.writer._end_time = end_time if has_end_time else None
    made.writer._close()
    assert end.tolist() == [b"", b"noon" if has_end else b""]
    assert end_time.item() == (b"noon" if has_end_time and not has_end else b"")
    assert made.calls == [("file.flush",), ("file.close",)]


def test_a_run_whose_file_was_taken_away_goes_on_in_a_copy(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Written(monkeypatch)
    old_lock, beat = made.writer._lock, made.writer._beat
    made.writer._keep_the_name()
    assert made.calls == []
    made.fate = "was deleted"
    states: list[bool] = []

    def attach(path: Path, lock: str) -> None:
        states.append(made.writer._abandoned)
        made.writer.path, made.writer._lock, made.writer._descriptor = path, lock, 8

    monkeypatch.setattr(writing.os, "dup", lambda descriptor: descriptor + 100)
    monkeypatch.setattr(writing.os, "close", noted(made.calls, "close"))
    monkeypatch.setattr(writing, "copy_beside", noted(made.calls, "copy", (Path("copy.h5"), "new lock")))
    monkeypatch.setattr(writing, "head_of", lambda descriptor: b"head of %d" % descriptor)
    monkeypatch.setattr(made.writer, "_attach", attach)
    made.writer._keep_the_name()
    assert made.calls == [
        ("file.flush",),
        ("file.close",),
        ("copy", PATH, 107, "was deleted", beat),
        ("close", 107),
        ("lock.release",),
        (
            "warn",
            "run.h5 was deleted during the run; the 3 states stored so far and all following states are in copy.h5",
        ),
    ]
    assert old_lock._name == "lock"
    assert (states, made.writer._head) == ([True], b"head of 8")


@pytest.mark.parametrize("stored", [0, 2])
@pytest.mark.parametrize("fate", ["", "was deleted"])
@pytest.mark.parametrize("abandoned", [False, True])
def test_a_file_without_a_state_is_removed_at_its_end(
    monkeypatch: pytest.MonkeyPatch, stored: int, fate: str, abandoned: bool
) -> None:
    made = Written(monkeypatch, stored)
    made.writer._abandoned = abandoned
    made.fate = fate
    for name in ("_refuse_overwritten", "_keep_the_name", "_close"):
        monkeypatch.setattr(DatasetWriter, name, lambda self, name=name: made.calls.append(name))
    with made.writer as entered:
        assert entered is made.writer
    expected = [
        "_refuse_overwritten",
        *["_keep_the_name"] * bool(stored),
        "_close",
        *[("remove", PATH)] * (not stored and not fate),
        ("lock.release",),
    ]
    assert made.calls == ([] if abandoned else expected)


FULL = OSError("write failed (errno = 28, error message = ...)")


@pytest.mark.parametrize(("error", "reason"), [(FULL, os.strerror(28)), (RuntimeError("y"), "y")])
@pytest.mark.parametrize("stored", [0, 2])
def test_a_failed_write_abandons_the_file(
    monkeypatch: pytest.MonkeyPatch, error: Exception, reason: str, stored: int
) -> None:
    made = Written(monkeypatch, stored)
    monkeypatch.setattr(DatasetWriter, "_abandon", lambda self: made.calls.append("abandon"))
    words = f"the {stored} states stored so far are safe, and {writing.CONTINUE_STORED}" if stored else "no state was"
    with pytest.raises(StorageFailed) as caught, made.writer._writing():
        raise error
    assert str(caught.value).startswith(f"run.h5: cannot be written any more: {reason}; {words}")
    assert caught.value.reason == reason
    assert made.calls == ["abandon"]
    monkeypatch.setattr(writing, "head_of", lambda descriptor: b"other")
    with pytest.raises(StorageFailed, match=rf"^run\.h5: another program wrote into the file .* the {stored} states "):
        made.writer._refuse_overwritten()
    assert made.calls == ["abandon"] * 2


@pytest.mark.parametrize("opens", [True, False])
def test_a_resumed_writer_holds_its_lock_and_begins_a_session(monkeypatch: pytest.MonkeyPatch, opens: bool) -> None:
    calls: list[Any] = []

    def attach(self: Any, path: Path, lock: Any) -> None:
        calls.append(("attach", path, lock))
        if not opens:
            raise InputError("run.h5: cannot be opened")

    lock = Noted(calls, "lock")
    monkeypatch.setattr(writing, "WriterLock", noted(calls, "make lock", lambda path: lock))
    monkeypatch.setattr(DatasetWriter, "_attach", attach)
    monkeypatch.setattr(DatasetWriter, "begin_session", lambda self: calls.append("session"))
    monkeypatch.setattr(DatasetWriter, "_end_last_set_point", lambda self: calls.append("end"))
    if opens:
        writer: Any = DatasetWriter.resume(PATH, "beat", "warn")  # type: ignore[arg-type]
        assert (writer._beat, writer._warn) == ("beat", "warn")
        assert calls == [("make lock", PATH), ("attach", PATH, lock), "session", "end"]
    else:
        with pytest.raises(InputError):
            DatasetWriter.resume(PATH)
        assert calls == [("make lock", PATH), ("attach", PATH, lock), ("lock.release",)]


def test_a_session_is_flushed_before_the_file_is_synchronised(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Written(monkeypatch)
    made.writer._sessions = {name: Noted(made.calls, name) for name in ("start", "first_state", "end")}
    made.writer.begin_session()
    values = {"start": b"noon", "first_state": 3, "end": b""}
    assert made.calls == [
        *[call for name in values for call in (("append", name, [values[name]]), (f"{name}.flush",))],
        ("file.flush",),
        ("synchronise", 7, made.writer._beat),
    ]


def test_a_warning_is_printed_where_nobody_takes_it(capsys: pytest.CaptureFixture[str]) -> None:
    writing._tell_warning("the file was moved")
    assert capsys.readouterr().err == "eimi: warning: the file was moved\n"
    writing._ignore()


# A new file


def test_a_new_file_has_the_settings_of_the_camera_and_the_note_of_a_person() -> None:
    settings: Any = SimpleNamespace(chosen=lambda: {"gain": 2.5, "exposure_s": 0.01})
    image = np.zeros((4, 6), np.uint8)
    header = Header(load_specimen("type1"), note="a remark", camera_settings=settings, without_contact="stays on")
    with h5py.File(BytesIO(empty_file(header, image))) as file:
        entry = file["entry"]
        detector = entry["instrument/detector"]
        assert {name: value[()] for name, value in detector["settings"].items()} == {"gain": 2.5, "exposure_s": 0.01}
        assert detector["settings"].attrs["NX_class"] == "NXcollection"
        assert get_text(entry["user_note"], "data") == "a remark"
        assert get_text(entry["user_note"], "type") == "text/plain"
        assert get_text(entry["instrument/supply"], "without_contact") == "stays on"
        assert entry["data/frames"].shape[1:] == (4, 6)
    with h5py.File(BytesIO(empty_file(Header(load_specimen("type1")), image))) as file:
        assert "user_note" not in file["entry"]
        assert "settings" not in file["entry/instrument/detector"]
        assert "without_contact" not in file["entry/instrument/supply"]


# Copies


def test_a_copy_has_the_next_free_name_beside_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(lost_name, "WriterLock", noted(calls, "lock", lambda path: f"lock of {path.name}"))
    monkeypatch.setattr(lost_name, "COPY_BYTES", 4)
    monkeypatch.setattr(lost_name.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    path = tmp_path / "moved" / "run.h5"
    (tmp_path / "source").write_bytes(b"0123456789")
    with (tmp_path / "source").open("rb") as opened:
        opened.seek(5)
        names = ["run-continued.h5", "run-continued-2.h5", "run-continued-3.h5"]
        for name in names:
            found, lock = lost_name.copy_beside(path, opened.fileno(), "was moved", noted(calls, "beat"))
            assert (found, lock) == (path.parent / name, f"lock of {name}")  # type: ignore[comparison-overlap]
            assert found.read_bytes() == b"0123456789"
            assert calls == [("lock", path.parent / name), *[("beat",)] * 3]
            calls.clear()


@pytest.mark.parametrize("fails", ["the folder", "the copy", "everything"])
def test_a_copy_goes_to_the_temporary_folder_if_that_of_the_file_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: str
) -> None:
    calls: list[Any] = []
    beside, temporary = tmp_path / "beside", tmp_path / "temporary"

    def lock(path: Path) -> Any:
        if fails == "everything" or (fails == "the folder" and path.parent == beside):
            raise InputError(f"{path.name} is in use in {path.parent.name}")
        return Noted(calls, f"lock in {path.parent.name}")

    @contextmanager
    def whole(name: Path, force: bool) -> Iterator[Path]:
        assert force is False
        if name.parent == beside:
            raise OSError("no space")
        yield name

    monkeypatch.setattr(lost_name, "WriterLock", lock)
    monkeypatch.setattr(lost_name, "whole_file", whole)
    monkeypatch.setattr(lost_name.tempfile, "gettempdir", lambda: str(temporary))
    (tmp_path / "source").write_bytes(b"0123")
    with (tmp_path / "source").open("rb") as opened:
        if fails == "everything":
            words = (
                r"run\.h5: was moved during the run, and no copy can be made: run-continued\.h5 is in use in beside; "
                r"run-continued\.h5 is in use in temporary$"
            )
            with pytest.raises(StorageFailed, match=words):
                lost_name.copy_beside(beside / "run.h5", opened.fileno(), "was moved", lambda: None)
            return
        found, _ = lost_name.copy_beside(beside / "run.h5", opened.fileno(), "was moved", lambda: None)
    assert found == temporary / "run-continued.h5"
    assert found.read_bytes() == b"0123"
    assert calls == [("lock in beside.release",)] * (fails == "the copy")


# Repair


@pytest.fixture
def entry() -> Iterator[h5py.Group]:
    # A dataset of 3 states with the frames 0 and 1, 2 and 3, and 4, a sensor, and a recording of three frames.
    with h5py.File("memory.h5", "w", driver="core", backing_store=False) as file:
        made = file.create_group("entry")
        put_date(made, "start_time", "2026-01-02T03:04:05+00:00")
        data = made.create_group("data")
        data.create_dataset("frames", data=np.arange(1, 6)[:, None, None] * np.ones((5, 1, 2)), maxshape=(None, 1, 2))
        for number, (name, column) in enumerate(columns(data, FRAME_COLUMNS).items()):
            append(column, [0, 0, 1, 1, 2] if name == "state" else [10 * number + k for k in range(5)])
        table = write_state_columns(made, "frames")
        for name, values in {"current": [0.0, 0.1, 0.2], "field": [0.0, 1.0, 2.0], "tip_force": [0.0] * 3}.items():
            append(table[name], values)
        append(table["flags"], [flags_to_text((FLAG,))] * 3)
        append(table["index"], [0, 1, 2])
        made.create_group("sample")
        make_sensor_logs(made, [LoggedSensor("hall", "F41", "field", "mT", 1.0, None, None)])
        for number, column in enumerate(log_of(made, "hall").values()):
            append(column, [100.0 * number + k for k in range(5)])
        yield made


def test_damaged_frames_are_removed_with_their_rows_and_flag_their_states(entry: h5py.Group) -> None:
    # Of state 0 the second frame is lost, of state 1 both: its first becomes black.
    assert recovery._drop_damaged(entry, [3, 1, 2]) == [0, 1]
    assert entry["data/frames"][:, 0, 0].tolist() == [1, 0, 5]
    assert entry["data/state"][()].tolist() == [0, 1, 2]
    for number, name in enumerate(FRAME_COLUMNS):
        if name != "state":
            assert entry["data"][name][()].tolist() == [10 * number + k for k in (0, 2, 4)]
    for number, column in enumerate(log_of(entry, "hall").values()):
        assert column[()].tolist() == [100.0 * number + k for k in (0, 2, 4)]
    flags = [[(flag.name, flag.value) for flag in flags_from_text(text)] for text in entry["states/flags"][()]]
    assert flags == [[("A", 1.0), ("DROPPED", 1.0)], [("A", 1.0), ("DROPPED", 2.0)], [("A", 1.0)]]


def test_rows_of_states_that_are_not_stored_are_cut_off(entry: h5py.Group) -> None:
    recovery._drop_unacknowledged(entry, 2)
    assert [len(entry["states"][name]) for name in ("current", "field", "tip_force", "flags", "index")] == [2] * 5
    assert {len(entry["data"][name]) for name in ("frames", *FRAME_COLUMNS)} == {4}
    assert {len(column) for column in log_of(entry, "hall").values()} == {4}


def test_damaged_frames_of_recordings_are_removed_and_unreadable_recordings_are_left_out(
    entry: h5py.Group, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[Any] = []

    def rows(entry: Any, name: str, states: int) -> Any:
        if name == "conditioning":
            raise OSError("wrong checksum")
        return np.array([4, 5, 7])

    for name in ("conditioning", "transients"):
        entry.create_group(name)
    entry["transients/frames"] = "the frames"
    monkeypatch.setattr(recovery, "complete_rows", noted(calls, "rows", rows))
    monkeypatch.setattr(recovery, "keep_rows", lambda entry, name, rows: calls.append(("keep", name, rows.tolist())))
    monkeypatch.setattr(recovery, "readable", lambda frames, row: row != 5)
    assert recovery._drop_unreadable(entry, 3) == [
        "unreadable and left out: entry/conditioning",
        "damaged frames left out of transients: 1",
    ]
    assert calls == [
        ("rows", entry, "conditioning", 3),
        ("rows", entry, "transients", 3),
        ("keep", "transients", [4, 7]),
    ]
    assert "conditioning" not in entry
    monkeypatch.setattr(recovery, "readable", lambda frames, row: True)
    assert recovery._drop_unreadable(entry, 3) == []


@pytest.mark.parametrize(
    ("attempts", "mended", "outcome"),
    [
        ([(3, [])], 0, (3, [])),
        ([(3, ["lost"])], 0, (3, ["lost"])),
        ([(3, ["lost"]), (4, ["less"])], 5, (4, ["single flipped bits in the file that were corrected: 5", "less"])),
        ([OSError("x"), (4, [])], 5, (4, ["single flipped bits in the file that were corrected: 5"])),
        ([InputError("damaged")], 0, InputError),
        ([InputError("damaged"), InputError("still damaged")], 5, InputError),
    ],
)
def test_a_file_is_mended_only_if_something_cannot_be_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, attempts: list[Any], mended: int, outcome: Any
) -> None:
    calls: list[Any] = []
    results = iter(attempts)

    def attempt(*_: Any) -> Any:
        result = next(results)
        if isinstance(result, Exception):
            raise result
        return result

    monkeypatch.setattr(recovery, "MendedFile", noted(calls, "open", "file"))
    monkeypatch.setattr(recovery, "is_hdf5", lambda file: True)
    monkeypatch.setattr(recovery, "close_superblock", noted(calls, "superblock"))
    monkeypatch.setattr(recovery, "_attempt", noted(calls, "attempt", attempt))
    monkeypatch.setattr(recovery, "mend_metadata", noted(calls, "metadata", min(mended, 3)))
    monkeypatch.setattr(recovery, "_mend_all_chunks", noted(calls, "chunks", max(mended - 3, 0)))
    target = tmp_path / "copy.h5"
    if isinstance(outcome, type):
        with pytest.raises(outcome) as caught:
            recovery.copy_readable(PATH, target)
        assert caught.value is attempts[-1]
    else:
        assert recovery.copy_readable(PATH, target) == outcome
    first = ("attempt", "file", PATH, target)
    tried = [("open", PATH), ("superblock", "file"), first]
    whole = attempts[0] == (3, [])
    assert calls == [*tried, *[("metadata", "file"), ("chunks", "file")] * (not whole), *[first] * (len(attempts) - 1)]
    monkeypatch.setattr(recovery, "is_hdf5", lambda file: False)
    with pytest.raises(InputError, match=r"^run\.h5: is not an HDF5 file$"):
        recovery.copy_readable(PATH, target)


def test_the_chunks_of_all_arrays_are_mended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with h5py.File(tmp_path / "file.h5", "w") as file:
        file["a"], file["b/c"], file["b/d"] = [1], [2], [3]
    seen: list[str] = []
    monkeypatch.setattr(recovery, "mend_chunks", lambda file, item: seen.append(item.name) or len(seen))
    assert recovery._mend_all_chunks(tmp_path / "file.h5") == 1 + 2 + 3  # type: ignore[arg-type]
    assert seen == ["/a", "/b/c", "/b/d"]
    (tmp_path / "file.h5").write_bytes(b"text")
    assert recovery._mend_all_chunks(tmp_path / "file.h5") == 0  # type: ignore[arg-type]


class Bytes:
    # A file in memory; `find` yields the positions at which a pattern matches.

    def __init__(self, content: bytes) -> None:
        self.content = content

    def bytes_at(self, at: int, length: int) -> bytes:
        return self.content[at : at + length]

    def find(self, pattern: Any) -> Iterator[int]:
        yield from (match.start() for match in pattern.finditer(self.content))


@pytest.mark.parametrize(
    ("content", "mends", "asked", "mended"),
    [
        (b"..OHDR..EAHD..FHDB", True, [(2, None), (8, b"EAHD"), (14, b"FHDB")], 3),
        (b"..OHDR..EAHD", False, [(2, None), (8, b"EAHD")] * 2, 0),
        (b"..OHDR..E\x40HD", False, [(2, None), (2, None), (8, b"EAHD")], 0),  # one flipped bit: 0x40 for A, 0x41
        (b"..OHDR..E\x42HD", False, [(2, None), (2, None)], 0),  # two flipped bits
        (b"..NHDR..", True, [(2, None)], 1),
        (b"..OHD", True, [], 0),
    ],
)
def test_blocks_with_a_wrong_bit_in_their_signature_are_searched_second(
    monkeypatch: pytest.MonkeyPatch, content: bytes, mends: bool, asked: list[Any], mended: int
) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(metadata, "_mend_header", lambda file, at: calls.append((at, None)) or int(mends))
    monkeypatch.setattr(metadata, "_mend_signed", lambda file, at, name: calls.append((at, name)) or int(mends))
    assert metadata.mend_metadata(Bytes(content)) == mended  # type: ignore[arg-type]
    assert calls == asked


def test_a_block_is_mended_by_its_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metadata, "_mend_heap", lambda file, at: f"heap at {at}")
    monkeypatch.setattr(metadata, "_block_lengths", lambda *given: given)
    monkeypatch.setattr(metadata, "_mend_any", lambda *given: (given, "length"))
    assert metadata._mend_signed("file", 5, b"FHDB") == "heap at 5"  # type: ignore[arg-type, comparison-overlap]
    found: Any = metadata._mend_signed("file", 5, b"EAHD")  # type: ignore[arg-type]
    assert found == ("file", 5, ("file", 5, b"EAHD"))


# Reading


@pytest.mark.parametrize("kind", ["frames", "points"])
def test_a_dataset_is_plotted_upright(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(plotting, "drawn_places", noted(calls, "draw", "a figure"))
    made: Any = Dataset.__new__(Dataset)
    sides = SimpleNamespace(left=SimpleNamespace(points_mm="left"), right=SimpleNamespace(points_mm="right"))
    vars(made).update(kind=kind, states="states", upright=lambda places: f"upright {places}", edges=lambda: [sides])
    vars(made).update(points=lambda: [SimpleNamespace(points_mm="a"), SimpleNamespace(points_mm="b")])
    assert made.plot() == "a figure"
    places = [["upright left", "upright right"]] if kind == "frames" else [["upright a"], ["upright b"]]
    assert calls == [("draw", "states", places, ("to the right", "up"), ("lines", kind == "frames"))]


def test_a_dataset_that_is_opened_again_keeps_its_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    made: Any = Dataset.__new__(Dataset)
    vars(made).update(path=PATH, _file=Noted(calls, "old file"), _if_damaged="advice")
    monkeypatch.setattr("eimi_lab.dataset.reading.open_file", noted(calls, "open", ("new file", True)))
    monkeypatch.setattr(Dataset, "_open", lambda self, path, file: calls.append(("read", path, file)))
    made.reopen()
    assert calls == [("old file.close",), ("open", PATH), ("read", PATH, "new file")]
    assert (made._file, made.finished, made._if_damaged) == ("new file", True, "advice")


# Imports


def test_an_import_names_its_own_file_if_the_disk_is_full(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fail(*given: Any, **named: Any) -> None:
        raise StorageFailed("temporary.h5: cannot be written any more", "No space left on device")

    image = np.zeros((4, 6), np.uint8)
    frame = SimpleNamespace(row=None, path=Path("f.png"), time_s=0.0)
    listing = SimpleNamespace(frames=[frame], images=lambda: iter([image]))
    monkeypatch.setattr(importing, "list_frames", lambda *given: listing)
    monkeypatch.setattr(importing, "load_of", lambda *given: Load(0.0, 0.0, 0.0))
    monkeypatch.setattr(importing, "_check_against_picture", lambda *given: None)
    monkeypatch.setattr(importing, "_oldest", lambda listing: "noon")
    monkeypatch.setattr(importing, "DatasetWriter", fail)
    target = tmp_path / "import.h5"
    with pytest.raises(OSError, match=rf"^{target}: cannot be written: No space left on device$"):
        importing.import_frames(Path("f"), Path("s.csv"), load_specimen("type1"), None, target)  # type: ignore[arg-type]
