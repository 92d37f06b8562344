"""Write imported motions (positions of points over time) into a new dataset, or into a dataset of the same beam."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py

from eimi_fitting.time.measured import Motion
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.layout import WRITTEN_AS, Header
from eimi_lab.dataset.moving.stored_motions import write_motions
from eimi_lab.dataset.points import write_points
from eimi_lab.dataset.rewriting import rewritten
from eimi_lab.process.outputs import whole_file
from eimi_lab.process.replacing import patiently
from eimi_lab.vision.beam_frame import BeamFrame


def write_motion_dataset(
    path: Path,
    motions: Sequence[Motion],
    specimen: SpecimenFile,
    calibration: Calibration | None = None,
    gravity_angle_deg: float | None = None,
    gravity: bool = True,
    force: bool = False,
) -> None:
    """Write a new dataset that contains only motions (positions of points of the beam over time).

    Parameters
    ----------
    path : Path
        The dataset.
    motions : sequence of Motion
        Either free oscillations or creep; at least one motion.
    specimen : SpecimenFile
        The specimen.
    calibration : Calibration, optional
        Calibration of the pictures; None for tracked points.
    gravity_angle_deg : float, optional
        Direction of gravity, degrees from +x (along the straight beam) toward +y; used only without a calibration.
    gravity : bool
        Whether the simulation of the beam includes its weight; used only without a calibration.
    force : bool
        Whether an existing file is overwritten.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if calibration is not None:
        gravity_angle_deg, gravity = BeamFrame(calibration).gravity_deg, calibration.gravity
    with whole_file(path, force) as temporary:
        header = Header(specimen=specimen, calibration=calibration)
        write_points(temporary, header, gravity_angle_deg or 0.0, [], [], gravity)
        with patiently(lambda: h5py.File(temporary, "r+", libver=WRITTEN_AS)) as file:
            write_motions(file["entry"], motions[0].kind, motions, specimen.specimen.length_mm)


def add_motions(path: Path, motions: Sequence[Motion], specimen: SpecimenFile) -> None:
    """Store free oscillations, or creep, in a dataset of the same beam; they replace stored motions of the same kind.

    Parameters
    ----------
    path : Path
        The dataset.
    motions : sequence of Motion
        Either free oscillations or creep; at least one motion.
    specimen : SpecimenFile
        The specimen.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    size = sum(motion.points_mm.nbytes + 4 * motion.time_s.nbytes for motion in motions)
    with rewritten(path, size) as entry:
        write_motions(entry, motions[0].kind, motions, specimen.specimen.length_mm)
