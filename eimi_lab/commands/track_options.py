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
    """Options for finding the beam, and facts that the file of a tracking program does not state."""

    format: Annotated[
        str | None,
        typer.Option(metavar="dice|ncorr|mudic|dltdv|tracker|deeplabcut|c3d", help="format of the tracked points"),
    ] = None
    unit: Annotated[
        str | None, typer.Option(metavar="mm|cm|m|in|px", help="unit of the tracked points, and then of --clamp")
    ] = None
    pixels_per_mm: Annotated[
        float | None, typer.Option(help="scale of tracked points in px, if --calibration is not given")
    ] = None
    sigma: Annotated[
        float | None, typer.Option(help="standard deviation of a tracked coordinate, in the unit of the file")
    ] = None
    rest: Annotated[int | None, typer.Option(help="number of the frame in which the tracked beam is straight")] = None
    plane: Annotated[
        str | None, typer.Option(metavar="PLANE", help="for points in three dimensions: plane of bending, such as xz")
    ] = None

    def placing(self, calibration: Calibration | None) -> Placing:
        """Return how tracked points are placed in the beam frame.

        Raises
        ------
        InputError
            If an option was given that concerns images, or that the calibration determines.
        """
        from eimi_lab.dataset.tracked.axes import Placing

        changes = self.changes()
        if "picture" in changes:
            raise InputError(
                "--region, --polarity, --channel and --beam-colour: are for images, not for tracked points"
            )
        if calibration is not None and changes:
            raise InputError("--clamp, --axis: the calibration states them; leave out --calibration or these options")
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
                f"--{needless[0].replace('_', '-')}: is for points that another program tracked; give --format, too"
            )
