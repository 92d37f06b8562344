"""The command with which a person begins: files to fill in."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eimi_lab.commands.result import Result
from eimi_lab.commands.shared_options import Force

STATES = "states.csv"


def init(
    folder: Annotated[Path, typer.Argument(help="where to put them; with pictures in it, or none")] = Path(),
    force: Force = False,
) -> Result:
    """Write commented specimen.toml, calibration.toml, protocol.toml and states.csv, to be filled in."""
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
    """A row for each picture of the folder, whose currents are to be filled in; else a row to begin with."""
    from eimi_drivers.cameras.image_series import natural_key
    from eimi_lab.vision.image_files import ENDINGS

    pictures = [file.name for file in folder.iterdir() if file.suffix.lower() in ENDINGS]
    rows = sorted(pictures, key=natural_key) or ["frame_0.png"]
    return "frame,current_A\n" + "".join(f"{name},\n" for name in rows)
