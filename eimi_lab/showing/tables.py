"""Results as tables: HTML for a notebook, comma-separated text, and data frames if pandas is installed."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import import_module
from typing import Any


def html_table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]], notes: Sequence[str] = ()) -> str:
    """Return an HTML table with a caption and notes."""
    cells = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    titles = "".join(f"<th>{escape(name)}</th>" for name in head)
    below = "".join(f"<p>{escape(note)}</p>" for note in notes)
    return (
        f"<table><caption>{escape(caption)}</caption><thead><tr>{titles}</tr></thead>"
        f"<tbody>{cells}</tbody></table>{below}"
    )


def csv_text(rows: Iterable[Sequence[str]]) -> str:
    """Return rows of cells as comma-separated text, one line for each row."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def data_frame(rows: Sequence[Mapping[str, Any]], index: str) -> Any:
    """Return rows as a pandas.DataFrame whose index is the column `index`. Raises ImportError without pandas."""
    return installed("pandas").DataFrame(list(rows), columns=None if rows else [index]).set_index(index)


def installed(package: str) -> Any:
    """Import and return an optional package. Raises ImportError with the command that installs a missing package."""
    try:
        return import_module(package)
    except ImportError as error:
        raise ImportError(
            f"this function needs the package {package}, which is not installed: pip install {package}"
        ) from error
