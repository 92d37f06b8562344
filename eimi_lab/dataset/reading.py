"""Reading a dataset, finished or not: a live or crashed file shows every state that was acknowledged."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.config.toml import differences, parse
from eimi_lab.dataset.dark_and_flat import correction_by, stored_correction
from eimi_lab.dataset.labelled import labelled_edges, labelled_points
from eimi_lab.dataset.layout import FORMAT, FORMAT_ATTRIBUTE, Kind, flags_from_text, get_text
from eimi_lab.dataset.points import TrackedPoints, read_points
from eimi_lab.dataset.recordings import BELONGS_TO, CONDITIONING, RELEASE, TRANSIENTS, Recording, read_recording
from eimi_lab.dataset.repair.mended_file import MendedFile
from eimi_lab.dataset.repair.probing import why_unreadable
from eimi_lab.dataset.repair.superblock import close_superblock
from eimi_lab.dataset.state import State
from eimi_lab.dataset.stored_edges import read_edges, read_projection
from eimi_lab.dataset.tip_force_angles import tip_force_angles
from eimi_lab.dataset.upright import turn
from eimi_lab.process.errors import InputError
from eimi_lab.process.writer_lock import is_being_written
from eimi_lab.showing.tables import html_table
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.intensity import FieldCorrection
from eimi_lab.vision.projection import Projection

MOST_BYTES = 1 << 30
"""Of one table, or of one frame. A few bytes in a file can claim any size."""

MOST_OF_A_STATE_BYTES = 8 << 30

FORMER = "former"
"""The group of files that others took the place of."""

READ = (
    *("entry/specimen", "entry/calibration", "entry/protocol", "entry/rig", "entry/truth", "entry/start_time"),
    *("entry/user_note", "entry/data", "entry/states", "entry/sessions", "entry/correction", "entry/instrument"),
    f"entry/{FORMER}",
    *(f"entry/{name}" for name in BELONGS_TO),
    *(
        "entry/segmentation/projection",
        "entry/segmentation/edges",
        "entry/segmentation/edges/left",
        "entry/segmentation/edges/right",
    ),
)


_IF_DAMAGED = "`eimi recover` makes a copy of what is readable"
_NOT_HDF5 = "is not an HDF5 file; `eimi import` makes a dataset from images or points"
# What a person may give in a dataset's place, by the ending of its name.
_INSTEAD = {
    ".json": "is a JSON file; a fit goes with --fit, and the dataset is what `eimi acquire` or `eimi import` wrote",
    ".toml": "is a TOML file, not a dataset, which `eimi acquire` or `eimi import` writes",
    ".csv": "is a table; `eimi import` makes a dataset of tables and what they list",
}


class Dataset:
    """An open dataset; see `open_dataset`. It closes at the end of a `with`, by `close`, or when nobody has it.

    gravity_angle_deg and field_angle_deg are in the beam frame, from +x toward +y; gravity: whether the weight bends
    the beam. finished is False while a run is going on, and after it crashed. if_damaged: what is told of a damaged
    file beside the damage.
    """

    def __init__(self, path: Path, file: h5py.File, finished: bool, if_damaged: str = _IF_DAMAGED) -> None:
        self.path = path
        self._if_damaged = if_damaged
        self.finished = finished
        self._file = file
        with self._damage_named():
            self._open(path, file)

    def close(self) -> None:
        """Close the file; nothing more can be read from it."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @contextmanager
    def _damage_named(self) -> Iterator[None]:
        """HDF5 raises nearly anything on a damaged file, and so does what is computed from its wrong numbers."""
        try:
            yield
        except (InputError, ImportError):
            raise
        except Exception as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise InputError(
                f"{self.path}: is damaged, or not what a dataset should be ({reason}); {self._if_damaged}"
            ) from error

    def _open(self, path: Path, file: h5py.File) -> None:
        _refuse_links(path, file)
        states = file.get("entry/states")
        if states is None or FORMAT_ATTRIBUTE not in states.attrs:
            raise InputError(f"{path}: is an HDF5 file, but not a dataset of this suite; `eimi import` makes one")
        if states.attrs[FORMAT_ATTRIBUTE] != FORMAT:
            raise InputError(f"{path}: is of format {states.attrs[FORMAT_ATTRIBUTE]}; this version reads {FORMAT}")
        self._entry = file["entry"]
        # Not by the attribute that says so: HDF5 may never come back from a damaged heap of texts.
        self.kind: Kind = "frames" if "frames" in self._entry["data"] else "points"
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
            self.gravity = self.calibration.gravity
        elif self.kind == "frames":
            raise InputError(f"{path}: holds frames but no calibration, so its scale is unknown")
        else:
            self.gravity_angle_deg = float(states.attrs["gravity_angle_deg"])
            self.field_angle_deg = float(states.attrs["field_angle_deg"])
            self.gravity = bool(states.attrs.get("gravity", True))
        try:
            self.states: tuple[State, ...] = self._read_states()
        except OSError as error:
            raise InputError(
                f"{path}: the tables of its states are damaged ({error}); `eimi recover` may mend them, or take "
                "another copy of it"
            ) from error

    def _read_states(self) -> tuple[State, ...]:
        table = self._entry["states"]
        indices = table["index"][()]
        if not np.array_equal(indices, np.arange(len(indices))):
            raise InputError(f"{self.path}: the numbers of its states are damaged; `eimi recover` may mend them")
        angles = tip_force_angles(table, len(indices))
        measured = np.full(len(indices), np.nan)
        if self.kind == "frames":
            # The arrays may be longer than what the last acknowledged state left: those rows are not ours to read.
            of_state, values = self._entry["data/state"][()], self._entry["data/measured_current"][()]
            rows = min(len(of_state), len(values))
            known = np.isin(of_state[:rows], indices)
            frames = np.bincount(of_state[:rows][known], minlength=len(indices))[: len(indices)]
            sums = np.bincount(of_state[:rows][known], weights=values[:rows][known], minlength=len(indices))
            measured = sums[: len(indices)] / frames
        return tuple(
            State(
                index=int(index),
                current_A=_known(table["current"][index]),
                measured_A=_known(measured[index]),
                field_mT=float(table["field"][index]),
                tip_force_N=float(table["tip_force"][index]),
                flags=flags_from_text(table["flags"][index]),
                tip_force_angle_deg=_known(angles[index]),
            )
            for index in indices
        )

    def text(self, name: str) -> str | None:
        """The stored TOML text of the specimen, calibration, protocol or rig; None where there is none."""
        with self._damage_named():
            return get_text(self._entry[name], "data") if name in self._entry else None

    def corrections(self) -> tuple[str, ...]:
        """What was stated otherwise before, a line a file that another took the place of, oldest first."""
        with self._damage_named():
            former = self._entry.get(FORMER, {})
            every = [(get_text(former[name], "date"), name) for name in former]
            found = []
            for date, name in sorted(every):
                kind, _, number = name.rpartition("_")
                later = f"{kind}_{int(number) + 1}"
                text = get_text(former[later], "data") if later in former else self.text(kind) or ""
                words = "; ".join(differences(get_text(former[name], "data"), text))
                found.append(f"{kind} on {date[:10]}: {words}")
            return tuple(found)

    def images(self, state_index: int, most: int | None = None) -> NDArray[Any]:
        """(n, H, W) or (n, H, W, 3: blue, green, red), uint8 or uint16: the frames of a state, at most so many.

        Raises InputError naming those that are damaged.
        """
        with self._damage_named():
            rows = np.flatnonzero(self._entry["data/state"][()] == state_index)[:most]
            frames = self._entry["data/frames"]
            if len(rows) * int(np.prod(frames.shape[1:], dtype=object)) * frames.dtype.itemsize > MOST_OF_A_STATE_BYTES:
                raise InputError(f"{self.path}: state {state_index} claims {len(rows)} frames, more than could be read")
            try:
                found = frames[rows[0] : rows[-1] + 1]
            except OSError as error:
                damaged = ", ".join(str(row - rows[0]) for row in rows.tolist() if not self._readable(row))
                raise InputError(
                    f"{self.path}: frame {damaged} of the {len(rows)} of state {state_index} (counted from 0) "
                    f"is damaged ({error}); `eimi recover` makes a copy without it"
                ) from error
            return found if found.ndim == 3 else found[..., ::-1]

    def transient(self, state_index: int) -> Recording | None:
        """How the beam came to rest in a state; None where nothing was kept of it. Raises InputError."""
        return self._recording(TRANSIENTS, state_index)

    def release(self) -> Recording | None:
        """What the beam did after the current went to zero at the end; None where that was not recorded.

        Raises InputError.
        """
        return self._recording(RELEASE)

    def conditioning(self) -> Recording | None:
        """The beam before the run, in its first and its last cycle; None where there was none. Raises InputError."""
        return self._recording(CONDITIONING)

    def _recording(self, name: str, only: int | None = None) -> Recording | None:
        with self._damage_named():
            return read_recording(self._entry, name, len(self.states), only)

    def damaged_frames(self) -> tuple[int, ...]:
        """Rows of the frames that cannot be read, counted over the whole dataset; reads every frame."""
        return tuple(row for row in range(len(self._entry["data/frames"])) if not self._readable(row))

    def _readable(self, row: int) -> bool:
        try:
            self._entry["data/frames"][row]
        except OSError:
            return False
        return True

    def frame_format(self) -> tuple[tuple[int, ...], np.dtype[Any]]:
        """Height and width of the frames, and 3 where they have colours; and their type."""
        frames = self._entry["data/frames"]
        return frames.shape[1:], frames.dtype

    def instruments(self) -> tuple[str, ...]:
        """What supply and camera said of themselves, a line each; empty for an imported dataset."""
        with self._damage_named():
            group = self._entry["instrument"]
            return tuple(get_text(group[name], "data") for name in sorted(group) if name.startswith("identity_"))

    def start_time(self) -> datetime:
        """When the run began, or when the oldest of the imported image files was written."""
        with self._damage_named():
            start = datetime.fromisoformat(get_text(self._entry, "start_time"))
            return start if start.tzinfo else start.replace(tzinfo=UTC)

    def last_time_s(self) -> float:
        """The run's clock at the last frame; 0 before there is one."""
        with self._damage_named():
            return float(np.nanmax(self._entry["data/time"][()], initial=0.0))

    @property
    def resumable(self) -> bool:
        """Whether the file can take more states; those of earlier versions cannot."""
        return "sessions" in self._entry

    def edges(self) -> tuple[EdgeSet, ...] | None:
        """What segmentation stored, one element a state; None before segmentation, or where a run went on after it."""
        if "segmentation" not in self._entry:
            return None
        with self._damage_named():
            found = read_edges(self._entry)
        return found if len(found) == len(self.states) else None

    def projection(self) -> Projection | None:
        """How colours were seen when the stored edges were found; None where there are no edges, or no colours."""
        with self._damage_named():
            return read_projection(self._entry)

    def correction(self) -> FieldCorrection | None:
        """What dark frame and flat field take out of the frames; None where the dataset keeps neither."""
        with self._damage_named():
            return correction_by(stored_correction(self._entry))

    def points(self) -> tuple[TrackedPoints, ...]:
        """The tracked points, one element a state. Raises ValueError for a dataset of frames."""
        if self.kind != "points":
            raise ValueError(f"{self.path} holds frames, not tracked points")
        with self._damage_named():
            return read_points(self._entry, len(self.states))

    def upright(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """(..., 2) places of the beam frame as (to the right, up): as before the camera, or with gravity downward."""
        turned = turn(self.calibration, self.gravity_angle_deg if self.gravity else None)
        return np.asarray(np.asarray(points_mm, dtype=float) @ turned.T)

    def plot(self) -> Any:
        """A matplotlib figure of the edges or tracked points of all states, by their field. Raises InputError."""
        from eimi_lab.dataset.plotting import UPRIGHT, drawn_places  # matplotlib is slow to import

        if self.kind == "points":
            return drawn_places(self.states, [[self.upright(p.points_mm)] for p in self.points()], UPRIGHT, lines=False)
        edges = self._edges_or_refusal()
        places = [[self.upright(side.points_mm) for side in (own.left, own.right)] for own in edges]
        return drawn_places(self.states, places, UPRIGHT, lines=True)

    def _edges_or_refusal(self) -> tuple[EdgeSet, ...]:
        edges = self.edges()
        if edges is None:
            raise InputError(f"{self.path}: has no edges yet; `eimi segment` finds them")
        return edges

    def _repr_html_(self) -> str:
        beam, rows = self.specimen.specimen, []
        edges = self.edges() if self.kind == "frames" else None
        for state in self.states:
            names = dict.fromkeys(flag.name for flag in (*state.flags, *(edges[state.index].flags if edges else ())))
            rows.append((str(state.index), f"{state.field_mT:.3f}", f"{state.tip_force_N:.3g}", ", ".join(names)))
        found = "" if self.kind == "points" else "; no edges yet" if edges is None else "; with edges"
        caption = f"{self.path.name}: {beam.name}, {beam.material}, {len(self.states)} states of {self.kind}{found}"
        return html_table(caption, ("state", "field, mT", "tip force, N", "flags"), rows)

    def to_xarray(self) -> Any:
        """Edges or tracked points as xarray.Dataset. Raises ImportError, InputError for frames without edges."""
        attributes = {"path": str(self.path), "specimen": self.specimen.specimen.name}
        if self.kind == "points":
            return labelled_points(self.states, self.points(), attributes)
        return labelled_edges(self.states, self._edges_or_refusal(), attributes)

    def truth(self) -> dict[str, Any] | None:
        """What a virtual rig was made of, for scoring alone: nothing that fits may ask for it."""
        with self._damage_named():
            return json.loads(get_text(self._entry["truth"], "data")) if "truth" in self._entry else None


def _known(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def open_dataset(path: str | Path) -> Dataset:
    """Open a dataset to read, also one that is being written or whose writer crashed. Raises InputError.

    To be used in a `with`, or as it is.
    """
    path = Path(path)
    file, finished = open_file(path)
    try:
        return Dataset(path, file, finished)
    except BaseException:
        file.close()
        raise


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
        raise InputError(f"{path}: {_instead(path)}")
    try:
        return h5py.File(path, "r"), True
    except OSError as error:
        reason = str(error)
    if _has_a_writer(path):
        if is_being_written(path):
            if reason := why_unreadable(path):
                raise InputError(f"{path}: is a damaged HDF5 file ({reason})")
            return h5py.File(path, "r", libver="latest", swmr=True), False
        crashed = MendedFile(path)
        close_superblock(crashed)
        try:
            return h5py.File(crashed, "r"), False
        except OSError as error:
            reason = str(error)
    raise InputError(f"{path}: is a damaged HDF5 file ({reason}); `eimi recover` makes a copy of what is readable")


def _instead(path: Path) -> str:
    """What a file is that is none of HDF5, and what is to be done with it."""
    from eimi_lab.dataset.videos import ENDINGS as VIDEOS  # OpenCV is slow to load
    from eimi_lab.vision.image_files import ENDINGS as IMAGES

    ending = path.suffix.lower()
    if ending in IMAGES:
        return "is a picture; `eimi import` makes a dataset of pictures"
    if ending in VIDEOS:
        return "is a video; `eimi import` makes a dataset of videos"
    return _INSTEAD.get(ending, _NOT_HDF5)


def _refuse_links(path: Path, file: h5py.File) -> None:
    """Raise InputError where what a dataset holds is kept elsewhere, or claims more than could be read.

    Only what is read is looked at: a person may have put other things beside it.
    """
    for place in READ:
        parent: Any = file
        for name in place.split("/"):
            if not isinstance(parent, h5py.Group) or name not in parent:
                break
            parent = _own(path, parent, name)
        else:
            names = list(parent) if isinstance(parent, h5py.Group) else []
            for item in [_own(path, parent, name) for name in names] or [parent]:
                _refuse_storage(path, item)


def _own(path: Path, parent: h5py.Group, name: str) -> Any:
    """What a group itself holds under a name. Raises InputError for a link to elsewhere."""
    if not isinstance(parent.get(name, getlink=True), h5py.HardLink):
        place = f"{parent.name}/{name}".lstrip("/")
        raise InputError(f"{path}: {place} is a link to another place; a dataset holds everything itself")
    return parent[name]


def _refuse_storage(path: Path, item: Any) -> None:
    if not isinstance(item, h5py.Dataset):
        return
    if item.external or item.is_virtual:
        raise InputError(f"{path}: {item.name} is kept in another file; a dataset holds everything itself")
    if item.dtype.hasobject or item.dtype.kind not in "iufS":
        raise InputError(f"{path}: {item.name} is of type {item.dtype}; numbers or text of fixed length are read")
    row = item.nbytes if item.ndim < 3 else int(np.prod(item.shape[1:], dtype=object)) * item.dtype.itemsize
    if row > MOST_BYTES or item.ndim > 4:
        raise InputError(f"{path}: {item.name} claims a size of {item.shape}, more than could be read")


def _has_a_writer(path: Path) -> bool:
    """Whether somebody has the file open to write, or had when he crashed.

    Version and consistency flags are at bytes 8 and 11 (HDF5 File Format Specification 3.0, section II.A, superblock 2
    and 3).
    """
    with path.open("rb") as raw:
        superblock = raw.read(12)
    return len(superblock) == 12 and superblock[8] == 3 and superblock[11] != 0
