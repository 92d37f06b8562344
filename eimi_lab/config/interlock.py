"""The table [[interlocks]] of a rig file: bounds of a measured value, beyond which the coil is switched off."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pydantic import Field, model_validator

from eimi_drivers.installed import did_you_mean
from eimi_drivers.interfaces import Reading
from eimi_lab.config.toml import Table

READINGS: dict[str, Callable[[Reading], float]] = {
    "coil_current_A": lambda measured: measured.current_A,
    "coil_voltage_V": lambda measured: measured.voltage_V,
    "coil_power_W": lambda measured: measured.current_A * measured.voltage_V,
}
"""The readings of the supply, by name; each is a function of the voltage and the current that the supply measures."""

LEAST_SILENCE_S = 2.0
"""Smallest permitted value of `longest_silence_s`: the supply is read only every 1.5 s."""


class Interlock(Table):
    """Bounds of a measured value, beyond which the coil is switched off."""

    reading: str = Field(min_length=1)
    """Name of a sensor in [[sensors]]; or coil_current_A, coil_voltage_V or coil_power_W, which the supply measures."""
    minimum: float | None = None
    """Smallest permitted value, in the unit of the reading. The bound also applies at zero current and before the run.
    """
    maximum: float | None = None
    """Largest permitted value, in the unit of the reading."""
    longest_silence_s: float = Field(default=5.0, ge=LEAST_SILENCE_S)
    """Longest permitted time without a reading. After this time the coil is switched off."""

    @model_validator(mode="after")
    def _bounded(self) -> Interlock:
        if self.minimum is None and self.maximum is None:
            raise ValueError(f"an interlock on {self.reading} needs minimum, maximum or both")
        if self.minimum is not None and self.maximum is not None and self.minimum >= self.maximum:
            raise ValueError(
                f"interlock on {self.reading}: minimum = {self.minimum:g} must be less than maximum = {self.maximum:g}"
            )
        return self

    @property
    def in_words(self) -> str:
        """The bounds of the reading as text.

        Examples
        --------
        >>> Interlock(reading="coil_voltage_V", maximum=12.0).in_words
        'coil_voltage_V at most 12, read at least every 5 s'
        """
        bounds = [("at least", self.minimum), ("at most", self.maximum)]
        words = " and ".join(f"{bound} {value:g}" for bound, value in bounds if value is not None)
        return f"{self.reading} {words}, read at least every {self.longest_silence_s:g} s"


def check_readings(interlocks: Sequence[Interlock], readings: Sequence[str]) -> None:
    """Raise ValueError if an interlock (bounds of a measured value) names a value that is not measured.

    ``readings`` are the names of all measured values.
    """
    for number, interlock in enumerate(interlocks):
        if interlock.reading not in readings:
            raise ValueError(
                f"interlocks.{number}.reading = {interlock.reading!r} is not a reading; the readings are "
                f"{', '.join(readings)}{did_you_mean(interlock.reading, list(readings))}"
            )
