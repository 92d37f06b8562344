"""The probabilities of the causes of residuals agree with calculations by hand."""

# The law has two parameters, and there are one uncertain input, one correction and three causes. Each residual is one
# number.

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.stats

from eimi_fitting.inference.doubts import causes, deviating_inputs
from eimi_fitting.inference.doubts.marginal_likelihood import Posterior
from eimi_fitting.inference.doubts.signatures import Column
from eimi_fitting.inference.doubts.weighing import Weighing

SCALE = np.array([0.1, 0.2, 0.05, 0.5, 0.3, 0.3, 0.01, 2.0, 1.0])
"""The prior sizes: law (2), input, correction, first cause (2 numbers), second and third cause, and no effect."""


class Simulated:
    # Replaces the simulations: residuals are linear in the sizes of their causes and in two parameters of the law.

    def __init__(self) -> None:
        self.unit, self.kept = np.array([0.5, 0.4]), np.array([0, 1])
        self.asked: list[tuple[np.ndarray, dict[str, list[float]]]] = []
        self.fails = False

    def simulated(self, moved: np.ndarray, given: Any) -> list[np.ndarray] | None:
        sizes = {cause.name: [amplitude for _, amplitude in columns] for cause, columns in given.items()}
        self.asked.append((moved, sizes))
        if self.fails:
            return None
        total = 3.0 * moved[0] - 2.0 * moved[1] + sum(10.0 * sum(some) for some in sizes.values())
        return [np.array([1.0, -1.0]) * (1.0 + total)]


class Named(SimpleNamespace):
    # A replacement for the class `PossibleCause`. Like the class, it can be a key of a dictionary.

    __hash__ = object.__hash__  # type: ignore[assignment]


def cause(name: str, source: str = "", shown: int | None = None) -> Any:
    return Named(name=name, source=source, shown=shown, stated_as=(source,) if source else ())


def column(part: int, size: float, start: float = 0.0) -> Column:
    return Column(part, (0,), size, start, (np.array([[[10.0, -10.0]]]),))


@pytest.fixture
def weighing() -> Any:
    one: Any = Weighing.__new__(Weighing)
    one._about = Simulated()
    one._causes = (cause("first", shown=1), cause("second", "scale"), cause("third"))
    one._inputs = (cause("width", "scale"),)
    of_input, columns = column(0, 0.05), [column(0, 0.3), column(1, 0.3), column(0, 0.01, 0.02), column(0, 2.0)]
    one._columns = [of_input, *columns]
    one._scale, one._law, one._simulated_common, one._common = SCALE, 2, 3, 4
    one._rows = SCALE[:, None] * np.array([[1.0, 2.0]] * 9) * np.arange(1.0, 10.0)[:, None]
    one._rows[-1] = 0.0
    one.blocks = [[4, 5], [6], [7]]
    by_row = {2: of_input, 4: columns[0], 5: columns[1], 6: columns[2], 7: columns[3]}
    one._coefficients = SimpleNamespace(
        of_inputs=[[2]], column=by_row.__getitem__, remaining=np.array([[0.4, 0.0]]), common=4
    )
    noise = np.array([0.5, 2.0])
    one._project = SimpleNamespace(
        noise=noise, error=np.array([1.0, 3.0]), of=lambda residuals: np.asarray(residuals[0]),
        smooth=lambda moves: (np.asarray(moves) ** 2).sum() * np.array([0.1, 0.2]),
    )  # fmt: skip
    one._variance = noise + 0.25
    one._members = [np.zeros((7, 3), int)]
    one.hypotheses = [(), (0,), (1,), (2,), (0, 1), (0, 2), (1, 2)]
    one.is_uncertain = np.zeros(7, bool)
    one._measured = {1}
    one.log_prior = -np.log(2.0) * np.array([len(h) for h in one.hypotheses])
    one._y = np.zeros((7, 2))
    return one


def posterior(log_evidence: list[float], means: np.ndarray | None = None) -> Posterior:
    count = len(log_evidence)
    sizes = np.zeros((count, 9)) if means is None else means
    return Posterior(np.array(log_evidence), sizes, sizes**2, np.full(count, 0.5))


def test_the_model_error_has_a_hundredth_of_each_change_and_what_the_corrections_leave(weighing: Any) -> None:
    moves = np.array([[3.0, 0.0], [0.0, 4.0]])
    expected = 1e-4 * (np.array([9.0, 16.0]) + 25.0 * np.array([0.1, 0.2])) + 0.16 * np.array([0.1, 0.2])
    assert weighing._model_error(moves) == pytest.approx(expected)


