"""The states (load steps) of a dataset are read as they were written, also from a file that was never closed."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame, Identity
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.frame_chunk import append_image
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recovery import recover
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError
from eimi_lab.vision.check import Flag
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from tests.patience import PATIENCE_S

NOT_SETTLED = Flag("NOT_SETTLED", 1.7, 1.2, "Wait longer: 30 s were not enough.")


def header(files: Path) -> Header:
    return Header(
        specimen=load_specimen(files / "specimen.toml"),
        calibration=load_calibration(files / "calibration.toml"),
        protocol=load_protocol(files / "protocol.toml"),
        instruments=(Identity("korad", "KORADKA3005P", "/dev/ttyACM0"),),
        truth={"model": "yeoh", "parameters": {"C10": 34000.0}},
    )


def write_states(path: Path, files: Path, draw: Callable[..., np.ndarray], states: int) -> None:
    with DatasetWriter(path, header(files), Frame(draw(0), 0, 0.0)) as writer:
        for k in range(states):
            frames = [Frame(draw(10 * k + n), 100 + 10 * k + n, k + n / 30) for n in range(2)]
            writer.append_state(
                frames,
                current_A=k / 10,
                field_mT=k * 0.47,
                measured_A=[k / 10 + 0.001, k / 10 + 0.003],
                time_s=[float(k), k + 0.1],
                tip_force_N=0.5,
                flags=(NOT_SETTLED,) if k == 1 else (),
            )


def test_a_dataset_is_read_back_as_it_was_written(files: Path, frame: Callable[..., np.ndarray]) -> None:
    path = files / "run.h5"
    write_states(path, files, frame, 3)
    with open_dataset(path) as dataset:
        assert dataset.finished
        assert dataset.kind == "frames"
        assert dataset.specimen == load_specimen(files / "specimen.toml")
        assert dataset.calibration == load_calibration(files / "calibration.toml")
        assert dataset.text("protocol") == (files / "protocol.toml").read_text()
        assert dataset.text("rig") is None
        assert (dataset.gravity_angle_deg, dataset.field_angle_deg) == (0.0, 90.0)
        assert [state.current_A for state in dataset.states] == [0.0, 0.1, 0.2]
        assert [state.field_mT for state in dataset.states] == [0.0, 0.47, 0.94]
        assert [state.measured_A for state in dataset.states] == pytest.approx([0.002, 0.102, 0.202])
        assert [state.flags for state in dataset.states] == [(), (NOT_SETTLED,), ()]
        assert dataset.states[2].tip_force_N == 0.5
        assert np.array_equal(dataset.images(2), np.stack([frame(20), frame(21)]))
        assert dataset.edges() is None
        assert dataset.truth() == {"model": "yeoh", "parameters": {"C10": 34000.0}}


def test_every_column_of_a_frame_is_in_the_file(files: Path, frame: Callable[..., np.ndarray]) -> None:
    path = files / "run.h5"
    write_states(path, files, frame, 2)
    with h5py.File(path, "r") as file:
        data = file["entry/data"]
        assert data["state"][()].tolist() == [0, 0, 1, 1]
        assert data["number"][()].tolist() == [100, 101, 110, 111]
        assert data["timestamp"][()] == pytest.approx([0, 1 / 30, 1, 1 + 1 / 30])
        assert data["set_current"][()].tolist() == [0.0, 0.0, 0.1, 0.1]
        assert file["entry/instrument/supply/measured_current/value"][()] == pytest.approx([0.001, 0.003, 0.101, 0.103])
        assert file["entry/instrument/supply/measured_current/time"].attrs["units"] == "s"
        assert file["entry/instrument/detector/data"].fletcher32
        assert "KORADKA3005P" in file["entry/instrument/identity_0/data"][()].decode()


def test_frames_in_colour_and_with_sixteen_bits_are_stored_unchanged(
    files: Path, frame: Callable[..., np.ndarray]
) -> None:
    deep = frame(0).astype(np.uint16) * 200
    with DatasetWriter(files / "deep.h5", header(files), Frame(deep, 0, 0.0)) as writer:
        writer.append_state([Frame(deep, 0, 0.0)], current_A=0.0, field_mT=0.0)
        with pytest.raises(ValueError, match="uint8"):
            writer.append_state([Frame(frame(0), 1, 0.0)], current_A=0.1, field_mT=0.47)
    with open_dataset(files / "deep.h5") as dataset:
        assert np.array_equal(dataset.images(0)[0], deep)
    colour = np.dstack([frame(0), frame(1), frame(2)])  # the colours are in the order blue, green, red
    with DatasetWriter(files / "colour.h5", header(files), Frame(colour, 0, 0.0)) as writer:
        writer.append_state([Frame(colour, 0, 0.0)], current_A=0.0, field_mT=0.0)
    with open_dataset(files / "colour.h5") as dataset:
        assert np.array_equal(dataset.images(0)[0], colour)
    with h5py.File(files / "colour.h5") as file:  # the file has the order of NeXus, red first
        assert file["entry/data/frames"].attrs["interpretation"] == "rgb-image"
        assert np.array_equal(file["entry/data/frames"][0, ..., 0], frame(2))


def test_a_file_is_never_overwritten_unless_forced(files: Path, frame: Callable[..., np.ndarray]) -> None:
    path = files / "run.h5"
    path.write_text("precious")
    with pytest.raises(InputError, match="exists already"):
        DatasetWriter(path, header(files), Frame(frame(0), 0, 0.0))
    assert path.read_text() == "precious"
    with DatasetWriter(path, header(files), Frame(frame(0), 0, 0.0), force=True) as writer:
        writer.append_state([Frame(frame(0), 0, 0.0)], current_A=0.0, field_mT=0.0)
    with open_dataset(path) as dataset:
        assert len(dataset.states) == 1


def test_a_run_without_a_state_leaves_no_file(files: Path, frame: Callable[..., np.ndarray]) -> None:
    with DatasetWriter(files / "run.h5", header(files), Frame(frame(0), 0, 0.0)):
        pass
    assert not (files / "run.h5").exists()


def edge_set(points: int, *flags: Flag) -> EdgeSet:
    rng = np.random.default_rng(points)
    edges = [EdgePoints(rng.normal(size=(n, 2)), rng.uniform(0.1, 1, n)) for n in (points, 2 * points)]
    return EdgeSet(edges[0], edges[1], flags, rng.normal(size=(4, 2)))


def test_stored_edges_are_read_back_and_replace_earlier_ones(files: Path, frame: Callable[..., np.ndarray]) -> None:
    path = files / "run.h5"
    write_states(path, files, frame, 3)
    nothing = EdgePoints(np.empty((0, 2)), np.empty(0))
    lost = EdgeSet(nothing, nothing, (Flag("LOW_CONTRAST", 3.0, 20.0, "Light."),), np.full((4, 2), np.nan))
    for stored in ([edge_set(n) for n in (5, 6, 7)], [edge_set(4, NOT_SETTLED, NOT_SETTLED), lost, edge_set(2)]):
        write_edges(path, stored)
        with open_dataset(path) as dataset:
            read = dataset.edges()
            assert read is not None
            for expected, edges in zip(stored, read, strict=True):
                assert np.array_equal(expected.left.points_mm, edges.left.points_mm)
                assert np.array_equal(expected.right.sigma_mm, edges.right.sigma_mm)
                assert np.array_equal(expected.corners_px, edges.corners_px, equal_nan=True)
                assert expected.flags == edges.flags
            assert np.array_equal(dataset.images(1)[0], frame(10))
    assert [file.name for file in files.glob("*.h5")] == ["run.h5"]
    assert not list(files.glob(".run*"))
    with pytest.raises(ValueError, match="1 sets of edges are given for 3 states"):
        write_edges(path, [edge_set(1)])
    with DatasetWriter.resume(path) as writer:
        writer.append_state([Frame(frame(30), 130, 3.0)], current_A=0.3, field_mT=1.41)
    with open_dataset(path) as dataset:
        assert dataset.edges() is None  # edges of three states are stored, and the dataset now has four states


def test_a_damaged_frame_is_reported_and_recovery_leaves_it_out(files: Path, frame: Callable[..., np.ndarray]) -> None:
    path = files / "run.h5"
    write_states(path, files, frame, 2)
    with h5py.File(path, "r") as file:
        where = file["entry/data/frames"].id.get_chunk_info(3)
    with path.open("r+b") as raw:
        raw.seek(where.byte_offset + where.size // 2)
        chunk = raw.read(8)
        raw.seek(-8, os.SEEK_CUR)
        raw.write(bytes(byte ^ 0x5A for byte in chunk))
    with open_dataset(path) as dataset:
        dataset.images(0)
        with pytest.raises(InputError, match=r"run\.h5: frame 1 of the 2 frames of state 1 .* is damaged"):
            dataset.images(1)
    messages: list[str] = []
    assert recover(path, files / "whole.h5", say=messages.append) == 2
    assert len(messages) == 1
    assert "run.h5: damaged frames left out: 1, of state 1 " in messages[0]
    with open_dataset(path) as dataset, open_dataset(files / "whole.h5") as whole:
        np.testing.assert_array_equal(whole.images(0), dataset.images(0))
        np.testing.assert_array_equal(whole.images(1), [frame(10)])
        assert whole.states[1].measured_A == pytest.approx(0.101)
        assert [flag.name for flag in whole.states[1].flags] == ["NOT_SETTLED", "DROPPED"]


def test_damaged_tables_are_refused_in_one_line_and_rebuilt_by_recovery(
    files: Path, frame: Callable[..., np.ndarray]
) -> None:
    path = files / "run.h5"
    write_states(path, files, frame, 2)
    with h5py.File(path, "r") as file:
        where = file["entry/states/field"].id.get_chunk_info(0)
    with path.open("r+b") as raw:
        raw.seek(where.byte_offset)
        raw.write(bytes([255]) * where.size)
    with (
        pytest.raises(
            InputError, match=r"run\.h5: the tables of the states in the file are damaged \(.+\); `eimi recover`"
        ),
        open_dataset(path),
    ):
        pass
    messages: list[str] = []
    assert recover(path, files / "whole.h5", say=messages.append) == 2
    assert "entry/states/field (rebuilt from the frames)" in messages[0]
    with open_dataset(files / "whole.h5") as whole:
        assert [state.field_mT for state in whole.states] == [0.0, 0.47]


def test_a_state_without_readable_frames_keeps_its_number(files: Path, frame: Callable[..., np.ndarray]) -> None:
    path = files / "run.h5"
    write_states(path, files, frame, 3)
    with h5py.File(path, "r") as file:
        chunks = [file["entry/data/frames"].id.get_chunk_info(row) for row in (2, 3)]
    with path.open("r+b") as raw:
        for chunk in chunks:
            raw.seek(chunk.byte_offset)
            raw.write(bytes(chunk.size))
    assert recover(path, path, force=True, say=lambda line: None) == 3
    with open_dataset(path) as whole:
        assert [flag.name for flag in whole.states[1].flags] == ["NOT_SETTLED", "DROPPED"]
        assert whole.images(1).shape[0] == 1
        assert not whole.images(1).any()
        np.testing.assert_array_equal(whole.images(2), [frame(20), frame(21)])


WRITE_AND_DIE = """
import os, signal, sys
from pathlib import Path
import numpy as np
from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.writing import DatasetWriter

