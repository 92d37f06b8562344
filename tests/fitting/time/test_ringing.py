"""Frequency and decay of a vibrating beam are interpolated correctly in a table of complex frequencies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting import LAWS, Loads, Magnet, Specimen
from eimi_fitting.beam.specimen import STANDARD_GRAVITY
from eimi_fitting.beam.vibration import Vibration
from eimi_fitting.laws.prony import Prony
from eimi_fitting.time.channels import signals_of
from eimi_fitting.time.decay import Decay, RingMode, decay_of
from eimi_fitting.time.evidence import AT_REST_S, RingEvidence, Sag, with_scatter
from eimi_fitting.time.exposure import without_blur
from eimi_fitting.time.measured import Motion
from eimi_fitting.time.ringing import RingTable
from eimi_fitting.time.ringing_beam import RingingBeam

MAGNET = Magnet(length_mm=4.0, width_mm=3.0, depth_mm=2.0, remanence_T=1.2, density_kg_m3=7500.0)
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, section="plane-stress", magnet=MAGNET)
SERIES = Prony(np.array([0.12, 0.10]), np.array([0.05, 2.0]))
AT_REST_PA = 47e3


def table(field_mT: float) -> RingTable:
    return RingTable(RingingBeam(BEAM, Loads.along([field_mT]), LAWS["neo-hookean"], np.ones(1)), 48e3)


def relaxing(s: np.ndarray) -> np.ndarray:
    return SERIES.complex_ratio(s) / float(SERIES.long_term)


def test_the_table_gives_the_roots_of_the_whole_matrices_in_a_field() -> None:
    of_table = table(7.0)
    roots = of_table.roots(np.log([AT_REST_PA]), relaxing)[0]
    vibration = Vibration(of_table.beam.planar().refined())
    motion, _ = vibration.about(
        of_table.beam.law, np.array([[AT_REST_PA]]), of_table.beam.loads, stiffenings=(1.0, 1.3, 2.0, 4.0)
    )
    expected = motion.roots(relaxing)[0]
    assert roots.imag == pytest.approx(expected.imag, rel=2e-4)
    assert roots.real == pytest.approx(expected.real, rel=1e-3)


def test_the_table_is_exact_for_a_material_that_is_eight_times_as_stiff_in_vibrations() -> None:
    strong = Prony(np.array([0.45, 0.425]), np.array([2.0, 20.0]))
    of_table = table(0.0)

    def ratio(s: np.ndarray) -> np.ndarray:
        return strong.complex_ratio(s) / float(strong.long_term)

    roots = of_table.roots(np.log([AT_REST_PA]), ratio)[0]
    vibration = Vibration(of_table.beam.planar().refined())
    motion, _ = vibration.about(
        of_table.beam.law, np.array([[AT_REST_PA]]), of_table.beam.loads, stiffenings=(1.0, 2.0, 4.0, 8.0)
    )
    expected = motion.roots(ratio)[0]
    assert abs(ratio(expected)).min() > 7.0
    assert roots.imag == pytest.approx(expected.imag, rel=3e-4)


def test_a_factor_on_the_moment_changes_a_ring_down_as_a_stronger_field_does() -> None:
    of_field, stronger = table(7.0), table(7.7)
    (root,) = of_field.roots(np.log([AT_REST_PA]), relaxing, 1, np.log([1.1]))[0]
    (expected,) = stronger.roots(np.log([AT_REST_PA]), relaxing, 1)[0]
    assert root == pytest.approx(expected, rel=5e-4)
    (unchanged,) = table(0.0).roots(np.log([AT_REST_PA]), relaxing, 1, np.log([1.1]))[0]
    assert unchanged == pytest.approx(table(0.0).roots(np.log([AT_REST_PA]), relaxing, 1)[0, 0])


def test_amplitudes_are_those_of_the_beam_and_not_of_exposed_frames() -> None:
    frequency, exposure_s, frames = 6.0, 0.05, np.arange(300)[:, None] / 60
    # Each value is the mean over an exposure, which ends at the time of the frame.
    inside = frames[..., None] - exposure_s * (np.arange(200) + 0.5) / 200
    across = np.mean(np.exp(-1.0 * inside) * np.cos(2 * np.pi * frequency * inside), axis=-1)
    places = np.stack([np.full_like(across, 30.0), across], axis=-1)
    motion = Motion(
        "ring_down", places, np.array([[30.0, 0.0]]), frames, np.full(frames.shape, 1e-3), exposure_s=exposure_s
    )
    measured = decay_of(signals_of(motion), "blurred", 30.0, is_stepped=False)
    whole = without_blur(measured, exposure_s)
    start = np.exp(-1.0 * measured.from_s + 0.5 * exposure_s)
    assert measured.amplitude_mm < 0.87 * start
    assert whole.amplitude_mm == pytest.approx(start, rel=0.01)
    assert whole.windows[0].amplitude_mm / measured.windows[0].amplitude_mm == pytest.approx(1 / np.sinc(0.3), rel=1e-3)
    assert without_blur(measured, None) is measured


def test_a_material_that_is_softer_at_rest_than_the_table_keeps_its_modulus_in_the_vibration() -> None:
    of_table = table(0.0)
    lowest = of_table.range_Pa[0]
    at_rest = lowest * np.array([1.0, 0.8])
    ratios = 60e3 / at_rest  # the modulus in the vibration is 60 kPa

    roots = of_table.roots(np.log(at_rest), lambda s: np.broadcast_to(ratios[:, None] + 0j, s.shape), 1)[:, 0]
    assert roots.imag[1] == pytest.approx(roots.imag[0], rel=1e-9)


def test_a_planar_section_of_a_thick_beam_is_compared_with_a_solid() -> None:
    cube = Specimen(60.0, 20.0, 20.0, 1070.0, section="plane-stress")
    level = Loads.along([0.0], gravity_angle_deg=-90.0)
    of_table = RingTable(RingingBeam(cube, level, LAWS["neo-hookean"], np.ones(1)), 90e3)
    share = of_table.solid_over_stated_modulus()
    solid = RingTable(RingingBeam(replace(cube, section="solid"), level, LAWS["neo-hookean"], np.ones(1)), share * 90e3)

    def frequency_Hz(one: RingTable) -> float:
        return float(one.beam.undamped_Hz(one.middle_Pa)[0] * one.solid_over_planar[0])

    assert share < 0.97
    assert frequency_Hz(solid) == pytest.approx(frequency_Hz(of_table), rel=2e-3)
    assert solid.solid_over_stated_modulus() == 1.0


def swing(frequency_Hz: float) -> Decay:
    # Return the analysis of a damped free vibration at this frequency.
    time = np.arange(400)[:, None] / 100.0
    points = np.stack([np.full(time.shape, 30.0), np.exp(-time) * np.cos(2 * np.pi * frequency_Hz * time)], axis=-1)
    motion = Motion("ring_down", points, np.array([[30.0, 0.0]]), time, np.full(time.shape, 0.01))
    return decay_of(signals_of(motion), "swing", 30.0, is_stepped=False)


@pytest.mark.parametrize(
    ("modulus_Pa", "rate", "is_doubted"),
    [(277e3, 1.0, False), (100e3, 1.0, False), (150e3, 0.5, True), (277e3, 0.25, True), (100e3, 6.0, True)],
)
def test_the_sag_of_a_level_strip_shows_a_wrong_frame_rate(modulus_Pa: float, rate: float, is_doubted: bool) -> None:
    strip = Specimen(41.0, 5.9, 10.0, 1050.0, section="plane-stress")
    level = Loads.along([0.0], gravity_angle_deg=-90.0)
    beam = RingingBeam(strip, level, LAWS["neo-hookean"], np.ones(1))
    true_Hz, model = float(beam.undamped_Hz(modulus_Pa)[0]), beam.planar()
    sagged = model.solve(beam.law, beam.parameters(np.array([0.8 * modulus_Pa])), level)
    rest_mm = np.array([[20.0, 0.0], [40.0, 0.0]])
    decay = swing(rate * true_Hz)
    places = np.repeat(model.positions(sagged, rest_mm)[0], 400, axis=0)
    time = np.repeat(np.arange(400)[:, None] / 100.0, 2, axis=1)
    motion = Motion("ring_down", places, rest_mm, time, np.full(time.shape, 0.01))
    of_table = RingTable(beam, beam.modulus_at(rate * true_Hz))
    sag = Sag.of(of_table, motion, decay)
    assert sag is not None
    doubts = sag.doubts(decay, strip.length_mm)
    assert bool(doubts) == is_doubted
    assert all("check the frame rate (is it slow motion?)" in words for words in doubts)


def test_repeated_ring_downs_share_the_error_of_the_frequencies_that_are_computed() -> None:
    of_table, elastic = table(0.0), Prony(np.zeros((1, 1)), np.ones((1, 1)))
    mode = RingMode(5.0, 0.1, np.diag([1e-14, 1e-14]))
    one = RingEvidence(of_table, swing(5.0), ((0, mode),))
    (single,) = with_scatter([one])
    several = with_scatter([one] * 4)
    rows = [ring.residuals(np.array([48e3]), elastic, np.zeros(1)) for ring in (single, *several)]
    assert [ring.repeats for ring in several] == [4] * 4
    assert sum((row**2).sum() for row in rows[1:]) == pytest.approx((rows[0] ** 2).sum(), rel=1e-4)


def test_with_a_hanging_weight_only_the_lowest_vibration_is_used() -> None:
    beam = RingingBeam(BEAM, Loads.along([0.0]), LAWS["neo-hookean"], np.ones(1))
    of_table = RingTable(beam, 48e3)
    computed = of_table.beam.undamped_Hz(48e3) * of_table.solid_over_planar
    modes = tuple(RingMode(float(f), 0.1, np.diag([1e-6, 1e-6])) for f in computed[:2])
    decay = replace(swing(float(computed[0])), modes=modes)
    assert [number for number, _ in RingEvidence.of(of_table, decay).modes] == [0, 1]
    hanging = RingTable(replace(beam, hanging_N=0.001), 48e3)
    assert [number for number, _ in RingEvidence.of(hanging, decay).modes] == [0]


def test_a_weight_on_a_thread_does_not_follow_a_motion_across_gravity() -> None:
    strip = Specimen(60.0, 4.0, 12.0, 1070.0, section="plane-stress")
    loads = replace(Loads.along([0.0]), tip_force_N=np.array([[0.02, 0.0]]))  # the strip hangs down, the weight below
    weighted = RingingBeam(strip, loads, LAWS["neo-hookean"], np.ones(1), hanging_N=0.02)
    # Across gravity a weight on a thread only pulls. Fixed to the tip, it would also add its mass.
    pulled = replace(weighted, hanging_N=0.0).undamped_Hz(60e3)[0]
    assert weighted.undamped_Hz(60e3)[0] == pytest.approx(pulled, rel=1e-6)
    fixed = Vibration(weighted.planar(), 0.02 / STANDARD_GRAVITY)
    motion, _ = fixed.about(weighted.law, np.array([[60e3]]), loads)
    of_table = RingTable(weighted, 60e3)
    assert of_table.fixed_weight_log == pytest.approx(np.log(motion.frequencies_Hz(1)[0, 0] / pulled))
    assert of_table.fixed_weight_log < -0.3


def test_the_interval_of_a_beam_with_a_hanging_weight_holds_a_fixed_weight_too() -> None:
    strip = Specimen(100.0, 30.0, 30.0, 1070.0, section="plane-stress")
    loads = replace(Loads.along([0.0], gravity_angle_deg=-90.0), tip_force_N=np.array([[0.0, -1.0]]))
    of_table = RingTable(RingingBeam(strip, loads, LAWS["neo-hookean"], np.ones(1), hanging_N=1.0), 90e3)
    fixed_Hz = float(of_table.beam.undamped_Hz(90e3)[0] * of_table.solid_over_planar[0])
    fixed_Hz *= np.exp(of_table.fixed_weight_log)
    mode = RingMode(fixed_Hz, 1e-3, np.diag([1e-8, 1e-6]))
    elastic = Prony(np.array([[1e-9]]), np.array([[1.0]]))
    residuals = RingEvidence(of_table, swing(4.0), ((0, mode),)).residuals(np.array([90e3]), elastic, np.zeros(1))
    assert of_table.fixed_weight_log < -0.01
    assert abs(residuals[0, 0]) == pytest.approx(2.0, rel=0.01)


def test_a_creeping_beam_vibrates_about_its_equilibrium_at_the_time_of_the_vibration() -> None:
    instantaneous = AT_REST_PA / SERIES.long_term
    one = Prony(SERIES.g[None], SERIES.tau_s[None])
    for field_mT, is_bent in ((0.0, False), (7.0, True)):
        of_table, decay = table(field_mT), swing(5.0)
        stepped = RingEvidence.of(of_table, decay, is_stepped=True)
        # After a step to zero field, gravity alone acts, and it has acted for long.
        age_s = decay.from_s - 1 / decay.modes[0].rate.real if is_bent else AT_REST_S
        assert stepped.age_s == pytest.approx(age_s)
        at_time = instantaneous / float(SERIES.creep(age_s))
        (root,) = of_table.roots(
            np.log([at_time]), lambda s, now=at_time: instantaneous / now * SERIES.complex_ratio(s), 1
        )[0]
        mode = RingMode(root.imag / (2 * np.pi), -2 * root.real / root.imag, np.diag([1e-10, 1e-8]))
        rows = [
            replace(ring, modes=((0, mode),)).residuals(np.array([instantaneous]), one, np.zeros(1))[0, 0]
            for ring in (stepped, RingEvidence.of(of_table, decay))
        ]
        assert abs(rows[0]) < 0.05
        assert bool(abs(rows[1]) > 3.0) is is_bent
