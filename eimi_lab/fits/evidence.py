"""Read a dataset as evidence for a fit: the beam model, the loads, and the measured edges or points."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Section
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Observation, PointObservation
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.searching.measured_rest_shape import MeasuredRestShape, measured_rest_shape
from eimi_lab.config.rig_uncertainty import stated_by_rig
from eimi_lab.config.specimen import MEASURED
from eimi_lab.config.uncertainty import missing_keys
from eimi_lab.dataset.measured_field import FieldLine
from eimi_lab.dataset.measured_heating import MeasuredHeating, coil_heating
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.dataset.state import State
from eimi_lab.fits.before_search import check_width
from eimi_lab.fits.measured_conditions import REPLACED, stated_by_measurement, with_measured_offset
from eimi_lab.fits.perspective import seen_depth
from eimi_lab.fits.states_used import FEW_POINTS, FlaggedState, StatesUsed, WidenedState
from eimi_lab.process.errors import InputError
from eimi_lab.process.progress import silent
from eimi_lab.showing.tables import html_table
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import leaves_out
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.field_at_beam import in_stated_field

Array = NDArray[np.float64]

COIL_CONSTANT = "coil_constant_mT_per_A"
WHOLE_FILES = ("dimensions", "calibration")  # the words if specimen or calibration states no uncertainty at all
FEWEST_STATES = 2  # from which a modulus can be identified: one at rest and one bent
FEWEST_POINTS = 10  # on each edge of a state that is used


@dataclass(frozen=True)
class Evidence:
    """A dataset that is ready for a fit.

    Attributes
    ----------
    path : Path
        Dataset file.
    sha256 : str
        Hash of the file.
    experiment : Experiment
        Beam model, loads, and measured edges or tracked points of the used states.
    states : tuple of State
        Used states (load steps).
    used : StatesUsed
        Indices of the states used and left out.
    taken_as_exact : tuple of str
        Inputs without a given uncertainty.
    doubts : tuple of str
        Contradictions between the measured edges and the calibration.
    rest_shape : MeasuredRestShape or None
        Measured shape at rest, if it differs from the specimen file.
    poisson_ratio : float
        Poisson's ratio in the specimen file.
    field_line : FieldLine or None
        Measured line of field against current.
    typed_mT_per_A : float or None
        Coil constant in the calibration.
    heating : MeasuredHeating or None
        Measured temperature of the coil.
    """

    path: Path
    sha256: str
    experiment: Experiment
    states: tuple[State, ...]
    used: StatesUsed
    taken_as_exact: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    rest_shape: MeasuredRestShape | None = None
    poisson_ratio: float = 0.5
    field_line: FieldLine | None = None
    typed_mT_per_A: float | None = None
    heating: MeasuredHeating | None = None

    def plot(self) -> Any:
        """Return a matplotlib figure of the measured edges or tracked points."""
        from eimi_lab.dataset.plotting import OF_BEAM, drawn_places  # matplotlib is slow to import

        observed = self.experiment.observed
        measured = np.isfinite(observed.sigma_mm)
        if isinstance(observed, PointObservation):
            places = [[points[valid]] for points, valid in zip(observed.moved_mm, measured, strict=True)]
            return drawn_places(self.states, places, OF_BEAM, lines=False)
        sides = [
            [points[i][valid[i]] for i in range(2)] for points, valid in zip(observed.points_mm, measured, strict=True)
        ]
        return drawn_places(self.states, sides, OF_BEAM, lines=True)

    def _repr_html_(self) -> str:
        counts = np.isfinite(self.experiment.observed.sigma_mm).reshape(len(self.states), -1).sum(axis=1)
        rows = [
            (str(s.index), f"{s.field_mT:.3f}", f"{s.tip_force_N:.3g}", str(n))
            for s, n in zip(self.states, counts, strict=True)
        ]
        section = self.experiment.model.specimen.section
        notes = [f"Doubt: {words}." for words in self.doubts]
        if self.taken_as_exact:
            notes.append(f"Taken as exact, because no uncertainty is given: {', '.join(self.taken_as_exact)}.")
        caption = f"{self.path.name}, section {section}: {self.used.in_words()}"
        return html_table(caption, ("state", "field, mT", "tip force, N", "points"), rows, notes)


def load_evidence(
    path: str | Path,
    *,
    section: Section | None = None,
    flagged: bool = False,
    report: Callable[[str], None] = silent,
) -> Evidence:
    """Read from a dataset what a fit needs: beam model, loads and edges.

    Parameters
    ----------
    path : str or Path
        Dataset file.
    section : {"solid", "plane-strain", "plane-stress"}, optional
        Model of the cross-section; by default that of the specimen file.
    flagged : bool
        Whether to use states that failed a quality check.
    report : callable
        Called with a line of text when the edges of a state are known.

    Raises
    ------
    InputError
        If the file cannot be read, or if no state can be used.
    """
    path = Path(path)
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise InputError(
            f"{str(path)!r}: is not UTF-8 and cannot be written to a result file; rename the dataset"
        ) from error
    with open_dataset(path) as dataset:
        if dataset.kind != "frames" or dataset.edges() is not None:
            return _evidence(dataset, path, section, flagged)
    from eimi_lab.dataset.segmentation import segment  # a slow import, not needed with stored edges

    segment(path, report)
    with open_dataset(path) as dataset:
        return _evidence(dataset, path, section, flagged)


def _evidence(dataset: Dataset, path: Path, section: Section | None, flagged: bool) -> Evidence:
    """Return beam model, loads and measurements of a dataset. Raises InputError if no state can be used."""
    if not dataset.states and (dataset.ring_downs() or dataset.creeps()):
        raise InputError(f"{path}: holds a recorded motion and no states; fit the motion with --time prony")
    specimen = dataset.specimen.mechanics()
    if section:
        specimen = dataclasses.replace(specimen, section=section)
    used, observed = _observed(dataset, flagged)
    states = tuple(dataset.states[i] for i in used)
    model = BeamModel(specimen, plane=specimen.planar_section).refined()
    if isinstance(observed, PointObservation):
        rest = observed.rest_mm[np.isfinite(observed.sigma_mm)]
        try:
            model.place(rest[~model.grid.on_magnet(model.grid.straightened(rest))])
        except ValueError as error:
            raise InputError(f"{path}: {error}") from error
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    experiment = Experiment(model, loads_of_states(dataset, states), observed, stated=sources_of(dataset))
    rest_shape = _measured_rest_shape(dataset, experiment)
    return Evidence(
        path,
        digest,
        rest_shape.applied(experiment, f"the states without load of the dataset with SHA-256 {digest[:16]}")
        if rest_shape
        else experiment,
        states,
        _states_used(dataset, used),
        taken_as_exact(dataset),
        _lens_doubts(dataset, observed),
        rest_shape,
        dataset.specimen.specimen.poisson_ratio,
        dataset.field_line,
        dataset.calibration.coil_constant_mT_per_A if dataset.calibration else None,
        coil_heating(dataset),
    )


def _measured_rest_shape(dataset: Dataset, experiment: Experiment) -> MeasuredRestShape | None:
    return measured_rest_shape(experiment) if dataset.specimen.specimen.rest_shape == MEASURED else None


def experiment_so_far(dataset: Dataset, edges: Sequence[EdgeSet]) -> Experiment | None:
    """Return beam model, loads and measured edges of an unfinished run.

    Parameters
    ----------
    dataset : Dataset
        Dataset to which a run still adds states (load steps).
    edges : sequence of EdgeSet
        Edges of the first states.

    Returns
    -------
    Experiment or None
        None if fewer than two states can be used.

    Raises
    ------
    InputError
        If the files of the dataset contradict each other.
    """
    used = _used(dataset, edges, flagged=False)
    if len(used) < FEWEST_STATES:
        return None
    states = [dataset.states[index] for index in used]
    specimen = dataset.specimen.mechanics()
    experiment = Experiment(
        BeamModel(specimen, plane=specimen.planar_section),
        loads_of_states(dataset, states),
        _edge_observation(dataset, edges, used),
        stated=sources_of(dataset),
    )
    rest_shape = _measured_rest_shape(dataset, experiment)
    return rest_shape.applied(experiment) if rest_shape else experiment


def loads_of_states(dataset: Dataset, states: Sequence[State]) -> Loads:
    """Return the loads of some states of a dataset. Raises InputError if the field cannot be computed."""
    loads = Loads.along(
        [s.field_mT for s in states],
        dataset.field_angle_deg,
        dataset.gravity_angle_deg if dataset.gravity else None,
        [s.tip_force_N for s in states],
        tip_force_angle_deg=[
            dataset.gravity_angle_deg if s.tip_force_angle_deg is None else s.tip_force_angle_deg for s in states
        ],
    )
    if dataset.calibration is None:
        return loads
    try:
        in_field = in_stated_field(loads, dataset.calibration, dataset.specimen.mechanics())
    except InputError as error:
        raise InputError(f"{dataset.path}: {error}") from error
    return with_measured_offset(in_field, dataset)


def sources_of(dataset: Dataset) -> tuple[StatedSource, ...]:
    """Return the uncertainties in the specimen, calibration and rig files of a dataset.

    Raises InputError if a table of uncertainties is wrong.
    """
    sources = dataset.specimen.stated_sources()
    if dataset.calibration is not None:
        sources += dataset.calibration.stated_sources()
        rig = dataset.text("rig")
        if rig is not None:
            sources += stated_by_rig(rig, f"{dataset.path}: rig", dataset.calibration.mT_per_A)
    measured = stated_by_measurement(dataset, dataset.states)
    return (*(source for source in sources if not measured or source.source not in REPLACED), *measured)


def taken_as_exact(dataset: Dataset) -> tuple[str, ...]:
    """Return the names of the inputs without a given uncertainty.

    `dimensions` replaces all names of the specimen file, and `calibration` all names of the calibration file, if the
    file gives no uncertainty at all.
    """
    specimen, calibration = dataset.specimen, dataset.calibration
    keys = missing_keys(WHOLE_FILES[0], specimen.uncertainty, specimen.uncertain_keys())
    if calibration is not None:
        is_measured = bool(stated_by_measurement(dataset, dataset.states))
        keys_of_file = [key for key in calibration.uncertain_keys() if not (is_measured and key == COIL_CONSTANT)]
        keys += missing_keys(WHOLE_FILES[1], calibration.uncertainty, keys_of_file)
    return keys


def _observed(dataset: Dataset, flagged: bool) -> tuple[list[int], Observation]:
    """Return the indices of the usable states, with their edges or tracked points.

    Raises InputError if no state can be used.
    """
    if dataset.kind == "points":
        points = dataset.points()
        most = max(len(p.names) for p in points)
        rest, moved = np.zeros((2, len(points), most, 2))
        depth = np.zeros((len(points), most))
        sigma = np.full((len(points), most), np.inf)
        for k, p in enumerate(points):
            rest[k, : len(p.names)], moved[k, : len(p.names)] = p.rest_mm, p.points_mm
            sigma[k, : len(p.names)] = p.sigma_mm
            if p.depth_mm is not None:
                depth[k, : len(p.names)] = p.depth_mm
        return list(range(len(points))), PointObservation(rest, moved, sigma, depth)
    edges = dataset.edges() or ()
    used = _used(dataset, edges, flagged)
    if 2 * len(used) < len(dataset.states):
        check_width(dataset)
    if not used:
        raise InputError(f"{dataset.path}: no state has edges that can be used; {_first_flag(edges)}")
    return used, _edge_observation(dataset, edges, used)


def _used(dataset: Dataset, edges: Sequence[EdgeSet], flagged: bool) -> list[int]:
    """Return the indices of the states whose edges can be used; if `flagged`, also states that failed a check."""
    return [
        i
        for i, (state, pair) in enumerate(zip(dataset.states, edges, strict=False))
        if min(len(pair.left.points_mm), len(pair.right.points_mm)) >= FEWEST_POINTS
        and (flagged or not leaves_out((*pair.flags, *state.flags)))
    ]


def _edge_observation(dataset: Dataset, edges: Sequence[EdgeSet], used: Sequence[int]) -> EdgeObservation:
    widened, alone = (
        EdgeObservation.from_edges([_widened(edges[i], by_mm) for i, by_mm in zip(used, widening, strict=True)])
        for widening in ([_widening_mm(dataset, edges, i) for i in used], [0.0] * len(used))
    )
    return dataclasses.replace(widened, view=_view(dataset), noise_mm=alone.sigma_mm)


def _widening_mm(dataset: Dataset, edges: Sequence[EdgeSet], index: int) -> float:
    # Return the additional standard deviation (mm) of the edge points of a state, because of its flags.
    calibration, beam = dataset.calibration, dataset.specimen.specimen
    if calibration is None or not edges:
        return 0.0
    flags = {*dataset.states[index].flags, *edges[index].flags}
    return math.hypot(*(flag.widens_mm(calibration.pixels_per_mm, beam.width_mm, beam.depth_mm) for flag in flags))


def _widened(pair: EdgeSet, by_mm: float) -> tuple[Array, Array, Array, Array]:
    """Return points and standard deviations (mm) of the left edge, then of the right edge.

    `by_mm` has been added in quadrature to the standard deviations.
    """
    left, right = pair.left, pair.right
    return left.points_mm, np.hypot(left.sigma_mm, by_mm), right.points_mm, np.hypot(right.sigma_mm, by_mm)


def _states_used(dataset: Dataset, used: Sequence[int]) -> StatesUsed:
    edges = dataset.edges() if dataset.kind == "frames" else None
    left_out, flagged, widened = [], [], []
    for i, state in enumerate(dataset.states):
        names = tuple(dict.fromkeys(flag.name for flag in (*state.flags, *(edges[i].flags if edges else ()))))
        if i not in used:
            left_out.append(FlaggedState(state.index, names or (FEW_POINTS,)))
        elif names:
            flagged.append(FlaggedState(state.index, names))
        if i in used and (by_mm := _widening_mm(dataset, edges or (), i)):
            widened.append(WidenedState(state.index, by_mm))
    return StatesUsed(len(dataset.states), tuple(left_out), tuple(flagged), tuple(widened))


def _view(dataset: Dataset) -> View | None:
    if dataset.calibration is None:
        return None
    (height, width, *_), _ = dataset.frame_format()
    try:
        return BeamFrame(dataset.calibration).view(dataset.specimen.specimen.depth_mm, (width, height))
    except ValueError as error:
        raise InputError(f"{dataset.path}: calibration.stand_off_mm: {error}") from error


def _lens_doubts(dataset: Dataset, observed: Observation) -> tuple[str, ...]:
    """Return a warning if the edges show perspective, and the calibration gives no distance of the lens."""
    calibration, depth_mm = dataset.calibration, dataset.specimen.specimen.depth_mm
    if calibration is None or not isinstance(observed, EdgeObservation) or observed.view:
        return ()
    (height, width, *_), _ = dataset.frame_format()
    anywhere = calibration.model_copy(update={"telecentric": False, "stand_off_mm": 1e3 * depth_mm})
    lens = BeamFrame(anywhere).view(depth_mm, (width, height))
    perspective = seen_depth(observed, lens.centre_mm, depth_mm) if lens else None
    if perspective is None:
        return ()
    stated = "telecentric = true" if calibration.telecentric else "no stand_off_mm"
    return (
        f"the beam appears up to {perspective.change_mm:.2g} mm wider away from the middle of the picture, as through "
        f"an ordinary lens about {round(perspective.stand_off_mm, -1):g} mm away, but the calibration has {stated}: "
        "measure stand_off_mm, add it to the calibration, and give the file with eimi segment --calibration",
    )


def _first_flag(edges: tuple[EdgeSet, ...]) -> str:
    """Return a sentence with the first defect in the edges of a dataset, and its remedy."""
    flags = [flag for pair in edges for flag in pair.flags]
    if not flags:
        return "the frames show no beam"
    return f"the first flag is {flags[0].name}: {flags[0].remedy}"
