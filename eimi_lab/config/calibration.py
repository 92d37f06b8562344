"""calibration.toml: where the beam is in the image, how large a millimetre is, and what an ampere does."""

from __future__ import annotations

import hashlib
import math
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from eimi_lab.config.reading import Document, Table, locate, parse, read_text

# TOML has lists only; in strict mode a tuple has to be told that a list will do.
Pair = Annotated[tuple[float, float], Field(strict=False)]
Triple = Annotated[tuple[float, float, float], Field(strict=False)]
Matrix = Annotated[tuple[Triple, Triple, Triple], Field(strict=False)]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]

# Lengths of the coefficient vectors that OpenCV's camera model knows (its documentation, "Camera Calibration and 3D
# Reconstruction").
DISTORTION_LENGTHS = (4, 5, 8, 12, 14)


class Uncertainty(Table):
    """Standard deviations of a calibration's numbers, each in the unit of its name."""

    pixels_per_mm: float = Field(ge=0)
    axis_angle_deg: float = Field(ge=0)
    focal_length_px: float | None = Field(default=None, ge=0)
    stand_off_mm: float | None = Field(default=None, ge=0)
    gravity_angle_deg: float | None = Field(default=None, ge=0)


class Calibration(Document):
    """Image frame: x right, y down, pixel centres at integer coordinates; angles clockwise from +x, in degrees.

    camera_matrix and distortion are OpenCV's; stand_off_mm is the distance from the lens's entrance pupil to the
    beam's middle plane, which a telecentric lens does not need. calibrated_on is the day on which the numbers were
    measured, and uncertainty how well; a file written by hand may leave them out.
    """

    pixels_per_mm: float = Field(gt=0)
    coil_constant_mT_per_A: float = Field(gt=0)
    clamp_midpoint_px: Pair
    axis_angle_deg: Angle
    gravity_angle_deg: Angle
    field_angle_deg: Angle
    camera_matrix: Matrix | None = None
    distortion: Numbers | None = None
    stand_off_mm: float | None = Field(default=None, gt=0)
    telecentric: bool = False
    calibrated_on: date | None = None
    uncertainty: Uncertainty | None = None

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
        return self

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


def load_calibration(path: str | Path) -> Calibration:
    """Read a calibration file. Raises InputError."""
    file = locate(path, "rigs")
    return parse(Calibration, read_text(file), file)
