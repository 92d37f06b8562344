"""Damaged and hostile files are recovered or refused: a flipped bit, links to other files, impossible sizes."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.empty_file import empty_file
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.recovery import recover
from eimi_lab.dataset.repair.checksums import fletcher32, flipped_bit, flipped_bit_of_chunk, lookup3
from eimi_lab.dataset.writing import DatasetWriter
from eimi_lab.process.errors import InputError

STATES = 4


def image(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 255, (48, 64)).astype(np.uint8)


@pytest.fixture
def two(files: Path) -> dict[str, Path]:
    # The same dataset before its writer closed it ("crashed") and afterwards ("finished").
    header = Header(load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml"))
    with DatasetWriter(files / "finished.h5", header, Frame(image(0), 0, 0.0)) as writer:
        for k in range(STATES):
            frames = [Frame(image(2 * k), 2 * k, 0.0), Frame(image(2 * k + 1), 2 * k + 1, 0.1)]
            writer.append_state(frames, current_A=k / 10, field_mT=k * 0.47)
        shutil.copyfile(files / "finished.h5", files / "crashed.h5")
    return {name: files / f"{name}.h5" for name in ("finished", "crashed")}


def assert_everything_is_there(path: Path) -> None:
    with open_dataset(path) as dataset:
        assert [state.current_A for state in dataset.states] == [k / 10 for k in range(STATES)]
        assert not any(state.flags for state in dataset.states)
        for k in range(STATES):
            np.testing.assert_array_equal(dataset.images(k), [image(2 * k), image(2 * k + 1)])


def test_the_checksums_are_those_of_hdf5(two: dict[str, Path]) -> None:
    raw = two["finished"].read_bytes()
    assert lookup3(raw[:44]) == int.from_bytes(raw[44:48], "little")
    with h5py.File(two["finished"]) as file:
        for place in ("entry/data/frames", "entry/states/flags", "entry/data/time"):
            chunk = file[place].id.get_chunk_info(0)
            stored = raw[chunk.byte_offset : chunk.byte_offset + chunk.size]
            assert fletcher32(stored[:-4]) == int.from_bytes(stored[-4:], "little")


@pytest.mark.parametrize("length", [9, 44, 127, 128, 129, 700])
def test_the_checksum_locates_a_flipped_bit(length: int) -> None:
    random = np.random.default_rng(length)
    block = random.integers(0, 256, length, dtype=np.uint8).tobytes()
    chunk = block + fletcher32(block).to_bytes(4, "little")
    for bit in random.integers(0, 8 * length, 20).tolist():
        damaged = bytearray(block)
        damaged[bit // 8] ^= 1 << bit % 8
        assert flipped_bit(bytes(damaged), lookup3(block)) == bit
        assert flipped_bit_of_chunk(bytes(damaged) + chunk[-4:]) == bit


@pytest.mark.parametrize("kind", ["finished", "crashed"])
@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 120))])
def test_everything_in_a_file_with_a_flipped_bit_is_recovered(
    two: dict[str, Path], files: Path, kind: str, seed: int
) -> None:
    raw = bytearray(two[kind].read_bytes())
    random = np.random.default_rng(seed)
    # The tables and HDF5's structures are in the first part of the file, the frames in the rest.
    bit = int(random.integers(0, 8 * (20_000 if seed % 2 else len(raw))))
    raw[bit // 8] ^= 1 << bit % 8
    (files / "damaged.h5").write_bytes(raw)
    refused = ""
    try:
        recover(files / "damaged.h5", files / "whole.h5", say=lambda words: None)
    except InputError as error:
        refused = str(error)
    if not refused:
        assert_everything_is_there(files / "whole.h5")
    else:  # texts have no checksum, so that a changed letter is not noticed
        assert "damaged.h5: specimen" in refused or "damaged.h5: calibration" in refused


def test_a_flipped_bit_is_corrected_also_if_the_recovered_file_replaces_the_crashed_one(two: dict[str, Path]) -> None:
    with h5py.File(two["finished"]) as file:
        chunk = file["entry/data/frames"].id.get_chunk_info(2)
    raw = bytearray(two["crashed"].read_bytes())
    raw[chunk.byte_offset + chunk.size // 2] ^= 4
    two["crashed"].write_bytes(raw)
    messages: list[str] = []
    recover(two["crashed"], two["crashed"], force=True, say=messages.append)
    assert [line.partition(": ")[2] for line in messages] == ["single flipped bits in the file that were corrected: 1"]
    assert_everything_is_there(two["crashed"])


@pytest.mark.parametrize("options", [(), ("--dark",), ("--axis", "89")])
def test_a_run_without_a_state_has_no_edges(
    files: Path, run: Callable[..., tuple[int, str]], options: tuple[str, ...]
) -> None:
    header = Header(load_specimen(files / "specimen.toml"), load_calibration(files / "calibration.toml"))
    (files / "crashed.h5").write_bytes(empty_file(header, image(0)))  # a run that was killed before its first state
    assert recover(files / "crashed.h5", files / "run.h5") == 0
    cv2.imwrite(str(files / "dark.png"), image(0) // 10)
    dark = (files / "dark.png",) * (options == ("--dark",))
    status, message = run("segment", files / "run.h5", *options, *dark)
    assert (status, message) == (2, f"eimi: {files / 'run.h5'}: holds no state; repeat the run\n")


HOSTILE: dict[str, Callable[[h5py.File], object]] = {
    "is a link to another place": lambda file: swap(file, "entry/data/frames", h5py.ExternalLink("other.h5", "/x")),
    "entry/specimen is a link": lambda file: swap(file, "entry/specimen", h5py.SoftLink("/entry/specimen")),
    "is kept in another file": lambda file: swap_by(
        file, "entry/data/time", lambda at: file.create_dataset(at, (8,), "f8", external=[("/etc/passwd", 0, 64)])
    ),
    "according to the file, which is more than the program reads": lambda file: swap_by(
        file, "entry/data/time", lambda at: file.create_dataset(at, (10**15,), "f8", chunks=(64,))
    ),
    "is of type object": lambda file: swap_by(
        file, "entry/data/time", lambda at: file.create_dataset(at, (8,), h5py.string_dtype())
    ),
    "is damaged, or does not have the contents of a dataset": lambda file: swap_by(
        file, "entry/states/current", lambda at: file.create_group(at)
    ),
    "is an HDF5 file, but not a dataset": lambda file: file.__delitem__("entry/states"),
    "holds no specimen": lambda file: file.__delitem__("entry/specimen"),
    "specimen: is not valid TOML": lambda file: swap_by(
        file, "entry/specimen/data", lambda at: file.create_dataset(at, data=np.bytes_(b"= ="))
    ),
    "(Expecting value": lambda file: file["entry/states/flags"].__setitem__(0, b"none"),
}


def swap(file: h5py.File, place: str, link: object) -> None:
    del file[place]
    file[place] = link


def swap_by(file: h5py.File, place: str, make: Callable[[str], object]) -> None:
    del file[place]
    make(place)


@pytest.mark.parametrize("expected", HOSTILE)
def test_a_hostile_file_is_refused_in_one_line(
    two: dict[str, Path], expected: str, run: Callable[..., tuple[int, str]]
) -> None:
    with h5py.File(two["finished"], "r+") as file:
        HOSTILE[expected](file)
    status, message = run("segment", two["finished"])
    assert (status, message.count("\n")) == (2, 1), message
    assert expected in message
    status, message = run("recover", two["finished"], "-o", two["finished"].with_name("whole.h5"))
    assert status in (0, 2), message
    assert "Traceback" not in message


def test_an_unforeseen_error_is_reported_as_a_fault_of_the_program(
    two: dict[str, Path], run: Callable[..., tuple[int, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = two["crashed"].parent
    (folder / "sitecustomize.py").write_text("""
