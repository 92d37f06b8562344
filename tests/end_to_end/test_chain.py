"""A user's commands work one after another: demonstration, fits and validations."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import pytest

from eimi_fitting.laws import LAWS
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.vision.flags import judge
from tests.patience import PATIENCE_S

README = Path(__file__).parents[2] / "README.md"
PAPER = Path(__file__).parents[2] / "docs" / "why" / "paper.md"
VIRTUAL = Path(__file__).parents[2] / "protocols" / "rigs"


def moduli(fits: Path) -> dict[str, float]:
    return {f["model"]: f["initial_shear_modulus"]["value"] for f in json.loads(fits.read_text())["fits"]}


def rig_of(folder: Path, model: str, parameters: str) -> Path:
    # Write a copy of the virtual rig with another material, and return its path.
    # model, parameters : law, and its parameters as TOML
    for file in VIRTUAL.glob("virtual*.toml"):
        shutil.copy(file, folder)
    materials = f'[silicone."Dragon Skin 10"]\nmodel = "{model}"\nparameters = {{ {parameters} }}\n'
    (folder / "virtual_materials.toml").write_text(materials, encoding="utf-8")
    return folder / "virtual.toml"


@pytest.fixture(scope="module")
def demonstration(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    # The folder of a quick demonstration (`eimi demo`), and its output.
    folder = tmp_path_factory.mktemp("demonstration")
    command = [sys.executable, "-m", "eimi_lab", "demo", "--quick", "-o", "demo"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    return folder / "demo", done.stdout


def test_the_quick_demonstration_writes_all_files(demonstration):
    folder, printed = demonstration
    assert "truth: neo-hookean" in printed
    assert re.search(r"neo-hookean: initial shear modulus \d+ Pa \[\d+, \d+\].*% from the truth", printed)
    assert moduli(folder / "fits.json")["neo-hookean"] == pytest.approx(46390, rel=0.02)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Do the residuals look like noise?" in page
    assert "Published shear moduli of Dragon Skin 10" in page
    assert page.count('<img src="data:image/') == 8
    assert "neo-hookean" in page
    assert "://" not in page  # the report loads no other files


def test_a_demonstration_does_not_overwrite_another(demonstration, eimi):
    status, _, err = eimi("demo", "--quick", "-o", "demo", folder=demonstration[0].parent)
    assert (status, err.count("\n")) == (2, 1)
    assert "demo: is not empty" in err


def test_a_second_fit_gives_the_same_result_and_needs_no_truth(demonstration, done, tmp_path):
    folder, _ = demonstration
    shutil.copy(folder / "dataset.h5", tmp_path / "blind.h5")
    with h5py.File(tmp_path / "blind.h5", "r+", libver="latest") as file:
        del file["entry/truth"]
        assert "46390" not in file["entry/rig/data"].asstr()[()]
    done("fit", "blind.h5", "--model", "neo-hookean", "-o", "fits.json", folder=tmp_path)
    first, second = (json.loads((f / "fits.json").read_text())["fits"][0] for f in (folder, tmp_path))
    for record in (first, second):
        del record["wall_s"], record["datasets"]
    assert first == second
    done("report", "blind.h5", "--fit", "fits.json", "-o", "report.html", folder=tmp_path)
    assert (tmp_path / "report.html").stat().st_size > 100_000
    done("report", "blind.h5", "-o", "bare.html", folder=tmp_path)
    assert (tmp_path / "bare.html").read_text(encoding="utf-8").count('<img src="data:image/') == 2


def test_every_result_names_the_omitted_states(demonstration, done, tmp_path):
    shutil.copy(demonstration[0] / "dataset.h5", tmp_path / "flagged.h5")
    with open_dataset(tmp_path / "flagged.h5") as dataset:
        edges = list(dataset.edges())
    blurred, bright = judge({"blur_px": 9.0}), judge({"saturated_share": 0.2})
    for state, flags in ((1, blurred), (2, blurred + bright)):
        edges[state] = replace(edges[state], flags=flags)
    write_edges(tmp_path / "flagged.h5", edges)
    statement = "4 of 6 states used; left out: DEFOCUS in 2 (states 1, 2), SATURATED in 1 (state 2)"
    plane = ["--section", "plane-stress"]  # plane stress is faster than a solid
    fit = done("fit", "flagged.h5", *plane, "--model", "neo-hookean", "-o", "fits.json", folder=tmp_path)
    assert fit[0] == f"flagged.h5: {statement}"
    (record,) = read_fits_file(tmp_path / "fits.json").fits
    (fitted_dataset,) = json.loads((tmp_path / "fits.json").read_text())["fits"][0]["datasets"]
    assert fitted_dataset["states"]["left_out"] == [
        {"state": 1, "flags": ["DEFOCUS"]},
        {"state": 2, "flags": ["DEFOCUS", "SATURATED"]},
    ]
    assert statement in record._repr_html_()
    judged = done("validate", "flagged.h5", *plane, "--fit", "fits.json", "-o", "v.json", folder=tmp_path)
    assert any(statement in line for line in judged)
    done("report", "flagged.h5", "--fit", "fits.json", "-o", "report.html", folder=tmp_path)
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count(
        statement
    ) == 3  # the text is printed for the dataset, for the fit, and in the methods
    model = ["--model", "neo-hookean"]
    all_the_same = done("fit", "flagged.h5", "--include-flagged", *plane, *model, "-o", "all.json", folder=tmp_path)
    used = "6 of 6 states used; used although they have flags: DEFOCUS in 2 (states 1, 2), SATURATED in 1 (state 2)"
    assert any(used in line for line in all_the_same)


def test_the_example_of_the_readme_runs(demonstration, tmp_path):
    pytest.importorskip("pandas")
    (tmp_path / "eimi-demo").mkdir()
    shutil.copy(demonstration[0] / "dataset.h5", tmp_path / "eimi-demo")
    (lines,) = re.findall(r"```python\n(import eimi_lab as eimi.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert len([line for line in lines.splitlines() if line]) == 5
    # A notebook shows the value of the last line; a script has to print it.
    script = lines + "print(fit._repr_html_())\nprint(frame)\n"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    assert "<td>initial shear modulus</td>" in done.stdout
    assert "These data determine" in done.stdout
    assert "initial_shear_modulus" in done.stdout


def test_edges_become_labelled_arrays(demonstration):
    pytest.importorskip("xarray")
    with open_dataset(demonstration[0] / "dataset.h5") as dataset:
        labelled, edges = dataset.to_xarray(), dataset.edges()
    for k, edge_set in enumerate(edges):
        right = labelled.edge.sel(side="right").isel(state=k).dropna("point").values
        assert (right == edge_set.right.points_mm).all()
    assert labelled.field.attrs["units"] == "mT"


def test_a_validation_uses_the_inputs_that_the_fit_has_estimated(demonstration, done, tmp_path):
    # On any other dataset, all inputs have the values in the files.
    dataset = demonstration[0] / "dataset.h5"
    free = ["--free", "moment=0.02", "--free", "roll=0.1", "--free", "clamp=0.02"]
    plane = ["--section", "plane-stress"]  # plane stress is faster than a solid
    done("fit", dataset, "--model", "neo-hookean", *plane, *free, "-o", "fits.json", folder=tmp_path)
    done("validate", dataset, *plane, "--fit", "fits.json", "-o", "v.json", folder=tmp_path)
    (fit,) = json.loads((tmp_path / "fits.json").read_text())["fits"]
    (judged,) = json.loads((tmp_path / "v.json").read_text())["validations"]
    assert judged["seen"]
    # (The correction by the finer mesh is computed one refinement step before the optimum.)
    assert judged["mean_error_mm"] == pytest.approx(fit["mean_error_mm"], rel=5e-3)
    # With another hash it is a dataset that the fit has not used.
    fit["datasets"][0]["sha256"] = "0" * 64
    (tmp_path / "other.json").write_text(json.dumps({"fits": [fit]}))
    done("validate", dataset, *plane, "--fit", "other.json", "-o", "w.json", folder=tmp_path)
    (judged,) = json.loads((tmp_path / "w.json").read_text())["validations"]
    assert not judged["seen"]
    assert judged["mean_error_mm"] != pytest.approx(fit["mean_error_mm"], rel=2e-2)


def test_the_real_beam_gives_the_figures_of_the_readme(measured, tmp_path):
    (lines,) = re.findall(r"```sh\n(eimi import \$BEAM.*?)```", PAPER.read_text(encoding="utf-8"), re.DOTALL)
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "BEAM": str(measured / "real_beam"),
        "TENSILE": str(measured / "tensile"),
    }
    done = subprocess.run(
        ["sh", "-ec", lines], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    # An independent analysis of the same recordings in 3-D and in 2-D.
    for name, reference_Pa, held_Pa in (
        ("solid", 87.7e3, 87.7e3),
        ("stress", 92.9e3, 87.7e3),
        ("strain", 69.0e3, 69.0e3),
    ):
        (fit,) = read_fits_file(tmp_path / f"{name}.json").fits
        assert fit.initial_shear_modulus.value == pytest.approx(reference_Pa, rel=0.03)
        low, high = fit.initial_shear_modulus.interval_95
        assert low < held_Pa < high
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for words in ("bending, plane-stress", "bending, plane-strain", "tensile 50 %"):
        assert words in page
    assert "is not drawn" not in page


@pytest.mark.slow
@pytest.mark.parametrize("specimen", ["type1", "type2", "type3", "type4"])
@pytest.mark.parametrize(
    ("truth", "parameters", "modulus_Pa", "models"),
    [
        ("neo-hookean", "mu_Pa = 46390.0", 46390.0, list(LAWS)),
        ("yeoh", "C10_Pa = 19530.0, C20_Pa = 7410.0, C30_Pa = -3117.0", 39060.0, ["yeoh", "ogden"]),
    ],
)
def test_the_initial_shear_modulus_is_within_two_per_cent(
    tmp_path, done, specimen, truth, parameters, modulus_Pa, models
):
    rig = rig_of(tmp_path, truth, parameters)
    done("acquire", "dragon_skin_10", "--specimen", specimen, "--rig", rig, "-o", "run.h5", folder=tmp_path)
    options = [word for model in models for word in ("--model", model)]
    done("fit", "run.h5", *options, "-o", "fits.json", folder=tmp_path)
    print(specimen, truth, moduli(tmp_path / "fits.json"))
    assert moduli(tmp_path / "fits.json") == pytest.approx(dict.fromkeys(models, modulus_Pa), rel=0.02)


@pytest.mark.parametrize(
    ("arguments", "culprit"),
    [
        (["fit", "nothing.h5", "--model", "yeoh", "-o", "f.json"], "nothing.h5: no such file"),
        (["fit", "text.h5", "--model", "yeoh", "-o", "f.json"], "text.h5: is not an HDF5 file"),
        (
            ["fit", "text.h5", "--model", "hooke", "-o", "f.json"],
            "--model hooke: there is no law 'hooke'; did you mean 'neo-hookean'?",
        ),
        (
            ["fit", "text.h5", "--model", "yeoh", "--section", "3d", "-o", "f.json"],
            "--section 3d: there is no such section; there are",
        ),
        (["fit", "text.h5", "-o", "f.json"], "Missing option '--model'"),
        (["report", "text.h5", "--fit", "bad.json", "-o", "r.html"], "bad.json: line 1: is not JSON"),
        (["report", "text.h5", "--fit", "odd.json", "-o", "r.html"], "odd.json: fits"),
        (["demo", "--quick", "--material", "butter", "-o", "d"], "butter_quick: no such file"),
        (["demo", "--quick", "--specimen", "type9", "-o", "d"], "type9: no such file"),
    ],
)
def test_wrong_input_gives_one_line(tmp_path, eimi, arguments, culprit):
    (tmp_path / "text.h5").write_text("not hdf5")
    (tmp_path / "bad.json").write_text("{fits}")
    (tmp_path / "odd.json").write_text('{"fits": [{"model": 3}]}')
    before = sorted(tmp_path.iterdir())
    status, _, err = eimi(*arguments, folder=tmp_path)
    assert (status, err.count("\n")) == (2, 1), err
    assert culprit in err
    assert sorted(tmp_path.iterdir()) == before
