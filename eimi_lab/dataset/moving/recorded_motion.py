"""Measure the motions of the beam in the recordings of a run: free oscillations and creep."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from eimi_fitting.time.measured import Kind, Motion
from eimi_lab.dataset.moving.film import follow_film
from eimi_lab.dataset.moving.filmed_motion import points_of_film
from eimi_lab.dataset.reading import Dataset
from eimi_lab.dataset.recorded_frames import RecordedFrames
from eimi_lab.dataset.steps import SetPoint
from eimi_lab.process.errors import InputError, tell
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.projection import Projection


def recorded_motions(
    dataset: Dataset,
    edge_sets: Sequence[EdgeSet],
    projection: Projection | None,
    report: Callable[[str], None],
) -> tuple[Motion, ...]:
    """Measure the motion of the beam in each free oscillation and each recording of creep of a run.

    A recording in which no beam is found is left out, with a note on standard error.

    Parameters
    ----------
    dataset : Dataset
        A dataset of frames.
    edge_sets : sequence of EdgeSet
        The edges in each load step. Without edges, the result is empty.
    projection : Projection, optional
        Conversion of colours to grey values.
    report : callable
        Function that gets a line of text for each motion.

    Returns
    -------
    tuple of Motion
        The free oscillations, followed by the creep.

    Raises
    ------
    InputError
        If a frame cannot be read.
    """
    if not any(len(edges.middle_mm) for edges in edge_sets):
        return ()
    motions: list[Motion] = []
    set_points = dataset.set_points()
    for step, frames in dataset.recorded_ring_downs():
        at = SetPoint(step.time_s, step.to_A, step.uncertainty_s)
        label = f"{dataset.path}: ring-down {step.ring_down}"
        followed = _followed(dataset, frames, "ring_down", at, set_points, step.from_A, projection, label)
        motions += [replace(motion, lost_frames=step.lost) for motion in followed]
    for state in dataset.states:
        creeping = dataset.creep_frames(state.index)
        if creeping is None:
            continue
        before = [point for point in set_points if point.time_s <= creeping.time_s[0]]
        held_A = dataset.states[state.index - 1].current_A if state.index else 0.0
        if before and held_A is not None and before[-1].current_A != held_A:
            label = f"{dataset.path}: state {state.index}"
            motions += list(_followed(dataset, creeping, "creep", before[-1], set_points, held_A, projection, label))
    for motion in motions:
        report(f"{motion.label}: {len(motion.time_s)} frames of {motion.kind.replace('_', '-')}")
    return tuple(motions)


def recorded_kinds(dataset: Dataset) -> tuple[Kind, ...]:
    """Return the kinds of motion of which a dataset contains frames: free oscillations, creep, both or none."""
    kinds: list[Kind] = ["ring_down"] if dataset.recorded_ring_downs() else []
    if any(dataset.creep_frames(state.index) is not None for state in dataset.states):
        kinds.append("creep")
    return tuple(kinds)


def _followed(
    dataset: Dataset,
    frames: RecordedFrames,
    kind: Kind,
    step: SetPoint,
    set_points: Sequence[SetPoint],
    from_A: float,
    projection: Projection | None,
    label: str,
) -> Iterator[Motion]:
    """Yield the motion of the beam in one recording of a run; nothing if no beam is found.

    ``step`` is the change of the current that began the motion, from ``from_A``. ``label`` is the motion's name.
    """
    calibration = dataset.calibration
    if calibration is None:
        return
    try:
        correction = dataset.correction()
        images = frames.images() if correction is None else map(correction.apply, frames.images())
        film = follow_film(images, calibration, dataset.specimen, label, projection)
    except InputError as error:
        tell(f"note: {error}")
        return
    row_time_s, exposure_s = dataset.camera_setting("row_time_s"), dataset.camera_setting("exposure_s")
    frame_s = frames.time_s[: len(film.middle_px)] - step.time_s
    points = points_of_film(film, calibration, dataset.specimen, frame_s, row_time_s or 0.0)
    after = points.time_s.min(axis=1) > 0.0
    if not after.any():
        return
    yield Motion(
        kind=kind,
        points_mm=points.points_mm[after],
        rest_mm=points.rest_mm,
        time_s=points.time_s[after],
        sigma_mm=points.sigma_mm[after],
        exposure_s=exposure_s,
        from_A=from_A,
        to_A=step.current_A,
        step_uncertainty_s=step.uncertainty_s,
        history=tuple(
            (point.time_s - step.time_s, point.current_A) for point in set_points if point.time_s < step.time_s
        ),
        label=label,
    )
