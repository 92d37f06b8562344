"""Functions that fit a viscoelastic law to recorded motions give the expected results for simple data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS, Loads, Specimen
from eimi_fitting.beam.coil_field import CoilShape, FieldTable
from eimi_fitting.beam.kinds_of_load import UniformField
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time import channels, identification, law_of_time
from eimi_fitting.time import decay as decays
from eimi_fitting.time.channels import Signals
from eimi_fitting.time.decay import NoVibration, decay_of
from eimi_fitting.time.decay_windows import Window, material_windows
from eimi_fitting.time.evidence import RingEvidence
from eimi_fitting.time.loaded_creep import LoadCurve, LoadStep, creep
from eimi_fitting.time.modal_fit import ModalFit, with_more_modes
from eimi_fitting.time.ringing_beam import NoEquilibrium, RingingBeam
from eimi_fitting.time.terms import Terms

NEO = LAWS["neo-hookean"]


def signals(time_s: np.ndarray, values: np.ndarray) -> Signals:
    number = np.zeros(1, np.intp)
    return Signals(time_s, values[:, None], np.ones(1), number, number, values[:, None], np.ones((1, 1)), 0.0)


def swing(time_s: np.ndarray, frequency_Hz: float, loss: float, size: float = 1.0) -> np.ndarray:
    omega = 2 * np.pi * frequency_Hz
    return np.asarray(size * np.exp(-0.5 * loss * omega * time_s) * np.cos(omega * time_s))


def test_the_frames_before_a_step_of_the_load_are_not_used() -> None:
    time = np.arange(-100, 300) / 100.0
    recorded = signals(time, np.where(time < 0, 3.0 * np.sin(70 * time), swing(time, 5.0, 0.1)))
    decay = decay_of(recorded, "step", 30.0, is_stepped=True)
    assert decay.from_s == 0.0
    assert (decay.modes[0].frequency_Hz, decay.modes[0].loss) == pytest.approx((5.0, 0.1), rel=1e-3)
    other = decay_of(recorded, "no step", 30.0, is_stepped=False)
    assert other.modes[0].frequency_Hz > 6.0


class Spring(RingingBeam):
    # A beam whose squared frequency rises with its modulus: f² = (mu - `softening`) / 1000 Pa s².

    softening = 0.0
    moduli: list[float]

    def planar(self) -> Any:
        return None

    def vibration(self, model: Any) -> Any:
        type(self).moduli = []
        return SimpleNamespace(about=self._about)

    def _about(self, law: Any, parameters: np.ndarray, loads: Any) -> Any:
        modulus = float(parameters[0, 0])
        type(self).moduli.append(modulus)
        left = modulus - type(self).softening
        frequencies = np.array([[np.sqrt(max(left, 0.0) / 1e3)]])
        return SimpleNamespace(sound=np.array([left > 0]), frequencies_Hz=lambda count: frequencies), None


@pytest.mark.parametrize(("softening", "most"), [(0.0, 2), (20e3, 12)])
def test_the_modulus_of_a_frequency_is_approached_from_stiff_beams(softening: float, most: int) -> None:
    Spring.softening = softening
    beam = Spring(Specimen(20.0, 2.0, 4.0, 1070.0), Loads.along([0.0]), NEO, np.ones(1))
    assert beam.modulus_at(5.0) == pytest.approx(25e3 + softening, rel=3e-5)
    assert Spring.moduli[0] == pytest.approx(1e6)
    assert len(Spring.moduli) <= most


@pytest.mark.parametrize(("frequency_Hz", "found"), [(0.32, True), (0.31, False), (999.0, True), (1001.0, False)])
def test_a_modulus_lies_between_100_pascal_and_1_gigapascal(frequency_Hz: float, found: bool) -> None:
    Spring.softening = 0.0
    beam = Spring(Specimen(20.0, 2.0, 4.0, 1070.0), Loads.along([0.0]), NEO, np.ones(1))
    if found:
        assert beam.modulus_at(frequency_Hz) == pytest.approx(1e3 * frequency_Hz**2)
        return
    with pytest.raises(NoEquilibrium, match=r"no shear modulus gives the beam a frequency of .* Hz: check the dimens"):
        beam.modulus_at(frequency_Hz)


def test_a_beam_has_three_frequencies_unless_more_are_asked_for() -> None:
    asked: list[int] = []

    class Counted(Spring):
        def _about(self, law: Any, parameters: np.ndarray, loads: Any) -> Any:
            return SimpleNamespace(
                sound=np.array([True]), frequencies_Hz=lambda n: asked.append(n) or np.ones((1, n))
            ), 0

    beam = Counted(Specimen(20.0, 2.0, 4.0, 1070.0, "plane-stress"), Loads.along([0.0]), NEO, np.ones(1))
    assert len(beam.undamped_Hz(5e4)) == 3
    assert len(beam.undamped_Hz(5e4, 5)) == 5
    assert asked == [3, 5]
    assert beam.section == "plane-stress"


def test_a_hanging_weight_moves_along_gravity_and_a_free_beam_has_none() -> None:
    down = Loads.along([0.0], gravity_angle_deg=30.0)
    beam = RingingBeam(Specimen(20.0, 2.0, 4.0, 1070.0, "plane-stress"), down, NEO, np.ones(1), 0.0196133)
    hanging = beam.vibration(beam.planar())
    along = np.array([np.cos(np.radians(30)), np.sin(np.radians(30))])
    assert hanging._moves_along == pytest.approx(np.outer(along, along))
    free = replace(beam, hanging_N=0.0)
    without = free.vibration(free.planar())
    assert without._moves_along.tolist() == np.eye(2).tolist()


def test_with_fewer_than_ten_free_lines_no_further_vibration_is_fitted() -> None:
    def fitted(frames: int, rate_Hz: float, other_Hz: float) -> ModalFit:
        time = np.arange(frames) / rate_Hz
        both = swing(time, 8.0, 0.05) + swing(time, other_Hz, 0.02, 0.4)
        return ModalFit.of(signals(time, both), np.array([[np.log(2 * np.pi * 8.0), 0.05]]), False)

    short, long = fitted(40, 40.0, 12.5), fitted(160, 100.0, 34.0)
    assert with_more_modes(short) is short
    more = with_more_modes(long)
    assert np.exp(more.modes[:, 0]) / (2 * np.pi) == pytest.approx([8.0, 34.0], rel=1e-3)
    assert more.modes[:, 1] == pytest.approx([0.05, 0.02], rel=0.02)
    assert more.chi2 < 1e-6 * long.chi2


def test_a_moment_is_continued_beyond_the_ends_of_its_curve() -> None:
    rotation = np.linspace(-0.2, 0.3, 9)
    one = np.ones(1)
    elastic = Prony(np.array([[1e-9]]), np.array([[1.0]]))
    for push in (60e3, -60e3):
        moment = push - 20e3 * rotation
        curve = LoadCurve(rotation, moment, moment)
        found = creep(50e3 * one, elastic, (LoadStep(0.0, curve),), np.array([1.0, 50.0]), one)
        assert found[0] == pytest.approx([push / 70e3] * 2, rel=1e-6)


def window(frequency_Hz: float, loss: float, sigma: float = 1e-4) -> Window:
    return Window(0.0, 1.0, 1.0, frequency_Hz, loss, sigma, sigma)


def test_groups_of_windows_begin_anew_where_the_vibration_has_changed() -> None:
    alike = [window(5.0, 0.1), window(5.01, 0.11), window(4.99, 0.105)]
    other = [window(5.3, 0.08), window(5.31, 0.085)]
    assert material_windows((*alike, *other), False) == slice(3, 5)
    assert material_windows((*other, *alike), False) == slice(0, 2)
    assert material_windows((*alike, *other, *alike), False) == slice(3, 5)
    assert material_windows(tuple(alike), False) == slice(0, 3)


def test_loads_are_equal_if_all_their_parts_are() -> None:
    field = np.array([[0.0, 0.001]])
    grid = np.linspace(-60.0, 60.0, 5)

    def loads(pressure_Pa: float = 0.0, background_T: float = 1e-5, gradient: float = 0.5, turn: float = 1.0) -> Loads:
        table = FieldTable(grid, grid, turn * np.ones((5, 5)))
        shape = CoilShape((0.0, 1.0), (gradient, 0.0), table)
        background = UniformField(np.array([[background_T, 0.0]]))
        return replace(Loads.along([1.0], pressure_Pa=pressure_Pa), coil=shape).plus(background)

    assert identification._same(loads(), loads())
    assert identification._same(loads(), loads(background_T=1e-5 * (1 + 1e-9)))
    changed = [loads(pressure_Pa=10.0), loads(background_T=3e-5), loads(gradient=0.6), loads(turn=1.1)]
    changed += [replace(loads(), coil=None), replace(loads(), others=()), Loads.along([1.0])]
    changed += [replace(loads(), gravity=np.zeros((1, 2))), replace(loads(), field_T=2 * field)]
    changed += [loads().plus(UniformField(field))]
    for other in changed:
        assert not identification._same(loads(), other)
        assert not identification._same(other, loads())


def test_a_table_is_used_again_for_equal_loads_and_equal_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    ratios = [1.1]  # the modulus changes by ln(1.21) = 0.19

    class Table:
        def __init__(self, beam: Any, middle_Pa: float) -> None:
            self.beam, self.middle_Pa, self.solid_over_planar = beam, middle_Pa, np.array([ratios[0], 1.0, 1.0])

    monkeypatch.setattr(identification, "RingTable", Table)
    decay: Any = SimpleNamespace(modes=[SimpleNamespace(frequency_Hz=5.0)])
    tables: list[Any] = []

    def table_for(field_mT: float, hanging_N: float) -> Any:
        loads = Loads.along([field_mT])
        beam: Any = SimpleNamespace(loads=loads, hanging_N=hanging_N, modulus_at=lambda f: 1e3 * f**2)
        recorded: Any = SimpleNamespace(loads=loads, motion=SimpleNamespace(hanging_N=hanging_N))
        return identification._table_for(recorded, decay, tables, beam)

    first = table_for(0.0, 0.0)
    assert table_for(0.0, 0.0) is first
    assert first.middle_Pa == pytest.approx(25e3)
    others = [table_for(0.0, 0.1), table_for(3.0, 0.0)]
    assert [tables.index(one) for one in (first, *others)] == [0, 1, 2]
    assert table_for(3.0, 0.0) is others[1]
    for ratio, corrected in ((1.161, 25e3), (1.163, 25e3 / 1.163**2), (1 / 1.163, 25e3 * 1.163**2)):
        tables.clear()
        ratios[0] = ratio
        assert table_for(1.0, 0.0).middle_Pa == pytest.approx(corrected)


class Line:
    # Data whose residuals are linear in the unknowns of a law with `count` terms.

    def __init__(self, slopes: np.ndarray, at: np.ndarray) -> None:
        self.slopes, self.at = slopes, at

    def residuals(self, instantaneous_Pa: np.ndarray, series: Prony, load_log: np.ndarray) -> np.ndarray:
        share = series.g / series.long_term[:, None]
        modulus = np.log(instantaneous_Pa * series.long_term)
        unknowns = np.column_stack([modulus, np.log(share), np.log(series.tau_s), load_log])
        return np.asarray((unknowns - self.at) @ self.slopes.T)

    def effects(self, sources: Any) -> dict[str, np.ndarray]:
        return {key: np.full((1, len(self.slopes)), sigma) for key, sigma in sources.items()}


def test_the_least_squares_fit_of_linear_data_is_the_solution_of_the_normal_equations() -> None:
    terms = Terms(2, (0.01, 100.0), 40e3)
    rng = np.random.default_rng(8)
    slopes = rng.normal(size=(9, 6)) * 5.0
    at = np.append(terms.mean, 0.0) + np.array([0.2, -0.3, 0.4, 0.5, -0.6, 0.02])
    problem = law_of_time.Problem(terms, (Line(slopes, at),), 0.05)
    matrix = np.concatenate([slopes, np.diag(1 / problem.sigma)])
    right = np.concatenate([slopes @ at, problem.mean / problem.sigma])
    expected = np.linalg.lstsq(matrix, right, rcond=None)[0]
    unknowns, jacobian, spent, converged = law_of_time._polished(problem, problem.mean + 0.1)
    assert unknowns == pytest.approx(expected, rel=1e-6)
    assert jacobian == pytest.approx(matrix, rel=1e-5, abs=1e-6)
    assert converged
    assert spent % 13 == 0
    optimum = law_of_time.optimum_of(problem, 2)
    assert optimum.unknowns == pytest.approx(expected, rel=1e-6)
    residuals = matrix @ expected - right
    assert optimum.chi2 == pytest.approx((residuals[:9] ** 2).sum(), rel=1e-6)
    log_det = np.linalg.slogdet(matrix.T @ matrix)[1]
    assert optimum.log_evidence == pytest.approx(
        -0.5 * ((residuals**2).sum() + log_det) - np.log(problem.sigma).sum(), rel=1e-6
    )
    covariance = np.linalg.inv(matrix.T @ matrix)
    assert optimum.covariance == pytest.approx(covariance, rel=1e-4)
    steps = optimum.steps(problem.effects({"width": 0.3}))["width"]
    assert steps == pytest.approx(-0.3 * (covariance @ slopes.T).sum(axis=1)[None], rel=1e-4)
    assert optimum.load_step(0.02) == pytest.approx(covariance[:, -1] * 0.02 / 0.05**2, rel=1e-4)
    free = optimum.with_free_load()
    assert free.problem.load_sigma == law_of_time.FREE_LOAD
    assert free.evaluations > optimum.evaluations
    assert np.isinf(problem.chi(np.full((1, 6), np.nan))[0])


def test_frequencies_are_matched_to_one_mode_each() -> None:
    table: Any = SimpleNamespace(
        beam=SimpleNamespace(
            loads=Loads.along([0.0]), hanging_N=0.0, undamped_Hz=lambda modulus: np.array([5.0, 30.0, 80.0])
        ),
        middle_Pa=5e4,
        solid_over_planar=np.ones(3),
    )

    def mode(frequency_Hz: float) -> Any:
        return SimpleNamespace(frequency_Hz=frequency_Hz, rate=complex(-1.0, 1.0))

    decay: Any = SimpleNamespace(modes=[mode(5.0), mode(31.0), mode(29.0), mode(79.0), mode(50.0)], from_s=0.0)
    numbers = [number for number, _ in RingEvidence.of(table, decay).modes]
    assert numbers == [0, 1, 2]


def test_a_gap_in_a_single_channel_is_a_straight_line() -> None:
    values = np.sin(np.arange(30.0))[:, None]
    values[10:13, 0] = np.nan
    filled, missing = channels._filled(values)
    inside = np.linspace(values[9, 0], values[13, 0], 5)[1:-1]
    assert filled[10:13, 0] == pytest.approx(inside)
    assert np.flatnonzero(missing[:, 0]).tolist() == [10, 11, 12]


def test_the_gaps_of_two_channels_follow_from_their_common_motion() -> None:
    common = 30 * np.sin(np.arange(40.0))
    values = np.stack([common, 2 * common + 1.0], axis=1)
    values[5, 0] = values[20, 1] = np.nan  # no channel is whole, so that both are filled step by step
    filled, _ = channels._filled(values)
    assert filled[5, 0] == pytest.approx(common[5], abs=0.5)
    assert filled[20, 1] == pytest.approx(2 * common[20] + 1.0, abs=0.5)


def test_the_time_of_a_frame_is_the_mean_over_its_points_without_their_delays() -> None:
    frames = np.array([0.0, 1.0, 2.0, 3.0])[:, None]
    times = frames + np.array([0.0, 0.1, 0.5])
    assert channels._frame_times(Timed(times)) == pytest.approx(frames[:, 0] + 0.1)  # type: ignore[arg-type]
    times[1, 2] += 0.3
    times[2] = np.nan
    times[3, 0] = np.inf
    expected = [0.1, 1.1 + 0.1, np.nan, 3.1]
    assert channels._frame_times(Timed(times)) == pytest.approx(expected, abs=0.06, nan_ok=True)  # type: ignore[arg-type]
    assert np.isnan(channels._frame_times(Timed(np.full((3, 2), np.nan)))).all()  # type: ignore[arg-type]
    assert channels._frame_times(Timed(np.zeros((3, 0)))).tolist() == [0.0] * 3  # type: ignore[arg-type]


@dataclass
class Timed:
    # A motion of which only the times are known.

    time_s: np.ndarray


def test_a_law_of_time_has_free_times_and_up_to_four_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []

    def stop(problems: Any, seed: int) -> Any:
        made.append((problems, seed))
        raise NoEquilibrium

    mode = SimpleNamespace(frequency_Hz=5.0, rate=complex(-1.0, 30.0))
    decay: Any = SimpleNamespace(modes=(mode,), doubts=("of the decay",))
    motion = SimpleNamespace(hanging_N=0.0, exposure_s=None)
    recorded: Any = SimpleNamespace(loads=Loads.along([0.0]), motion=motion, is_stepped=False)
    table: Any = SimpleNamespace(middle_Pa=5e4)
    ring: Any = SimpleNamespace(table=table, modes=((0, mode),), decay=decay)
    monkeypatch.setattr(identification, "_analysed", lambda motions, specimen: ([(recorded, decay)], []))
    monkeypatch.setattr(
        identification, "_table_for", lambda recorded, decay, tables, beam: tables.append(table) or table
    )
    monkeypatch.setattr(identification.RingEvidence, "of", lambda table, decay, is_stepped: ring)
    monkeypatch.setattr(identification, "with_scatter", list)
    monkeypatch.setattr(identification, "_doubts_of_section", lambda table: [])
    monkeypatch.setattr(identification, "_creeps", lambda *given: ())
    monkeypatch.setattr(identification, "_at_rest", lambda *given: (None, ()))
    monkeypatch.setattr(identification, "best_number_of_terms", stop)
    for more in ({}, {"free_times": False, "most_terms": 2, "seed": 9}):
        with pytest.raises(NoEquilibrium):
            identification.identify_time(NEO, np.array([2.0]), Specimen(20.0, 2.0, 4.0, 1070.0), (), **more)  # type: ignore[arg-type]
    (problems, seed), (fewer, other) = made
    assert [one.terms.count for one in problems] == [1, 2, 3, 4]
    assert [one.terms.count for one in fewer] == [1, 2]
    assert {one.terms.free_times for one in problems} == {True}
    assert {one.terms.free_times for one in fewer} == {False}
    assert (seed, other) == (1, 9)
    period = 1 / (2 * np.pi * 5.0)
    assert problems[0].terms.range_s == pytest.approx((period / 3, 30.0))
    assert problems[0].terms.modulus_Pa == 5e4
    assert problems[0].load_sigma == law_of_time.EXACT_LOAD
    assert problems[0].evidence == (ring,)
    monkeypatch.setattr(identification, "_analysed", lambda motions, specimen: ([(recorded, None)], ["a: too short"]))
    with pytest.raises(identification.NoRingDown, match=r"^a: too short$"):
        identification.identify_time(NEO, np.array([2.0]), Specimen(20.0, 2.0, 4.0, 1070.0), ())
    monkeypatch.setattr(identification, "_analysed", lambda motions, specimen: ([], []))
    with pytest.raises(identification.NoRingDown, match="no recorded motion is given, but at least one ring-down"):
        identification.identify_time(NEO, np.array([2.0]), Specimen(20.0, 2.0, 4.0, 1070.0), ())


def test_noise_shows_no_vibration_in_the_range_of_the_recording() -> None:
    time = np.arange(400) / 100.0
    noise = np.random.default_rng(6).standard_normal(400)
    with pytest.raises(
        NoVibration, match=r"^still: no vibration from 0\.63 to 40 Hz is clearly larger than the noise; r"
    ):
        decay_of(signals(time, noise), "still", 30.0, is_stepped=True)


def test_the_warnings_about_a_part_of_a_ring_down_have_its_numbers() -> None:
    windows = tuple(Window(float(i), i + 1.0, 1.0, 5.0 + 0.1 * i, 0.05 * (i + 1), 1e-3, 1e-3) for i in range(4))
    hanging = decays._change_in_words(windows, slice(0, 2), "flick", True)
    assert hanging.startswith("flick: the loss rises from 0.05 to 0.2 while the amplitude falls")
    assert hanging.endswith("only the first 2 s were used")
    first = decays._change_in_words(windows, slice(0, 2), "flick", False)
    assert (
        "from 0 to 2 s the beam vibrates at 5 Hz with a loss factor of 0.05, but next to this part at 5.2 Hz" in first
    )
    last = decays._change_in_words(windows, slice(2, 4), "flick", False)
    assert (
        "from 2 to 4 s the beam vibrates at 5.2 Hz with a loss factor of 0.15, but next to this part at 5.1 Hz with"
        in last
    )
    assert last.split("5.1 Hz with ")[1].startswith("0.1, ")
    two: Any = SimpleNamespace(modes=np.array([[np.log(2 * np.pi * 4.0), 0.1], [np.log(2 * np.pi * 4.567), 0.1]]))
    assert decays._swing_in_words(two, "flick").startswith("flick: the beam vibrates at 4 and at 4.567 Hz, as when")
