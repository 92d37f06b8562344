"""A report is written in the right order, and its sections show the right texts, tables and figures."""

from __future__ import annotations

from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_lab.reporting import drawn_panels, page
from eimi_lab.reporting.citation import Citation
from eimi_lab.reporting.contents import DatasetContents, ReportContents
from eimi_lab.reporting.drawn_panels import DrawnPanels
from eimi_lab.reporting.elements import Elements, Table
from eimi_lab.reporting.panel import DatasetPanel, ReportPanel
from eimi_lab.reporting.panels import (
    contact_sheet,
    law_of_time,
    laws,
    parameter_correlation,
    published_values,
    what_was_measured,
)
from tests.lab.printed.described import described
from tests.lab.printed.test_whole_report import check


def test_a_reference_in_short_and_as_a_line() -> None:
    one = Citation("k", ("Doe, Jane",), "A title", 2020, "A journal 1:2", "10.1/x")
    assert (one.short, one.text) == ("Doe 2020", "Doe, Jane (2020). A title. A journal 1:2. doi:10.1/x")
    two = replace(one, authors=("Doe, Jane", "Roe, Ann"), doi="")
    assert (two.short, two.text) == ("Doe et al. 2020", "Doe, Jane; Roe, Ann (2020). A title. A journal 1:2.")


def panels() -> list[Any]:
    # Return panels whose values are their title and the contents.
    def panel(place: int, title: str, **how: Any) -> ReportPanel:
        return ReportPanel(
            place=place, title=title, template="", values=lambda given: DRAWN.append(title) or {"of": given}, **how
        )

    return [
        panel(0, "summary", summary=True),
        panel(1, "of fits", of_fits=True),
        panel(2, "with intervals", of_intervals=True),
        panel(3, "after", after_datasets=True),
        DatasetPanel(
            place=4, title="of a dataset", template="", values=lambda given: DRAWN.append("dataset") or {"of": given}
        ),
    ]


DRAWN: list[str] = []


def test_panels_are_drawn_once_as_soon_as_their_contents_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    DRAWN.clear()
    monkeypatch.setattr(drawn_panels, "all_panels", panels)
    drawn = DrawnPanels()
    report: Any = "report"
    drawn.fits(report)
    assert DRAWN == ["of fits"]
    shown: Any = SimpleNamespace(name="a.h5")
    drawn.dataset(shown)
    assert DRAWN == ["of fits", "dataset"]
    assert [(panel.title, values) for panel, values in drawn.of_dataset(shown)] == [("of a dataset", {"of": shown})]
    drawn.datasets(report)
    assert DRAWN[2:] == ["summary", "after"]
    drawn.report("whole")  # type: ignore[arg-type]
    assert DRAWN[4:] == ["with intervals"]
    assert [(panel.title, values) for panel, values in drawn.summary()] == [("summary", {"of": "report"})]
    assert [panel.title for panel, _ in drawn.of_report(after_datasets=False)] == ["of fits", "with intervals"]
    assert [panel.title for panel, _ in drawn.of_report(after_datasets=True)] == ["after"]
    drawn.report("again")  # type: ignore[arg-type]
    assert len(DRAWN) == 5


def test_filled_panels_have_a_title_an_anchor_and_a_body() -> None:
    panel: Any = SimpleNamespace(title="A & {{ x }}: of (two)", template="<p>{{ x }}</p>{{ t | table }}")
    environment = page._environment(Elements())
    table = Table("t", "c", ["h"], [["1"]])
    filled = page._filled(environment, [(panel, {"x": "<y>", "t": table}), (panel, None)])
    assert len(filled) == 1
    assert filled[0]["title"] == "A & &lt;y&gt;: of (two)"
    assert filled[0]["slug"] == "a-x-of-two"
    assert filled[0]["body"].startswith('<p>&lt;y&gt;</p><div class="table whole" id="table-1">')


def beam(name: str, material: str) -> Any:
    return SimpleNamespace(
        name=f"{name}.h5",
        dataset=SimpleNamespace(specimen=SimpleNamespace(specimen=SimpleNamespace(material=material))),
    )


