"""A report shows datasets with and without a fit, and fits to bending beside fits to tension."""

from __future__ import annotations

import csv
import json
import pickle
import re
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress
from eimi_lab.fits import prediction
from eimi_lab.fits.prediction import predict_on_each
from eimi_lab.fits.simulated_fit import simulate_each
from eimi_lab.process import workers
from eimi_lab.reporting import panels
from eimi_lab.reporting.citation import METHOD, SUITE
from eimi_lab.reporting.page import write_report
from eimi_lab.reporting.sections import evidence_for_fits
from eimi_lab.reporting.shown import ShownFit, read_shown
from eimi_lab.reporting.stress import MODES, stress_curve

Done = Callable[..., list[str]]


def page_of(done: Done, folder: Path, *arguments: str) -> str:
    done("report", *arguments, "-o", "report.html", "--force", folder=folder)
    return (folder / "report.html").read_text(encoding="utf-8")


def fits_on(paths: list[Path], fits: tuple[ShownFit, ...]) -> list[Any]:
    return [evidence_for_fits(path, fits, flagged=False)[1] for path in paths]


def test_a_report_shows_tensile_fits_beside_bending_fits(done: Done, folder: Path) -> None:
    page = page_of(done, folder, "train.h5", "unseen.h5", "--fit", "fits.json", "--fit", "tensile.json")
    for words in ("tensile 20 %", "tensile full", "bending", "Each fit on each specimen", "is an extrapolation"):
        assert words in page
    assert "is not drawn" not in page
    assert "://" not in page
    first_pages, appendix = page.split('<h1 class="appendix"')
    for words in ("Can the modulus be believed?", "error by field", "Causes of the"):
        assert words in first_pages
    for words in ("The result of each fit", "Each fit on each specimen", "of each fit minus the error of", "SHA-256"):
        assert words in appendix
    # The report shows the errors that `eimi validate` writes.
    fits = ("--fit", "fits.json", "--fit", "tensile.json")
    done("validate", "train.h5", "unseen.h5", *fits, "-o", "shown.json", "--force", folder=folder)
    for v in json.loads((folder / "shown.json").read_text())["validations"]:
        assert v["mean_error_mm"] is not None
        error = 1e3 * v["mean_error_mm"]
        assert (f">{error:.2f} [" if error < 10 else f">{error:.1f} [" if error < 100 else f">{error:.0f} [") in page


class Copying(ThreadPoolExecutor):
    # An executor that pickles arguments and results, as worker processes do.

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **options: Any) -> Future[Any]:
        copy = pickle.loads(pickle.dumps((arguments, options)))
        return super().submit(lambda: pickle.loads(pickle.dumps(function(*copy[0], **copy[1]))))


def test_workers_share_the_simulations_of_a_report_and_change_no_digit(folder: Path) -> None:
    paths = [folder / "train.h5", folder / "unseen.h5"]
    fits = read_shown([folder / "fits.json", folder / "tensile.json"])
    steps_alone, steps_shared, waits = list[str](), list[str](), list[str]()
    alone = dict(predict_on_each(fits_on(paths, fits), steps_alone.append))
    shared = dict(
        predict_on_each(fits_on(paths, fits), steps_shared.append, partial(Copying, 2), lambda: waits.append("once"))
    )
    assert waits == ["once"]
    assert len(steps_alone) == len(steps_shared) == 2 * 2 * len(fits)
    assert set(alone) == set(shared) == {0, 1}
    for place, expected in alone.items():
        actual = shared[place]
        assert all(p.has_equilibrium for p in expected)
        assert [p.evidence.path for p in actual] == [p.evidence.path for p in expected] == [paths[place]] * len(fits)
        assert all(p.fitted_law == s and p.fitted_law.label == s.label for p, s in zip(actual, fits, strict=True))
        assert [p.validation.model_dump() for p in actual] == [p.validation.model_dump() for p in expected]
        assert [p.edges_mm.tolist() for p in actual] == [p.edges_mm.tolist() for p in expected]


