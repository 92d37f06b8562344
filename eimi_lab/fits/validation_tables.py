"""Tables of the errors of fits on datasets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_lab.fits.validation import FitReference, Validation

_HEAD = ("fit", "", "law", "shear modulus, kPa [95 %]", "error, µm [95 %]", "± µm", "stretch", "notes")
_RIGHT = ("error, µm [95 %]", "± µm", "stretch")
_FITS_ABREAST = 6


def by_dataset(validations: Sequence[Validation]) -> list[str]:
    """Return the lines of a table for each dataset, with a row for each fit in the order of the mean errors."""
    rows = [(v, _cells(v)) for v in validations]
    widths = _widths([_HEAD, *(cells for _, cells in rows)])
    lines = []
    for dataset in dict.fromkeys(v.dataset for v in validations):
        of_dataset = [(v, cells) for v, cells in rows if v.dataset == dataset]
        of_dataset.sort(key=lambda row: np.inf if row[0].mean_error_mm is None else row[0].mean_error_mm)
        first = of_dataset[0][0]
        lines.append(f"{dataset} ({first.section}, {first.states.in_words()})")
        lines += [_line(cells, widths, _HEAD, _RIGHT) for cells in (_HEAD, *(c for _, c in of_dataset))]
    return lines


def by_state(validations: Sequence[Validation]) -> list[str]:
    """Return the lines of a table for each dataset, with a row for each state and a column for each fit.

    A cell holds two numbers for the distances of measured from simulated edges, in µm: root mean square ± standard
    deviation.
    """
    lines = []
    for dataset in dict.fromkeys(v.dataset for v in validations):
        of_dataset = [v for v in validations if v.dataset == dataset and v.by_state]
        for first in range(0, len(of_dataset), _FITS_ABREAST):
            shown = of_dataset[first : first + _FITS_ABREAST]
            lines.append(f"{dataset}: error ± deviation by state, µm")
            head = ("state", "field, mT", *(f"{v.fit.path}:{v.fit.index} {v.model}" for v in shown))
            rows = [
                (
                    str(state.state),
                    f"{state.field_mT:.3f}",
                    *(f"{1e3 * v.by_state[k].error_mm:.2f} ± {1e3 * v.by_state[k].deviation_mm:.2f}" for v in shown),
                )
                for k, state in enumerate(shown[0].by_state)
            ]
            mean = (
                "mean",
                "",
                *(f"{micrometres(v.mean_error_mm)} ± {micrometres(v.mean_deviation_mm)}" for v in shown),
            )
            table = [head, *rows, mean]
            widths = _widths(table)
            lines += [_line(cells, widths, head, head[1:]) for cells in table]
    return lines


def matrix(validations: Sequence[Validation]) -> list[str]:
    """Return the lines of a table with a row for each fit and a column for each dataset.

    A cell holds the mean error (µm) with its 95 % interval. `*` marks the datasets to which the law was fitted.
    """
    datasets = list(dict.fromkeys(v.dataset for v in validations))
    head = ("fit", "", "law", *datasets)
    rows: dict[FitReference, list[str]] = {}
    for v in validations:
        row = rows.setdefault(v.fit, [f"{v.fit.path}:{v.fit.index}", v.fit.kind_in_words(), v.model])
        row.append(error_in_words(v) + ("*" if v.seen else " "))
    table = [head, *(tuple(row) for row in rows.values())]
    widths = _widths(table)
    title = "mean error, µm [95 % interval]; * fitted to this dataset"
    return [title, *(_line(cells, widths, head, tuple(datasets)) for cells in table)]


def error_in_words(v: Validation) -> str:
    """Return the mean error (µm) with its 95 % interval, such as `12.3 [11.0, 14.2]`.

    `>` replaces an unknown upper end. Without an interval, the error stands alone; without an error, the status of the
    simulation is returned.
    """
    if v.mean_error_mm is None:
        return v.status
    if v.mean_error_interval_mm is None:
        return micrometres(v.mean_error_mm)
    low, high = v.mean_error_interval_mm
    return f"{micrometres(v.mean_error_mm)} [{micrometres(low)}, {'>' if high is None else micrometres(high)}]"


def micrometres(length_mm: float | None) -> str:
    """Return a length in µm with three significant digits; `-` for None.

    Examples
    --------
    >>> micrometres(0.01234), micrometres(0.1234), micrometres(None)
    ('12.3', '123', '-')
    """
    if length_mm is None:
        return "-"
    um = 1e3 * length_mm
    return f"{um:.2f}" if um < 10 else f"{um:.1f}" if um < 100 else f"{um:.0f}"


def _cells(v: Validation) -> tuple[str, ...]:
    modulus = v.initial_shear_modulus
    low, high = modulus.interval_95
    moduli = f"{1e-3 * modulus.value:.2f} [{1e-3 * low:.2f}, {1e-3 * high:.2f}]"
    start = (f"{v.fit.path}:{v.fit.index}", v.fit.kind_in_words(), v.model, moduli)
    if v.max_stretch is None:
        return (*start, "-", "-", "-", v.status)
    notes = ["seen" if v.seen else "unseen"]
    if not v.stable:
        notes.append("not stable over these stretches")
    if v.within_fitted_stretch is False:
        notes.append("stretches beyond the data of the fit")
    return (*start, error_in_words(v), micrometres(v.mean_deviation_mm), f"{v.max_stretch:.3f}", ", ".join(notes))


def _widths(table: Sequence[Sequence[str]]) -> list[int]:
    return [max(map(len, column)) for column in zip(*table, strict=True)]


def _line(cells: Sequence[str], widths: Sequence[int], head: Sequence[str], right: Sequence[str]) -> str:
    """Return one line of a table; the columns whose headings are in `right` are aligned to the right."""
    aligned = (
        cell.rjust(width) if name in right else cell.ljust(width)
        for cell, width, name in zip(cells, widths, head, strict=True)
    )
    return f"  {'  '.join(aligned)}".rstrip()