@pytest.mark.parametrize(
    ("fits", "datasets", "title"),
    [
        ((), [beam("a", "soft"), beam("b", "soft"), beam("c", "hard")], "Measured: soft, hard (a.h5, b.h5, c.h5)"),
        (("f",), [beam("a", "soft"), beam("b", "soft")], "Material identified: soft"),
        (("f",), [], "Material identified"),
    ],
)
def test_the_title_of_a_report(fits: Any, datasets: Any, title: str) -> None:
    assert page._title(SimpleNamespace(fits=fits, datasets=datasets)) == title  # type: ignore[arg-type]


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("assets", [None, Path("figures")])
def test_a_report_is_written_step_by_step(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, count: int, assets: Path | None
) -> None:
    steps: list[Any] = []

    class Drawn:
        def fits(self, report: ReportContents) -> None:
            steps.append(("fits", len(report.datasets)))

        def dataset(self, shown: DatasetContents) -> None:
            steps.append(("dataset", shown.name, shown.predictions, shown.leading))

        def datasets(self, report: ReportContents) -> None:
            steps.append(("datasets", [one.name for one in report.datasets]))

    def predict(fits_on: Any, step_done: Any, executor: Any, draw_fits: Any) -> Any:
        steps.append(("predict", fits_on, executor))
        for place in reversed(range(count)):
            yield place, f"first {place}"
        for place in range(count):
            yield place, f"whole {place}"

    @contextmanager
    def progress(title: str, total: int) -> Any:
        steps.append((title, total))
        yield lambda words: steps.append(words)

    paths = [tmp_path / f"{place}.h5" for place in range(count)]
    monkeypatch.setattr(page, "DrawnPanels", Drawn)
    monkeypatch.setattr(page, "read_shown", lambda fits: ("one", "two"))
    monkeypatch.setattr(page, "laws_of_time", lambda fits: ("time",))
    monkeypatch.setattr(page, "_has_motions_alone", lambda path: path.name == "motion.h5")
    monkeypatch.setattr(
        page, "evidence_for_fits", lambda path, fits, flagged: (SimpleNamespace(sha256=path.name), (path.name, flagged))
    )
    monkeypatch.setattr(page, "predict_on_each", predict)
    monkeypatch.setattr(page, "open_dataset", lambda path: nullcontext(f"open {path.name}"))
    monkeypatch.setattr(page, "leading", lambda fits, sha256: f"leading {sha256}")
    monkeypatch.setattr(page, "whole_folder", lambda folder, force: nullcontext(tmp_path))
    elements = SimpleNamespace(files=lambda: {"figure.svg": b"drawn"})

    def render(report: ReportContents, drawn: Any) -> Any:
        steps.append(("render", [one.predictions for one in report.datasets], report.command, report.laws_of_time))
        assert report.fits == ("one", "two")
        return "<html>", elements

    monkeypatch.setattr(page, "render", render)
    page.write_report(
        tmp_path / "o.html",
        [*paths, tmp_path / "motion.h5"],
        [],
        assets=assets,
        command="eimi",
        flagged=True,
        executor="executor",
        progress=progress,  # type: ignore[arg-type]
    )
    assert (tmp_path / "o.html").read_text() == "<html>"
    assert (tmp_path / "figure.svg").exists() is (assets is not None)
    drawn: list[Any] = []
    for number, place in enumerate(reversed(range(count)), 1):
        drawn += [("dataset", f"{place}.h5", f"first {place}", f"leading {place}.h5"), f"{place}.h5: figures drawn"]
        drawn += [("fits", number)]
    whole = ("datasets", [f"{place}.h5" for place in range(count)])
    assert steps == [
        ("report", 6 * count + 1),
        *(f"{place}.h5 read" for place in range(count)),
        ("predict", [(f"{place}.h5", True) for place in range(count)], "executor"),
        *(drawn if count else [("fits", 0)]),
        whole,
        ("render", [f"whole {place}" for place in range(count)], "eimi", ("time",)),
        "page written",
    ]


