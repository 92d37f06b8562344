"""Read the ring-downs (free vibrations) and the creep of a dataset, for the fit of a viscoelastic (Prony) law."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import Section, Specimen
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource
from eimi_fitting.time.identification import RecordedMotion, StaticRun, StaticStates
from eimi_fitting.time.measured import Motion
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.dataset.state import State
from eimi_lab.fits.evidence import Evidence, loads_of_states, sources_of, taken_as_exact
from eimi_lab.fits.records import FitRecord
from eimi_lab.process.errors import InputError

Array = NDArray[np.float64]

_LONG_S = 1e3  # assumed duration of a load that was present before the recording
_DWELL_S = 30.0  # assumed time between states if the dataset has no increasing times of the states


@dataclass(frozen=True)
class MotionEvidence:
    """The recorded motions of one dataset, ready for the fit of a viscoelastic (Prony) law.

    Attributes
    ----------
    path : Path
        Dataset file.
    sha256 : str
        Hash of the file.
    specimen : Specimen
        Beam and magnet.
    motions : tuple of RecordedMotion
        Ring-downs (free vibrations) and creep.
    stated : tuple of StatedSource
        Uncertain inputs with their uncertainties.
    taken_as_exact : tuple of str
        Inputs without a given uncertainty.
    has_states : bool
        Whether the dataset holds static states.
    has_recording : bool
        Whether the dataset holds a ring-down.
    """

    path: Path
    sha256: str
    specimen: Specimen
    motions: tuple[RecordedMotion, ...]
    stated: tuple[StatedSource, ...]
    taken_as_exact: tuple[str, ...]
    has_states: bool
    has_recording: bool


def load_motions(path: Path, section: Section | None = None) -> MotionEvidence:
    """Read the ring-downs (free vibrations) and the creep of a dataset.

    Parameters
    ----------
    path : Path
        Dataset file.
    section : {"solid", "plane-strain", "plane-stress"}, optional
        Model of the cross-section; by default that of the specimen file.

    Raises
    ------
    InputError
        If the file cannot be read, or if a weight hangs from the tip but gravity has no direction.
    """
    with open_dataset(path) as dataset:
        motions = (*dataset.ring_downs(), *dataset.creeps())
        recorded = tuple(_recorded(dataset, motion) for motion in motions)
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        specimen = dataset.specimen.mechanics()
        return MotionEvidence(
            path,
            digest,
            replace(specimen, section=section) if section else specimen,
            recorded,
            sources_of(dataset),
            taken_as_exact(dataset),
            bool(dataset.states),
            any(motion.kind == "ring_down" for motion in motions) or bool(dataset.recorded_ring_downs()),
        )


def with_ring_downs(datasets: Sequence[MotionEvidence], each: bool = False) -> list[MotionEvidence]:
    """Check that a viscoelastic (Prony) law can be fitted to datasets, and return the datasets unchanged.

    With `each`, every dataset is fitted separately.

    Raises
    ------
    InputError
        If the datasets of a fit hold no ring-down (no free vibration), or if their specimens differ.
    """
    for together in fitted_together(datasets, each):
        _check_together(together)
    return list(datasets)


def fitted_together(motions: Sequence[MotionEvidence], each: bool) -> list[list[MotionEvidence]]:
    """Return the motions of each fit; with `each`, every dataset is fitted separately."""
    if not each:
        return [list(motions)]
    return [motions_beside([one.path], motions) for one in motions if one.has_states] or [[one] for one in motions]


def motions_beside(paths: Sequence[Path], motions: Sequence[MotionEvidence]) -> list[MotionEvidence]:
    """Return the motions that are fitted together with the states (load steps) of the datasets `paths`.

    They are the motions of these datasets, and those of all datasets without states.
    """
    return [one for one in motions if one.path in paths or not one.has_states]


def _check_together(datasets: Sequence[MotionEvidence]) -> None:
    for other in datasets[1:]:
        if other.specimen != datasets[0].specimen:
            raise InputError(
                f"{other.path}: the specimen of this dataset differs from the specimen of {datasets[0].path}; --time "
                "prony needs datasets of one specimen"
            )
    if not any(one.has_recording for one in datasets):
        paths = ", ".join(str(one.path) for one in datasets)
        raise InputError(
            f"{paths}: --time prony: there is no ring-down; record a ring-down with [ring_down] in the protocol, "
            "or import a recording with `eimi import --ring-down`"
        )


def _recorded(dataset: Dataset, motion: Motion) -> RecordedMotion:
    loads = _loads(dataset, motion.to_A, motion.hanging_N)
    if motion.kind == "creep" and motion.hanging_N and not motion.tip_force_N:  # the weight was hung on the beam
        return RecordedMotion(motion, loads, ((-_LONG_S, _loads(dataset, motion.from_A, 0.0)),))
    if motion.tip_force_N:
        before = ((-_LONG_S, _loads(dataset, motion.from_A, motion.hanging_N + motion.tip_force_N)),)
        return RecordedMotion(motion, loads, before)
    history = [(time, current) for time, current in motion.history if time < 0] or [(-_LONG_S, motion.from_A)]
    if motion.from_A == motion.to_A and not any(current != motion.to_A for _, current in history):
        return RecordedMotion(motion, loads)
    return RecordedMotion(
        motion,
        loads,
        tuple((float(time), _loads(dataset, current, motion.hanging_N)) for time, current in sorted(history)),
    )


def _loads(dataset: Dataset, current_A: float, hanging_N: float) -> Loads:
    """Return the loads at one current: the field at `current_A`, gravity, and the weight `hanging_N` at the tip."""
    field = current_A * dataset.calibration.mT_per_A if dataset.calibration and dataset.calibration.mT_per_A else 0.0
    if dataset.field_line is not None:
        field = current_A * dataset.field_line.mT_per_A
    if hanging_N and not dataset.gravity:
        raise InputError(
            f"{dataset.path}: a weight of {hanging_N:g} N hangs at the tip, but in this dataset gravity does not act "
            "on the beam (gravity = false in the calibration, or --no-gravity); correct the weight or the gravity"
        )
    return loads_of_states(dataset, [State(0, current_A, None, field, hanging_N, ())])


def static_states(evidence: Sequence[Evidence], record: FitRecord) -> StaticStates:
    """Return the static states in `evidence` with their times, and the shear modulus in the fit `record`."""
    modulus = record.initial_shear_modulus
    low, high = modulus.interval_95_fit or modulus.interval_95
    on_picture = {
        entry.source: entry.effect_percent / 100
        for entry in record.budget
        if entry.source in SOURCES
        and not (SOURCES[entry.source].specimen or SOURCES[entry.source].loads or SOURCES[entry.source].field)
    }
    return StaticStates(
        tuple(_static_run(one) for one in evidence),
        modulus.value,
        max((high - low) / 3.92 / modulus.value, 1e-4),
        on_picture,
    )


def _static_run(evidence: Evidence) -> StaticRun:
    """Return the static states of a dataset, with the times at which they were set and measured."""
    with open_dataset(evidence.path) as dataset:
        clock_s = dataset.times_of_states()
    indices: NDArray[np.intp] = np.array([state.index for state in evidence.states])
    measured_s: Array = np.asarray(clock_s[indices] if len(clock_s) else np.full(len(indices), np.nan), float)
    if not np.isfinite(measured_s).all() or (len(measured_s) > 1 and not (np.diff(measured_s) > 0).all()):
        measured_s = np.asarray(_DWELL_S * (1.0 + np.arange(len(indices))), float)
    first_s = max(float(measured_s[0]) - _DWELL_S, min(float(measured_s[0]), 0.0) - 1.0)
    set_s = np.concatenate([[first_s], measured_s[:-1]])
    return StaticRun(evidence.experiment.loads, set_s, measured_s)
