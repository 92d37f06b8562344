"""The fit of a viscoelastic law agrees with calculations by hand and with closed forms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS, Loads, Specimen
from eimi_fitting.inference.evidence.quantity import NORMAL_95
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time import identification, law_of_time, loaded_creep, result, slow_motion
from eimi_fitting.time.channels import Signals
from eimi_fitting.time.decay import Decay, RingMode
from eimi_fitting.time.evidence import AT_REST_S, RestEvidence, RingEvidence, Sag, with_scatter
from eimi_fitting.time.law_of_time import Problem, TimeOptimum, best_number_of_terms, drawn, optimum_of
from eimi_fitting.time.loaded_creep import LoadCurve, LoadStep, creep
from eimi_fitting.time.measured import Motion
from eimi_fitting.time.ringing import _lagrange
from eimi_fitting.time.slow_evidence import CreepEvidence, LoadHistory
from eimi_fitting.time.slow_motion import slow_rotations
from eimi_fitting.time.small_effects import SmallEffect
from eimi_fitting.time.terms import Terms

SERIES = Prony(np.array([[0.2, 0.1]]), np.array([[0.1, 5.0]]))
STIFF_PA = np.array([50e3])
ONE = np.ones(1)
NO_POINTS = np.zeros((0, 2))


def mode(frequency_Hz: float = 5.0, loss: float = 0.1, log_sigma: float = 1e-3, sigma: float = 2e-3) -> RingMode:
    return RingMode(frequency_Hz, loss, np.diag([log_sigma**2, sigma**2]))


def decay(*modes: RingMode, from_s: float = 0.0) -> Decay:
    none = np.zeros(0)
    return Decay("flick", modes, (), from_s, 4.0, 3.0, 0.01, 0.02, none, none, none, none, 1.0)


def table(weight_log: float = 0.0, hanging_N: float = 0.0, solid: float = 1.0) -> Any:
    # Return a replacement for a RingTable (table of vibrations); its beam vibrates with 5, 30 and 80 Hz.
    # weight_log : change of ln(frequency) by the weight `hanging_N` (N) at the tip
    # solid : second and third frequency of the solid model, divided by those of the planar model
    specimen = Specimen(50.0, 5.0, 5.0, 1000.0)
    beam = SimpleNamespace(
        loads=Loads.along([0.0]),
        hanging_N=hanging_N,
        specimen=specimen,
        undamped_Hz=lambda modulus_Pa: np.array([5.0, 30.0, 80.0]),
    )
    return SimpleNamespace(
        beam=beam,
        middle_Pa=50e3,
        solid_over_planar=np.array([1.0, solid, solid]),
        fixed_weight_log=weight_log,
        planar_over_solid_modulus=0.8,
        effects=lambda sources: {key: np.array([[0.01, 0.02, 0.03]]) for key in sources},
    )


def test_the_errors_of_a_frequency_and_a_loss_have_a_measured_and_a_computed_part() -> None:
    one = mode(loss=0.2)
    ring = RingEvidence(table(), decay(one), ((0, one), (1, one)))
    gaps = np.array([[0.01, 0.02]])
    assert ring._whitened(0, one, gaps) == pytest.approx(gaps / np.hypot([1e-3, 2e-3], [3e-4, 3e-3 * 0.2]))
    assert ring._whitened(1, one, gaps) == pytest.approx(gaps / np.hypot([1e-3, 2e-3], [0.015, 0.05 * 0.2]))
    several = replace(ring, inflation=3.0, repeats=4)
    expected = gaps / np.hypot([3e-3, 6e-3], 2 * np.array([3e-4, 6e-4]))
    assert several._whitened(0, one, gaps) == pytest.approx(expected)
    hanging = replace(ring, table=table(0.02))
    assert hanging._whitened(0, one, gaps)[0, 0] == pytest.approx(0.01 / np.sqrt(1e-6 + 9e-8 + 1e-4))
    effects = ring.effects({"width": 0.1})["width"]
    assert effects[0, [0, 2]] == pytest.approx([0.01 / np.hypot(1e-3, 3e-4), 0.02 / np.hypot(1e-3, 0.015)])
    assert effects[0, [1, 3]].tolist() == [0.0, 0.0]
    correlated = replace(one, covariance=np.array([[1e-6, 1e-6], [1e-6, 4e-6]]))
    covariance = correlated.covariance + np.diag([9e-8, 3.6e-7])
    rows = ring._whitened(0, correlated, gaps)
    assert (rows**2).sum() == pytest.approx(float(gaps[0] @ np.linalg.inv(covariance) @ gaps[0]))


def test_a_higher_frequency_belongs_to_the_nearest_computed_one_within_an_eighth() -> None:
    def numbers(*frequencies_Hz: float, solid: float = 1.0) -> list[int]:
        found = RingEvidence.of(table(solid=solid), decay(mode(), *(mode(f) for f in frequencies_Hz)))
        return [number for number, _ in found.modes]

    assert numbers(26.7, 89.5) == [0, 1, 2]
    assert numbers(26.3) == [0]
    assert numbers(89.7) == [0]
    assert numbers(30.0, 31.0) == [0, 1]
    assert numbers(33.0, solid=1.2) == [0, 1]
    assert numbers(30.0, solid=1.2) == [0]


def test_the_age_of_a_ring_down_after_a_step_is_one_decay_time_after_its_start() -> None:
    loaded = table()
    loaded.beam.loads = Loads.along([5.0])
    ring = decay(mode(), from_s=0.5)
    assert RingEvidence.of(loaded, ring, is_stepped=True).age_s == pytest.approx(0.5 + 1 / (0.05 * 2 * np.pi * 5))
    assert RingEvidence.of(loaded, ring).age_s == RingEvidence.of(table(), ring, is_stepped=True).age_s == AT_REST_S


@pytest.mark.parametrize(("measured", "is_doubted"), [(0.49, True), (0.51, False), (4.49, False), (4.51, True)])
def test_a_sag_that_contradicts_the_vibration_is_doubted(measured: float, is_doubted: bool) -> None:
    # A beam of 50 mm may be bent by 5 mm at rest: half of the computed sag of 10 mm.
    doubts = Sag(10.0, measured, STIFF_PA, ONE, NO_POINTS).doubts(decay(mode()), 50.0)
    assert bool(doubts) is is_doubted
    assert (
        not doubts
        or f"sags by {10 * measured:.2g} mm, but a beam that vibrates at 5 Hz would sag by 10 mm" in doubts[0]
    )


def test_the_modulus_at_rest_follows_from_the_sag_with_its_error() -> None:
    moduli = np.array([20e3, 40e3, 80e3])
    sag = Sag(2.0, 1.5, moduli, np.array([2.0, 1.0, 0.5]), NO_POINTS)
    rest = RestEvidence.of(sag, table())
    assert rest is not None
    assert rest.modulus_Pa == pytest.approx(np.sqrt(20e3 * 40e3) / 0.8)  # planar over solid
    slopes = np.abs(np.gradient(np.log(moduli)[::-1], [0.5, 1.0, 2.0]))
    at = 0.5 * (slopes[1] + slopes[2])
    assert rest.sigma == pytest.approx(np.hypot(0.02, at * 0.005 * 50.0 / 2.0))
    assert RestEvidence.of(replace(sag, computed_mm=0.99), table()) is None  # below 2 % of the length
    assert RestEvidence.of(replace(sag, computed_mm=1.01), table()) is not None
    for measured in (0.5, 2.0, 0.4, 2.1):
        assert RestEvidence.of(replace(sag, measured=measured), table()) is None
    (row,) = rest.residuals(STIFF_PA, SERIES, np.zeros(1))[0]
    assert row == pytest.approx(np.log(0.7 * 50e3 / rest.modulus_Pa) / rest.sigma)


def test_repeated_ring_downs_that_scatter_are_widened_by_their_birge_ratio() -> None:
    of_table = table()

    def ring(frequency_Hz: float, loss: float = 0.1) -> RingEvidence:
        one = mode(frequency_Hz, loss)
        return RingEvidence(of_table, decay(one), ((0, one),))

    sigma = np.hypot(1e-3, 3e-4)
    both = with_scatter([ring(5.0), ring(5.0 * np.exp(6 * sigma))])
    assert [one.inflation for one in both] == pytest.approx([6 / np.sqrt(2)] * 2, rel=1e-6)
    assert [one.repeats for one in both] == [2, 2]
    close = with_scatter([ring(5.0), ring(5.0 * np.exp(sigma)), ring(5.0)])
    assert [(one.inflation, one.repeats) for one in close] == [(1.0, 3)] * 3
    of_loss = with_scatter([ring(5.0, 0.1), ring(5.0, 0.14)])
    spread = [np.hypot(2e-3, 3e-3 * loss) for loss in (0.1, 0.14)]
    assert of_loss[0].inflation == pytest.approx(0.04 / np.hypot(*spread), rel=1e-6)
    alone = with_scatter([ring(5.0), replace(ring(6.0), table=table())])
    assert [(one.inflation, one.repeats) for one in alone] == [(1.0, 1)] * 2


def constant(moment: float) -> LoadCurve:
    ends = np.array([-3.0, 3.0])
    return LoadCurve(ends, np.full(2, moment), np.full(2, moment))


def test_a_constant_moment_makes_a_beam_creep_as_its_prony_series_tells() -> None:
    times_s = np.array([1e-3, 0.05, 0.3, 2.0, 20.0, 60.0])
    expected = 5e3 / 50e3 * np.array([float(SERIES.creep(t)[0]) for t in times_s])
    found = creep(STIFF_PA, SERIES, (LoadStep(0.0, constant(5e3)),), times_s, ONE)
    assert found[0] == pytest.approx(expected, rel=2e-3)
    twice = creep(STIFF_PA, SERIES, (LoadStep(0.0, constant(5e3)),), times_s, 2 * ONE)
    assert twice == pytest.approx(2 * found)


def test_a_load_that_is_removed_leaves_the_difference_of_two_creeps() -> None:
    times_s = np.array([1.0, 2.5, 3.0, 10.0, 30.0])
    steps = (LoadStep(0.0, constant(5e3)), LoadStep(2.0, constant(0.0)))
    expected = 0.1 * np.array([
        float((SERIES.creep(t) - (SERIES.creep(t - 2.0) if t > 2.0 else 0.0))[0]) for t in times_s
    ])  # fmt: skip
    assert creep(STIFF_PA, SERIES, steps, times_s, ONE)[0] == pytest.approx(expected, abs=2e-4)


def test_gravity_resists_a_rotation_like_a_spring() -> None:
    spring = LoadCurve.of_gravity(10e3)
    moment, slope = spring.at(np.array([0.5, -4.0]))
    assert moment == pytest.approx([-5e3, 40e3])
    assert slope == pytest.approx([-10e3, -10e3])
    # At rest, a moment of 4 kPa that acts against both has bent the beam by 4 / (0.7 * 50 + 10).
    pushed = LoadCurve(spring.rotation, spring.moment + 4e3, 0 * spring.moment)
    found = creep(STIFF_PA, SERIES, (LoadStep(0.0, pushed),), np.array([1e-3, 1e3]), ONE)[0]
    assert found == pytest.approx([4 / 60, 4 / 45], rel=3e-3)


def test_the_share_of_the_field_in_a_moment_follows_from_a_stronger_field() -> None:
    theta = np.linspace(-1.0, 1.0, 6)
    of_field, of_gravity = 3 * np.cos(theta), -2 * theta
    curve = LoadCurve.through((theta, of_field + of_gravity), (theta, 1.05 * of_field + of_gravity), 1.05)
    assert (curve.rotation[0], curve.rotation[-1], len(curve.rotation)) == (-1.0, 1.0, 65)
    assert curve.moment == pytest.approx(3 * np.cos(curve.rotation) - 2 * curve.rotation, abs=2e-3)
    assert curve.of_field == pytest.approx(3 * np.cos(curve.rotation), abs=3e-3)
    few = LoadCurve.through((theta, of_gravity), (theta[:1], of_gravity[:1]), 1.05)
    assert few.of_field is few.moment
    assert curve.at(np.array([0.3]))[0] == pytest.approx([3 * np.cos(0.3) - 0.6], abs=3e-3)
    coarse = replace(curve, rotation=curve.rotation[::8], moment=curve.moment[::8], of_field=curve.of_field[::8])
    even = coarse.at_even_rotations()
    assert even.rotation == pytest.approx(curve.rotation)
    assert even.moment == pytest.approx(np.interp(curve.rotation, coarse.rotation, coarse.moment))
    assert even.of_field == pytest.approx(np.interp(curve.rotation, coarse.rotation, coarse.of_field))


def test_the_time_steps_of_a_history_are_short_at_first_and_end_at_the_wanted_times() -> None:
    steps = (LoadStep(0.0, constant(1.0)), LoadStep(10.0, constant(2.0)))
    wanted = np.array([5.0, 10.0, 30.0])
    plan = loaded_creep._plan(steps, wanted)
    ends = np.cumsum(plan.spans_s)
    assert ends[plan.wanted] == pytest.approx(wanted)
    assert ends[0] == pytest.approx(1e-6)
    assert ends[1] == pytest.approx(2e-3)
    # Four steps for a decade before the last change of the load, and eight after it: at 2 ms, 1 microsecond and the
    # wanted times besides.
    assert np.sum(ends < 10.0 + 1e-7) == np.ceil(4 * np.log10(10.0 / 2e-3)) + 1 + 2
    assert np.sum(ends > 10.0 + 1e-7) == np.ceil(8 * np.log10(20.0 / 2e-3)) + 1 + 1
    assert [curve is steps[1].curve for curve in plan.curves] == (ends > 10.0).tolist()
    straight = loaded_creep._plan((LoadStep(0.0, constant(0.0)), LoadStep(10.0, constant(2.0))), wanted)
    assert np.sum(np.cumsum(straight.spans_s) <= 10.0) == 2  # an unbent beam does not creep


class OneLoadStep:
    # Replaces a history of loads by one load step; the tests give the rotations of the tip.

    steps = (LoadStep(0.0, constant(5e3)),)


def test_the_errors_of_creep_are_shared_by_the_times_of_a_decade() -> None:
    time_s, rotation = np.geomspace(1.0, 100.0, 8), np.linspace(0.0, 0.2, 8)
    shown = np.linspace(-1.0, 1.0, 5), np.linspace(-1.0, 1.0, 5)
    for error, table_of in ((0.02, shown), (0.06, None)):
        evidence = CreepEvidence(OneLoadStep(), time_s, rotation, np.full(8, 1e-3), np.zeros(8), "step", table_of)  # type: ignore[arg-type]
        sigma = np.hypot(1e-3, error * np.sqrt(4.0) * 0.2)  # four times in each of two decades
        true = rotation + 0.01 * np.array([1, -1, 1, -1, 1, -1, 1, -1])
        rows = evidence.residuals_at(true[None])[0]
        assert rows == pytest.approx(np.append((true - rotation) / sigma, 0.0))
        assert evidence.residuals_at(true[None] + 0.3)[0] == pytest.approx(rows)  # a constant does not count
    quick = CreepEvidence(OneLoadStep(), np.linspace(1.0, 3.0, 8), rotation, np.full(8, 1e-3), np.zeros(8), "step")  # type: ignore[arg-type]
    sigma = np.hypot(1e-3, 0.06 * np.sqrt(8.0) * 0.2)
    assert quick.residuals_at(true[None])[0][:8] == pytest.approx((true - rotation) / sigma)
    assert quick.effects({"width": 0.1})["width"].tolist() == [[0.0] * 9]
    predicted = evidence.predicted(STIFF_PA, SERIES, np.log(2 * ONE))
    assert predicted == pytest.approx(2 * creep(STIFF_PA, SERIES, OneLoadStep.steps, time_s, ONE))


def test_the_shown_rotation_is_interpolated_in_its_table_and_continued_at_its_ends() -> None:
    table_of = np.array([0.0, 1.0, 2.0]), np.array([0.0, 2.0, 3.0])
    evidence = CreepEvidence(LoadHistory(()), ONE, ONE, ONE, ONE, "step", table_of)
    assert evidence.shown_at(np.array([[-1.0, 0.0, 0.5, 1.0, 1.5, 3.0]])).tolist() == [[-2.0, 0.0, 1.0, 2.0, 2.5, 4.0]]
    true = np.array([0.3])
    assert replace(evidence, shown=None).shown_at(true) is true


@dataclass(frozen=True)
class Normal:
    # A replacement for measured data: ln(instantaneous modulus / 50 kPa), measured as `mean` with `sigma`.

    mean: float
    sigma: float

    def residuals(self, instantaneous_Pa: np.ndarray, series: Prony, load_log: np.ndarray) -> np.ndarray:
        return np.asarray((np.log(instantaneous_Pa / 50e3) - self.mean) / self.sigma)[:, None]

    def effects(self, sources: Mapping[str, float]) -> dict[str, np.ndarray]:
        return {key: np.full((1, 1), sigma / self.sigma) for key, sigma in sources.items()}


@pytest.fixture(scope="module")
def optimum() -> TimeOptimum:
    return optimum_of(Problem(Terms(1, (0.01, 30.0), 50e3), (Normal(0.1, 0.02),), 0.05))


def test_measurements_that_contradict_each_other_lower_the_evidence() -> None:
    def of(*means: float) -> TimeOptimum:
        evidence = tuple(Normal(mean, 0.02) for mean in means)
        return optimum_of(Problem(Terms(1, (0.01, 30.0), 50e3), evidence, 0.05))

    agreeing, apart = of(0.1, 0.1), of(0.05, 0.15)  # each 2.5 standard deviations from the mean of both
    assert apart.chi2 - agreeing.chi2 == pytest.approx(2 * 2.5**2, rel=1e-3)
    assert agreeing.log_evidence - apart.log_evidence == pytest.approx(2.5**2, rel=1e-2)


def test_the_evidence_of_an_optimum_is_that_of_a_normal_distribution(optimum: TimeOptimum) -> None:
    problem, at = optimum.problem, optimum.unknowns
    assert np.log(problem.terms.split(at[None, :-1])[0][0] / 50e3) == pytest.approx(0.1, abs=1e-3)
    prior = ((at - problem.mean) / problem.sigma) ** 2
    assert problem.sigma[-1] == 0.05
    step = 1e-5
    jacobian = np.stack(
        [(problem.residuals((at + step * e)[None]) - problem.residuals((at - step * e)[None]))[0] / (2 * step)
         for e in np.eye(len(at))],
        axis=1,
    )  # fmt: skip
    assert optimum.jacobian == pytest.approx(jacobian, abs=1e-4)
    misfit = float(problem.rows(at[None])[0, 0] ** 2)
    log_determinant = np.linalg.slogdet(jacobian.T @ jacobian)[1]
    expected = -0.5 * (misfit + prior.sum() + log_determinant) - np.log(problem.sigma).sum()
    assert optimum.log_evidence == pytest.approx(expected, abs=1e-4)
    assert optimum.chi2 == pytest.approx(misfit)
    assert optimum.converged
    assert optimum.covariance == pytest.approx(np.linalg.inv(jacobian.T @ jacobian), rel=1e-3)
    effects = problem.effects({"width": 0.01})
    assert effects["width"].tolist() == [[0.5]]
    assert optimum.steps(effects)["width"][0] == pytest.approx(-optimum.covariance @ jacobian[0] * 0.5, rel=1e-3)


def test_draws_have_the_covariance_of_the_optimum(optimum: TimeOptimum) -> None:
    omegas = np.array([2 * np.pi * 5.0])
    moves = {"width": np.zeros((1, 4))}
    moves["width"][0, 3] = 1.0
    draws = drawn(optimum, moves, 3, omegas, of_sources=False)
    assert draws.shape == (480, 4)  # five times 96 walkers
    modulus = np.log(optimum.problem.terms.split(draws[:, :-1])[0] / 50e3)
    assert modulus.mean() == pytest.approx(0.1, abs=0.07)
    assert modulus.std() < 0.3  # of the prior: 3
    assert draws[:, 3].mean() == pytest.approx(0.0, abs=0.01)
    assert draws[:, 3].std() == pytest.approx(0.05, rel=0.15)
    assert draws[:, 2].std() == pytest.approx(optimum.problem.sigma[2], rel=0.15)
    moved = drawn(optimum, moves, 3, omegas)
    assert moved[:, :3] == pytest.approx(draws[:, :3])
    assert (moved - draws)[:, 3].std() == pytest.approx(1.0, rel=0.15)
    assert drawn(optimum, moves, 4, omegas)[0, 0] != moved[0, 0]


@pytest.mark.parametrize(
    ("evidences", "computed", "chosen"),
    [([0.0, 0.9], 2, 0), ([0.0, 1.1, 1.5], 3, 1), ([0.0, 2.0, 5.0, 5.5], 4, 2), ([0.0, -3.0], 2, 0)],
)
def test_the_fewest_terms_are_taken_whose_evidence_is_near_the_largest(
    monkeypatch: pytest.MonkeyPatch, evidences: list[float], computed: int, chosen: int
) -> None:
    given: list[tuple[int, int, Any]] = []

    def optimum_of(problem: int, seed: int, fewer: Any) -> Any:
        given.append((problem, seed, fewer))
        return SimpleNamespace(log_evidence=[*evidences, 99.0][problem])

    monkeypatch.setattr(law_of_time, "optimum_of", optimum_of)
    best, optima = best_number_of_terms(range(5 if len(evidences) < 4 else 4), 7)  # type: ignore[arg-type]
    assert len(optima) == computed
    assert best is optima[chosen]
    assert given[1] == (1, 7, optima[0])


def test_the_known_range_ends_where_the_interval_of_the_modulus_exceeds_a_twentieth() -> None:
    curve_s = np.geomspace(1e-3, 1e3, 61)
    signs = np.array([1.0, -1.0])[:, None]

    def known(half_widths: np.ndarray, start_s: float, data_s: tuple[float, float]) -> Any:
        return result._known_between(np.exp(signs * half_widths / NORMAL_95), start_s, data_s)

    widths = np.full(61, 0.049)
    widths[:11], widths[51:] = 0.051, 0.051
    assert known(widths, 1.0, (1e-3, 1e3)) == pytest.approx((curve_s[11], curve_s[50]))
    assert known(widths, 1.0, (0.1, 7.0)) == pytest.approx((0.1, 7.0))
    assert known(np.full(61, 0.01), 1.0, (0.0, 1e9)) == pytest.approx((1e-3, 1e3))
    assert known(np.full(61, 1.0), 1.01, (0.0, 1e9)) is None
    widths[11:40], widths[30] = 1.0, 0.049
    assert known(widths, 1.0, (1e-3, 1e3)) == pytest.approx((curve_s[30], curve_s[30]))
    # If the data do not determine the modulus at the time of the vibration, the longest other range is the result.
    assert known(widths, 0.1, (1e-3, 1e3)) == pytest.approx((curve_s[40], curve_s[50]))
    assert known(widths, 0.1, (1e-3, 5.0)) == pytest.approx((curve_s[30], curve_s[30]))
    assert known(widths, 0.1, (1e-3, 0.5)) is None


def test_intervals_factors_and_gains() -> None:
    draws = np.append(np.arange(1001.0), np.nan)
    assert result._interval(500.0, draws) == pytest.approx((25.0, 975.0))
    assert result._interval(10.0, draws) == pytest.approx((10.0, 975.0))
    assert result._interval(990.0, draws) == pytest.approx((25.0, 990.0))
    assert result._gain(10.0, 10.0 * 1.05**0.25) == pytest.approx(4.0)
    small = [SmallEffect("air-mass", "", 3.0, 0.0), SmallEffect("exposure", "", 4.0, 0.0)]
    factors = result._factors(4000, small)
    assert factors.mean() == pytest.approx(1.0, abs=3e-3)
    assert factors.std() == pytest.approx(0.05, rel=0.05)


def test_the_result_of_a_ring_down_has_few_frames_and_widened_uncertainties() -> None:
    time = np.arange(500.0)
    one = replace(decay(mode(), mode(30.0)), time_s=time, displacement_mm=time + 0.1, envelope_mm=time + 0.2)
    ring = RingEvidence(table(), one, ((0, mode()), (1, mode(30.0))), inflation=2.0)
    shown = result._ring_down(ring)
    assert shown.time_s == tuple(np.arange(0.0, 500.0, 3.0))  # at most 240
    assert (shown.displacement_mm[1], shown.envelope_mm[1]) == (3.1, 3.2)
    assert (shown.frequency_Hz, shown.decay_loss, shown.higher_Hz) == (5.0, 0.1, (30.0,))
    assert (shown.frequency_sigma_Hz, shown.decay_loss_sigma) == pytest.approx((5 * 2e-3, 4e-3))
    assert (shown.label, shown.amplitude_mm, shown.frequency_change, shown.loss_change) == ("flick", 3.0, 0.01, 0.02)
    short = replace(one, time_s=time[:240], displacement_mm=time[:240], envelope_mm=time[:240])
    assert len(result._ring_down(replace(ring, decay=short)).time_s) == 240


def test_a_curve_of_creep_is_shown_about_its_mean_in_degrees() -> None:
    evidence = CreepEvidence(
        LoadHistory(OneLoadStep.steps),
        np.array([1.0, 10.0]),
        np.radians([1.0, 3.0]),
        np.radians([0.1, 0.2]),
        0 * ONE,
        "step",
    )
    shown = result._creep_curve(evidence, STIFF_PA, SERIES, np.zeros(1))
    assert (shown.label, shown.time_s) == ("step", (1.0, 10.0))
    assert shown.measured_deg == pytest.approx((-1.0, 1.0))
    assert shown.sigma_deg == pytest.approx((0.1, 0.2))
    half = 0.5 * np.degrees(np.diff(creep(STIFF_PA, SERIES, OneLoadStep.steps, evidence.time_s, ONE)[0])[0])
    assert shown.fitted_deg == pytest.approx((-half, half))


def test_the_moduli_at_a_frequency_are_those_of_the_prony_series() -> None:
    terms = Terms(1, (0.01, 1.0), 50e3)
    at = np.array([[np.log(50e3), np.log(0.25), np.log(0.2), 0.0]])
    x = 3.0 * 0.2
    storage, loss = 50e3 * (1 + 0.25 * x**2 / (1 + x**2)), 50e3 * 0.25 * x / (1 + x**2)
    assert result.storage_modulus(terms, at, 3.0) == pytest.approx([storage])
    assert result._loss(terms, at, 3.0) == pytest.approx([loss / storage])


def test_the_budget_of_the_dynamic_modulus_has_its_sources_the_noise_and_the_small_effects(
    optimum: TimeOptimum,
) -> None:
    terms, omega = optimum.problem.terms, 2 * np.pi * 5.0
    dynamic = float(result.storage_modulus(terms, optimum.unknowns[None], omega)[0])
    rng = np.random.default_rng(1)
    draws = optimum.unknowns + np.array([0.03, 0.0, 0.0, 0.0]) * rng.standard_normal((2000, 1))
    steps = {"width": np.array([[0.01, 0.0, 0.0, 0.0], [0.02, 0.0, 0.0, 0.0]])}
    small = (SmallEffect("air-mass", "added mass of the air", 0.4, 0.0),)
    entries = result._budget(terms, optimum, omega, dynamic, draws, {"width": 0.05}, steps, {"moment": 0.05}, small)
    by_source = {entry.source: entry for entry in entries}
    assert by_source["width"].effect_percent == pytest.approx(100 * np.hypot(0.01, 0.02), rel=1e-3)
    assert by_source["width"].standard_uncertainty == 0.05
    assert by_source["noise"].effect_percent == pytest.approx(3.0, rel=0.05)
    assert by_source["noise"].standard_uncertainty == pytest.approx(0.03, rel=0.05)
    assert by_source["moment"].effect_percent == pytest.approx(0.0, abs=1e-6)  # the data do not depend on the loads
    assert (by_source["air-mass"].effect_percent, by_source["air-mass"].standard_uncertainty) == (0.4, 0.004)
    assert [entry.source for entry in entries] == ["noise", "width", "air-mass", "moment"]


def signals(channels_mm: np.ndarray, time_s: np.ndarray) -> Signals:
    # Return signals with a noise of 0.1 mm; the second one is the y coordinate of a point.
    number = np.zeros(2, np.intp)
    return Signals(time_s, channels_mm, np.array([0.1, 0.1]), number, np.arange(2), channels_mm, np.eye(2), 0.0)


PER_RAD = np.array([[0.0, 20.0]])
GAIN = np.array([0.0, 200.0])


def test_the_rotation_after_a_step_is_the_displacement_over_that_of_one_radian() -> None:
    time_s = np.geomspace(4.0, 400.0, 64)
    rotation = 0.01 * np.log(time_s)
    recorded = signals(np.stack([np.ones(64), 20.0 * rotation], axis=1), time_s)
    motion = SimpleNamespace()
    found = slow_rotations(motion, recorded, None, PER_RAD)  # type: ignore[arg-type]
    assert found is not None
    times, turned, sigma, squares = found
    assert len(times) == 16
    assert (np.diff(np.log(times)) > 0).all()
    assert turned == pytest.approx(0.01 * np.log(times), abs=1e-9)
    assert squares.tolist() == [0.0] * 16
    assert times[0] == pytest.approx(np.exp(np.log(time_s[:4]).mean()))
    within = rotation[:4]
    scatter = 0.5 * within.std(ddof=1)  # a quarter of four frames counts as independent
    ringing = slow_motion._unseen_ringing(time_s, rotation, 1 / 200)[:4]
    expected = np.sqrt((1 / 200) ** 2 / 4 + scatter**2 + (ringing**2).sum() / 16)
    assert sigma[0] == pytest.approx(expected)
    early = signals(recorded.channels_mm, np.linspace(-1.0, 3.0, 64))
    assert slow_rotations(motion, early, None, PER_RAD) is None  # type: ignore[arg-type]  # rings for three seconds
    assert slow_rotations(motion, recorded, None, 0 * PER_RAD) is None  # type: ignore[arg-type]


def test_a_vibration_that_was_fitted_is_taken_out_of_the_slow_motion() -> None:
    time_s = np.arange(1.0, 500.0) / 50.0
    slow = np.stack([0 * time_s, 0.2 * np.log(time_s)], axis=1)
    size = np.exp(-0.5 * time_s)
    vibration = np.stack([0 * time_s, 2.0 * size * np.cos(2 * np.pi * 5.0 * time_s)], axis=1)
    recorded = signals(slow + vibration, time_s)
    rows = time_s <= 4.0
    loss = 2 * 0.5 / (2 * np.pi * 5.0)
    ring = Decay("step", (mode(5.0, loss),), (), float(time_s[0]), 4.0, 2.0, 0.0, 0.0, time_s[rows], 0 * time_s[rows],
                 2.0 * size[rows], 0 * time_s[rows], 1.0, (), slow[rows])  # fmt: skip
    times, turned, rings = slow_motion._slow_frames(recorded, ring, GAIN)
    assert times == pytest.approx(time_s)
    assert turned[rows] == pytest.approx(0.01 * np.log(time_s[rows]))
    assert turned[~rows] == pytest.approx((slow + vibration)[~rows, 1] / 20)
    last = rows & (time_s > 4.0 - 2 / 5.0)
    at_end = np.sqrt(np.mean((vibration[last, 1] / 20) ** 2))
    assert rings[rows].tolist() == [0.0] * rows.sum()
    assert rings[~rows] == pytest.approx(at_end * np.exp(-0.5 * (time_s[~rows] - 4.0)))
    at_s, squares = slow_motion._squares(recorded, ring, GAIN)
    assert at_s == pytest.approx(time_s[rows])
    assert squares == pytest.approx(0.01 * size[rows] ** 2, rel=0.05)  # the square of 0.1 rad and its decay
    other = replace(ring, baseline_mm=slow[:5])
    assert slow_motion._squares(recorded, other, GAIN)[1].tolist() == [0.0]
    assert slow_motion._ringing_after(recorded, other, GAIN, time_s[:3]).tolist() == [0.0] * 3
    found = slow_rotations(SimpleNamespace(), recorded, ring, PER_RAD)  # type: ignore[arg-type]
    assert found is not None
    assert np.diff(found[0]).min() > 0.1  # no bin is shorter than a period


def test_the_size_of_a_vibration_that_was_not_fitted_decays_with_time() -> None:
    time_s = np.linspace(0.5, 20.0, 200)
    sign = np.where(np.arange(200) % 2, 1.0, -1.0)
    rotation = 0.01 * np.log(time_s) + sign * 0.2 * np.exp(-0.3 * time_s)
    found = slow_motion._unseen_ringing(time_s, rotation, 1e-3)
    assert found[:60] == pytest.approx(0.2 * np.exp(-0.3 * time_s[:60]), rel=0.15)
    assert slow_motion._unseen_ringing(time_s[:7], rotation[:7], 1e-3).tolist() == [0.0] * 7
    assert slow_motion._unseen_ringing(time_s[:8], rotation[:8], 1e-3).max() > 0.0


def test_the_times_of_the_data_reach_from_a_third_of_the_shortest_to_three_times_the_longest() -> None:
    one, other = mode(5.0), mode(30.0)
    rings = [RingEvidence(table(), decay(one, other), ((0, one), (1, other)))]
    shortest, longest = 1 / (2 * np.pi * 30.0), 1 / (2 * np.pi * 5.0)
    creeps: Any = [SimpleNamespace(time_s=np.array([1.0, 40.0])), SimpleNamespace(time_s=np.array([1.0, 20.0]))]
    static: Any = SimpleNamespace(age_s=100.0)
    assert identification._range_s(rings, (), None) == pytest.approx((shortest / 3, 3 * longest))
    assert identification._range_s(rings, creeps, None) == pytest.approx((shortest / 3, 120.0))
    assert identification._range_s(rings, creeps, static) == pytest.approx((shortest / 3, 300.0))
    assert identification._range_s(rings, creeps, SimpleNamespace(age_s=9.0)) == pytest.approx((shortest / 3, 120.0))  # type: ignore[arg-type]


def test_lost_frames_and_unusable_ring_downs_are_reported_and_creep_needs_no_vibration() -> None:
    time = np.repeat(np.arange(5.0)[:, None], 2, axis=1)
    motion = Motion(
        "ring_down", np.zeros((5, 2, 2)), np.zeros((2, 2)), time, 0 * time + 0.1, label="flick", lost_frames=1
    )
    loads = Loads.along([0.0])
    several = [
        motion,
        replace(motion, kind="creep", lost_frames=2, label="step"),
        replace(motion, label="", lost_frames=0),
    ]
    analysed, doubts = identification._analysed(
        [identification.RecordedMotion(one, loads) for one in several], Specimen(50.0, 5.0, 5.0, 1000.0)
    )
    assert [found for _, found in analysed] == [None, None, None]
    assert doubts[0].startswith("flick: 5 frames can be used")
    assert doubts[1:3] == ["flick: 1 frame was lost", "step: 2 frames were lost"]
    assert doubts[3].startswith("the recording: 5 frames can be used")


def test_a_motion_is_stepped_if_one_of_its_loads_was_another_one() -> None:
    motion: Any = None
    at_rest, field = Loads.along([0.0]), Loads.along([5.0])
    pulled = replace(at_rest, tip_force_N=np.array([[0.1, 0.0]]))
    turned = replace(at_rest, gravity=-at_rest.gravity)
    for before, is_stepped in ((at_rest, False), (field, True), (pulled, True), (turned, True)):
        one = identification.RecordedMotion(motion, at_rest, ((-9.0, field), (-5.0, before)))
        assert one.is_stepped is is_stepped
    assert not identification.RecordedMotion(motion, at_rest).is_stepped
    stacked = Loads.joined([at_rest, field, pulled])
    assert np.linalg.norm(stacked.field_T, axis=1) == pytest.approx([0.0, 5e-3, 0.0])
    assert stacked.tip_force_N.tolist() == [[0.0, 0.0], [0.0, 0.0], [0.1, 0.0]]
    assert stacked.gravity.shape == (3, 2)


def test_a_different_modulus_of_the_solid_is_doubted_from_two_per_cent_on() -> None:
    def doubts(ratio: float) -> list[str]:
        beam = SimpleNamespace(specimen=SimpleNamespace(section="plane-stress"))
        return identification._doubts_of_section(
            SimpleNamespace(beam=beam, solid_over_stated_modulus=lambda: ratio)  # type: ignore[arg-type]
        )

    assert doubts(1.019) == doubts(0.981) == []
    assert "would be 2.1% higher" in doubts(1.021)[0]
    assert "would be 2.1% lower" in doubts(0.979)[0]


def test_lagrange_polynomials_are_one_at_their_node_and_exact_for_parabolas() -> None:
    nodes, at = np.array([-0.2, 0.0, 0.2]), np.array([-0.2, 0.05, 0.3])
    values = _lagrange(nodes, at)
    assert values[0] == pytest.approx([1.0, 0.0, 0.0])
    assert values @ (3 - 2 * nodes + 5 * nodes**2) == pytest.approx(3 - 2 * at + 5 * at**2)
    assert _lagrange(np.zeros(1), at).tolist() == [[1.0]] * 3


def test_moduli_of_a_law_scale_with_its_shear_modulus_and_other_numbers_do_not() -> None:
    from eimi_fitting.time.ringing_beam import RingingBeam

    law = LAWS["ogden"]
    shape = np.arange(1.0, 1 + len(law.units))
    scaled = RingingBeam(Specimen(50.0, 5.0, 5.0, 1000.0), Loads.along([0.0]), law, shape).parameters(
        np.array([2.0, 3.0])
    )
    is_modulus = np.array(law.units) == "Pa"
    assert scaled == pytest.approx(np.where(is_modulus, [[2.0], [3.0]], 1.0) * shape)
