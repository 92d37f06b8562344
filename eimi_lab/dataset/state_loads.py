"""Read the loads of each load step from the table of load steps, states.csv."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.csv_tables import Column, Row
from eimi_lab.dataset.points import Load
from eimi_lab.process.errors import InputError

FRAME_COLUMNS = {
    "frame": Column(
        "An image: its path relative to states.csv, its name in the folder with or without the ending, or the number "
        "at the end of its name. For a video: the number of the frame, counted from 0. For a file of a "
        "tracking program (tracked points): the number of the frame as the tracking program counts it.",
        "shot_07.png",
    ),
    "time_s": Column(
        "Instead of frame: time in seconds from the beginning of a video, or of a file of a tracking program if this "
        "file contains times.",
        "12.5",
    ),
}
UNTIL_COLUMNS = {
    "until_s": Column(
        "For a video that `eimi import --every N` reads: time in seconds from the beginning of the video at which the "
        "load ends.",
        "14.0",
        "the load acts until the next row",
    )
}
STATE_COLUMNS = {"state": Column("Instead of frame: number of the state in points.csv.", "0")}
LOAD_COLUMNS = {
    "current_A": Column(
        "Current of the coil. Give either current_A or field_mT. A current other than 0 needs coil_constant_mT_per_A "
        "in the calibration; without a calibration, as for points.csv, give field_mT. For the case without a coil, see "
        "field_mT.",
        "0.3",
    ),
    "field_mT": Column(
        "Field at the magnet. Give either field_mT or current_A. If there is no coil, give field_mT = 0. Both "
        "columns may be absent if there is no coil, if a calibration is given, and if the file has the column "
        "tip_force_N.",
        "1.41",
    ),
    "tip_force_N": Column("Force at the tip, such as a weight.", "0.049", "0"),
    "tip_force_angle_deg": Column(
        "Direction of the tip force in the beam frame, from +x toward +y.", "0", "the direction of gravity"
    ),
    "field_sigma_mT": Column(
        "Standard uncertainty of field_mT, if the field was measured.", "0.02", "the field is exact"
    ),
    "temperature_degC": Column("Measured temperature of the specimen.", "23.5", "not measured"),
}


ABSOLUTE_ZERO_DEGC = -273.15


def load_of(row: Row, calibration: Calibration | None) -> Load:
    """Return the loads (current, field, tip force) and measured conditions in one row of states.csv.

    Parameters
    ----------
    row
        A row of the table, which describes one load step.
    calibration
        The calibration, whose coil constant converts currents into fields; None for tracked points.

    Raises
    ------
    InputError
        If a value is wrong, if the row gives both or neither of current and field, or if the coil constant is needed
        and unknown.
    """
    has_current, has_field = "current_A" in row.cells, "field_mT" in row.cells
    only_weights = "tip_force_N" in row.cells and calibration is not None and not calibration.mT_per_A
    if has_current == has_field and (has_current or not only_weights):
        wrong = "both current_A and field_mT" if has_current else "neither current_A nor field_mT"
        raise InputError(f"{row.path}: row 1: has {wrong}; give one of these columns")
    force = row.number("tip_force_N") if row.cells.get("tip_force_N") else 0.0
    angle = row.number("tip_force_angle_deg") if row.cells.get("tip_force_angle_deg") else None
    sigma = row.number("field_sigma_mT") if row.cells.get("field_sigma_mT") else None
    temperature = row.number("temperature_degC") if row.cells.get("temperature_degC") else None
    if sigma is not None and (sigma < 0 or not has_field):
        raise row.fault("field_sigma_mT", "0 or above, in a table that has the column field_mT")
    if temperature is not None and temperature < ABSOLUTE_ZERO_DEGC:
        raise row.fault("temperature_degC", f"a temperature in degrees Celsius, not below {ABSOLUTE_ZERO_DEGC:g}")
    current, field = None, 0.0
    if has_field:
        field = row.number("field_mT")
        current = field / calibration.mT_per_A if calibration and calibration.mT_per_A else None
    else:
        current = row.number("current_A") if has_current else 0.0
        if calibration and (calibration.mT_per_A or not current):
            field = current * calibration.mT_per_A
        elif calibration:
            raise row.fault("current_A", "0, because the calibration has no coil_constant_mT_per_A")
        elif current:
            raise row.fault(
                "current_A", "0; for tracked points give field_mT instead, because they have no coil constant"
            )
    return Load(current, field, force, angle, sigma, temperature)


def numbered_loads(rows: list[Row]) -> dict[int, Load]:
    """Return the loads in a table of load steps for tracked points, by the number in the column ``state``.

    Raises InputError if a row is wrong, or if two rows have the same number.
    """
    loads: dict[int, Load] = {}
    for row in rows:
        state = row.count("state")
        if state in loads:
            raise row.fault("state", "a number that no earlier row has")
        loads[state] = load_of(row, None)
    return dict(sorted(loads.items()))


def check_directions(states: Path, loads: Sequence[Load], gravity_angle_deg: float | None) -> None:
    """Raise InputError if a tip force has no angle, and the direction of gravity is unknown (None)."""
    for load in loads:
        if gravity_angle_deg is None and load.tip_force_N and load.tip_force_angle_deg is None:
            raise InputError(
                f"{states}: tip_force_N = {load.tip_force_N:g} has no direction, because the direction of gravity is "
                "not known; add a column tip_force_angle_deg with the angle of the force in degrees, from +x (along "
                "the straight beam from the clamp) toward +y (across the beam)"
            )
