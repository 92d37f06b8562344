"""Options with which the user helps the program to find the beam in images."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from eimi_lab.process.errors import InputError


@dataclass(frozen=True)
class PictureOptions:
    """Options on the position and the appearance of the beam in images."""

    clamp: Annotated[
        str | None, typer.Option(metavar="X,Y", help="middle of the line at which the beam leaves the clamp, in px")
    ] = None
    axis: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="direction in which the straight beam leaves the clamp: 0 right, 90 down, 180 left, -90 up",
        ),
    ] = None
    region: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,WIDTH,HEIGHT",
            help="part of the image in which the program searches for the beam: left, top, width and height, in px",
        ),
    ] = None
    polarity: Annotated[
        str | None,
        typer.Option(metavar="dark|bright", help="whether the beam is darker or brighter than its background"),
    ] = None
    channel: Annotated[
        str | None,
        typer.Option(
            metavar="red|green|blue|grey",
            help="colour channel of the image in which the beam differs most from its background",
        ),
    ] = None
    beam_colour: Annotated[
        str | None,
        typer.Option(metavar="R,G,B", help="colour of the beam: red, green and blue, each from 0 to 255"),
    ] = None
    along: Annotated[
        str | None,
        typer.Option(
            metavar="'X,Y X,Y ...'",
            help="two to six points on the centre line of the beam in the first image, from the clamp to the tip, in "
            "px; for a motion, in the image of the beam at rest",
        ),
    ] = None

    def changes(self) -> dict[str, Any]:
        """Return the calibration values that the user gave with these options, by their keys in calibration.toml.

        Raises
        ------
        InputError
            If the text of an option contains too few or too many numbers.
        """
        picture = {
            "region_px": self.region and _numbers("--region", self.region, 4, whole=True),
            "polarity": self.polarity,
            "channel": self.channel,
            "beam_colour": self.beam_colour and _numbers("--beam-colour", self.beam_colour, 3),
            "along_px": None if self.along is None else _points("--along", self.along),
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
        raise InputError(f"{option} {text}: should be {count} {kind}, separated by commas")
    return numbers


def _points(option: str, text: str) -> tuple[tuple[float, ...], ...]:
    texts = re.sub(r"\s*,\s*", ",", text.strip()).split()
    try:
        points = tuple(tuple(map(float, point.split(","))) for point in texts)
    except ValueError:
        points = ()
    if not 2 <= len(points) <= 6 or any(len(point) != 2 for point in points):
        raise InputError(f"{option} {text!r}: should be two to six points X,Y, such as '120,80 118,160 101,240'")
    return points


def ask_where(
    missing: tuple[str, ...], source: Path, states: Path, calibration: str, output: Path, every: int | None = None
) -> InputError:
    """Return an error that asks the user to read the position or the direction of the beam from an image.

    The first image is written next to the dataset, with rulers in pixels.

    Parameters
    ----------
    missing : tuple of str
        Keys that are missing in the calibration: ``clamp_midpoint_px``, ``axis_angle_deg`` or both.
    source, states : Path
        The images or the video, and states.csv.
    calibration : str
        Name of the calibration file, for the message.
    output : Path
        The dataset that the command will write.
    every : int or None
        The number n if only every n-th frame of a video is imported; otherwise None.

    Returns
    -------
    InputError
        The error, which the caller raises.

    Raises
    ------
    InputError
        If the images cannot be read, or if the image with rulers cannot be written.
    """
    import cv2

    from eimi_lab.dataset.listing import list_frames
    from eimi_lab.process.outputs import write_file
    from eimi_lab.vision.ruled_picture import ruled_picture

    listing = list_frames(source, states, every)
    picture = output.with_name(f"{output.stem}_where.png")
    write_file(picture, cv2.imencode(".png", ruled_picture(next(listing.images())))[1].tobytes(), force=True)
    options = " and ".join({"clamp_midpoint_px": "--clamp X,Y", "axis_angle_deg": "--axis DEG"}[key] for key in missing)
    return InputError(
        f"{calibration}: {' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing; {picture} shows "
        f"{listing.frames[0].path.name} with rulers in px: read where the beam leaves the clamp, and in which "
        f"direction, and give {options}"
    )
