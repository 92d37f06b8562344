"""The record of a fit to ring-downs (free vibrations) without static states."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.time.result import LawOfTime
from eimi_fitting.units import in_words
from eimi_lab.fits.law_record import STRICT, LawRecord, Record

_LARGEST = 5  # number of the largest sources that have a line


class MotionReference(Record):
    """A dataset of recorded motions: path, hash, model of the cross-section, number of motions, and uncertainties."""

    path: str
    sha256: str
    section: str
    motions: int
    stated: tuple[StatedSource, ...] = ()

    def in_words(self) -> str:
        """Return the path of the dataset and the number of its recorded motions as text."""
        return f"{self.path}: {self.motions} recorded motion{'' if self.motions == 1 else 's'}"


@dataclass(config=STRICT, frozen=True, kw_only=True, repr=False)
class RingDownRecord(LawRecord):
    """A dynamic shear modulus identified from ring-downs (free vibrations of the beam) alone.

    Attributes
    ----------
    time : LawOfTime
        Viscoelastic (Prony) law.
    datasets : tuple of MotionReference
        Datasets with the ring-downs.
    taken_as_exact : tuple of str
        Inputs without a given uncertainty.
    seed : int
        Seed of the random numbers.
    """

    kind: Literal["ring-down"] = "ring-down"
    time: LawOfTime
    datasets: tuple[MotionReference, ...] = Field(min_length=1)
    taken_as_exact: tuple[str, ...]
    seed: int

    def summary(self) -> str:
        """Return one line with the name of the law, and the dynamic modulus with its 95 % interval."""
        return f"{self.model}: {time_lines(self.time)[0]}"

    def caveats(self) -> list[str]:
        """Return lines on the viscoelastic law and on reasons to distrust it."""
        return [*time_lines(self.time), *(f"doubt: {words}" for words in self.doubts_in_words())]

    def notes(self) -> list[str]:
        """Return sentences on a fit to ring-downs: its datasets and the viscoelastic (Prony) law."""
        return [*(f"{dataset.in_words()}." for dataset in self.datasets), *time_lines(self.time)[1:]]

    def stretch_in_words(self) -> str:
        """Return sentences on the stretches in the data and on the limit of stability."""
        return f"The stretches of the ring-downs are not determined. {self._stability_in_words()}"


def time_lines(time: LawOfTime) -> list[str]:
    """Return lines on a viscoelastic (Prony) law: moduli, ring-downs, times, magnetic moment and uncertainties."""
    modulus = time.dynamic_shear_modulus
    terms = ", ".join(f"g = {term.g:.3g} with tau = {term.tau_s:.3g} s" for term in time.prony)
    lines = [
        f"dynamic shear modulus {in_words(modulus.value, modulus.interval_95)} at {time.frequency_Hz:.3f} Hz, "
        f"loss factor {time.loss_factor:.3f} [{time.loss_interval_95[0]:.3f}, {time.loss_interval_95[1]:.3f}]",
        *(
            f"{ring.label or 'ring-down'}: {ring.frequency_Hz:.4f} ± {ring.frequency_sigma_Hz:.2g} Hz, loss factor "
            f"of the decay {ring.decay_loss:.4f} ± {ring.decay_loss_sigma:.2g}, "
            f"from an amplitude of {ring.amplitude_mm:.2g} mm"
            for ring in time.ring_downs
        ),
        f"Prony series of {len(time.prony)} term{'' if len(time.prony) == 1 else 's'}: {terms}",
        _extent("instantaneous shear modulus", time.instantaneous_shear_modulus),
        _extent("long-term shear modulus", time.long_term_shear_modulus),
        _known_in_words(time.known_between_s),
    ]
    if time.moment is not None:
        low, high = time.moment.interval_95
        age = (
            f" (static states: measured {time.static_age_s:.3g} s after the load was set, as a median)"
            if time.static_age_s
            else ""
        )
        lines.append(
            f"magnetic moment from static states and ring-downs together{age}: {time.moment.value:.3f} [{low:.3f}, "
            f"{high:.3f}] times the given moment"
        )
    for entry in time.budget[:_LARGEST]:
        if entry.effect_percent > 0:
            lines.append(f"source of uncertainty {entry.words}: ± {entry.effect_percent:.2g} % of the dynamic modulus")
    return [*lines, *(f"doubt: {words}" for words in time.doubts)]


def _known_in_words(between_s: tuple[float, float] | None) -> str:
    if between_s is None:
        return "the data determine the shear modulus at no time with an error of at most 5 %"
    return (
        f"the data determine the shear modulus with an error of at most 5 % at times from {between_s[0]:.2g} to "
        f"{between_s[1]:.2g} s after a sudden strain"
    )


def _extent(name: str, quantity: Any) -> str:
    return f"{name} {in_words(quantity.value, quantity.interval_95)}"
