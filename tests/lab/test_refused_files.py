"""Unsuitable files are refused before their data are read; the error message is one line and begins with the path."""

from __future__ import annotations

import ctypes
import errno
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_lab.dataset import containment, dark_and_flat, file_system, opened_file
from eimi_lab.process.errors import InputError

PATH = Path("run.h5")


@pytest.fixture
def file() -> Iterator[h5py.File]:
    # A file in memory with a group `entry`.
    with h5py.File("memory.h5", "w", driver="core", backing_store=False) as made:
        made.create_group("entry/data")
        made.create_group("entry/states")
        yield made


def check_of(file: h5py.File) -> None:
    containment.refuse_links_and_absurd_sizes(PATH, file)


# Links, and data in other files


@pytest.mark.parametrize(
    ("place", "link"),
    [
        ("entry/title", h5py.SoftLink("/entry")),
        ("entry/data/frames", h5py.ExternalLink("other.h5", "/x")),
        ("entry/states/index", h5py.SoftLink("/entry")),
        ("entry/ring_down_points/0/points", h5py.SoftLink("/entry")),
        ("entry/sample/environment/probe/short_name", h5py.SoftLink("/entry")),
        ("entry/sample/environment/probe/value_log/value", h5py.SoftLink("/entry")),
        ("entry/sample/environment/probe/stated/unit", h5py.SoftLink("/entry")),
        ("entry/segmentation/edges/left/points", h5py.SoftLink("/entry")),
        ("entry/former/specimen_0", h5py.SoftLink("/entry")),
    ],
)
def test_a_link_is_refused_by_its_place(file: h5py.File, place: str, link: Any) -> None:
    check_of(file)
    file[place] = link
    if place == "entry/title":  # it is not read, so that it does no harm
        check_of(file)
        return
    with pytest.raises(InputError) as caught:
        check_of(file)
    assert str(caught.value) == (
        f"run.h5: {place} is a link to another place in this file or in another file; a dataset should contain all of "
        "its data itself"
    )


