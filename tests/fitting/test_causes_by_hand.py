"""Probabilities of single causes of residuals, from those of combinations of causes, agree with sums by hand."""

from __future__ import annotations

from statistics import NormalDist
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.inference.doubts import causes
from eimi_fitting.inference.doubts.causes import weighed_causes
from eimi_fitting.inference.doubts.deviating_inputs import Deviation, deviations
from eimi_fitting.inference.doubts.marginal_likelihood import Posterior
from eimi_fitting.inference.doubts.possible_causes import of_source

SHIFT = of_source("shift", "clamp", (0.3, 0.3), "a picture")
WIDTH = of_source("width", "width", (0.05,), "a caliper")
SETS = [(), (0,), (1,), (0, 1)]
# Effect on the modulus: 0.2 for 1 mm of shift in x, 0.1 for 1 mm of shift in y, -0.5 for 1 mm of width.
BY_UNIT = np.array([0.0, 0.2, 0.1, -0.5])
# One row for each set: change of the modulus, shift in x, shift in y, width.
MEANS = np.array([[0.01, 0.0, 0.0, 0.0], [0.02, 0.3, -0.4, 0.0], [-0.03, 0.0, 0.0, 0.08], [0.05, 0.1, 0.2, 0.02]])


class Weighing:
    # A replacement for the comparison of sets of two bench errors, a shift and a width.

    def __init__(self, probability: list[float], uncertain: bool, stated: float, start: float) -> None:
        self.probability, self.stated, self.start = np.array(probability), stated, start
        self.hypotheses = SETS * (2 if uncertain else 1)
        self.is_uncertain = np.repeat([False, True], 4)[: len(self.hypotheses)]
        self.log_prior = np.zeros(len(self.hypotheses))
        self.blocks = [[1, 2], [3]]

    def evidence_of_sets(self) -> Posterior:
        means = np.tile(MEANS, (len(self.hypotheses) // 4, 1))
        means[4:] *= 2
        return Posterior(np.log(self.probability), means, means**2, 0 * self.probability)

    def classes(self, posterior: Posterior) -> list[tuple[int, ...]]:
        return [(0,), (1,)]

    def alone(self, best: int) -> slice:
        return slice(4, 7) if self.is_uncertain[best] else slice(0, 3)

    def shown(self, cause: int) -> int:
        return 2 - cause

    def moved_by_unit(self) -> np.ndarray:
        return BY_UNIT

    def starts(self, cause: int) -> np.ndarray:
        return np.zeros(1) if cause else np.array([self.start, 0.0])

    def stated_size(self, cause: int) -> float:
        return self.stated

    def remaining_mm(self, amplitudes: np.ndarray) -> Any:
        return ("left by", amplitudes.tolist())

    def remaining(self, row: int, amplitudes: np.ndarray) -> Any:
        return ("residuals of", row)


def weighed(
    monkeypatch: pytest.MonkeyPatch,
    probability: list[float],
    *,
    within: Any = None,
    stated: float = 0.0,
    start: float = 0.0,
    freed: tuple[str, ...] = (),
) -> Any:
    columns = {SHIFT: [SimpleNamespace(start=start)], WIDTH: [SimpleNamespace(start=0.0)]}
    monkeypatch.setattr(
        causes.LinearisedFit, "of", lambda problem, optimum, possible: SimpleNamespace(solved=("beam",))
    )
    monkeypatch.setattr(causes, "columns_of", lambda fit, cause: columns[cause])
    monkeypatch.setattr(causes, "stated_columns", lambda fit, possible: {})
    monkeypatch.setattr(causes, "Weighing", lambda *given: Weighing(probability, len(probability) > 4, stated, start))
    monkeypatch.setattr(causes, "deviations", lambda *given: within or {})
    unknowns = SimpleNamespace(
        freed=[SimpleNamespace(source=source) for source in freed], modulus_percent=lambda moved: 100 * moved
    )
    return weighed_causes(SimpleNamespace(unknowns=unknowns), None, (), (SHIFT, WIDTH))  # type: ignore[arg-type]


def test_the_probability_of_a_cause_is_the_sum_over_its_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    found = weighed(monkeypatch, [0.1, 0.5, 0.15, 0.25])
    shift, width, none = found.causes
    assert [cause.name for cause in found.causes] == ["shift", "width", "none"]
    assert [cause.probability for cause in found.causes] == pytest.approx([0.75, 0.4, 0.1])
    # The sizes are averages over the sets, (0.5 x + 0.25 x') / 0.75; the largest component has the sign.
    mean = (0.5 * MEANS[1, 1:3] + 0.25 * MEANS[3, 1:3]) / 0.75
    assert shift.value == pytest.approx(np.linalg.norm(mean))
    assert width.value == pytest.approx((0.15 * 0.08 + 0.25 * 0.02) / 0.4)
    assert (shift.unit, width.unit, shift.decide_by, none.unit) == ("mm", "mm", "a picture", "")
    # Of the change in the set of both, 0.05, the less probable cause makes -0.5 × 0.02 = -0.01.
    shifts = [100 * (0.5 * 0.02 + 0.25 * (0.05 + 0.01)) / 0.75, 100 * (0.15 * -0.03 + 0.25 * -0.01) / 0.4, 0.0]
    assert [cause.shift_percent for cause in found.causes] == pytest.approx(shifts)
    assert (shift.like, width.like, shift.is_within_stated) == ((), (), False)
    assert found.modulus_percent == pytest.approx((-3.0, 5.0))
    assert found.most_probable == frozenset({"shift"})
    assert (found.in_the_fit, found.beside_the_fit) == (frozenset(), pytest.approx(0.9))
    assert found.as_stated == pytest.approx(0.1)
    assert found.remaining == ("residuals of", 1)
    assert found.error_mm == {"shift": ("left by", MEANS[1].tolist()), "width": ("left by", MEANS[2].tolist())}


@pytest.mark.parametrize(("probability", "is_listed"), [(0.0009, False), (0.0011, True)])
def test_a_cause_is_listed_from_a_thousandth_on(
    monkeypatch: pytest.MonkeyPatch, probability: float, is_listed: bool
) -> None:
    found = weighed(monkeypatch, [0.4, 0.6 - probability, 0.5 * probability, 0.5 * probability])
    assert ("width" in [cause.name for cause in found.causes]) is is_listed
    assert "width" in found.error_mm


def test_a_negative_component_that_is_the_largest_gives_the_sign(monkeypatch: pytest.MonkeyPatch) -> None:
    shift = weighed(monkeypatch, [0.1, 0.7, 0.15, 0.05]).causes[0]
    mean = (0.7 * MEANS[1, 1:3] + 0.05 * MEANS[3, 1:3]) / 0.75
    assert shift.value == pytest.approx(-np.linalg.norm(mean))


@pytest.mark.parametrize(("stated", "is_within"), [(0.027, False), (0.029, True)])
def test_a_size_is_within_twice_its_stated_uncertainty(
    monkeypatch: pytest.MonkeyPatch, stated: float, is_within: bool
) -> None:
    width = weighed(monkeypatch, [0.1, 0.1, 0.5, 0.3], stated=stated).causes[0]
    assert width.name == "width"
    assert width.value == pytest.approx(0.0575)
    assert width.is_within_stated is is_within


@pytest.mark.parametrize(("start", "freed"), [(0.2, ()), (0.0, ("clamp",))])
def test_a_cause_in_the_fit_moves_the_modulus_from_that_without_the_cause(
    monkeypatch: pytest.MonkeyPatch, start: float, freed: tuple[str, ...]
) -> None:
    found = weighed(monkeypatch, [0.1, 0.6, 0.2, 0.1], start=start, freed=freed)
    assert found.in_the_fit == frozenset({"shift"})
    # The fit contains the change 0.2 × 0.2 by the measured shift. The less probable width makes -0.5 × 0.02.
    measured = 0.2 * start
    assert found.causes[0].shift_percent == pytest.approx(100 * (measured + (0.6 * 0.02 + 0.1 * 0.06) / 0.7))
    assert found.causes[1].shift_percent == pytest.approx(100 * (0.2 * (measured - 0.03) + 0.1 * -0.01) / 0.3)
    assert found.beside_the_fit == pytest.approx(0.3)
    assert found.remaining is None  # the most probable set is in the fit


def test_an_input_may_deviate_within_its_stated_uncertainty(monkeypatch: pytest.MonkeyPatch) -> None:
    within = {0: Deviation(0, 0.1, 0.5, 0.3, (1,)), 1: Deviation(1, 0.8, 0.04, -0.02, (0,))}
    exact, uncertain = [0.02, 0.03, 0.02, 0.01], [0.7, 0.1, 0.07, 0.05]
    found = weighed(monkeypatch, [*exact, *uncertain], within=within)
    width, shift, none = found.causes
    assert [width.name, shift.name, none.name] == ["width", "shift", "none"]
    assert width.probability == pytest.approx(0.02 + 0.01 + 0.07 + 0.05 + 0.8 * (0.7 + 0.1))
    assert (width.value, width.shift_percent, width.like) == (0.04, pytest.approx(-2.0), ("shift",))
    assert none.probability == pytest.approx(0.02 + (1 - 0.8 - 0.1) * 0.7)
    assert shift.probability == pytest.approx(0.03 + 0.01 + 0.1 + 0.05 + 0.1 * 0.77)
    # With uncertain inputs, all sizes are twice as large.
    shifts = 0.03 * 0.02 + 0.01 * 0.06 + 0.1 * 0.04 + 0.05 * 0.12
    assert shift.shift_percent == pytest.approx(100 * shifts / 0.19)
    assert found.as_stated == pytest.approx(0.72)
    assert found.remaining == ("residuals of", 4)
    # Without a smaller probability of the deviation than that of the sets with this cause.
    unlikely = weighed(monkeypatch, [*exact, 0.5, 0.1, 0.2, 0.12], within={1: Deviation(1, 0.3, 0.04, -0.02, ())})
    width = next(cause for cause in unlikely.causes if cause.name == "width")
    assert width.probability == pytest.approx(0.35 + 0.3 * 0.6)
    assert width.like == ()
    # The shift is less probable now, and makes 0.04 and 0.08 of the change in the two sets of both.
    shifts = 0.02 * -0.03 + 0.01 * (0.05 - 0.04) + 0.2 * -0.06 + 0.12 * (0.10 - 0.08)
    assert width.shift_percent == pytest.approx(100 * shifts / 0.35)


def test_without_an_equilibrium_or_an_effect_no_cause_is_weighed(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing: Any = SimpleNamespace(unknowns=SimpleNamespace(freed=()))
    assert weighed_causes(nothing, None, (), ()).causes == ()  # type: ignore[arg-type]
    monkeypatch.setattr(causes.LinearisedFit, "of", lambda problem, optimum, possible: SimpleNamespace(solved=()))
    monkeypatch.setattr(causes, "columns_of", lambda fit, cause: ())
    assert weighed_causes(nothing, None, (), (SHIFT,)).causes == ()  # type: ignore[arg-type]
    monkeypatch.setattr(causes.LinearisedFit, "of", lambda problem, optimum, possible: SimpleNamespace(solved=(1,)))
    assert weighed_causes(nothing, None, (), (SHIFT,)).causes == ()  # type: ignore[arg-type]


class Inputs:
    # A replacement for the comparison of sets, in which the residuals show that an input differs.

    blocks = ([1, 2], [3])
    has_several_inputs = False
    hypotheses = ((), (1,))

    def __init__(self, squares: float, start: float = 0.0) -> None:
        self.squares, self.start = squares, start

    def starts(self, cause: int) -> np.ndarray:
        return np.array([self.start])

    def moved_by_unit(self) -> np.ndarray:
        return np.array([0.0, 0.2, 0.1, -1.0])

    def rows_of_inputs(self, cause: int) -> list[int]:
        return [5] if cause == 1 else []

    def squares_of(self, base: int, posterior: Posterior, rows: list[int]) -> float:
        assert rows == [5]
        return self.squares

    def shown(self, cause: int) -> int:
        return 2 - cause

    def scale(self, rows: Any) -> np.ndarray:
        return np.array([1.0, 0.5, 0.2, 0.1])[list(rows)]

    def as_cause(self, rows: list[int], amounts: np.ndarray, cause: int) -> np.ndarray:
        assert (rows, amounts.tolist(), cause) == ([5], [0.7], 1)
        return np.array([-0.04])

    def if_exact(self, base: int, rows: list[int]) -> Any:
        means = np.array([[0.01, 0.0, 0.0, 0.0], [0.03, 0.1, -0.12, 0.0], [-0.02, 0.0, 0.0, -0.05]])
        squares = (means / [1.0, 0.5, 0.2, 0.1]) ** 2 + 0.04
        exact = Posterior(np.zeros(3), means, squares, np.zeros(3))
        return SimpleNamespace(causes=[0, 1], probability=np.array([0.1, 0.3, 0.6]), posterior=exact, classes=[(0, 1)])


@pytest.mark.parametrize(("squares", "is_seen"), [(4.39, False), (4.4, True)])  # 2 ln 9 = 4.394
def test_an_input_deviates_if_the_residuals_favour_it_by_nine_to_one(squares: float, is_seen: bool) -> None:
    means = np.zeros((2, 6))
    means[0, 5] = 0.7
    posterior = Posterior(np.zeros(2), means, means, np.zeros(2))
    found = deviations(Inputs(squares), posterior, 0)  # type: ignore[arg-type]
    assert sorted(found) == ([0, 1] if is_seen else [])
    assert deviations(Inputs(squares), posterior, 1) == {}  # type: ignore[arg-type]
    if is_seen:
        # The shift has 0.6 prior sizes, and the width 0.4; up to 0.3 is negligible. The standard deviation is 0.2.
        beyond = [NormalDist().cdf((size - 0.3) / 0.2) + NormalDist().cdf((-size - 0.3) / 0.2) for size in (0.6, 0.4)]
        shift, width = found[0], found[1]
        assert (shift.probability, width.probability) == pytest.approx((0.3 * beyond[0], 0.6 * beyond[1]))
        assert (shift.value, width.value) == pytest.approx((-np.hypot(0.1, 0.12), -0.04))
        # Without a measured error, the change counts from the fit. The width is -0.04 instead of -0.05.
        assert (shift.moved, width.moved) == pytest.approx((0.03, -0.02 - 1.0 * 0.01))
        measured = deviations(Inputs(squares, 0.1), posterior, 0)  # type: ignore[arg-type]
        assert (measured[0].moved, measured[1].moved) == pytest.approx((0.02, -0.04))
        assert (shift.cause, shift.like, width.cause, width.like) == (0, (1,), 1, (0,))
