"""One state of the specimen: its loads and its flags, as read from a dataset."""

from __future__ import annotations

from dataclasses import dataclass

from eimi_lab.vision.check import Flag


@dataclass(frozen=True)
class State:
    """One state of the specimen with its loads and flags.

    Parameters
    ----------
    index
        Number of the state, from 0.
    current_A, measured_A
        The set-point of the coil current, and the mean of the currents that were measured in the state; each is None if
        unknown.
    field_mT
        Field at the magnet.
    tip_force_N
        Force at the tip.
    flags
        Flags that the run or the import gave to the state; the flags of segmentation belong to the edges.
    tip_force_angle_deg
        Direction of the tip force in the beam frame, from +x toward +y; None for the direction of gravity.
    field_sigma_mT
        Standard uncertainty of a field that was measured in this state; None if the field was computed from the
        current.
    temperature_degC
        Measured temperature of the specimen; None if it was not measured.
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
