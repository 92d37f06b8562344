"""calibration.toml: where the beam is in the image, how large a millimetre is, and what an ampere does."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_lab.config.toml import Document, Table, check, locate, parse_table, read_text, to_toml
from eimi_lab.config.uncertainty import OfCalibration, check_sizes, keys_of, stated_of

# TOML has lists only; in strict mode a tuple has to be told that a list will do.
Pair = Annotated[tuple[float, float], Field(strict=False)]
Triple = Annotated[tuple[float, float, float], Field(strict=False)]
Quad = Annotated[tuple[int, int, int, int], Field(strict=False)]
Matrix = Annotated[tuple[Triple, Triple, Triple], Field(strict=False)]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]

# Lengths of the coefficient vectors that OpenCV's camera model knows (its documentation, "Camera Calibration and 3D
# Reconstruction").
DISTORTION_LENGTHS = (4, 5, 8, 12, 14)


class Picture(Table):
    """What a person says of the pictures, where the search for the beam would else have to find out by itself.

    region_px: left, top, width and height of the part of the picture in which the beam is; what is outside is not
    looked at. polarity: whether the beam is darker or brighter than what is beside it. channel: the colour in which it
    differs most. beam_colour: its own, as red, green and blue from 0 to 255.
    """

    region_px: Quad | None = None
    """Left, top, width and height: what is outside is not looked at."""
    polarity: Literal["dark", "bright"] | None = None
    """The beam against what is beside it."""
    channel: Literal["red", "green", "blue", "grey"] | None = None
    """The colour in which beam and surroundings differ most."""
    beam_colour: Triple | None = None
    """The beam's own red, green and blue, 0 to 255; in place of channel."""

    @model_validator(mode="after")
    def _sensible(self) -> Picture:
        if self.region_px is not None and (min(self.region_px[:2]) < 0 or min(self.region_px[2:]) < 1):
            raise ValueError(
                f"region_px = {list(self.region_px)} should be left and top, 0 or more, and width and height, 1 or more"
            )
        if self.beam_colour is not None and not all(0 <= part <= 255 for part in self.beam_colour):
            raise ValueError(f"beam_colour = {list(self.beam_colour)} should be red, green and blue from 0 to 255")
        if self.channel is not None and self.beam_colour is not None:
            raise ValueError("has both channel and beam_colour; give one of them")
        return self


