"""A program that uses every public name passes mypy --strict; a program that misuses the names does not."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PROGRAM = """
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import eimi_lab as eimi


def chain(folder: Path) -> float:
    steps = eimi.acquire("dragon_skin_10", "type1", "virtual", dry_run=True)
    events: list[eimi.Event] = []
    run = eimi.acquire(
        "dragon_skin_10", "type1", "virtual", folder / "run.h5", note=steps.lines[0], on_event=events.append
    )
    taken = eimi.import_pictures(folder, "states.csv", run.specimen, "calibration.toml", "taken.h5", clamp=(1.0, 2.0))
    eimi.import_points("points.csv", "states.csv", "type1", "points.h5", gravity_angle=0.0).close()
    with eimi.import_motion("flick.mp4", "type1", "flick.h5", along=[(1.0, 2.0), (3.0, 4.0)], rate=240.0) as flick:
        durations = [motion.duration_s for motion in flick.ring_downs()]
    with eimi.segment(taken, workers=2) as segmented:
        images = segmented.images(0)
    prior = eimi.Prior("C10", 20e3, 500.0)
    fit: eimi.FitRecord = eimi.fit(
        [run, folder / "other.h5", "third.h5"], "yeoh", prior=[prior, "C20=1,2"], free="width=0.02"
    )
    fits: eimi.Fits = eimi.fit(run, ["yeoh", "ogden"], seed=[1, 2], each=True)
    first = fits[0]
    distances: NDArray[np.float64] = fit.residuals().distance_mm
    tensile = eimi.tensile("curve.csv", "yeoh", window=[20, "full"])
    terms: str = eimi.discover(run, tensile="curve.csv").statement
    shapes = eimi.simulate([0.0, 1.0], "type1", "neo-hookean", parameter={"mu": 46e3}).tip_mm
    judged: eimi.Validations = eimi.validate(run, [fit, "fits.json", tensile])
    planned = eimi.plan(fit, "dragon_skin_10", ["type1"], "virtual", states=4).protocol.currents_A
    page = eimi.report([run], "report.html", fit=fit).path
    card: str = eimi.export(fits, "yeoh", to="abaqus", bulk_ratio=2000.0)
    names: list[str] = [*eimi.LAWS, *eimi.SUPPLIES, *eimi.CAMERAS, eimi.__version__, terms, card, page.name]
    errors = [own.mean_error_mm for own in judged]
    print(images.shape, first.model, distances.shape, shapes.shape, planned, names, errors, durations)
    return fit.initial_shear_modulus.value


try:
    chain(Path("."))
except eimi.InputError as error:
    print(error)
"""
WRONG = {
    "a law that is no text": ('eimi.fit("run.h5", 3)', "call-overload"),
    "an option that is none": ('eimi.segment("run.h5", worker=2)', "call-arg"),
    "a section that is none": ('eimi.validate("run.h5", "fits.json", section="plane")', "arg-type"),
    "a name that is none": ("eimi.fitt", "attr-defined"),
    "an attribute that is none": ('eimi.fit("run.h5", "yeoh").modulus', "attr-defined"),
}


def checked(text: str, folder: Path) -> str:
    # Return the output of mypy for a program outside the repository.
    (folder / "client.py").write_text(text, encoding="utf-8")
    environment = os.environ | {"MYPYPATH": os.pathsep.join(map(str, (ROOT, ROOT / "drivers", ROOT / "fitting")))}
    options = ["--strict", "--follow-imports=silent", "--no-error-summary", "--config-file=", f"--cache-dir={CACHE}"]
    command = [sys.executable, "-m", "mypy", *options, "--explicit-package-bases", "client.py"]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False).stdout


CACHE = ROOT / ".mypy_cache" / "client"


def test_a_program_with_every_public_name_is_typed(tmp_path: Path) -> None:
    assert checked(PROGRAM, tmp_path) == ""


def test_the_type_checker_reports_a_wrong_program(tmp_path: Path) -> None:
    lines = checked("import eimi_lab as eimi\n" + "\n".join(line for line, _ in WRONG.values()), tmp_path).splitlines()
    errors = [line for line in lines if ": error: " in line]
    assert [line.rsplit("[", 1)[1].rstrip("]") for line in errors] == [kind for _, kind in WRONG.values()], lines


@pytest.mark.parametrize("package", ["eimi_lab", "drivers/eimi_drivers", "fitting/eimi_fitting"])
def test_a_package_says_that_it_is_typed(package: str) -> None:
    assert (ROOT / package / "py.typed").is_file()
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    assert package.rsplit("/", 1)[-1] in settings["packages"]
    assert "py.typed" in settings["package-data"]["*"]
