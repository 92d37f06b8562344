"""Parts of the analysis of a vibration agree with calculations by hand or with an independent formula."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import Loads, Magnet, Specimen
from eimi_fitting.time import channels, modal_fit, ringing, swinging_weight
from eimi_fitting.time.channels import Signals, TooFewFrames, signals_of
from eimi_fitting.time.decay import Decay, RingMode
from eimi_fitting.time.decay_windows import Window
from eimi_fitting.time.exposure import without_blur
from eimi_fitting.time.measured import Motion
from eimi_fitting.time.modal_fit import ModalFit, design_matrix, exponent, wave
from eimi_fitting.time.small_effects import small_effects
from eimi_fitting.time.swinging_weight import of_beam, with_swing
from eimi_fitting.time.terms import Terms


def fit(
    modes: list[tuple[float, float]], linear: list[list[float]], bend: tuple[float, float] = (0.0, 0.0)
) -> ModalFit:
    # Return the fit of a vibration in 400 frames, 100 in a second. One signal is a motion along x, the other along y.
    # modes : frequency (Hz) and loss factor of each vibration
    # linear : the first coefficients of the two signals; the units are 2 mm for the first and 3 mm for the second
    # bend : change of frequency and loss factor of the first vibration at large amplitudes
    of_modes = np.array([[np.log(2 * np.pi * f), loss] for f, loss in modes])
    time, change = np.arange(400) / 100.0, np.array(bend)
    design = design_matrix(time, of_modes, change)
    coefficients = np.zeros((design.shape[1], 2))
    coefficients[: len(linear)] = linear
    numbers = np.zeros(2, np.intp)
    reduced = design @ coefficients
    signals = Signals(time, reduced * [2.0, 3.0], np.array([2.0, 3.0]), numbers, np.arange(2), reduced, np.eye(2), 0.0)
    covariance = np.diag(np.arange(1.0, 1 + of_modes.size)) * 1e-6
    return ModalFit(signals, of_modes, change, False, 1.0, 1.0, covariance, 0 * reduced, coefficients)


def test_the_rate_of_a_vibration_that_changes_with_its_amplitude() -> None:
    time, omega, loss, (one, two) = np.linspace(0.0, 3.0, 3001), 2 * np.pi * 2.0, 0.2, (0.03, 0.05)
    psi = exponent(time, np.array([np.log(omega), loss]), np.array([one, two]))
    delta = 0.5 * loss * omega
    rate = 1j * omega - delta + (1j * one - two) * omega * np.exp(-2 * delta * time)
    assert psi[0] == 0.0
    assert np.gradient(psi, time)[1:-1] == pytest.approx(rate[1:-1], rel=1e-5)
    lossless = exponent(time, np.array([np.log(omega), 0.0]), np.array([one, two]))
    assert lossless == pytest.approx((1j * omega + (1j * one - two) * omega) * time)
    nearly = exponent(time, np.array([np.log(omega), 1e-11]), np.array([one, two]))
    assert nearly == pytest.approx(lossless, rel=1e-6)
    real, imaginary = wave(psi)
    assert real + 1j * imaginary == pytest.approx(np.exp(psi))
    assert wave(np.array([31.0 + 0j]))[0] == pytest.approx([np.exp(30.0)])  # no overflow


def test_a_design_has_the_modes_two_harmonics_a_shift_and_a_slow_motion() -> None:
    time = 5.0 + np.arange(200) / 100.0
    modes = np.array([[np.log(2 * np.pi * 3.0), 0.1], [np.log(2 * np.pi * 7.0), 0.3]])
    design = design_matrix(time, modes, np.zeros(2))
    t = time - 5.0
    first, second = (np.exp((1j - 0.5 * loss) * 2 * np.pi * f * t) for f, loss in ((3.0, 0.1), (7.0, 0.3)))
    waves = np.array([first, second, first**2, first**3])
    np.testing.assert_allclose((design[:, :8:2] + 1j * design[:, 1:8:2]).T, waves)
    assert design[:, 8] == pytest.approx(np.abs(first) ** 2)
    assert design[:, 9:].sum(axis=1) == pytest.approx(np.ones(200))


@pytest.mark.parametrize(("periods", "columns"), [(7.9, 2), (8.1, 5), (12.1, 6), (51.9, 15), (52.1, 16), (200.0, 16)])
def test_the_slow_motion_has_a_knot_for_every_four_periods(periods: float, columns: int) -> None:
    time = np.linspace(2.0, 4.0, 101)
    slow = modal_fit._baseline(time, periods / 2.0)
    assert slow.shape == (101, columns)
    x = (time - 2.0) / 2.0
    wanted = 1 + 2 * x - 3 * x**2 * (columns > 2) + x**3 * (columns > 2)
    if columns == 5:  # the middle knot lies nearer to the start, at 0.5 to the power of 1.5
        wanted = wanted + 7 * np.maximum(x - 0.5**1.5, 0.0) ** 3
    assert slow @ np.linalg.lstsq(slow, wanted, rcond=None)[0] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(("bin_", "is_near"), [(12, False), (13, True), (31, True), (32, False)])
def test_the_noise_near_a_frequency_counts_the_lines_from_three_fifths_to_eight_fifths(
    bin_: int, is_near: bool
) -> None:
    # 400 frames in 3.99 s: lines at multiples of 0.25 Hz. 19 of them lie between 3 and 8 Hz, of which the fit takes 2.
    residuals = np.cos(2 * np.pi * bin_ * np.arange(400) / 400)[:, None]
    signals = SimpleNamespace(time_s=np.arange(400) / 100.0)
    noise = modal_fit._band_noise(signals, residuals, 5.0)  # type: ignore[arg-type]
    assert noise == pytest.approx(np.sqrt(100.0 / 17) if is_near else 0.0, abs=1e-9)


def test_too_few_lines_near_a_frequency_tell_no_noise() -> None:
    signals = SimpleNamespace(time_s=np.arange(20) / 100.0)  # lines at multiples of 5 Hz
    residuals = np.random.default_rng(1).standard_normal((20, 1))
    assert modal_fit._band_noise(signals, residuals, 15.5) == 0.0  # type: ignore[arg-type]  # 10, 15 and 20 Hz
    assert modal_fit._band_noise(signals, residuals, 16.0) > 0.0  # type: ignore[arg-type]  # and 25 Hz


def test_the_misfit_of_given_modes_is_what_their_waves_leave() -> None:
    clean = fit([(5.0, 0.1)], [[1.0, 0.5], [0.3, 0.0]])
    mode = clean.modes[0]
    assert modal_fit._misfit(clean.signals, mode) == pytest.approx(0.0, abs=1e-9)
    assert modal_fit._misfit(clean.signals, mode + np.array([0.05, 0.0])) > 1.0


def test_the_vibrations_the_slow_motion_and_the_amplitude_of_a_fit_in_mm() -> None:
    one = fit([(5.0, 0.1), (8.0, 0.05)], [[3.0, 1.0], [4.0, 0.0], [0.0, 0.5], [0.0, 0.0]])
    slow = one.linear.copy()
    slow[9:] = np.arange(1.0, 1 + len(slow) - 9)[:, None]
    one = replace(one, linear=slow)
    t = one.signals.time_s
    first, second = (np.exp((1j - 0.5 * loss) * 2 * np.pi * f * t) for f, loss in ((5.0, 0.1), (8.0, 0.05)))
    of_first = np.stack([2 * (3 * first.real + 4 * first.imag), 3 * first.real], axis=1)
    of_second = np.stack([0 * t, 3 * 0.5 * second.real], axis=1)
    assert one.vibration_mm(0) == pytest.approx(of_first)
    assert one.vibration_mm(1) == pytest.approx(of_second)
    assert one.vibration_mm() == pytest.approx(of_first + of_second)
    design = design_matrix(t, one.modes, one.bend)
    assert one.slow_mm() == pytest.approx((design @ slow) * [2.0, 3.0] - of_first - of_second)
    assert one.amplitude_mm() == pytest.approx(10.0 * np.abs(first))  # 2 mm times |3 - 4 i|
    assert one.frequency_Hz == pytest.approx(5.0)
    wider = one.widened(np.array([0.1, 0.2])).covariance
    assert wider == pytest.approx(np.diag([1e-6 + 0.01, 2e-6 + 0.04, 3e-6, 4e-6]))


@pytest.mark.parametrize(
    ("ratio", "size", "cancels"), [(1.49, -0.9, True), (1.51, -0.9, False), (1.01, -0.1, False), (1.01, 0.9, False)]
)
def test_two_close_vibrations_of_opposite_sign_cancel(ratio: float, size: float, cancels: bool) -> None:
    # With a large loss, the first of two vibrations of 5 Hz and 7.45 Hz would still be near the other.
    one = fit([(5.0, 0.6), (5.0 * ratio, 0.6)], [[1.0, 0.0], [0.0, 0.0], [size, 0.0], [0.0, 0.0]])
    assert one.cancels is cancels


@pytest.mark.parametrize(
    ("bend", "is_mild"),
    [((0.049, 0.0), True), ((-0.051, 0.0), False), ((0.0, 0.099), True), ((0.0, -0.101), False)],
)
def test_a_vibration_may_change_by_a_twentieth_of_its_frequency_and_half_of_its_loss(
    bend: tuple[float, float], is_mild: bool
) -> None:
    assert fit([(5.0, 0.2)], [[1.0, 0.0]], bend).changes_little is is_mild


def squares(frequency_Hz: float, loss: float) -> complex:
    return (2 * np.pi * frequency_Hz) ** 2 * complex(1.0, loss)


def test_the_beam_without_a_swinging_weight_has_the_product_of_the_squares_over_the_exchanged_mean() -> None:
    two = fit([(4.0, 0.06), (4.4, 0.03)], [[1.0, 0.0], [0.0, 0.0], [0.5, 0.0], [0.0, 0.0]])
    one, other = squares(4.0, 0.06), squares(4.4, 0.03)
    share = one.imag / (one.imag + other.imag)
    alone = one * other / ((1 - share) * one.real + share * other.real)
    exact = replace(two, covariance=np.zeros((4, 4)))
    mode, covariance = of_beam(exact)
    assert mode == pytest.approx([0.5 * np.log(alone.real), alone.imag / alone.real])
    distance = np.log(1.1) * 1.0  # a quarter of the energy or more is in each of them
    assert np.sqrt(np.diag(covariance)) == pytest.approx([np.hypot(0.005, 0.05 * distance), 0.1 * mode[1]])
    _, widened = of_beam(two)
    at, step = two.modes.ravel(), 1e-4
    slopes = np.stack(
        [
            (swinging_weight._alone(at + step * e) - swinging_weight._alone(at - step * e)) / (2 * step)
            for e in np.eye(4)
        ],
        axis=1,
    )
    assert widened - covariance == pytest.approx(slopes @ two.covariance @ slopes.T, rel=1e-3, abs=1e-12)
    # A vibration with 5 % of the energy shortens the distance to a fifth.
    weak = replace(fit([(4.0, 0.095), (4.0 * 1.2, 0.005 / 1.44)], [[1.0, 0.0]]), covariance=np.zeros((4, 4)))
    mode, covariance = of_beam(weak)
    assert covariance[0, 0] == pytest.approx(0.005**2 + (0.05 * np.log(1.2) * 0.2) ** 2)


def test_far_apart_the_vibration_with_more_energy_is_that_of_the_beam() -> None:
    def alone(ratio: float, losses: tuple[float, float]) -> np.ndarray:
        return swinging_weight._alone(np.array([np.log(4.0), losses[0], np.log(4.0 * ratio), losses[1]]))

    assert alone(1.36, (0.1, 0.01)) == pytest.approx([np.log(4.0), 0.1])
    assert alone(1.36, (0.01, 0.1)) == pytest.approx([np.log(4.0 * 1.36), 0.1])
    assert alone(1 / 1.36, (0.1, 0.01)) == pytest.approx([np.log(4.0), 0.1])
    assert alone(1.34, (0.1, 0.01))[0] != pytest.approx(np.log(4.0), abs=1e-3)
    # A loss below zero, of a weight that gains energy, counts as none.
    assert alone(1.36, (-0.01, 0.1)) == pytest.approx([np.log(4.0 * 1.36), 0.1])


@pytest.mark.parametrize(
    ("ratio", "losses", "is_sound"),
    [
        (1.69, (0.1, 0.1), True),
        (1.71, (0.1, 0.1), False),
        (1 / 1.71, (0.1, 0.1), False),
        (1.1, (-0.019, 0.1), True),
        (1.1, (0.1, -0.021), False),
        (1.1, (0.59, 0.1), True),
        (1.1, (0.1, 0.61), False),
        (1.1, (-0.01, 0.0), False),
    ],
)
def test_two_vibrations_of_a_weight_are_close_and_lose_energy(
    ratio: float, losses: tuple[float, float], is_sound: bool
) -> None:
    two = SimpleNamespace(modes=np.array([[1.0, losses[0]], [1.0 + np.log(ratio), losses[1]]]))
    assert swinging_weight._is_sound(two) is is_sound  # type: ignore[arg-type]


def windows(first_Hz: float, second_Hz: float, loss: float) -> list[Window]:
    return [Window(0.0, 1.0, 1.0, f, loss, 1e-3, 1e-3) for f in (first_Hz, second_Hz)]


def test_a_weight_swings_if_two_vibrations_explain_the_motion_much_better(monkeypatch: pytest.MonkeyPatch) -> None:
    one = fit([(4.0, 0.05)], [[1.0, 0.0]])
    two = fit([(4.0, 0.06), (4.2, 0.03)], [[1.0, 0.0], [0.0, 0.0], [0.5, 0.0], [0.0, 0.0]])

    def swing(noise: float = 2.1, chi2: float = 24.0, seen: list[Window] | None = None) -> ModalFit | None:
        tried = iter(range(12))
        monkeypatch.setattr(
            ModalFit, "of", lambda signals, modes, bent: replace(two, chi2=chi2 if next(tried) == 5 else chi2 + 50.0)
        )
        return with_swing(replace(one, noise=noise, chi2=100.0), windows(4.0, 4.1, 0.04) if seen is None else seen)

    best = swing()
    assert best is not None
    assert best.chi2 == 24.0  # the best of twelve starts
    assert swing(chi2=26.0) is None
    assert swing(noise=1.9) is None
    # A loss that only rises, at a steady frequency, belongs to the material: `alone` has a loss of 0.09.
    alone = float(swinging_weight._alone(two.modes.ravel())[1])
    assert alone == pytest.approx(0.09, rel=0.02)
    assert swing(seen=windows(4.0, 4.039, 0.4 * alone)) is None
    assert swing(seen=windows(4.0, 4.041, 0.4 * alone)) is not None
    assert swing(seen=windows(4.0, 4.0, 0.19 * alone)) is not None
    assert swing(seen=windows(4.0, 4.0, 0.21 * alone)) is None
    assert swing(seen=windows(4.0, 4.0, 0.49 * alone)) is None
    assert swing(seen=windows(4.0, 4.0, 0.51 * alone)) is not None
    assert swing(seen=windows(4.0, 4.0, 0.4 * alone)[:1]) is not None
    two = replace(two, modes=two.modes + np.array([[0.0, 0.0], [0.06, 0.0]]))  # 11 % apart
    alone = float(swinging_weight._alone(two.modes.ravel())[1])
    assert swing(seen=windows(4.0, 4.0, 0.4 * alone)) is not None


def test_the_unknowns_of_a_viscoelastic_law_and_their_prior() -> None:
    terms = Terms(2, (0.01, 100.0), 40e3)
    times = np.log([0.1, 10.0])  # the middle of each half of four decades
    assert terms.mean == pytest.approx([np.log(40e3), np.log(0.1), np.log(0.1), *times])
    assert terms.sigma == pytest.approx([3.0, 1.5, 1.5, np.log(10.0), np.log(10.0)])
    assert replace(terms, free_times=False).sigma == pytest.approx([3.0, 1.5, 1.5, 1e-6, 1e-6])
    instantaneous, series = terms.split(np.array([[np.log(40e3), np.log(0.5), np.log(1.0), *times]]))
    assert instantaneous == pytest.approx([100e3])
    assert series.g == pytest.approx(np.array([[0.2, 0.4]]))
    assert series.tau_s == pytest.approx(np.array([[0.1, 10.0]]))
    assert series.long_term == pytest.approx([0.4])
    huge, tiny = (terms.split(np.array([[0.0, h, h, *times]]))[0][0] for h in (11.0, -31.0))
    assert (huge, tiny) == pytest.approx((1 + 2 * np.exp(10.0), 1.0))


def decay(frequency_Hz: float) -> Decay:
    mode, none = RingMode(frequency_Hz, 0.1, np.eye(2)), np.zeros(0)
    window = Window(0.0, 1.0, 2.0, frequency_Hz, 0.1, 0.1, 0.1)
    return Decay("flick", (mode,), (window,), 0.0, 1.0, 3.0, 0.0, 0.0, none, none, none, none, 1.0)


def test_an_exposure_of_up_to_three_quarters_of_a_period_is_corrected() -> None:
    true = without_blur(decay(5.0), 0.1)
    assert (true.amplitude_mm, true.windows[0].amplitude_mm) == pytest.approx((1.5 * np.pi, np.pi))  # sinc(0.5)
    for exposure_s, is_corrected in ((0.149, True), (0.152, False), (0.0, False), (None, False)):
        assert (without_blur(decay(5.0), exposure_s).amplitude_mm > 3.0) is is_corrected


def test_a_motion_is_described_by_arrays_of_the_same_size() -> None:
    points, time = np.zeros((4, 3, 2)), np.repeat(np.arange(4.0)[:, None], 3, axis=1)
    points[0, 0, 1], time[3, 1] = np.nan, np.nan
    sigma = np.ones((4, 3))
    sigma[1, 2] = np.inf
    motion = Motion("creep", points, np.zeros((3, 2)), time, sigma)
    assert np.argwhere(~motion.seen).tolist() == [[0, 0], [1, 2], [3, 1]]
    assert motion.duration_s == 3.0
    assert replace(motion, sigma_mm=np.full((4, 3), np.nan)).duration_s == 0.0
    with pytest.raises(ValueError, match="kind: 'creeping' should be ring_down or creep"):
        replace(motion, kind="creeping")  # type: ignore[arg-type]
    for name, wrong in (
        ("points_mm", points[:3]), ("rest_mm", np.zeros((2, 2))), ("sigma_mm", sigma[:, :2]), ("time_s", time[:, 0])
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"\(frames, points\)"):
            replace(motion, **{name: wrong})


def test_small_effects_of_a_beam_without_a_magnet_are_those_of_the_air() -> None:
    specimen, loads = Specimen(100.0, 10.0, 20.0, 1000.0, section="plane-stress"), Loads.along([0.0])
    mass, frequency_Hz, gain = 0.25 * 1000.0 * 0.01 * 0.02 * 0.1, 2.0, 2.0
    by_name = {e.source: e for e in small_effects(specimen, loads, frequency_Hz, 0.1, gain, 0.05)}
    added = 0.25 * np.pi / 4 * 1.2 * 0.02**2 * 0.1 / mass  # a quarter of the air in a cylinder about the depth
    assert by_name["air-mass"].modulus_percent == pytest.approx(100 * added)
    omega = 2 * np.pi * frequency_Hz
    boundary = np.sqrt(2 * 1.5e-5 / omega)
    viscous = 0.25 * np.pi * 1.2 * 0.02 * boundary * 0.1 / mass
    assert by_name["air-viscosity"].loss == pytest.approx(viscous)
    assert by_name["air-viscosity"].modulus_percent == pytest.approx(100 * viscous)
    assert by_name["exposure"].words.endswith(f"(amplitudes lower by {100 * (omega * 0.05) ** 2 / 24:.2g} %)")
    without = {e.source: e for e in small_effects(specimen, loads, frequency_Hz, 0.1, gain, None)}
    assert without["exposure"].words.endswith("(amplitudes lower by 0 %)")
    assert by_name["eddy-currents"].loss == by_name["back-emf"].loss == by_name["clamp-loss"].loss == 0.0
    silent = [e for e in by_name.values() if not e.modulus_percent]
    assert [e.source for e in silent] == ["eddy-currents", "back-emf", "exposure", "clamp-loss"]


def test_eddy_currents_and_the_coil_take_energy_from_a_turning_magnet() -> None:
    magnet = Magnet(length_mm=8.0, width_mm=4.0, depth_mm=6.0, remanence_T=1.0, density_kg_m3=7500.0)
    specimen = Specimen(104.0, 10.0, 20.0, 1000.0, section="plane-stress", magnet=magnet)
    volume = 8e-3 * 4e-3 * 6e-3
    block = 8e-3 * 4e-3 * 20e-3  # the silicone before and behind the magnet moves with it
    mass = 0.25 * 1000.0 * 0.01 * 0.02 * 0.104 + 7500.0 * volume + 1000.0 * (block - volume)
    omega, turn = 2 * np.pi * 3.0, 1.4 / 0.1
    by_name = {e.source: e for e in small_effects(specimen, Loads.along([10.0]), 3.0, 0.1, 2.0, None)}
    eddy = 6.3e5 * (0.01 * turn) ** 2 * 4e-3**2 / 20 * volume / (omega * mass)
    assert by_name["eddy-currents"].loss == pytest.approx(eddy)
    moment = volume / (4e-7 * np.pi)
    assert by_name["back-emf"].loss == pytest.approx((0.01 * moment * turn) ** 2 / 2.0 / (omega * mass))
    still = {e.source: e.loss for e in small_effects(specimen, Loads.along([0.0]), 3.0, 0.1, 2.0, None)}
    assert still["eddy-currents"] == still["back-emf"] == 0.0


def filmed(seen: np.ndarray, sigma_mm: float = 0.01, size_mm: float = 1.0) -> Motion:
    # Return a motion whose points swing with the amplitudes 1, 2, 3, ... times `size_mm`.
    # seen : whether each point is visible, shape (frames, points)
    frames, points = seen.shape
    time = np.repeat(np.arange(frames)[:, None] / 50.0, points, axis=1)
    places = np.zeros((frames, points, 2))
    places[..., 1] = size_mm * np.sin(2 * np.pi * time) * np.arange(1, points + 1)
    places[~seen] = np.nan
    return Motion("creep", places, np.zeros((points, 2)), time, np.full((frames, points), sigma_mm))


def test_points_that_are_seen_in_two_fifths_of_the_frames_are_used() -> None:
    seen = np.ones((100, 3), bool)
    seen[::5, 1], seen[1::5, 1], seen[2::5, 1] = False, False, False  # seen in 40 % of the frames
    seen[:61, 2] = False
    signals = signals_of(filmed(seen))
    assert signals.points.tolist() == [0, 0, 1, 1]
    assert signals.axis.tolist() == [0, 1, 0, 1]
    assert signals.filled == pytest.approx(0.3)
    assert signals.sigma_mm == pytest.approx([0.01] * 4)
    wave = np.sin(2 * np.pi * signals.time_s)
    assert np.ptp(signals.channels_mm[:, 1] - wave) == pytest.approx(0.0, abs=1e-9)
    assert np.ptp(signals.channels_mm[:, 3] - 2 * wave) < 1e-4  # the gaps follow from the other point
    assert signals.in_mm(signals.reduced)[:, 3] == pytest.approx(
        signals.channels_mm[:, 3] - signals.channels_mm[:, 3].mean(), abs=1e-4
    )


def test_eight_frames_are_the_fewest_and_repeated_or_early_frames_do_not_count() -> None:
    motion = filmed(np.ones((10, 2), bool))
    assert len(signals_of(motion, 0.04).time_s) == 8
    with pytest.raises(TooFewFrames, match="the recording: 7 frames can be used, but at least 8 are needed"):
        signals_of(motion, 0.05)
    time = motion.time_s.copy()
    time[5] = time[4]
    assert len(signals_of(replace(motion, time_s=time)).time_s) == 9
    mixed = np.array([3, 0, 1, 2, 4, 5, 6, 8, 7, 9])
    shuffled = replace(motion, time_s=motion.time_s[mixed], points_mm=motion.points_mm[mixed])
    assert signals_of(shuffled).channels_mm == pytest.approx(signals_of(motion).channels_mm)
    with pytest.raises(TooFewFrames, match="flick: 0 frames can be used"):
        signals_of(replace(filmed(np.zeros((10, 2), bool)), label="flick"))
    between = signals_of(motion).between(0.04, 0.1)
    assert between.time_s == pytest.approx([0.04, 0.06, 0.08, 0.1])
    assert len(between.channels_mm) == len(between.reduced) == 4


@pytest.mark.parametrize(("far", "is_replaced"), [(5.5, False), (9.5, True)])
def test_a_position_that_is_far_from_the_motion_of_the_others_is_replaced(far: float, is_replaced: bool) -> None:
    rng, time = np.random.default_rng(3), np.arange(400.0)
    motion = np.sin(np.outer(time, [0.2, 0.3, 0.5, 0.7])) @ (50.0 * rng.standard_normal((4, 20)))
    values = motion + rng.standard_normal(motion.shape)
    values[77, 3] = motion[77, 3] + far
    clean, missing = channels._filled(values)
    assert bool(missing[77, 3]) is is_replaced
    assert missing.sum() == is_replaced
    assert abs(clean[77, 3] - values[77, 3]) > 5.0 or not is_replaced


def test_as_many_signals_are_kept_as_stand_out_of_the_noise() -> None:
    rng = np.random.default_rng(5)
    frames, each = 400, np.linalg.qr(rng.standard_normal((400, 9)))[0]
    each -= each.mean(axis=0)
    patterns = np.linalg.qr(rng.standard_normal((12, 9)))[0].T
    for sizes, kept in (([100.0, 61.0, 59.0], 2), ([100.0, 50.0, 59.0], 1), ([10.0, 5.0], 1), ([90.0] * 9, 6)):
        values = (each[:, : len(sizes)] * sizes) @ patterns[: len(sizes)] + 3.0
        reduced, found = channels._reduced(values)
        assert reduced.shape == (frames, kept)
        assert found @ found.T == pytest.approx(np.eye(kept), abs=1e-9)
        assert reduced == pytest.approx((values - values.mean(axis=0)) @ found.T)


@pytest.mark.parametrize(("known", "exact"), [(6, False), (7, True)])
def test_a_gap_follows_from_the_other_channels_if_enough_values_are_known(known: int, exact: bool) -> None:
    # Two unknowns, a level and a factor, need more than three times as many known values; with fewer the gap is filled
    # by straight lines first.
    swing = 40 * np.sin(np.arange(18.0))
    whole = np.stack([swing, 3 * swing + 5], axis=1)
    values = whole.copy()
    gap = np.setdiff1d(np.arange(18), np.linspace(0, 17, known).round().astype(int))
    values[gap, 1] = np.nan
    filled, replaced = channels._filled(values)
    assert replaced.sum() == 18 - known
    assert bool(np.allclose(filled, whole, atol=1e-9)) is exact


def test_the_factors_on_the_ratios_are_found_by_six_steps_that_a_small_slope_damps() -> None:
    # The growth of ln(squared frequency) between both ratios is linear in ln(factor), with these slopes.
    slopes, wanted = np.array([1e-3, 0.5, 0.5, -0.5]), np.array([0.1, -0.2, 0.6, -0.6])
    width = np.log(1.2 / 0.9)

    def logs(x: np.ndarray, ratio: float) -> np.ndarray:
        return np.asarray(0.5 * slopes / width * (np.log(ratio) + x) ** 2)

    table: Any = object.__new__(ringing.RingTable)
    of_better = np.exp(np.stack([logs(wanted, ratio) + 0.3 for ratio in (0.9, 1.2)], axis=1))
    table.__dict__ |= {"middle_Pa": 1e4, "range_Pa": (9e3, 2e4), "_better": (np.ones(4), 1.0, of_better)}
    table._squares = lambda at, load_log, count: lambda one: np.exp(logs(np.log(one.real), 1.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ringing, "_MODES", 4)
        factors, sizes = table._correction
    # With a slope of 1e-3 each step halves the gap.
    assert np.log(factors) == pytest.approx([0.1 * (1 - 0.5**6), -0.2, 0.25, -0.25], rel=1e-4)
    assert np.log(sizes) == pytest.approx(0.3 + logs(wanted, 0.9) - logs(np.log(factors), 0.9), rel=1e-6)
