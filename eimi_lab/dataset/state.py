"""One state (load step) of the specimen: its loads and its flags (defects), as read from a dataset."""

from __future__ import annotations

from dataclasses import dataclass

from eimi_lab.vision.check import Flag


@dataclass(frozen=True)
class State:
    """One state (load step) of the specimen: its loads and its flags, which are the names of its defects.

    Parameters
    ----------
    index
        Number of the state, from 0.
    current_A, measured_A
        The set-point of the coil current, and the mean of the currents that were measured in the state, A; each is None
        if unknown.
    field_mT
        Field at the magnet, mT.
    tip_force_N
        Force at the tip, N.
    flags
        Defects that were found during the run or the import. The defects that the search for edges finds are stored
        with the edges.
    tip_force_angle_deg
        Direction of the tip force in the beam frame (x along the straight beam from the clamp, y across), degrees from
        +x toward +y; None for the direction of gravity.
    field_sigma_mT
        Standard uncertainty of a field that was measured in this state, mT; None if the field was computed from the
        current.
    temperature_degC
        Measured temperature of the specimen, °C; None if the temperature was not measured.
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
