"""Read protocol.toml: the currents of a run, how long to wait at each current, and how many frames to take."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from eimi_lab.config.toml import Document, Table, locate, parse, read_text

MOST_STATES = 1000  # a larger number is assumed to be a typing error
MOST_FRAMES = 10_000  # largest number of frames of one state
LONGEST_RAMP_DOWN_S = 60.0
FINEST_STEP_A = 1e-4  # smallest step of a ramp; supplies resolve about a milliampere


class Currents(Table):
    """The currents of a run: a range with a step, or a list."""

    start_A: float | None = None
    """The first set-point."""
    stop_A: float | None = None
    """The last set-point."""
    step_A: float | None = Field(default=None, gt=0)
    """Difference between neighbouring set-points. The range must be a multiple of this step."""
    values_A: Annotated[tuple[float, ...], Field(strict=False, min_length=2, max_length=MOST_STATES)] | None = None
    """All set-points in the order of the run, instead of start_A, stop_A and step_A."""
    up_and_down: bool = False
    """Whether the run returns through the same set-points to the first set-point."""
    both_polarities: bool = False
    """Whether the run afterwards repeats all states, except those at zero current, with the opposite sign of the
    current. If the supply cannot reverse the current, the run pauses and asks the user to swap the leads of the coil.
    """

    @model_validator(mode="after")
    def _range_or_list(self) -> Currents:
        ends = (self.start_A, self.stop_A, self.step_A)
        if (self.values_A is None) != all(end is not None for end in ends) or (
            self.values_A is not None and any(end is not None for end in ends)
        ):
            raise ValueError("should have either start_A, stop_A and step_A, or only values_A")
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
                f"both_polarities = true repeats every state with the opposite current, but one current is {lowest:g} "
                "A; all currents should be 0 or more"
            )
        return self

    @property
    def set_points_A(self) -> tuple[float, ...]:
        """The currents in the order of the run, A."""
        forward = self._forward_A()
        one_way = forward + forward[-2::-1] if self.up_and_down else forward
        return one_way + tuple(-current_A for current_A in one_way if current_A) if self.both_polarities else one_way

    def key_of(self, current_A: float) -> str:
        """Return the key in protocol.toml that gives ``current_A``, the smallest or the largest current of the run."""
        if self.values_A is not None:
            return "values_A"
        forward_A = abs(current_A) if self.both_polarities else current_A
        return "start_A" if forward_A == self.start_A else "stop_A"

    def _forward_A(self) -> tuple[float, ...]:
        if self.values_A is not None:
            return self.values_A
        # In decimal arithmetic, 0 + 3 * 0.1 is 0.3 exactly.
        start, stop, step = (Decimal(str(end)) for end in (self.start_A, self.stop_A, self.step_A))
        count = int(abs(stop - start) / step)
        signed = step if stop > start else -step
        return tuple(float(start + k * signed) for k in range(count + 1))


class Ramp(Table):
    """How the current changes between set-points, and how close the measured current must be to the set-point."""

    rate_A_per_s: float = Field(gt=0)
    """Rate of change of the current between states."""
    step_A: float = Field(ge=FINEST_STEP_A)
    """Largest difference between consecutive set-points that are sent during a ramp."""
    tolerance_A: float = Field(gt=0)
    """Largest permitted difference between measured current and set-point in a state. The run stops if the difference
    is larger.
    """
    down_within_s: float = Field(default=2.0, gt=0, le=LONGEST_RAMP_DOWN_S)
    """Longest time in which the current returns to zero at the end of the run. If necessary, the current changes faster
    than rate_A_per_s.
    """


class SupplyLimits(Table):
    """The largest current and the largest voltage to which the program sets the supply."""

    current_A: float = Field(gt=0)
    """Largest current to which the program sets the supply."""
    voltage_V: float = Field(gt=0)
    """Largest voltage to which the program sets the supply."""

    def stricter(self, other: SupplyLimits) -> SupplyLimits:
        """Return the smaller current and the smaller voltage of these limits and of the limits ``other``."""
        return SupplyLimits(
            current_A=min(self.current_A, other.current_A), voltage_V=min(self.voltage_V, other.voltage_V)
        )


class Settle(Table):
    """The criterion by which the program decides from consecutive frames that the beam is at rest."""

    noise_ratio: float = Field(gt=1)
    """Largest permitted ratio of the mean squared difference between two frames to the value that camera noise alone
    causes. For a beam at rest, this ratio is 1.
    """
    pairs: int = Field(ge=1)
    """Number of successive pairs of frames whose ratio (see noise_ratio) must be at most noise_ratio."""
    drift_window_s: float = Field(gt=0)
    """Time between the two frames of an additional pair, whose ratio must also be at most noise_ratio. This test
    detects creep.
    """
    dwell_s: float = Field(default=0.0, ge=0, le=3600)
    """Shortest duration of a state after its current was set. To record creep, give about 60 s."""
    timeout_s: float = Field(gt=0)
    """Longest time to wait for the beam. If the beam is not at rest after this time, the frames are taken nevertheless,
    and the state gets the flag NOT_SETTLED.
    """

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
    """Largest number of frames that are stored while the beam settles in a state; 0 to store no such frames."""


class Conditioning(Table):
    """Cycles of the current from zero to a maximum and back to zero before the run.

    Silicone softens when it is stretched for the first time (L. Mullins, Rubber Chem. Technol. 42 (1969) 339).
    """

    cycles: int = Field(ge=1, le=1000)
    """Number of cycles."""
    current_A: float
    """Maximum of the current in a cycle; usually the largest current of the run."""

    @field_validator("current_A")
    @classmethod
    def _moves(cls, current_A: float) -> float:
        if current_A == 0:
            raise ValueError(
                "does not move the beam; give the largest current of the run, or leave the table [conditioning] (load "
                "cycles before the run) out"
            )
        return current_A


class RingDown(Table):
    """Steps of the current to zero at the end of a run, after which the beam swings freely."""

    seconds: float = Field(gt=0, le=600)
    """Duration of each recording."""
    from_A: float | None = None
    """Current before the step to zero; by default the last current of the run. Give a current if the last one is 0."""
    rate_Hz: float | None = Field(default=None, gt=0)
    """Frames per second that the camera should reach. If the rig file has no camera.frame_rate_Hz, the camera is set to
    this rate.
    """
    repeats: int = Field(default=1, ge=1, le=100)
    """Number of ring-downs."""

    @field_validator("from_A")
    @classmethod
    def _moves(cls, from_A: float | None) -> float | None:
        if from_A == 0:
            raise ValueError(
                "should not be zero, because the beam then does not move; give the current that flows before the "
                "ring-down, or leave the key out to use the last current of the run"
            )
        return from_A


class Protocol(Document):
    """The contents of protocol.toml: the currents of a run, and when the frames are taken at each current."""

    name: str = Field(min_length=1)
    """Name of the protocol."""
    material: str = Field(min_length=1)
    """Material of the specimen; it must be equal to specimen.material in the specimen file."""
    frames_per_state: int = Field(ge=1, le=MOST_FRAMES)
    """Number of frames that are stored in each state when the beam is at rest."""
    current: Currents
    """The set-points of the current: start, stop and step, or a list."""
    ramp: Ramp
    """How the current changes between states, and to zero at the end of the run."""
    limits: SupplyLimits
    """Limits of the supply. The rig file also has limits; the smaller value applies."""
    settle: Settle
    """The criterion by which the program decides that the beam is at rest."""
    tip_force_N: float = Field(default=0.0, ge=0)
    """Force of a weight that hangs at the tip during the run; 0.00981 for one gram."""
    transients: Transients = Transients(frames_per_state=12)
    """Frames that are stored while the beam settles, at logarithmically spaced times."""
    conditioning: Conditioning | None = None
    """Cycles of the current before the run, because silicone softens when it is stretched for the first time."""
    ring_down: RingDown | None = None
    """Ring-downs after the last state: the current steps to zero, and every frame of the free vibration is stored."""
    creep: bool = False
    """Whether creep is recorded: frames at logarithmically spaced times are stored from the change of the current to
    the end of each state. transients.frames_per_state is the number of frames, and settle.dwell_s the shortest
    duration.
    """

    @model_validator(mode="before")
    @classmethod
    def _read_release(cls, content: Any) -> Any:
        """Rename the table `release` of a protocol file to `ring_down`."""
        # Files of early versions have the old name.
        if isinstance(content, dict) and "release" in content and "ring_down" not in content:
            content = {**content, "ring_down": content["release"]}
            del content["release"]
        return content

    @model_validator(mode="after")
    def _records_creep(self) -> Protocol:
        if self.creep and not self.transients.frames_per_state:
            raise ValueError("transients.frames_per_state = 0 should be 1 or more, such as 30, because creep = true")
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
        """The names of keys in protocol.toml and the extreme currents of the run (A) that these keys give."""
        ends = [(f"current.{self.current.key_of(end)}", end) for end in (min(self.currents_A), max(self.currents_A))]
        conditioning = [("conditioning.current_A", self.conditioning.current_A)] if self.conditioning else []
        from_A = self.ring_down.from_A if self.ring_down else None
        ring_down = [("ring_down.from_A", from_A)] if from_A is not None else []
        return (*ends, *conditioning, *ring_down)

    @property
    def recordings(self) -> int:
        """The number of set-points of the current plus the number of ring-downs (free vibrations) in a run."""
        return len(self.currents_A) + (self.ring_down.repeats if self.ring_down else 0)

    @property
    def rate_Hz(self) -> float | None:
        """The frames per second that the protocol requires while the beam swings freely; None without a requirement."""
        return self.ring_down.rate_Hz if self.ring_down else None

    @property
    def ring_down_from_A(self) -> float:
        """The current (A) that flows until it is set to zero, so that the beam swings freely."""
        from_A = self.ring_down.from_A if self.ring_down else None
        return self.currents_A[-1] if from_A is None else from_A

    @property
    def currents_A(self) -> tuple[float, ...]:
        """The currents in the order of the run, A."""
        return self.current.set_points_A


def load_protocol(name: str | Path) -> Protocol:
    """Read a protocol from a path, or a shipped protocol by its name ("dragon_skin_10").

    Raises InputError if the file cannot be read, or is not a valid protocol.
    """
    file = locate(name)
    return parse(Protocol, read_text(file), file)
