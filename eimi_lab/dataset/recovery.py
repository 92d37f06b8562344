"""Recover a crashed or damaged dataset: copy everything readable to a new file.

A second process reads the file with limits of processor time and memory, because HDF5 may run forever.
"""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np

from eimi_lab.dataset.layout import (
    FRAME_COLUMNS,
    STATE_COLUMNS,
    WRITTEN_AS,
    flags_from_text,
    flags_to_text,
)
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.dataset.rebuilding import HDF5_RAISES, readable, rebuilt_tables
from eimi_lab.dataset.recordings import BELONGS_TO, RING_DOWN, complete_rows, keep_rows, make_recordings
from eimi_lab.dataset.repair.chunks import mend_chunks
from eimi_lab.dataset.repair.mended_file import MendedFile
from eimi_lab.dataset.repair.metadata import mend_metadata
from eimi_lab.dataset.repair.superblock import close_superblock, is_hdf5
from eimi_lab.dataset.sensor_logs import log_of, sensor_names
from eimi_lab.dataset.steps import RING_DOWN_STEPS, SET_POINTS
from eimi_lab.process.errors import InputError, OwnFault, tell
from eimi_lab.process.limits import child_arguments, limit_memory, obey_processor_limit, run_limited
from eimi_lab.process.outputs import whole_file
from eimi_lab.process.paths import followed
from eimi_lab.process.replacing import patiently
from eimi_lab.process.writer_lock import is_being_written
from eimi_lab.vision.flags import judge

READ_WITHIN_S, BYTES_PER_S = 60.0, 2e6
MEMORY_BYTES = 4 << 30
_FRAMES = ("frames", "data")
"""Names of arrays of frames, which are read later, one frame at a time."""
_RUNNING, _ENDED = "running", "ended"
"""The second process receives one of these words: a run is still writing the file, or no run is writing it."""


def recover(crashed: str | Path, path: str | Path, force: bool = False, say: Callable[[str], None] = tell) -> int:
    """Copy everything readable of a crashed or damaged dataset to a new file, and return the number of load steps.

    Single flipped bits are corrected. Damaged frames are left out, and their load steps get the flag DROPPED; if all
    frames of a load step are damaged, it gets one black frame.

    Parameters
    ----------
    crashed
        The crashed or damaged dataset.
    path
        The new file.
    force
        Whether an existing file is overwritten.
    say
        Function that gets a line of text for everything that was corrected or lost.

    Raises
    ------
    InputError
        If nothing can be recovered.
    OwnFault
        If the recovery failed for an unforeseen reason.
    """
    crashed, path = Path(crashed), Path(path)
    if not crashed.is_file():
        raise InputError(f"{crashed}: is {'a folder' if crashed.is_dir() else 'not a file'}; give a dataset to recover")
    # A file that is replaced has no other writer, because this process holds its lock below.
    kind = _RUNNING if followed(crashed) != followed(path) and is_being_written(crashed) else _ENDED
    with whole_file(path, force) as temporary:
        within_s = READ_WITHIN_S + crashed.stat().st_size / BYTES_PER_S
        command = [sys.executable, "-P", "-m", __name__, str(crashed), kind, str(temporary)]
        done = run_limited(crashed, command, within_s)
        if done.returncode:
            message = done.stderr.decode("utf-8", "replace").strip().rpartition("\n")[2]
            if done.returncode == 2:
                raise InputError(message)
            raise OwnFault(f"{crashed}: its recovery failed", message)
        outcome = json.loads(done.stdout)
        for line in outcome["said"]:
            say(f"{crashed}: {line}")
        return int(outcome["states"])


def copy_readable(crashed: Path, path: Path, running: bool = False) -> tuple[int, list[str]]:
    """Copy everything readable of a crashed or damaged dataset to a new file.

    For some damaged files HDF5 never returns: call this function in a process with limited processor time.

    Parameters
    ----------
    crashed
        The crashed or damaged dataset.
    path
        The new file; an existing file is overwritten.
    running
        Whether a run is still writing the dataset. Flipped bits are then not corrected.

    Returns
    -------
    states, lines
        The number of recovered load steps, and a line of text for everything that was corrected or lost.

    Raises
    ------
    InputError
        If HDF5 cannot read the file.
    """
    if running:
        with h5py.File(crashed, "r", libver="latest", swmr=True) as source:
            return _copy(source, crashed, path)
    file = MendedFile(crashed)
    if not is_hdf5(file):
        raise InputError(f"{crashed}: is not an HDF5 file")
    close_superblock(file)
    first: Exception | None = None
    try:
        states, lines = _attempt(file, crashed, path)
        if not lines:
            return states, lines
    except (InputError, *HDF5_RAISES) as error:  # a flipped bit may cause any of these errors
        first = error
    mended = mend_metadata(file) + _mend_all_chunks(file)
    if mended:
        states, lines = _attempt(file, crashed, path)
        return states, [f"single flipped bits in the file that were corrected: {mended}", *lines]
    if first:
        raise first
    return states, lines


