"""What a person reads of a fit: every number with the size, the unit and the place that the result's file has.

One small fit, its numbers replaced by some that cannot be mistaken for each other.
"""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib.text
import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.inference.budget import BudgetEntry, MeasureNext
from eimi_fitting.inference.checks import Doubt
from eimi_fitting.inference.choice_of_law import Choice
from eimi_fitting.inference.draws import Draws
from eimi_fitting.inference.estimate import FreedNuisance
from eimi_fitting.inference.quantity import Quantity
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.tensile import engineering_stress
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.config.toml import parse
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.points import Load, TrackedPoints, write_points
from eimi_lab.demonstration import Score
from eimi_lab.fits.evidence import Evidence, load_evidence
from eimi_lab.fits.export import bulk_modulus_Pa
from eimi_lab.fits.fit_figures import drawn_errors as errors_in_a_notebook
from eimi_lab.fits.fit_figures import drawn_law
from eimi_lab.fits.fit_summary import comparison_table, remarks
from eimi_lab.fits.fitting import fit_evidence
from eimi_lab.fits.records import BootstrapRecord, CurveRecord, FitRecord, ReplicateRecord, StateError, TensileRecord
from eimi_lab.fits.states_used import FlaggedState, StatesUsed, WidenedState
from eimi_lab.fits.tensile_files import read_tensile
from eimi_lab.fits.tensile_fits import fit_window
from eimi_lab.fits.validation import FitReference, Validation, predict
from eimi_lab.fits.validation_tables import by_dataset, by_state, matrix
from eimi_lab.report import findings
from eimi_lab.report.panels.convergence import drawn_convergence, table_of_searches
from eimi_lab.report.panels.error_against_field import drawn_errors
from eimi_lab.report.panels.error_boxes import drawn_boxes
from eimi_lab.report.panels.every_fit import tables as fits_on_specimens
from eimi_lab.report.panels.laws import table_of_choice, table_of_laws
from eimi_lab.report.panels.stress_strain import drawn_stress
from eimi_lab.report.panels.uncertainty_budget import drawn_budget, shares
from eimi_lab.report.rounded import format_quantity, value_and_interval
from eimi_lab.report.shown import ShownFit, chosen
from eimi_lab.report.stress import TensilePoints

FIELD_MT = (0.0, 3.0, 6.0)
OF_THE_RECORD = ("doubts", "stability", "model", "tensile", "by_state", "datasets")
"""What a result's file says in other words than the mathematics."""

MODULUS = Quantity(50e3, "Pa", (40e3, 65e3), (49e3, 52e3))


@pytest.fixture(scope="module")
def evidence(tmp_path_factory: pytest.TempPathFactory) -> Evidence:
    """Tracked points of a beam of 50 kPa in three fields."""
    path = tmp_path_factory.mktemp("printed") / "beam.h5"
    text = load_specimen("type1").text.replace('section = "solid"', 'section = "plane-stress"')
    specimen = parse(SpecimenFile, text, "type1")
    model = BeamModel(specimen.mechanics(), 20, 2)
    rest = np.column_stack([np.linspace(2, 24, 8), np.zeros(8)])
    shapes = model.solve(LAWS["neo-hookean"], np.array([[50e3]]), Loads.along(FIELD_MT))
    places = model.positions(shapes, rest)[0] + np.random.default_rng(0).normal(0, 0.01, (3, 8, 2))
    names = tuple(f"p{i}" for i in range(8))
    points = [TrackedPoints(names, rest, place, np.full(8, 0.01)) for place in places]
    write_points(path, Header(specimen), 0.0, [Load(None, field, 0.0) for field in FIELD_MT], points)
    return load_evidence(path)


@pytest.fixture(scope="module")
def fitted(evidence: Evidence) -> FitRecord:
    return fit_evidence([evidence], "neo-hookean")


