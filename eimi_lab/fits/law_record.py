"""The fields of a result file that every fit has, whether to bending, to tension or to ring-downs (free vibrations)."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, TypeAdapter, field_serializer, model_validator
from pydantic.dataclasses import dataclass

from eimi_fitting.inference.doubts.checks import Doubt
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.interval.draws import Draws
from eimi_fitting.laws import LAWS
from eimi_fitting.units import in_words
from eimi_lab.showing.tables import data_frame, html_table

Array = NDArray[np.float64]


STRICT = ConfigDict(extra="forbid", arbitrary_types_allowed=True)
"""Pydantic settings of all records: unknown keys of a file are errors, and fields may have array types."""


class Record(BaseModel):
    """The immutable base class of the parts of a result file; unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Stability(Record):
    """The criterion for the stability of a law, and the largest stable stretch (null if all stretches are stable)."""

    criterion: str
    stable_up_to_stretch: float | None
    checked_up_to_stretch: float


HELD = "not measured"  # the mark of a value that the data do not determine
_HELD_BY = "not measured (their intervals contain zero or are determined by the bounds of the search)"


@dataclass(config=STRICT, frozen=True, kw_only=True, repr=False)
class LawRecord:
    """The result of a fit of a law to bending, to tension or to ring-downs (free vibrations).

    Attributes
    ----------
    model : str
        Name of the law.
    parameters : dict of Quantity
        Values and 95 % intervals by name of the parameter.
    initial_shear_modulus : Quantity
        Value and 95 % interval.
    max_stretch : float
        Largest principal stretch in the data; 1 for a fit to ring-downs, whose stretches are not determined.
    stability : Stability
        Largest stable stretch, with the criterion.
    doubts : tuple of Doubt
        Reasons to distrust the result.
    draws : Draws or None
        Random samples of parameters and uncertain inputs from the result of the fit.
    versions : dict of str
        Versions of Python and of the packages.
    """

    model: str
    parameters: dict[str, Quantity]
    initial_shear_modulus: Quantity
    max_stretch: float
    stability: Stability
    doubts: tuple[Doubt, ...]
    draws: Draws | None = None
    versions: dict[str, str]

    @model_validator(mode="after")
    def _is_a_law(self) -> Self:
        if self.model not in LAWS:
            raise ValueError(f"model {self.model!r} should be one of {', '.join(LAWS)}")
        names = LAWS[self.model].parameter_names
        if tuple(self.parameters) != names:
            raise ValueError(f"parameters of {self.model} should be {', '.join(names)}, in this order")
        for name, quantity in self._quantities().items():
            if not np.isfinite(quantity.value):
                raise ValueError(f"{name} {quantity.value} should be a finite number")
        return self

    def content(self) -> dict[str, Any]:
        """Return the fit as fits.json contains it: numbers, texts, lists and dictionaries."""
        content: dict[str, Any] = TypeAdapter(type(self)).dump_python(self, mode="json")
        return content

    def values(self) -> list[float]:
        """Return the values of the parameters in the order of the law."""
        return [quantity.value for quantity in self.parameters.values()]

    def drawn(self, most: int | None = None) -> Array:
        """Return D random samples of the n parameters of the law from the result of the fit, shape (D, n).

        D is at most `most`, and 0 if the fit has no samples.
        """
        if self.draws is None:
            return np.zeros((0, len(self.parameters)))
        return self._evenly(np.array(self.draws.values)[:, : len(self.parameters)], most)

    def drawn_deviation(self, name: str, most: int | None = None) -> Array | None:
        """Return the deviation of an uncertain input from its given value in D random samples of the fit, shape (D,).

        None if the samples do not contain the input. The samples are in the order of `drawn`.
        """
        if self.draws is None or name not in self.draws.names:
            return None
        return self._evenly(self.draws.column(name), most)

    @staticmethod
    def _evenly(draws: Array, most: int | None) -> Array:
        if most is None or most >= len(draws):
            return draws
        return np.asarray(draws[((np.arange(most) + 0.5) * len(draws) / most).astype(int)])

    def modulus_in_words(self) -> str:
        """Return the initial shear modulus with its 95 % interval and its unit, as text."""
        modulus = self.initial_shear_modulus
        return in_words(modulus.value, modulus.interval_95)

    def notes(self) -> list[str]:
        """Return sentences on the data to which the law was fitted, and on the errors of the fit."""
        return []

    def held_by_bounds(self) -> tuple[str, ...]:
        """Return the names of the parameters that the data do not limit, but only the bounds of the search."""
        return ()

    @property
    def stretch_reached(self) -> float:
        """Return the largest stretch in all data of the fit."""
        return self.max_stretch

    def stretch_in_words(self) -> str:
        """Return sentences with the largest stretch in the data and the limit of stability."""
        return (
            f"Largest stretch in the data {self.stretch_reached:.3f}; beyond this stretch the law is an extrapolation. "
            f"{self._stability_in_words()}"
        )

    def _stability_in_words(self) -> str:
        limit, checked = self.stability.stable_up_to_stretch, self.stability.checked_up_to_stretch
        stable = (
            f"up to a stretch of {checked:g}, the largest stretch that was checked"
            if limit is None
            else f"up to {limit:.3g} only"
        )
        return f"The law is {self.stability.criterion}-stable {stable}."

    def caveats(self) -> list[str]:
        """Return lines on the limits of a fit: interval, undetermined parameters, stretch, stability and doubts."""
        held = self.held_by_bounds()
        return [
            f"initial shear modulus {self.modulus_in_words()}, 95 % interval",
            *([f"{_HELD_BY}: {', '.join(held)}"] if held else []),
            self.stretch_in_words(),
            *self.priors_in_words(),
            *(f"doubt: {words}" for words in self.doubts_in_words()),
        ]

    def priors_in_words(self) -> list[str]:
        """Return a sentence for each prior on a parameter of the law."""
        return []

    def doubts_in_words(self) -> list[str]:
        """Return each reason to distrust a fit in words."""
        return [doubt.words for doubt in self.doubts]

    @field_serializer("doubts")
    def _without_kinds(self, doubts: tuple[Doubt, ...]) -> list[dict[str, Any]]:
        """Return the reasons to distrust the fit as JSON objects for a result file, without their attribute `kind`."""
        written = [{key: value for key, value in vars(doubt).items() if key != "kind"} for doubt in doubts]
        return [{k: v for k, v in doubt.items() if v or k not in ("modulus_percent", "short")} for doubt in written]

    def _quantities(self) -> dict[str, Quantity]:
        return {**self.parameters, "initial_shear_modulus": self.initial_shear_modulus}

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame of the parameters and the initial shear modulus, with their 95 % intervals.

        The column `held_by_bounds` is true if the data do not determine the value. Raises ImportError without pandas.
        """
        rows = [
            {
                "parameter": name,
                "value": q.value,
                "low_95": q.interval_95[0],
                "high_95": q.interval_95[1],
                "unit": q.unit,
                "held_by_bounds": name in self.held_by_bounds(),
            }
            for name, q in self._quantities().items()
        ]
        return data_frame(rows, "parameter")

    def plot(self) -> Any:
        """Return a matplotlib figure of stress against strain in uniaxial tension, with the 95 % interval."""
        from eimi_lab.fits.fit_figures import drawn_law  # matplotlib is slow to import

        law = LAWS[self.model]
        return drawn_law(law, np.array(self.values()), self.drawn(200), self.stretch_reached)

    def summary(self) -> str:
        """Return one line: the name of the law, and the initial shear modulus with its 95 % interval."""
        return f"{self.model}: initial shear modulus {self.modulus_in_words()}"

    def __repr__(self) -> str:
        return f"<{self.summary()}>"

    def _repr_html_(self) -> str:
        rows = [
            (
                name.replace("_", " "),
                f"{q.value + 0.0:.5g}",  # no negative zeros
                f"{q.interval_95[0] + 0.0:.5g} to {q.interval_95[1] + 0.0:.5g}",
                q.unit,
                HELD if name in self.held_by_bounds() else "",
            )
            for name, q in self._quantities().items()
        ]
        doubts = (f"Doubt: {words}." for words in self.doubts_in_words())
        notes = (*self.notes(), self.stretch_in_words(), *doubts)
        return html_table(self.model, ("", "value", "95 %", "unit", ""), rows, notes)
