"""Datasets comply with NXsensor_scan, a set of rules of the file standard NeXus."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet

POINTS = np.arange(10.0).reshape(5, 2)
EDGES = EdgeSet(EdgePoints(POINTS, POINTS[:, 0] + 0.01), EdgePoints(POINTS, POINTS[:, 0] + 0.01), (), POINTS[:4])


def dates(path: Path) -> dict[str, Any]:
    with h5py.File(path) as file:
        return {
            name: entry.asstr()[()] if entry.dtype.hasobject else entry
            for name in ("entry/start_time", "entry/end_time", "entry/segmentation/date")
            if (entry := file.get(name)) is not None
        }


def test_a_dataset_contains_the_name_of_its_definition_and_its_start_time(setup: Any) -> None:
    setup.run()
    with h5py.File(setup.path) as file:
        assert file["entry/definition"][()] == b"NXsensor_scan"
        assert file["entry/definition"].attrs["version"] == "1.0"
        assert "end_time" not in file["entry"]
        ends = file["entry/sessions/end"][()]
    assert isinstance(dates(setup.path)["entry/start_time"], str)
    assert len(ends) == 1
    with open_dataset(setup.path) as dataset:
        start = dataset.start_time()
        assert start.isoformat() == dates(setup.path)["entry/start_time"]
    assert ends[0].decode() >= start.isoformat()


def test_after_edges_are_stored_the_dataset_contains_their_program_their_date_and_the_end_of_the_run(
    setup: Any,
) -> None:
    setup.run()
    write_edges(setup.path, [EDGES] * 4)
    write_edges(setup.path, [EDGES] * 4)
    with h5py.File(setup.path) as file:
        program = file["entry/segmentation/program"].attrs
        assert program["version"]
        assert program["program_url"].startswith("https://")
        end = file["entry/sessions/end"][0].decode()
    assert all(isinstance(date, str) for date in dates(setup.path).values())
    assert dates(setup.path)["entry/end_time"] == end


@pytest.mark.skipif(shutil.which("pynx") is None, reason="needs the program pynx (`pip install pynxtools`)")
def test_pynx_finds_a_dataset_valid(setup: Any) -> None:
    setup.run()
    for _ in ("as it was acquired", "with edges"):
        answer = subprocess.run(["pynx", "validate", setup.path], capture_output=True, text=True, check=True)
        assert "is valid according to the `NXsensor_scan`" in answer.stdout + answer.stderr
        write_edges(setup.path, [EDGES] * 4)
