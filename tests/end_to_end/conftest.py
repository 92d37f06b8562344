"""Fixtures: commands that run in this process, and datasets of a beam with tracked points."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.laws import LAWS
from eimi_lab import cli

SPECIMEN = """
[specimen]
name = "plain strip"
material = "silicone"
length_mm = 30.0
width_mm = 3.0
depth_mm = 10.0
density_kg_m3 = 1070.0
section = "plane-stress"
"""

Done = Callable[..., list[str]]


class Ended(NamedTuple):
    # The exit status of a command, and its outputs on stdout and stderr.

    status: int
    stdout: str
    stderr: str


@pytest.fixture(scope="session")
def eimi() -> Callable[..., Ended]:
    # Return a function that runs an `eimi` command in a folder, and returns exit status and outputs.
    def eimi(*arguments: str | Path, folder: Path) -> Ended:
        out, err = io.StringIO(), io.StringIO()
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
            patch.chdir(folder)
            patch.setattr(sys, "argv", ["eimi", *map(str, arguments)])
            patch.setattr(cli, "unwind_on_termination", lambda: None)
            with pytest.raises(SystemExit) as exit_:
                cli.main()
        return Ended(int(exit_.value.code or 0), out.getvalue(), err.getvalue())

    return eimi


@pytest.fixture(scope="session")
def done(eimi: Callable[..., Ended]) -> Callable[..., list[str]]:
    # Return a function that runs a command, which must succeed, and returns its printed lines.
    def done(*arguments: str | Path, folder: Path) -> list[str]:
        ended = eimi(*arguments, folder=folder)
        assert ended.status == 0, ended.stderr
        return ended.stdout.splitlines()

    return done


def track_points(done: Done, folder: Path, name: str, forces_N: list[float], modulus_Pa: float) -> None:
    # Import tracked points of a neo-Hookean beam under tip forces (N) as the dataset `name`.h5.
    # modulus_Pa : shear modulus
    model = BeamModel(Specimen(30.0, 3.0, 10.0, 1070.0, "plane-stress")).refined().halved()
    loads = Loads.along([0.0] * len(forces_N), 90.0, 90.0, forces_N)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[modulus_Pa]]), loads)
    rest = np.column_stack([np.linspace(5, 29, 9), np.zeros(9)])
    places = model.positions(shapes, rest)[0]
    rows = [
        f"{k},p{i},{rest[i, 0]},{rest[i, 1]},{x:.6f},{y:.6f},0.01"
        for k, state in enumerate(places)
        for i, (x, y) in enumerate(state)
    ]
    (folder / f"{name}.csv").write_text("\n".join(["state,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm", *rows]) + "\n")
    states = [f"{k},0.0,{force}" for k, force in enumerate(forces_N)]
    (folder / f"{name}_states.csv").write_text("\n".join(["state,field_mT,tip_force_N", *states]) + "\n")
    (folder / "specimen.toml").write_text(SPECIMEN)
    tables = ("--states", f"{name}_states.csv", "--specimen", "specimen.toml", "--gravity-angle", "90")
    done("import", f"{name}.csv", *tables, "-o", f"{name}.h5", folder=folder)


@pytest.fixture(scope="module")
def folder(done: Done, tmp_path_factory: pytest.TempPathFactory) -> Path:
    # A folder with two datasets of one beam, a fit of the first, and tensile fits of a stiffer material.
    folder = tmp_path_factory.mktemp("validate")
    track_points(done, folder, "train", [0.0, 0.001, 0.002], 46e3)
    track_points(done, folder, "unseen", [0.0005, 0.0015, 0.003], 46e3)
    done("fit", "train.h5", "--model", "neo-hookean", "-o", "fits.json", folder=folder)
    strain = np.linspace(0.02, 1.0, 30)
    stress = 60 * (1 + strain - (1 + strain) ** -2)
    rows = [f"{e},{s}" for e, s in zip(strain, stress, strict=True)]
    (folder / "curve.csv").write_text("\n".join(["strain,stress_kPa", *rows]) + "\n")
    windows = ("--window", "20", "--window", "full")
    done("tensile", "curve.csv", "--model", "neo-hookean", *windows, "-o", "tensile.json", folder=folder)
    return folder
