"""Every printed number is the right stored number times the right factor, for example 1000 from mm to µm.

`traced_numbers.txt` lists the path of the stored number, and the factor, for each printed number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from eimi_fitting.discovery.terms_of_a_law import Alternative, Discovery
from eimi_fitting.inference.doubts.causes import Cause
from eimi_fitting.inference.interval.budget import BudgetEntry
from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_fitting.laws.sum_of_terms import Term
from eimi_lab.fits import discovering, validation_tables
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.fit_summary import comparison_table, remarks, tensile_remarks
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.validation import Validation
from eimi_lab.reporting import findings
from eimi_lab.reporting.elements import Elements, Table
from eimi_lab.reporting.error_at_a_glance import error_at_a_glance
from eimi_lab.reporting.panels import law_stability, methods, uncertainty_budget, what_was_measured
from eimi_lab.reporting.panels.causes import table_of_causes
from eimi_lab.reporting.panels.convergence import drawn_convergence, table_of_searches
from eimi_lab.reporting.panels.error_against_field import drawn_errors
from eimi_lab.reporting.panels.error_boxes import drawn_boxes
from eimi_lab.reporting.panels.every_fit import tables as tables_of_every_fit
from eimi_lab.reporting.panels.laws import table_of_choice, table_of_laws
from eimi_lab.reporting.panels.parameter_correlation import drawn_correlations
from eimi_lab.reporting.panels.published_values import table_of_published
from eimi_lab.reporting.shown import ShownFit
from tests.lab.printed.drawn import printed_figure
from tests.lab.printed.tracing import Texts, filled, numbers_of, traced

LIST = Path(__file__).with_name("traced_numbers.txt")
Shown = Callable[..., ShownFit]


def printed_table(table: Table | None) -> dict[str, str]:
    # Return the rows of a table without the caption, as HTML, CSV and LaTeX, by name of the table and format.
    assert table is not None
    bare = replace(table, caption="", notes=())
    page = str(Elements().table(bare)).partition("<tbody>")[2]
    texts = {"page": page, "csv": bare.to_csv(), "latex": bare.to_latex()}
    return {f"{table.name} {kind}": text for kind, text in texts.items()}


def namespace(content: Any) -> Any:
    # Return nested dictionaries as nested objects, whose attributes are the keys.
    if isinstance(content, dict):
        return SimpleNamespace(**{key: namespace(value) for key, value in content.items()})
    return [namespace(value) for value in content] if isinstance(content, list) else content


def lines(texts: Iterable[str]) -> str:
    return "\n".join(texts)


def numbers_of_a_fit(fit: FitRecord, evidence: Evidence, shown: Shown) -> dict[str, list[str]]:
    causes = (
        Cause("camera_roll", 0.83, 1.7, "deg", -2.3, "a plumb line"),
        Cause("scale", 0.12, 0.019, "1", 4.1, "a second ruler"),
    )
    doubted = BudgetEntry("magnetisation", "direction of magnetisation", 3.0, "deg", (0,), 7.7)
    small = tuple(BudgetEntry("depth", "depth", 0.01, "mm", (0,), effect) for effect in (0.25, 0.2, 0.15))
    record = replace(fit, causes=causes, if_uncertain=(doubted,), budget=(*fit.budget, *small))
    adapter = TypeAdapter(FitRecord)

    def printed(content: Any) -> Texts:
        again = adapter.validate_python(content)
        one = shown(again)
        beam = SimpleNamespace(name="one", material="Dragon Skin 10")
        dataset = SimpleNamespace(
            kind="points",
            specimen=SimpleNamespace(specimen=beam),
            calibration=SimpleNamespace(pixels_per_mm=25.0),
            truth=lambda: None,
        )
        contents = SimpleNamespace(
            dataset=dataset,
            evidence=replace(evidence, sha256=again.datasets[0].sha256),
            name="beam.h5",
            simulated_by=lambda shown: None,
        )
        report: Any = SimpleNamespace(bending=[one], tensile=[], datasets=[contents], written=datetime.now(UTC))
        (finding,) = findings.findings(report)
        stability = law_stability._values(SimpleNamespace(fits=[one]))  # type: ignore[arg-type]
        assert stability
        return {
            "first line of a fit": again.summary(),
            "remarks on a fit": lines(remarks(again)),
            "notes on a fit": lines([*again.notes(), *again.caveats()]),
            "modulus on the first page": f"{finding.value} {finding.interval}",
            "limit on the first page": finding.limit,
            "data on the first page": finding.how,
            **{f"first page: {v.question}": f"{v.answer} {v.words}" for v in finding.verdicts},
            "budget": lines(f"{words}: {size:.3f} %" for words, size in uncertainty_budget.shares(again)),
            **printed_table(table_of_laws([one], False)),
            **printed_table(table_of_searches([one])),
            **printed_table(table_of_causes([one])),
            **printed_table(stability["stability"]),
            **printed_table(table_of_published(finding, "Dragon Skin 10")),
        }

    skip = ("draws", "bootstrap", "identifiability.correlation")
    return traced(filled(record.content()), printed, skip)


def numbers_of_the_figures_of_a_fit(fit: FitRecord, shown: Shown) -> dict[str, list[str]]:
    # Return, for each plot of a fit, the source of each printed number: path, ratio to the source, and unit.
    names = ("mu", "moment")
    small = tuple(BudgetEntry("depth", "depth", 0.01, "mm", (0,), effect) for effect in (0.25, 0.2, 0.15))
    record = replace(
        fit,
        budget=(*fit.budget, *small),
        history=fit.history[:3],
        identifiability=replace(fit.identifiability, names=names, correlation=((1.0, 0.41), (0.41, 1.0))),
    )
    adapter = TypeAdapter(FitRecord)

    def printed(content: Any) -> Texts:
        again = adapter.validate_python(content)
        one = shown(again)
        return {
            "figure of the budget": printed_figure(uncertainty_budget.drawn_budget([(one, again)])),
            "figure of the searches": printed_figure(drawn_convergence([one])),
            "figure of the correlations": printed_figure(drawn_correlations([(one, again)])),
        }

    content = record.content()
    drawn = ("budget", "history", "identifiability.correlation", "initial_shear_modulus")
    skip = tuple(path for path in numbers_of(content) if not path.startswith(drawn))
    return traced(filled(content), printed, skip)


def numbers_of_the_figures_of_predictions(fit: FitRecord, shown: Shown) -> dict[str, list[str]]:
    # Find out which stored number each number in a plot of predictions by two laws comes from (see `traced`).
    content = {
        "states": [{"index": k, "field_mT": field} for k, field in enumerate((0.67, 3.49, 6.83))],
        "fits": [
            {"error_mm": [0.011, 0.013, 0.017], "deviation_mm": [0.0031, 0.0037, 0.0041]},
            {"error_mm": [0.019, 0.023, 0.029], "deviation_mm": [0.0043, 0.0047, 0.0053]},
        ],
        "pixels_per_mm": 24.7,
    }

    def printed(content: Any) -> Texts:
        laws = [shown(fit), replace(shown(fit), origin="tensile")]
        evidence = SimpleNamespace(states=namespace(content["states"]))
        predictions: list[Any] = [
            SimpleNamespace(
                fitted_law=law,
                evidence=evidence,
                error_mm=np.array(values["error_mm"]),
                deviation_mm=np.array(values["deviation_mm"]),
            )
            for law, values in zip(laws, content["fits"], strict=True)
        ]
        contents: Any = SimpleNamespace(
            name="beam.h5",
            best=predictions[0],
            simulated=predictions,
            simulated_by=lambda law: predictions[laws.index(law)],
            dataset=SimpleNamespace(
                specimen=SimpleNamespace(specimen=SimpleNamespace(name="one")),
                calibration=SimpleNamespace(pixels_per_mm=content["pixels_per_mm"]),
            ),
        )
        report: Any = SimpleNamespace(datasets=[contents], fits=laws)
        picture = error_at_a_glance(report)
        assert picture
        return {
            "figure on the first page": f"{picture.caption}\n{printed_figure(picture.figure)}",
            "figure of the errors": printed_figure(drawn_errors(predictions)),
            "figure of boxes": printed_figure(drawn_boxes(report)),
        }

    return traced(content, printed)


def numbers_of_a_tensile_fit(tensile: TensileRecord, shown: Shown) -> dict[str, list[str]]:
    adapter = TypeAdapter(TensileRecord)

    def printed(content: Any) -> Texts:
        again = adapter.validate_python(content)
        return {
            "tensile fit": lines([again.summary(), *again.notes(), *tensile_remarks(again)]),
            **{f"tensile {name}": text for name, text in printed_table(table_of_laws([shown(again)], False)).items()},
        }

    return traced(filled(tensile.content()), printed, ("draws", "correlation"))


def numbers_of_a_comparison(choices: tuple[Choice, ...]) -> dict[str, list[str]]:
    content = filled([{field.name: getattr(choice, field.name) for field in fields(Choice)} for choice in choices])

    def printed(content: Any) -> Texts:
        again = tuple(Choice(**choice) for choice in content)
        return {"comparison": lines(comparison_table(again)), **printed_table(table_of_choice(again))}

    return traced(content, printed)


def numbers_of_a_validation(validation: Validation, shown: Shown, fit: FitRecord) -> dict[str, list[str]]:
    def printed(content: Any) -> Texts:
        again = Validation.model_validate(content)
        one = SimpleNamespace(name="beam.h5", validations=[again])
        report: Any = SimpleNamespace(fits=[shown(fit)], datasets=[one])
        (table,) = tables_of_every_fit(report)
        return {
            "validation by dataset": lines(validation_tables.by_dataset([again])),
            "validation by state": lines(validation_tables.by_state([again])),
            "validation as a matrix": lines(validation_tables.matrix([again])),
            **printed_table(table),
        }

    return traced(filled(validation.model_dump(mode="json")), printed, ("draws",))


DATASET: dict[str, Any] = {
    "specimen": {
        "specimen": {
            "name": "one",
            "material": "silicone",
            "length_mm": 31.7,
            "width_mm": 3.13,
            "depth_mm": 5.19,
            "density_kg_m3": 1073.0,
        },
        "magnet": {"length_mm": 4.37, "width_mm": 2.91, "depth_mm": 1.83, "remanence_T": 1.21, "density_kg_m3": 7511.0},
        "uncertainty": {"length_mm": 0.11, "width_mm": 0.023, "depth_mm": 0.031, "density_kg_m3": 13.0},
    },
    "calibration": {
        "pixels_per_mm": 24.7,
        "stand_off_mm": 412.0,
        "coil_constant_mT_per_A": 4.71,
        "uncertainty": {"pixels_per_mm": 0.071, "coil_constant_mT_per_A": 0.053},
    },
    "states": [
        {"index": 0, "field_mT": 0.67, "current_A": 0.14, "tip_force_N": 0.0},
        {"index": 1, "field_mT": 3.49, "current_A": 0.74, "tip_force_N": 0.0},
        {"index": 2, "field_mT": 6.83, "current_A": 1.45, "tip_force_N": 0.0},
    ],
}


def numbers_of_a_dataset(evidence: Evidence) -> dict[str, list[str]]:
    def printed(content: Any) -> Texts:
        specimen, calibration = namespace(content["specimen"]), namespace(content["calibration"])
        specimen.uncertainty = content["specimen"]["uncertainty"]
        calibration.uncertainty = content["calibration"]["uncertainty"]
        calibration.mT_per_A = calibration.coil_constant_mT_per_A
        calibration.telecentric, calibration.calibrated_on = False, None
        dataset = SimpleNamespace(
            kind="frames",
            specimen=specimen,
            calibration=calibration,
            states=namespace(content["states"]),
            truth=lambda: None,
            text=lambda name: 'name = "steps"' if name == "protocol" else None,
        )
        contents: Any = SimpleNamespace(dataset=dataset, evidence=evidence, name="beam.h5", validations=())
        report: Any = SimpleNamespace(datasets=[contents], bending=[], tensile=[])
        facts = (
            what_was_measured._of_specimen(contents)
            + what_was_measured._of_protocol(contents)
            + what_was_measured._of_picture(contents)
        )
        return {
            "methods": methods.paragraph(report),
            **{f"fact: {name}": words for name, words in facts},
        }

    return traced(DATASET, printed)


def numbers_of_a_discovery() -> dict[str, list[str]]:
    content = {"coefficients": [21300.0, 4170.0], "intervals": [[18900.0, 23700.0], [3310.0, 5430.0]], "error": 1.37}

    def printed(content: Any) -> Texts:
        law = Alternative(
            terms=(Term.of("I1"), Term.of("I2")),
            coefficients=np.array(content["coefficients"]),
            intervals=np.array(content["intervals"]),
            initial_shear_modulus_Pa=51e3,
            held_out_error=content["error"],
            stable_to=None,
        )
        result = Discovery((law,), {}, 1.0, law.terms, (), (0.001,), (), (law.terms,), 3)
        return {"discovery": lines(discovering.lines(result, Path("discovery.json"))[1:])}

    return traced(content, printed)


@pytest.fixture
def traces(
    fit: FitRecord,
    tensile: TensileRecord,
    evidence: Evidence,
    choices: tuple[Choice, ...],
    validation: Callable[..., Validation],
    shown: Shown,
) -> dict[str, list[str]]:
    # Return, for each text, table and figure, the stored number from which each printed number comes.
    return {
        **numbers_of_a_fit(fit, evidence, shown),
        **numbers_of_the_figures_of_a_fit(fit, shown),
        **numbers_of_the_figures_of_predictions(fit, shown),
        **numbers_of_a_tensile_fit(tensile, shown),
        **numbers_of_a_comparison(choices),
        **numbers_of_a_validation(validation(fit), shown, fit),
        **numbers_of_a_dataset(evidence),
        **numbers_of_a_discovery(),
    }


def as_text(traces: dict[str, list[str]]) -> str:
    return "".join(f"{name}\n{''.join(f'    {number}' + chr(10) for number in traces[name])}" for name in traces)


def test_every_printed_number_comes_from_its_field_with_its_factor(
    traces: dict[str, list[str]], tmp_path: Path
) -> None:
    present = tmp_path / LIST.name
    present.write_text(as_text(traces), encoding="utf-8")
    assert as_text(traces).splitlines() == LIST.read_text(encoding="utf-8").splitlines(), f"diff {present} {LIST}"


def test_a_value_that_the_data_do_not_determine_says_so_on_the_page_and_in_both_files(
    fit: FitRecord, shown: Shown
) -> None:
    held = replace(fit, identifiability=replace(fit.identifiability, held_by_bounds=("mu",)))
    for name, text in printed_table(table_of_laws([shown(held)], False)).items():
        assert text.count("not measured") == 1, name
    for name, text in printed_table(table_of_laws([shown(fit)], False)).items():
        assert "not measured" not in text, name


def test_the_first_line_of_a_fit_names_what_is_taken_as_exact(fit: FitRecord) -> None:
    assert "taken as exact" not in fit.summary()
    assert "; dimensions taken as exact" in replace(fit, taken_as_exact=("dimensions",)).summary()
    doubted = BudgetEntry("magnetisation", "direction of magnetisation", 3.0, "deg", (0,), 7.7)
    assert "; direction of magnetisation taken as exact" in replace(fit, if_uncertain=(doubted,)).summary()


def test_no_two_numbers_of_a_filled_record_are_equal(fit: FitRecord) -> None:
    numbers = [value for value in numbers_of(filled(fit.content())).values() if isinstance(value, float) and value]
    assert len(set(numbers)) == len(numbers)
