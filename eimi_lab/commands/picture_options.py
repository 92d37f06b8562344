"""What a person who looks at the pictures can tell, as options of the commands that look for the beam in them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from eimi_lab.process.errors import InputError


@dataclass(frozen=True)
class PictureOptions:
    """Help in finding the beam; the dataset keeps it, with its calibration."""

    clamp: Annotated[
        str | None, typer.Option(metavar="X,Y", help="px: middle of the line at which the beam leaves its clamp")
    ] = None
    axis: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="direction of the beam there, at rest: 0 right, 90 down, 180 left, -90 up"),
    ] = None
    region: Annotated[
        str | None, typer.Option(metavar="X,Y,WIDTH,HEIGHT", help="px: the part of the pictures to look at")
    ] = None
    polarity: Annotated[str | None, typer.Option(metavar="dark|bright", help="the beam, against what is beside it")] = (
        None
    )
    channel: Annotated[
        str | None,
        typer.Option(metavar="red|green|blue|grey", help="in which the beam differs most from what is beside it"),
    ] = None
    beam_colour: Annotated[
        str | None, typer.Option(metavar="R,G,B", help='the beam\'s colour from 0 to 255, such as "200,30,40"')
    ] = None

    def changes(self) -> dict[str, Any]:
        """In place of a calibration's own values (`eimi_lab.config.calibration.Changes`). Raises InputError."""
        picture = {
            "region_px": self.region and _numbers("--region", self.region, 4, whole=True),
            "polarity": self.polarity,
            "channel": self.channel,
            "beam_colour": self.beam_colour and _numbers("--beam-colour", self.beam_colour, 3),
        }
        changes: dict[str, Any] = {
            "clamp_midpoint_px": self.clamp and _numbers("--clamp", self.clamp, 2),
            "axis_angle_deg": self.axis,
            "picture": {key: value for key, value in picture.items() if value is not None} or None,
        }
        return {key: value for key, value in changes.items() if value is not None}


def _numbers(option: str, text: str, count: int, whole: bool = False) -> tuple[float, ...]:
    try:
        numbers = tuple(map(int if whole else float, text.replace(" ", "").split(",")))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        kind = "whole numbers" if whole else "numbers"
        raise InputError(f"{option} {text}: should be {count} {kind} with commas between them")
    return numbers


def ask_where(missing: tuple[str, ...], source: Path, states: Path, calibration: str, output: Path) -> InputError:
    """Write a picture from which what is missing can be read; returns the error that says so. Raises InputError."""
    import cv2

    from eimi_lab.dataset.listing import list_frames
    from eimi_lab.process.outputs import write_file
    from eimi_lab.vision.ruled_picture import ruled_picture

    listing = list_frames(source, states)
    picture = output.with_name(f"{output.stem}_where.png")
    write_file(picture, cv2.imencode(".png", ruled_picture(next(listing.images())))[1].tobytes(), force=True)
    options = " and ".join({"clamp_midpoint_px": "--clamp X,Y", "axis_angle_deg": "--axis DEG"}[key] for key in missing)
    return InputError(
        f"{calibration}: {' and '.join(missing)} is missing; {picture} is {listing.frames[0].path.name} with its "
        f"pixels counted: read off where the beam leaves its clamp and in which direction, and give {options}"
    )
