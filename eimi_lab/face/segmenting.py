"""From pictures or tracked points that a lab already has to a dataset, and from its frames to edges."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from eimi_lab.config.calibration import Calibration, changed_calibration, load_calibration
from eimi_lab.config.toml import Document, to_toml
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.face.given import AnyDataset, AnyPath, AnySpecimen, closed_meanwhile, files, named_options, specimen_of
from eimi_lab.process.errors import InputError, tell
from eimi_lab.vision.edges.edge_set import EdgeSet


@named_options
def import_pictures(
    source: AnyPath,
    states: AnyPath,
    specimen: AnySpecimen,
    calibration: AnyPath | Calibration,
    output: AnyPath,
    *,
    average: bool = False,
    dark: AnyPath | None = None,
    flat: AnyPath | None = None,
    clamp: tuple[float, float] | None = None,
    axis: float | None = None,
    region: tuple[int, int, int, int] | None = None,
    polarity: Literal["dark", "bright"] | None = None,
    channel: Literal["red", "green", "blue", "grey"] | None = None,
    beam_colour: tuple[float, float, float] | None = None,
    force: bool = False,
) -> Dataset:
    """Make a dataset of pictures or a video that a lab already has.

    Parameters
    ----------
    source : str or Path
        A folder of images, an image, or a video.
    states : str or Path
        A table (CSV) of frame (or time_s), current_A or field_mT, tip_force_N.
    specimen, calibration : str, Path or object
        TOML files, names of shipped ones, or what was loaded from one.
    output : str or Path
        The dataset to write.
    average : bool
        Keep the mean of a state's frames, not each.
    dark, flat : str or Path
        An image without light and one of the bare back-light, which the dataset keeps to correct its frames.
    clamp : (float, float)
        Middle of the line at which the beam leaves its clamp, px.
    axis : float
        Direction of the beam there, at rest, degrees: 0 right, 90 down.
    region : (int, int, int, int)
        x, y, width and height of the part of the pictures to look at, px.
    polarity, channel, beam_colour
        The beam against what is beside it; the channel in which it differs most; its colour (red, green, blue).
    force : bool
        Replace a dataset that exists.

    Returns
    -------
    Dataset
        Open, without edges: `segment` finds them.

    Raises
    ------
    InputError
        For files that cannot be used, in one line that says what would be right.
    """
    from eimi_lab.dataset.dark_and_flat import read_correction_images
    from eimi_lab.dataset.importing import import_frames
    from eimi_lab.process.outputs import check_distinct
    from eimi_lab.process.progress import progress

    changes = _changes(clamp, axis, region, polarity, channel, beam_colour)
    check_distinct(files(source, states, specimen, calibration, dark, flat), [Path(output)])
    if isinstance(calibration, Calibration):
        found = changed_calibration(calibration, changes)
    else:
        found = load_calibration(calibration, changes)
    correction = read_correction_images(_path(dark), _path(flat))
    beam = specimen_of(specimen)
    import_frames(Path(source), Path(states), beam, found, Path(output), force, average, progress, correction)
    return open_dataset(Path(output))


@named_options
def import_points(
    source: AnyPath,
    states: AnyPath,
    specimen: AnySpecimen,
    output: AnyPath,
    *,
    gravity_angle: float | None = None,
    no_gravity: bool = False,
    force: bool = False,
) -> Dataset:
    """Make a dataset of points that were tracked on a beam.

    Parameters
    ----------
    source : str or Path
        A table (CSV) of state, point, x0_mm, y0_mm, x_mm, y_mm, sigma_mm.
    states : str or Path
        A table (CSV) of state, field_mT, tip_force_N.
    specimen : str, Path or SpecimenFile
        The beam.
    output : str or Path
        The dataset to write.
    gravity_angle : float
        Gravity in the beam frame, degrees from +x toward +y; 0 for a beam that hangs. Needed unless ``no_gravity``.
    no_gravity : bool
        The beam's weight does not bend it.
    force : bool
        Replace a dataset that exists.

    Returns
    -------
    Dataset
        Open.

    Raises
    ------
    InputError
        For files that cannot be used, in one line that says what would be right.
    """
    from eimi_lab.dataset.tracked.points_csv import import_points as from_table
    from eimi_lab.process.outputs import check_distinct

    if gravity_angle is None and not no_gravity:
        raise InputError(f"{source}: tracked points need gravity_angle, or no_gravity = True")
    check_distinct(files(source, states, specimen), [Path(output)])
    from_table(
        Path(source), Path(states), specimen_of(specimen), gravity_angle, Path(output), force, gravity=not no_gravity
    )
    return open_dataset(Path(output))


@named_options
def segment(
    dataset: AnyDataset,
    *,
    specimen: AnySpecimen | None = None,
    calibration: AnyPath | Calibration | None = None,
    clamp: tuple[float, float] | None = None,
    axis: float | None = None,
    region: tuple[int, int, int, int] | None = None,
    polarity: Literal["dark", "bright"] | None = None,
    channel: Literal["red", "green", "blue", "grey"] | None = None,
    beam_colour: tuple[float, float, float] | None = None,
    csv: AnyPath | None = None,
    overlay: AnyPath | None = None,
    explain: AnyPath | None = None,
    dark: AnyPath | None = None,
    flat: AnyPath | None = None,
    uncorrected: bool = False,
    workers: int = 1,
    force: bool = False,
) -> Dataset:
    """Find the beam's edges in every state and store them in the dataset.

    Parameters
    ----------
    dataset : str, Path or Dataset
        A dataset of frames; one that is open is closed meanwhile.
    specimen, calibration : str, Path or object
        In place of the stored ones, which the dataset keeps too.
    clamp, axis, region, polarity, channel, beam_colour
        Help in finding the beam, see `import_pictures`; the dataset keeps it.
    csv, overlay, explain : str or Path
        Folders for the edges as tables, for pictures of the edges, and for pictures of how the beam is followed.
    dark, flat : str or Path
        Images that correct the frames; the dataset keeps them.
    uncorrected : bool
        Forget the dark frame and the flat field that the dataset keeps.
    workers : int
        Processes that share the states.
    force : bool
        Replace folders that exist.

    Returns
    -------
    Dataset
        Open, with edges; the one that was given, if it was open.

    Raises
    ------
    InputError
        For a dataset without frames, and for files that cannot be used.
    """
    changes = _changes(clamp, axis, region, polarity, channel, beam_colour)
    with closed_meanwhile([dataset]) as (path,), TemporaryDirectory() as folder:
        find_edges(
            path,
            specimen=_as_file(specimen, Path(folder) / "specimen.toml"),
            calibration=_as_file(calibration, Path(folder) / "calibration.toml"),
            changes=changes,
            csv=_path(csv),
            overlay=_path(overlay),
            explain=_path(explain),
            dark=_path(dark),
            flat=_path(flat),
            uncorrected=uncorrected,
            workers=workers,
            force=force,
        )
    return dataset if isinstance(dataset, Dataset) else open_dataset(path)


def _path(given: AnyPath | None) -> Path | None:
    return None if given is None else Path(given)


def _as_file(given: AnyPath | Document | None, path: Path) -> str | None:
    """Return the path of the file that states this value."""
    if given is None or not isinstance(given, Document):
        return None if given is None else str(given)
    path.write_text(given.text or to_toml(given), encoding="utf-8")
    return str(path)


def _changes(
    clamp: tuple[float, float] | None,
    axis: float | None,
    region: tuple[int, int, int, int] | None,
    polarity: str | None,
    channel: str | None,
    beam_colour: tuple[float, float, float] | None,
) -> dict[str, Any]:
    """In place of a calibration's own values, see `config.calibration.Changes`."""
    picture = {"region_px": region, "polarity": polarity, "channel": channel, "beam_colour": beam_colour}
    changes: dict[str, Any] = {
        "clamp_midpoint_px": clamp,
        "axis_angle_deg": axis,
        "picture": {key: value for key, value in picture.items() if value is not None} or None,
    }
    return {key: value for key, value in changes.items() if value is not None}


