"""Options of `eimi import` for the motion of a beam: a ring-down, or creep."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from eimi_lab.commands.picture_options import PictureOptions
from eimi_lab.process.errors import InputError

if TYPE_CHECKING:
    from eimi_lab.dataset.moving.motion_facts import MotionFacts

_POSITIVE = ("rate", "exposure")
_NOT_NEGATIVE = ("hanging", "removed")


@dataclass(frozen=True)
class MotionOptions(PictureOptions):
    """Facts about the recording of a motion that are in no file."""

    ring_down: Annotated[
        bool, typer.Option("--ring-down", help="the source shows a beam that swings freely after a flick or a release")
    ] = False
    creep: Annotated[
        bool, typer.Option("--creep", help="the source shows a beam that creeps under a load that no longer changes")
    ] = False
    rate: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="for a motion: frames per second, if the file states none or plays slowly"),
    ] = None
    released: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="for a motion: time in the file at which the beam was released or its load changed",
            show_default="last frame within 3 % of the greatest deflection",
        ),
    ] = None
    hanging: Annotated[
        float | None, typer.Option(metavar="N", help="for a motion: weight that hangs at the tip, in newtons")
    ] = None
    removed: Annotated[
        float | None,
        typer.Option(metavar="N", help="for a motion: weight taken from the tip at the release, in newtons"),
    ] = None
    exposure: Annotated[float | None, typer.Option(metavar="S", help="for a motion: exposure time of a frame")] = None
    row_time: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="for a motion: time from one row of the picture to the next below (rolling shutter)"
        ),
    ] = None

    def motion_facts(self) -> MotionFacts | None:
        """Return the facts of a motion; None if the source shows states.

        Raises
        ------
        InputError
            If an option of a motion is given without --ring-down or --creep, or if its value is impossible.
        """
        from eimi_lab.dataset.moving.motion_facts import MotionFacts

        values = {name: getattr(self, name) for name in (*_POSITIVE, *_NOT_NEGATIVE, "released", "row_time")}
        stated = {name: value for name, value in values.items() if value is not None}
        if self.ring_down and self.creep:
            raise InputError("--ring-down and --creep: give one of them; import the other motion into its own dataset")
        if not (self.ring_down or self.creep):
            if stated:
                raise InputError(
                    f"--{next(iter(stated)).replace('_', '-')}: is for a motion; give --ring-down or --creep, too"
                )
            return None
        for name, value in stated.items():
            low = 0.0 if name in _POSITIVE else -math.inf
            if not math.isfinite(value) or value <= low or (name in _NOT_NEGATIVE and value < 0):
                wanted = "greater than 0" if name in _POSITIVE else "0 or more"
                raise InputError(f"--{name.replace('_', '-')} {value:g}: should be {wanted}")
        return MotionFacts(
            kind="ring_down" if self.ring_down else "creep",
            rate_Hz=self.rate,
            released_s=self.released,
            hanging_N=self.hanging or 0.0,
            removed_N=self.removed or 0.0,
            exposure_s=self.exposure,
            row_time_s=self.row_time or 0.0,
        )