@pytest.mark.parametrize(("states", "alone"), [([], True), ([1], False)])
def test_a_dataset_may_have_motions_alone(monkeypatch: pytest.MonkeyPatch, states: list[int], alone: bool) -> None:
    monkeypatch.setattr(page, "open_dataset", lambda path: nullcontext(SimpleNamespace(states=states)))
    assert page._has_motions_alone(Path("d.h5")) is alone


@dataclass
class Flag:
    name: str
    value: float
    limit: float
    severity: str = "doubtful"
    remedy: str = "more light"


def test_flags_are_listed_with_their_worst_value() -> None:
    flags: Any = {
        0: [Flag("BLUR", 2.0, 1.5), Flag("DARK", 0.1, 0.2, "unusable", "open")],
        2: [Flag("BLUR", 0.25, 1.5), Flag("BLUR", 1.7, 1.5)],
        3: [],
    }
    table = contact_sheet.table_of_flags(flags)
    assert table is not None
    assert table.texts() == [
        ["BLUR", "doubtful", "0, 2", "0.250", "1.5", "more light"],
        ["DARK", "unusable", "0", "0.100", "0.2", "open"],
    ]
    assert table.head == ("flag", "severity", "states", "worst value", "limit", "what to do")
    assert contact_sheet.table_of_flags({0: []}) is None


@pytest.mark.parametrize(("count", "shown"), [(1, 1), (48, 48), (49, 25), (97, 33)])
def test_at_most_48_states_are_shown(count: int, shown: int) -> None:
    contents: Any = SimpleNamespace(dataset=SimpleNamespace(states=tuple(range(count))))
    assert len(contact_sheet.shown_states(contents)) == shown


def window(k: int, used: bool) -> Any:
    return SimpleNamespace(
        **{"from_s": 0.1 * k, "to_s": 0.1 * k + 0.25, "amplitude_mm": 2.0 / (k + 1), "frequency_Hz": 7.0 + 0.1 * k},
        **{"frequency_sigma_Hz": 0.012, "loss": 0.05 + 0.01 * k, "loss_sigma": 0.0034, "is_used": used},
    )


@pytest.mark.parametrize("creeps", [2, 0])
def test_the_law_of_time_is_drawn_as_accepted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, creeps: int) -> None:
    monkeypatch.setattr(law_of_time, "time_lines", lambda time: ["a line"])
    rings = [
        SimpleNamespace(
            **{"label": f"ring {k}", "frequency_Hz": 7.2 + k, "windows": [window(0, False), window(1 + k, True)]},
            **{"time_s": [0.0, 0.1, 0.2], "displacement_mm": [2.0 + k, -1.0, 0.5], "envelope_mm": [2.0, 1.5 + k, 1.0]},
        )
        for k in range(2)
    ]
    time = SimpleNamespace(
        ring_downs=rings,
        modulus_by_time=[
            SimpleNamespace(time_s=10.0**k, value=50e3 - 1e3 * k, interval_95=(48e3 - 1e3 * k, 53e3 + k))
            for k in range(3)
        ],
        known_between_s=(0.02, 30.0),
        creep=[
            SimpleNamespace(
                label=f"creep {k}", time_s=[1.0, 10.0], measured_deg=[0.1 + k, -0.2], fitted_deg=[0.2, -0.1 - k]
            )
            for k in range(creeps)
        ],
    )
    values = law_of_time._values(SimpleNamespace(laws_of_time=[("yeoh, fits.json", time), ("other", None)]))  # type: ignore[arg-type]
    lines = [" ".join(line.split()) for line in described(values, "time")]
    check(lines, f"law_of_time_{creeps}.txt", tmp_path, 2e-3, 1e-6)
    assert law_of_time._values(SimpleNamespace(laws_of_time=[])) is None  # type: ignore[arg-type]
    assert sum("patch #999999" in line for line in lines) == 1  # the range of times in which the modulus is known
    time.known_between_s = None
    undetermined = law_of_time._values(SimpleNamespace(laws_of_time=[("yeoh, fits.json", time)]))  # type: ignore[arg-type]
    assert not any("patch #999999" in line for line in described(undetermined, "time"))