def test_prior_odds_hypotheses_and_members(weighing: Any) -> None:
    assert weighing._log_odds == pytest.approx(np.log(2.0))  # one of three causes
    weighing._causes = weighing._causes[:1]
    assert weighing._log_odds == 0.0
    assert weighing._rows_of((0, 2)) == [4, 5, 7]
    assert weighing._members_of([[0, 1], [0, 1, 4, 5]]).tolist() == [[0, 1, 8, 8], [0, 1, 4, 5]]


def test_the_shown_numbers_of_a_cause(weighing: Any) -> None:
    assert [weighing.shown(i) for i in range(3)] == [1, 1, 1]
    weighing._causes = (cause("first"), cause("second", shown=2), cause("third", shown=0))
    assert [weighing.shown(i) for i in range(3)] == [2, 1, 1]
    assert weighing.scale([4, 6]).tolist() == [0.3, 0.01]


def test_the_single_causes_stand_before_the_pairs_of_the_same_inputs(weighing: Any) -> None:
    assert weighing.alone(3) == slice(0, 4)
    weighing.hypotheses, weighing._members = weighing.hypotheses * 2, weighing._members * 2
    weighing.is_uncertain = np.repeat([False, True], 7)
    assert weighing.alone(9) == slice(7, 11)


def test_the_modulus_follows_a_unit_of_each_cause_as_in_a_weighted_fit_of_the_law(weighing: Any) -> None:
    by_unit = weighing.moved_by_unit()
    # A fit of the law to the negative change of the residuals, with one row for the prior of each parameter.
    root = np.sqrt(weighing._variance)
    law = np.concatenate([(weighing._rows[:2] / SCALE[:2, None] / root).T, np.diag(1 / SCALE[:2])])
    for row in (2, 4, 7):
        change = np.concatenate([weighing._rows[row] / SCALE[row] / root, [0.0, 0.0]])
        assert by_unit[row] == pytest.approx(-np.linalg.lstsq(law, change)[0][0])
    assert (by_unit[8], weighing.starts(0).tolist(), weighing.starts(1).tolist()) == (0.0, [0.0, 0.0], [0.02])


def test_an_input_changes_the_residuals_by_its_size(weighing: Any) -> None:
    means = np.zeros((7, 9))
    means[1, 2] = 0.1
    change = 0.1 / 0.05 * weighing._rows[2]
    expected = (change**2 / (weighing._variance + 0.5 * np.array([1.0, 3.0]))).sum()
    assert weighing.squares_of(1, posterior([0.0] * 7, means), [2]) == pytest.approx(expected)
    assert weighing.rows_of_inputs(1) == [2]
    assert weighing.rows_of_inputs(0) == []
    # The second cause changes the residuals as the input does, by 7 / 3 of it for a prior size of each.
    assert weighing.as_cause([2], np.array([0.1]), 1) == pytest.approx([0.1 * 3.0 / 7.0])
    assert weighing.stated_size(1) == pytest.approx(0.05 * 3.0 / 7.0)
    assert weighing.stated_size(0) == 0.0


def test_the_misfit_is_the_mean_square_over_the_noise(weighing: Any) -> None:
    amplitudes = np.zeros(9)
    amplitudes[6] = 0.02
    rest = np.array([1.0, 2.0]) - 2.0 * weighing._rows[6]
    assert weighing._misfit(np.array([1.0, 2.0]), amplitudes) == pytest.approx(np.mean(rest**2 / [0.5, 2.0]))


