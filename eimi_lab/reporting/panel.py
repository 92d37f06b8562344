"""A panel of the report: where it stands, its title, its text, and what it needs for them.

Each file of `eimi_lab/reporting/panels` holds one, named `PANEL`; no list of them is kept anywhere else.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from eimi_lab.reporting import panels
from eimi_lab.reporting.contents import DatasetContents, ReportContents


@dataclass(frozen=True, kw_only=True)
class _Panel:
    """place: panels stand in the order of these numbers. title, template: Jinja, filled with what `values` gives.

    Filters beside Jinja's: `figure` (of a Picture) and `table` (of a Table), which number what they are given. A panel
    without a title has no heading.
    """

    place: int
    title: str
    template: str


@dataclass(frozen=True, kw_only=True)
class ReportPanel(_Panel):
    """Once in a report, before its datasets or after them. values: None leaves the panel out.

    of_fits: it shows the fits alone and asks for no dataset, so that it can be drawn while these are simulated;
    of_intervals: it shows the intervals of errors, which are known last.
    """

    values: Callable[[ReportContents], Mapping[str, Any] | None]
    after_datasets: bool = False
    of_fits: bool = False
    of_intervals: bool = False


@dataclass(frozen=True, kw_only=True)
class DatasetPanel(_Panel):
    """Once for each dataset. values: None leaves the panel out."""

    values: Callable[[DatasetContents], Mapping[str, Any] | None]


def every_panel() -> list[ReportPanel | DatasetPanel]:
    """The panels of all files in the folder, in their places."""
    modules = [import_module(f"{panels.__name__}.{found.name}") for found in pkgutil.iter_modules(panels.__path__)]
    return sorted((module.PANEL for module in modules), key=lambda panel: panel.place)
