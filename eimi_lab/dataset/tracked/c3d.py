"""C3D files of motion capture: markers in three dimensions (c3d.org), read with ezc3d (github.com/pyomeca/ezc3d).

POINT:UNITS holds the unit, and the header holds the number of the first frame. A residual below 0 means that the marker
was not seen.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from eimi_lab.dataset.tracked.numbers_table import refused
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.process.errors import InputError

_UNITS = {"mm": "mm", "cm": "cm", "m": "m", "in": "in", "millimeters": "mm", "meters": "m"}


def read_c3d(path: Path) -> Tracks:
    """Read the markers of a C3D file; frames keep the numbers of the capture. Raises InputError."""
    try:
        import ezc3d
    except ImportError as error:
        raise InputError(f"{path}: C3D needs another package: pip install 'eimi-lab[c3d]'") from error
    try:
        file: Any = ezc3d.c3d(str(path))
        points = np.asarray(file["data"]["points"], dtype=np.float64)[:3]  # (3, n, k)
        parameters, header = file["parameters"]["POINT"], file["header"]["points"]
        labels = [str(label) for label in parameters["LABELS"]["value"]]
        units = [str(unit).strip().lower() for unit in parameters["UNITS"]["value"]] if "UNITS" in parameters else []
        residuals = np.asarray(file["data"]["meta_points"]["residuals"], dtype=np.float64).reshape(-1, points.shape[2])
    except Exception as error:  # ezc3d may raise nearly any error on a damaged file
        raise refused(path, "motion capture (C3D)", " ".join(str(error).split())[:120]) from error
    count = points.shape[1]
    if not count or not points.shape[2]:
        raise InputError(f"{path}: holds no markers")
    places = points.transpose(2, 1, 0).copy()
    if residuals.shape[0] == count:
        places[residuals.T < 0.0] = np.nan
    frames = (
        np.arange(places.shape[0]) + int(header["first_frame"]) + 1
    )  # ezc3d counts the first frame of the header from 0
    rate = float(header["frame_rate"])
    return Tracks(
        names=tuple([*labels, *(f"marker {k + 1}" for k in range(len(labels), count))][:count]),
        frames=frames,
        places=places,
        unit=_UNITS.get(units[0]) if units else None,
        times_s=(frames - frames[0]) / rate if rate > 0 else None,
    )
