"""Number the figures and tables of a report, and write them as HTML and as separate files."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from eimi_lab.showing.tables import csv_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RASTER_DPI = 220  # resolution of photographs: twice that of a common screen
_WHOLE = 14  # a table of at most so many lines is printed on one page
_SHORT = 24  # a cell of at most so many letters stays on one line
_LINE = 32  # a line of so many letters in a cell of several lines is not broken
_LONG = 24  # a word of more letters, such as a path, may be broken
_PAGE_IN = 7.1  # width of a figure that fills the page, `eimi_lab.showing.drawing.WIDTH_IN`
_NARROW = 0.75  # a figure of a smaller share of the page has its caption beside it
_WEBP = {"quality": 82, "method": 2}


@dataclass(frozen=True)
class Picture:
    """A figure of the report.

    Attributes
    ----------
    name : str
        Name of the files of the figure, without number and ending.
    figure : matplotlib Figure
        The figure itself.
    alternative : str
        Text for readers who cannot see the figure.
    caption : str or Markup
        Caption of the figure.
    photograph : bool
        Whether the figure contains photographs and is therefore stored as pixels.
    of_half_width : bool
        Whether the figure stands in one of two columns.
    """

    name: str
    figure: Figure
    alternative: str
    caption: str | Markup
    photograph: bool = False
    of_half_width: bool = False

    @cached_property
    def embedded(self) -> str:
        """Return the figure as a `data:` URL, which contains the whole image."""
        from eimi_lab.showing.drawing import saved  # matplotlib is slow to import

        if self.photograph:
            kind, content = "webp", saved(self.figure, "webp", dpi=_RASTER_DPI, pil_kwargs=_WEBP)
        else:
            kind, content = "svg+xml", saved(self.figure, "svg", dpi=_RASTER_DPI)
        return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


@dataclass(frozen=True)
class Cell:
    """A line of text in a table cell.

    `mark` is "best" for the smallest error of a column, "held" for a value that the data do not determine, or empty.
    """

    text: str
    mark: str


AnyCell = str | Cell | tuple[str | Cell, ...]


@dataclass(frozen=True)
class Table:
    """A table of the report. A cell with several lines is a tuple of lines."""

    name: str
    caption: str | Markup
    head: Sequence[str]
    rows: Sequence[Sequence[AnyCell]]
    notes: Sequence[str | Markup] = ()

    def texts(self) -> list[list[str]]:
        """Return the rows of the table as plain text."""
        return [[_text(cell) for cell in row] for row in self.rows]

    def to_csv(self) -> str:
        """Return the table as CSV; the first line contains the column names."""
        return csv_text([self.head, *self.texts()])

    def to_latex(self) -> str:
        """Return the table as a LaTeX `tabular` for the package booktabs."""
        rows = [" & ".join(_latex(text) for text in row) + r" \\" for row in [list(self.head), *self.texts()]]
        rules = [rf"\begin{{tabular}}{{{'l' * len(self.head)}}}", r"\toprule", rows[0], r"\midrule", *rows[1:]]
        return "\n".join([f"% {' '.join(str(self.caption).split())}", *rules, r"\bottomrule", r"\end{tabular}", ""])


@dataclass
class Elements:
    """The figures and tables of one page, in the order in which they were inserted."""

    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)

    def figure(self, picture: Picture) -> Markup:
        """Add a figure to the page, and return its HTML."""
        self.pictures.append(picture)
        number = len(self.pictures)
        source = picture.embedded
        share = float(picture.figure.get_figwidth()) / _PAGE_IN
        beside = Markup(' class="beside"') if not picture.of_half_width and share < _NARROW else ""
        width = Markup(' style="width: {:.0f}%"').format(100 * share) if beside else ""
        return Markup(
            '<figure id="figure-{number}"{beside}><img src="{source}" alt="{alternative}"{width}>'
            "<figcaption><b>Figure {number}.</b> {caption}</figcaption></figure>"
        ).format(
            number=number,
            beside=beside,
            width=width,
            source=source,
            alternative=picture.alternative,
            caption=picture.caption,
        )

    def table(self, table: Table) -> Markup:
        """Add a table to the page, and return its HTML."""
        self.tables.append(table)
        head = Markup("").join(Markup('<th scope="col">{}</th>').format(name) for name in table.head)
        rows = Markup("").join(
            Markup("<tr>{}</tr>").format(Markup("").join(_cell(cell) for cell in row)) for row in table.rows
        )
        lines = sum(max((len(_lines(cell)) for cell in row), default=1) for row in table.rows)
        kind = "table whole" if lines <= _WHOLE else "table"
        notes = Markup("").join(Markup('<p class="note">{}</p>').format(note) for note in table.notes)
        return Markup(
            '<div class="{kind}" id="table-{number}"><table><caption><b>Table {number}.</b> {caption}</caption>'
            "<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>{notes}"
        ).format(kind=kind, number=len(self.tables), caption=table.caption, head=head, rows=rows, notes=notes)

    def files(self) -> dict[str, bytes]:
        """Return each figure as SVG and PDF, and each table as CSV and LaTeX, by file name."""
        from eimi_lab.showing.drawing import saved

        contents: dict[str, bytes] = {}
        for number, picture in enumerate(self.pictures, 1):
            for kind in ("svg", "pdf"):
                name = f"figure_{number:02d}_{picture.name}.{kind}"
                contents[name] = saved(picture.figure, kind, dpi=_RASTER_DPI)
        for number, table in enumerate(self.tables, 1):
            name = f"table_{number:02d}_{table.name}"
            contents |= {f"{name}.csv": table.to_csv().encode(), f"{name}.tex": table.to_latex().encode()}
        return contents


def _lines(cell: AnyCell) -> list[Cell]:
    lines = cell if isinstance(cell, tuple) else (cell,)
    return [line if isinstance(line, Cell) else Cell(line, "") for line in lines]


def _cell(cell: AnyCell) -> Markup:
    lines = _lines(cell)
    shown = Markup("<br>").join(_line(line, unbroken=len(lines) > 1 and len(line.text) <= _LINE) for line in lines)
    longest = max((len(word) for line in lines for word in line.text.split()), default=0)
    narrow = all(len(line.text) <= _SHORT for line in lines)
    marks = {"best": any(line.mark == "best" for line in lines), "long": longest > _LONG, "short": narrow}
    classes = " ".join(name for name, has in marks.items() if has)
    return Markup('<td class="{}">{}</td>').format(classes, shown) if classes else Markup("<td>{}</td>").format(shown)


def _line(line: Cell, unbroken: bool) -> Markup:
    """Return a line of a table cell as HTML. If `unbroken` is true, the browser does not wrap the line."""
    shown = escape(line.text)
    if line.mark == "held":
        shown = Markup('{} <span class="held">not measured</span>').format(line.text)
    return Markup('<span class="line">{}</span>').format(shown) if unbroken else shown


def _text(cell: AnyCell) -> str:
    return "; ".join(line.text + (" (not measured)" if line.mark == "held" else "") for line in _lines(cell))


# LaTeX for the characters that it would read as commands, and for those that it has only in mathematics.
_LATEX = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"},
    **{"µ": r"\textmu{}", "≥": r"$\geq$", "×": r"$\times$", "±": r"$\pm$", "−": "$-$", "³": "$^3$", "…": r"\ldots{}"},
    **{"<": r"\textless{}", ">": r"\textgreater{}", "Δ": r"$\Delta$", "λ": r"$\lambda$", "°": r"$^\circ$"},
}


def _latex(text: str) -> str:
    return "".join(_LATEX.get(sign, sign) for sign in text)
