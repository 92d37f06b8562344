"""calibration.toml: where the beam is in the image, how large a millimetre is, and what an ampere does."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from eimi_lab.config.reading import Document, locate, parse, read_text

# TOML has lists only; in strict mode a tuple has to be told that a list will do.
Pair = Annotated[tuple[float, float], Field(strict=False)]
Triple = Annotated[tuple[float, float, float], Field(strict=False)]
Matrix = Annotated[tuple[Triple, Triple, Triple], Field(strict=False)]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]

# Lengths of the coefficient vectors that OpenCV's camera model knows (its documentation, "Camera Calibration and 3D
# Reconstruction").
DISTORTION_LENGTHS = (4, 5, 8, 12, 14)


class Calibration(Document):
    """Image frame: x right, y down, pixel centres at integer coordinates; angles clockwise from +x, in degrees.

    camera_matrix and distortion are OpenCV's; stand_off_mm is the distance from the lens's entrance pupil to the
    beam's middle plane, which a telecentric lens does not need.
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


def load_calibration(path: str | Path) -> Calibration:
    """Read a calibration file. Raises InputError."""
    file = locate(path, "rigs")
    return parse(Calibration, read_text(file), file)
