"""Every fit on every dataset, as a person runs it."""

from __future__ import annotations

import csv
import json
import pickle
import re
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.corrections import correction
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress
from eimi_lab import workers
from eimi_lab.fits import validation
from eimi_lab.notebook import load_evidence, open_dataset, read_any_fits, validate
from eimi_lab.report import panels
from eimi_lab.report.citation import METHOD, SUITE
from eimi_lab.report.shown import read_shown
from eimi_lab.report.simulated import simulate_on_each
from eimi_lab.report.stress import MODES, stress_curve

Eimi = Callable[..., tuple[int, str, str]]
Done = Callable[..., list[str]]

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


def track_points(done: Done, folder: Path, name: str, forces_N: list[float], modulus_Pa: float) -> None:
    """Points on the middle line of a strip of a known law under tip forces, imported as `name`.h5."""
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
    """Two datasets of one strip, a fit of the first, and tensile fits of a stiffer curve."""
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


def test_unseen_states_and_the_comparison_with_tensile_fits(done: Done, folder: Path) -> None:
    fits = ("--fit", "tensile.json", "--fit", "fits.json")
    lines = done("validate", "train.h5", "unseen.h5", *fits, "-o", "validation.json", folder=folder)
    found = json.loads((folder / "validation.json").read_text())["validations"]
    assert [(v["dataset"], v["fit"]["path"], v["fit"]["index"], v["seen"]) for v in found] == [
        ("train.h5", "tensile.json", 0, False),
        ("train.h5", "tensile.json", 1, False),
        ("train.h5", "fits.json", 0, True),
        ("unseen.h5", "tensile.json", 0, False),
        ("unseen.h5", "tensile.json", 1, False),
        ("unseen.h5", "fits.json", 0, False),
    ]
    for v in found:
        assert [s["state"] for s in v["by_state"]] == [0, 1, 2]
        assert v["mean_error_mm"] == pytest.approx(np.mean([s["error_mm"] for s in v["by_state"]]))
        assert v["mean_deviation_mm"] == pytest.approx(np.mean([s["deviation_mm"] for s in v["by_state"]]))
        assert (v["status"], v["stable"], v["section"]) == ("ok", True, "plane-stress")
    # A fit of the same law from the same strip predicts what it has not seen; one of a stiffer curve does not.
    assert found[5]["mean_error_mm"] < 1e-3
    assert found[3]["mean_error_mm"] > 0.1
    # What the fit itself wrote of the states it saw.
    (own,) = json.loads((folder / "fits.json").read_text())["fits"]
    # To 0.02 µm: the finer mesh's edges are followed from where it changed them, and here nothing else is left.
    assert own["mean_error_mm"] == pytest.approx(found[2]["mean_error_mm"], rel=5e-3, abs=2e-5)
    # What the plane leaves out of each beam is said last. The table: by dataset, the best fit first.
    assert [line.split()[0] for line in lines[-2:]] == ["train.h5:", "unseen.h5:"]
    lines = lines[:-2]
    assert [line.split()[0] for line in lines[:3]] == ["train.h5", "fit", "fits.json:0"]
    assert [line.split()[0] for line in lines[5:8]] == ["unseen.h5", "fit", "fits.json:0"]
    assert lines[2].endswith("  seen")
    assert "unseen" in lines[7]
    # The interval of the error goes over the draws: stiffer and softer strips are worse than the truth.
    for v in found:
        low, high = v["mean_error_interval_mm"]
        assert low <= v["mean_error_mm"] <= high
    low, high = found[5]["mean_error_interval_mm"]
    assert low < 0.01
    assert high > 2 * low
    # Fits against specimens: the fitted specimen is marked.
    matrix = [line.split() for line in lines[lines.index(next(x for x in lines if x.startswith("mean error"))) + 1 :]]
    assert matrix[0] == ["fit", "law", "train.h5", "unseen.h5"]
    assert [row[0] for row in matrix[1:]] == ["tensile.json:0", "tensile.json:1", "fits.json:0"]
    assert [row[1] for row in matrix[1:]] == ["tensile", "tensile", "bending"]
    assert ["*" in " ".join(row) for row in matrix[1:]] == [False, False, True]