@pytest.fixture
def fit(fitted: FitRecord) -> FitRecord:
    """The fit with numbers of our own."""
    entry = BudgetEntry("width", "width", 0.02, "mm", (0,), 3.0)
    small = [BudgetEntry("depth", "depth", 0.01, "mm", (0,), size) for size in (0.9, 0.8, 0.7, 0.6, 0.3, 0.4)]
    return fitted.model_copy(
        update={
            "initial_shear_modulus": MODULUS,
            "parameters": {"mu": MODULUS},
            "bulk_modulus": Quantity(7e6, "Pa", (5e6, 9e6)),
            "freed": (FreedNuisance("moment", (0,), Quantity(0.011, "1", (-0.02, 0.04)), 0.05),),
            "mean_error_mm": 0.0123,
            "mean_deviation_mm": 0.0045,
            "held_out_error_mm": 0.0234,
            "budget": (entry, *small),
            "measure_next": MeasureNext("width", "width", (45e3, 57e3)),
            "max_stretch": 1.25,
            "draws": Draws(1, ("mu",), tuple((x,) for x in np.linspace(40e3, 65e3, 401).tolist())),
            "tensile": (
                CurveRecord(
                    path="curve.csv",
                    sha256="0" * 64,
                    window_percent=50.0,
                    weight=0.5,
                    rows=40,
                    correlation_rows=4.0,
                    largest_strain=0.5,
                    rmse_alone_Pa=210.0,
                    rmse_Pa=350.0,
                ),
            ),
            "doubts": (),
            "by_state": tuple(
                StateError(
                    dataset=0, state=k, current_A=None, field_mT=field, error_mm=0.01 * (k + 1), deviation_mm=0.002
                )
                for k, field in enumerate(FIELD_MT)
            ),
        }
    )


@pytest.fixture
def tensile(tmp_path: Path) -> TensileRecord:
    strain = np.linspace(0.02, 1.0, 30)
    rows = [f"{e},{60 * (1 + e - (1 + e) ** -2)}" for e in strain]
    (tmp_path / "curve.csv").write_text("\n".join(["strain,stress_kPa", *rows]) + "\n")
    found = fit_window(read_tensile(tmp_path / "curve.csv"), "neo-hookean", 50.0)
    return found.model_copy(update={"rmse_Pa": 1234.0})


def shown(fit: FitRecord | TensileRecord, comparison: tuple[Choice, ...] = (), **more: Any) -> ShownFit:
    return ShownFit(Path("fits.json"), 0, fit, comparison, "bending", **more)


def validation(of: FitRecord, **changes: Any) -> Validation:
    own: dict[str, Any] = {
        "dataset": "beam.h5",
        "sha256": "0" * 64,
        "section": "plane-stress",
        "model": of.model,
        "fit": FitReference(path="fits.json", index=0, kind="bending", window_percent=None),
        "initial_shear_modulus": MODULUS,
        "seen": True,
        "states": of.datasets[0].states,
        "status": "ok",
        "mean_error_mm": 0.02,
        "mean_error_interval_mm": (0.015, 0.03),
        "mean_deviation_mm": 0.004,
        "max_stretch": 1.2,
        "stable": True,
        "within_fitted_stretch": True,
        "by_state": of.by_state,
    }
    return Validation(**{**own, **changes})


def test_a_fit_s_line_has_the_modulus_with_its_ends_and_the_error_in_micrometres(fit: FitRecord) -> None:
    assert "initial shear modulus 50000 Pa [40000, 65000], mean error 12.30 µm" in fit.summary()
    assert "Mean error 12.3 µm, mean deviation 4.5 µm." in fit.notes()
    large = fit.model_copy(update={"initial_shear_modulus": Quantity(50e6, "Pa", (40e6, 65e6))})
    assert "50.000 MPa [40.000, 65.000]" in large.summary()


def test_what_is_beside_the_modulus_has_its_own_unit(fit: FitRecord) -> None:
    lines = remarks(fit)
    assert "bulk modulus 7000 [5000, 9000] kPa" in lines
    assert "moment off by 1.1 % [-2 %, 4 %], prior standard deviation 5 %" in lines
    assert any(
        line.startswith(
            "curve.csv: RMSE 0.35 kPa, 0.21 kPa for the curve alone (weight 0.5, 40 rows that count as 10.0"
        )
        for line in lines
    )
    assert "width ± 0.02 mm: ± 3 % of the modulus" in lines
    assert "2 smaller sources together: ± 0.5 % of the modulus" in lines
    assert "noise and mesh alone: [49000, 52000] Pa at 95 %" in lines
    assert any("the interval would be [45000, 57000] Pa" in line for line in lines)
    in_degrees = replace(fit.freed[0], deviation=Quantity(0.2, "deg", (0.1, 0.4)), prior_standard_deviation=0.3)
    lines = remarks(fit.model_copy(update={"freed": (in_degrees,)}))
    assert "moment off by 0.2 deg [0.1 deg, 0.4 deg], prior standard deviation 0.3 deg" in lines