def test_a_dataset_is_shown_before_the_intervals_of_its_errors_are_computed(folder: Path) -> None:
    fits = read_shown([folder / "fits.json", folder / "tensile.json"])
    intervals = [
        (place, [p.validation.mean_error_interval_mm is not None for p in on], sum(p.has_equilibrium for p in on))
        for place, on in predict_on_each(fits_on([folder / "train.h5", folder / "unseen.h5"], fits))
    ]
    count = len(fits)
    first, last = [False] * count, [True] * count
    assert intervals == [(0, first, count), (1, first, count), (0, last, count), (1, last, count)]


@pytest.mark.parametrize("executor", [None, partial(Copying, 2)], ids=["one process", "workers"])
def test_a_fit_that_fails_beside_the_others_is_simulated_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch, executor: Any
) -> None:
    fits = read_shown([folder / "fits.json", folder / "tensile.json"])
    paths, steps = [folder / "train.h5", folder / "unseen.h5"], list[str]()
    expected = dict(predict_on_each(fits_on(paths, fits)))

    def fail_the_second(evidence: Any, fits: Any) -> Iterator[Any]:
        for i, simulated in enumerate(simulate_each(evidence, fits)):
            yield None if i == 1 else simulated

    monkeypatch.setattr(prediction, "simulate_each", fail_the_second)
    for place, on in predict_on_each(fits_on(paths, fits), steps.append, executor):
        assert [p.edges_mm.tolist() for p in on] == [p.edges_mm.tolist() for p in expected[place]]
    assert [p.validation.model_dump() for p in on] == [p.validation.model_dump() for p in expected[1]]
    assert len(steps) == 2 * 2 * len(fits)


def test_a_page_is_the_same_with_workers_and_without(folder: Path) -> None:
    # Workers draw the panels of the fits first.
    (folder / "again.json").write_text((folder / "fits.json").read_text())
    fits = [folder / name for name in ("fits.json", "tensile.json", "again.json")]
    pages, totals = [], []
    for executor in (None, partial(Copying, 2)):
        steps = list[str]()
        output = folder / f"page{len(pages)}.html"
        progress = partial(counted, steps, totals)
        write_report(output, [folder / "unseen.h5"], fits, executor=executor, progress=progress)
        pages.append(re.sub(r'<p class="byline">.*', "", output.read_text(encoding="utf-8")))
        assert len(steps) == totals[-1]
    assert pages[0] == pages[1]


@contextmanager
def counted(steps: list[str], totals: list[int], title: str, total: int) -> Iterator[Callable[[str], None]]:
    totals.append(total)
    yield steps.append


@pytest.mark.parametrize(("options", "started"), [((), 2), (("--workers", "1"), 1), (("--workers", "2"), 2)])
def test_a_report_starts_one_worker_for_each_dataset_unless_the_option_says_otherwise(
    done: Done, folder: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], started: int
) -> None:
    counts = list[int]()
    monkeypatch.setattr(workers, "executor_for", lambda count, scheduler: counts.append(count))
    fits = ("--fit", "fits.json")
    done("report", "train.h5", "unseen.h5", *fits, *options, "-o", "shared.html", "--force", folder=folder)
    assert counts == [started]


class WellFormed(HTMLParser):
    # A parser of an HTML page that asserts closed elements, unique ids and `alt` texts, and collects `text`.

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
        values = dict(attrs)
        assert len(values) == len(attrs)
        assert tag not in {"script", "link", "iframe"}
        assert "p" not in self.open or tag in {"b", "br", "code", "span"}, f"<{tag}> in a paragraph"
        if tag == "img":
            assert values["alt"]
            assert str(values["src"]).startswith("data:image/")
        self.ids += [str(values["id"])] if "id" in values else []
        self.links += [str(values["href"])] if "href" in values else []
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_a_hostile_name_stays_text_and_each_figure_is_also_a_file(done: Done, folder: Path) -> None:
    name = """<script>alert("1")</script> & </p> $x_1$ {{ 1 }} end{tabular}"""
    plain = (folder / "specimen.toml").read_text()
    (folder / "hostile.toml").write_text(plain.replace('"plain strip"', f"'''{name}'''"))
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


def test_the_references_agree_with_the_citation_file() -> None:
    cff = (Path(__file__).parents[2] / "CITATION.cff").read_text(encoding="utf-8")
    for words in (METHOD.title, METHOD.doi, *(author.split(", ")[0] for author in METHOD.authors), SUITE.authors[0]):
        assert words in cff