def test_the_interval_of_the_error_is_that_of_the_draws(done: Done, folder: Path) -> None:
    content = json.loads((folder / "fits.json").read_text())
    (fit,) = content["fits"]
    assert fit["draws"]["names"][0] == "mu"
    assert np.quantile(fit["draws"]["values"], [0.025, 0.975]) == pytest.approx(fit["parameters"]["mu"]["interval_95"])
    # Value and draws both lie off what was measured, so that neither's distance to it can be left out or counted twice.
    fit["draws"]["values"] = [[60e3]] * 40
    fit["parameters"]["mu"]["value"] = fit["initial_shear_modulus"]["value"] = 52e3
    (folder / "wide.json").write_text(json.dumps(content))
    fit["parameters"]["mu"]["value"] = fit["initial_shear_modulus"]["value"] = 60e3
    fit["draws"] = None  # as an earlier release wrote it
    (folder / "at_end.json").write_text(json.dumps(content))
    fits = ("--fit", "wide.json", "--fit", "at_end.json")
    done("validate", "unseen.h5", *fits, "-o", "ends.json", folder=folder)
    wide, at_end = json.loads((folder / "ends.json").read_text())["validations"]
    # (Draws bend on the coarse mesh; what finer ones change is taken at the value, and differs a little at the end.)
    assert wide["mean_error_interval_mm"] == pytest.approx([wide["mean_error_mm"], at_end["mean_error_mm"]], rel=1e-2)
    assert at_end["mean_error_interval_mm"] is None


def test_by_state_prints_what_the_file_holds(done: Done, folder: Path) -> None:
    fits = ("--fit", "fits.json", "--fit", "tensile.json")
    lines = done("validate", "unseen.h5", *fits, "--by-state", "-o", "states.json", folder=folder)
    validations = json.loads((folder / "states.json").read_text())["validations"]
    first = lines.index("unseen.h5: error ± deviation by state, µm")
    for k, line in enumerate(lines[first + 2 : first + 5]):
        cells = line.split()
        assert cells[0] == str(k)
        states = [v["by_state"][k] for v in validations]
        told = [float(f"{1e3 * s[key]:.2f}") for s in states for key in ("error_mm", "deviation_mm")]
        assert [float(c) for c in cells[2:] if c != "±"] == told
    assert lines[first + 5].split()[0] == "mean"


def page_of(done: Done, folder: Path, *arguments: str) -> str:
    done("report", *arguments, "-o", "report.html", "--force", folder=folder)
    return (folder / "report.html").read_text(encoding="utf-8")


def test_a_report_lays_tensile_fits_beside_those_of_bending(done: Done, folder: Path) -> None:
    page = page_of(done, folder, "train.h5", "unseen.h5", "--fit", "fits.json", "--fit", "tensile.json")
    for words in ("tensile 20 %", "tensile full", "bending", "Every fit on every specimen", "is an extrapolation"):
        assert words in page
    assert "is not drawn" not in page
    assert "://" not in page
    # What `eimi validate` writes is what the report shows.
    fits = ("--fit", "fits.json", "--fit", "tensile.json")
    done("validate", "train.h5", "unseen.h5", *fits, "-o", "shown.json", "--force", folder=folder)
    for v in json.loads((folder / "shown.json").read_text())["validations"]:
        assert v["mean_error_mm"] is not None
        error = 1e3 * v["mean_error_mm"]
        assert (f">{error:.2f} [" if error < 10 else f">{error:.1f} [" if error < 100 else f">{error:.0f} [") in page


