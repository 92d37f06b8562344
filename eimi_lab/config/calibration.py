"""Read calibration.toml: scale of the picture, place and direction of the beam in it, and field of the coil."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.config.coil_shape import CoilShapeTable, with_rows_of_map
from eimi_lab.config.toml import Document, Table, check, locate, parse_table, read_text, to_toml
from eimi_lab.config.uncertainty import OfCalibration, check_sizes, keys_of, stated_sources

# TOML has lists but no tuples; strict=False lets pydantic turn a list into a tuple.
Pair = Annotated[tuple[float, float], Field(strict=False)]
Triple = Annotated[tuple[float, float, float], Field(strict=False)]
Quad = Annotated[tuple[int, int, int, int], Field(strict=False)]
Matrix = Annotated[tuple[Triple, Triple, Triple], Field(strict=False)]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]

# Numbers of distortion coefficients that OpenCV's camera model accepts (OpenCV documentation, "Camera Calibration and
# 3D Reconstruction").
DISTORTION_LENGTHS = (4, 5, 8, 12, 14)


# Later releases added these keys. If a calibration lacks such a key, its hash is computed without the key, so that the
# hash of an older calibration stays the same.
_OF_LATER_RELEASES = ("background_field_mT", "field", "camera_tilt_deg", "ruler_px")
_ROUNDING = 1e-9  # allowed rounding error of the sine of an angle
LARGEST_CAMERA_TILT_DEG = 30.0


class Picture(Table):
    """The table [picture] of a calibration: hints for finding the beam in the pictures, such as its colour."""

    region_px: Quad | None = None
    """Left, top, width and height of the part of the picture in which the program searches for the beam."""
    polarity: Literal["dark", "bright"] | None = None
    """dark or bright: whether the beam is darker or brighter than its surroundings."""
    channel: Literal["red", "green", "blue", "grey"] | None = None
    """The colour in which beam and surroundings differ most."""
    beam_colour: Triple | None = None
    """Red, green and blue of the beam, from 0 to 255 each. Give either beam_colour or channel."""
    along_px: Annotated[tuple[Pair, ...], Field(strict=False)] | None = None
    """Two to six points on the centre line of the beam in the first picture, from the clamp to the tip."""

    @model_validator(mode="after")
    def _sensible(self) -> Picture:
        if self.region_px is not None and (min(self.region_px[:2]) < 0 or min(self.region_px[2:]) < 1):
            raise ValueError(
                f"region_px = {list(self.region_px)} should be left and top (0 or more), width and height (1 or more)"
            )
        if self.beam_colour is not None and not all(0 <= part <= 255 for part in self.beam_colour):
            raise ValueError(f"beam_colour = {list(self.beam_colour)} should be red, green and blue from 0 to 255")
        if self.along_px is not None and not 2 <= len(self.along_px) <= 6:
            raise ValueError(f"along_px has {len(self.along_px)} points; give two to six points")
        if self.channel is not None and self.beam_colour is not None:
            raise ValueError("has both channel and beam_colour; give only one of these keys")
        return self


class Calibration(Document):
    """The contents of calibration.toml.

    In the picture, x points to the right and y down, and the centres of the pixels have integer coordinates. Angles are
    in degrees, clockwise from +x.
    """

    pixels_per_mm: float = Field(gt=0)
    """Scale of the image in the middle plane of the beam."""
    coil_constant_mT_per_A: float | None = Field(default=None, gt=0)
    """Field at the magnet for each ampere, measured with a Hall probe. Leave the key out if there is no coil."""
    clamp_midpoint_px: Pair
    """Middle of the line at which the beam leaves the clamp: x to the right, y down."""
    axis_angle_deg: Angle
    """Direction of the undeformed beam away from the clamp, clockwise from +x of the picture; 90 is down."""
    gravity_angle_deg: Angle
    """Direction of gravity, clockwise from +x of the picture; 90 is down."""
    gravity: bool = True
    """false if the weight does not bend the beam, because the beam bends in a horizontal plane. A tip force without an
    angle acts in the direction gravity_angle_deg, also with gravity = false.
    """
    field_angle_deg: Angle | None = None
    """Direction of the field of a positive current, clockwise from +x of the picture. This direction must be at
    least 30 degrees from the axis of the beam. The key is required with coil_constant_mT_per_A.
    """
    background_field_mT: Pair | None = None
    """Field at the magnet without a current, such as the field of the earth: the components to the right and down in
    the picture.
    """
    field: CoilShapeTable | None = None
    """The field of the coil as a function of position; by default the field is uniform."""
    camera_matrix: Matrix | None = None
    """Camera matrix of OpenCV, `[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]`; give camera_matrix and distortion together.
    """
    distortion: Numbers | None = None
    """Distortion coefficients of OpenCV: 4, 5, 8, 12 or 14 numbers."""
    stand_off_mm: float | None = Field(default=None, gt=0)
    """Distance from the entrance pupil of the lens to the middle plane of the beam."""
    camera_tilt_deg: Pair | None = None
    """Angles between the plane of the beam and the plane of the sensor. The first angle is positive if the beam is
    nearer to the camera at the right of the picture, the second if it is nearer at the bottom. This key needs
    stand_off_mm.
    """
    ruler_px: Annotated[tuple[Pair, Pair], Field(strict=False)] | None = None
    """Positions of two ticks of the ruler with which the scale was measured. When the program takes the tilt of the
    camera into account, it keeps the distance between these ticks.
    """
    telecentric: bool = False
    """true for a telecentric lens, which needs no stand_off_mm."""
    calibrated_on: date | None = None
    """The day on which the values were measured."""
    uncertainty: OfCalibration | None = None
    """Standard uncertainties. Most keys are the keys of the values. 0 means exact. If a key is absent, the uncertainty
    is unknown, and a fit takes the value as exact.
    """
    picture: Picture | None = None
    """Information that helps the program to find the beam in the pictures."""

    @model_validator(mode="after")
    def _consistent(self) -> Calibration:
        if self.coil_constant_mT_per_A is not None and self.field_angle_deg is None:
            raise ValueError("field_angle_deg is missing: coil_constant_mT_per_A needs the direction of the field")
        across = math.sin(math.radians(self.positive_field_deg - self.axis_angle_deg))
        if abs(across) < 0.5 - _ROUNDING:
            raise ValueError(
                f"field_angle_deg = {self.positive_field_deg:g} should be across the beam, at least 30 degrees from "
                f"axis_angle_deg = {self.axis_angle_deg:g}"
            )
        if (self.camera_matrix is None) != (self.distortion is None):
            raise ValueError("camera_matrix and distortion belong together: give both keys or none of them")
        if self.camera_matrix is not None and not _is_camera_matrix(self.camera_matrix):
            raise ValueError(
                f"camera_matrix = {[list(row) for row in self.camera_matrix]} should be [[fx, skew, cx], [0, fy, cy], "
                "[0, 0, 1]], with fx and fy greater than 0; some programs write the transpose of this matrix"
            )
        if self.distortion is not None and len(self.distortion) not in DISTORTION_LENGTHS:
            raise ValueError(f"distortion has {len(self.distortion)} numbers; OpenCV needs 4, 5, 8, 12 or 14 numbers")
        if self.telecentric and self.stand_off_mm is not None:
            raise ValueError(
                f"stand_off_mm = {self.stand_off_mm:g} and telecentric = true exclude each other: leave one of them out"
            )
        if self.camera_tilt_deg is not None and self.stand_off_mm is None:
            raise ValueError("stand_off_mm is missing: camera_tilt_deg needs the distance of the camera")
        if "camera_tilt_deg" in (self.uncertainty or {}) and self.stand_off_mm is None:
            raise ValueError("stand_off_mm is missing: [uncertainty] camera_tilt_deg needs the distance of the camera")
        if self.camera_tilt_deg is not None and max(map(abs, self.camera_tilt_deg)) > LARGEST_CAMERA_TILT_DEG:
            raise ValueError(
                f"camera_tilt_deg = {list(self.camera_tilt_deg)} should be two angles "
                f"from -{LARGEST_CAMERA_TILT_DEG:g} to {LARGEST_CAMERA_TILT_DEG:g}"
            )
        sizes = {key: (key, getattr(self, key)) for key in ("pixels_per_mm", "coil_constant_mT_per_A", "stand_off_mm")}
        check_sizes(
            self.uncertainty or {}, sizes, largest=0.5
        )  # a lens calibrated from few views has a poorly known stand-off
        return self

    @property
    def positive_field_deg(self) -> float:
        """Direction of the field of a positive current, in degrees clockwise from the x-axis of the picture.

        By default, the direction is 90° counter-clockwise from the straight beam.
        """
        return self.axis_angle_deg - 90.0 if self.field_angle_deg is None else self.field_angle_deg

    @property
    def mT_per_A(self) -> float:
        """The coil constant, mT/A; 0 without a coil."""
        return self.coil_constant_mT_per_A or 0.0

    def uncertain_keys(self) -> tuple[str, ...]:
        """Return the keys of this calibration that the table [uncertainty] may contain."""
        return tuple(key for key in keys_of("calibration") if getattr(self, key, None) is not None)

    def stated_sources(self) -> tuple[StatedSource, ...]:
        """Return the standard uncertainties in the table [uncertainty], in the form for a fit.

        For each uncertainty, the result names the object (this calibration or the coil) that causes the error.
        """
        coil = f"coil of {self.mT_per_A:g} mT/A"
        numbers = self._as_json({"picture"})
        this_calibration = f"calibration {hashlib.sha256(numbers.encode()).hexdigest()[:16]}"
        in_units = {
            "pixels_per_mm": 1 / self.pixels_per_mm,
            "clamp_midpoint_px": 1 / self.pixels_per_mm,
        }
        if self.coil_constant_mT_per_A is not None:
            in_units["coil_constant_mT_per_A"] = 1 / self.coil_constant_mT_per_A

        def shared_by(key: str) -> str:
            return coil if key.startswith("coil") else this_calibration

        return stated_sources("calibration", self.uncertainty, shared_by, in_units)

    @property
    def digest(self) -> str:
        """The SHA-256 hash of the values of the calibration."""
        return hashlib.sha256(self._as_json(set()).encode()).hexdigest()

    def _as_json(self, excluded: set[str]) -> str:
        """Return the values of the calibration as JSON, without the keys ``excluded``."""
        absent = {key for key in _OF_LATER_RELEASES if getattr(self, key) is None}
        return self.model_dump_json(exclude=excluded | absent)

    def age_days(self, taken: datetime) -> float | None:
        """Return the age of the calibration in days at the time ``taken``; None if the calibration has no date."""
        if self.calibrated_on is None:
            return None
        begin = datetime(self.calibrated_on.year, self.calibrated_on.month, self.calibrated_on.day, tzinfo=UTC)
        return max(0.0, (taken - begin).total_seconds() / 86400.0)


def _is_camera_matrix(matrix: Matrix) -> bool:
    (fx, _, _), (zero, fy, _), last = matrix
    return fx > 0.0 and fy > 0.0 and zero == 0.0 and last == (0.0, 0.0, 1.0)


PLACES = ("clamp_midpoint_px", "axis_angle_deg")
"""Keys whose values the user measures in the pictures. A file may lack these keys until the pictures exist."""

Changes = Mapping[str, Any]
"""New values for keys of a calibration, by key. The value of the key "picture" is a table of new values."""


_ONE_OF = frozenset({"channel", "beam_colour"})  # a new value of one of these keys removes the other key


def load_calibration(path: str | Path, changes: Changes | None = None) -> Calibration:
    """Read a calibration file.

    Parameters
    ----------
    path
        Path of the file, or the name of a shipped calibration.
    changes
        New values, which replace the values in the file.

    Raises
    ------
    InputError
        If the file cannot be read, or is not a valid calibration.
    """
    file = locate(path, "rigs")
    text = read_text(file)
    table = parse_table(text, file)
    if with_rows_of_map(table, file):
        text = to_toml(check(Calibration, table, "", file))
    return _changed(table, changes, text, file)


def missing_places(path: str | Path, changes: Changes) -> tuple[str, ...]:
    """Return the keys that are missing in a calibration: "clamp_midpoint_px", "axis_angle_deg", both or none.

    Parameters
    ----------
    path
        Path of the calibration file, or the name of a shipped calibration.
    changes
        New values for keys of the calibration.

    Raises
    ------
    InputError
        If the file would not be a valid calibration even with the missing keys.
    """
    file = locate(path, "rigs")
    table = parse_table(read_text(file), file)
    missing = tuple(place for place in PLACES if place not in table.keys() | changes.keys())
    if missing:
        across = table.get("field_angle_deg")
        any_axis = (across + 90.0) % 360.0 if isinstance(across, float | int) else 0.0
        assumed = dict(zip(PLACES, ((0.0, 0.0), any_axis), strict=True))
        load_calibration(path, {**changes, **{place: assumed[place] for place in missing}})
    return missing


def changed_calibration(calibration: Calibration, changes: Changes) -> Calibration:
    """Return a copy of a calibration in which ``changes``, new values by key, replace the old values.

    Raises InputError if the copy is not a valid calibration.
    """
    table = calibration.model_dump(exclude_unset=True, exclude_none=True)
    return _changed(table, changes, calibration.text, "calibration")


def _changed(table: dict[str, Any], changes: Changes | None, text: str, origin: str | Path) -> Calibration:
    if not changes:
        return check(Calibration, table, text, origin)
    picture = table.get("picture")
    merged = {**table, **changes}
    if "picture" in changes and isinstance(picture, dict):
        replaced = _ONE_OF if _ONE_OF & changes["picture"].keys() else frozenset()
        kept = {key: value for key, value in picture.items() if key not in replaced}
        merged["picture"] = {**kept, **changes["picture"]}
    calibration = check(Calibration, merged, "", origin)
    return check(Calibration, merged, to_toml(calibration), origin)
