"""Write the rig file for a program that measures on a simulated bench, and add parameters of a simulation to a rig."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from eimi_lab.config.rig import VIRTUAL, Rig, load_rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.config.toml import table_text
from eimi_lab.process.outputs import write_file
from eimi_lab.vision.beam_frame import BeamFrame

DIALECT_OF_THE_VIRTUAL_SUPPLY = "korad"
GIGE_DRIVER = "aravis"

_ROUND_PX = 16
_BESIDE = 0.7
"""The distance that the pictures show on each side of the beam, as a fraction of the beam's length.

The value is used for a rig without a table [virtual] and without a region of the camera.
"""


def with_virtual_table(rig: Rig, specimen: SpecimenFile) -> Rig:
    """Return a rig that can be simulated: with a virtual camera and with the parameters of the table [virtual].

    A rig without this table gets the table of the virtual rig that is shipped with eimi-lab.
    """
    if rig.virtual is not None:
        return rig
    shipped = load_rig("virtual").virtual
    assert shipped is not None
    size_px = rig.camera.region[2:] if rig.camera.region else _size_that_shows(rig, specimen)
    camera = rig.camera.model_copy(update={"driver": VIRTUAL})
    return rig.model_copy(update={"virtual": shipped.model_copy(update={"frame_size_px": size_px}), "camera": camera})


def _size_that_shows(rig: Rig, specimen: SpecimenFile) -> tuple[int, int]:
    length_mm = specimen.specimen.length_mm
    corners_mm = length_mm * np.array([[-0.1, -_BESIDE], [-0.1, _BESIDE], [1.1, -_BESIDE], [1.1, _BESIDE]])
    farthest_px = BeamFrame(rig.calibration).to_px(corners_mm).max(axis=0)
    width, height = (_ROUND_PX * int(np.ceil(max(px, _ROUND_PX) / _ROUND_PX)) for px in farthest_px)
    return width, height


def write_client_rig(
    rig: Rig, path: Path, supply_address: str, camera_address: str, sensor_addresses: Mapping[str, str], force: bool
) -> None:
    """Write the rig file and the calibration file with which another program can measure on a simulated bench.

    The files do not contain the true material. The camera is a GigE camera.

    Parameters
    ----------
    rig : Rig
        The rig of the simulated bench.
    path : Path
        The rig file to write. The name of the calibration file is the same name with "_calibration" added.
    supply_address, camera_address : str
        Addresses of supply and camera.
    sensor_addresses : mapping of str
        Addresses of the sensors, by the names of the sensors.
    force : bool
        True if existing files are replaced.

    Raises
    ------
    InputError
        If one of the files exists and ``force`` is false.
    """
    calibration = path.with_name(f"{path.stem}_calibration.toml")
    given = rig.model_dump(exclude_unset=True, exclude_none=True, exclude={"calibration", "virtual"})
    supply = given["supply"]
    if supply["driver"] == VIRTUAL:
        supply["driver"] = DIALECT_OF_THE_VIRTUAL_SUPPLY
    supply["address"] = supply_address
    camera = {**given["camera"], "driver": GIGE_DRIVER, "source": camera_address}
    camera.pop("playback", None)
    sensors = [
        {**sensor, "address": sensor_addresses.get(sensor["name"], sensor["address"])}
        for sensor in given.get("sensors", ())
    ]
    table: dict[str, Any] = {"name": given.pop("name"), "calibration": calibration.name, **given, "camera": camera}
    if sensors:
        table["sensors"] = sensors
    write_file(calibration, rig.calibration.text, force)
    write_file(path, f"# An emulated bench. The addresses are valid while it is served.\n{table_text(table)}", force)