from eimi_lab.dataset import reading

def surprised(*arguments):
    raise ValueError("nobody thought of this")

reading.read_states = surprised
reading.Dataset._naming_damage = lambda self: __import__("contextlib").nullcontext()
""")
    monkeypatch.setenv("PYTHONPATH", str(folder))
    status, message = run("recover", two["crashed"], "-o", folder / "out.h5")
    assert (status, message.count("\n")) == (1, 1)
    assert "crashed.h5: its recovery failed: ValueError: nobody thought of this: a fault of this program" in message
    assert "damaged" not in message
    assert not (folder / "out.h5").exists()


@pytest.mark.parametrize("length", [8, 11, 12, 47])
def test_the_first_bytes_of_a_dataset_are_refused_in_one_line(two: dict[str, Path], length: int) -> None:
    raw = two["crashed"].read_bytes()
    two["crashed"].write_bytes(raw[:length])
    with pytest.raises(InputError, match=r"crashed\.h5: is a damaged HDF5 file"), open_dataset(two["crashed"]):
        pass
    with pytest.raises(InputError, match=r"crashed\.h5: is ") as raised:
        recover(two["crashed"], two["crashed"].with_name("out.h5"))
    assert "eimi recover" not in str(raised.value)


def test_an_error_of_eimi_recover_does_not_advise_the_user_to_use_eimi_recover(two: dict[str, Path]) -> None:
    with h5py.File(two["finished"], "r+") as file:
        del file["entry/data/frames"]
    with pytest.raises(InputError, match="the part of the file that can be read is not a dataset") as raised:
        recover(two["finished"], two["crashed"].with_name("out.h5"))
    assert "eimi recover" not in str(raised.value)


def test_an_update_of_the_program_while_it_runs_gives_one_line(two: dict[str, Path]) -> None:
    command = [sys.executable, "-m", "eimi_lab.dataset.recovery", two["crashed"], "copy.h5"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.count("\n"), done.stdout) == (2, 1, "")
    assert "replaced by another release while it ran" in done.stderr
