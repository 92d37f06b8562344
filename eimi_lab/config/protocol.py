"""protocol.toml: the currents that a run goes through, and what has to hold at each of them."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Annotated

from pydantic import Field, field_validator, model_validator

from eimi_lab.config.toml import Document, Table, locate, parse, read_text

MOST_STATES = 1000  # more is a slip of the pen
MOST_FRAMES = 10_000  # of one state
LONGEST_WAY_OUT_S = 60.0
FINEST_STEP_A = 1e-4  # of a ramp; supplies set milliamperes


class Currents(Table):
    """Set-points: start_A, stop_A and step_A, or an explicit list values_A; up_and_down goes back the same way.

    `exact` holds them as typed in decimal, so that the fourth step of 0.1 is 0.3 and not 0.30000000000000004.
    """

    start_A: float | None = None
    """The first set-point."""
    stop_A: float | None = None
    """The last one."""
    step_A: float | None = Field(default=None, gt=0)
    """Between neighbours; has to divide the range."""
    values_A: Annotated[tuple[float, ...], Field(strict=False, min_length=2, max_length=MOST_STATES)] | None = None
    """In place of the three: the set-points in their order."""
    up_and_down: bool = False
    """Whether the run goes back the same way."""

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
    """How fast the current moves between states, and how close the measured current must come to the set one.

    down_within_s: on the way out it is at zero by then, faster than the rate if need be.
    """

    rate_A_per_s: float = Field(gt=0)
    """How fast the current moves between states."""
    step_A: float = Field(ge=FINEST_STEP_A)
    """Set-points sent along the ramp are no further apart."""
    tolerance_A: float = Field(gt=0)
    """Measured against set current at each state; the run stops beyond it."""
    down_within_s: float = Field(default=2.0, gt=0, le=LONGEST_WAY_OUT_S)
    """On the way out the current is at zero by then, faster than the rate if need be."""


class SupplyLimits(Table):
    """The largest current and voltage that may ever be asked for."""

    current_A: float = Field(gt=0)
    """The largest current that may ever be asked for."""
    voltage_V: float = Field(gt=0)
    """The largest voltage."""

    def stricter(self, other: SupplyLimits) -> SupplyLimits:
        """The smaller of each of two sets of limits."""
        return SupplyLimits(
            current_A=min(self.current_A, other.current_A), voltage_V=min(self.voltage_V, other.voltage_V)
        )


class Settle(Table):
    """When the beam counts as at rest: see `eimi_lab.acquisition.settling`."""

    noise_ratio: float = Field(gt=1)
    """Mean squared difference of consecutive frames over camera noise: 1 at rest."""
    pairs: int = Field(ge=1)
    """So many consecutive pairs in a row have to be at rest."""
    drift_window_s: float = Field(gt=0)
    """And no more difference than that over this long: silicone creeps."""
    timeout_s: float = Field(gt=0)
    """Then the frames are taken anyway and the state is marked NOT_SETTLED."""

    @model_validator(mode="after")
    def _long_enough(self) -> Settle:
        if self.timeout_s <= self.drift_window_s:
            raise ValueError(
                f"timeout_s = {self.timeout_s:g} must be more than drift_window_s = {self.drift_window_s:g}"
            )
        return self


class Transients(Table):
    """Frames that are kept while the beam settles, log-spaced in time; 0 keeps none."""

    frames_per_state: int = Field(ge=0, le=MOST_FRAMES)
    """At most so many are kept of each state."""


class Conditioning(Table):
    """Cycles from zero to a current and back before the run, since silicone softens where it is first stretched.

    The Mullins effect: L. Mullins, Rubber Chem. Technol. 42 (1969) 339.
    """

    cycles: int = Field(ge=1, le=1000)
    """How often."""
    current_A: float
    """The far end of a cycle; the largest current of the run, as a rule."""

    @field_validator("current_A")
    @classmethod
    def _moves(cls, current_A: float) -> float:
        if current_A == 0:
            raise ValueError("moves nothing; leave the conditioning out, or give the largest current of the run")
        return current_A


class Release(Table):
    """The current goes to zero in one step after the last state, and the camera records for so long."""

    seconds: float = Field(gt=0, le=600)
    """How long the camera records."""


class Protocol(Document):
    """A whole protocol.toml."""

    name: str = Field(min_length=1)
    """What the protocol is called."""
    material: str = Field(min_length=1)
    """Has to be the specimen's material."""
    frames_per_state: int = Field(ge=1, le=MOST_FRAMES)
    """Frames kept once the beam is at rest."""
    current: Currents
    """The set-points: start, stop and step, or a list."""
    ramp: Ramp
    """Between states and on the way out."""
    limits: SupplyLimits
    """The rig has limits too; the stricter of the two holds."""
    settle: Settle
    """When the beam counts as at rest."""
    tip_force_N: float = Field(default=0.0, ge=0)
    """Of a weight that hangs at the specimen's tip throughout the run; 0.00981 for a gram."""
    transients: Transients = Transients(frames_per_state=12)
    """Frames that are kept while the beam settles, log-spaced in time; 0 keeps none."""
    conditioning: Conditioning | None = None
    """Cycles before the run, since silicone softens where it is first stretched."""
    release: Release | None = None
    """After the last state the current goes to zero in one step, and every frame is kept."""

    @model_validator(mode="after")
    def _within_limits(self) -> Protocol:
        for key, current_A in self.extremes_A:
            if abs(current_A) > self.limits.current_A:
                raise ValueError(
                    f"{key} goes to {current_A:g} A, which exceeds limits.current_A = {self.limits.current_A:g}"
                )
        return self

    @property
    def extremes_A(self) -> tuple[tuple[str, float], ...]:
        """The lowest and the highest current of run and conditioning, each with the key that asks for it."""
        ends = [(f"current.{self.current.key_of(end)}", end) for end in (min(self.currents_A), max(self.currents_A))]
        before = [("conditioning.current_A", self.conditioning.current_A)] if self.conditioning else []
        return (*ends, *before)

    @property
    def currents_A(self) -> tuple[float, ...]:
        """The set-points in the order of the run."""
        return self.current.exact


def load_protocol(name: str | Path) -> Protocol:
    """Read a protocol, or a shipped one by its name ("dragon_skin_10"). Raises InputError."""
    file = locate(name)
    return parse(Protocol, read_text(file), file)
