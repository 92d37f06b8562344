"""Options of `eimi import` for points that another program tracked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from eimi_lab.commands.motion_options import MotionOptions
from eimi_lab.process.errors import InputError

if TYPE_CHECKING:
    from eimi_lab.config.calibration import Calibration
    from eimi_lab.dataset.tracked.axes import Placing


@dataclass(frozen=True)
class ImportOptions(MotionOptions):
    """All options of `eimi import` that describe its source: images of the beam, a motion, or tracked points."""

    format: Annotated[
        str | None,
        typer.Option(
            metavar="dice|ncorr|mudic|dltdv|tracker|deeplabcut|c3d",
            help="for tracked points: program that wrote SOURCE, or c3d for a C3D file",
        ),
    ] = None
    unit: Annotated[
        str | None,
        typer.Option(
            metavar="mm|cm|m|in|px", help="for tracked points: unit of the file; --clamp is then also in this unit"
        ),
    ] = None
    pixels_per_mm: Annotated[
        float | None, typer.Option(help="for tracked points in px without --calibration: scale in pixels per mm")
    ] = None
    sigma: Annotated[
        float | None,
        typer.Option(help="for tracked points: standard deviation of a coordinate, in the unit of the file"),
    ] = None
    rest: Annotated[
        int | None,
        typer.Option(
            help="for tracked points: number of the frame in which the beam is straight, as the tracking program "
            "counts it"
        ),
    ] = None
    plane: Annotated[
        str | None,
        typer.Option(metavar="PLANE", help="for points in three dimensions: plane in which the beam bends, such as xz"),
    ] = None

    def placing(self, calibration: Calibration | None) -> Placing:
        """Return the rule that converts coordinates of tracked points into positions in mm (x along the straight beam).

        `calibration` is the loaded calibration file; None without --calibration.

        Raises
        ------
        InputError
            If an option for images is given, or if both the calibration and an option give the clamp or the axis.
        """
        from eimi_lab.dataset.tracked.axes import Placing

        changes = self.changes()
        if "picture" in changes:
            raise InputError(
                "--region, --polarity, --channel and --beam-colour: are only for images; leave them out for tracked "
                "points"
            )
        if calibration is not None and changes:
            raise InputError(
                "--clamp and --axis: the calibration gives these values already; leave out --clamp and --axis, or "
                "--calibration"
            )
        return Placing(
            calibration=calibration,
            unit=self.unit,
            pixels_per_mm=self.pixels_per_mm,
            clamp=changes.get("clamp_midpoint_px"),
            axis_deg=changes.get("axis_angle_deg"),
            sigma=self.sigma,
            rest=self.rest,
            plane=self.plane,
        )

    def refuse_track_options(self) -> None:
        """Raise InputError if an option for tracked points is given without --format."""
        names = ("unit", "pixels_per_mm", "sigma", "rest", "plane")
        if needless := [name for name in names if getattr(self, name) is not None]:
            raise InputError(
                f"--{needless[0].replace('_', '-')}: is only for points of a tracking program; also give --format, or "
                "leave this option out"
            )
