"""The properties of a panel (a section of the report): place, title, template, and the function that fills it.

Each module of `eimi_lab.reporting.panels` defines one panel, named `PANEL`.
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
    """The fields that all panels (sections of a report) have.

    Attributes
    ----------
    place : int
        Panels are shown in increasing order of this number.
    title, template : str
        Jinja templates, filled with the result of `values`. The filters `figure` and `table` insert a numbered figure
        or table.
    """

    place: int
    title: str
    template: str


@dataclass(frozen=True, kw_only=True)
class ReportPanel(_Panel):
    """A panel (section) that occurs once in a report.

    Attributes
    ----------
    values : callable
        Returns the values for the template, or None to omit the panel.
    summary : bool
        Whether the panel belongs to the first pages; otherwise it is in the appendix.
    after_datasets : bool
        Whether the panel follows the sections of the datasets.
    of_fits : bool
        Whether the panel needs only the results of the fits.
    of_intervals : bool
        Whether the panel needs the 95 % intervals of the mean error of each law.
    """

    values: Callable[[ReportContents], Mapping[str, Any] | None]
    summary: bool = False
    after_datasets: bool = False
    of_fits: bool = False
    of_intervals: bool = False


@dataclass(frozen=True, kw_only=True)
class DatasetPanel(_Panel):
    """A panel (section) that occurs once for each dataset of a report.

    The function `values` returns the values for the template, or None to omit the panel.
    """

    values: Callable[[DatasetContents], Mapping[str, Any] | None]


def all_panels() -> list[ReportPanel | DatasetPanel]:
    """Return the panels (sections) of all modules in the folder `panels`, in the order of the report."""
    modules = [import_module(f"{panels.__name__}.{module.name}") for module in pkgutil.iter_modules(panels.__path__)]
    return sorted((module.PANEL for module in modules), key=lambda panel: panel.place)