class Calibration(Document):
    """Image frame: x right, y down, pixel centres at integer coordinates; angles clockwise from +x, in degrees.

    gravity = false switches the weight off, for a beam that bends in a horizontal plane or whose places are measured
    from those under its weight; gravity_angle_deg is then no more than the direction of tip forces that have none of
    their own. camera_matrix and distortion are OpenCV's; stand_off_mm is the distance from the lens's entrance pupil to
    the beam's middle plane, which a telecentric lens does not need. calibrated_on is the day on which the numbers were
    measured, and uncertainty how well, as standard uncertainties under the same keys (clamp_midpoint_px in either
    direction; focal_length_px beside them); a file written by hand may leave them out. picture helps to find the beam.
    """

    pixels_per_mm: float = Field(gt=0)
    """At the beam's middle plane."""
    coil_constant_mT_per_A: float = Field(gt=0)
    """At the magnet, from a Hall probe; 1.0 where there is no coil."""
    clamp_midpoint_px: Pair
    """Middle of the line where the beam leaves its clamp; x to the right, y down."""
    axis_angle_deg: Angle
    """Of the undeformed beam, away from the clamp; clockwise from the image's +x, so that 90 hangs down."""
    gravity_angle_deg: Angle
    """Where down is; 90 where it is down in the picture."""
    gravity: bool = True
    """false for a beam that bends in a horizontal plane: the angle is then only the direction of tip forces."""
    field_angle_deg: Angle
    """Direction of the field of a positive current, across the beam."""
    camera_matrix: Matrix | None = None
    """OpenCV's, with its distortion."""
    distortion: Numbers | None = None
    """OpenCV's, 4, 5, 8, 12 or 14 numbers."""
    stand_off_mm: float | None = Field(default=None, gt=0)
    """From the lens's entrance pupil to the beam's middle plane."""
    telecentric: bool = False
    """true for a telecentric lens, which has no stand-off."""
    calibrated_on: date | None = None
    """The day on which the numbers were measured."""
    uncertainty: OfCalibration | None = None
    """Standard uncertainties under the keys of the values. 0 is exact, absent is not known."""
    picture: Picture | None = None
    """Help where the search for the beam goes wrong."""

    @model_validator(mode="after")
    def _consistent(self) -> Calibration:
        across = math.sin(math.radians(self.field_angle_deg - self.axis_angle_deg))
        if abs(across) < 0.5:
            raise ValueError(
                f"field_angle_deg = {self.field_angle_deg:g} must lie across the beam, at least 30 degrees from "
                f"axis_angle_deg = {self.axis_angle_deg:g}"
            )
        if (self.camera_matrix is None) != (self.distortion is None):
            raise ValueError("camera_matrix and distortion belong together: give both or neither")
        if self.distortion is not None and len(self.distortion) not in DISTORTION_LENGTHS:
            raise ValueError(f"distortion has {len(self.distortion)} numbers; OpenCV has 4, 5, 8, 12 or 14")
        if self.telecentric and self.stand_off_mm is not None:
            raise ValueError(f"stand_off_mm = {self.stand_off_mm:g} has no meaning beside telecentric = true")
        sizes = {key: (key, getattr(self, key)) for key in ("pixels_per_mm", "coil_constant_mT_per_A", "stand_off_mm")}
        check_sizes(self.uncertainty or {}, sizes, largest=0.5)  # half: a lens from a few views tells its place badly
        return self

    def keys_that_count(self) -> tuple[str, ...]:
        """Keys whose values this calibration has."""
        return tuple(key for key in keys_of("calibration") if getattr(self, key) is not None)

    def stated(self) -> tuple[StatedSource, ...]:
        """How uncertain its numbers are. Those of one calibration err together, and those of one coil constant."""
        coil = f"coil of {self.coil_constant_mT_per_A:g} mT/A"
        numbers = self.model_dump_json(exclude={"picture"})
        own = f"calibration {hashlib.sha256(numbers.encode()).hexdigest()[:16]}"
        in_units = {
            "pixels_per_mm": 1 / self.pixels_per_mm,
            "coil_constant_mT_per_A": 1 / self.coil_constant_mT_per_A,
            "clamp_midpoint_px": 1 / self.pixels_per_mm,
        }
        return stated_of("calibration", self.uncertainty, lambda key: coil if key.startswith("coil") else own, in_units)

    @property
    def digest(self) -> str:
        """SHA-256 of the numbers, whatever the file's layout and comments."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()

    def age_days(self, taken: datetime) -> float | None:
        """Days from the calibration to a moment; None where its day is not known."""
        if self.calibrated_on is None:
            return None
        begin = datetime(self.calibrated_on.year, self.calibrated_on.month, self.calibrated_on.day, tzinfo=UTC)
        return max(0.0, (taken - begin).total_seconds() / 86400.0)


PLACES = ("clamp_midpoint_px", "axis_angle_deg")
"""What only a person who looks at the pictures can tell, who may have left it out."""

Changes = Mapping[str, Any]
"""Values in place of a calibration's own, by its keys; under "picture" a table of such values."""


_ONE_OF = frozenset({"channel", "beam_colour"})  # the one that is given anew takes the place of the other


def load_calibration(path: str | Path, changes: Changes | None = None) -> Calibration:
    """Read a calibration file, with values in place of its own. Raises InputError."""
    file = locate(path, "rigs")
    text = read_text(file)
    return _changed(parse_table(text, file), changes, text, file)


def missing_places(path: str | Path, changes: Changes) -> tuple[str, ...]:
    """Which of `PLACES` neither a file nor the changes tell. Raises InputError for whatever else is wrong with them."""
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
    """A calibration with other values, which its text has too. Raises InputError."""
    table = calibration.model_dump(exclude_unset=True, exclude_none=True)
    return _changed(table, changes, calibration.text, "calibration")


def _changed(table: dict[str, Any], changes: Changes | None, text: str, origin: str | Path) -> Calibration:
    if not changes:
        return check(Calibration, table, text, origin)
    before = table.get("picture")
    merged = {**table, **changes}
    if "picture" in changes and isinstance(before, dict):
        kept = {
            key: value for key, value in before.items() if key not in _ONE_OF or not _ONE_OF & changes["picture"].keys()
        }
        merged["picture"] = {**kept, **changes["picture"]}
    calibration = check(Calibration, merged, "", origin)
    return check(Calibration, merged, to_toml(calibration), origin)
