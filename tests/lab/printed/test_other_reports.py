"""The text and figures of a report with several laws, datasets and tensile tests equal stored text and figures.

The fits and predictions are invented, so that every variant of a sentence and of a figure occurs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.inference.doubts.checks import Doubt
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.interval.budget import BudgetEntry, MeasureNext
from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_fitting.laws import LAWS
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.law_record import Stability
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.reporting import findings
from eimi_lab.reporting.error_at_a_glance import drawn_at_a_glance, error_at_a_glance
from eimi_lab.reporting.panels import (
    error_against_field,
    error_boxes,
    every_fit,
    law_stability,
    laws,
    magnified_residuals,
    parameter_correlation,
    residuals_along_beam,
    stress_strain,
    uncertainty_budget,
)
from eimi_lab.reporting.panels.convergence import drawn_convergence
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.reporting.stress import TensilePoints
from eimi_lab.showing.palette import LINES, MARKERS, PALETTE
from tests.lab.printed.described import described
from tests.lab.printed.test_whole_report import check

Shown = Callable[..., ShownFit]


def law(fit: FitRecord, name: str, factor: float) -> FitRecord:
    # Return a fit of another law, with parameters in proportion to `factor`.
    names = LAWS[name].parameter_names
    values = {key: factor * 7e3 / (1 + k) if "alpha" not in key else 1.5 + k for k, key in enumerate(names)}
    parameters = {key: Quantity(value, "Pa", (0.8 * value, 1.3 * value)) for key, value in values.items()}
    modulus = float(LAWS[name].initial_shear_modulus(np.array(list(values.values()))))
    draws = tuple(tuple(share * value for value in values.values()) for share in (0.9, 1.0, 1.05))
    return replace(
        fit,
        model=name,
        parameters=parameters,
        initial_shear_modulus=Quantity(modulus, "Pa", (0.9 * modulus, 1.2 * modulus), (0.95 * modulus, 1.1 * modulus)),
        draws=replace(fit.draws, names=names, values=draws),  # type: ignore[type-var]
    )


def variants(fit: FitRecord) -> Iterator[tuple[str, FitRecord]]:
    # Yield fits with their names. Each fit differs from the first one in a property that the report describes.
    (curve,), (dataset,) = fit.tensile, fit.datasets
    prior = Prior("mu", 52e3, 2e3)
    degrees = BudgetEntry("magnetisation", "direction of magnetisation", 3.0, "deg", (0,), 7.77)
    lengths = BudgetEntry("length", "length of the beam", 0.25, "mm", (0,), 1.234)
    exact = replace(fit, if_uncertain=(degrees, lengths))
    limited = replace(dataset.states, total=9)
    some = dataset.model_copy(update={"states": limited, "path": "other.h5"})
    yield "one", fit
    yield "two curves", replace(fit, tensile=(curve, curve))
    yield "no curve", replace(fit, tensile=())
    yield "one prior", replace(fit, priors=(prior,))
    yield "two priors", replace(fit, priors=(prior, prior))
    yield "two datasets", replace(fit, datasets=(dataset, some))
    yield (
        "one state",
        replace(fit, datasets=(dataset.model_copy(update={"states": replace(dataset.states, total=1)}),)),
    )
    yield "no field", replace(fit, by_state=tuple(s.model_copy(update={"field_mT": 0.0}) for s in fit.by_state))
    yield (
        "negative field",
        replace(fit, by_state=tuple(s.model_copy(update={"field_mT": -s.field_mT}) for s in fit.by_state)),
    )
    yield "no state", replace(fit, by_state=())
    yield "one source", replace(fit, budget=fit.budget[:1])
    yield "no source", replace(fit, budget=())
    yield "no next source", replace(fit, measure_next=MeasureNext(None, "", (47e3, 53e3)))
    yield "dimensions exact", replace(fit, taken_as_exact=("dimensions", "remanence_T"))
    yield "calibration exact", replace(fit, taken_as_exact=("calibration",))
    yield "both exact", replace(fit, taken_as_exact=("dimensions", "calibration"))
    yield "some exact", replace(fit, taken_as_exact=("remanence_T",))
    yield "all exact", replace(fit, budget=(), taken_as_exact=("dimensions",))
    yield "uncertain inputs", exact
    for limit in (0.9, 1.0, 1.01, 1.4999, 1.5, 2.345, None):
        yield (
            f"stable to {limit}",
            replace(
                fit, stability=Stability(criterion="Drucker", stable_up_to_stretch=limit, checked_up_to_stretch=3.0)
            ),
        )
    yield (
        "data beyond the largest checked stretch",
        replace(
            fit,
            max_stretch=3.5,
            stability=Stability(criterion="Drucker", stable_up_to_stretch=None, checked_up_to_stretch=3.0),
        ),
    )
    held = replace(fit.identifiability, held_by_bounds=("mu",), not_fixed=fit.identifiability.names[:1])
    yield "held", replace(fit, identifiability=held)
    yield "doubted", replace(fit, doubts=(Doubt("the clamp moved", 0), Doubt("the law is wrong", None)))


COMPARISONS = {
    "none": (),
    "too few data": (
        Choice("neo-hookean", 1, 5.04, None, 3.25, None, 0.01),
        Choice("yeoh", 3, 5.0, None, 0.0, None, 0.02),
    ),
    "one": (Choice("yeoh", 3, 55.0, 0.0, 0.0, None, 0.0045),),
    "clear": (
        Choice("neo-hookean", 1, 55.06, 2.0, 3.25, 0.02, 0.0123),
        Choice("yeoh", 3, 55.06, 0.0, 0.0, 0.98, 0.0045),
        Choice("ogden", 3, 55.06, 2.5, 0.0, 0.01, 0.0045),
    ),
    "near": (
        Choice("neo-hookean", 1, 55.0, 1.99, 3.25, 0.25, 0.0123),
        Choice("yeoh", 3, 55.0, 0.0, 0.0, 0.75, None),
        Choice("mooney-rivlin", 2, 55.0, 0.44, 0.5, 0.3, 0.2),
        Choice("ogden", 2, 55.0, None, 0.5, None, 0.2),
    ),
}


def test_the_sentences_about_a_fit_are_as_accepted(
    fit: FitRecord, tensile: TensileRecord, evidence: Evidence, shown: Shown, tmp_path: Path
) -> None:
    tensile = replace(tensile, initial_shear_modulus=Quantity(60e3, "Pa", (59e3, 62e3)))
    lines: list[str] = []
    usual: list[str] = []
    for name, one in variants(fit):
        words = [findings._how(one), findings._limit(one, "scatter"), *described(findings._next(one), "next")]
        words += [*described(findings._reach(one), "reach"), *law_stability._row("label", one), one.doubts_in_short()]
        lines += [f"{name}: {text}" for text in words if text not in usual]
        usual = usual or words
    for name, choices in COMPARISONS.items():
        lines += [f"{name}: {text}" for text in described(findings._law(shown(fit, choices)), "law")]
        lines += [f"{name}: {text}" for text in described(laws.table_of_choice(choices), "table")] if choices else []
    truth = ("yeoh", {"C10_Pa": 23456.0, "C20_Pa": -12.0, "alpha1": 1.5}, 41e3)
    for names in (["a.h5"], ["a.h5", "b.h5"]):
        lines += described(findings._truth(fit, names, truth), "truth")
    lines += described(findings._reach(replace(tensile, not_fixed=("mu",))), "tensile")
    (finding,) = findings.findings(SimpleNamespace(bending=[], tensile=[shown(tensile)]))  # type: ignore[arg-type]
    lines += [text for text in described(finding, "tensile finding") if "shown" not in text]
    lines = [line.replace(str(evidence.path), "beam.h5") for line in lines]
    check(lines, "words_of_fits.txt", tmp_path, 1e-9, 1e-12)


def styled(shown: ShownFit, place: int, origin: int = 0) -> ShownFit:
    kind = ("bending", "tensile 50 %", "bending and tensile")[origin]
    return replace(shown, index=place, origin=kind, colour=PALETTE[place], marker=MARKERS[place], line=LINES[origin])


FIELDS = (4.0, 0.5, -2.5, 1.25)


def prediction(of: ShownFit, factor: float, fields: tuple[float, ...] = FIELDS, points: bool = False) -> Any:
    # Return invented errors of a fit in four states, in which two edges bend with the field.
    count = len(fields)
    along = np.linspace(0.0, 20.0, 9)
    bend = 0.01 * np.array(fields)[:, None] * along**2
    edges = np.stack([np.stack([np.broadcast_to(along, bend.shape), bend + side], axis=-1) for side in (1.5, -1.5)], 1)
    noise = factor * np.random.default_rng(3).normal(0.0, 0.004, (count, 2, 13))
    noise[0, 0, 3] = np.nan
    places = np.linspace(1.0, 19.5, 13)
    shifts = 0.01 * np.array(fields)[:, None, None] * places**2 + np.array([1.5, -1.5])[None, :, None]
    measured = np.stack([np.broadcast_to(places, shifts.shape), shifts + np.nan_to_num(noise)], axis=-1)
    sigma = np.where(np.isnan(noise), math.inf, 0.004)
    observed: Any = EdgeObservation(measured, sigma)
    if points:
        observed = PointObservation(measured[0, 0], measured[:, 0], np.full((count, 13), 0.01))
    states = tuple(
        SimpleNamespace(index=2 + 3 * k, field_mT=field, tip_force_N=1e-3 * k if points else 0.0)
        for k, field in enumerate(fields)
    )
    return SimpleNamespace(
        fitted_law=of,
        evidence=SimpleNamespace(states=states, experiment=SimpleNamespace(observed=observed)),
        error_mm=factor * (0.005 + 0.004 * np.arange(count)),
        deviation_mm=factor * (0.006 - 0.001 * np.arange(count)),
        edges_mm=edges,
        residuals_mm=np.moveaxis(measured - measured.round(2), -1, 1)[:, :, 0] if points else noise,
    )


def dataset(name: str, predictions: list[Any], magnet: Any, pixels_per_mm: float | None = 8.0) -> Any:
    # Return a dataset with invented predictions, of a beam of 20 mm with or without a magnet.
    calibration = SimpleNamespace(pixels_per_mm=pixels_per_mm) if pixels_per_mm else None
    beam = SimpleNamespace(name=f"beam of {name} with a long name that has to be cut", length_mm=20.0, width_mm=3.0)
    return SimpleNamespace(
        name=name,
        predictions=predictions,
        simulated=predictions,
        best=predictions[0] if predictions else None,
        simulated_by=lambda one: next((p for p in predictions if p.fitted_law is one), None),
        evidence=predictions[0].evidence if predictions else None,
        dataset=SimpleNamespace(
            kind="frames",
            specimen=SimpleNamespace(specimen=beam, magnet=magnet),
            calibration=calibration,
            upright=lambda places: np.stack([places[..., 1], -places[..., 0]], axis=-1),
        ),
    )


MAGNET = SimpleNamespace(length_mm=4.0, tip_offset_mm=0.5)


@pytest.fixture
def laws_shown(fit: FitRecord, tensile: TensileRecord, shown: Shown) -> list[ShownFit]:
    # Four fits: three laws, one of them also with a tensile test, and one fitted to a tensile test alone.
    bare = replace(fit, tensile=(), max_stretch=1.1)
    joint = replace(law(fit, "yeoh", 1.3), max_stretch=1.2)
    return [
        styled(shown(bare), 0),
        styled(shown(law(bare, "mooney-rivlin", 1.1)), 1),
        styled(shown(joint), 2, 2),
        styled(shown(replace(tensile, max_stretch=1.45)), 3, 1),
    ]


def test_the_figures_of_several_fits_are_as_accepted(laws_shown: list[ShownFit], tmp_path: Path) -> None:
    one, two, joint, tension = laws_shown
    draw = {
        "errors, several": lambda: error_against_field.drawn_errors(
            [prediction(fit, factor) for fit, factor in zip(laws_shown, (1.0, 1.7, 2.5, 19.9), strict=True)]
        ),
        "errors, logarithmic": lambda: error_against_field.drawn_errors([prediction(one, 1.0), prediction(two, 20.1)]),
        "errors, one field": lambda: error_against_field.drawn_errors([prediction(one, 1.0, (2.0, 2.0))]),
        "errors, one state": lambda: error_against_field.drawn_errors([prediction(one, 1.0, (2.0,))]),
        "along the beam": lambda: residuals_along_beam.drawn_along_beam(dataset("a", [], MAGNET), prediction(one, 1.0)),
        "along the beam, no magnet": lambda: residuals_along_beam.drawn_along_beam(
            dataset("a", [], None), prediction(one, 2.0, (1.0, 1.0))
        ),
        "arrows": lambda: magnified_residuals.drawn_residuals(
            dataset("a", [prediction(one, 1.0)], MAGNET), prediction(one, 1.0)
        )[0],
        "arrows at points": lambda: magnified_residuals.drawn_residuals(
            dataset("a", [prediction(one, 1.0, points=True)], MAGNET), prediction(one, 1.0, points=True)
        )[0],
        "stress": lambda: stress_strain.drawn_stress(laws_shown, [], 0.1),
        "stress of two": lambda: stress_strain.drawn_stress(
            laws_shown,
            [
                TensilePoints("t.csv", np.array([0.1, 0.3]), np.array([9e3, 21e3])),
                TensilePoints("none.csv", np.zeros(0), np.zeros(0)),
            ],
            None,
            ["bending and tensile", "tensile 50 %"],
        ),
        "stress of one": lambda: stress_strain.drawn_stress([tension], [], 0.3),
        "budget": lambda: uncertainty_budget.drawn_budget([(fit, fit.fit) for fit in (one, two, joint)]),  # type: ignore[misc]
        "searches": lambda: drawn_convergence([one, two, tension]),
        "many searches": lambda: drawn_convergence([*[one] * 6, two]),
        "correlations": lambda: parameter_correlation.drawn_correlations(
            [(fit, correlated(fit, n)) for fit, n in ((one, 2), (two, 5), (joint, 3), (one, 4))]
        ),
    }
    lines = [line for name, drawn in draw.items() for line in described(drawn(), name)]
    check([" ".join(line.split()) for line in lines], "several_figures.txt", tmp_path, 2e-3, 1e-6)


def correlated(shown: ShownFit, number: int) -> FitRecord:
    # Return a fit with `number` unknowns, of which each two neighbours are correlated.
    assert isinstance(shown.fit, FitRecord)
    matrix = np.fromfunction(lambda i, j: np.where(i == j, 1.0, (-0.8) ** np.abs(i - j)), (number, number))
    names = tuple(f"input_{k}" for k in range(number))
    unknowns = replace(shown.fit.identifiability, names=names, correlation=tuple(map(tuple, matrix.tolist())))
    return replace(shown.fit, identifiability=unknowns)


@pytest.mark.parametrize("count", [1, 2, 4, 7])
def test_the_figures_of_several_datasets_are_as_accepted(
    laws_shown: list[ShownFit], tmp_path: Path, count: int
) -> None:
    one, two, *_ = laws_shown
    factors = (1.0, 2.0, 1.5, 3.0, 1.2, 0.8, 25.0)
    fields = (FIELDS, (1.0, 1.0, 1.0, 1.0), FIELDS[::-1])
    contents = [
        dataset(
            f"{k}.h5",
            [prediction(one, factors[k], fields[k % 3]), prediction(two, 1.1 * factors[k], fields[k % 3])],
            MAGNET,
            None if k == 3 else 8.0,
        )
        for k in range(count)
    ]
    contents[0].simulated_by = lambda law: contents[0].predictions[0] if law is one else None
    report: Any = SimpleNamespace(datasets=contents, fits=[one, two])
    lines = [*described(error_at_a_glance(report), "glance"), *described(error_boxes.PANEL.values(report), "boxes")]
    constant: Any = SimpleNamespace(datasets=contents[1:2] or contents, fits=[one])
    lines += described(error_at_a_glance(constant), "constant")
    check([" ".join(line.split()) for line in lines], f"figures_of_{count}_datasets.txt", tmp_path, 2e-3, 1e-6)


def test_a_dataset_in_a_constant_field_is_drawn_at_its_field(laws_shown: list[ShownFit]) -> None:
    fields = (FIELDS, (1.0, 1.0, 1.0, 1.0), (8.0,))
    leading = [
        (SimpleNamespace(name=f"{k}.h5"), prediction(laws_shown[0], 1.0, field)) for k, field in enumerate(fields)
    ]
    (axes,) = drawn_at_a_glance(leading).axes  # type: ignore[arg-type]
    assert [list(line.get_xdata()) for line in axes.lines] == [sorted(field) for field in fields]


def test_the_errors_of_many_datasets_stand_in_tables_of_four(
    fit: FitRecord, shown: Shown, validation: Callable[..., Any], tmp_path: Path
) -> None:
    one, two = styled(shown(fit), 0), styled(shown(fit), 1)

    def judged(mean_mm: float | None, **changes: Any) -> Any:
        interval = None if mean_mm is None else (0.5 * mean_mm, 2 * mean_mm)
        status = "no equilibrium" if mean_mm is None else "ok"
        return validation(fit, mean_error_mm=mean_mm, mean_error_interval_mm=interval, status=status, **changes)

    contents = [
        SimpleNamespace(name=f"{k}.h5", validations=(judged(0.01 * (k + 1)), judged(0.03, seen=False)))
        for k in range(5)
    ]
    contents[1].validations = (judged(None), judged(None))
    report: Any = SimpleNamespace(fits=[one, two], datasets=contents, tensile=[])
    check(list(described(every_fit.PANEL.values(report), "errors")), "errors_of_datasets.txt", tmp_path, 1e-9, 1e-12)
    assert every_fit.PANEL.values(SimpleNamespace(fits=[], datasets=contents)) is None  # type: ignore[arg-type]
    alone: Any = SimpleNamespace(fits=[one], datasets=contents[:1], tensile=[])
    assert every_fit.PANEL.values(SimpleNamespace(**{**vars(alone), "fits": [one, two], "tensile": [one]}))  # type: ignore[arg-type]
    assert every_fit.PANEL.values(alone) is None
