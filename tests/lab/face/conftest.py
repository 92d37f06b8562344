"""Fixtures: a run of three states on the virtual rig, with a coarse mesh."""

from __future__ import annotations

import re
import shutil
from importlib.resources import files
from pathlib import Path

import pytest

import eimi_lab as eimi
from eimi_lab.fits.records import FitRecord

SHIPPED = Path(str(files("eimi_lab.protocols")))


@pytest.fixture(scope="package")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # A folder with protocol.toml, specimen.toml, rig.toml, and the dataset run.h5 with edges.
    folder = tmp_path_factory.mktemp("bench")
    protocol = (SHIPPED / "dragon_skin_10_quick.toml").read_text(encoding="utf-8")
    protocol = re.sub(r"start_A = .*\nstop_A = .*\nstep_A = .*\n", "values_A = [0.0, 0.8, 1.5]\n", protocol, count=1)
    (folder / "protocol.toml").write_text(protocol.replace("frames_per_state = 12", "frames_per_state = 0"))
    specimen = (SHIPPED / "specimens" / "type1.toml").read_text(encoding="utf-8")
    (folder / "specimen.toml").write_text(specimen.replace('section = "solid"', 'section = "plane-stress"'))
    for path in (SHIPPED / "rigs").glob("virtual*.toml"):
        name = "rig.toml" if path.stem == "virtual" else path.name
        text = re.sub(r"^mesh = \[.*\]", "mesh = [13, 1, 1]", path.read_text(encoding="utf-8"), flags=re.M)
        (folder / name).write_text(text, encoding="utf-8")
    run = eimi.acquire(folder / "protocol.toml", folder / "specimen.toml", folder / "rig.toml", folder / "run.h5")
    eimi.segment(run).close()
    return folder


@pytest.fixture
def run(bench: Path, tmp_path: Path) -> Path:
    # A copy of the dataset `run.h5` that a test may change.
    return Path(shutil.copy(bench / "run.h5", tmp_path))


@pytest.fixture(scope="package")
def fitted(bench: Path) -> FitRecord:
    # The fit of the neo-Hookean law to the dataset `run.h5`.
    return eimi.fit(bench / "run.h5", "neo-hookean")
