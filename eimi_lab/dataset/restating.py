"""A dataset's calibration, corrected by who looked at the pictures; what was found by the old one goes."""

from __future__ import annotations

from pathlib import Path

from eimi_lab.config.calibration import Changes, changed_calibration
from eimi_lab.dataset.layout import note
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.rewriting import rewritten
from eimi_lab.dataset.stored_edges import GROUP as EDGES
from eimi_lab.errors import InputError
from eimi_lab.vision.edges.region import region_of


def change_calibration(path: Path, changes: Changes) -> None:
    """Give a dataset of frames a calibration with other values, and remove its edges. Raises InputError."""
    with open_dataset(path) as dataset:
        if dataset.calibration is None:
            raise InputError(f"{path}: holds tracked points, which need no help in finding the beam")
        calibration = changed_calibration(dataset.calibration, changes)
        region_of(calibration, dataset.frame_format()[0])
    with rewritten(path) as entry:
        del entry["calibration"]
        note(entry, "calibration", calibration.text, "application/toml")
        if EDGES in entry:
            del entry[EDGES]
