"""Check a dataset for errors that no material could explain, and name the key of an input file to change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.searching.named_causes import NamedCause, Slip
from eimi_lab.config.size_along import rows_of
from eimi_lab.dataset.reading import Dataset
from eimi_lab.dataset.state import State
from eimi_lab.process.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame

Array = NDArray[np.float64]

_WIDTH = 1.2  # ratio to the stated width, up or down; the flag WIDTH_ANOMALY reports smaller deviations
_SAME = 0.06  # relative difference within which two widths are the same
_MOST_A, _MOST_MT = 100.0, 500.0  # assumed: no coil on a bench exceeds both limits
_MOVED = 0.01  # motion of the tip, as a fraction of the beam's length


@dataclass(frozen=True)
class _Remedy:
    """What the user has to change to correct one mistake in the inputs, as texts.

    `calibration`: change in calibration.toml; `states`: change in states.csv; `points`: change for tracked points.
    """

    calibration: str
    states: str
    points: str


_SIGN_OF_FORCE = "change the sign of tip_force_N in states.csv, or its tip_force_angle_deg, and import again"
_UNIT_OF_FORCE = "tip_force_N in states.csv is in newton (not mN, nor gram): correct it and import again"

_REMEDIES: dict[Slip, _Remedy] = {
    "field_reversed": _Remedy(
        "turn field_angle_deg by 180 degrees",
        "change the sign of current_A in states.csv and import again",
        "change the sign of field_mT in states.csv and import again",
    ),
    "gravity_reversed": _Remedy(
        "turn gravity_angle_deg by 180 degrees",
        "",
        "turn --gravity-angle by 180 degrees and import again",
    ),
    "field_too_large": _Remedy(
        "give coil_constant_mT_per_A in mT per ampere (not per kiloampere)",
        "give current_A in states.csv in ampere (not mA) and import again",
        "give field_mT in states.csv in mT and import again",
    ),
    "field_too_small": _Remedy(
        "give coil_constant_mT_per_A in mT per ampere (not T)",
        "give current_A in states.csv in ampere and import again",
        "give field_mT in states.csv in mT (not T) and import again",
    ),
    "force_reversed": _Remedy("", _SIGN_OF_FORCE, _SIGN_OF_FORCE),
    "force_too_large": _Remedy("", _UNIT_OF_FORCE, _UNIT_OF_FORCE),
    "gravity_absent": _Remedy(
        "set gravity = false if the beam bends in a horizontal plane",
        "",
        "give --no-gravity instead of --gravity-angle if the beam bends in a horizontal plane, and import again",
    ),
}


def in_words(cause: NamedCause, path: Path, experiment: Experiment) -> str:
    """Return a message about a mistake in the loads of a dataset, such as a reversed field, and how to correct it."""
    remedy = _REMEDIES[cause.slip]
    remedies = [remedy.points]
    if _is_edges(experiment):
        remedies = [_in_file(remedy.calibration, "calibration", path)] if remedy.calibration else []
        remedies += [remedy.states] if remedy.states else []
    return (
        f"{path}: no material explains the measured shape of the beam: with the values in the files the smallest "
        f"error is {cause.error_mm:.2g} mm, but only {cause.error_without_mm:.2g} mm without {cause.words}; "
        f"{'; or, for imported pictures, '.join(remedies)}"
    )


def _in_file(remedy: str, file: str, dataset: Path) -> str:
    return f"{remedy} in {file}.toml, and store this file: eimi segment {dataset} --{file} {file}.toml"


def check_states(path: Path, experiment: Experiment, states: Sequence[State]) -> None:
    """Check currents, magnet and field of a dataset. Raises InputError if no material could explain the data."""
    try:
        _check_currents(states)
        _check_magnet(path, experiment)
        _check_map(experiment)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _check_currents(states: Sequence[State]) -> None:
    current = max((abs(state.current_A) for state in states if state.current_A is not None), default=0.0)
    field = max(abs(state.field_mT) for state in states)
    if current > _MOST_A and field > _MOST_MT:
        raise InputError(
            f"current_A of up to {current:g} A makes a field of {field:g} mT, which is too strong for a coil; "
            "current_A should be in ampere (not mA)"
        )


def _check_magnet(path: Path, experiment: Experiment) -> None:
    """Raise InputError if the specimen is not magnetic but its tip moves when only the field changes."""
    specimen, loads = experiment.model.specimen, experiment.loads
    non_magnetic = specimen.magnet is None and not any(specimen.magnetisation_A_per_m)
    if not non_magnetic or np.ptp(loads.tip_force_N, axis=0).any() or not np.ptp(loads.field_T, axis=0).any():
        return
    moved = float(np.linalg.norm(np.ptp(_tips_mm(experiment), axis=0)))
    if moved > _MOVED * specimen.length_mm:
        largest = 1e3 * float(np.linalg.norm(loads.field_T, axis=1).max())
        raise InputError(
            f"the tip moves by {moved:.2g} mm in fields of up to {largest:g} mT, but the specimen is not magnetic: "
            "its file has no [magnet] and no magnetisation_kA_per_m; add one of these, and "
            + (
                f"store this file: eimi segment {path} --specimen specimen.toml"
                if _is_edges(experiment)
                else "import again"
            )
        )


def _check_map(experiment: Experiment) -> None:
    """Raise InputError if the tip of the beam reaches a place where the measured map of the field has no values."""
    table = experiment.loads.coil.table if experiment.loads.coil else None
    if table is None or not _is_edges(experiment):
        return
    for x, y in _tips_mm(experiment):
        if not table.covers(np.array([[x, y]])):
            raise InputError(
                f"the tip reaches x_mm = {x:.3g}, y_mm = {y:.3g}, but the field of calibration.field is known for x_mm "
                f"from {table.x_mm[0]:g} to {table.x_mm[-1]:g} and y_mm from {table.y_mm[0]:g} to {table.y_mm[-1]:g} "
                "only; measure a larger map"
            )


def check_width(dataset: Dataset) -> None:
    """Check that the beam has the width of the specimen file in the first picture.

    Raises
    ------
    InputError
        If the widths differ by more than a factor of 1.2.
    """
    from eimi_lab.vision.edges.apparent_width import apparent_width_mm  # slow imports, rarely needed
    from eimi_lab.vision.intensity import grey, state_mean

    beam, calibration = dataset.specimen.specimen, dataset.calibration
    if calibration is None:
        return
    width_mm = apparent_width_mm(grey(state_mean(dataset.each_image(0))), BeamFrame(calibration), beam.length_mm)
    rows = rows_of(beam.width_mm)
    stated_mm = rows[0][1] if rows else beam.width_mm  # the picture shows the width near the clamp
    if width_mm is None or 1 / _WIDTH < width_mm / stated_mm < _WIDTH:
        return
    words = (
        f"{dataset.path}: the beam in the picture is {width_mm / stated_mm:.2g} times as wide as the specimen file "
        f"says: {width_mm:.3g} mm by pixels_per_mm = {calibration.pixels_per_mm:g}, but width_mm = {stated_mm:g}"
    )
    if abs(width_mm / beam.depth_mm - 1) < _SAME:
        raise InputError(
            f"{words}; the width in the picture equals depth_mm, but depth_mm should be the size along the line of "
            f"sight; {_in_file('exchange width_mm and depth_mm', 'specimen', dataset.path)}"
        )
    raise InputError(
        f"{words}; {_in_file('correct width_mm', 'specimen', dataset.path)}; or "
        f"{_in_file('correct pixels_per_mm', 'calibration', dataset.path)}"
    )


def _is_edges(experiment: Experiment) -> bool:
    return isinstance(experiment.observed, EdgeObservation)


def _tips_mm(experiment: Experiment) -> Array:
    """Return x and y of the beam's tip in each state (mm), shape (states, 2)."""
    observed = experiment.observed
    measured = np.isfinite(observed.sigma_mm)
    if isinstance(observed, EdgeObservation):
        last = measured.shape[-1] - 1 - np.argmax(measured[..., ::-1], axis=-1)
        return np.asarray(np.take_along_axis(observed.points_mm, last[..., None, None], axis=2)[:, :, 0].mean(axis=1))
    moved = (observed.moved_mm - observed.rest_mm) * measured[..., None]
    return np.asarray(moved.sum(axis=1) / np.maximum(measured.sum(axis=1), 1)[:, None])