def test_a_hypothesis_starts_from_its_most_probable_simulated_part(weighing: Any) -> None:
    known = np.array([True, True, True, True, False, False, False])
    score = posterior([0.0, 1.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    # The fit has corrected the second cause: only hypotheses with it start from one with it.
    assert weighing._starts(score, known) == [(4, 2), (5, 3), (6, 2)]
    weighing._measured = set()
    assert weighing._starts(score, known) == [(4, 1), (5, 3), (6, 3)]
    assert weighing._starts(score, np.zeros(7, bool)) == []
    weighing.is_uncertain = np.array([True] * 4 + [False] * 3)
    assert weighing._starts(score, known) == []


def test_the_most_probable_hypotheses_are_simulated(weighing: Any) -> None:
    weighing._columns = []
    logs = [0.0, -10.0, -100.0, 0.0, -5.0, -25.0, -60.0]
    prior = np.array(weighing.log_prior)
    assert weighing._probable(posterior(list(np.array(logs) - prior)), 30.0) == [3, 1, 4, 5]
    assert weighing._probable(posterior(list(np.array(logs) - prior)), 200.0) == [3, 1, 2, 4, 5, 6]
    logs[2] = -300.0
    # In the first passes, a single cause is simulated however improbable it is.
    assert weighing._probable(posterior(list(np.array(logs) - prior)), 200.0) == [3, 1, 2, 4, 5, 6]
    weighing._columns = [column(0, 1.0, 0.5)]
    assert weighing._probable(posterior(list(np.array(logs) - prior)), 30.0)[0] == 0


def test_at_most_eight_single_causes_and_four_pairs_are_simulated(weighing: Any) -> None:
    weighing.hypotheses = [(), *((i,) for i in range(10)), *((0, i) for i in range(1, 7))]
    weighing.is_uncertain, weighing._columns = np.zeros(17, bool), []
    weighing.log_prior = np.zeros(17)
    found = weighing._probable(posterior([-0.1 * k for k in range(17)]), 30.0)
    assert found == [*range(1, 9), *range(11, 15)]


def test_a_simulation_gets_the_law_the_inputs_and_the_causes(weighing: Any) -> None:
    amplitudes = np.array([0.01, 0.02, 0.03, 9.0, 0.1, 0.2, 0.005, 1.5, 0.0])
    (found,) = weighing._simulated((0, 2), amplitudes)
    moved, sizes = weighing._about.asked[0]
    assert moved.tolist() == [0.01, 0.02]
    # The second cause has a size in the fit, which its absence removes.
    assert sizes == {"width": [0.03], "first": [0.1, 0.2], "second": [0.0], "third": [1.5]}
    assert found[0] == pytest.approx(1.0 + 0.03 - 0.04 + 10 * (0.03 + 0.3 + 1.5))
    assert weighing.remaining(5, amplitudes)[0].tolist() == found.tolist()
    weighing._about.fails = True
    assert weighing.remaining(5, amplitudes) is None


def test_the_most_probable_sizes_minimise_the_squares_with_their_priors(weighing: Any) -> None:
    start = np.array([0.01, 0.01, 0.0, 9.0, 0.01, 0.01, 0.0, 0.0, 0.0])
    found = weighing._minimised(1, start)
    assert found[3] == 0.0  # a correction is not simulated
    assert found[[2, 6, 7, 8]].tolist() == [0.0] * 4
    # Least squares of (1 + slope . x)^2 (1 / 0.5 + 1 / 2) + sum of (x / size)^2.
    slope, size = np.array([3.0, -2.0, 10.0, 10.0]), SCALE[[0, 1, 4, 5]]
    normal = 2.5 * np.outer(slope, slope) + np.diag(size**-2)
    assert found[[0, 1, 4, 5]] == pytest.approx(-np.linalg.solve(normal, 2.5 * slope), rel=1e-3)
    weighing._about.fails = True
    assert weighing._minimised(1, start)[:2].tolist() == [0.01, 0.01]


def test_without_slopes_the_start_is_kept(weighing: Any) -> None:
    start = np.array([0.01, 0.01, 0.0, 9.0, 0.01, 0.01, 0.0, 0.0, 0.0])
    weighing._slopes = lambda row, trial, residual, active: None
    found = weighing._minimised(1, start)
    assert found.tolist() == [0.01, 0.01, 0.0, 0.0, 0.01, 0.01, 0.0, 0.0, 0.0]


def test_slopes_are_differences_over_a_small_share_of_each_prior_size(weighing: Any) -> None:
    amplitudes = np.zeros(9)
    (residual,) = weighing._simulated((0,), amplitudes)
    weighing._about.asked.clear()
    found = weighing._slopes(1, amplitudes, residual, [1, 2, 4])
    assert found[0] == pytest.approx(0.2 * -2.0 * np.array([1.0, -1.0]))
    assert found[1] is not None
    assert found[1].tolist() == weighing._rows[2].tolist()
    assert found[2] == pytest.approx(0.3 * 10.0 * np.array([1.0, -1.0]))
    (law, _), (_, sizes) = weighing._about.asked
    assert law[1] == pytest.approx(3e-3 * 0.2)
    assert sizes["first"][0] == pytest.approx(0.05 * 0.3)
    weighing._about.fails = True
    assert weighing._slopes(1, amplitudes, residual, [1]) is None


def test_the_evidence_has_the_factor_of_a_moment_prior_and_bounded_sizes(
    weighing: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    means = np.zeros((4, 9))
    means[1, 4], means[1, 5], means[2, 6], means[0, 0], means[0, 1] = 0.6, 99.0, -7.0, 9.0, -9.0
    means[3, [4, 6]] = 1.0
    monkeypatch.setattr("eimi_fitting.inference.doubts.weighing.weigh", lambda *given: posterior([1.0] * 4, means))
    found = weighing._evidence(None, None, [(), (0,), (1,), (0, 1)])
    first, second = (np.log(s / (s + 0.09)) for s in (0.36, 49.0))
    assert found.log_evidence[:3] == pytest.approx([1.0, 1.0 + 2 * first, 1.0 + 2 * second])
    assert found.means[1, 4] == pytest.approx(0.6 * 0.3)
    assert found.means[1, 5] == pytest.approx(5 * 0.3)  # at most five prior sizes
    assert found.means[2, 6] == pytest.approx(-5 * 0.01)
    assert found.means[0, :2] == pytest.approx([1 - 0.5, -0.4])  # the law stays in its range


def test_the_remaining_error_of_each_state_is_that_of_the_used_points(weighing: Any) -> None:
    weighing._stated = [np.array([[[1.0, 2.0]]])]
    weighing._about.slopes = [np.array([[[[3.0, 3.0]]], [[[5.0, 5.0]]]])]
    weighing._about.in_error = [np.array([[[1.0, 0.0]]])]
    amplitudes = np.array([0.1, 0.0, 0.01, 7.0, 0.0, 0.0, 0.02, 0.0, 0.0])
    (error,) = weighing.remaining_mm(amplitudes)
    assert error == pytest.approx([1.0 + 0.3 + 0.1 + 0.2])
    weighing._about.in_error = [np.zeros((1, 1, 2))]
    assert weighing.remaining_mm(amplitudes)[0].tolist() == [0.0]


def test_causes_of_negligible_size_are_in_no_class(weighing: Any) -> None:
    means = np.zeros((4, 9))
    means[1, 4], means[2, 6], means[3, 7] = 0.31 * 0.3, 0.31 * 0.01, 0.29 * 2.0
    seen: list[Any] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "eimi_fitting.inference.doubts.weighing.classes",
            lambda remaining, counts, evidence, negligible: (
                seen.append((remaining, counts, negligible)) or [(0, 1), (2,)]
            ),
        )
        groups = weighing._alike(np.ones((4, 2)), posterior([0.0, 3.0, 2.0, 1.0], means), [0, 1, 2], 0.5)
    assert groups == [(0, 1), (2,)]
    remaining, counts, negligible = seen[0]
    assert counts == [2, 1, 1]
    assert negligible.tolist() == [False, False, True]
    deviation = np.sqrt(weighing._variance + 0.5 * np.array([1.0, 3.0]))
    assert remaining[0] == pytest.approx(1 / deviation)
    assert remaining[1] == pytest.approx((1 - 0.31 * weighing._rows[4]) / deviation)


@pytest.mark.parametrize(("solved", "possible"), [(True, ()), (False, ("a",)), (True, ("a", "b"))])
def test_without_a_cause_that_changes_the_residuals_the_result_is_empty(monkeypatch, solved, possible):
    monkeypatch.setattr(causes, "LinearisedFit", SimpleNamespace(of=lambda *_: SimpleNamespace(solved=solved)))
    monkeypatch.setattr(causes, "columns_of", lambda about, cause: [])
    found = causes.weighed_causes("problem", "optimum", possible=possible)
    assert found == causes.Weighed((), frozenset(), {})
    assert (found.modulus_percent, found.most_probable, found.remaining) == ((0.0, 0.0), frozenset(), None)
    assert (found.beside_the_fit, found.as_stated) == (0.0, 0.0)


def test_a_deviation_within_its_uncertainty_has_the_probability_of_being_more_than_negligible():
    # Cause 1 has two numbers with the prior sizes 0.5 and 2; the second is the larger in its prior size.
    blocks = {1: np.array([2, 3])}
    weighing = SimpleNamespace(
        blocks=blocks,
        shown=lambda cause: 2,
        scale=lambda indices: np.array([1.0, 1.0, 0.5, 2.0])[indices],
        moved_by_unit=lambda: np.array([0.0, 0.0, 0.5, 0.25]),
    )
    posterior = SimpleNamespace(
        means=np.array([[0.1, 9.0, 9.0, 9.0], [9.0, 9.0, 9.0, 9.0], [0.4, 9.0, 0.2, -1.6]]),
        squares=np.array([[0.0] * 4, [0.0] * 4, [0.0, 0.0, 0.0, 0.8**2 + 0.25]]),
    )
    exact = SimpleNamespace(causes=[0, 1], posterior=posterior, probability=np.array([0.0, 0.0, 0.6]))
    found = deviating_inputs._deviation(weighing, exact, 1, np.array([0.3, -1.6]), (0, 1, 4), 0.1)
    beyond = scipy.stats.norm.cdf((-0.8 - 0.3) / 0.5) + scipy.stats.norm.cdf((0.8 - 0.3) / 0.5)
    assert found.cause == 1
    assert found.probability == pytest.approx(0.6 * beyond)
    assert found.value == pytest.approx(-np.hypot(0.3, 1.6))
    assert found.moved == pytest.approx(0.3 + 0.5 * (0.3 - 0.2))
    assert found.like == (0, 4)


@pytest.mark.parametrize(("decrease", "simulations"), [(1.0, 8), (0.011, 8), (0.009, 2)])
def test_slopes_are_renewed_while_the_squares_fall_by_a_hundredth_at_most_eight_times(
    weighing: Any, decrease: float, simulations: int
) -> None:
    calls: list[Any] = []

    def simulated(hypothesis: Any, amplitudes: np.ndarray) -> list[np.ndarray]:
        calls.append(amplitudes.copy())
        square = 100.0 - decrease * len(calls) - ((amplitudes / SCALE) ** 2).sum()
        return [np.array([np.sqrt(0.5 * square), 0.0])]  # the first residual has the noise 0.5

    weighing._simulated = simulated
    weighing._slopes = lambda row, trial, residual, active: np.zeros((len(active), 2))
    start = np.zeros(9)
    start[0], start[6] = 1e-9, 1e-9
    weighing._minimised(2, start)
    assert len(calls) == simulations


@pytest.mark.parametrize(("moves", "passes"), [(True, 8), (False, 0)])
def test_hypotheses_are_simulated_at_most_eight_times_and_improbable_ones_three_times(
    weighing: Any, moves: bool, passes: int
) -> None:
    limits: list[float] = []
    simulated: list[tuple[int, ...]] = []
    errors: list[np.ndarray] = []

    def weigh(y: np.ndarray, error: np.ndarray) -> Posterior:
        errors.append(error)
        means = np.zeros((7, 9))
        means[2, 6] = 0.01 * (0.0051 if moves else 0.0049) * len(errors)  # of cause 1, in its prior size 0.01
        return posterior([0.0] * 7, means)

    def probable(result: Posterior, far: float) -> range:
        limits.append(far)
        return range(7)

    def simulate(hypothesis: tuple[int, ...], amplitudes: np.ndarray) -> list[np.ndarray]:
        simulated.append(hypothesis)
        return [np.array([1.0, 2.0])]

    weighing._stated = [np.array([0.1, 0.2])]
    weighing._weigh, weighing._probable, weighing._simulated = weigh, probable, simulate
    weighing._misfit = lambda y, amplitudes: 3.9
    weighing._starts = lambda result, known: []
    weighing.evidence_of_sets()
    assert simulated == [(1,)] * passes
    assert limits == ([200.0] * 3 + [30.0] * 5 if moves else [200.0])
    assert len(errors) == 1 + passes
    if moves:
        size = 0.0051 * 8
        assert weighing._y[2] == pytest.approx(size * weighing._rows[6] - [1.0, 2.0])
    assert weighing._y[0] == pytest.approx([-0.1, -0.2])


@pytest.mark.parametrize(("misfit", "renewed"), [(3.9, []), (4.1, [2])])
def test_a_single_cause_with_a_misfit_above_four_is_fitted_again_in_the_second_pass(
    weighing: Any, misfit: float, renewed: list[int]
) -> None:
    rows: list[int] = []
    passes: list[int] = []

    def weigh(y: np.ndarray, error: np.ndarray) -> Posterior:
        passes.append(1)
        means = np.zeros((7, 9))
        means[[2, 4], 6] = len(passes)  # a single cause and a pair
        return posterior([0.0] * 7, means)

    def minimised(row: int, amplitudes: np.ndarray) -> np.ndarray:
        rows.append(row)
        return amplitudes

    weighing._stated = [np.zeros(2)]
    weighing._weigh, weighing._probable, weighing._minimised = weigh, lambda result, far: range(7), minimised
    weighing._simulated = lambda hypothesis, amplitudes: None
    weighing._misfit = lambda y, amplitudes: misfit
    weighing._starts = lambda result, known: []
    weighing.evidence_of_sets()
    assert rows == renewed