CHOICES = (
    Choice("neo-hookean", 1, 55.0, 7.5, 3.25, 0.02, 0.0123),
    Choice("yeoh", 3, 55.0, 0.0, 0.0, 0.98, 0.0045),
)


def test_the_laws_compared_have_their_criteria_each_in_its_column(fit: FitRecord) -> None:
    _, first, second = comparison_table(CHOICES)
    assert first.split() == ["neo-hookean", "1", "7.5", "3.2", "0.020", "12.30", "µm"]
    assert second.split() == ["yeoh", "3", "0.0", "0.0", "0.980", "4.50", "µm"]
    rows = table_of_choice(CHOICES).texts()
    assert rows[0] == ["neo-hookean", "1", "7.5", "3.2", "0.020", "12.3"]
    # The report stands for the law of the smallest AICc, whichever of them comes first.
    both = [shown(fit, CHOICES), shown(fit.model_copy(update={"model": "yeoh"}), CHOICES)]
    assert chosen(both).fit.model == chosen(both[::-1]).fit.model == "yeoh"


def test_a_tensile_fit_s_misfit_is_in_kilopascal(tensile: TensileRecord) -> None:
    assert "RMSE 1.23 kPa over" in tensile.summary()
    assert "RMSE 1.23 kPa over" in tensile.notes()[0]
    (row,) = table_of_laws([shown(tensile)], False).texts()
    assert row[4] == "RMSE 1.23 kPa"
    nowhere = tensile.stability.model_copy(update={"stable_up_to_stretch": 1.0})
    assert "not stable at any stretch" in tensile.model_copy(update={"stability": nowhere}).summary()
    limited = tensile.stability.model_copy(update={"stable_up_to_stretch": 1.5})
    assert "stable up to a stretch of 1.50 only" in tensile.model_copy(update={"stability": limited}).summary()


def test_a_bootstrap_s_interval_is_that_of_ninety_five_per_cent_of_its_replicates() -> None:
    def replicates(count: int) -> list[ReplicateRecord]:
        return [
            ReplicateRecord(
                replicate=k + 1,
                parameters={"mu": 0.0},
                initial_shear_modulus_Pa=1000.0 * k,
                mean_error_mm=0.0,
                evaluations=1,
                stop="",
                wall_s=0.0,
            )
            for k in range(count)
        ]

    assert BootstrapRecord.of(replicates(41)).initial_shear_modulus_interval_95_Pa == pytest.approx((1000.0, 39000.0))
    assert BootstrapRecord.of(replicates(39)).initial_shear_modulus_interval_95_Pa is None


def test_states_are_told_by_their_own_numbers_and_datasets_apart(fitted: FitRecord, evidence: Evidence) -> None:
    """Of a dataset that lost its first two states, and one of another length beside it."""
    short = replace(evidence, path=Path("short.h5"), states=(replace(evidence.states[2], index=7),))
    held = {name: value for name, value in vars(fitted).items() if name not in OF_THE_RECORD}
    found: Any = SimpleNamespace(
        **held,
        law=LAWS["neo-hookean"],
        error_mm=np.array([0.1, 0.2, 0.3, 0.4]),
        deviation_mm=np.array([0.01, 0.02, 0.03, 0.04]),
        corrections={},
        curves=(),
        curve_rmse_Pa=(),
        doubts=(Doubt("odd", 0, 0),),
        stable_to=None,
        stability_checked_to=6.0,
    )
    record = FitRecord.of(found, [short, evidence])
    assert [(s.dataset, s.state, s.error_mm, s.deviation_mm) for s in record.by_state] == [
        (0, 7, 0.1, 0.01),
        (1, 0, 0.2, 0.02),
        (1, 1, 0.3, 0.03),
        (1, 2, 0.4, 0.04),
    ]
    assert [s.field_mT for s in record.by_state] == [6.0, *FIELD_MT]
    assert record.doubts_in_words() == ["short.h5, state 7: odd"]


