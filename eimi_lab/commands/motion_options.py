"""Options of `eimi import` for the motion of a beam: a ring-down (a free vibration) or creep."""

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
    """Options of `eimi import` for a ring-down (free vibration of the beam) or creep under a constant load."""

    ring_down: Annotated[
        bool,
        typer.Option(
            "--ring-down", help="SOURCE shows a beam that swings freely after a short push (flick) or a release"
        ),
    ] = False
    creep: Annotated[bool, typer.Option("--creep", help="SOURCE shows a beam that creeps under a constant load")] = (
        False
    )
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="HZ",
            help="for --ring-down or --creep: frames per second of the recording, if the file does not contain this "
            "rate or is played in slow motion",
        ),
    ] = None
    released: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="for --ring-down or --creep: time in the file, in seconds, at which the beam was released or its load "
            "changed",
            show_default="time of the last frame with at least 97 % of the largest deflection",
        ),
    ] = None
    hanging: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="for --ring-down or --creep: weight that hangs at the tip during the motion, in newtons; without "
            "--removed, the program assumes that the creep begins when this weight is hung on the beam",
        ),
    ] = None
    removed: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="for --ring-down or --creep: weight in newtons that was taken from the tip at the time of --released",
        ),
    ] = None
    exposure: Annotated[
        float | None, typer.Option(metavar="S", help="for --ring-down or --creep: exposure time of a frame, in seconds")
    ] = None
    row_time: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="for --ring-down or --creep: time between the exposures of two neighbouring rows of the sensor, in "
            "seconds (rolling shutter)",
        ),
    ] = None

    def motion_facts(self) -> MotionFacts | None:
        """Return the values of the options for a motion; None if neither --ring-down nor --creep is given.

        Raises
        ------
        InputError
            If the options contradict each other, or if a value is impossible.
        """
        from eimi_lab.dataset.moving.motion_facts import MotionFacts

        values = {name: getattr(self, name) for name in (*_POSITIVE, *_NOT_NEGATIVE, "released", "row_time")}
        given = {name: value for name, value in values.items() if value is not None}
        if self.ring_down and self.creep:
            raise InputError(
                "--ring-down and --creep: give only one of them; import the other motion into a second dataset"
            )
        if not (self.ring_down or self.creep):
            if given:
                raise InputError(
                    f"--{next(iter(given)).replace('_', '-')}: is only for a motion; also give --ring-down or --creep"
                )
            return None
        for name, value in given.items():
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
