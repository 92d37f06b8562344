"""Every file is on the disk before the program reports that it was written."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.csv_tables import Row
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.dark_and_flat import check_like, forget_correction, store_correction
from eimi_lab.dataset.layout import FORMAT, FORMAT_ATTRIBUTE, Header
from eimi_lab.dataset.points import Load, TrackedPoints, write_points
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recovery import copy_readable
from eimi_lab.dataset.restating import restate
from eimi_lab.dataset.state_loads import load_of
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.fits.checkpoint import Checkpoint, Head
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import whole_file, whole_folder, write_whole
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from tests.patience import PATIENCE_S

Draw = Callable[..., np.ndarray]


def header(files: Path) -> Header:
    return Header(
        load_specimen(files / "specimen.toml"),
        load_calibration(files / "calibration.toml"),
        load_protocol(files / "protocol.toml"),
    )


@pytest.fixture
def synchronised(monkeypatch: pytest.MonkeyPatch) -> dict[int, bytes]:
    # The contents of each file when it was last synchronised, by the inode number of the file.
    contents: dict[int, bytes] = {}
    fsync = os.fsync

    def noted(descriptor: int) -> None:
        fsync(descriptor)
        about = os.fstat(descriptor)
        reader = os.open(f"/proc/self/fd/{descriptor}", os.O_RDONLY)
        contents[about.st_ino] = os.pread(reader, about.st_size, 0)
        os.close(reader)

    monkeypatch.setattr(os, "fsync", noted)
    return contents


pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="looks at files as Linux shows them")


def test_a_state_is_on_the_disk_when_it_is_acknowledged(
    files: Path, frame: Draw, synchronised: dict[int, bytes]
) -> None:
    path = files / "run.h5"
    with DatasetWriter(path, header(files), Frame(frame(0), 0, 0.0)) as writer:
        for k in range(3):
            writer.append_state([Frame(frame(k), k, 0.0)], current_A=k / 10, field_mT=0.47 * k)
            assert synchronised[path.stat().st_ino] == path.read_bytes()
            (files / "copy.h5").write_bytes(synchronised[path.stat().st_ino])
            with open_dataset(files / "copy.h5") as dataset:
                assert [state.current_A for state in dataset.states] == [n / 10 for n in range(k + 1)]
                assert np.array_equal(dataset.images(k)[0], frame(k))


def test_a_run_reacts_while_a_busy_disk_writes_a_state(
    files: Path, frame: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    # While the writer waits for the disk, it calls `beat` in the main thread: the run shows that it is alive, and
    # reacts to signals.
    writes, alive = threading.Event(), threading.Event()

    def of_a_busy_disk(descriptor: int) -> None:
        writes.set()
        assert alive.wait(PATIENCE_S), "the writer gave no sign of life while the disk worked"

    def beat() -> None:
        if writes.is_set() and threading.current_thread() is threading.main_thread():
            alive.set()

    with DatasetWriter(files / "run.h5", header(files), Frame(frame(0), 0, 0.0), beat=beat) as writer:
        monkeypatch.setattr(os, "fsync", of_a_busy_disk)
        writer.append_state([Frame(frame(0), 0, 0.0)], current_A=0.0, field_mT=0.0)
        assert alive.is_set()
        monkeypatch.undo()


def test_a_whole_file_is_on_the_disk_before_it_gets_its_final_name(
    tmp_path: Path, synchronised: dict[int, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    replace = os.replace
    contents: list[bytes] = []

    def noted(source: Any, target: Any) -> None:
        contents.append(synchronised.get(os.stat(source).st_ino, b""))
        replace(source, target)

    monkeypatch.setattr(os, "replace", noted)
    with whole_file(tmp_path / "a.json", force=False) as temporary:
        temporary.write_text("{}")
    with whole_folder(tmp_path / "folder", force=False) as unfinished:
        write_whole(unfinished / "tip.csv", b"1,2\n")
    assert contents == [b"{}", b"1,2\n"]


def test_a_line_of_a_checkpoint_is_on_the_disk(tmp_path: Path, synchronised: dict[int, bytes]) -> None:
    log = tmp_path / "log.jsonl"
    Checkpoint(log, Head(fits=("one",), datasets=(), options={}, versions={}), resume=False)
    assert synchronised[log.stat().st_ino] == log.read_bytes()


def test_every_unit_in_a_file_is_the_unit_of_its_numbers(files: Path, frame: Draw) -> None:
    path, tracked = files / "run.h5", files / "tracked.h5"
    with DatasetWriter(path, header(files), Frame(frame(0), 0, 0.0)) as writer:
        writer.append_state([Frame(frame(0), 0, 0.0)], current_A=0.1, field_mT=0.47)
    points = EdgePoints(np.zeros((3, 2)), np.ones(3))
    write_edges(path, [EdgeSet(points, points, (), np.zeros((4, 2)))])
    rest = np.zeros((1, 2))
    write_points(
        tracked,
        Header(load_specimen(files / "specimen.toml")),
        0.0,
        [Load(None, 1.0, 0.1, 30.0)],
        [TrackedPoints(("a",), rest, rest, np.ones(1))],
    )
    units = {}
    for file in (path, tracked):
        with h5py.File(file) as opened:
            opened.visititems(
                lambda name, item, file=file: units.update({f"{file.stem} {name}": item.attrs.get("units")})
            )
    expected = {
        "run entry/data/field": "mT",
        "run entry/data/set_current": "A",
        "run entry/data/measured_current": "A",
        "run entry/data/timestamp": "s",
        "run entry/data/time": "s",
        "run entry/states/current": "A",
        "run entry/states/field": "mT",
        "run entry/states/tip_force": "N",
        "run entry/segmentation/edges/left/points": "mm",
        "run entry/segmentation/edges/right/sigma": "mm",
        "run entry/segmentation/edges/corners": "pixel",
        "run entry/segmentation/edges/calibration_age": "day",
        **{f"tracked entry/data/{name}": "mm" for name in ("x0", "y0", "z0", "x", "y", "sigma")},
        "tracked entry/states/tip_force_angle": "deg",
    }
    assert {name: units[name] for name in expected} == expected


@pytest.mark.parametrize("format_", [FORMAT + 1, FORMAT - 1])
def test_a_file_of_another_format_is_not_read(files: Path, frame: Draw, format_: int) -> None:
    path = files / "run.h5"
    with DatasetWriter(path, header(files), Frame(frame(0), 0, 0.0)) as writer:
        writer.append_state([Frame(frame(0), 0, 0.0)], current_A=0.1, field_mT=0.47)
    with h5py.File(path, "r+", libver="latest") as file:
        file["entry/states"].attrs[FORMAT_ATTRIBUTE] = format_
    with pytest.raises(InputError, match=f"is of format {format_}; this version reads {FORMAT}"):
        open_dataset(path)


def test_recovery_leaves_out_frames_that_belong_to_no_stored_state(files: Path, frame: Draw) -> None:
    # A crash may leave such frames in the file.
    path = files / "run.h5"
    with DatasetWriter(path, header(files), Frame(frame(0), 0, 0.0)) as writer:
        for k in range(3):
            writer.append_state([Frame(frame(k), k, 0.0)], current_A=k / 10, field_mT=0.47 * k)
    with h5py.File(path, "r+", libver="latest") as file:
        for column in file["entry/states"].values():
            column.resize(2, axis=0)
    assert copy_readable(path, files / "whole.h5")[0] == 2
    with h5py.File(files / "whole.h5") as file:
        assert file["entry/data/frames"].shape[0] == len(file["entry/data/state"]) == 2


def test_current_and_field_of_a_table_follow_the_coil_constant(files: Path) -> None:
    calibration = load_calibration(files / "calibration.toml")  # coil constant 4.7 mT/A

    def load(**cells: str) -> Load:
        return load_of(Row(Path("states.csv"), 2, cells), calibration)

    given = load(current_A="0.5", tip_force_N="0.01", tip_force_angle_deg="30")
    assert given == Load(0.5, pytest.approx(2.35), 0.01, 30.0)
    assert load(field_mT="2.35") == Load(pytest.approx(0.5), 2.35, 0.0, None)


@pytest.mark.parametrize(("dark", "fits"), [(5, True), (90, True), (120, False), (190, False)])
def test_a_dark_frame_is_dark(dark: int, fits: bool) -> None:
    lit = np.full((40, 40), 200, np.uint8)
    images = {"dark": np.full((40, 40), dark, np.uint8)}
    if fits:
        check_like(images, lit)
        return
    with pytest.raises(InputError, match="take the dark frame with the light off"):
        check_like(images, lit)


def test_edges_are_removed_when_calibration_or_correction_images_change(files: Path, frame: Draw) -> None:
    # The next segmentation may be interrupted, so that old edges would stay in the dataset.
    path = files / "run.h5"
    with DatasetWriter(path, header(files), Frame(frame(0), 0, 0.0)) as writer:
        writer.append_state([Frame(frame(0), 0, 0.0)], current_A=0.1, field_mT=0.47)
    points = EdgePoints(np.zeros((3, 2)), np.ones(3))
    lit = np.full_like(frame(0), 250)
    for change in (
        lambda: store_correction(path, {"flat": lit}),
        lambda: forget_correction(path),
        lambda: restate(path, changes={"axis_angle_deg": 89.0}),
    ):
        write_edges(path, [EdgeSet(points, points, (), np.zeros((4, 2)))])
        with open_dataset(path) as dataset:
            assert dataset.edges() is not None
        change()
        with open_dataset(path) as dataset:
            assert dataset.edges() is None
