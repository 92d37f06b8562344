"""List the inputs of a simulation that may be uncertain, such as the width of the specimen.

An input is uncertain if a file specifies its standard uncertainty. Either a fit determines the input together with the
law, or the uncertainty widens the intervals of the result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.coil_field import CoilShape
from eimi_fitting.beam.kinds_of_load import UniformField
from eimi_fitting.beam.rest_modes import with_modes
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.view import View

if TYPE_CHECKING:
    from eimi_fitting.beam.loads import Loads

Array = NDArray[np.float64]
File = Literal["specimen", "calibration", "rig"]


@dataclass(frozen=True, kw_only=True)
class Source:
    """An input of a simulation that may be uncertain, such as the width of the specimen.

    Parameters
    ----------
    words : str
        Name of the input in texts.
    parts : tuple of str
        Names of its components, such as x and y, in a result.
    unit : str
        Unit of the components; ``"1"`` for a relative error.
    largest : float
        Largest accepted standard deviation, in ``unit``.
    usual : float
        Usual standard deviation in a laboratory, in ``unit``.
    is_decisive : bool
        Whether the input is important: a fit reports the effect of its ``usual`` error if no uncertainty is given.
    is_even : bool
        Whether the effect is equal in a reversed magnetic field.
    common : bool
        Whether all datasets usually have the same error of this input.
    covers : tuple of str
        Names of other inputs with the same effect. If this input is fitted, they are not considered separately.
    stated_in : str or None
        The file that specifies the uncertainty: "specimen", "calibration" or "rig".
    key : str
        Key of the input in this file.
    field : callable, optional
        Converts errors of the input to factors on the magnetic loads.
    image : callable, optional
        Converts errors of the input to linear maps of the picture: matrices, and shifts in mm.
    specimen : callable, optional
        Changes the specimen by an error of the input.
    loads : callable, optional
        Changes the loads by an error of the input.
    lens : callable, optional
        Changes the view of the lens by an error of the input.
    """

    words: str
    parts: tuple[str, ...]
    unit: str
    largest: float
    usual: float
    is_decisive: bool = False
    is_even: bool = False
    common: bool = False
    covers: tuple[str, ...] = ()
    stated_in: File | None = None
    key: str = ""
    # From (P, parts) to (P,).
    field: Callable[[Array], Array] | None = None
    # From (P, parts) to (P, 2, 2) and (P, 2).
    image: Callable[[Array], tuple[Array, Array]] | None = None
    # Each takes one error, (parts,).
    specimen: Callable[[Specimen, Array], Specimen] | None = None
    loads: Callable[[Loads, Array], Loads] | None = None
    lens: Callable[[View, Array], View] | None = None

    @property
    def changes_experiment(self) -> bool:
        """Whether an error of this input changes the specimen, the loads or the lens of an experiment."""
        # `Experiment.under` applies these errors. `Setup` describes all others: a factor on the magnetic loads, or a
        # shift, rotation or scale of the image.
        return any((self.specimen, self.loads, self.lens))

    @property
    def changes_shapes(self) -> bool:
        """Whether an error of this input changes the shape of the beam."""
        return any((self.specimen, self.loads, self.field))


@dataclass(frozen=True)
class StatedSource:
    """The standard uncertainty of one input, such as the width, in a file."""

    source: str
    # In the unit of the input.
    standard_uncertainty: float
    # Name of the object to which the input belongs, such as a coil.
    of: str


def _share(deviation: Array) -> Array:
    return np.asarray(1 + deviation[:, 0])


def _rotation(angle_deg: Array) -> Array:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def _turned(deviation: Array) -> tuple[Array, Array]:
    return _rotation(deviation[:, 0]), np.zeros((len(deviation), 2))


def _shifted(deviation: Array) -> tuple[Array, Array]:
    return np.broadcast_to(np.eye(2), (len(deviation), 2, 2)), deviation


def _magnified(deviation: Array) -> tuple[Array, Array]:
    return (1 + deviation[:, :, None]) * np.eye(2), np.zeros((len(deviation), 2))


def _gravity_turned(loads: Loads, deviation: Array) -> Loads:
    # The angle is in degrees. Tip forces are rotated, too.
    turn = _rotation(deviation[0]).T
    return replace(loads, gravity=loads.gravity @ turn, tip_force_N=loads.tip_force_N @ turn)


def _field_turned(loads: Loads, deviation: Array) -> Loads:
    return replace(loads, field_T=loads.field_T @ _rotation(deviation[0]).T)


def _seen_from_turned_axis(loads: Loads, deviation: Array) -> Loads:
    # The beam is rotated in the image. In its frame, all loads are rotated the other way.
    return _gravity_turned(_field_turned(loads, -deviation), -deviation)


def _field_offset(loads: Loads, deviation: Array) -> Loads:
    # The added field in mT has the direction of the strongest field.
    strongest = loads.field_T[np.argmax(np.linalg.norm(loads.field_T, axis=1))]
    size = float(np.linalg.norm(strongest))
    return replace(loads, field_T=loads.field_T + 1e-3 * deviation[0] * strongest / size) if size else loads


def _background_field(loads: Loads, deviation: Array) -> Loads:
    # A uniform field (x, y) in mT.
    return loads.plus(UniformField(np.tile(1e-3 * deviation, (len(loads), 1))))


def with_gradient(loads: Loads, added_per_m: Array, curvature_per_m2: float = 0.0) -> Loads:
    """Return the loads with a changed gradient and a changed curvature of the magnetic field."""
    # added_per_m (2,): changes of the gradient of the relative field strength along and across the straight beam.
    # curvature_per_m2: change of half the second derivative of the relative field strength along the coil axis.
    strongest = loads.field_T[np.argmax(np.linalg.norm(loads.field_T, axis=1))]
    size = float(np.linalg.norm(strongest))
    if not size:
        return loads
    shape = loads.coil or CoilShape((float(strongest[0] / size), float(strongest[1] / size)))
    along, across = shape.gradient_per_m
    graded = replace(
        shape,
        gradient_per_m=(along + float(added_per_m[0]), across + float(added_per_m[1])),
        curvature_per_m2=shape.curvature_per_m2 + curvature_per_m2,
    )
    return replace(loads, coil=graded)


def _farther(view: View, deviation: Array) -> View:
    return replace(view, stand_off_mm=view.stand_off_mm + float(deviation[0]))


def _tilted(view: View, deviation: Array) -> View:
    along, across = view.tilt_deg
    return replace(view, tilt_deg=(along + float(deviation[0]), across + float(deviation[1])))


def _beam(name: str) -> Callable[[Specimen, Array], Specimen]:
    def changed(specimen: Specimen, deviation: Array) -> Specimen:
        more: dict[str, Any] = {name: getattr(specimen, name) + float(deviation[0])}
        return replace(specimen, **more)

    return changed


def _magnet(name: str) -> Callable[[Specimen, Array], Specimen]:
    def changed(specimen: Specimen, deviation: Array) -> Specimen:
        magnet = specimen.magnet
        if magnet is None:
            return specimen
        more: dict[str, Any] = {name: getattr(magnet, name) + float(deviation[0])}
        return replace(specimen, magnet=replace(magnet, **more))

    return changed


def _of_specimen(
    words: str, key: str, unit: str, largest: float, usual: float, change: Callable[[Specimen, Array], Specimen]
) -> Source:
    return Source(
        words=words,
        parts=(words,),
        unit=unit,
        largest=largest,
        usual=usual,
        stated_in="specimen",
        key=key,
        specimen=change,
    )


# Beyond ``largest`` the field may have either sign, x and y may be swapped, or the clamp may be anywhere on the beam.
# Such a number is a mistake, for example per cent instead of a share. The maps of the image apply in this order.
SOURCES: dict[str, Source] = {
    "moment": Source(
        words="magnetic moment",
        parts=("moment",),
        unit="1",
        largest=0.5,
        usual=0.02,
        covers=("remanence",),
        field=_share,
    ),
    "coil": Source(
        words="coil constant",
        parts=("coil constant",),
        unit="1",
        largest=0.5,
        usual=0.01,
        common=True,
        stated_in="calibration",
        key="coil_constant_mT_per_A",
        field=_share,
    ),
    "scale": Source(
        words="scale of the picture",
        parts=("scale",),
        unit="1",
        largest=0.5,
        usual=0.003,
        stated_in="calibration",
        key="pixels_per_mm",
        image=_magnified,
    ),
    "roll": Source(words="roll of the camera", parts=("roll",), unit="deg", largest=45.0, usual=0.1, image=_turned),
    "axis": Source(
        words="direction of the beam at rest",
        parts=("axis",),
        unit="deg",
        largest=45.0,
        usual=0.1,
        stated_in="calibration",
        key="axis_angle_deg",
        image=_turned,
        loads=_seen_from_turned_axis,
    ),
    "clamp": Source(
        words="place of the clamp",
        parts=("clamp x", "clamp y"),
        unit="mm",
        largest=10.0,
        usual=0.05,
        stated_in="calibration",
        key="clamp_midpoint_px",
        image=_shifted,
    ),
    "gravity": Source(
        words="direction of gravity",
        parts=("gravity",),
        unit="deg",
        largest=45.0,
        usual=0.2,
        stated_in="calibration",
        key="gravity_angle_deg",
        loads=_gravity_turned,
    ),
    "field": Source(
        words="direction of the field",
        parts=("field",),
        unit="deg",
        largest=45.0,
        usual=0.5,
        stated_in="calibration",
        key="field_angle_deg",
        loads=_field_turned,
    ),
    "background-field": Source(
        words="background field",
        parts=("background field x", "background field y"),
        unit="mT",
        largest=2.0,
        usual=0.03,
        is_even=True,
        stated_in="calibration",
        key="background_field_mT",
        loads=_background_field,
    ),
    "field-gradient": Source(
        words="gradient of the coil's field",
        parts=("field gradient along the beam", "field gradient across the beam"),
        unit="1/m",
        largest=20.0,
        usual=1.0,
        stated_in="calibration",
        key="field_gradient_per_m",
        loads=with_gradient,
    ),
    "stand-off": Source(
        words="stand-off of the lens",
        parts=("stand-off",),
        unit="mm",
        largest=100.0,
        usual=2.0,
        stated_in="calibration",
        key="stand_off_mm",
        lens=_farther,
    ),
    "tilt": Source(
        words="tilt of the camera about the picture's axes",
        parts=("tilt along the beam", "tilt across the beam"),
        unit="deg",
        largest=20.0,
        usual=1.0,
        stated_in="calibration",
        key="camera_tilt_deg",
        lens=_tilted,
    ),
    "offset": Source(
        words="zero of the field",
        parts=("offset",),
        unit="mT",
        largest=10.0,
        usual=0.01,
        stated_in="rig",
        key="current_A",
        loads=_field_offset,
    ),
    "width": _of_specimen("width", "width_mm", "mm", 10.0, 0.02, _beam("width_mm")),
    "depth": _of_specimen("depth", "depth_mm", "mm", 10.0, 0.03, _beam("depth_mm")),
    "length": _of_specimen("length", "length_mm", "mm", 10.0, 0.05, _beam("length_mm")),
    "rest-shape": Source(
        words="shape at rest",
        parts=("even bend", "bend toward the tip", "bend in the middle"),
        unit="mm",
        largest=10.0,
        usual=0.1,
        stated_in="specimen",
        key="rest_shape_mm",
        specimen=with_modes,
    ),
    "taper": _of_specimen(
        "change of width", "taper_mm", "mm", 10.0, 0.02, lambda specimen, change: with_modes(specimen, (), 0.5 * change)
    ),
    "density": _of_specimen("density", "density_kg_m3", "kg/m3", 1000.0, 5.0, _beam("density_kg_m3")),
    "remanence": _of_specimen("remanence", "remanence_T", "T", 1.0, 0.02, _magnet("remanence_T")),
    "magnetisation-angle": replace(
        _of_specimen(
            "direction of magnetisation",
            "magnetisation_angle_deg",
            "deg",
            45.0,
            3.0,
            _magnet("magnetisation_angle_deg"),
        ),
        is_decisive=True,
        is_even=True,
    ),
    "magnet-length": _of_specimen("magnet's length", "magnet_length_mm", "mm", 10.0, 0.02, _magnet("length_mm")),
    "magnet-width": _of_specimen("magnet's width", "magnet_width_mm", "mm", 10.0, 0.02, _magnet("width_mm")),
    "magnet-depth": _of_specimen("magnet's depth", "magnet_depth_mm", "mm", 10.0, 0.02, _magnet("depth_mm")),
    "magnet-offset": _of_specimen(
        "magnet's distance from the tip", "magnet_tip_offset_mm", "mm", 10.0, 0.05, _magnet("tip_offset_mm")
    ),
    "magnet-density": _of_specimen(
        "magnet's density", "magnet_density_kg_m3", "kg/m3", 5000.0, 50.0, _magnet("density_kg_m3")
    ),
}


def specimen_under(before: Specimen, deviations: Mapping[str, Array]) -> Specimen:
    """Return the specimen after changes of its dimensions and material properties, such as the width."""
    specimen = before
    for key, deviation in deviations.items():
        if change := SOURCES[key].specimen:
            specimen = change(specimen, deviation)
    if before.tip_load_mm is None:
        return specimen
    x, y = before.tip_load_mm
    larger_x, larger_y = specimen.length_mm / before.length_mm, specimen.width_mm / before.width_mm
    return replace(specimen, tip_load_mm=(x * larger_x, y * larger_y))


def loads_under(loads: Loads, deviations: Mapping[str, Array]) -> Loads:
    """Return the loads after changes of their inputs, such as the direction of gravity."""
    for key, deviation in deviations.items():
        if change := SOURCES[key].loads:
            loads = change(loads, deviation)
    return loads


def view_under(view: View, deviations: Mapping[str, Array]) -> View:
    """Return the view of the lens after changes of its distance and tilt."""
    for key, deviation in deviations.items():
        if change := SOURCES[key].lens:
            view = change(view, deviation)
    return view
