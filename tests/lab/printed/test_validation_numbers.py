"""The errors of a fit are printed in µm and kPa with their intervals."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.inference.evidence import corrections
from eimi_fitting.inference.evidence.corrections import Correction, correction
from eimi_fitting.inference.interval.draws import Draws
from eimi_fitting.laws import LAWS
from eimi_lab.face.results import Validations
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.prediction import predict, validate
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.simulated_fit import FittedLaw
from eimi_lab.fits.validation import FitReference, Validation
from eimi_lab.fits.validation_tables import by_dataset, by_state, matrix


def test_tables_of_validations_are_in_micrometres_and_kilopascal(
    fit: FitRecord, validation: Callable[..., Validation]
) -> None:
    other = FitReference(path="fits.json", index=1, kind="bending", window_percent=None)
    worse = validation(fit, fit=other, seen=False, mean_error_mm=0.05, within_fitted_stretch=False, stable=False)
    open_end = validation(fit, dataset="other.h5", mean_error_interval_mm=(0.015, None))
    lines = by_dataset([worse, validation(fit)])
    best, last = lines[2], lines[3]
    expected = "fits.json:0 bending neo-hookean 50.00 [40.00, 65.00] 20.0 [15.0, 30.0] 4.00 1.200 seen"
    assert " ".join(best.split()) == expected
    assert last.endswith("unseen, not stable over these stretches, stretches beyond the data of the fit")
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


def comparisons(*validations: Validation) -> Validations:
    given: Any = tuple(SimpleNamespace(validation=one) for one in validations)
    return Validations(given)


def test_comparisons_with_fits_of_several_files_keep_all_fits(
    fit: FitRecord, validation: Callable[..., Validation]
) -> None:
    pytest.importorskip("pandas")
    first, other = validation(fit), FitReference(path="b.json", index=0, kind="bending", window_percent=None)
    table = comparisons(first, validation(fit, dataset="other.h5")).to_pandas()
    assert list(table.index.unique("fit")) == ["0 neo-hookean"]
    both = comparisons(first, validation(fit, fit=other, mean_error_mm=0.05))
    table = both.to_pandas()
    assert list(table.index.unique("fit")) == ["fits.json:0 neo-hookean", "b.json:0 neo-hookean"]
    assert len(table) == 2 * len(first.by_state)
    assert len(both.plot().axes[0].lines) == 2


def test_comparisons_with_a_fit_without_an_equilibrium_are_a_table(
    fit: FitRecord, validation: Callable[..., Validation]
) -> None:
    pytest.importorskip("pandas")
    lost = validation(fit, dataset="lost.h5", status="no equilibrium", by_state=())
    assert lost.to_pandas().empty
    table = comparisons(validation(fit), lost).to_pandas()
    assert list(table.index.unique("dataset")) == ["beam.h5"]


def test_the_drawn_outline_is_that_of_the_finer_mesh(
    fitted: FitRecord, evidence: Evidence, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The search for the parameters uses the coarser mesh.
    made = list[Correction | None]()

    def kept(*arguments: Any) -> Correction | None:
        made.append(correction(*arguments))
        return made[-1]

    monkeypatch.setattr(corrections, "correction", kept)
    (predicted,) = predict([(FittedLaw(Path("fits.json"), 0, fitted), evidence)])
    (better,) = made
    assert better is not None
    finer = better.models[0]
    expected = points_on(outline(finer, better.better.shapes[0])[0], 6)
    assert predicted.edges_mm == pytest.approx(expected)
    coarse = outline(evidence.experiment.model, BeamModel.solve(*_at_rest(evidence)))
    assert predicted.edges_mm.shape[2] > points_on(coarse[0], 6).shape[2]


def _at_rest(evidence: Evidence) -> tuple[Any, ...]:
    experiment = evidence.experiment
    return experiment.model, LAWS["neo-hookean"], np.array([[50e3]]), experiment.loads


def test_an_error_has_no_upper_end_if_a_draw_has_no_equilibrium(fitted: FitRecord, evidence: Evidence) -> None:
    sound = tuple((x,) for x in np.linspace(49e3, 51e3, 15).tolist())
    for draws, has_end in ((sound, True), ((*sound, (-5e3,)), False)):
        with_draws = replace(fitted, draws=Draws(1, ("mu",), draws))
        interval = validate(evidence, with_draws, Path("fits.json"), 0).mean_error_interval_mm
        assert interval is not None
        assert (interval[1] is not None) == has_end