def fit_with(*doubts: str) -> Any:
    return SimpleNamespace(doubts_in_words=lambda: doubts)


def test_a_doubt_is_told_once_with_the_fits_that_it_concerns() -> None:
    shown: list[Any] = [
        SimpleNamespace(label="a", fit=fit_with("moved", "weak")),
        SimpleNamespace(label="b", fit=fit_with("moved")),
    ]
    assert laws._doubts(shown) == [("moved", "all fits"), ("weak", "a")]
    assert laws._doubts(shown[:1]) == [("moved", "a"), ("weak", "a")]
    three = [*shown, SimpleNamespace(label="c", fit=fit_with())]
    assert laws._doubts(three)[0] == ("moved", "a; b")


@pytest.mark.parametrize(("count", "words"), [(6, ""), (7, " Shown are the first 6 of 7 fits.")])
def test_at_most_six_correlation_matrices_are_drawn(monkeypatch: pytest.MonkeyPatch, count: int, words: str) -> None:
    drawn: list[int] = []
    monkeypatch.setattr(parameter_correlation, "drawn_correlations", lambda fits: drawn.append(len(fits)))
    monkeypatch.setattr(parameter_correlation, "FitRecord", SimpleNamespace)
    names = [SimpleNamespace(fit=SimpleNamespace(identifiability=SimpleNamespace(names=["a", "b"])))] * count
    single = SimpleNamespace(fit=SimpleNamespace(identifiability=SimpleNamespace(names=["a"])))
    values = parameter_correlation._values(SimpleNamespace(bending=[single, *names]))  # type: ignore[arg-type]
    assert values is not None
    assert drawn == [6]
    assert values["picture"].caption.endswith(f"the value of each unknown.{words}")
    assert parameter_correlation._values(SimpleNamespace(bending=[single])) is None  # type: ignore[arg-type]


def test_the_material_of_a_tensile_test_is_compared_with_published_values() -> None:
    for material, found in (("Ecoflex 00-30", ["Ecoflex 00-30"]), (None, [])):
        tested: Any = SimpleNamespace(
            shown=SimpleNamespace(fit=SimpleNamespace(source=SimpleNamespace(material=material)))
        )
        assert published_values._materials(tested, None) == found  # type: ignore[arg-type]


def measured(**changes: Any) -> Any:
    # Return a dataset without a magnet and without a rig; its attributes are changed to `changes`.
    size = SimpleNamespace(
        name="one", material="soft", length_mm=20.0, width_mm=3.0, depth_mm=4.0, density_kg_m3=1000.0
    )
    values: dict[str, Any] = {
        "specimen": SimpleNamespace(specimen=size, magnet=None, uncertainty={"length_mm": 0.1, "width_mm": 0.0}),
        "start_time": lambda: datetime(2026, 3, 4, 5, 6, tzinfo=UTC),
        **{"gravity": True, "gravity_angle_deg": 0.4, "finished": True, "calibration": None},
        **{"states": [SimpleNamespace(field_mT=0.0, current_A=None)], "truth": lambda: None, "corrections": list},
        **{"ring_downs": list, "creeps": list, "instruments": lambda: ["a supply"], "text": {}.get},
    }
    evidence = SimpleNamespace(
        used=SimpleNamespace(in_words=lambda: "1 of 1 states used"),
        sha256="hash",
        heating=None,
        experiment=SimpleNamespace(model=SimpleNamespace(specimen=SimpleNamespace(section="solid"))),
    )
    return SimpleNamespace(dataset=SimpleNamespace(**values | changes), evidence=evidence, validations=())