class Copying(ThreadPoolExecutor):
    """Sends what it is given and what comes of it as other processes do."""

    def submit(self, function: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        copy = pickle.loads(pickle.dumps((given, named)))
        return super().submit(lambda: pickle.loads(pickle.dumps(function(*copy[0], **copy[1]))))


def test_workers_share_the_datasets_of_a_report_and_change_no_digit(folder: Path) -> None:
    paths = [folder / "train.h5", folder / "unseen.h5"]
    (folder / "again.json").write_text((folder / "fits.json").read_text())
    every = read_shown([folder / "fits.json", folder / "tensile.json", folder / "again.json"])
    here, there = list[str](), list[str]()
    alone = simulate_on_each(paths, every, False, here.append)
    shared = simulate_on_each(paths, every, False, there.append, partial(Copying, 2))
    assert len(here) == len(there) == 2 * (1 + len(every))
    for (own, outlines, validations), other in zip(alone, shared, strict=True):
        assert other[0].path == own.path
        assert [every.index(o.shown) for o in other[1]] == list(range(len(every)))
        assert all(o.shown is every[place] for place, o in enumerate(other[1]))
        assert [v.model_dump() for v in other[2]] == [v.model_dump() for v in validations]
        assert [o.edges_mm.tolist() for o in other[1]] == [o.edges_mm.tolist() for o in outlines]


def test_no_worker_is_started_for_few_fits(folder: Path) -> None:
    def started() -> Any:
        raise AssertionError("a worker for three fits")

    every = read_shown([folder / "fits.json", folder / "tensile.json"])
    paths = [folder / "train.h5", folder / "unseen.h5"]
    assert len(simulate_on_each(paths, every, False, executor=started)) == 2


@pytest.mark.parametrize(("asked", "started"), [((), 2), (("--workers", "1"), 1), (("--workers", "2"), 2)])
def test_workers_of_a_report_are_one_a_dataset_unless_asked_for(
    done: Done, folder: Path, monkeypatch: pytest.MonkeyPatch, asked: tuple[str, ...], started: int
) -> None:
    counts = list[int]()
    monkeypatch.setattr(workers, "executor_for", lambda count, scheduler: counts.append(count))
    done("report", "train.h5", "unseen.h5", *asked, "-o", "shared.html", "--force", folder=folder)
    assert counts == [started]


class WellFormed(HTMLParser):
    """Every element closed in its turn, no attribute or id twice, every image described; what the text says."""

    VOID = frozenset({"meta", "img", "br"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.text = ""
        self.feed(page)
        self.close()
        assert self.open == []
        assert len(set(self.ids)) == len(self.ids)
        assert {link.removeprefix("#") for link in self.links} <= set(self.ids)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        assert len(given) == len(attrs)
        assert tag not in {"script", "link", "iframe"}
        assert "p" not in self.open or tag in {"b", "br", "code", "span"}, f"<{tag}> in a paragraph"
        if tag == "img":
            assert given["alt"]
            assert str(given["src"]).startswith("data:image/")
        self.ids += [str(given["id"])] if "id" in given else []
        self.links += [str(given["href"])] if "href" in given else []
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_a_hostile_name_stays_text_and_every_figure_is_a_file_too(done: Done, folder: Path) -> None:
    name = """<script>alert("1")</script> & </p> $x_1$ {{ 1 }} end{tabular}"""
    (folder / "hostile.toml").write_text(SPECIMEN.replace('"plain strip"', f"'''{name}'''"))
    tables = ("--states", "train_states.csv", "--specimen", "hostile.toml", "--gravity-angle", "90")
    done("import", "train.csv", *tables, "-o", "hostile.h5", folder=folder)
    page = page_of(done, folder, "hostile.h5", "--fit", "fits.json", "--fit", "tensile.json", "--assets", "assets")
    shown = WellFormed(page)
    assert shown.text.count(name) >= 1
    files = [path.suffix for path in (folder / "assets").iterdir()]
    pictures, numbered = page.count("<figure"), page.count("<table")
    assert [files.count(f".{kind}") for kind in ("svg", "pdf", "csv", "tex")] == [
        *(pictures, pictures, numbered, numbered)
    ]
    for file in (folder / "assets").glob("*.svg"):
        assert not list(ElementTree.parse(file).iter("{http://www.w3.org/2000/svg}script"))
    (laws,) = (folder / "assets").glob("*_laws.csv")
    rows = list(csv.reader(laws.read_text(encoding="utf-8").splitlines()))
    origins = ("bending", "tensile 20 %", "tensile full")
    assert [row[:2] for row in rows[1:]] == [["neo-hookean", words] for words in origins]
    latex = laws.with_suffix(".tex").read_text(encoding="utf-8")
    assert r"tensile 20 \%" in latex
    assert latex.count(r" \\") == 4
    assert "doi:10.3389/frobt.2021.790571" in shown.text


def test_what_to_cite_is_what_the_citation_file_says() -> None:
    cff = (Path(__file__).parents[2] / "CITATION.cff").read_text(encoding="utf-8")
    for words in (METHOD.title, METHOD.doi, *(author.split(", ")[0] for author in METHOD.authors), SUITE.authors[0]):
        assert words in cff


def test_a_panel_of_the_report_is_one_file(
    done: Done, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The one that CONTRIBUTING.md shows: its file lies in the folder of panels, and nothing else is touched."""
    guide = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (code,) = (block for block in re.findall(r"```python\n(.*?)```", guide, re.DOTALL) if "PANEL = " in block)
    (tmp_path / "tip_forces.py").write_text(code, encoding="utf-8")
    monkeypatch.setattr(panels, "__path__", [*panels.__path__, str(tmp_path)])
    try:
        page = page_of(done, folder, "train.h5", "unseen.h5", "--fit", "fits.json")
    finally:
        sys.modules.pop("eimi_lab.report.panels.tip_forces", None)
    assert page.count("<h3>Forces at the tip</h3>") == 2
    assert "0.0, 0.001, 0.002 N" in page
    before, title, after = re.findall(r"<h3>(.*?)</h3>", page)[:3]
    assert (before, title) == ("Error against field", "Forces at the tip")
    assert after.startswith("Simulated and measured")


def test_a_report_without_a_bending_fit_or_with_a_lost_curve(done: Done, folder: Path) -> None:
    (folder / "curve.csv").rename(folder / "kept.csv")
    try:
        page = page_of(done, folder, "unseen.h5", "--fit", "tensile.json")
        assert "The tensile test is not drawn: curve.csv: cannot be read" in page
        (folder / "curve.csv").write_text("strain,stress_kPa\n0.1,2\n")
        page = page_of(done, folder, "unseen.h5", "--fit", "tensile.json")
        assert "The tensile test is not drawn: curve.csv has changed since it was fitted." in page
    finally:
        (folder / "kept.csv").replace(folder / "curve.csv")
    content = json.loads((folder / "tensile.json").read_text())
    del content["fits"][0]["draws"]  # as an earlier release wrote it
    (folder / "earlier.json").write_text(json.dumps(content))
    page = page_of(done, folder, "unseen.h5", "--fit", "earlier.json")
    assert page.count("holds no draws: no band for neo-hookean, tensile 20 %.") == 1
    assert "Shaded" not in page
    assert "<h2>Search</h2>" not in page


def test_a_report_shows_a_law_without_an_equilibrium_as_such(done: Done, folder: Path) -> None:
    content = json.loads((folder / "tensile.json").read_text())
    content["fits"][0]["parameters"]["mu"]["value"] = -60e3
    (folder / "lost.json").write_text(json.dumps(content))
    page = page_of(done, folder, "unseen.h5", "--fit", "fits.json", "--fit", "lost.json")
    assert ">no equilibrium<" in page


def test_bands_of_stress_are_those_of_the_parameters(folder: Path) -> None:
    strain = np.linspace(0, 1, 21)
    for shown in read_shown([folder / "tensile.json"]):
        low, high = shown.fit.parameters["mu"].interval_95
        ends = engineering_stress(LAWS["neo-hookean"], np.array([[low], [high]]), strain).T
        assert stress_curve(shown, strain).band_Pa == pytest.approx(ends, rel=0.02, abs=1e-6)
    # A bending fit that fixes C10 + C01 alone: its band is between the laws of C10 and of C01 nearly only.
    content = json.loads((folder / "fits.json").read_text())
    (fit,) = content["fits"]
    half = {"value": 10e3, "unit": "Pa", "interval_95": [0.0, 20e3]}
    fit["model"], fit["parameters"] = "mooney-rivlin", {"C10": half, "C01": half}
    fit["initial_shear_modulus"] = {"value": 40e3, "unit": "Pa", "interval_95": [40e3, 40e3]}
    fit["draws"] = {"seed": 1, "names": ["C10", "C01"], "values": [[c, 20e3 - c] for c in np.linspace(0, 20e3, 41)]}
    (folder / "loose.json").write_text(json.dumps(content))
    (shown,) = read_shown([folder / "loose.json"])
    ends = engineering_stress(LAWS["mooney-rivlin"], np.array([[500.0, 19500.0], [19500.0, 500.0]]), strain).T
    assert stress_curve(shown, strain).band_Pa == pytest.approx(ends, rel=1e-6, abs=1e-6)


def test_planar_tension_and_shear_follow_their_closed_forms() -> None:
    """Mooney and Rivlin's law (Treloar 1975, The Physics of Rubber Elasticity, chapter 5)."""
    law, strain = LAWS["mooney-rivlin"], np.linspace(0, 1, 11)
    c10, c01, stretch = 20e3, 4e3, 1 + strain
    uniaxial, planar, shear = (mode.stress_Pa(law, np.array([c10, c01]), strain) for mode in MODES)
    assert uniaxial == pytest.approx(2 * (stretch - stretch**-2) * (c10 + c01 / stretch), abs=1e-6)
    assert planar == pytest.approx(2 * (c10 + c01) * (stretch - stretch**-3), abs=1e-6)
    assert shear == pytest.approx(2 * (c10 + c01) * strain, abs=1e-6)


def test_two_section_assumptions_stand_side_by_side_in_a_report(done: Done, folder: Path) -> None:
    done("fit", "train.h5", "--model", "neo-hookean", "--section", "plane-strain", "-o", "strain.json", folder=folder)
    page = page_of(done, folder, "train.h5", "unseen.h5", "--fit", "fits.json", "--fit", "strain.json")
    assert "bending, plane-stress" in page
    assert "bending, plane-strain" in page
    # Each is simulated under its own assumption: the error is what each fit wrote.
    for name in ("fits.json", "strain.json"):
        (fit,) = json.loads((folder / name).read_text())["fits"]
        error = 1e3 * fit["mean_error_mm"]
        told = [float(number) for number in re.findall(r">([\d.]+) \[", page)]
        assert any(number == pytest.approx(error, rel=5e-3, abs=0.025) for number in told)


def test_results_show_themselves_and_turn_into_frames(folder: Path) -> None:
    pytest.importorskip("pandas")
    (fit,) = read_any_fits(folder / "fits.json")
    tensile = read_any_fits(folder / "tensile.json")[0]
    evidence = load_evidence(folder / "unseen.h5")
    found = validate(evidence, fit, Path("fits <1>.json"), 0)
    for result in (fit, tensile, found):
        shown = ElementTree.fromstring(f"<div>{result._repr_html_()}</div>")
        rows = [["".join(cell.itertext()) for cell in row] for row in shown.iter("tr")]
        assert len(rows) == 1 + len(result.to_pandas()), rows
    with open_dataset(folder / "unseen.h5") as dataset:
        for result in (dataset, evidence):
            assert len(list(ElementTree.fromstring(f"<div>{result._repr_html_()}</div>").iter("tr"))) == 4
        for result in (dataset, evidence, fit, tensile, found):
            assert result.plot()._repr_png_().startswith(b"\x89PNG")
    frame = fit.to_pandas()
    assert frame.loc["mu", "value"] == fit.values()[0]
    assert tuple(frame.loc["initial_shear_modulus", ["low_95", "high_95"]]) == fit.initial_shear_modulus.interval_95
    assert found.to_pandas()["error_mm"].mean() == pytest.approx(found.mean_error_mm)
    assert list(found.to_pandas().index) == [0, 1, 2]


def test_what_was_measured_turns_into_labelled_arrays(folder: Path) -> None:
    pytest.importorskip("xarray")
    dataset = open_dataset(folder / "unseen.h5")  # no `with` in a notebook's cell
    labelled, points = dataset.to_xarray(), dataset.points()
    dataset.close()
    assert labelled.place.sel(state=2, point="p3", axis="y").item() == points[2].points_mm[3, 1]
    assert list(labelled.tip_force.values) == [0.0005, 0.0015, 0.003]
    assert labelled.place.attrs["units"] == "mm"


def test_what_is_not_installed_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("pandas", "xarray"):
        monkeypatch.setitem(sys.modules, package, None)
    (fit,) = read_any_fits(folder / "fits.json")
    with pytest.raises(ImportError, match="this needs pandas, which is not installed: pip install pandas"):
        fit.to_pandas()
    with open_dataset(folder / "unseen.h5") as dataset, pytest.raises(ImportError, match="pip install xarray"):
        dataset.to_xarray()


def test_a_law_without_an_equilibrium_is_told_and_stops_nothing(done: Done, folder: Path) -> None:
    content = json.loads((folder / "tensile.json").read_text())
    content["fits"][0]["parameters"]["mu"]["value"] = -60e3
    (folder / "negative.json").write_text(json.dumps(content))
    lines = done("validate", "unseen.h5", "--fit", "negative.json", "-o", "negative_v.json", folder=folder)
    first, second = json.loads((folder / "negative_v.json").read_text())["validations"]
    assert second["status"] == "ok"
    assert (first["status"], first["mean_error_mm"], first["by_state"]) == ("no equilibrium", None, [])
    assert [line.split()[0] for line in lines[-2:]] == ["negative.json:0", "unseen.h5:"]


def test_no_better_model_is_asked_where_the_planar_one_has_no_equilibrium(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence, asked = load_evidence(folder / "unseen.h5"), list[float]()
    first, *_ = read_any_fits(folder / "tensile.json")

    def counted(*given: Any) -> Any:
        asked.append(1.0)
        return correction(*given)

    monkeypatch.setattr(validation, "correction", counted)
    lost = first.model_copy(update={"parameters": {"mu": replace(first.parameters["mu"], value=-60e3)}})
    assert validate(evidence, lost, Path("lost.json"), 0).status == "no equilibrium"
    assert not asked
    assert validate(evidence, first, Path("tensile.json"), 0).status == "ok"
    assert asked


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("train.h5", "--fit", "none.json", "-o", "v.json"), "none.json: cannot be read (No such file or directory)"),
        (("none.h5", "--fit", "fits.json", "-o", "v.json"), "none.h5: no such file"),
        (("train.h5", "--fit", "fits.json", "-o", "tensile.json"), "tensile.json: exists already"),
        (
            ("train.h5", "--fit", "fits.json", "-o", "fits.json", "--force"),
            "fits.json: cannot be written, it is in use",
        ),
        (("train.h5", "./train.h5", "--fit", "fits.json", "-o", "v.json"), "train.h5: is given twice"),
        (
            ("train.h5", "--fit", "earlier.json", "-o", "v.json"),
            "earlier.json: fits.0.mesh: Field required; expected a "
            "file that `eimi fit` or `eimi tensile` of this release wrote: if it is of an earlier one, fit again",
        ),
        (("train.h5", "--fit", "empty.json", "-o", "v.json"), "empty.json: fits: Tuple should have at least 1 item"),
        (
            ("train.h5", "--fit", "fits.json", "--section", "plane-strain", "-o", "v.json"),
            "fits.json: fits.0 took train.h5 as plane-stress, not plane-strain; give --section plane-stress",
        ),
    ],
)
def test_bad_input_to_validate_is_one_line(eimi: Eimi, folder: Path, arguments: tuple[str, ...], told: str) -> None:
    content = json.loads((folder / "fits.json").read_text())
    del content["fits"][0]["mesh"]
    (folder / "earlier.json").write_text(json.dumps(content))
    (folder / "empty.json").write_text('{"fits": []}')
    status, _, said = eimi("validate", *arguments, folder=folder)
    assert (status, said.count("\n")) == (2, 1)
    assert told in said
    assert not (folder / "v.json").exists()
