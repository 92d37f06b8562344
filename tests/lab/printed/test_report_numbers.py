"""The report prints and draws each number of a fits file with the right value, unit and place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.inference.doubts.causes import Cause
from eimi_fitting.inference.doubts.checks import Doubt
from eimi_fitting.inference.evidence.measurements import PointObservation
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.face.demonstrating import Score
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.grades import grade
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.fits.tensile_fits import fit_window
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.validation import Validation
from eimi_lab.reporting import findings
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.panels import methods, stress_strain
from eimi_lab.reporting.panels.causes import table_of_causes
from eimi_lab.reporting.panels.convergence import drawn_convergence, table_of_searches
from eimi_lab.reporting.panels.error_against_field import drawn_errors
from eimi_lab.reporting.panels.error_boxes import drawn_boxes
from eimi_lab.reporting.panels.every_fit import tables as fits_on_specimens
from eimi_lab.reporting.panels.first_screen import points_over_outlines
from eimi_lab.reporting.panels.laws import table_of_choice, table_of_laws
from eimi_lab.reporting.panels.published_values import table_of_published
from eimi_lab.reporting.panels.stress_strain import drawn_stress
from eimi_lab.reporting.panels.uncertainty_budget import drawn_budget, shares
from eimi_lab.reporting.residual_noise import ResidualNoise
from eimi_lab.reporting.shown import ShownFit, chosen
from eimi_lab.reporting.stress import TensilePoints, largest_strain, tensile_points
from eimi_lab.showing.rounded import format_quantity, value_and_interval

Shown = Callable[..., ShownFit]
Judged = Callable[..., Validation]
Reported = Callable[..., Any]


def test_the_comparison_has_its_columns_and_the_best_law_is_chosen(
    fit: FitRecord, shown: Shown, choices: tuple[Choice, ...]
) -> None:
    rows = table_of_choice(choices).texts()
    assert rows[0] == ["neo-hookean", "1", "7.5", "3.2", "0.020", "12.3"]
    # The law with the smallest AICc is chosen, in any order of the fits.
    yeoh = replace(fit, model="yeoh", parameters=dict.fromkeys(LAWS["yeoh"].parameter_names, fit.parameters["mu"]))
    both = [shown(fit, choices), shown(yeoh, choices)]
    assert chosen(both).fit.model == chosen(both[::-1]).fit.model == "yeoh"


def test_a_tensile_fit_s_misfit_is_in_kilopascal_in_the_report(tensile: TensileRecord, shown: Shown) -> None:
    (row,) = table_of_laws([shown(tensile)], False).texts()
    assert row[3] == "RMSE 1.23 kPa"


@pytest.fixture
def simulated(fit: FitRecord, evidence: Evidence, shown: Shown) -> Any:
    # The prediction of a fit on a dataset.
    return SimpleNamespace(
        fitted_law=shown(fit), evidence=evidence, error_mm=np.array([0.01, 0.02, 0.03]), deviation_mm=np.full(3, 0.004)
    )


def test_the_figures_of_the_report_show_the_errors_of_the_fit(fit: FitRecord, simulated: Any) -> None:
    (axes,) = drawn_errors([simulated]).axes
    x, error = axes.lines[0].get_data()
    assert x.tolist() == [0.0, 3.0, 6.0]
    assert error.tolist() == pytest.approx([10.0, 20.0, 30.0])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("field, mT", "error, µm")
    contents = SimpleNamespace(
        name="beam.h5",
        simulated_by={simulated.fitted_law: simulated}.get,
        dataset=SimpleNamespace(specimen=SimpleNamespace(specimen=SimpleNamespace(name="one"))),
    )
    (axes,) = drawn_boxes(SimpleNamespace(datasets=[contents], fits=[simulated.fitted_law])).axes  # type: ignore[arg-type]
    median = next(line for line in axes.lines if line.get_color() == "black")
    assert median.get_ydata().tolist() == pytest.approx([20.0, 20.0])
    (axes,) = drawn_convergence([simulated.fitted_law]).axes
    assert axes.lines[0].get_ydata()[-1] == pytest.approx(1e3 * fit.history[-1].best_mm)
    (search,) = table_of_searches([simulated.fitted_law]).texts()
    assert search[5].endswith(f"to {1e3 * fit.polish.mean_error_after_mm:.2f} µm")
    assert search[6] == f"{1e3 * fit.mean_error_mm:.2f} µm"


@pytest.mark.parametrize("with_fit", [False, True])
def test_tracked_points_and_simulated_outlines_are_drawn_upright_at_three_loads(simulated: Any, with_fit: bool) -> None:
    moved = np.arange(24.0).reshape(4, 3, 2)
    sigma = np.full((4, 3), 0.02)
    sigma[:, 2] = np.nan  # a point that was not found
    states = tuple(SimpleNamespace(field_mT=field, tip_force_N=0.0) for field in (6.0, 0.0, 3.0, 1.0))
    experiment = SimpleNamespace(observed=PointObservation(np.zeros_like(moved), moved, sigma))
    contents: Any = SimpleNamespace(
        evidence=SimpleNamespace(experiment=experiment, states=states),
        dataset=SimpleNamespace(upright=lambda places: places[..., ::-1]),
    )
    simulated.edges_mm = 10.0 + np.arange(32.0).reshape(4, 2, 2, 2)
    (axes,) = points_over_outlines(contents, simulated if with_fit else None).axes
    points = [line.get_xydata() for line in axes.lines if line.get_marker() != "None"]
    smallest_first = [1, 2, 0]
    assert np.array(points) == pytest.approx(moved[smallest_first, :2, ::-1])
    outlines = [line.get_xydata() for line in axes.lines if line.get_marker() == "None" and len(line.get_xdata())]
    assert len(outlines) == (3 if with_fit else 0)
    for k, outline in zip(smallest_first, outlines, strict=False):
        left, right = simulated.edges_mm[k][..., ::-1]
        assert outline == pytest.approx(np.array([*left, *right[::-1], left[0]]))


@pytest.mark.parametrize("kind", ["frames", "points"])
def test_the_methods_describe_what_was_done_and_nothing_else(
    fit: FitRecord, shown: Shown, evidence: Evidence, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.setattr(methods, "findings", lambda report: [])
    with open_dataset(evidence.path) as dataset:
        stub = SimpleNamespace(
            specimen=dataset.specimen, states=dataset.states, kind=kind, calibration=None, truth=lambda: None
        )
    contents = SimpleNamespace(dataset=stub, evidence=evidence)
    bending = SimpleNamespace(fit=fit, origin="run")
    tensile = SimpleNamespace(origin="tensile 20 %")
    report: Any = SimpleNamespace(datasets=[contents], bending=[bending], tensile=[])
    words = methods.paragraph(report)
    assert f"was {'photographed' if kind == 'frames' else 'tracked'} at rest in 3 states" in words
    assert "in magnetic fields up to 6 mT" in words
    assert ("Edges were located" in words) is (kind == "frames")
    assert "The 95 % intervals include the scatter of the" in words
    assert "Evolutionary Inverse Material Identification" in words
    assert "virtual" not in words
    assert "tensile" not in words
    only_tension: Any = SimpleNamespace(datasets=[], bending=[], tensile=[tensile])
    assert methods.paragraph(only_tension) == (
        "For comparison, laws were fitted by least squares to uniaxial tensile tests (window: 20 %)."
    )


def test_the_report_s_stress_is_in_kilopascal_with_the_band_of_the_draws(fit: FitRecord, shown: Shown) -> None:
    bare = replace(fit, tensile=())
    test = TensilePoints("curve.csv", np.array([0.1, 0.2]), np.array([12e3, 25e3]))
    drawing = drawn_stress([shown(bare)], [test], 0.25)
    uniaxial = drawing.axes[0]
    measured = next(line for line in uniaxial.lines if line.get_label() == "curve.csv")
    assert measured.get_data()[0].tolist() == pytest.approx([10.0, 20.0])
    assert measured.get_data()[1].tolist() == pytest.approx([12.0, 25.0])
    law = LAWS["neo-hookean"]
    strain, stress = next(line for line in uniaxial.lines if line.get_linestyle() == "--").get_data()
    assert stress == pytest.approx(1e-3 * engineering_stress(law, np.array([50e3]), strain / 100))
    whole = next(line for line in uniaxial.lines if line.get_label() == "neo-hookean")
    assert whole.get_xdata().max() <= 25.0  # the line is solid within the range of the data
    band = next(c for c in uniaxial.collections if len(c.get_paths())).get_paths()[0].vertices
    ends = engineering_stress(law, np.quantile(np.linspace(40e3, 65e3, 401), [[0.025], [0.975]]), strain[-1:] / 100)
    at_end = band[np.isclose(band[:, 0], strain[-1]), 1]
    assert (at_end.min(), at_end.max()) == pytest.approx(tuple(1e-3 * ends[:, 0]), rel=1e-2)


@pytest.mark.parametrize("first", [-0.02, 0.0])
def test_a_compression_test_is_named_but_not_drawn(tmp_path: Path, shown: Shown, first: float) -> None:
    strain = np.linspace(first, -0.5, 30)
    stress_Pa = engineering_stress(LAWS["neo-hookean"], np.array([46e3]), strain)
    rows = [f"{e},{s}" for e, s in zip(strain, stress_Pa, strict=True)]
    (tmp_path / "pressed.csv").write_text("\n".join(["strain,stress_Pa", *rows]) + "\n")
    fits = [shown(fit_window(read_tensile(tmp_path / "pressed.csv"), "neo-hookean", None))]
    points, missing = tensile_points(fits, largest_strain(fits))
    assert points == []
    assert missing == ["pressed.csv is not drawn, because it has no strain in the range of the figure."]
    low_kPa, high_kPa = drawn_stress(fits, points, None).axes[0].get_ylim()
    assert low_kPa < 0 < 10 < high_kPa


def test_the_stress_of_many_kinds_of_data_is_drawn_in_figures_of_two_kinds(
    fit: FitRecord, tensile: TensileRecord, shown: Shown
) -> None:
    fits = [replace(shown(fit), origin="bending")]
    fits += [replace(shown(tensile), origin=f"tensile {percent} %") for percent in (20, 50)]
    values = stress_strain.PANEL.values(ReportContents(tuple(fits), (), datetime.now(UTC)))
    first, second = values["pictures"]
    rows = [[axes.get_ylabel() for axes in picture.figure.axes[::3]] for picture in (first, second)]
    assert rows == [
        ["fitted to bending\nstress, kPa", "fitted to tensile\n20 %\nstress, kPa"],
        ["fitted to tensile\n50 %\nstress, kPa", "relative to\nneo-hookean, %"],
    ]
    assert first.figure.axes[0].get_ylim() == second.figure.axes[0].get_ylim()
    assert first.caption.startswith("Laws fitted to bending and tensile 20 %. Engineering stress")
    assert second.caption.startswith("Laws fitted to tensile 50 %. Drawn as in the figure before. Last row")
    (alone,) = stress_strain.PANEL.values(ReportContents(tuple(fits[:2]), (), datetime.now(UTC)))["pictures"]
    assert alone.caption.startswith("Engineering stress")
    assert "Last row" in alone.caption


def test_the_budget_s_bars_are_standard_deviations_of_the_modulus(fit: FitRecord, shown: Shown) -> None:
    percent_of = dict(shares(fit))
    assert percent_of["width"] == 3.0
    assert percent_of["noise and mesh"] == pytest.approx(100 * 3e3 / 50e3 / (2 * 1.96))
    many = replace(fit, budget=(*fit.budget, *fit.budget[1:]))
    expected = np.sqrt(np.sum(np.square([0.8, 0.7, 0.6, 0.3, 0.4])))
    assert dict(shares(many))["5 smaller sources"] == pytest.approx(expected)
    (axes,) = drawn_budget([(shown(fit), fit)]).axes
    assert axes.patches[0].get_width() == 3.0
    three = [axes for axes in drawn_budget([(shown(fit), fit)] * 3).axes if axes.axison]
    assert [axes.get_subplotspec().colspan.start for axes in three] == [0, 1, 0]
    assert [axes.get_xlabel() != "" for axes in three] == [False, True, True]  # the lowest axes of each column


def test_quantities_of_the_report_have_their_interval_and_their_unit(fit: FitRecord) -> None:
    words = [text.replace("\N{NO-BREAK SPACE}", " ") for text in value_and_interval(fit.initial_shear_modulus)]
    assert words == ["50 kPa", "40 to 65 kPa, −20 % to +30 %"]
    assert format_quantity(fit.initial_shear_modulus) == "50 kPa [40, 65]"
    assert format_quantity(Quantity(50e6, "Pa", (40e6, 65e6))) == "50 MPa [40, 65]"
    assert format_quantity(Quantity(50e9, "Pa", (40e9, 65e9))) == "50 GPa [40, 65]"
    assert format_quantity(Quantity(2.0, "1", (1.5, 3.0))) == "2.00 [1.50, 3.00]"


def test_the_table_of_laws_has_a_column_for_the_data_if_they_differ(fit: FitRecord, shown: Shown) -> None:
    same = table_of_laws([shown(fit), shown(fit)], True)
    assert "Fitted to: bending." in same.caption
    assert "fitted to" not in same.head
    different = table_of_laws([shown(fit), replace(shown(fit), origin="tensile 50 %")], True)
    column = different.head.index("fitted to")
    assert [row[column] for row in different.texts()] == ["bending", "tensile 50 %"]
    assert len(same.head) == len(same.texts()[0]) == len(different.head) - 1


def test_no_table_of_the_report_loses_a_last_zero(fit: FitRecord, tensile: TensileRecord, shown: Shown) -> None:
    modulus = Quantity(46.5e3, "Pa", (46.3e3, 46.71e3))
    cause = Cause("tilt", 0.75, 1.0, "deg", -2.0, "a picture from above")
    round_fit = replace(fit, initial_shear_modulus=modulus, parameters={"mu": modulus}, causes=(cause,))
    laws = table_of_laws([shown(round_fit), shown(replace(tensile, rmse_Pa=1200.0))], True).texts()
    assert laws[0][1:3] == ["46.50 kPa [46.30, 46.71]", "mu = 46.50 kPa [46.30, 46.71]"]
    assert laws[1][3] == "RMSE 1.20 kPa"
    causes = table_of_causes([shown(round_fit)])
    assert causes is not None
    assert causes.texts()[0][2:5] == ["0.75", "+1.0 deg", "-2.0 %"]
    published = table_of_published(SimpleNamespace(shown=shown(round_fit), how="yeoh"), "Dragon Skin 30")  # type: ignore[arg-type]
    assert published is not None
    assert published.texts()[1][:2] == ["339 kPa", "7.3"]


@pytest.fixture
def report_of(shown: Shown, validation: Judged) -> Reported:
    # Return a function that makes a report on one dataset, filmed at 25 px/mm.
    def report_of(fit: FitRecord, evidence: Evidence, truth: dict[str, Any] | None = None) -> Any:
        beam = SimpleNamespace(name="one", material="silicone")
        dataset = SimpleNamespace(
            kind="points",
            specimen=SimpleNamespace(specimen=beam),
            calibration=SimpleNamespace(pixels_per_mm=25.0),
            truth=lambda: truth,
        )
        fitted_to = replace(evidence, sha256=fit.datasets[0].sha256)
        contents = SimpleNamespace(
            dataset=dataset,
            evidence=fitted_to,
            name="beam.h5",
            validations=(validation(fit),),
            simulated_by=lambda shown: None,
        )
        one = shown(fit)
        return SimpleNamespace(fits=(one,), bending=[one], tensile=[], datasets=[contents], written=datetime.now(UTC))

    return report_of


def test_the_first_screen_shows_the_result_of_a_fit(
    fit: FitRecord, evidence: Evidence, report_of: Reported, validation: Callable[..., Validation]
) -> None:
    (finding,) = findings.findings(report_of(fit, evidence))
    verdicts = {verdict.question: verdict for verdict in finding.verdicts}
    belief = verdicts["Can the modulus be believed?"]
    assert belief.answer == "budget stated"
    assert "The error is 12 µm (0.31 pixel)" in belief.words
    assert "left out of the fit the error is 23 µm." in belief.words
    assert verdicts["What is extrapolated?"].answer == "beyond 50.0 % strain"
    assert "a stretch of 1.500" in verdicts["What is extrapolated?"].words
    assert "by width, whose standard uncertainty changes the modulus by 3 %" in finding.limit
    assert verdicts["What to measure better next?"].answer == fit.measure_next.words
    assert "3 states of bending, fields up to 6 mT" in finding.how
    for change, answer in (({"held_out_error_mm": 0.0130}, "predicted unseen states"), ({"budget": ()}, "noise only")):
        (graded,) = findings.findings(report_of(replace(fit, **change), evidence))
        assert graded.verdicts[0].answer == answer
    exact = replace(fit, budget=(), taken_as_exact=(), measure_next=replace(fit.measure_next, source=None))
    for change, answer in ((exact, "more states"), (replace(exact, taken_as_exact=("dimensions",)), "not known")):
        (without,) = findings.findings(report_of(change, evidence))
        assert [v.answer for v in without.verdicts if v.question == "What to measure better next?"] == [answer]
    of_other = validation(fit).model_copy(update={"dataset": "other.h5", "seen": False, "mean_error_interval_mm": None})
    predicted, missed = (
        of_other.model_copy(update={"mean_error_mm": share * fit.mean_error_mm}) for share in (1.2, 4.0)
    )
    assert grade(fit, [predicted]).name == "predicted an unseen specimen"
    assert "other.h5" in grade(fit, [predicted]).words
    assert grade(fit, [missed]).name == "budget stated"
    assert "did not predict the specimen of other.h5" in grade(fit, [missed]).words
    ends = (0.5 * fit.mean_error_mm, 5 * fit.mean_error_mm)
    by_inputs = missed.model_copy(update={"mean_error_interval_mm": ends})
    assert grade(fit, [by_inputs]).name == "predicted an unseen specimen"
    doubtful = replace(fit, doubts=(Doubt("the clamp moved", 0),))
    (finding,) = findings.findings(report_of(doubtful, evidence))
    assert finding.verdicts[0].answer == "doubted"
    assert "the clamp moved" in finding.verdicts[0].words


@pytest.mark.parametrize(("mu", "where"), [(62e3, "inside"), (66e3, "outside"), (39e3, "outside")])
def test_a_hidden_truth_is_inside_the_interval_or_outside(
    fit: FitRecord, evidence: Evidence, report_of: Reported, mu: float, where: str
) -> None:
    truth = {"model": "neo-hookean", "parameters": {"mu_Pa": mu}}
    (finding,) = findings.findings(report_of(fit, evidence, truth))
    verdict = next(v for v in finding.verdicts if v.question == "How far is the modulus from the true value?")
    assert f"initial shear modulus {1e-3 * mu:g} kPa, {where} the interval" in verdict.words
    assert verdict.answer.replace("−", "-") == f"{100 * (50e3 / mu - 1):+.2f} %"
    assert Score(fit, mu).difference_percent == pytest.approx(100 * (50e3 / mu - 1))


def test_several_datasets_share_one_verdict_on_their_residuals_and_one_on_the_hidden_material(
    fit: FitRecord, evidence: Evidence, report_of: Reported, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = {"model": "neo-hookean", "parameters": {"mu_Pa": 62e3}}
    report, other = report_of(fit, evidence, truth), report_of(fit, evidence, truth)
    (one,), (two,) = report.datasets, other.datasets
    one.name, two.name = "one.h5", "two.h5"
    one.simulated_by = two.simulated_by = lambda shown: "simulated"
    report.datasets = [one, two]
    verdicts = [ResidualNoise("no", "", "random part 0.3 µm, systematic part 0.7 µm")] * 2
    verdicts.append(ResidualNoise("yes", "", "random part 0.4 µm"))
    answers = iter([*verdicts[:2], *verdicts[1:]])
    monkeypatch.setattr(findings, "residual_noise", lambda simulated: next(answers))
    for answer, parts in (("no", verdicts[1].parts), ("1 of 2 datasets", verdicts[2].parts)):
        (finding,) = findings.findings(report)
        (noise,) = (v for v in finding.verdicts if v.question == "Do the residuals look like noise?")
        (hidden,) = (v for v in finding.verdicts if v.question == "How far is the modulus from the true value?")
        assert noise.answer == answer
        assert f"one.h5: no, {verdicts[0].parts}; two.h5: {'no' if answer == 'no' else 'yes'}, {parts}" in noise.words
        assert hidden.words.startswith("one.h5, two.h5 were made on the virtual rig. Hidden material: neo-hookean, mu")


def test_the_smallest_error_on_a_specimen_is_bold(
    fit: FitRecord, evidence: Evidence, report_of: Reported, shown: Shown, validation: Judged
) -> None:
    report = report_of(fit, evidence)
    report.fits = (shown(fit), replace(shown(fit), index=1))
    report.datasets[0].validations = (validation(fit), validation(fit, mean_error_mm=0.01, seen=False))
    (table,) = fits_on_specimens(report)
    worse, best = (row[2] for row in table.rows)
    assert worse == "20.0 [15.0, 30.0]*"
    assert (best.text, best.mark) == ("10.0 [15.0, 30.0]", "best")  # type: ignore[union-attr]


def test_the_interval_names_what_scatters(fit: FitRecord, evidence: Evidence, report_of: Reported) -> None:
    report = report_of(replace(fit, budget=()), evidence)
    (finding,) = findings.findings(report)
    assert finding.limit.startswith("The scatter of the tracked points and the error of the mesh limit the interval")
    report.datasets[0].dataset.kind = "frames"
    (finding,) = findings.findings(report)
    assert finding.limit.startswith("The scatter of the edges and the error")