def test_states_left_out_are_taken_off_those_that_there_are() -> None:
    used = StatesUsed(16, (FlaggedState(2, ("DEFOCUS",)), FlaggedState(7, ("DEFOCUS",))), (), (WidenedState(3, 0.02),))
    assert used.in_words() == (
        "14 of 16 states used; left out 2 DEFOCUS (2, 7); points widened in 1, by up to 0.02 mm (3)"
    )


def test_tables_of_validations_are_in_micrometres_and_kilopascal(fit: FitRecord) -> None:
    other = FitReference(path="fits.json", index=1, kind="bending", window_percent=None)
    worse = validation(fit, fit=other, seen=False, mean_error_mm=0.05, within_fitted_stretch=False, stable=False)
    open_end = validation(fit, dataset="other.h5", mean_error_interval_mm=(0.015, None))
    lines = by_dataset([worse, validation(fit)])
    best, last = lines[2], lines[3]
    told = "fits.json:0 bending neo-hookean 50.00 [40.00, 65.00] 20.0 [15.0, 30.0] 4.00 1.200 seen"
    assert " ".join(best.split()) == told
    assert last.endswith("unseen, not stable over these stretches, stretched beyond its data")
    table = matrix([validation(fit), open_end])
    assert re.search(r"20\.0 \[15\.0, 30\.0\]\*\s+20\.0 \[15\.0, >\]\*", table[2])
    states = by_state([validation(fit)])
    assert [line.split()[1:] for line in states[2:5]] == [
        ["0.000", "10.00", "±", "2.00"],
        ["3.000", "20.00", "±", "2.00"],
        ["6.000", "30.00", "±", "2.00"],
    ]
    assert states[5].split() == ["mean", "20.0", "±", "4.00"]
    cells = re.findall(r"<td>(.*?)</td>", validation(fit)._repr_html_())
    assert cells[:4] == ["0", "0.000", "10", "2"]
    assert "mean error 20 µm" in validation(fit)._repr_html_()


def texts(drawing: Any) -> str:
    """All words of a figure."""
    return " ".join(text.get_text() for text in drawing.findobj(matplotlib.text.Text))


def test_a_notebook_s_figures_show_kilopascal_and_micrometres() -> None:
    law, drawn = LAWS["neo-hookean"], np.linspace(40e3, 60e3, 2001)[:, None]
    (axes,) = drawn_law(law, np.array([50e3]), drawn, 1.5).axes
    strain, stress = axes.lines[0].get_data()
    assert stress == pytest.approx(1e-3 * engineering_stress(law, np.array([50e3]), strain / 100))
    band = axes.collections[0].get_paths()[0].vertices
    ends = 1e-3 * engineering_stress(law, np.array([[40.5e3], [59.5e3]]), np.array([1.0]))[:, 0]
    at_end = band[np.isclose(band[:, 0], 100.0), 1]
    assert (at_end.min(), at_end.max()) == pytest.approx(tuple(ends), rel=1e-3)
    (axes,) = errors_in_a_notebook([0, 1], [2.0, 4.0], [0.01, 0.03], [0.002, 0.004]).axes
    assert axes.lines[0].get_ydata().tolist() == pytest.approx([10.0, 30.0])
    assert "µm" in axes.get_ylabel()


def simulated(fit: FitRecord, evidence: Evidence) -> Any:
    """As the panels get it."""
    return SimpleNamespace(
        shown=shown(fit), evidence=evidence, error_mm=np.array([0.01, 0.02, 0.03]), deviation_mm=np.full(3, 0.004)
    )