folder, states = Path(sys.argv[1]), int(sys.argv[2])
header = Header(load_specimen(folder / "specimen.toml"), load_calibration(folder / "calibration.toml"))
image = lambda k: np.full((96, 128), k, np.uint8)
with DatasetWriter(folder / "crashed.h5", header, Frame(image(0), 0, 0.0)) as writer:
    for k in range(states):
        writer.append_state([Frame(image(k), k, float(k))], current_A=k / 10, field_mT=k * 0.47)
    # Rows of a state that was not completed: the table of states does not contain it.
    writer._frames.resize(states + 1, axis=0)
    writer._columns["state"].resize(states + 1, axis=0)
    writer._columns["state"][states] = states
    writer._file.flush()
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("states", [1, 5])
def test_a_killed_writer_loses_no_stored_state(files: Path, states: int) -> None:
    subprocess.run([sys.executable, "-c", WRITE_AND_DIE, str(files), str(states)], check=False, timeout=PATIENCE_S)
    crashed = files / "crashed.h5"
    with pytest.raises(OSError, match=r"."):
        h5py.File(crashed, "r")
    with open_dataset(crashed) as dataset:
        assert not dataset.finished
        assert [state.current_A for state in dataset.states] == [k / 10 for k in range(states)]
        assert [dataset.images(k)[0, 0, 0] for k in range(states)] == list(range(states))
    with pytest.raises(InputError, match="eimi recover"):
        write_edges(crashed, [edge_set(3)] * states)

    assert recover(crashed, files / "whole.h5") == states
    with open_dataset(files / "whole.h5") as dataset:
        assert dataset.finished
        assert [dataset.images(k).tolist() for k in range(states)] == [[[[k] * 128] * 96] for k in range(states)]
    with h5py.File(files / "whole.h5", "r") as file:
        assert len(file["entry/data/frames"]) == len(file["entry/instrument/detector/data"]) == states
    write_edges(files / "whole.h5", [edge_set(3)] * states)
    with pytest.raises(InputError, match="exists already"):
        recover(crashed, files / "whole.h5")


