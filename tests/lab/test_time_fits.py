"""`eimi fit --time prony` fits a viscoelastic (Prony) law to imported ring-downs (free vibrations)."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import h5py
import numpy as np
import pytest

from eimi_fitting import LAWS, Loads, Specimen
from eimi_fitting.laws.law import Law
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.identification import NoRingDown
from eimi_fitting.time.ringing import RingTable
from eimi_fitting.time.ringing_beam import RingingBeam
from eimi_lab.dataset.moving.stored_motions import GROUPS
from eimi_lab.face.identifying import open_fits
from eimi_lab.fits import time_fits

Run = Callable[..., tuple[int, str]]

SPECIMEN = """[specimen]
name = "strip"
material = "silicone"
length_mm = 40.0
width_mm = 6.0
depth_mm = 12.0
density_kg_m3 = 1070
section = "plane-stress"
[uncertainty]
length_mm = 0.1
width_mm = 0.03
depth_mm = 0.05
density_kg_m3 = 5
"""
AT_REST_PA = 60e3
SERIES = Prony(np.array([[0.08, 0.1]]), np.array([[0.03, 3.0]]))


@pytest.fixture(scope="module")
def flick() -> tuple[str, float, float]:
    # A free vibration of a silicone strip as CSV text, and the storage modulus (Pa) and loss factor of the strip.
    specimen = Specimen(40.0, 6.0, 12.0, 1070.0, section="plane-stress")
    beam = RingingBeam(specimen, Loads.along([0.0], gravity_angle_deg=-90.0), LAWS["neo-hookean"], np.ones(1))
    relative = 1 / float(SERIES.long_term[0])
    table = RingTable(beam, AT_REST_PA)
    (root,) = table.roots(np.log([AT_REST_PA]), lambda s: relative * SERIES.complex_ratio(s), 1)[0]
    model = beam.planar()
    x = np.linspace(4.0, 40.0, 6)
    rest = np.column_stack([x, 0 * x])
    sag = model.positions(model.solve(beam.law, np.array([[AT_REST_PA]]), beam.loads), rest)[0, 0]
    rng, rows = np.random.default_rng(3), ["time_s,point,x0_mm,y0_mm,x_mm,y_mm,sigma_mm"]
    for time in np.arange(300) / 120:
        tip = 1.5 * float(np.real(np.exp(root * max(time - 0.2, 0.0))))
        places = sag + np.column_stack([0 * x, tip * (x / 40) ** 2]) + 0.01 * rng.standard_normal((6, 2))
        rows += [f"{time:.5f},{k},{x[k]},0,{a:.5f},{b:.5f},0.01" for k, (a, b) in enumerate(places)]
    value = complex(AT_REST_PA * relative * SERIES.complex_ratio(np.array([[1j * root.imag]]))[0, 0])
    return "\n".join(rows), value.real, value.imag / value.real


@pytest.fixture
def imported(run: Run, tmp_path: Path, flick: tuple[str, float, float]) -> Path:
    (tmp_path / "flick.csv").write_text(flick[0])
    (tmp_path / "strip.toml").write_text(SPECIMEN)
    options = ("--ring-down", "--specimen", tmp_path / "strip.toml", "--gravity-angle", "-90")
    code, message = run("import", tmp_path / "flick.csv", *options, "-o", tmp_path / "flick.h5")
    assert code == 0, message
    return tmp_path / "flick.h5"


def fitted(run: Run, dataset: Path) -> dict[str, Any]:
    output = dataset.parent / "fits.json"
    code, message = run("fit", dataset, "--model", "neo-hookean", "--time", "prony", "-o", output)
    assert code == 0, message
    (fit,) = json.loads(output.read_text())["fits"]
    return dict(fit)


def test_a_flick_gives_the_dynamic_modulus_and_its_card_and_report(
    run: Run, imported: Path, flick: tuple[str, float, float]
) -> None:
    fit = fitted(run, imported)
    _, storage_Pa, loss = flick
    time = fit["time"]
    low, high = time["dynamic_shear_modulus"]["interval_95"]
    assert low < storage_Pa < high
    assert time["dynamic_shear_modulus"]["value"] == pytest.approx(storage_Pa, rel=0.05)
    assert time["dynamic_shear_modulus"]["unit"] == "Pa"
    assert time["loss_factor"] == pytest.approx(loss, rel=0.05)
    assert set(time["prony"][0]) == {"g", "tau_s"}
    shortest, longest = time["known_between_s"]
    assert shortest < 1 / (2 * np.pi * time["frequency_Hz"]) < longest
    assert {"width", "noise", "air-mass"} <= {entry["source"] for entry in time["budget"]}
    assert fit["kind"] == "ring-down"
    fits = imported.parent / "fits.json"
    (record,) = open_fits(fits)
    assert "The stretches of the ring-downs are not determined." in record._repr_html_()
    assert record.plot().axes[0].get_xlim() == (0.0, 10.0)
    card = imported.parent / "card.inp"
    code, message = run("export", fits, "--model", "neo-hookean", "--to", "abaqus", "--bulk-ratio", "1000", "-o", card)
    assert code == 0, message
    assert "*VISCOELASTIC, TIME=PRONY" in card.read_text()
    code, message = run("report", imported, "--fit", fits, "-o", imported.parent / "report.html")
    assert code == 0, message
    assert "Viscoelastic law" in (imported.parent / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "section"), [((), "plane-stress"), (("--section", "plane-strain"), "plane-strain")]
)
def test_the_section_of_a_fit_is_also_that_of_its_ring_downs(
    run: Run, monkeypatch: pytest.MonkeyPatch, imported: Path, options: tuple[str, ...], section: str
) -> None:
    sections: list[str] = []

    def identified(law: Law, shape: np.ndarray, specimen: Specimen, *given: Any, seed: int) -> NoReturn:
        sections.append(specimen.section)
        raise NoRingDown("too short")

    monkeypatch.setattr(time_fits, "identify_time", identified)
    output = imported.parent / "fits.json"
    code, message = run("fit", imported, "--model", "neo-hookean", "--time", "prony", *options, "-o", output)
    assert (code, sections) == (2, [section]), message


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--model", "neo-hookean"), "holds a recorded motion and no states; fit the motion with --time prony"),
        (("--model", "yeoh", "--time", "prony"), "a ring-down determines only one parameter"),
        (("--model", "neo-hookean", "--time", "pronny"), "--time pronny: should be one of none, prony"),
    ],
)
def test_a_fit_of_a_ring_down_that_cannot_be_is_refused(
    run: Run, imported: Path, options: tuple[str, ...], words: str
) -> None:
    code, message = run("fit", imported, *options, "-o", imported.parent / "fits.json")
    assert code == 2
    assert words in message
    assert not (imported.parent / "fits.json").exists()


def test_options_for_states_are_refused_in_a_fit_of_ring_downs_alone(
    run: Run, monkeypatch: pytest.MonkeyPatch, imported: Path
) -> None:
    monkeypatch.chdir(imported.parent)
    Path("curve.csv").write_text("strain,stress_kPa\n" + "".join(f"{e / 100},{e}\n" for e in range(1, 40)))
    given = (
        "--include-flagged",
        "--free width",
        "--prior mu=60000,500",
        "--tensile curve.csv",
        "--restarts 2",
        "--bipop",
    )
    for option in (*given, "--bootstrap 9", "--checkpoint log.jsonl", "--resume"):
        fit = ("fit", "flick.h5", "--model", "neo-hookean", "--time", "prony", "-o", "fits.json")
        code, message = run(*fit, *option.split())
        assert code == 2
        assert f"flick.h5: {option.split()[0]}: is for a fit to states (load steps)" in message
    assert not Path("fits.json").exists()


def test_a_dataset_without_a_ring_down_is_refused_with_the_remedy(run: Run, imported: Path) -> None:
    with h5py.File(imported, "r+", libver="latest") as file:
        del file["entry"][GROUPS["ring_down"]]
    code, message = run(
        "fit", imported, "--model", "neo-hookean", "--time", "prony", "-o", imported.parent / "fits.json"
    )
    assert code == 2
    assert f"{imported.name}: --time prony: there is no ring-down; record a ring-down with [ring_down]" in message


def test_datasets_of_different_specimens_are_not_fitted_together(run: Run, imported: Path) -> None:
    folder = imported.parent
    (folder / "strip.toml").write_text(SPECIMEN.replace("40.0", "41.0"))
    options = ("--ring-down", "--specimen", folder / "strip.toml", "--gravity-angle", "-90")
    assert run("import", folder / "flick.csv", *options, "-o", folder / "longer.h5")[0] == 0
    datasets = (imported, folder / "longer.h5")
    code, message = run("fit", *datasets, "--model", "neo-hookean", "--time", "prony", "-o", folder / "fits.json")
    assert code == 2
    assert "longer.h5: the specimen of this dataset differs from the specimen of" in message


def test_the_largest_uncertainty_of_an_input_counts_in_a_fit_of_several_datasets(
    run: Run, imported: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, used = imported.parent, []

    def identify_time(*given: Any, **options: Any) -> None:
        used.append({source.source: source.standard_uncertainty for source in given[4]})
        raise NoRingDown("no fit is needed here")

    monkeypatch.setattr(time_fits, "identify_time", identify_time)
    (folder / "strip.toml").write_text(SPECIMEN.replace("width_mm = 0.03\n", "").replace("= 0.1\n", "= 0.2\n"))
    options = ("--ring-down", "--specimen", folder / "strip.toml", "--gravity-angle", "-90")
    assert run("import", folder / "flick.csv", *options, "-o", folder / "other.h5")[0] == 0
    for datasets in ((folder / "other.h5", imported), (imported, folder / "other.h5")):
        run("fit", *datasets, "--model", "neo-hookean", "--time", "prony", "-o", folder / "fits.json")
    assert used == [{"length": 0.2, "width": 0.03, "depth": 0.05, "density": 5.0}] * 2
