"""The possible errors of a bench: usual size, effect on the residuals, and the measurement that confirms each error.

Such an error is a possible cause of residuals. A cause changes the assumptions of a fit about an experiment: the
specimen, the loads, the picture or the law. The change of the residuals at the optimum is the signature of the cause
(`inference.doubts.causes`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.coil_field import CoilShape
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.rest_modes import WAIST, with_modes
from eimi_fitting.inference.doubts.twisted_picture import without_twist
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.laws.law import Law
from eimi_fitting.laws.sum_of_terms import SumOfTerms

Array = NDArray[np.float64]

_STAND_OFF_MM = 300.0  # distance of a camera whose stand-off is not stated
_FARTHEST_AXIS = 2.0  # displacement of the lens axis up to which a distortion is computed exactly, a multiple of R
_GRADIENT_AT_M = 0.01  # distance at which a curved field has the gradient that is given as its size


@dataclass(frozen=True)
class Assumed:
    """The law, the beam model, the loads and the deviations of inputs that a fit assumes for one experiment.

    Parameters
    ----------
    law : Law
        The hyperelastic law.
    parameters : ndarray, shape (1, n)
        The n parameters of the law.
    bulk_modulus_Pa : ndarray, shape (1,), or None
        Bulk modulus in Pa; None for an incompressible material.
    experiment : Experiment
        The experiment with a planar model.
    deviations : tuple of (str, int, float)
        One entry for each uncertain number that differs from its stated value: the source of the number (a key of
        `SOURCES`), its index among the parts of the source (such as x and y), and its deviation in the unit of the
        source.
    """

    law: Law
    parameters: Array
    bulk_modulus_Pa: Array | None
    experiment: Experiment
    deviations: tuple[tuple[str, int, float], ...] = ()

    @property
    def bent(self) -> Experiment:
        """The experiment with the assumed deviations of specimen, loads and lens.

        A deviation that only multiplies the field by a factor is not included; `setup` contains this factor.
        """
        parts: dict[str, Array] = {}
        for source, part, value in self.deviations:
            if SOURCES[source].bends:
                parts.setdefault(source, np.zeros(len(SOURCES[source].parts)))[part] += value
        return self.experiment.under(parts)

    @property
    def setup(self) -> Setup:
        """The factor on the field and the map from the beam to the picture for the assumed deviations of inputs."""
        return Setup.of(self.deviations, 1)


Change = Callable[[Assumed, Array], Assumed]


@dataclass(frozen=True)
class PossibleCause:
    """One possible error of a bench, described by one or more amplitudes.

    Attributes
    ----------
    name : str
        Name of the cause in `fits.json`.
    words : str
        Name of the cause for people.
    unit : str
        Unit of the amplitudes; ``"1"`` for a share.
    sizes : tuple of float
        Standard deviation of the prior of each amplitude, the usual size of the error in a laboratory.
    change : callable or None
        Takes the assumptions of a fit and the amplitudes, and returns the assumptions with this cause. None for a
        planar model of a solid section, whose effect is computed with a three-dimensional model.
    decide_by : str
        The measurement that decides whether the cause is present.
    source : str
        The source of uncertainty (a key of `SOURCES`) that describes the same error; empty without such a source.
    is_common : bool
        Whether all datasets share one amplitude.
    shown : int or None
        Number of amplitudes, from the first, that enter the reported value of the cause. None for all amplitudes.
    """

    name: str
    words: str
    unit: str
    sizes: tuple[float, ...]
    change: Change | None
    decide_by: str
    source: str = ""
    is_common: bool = False
    shown: int | None = None


def _by_sources(*parts: Mapping[tuple[str, int], float]) -> Change:
    """Return a function that adds deviations of uncertain inputs to the assumptions of a fit.

    The function takes the assumptions and the amplitudes of a cause (an error of the bench). ``parts`` has one
    dictionary for each amplitude. A key is an uncertain number: a source (a key of `SOURCES`) and the index of the
    number among the parts of this source. Its value is the deviation of the number for an amplitude of 1. Example: with
    an amplitude of 1 mm for a soft clamp, the beam is 1 mm longer and the clamp lies at x = -1 mm.
    """

    def change(assumed: Assumed, amplitudes: Array) -> Assumed:
        more = tuple(
            (source, index, float(amplitude * per_unit))
            for part, amplitude in zip(parts, amplitudes, strict=True)
            if amplitude
            for (source, index), per_unit in part.items()
        )
        return replace(assumed, deviations=assumed.deviations + more)

    return change


def _of_source(
    name: str, source: str, sizes: tuple[float, ...], decide_by: str, is_common: bool = False
) -> PossibleCause:
    entry = SOURCES[source]
    parts: list[Mapping[tuple[str, int], float]] = [{(source, i): 1.0} for i in range(len(entry.parts))]
    return PossibleCause(name, entry.words, entry.unit, sizes, _by_sources(*parts), decide_by, source, is_common)


def _by_picture(displacement: Callable[[Experiment, Array, Array], Array], shift: int | None = None) -> Change:
    """Return a function that displaces the measured points of an experiment in the picture.

    Parameters
    ----------
    displacement : callable
        Takes an experiment, positions (x, y) in mm, shape (..., 2), and the amplitudes (sizes of the error). Returns
        the displacements of these positions in mm, (..., 2). The displacement of the clamp is subtracted from all
        displacements, because positions are measured from the clamp.
    shift : int, optional
        Index of the first of two amplitudes that displace all points in x and y by a length in mm. Such a shift is
        needed if the position of the clamp comes from another picture, in which the clamp is not displaced.

    Returns
    -------
    callable
        Takes the assumptions of a fit and amplitudes, and returns the assumptions with displaced measured points.
    """

    def change(assumed: Assumed, amplitudes: Array) -> Assumed:
        experiment, places = assumed.experiment, _measured(assumed.experiment)
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
    """Return the point (x, y) at which the axis of the lens meets the plane of the beam, (2,) in mm.

    If the axis is not known, return the middle of the measured points that the fit uses.
    """
    observed = experiment.observed
    if isinstance(observed, EdgeObservation) and observed.view is not None:
        return observed.view.centre_mm
    used = _measured(experiment)[np.isfinite(observed.sigma_mm)]
    return np.asarray(0.5 * (used.min(axis=0) + used.max(axis=0)))


def _stand_off_mm(experiment: Experiment) -> float:
    observed = experiment.observed
    view = observed.view if isinstance(observed, EdgeObservation) else None
    return _STAND_OFF_MM if view is None else view.stand_off_mm


def _distorted(experiment: Experiment, places: Array, amplitudes: Array) -> Array:
    """Return the displacements in mm of the positions ``places`` by a radial distortion of the lens.

    Positions (x, y) in mm and displacements have the shape (..., 2). Let R be the distance of the farthest measured
    point from the assumed centre of the lens. A position with the vector r from the true axis of the lens is displaced
    by k |r|^2 / R^2 times r. The first amplitude is k, the relative distortion at the distance R. The next two
    amplitudes are k / R times the distance in x and y of the true axis from the assumed centre. If the axis is more
    than 2 R from the centre, only the terms that are linear in the amplitudes are kept.
    """
    centre, radial, off_centre = _centre(experiment), float(amplitudes[0]), amplitudes[1:3]
    used = _measured(experiment)[np.isfinite(experiment.observed.sigma_mm)] - centre
    farthest_mm = max(float(np.sqrt((used**2).sum(axis=-1).max())), 1e-6)
    share = (places - centre) / farthest_mm
    if float(np.linalg.norm(off_centre)) <= _FARTHEST_AXIS * abs(radial) and radial:
        from_axis = share - off_centre / radial
        return np.asarray(farthest_mm * radial * (from_axis**2).sum(axis=-1, keepdims=True) * from_axis)
    square = (share**2).sum(axis=-1, keepdims=True)
    by_axis = 2 * (share @ off_centre)[..., None] * share + square * off_centre
    return np.asarray(farthest_mm * (radial * square * share - by_axis))


def _pitched(experiment: Experiment, places: Array, amplitudes: Array) -> Array:
    """Return the displacements in mm, (..., 2), of positions (x, y) in mm by two tilts of the camera in degrees.

    A positive first tilt brings the points at larger x nearer to the camera, and a positive second tilt the points at
    larger y.
    """
    from_centre = places - _centre(experiment)
    nearer = from_centre @ np.radians(amplitudes) / _stand_off_mm(experiment)
    return np.asarray(nearer[..., None] * from_centre)


def _farther(experiment: Experiment, places: Array, amplitudes: Array) -> Array:
    """Return the displacements in mm, (..., 2), of positions (x, y) in mm if the beam is farther from the camera.

    The first of ``amplitudes`` is the distance in mm of the beam behind the plane of the calibration.
    """
    return np.asarray(-amplitudes[0] / _stand_off_mm(experiment) * (places - _centre(experiment)))


def _tapered(assumed: Assumed, amplitudes: Array) -> Assumed:
    """Return the assumptions of a fit with a beam whose width varies.

    The two amplitudes in mm are the change of the width from the clamp to the end of the flexible part, and the width
    at both ends minus the width in the middle.
    """
    assumed = _by_sources({("taper", 0): 1.0})(assumed, amplitudes[:1])
    if not amplitudes[1]:
        return assumed
    model = assumed.experiment.model
    waisted = with_modes(model.specimen, (), (0.0, float(amplitudes[1]) / WAIST))
    return replace(assumed, experiment=replace(assumed.experiment, model=model.of(waisted)))


def _untwisted(assumed: Assumed, amplitudes: Array) -> Assumed:
    """Return the assumptions of a fit with measured edges from which the effect of a twist is subtracted.

    The magnet twists the beam if its moment points out of the plane of the picture. The only amplitude is the angle
    between moment and plane in degrees.
    """
    law, parameters, angle_deg = assumed.law, assumed.parameters, float(amplitudes[0])
    return replace(assumed, experiment=without_twist(assumed.experiment, assumed.bent, law, parameters, angle_deg))


def _by_loads(loads_of: Callable[[Loads, Array], Loads]) -> Change:
    def change(assumed: Assumed, amplitudes: Array) -> Assumed:
        loads = loads_of(assumed.experiment.loads, amplitudes)
        return replace(assumed, experiment=replace(assumed.experiment, loads=loads))

    return change


def _softened(loads: Loads, stiffness: Array) -> Loads:
    """Return the loads of K states divided by ``stiffness`` (K,), because a softer beam bends as under larger loads.

    ``stiffness`` has the factor on the stiffness of the beam in each state.
    """
    over = 1 / stiffness[:, None]
    return replace(
        loads, field_T=over * loads.field_T, gravity=over * loads.gravity, tip_force_N=over * loads.tip_force_N
    )


def _crept(loads: Loads, amplitudes: Array) -> Loads:
    """Return larger loads that describe a beam that softens in proportion to time, with equal time between states.

    The only amplitude is the share of the stiffness that is lost between the first and the last state.
    """
    return _softened(loads, 1 - amplitudes[0] * np.linspace(0, 1, len(loads)))


def strengths(loads: Loads) -> Array:
    """Return a measure of the size of the load in each of K states, (K,).

    The measure is the sum of two ratios: the field divided by the largest field of all states, and the tip force
    divided by the largest tip force.
    """
    sizes = [np.linalg.norm(load, axis=1) for load in (loads.field_T, loads.tip_force_N)]
    return np.asarray(sum(size / size.max() for size in sizes if size.max() > 0) + np.zeros(len(loads)))


def directions_of_change(loads: Loads) -> Array:
    """Return 1 for a state after an increase of the load (`strengths`) and -1 after a decrease, for K states, (K,)."""
    steps = np.sign(np.round(np.diff(strengths(loads), prepend=-1e-3), 6))
    for k in range(1, len(steps)):
        steps[k] = steps[k] or steps[k - 1]
    return np.asarray(steps)


def _lagging(loads: Loads, amplitudes: Array) -> Loads:
    """Return larger loads in the states after a decrease of the load, which describe a softer beam (hysteresis).

    The only amplitude is the share of the stiffness that is missing in these states.
    """
    return _softened(loads, 1 - amplitudes[0] * (directions_of_change(loads) < 0))


def _graded(loads: Loads, amplitudes: Array) -> Loads:
    """Return the loads with a field whose strength varies in space: with two gradients and a curvature.

    A gradient is the relative change of the field strength per metre. The first two amplitudes are gradients along and
    across the straight beam. The third amplitude describes a curvature, which is a gradient along the axis of the coil
    that grows with the distance from the position of the magnet at rest. The amplitude is the gradient at a distance of
    10 mm.
    """
    strongest = loads.field_T[np.argmax(np.linalg.norm(loads.field_T, axis=1))]
    size = float(np.linalg.norm(strongest))
    if not size:
        return loads
    shape = loads.coil or CoilShape((float(strongest[0] / size), float(strongest[1] / size)))
    along, across = shape.gradient_per_m
    graded = replace(
        shape,
        gradient_per_m=(along + float(amplitudes[0]), across + float(amplitudes[1])),
        curvature_per_m2=shape.curvature_per_m2 + float(amplitudes[2]) / (2 * _GRADIENT_AT_M),
    )
    return replace(loads, coil=graded)


_AS_TERMS: dict[str, tuple[tuple[str, ...], tuple[float, ...]]] = {
    "neo-hookean": (("i1",), (1.0,)),
    "mooney-rivlin": (("i1", "i2"), (2.0, 2.0)),
    "yeoh": (("i1", "i1^2", "i1^3"), (2.0, 1.0, 1.0)),
}
"""For some laws, the names of the terms, and for each term its coefficient divided by the parameter of the law."""


def _with_terms(assumed: Assumed, amplitudes: Array) -> Assumed:
    """Return the assumptions of a fit with two more terms of the law, (I1 - 3)^2 and I2 - 3.

    The two amplitudes are the coefficients of the terms as shares of the initial shear modulus. The initial shear
    modulus stays the same. Only Neo-Hookean, Mooney-Rivlin and Yeoh laws are changed.
    """
    if assumed.law.name not in _AS_TERMS or not amplitudes.any():
        return assumed
    terms, factors = _AS_TERMS[assumed.law.name]
    coefficients = dict(zip(terms, assumed.parameters[0] * factors, strict=True))
    modulus = float(assumed.law.initial_shear_modulus(assumed.parameters)[0])
    quadratic, second = modulus * amplitudes
    coefficients["i1^2"] = coefficients.get("i1^2", 0.0) + quadratic
    coefficients["i2"] = coefficients.get("i2", 0.0) + second
    coefficients["i1"] -= second
    return replace(assumed, law=SumOfTerms.of(*coefficients), parameters=np.array([list(coefficients.values())]))


_REST_PICTURE = "two pictures without field, the second with the beam turned by 180 degrees about its axis"
_BOTH_POLARITIES = "the same currents with both polarities (both_polarities = true)"

POSSIBLE_CAUSES: tuple[PossibleCause, ...] = (
    _of_source("roll", "roll", (1.0,), "a plumb line in the picture"),
    _of_source("clamp_angle", "axis", (0.5,), "a picture of the clamp's edge beside a plumb line (axis_angle_deg)"),
    _of_source("clamp_offset", "clamp", (0.3, 0.3), "a picture of the clamp's edge (clamp_midpoint_px)"),
    PossibleCause(
        "clamp_softness",
        "softness of the clamp",
        "mm",
        (0.3,),
        _by_sources({("length", 0): 1.0, ("clamp", 0): -1.0}),
        "the angle of the beam at the clamp under load in an enlarged picture, or a stiffer clamp",
    ),
    _of_source("scale", "scale", (0.01,), "a scale in the plane of the beam (pixels_per_mm)"),
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
    _of_source("rest_shape", "rest-shape", (0.5, 0.3, 0.3), _REST_PICTURE),
    PossibleCause(
        "taper",
        SOURCES["taper"].words,
        SOURCES["taper"].unit,
        (0.06, 0.03),
        _tapered,
        "the width at both ends and in the middle of the beam",
        "taper",
    ),
    _of_source("width", "width", (0.05,), "the width at several places"),
    _of_source("magnetisation_angle", "magnetisation-angle", (3.0,), _BOTH_POLARITIES),
    PossibleCause(
        "magnetisation_out_of_plane",
        "twist by a magnetisation out of the plane of the picture",
        "deg",
        (3.0,),
        _untwisted,
        "a picture of the tip along the beam",
    ),
    _of_source(
        "moment",
        "moment",
        (0.05,),
        "the field of the magnet at a known distance, or a bending test with weights in place of the field",
    ),
    PossibleCause(
        "field_gradient",
        "uneven field of the coil",
        "1/m",
        (2.0, 2.0, 2.0),
        _by_loads(_graded),
        "the field at several places with a gaussmeter",
        "field-gradient",
    ),
    _of_source(
        "background_field", "background-field", (0.05, 0.05), f"{_BOTH_POLARITIES}, or a gaussmeter at zero current"
    ),
    PossibleCause(
        "creep",
        "softening during the run",
        "1",
        (0.1,),
        _by_loads(_crept),
        "one current repeated at the beginning and at the end of the run",
    ),
    PossibleCause(
        "hysteresis",
        "softening after a decrease of the load",
        "1",
        (0.05,),
        _by_loads(_lagging),
        "the same currents with increasing and with decreasing steps",
    ),
    PossibleCause(
        "section", "planar section of a solid beam", "1", (1.0,), None, 'a fit with section = "solid"', is_common=True
    ),
    PossibleCause(
        "law",
        "another law",
        "1",
        (0.1, 0.3),
        _with_terms,
        "a fit of the other laws, larger fields, or a tensile curve",
        is_common=True,
    ),
)