def test_a_file_can_be_read_while_it_is_written(files: Path, frame: Callable[..., np.ndarray]) -> None:
    reader = f"""
from eimi_lab.dataset.reading import open_dataset
with open_dataset({str(files / "run.h5")!r}) as dataset:
    print(len(dataset.states), dataset.finished, dataset.images(0).shape)
"""
    with DatasetWriter(files / "run.h5", header(files), Frame(frame(0), 0, 0.0)) as writer:
        for k in range(2):
            writer.append_state([Frame(frame(k), k, 0.0)], current_A=k / 10, field_mT=0.0)
            out = subprocess.run(
                [sys.executable, "-c", reader], capture_output=True, text=True, timeout=PATIENCE_S, check=True
            )
            assert out.stdout.split("\n")[0] == f"{k + 1} False (1, 96, 128)"


def test_files_that_are_not_datasets_are_refused_with_the_reason(files: Path) -> None:
    (files / "text.h5").write_text("not at all")
    with h5py.File(files / "other.h5", "w") as file:
        file["numbers"] = [1, 2, 3]
    for name, reason in (
        ("missing.h5", "no such file"),
        ("text.h5", "is not an HDF5 file"),
        ("other.h5", "is an HDF5 file, but not a dataset of eimi-lab"),
    ):
        with pytest.raises(InputError, match=f"{name}: {reason}"), open_dataset(files / name):
            pass


