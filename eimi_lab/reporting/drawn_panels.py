"""Draw each panel (section) of a report as soon as its contents are available."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from eimi_lab.reporting.contents import DatasetContents, ReportContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import DatasetPanel, ReportPanel, all_panels

AnyPanel = ReportPanel | DatasetPanel
Values = Mapping[str, Any] | None
"""The values that fill the template of a panel; None omits the panel."""


class DrawnPanels:
    """The drawn panels (sections) of a report, with the values for their templates."""

    def __init__(self) -> None:
        self._report: dict[ReportPanel, Values] = {}
        self._datasets: dict[str, list[tuple[AnyPanel, Values]]] = {}

    @cached_property
    def _panels(self) -> list[AnyPanel]:
        return all_panels()  # imports matplotlib, which is slow: wait until the first panel is drawn

    @property
    def _of_report(self) -> list[ReportPanel]:
        return [panel for panel in self._panels if isinstance(panel, ReportPanel)]

    def fits(self, report: ReportContents) -> None:
        """Draw the panels (sections of the report) that need only the fits."""
        self._draw(report, [panel for panel in self._of_report if panel.of_fits])

    def dataset(self, shown: DatasetContents) -> None:
        """Draw the panels (sections of the report) that show only this dataset."""
        self._datasets[shown.name] = [
            (panel, _drawn(panel, shown)) for panel in self._panels if isinstance(panel, DatasetPanel)
        ]

    def datasets(self, report: ReportContents) -> None:
        """Draw the panels (sections) of the report that do not need the 95 % interval of the mean error of each law."""
        self._draw(report, [panel for panel in self._of_report if not panel.of_intervals])

    def report(self, report: ReportContents) -> None:
        """Draw the panels (sections) of a report that are not drawn yet."""
        self._draw(report, self._of_report)

    def summary(self) -> list[tuple[AnyPanel, Values]]:
        """Return the panels (sections) of the first pages with the values for their templates."""
        return [(panel, self._report[panel]) for panel in self._of_report if panel.summary]

    def of_report(self, *, after_datasets: bool) -> list[tuple[AnyPanel, Values]]:
        """Return the panels (sections) that stand before or after the panels of the datasets, with their values."""
        panels = [panel for panel in self._of_report if panel.after_datasets == after_datasets and not panel.summary]
        return [(panel, self._report[panel]) for panel in panels]

    def of_dataset(self, shown: DatasetContents) -> list[tuple[AnyPanel, Values]]:
        """Return the panels (sections) that show a dataset, with the values for their templates."""
        return self._datasets[shown.name]

    def _draw(self, report: ReportContents, panels: Sequence[ReportPanel]) -> None:
        for panel in (panel for panel in panels if panel not in self._report):
            self._report[panel] = _drawn(panel, report)


def _drawn(panel: AnyPanel, contents: Any) -> Values:
    """Return the values for the template of a panel (section of a report), with encoded pictures."""
    from eimi_lab.showing.drawing import styled

    values: Values = styled(panel.values)(contents)
    for value in (values or {}).values():
        if isinstance(value, Picture):
            _ = value.embedded
    return values