def _attempt(file: MendedFile, crashed: Path, path: Path) -> tuple[int, list[str]]:
    try:
        with h5py.File(file, "r") as source:
            return _copy(source, crashed, path)
    except MemoryError as error:
        raise InputError(
            f"{crashed}: cannot be read with the memory that `eimi recover` may use; use a computer with more free "
            "memory"
        ) from error
    except HDF5_RAISES as error:
        if not _comes_from_hdf5(error):
            raise
        raise InputError(f"{crashed}: is damaged ({' '.join(str(error).split())[:200]})") from error


def _comes_from_hdf5(error: BaseException) -> bool:
    """Return whether the library h5py raised an error, which means that the file is damaged."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    return "h5py" in Path(frame.f_code.co_filename).parts


def _mend_all_chunks(file: MendedFile) -> int:
    mended = 0

    def mend(name: str, item: h5py.Group | h5py.Dataset) -> None:
        nonlocal mended
        if isinstance(item, h5py.Dataset):
            mended += mend_chunks(file, item)

    with (
        suppress(OSError, RuntimeError, KeyError),
        h5py.File(file, "r") as source,
    ):  # the next attempt reports the error
        source.visititems(mend)
    return mended


def _copy(source: h5py.File, crashed: Path, path: Path) -> tuple[int, list[str]]:
    lost: list[str] = []
    lost_of_recordings: list[str] = []
    with h5py.File(path, "w", libver=WRITTEN_AS) as copy:
        copy.attrs["default"] = "entry"
        _copy_group(source["entry"], copy.create_group("entry"), lost, {})
        lost = rebuilt_tables(copy["entry"], lost, crashed)
        dataset = Dataset(crashed, copy, True, "the part of the file that can be read is not a dataset")
        states = len(dataset.states)
        if dataset.kind == "points":  # also if the frames were lost; reading the points then raises InputError
            dataset.points()
        else:
            _drop_unacknowledged(copy["entry"], states)
            lost_of_recordings = _drop_unreadable(copy["entry"], states)
            _repair_steps(copy["entry"])
    lines = [f"unreadable and left out: {', '.join(lost)}"] if lost else []
    lines += lost_of_recordings
    with open_dataset(path) as recovered:
        damaged = recovered.damaged_frames() if recovered.kind == "frames" else ()
    if damaged:
        with patiently(lambda: h5py.File(path, "r+", libver=WRITTEN_AS)) as copy:
            of_states = _drop_damaged(copy["entry"], damaged)
        lines.append(
            f"damaged frames left out: {len(damaged)}, of state {', '.join(map(str, of_states))} (counted from 0); "
            "these states get the flag DROPPED"
        )
    return states, lines


def _copy_group(source: h5py.Group, copy: h5py.Group, lost: list[str], copied: dict[int, str]) -> None:
    """Copy everything readable in an HDF5 group, with its subgroups, and add unreadable names to ``lost``.

    ``copied`` maps the address of each copied object in the old file to its name in the new file.
    """
    _copy_attributes(source, copy, lost)
    for name in source:
        place = f"{source.name}/{name}"
        try:
            if not isinstance(source.get(name, getlink=True), h5py.HardLink):
                lost.append(f"{place} (a link to another place)")
                continue
            item = source[name]
            address = h5py.h5o.get_info(item.id).addr
            if address in copied:
                copy[name] = copy.file[copied[address]]
            elif isinstance(item, h5py.Group):
                copied[address] = f"{copy.name}/{name}"
                _copy_group(item, copy.create_group(name), lost, copied)
            else:
                if item.external or item.is_virtual:
                    lost.append(f"{place} (kept in another file)")
                    continue
                h5py.h5o.copy(source.id, name.encode(), copy.id, name.encode())
                _read(name, copy[name])
                copied[address] = f"{copy.name}/{name}"
        except HDF5_RAISES:
            lost.append(place)
            if name in copy:
                del copy[name]


def _copy_attributes(source: h5py.Group, copy: h5py.Group, lost: list[str]) -> None:
    is_lost = False
    try:
        for name in source.attrs:
            try:
                copy.attrs[name] = source.attrs[name]
            except HDF5_RAISES:
                is_lost = True
    except HDF5_RAISES:
        is_lost = True
    if is_lost:
        lost.append(f"attributes of {source.name}")


def _read(name: str, item: h5py.Dataset) -> None:
    """Read an array completely, unless it contains frames or texts of variable length, so that damage is noticed."""
    if not item.dtype.hasobject and not (item.ndim >= 3 and name in _FRAMES):
        item[()]


def _drop_unacknowledged(entry: h5py.Group, states: int) -> None:
    frames = int((entry["data/state"][()] < states).sum())
    for name in STATE_COLUMNS:
        entry["states"][name].resize(states, axis=0)
    for name in ("frames", *FRAME_COLUMNS):
        entry["data"][name].resize(frames, axis=0)
    for name in sensor_names(entry):
        for column in log_of(entry, name).values():
            column.resize(frames, axis=0)


def _repair_steps(entry: h5py.Group) -> None:
    """Remove incomplete rows of set-points and ring-downs, and all ring-downs if their frames are lost.

    A resumed run then records the lost ring-downs again.
    """
    for name in (SET_POINTS, RING_DOWN_STEPS):
        columns = list(entry[name].values()) if name in entry else []
        is_lost = name == RING_DOWN_STEPS and RING_DOWN not in entry
        complete = 0 if is_lost else min(map(len, columns), default=0)
        for column in columns:
            column.resize(complete, axis=0)
    if RING_DOWN_STEPS in entry and RING_DOWN not in entry:
        frames = entry["data/frames"]
        make_recordings(entry, (RING_DOWN,), np.zeros(frames.shape[1:], frames.dtype))


def _drop_unreadable(entry: h5py.Group, states: int) -> list[str]:
    """Remove damaged frames from every recording, and return a line of text for each damaged recording."""
    lines = []
    for name in sorted(BELONGS_TO.keys() & entry.keys()):
        try:
            rows = complete_rows(entry, name, states)
            sound = np.array([readable(entry[name]["frames"], row) for row in rows], dtype=bool)
            keep_rows(entry, name, rows[sound])
        except HDF5_RAISES:
            del entry[name]
            lines.append(f"unreadable and left out: entry/{name}")
            continue
        if not sound.all():
            lines.append(f"damaged frames left out of {name}: {int((~sound).sum())}")
    return lines


def _drop_damaged(entry: h5py.Group, damaged: Sequence[int]) -> list[int]:
    """Remove damaged frames, given by row number, from a dataset, and return the numbers of their load steps."""
    data, flags = entry["data"], entry["states/flags"]
    of_state = data["state"][()]
    sound = np.ones(len(of_state), dtype=bool)
    sound[list(damaged)] = False
    of_states = sorted({int(of_state[row]) for row in damaged})
    for state in of_states:
        rows = np.flatnonzero(of_state == state)
        lost = int((~sound[rows]).sum())
        flags[state] = flags_to_text(flags_from_text(flags[state]) + judge({"damaged_frames": lost}))
        if lost == len(rows):
            data["frames"][rows[0]] = 0
            sound[rows[0]] = True
    kept = np.flatnonzero(sound)
    for place, row in enumerate(kept):
        if place != row:
            data["frames"][place] = data["frames"][row]
    data["frames"].resize(len(kept), axis=0)
    logs = [column for name in sensor_names(entry) for column in log_of(entry, name).values()]
    for column in (*(data[name] for name in FRAME_COLUMNS), *logs):
        values = column[()][kept]
        column.resize(len(kept), axis=0)
        column[:] = values
    return of_states


def _main(crashed: Path, kind: str, path: Path, within_s: str) -> None:
    """Copy a dataset with limits of memory and processor time (s), and print the result as JSON."""
    obey_processor_limit(within_s)
    limit_memory(MEMORY_BYTES + crashed.stat().st_size)  # the file itself is mapped into memory
    try:
        states, lines = copy_readable(crashed, path, kind == _RUNNING)
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    print(json.dumps({"states": states, "said": lines}))


if __name__ == "__main__":
    source, kind_of_source, target, limit_s = child_arguments(4)
    _main(Path(source), kind_of_source, Path(target), limit_s)
