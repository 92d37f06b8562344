"""The fit of a law to a tensile test in a result file."""

from __future__ import annotations

from typing import Literal

from pydantic.dataclasses import dataclass

from eimi_lab.fits.law_record import STRICT, LawRecord, Record


class TensileSource(Record):
    """The file of a tensile test: path, hash, and name of the material."""

    path: str
    sha256: str
    material: str | None


@dataclass(config=STRICT, frozen=True, kw_only=True, repr=False)
class TensileRecord(LawRecord):
    """A law fitted to a tensile test up to a largest strain (the window).

    Attributes
    ----------
    window_percent : float or None
        Largest engineering strain in per cent; null for the whole curve.
    residuals : {"absolute", "relative"}
        Kind of residuals.
    rmse_Pa : float
        Root mean square error of the engineering stress.
    rows, rows_left_out : int
        Number of used rows, and of rows left out.
    correlation_rows : float
        Number of neighbouring rows whose residuals are correlated.
    correlation : tuple or None
        Correlation matrix of the parameters.
    not_fixed : tuple of str
        Parameters that the data do not determine.
    source : TensileSource
        File of the tensile test.
    """

    kind: Literal["tensile"] = "tensile"
    window_percent: float | None
    residuals: Literal["absolute", "relative"]
    rmse_Pa: float
    rows: int
    rows_left_out: int
    correlation_rows: float
    correlation: tuple[tuple[float, ...], ...] | None = None
    not_fixed: tuple[str, ...]
    source: TensileSource

    def window(self) -> str:
        """Return the largest strain in words, such as `50 %`; `full` for the whole curve."""
        return "full" if self.window_percent is None else f"{self.window_percent:g} %"

    def summary(self) -> str:
        """Return one line about a tensile fit: law, strains, initial shear modulus, error and stability limit."""
        limit = self.stability.stable_up_to_stretch
        stable = "" if limit is None else f", stable up to a stretch of {limit:.2f} only"
        if limit == 1.0:
            stable = ", not stable at any stretch"
        return (
            f"{self.model}, window {self.window()}: initial shear modulus {self.modulus_in_words()}, "
            f"RMSE {1e-3 * self.rmse_Pa:.3g} kPa over {self.rows} rows{stable}"
        )

    def notes(self) -> list[str]:
        """Return sentences on the strains, the residuals and the undetermined parameters of a tensile fit."""
        misfit = f"Window {self.window()}: RMSE {1e-3 * self.rmse_Pa:.3g} kPa over {self.rows} rows."
        return [misfit, *self.not_fixed_in_words()]

    def held_by_bounds(self) -> tuple[str, ...]:
        """Return the names of the parameters that the tensile test does not determine."""
        return self.not_fixed

    def not_fixed_in_words(self) -> list[str]:
        """Return a sentence on the undetermined parameters; the list is empty without such parameters."""
        return [f"The curve does not determine {', '.join(self.not_fixed)}."] if self.not_fixed else []