def test_the_report_s_figures_show_what_the_fit_says(fit: FitRecord, evidence: Evidence) -> None:
    own = simulated(fit, evidence)
    (axes,) = drawn_errors([own]).axes
    x, error = axes.lines[0].get_data()
    assert x.tolist() == list(FIELD_MT)
    assert error.tolist() == pytest.approx([10.0, 20.0, 30.0])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("field, mT", "error, µm")
    contents = SimpleNamespace(
        name="beam.h5",
        simulated=(own,),
        dataset=SimpleNamespace(specimen=SimpleNamespace(specimen=SimpleNamespace(name="one"))),
    )
    (axes,) = drawn_boxes(SimpleNamespace(datasets=[contents], every=[own.shown])).axes  # type: ignore[arg-type]
    median = next(line for line in axes.lines if line.get_color() == "black")
    assert median.get_ydata().tolist() == pytest.approx([20.0, 20.0])
    (axes,) = drawn_convergence([own.shown]).axes
    assert axes.lines[0].get_ydata()[-1] == pytest.approx(1e3 * fit.history[-1].best_mm)
    assert table_of_searches([own.shown]).texts()[0][4].endswith(f"to {1e3 * fit.polish.mean_error_after_mm:.2f} µm")
    assert table_of_searches([own.shown]).texts()[0][5] == f"{1e3 * fit.mean_error_mm:.2f} µm"


def test_the_report_s_stress_is_in_kilopascal_with_the_band_of_the_draws(fit: FitRecord) -> None:
    bare = fit.model_copy(update={"tensile": ()})
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
    assert whole.get_xdata().max() <= 25.0  # solid as far as the data went
    band = next(c for c in uniaxial.collections if len(c.get_paths())).get_paths()[0].vertices
    ends = engineering_stress(law, np.quantile(np.linspace(40e3, 65e3, 401), [[0.025], [0.975]]), strain[-1:] / 100)
    at_end = band[np.isclose(band[:, 0], strain[-1]), 1]
    assert (at_end.min(), at_end.max()) == pytest.approx(tuple(1e-3 * ends[:, 0]), rel=1e-2)


def test_the_budget_s_bars_are_standard_deviations_of_the_modulus(fit: FitRecord) -> None:
    found = dict(shares(fit))
    assert found["width"] == 3.0
    assert found["noise and mesh"] == pytest.approx(100 * 3e3 / 50e3 / (2 * 1.96))
    many = fit.model_copy(update={"budget": (*fit.budget, *fit.budget[1:])})
    assert dict(shares(many))["5 smaller ones"] == pytest.approx(np.sqrt(np.sum(np.square([0.8, 0.7, 0.6, 0.3, 0.4]))))
    (axes,) = drawn_budget([(shown(fit), fit)]).axes
    assert axes.patches[0].get_width() == 3.0


def test_numbers_of_the_report_have_their_ends_and_their_unit() -> None:
    words = [text.replace("\N{NO-BREAK SPACE}", " ") for text in value_and_interval(MODULUS)]
    assert words == ["50 kPa", "40 to 65 kPa, −20 % to +30 %"]
    assert format_quantity(MODULUS) == "50 kPa [40, 65]"
    assert format_quantity(Quantity(50e6, "Pa", (40e6, 65e6))) == "50 MPa [40, 65]"
    assert format_quantity(Quantity(50e9, "Pa", (40e9, 65e9))) == "50 GPa [40, 65]"
    assert format_quantity(Quantity(2.0, "1", (1.5, 3.0))) == "2 [1.5, 3]"


def report_of(fit: FitRecord, evidence: Evidence, truth: dict[str, Any] | None = None) -> Any:
    """A report of one dataset, seen by a camera of 25 pixels a millimetre."""
    beam = SimpleNamespace(name="one", material="silicone")
    dataset = SimpleNamespace(
        specimen=SimpleNamespace(specimen=beam),
        calibration=SimpleNamespace(pixels_per_mm=25.0),
        truth=lambda: truth,
    )
    own = replace(evidence, sha256=fit.datasets[0].sha256)
    contents = SimpleNamespace(dataset=dataset, evidence=own, name="beam.h5", validations=(validation(fit),))
    one = shown(fit)
    return SimpleNamespace(every=(one,), bending=[one], tensile=[], datasets=[contents], written=datetime.now(UTC))


