"""Reading a dataset, finished or not: a live or crashed file shows every state that was acknowledged."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.reading import parse
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.corrections import correction_by, stored_correction
from eimi_lab.dataset.edges import read_edges
from eimi_lab.dataset.labelled import labelled
from eimi_lab.dataset.layout import FORMAT, FORMAT_ATTRIBUTE, KIND_ATTRIBUTE, Kind, flags_from_text, get_text
from eimi_lab.dataset.points import TrackedPoints, read_points
from eimi_lab.dataset.probing import why_unreadable
from eimi_lab.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edge_set import EdgeSet, Flag
from eimi_lab.vision.intensity import FieldCorrection


@dataclass(frozen=True)
class State:
    """One loading. current_A is what was set, measured_A the mean read back; None where it was never known."""

    index: int
    current_A: float | None
    measured_A: float | None
    field_mT: float
    tip_force_N: float
    flags: tuple[Flag, ...]


class Dataset:
    """An open dataset; see `open_dataset`.

    gravity_angle_deg and field_angle_deg are in the beam frame, from +x toward +y. finished is False while a run
    is going on, and after it crashed.
    """

    def __init__(self, path: Path, file: h5py.File, finished: bool) -> None:
        states = file.get("entry/states")
        if states is None or FORMAT_ATTRIBUTE not in states.attrs:
            raise InputError(f"{path}: is an HDF5 file, but not a dataset of this suite; `eimi import` makes one")
        if states.attrs[FORMAT_ATTRIBUTE] != FORMAT:
            raise InputError(f"{path}: is of format {states.attrs[FORMAT_ATTRIBUTE]}; this version reads {FORMAT}")
        self.path = path
        self.finished = finished
        self._entry = file["entry"]
        self.kind: Kind = states.attrs[KIND_ATTRIBUTE]
        specimen = self.text("specimen")
        if specimen is None:
            raise InputError(f"{path}: holds no specimen, so the beam's dimensions are unknown")
        self.specimen = parse(SpecimenFile, specimen, f"{path}: specimen")
        calibration = self.text("calibration")
        self.calibration: Calibration | None = None
        if calibration is not None:
            self.calibration = parse(Calibration, calibration, f"{path}: calibration")
            frame = BeamFrame(self.calibration)
            self.gravity_angle_deg, self.field_angle_deg = frame.gravity_deg, frame.field_deg
        elif self.kind == "frames":
            raise InputError(f"{path}: holds frames but no calibration, so its scale is unknown")
        else:
            self.gravity_angle_deg = float(states.attrs["gravity_angle_deg"])
            self.field_angle_deg = float(states.attrs["field_angle_deg"])
        try:
            self.states: tuple[State, ...] = self._read_states()
        except OSError as error:
            raise InputError(
                f"{path}: the tables of its states are damaged ({error}); take another copy of it"
            ) from error

    def _read_states(self) -> tuple[State, ...]:
        table = self._entry["states"]
        indices = table["index"][()]
        measured = np.full(len(indices), np.nan)
        if self.kind == "frames":
            # The arrays may be longer than what the last acknowledged state left: those rows are not ours to read.
            of_state, values = self._entry["data/state"][()], self._entry["data/measured_current"][()]
            for index in indices:
                measured[index] = values[: len(of_state)][of_state[: len(values)] == index].mean()
        return tuple(
            State(
                index=int(index),
                current_A=_known(table["current"][index]),
                measured_A=_known(measured[index]),
                field_mT=float(table["field"][index]),
                tip_force_N=float(table["tip_force"][index]),
                flags=flags_from_text(table["flags"][index]),
            )
            for index in indices
        )

    def text(self, name: str) -> str | None:
        """The stored TOML text of the specimen, calibration, protocol or rig; None where there is none."""
        return get_text(self._entry[name], "data") if name in self._entry else None

    def images(self, state_index: int) -> NDArray[Any]:
        """(n, H, W), uint8 or uint16: the frames of a state. Raises InputError naming those that are damaged."""
        rows = np.flatnonzero(self._entry["data/state"][()] == state_index)
        try:
            return self._entry["data/frames"][rows[0] : rows[-1] + 1]
        except OSError as error:
            damaged = ", ".join(str(row - rows[0]) for row in rows.tolist() if not self._readable(row))
            raise InputError(
                f"{self.path}: frame {damaged} of the {len(rows)} of state {state_index} (counted from 0) "
                f"is damaged ({error}); `eimi recover` makes a copy without it"
            ) from error

    def damaged_frames(self) -> tuple[int, ...]:
        """Rows of the frames that cannot be read, counted over the whole dataset; reads every frame."""
        return tuple(row for row in range(len(self._entry["data/frames"])) if not self._readable(row))

    def _readable(self, row: int) -> bool:
        try:
            self._entry["data/frames"][row]
        except OSError:
            return False
        return True

    def frame_format(self) -> tuple[tuple[int, int], np.dtype[Any]]:
        """Height and width of the frames, and their type."""
        frames = self._entry["data/frames"]
        return frames.shape[1:], frames.dtype

    def instruments(self) -> tuple[str, ...]:
        """What supply and camera said of themselves, a line each; empty for an imported dataset."""
        group = self._entry["instrument"]
        return tuple(get_text(group[name], "data") for name in sorted(group) if name.startswith("identity_"))

    def start_time(self) -> datetime:
        """When the run began, or when the oldest of the imported image files was written."""
        return datetime.fromisoformat(get_text(self._entry, "start_time"))

    def last_time_s(self) -> float:
        """The run's clock at the last frame; 0 before there is one."""
        times = self._entry["data/time"][()]
        return float(np.nanmax(times, initial=0.0))

    @property
    def resumable(self) -> bool:
        """Whether the file can take more states; those of earlier versions cannot."""
        return "sessions" in self._entry

    def edges(self) -> tuple[EdgeSet, ...] | None:
        """What segmentation stored, one element a state; None before segmentation, or where a run went on after it."""
        if "segmentation" not in self._entry:
            return None
        found = read_edges(self._entry)
        return found if len(found) == len(self.states) else None

    def correction(self) -> FieldCorrection | None:
        """What dark frame and flat field take out of the frames; None where the dataset keeps neither."""
        return correction_by(stored_correction(self._entry))

    def points(self) -> tuple[TrackedPoints, ...]:
        """The tracked points, one element a state. Raises ValueError for a dataset of frames."""
        if self.kind != "points":
            raise ValueError(f"{self.path} holds frames, not tracked points")
        return read_points(self._entry, len(self.states))

    def to_xarray(self) -> Any:
        """Edges or tracked points as xarray.Dataset. Raises ImportError, InputError for frames without edges."""
        return labelled(self)

    def truth(self) -> dict[str, Any] | None:
        """What a virtual rig was made of, for scoring alone: nothing that fits may ask for it."""
        return json.loads(get_text(self._entry["truth"], "data")) if "truth" in self._entry else None


