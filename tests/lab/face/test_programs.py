"""Ten programs of users, each of at most twenty lines, work with the public names of eimi_lab alone."""

from __future__ import annotations

import ast
import runpy
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eimi_lab as eimi
from eimi_drivers.clock import WallClock
from eimi_drivers.emulators import CoilSupply, emulate, serve_pty

PROGRAMS = Path(__file__).parent / "programs"
NAMES = sorted(path.name for path in PROGRAMS.glob("*.py"))
FOUND_PA = 49.2e3  # fitted in plane stress; the true modulus of the coarse solid is 46.39 kPa
MOST_LINES = 20
PUBLIC = {"eimi_lab", "eimi_fitting", "eimi_fitting.laws"}


def code_lines(text: str) -> int:
    # Return the number of lines of a program without its docstring and without empty lines.
    return len([line for line in text.split('"""', 2)[2].splitlines() if line.strip()])


@pytest.fixture(scope="module")
def again(bench: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    toml = [bench / f"{name}.toml" for name in ("protocol", "specimen", "rig")]
    path = tmp_path_factory.mktemp("again") / "run.h5"
    eimi.acquire(toml[0], toml[1], toml[2], path, note="again").close()
    return path


@pytest.fixture
def folder(bench: Path, again: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    # The working directory: run.h5, its TOML files, two datasets in `runs`, and frames.npy, an array of frames.
    shutil.copytree(bench, tmp_path, dirs_exist_ok=True)
    (tmp_path / "runs").mkdir()
    shutil.copy(bench / "run.h5", tmp_path / "runs" / "a.h5")
    shutil.copy(again, tmp_path / "runs" / "b.h5")
    with eimi.open(bench / "run.h5") as run:
        np.save(tmp_path / "frames.npy", [run.images(state.index, most=1)[0] for state in run.states])
    monkeypatch.chdir(tmp_path)
    return tmp_path


@contextmanager
def rig(files: Path, supply: str, camera: str, source: str) -> Iterator[CoilSupply]:
    # Serve an emulated SCPI supply, and write `files`/rig.toml with its address; yield the supply.
    # supply, camera: names of drivers. source: where the camera takes its frames from.
    coil = CoilSupply(WallClock())
    with serve_pty(emulate("scpi", coil)) as port:
        playback = ", playback = { picture_a_state = true }" if camera == "opencv" else ""
        limits = "limits = { current_A = 1.0, voltage_V = 10.0 }"
        (files / "rig.toml").write_text(f"""
name = "outside"
calibration = "calibration.toml"
supply = {{ driver = "{supply}", address = "{port}", {limits} }}
camera = {{ driver = "{camera}", source = "{source}"{playback} }}
""")
        yield coil


def result_of(name: str) -> Any:
    return runpy.run_path(str(PROGRAMS / name))["result"]


@pytest.mark.parametrize("name", NAMES)
def test_a_program_is_short_and_uses_public_names_alone(name: str) -> None:
    text = (PROGRAMS / name).read_text(encoding="utf-8")
    assert code_lines(text) <= MOST_LINES
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("eimi_"):
            assert node.module in PUBLIC or (node.module or "").startswith("eimi_drivers.")


def test_there_are_ten_programs() -> None:
    assert len(NAMES) == 10


def test_a_custom_law_is_fitted(folder: Path) -> None:
    try:
        assert result_of("custom_law.py") == pytest.approx(FOUND_PA, rel=0.02)
    finally:
        eimi.LAWS.pop("stiffening", None)


def test_a_custom_supply_runs_a_protocol(files: Path, pictures: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(files)
    with rig(files, "mine", "opencv", str(pictures / "frames")) as coil:
        try:
            assert result_of("custom_supply.py") == pytest.approx([0.0, 0.1, 0.2, 0.3], abs=0.005)
        finally:
            del eimi.SUPPLIES["mine"]
    assert not coil.state.output


def test_a_custom_camera_takes_the_frames_of_a_run(files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(files)
    with rig(files, "scpi", "eye", "wall") as coil:
        try:
            assert result_of("custom_camera.py") == (2, 96, 128)
        finally:
            del eimi.CAMERAS["eye"]
    assert not coil.state.output


def test_a_custom_actuation_bends_as_beam_theory_predicts() -> None:
    angle = result_of("custom_actuation.py")
    stiffness_N_mm2 = 3 * 46e3 * 1e-6 * 5.0 * 3.0**3 / 12
    assert angle == pytest.approx(np.degrees(np.array([0.0, 0.001, 0.002]) * 26.0 / stiffness_N_mm2), rel=0.03)


def test_a_folder_is_fitted_dataset_by_dataset(folder: Path) -> None:
    rows = result_of("batch_over_a_folder.py")
    assert [row.split(",")[0] for row in rows] == ["dataset", "a.h5", "b.h5"]
    assert (folder / "moduli.csv").read_text().splitlines() == rows
    assert eimi.open_fits(folder / "runs" / "b.json")[0].model == "neo-hookean"


def test_several_datasets_are_fitted_together(folder: Path) -> None:
    datasets, best, modulus_Pa = result_of("joint_fit.py")
    assert datasets == 2
    assert best in ("neo-hookean", "yeoh")
    assert modulus_Pa == pytest.approx(FOUND_PA, rel=0.02)


def test_a_prior_determines_a_parameter_that_bending_does_not_determine(folder: Path) -> None:
    without, with_prior, (low, high) = result_of("prior_on_a_parameter.py")
    assert without
    assert not with_prior
    assert low < 16e3 < high
    assert high - low == pytest.approx(2 * 1.96 * 400.0, rel=0.15)


def test_residuals_are_arrays(folder: Path) -> None:
    distances = result_of("residuals_as_arrays.py")
    assert len(distances) > 100
    assert np.isfinite(distances).all()


def test_the_solid_and_its_planar_model_give_different_tips() -> None:
    solid, planar = result_of("forward_curve_of_the_solid.py")
    assert solid[0] == pytest.approx(0.0, abs=1e-6)
    assert solid[-1] > 20
    assert 0.05 < abs(solid[-1] - planar[-1]) < 1.5


def test_frames_of_another_program_identify_the_material(folder: Path) -> None:
    assert result_of("frames_from_another_program.py") == pytest.approx(FOUND_PA, rel=0.02)
