"""Read motions (positions of points over time) from the file of a tracking program."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eimi_fitting.beam.strip import Strip
from eimi_fitting.time.measured import Motion
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.moving.free_motion import free_motions
from eimi_lab.dataset.moving.motion_facts import MotionFacts
from eimi_lab.dataset.tracked.axes import Placing, place
from eimi_lab.dataset.tracked.formats import reader_of
from eimi_lab.dataset.tracked.tracked_states import points_on_beam
from eimi_lab.process.errors import InputError, tell

_OFF_THE_BEAM = 0.05  # share of the length


def read_tracked_motion(
    source: Path, tool: str, specimen: SpecimenFile, placing: Placing, facts: MotionFacts
) -> tuple[Motion, ...]:
    """Read motions from the file of a tracking program.

    A marker is used if its distance from the beam is at most 5 % of the beam's length. It then gives the motion of the
    nearest point of the beam.

    Parameters
    ----------
    source : Path
        The file or the folder that the tracking program wrote.
    tool : str
        Name of the program, such as "tracker" or "dltdv".
    specimen : SpecimenFile
        The specimen.
    placing : Placing
        How coordinates are converted into mm along and across the straight beam.
    facts : MotionFacts
        Facts about the recording that the user gives. A frame rate replaces the times in the file.

    Returns
    -------
    tuple of Motion
        One motion for each time that the beam was pushed briefly.

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
    beam = specimen.specimen
    chosen = points_on_beam(placed, list(range(len(frame_s))), specimen, source, _OFF_THE_BEAM * beam.length_mm)
    if tool == "c3d" and not facts.hanging_N:
        # A cantilever in its lowest vibration moves like 33/140 of its mass at the tip.
        moving_g = 33 / 140 * 1e-6 * beam.density_kg_m3 * beam.length_mm * beam.width_mm * beam.depth_mm
        tell(
            f"note: {source}: markers count as weightless, but each gram at the tip raises the dynamic modulus by "
            f"about {100 / moving_g:.2g} %; if their weight matters, give it with --hanging"
        )
    rest = Strip(specimen.mechanics()).nearest(placed.rest_mm[chosen])
    places = placed.places_mm[:, chosen] + (rest - placed.rest_mm[chosen])
    time_s = np.repeat(frame_s[:, None], len(chosen), axis=1)
    return free_motions(places, rest, time_s, placed.sigma_mm[:, chosen], facts, str(source))