@pytest.fixture
def facts_of(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(what_was_measured.MeasuredField, "of", lambda evidence: None)
    monkeypatch.setattr(what_was_measured.MeasuredTemperature, "of", lambda evidence: None)
    monkeypatch.setattr(what_was_measured, "recordings_in_words", lambda motions: f"{len(motions)} motions")
    return lambda contents: dict(what_was_measured.facts(contents))


def test_the_facts_of_a_bare_dataset(facts_of: Any) -> None:
    assert facts_of(measured()) == {
        **{"specimen": "one, soft", "measured on": "4 March 2026, 05:06 UTC", "magnet": "none"},
        "length × width × depth": "20 ± 0.1 × 3 × 4 (± not stated) mm, model of the cross-section: solid",
        "density": "1000 (± not stated) kg/m³",
        "rig": "unknown, because the data were imported",
        "gravity": "along the beam at rest (the beam hangs)",
        "states": "1 of 1 states used",
        "content": "sha256 hash",
    }


@pytest.mark.parametrize(
    ("angle", "words"),
    [(0.49, "along"), (-0.49, "along"), (359.6, "along"), (0.5, "at 0.5°"), (-0.5, "at -0.5°"), (270.0, "at -90°")],
)
def test_gravity_along_the_beam_hangs_it(angle: float, words: str) -> None:
    assert what_was_measured._gravity_words(angle).startswith(words)


def test_the_facts_of_a_complete_dataset(facts_of: Any) -> None:
    texts = {"rig": 'name = "bench"', "protocol": 'name = "steps"\nframes_per_state = 5', "user_note": "by day"}
    states = [SimpleNamespace(field_mT=f, current_A=a) for f, a in ((-1.5, -0.3), (2.5, 0.5), (0.0, None))]
    calibration = SimpleNamespace(
        **{"uncertainty": {"pixels_per_mm": 0.05}, "pixels_per_mm": 8.0, "telecentric": False, "stand_off_mm": 400.0},
        **{"calibrated_on": date(2026, 1, 2), "coil_constant_mT_per_A": None, "mT_per_A": 4.7},
    )
    contents = measured(
        **{"text": texts.get, "states": states, "calibration": calibration, "truth": lambda: {"model": "yeoh"}},
        **{"ring_downs": lambda: [1, 2], "creeps": lambda: [3], "corrections": lambda: ["width"], "finished": False},
        gravity=False,
    )
    contents.validations = [
        SimpleNamespace(seen=False, section="solid"),
        SimpleNamespace(seen=False, section="plane-stress"),
    ]
    facts = facts_of(contents)
    assert {key: facts[key] for key in list(facts) if key not in ("specimen", "density", "magnet", "measured on")} == {
        "length × width × depth": (
            "20 ± 0.1 × 3 × 4 (± not stated) mm, model of the cross-section: solid and plane-stress"
        ),
        **{"rig": "bench", "instrument": "a supply", "lens": "400 mm away", "coil": "none"},
        "protocol": "steps: 2 states from -0.3 to 0.5 A, 5 frames each",
        "scale": "8 ± 0.05 pixels/mm; one pixel is 125 µm, calibrated on 2026-01-02",
        "gravity": "none: the weight does not bend the beam",
        "states": "1 of 1 states used; the run is not finished",
        "ring-downs and creep": "3 motions",
        **{"operator's note": "by day", "corrected": "width", "origin": "simulated on the virtual rig"},
        "unseen": "no law was fitted to this dataset; its errors are errors of predictions",
        "content": "sha256 hash",
    }
    contents.validations[0].seen = True
    assert "unseen" not in facts_of(contents)
    calibration.coil_constant_mT_per_A, calibration.telecentric, calibration.calibrated_on = 4.7, True, None
    facts = facts_of(contents)
    assert facts["coil constant"] == "4.7 (± not stated) mT/A; fields from -1.5 to 2.5 mT"
    assert (facts["lens"], facts["scale"]) == ("telecentric", "8 ± 0.05 pixels/mm; one pixel is 125 µm")
    calibration.telecentric, calibration.stand_off_mm = False, 0.0
    assert facts_of(contents)["lens"] == "stand-off not stated"
    bare = measured(states=states, text={"protocol": 'name = "steps"'}.get)
    assert facts_of(bare)["loads"] == "fields from -1.5 to 2.5 mT"
    assert facts_of(bare)["protocol"] == "steps: 2 states from -0.3 to 0.5 A"
    without = measured(text={"protocol": 'name = "steps"\nframes_per_state = 5'}.get)
    assert facts_of(without)["protocol"] == "steps, 5 frames each"
