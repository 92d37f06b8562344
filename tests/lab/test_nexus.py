"""Datasets are valid NeXus files: the checker of the package `nexusformat` finds no error and no warning."""

# The package is no dependency, because its own dependencies are large: `pip install nexusformat`.

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_drivers.cameras.settings import CameraSettings
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.specimen import load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.dataset.importing import import_frames
from eimi_lab.dataset.recovery import recover
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.dataset.tracked.points_csv import import_points
from eimi_lab.vision.check import Flag
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from tests.lab.test_sensing import HALL, ROOM, Emulated

validate = pytest.importorskip("nexusformat.nexus.validate", reason="needs `pip install nexusformat`")

NO_FAULT = (0, 0)
POINTS = np.arange(10.0).reshape(5, 2)


def faults(path: Path) -> tuple[int, int]:
    # Return how many warnings and errors the NeXus checker finds.
    validate.logger.setLevel("INFO")
    return validate.validate_file(str(path))


def put_edges(path: Path, states: int) -> None:
    edge = EdgePoints(POINTS, POINTS[:, 0] + 0.01)
    write_edges(path, [EdgeSet(edge, edge, (Flag("LOW_CONTRAST", 3.0, 20.0, "Light."),), POINTS[:4])] * states)


def test_the_checker_reports_faults(setup: Any) -> None:
    setup.run()
    with h5py.File(setup.path, "r+") as file:
        file["entry/data"].attrs["signal"] = "nothing"
        file["entry/instrument"].attrs["NX_class"] = "NXcoil"
    warnings, errors = faults(setup.path)
    assert warnings + errors >= 2


def test_an_acquired_dataset_has_no_fault(setup: Any) -> None:
    settings = CameraSettings(exposure_s=0.01, gain=6.0, gamma=1.0, region=(0, 0, 128, 96), bit_depth=8)
    setup.bench = replace(setup.bench, camera_settings=settings)
    between = "ring_down = { seconds = 0.1 }\nconditioning = { cycles = 2, current_A = 0.3 }\n"
    setup.protocol = parse(Protocol, between + setup.protocol.text, "p")
    setup.run(note="first cast")
    assert faults(setup.path) == NO_FAULT
    put_edges(setup.path, 4)
    assert faults(setup.path) == NO_FAULT
    recover(setup.path, setup.path.with_name("whole.h5"))
    assert faults(setup.path.with_name("whole.h5")) == NO_FAULT


@pytest.mark.parametrize("average", [False, True])
def test_an_imported_dataset_has_no_fault(pictures: Path, average: bool) -> None:
    specimen, calibration = load_specimen(pictures / "specimen.toml"), load_calibration(pictures / "calibration.toml")
    path = pictures / "imported.h5"
    states = import_frames(pictures / "frames", pictures / "states.csv", specimen, calibration, path, average=average)
    assert faults(path) == NO_FAULT
    put_edges(path, states)
    assert faults(path) == NO_FAULT


def test_a_dataset_of_tracked_points_has_no_fault(files: Path) -> None:
    (files / "points.csv").write_text(
        "state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm\n0,a,5,0,5,0,0.1\n1,a,5,0,5,0.2,0.1\n"
    )
    (files / "states.csv").write_text("state,field_mT,tip_force_N\n0,0,0\n1,2.5,0.001\n")
    specimen = load_specimen(files / "specimen.toml")
    import_points(files / "points.csv", files / "states.csv", specimen, 0.0, files / "points.h5")
    assert faults(files / "points.h5") == NO_FAULT


def test_a_dataset_with_sensors_has_no_fault(setup: Any) -> None:
    Emulated(setup, HALL, ROOM)
    setup.run()
    assert faults(setup.path) == NO_FAULT
