"""protocol.toml: the currents of a run, and the conditions that must hold at each of them."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from eimi_lab.config.toml import Document, Table, locate, parse, read_text

MOST_STATES = 1000  # a larger number is assumed to be a typing error
MOST_FRAMES = 10_000  # of one state
LONGEST_RAMP_DOWN_S = 60.0
FINEST_STEP_A = 1e-4  # of a ramp; supplies resolve about a milliampere


class Currents(Table):
    """The set-points of a run: a range with a step, or an explicit list.

    `set_points_A` computes the range in decimal arithmetic, so that the fourth set-point of a step of 0.1 is 0.3 and
    not 0.30000000000000004.
    """

    start_A: float | None = None
    """The first set-point."""
    stop_A: float | None = None
    """The last set-point."""
    step_A: float | None = Field(default=None, gt=0)
    """Difference between neighbouring set-points; the range must be a multiple of it."""
    values_A: Annotated[tuple[float, ...], Field(strict=False, min_length=2, max_length=MOST_STATES)] | None = None
    """All set-points in their order, instead of start_A, stop_A and step_A."""
    up_and_down: bool = False
    """Whether the run returns through the same set-points to the first one."""
    both_polarities: bool = False
    """Whether the run then repeats its states with the current reversed. If the supply cannot reverse its current, the
    run pauses and asks for the leads of the coil to be swapped."""

    @model_validator(mode="after")
    def _range_or_list(self) -> Currents:
        ends = (self.start_A, self.stop_A, self.step_A)
        if (self.values_A is None) != all(end is not None for end in ends) or (
            self.values_A is not None and any(end is not None for end in ends)
        ):
            raise ValueError("needs start_A, stop_A and step_A, or values_A alone")
        if self.values_A is None:
            start, stop, step = (Decimal(str(end)) for end in ends)
            if start == stop:
                raise ValueError(f"stop_A = {stop} is equal to start_A; a run needs at least two states")
            if abs(stop - start) / step >= MOST_STATES:
                raise ValueError(f"step_A = {step} gives more than {MOST_STATES} states from {start} to {stop} A")
            if (stop - start) % step:
                raise ValueError(f"step_A = {step} does not divide the range from {start} to {stop} A")
        if self.both_polarities and (lowest := min(self._forward_A())) < 0:
            raise ValueError(
                f"both_polarities = true repeats every state with the current reversed, but one current is {lowest:g} "
                "A; use currents from 0 up"
            )
        return self

    @property
    def set_points_A(self) -> tuple[float, ...]:
        """The set-points in the order of the run."""
        forward = self._forward_A()
        one_way = forward + forward[-2::-1] if self.up_and_down else forward
        return one_way + tuple(-current_A for current_A in one_way if current_A) if self.both_polarities else one_way

    def key_of(self, current_A: float) -> str:
        """Return the key in the file that defines the set-point at one end of the range."""
        if self.values_A is not None:
            return "values_A"
        forward_A = abs(current_A) if self.both_polarities else current_A
        return "start_A" if forward_A == self.start_A else "stop_A"

    def _forward_A(self) -> tuple[float, ...]:
        if self.values_A is not None:
            return self.values_A
        start, stop, step = (Decimal(str(end)) for end in (self.start_A, self.stop_A, self.step_A))
        count = int(abs(stop - start) / step)
        signed = step if stop > start else -step
        return tuple(float(start + k * signed) for k in range(count + 1))


class Ramp(Table):
    """How the current moves between states, and how closely the measured current must agree with its set-point."""

    rate_A_per_s: float = Field(gt=0)
    """Rate of the current between states."""
    step_A: float = Field(ge=FINEST_STEP_A)
    """Largest difference between consecutive set-points that are sent during a ramp."""
    tolerance_A: float = Field(gt=0)
    """Largest difference between measured and set current at a state; the run stops if it is exceeded."""
    down_within_s: float = Field(default=2.0, gt=0, le=LONGEST_RAMP_DOWN_S)
    """Longest time in which the current returns to zero when the run ends; the rate is exceeded if necessary."""


class SupplyLimits(Table):
    """The largest current and voltage that the supply is ever set to."""

    current_A: float = Field(gt=0)
    """The largest current that the supply is ever set to."""
    voltage_V: float = Field(gt=0)
    """The largest voltage that the supply is ever set to."""

    def stricter(self, other: SupplyLimits) -> SupplyLimits:
        """Return limits with the smaller current and the smaller voltage of these and the other limits."""
        return SupplyLimits(
            current_A=min(self.current_A, other.current_A), voltage_V=min(self.voltage_V, other.voltage_V)
        )


class Settle(Table):
    """The criterion for a beam at rest, see `eimi_lab.acquisition.settling`."""

    noise_ratio: float = Field(gt=1)
    """Limit of the mean squared difference of two frames, relative to camera noise alone; a beam at rest has 1."""
    pairs: int = Field(ge=1)
    """Number of successive pairs of frames that must be below the limit."""
    drift_window_s: float = Field(gt=0)
    """Two frames that are this time apart must also be below the limit, because silicone creeps."""
    dwell_s: float = Field(default=0.0, ge=0, le=3600)
    """Shortest time that a state lasts, from the moment at which its current was set; creep needs a minute."""
    timeout_s: float = Field(gt=0)
    """If the beam is not at rest after this time, the frames are taken and the state is flagged NOT_SETTLED."""

    @model_validator(mode="after")
    def _long_enough(self) -> Settle:
        if self.timeout_s <= self.drift_window_s:
            raise ValueError(
                f"timeout_s = {self.timeout_s:g} must be more than drift_window_s = {self.drift_window_s:g}"
            )
        return self


class Transients(Table):
    """Frames that are stored while the beam settles, at logarithmically spaced times."""

    frames_per_state: int = Field(ge=0, le=MOST_FRAMES)
    """Largest number of frames stored while the beam settles at a state; 0 stores none."""


class Conditioning(Table):
    """Cycles of the current from zero to a maximum and back before the run.

    Silicone softens when it is stretched for the first time (the Mullins effect: L. Mullins, Rubber Chem. Technol. 42
    (1969) 339).
    """

    cycles: int = Field(ge=1, le=1000)
    """Number of cycles."""
    current_A: float
    """Current at the far end of a cycle; usually the largest current of the run."""

    @field_validator("current_A")
    @classmethod
    def _moves(cls, current_A: float) -> float:
        if current_A == 0:
            raise ValueError("does not move the beam; use the largest current of the run, or omit the conditioning")
        return current_A


class RingDown(Table):
    """Steps of the current to zero after the last state, each recorded by the camera while the beam swings freely."""

    seconds: float = Field(gt=0, le=600)
    """Duration of each recording."""
    from_A: float | None = None
    """Current from which the coil is switched to zero; if it is absent, the last current of the run."""
    rate_Hz: float | None = Field(default=None, gt=0)
    """Frames per second that the camera must reach. If the rig states no frame_rate_Hz, the camera is set to it."""
    repeats: int = Field(default=1, ge=1, le=100)
    """Number of ring-downs."""

    @field_validator("from_A")
    @classmethod
    def _moves(cls, from_A: float | None) -> float | None:
        if from_A == 0:
            raise ValueError("does not move the beam; use a current of the run, or omit it for the last one")
        return from_A


class Protocol(Document):
    """The contents of protocol.toml."""

    name: str = Field(min_length=1)
    """Name of the protocol."""
    material: str = Field(min_length=1)
    """Material of the specimen; specimen.material must be the same."""
    frames_per_state: int = Field(ge=1, le=MOST_FRAMES)
    """Number of frames stored at each state when the beam is at rest."""
    current: Currents
    """The set-points: start, stop and step, or a list."""
    ramp: Ramp
    """How the current moves between states, and to zero when the run ends."""
    limits: SupplyLimits
    """Limits of the supply; the rig also has limits, and the stricter ones apply."""
    settle: Settle
    """The criterion for a beam at rest."""
    tip_force_N: float = Field(default=0.0, ge=0)
    """Force of a weight that hangs at the specimen's tip during the run; 0.00981 for one gram."""
    transients: Transients = Transients(frames_per_state=12)
    """Frames that are stored while the beam settles, at logarithmically spaced times."""
    conditioning: Conditioning | None = None
    """Cycles of the current before the run, because silicone softens when it is first stretched."""
    ring_down: RingDown | None = None
    """Steps of the current to zero after the last state, of which every frame is stored."""
    creep: bool = False
    """Whether frames at logarithmic times are stored through the whole of each state, from the moment at which its
    current was set; transients.frames_per_state is their number, and settle.dwell_s makes the states longer."""

    @model_validator(mode="before")
    @classmethod
    def _read_release(cls, content: Any) -> Any:
        """Read the table `release` of earlier versions, which recorded one ring-down from the last current."""
        if isinstance(content, dict) and "release" in content and "ring_down" not in content:
            content = {**content, "ring_down": content["release"]}
            del content["release"]
        return content

    @model_validator(mode="after")
    def _records_creep(self) -> Protocol:
        if self.creep and not self.transients.frames_per_state:
            raise ValueError("creep = true needs transients.frames_per_state of 1 or more, such as 30")
        return self

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
        """The extreme currents of the run, the conditioning and the ring-downs, with the key that defines each."""
        ends = [(f"current.{self.current.key_of(end)}", end) for end in (min(self.currents_A), max(self.currents_A))]
        conditioning = [("conditioning.current_A", self.conditioning.current_A)] if self.conditioning else []
        from_A = self.ring_down.from_A if self.ring_down else None
        ring_down = [("ring_down.from_A", from_A)] if from_A is not None else []
        return (*ends, *conditioning, *ring_down)

    @property
    def recordings(self) -> int:
        """The number of recordings of a run: its states and its ring-downs."""
        return len(self.currents_A) + (self.ring_down.repeats if self.ring_down else 0)

    @property
    def rate_Hz(self) -> float | None:
        """The frames per second that the ring-downs need; None if the ring-downs need no rate."""
        return self.ring_down.rate_Hz if self.ring_down else None

    @property
    def ring_down_from_A(self) -> float:
        """The current from which the ring-downs begin."""
        stated = self.ring_down.from_A if self.ring_down else None
        return self.currents_A[-1] if stated is None else stated

    @property
    def currents_A(self) -> tuple[float, ...]:
        """The set-points in the order of the run."""
        return self.current.set_points_A


def load_protocol(name: str | Path) -> Protocol:
    """Read a protocol from a path, or a shipped protocol by its name ("dragon_skin_10"). Raises InputError."""
    file = locate(name)
    return parse(Protocol, read_text(file), file)
