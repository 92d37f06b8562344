"""Read a dataset. Every complete load step can be read, even while a run writes the file or after a crash."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_fitting.time.measured import Motion
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.config.toml import differences, parse
from eimi_lab.dataset.containment import FORMER, refuse_links_and_absurd_sizes
from eimi_lab.dataset.dark_and_flat import correction_by, stored_correction
from eimi_lab.dataset.labelled import labelled_edges, labelled_points
from eimi_lab.dataset.layout import FORMAT, FORMAT_ATTRIBUTE, Kind, get_start, get_text
from eimi_lab.dataset.logged_sensor import SensorLog
from eimi_lab.dataset.moving.stored_motions import read_motions
from eimi_lab.dataset.opened_file import open_file
from eimi_lab.dataset.points import TrackedPoints, read_points
from eimi_lab.dataset.recorded_frames import RecordedFrames, creep_frames, recorded_ring_downs
from eimi_lab.dataset.recordings import CONDITIONING, TRANSIENTS, Recording, read_recording
from eimi_lab.dataset.sensor_logs import read_sensor_logs
from eimi_lab.dataset.steps import RingDownStep, SetPoint, count_steps, read_set_points
from eimi_lab.dataset.stored_edges import read_edges, read_projection
from eimi_lab.dataset.stored_frames import damaged_frames, each_image_of_state, images_of_state
from eimi_lab.dataset.stored_states import mean_by_state, read_states
from eimi_lab.dataset.upright import turn
from eimi_lab.process.errors import InputError
from eimi_lab.showing.tables import html_table
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.intensity import FieldCorrection
from eimi_lab.vision.projection import Projection

_IF_DAMAGED = "`eimi recover` makes a copy of what is readable"


class Dataset:
    """An open dataset, created by `open_dataset`. Use it in a ``with`` statement, or close it with `close`.

    Attributes
    ----------
    path
        The file.
    finished
        Whether the file was closed properly; False during a run and after a crash.
    kind
        ``"frames"`` for a dataset of frames, ``"points"`` for a dataset of tracked points.
    specimen
        The specimen.
    calibration
        The calibration; None for a dataset of tracked points.
    states
        The load steps with their loads and flags (defects).
    gravity_angle_deg, field_angle_deg
        Directions of gravity and of the field of a positive current, degrees from +x (along the straight beam from the
        clamp) toward +y (across the beam).
    gravity
        Whether the simulation of the beam includes its weight.
    field_line
        Straight line of gaussmeter readings against current, which gives the fields; None without a gaussmeter.
    """

    def __init__(self, path: Path, file: h5py.File, finished: bool, if_damaged: str = _IF_DAMAGED) -> None:
        """Read the specimen, the calibration and the load steps from an open file.

        ``finished`` tells whether the file was closed properly. ``if_damaged`` is the advice in a message about damage.
        """
        self.path = path
        self._if_damaged = if_damaged
        self.finished = finished
        self._file = file
        with self._naming_damage():
            self._open(path, file)

    def close(self) -> None:
        """Close the file of the dataset."""
        self._file.close()

    def reopen(self) -> None:
        """Open the file again, to read load steps that were written since. Raises InputError if this fails."""
        self._file.close()
        file, finished = open_file(self.path)
        self.__init__(self.path, file, finished, self._if_damaged)  # type: ignore[misc]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @contextmanager
    def _naming_damage(self) -> Iterator[None]:
        """Convert an error of HDF5 inside a ``with`` block into an InputError that names the damaged dataset."""
        try:
            yield
        except (InputError, ImportError):
            raise
        except Exception as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise InputError(
                f"{self.path}: is damaged, or does not have the contents of a dataset ({reason}); {self._if_damaged}"
            ) from error

    def _open(self, path: Path, file: h5py.File) -> None:
        refuse_links_and_absurd_sizes(path, file)
        states = file.get("entry/states")
        if states is None or FORMAT_ATTRIBUTE not in states.attrs:
            raise InputError(f"{path}: is an HDF5 file, but not a dataset of eimi-lab; `eimi import` makes a dataset")
        if states.attrs[FORMAT_ATTRIBUTE] != FORMAT:
            raise InputError(
                f"{path}: is of format {states.attrs[FORMAT_ATTRIBUTE]}; this version reads {FORMAT} only; open the "
                "file with the version of eimi-lab that wrote it"
            )
        self._entry = file["entry"]
        # The attribute `eimi_kind` is not read: HDF5 may never return from reading a damaged text.
        self.kind: Kind = "frames" if "frames" in self._entry["data"] else "points"
        specimen = self.text("specimen")
        if specimen is None:
            raise InputError(
                f"{path}: holds no specimen, so the dimensions of the beam are unknown; use another copy of the file"
            )
        self.specimen = parse(SpecimenFile, specimen, f"{path}: specimen")
        calibration = self.text("calibration")
        self.calibration: Calibration | None = None
        if calibration is not None:
            self.calibration = parse(Calibration, calibration, f"{path}: calibration")
            frame = BeamFrame(self.calibration)
            self.gravity_angle_deg, self.field_angle_deg = frame.gravity_deg, frame.field_deg
            self.gravity = self.calibration.gravity
        elif self.kind == "frames":
            raise InputError(
                f"{path}: holds frames but no calibration, so their scale is unknown; use another copy of the file"
            )
        else:
            self.gravity_angle_deg = float(states.attrs["gravity_angle_deg"])
            self.field_angle_deg = float(states.attrs["field_angle_deg"])
            self.gravity = bool(states.attrs.get("gravity", True))
        try:
            self.states, self.field_line = read_states(path, self._entry, self.kind)
        except OSError as error:
            raise InputError(
                f"{path}: the tables of the states in the file are damaged ({error}); `eimi recover` may repair them "
                "in a new file; otherwise, use another copy of this file"
            ) from error

    def refuse_without_state(self) -> None:
        """Raise InputError for a dataset of frames without a load step, because its run ended before the first one."""
        if self.kind == "frames" and not self.states:
            raise InputError(f"{self.path}: holds no state; repeat the run")

    def text(self, name: str) -> str | None:
        """Return the TOML text of one input file of the run; None if the text is not stored.

        ``name`` is "specimen", "calibration", "protocol" or "rig".
        """
        with self._naming_damage():
            return get_text(self._entry[name], "data") if name in self._entry else None

    def corrections(self) -> tuple[str, ...]:
        """Return the later changes of specimen and calibration, the oldest first, one line for each change."""
        with self._naming_damage():
            former = self._entry.get(FORMER, {})
            dated = [(get_text(former[name], "date"), name) for name in former]
            lines = []
            for date, name in sorted(dated):
                kind, _, number = name.rpartition("_")
                later = f"{kind}_{int(number) + 1}"
                text = get_text(former[later], "data") if later in former else self.text(kind) or ""
                changes = "; ".join(differences(get_text(former[name], "data"), text))
                lines.append(f"{kind} on {date[:10]}: {changes}")
            return tuple(lines)

    def images(self, state_index: int, most: int | None = None) -> NDArray[Any]:
        """Return the n frames of a load step, shape (n, H, W) or (n, H, W, 3: blue, green, red), type uint8 or uint16.

        At most the first ``most`` frames are returned. Raises InputError with the numbers of damaged frames.
        """
        with self._naming_damage():
            return images_of_state(self.path, self._entry, state_index, most)

    def each_image(self, state_index: int) -> Iterator[NDArray[Any]]:
        """Yield the frames of a load step one after another, shape (H, W) or (H, W, 3: blue, green, red).

        Only one frame is in memory at a time. Raises InputError for a damaged frame.
        """
        with self._naming_damage():
            yield from each_image_of_state(self.path, self._entry, state_index)

    def transient(self, state_index: int) -> Recording | None:
        """Return the frames that were taken while the beam settled in one load step; None if none are stored.

        Raises InputError if the file is damaged.
        """
        return self._recording(TRANSIENTS, state_index)

    def recorded_ring_downs(self) -> tuple[tuple[RingDownStep, RecordedFrames], ...]:
        """Return the change of the current and the frames of each recorded free oscillation; empty if there are none.

        Raises InputError if the file is damaged.
        """
        with self._naming_damage():
            return recorded_ring_downs(self._entry, len(self.states))

    @property
    def stored_ring_downs(self) -> int | None:
        """The number of recorded free oscillations; None if the file has no table for them."""
        with self._naming_damage():
            return count_steps(self._entry)

    def camera_setting(self, name: str) -> float | None:
        """Return a setting of the camera during the run, such as "exposure_s"; None if the setting was not stored."""
        with self._naming_damage():
            stored = self._entry.get(f"instrument/detector/settings/{name}")
            return None if stored is None else float(stored[()])

    def creep_frames(self, state_index: int) -> RecordedFrames | None:
        """Return the frames that record the creep of the beam in one load step; None if none are stored."""
        with self._naming_damage():
            return creep_frames(self._entry, len(self.states), state_index)

    def set_points(self) -> tuple[SetPoint, ...]:
        """Return all set-points of the current during the run, with their times; empty if none are stored."""
        with self._naming_damage():
            return read_set_points(self._entry)

    def conditioning(self) -> Recording | None:
        """Return the frames of the first and the last load cycle that preceded the load steps; None if none are stored.

        Raises InputError if the file is damaged.
        """
        return self._recording(CONDITIONING)

    def ring_downs(self) -> tuple[Motion, ...]:
        """Return the stored free oscillations of the beam as positions of points over time.

        The result is empty before `eimi segment` finds the points.
        """
        with self._naming_damage():
            return read_motions(self._entry, "ring_down")

    def creeps(self) -> tuple[Motion, ...]:
        """Return the stored creep of the beam as positions of points over time.

        The result is empty before `eimi segment` finds the points.
        """
        with self._naming_damage():
            return read_motions(self._entry, "creep")

    def _recording(self, name: str, only: int | None = None) -> Recording | None:
        with self._naming_damage():
            return read_recording(self._entry, name, len(self.states), only)

    def damaged_frames(self) -> tuple[int, ...]:
        """Return the row numbers of all damaged frames in the HDF5 array of frames. Every frame is read."""
        return damaged_frames(self._entry["data/frames"])

    def frame_format(self) -> tuple[tuple[int, ...], np.dtype[Any]]:
        """Return the shape of a frame, (rows, columns) or (rows, columns, 3), and the data type of its pixels."""
        frames = self._entry["data/frames"]
        return frames.shape[1:], frames.dtype

    def instruments(self) -> tuple[str, ...]:
        """Return driver, identification and address of each instrument as a line of text; empty for an import."""
        with self._naming_damage():
            group = self._entry["instrument"]
            return tuple(get_text(group[name], "data") for name in sorted(group) if name.startswith("identity_"))

    def sensors(self) -> tuple[SensorLog, ...]:
        """Return the readings of every sensor, one for each frame; empty if the run had no sensors."""
        with self._naming_damage():
            return read_sensor_logs(self._entry, len(self.states)) if self.kind == "frames" else ()

    def start_time(self) -> datetime:
        """Return the time at which the run started, or at which the oldest imported image file was written."""
        with self._naming_damage():
            start = datetime.fromisoformat(get_start(self._entry))
            return start if start.tzinfo else start.replace(tzinfo=UTC)

    def times_of_states(self) -> NDArray[np.float64]:
        """Return the mean time of the frames of each of K load steps on the clock of the run, s, shape (K,).

        The array is empty for tracked points.
        """
        if self.kind != "frames" or not self.states:
            return np.zeros(0)
        with self._naming_damage():
            return np.nan_to_num(mean_by_state(self._entry, "time", len(self.states)))

    def last_time_s(self) -> float:
        """Return the time of the last frame or set-point on the clock of the run, s; 0 if the dataset has neither."""
        with self._naming_damage():
            set_points_s = [point.time_s for point in read_set_points(self._entry)]
            return float(np.nanmax([*self._entry["data/time"][()], *set_points_s], initial=0.0))

    @property
    def resumable(self) -> bool:
        """Whether a run can add further load steps to the file. False for files of early versions."""
        return "sessions" in self._entry

    def edges(self) -> tuple[EdgeSet, ...] | None:
        """Return the stored edges of every load step; None if the edges of any load step are missing."""
        if "segmentation" not in self._entry:
            return None
        with self._naming_damage():
            edges = read_edges(self._entry)
        return edges if len(edges) == len(self.states) else None

    def projection(self) -> Projection | None:
        """Return the conversion of colours to grey values that was used to find the stored edges.

        The result is None if no edges are stored, or if the frames have no colours.
        """
        with self._naming_damage():
            return read_projection(self._entry)

    def correction(self) -> FieldCorrection | None:
        """Return the correction of frames by the stored dark frame (without light) and flat field (without the beam).

        The result is None if neither image is stored.
        """
        with self._naming_damage():
            return correction_by(stored_correction(self._entry))

    def points(self) -> tuple[TrackedPoints, ...]:
        """Return the tracked points of every load step. Raises ValueError for a dataset of frames."""
        if self.kind != "points":
            raise ValueError(
                f"{self.path} holds frames of a camera and no tracked points; `edges()` gives the edges in the frames"
            )
        with self._naming_damage():
            return read_points(self._entry, len(self.states))

    def upright(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """Convert points (x along the straight beam, y across it) into points (right, up) of the camera's picture.

        Points have the shape (..., 2), mm. Without a camera, gravity points down.
        """
        rotation = turn(self.calibration, self.gravity_angle_deg if self.gravity else None)
        return np.asarray(np.asarray(points_mm, dtype=float) @ rotation.T)

    def plot(self) -> Any:
        """Return a matplotlib figure with the edges or the tracked points of all load steps.

        Raises InputError for a dataset of frames that has no edges yet.
        """
        from eimi_lab.dataset.plotting import UPRIGHT, drawn_places  # matplotlib loads slowly

        if self.kind == "points":
            return drawn_places(self.states, [[self.upright(p.points_mm)] for p in self.points()], UPRIGHT, lines=False)
        edges = self._edges_or_refusal()
        places = [[self.upright(side.points_mm) for side in (sides.left, sides.right)] for sides in edges]
        return drawn_places(self.states, places, UPRIGHT, lines=True)

    def _edges_or_refusal(self) -> tuple[EdgeSet, ...]:
        edges = self.edges()
        if edges is None:
            raise InputError(f"{self.path}: has no edges yet; `eimi segment` finds the edges")
        return edges

    def __repr__(self) -> str:
        return f"<Dataset {self.path}: {self.specimen.specimen.name}, {len(self.states)} states of {self.kind}>"

    def _repr_html_(self) -> str:
        beam, rows = self.specimen.specimen, []
        edges = self.edges() if self.kind == "frames" else None
        for state in self.states:
            names = dict.fromkeys(flag.name for flag in (*state.flags, *(edges[state.index].flags if edges else ())))
            rows.append((str(state.index), f"{state.field_mT:.3f}", f"{state.tip_force_N:.3g}", ", ".join(names)))
        progress = "" if self.kind == "points" else "; no edges yet" if edges is None else "; with edges"
        caption = f"{self.path.name}: {beam.name}, {beam.material}, {len(self.states)} states of {self.kind}{progress}"
        return html_table(caption, ("state", "field, mT", "tip force, N", "flags"), rows)

    def to_xarray(self) -> Any:
        """Return the edges or the tracked points of all load steps as an xarray.Dataset.

        Raises InputError for a dataset of frames that has no edges yet, and ImportError if xarray is not installed.
        """
        attributes = {"path": str(self.path), "specimen": self.specimen.specimen.name}
        if self.kind == "points":
            return labelled_points(self.states, self.points(), attributes)
        return labelled_edges(self.states, self._edges_or_refusal(), attributes)

    def truth(self) -> dict[str, Any] | None:
        """Return the true materials of a virtual rig; None for a real rig or an import. A fit must not read them."""
        with self._naming_damage():
            return json.loads(get_text(self._entry["truth"], "data")) if "truth" in self._entry else None


def open_dataset(path: str | Path) -> Dataset:
    """Open a dataset for reading, even if a run is writing it or its writer crashed.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, or is not a dataset.
    """
    path = Path(path)
    file, finished = open_file(path)
    try:
        return Dataset(path, file, finished)
    except BaseException:
        file.close()
        raise
