"""Write the report as one complete HTML file and, on request, each figure and table as a file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import replace
from datetime import datetime
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, select_autoescape
from markupsafe import Markup

from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.prediction import predict_on_each
from eimi_lab.process.outputs import whole_folder, write_file, write_whole
from eimi_lab.process.progress import silent
from eimi_lab.reporting.contents import DatasetContents, ReportContents, short_names
from eimi_lab.reporting.drawn_panels import AnyPanel, DrawnPanels, Values
from eimi_lab.reporting.elements import Elements
from eimi_lab.reporting.sections import evidence_for_fits
from eimi_lab.reporting.shown import laws_of_time, leading, read_shown

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
    """Write a report that compares datasets with the simulations of fitted laws.

    Parameters
    ----------
    output : Path
        The HTML file.
    datasets, fits : sequence of Path
        Datasets and fits files.
    flagged : bool
        Whether to use load steps in which a check found a defect.
    force : bool
        Whether to overwrite existing files.
    assets : Path, optional
        Folder for each figure as SVG and PDF, and for each table as CSV and LaTeX.
    command : str
        The command line, which the report quotes.
    executor : callable, optional
        Starts worker processes for the simulations; by default there are none.
    progress : callable
        Receives a title and the number of steps, and returns a context manager. The context manager yields a function
        that is called after each step.

    Raises
    ------
    InputError
        If a file cannot be read, or if an output exists and `force` is false.
    """
    shown_fits, written, times = read_shown(fits), datetime.now().astimezone(), laws_of_time(fits)
    datasets = [path for path in datasets if not (times and _has_motions_alone(path))]
    with ExitStack() as stack:
        folder = stack.enter_context(whole_folder(assets, force)) if assets is not None else None
        step_done = stack.enter_context(progress("report", len(datasets) * (2 + 2 * len(shown_fits)) + 1))
        names, shown, drawn = short_names(datasets), dict[int, DatasetContents](), DrawnPanels()

        def contents() -> ReportContents:
            return ReportContents(shown_fits, tuple(shown[place] for place in sorted(shown)), written, command, times)

        def draw_fits() -> None:
            drawn.fits(contents())

        evidence, fits_on = [], []
        for path in datasets:
            evidence_here, fits_here = evidence_for_fits(path, shown_fits, flagged)
            evidence.append(evidence_here)
            fits_on.append(fits_here)
            step_done(f"{path.name} read")
        for place, predictions in predict_on_each(fits_on, step_done, executor, draw_fits):
            if place in shown:
                shown[place] = replace(shown[place], predictions=predictions)  # with their intervals
                continue
            dataset = stack.enter_context(open_dataset(datasets[place]))
            leading_fit = leading(shown_fits, evidence[place].sha256)
            shown[place] = DatasetContents(dataset, evidence[place], predictions, names[place], leading_fit)
            drawn.dataset(shown[place])
            step_done(f"{names[place]}: figures drawn")
            draw_fits()
            if len(shown) == len(datasets):
                drawn.datasets(contents())
        if not datasets:
            draw_fits()
            drawn.datasets(contents())
        page, elements = render(contents(), drawn)
        step_done("page written")
        if folder is not None:
            for name, content in elements.files().items():
                write_whole(folder / name, content)
    write_file(output, page, force)


def _has_motions_alone(path: Path) -> bool:
    """Return whether a dataset contains motions (vibration or creep) but no load steps at rest."""
    with open_dataset(path) as dataset:
        return not dataset.states


def render(report: ReportContents, drawn: DrawnPanels) -> tuple[str, Elements]:
    """Return the page as HTML, and its numbered figures and tables."""
    elements = Elements()
    environment = _environment(elements)
    drawn.report(report)
    template = environment.from_string((files("eimi_lab.reporting") / "page.html").read_text(encoding="utf-8"))
    page = template.render(
        title=_title(report),
        report=report,
        summary=_filled(environment, drawn.summary()),
        before=_filled(environment, drawn.of_report(after_datasets=False)),
        sections=[
            {"name": shown.name, "slug": f"dataset-{number}", "panels": _filled(environment, drawn.of_dataset(shown))}
            for number, shown in enumerate(report.datasets, 1)
        ],
        after=_filled(environment, drawn.of_report(after_datasets=True)),
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
    if not report.fits:
        return f"Measured: {materials} ({names})"
    return f"Material identified: {materials}" if materials else "Material identified"


def _filled(environment: Environment, drawn: Iterable[tuple[AnyPanel, Values]]) -> list[dict[str, str]]:
    """Return title, anchor and HTML body of each panel (section of the report), without empty panels."""
    filled = []
    for panel, values in drawn:
        if values is not None:
            title, body = (
                Markup(environment.from_string(text).render(values)) for text in (panel.title, panel.template)
            )
            slug = re.sub(r"\W+", "-", panel.title.lower()).strip("-")
            filled.append({"title": title, "body": body, "slug": slug})
    return filled
