"""The solvers of beam models and laws need a known number of starts, iterations and grid points."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy

from eimi_fitting import LAWS, BeamModel, Loads, Magnet, Specimen
from eimi_fitting.beam import modal_motion, path, vibration
from eimi_fitting.beam.equilibrium import Configuration, Solid, Status
from eimi_fitting.beam.rest_shape import RestShape, centre_line
from eimi_fitting.beam.strip import Strip
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.laws import engineering_stress, fit_tensile, ogden, stability, stable_cells, tensile
from examples.arruda_boyce import ArrudaBoyce

BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 5.0, 1.2, 7500.0))
YEOH = LAWS["yeoh"]
OF_YEOH = np.array([[22e3, 2e3, 100.0]])


def sizes_of_cells(monkeypatch: pytest.MonkeyPatch, open_cells: slice) -> list[int]:
    # Return how many cells a proof of stability examines in each pass if it fails in the given cells.
    sizes: list[int] = []

    def bound(weight: np.ndarray, *ends: np.ndarray) -> np.ndarray:
        sizes.append(len(weight))
        values = np.ones(len(weight))
        values[open_cells] = -1.0
        return values

    monkeypatch.setattr(stable_cells, "_lower_bound", bound)
    limit = stable_cells.proved_stable(np.ones((1, 3)), np.ones((1, 3)), np.array([1.0]))
    assert limit.tolist() == [0.0]
    return sizes[::3]


def test_a_proof_begins_with_8_x_12_cells_and_ends_beyond_100_000_open_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    assert sizes_of_cells(monkeypatch, slice(None)) == [96 * 4**k for k in range(7)]


def test_a_proof_divides_a_cell_at_most_16_times(monkeypatch: pytest.MonkeyPatch) -> None:
    assert sizes_of_cells(monkeypatch, slice(1)) == [96, *[4] * 15]


def test_a_scan_examines_48_levels_of_61_deformations_and_halves_30_times(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[np.ndarray, tuple[int, ...]]] = []
    principal = type(YEOH).principal

    def recorded(self: Any, parameters: np.ndarray, stretches: np.ndarray) -> Any:
        calls.append((np.log(stretches[0, -1]), stretches.shape))
        return principal(self, parameters, stretches)

    monkeypatch.setattr(type(YEOH), "principal", recorded)
    limit = stability.scanned_limit(YEOH, np.array([[1e4, -2e3, 0.0]]), np.array([np.exp(0.48)]))
    assert limit == pytest.approx([1.32184], abs=1e-4)
    assert len(calls) == 48 + 30
    assert {shape for _, shape in calls} == {(1, 61, 3)}
    levels = np.array([logarithms[0] for logarithms, _ in calls])
    assert levels[:48] == pytest.approx(0.01 * np.arange(1, 49))
    assert levels[48] == pytest.approx(0.275)
    assert calls[0][0] == pytest.approx(0.01 * np.array([1.0, 1.0, -2.0]))


@pytest.mark.parametrize(("law", "module", "fits"), [(LAWS["ogden"], ogden, 8), (ArrudaBoyce(), tensile, 2)])
def test_a_tensile_fit_starts_twice_for_each_unknown(
    law: Any, module: Any, fits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    starts: list[np.ndarray] = []
    search = scipy.optimize.least_squares

    def counted(function: Any, start: np.ndarray, **given: Any) -> Any:
        low, high = given["bounds"]
        starts.append((start - low) / (high - low))
        assert given["x_scale"] == pytest.approx(high - low)
        assert given["max_nfev"] == 100
        return search(function, start, **{**given, "max_nfev": 2})

    monkeypatch.setattr(scipy.optimize, "least_squares", counted)
    strain = np.linspace(0.1, 1.5, 12)
    fit_tensile(law, strain, engineering_stress(YEOH, OF_YEOH[0], strain))
    assert len(starts) == fits
    assert sorted({round(float(value), 9) for start in starts for value in start}) == [0.25, 0.75]
    assert len({tuple(start) for start in starts}) == fits


def test_modes_are_found_among_eight_shapes_in_at_most_forty_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    shapes: list[tuple[int, ...]] = []
    found = vibration._symmetric_modes

    def restless(stiffness: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        shapes.append(stiffness.shape)
        values, vectors = found(stiffness, mass)
        return values * (1 + 1e-3 * (-1) ** len(shapes)), vectors

    monkeypatch.setattr(vibration, "_symmetric_modes", restless)
    Vibration(BeamModel(BEAM, 2, 1)).about(YEOH, OF_YEOH, Loads.along([1.0]))
    assert shapes == [(1, 8, 8)] * 40


@pytest.mark.parametrize(("change", "passes"), [(0.9e-9, 2), (1.2e-9, 3)])
def test_modes_are_found_when_their_rates_change_by_less_than_a_billionth(
    change: float, passes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = [0]

    def known(stiffness: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        calls[0] += 1
        values = np.arange(1.0, 9.0)
        values[2] *= 1 + change * (calls[0] == 1)
        return values[None], np.eye(8)[None]

    monkeypatch.setattr(vibration, "_symmetric_modes", known)
    Vibration(BeamModel(BEAM, 2, 1)).about(YEOH, OF_YEOH, Loads.along([1.0]))
    assert calls[0] == passes


def test_a_complex_rate_is_sought_in_at_most_a_hundred_steps() -> None:
    calls = [0]

    def swinging(stiffening: np.ndarray) -> np.ndarray:
        calls[0] += 1
        return np.full((1, 1), 1.0 + 0.5 * np.sin(3.0 * calls[0]) + 0j)

    found = modal_motion.fixed_point(swinging, lambda s: s, (1, 1))
    assert np.isnan(found).all()
    assert calls[0] == 1 + 2 * 100


def test_centre_lines_have_the_stated_numbers_of_stations() -> None:
    strip = Strip(replace(BEAM, rest_shape=RestShape(turns=((0.0, 0.0), (0.5, 0.1), (1.0, 0.1)))))
    assert len(strip._centre.x) == 513
    points = np.column_stack([np.linspace(0, 30, 40), np.zeros(40)])
    numbers = [len(centre_line(points[::step], 30.0)) for step in (13, 3, 1)]
    assert numbers == [17, 28, 80]


def test_strains_are_computed_for_at_most_4096_elements_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    model, batches = BeamModel(replace(BEAM, magnet=None), 50, 20), []
    kind, found = model.solid.kind, model.solid.kind.stretch

    def counted(ops: Any, nodal: np.ndarray) -> np.ndarray:
        batches.append(nodal.shape[1])
        return np.asarray(found(ops, nodal))

    monkeypatch.setattr(kind, "stretch", counted)
    model.solid.stretch(np.zeros((9, *model.mesh.nodes.shape)))
    assert batches == [4, 4, 1]


@pytest.mark.parametrize(("along", "states", "parts"), [(100, 14, [14]), (100, 15, [8, 7]), (1401, 2, [1, 1])])
def test_states_are_solved_together_with_at_most_1400_elements(
    along: int, states: int, parts: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    model, batches = BeamModel(replace(BEAM, magnet=None), along, 1), []

    def solved(self: Solid, batch: Any, loads: Any, start: Configuration, *given: Any, **more: Any) -> Any:
        batches.append(len(start.rigid))
        ones = np.ones(len(start.rigid), np.intp)
        return start, np.full(len(ones), Status.CONVERGED, np.int8), ones

    monkeypatch.setattr(Solid, "equilibrium", solved)
    chosen = path.candidates(YEOH, OF_YEOH, "plane-stress", None, None)
    loads = Loads.along(np.zeros(states))
    assert path.at_once(model.solid, model.loaded, chosen, loads, 1e-3, model.solid.rest(states)) is not None
    assert batches == parts
