"""What a person has to say of points that another tool tracked, as options of `eimi import`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from eimi_lab.commands.picture_options import PictureOptions
from eimi_lab.process.errors import InputError

if TYPE_CHECKING:
    from eimi_lab.config.calibration import Calibration
    from eimi_lab.dataset.tracked.axes import Placing


@dataclass(frozen=True)
class ImportOptions(PictureOptions):
    """Help in finding the beam, and what a tracking tool's file does not say of itself."""

    format: Annotated[
        str | None, typer.Option(metavar="dice|ncorr|mudic|dltdv|tracker|deeplabcut|c3d", help="of tracked points")
    ] = None
    unit: Annotated[
        str | None, typer.Option(metavar="mm|cm|m|in|px", help="of tracked points; --clamp and --axis are in it then")
    ] = None
    pixels_per_mm: Annotated[float | None, typer.Option(help="of tracked points in px without --calibration")] = None
    sigma: Annotated[float | None, typer.Option(help="standard deviation of a tracked place, in the file's unit")] = (
        None
    )
    rest: Annotated[int | None, typer.Option(help="frame in which the tracked beam hangs straight")] = None
    plane: Annotated[str | None, typer.Option(help="of points in three dimensions: that of bending, such as xz")] = None

    def placing(self, calibration: Calibration | None) -> Placing:
        """What is said of tracked points. Raises InputError for help with pictures, of which there are none."""
        from eimi_lab.dataset.tracked.axes import Placing

        changes = self.changes()
        if "picture" in changes:
            raise InputError("--region, --polarity, --channel and --beam-colour: belong to pictures, not to points")
        if calibration is not None and changes:
            raise InputError("--clamp, --axis: the calibration tells them; give one or the other")
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
        """Raise InputError where one of them is given without a format."""
        own = ("unit", "pixels_per_mm", "sigma", "rest", "plane")
        if given := [name for name in own if getattr(self, name) is not None]:
            raise InputError(
                f"--{given[0].replace('_', '-')}: goes with --format, for points that another tool tracked"
            )
