"""One loading of the specimen, as a dataset tells it."""

from __future__ import annotations

from dataclasses import dataclass

from eimi_lab.vision.check import Flag


@dataclass(frozen=True)
class State:
    """One loading. current_A is what was set, measured_A the mean read back; None where it was never known.

    tip_force_angle_deg: direction of the tip force in the beam frame, from +x toward +y; None for along gravity.
    """

    index: int
    current_A: float | None
    measured_A: float | None
    field_mT: float
    tip_force_N: float
    flags: tuple[Flag, ...]
    tip_force_angle_deg: float | None = None