def test_a_dataset_without_a_specimen_is_refused(files: Path, frame: Callable[..., np.ndarray]) -> None:
    write_states(files / "run.h5", files, frame, 1)
    with h5py.File(files / "run.h5", "r+") as file:
        del file["entry/specimen"]
    with pytest.raises(InputError, match=r"run\.h5: holds no specimen"), open_dataset(files / "run.h5"):
        pass


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9])
def test_a_truncated_file_is_refused_in_one_line(files: Path, frame: Callable[..., np.ndarray], share: float) -> None:
    path = files / "run.h5"
    write_states(path, files, frame, 2)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match=r"run\.h5: is a damaged HDF5 file"), open_dataset(path):
        pass


@pytest.mark.parametrize("colours", [(), (3,)])
@pytest.mark.parametrize("filters", [{"compression": "gzip", "fletcher32": True}, {"compression": "lzf"}, {}])
def test_a_frame_is_appended_to_a_stack_with_any_filters(
    tmp_path: Path, colours: tuple[int, ...], filters: dict[str, Any]
) -> None:
    images = np.random.default_rng(1).integers(0, 4000, (3, 40, 31, *colours), np.uint16)
    shape = images.shape[1:]
    with h5py.File(tmp_path / "stack.h5", "w") as file:
        stack = file.create_dataset("frames", (0, *shape), "u2", chunks=(1, *shape), maxshape=(None, *shape), **filters)
        for image in images:
            append_image(stack, image)
    with h5py.File(tmp_path / "stack.h5") as file:
        assert np.array_equal(file["frames"], images)
