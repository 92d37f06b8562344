"""The measured field and temperatures of a dataset, as a result file stores them."""

from __future__ import annotations

from typing import Self

import numpy as np

from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.law_record import Record


class MeasuredField(Record):
    """The straight line of field against current, fitted to the readings of a gaussmeter.

    Attributes
    ----------
    source : str
        Name of the gaussmeter.
    mT_per_A, mT_per_A_sigma : float
        Slope, and its standard uncertainty.
    offset_mT, offset_mT_sigma : float
        Field at zero current, and its standard uncertainty.
    scatter_mT : float
        Standard deviation of the readings about the line.
    currents : int
        Number of different currents.
    scale_is_stated : bool
        Whether an uncertainty of the gaussmeter's scale is known.
    stated_mT_per_A : float or None
        Coil constant in the calibration.
    """

    source: str
    mT_per_A: float
    mT_per_A_sigma: float
    offset_mT: float
    offset_mT_sigma: float
    scatter_mT: float
    currents: int
    scale_is_stated: bool
    stated_mT_per_A: float | None = None

    @classmethod
    def of(cls, evidence: Evidence) -> Self | None:
        """Return the measured field of a dataset; None if the field was not measured."""
        line = evidence.field_line
        if line is None:
            return None
        return cls(
            source=line.probe,
            mT_per_A=line.mT_per_A,
            mT_per_A_sigma=line.mT_per_A_sigma,
            offset_mT=line.offset_mT,
            offset_mT_sigma=line.offset_mT_sigma,
            scatter_mT=line.scatter_mT,
            currents=line.currents,
            scale_is_stated=line.shared_is_stated,
            stated_mT_per_A=evidence.typed_mT_per_A,
        )

    @property
    def in_words(self) -> str:
        """Return a text with the gaussmeter, the measured and the typed coil constant, and the field at 0 A."""
        stated = self.stated_mT_per_A
        percent = "" if not stated else f" ({100 * (self.mT_per_A / stated - 1):+.1f} %)"
        replaced = "" if stated is None else f", in place of coil_constant_mT_per_A = {stated:g}{percent}"
        no_share = "; the scale of the gaussmeter is taken as exact, because the rig file gives no uncertainty_share"
        exact = "" if self.scale_is_stated else no_share
        return (
            f"{self.source} measured at {self.currents} currents, "
            f"{self.mT_per_A:.5g} ± {self.mT_per_A_sigma:.2g} mT/A, and {self.offset_mT:.3g} "
            f"± {self.offset_mT_sigma:.2g} mT without a current{replaced}{exact}"
        )


class MeasuredTemperature(Record):
    """The measured temperature of the specimen in the states (load steps) that a fit uses.

    Attributes
    ----------
    mean_degC, lowest_degC, highest_degC : float
        Temperatures in °C.
    states : int
        Number of states with a measured temperature.
    """

    mean_degC: float
    lowest_degC: float
    highest_degC: float
    states: int

    @classmethod
    def of(cls, evidence: Evidence) -> Self | None:
        """Return the measured temperature of a dataset; None if the temperature was not measured."""
        degC = [state.temperature_degC for state in evidence.states if state.temperature_degC is not None]
        if not degC:
            return None
        return cls(mean_degC=float(np.mean(degC)), lowest_degC=min(degC), highest_degC=max(degC), states=len(degC))

    @property
    def in_words(self) -> str:
        """Return the mean, the lowest and the highest measured temperature of the specimen as text."""
        span = f", from {self.lowest_degC:.1f} to {self.highest_degC:.1f}" if self.states > 1 else ""
        return f"{self.mean_degC:.1f} °C{span}"
