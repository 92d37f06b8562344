"""Read motions from the file of a tracking program."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eimi_fitting.time.measured import Motion
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.moving.free_motion import free_motions
from eimi_lab.dataset.moving.motion_facts import MotionFacts
from eimi_lab.dataset.tracked.axes import Placing, place
from eimi_lab.dataset.tracked.formats import reader_of
from eimi_lab.dataset.tracked.tracked_states import points_on_beam
from eimi_lab.process.errors import InputError


def read_tracked_motion(
    source: Path, tool: str, specimen: SpecimenFile, placing: Placing, facts: MotionFacts
) -> tuple[Motion, ...]:
    """Read motions from the file of a tracking program.

    Tracked points that do not lie on the undeformed beam are left out.

    Parameters
    ----------
    source : Path
        The file or the folder that the tracking program wrote.
    tool : str
        Name of the program, such as "tracker" or "dltdv".
    specimen : SpecimenFile
        The specimen.
    placing : Placing
        The rule by which coordinates of the file are converted into the beam frame (x along the straight beam from the
        clamp, y across; mm).
    facts : MotionFacts
        Facts that the user gives. If `rate_Hz` is given, the times follow from this rate instead of the file.

    Returns
    -------
    tuple of Motion
        One motion for each time that the beam was flicked (pushed briefly so that it swings).

    Raises
    ------
    InputError
        If a file is wrong, if information is missing, or if no point is on the beam.
    """
    placed = place(reader_of(tool)(source), placing, str(source))
    tracks = placed.tracks
    if facts.rate_Hz is not None:
        frame_s = (tracks.frames - tracks.frames[0]) / facts.rate_Hz
    elif tracks.times_s is not None:
        frame_s = np.asarray(tracks.times_s, dtype=float)
    else:
        raise InputError(f"{source}: has no times; give --rate, the frames per second")
    chosen = points_on_beam(placed, list(range(len(frame_s))), specimen, source)
    places = placed.places_mm[:, chosen]
    time_s = np.repeat(frame_s[:, None], len(chosen), axis=1)
    return free_motions(places, placed.rest_mm[chosen], time_s, placed.sigma_mm[:, chosen], facts, str(source))
