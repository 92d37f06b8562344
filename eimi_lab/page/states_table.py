"""Read the table states.csv in a folder of images, and write it with new values in one column."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path

from eimi_lab.config.csv_tables import read_cells
from eimi_lab.dataset.listing import images_named
from eimi_lab.dataset.state_loads import LOAD_COLUMNS
from eimi_lab.process.errors import InputError
from eimi_lab.showing.tables import csv_text
from eimi_lab.vision.image_files import find_images

STATES = "states.csv"


def written_states(folder: Path) -> dict[str, dict[str, str]]:
    """Return the rows of states.csv by the names of their images; a row is a text for each column.

    Rows name images as in `eimi import`: by the name with or without its ending, or by the number at its end. Rows that
    name no image or several images are left out. Without the file, the result is empty.

    Raises
    ------
    InputError
        If the file cannot be read, or if it is not CSV.
    """
    file = folder / STATES
    if not file.is_file():
        return {}
    numbered, separator = read_cells(file)
    header, *body = [cells for _, cells in numbered] or [[]]
    images: list[Path] = []
    with suppress(InputError):  # the images may follow later
        images = find_images(folder)
    rows = {}
    for cells in body:
        row = dict(zip(header, cells, strict=False))
        if separator != ",":  # then numbers may have a decimal comma
            row |= {column: cell.replace(",", ".") for column, cell in row.items() if column != "frame"}
        named = images_named(row.get("frame", ""), images)
        if len(named) == 1:
            rows[named[0].name] = row
    return rows


def states_text(folder: Path, column: str, values: Mapping[str, str], without: Collection[str] = ()) -> str:
    """Return the text of states.csv with new values in one column. Other columns that are known keep their values.

    Parameters
    ----------
    folder
        The folder of images, with or without states.csv.
    column
        The name of the column, such as "current_A".
    values
        Its values, by the names of the images. Other images are left out.
    without
        Columns that are left out.

    Raises
    ------
    InputError
        If an existing file cannot be read.
    """
    old = written_states(folder)
    rows = [{**old.get(name, {}), "frame": name, column: value} for name, value in values.items()]
    columns = dict.fromkeys(["frame", column, *(key for row in rows for key in row)])
    kept = [key for key in columns if key in ("frame", *LOAD_COLUMNS) and key not in without]
    return csv_text([kept, *([row.get(key, "") for key in kept] for row in rows)])