def test_data_in_another_file_are_refused(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((3,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (3,))
    file["entry/data"].create_virtual_dataset("time", layout)
    with pytest.raises(InputError, match=r"^run\.h5: /entry/data/time is kept in another file; a dataset should"):
        check_of(file)
    del file["entry/data/time"]
    file.create_dataset("entry/data/time", (8,), "f8", external=[("other", 0, 64)])
    with pytest.raises(InputError, match=r"^run\.h5: /entry/data/time is kept in another file"):
        check_of(file)


@pytest.mark.parametrize("kind", ["i8", "u2", "f4", "S40", "?", "c16", h5py.string_dtype()])
def test_only_numbers_and_texts_of_fixed_length_are_read(file: h5py.File, kind: Any) -> None:
    file.create_dataset("entry/start_time", data="2026", dtype=h5py.string_dtype())  # is read from its copy
    check_of(file)
    file.create_dataset("entry/data/time", (2,), kind)
    if kind in ("i8", "u2", "f4", "S40"):
        check_of(file)
    else:
        with pytest.raises(InputError, match=r"^run\.h5: /entry/data/time is of type .*; it should have numbers"):
            check_of(file)


@pytest.mark.parametrize(
    ("shape", "kind", "refused"),
    [
        (((1 << 30) // 8,), "f8", False),
        (((1 << 30) // 8 + 1,), "f8", True),
        ((1 << 15, 1 << 15), "u1", False),
        ((1 << 15, (1 << 15) + 1), "u1", True),
        ((9, 1 << 15, 1 << 15), "u1", False),
        ((9, 1 << 14, 1 << 15), "u2", False),
        ((9, 1 << 15, (1 << 15) + 1), "u1", True),
        ((1, 2, 3, 4), "u1", False),
        ((1, 1, 2, 3, 4), "u1", True),
    ],
)
def test_a_table_or_a_frame_has_at_most_a_gibibyte(
    file: h5py.File, monkeypatch: pytest.MonkeyPatch, shape: tuple[int, ...], kind: str, refused: bool
) -> None:
    monkeypatch.setattr(containment, "refuse_unpacked", lambda size, what: None)
    file.create_dataset("entry/data/frames", shape, kind, chunks=tuple(min(side, 64) for side in shape))
    if refused:
        with pytest.raises(InputError, match=r"^run\.h5: /entry/data/frames has the size \(.*, which is more than"):
            check_of(file)
    else:
        check_of(file)


def test_the_size_of_one_frame_is_compared_with_the_free_memory(
    file: h5py.File, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(containment, "refuse_unpacked", lambda *given: asked.append(given))
    file.create_dataset("entry/data/frames", (9, 3, 4), "u2")
    file.create_dataset("entry/data/time", (5,), "f8")
    check_of(file)
    assert asked == [(24, "run.h5: /entry/data/frames of (9, 3, 4)"), (40, "run.h5: /entry/data/time of (5,)")]


# Files that are no datasets


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a.png", "is a picture; `eimi import` makes a dataset from pictures"),
        ("a.MP4", "is a video; `eimi import` makes a dataset from a video"),
        ("a.json", "is a JSON file, not a dataset; .* a fits.json belongs to --fit"),
        ("a.toml", "is a TOML file, not a dataset"),
        ("a.csv", "is a table; `eimi import` makes a dataset from a table"),
        ("a.h5", "is not an HDF5 file; `eimi import` makes a dataset from images or points"),
    ],
)
def test_a_file_of_another_kind_is_named_with_the_way_to_a_dataset(tmp_path: Path, name: str, words: str) -> None:
    path = tmp_path / name
    with pytest.raises(InputError, match=f"^{path}: no such file$"):
        opened_file.open_file(path)
    path.write_bytes(b"something else")
    with pytest.raises(InputError, match=f"^{path}: {words}"):
        opened_file.open_file(path)
    with pytest.raises(InputError, match=f"^{tmp_path}: is a folder; a dataset is a file"):
        opened_file.open_file(tmp_path)


def test_a_file_that_cannot_be_opened_is_named_with_the_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(act: object) -> None:
        raise OSError(errno.EACCES, "Permission denied")

    (tmp_path / "a.h5").touch()
    monkeypatch.setattr(opened_file, "patiently", denied)
    with pytest.raises(InputError, match=r"a\.h5: cannot be read \(Permission denied\)$"):
        opened_file.open_file(tmp_path / "a.h5")


def superblock(version: int, mark: int, length: int = 48) -> bytes:
    return (b"\x89HDF\r\n\x1a\n" + bytes([version, 8, 8, mark]) + bytes(36))[:length]


@pytest.mark.parametrize(
    ("head", "marked"),
    [
        (superblock(3, 5), True),
        (superblock(3, 0), False),
        (superblock(2, 5), False),
        (superblock(3, 5, 12), True),
        (superblock(3, 5, 11), False),
    ],
)
def test_the_mark_of_a_writer_is_byte_11_of_superblock_3(tmp_path: Path, head: bytes, marked: bool) -> None:
    (tmp_path / "a.h5").write_bytes(head)
    assert opened_file._has_a_writer(tmp_path / "a.h5") is marked


@pytest.mark.parametrize(("written", "reason"), [(True, "OSError: wrong checksum"), (True, ""), (False, "")])
def test_a_marked_file_is_read_beside_its_writer_or_after_its_crash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: bool, reason: str
) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w", libver=("v110", "latest")) as made:
        made["x"] = 1
        made.swmr_mode = True
        made.flush()
        (tmp_path / "copy.h5").write_bytes(path.read_bytes())
    path = tmp_path / "copy.h5"
    monkeypatch.setattr(opened_file, "is_being_written", lambda given: written)
    monkeypatch.setattr(opened_file, "why_unreadable", lambda given: reason)
    if reason:
        with pytest.raises(InputError, match=r"copy\.h5: is a damaged HDF5 file \(OSError: wrong checksum\)$"):
            opened_file.open_file(path)
        return
    opened, finished = opened_file.open_file(path)
    with opened:
        assert opened["x"][()] == 1
        assert opened.swmr_mode == written
    assert not finished


def test_a_truncated_file_is_named_with_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w", libver=("v110", "latest")) as made:
        made["x"] = np.arange(1000)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"a\.h5: is a damaged HDF5 file \(.*truncated.*\); `eimi recover` makes"):
        opened_file.open_file(path)


# Dark frames and flat fields


def test_a_dark_frame_is_at_most_half_as_bright_as_the_light() -> None:
    frame = np.full((10, 10), 200, np.uint8)
    frame[0] = 100  # the 99th percentile is still 200
    dark_and_flat.check_like({"dark": np.full((10, 10), 100, np.uint8)}, frame)
    with pytest.raises(InputError, match=r"^--dark: the image has a median of 101 grey levels, but the back-light"):
        dark_and_flat.check_like({"dark": np.full((10, 10), 101, np.uint8)}, frame)
    dark_and_flat.check_like({"flat": np.full((10, 10), 250, np.uint8)}, frame)
    spotted = np.full((20, 20), 200, np.uint8)
    spotted[3, 3] = 255  # a single bright pixel is not the light
    with pytest.raises(InputError, match=r"but the back-light in the frames has 200 grey levels"):
        dark_and_flat.check_like({"dark": np.full((20, 20), 101, np.uint8)}, spotted)
    for wrong in (np.zeros((10, 11), np.uint8), np.zeros((10, 10), np.uint16)):
        with pytest.raises(InputError, match=r"^--flat: is .*; the frames are .*, and the image should"):
            dark_and_flat.check_like({"flat": wrong}, frame)


def test_the_images_of_a_correction_are_stored_replaced_and_forgotten(
    file: h5py.File, monkeypatch: pytest.MonkeyPatch
) -> None:
    reserved: list[int] = []
    dropped: list[str] = []

    @contextmanager
    def rewritten(path: Path, size: int = 0) -> Iterator[h5py.Group]:
        reserved.append(size)
        yield file["entry"]

    monkeypatch.setattr(dark_and_flat, "rewritten", rewritten)
    monkeypatch.setattr(dark_and_flat, "drop_edges", lambda entry: dropped.append(entry.name))
    dark, flat = np.full((4, 4), 3, np.uint8), np.full((4, 4), 200, np.uint8)
    with pytest.raises(InputError, match=r"^run\.h5: holds tracked points, so there are no frames to correct$"):
        dark_and_flat.store_correction(PATH, {"dark": dark})
    file["entry/data"].create_dataset("frames", data=np.full((1, 4, 4), 180, np.uint8))
    dark_and_flat.store_correction(PATH, {"dark": dark})
    dark_and_flat.store_correction(PATH, {"flat": flat})
    stored = dark_and_flat.stored_correction(file["entry"])
    np.testing.assert_array_equal(stored["dark"], dark)
    np.testing.assert_array_equal(stored["flat"], flat)
    assert file["entry/correction/dark"].attrs["units"] == "counts"
    assert (file["entry/correction/dark"].compression, file["entry/correction/dark"].fletcher32) == ("gzip", True)
    assert reserved[-2:] == [32, 32]
    assert len(dropped) == 2
    with pytest.raises(InputError, match=r"^run\.h5: "):
        dark_and_flat.store_correction(PATH, {"dark": dark + np.uint8(80), "flat": flat - np.uint8(120)})
    dark_and_flat.forget_correction(PATH)
    assert dark_and_flat.stored_correction(file["entry"]) == {}
    assert dark_and_flat.correction_by({}) is None


# Network drives


@pytest.mark.parametrize(("kind", "named"), [(4, "network drive"), (3, None), (0, None)])
def test_a_network_drive_of_windows_has_the_number_4(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, kind: int, named: str | None
) -> None:
    # GetDriveTypeW returns DRIVE_REMOTE, 4 (Microsoft, fileapi.h), for the root of a drive.
    asked: list[str] = []
    kernel = SimpleNamespace(GetDriveTypeW=lambda root: (asked.append(root), kind)[1])
    monkeypatch.setattr(ctypes, "windll", SimpleNamespace(kernel32=kernel), raising=False)
    monkeypatch.setattr(file_system, "followed", lambda folder: SimpleNamespace(anchor="\\\\server\\share\\"))
    monkeypatch.setattr(sys, "platform", "win32")
    assert file_system.network_file_system(tmp_path) == named
    assert asked == ["\\\\server\\share\\"]


def test_the_deepest_mount_and_the_last_of_equal_mounts_count(tmp_path: Path) -> None:
    mounts = tmp_path / "mounts"
    rows = ("disk / ext4 rw", "server:/a /data nfs4 rw", "disk2 /data/lo\\040cal ext4 rw", "x /twice nfs rw")
    mounts.write_text("\n".join([*rows, "y /twice xfs rw"]))
    found = file_system.network_file_system
    assert found(Path("/data/runs"), mounts) == "nfs4"
    assert found(Path("/data/lo cal/runs"), mounts) is None
    assert found(Path("/database"), mounts) is None
    assert found(Path("/twice/x"), mounts) is None
    assert found(Path("/data"), tmp_path / "missing") is None
