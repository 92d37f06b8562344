"""What the panels of a report show, drawn as soon as that is known: of fits, of each dataset, of all, of intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from eimi_lab.reporting.contents import DatasetContents, ReportContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import DatasetPanel, ReportPanel, every_panel

AnyPanel = ReportPanel | DatasetPanel
Values = Mapping[str, Any] | None
"""What fills a panel's template; None leaves the panel out."""


class DrawnPanels:
    """Each panel is drawn once."""

    def __init__(self) -> None:
        self._report: dict[ReportPanel, Values] = {}
        self._datasets: dict[str, list[tuple[AnyPanel, Values]]] = {}

    @cached_property
    def _panels(self) -> list[AnyPanel]:
        return every_panel()  # with matplotlib, which is slow to import: not before the first is drawn

    @property
    def _of_report(self) -> list[ReportPanel]:
        return [panel for panel in self._panels if isinstance(panel, ReportPanel)]

    def fits(self, report: ReportContents) -> None:
        """Draw what shows the fits of a report alone."""
        self._draw(report, [panel for panel in self._of_report if panel.of_fits])

    def dataset(self, shown: DatasetContents) -> None:
        """Draw the panels of a dataset."""
        self._datasets[shown.name] = [
            (panel, _drawn(panel, shown)) for panel in self._panels if isinstance(panel, DatasetPanel)
        ]

    def datasets(self, report: ReportContents) -> None:
        """Draw what shows all datasets, but for intervals of errors."""
        self._draw(report, [panel for panel in self._of_report if not panel.of_intervals])

    def report(self, report: ReportContents) -> None:
        """Draw what is left."""
        self._draw(report, self._of_report)

    def of_report(self, *, after_datasets: bool) -> list[tuple[AnyPanel, Values]]:
        """In their places before the datasets or after them."""
        own = [panel for panel in self._of_report if panel.after_datasets == after_datasets]
        return [(panel, self._report[panel]) for panel in own]

    def of_dataset(self, shown: DatasetContents) -> list[tuple[AnyPanel, Values]]:
        """In their places."""
        return self._datasets[shown.name]

    def _draw(self, report: ReportContents, panels: Sequence[ReportPanel]) -> None:
        for panel in (panel for panel in panels if panel not in self._report):
            self._report[panel] = _drawn(panel, report)


def _drawn(panel: AnyPanel, contents: Any) -> Values:
    from eimi_lab.showing.drawing import styled

    values: Values = styled(panel.values)(contents)
    for value in (values or {}).values():
        if isinstance(value, Picture):
            _ = value.embedded
    return values
