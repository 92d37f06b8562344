"""Import images or tracked points into a dataset, and find the edges of the beam in the frames of a dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    every: int | None = None,
    dark: AnyPath | None = None,
    flat: AnyPath | None = None,
    clamp: tuple[float, float] | None = None,
    axis: float | None = None,
    region: tuple[int, int, int, int] | None = None,
    polarity: Literal["dark", "bright"] | None = None,
    channel: Literal["red", "green", "blue", "grey"] | None = None,
    beam_colour: tuple[float, float, float] | None = None,
    along: Sequence[tuple[float, float]] | None = None,
    force: bool = False,
) -> Dataset:
    """Make a dataset from existing images or an existing video.

    Parameters
    ----------
    source : str or Path
        A folder of images, an image, or a video.
    states : str or Path
        The table of states (load steps, CSV) with the loads of each picture: the columns frame (or time_s), current_A
        or field_mT, and tip_force_N.
    specimen, calibration : str, Path or object
        TOML files, names of shipped files, or objects loaded from such files.
    output : str or Path
        The dataset to write.
    average : bool
        Store only the mean frame of each state (load step).
    every : int
        The number n, to import every n-th frame of a video. A row of the table then gives the beginning of a load in
        the column time_s or frame, and the end in the column until_s; by default a load ends when the next load begins.
    dark : str or Path
        Image that was taken without light. It is subtracted from every frame.
    flat : str or Path
        Image of the back-light without the beam, which corrects uneven light.
    clamp : (float, float)
        Middle of the line at which the beam leaves the clamp, px.
    axis : float
        Direction in which the straight beam leaves the clamp, degrees: 0 is to the right, 90 is down.
    region : (int, int, int, int)
        Part of the image in which the program searches for the beam: left, top, width and height, px.
    polarity : "dark" or "bright"
        Whether the beam is darker or brighter than its background.
    channel : "red", "green", "blue" or "grey"
        Channel in which the beam differs most from its background.
    beam_colour : (float, float, float)
        Colour of the beam: red, green and blue, each from 0 to 255.
    along : sequence of (float, float)
        Two to six points on the centre line of the beam in the first image, from the clamp to the tip, px. They help
        to find the beam.
    force : bool
        Replace an existing dataset.

    Returns
    -------
    Dataset
        The dataset, open for reading and without edges; `segment` finds the edges.

    Raises
    ------
    InputError
        If a file cannot be used.
    """
    from eimi_lab.dataset.dark_and_flat import read_correction_images
    from eimi_lab.dataset.importing import import_frames
    from eimi_lab.process.outputs import check_distinct
    from eimi_lab.process.progress import progress

    changes = stated_changes(clamp, axis, region, polarity, channel, beam_colour, along)
    check_distinct(files(source, states, specimen, calibration, dark, flat), [Path(output)])
    if isinstance(calibration, Calibration):
        used_calibration = changed_calibration(calibration, changes)
    else:
        used_calibration = load_calibration(calibration, changes)
    correction = read_correction_images(_path(dark), _path(flat))
    beam = specimen_of(specimen)
    import_frames(
        Path(source), Path(states), beam, used_calibration, Path(output), force, average, progress, correction, every
    )
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
    """Make a dataset from points that were tracked on a beam.

    Parameters
    ----------
    source : str or Path
        The table of points (CSV) with the columns state, point, x0_mm, y0_mm, x_mm, y_mm and sigma_mm.
    states : str or Path
        The table of states (load steps, CSV) with the columns state, field_mT and tip_force_N.
    specimen : str, Path or SpecimenFile
        The beam.
    output : str or Path
        The dataset to write.
    gravity_angle : float
        Direction of gravity, degrees from +x (along the straight beam from the clamp) toward +y (across the beam); 0
        for a beam that hangs down. It is required unless ``no_gravity`` is True.
    no_gravity : bool
        Gravity does not bend the beam.
    force : bool
        Replace an existing dataset.

    Returns
    -------
    Dataset
        The dataset, open for reading.

    Raises
    ------
    InputError
        If a file cannot be used.
    """
    from eimi_lab.dataset.tracked.points_csv import import_points as from_table
    from eimi_lab.process.outputs import check_distinct

    if gravity_angle is None and not no_gravity:
        raise InputError(
            f"{source}: tracked points need gravity_angle, the direction of gravity measured from the axis of the "
            "straight beam, or no_gravity = True"
        )
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
    along: Sequence[tuple[float, float]] | None = None,
    csv: AnyPath | None = None,
    overlay: AnyPath | None = None,
    explain: AnyPath | None = None,
    dark: AnyPath | None = None,
    flat: AnyPath | None = None,
    uncorrected: bool = False,
    workers: int = 1,
    force: bool = False,
) -> Dataset:
    """Find the edges of the beam in every state (load step), and store the edges in the dataset.

    Parameters
    ----------
    dataset : str, Path or Dataset
        A dataset of frames.
    specimen, calibration : str, Path or object
        New specimen and calibration for the dataset.
    clamp, axis, region, polarity, channel, beam_colour, along
        New values for the calibration in the dataset; see `import_pictures`.
    csv : str or Path
        Folder for the edges as CSV files.
    overlay : str or Path
        Folder for pictures of the frames with their edges.
    explain : str or Path
        Folder for pictures that show how the beam was followed from the clamp to the tip.
    dark, flat : str or Path
        Dark frame and flat field, which correct the frames and are stored in the dataset; see `import_pictures`.
    uncorrected : bool
        Remove the dark frame and the flat field from the dataset.
    workers : int
        Number of parallel processes.
    force : bool
        Replace existing folders.

    Returns
    -------
    Dataset
        The dataset with edges, open for reading; the same object if an open dataset was given.

    Raises
    ------
    InputError
        If the dataset has no frames, or if a file cannot be used.
    """
    changes = stated_changes(clamp, axis, region, polarity, channel, beam_colour, along)
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
    """Return the path of a TOML file; write a loaded object to the file ``path`` first.

    Return None if nothing is given.
    """
    if given is None or not isinstance(given, Document):
        return None if given is None else str(given)
    path.write_text(given.text or to_toml(given), encoding="utf-8")
    return str(path)


def stated_changes(
    clamp: tuple[float, float] | None,
    axis: float | None,
    region: tuple[int, int, int, int] | None,
    polarity: str | None,
    channel: str | None,
    beam_colour: tuple[float, float, float] | None,
    along: Sequence[tuple[float, float]] | None,
) -> dict[str, Any]:
    """Return the arguments that are not None as a dictionary, by the keys of the calibration file.

    For the arguments see `import_pictures`.
    """
    picture = {
        "region_px": region,
        "polarity": polarity,
        "channel": channel,
        "beam_colour": beam_colour,
        "along_px": None if along is None else tuple(map(tuple, along)),
    }
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
    """Find the edges of the beam in every state (load step) of a dataset, and store the edges.

    For the parameters and errors see `segment`.

    Returns
    -------
    edges, changes
        The edges of every state, and one line of text for each changed value of specimen and calibration.
    """
    from eimi_lab.dataset.dark_and_flat import forget_correction, read_correction_images, store_correction
    from eimi_lab.dataset.restating import restate
    from eimi_lab.dataset.segmentation import explain_missing_beam, segment, write_csv, write_explained, write_overlays
    from eimi_lab.process.outputs import whole_folder, write_file
    from eimi_lab.process.progress import progress
    from eimi_lab.process.workers import executor_for

    with open_dataset(dataset) as opened:
        creeping = sum(opened.creep_frames(state.index) is not None for state in opened.states)
        total = len(opened.states) + len(opened.recorded_ring_downs()) + creeping
    correction = read_correction_images(dark, flat)
    if uncorrected and correction:
        raise InputError(
            "--uncorrected: removes the dark frame and the flat field from the dataset; leave out --dark and --flat"
        )
    with ExitStack() as stack:
        unfinished = {
            folder: stack.enter_context(whole_folder(folder, force)) for folder in (csv, overlay, explain) if folder
        }
        changed: tuple[str, ...] = ()
        if changes or specimen or calibration:
            replaced = None if calibration is None else Path(calibration)
            changed = restate(dataset, specimen=specimen, calibration=replaced, changes=dict(changes or {}))
            if not changed:
                tell(f"{dataset}: nothing changed, because the dataset has these values already")
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
    without_beam = [index for index, edges in enumerate(edge_sets) if not len(edges.left.sigma_mm)]
    if without_beam:
        explanation, picture = explain_missing_beam(dataset, without_beam[0])
        picture_path = dataset.with_name(f"{dataset.stem}_where.png")
        write_file(picture_path, picture, force=True)
        tell(
            f"state {without_beam[0]}: no beam was found; {explanation} {picture_path} shows where the program searched"
        )
    return edge_sets, changed