def test_the_first_screen_says_what_the_fit_says(fit: FitRecord, evidence: Evidence) -> None:
    (found,) = findings.findings(report_of(fit, evidence))
    said = {verdict.question: verdict for verdict in found.verdicts}
    belief = said["Can it be believed?"]
    assert belief.answer == "yes"
    assert "beam is 12 µm (0.31 pixel) off in the mean, 23 µm in states left out" in belief.words
    assert said["What is extrapolated?"].answer == "beyond 25.0 % strain"
    assert "a stretch of 1.250" in said["What is extrapolated?"].words
    assert "by width, whose standard uncertainty moves the modulus by 3 %" in found.limit
    assert said["What to measure better next?"].answer == fit.measure_next.words
    assert "3 states of bending, fields up to 6 mT" in found.how
    doubtful = fit.model_copy(update={"doubts": (Doubt("the clamp moved", 0),)})
    (found,) = findings.findings(report_of(doubtful, evidence))
    assert found.verdicts[0].answer == "with doubts"
    assert "the clamp moved" in found.verdicts[0].words


@pytest.mark.parametrize(("mu", "where"), [(62e3, "inside"), (66e3, "outside"), (39e3, "outside")])
def test_a_hidden_truth_is_inside_the_interval_or_outside(
    fit: FitRecord, evidence: Evidence, mu: float, where: str
) -> None:
    truth = {"model": "neo-hookean", "parameters": {"mu_Pa": mu}}
    (found,) = findings.findings(report_of(fit, evidence, truth))
    verdict = next(v for v in found.verdicts if v.question == "And the truth?")
    assert f"initial shear modulus {1e-3 * mu:g} kPa, {where} the interval" in verdict.words
    assert verdict.answer.replace("−", "-") == f"{100 * (50e3 / mu - 1):+.2f} %"
    assert Score(fit, mu).difference_percent == pytest.approx(100 * (50e3 / mu - 1))


def test_the_smallest_error_on_a_specimen_is_the_bold_one(fit: FitRecord, evidence: Evidence) -> None:
    report = report_of(fit, evidence)
    report.every = (shown(fit), replace(shown(fit), index=1))
    report.datasets[0].validations = (validation(fit), validation(fit, mean_error_mm=0.01, seen=False))
    (table,) = fits_on_specimens(report)
    worse, best = (row[2] for row in table.rows)
    assert worse == "20.0 [15.0, 30.0]*"
    assert (best.text, best.mark) == ("10.0 [15.0, 30.0]", "best")  # type: ignore[union-attr]


def test_what_is_drawn_of_a_fit_is_the_better_model_s(fitted: FitRecord, evidence: Evidence) -> None:
    """The outline of the finer mesh, where there is one, and not of the one that the search had."""
    found = predict(evidence, fitted, Path("fits.json"), 0)
    assert found.correction is not None
    finer = found.correction.models[0]
    expected = points_on(outline(finer, found.correction.better.shapes[0])[0], 6)
    assert found.edges_mm == pytest.approx(expected)
    coarse = outline(evidence.experiment.model, BeamModel.solve(*_at_rest(evidence)))
    assert found.edges_mm.shape[2] > points_on(coarse[0], 6).shape[2]


def _at_rest(evidence: Evidence) -> tuple[Any, ...]:
    experiment = evidence.experiment
    return experiment.model, LAWS["neo-hookean"], np.array([[50e3]]), experiment.loads


def test_an_error_has_no_upper_end_where_a_draw_finds_no_equilibrium(fitted: FitRecord, evidence: Evidence) -> None:
    sound = tuple((x,) for x in np.linspace(49e3, 51e3, 15).tolist())
    for draws, has_end in ((sound, True), ((*sound, (-5e3,)), False)):
        own = fitted.model_copy(update={"draws": Draws(1, ("mu",), draws)})
        interval = predict(evidence, own, Path("fits.json"), 0).validation.mean_error_interval_mm
        assert interval is not None
        assert (interval[1] is not None) == has_end


@pytest.mark.parametrize(("kPa", "ratio", "expected"), [(900.0, None, 9e5), (None, 2000.0, 1e8)])
def test_a_card_s_bulk_modulus_is_what_was_stated(
    fit: FitRecord, kPa: float | None, ratio: float | None, expected: float
) -> None:
    assert bulk_modulus_Pa(fit, kPa, ratio) == pytest.approx(expected)
