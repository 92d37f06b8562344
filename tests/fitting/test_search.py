"""The search finds known optima, and continues from recorded generations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.experiment import DISCARDED_MM
from eimi_fitting.inference.evidence.measurements import Misfit
from eimi_fitting.inference.searching.polish import polish
from eimi_fitting.inference.searching.search import Generation, Objectives, OtherSearch, search

Array = NDArray[np.float64]
OPTIMUM = np.array([0.3, 0.62, 0.45])


@dataclass(frozen=True)
class Values:
    objective_mm: Array

    @property
    def unconverged(self) -> NDArray[np.bool_]:
        return self.objective_mm >= DISCARDED_MM

    @property
    def unstable(self) -> NDArray[np.bool_]:
        return np.zeros(len(self.objective_mm), bool)


def valley(units: Array) -> Values:
    values = 10 * np.sqrt(((units - OPTIMUM[: units.shape[1]]) ** 2).sum(axis=1))
    return Values(np.where(units[:, 0] > 0.95, DISCARDED_MM, values))


def rastrigin(units: Array) -> Values:
    # Return Rastrigin's function, which has many local minima, at n points in d coordinates, shape (n, d).
    x = 10 * (units - OPTIMUM[: units.shape[1]])
    return Values((x**2 - 10 * np.cos(2 * np.pi * x) + 10).sum(axis=1))


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_run_ends_near_the_optimum_and_reports_why_it_stopped(n, seed):
    generations: list[tuple[Generation, Objectives]] = []
    result = search(valley, n, seed=seed, enough_mm=0.1, progress=lambda *generation: generations.append(generation))
    assert np.abs(result.unit - OPTIMUM[:n]).max() < 0.01
    (run,) = result.runs
    assert (run.stop, result.stop) == ("population", "population")
    assert [generation for generation, _ in generations] == list(result.history)
    assert run.generations == len(result.history)
    assert result.evaluations == run.generations * run.population
    assert result.objective_mm == run.best_mm == result.history[-1].best_mm
    assert result.discarded.unconverged == sum(generation.discarded for generation in result.history)
    assert all(
        later.best_mm <= earlier.best_mm for earlier, later in zip(result.history, result.history[1:], strict=False)
    )
    for generation, objectives in generations:
        assert generation.best_mm <= min(objectives.objective_mm)
        valid = [value for value in objectives.objective_mm if value < DISCARDED_MM]
        assert generation.mean_mm == pytest.approx(np.mean(valid))
        assert generation.axis_ratio >= 1


def test_discarded_candidates_are_counted_in_each_generation_and_left_out_of_its_mean():
    # First coordinate above 0.5: no equilibrium; above 0.6: unstable law.

    @dataclass(frozen=True)
    class Parted(Values):
        first: Array

        @property
        def unconverged(self) -> NDArray[np.bool_]:
            return (self.first > 0.5) & (self.first <= 0.6)

        @property
        def unstable(self) -> NDArray[np.bool_]:
            return self.first > 0.6

    def parted(units: Array) -> Values:
        first = units[:, 0]
        return Parted(np.where(first > 0.5, DISCARDED_MM, valley(units).objective_mm), first)

    seen: list[tuple[Generation, Objectives]] = []
    result = search(parted, 2, seed=1, enough_mm=0.1, progress=lambda *generation: seen.append(generation))
    assert result.discarded.unconverged == sum(values.unconverged for _, values in seen) > 0
    assert result.discarded.unstable == sum(values.unstable for _, values in seen) > 0
    for generation, values in seen:
        every = np.array(values.objective_mm)
        assert generation.discarded == (every == DISCARDED_MM).sum()
        if generation.discarded < len(every):
            assert generation.mean_mm == pytest.approx(every[every < DISCARDED_MM].mean())


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_beam_that_hardly_moved_is_searched_to_a_smaller_error(seed):
    result = search(lambda units: Values(1e-2 * np.abs(units[:, 0] - OPTIMUM[0])), 1, seed=seed, enough_mm=1e-4)
    assert result.unit == pytest.approx(OPTIMUM[:1], abs=0.03)
    assert len(result.history) > 3


@pytest.mark.parametrize("bipop", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_restarts_find_an_optimum_that_a_single_run_does_not_find(bipop):
    alone = [search(rastrigin, 2, seed=seed).objective_mm for seed in range(1, 4)]
    assert max(alone) > 0.5  # the nearest local minima are about 1 above the optimum
    for seed in range(1, 4):
        result = search(rastrigin, 2, seed=seed, restarts=4, bipop=bipop)
        assert result.objective_mm < 0.1
        assert result.unit == pytest.approx(OPTIMUM[:2], abs=0.01)


def test_large_populations_double_and_small_ones_get_similar_effort():
    grown = search(rastrigin, 2, seed=1, restarts=3)
    assert [run.population for run in grown.runs] == [12, 24, 48, 96]
    assert {run.step_size for run in grown.runs} == {0.25}
    assert [generation.run for generation in grown.history] == [
        number for number, run in enumerate(grown.runs, start=1) for _ in range(run.generations)
    ]
    mixed = search(rastrigin, 2, seed=1, restarts=3, bipop=True)
    large = [run for run in mixed.runs[1:] if run.step_size == 0.25]
    small = [run for run in mixed.runs[1:] if run.step_size != 0.25]
    assert [run.population for run in large] == [24, 48, 96]
    assert small
    for run in small:
        assert 12 <= run.population <= 48
        assert 0.0025 <= run.step_size < 0.25
    cost = [sum(run.population * run.generations for run in runs) for runs in (large, small)]
    assert cost[1] < 1.5 * cost[0]


def test_a_replayed_search_continues_identically_and_evaluates_only_new_candidates():
    record: list[Objectives] = []
    whole = search(rastrigin, 3, seed=4, restarts=2, bipop=True, progress=lambda _, values: record.append(values))
    for count in (0, 1, len(record) // 2, len(record) - 1, len(record)):
        evaluated = []

        def counted(units: Array, evaluated: list[int] = evaluated) -> Values:
            evaluated.append(len(units))
            return rastrigin(units)

        np.random.seed(count)  # noqa: NPY002  the global generator decides nothing
        again = search(counted, 3, seed=4, restarts=2, bipop=True, replay=record[:count])
        assert again.unit.tolist() == whole.unit.tolist()
        assert (again.history, again.runs) == (whole.history, whole.runs)
        assert len(evaluated) == len(record) - count


def test_the_record_of_another_search_is_refused():
    with pytest.raises(OtherSearch, match="generation 1 has 12 candidates, but the stored generation has 3"):
        search(rastrigin, 2, replay=[Objectives((1.0, 2.0, 3.0), 0, 0)])


@dataclass(frozen=True)
class Line:
    # A replacement for the evaluation of P candidates (sets of parameters), with the residuals of a linear model.
    # residuals : shape (P, n) for n points of one load step

    residuals: Array

    @property
    def objective_mm(self) -> Array:
        return np.sqrt((self.residuals**2).mean(axis=1))

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        r = self.residuals[:, None, None, :]
        return (Misfit(r, np.ones(r.shape[1:]), self.objective_mm[:, None], np.zeros((len(r), 1))),)


def linear(slopes: Array, target: Array) -> Callable[[Array, Line | None], Line]:
    return lambda units, _: Line(units @ slopes - target)


def test_the_polish_ends_at_the_best_point_within_the_bounds():
    slopes = np.array([[1.0, 0.5, 0.2, 0.1], [0.9, 0.7, -0.1, 0.3]])
    # Without bounds the second coordinate would be 1.4; at its bound the first coordinate has another optimum.
    model = linear(slopes, np.array([0.2, 1.4]) @ slopes)
    first = (np.array([0.0, 0.4]) @ slopes @ slopes[0]) / (slopes[0] @ slopes[0]) + 0.2
    polished = polish(model, np.array([0.5, 0.5]))
    assert polished.unit == pytest.approx([first, 1.0], abs=5e-5)
    assert polished.polish.mean_error_after_mm < polished.polish.mean_error_before_mm


@pytest.mark.parametrize("start", [0.1, 0.5])
def test_the_polish_follows_a_direction_that_the_data_hardly_determine(start: float):
    # Like the modulus and a higher coefficient of a law: they change the edges by 40 mm and 1 µm, with 0.4 µm of noise.
    slopes = np.array([[40.0, 0.0, 0.0], [0.0, 1e-3, 0.0]])
    model = linear(slopes, np.array([0.3, 0.9]) @ slopes + np.array([0.0, 0.0, 4e-4]))
    assert polish(model, np.array([0.3, start])).unit == pytest.approx([0.3, 0.9], abs=0.01)
