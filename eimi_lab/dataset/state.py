"""One load step of the specimen: its loads and its flags (defects), as read from a dataset."""

from __future__ import annotations

from dataclasses import dataclass

from eimi_lab.vision.check import Flag


@dataclass(frozen=True)
class State:
    """One load step of the specimen: its loads and its flags (names of defects).

    Parameters
    ----------
    index
        Number of the load step, from 0.
    current_A, measured_A
        Set current, and mean of the measured currents, A; None if unknown.
    field_mT
        Field at the magnet, mT.
    tip_force_N
        Force at the tip, N.
    flags
        Defects that were found during the run or the import.
    tip_force_angle_deg
        Direction of the tip force, degrees from +x (along the straight beam) toward +y (across); None if the force has
        the direction of gravity.
    field_sigma_mT
        Standard uncertainty of the measured field, mT; None if the field was not measured in this load step.
    temperature_degC
        Measured temperature of the specimen, °C; None if not measured.
    """

    index: int
    current_A: float | None
    measured_A: float | None
    field_mT: float
    tip_force_N: float
    flags: tuple[Flag, ...]
    tip_force_angle_deg: float | None = None
    field_sigma_mT: float | None = None
    temperature_degC: float | None = None
