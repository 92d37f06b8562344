"""The errors of fits on datasets, as the file validation.json contains them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_lab.fits.law_record import Record
from eimi_lab.fits.records import FitRecord, StateError
from eimi_lab.fits.states_used import StatesUsed
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord
from eimi_lab.showing.tables import data_frame, html_table


class FitReference(Record):
    """A reference to a fit: its result file and its index in this file.

    For a tensile fit, `window_percent` is the largest strain in per cent, null for the whole curve.
    """

    path: str
    index: int
    kind: Literal["bending", "bending and tensile", "tensile", "ring-down"]
    window_percent: float | None

    @classmethod
    def of(cls, fit: FitRecord | TensileRecord | RingDownRecord, path: Path, index: int) -> FitReference:
        """Return the reference to the fit with this index in the file `path`."""
        return cls(
            path=str(path),
            index=index,
            kind=fit.fitted_to() if isinstance(fit, FitRecord) else fit.kind,
            window_percent=fit.window_percent if isinstance(fit, TensileRecord) else None,
        )

    def kind_in_words(self) -> str:
        """Return the data to which the law was fitted, such as `bending`, `ring-down` or `tensile 50 %`."""
        if self.kind != "tensile":
            return self.kind
        return "tensile full" if self.window_percent is None else f"tensile {self.window_percent:g} %"


class Validation(Record):
    """The errors of one fit on one dataset: distances between measured and simulated points, in mm.

    Attributes
    ----------
    seen : bool
        Whether the law was fitted to this dataset.
    states : StatesUsed
        Compared states (load steps).
    mean_error_interval_mm : tuple of float, or None
        95 % interval of the mean error; the upper end is None if it is not known.
    stable : bool or None
        Whether the law is Drucker-stable at all stretches of this dataset; None without an equilibrium.
    within_fitted_stretch : bool or None
        Whether all stretches of this dataset lie within those of the fit; None without an equilibrium, and for a fit
        to ring-downs, whose stretches are not determined.
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
        """Return a pandas.DataFrame with the errors in each state. Raises ImportError without pandas."""
        return data_frame([state.model_dump(exclude={"dataset"}) for state in self.by_state], "state")

    def plot(self) -> Any:
        """Return a matplotlib figure of the error of each state, with bars of one standard deviation."""
        from eimi_lab.fits.fit_figures import drawn_errors  # matplotlib is slow to import

        rows = [(s.state, s.field_mT, s.error_mm, s.deviation_mm) for s in self.by_state]
        states, field_mT, error_mm, deviation_mm = zip(*rows, strict=True) if rows else ((), (), (), ())
        return drawn_errors(states, field_mT, error_mm, deviation_mm)

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
    """The content of validation.json."""

    validations: tuple[Validation, ...]
