"""protocol.toml: the currents that a run goes through, and what has to hold at each of them."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from eimi_lab.config.reading import Document, Table, locate, parse, read_text

MOST_STATES = 1000  # more is a slip of the pen


class Currents(Table):
    """Set-points: start_A, stop_A and step_A, or an explicit list values_A; up_and_down goes back the same way.

    `exact` holds them as typed in decimal, so that the fourth step of 0.1 is 0.3 and not 0.30000000000000004.
    """

    start_A: float | None = None
    stop_A: float | None = None
    step_A: float | None = Field(default=None, gt=0)
    values_A: Annotated[tuple[float, ...], Field(strict=False, min_length=2)] | None = None
    up_and_down: bool = False

    @model_validator(mode="after")
    def _one_way(self) -> Currents:
        ends = (self.start_A, self.stop_A, self.step_A)
        if (self.values_A is None) != all(end is not None for end in ends) or (
            self.values_A is not None and any(end is not None for end in ends)
        ):
            raise ValueError("needs start_A, stop_A and step_A, or values_A alone")
        if self.values_A is None:
            start, stop, step = (Decimal(str(end)) for end in ends)
            if start == stop:
                raise ValueError(f"stop_A = {stop} is start_A: a run needs at least two states")
            if abs(stop - start) / step >= MOST_STATES:
                raise ValueError(f"step_A = {step} gives more than {MOST_STATES} states from {start} to {stop} A")
            if (stop - start) % step:
                raise ValueError(f"step_A = {step} does not divide the range from {start} to {stop} A")
        return self

    @property
    def exact(self) -> tuple[float, ...]:
        there = self._one_way_exact()
        return there + there[-2::-1] if self.up_and_down else there

    def key_of(self, current_A: float) -> str:
        """The key that brought a set-point at an end of the range about."""
        if self.values_A is not None:
            return "values_A"
        return "start_A" if current_A == self.start_A else "stop_A"

    def _one_way_exact(self) -> tuple[float, ...]:
        if self.values_A is not None:
            return self.values_A
        start, stop, step = (Decimal(str(end)) for end in (self.start_A, self.stop_A, self.step_A))
        count = int(abs(stop - start) / step)
        signed = step if stop > start else -step
        return tuple(float(start + k * signed) for k in range(count + 1))


class Ramp(Table):
    """How fast the current moves between states, and how close the measured current must come to the set one."""

    rate_A_per_s: float = Field(gt=0)
    step_A: float = Field(gt=0)
    tolerance_A: float = Field(gt=0)


class SupplyLimits(Table):
    """The largest current and voltage that may ever be asked for."""

    current_A: float = Field(gt=0)
    voltage_V: float = Field(gt=0)

    def stricter(self, other: SupplyLimits) -> SupplyLimits:
        """The smaller of each of two sets of limits."""
        return SupplyLimits(
            current_A=min(self.current_A, other.current_A), voltage_V=min(self.voltage_V, other.voltage_V)
        )


class Settle(Table):
    """When the beam counts as at rest: see `eimi_lab.acquisition.settling`."""

    noise_ratio: float = Field(gt=1)
    pairs: int = Field(ge=1)
    drift_window_s: float = Field(gt=0)
    timeout_s: float = Field(gt=0)

    @model_validator(mode="after")
    def _long_enough(self) -> Settle:
        if self.timeout_s <= self.drift_window_s:
            raise ValueError(
                f"timeout_s = {self.timeout_s:g} must be more than drift_window_s = {self.drift_window_s:g}"
            )
        return self


class Protocol(Document):
    """A whole protocol.toml."""

    name: str = Field(min_length=1)
    material: str = Field(min_length=1)
    frames_per_state: int = Field(ge=1)
    current: Currents
    ramp: Ramp
    limits: SupplyLimits
    settle: Settle

    @model_validator(mode="after")
    def _within_limits(self) -> Protocol:
        largest = max(self.currents_A, key=abs)
        if abs(largest) > self.limits.current_A:
            raise ValueError(
                f"current goes to {largest:g} A, which exceeds limits.current_A = {self.limits.current_A:g}"
            )
        return self

    @property
    def currents_A(self) -> tuple[float, ...]:
        """The set-points in the order of the run."""
        return self.current.exact


def load_protocol(name: str | Path) -> Protocol:
    """Read a protocol, or a shipped one by its name ("dragon_skin_10"). Raises InputError."""
    file = locate(name)
    return parse(Protocol, read_text(file), file)