def test_one_new_file_adds_a_panel_to_the_report(
    done: Done, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    guide = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (code,) = (block for block in re.findall(r"```python\n(.*?)```", guide, re.DOTALL) if "PANEL = " in block)
    (tmp_path / "tip_forces.py").write_text(code, encoding="utf-8")
    monkeypatch.setattr(panels, "__path__", [*panels.__path__, str(tmp_path)])
    try:
        page = page_of(done, folder, "train.h5", "unseen.h5", "--fit", "fits.json")
    finally:
        sys.modules.pop("eimi_lab.reporting.panels.tip_forces", None)
    assert page.count("<h3>Forces at the tip</h3>") == 2
    assert "0.0, 0.001, 0.002 N" in page
    before, title, after = re.findall(r"<h3>(.*?)</h3>", page)[:3]
    assert (before, title) == ("Error against field", "Forces at the tip")
    assert after.startswith("Simulated and measured")


def test_a_report_says_which_tensile_curve_or_band_cannot_be_drawn(done: Done, folder: Path) -> None:
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
    del content["fits"][0]["draws"]  # the format of an earlier release
    (folder / "earlier.json").write_text(json.dumps(content))
    page = page_of(done, folder, "unseen.h5", "--fit", "earlier.json")
    assert page.count("holds no draws: the figure has no band for neo-hookean, tensile 20 %.") == 1
    assert "Shaded" not in page
    assert "<h2>Search</h2>" not in page


def test_a_report_marks_a_law_without_an_equilibrium(done: Done, folder: Path) -> None:
    content = json.loads((folder / "tensile.json").read_text())
    content["fits"][0]["parameters"]["mu"]["value"] = -60e3
    (folder / "lost.json").write_text(json.dumps(content))
    page = page_of(done, folder, "unseen.h5", "--fit", "fits.json", "--fit", "lost.json")
    assert ">no equilibrium<" in page


def test_bands_of_stress_follow_from_the_intervals_of_the_parameters(folder: Path) -> None:
    strain = np.linspace(0, 1, 21)
    for shown in read_shown([folder / "tensile.json"]):
        low, high = shown.fit.parameters["mu"].interval_95
        ends = engineering_stress(LAWS["neo-hookean"], np.array([[low], [high]]), strain).T
        assert stress_curve(shown, strain).band_Pa == pytest.approx(ends, rel=0.02, abs=1e-6)
    # A bending fit may determine only C10 + C01; its band then lies between a law with C10 and a law with C01.
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
    # Source: Treloar 1975, The Physics of Rubber Elasticity, chapter 5.
    law, strain = LAWS["mooney-rivlin"], np.linspace(0, 1, 11)
    c10, c01, stretch = 20e3, 4e3, 1 + strain
    uniaxial, planar, shear = (mode.stress_Pa(law, np.array([c10, c01]), strain) for mode in MODES)
    assert uniaxial == pytest.approx(2 * (stretch - stretch**-2) * (c10 + c01 / stretch), abs=1e-6)
    assert planar == pytest.approx(2 * (c10 + c01) * (stretch - stretch**-3), abs=1e-6)
    assert shear == pytest.approx(2 * (c10 + c01) * strain, abs=1e-6)


def test_fits_with_two_section_assumptions_are_side_by_side_in_a_report(done: Done, folder: Path) -> None:
    done("fit", "train.h5", "--model", "neo-hookean", "--section", "plane-strain", "-o", "strain.json", folder=folder)
    page = page_of(done, folder, "train.h5", "unseen.h5", "--fit", "fits.json", "--fit", "strain.json")
    assert "bending, plane-stress" in page
    assert "bending, plane-strain" in page
    # Each fit is simulated with its own section assumption, so that its error is the one in its file.
    for name in ("fits.json", "strain.json"):
        (fit,) = json.loads((folder / name).read_text())["fits"]
        error = 1e3 * fit["mean_error_mm"]
        printed = [float(number) for number in re.findall(r">([\d.]+) \[", page)]
        assert any(number == pytest.approx(error, rel=5e-3, abs=0.025) for number in printed)