def find_edges(
    dataset: Path,
    *,
    specimen: str | None = None,
    calibration: str | Path | None = None,
    changes: Mapping[str, Any] | None = None,
    csv: Path | None = None,
    overlay: Path | None = None,
    explain: Path | None = None,
    dark: Path | None = None,
    flat: Path | None = None,
    uncorrected: bool = False,
    workers: int = 1,
    force: bool = False,
) -> tuple[tuple[EdgeSet, ...], tuple[str, ...]]:
    """Find and store the edges of a dataset; return them, and what was stated otherwise before. Raises InputError."""
    from eimi_lab.dataset.dark_and_flat import forget_correction, read_correction_images, store_correction
    from eimi_lab.dataset.restating import restate
    from eimi_lab.dataset.segmentation import explain_missing_beam, segment, write_csv, write_explained, write_overlays
    from eimi_lab.process.outputs import whole_folder, write_file
    from eimi_lab.process.progress import progress
    from eimi_lab.process.workers import executor_for

    with open_dataset(dataset) as opened:
        total = len(opened.states)
    correction = read_correction_images(dark, flat)
    if uncorrected and correction:
        raise InputError("--uncorrected: removes the dark frame and the flat field; leave out --dark and --flat")
    with ExitStack() as stack:
        unfinished = {
            folder: stack.enter_context(whole_folder(folder, force)) for folder in (csv, overlay, explain) if folder
        }
        restated: tuple[str, ...] = ()
        if changes or specimen or calibration:
            replaced = None if calibration is None else Path(calibration)
            restated = restate(dataset, specimen=specimen, calibration=replaced, changes=dict(changes or {}))
            if not restated:
                tell(f"{dataset}: states the same values already")
        if correction:
            store_correction(dataset, correction)
        if uncorrected:
            forget_correction(dataset)
        with progress("segment", total) as report:
            edge_sets = segment(dataset, report, executor_for(workers, None))
        if csv:
            write_csv(unfinished[csv], edge_sets)
        if overlay:
            write_overlays(unfinished[overlay], dataset, edge_sets)
        if explain:
            write_explained(unfinished[explain], dataset)
    without = [index for index, found in enumerate(edge_sets) if not len(found.left.sigma_mm)]
    if without:
        words, picture = explain_missing_beam(dataset, without[0])
        shown = dataset.with_name(f"{dataset.stem}_where.png")
        write_file(shown, picture, force=True)
        tell(f"state {without[0]}: no beam was found; {words} {shown} shows where the program looked")
    return edge_sets, restated