def _known(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


@contextmanager
def open_dataset(path: str | Path) -> Iterator[Dataset]:
    """Open a dataset to read, also one that is being written or whose writer crashed. Raises InputError."""
    path = Path(path)
    file, finished = open_file(path)
    with file:
        yield Dataset(path, file, finished)


def open_file(path: Path) -> tuple[h5py.File, bool]:
    """The HDF5 file and whether its writer closed it. Raises InputError."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; a dataset is a file, which `eimi import` makes from a folder of images")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        is_hdf5 = h5py.is_hdf5(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error})") from error
    if not is_hdf5:
        raise InputError(f"{path}: is not an HDF5 file; `eimi import` makes a dataset from images or points")
    try:
        return h5py.File(path, "r"), True
    except OSError as error:
        reason = why_unreadable(path) if _has_a_writer(path) else str(error)
        if reason:
            raise InputError(f"{path}: is a damaged HDF5 file ({reason})") from error
    return h5py.File(path, "r", libver="latest", swmr=True), False


def _has_a_writer(path: Path) -> bool:
    """Whether somebody has the file open to write, or had when he crashed.

    Version and consistency flags are at bytes 8 and 11 (HDF5 File Format Specification 3.0, section II.A, superblock 2
    and 3).
    """
    with path.open("rb") as raw:
        superblock = raw.read(12)
    return superblock[8] == 3 and superblock[11] != 0
