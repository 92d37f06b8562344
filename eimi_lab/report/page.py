"""The report's page: one HTML file with everything in it, and its figures and tables as files of their own."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, ExitStack, nullcontext
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, select_autoescape
from markupsafe import Markup

from eimi_lab.dataset.reading import open_dataset
from eimi_lab.drawing import styled
from eimi_lab.outputs import whole_file, whole_folder, write_whole
from eimi_lab.progress import silent
from eimi_lab.report.contents import DatasetContents, ReportContents, short_names
from eimi_lab.report.elements import Elements
from eimi_lab.report.panel import DatasetPanel, ReportPanel, every_panel
from eimi_lab.report.shown import leading, read_shown
from eimi_lab.report.simulated import simulate_on_each

Progress = Callable[[str, int], AbstractContextManager[Callable[[str], None]]]


def write_report(
    output: Path,
    datasets: Sequence[Path],
    fits: Sequence[Path],
    *,
    flagged: bool = False,
    force: bool = False,
    assets: Path | None = None,
    command: str = "",
    executor: Callable[[], AbstractContextManager[Executor]] | None = None,
    progress: Progress = lambda title, total: nullcontext(silent),
) -> None:
    """Write the report on datasets and on the fits of fits.json files, laid over them. Raises InputError.

    assets: a folder for each figure as SVG and PDF, each table as CSV and LaTeX. command: the line that asked for it.
    executor: whose workers share the datasets.
    """
    every = read_shown(fits)
    steps = len(datasets) * (len(every) + 1) + sum(isinstance(panel, ReportPanel) for panel in every_panel())
    with ExitStack() as stack:
        folder = stack.enter_context(whole_folder(assets, force)) if assets is not None else None
        told = stack.enter_context(progress("report", steps))
        shown = []
        found = simulate_on_each(datasets, every, flagged, told, executor)
        for path, name, (evidence, laid_over, validations) in zip(datasets, short_names(datasets), found, strict=True):
            dataset = stack.enter_context(open_dataset(path))
            stands_for = leading(every, evidence.sha256)
            shown.append(DatasetContents(dataset, evidence, tuple(laid_over), tuple(validations), name, stands_for))
        page, elements = render(ReportContents(every, tuple(shown), datetime.now().astimezone(), command), told)
        if folder is not None:
            for name, content in elements.files().items():
                write_whole(folder / name, content)
    with whole_file(output, force) as temporary:
        temporary.write_text(page, encoding="utf-8")


@styled
def render(report: ReportContents, told: Callable[[str], None] = silent) -> tuple[str, Elements]:
    """The page as HTML, with every panel that has something to show, and its figures and tables."""
    elements = Elements()
    environment = _environment(elements)
    panels = every_panel()
    above = [panel for panel in panels if isinstance(panel, ReportPanel) and not panel.after_datasets]
    below = [panel for panel in panels if isinstance(panel, ReportPanel) and panel.after_datasets]
    of_dataset = [panel for panel in panels if isinstance(panel, DatasetPanel)]
    template = environment.from_string((files("eimi_lab.report") / "page.html").read_text(encoding="utf-8"))
    page = template.render(
        title=_title(report),
        report=report,
        before=_filled(environment, above, report, told),
        sections=[
            {"name": shown.name, "slug": f"dataset-{number}", "panels": _filled(environment, of_dataset, shown, told)}
            for number, shown in enumerate(report.datasets, 1)
        ],
        after=_filled(environment, below, report, told),
    )
    return page, elements


def _environment(elements: Elements) -> Environment:
    environment = Environment(autoescape=select_autoescape(default=True), trim_blocks=True, lstrip_blocks=True)
    environment.filters["figure"] = elements.figure
    environment.filters["table"] = elements.table
    return environment


def _title(report: ReportContents) -> str:
    names = ", ".join(shown.name for shown in report.datasets)
    beams = [shown.dataset.specimen.specimen for shown in report.datasets]
    materials = ", ".join(dict.fromkeys(beam.material for beam in beams))
    if not report.every:
        return f"Measured: {materials} ({names})"
    return f"Material identified: {materials}" if materials else "Material identified"


def _filled(
    environment: Environment, panels: Iterable[Any], contents: Any, told: Callable[[str], None]
) -> list[dict[str, str]]:
    """Title, anchor and body of each panel that has something to show."""
    filled = []
    for panel in panels:
        values = panel.values(contents)
        if values is not None:
            title, body = (
                Markup(environment.from_string(text).render(values)) for text in (panel.title, panel.template)
            )
            slug = re.sub(r"\W+", "-", panel.title.lower()).strip("-")
            filled.append({"title": title, "body": body, "slug": slug})
        if not isinstance(panel, DatasetPanel):
            told(panel.title.lower() or "result")
    return filled
