"""List the systematic errors of the camera and of its calibration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.possible_causes import Assumed, Change, PossibleCause, of_source
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation

Array = NDArray[np.float64]

_STAND_OFF_MM = 300.0  # distance of a camera whose stand-off is not stated
_FARTHEST_AXIS = 2.0  # displacement of the lens axis up to which a distortion is computed exactly, a multiple of R


def _by_picture(displacement: Callable[[Experiment, Array, Array], Array], shift: int | None = None) -> Change:
    # `displacement` returns the displacements in mm that the error causes. `shift` is the index of the first of two
    # amplitudes that shift all points, if there are any.
    def change(assumed: Assumed, amplitudes: Array) -> Assumed:
        experiment, places = assumed.experiment, _measured(assumed.experiment)
        # Positions are measured from the clamp. If it is in another picture, two further amplitudes shift all points.
        by = displacement(experiment, places, amplitudes) - displacement(experiment, np.zeros(2), amplitudes)
        if shift is not None:
            by = by + amplitudes[shift : shift + 2]
        # The cause has displaced the measured points. Subtracting the displacement gives the true places.
        key = "points_mm" if isinstance(experiment.observed, EdgeObservation) else "moved_mm"
        moved: dict[str, Any] = {key: places - by}
        return replace(assumed, experiment=replace(experiment, observed=replace(experiment.observed, **moved)))

    return change


def _measured(experiment: Experiment) -> Array:
    observed = experiment.observed
    return observed.points_mm if isinstance(observed, EdgeObservation) else observed.moved_mm


def _centre(experiment: Experiment) -> Array:
    # The point (x, y) in mm where the axis of the lens meets the plane of the beam.
    if experiment.view is not None:
        return experiment.view.centre_mm
    # Without a known axis: the middle of the measured points.
    used = _measured(experiment)[np.isfinite(experiment.observed.sigma_mm)]
    return np.asarray(0.5 * (used.min(axis=0) + used.max(axis=0)))


def _stand_off_mm(experiment: Experiment) -> float:
    return _STAND_OFF_MM if experiment.view is None else experiment.view.stand_off_mm


def _distorted(experiment: Experiment, places: Array, amplitudes: Array) -> Array:
    centre, radial, off_centre = _centre(experiment), float(amplitudes[0]), amplitudes[1:3]
    used = _measured(experiment)[np.isfinite(experiment.observed.sigma_mm)] - centre
    # Few tracked points can be close together and far from the clamp, from which positions are measured. Then half of
    # its distance is used: in units of a much smaller radius, the displacement of the clamp would be enormous.
    farthest_mm = max(float(np.sqrt((used**2).sum(axis=-1).max())), 0.5 * float(np.linalg.norm(centre)), 1e-6)
    share = (places - centre) / farthest_mm
    # The first amplitude is the relative distortion at the farthest point. The other two are the displacement of the
    # axis, times the first, divided by the distance of this point. A large displacement is only counted linearly.
    if float(np.linalg.norm(off_centre)) <= _FARTHEST_AXIS * abs(radial) and radial:
        from_axis = share - off_centre / radial
        return np.asarray(farthest_mm * radial * (from_axis**2).sum(axis=-1, keepdims=True) * from_axis)
    square = (share**2).sum(axis=-1, keepdims=True)
    by_axis = 2 * (share @ off_centre)[..., None] * share + square * off_centre
    return np.asarray(farthest_mm * (radial * square * share - by_axis))


def _pitched(experiment: Experiment, places: Array, amplitudes: Array) -> Array:
    from_centre = places - _centre(experiment)
    # The first tilt brings points with a larger x nearer to the camera, the second points with a larger y.
    nearer = from_centre @ np.radians(amplitudes) / _stand_off_mm(experiment)
    return np.asarray(nearer[..., None] * from_centre)


def _farther(experiment: Experiment, places: Array, amplitudes: Array) -> Array:
    return np.asarray(-amplitudes[0] / _stand_off_mm(experiment) * (places - _centre(experiment)))


CAUSES_IN_PICTURES: tuple[PossibleCause, ...] = (
    of_source("roll", "roll", (1.0,), "a plumb line in the picture"),
    # The direction of the beam in the picture also changes the loads.
    of_source("clamp_angle", "axis", (0.5,), "a picture of the clamp's edge beside a plumb line (axis_angle_deg)"),
    of_source("clamp_offset", "clamp", (0.3, 0.3), "a picture of the clamp's edge (clamp_midpoint_px)"),
    of_source("scale", "scale", (0.01,), "a scale in the plane of the beam (pixels_per_mm)"),
    PossibleCause(
        "distance",
        "distance of the beam from the plane of calibration",
        "mm",
        (5.0,),
        _by_picture(_farther),
        "a scale in the plane of the beam, or the distances of beam and calibration target from the lens",
    ),
    PossibleCause(
        "distortion",
        "radial distortion of the lens",
        "1",
        (0.01, 0.005, 0.005, 0.1, 0.1),
        _by_picture(_distorted, shift=3),
        "a calibration with a board over the whole picture",
        shown=1,
    ),
    PossibleCause(
        "camera_pitch",
        "pitch of the camera",
        "deg",
        (1.0, 1.0),
        _by_picture(_pitched),
        "a calibration board in the plane of the beam",
        "tilt",
    ),
)
