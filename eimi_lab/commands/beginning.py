"""The command `init`, which writes template files for a new beam."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force

STATES = "states.csv"


def init(
    folder: Annotated[
        Path,
        typer.Argument(help="folder in which the files are written; it may contain images already"),
    ] = Path(),
    force: Force = False,
) -> Result:
    """Write templates of the files that describe a new beam.

    The files are specimen.toml, calibration.toml and protocol.toml, which contain comments, and states.csv. You then
    fill in these files. If the folder contains images, states.csv has a row for each image.
    """
    from importlib.resources import files

    from eimi_lab.process.outputs import refuse_existing, write_file

    shipped = Path(str(files("eimi_lab.protocols"))) / "first"
    texts = {file.name: file.read_text(encoding="utf-8") for file in sorted(shipped.glob("*.toml"))}
    folder.mkdir(parents=True, exist_ok=True)
    texts[STATES] = _states_of(folder)
    for name in texts:
        refuse_existing(folder / name, force)
    for name, text in texts.items():
        write_file(folder / name, text, force)
    written = [folder / name for name in texts]
    return Result(written, {"files": written})


def _states_of(folder: Path) -> str:
    """Return the text of a states.csv (table of load steps) with a row for each image, or with one example row."""
    from eimi_drivers.cameras.image_series import natural_key
    from eimi_lab.showing.tables import csv_text
    from eimi_lab.vision.image_files import ENDINGS

    images = [file.name for file in folder.iterdir() if file.suffix.lower() in ENDINGS]
    rows = sorted(images, key=natural_key) or ["frame_0.png"]
    return csv_text([("frame", "current_A"), *((name, "") for name in rows)])
