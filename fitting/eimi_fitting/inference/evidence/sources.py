"""What may be uncertain about an experiment beside its edges: one registry, an entry a source.

A source that is stated with a standard uncertainty is either considered (it widens the intervals by what it does to the
estimate, see `inference.interval.budget`) or freed (it is one more unknown of the fit, see
`inference.evidence.unknowns`). Nothing else
in the package or above it names one: keys of files, options of commands, words of reports are made from the entries.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.specimen import Specimen

if TYPE_CHECKING:
    from eimi_fitting.beam.loads import Loads

Array = NDArray[np.float64]
File = Literal["specimen", "calibration", "rig"]


@dataclass(frozen=True, kw_only=True)
class Source:
    """A quantity that may be uncertain, and what it does to an experiment.

    words: what it is, for people; parts: the names of its numbers in a result; unit: of all of them, 1 for a share of
    what was stated; largest: standard deviation above which nothing is known; usual: one that a bench might state;
    common: to all datasets where nobody says whose it is, else each has its own; covers: other sources that say the
    same in other words, and are not counted beside it.

    stated_in, key: the file that states it, and the key with its unit.

    What it does, from deviations (P, parts), or (parts,) of one candidate: field: the factor (P,) on the magnetic
    loads; image: the linear map (P, 2, 2) and the shift (P, 2) mm that take a place to where the camera has it;
    specimen, loads, lens: another specimen, other loads, another stand-off of the lens in mm.
    """

    words: str
    parts: tuple[str, ...]
    unit: str
    largest: float
    usual: float
    common: bool = False
    covers: tuple[str, ...] = ()
    stated_in: File | None = None
    key: str = ""
    field: Callable[[Array], Array] | None = None
    image: Callable[[Array], tuple[Array, Array]] | None = None
    specimen: Callable[[Specimen, Array], Specimen] | None = None
    loads: Callable[[Loads, Array], Loads] | None = None
    lens: Callable[[float, Array], float] | None = None

    @property
    def bends(self) -> bool:
        """Whether it changes more than field and picture: candidates that differ in it are other experiments."""
        return any((self.specimen, self.loads, self.lens))


@dataclass(frozen=True)
class StatedSource:
    """A key of SOURCES, its standard uncertainty in the source's unit (0: exact), and what it is a number of.

    Datasets whose ``of`` is the same have the same error: one calibration, one coil, one specimen.
    """

    source: str
    standard_uncertainty: float
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
    """A tip force is a weight that hangs there."""
    turn = _rotation(deviation[0]).T
    return replace(loads, gravity=loads.gravity @ turn, tip_force_N=loads.tip_force_N @ turn)


def _field_turned(loads: Loads, deviation: Array) -> Loads:
    return replace(loads, field_T=loads.field_T @ _rotation(deviation[0]).T)


def _seen_from_turned_axis(loads: Loads, deviation: Array) -> Loads:
    """The picture shows where field and gravity point; about a beam that lies otherwise they point otherwise."""
    return _gravity_turned(_field_turned(loads, -deviation), -deviation)


def _field_offset(loads: Loads, deviation: Array) -> Loads:
    """The same current more in every state, along the field of the strongest."""
    strongest = loads.field_T[np.argmax(np.linalg.norm(loads.field_T, axis=1))]
    size = float(np.linalg.norm(strongest))
    return replace(loads, field_T=loads.field_T + 1e-3 * deviation[0] * strongest / size) if size else loads


def _farther(stand_off_mm: float, deviation: Array) -> float:
    return stand_off_mm + float(deviation[0])


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


# Largest: the field may have either sign, x and y may be swapped, the clamp may be anywhere on the beam. Such a number
# is a slip, of percent for a share or of degrees for radians. What the camera does, it does in this order.
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
    "density": _of_specimen("density", "density_kg_m3", "kg/m3", 1000.0, 5.0, _beam("density_kg_m3")),
    "remanence": _of_specimen("remanence", "remanence_T", "T", 1.0, 0.02, _magnet("remanence_T")),
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
    """Return the specimen with the deviations (parts,) of sources.

    The point of a tip force keeps its share of length and width, so that it stays on the specimen.
    """
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
    """The loads with what sources (parts,) deviate by."""
    for key, deviation in deviations.items():
        if change := SOURCES[key].loads:
            loads = change(loads, deviation)
    return loads


def stand_off_under(stand_off_mm: float, deviations: Mapping[str, Array]) -> float:
    """The lens's stand-off in mm with what sources (parts,) deviate by."""
    for key, deviation in deviations.items():
        if change := SOURCES[key].lens:
            stand_off_mm = change(stand_off_mm, deviation)
    return stand_off_mm
