"""validation.json: what a fit's error is on datasets, those that it has not seen above all.

A law that finds no equilibrium in one of the states is a result, not an accident: its errors are then null and its
status says so. A law that is not Drucker-stable over the stretches it reaches is simulated all the same, and flagged.

What the errors are is told in `prediction`, and what their intervals are in `predicted_error`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_lab.fits.law_record import Record
from eimi_lab.fits.records import FitRecord, StateError, TensileRecord
from eimi_lab.fits.states_used import StatesUsed
from eimi_lab.process.outputs import write_file
from eimi_lab.showing.tables import data_frame, html_table


class FitReference(Record):
    """Which fit of which file; window_percent of a tensile fit (null: the whole curve)."""

    path: str
    index: int
    kind: Literal["bending", "bending and tensile", "tensile"]
    window_percent: float | None

    @classmethod
    def of(cls, fit: FitRecord | TensileRecord, path: Path, index: int) -> FitReference:
        """Of the fit ``index`` of a file."""
        return cls(
            path=str(path),
            index=index,
            kind=fit.fitted_to() if isinstance(fit, FitRecord) else fit.kind,
            window_percent=fit.window_percent if isinstance(fit, TensileRecord) else None,
        )

    def kind_in_words(self) -> str:
        """`bending`, `bending and tensile`, `tensile 50 %` or `tensile full`."""
        if self.kind != "tensile":
            return self.kind
        return "tensile full" if self.window_percent is None else f"tensile {self.window_percent:g} %"


class Validation(Record):
    """One fit on one dataset.

    seen: the fit was made from this dataset; states: which of the dataset's were used here; stable: Drucker-stable over
    the stretches reached here (null where no equilibrium was found); within_fitted_stretch: the fit's data reached the
    largest stretch of this dataset;
    mean_error_interval_mm: null without draws, its upper end where one of them finds no equilibrium.
    """

    dataset: str
    sha256: str
    section: str
    model: str
    fit: FitReference
    initial_shear_modulus: Quantity
    seen: bool
    states: StatesUsed
    status: Literal["ok", "no equilibrium"]
    mean_error_mm: float | None
    mean_error_interval_mm: tuple[float, float | None] | None
    mean_deviation_mm: float | None
    max_stretch: float | None
    stable: bool | None
    within_fitted_stretch: bool | None
    by_state: tuple[StateError, ...]

    def to_pandas(self) -> Any:
        """pandas.DataFrame with a row a state. Raises ImportError."""
        return data_frame([state.model_dump(exclude={"dataset"}) for state in self.by_state], "state")

    def plot(self) -> Any:
        """A matplotlib figure of the errors of the states, with bars of one deviation."""
        from eimi_lab.fits.fit_figures import drawn_errors  # matplotlib is slow to import

        own = self.by_state
        states, fields = [s.state for s in own], [s.field_mT for s in own]
        return drawn_errors(states, fields, [s.error_mm for s in own], [s.deviation_mm for s in own])

    def _repr_html_(self) -> str:
        rows = [
            (str(s.state), f"{s.field_mT:.3f}", f"{1e3 * s.error_mm:.3g}", f"{1e3 * s.deviation_mm:.3g}")
            for s in self.by_state
        ]
        mean = "" if self.mean_error_mm is None else f", mean error {1e3 * self.mean_error_mm:.3g} µm"
        seen = "seen" if self.seen else "not seen"
        caption = (
            f"{self.model}, {self.fit.kind_in_words()}, on {self.dataset} ({seen} by the fit): {self.status}{mean}"
        )
        return html_table(caption, ("state", "field, mT", "error, µm", "deviation, µm"), rows)


class ValidationFile(Record):
    """A whole validation.json."""

    validations: tuple[Validation, ...]


def write_validation(path: Path, validations: Sequence[Validation], force: bool = False) -> ValidationFile:
    """Write validation.json and return what it holds. Raises InputError when it exists and not ``force``."""
    content = ValidationFile(validations=tuple(validations))
    write_file(path, content.model_dump_json(indent=1) + "\n", force)
    return content
