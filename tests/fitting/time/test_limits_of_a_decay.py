"""A fitted free vibration is accepted, doubted or refused exactly at the stated limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.time import decay as decays
from eimi_fitting.time.channels import Signals
from eimi_fitting.time.decay import NoVibration
from eimi_fitting.time.decay_checks import doubts_of, is_better, refusal_of, spoilt_until_s, unexplained_share
from eimi_fitting.time.decay_windows import Window, material_windows, scatter_of, windows_of
from eimi_fitting.time.modal_fit import ModalFit, design_matrix

FREQUENCY_HZ = 5.0


def signals(values_mm: np.ndarray, rate_Hz: float = 100.0) -> Signals:
    # Return the signals of one coordinate of one point, with the values (n,) in mm and a stated noise of 1 mm.
    values, one = np.asarray(values_mm, float)[:, None], np.ones(1)
    number = np.zeros(1, np.intp)
    return Signals(np.arange(len(values)) / rate_Hz, values, one, number, number, values, np.ones((1, 1)), 0.0)


def fit(
    share: float = 0.0,
    *,
    frames: int = 400,
    rate_Hz: float = 100.0,
    loss: float = 0.05,
    noise: float = 5.0,
    size: tuple[float, float] = (1.0, 0.0),
    second: tuple[float, float] | None = None,
    bend: tuple[float, float] | None = None,
) -> ModalFit:
    # Return a fit of a vibration at 5 Hz whose residuals are `share` times the vibration (root mean squares).
    # size : factors of cosine and sine
    # second : frequency ratio and cosine factor of a second vibration
    # bend : change of frequency and loss factor of the first vibration at large amplitudes
    modes = np.array([[np.log(2 * np.pi * FREQUENCY_HZ), loss]])
    if second:
        modes = np.concatenate([modes, [[modes[0, 0] + np.log(second[0]), loss]]])
    change = np.array(bend or (0.0, 0.0))
    design = design_matrix(np.arange(frames) / rate_Hz, modes, change)
    linear = np.zeros((design.shape[1], 1))
    linear[:2, 0] = size
    if second:
        linear[2] = second[1]
    vibration = design @ linear
    residuals = share * (vibration - vibration.mean()).std() * np.where(np.arange(frames) % 2, 1.0, -1.0)[:, None]
    recorded = signals((vibration + residuals)[:, 0], rate_Hz)
    count = modes.size + 2 * (bend is not None)
    return ModalFit(recorded, modes, change, bend is not None, 1.0, noise, 1e-6 * np.eye(count), residuals, linear)


def test_the_unexplained_share_is_that_of_the_residuals() -> None:
    assert unexplained_share(fit(0.3)) == pytest.approx(0.3)
    assert unexplained_share(fit(0.3, second=(1.4, 0.7))) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("share", "noise", "is_refused"), [(0.59, 5.0, False), (0.61, 5.0, True), (0.61, 3.9, False), (0.61, 4.1, True)]
)
def test_a_fit_that_leaves_most_of_the_motion_unexplained_is_refused(
    share: float, noise: float, is_refused: bool
) -> None:
    refusal = refusal_of(fit(share, noise=noise), "flick")
    assert (refusal is not None) is is_refused
    assert refusal is None or "flick: the motion is no damped vibration of the beam: 61% of it differs" in refusal


@pytest.mark.parametrize(
    ("share", "noise", "is_doubted"), [(0.09, 5.0, False), (0.11, 5.0, True), (0.11, 3.9, False), (0.11, 4.1, True)]
)
def test_a_tenth_of_the_motion_that_is_unexplained_is_doubted(share: float, noise: float, is_doubted: bool) -> None:
    doubts = doubts_of(fit(share, noise=noise), "flick")
    assert [words[:41] for words in doubts] == ["flick: 11% of the motion differs from dam"] * is_doubted


def test_fewer_than_four_frames_in_a_period_are_doubted() -> None:
    assert doubts_of(fit(rate_Hz=20.5), "flick") == []
    (words,) = doubts_of(fit(rate_Hz=19.5), "flick")
    assert "only 3.9 frames show one period of 5 Hz" in words
    assert "a vibration of 14.5 Hz would look the same at 19.5 frames per second" in words


@pytest.mark.parametrize(
    ("ratio", "size", "hangs", "is_doubted"),
    [
        (2.45, 0.5, False, True),
        (2.55, 0.5, False, False),
        (1.4, 0.09, False, False),
        (1.4, 0.11, False, True),
        (1.4, 0.5, True, False),
    ],
)
def test_a_second_vibration_below_the_first_overtone_is_named(
    ratio: float, size: float, hangs: bool, is_doubted: bool
) -> None:
    doubts = doubts_of(fit(second=(ratio, size)), "flick", hangs)
    expected = f"flick: the beam also vibrates at {5 * ratio:.4g} Hz, with {size:.0%} of the amplitude of the vibration"
    assert [words.startswith(expected) for words in doubts] == [True] * is_doubted


def disturbed(first: int, last: int, size: float, later: float = 1e-3, frames: int = 400) -> ModalFit:
    # Return a fit of an undamped vibration, with residuals of `size` in the frames from `first` to before `last`. The
    # residuals of the other frames are `later`. The vibration has 20 frames in a period and a root mean square of 1.
    steady = fit(loss=0.0, size=(np.sqrt(2.0), 0.0), frames=frames)
    residuals = np.full((frames, 1), later)
    residuals[first:last] = size
    return replace(steady, residuals=residuals)


def test_a_disturbed_start_ends_two_quiet_periods_before_the_motion_that_is_used() -> None:
    # The mean over a period of 20 frames makes the disturbance longer by half a period.
    assert spoilt_until_s(disturbed(0, 60, 0.5)) == pytest.approx(0.80)
    assert spoilt_until_s(disturbed(0, 60, 0.059)) is None
    assert spoilt_until_s(disturbed(0, 60, 0.061)) is not None
    assert spoilt_until_s(disturbed(0, 60, 0.1, 0.024)) is not None
    assert spoilt_until_s(disturbed(0, 60, 0.1, 0.026)) is None  # less than four times the later residuals
    assert spoilt_until_s(disturbed(0, 140, 0.5)) == pytest.approx(1.60)
    assert spoilt_until_s(disturbed(0, 141, 0.5)) is None  # more than 40 % of the frames
    assert spoilt_until_s(disturbed(48, 60, 0.5)) == pytest.approx(0.80)
    assert spoilt_until_s(disturbed(49, 60, 0.5)) is None  # it begins after the first two periods
    assert spoilt_until_s(disturbed(0, 20, 0.5, frames=120)) == pytest.approx(0.40)
    assert spoilt_until_s(disturbed(0, 20, 0.5, frames=119)) is None  # fewer than six periods


def test_the_later_frames_alone_are_used_if_they_leave_much_less_unexplained() -> None:
    assert is_better(fit(0.059), fit(0.1))
    assert not is_better(fit(0.061), fit(0.1))


def window(
    frequency_Hz: float = 5.0, loss: float = 0.1, sigma_Hz: float = 1e-3, sigma: float = 1e-3, mm: float = 1.0
) -> Window:
    return Window(0.0, 1.0, mm, frequency_Hz, loss, sigma_Hz, sigma)


@pytest.mark.parametrize(
    ("loss", "sigma", "used"), [(0.119, 1e-3, 3), (0.121, 1e-3, 1), (0.14, 0.01, 3), (0.145, 0.01, 1)]
)
def test_with_a_hanging_weight_the_windows_before_the_loss_rises_are_used(loss: float, sigma: float, used: int) -> None:
    windows = (window(sigma=sigma), window(loss=loss, sigma=sigma), window(loss=loss, sigma=sigma))
    assert material_windows(windows, hangs=True) == slice(0, used)


@pytest.mark.parametrize(
    ("other", "used"),
    [
        (window(5.14), slice(0, 4)),
        (window(5.16), slice(0, 2)),
        (window(4.84), slice(0, 2)),
        (window(5.16, sigma_Hz=0.031), slice(0, 2)),
        (window(5.16, sigma_Hz=0.033), slice(0, 4)),  # within five standard deviations
        (window(loss=0.199), slice(0, 4)),
        (window(loss=0.201), slice(0, 2)),
        (window(loss=0.049), slice(2, 4)),  # a touch adds loss: the windows with the smaller loss are used
        (window(loss=0.051), slice(0, 4)),
        (window(loss=0.21, sigma=0.021), slice(0, 2)),
        (window(loss=0.21, sigma=0.023), slice(0, 4)),
    ],
)
def test_windows_that_differ_more_than_a_material_allows_are_not_used_together(other: Window, used: slice) -> None:
    assert material_windows((window(), window(), other, other), hangs=False) == used


def test_fewer_than_two_windows_are_used_as_they_are() -> None:
    assert material_windows((), hangs=False) == slice(0, 0)
    assert material_windows((window(),), hangs=True) == slice(0, 1)


def test_of_two_groups_of_windows_the_one_with_the_surely_smaller_loss_is_used() -> None:
    # 0.120 + 2 / sqrt(12 500) = 0.138 for the first two, weighted by their variances; 0.130 + 2 x 0.001 for the last.
    first = (window(5.0, 0.10, sigma=0.01), window(5.0, 0.20, sigma=0.02))
    assert material_windows((*first, window(6.0, 0.13)), hangs=False) == slice(2, 3)
    assert material_windows((*first, window(6.0, 0.137)), hangs=False) == slice(0, 2)


def test_the_scatter_of_the_windows_is_the_largest_deviation_beyond_two_standard_deviations() -> None:
    mode = np.array([np.log(2 * np.pi * 5.0), 0.1])
    windows = (window(), window(5.05, 0.12, 0.01, 0.004), window(6.0, 0.5, mm=0.19), window(5.5, 0.3, mm=0.21))
    assert scatter_of(windows[:3], 3, mode) == pytest.approx([np.log(1.01) - 0.02 / 5.05, 0.012])  # the third is small
    assert scatter_of(windows, 4, mode) == pytest.approx([np.log(1.1) - 0.002 / 5.5, 0.198])
    # Half of the change to the first window that is not used counts, too.
    assert scatter_of(windows, 2, mode) == pytest.approx([0.5 * np.log(6.0 / 5.05), 0.19])
    assert scatter_of((), 0, mode) == pytest.approx([0.0, 0.0])


def vibration(seconds: float, loss: float, rate_Hz: float = 100.0, size: float = 1.0) -> Signals:
    time = np.arange(round(seconds * rate_Hz)) / rate_Hz
    omega = 2 * np.pi * FREQUENCY_HZ
    return signals(size * np.exp(-0.5 * loss * omega * time) * np.cos(omega * time), rate_Hz)


@pytest.mark.parametrize(
    ("seconds", "loss", "rate_Hz", "count"),
    [
        (6.0, 0.1, 100.0, 8),  # the amplitude halves 14 times
        (4.0, 0.03, 100.0, 3),  # 2.7 times
        (4.0, 0.005, 100.0, 2),  # not once
        (1.3, 0.1, 100.0, 2),  # 2.9 times, but the recording has two windows of 2.5 periods
        (3.0, 0.05, 16.0, 3),  # 3.4 times, in 48 frames
        (3.0, 0.06, 14.0, 3),  # 4 times, but with fewer than 12 frames in a window
    ],
)
def test_a_ring_down_has_a_window_for_each_halving_of_its_amplitude(
    seconds: float, loss: float, rate_Hz: float, count: int
) -> None:
    recorded = vibration(seconds, loss, rate_Hz)
    windows = windows_of(ModalFit.first_of(recorded, FREQUENCY_HZ))
    assert len(windows) == count
    ends = np.linspace(recorded.time_s[0], recorded.time_s[-1], count + 1)
    for one, first, last in zip(windows, ends[:-1], ends[1:], strict=True):
        assert (one.from_s, one.to_s) == pytest.approx((first, last))
        assert one.frequency_Hz == pytest.approx(FREQUENCY_HZ, rel=1e-4)
        assert one.loss == pytest.approx(loss, rel=1e-2)
        decayed = np.exp(-0.5 * loss * 2 * np.pi * FREQUENCY_HZ * 0.5 * (first + last))
        assert one.amplitude_mm == pytest.approx(decayed, rel=0.03)


def at_times(time_s: np.ndarray) -> Signals:
    return replace(signals(np.zeros(len(time_s))), time_s=time_s)


@pytest.mark.parametrize(("factor", "before", "left"), [(2.9, 40, 61), (3.1, 40, 41), (3.1, 11, 12), (3.1, 10, 21)])
def test_frames_that_become_three_times_as_rare_are_not_used(factor: float, before: int, left: int) -> None:
    gaps = np.repeat([0.01, 0.01 * factor], [before, 20 if before == 40 else 11 if before == 11 else 10])
    assert len(decays._dense(at_times(np.append(0.0, np.cumsum(gaps)))).time_s) == left


def test_a_vibration_counts_as_lasting_if_its_power_hardly_falls() -> None:
    time = np.arange(400) / 100.0
    for ratio, is_lasting in ((0.79, 0.0), (0.81, 1.0)):
        wave = np.cos(2 * np.pi * 10.0 * time) * np.where(time < 2.0, 1.0, np.sqrt(ratio))
        assert decays._lasting(wave[:, None], 400)[40] == is_lasting


@pytest.mark.parametrize(("ratio", "shown"), [(1.0, 1.0), (1.25, np.exp(-0.5)), (0.75, np.exp(-0.5)), (2.0, 3e-4)])
def test_the_envelope_shows_the_vibrations_near_a_frequency(ratio: float, shown: float) -> None:
    time = np.arange(400) / 100.0
    at_s, size = decays._envelope(signals(2.0 * np.cos(2 * np.pi * FREQUENCY_HZ * ratio * time)), FREQUENCY_HZ)
    assert at_s == pytest.approx(time)
    assert size[150:250] == pytest.approx(2.0 * shown, rel=0.02, abs=0.01)


def test_a_rise_to_three_times_the_amplitude_within_one_and_a_half_periods_is_abrupt() -> None:
    def size(low_at: int, low: float = 0.33) -> np.ndarray:
        values = np.full(200, 0.5)
        values[low_at], values[120] = low, 1.0
        return values

    assert decays._rises_abruptly(size(90), 100, 20.0)
    assert not decays._rises_abruptly(size(89), 100, 20.0)
    assert not decays._rises_abruptly(size(90, 0.34), 100, 20.0)
    assert decays._rises_abruptly(size(90), 60, 20.0)  # the peak is searched in the next three periods
    assert not decays._rises_abruptly(size(90), 59, 20.0)


def test_frames_in_which_the_vibration_is_lost_in_the_noise_are_left_out() -> None:
    # exp(-0.05 omega t) with omega = 31.4 / s falls to 0.4 times the residuals.
    long = fit(loss=0.1, frames=600)
    for noise, last_s in ((0.01, np.log(250) / (np.pi / 2)), (0.02, np.log(125) / (np.pi / 2)), (0.2, 3.0)):
        kept = decays._without_end(long.signals, replace(long, residuals=np.full((600, 1), noise)))
        assert kept.time_s[-1] == pytest.approx(last_s, abs=0.011)  # at least fifteen periods are kept
    both = replace(fit(loss=0.1, frames=600, size=(0.5, -0.5)), residuals=np.full((600, 1), 0.01))
    assert decays._without_end(both.signals, both).time_s[-1] == pytest.approx(np.log(250) / (np.pi / 2), abs=0.011)


@pytest.mark.parametrize(
    ("bend", "doubts"),
    [((0.009, 0.0), 0), ((0.011, 0.0), 1), ((-0.011, 0.0), 1), ((0.0, 0.0024), 0), ((0.0, 0.0026), 1)],
)
def test_a_vibration_that_changes_with_its_amplitude_is_reported(bend: tuple[float, float], doubts: int) -> None:
    found = decays._result(fit(bend=bend), (), "flick", [], hangs=False)
    assert (found.frequency_change, found.loss_change) == pytest.approx((bend[0], 2 * bend[1]))
    assert len(found.doubts) == doubts


def test_the_result_describes_the_channel_that_moves_most() -> None:
    found = decays._result(fit(size=(3.0, -4.0), loss=0.1), (window(),), "flick", ["touched"], hangs=False)
    time = np.arange(400) / 100.0
    size = 5.0 * np.exp(-0.05 * 2 * np.pi * FREQUENCY_HZ * time)
    assert found.modes[0].frequency_Hz == pytest.approx(FREQUENCY_HZ)
    assert found.modes[0].rate == pytest.approx((-0.05 + 1j) * 2 * np.pi * FREQUENCY_HZ)
    assert found.envelope_mm == pytest.approx(size)
    assert found.displacement_mm == pytest.approx(found.modelled_mm)
    assert (np.abs(found.modelled_mm) <= size + 1e-9).all()
    assert found.baseline_mm == pytest.approx(np.zeros((400, 1)), abs=1e-12)
    assert (found.from_s, found.to_s, found.amplitude_mm) == pytest.approx((0.0, 3.99, 5.0))
    assert (found.label, found.doubts, found.noise) == ("flick", ("touched",), 5.0)


def test_a_vibration_that_grows_or_hardly_swings_is_no_decay() -> None:
    for loss in (0.0, -0.01, 1.51):
        with pytest.raises(NoVibration, match=r"flick: the vibration at 5 Hz does not decay; the hanging weight"):
            decays._result(fit(loss=loss), (), "flick", [], hangs=True)
    assert decays._result(fit(loss=1.49), (), "flick", [], hangs=False).modes[0].loss == 1.49
    (doubt,) = decays._result(fit(), (window(),), "flick", [], hangs=True).doubts
    assert doubt.endswith("too short to show whether the hanging weight swings like a pendulum")
    assert decays._result(fit(), (window(), window()), "flick", [], hangs=True).doubts == ()


def test_the_fit_begins_half_a_period_after_the_largest_amplitude_and_at_a_known_step_at_once() -> None:
    recorded = vibration(4.0, 0.05, size=1.0)
    first, last, doubts = decays._segment(recorded, FREQUENCY_HZ, 60.0, "flick", False)
    largest = int(np.argmax(decays._envelope(recorded, FREQUENCY_HZ)[1]))
    assert (first, last, doubts) == (pytest.approx(largest / 100 + 0.1), pytest.approx(3.99), [])
    assert decays._segment(recorded, FREQUENCY_HZ, 60.0, "flick", True)[0] == 0.0


def test_only_amplitudes_up_to_a_twentieth_of_the_length_are_fitted() -> None:
    recorded = vibration(4.0, 0.05, size=6.0)
    first, _, (doubt,) = decays._segment(recorded, FREQUENCY_HZ, 60.0, "flick", True)
    assert 6.0 * np.exp(-0.025 * 2 * np.pi * FREQUENCY_HZ * first) == pytest.approx(3.0, rel=0.03)
    assert f"in the first {first:.2g} s the amplitude is up to" in doubt
    with pytest.raises(NoVibration, match=r"stays above 0\.15 mm, which is 5% of the beam's length"):
        decays._segment(vibration(4.0, 0.001), FREQUENCY_HZ, 3.0, "flick", True)


def test_a_short_ring_down_is_refused_with_its_number_of_periods() -> None:
    with pytest.raises(NoVibration, match=r"the vibration at 5 Hz has 4\.5 such periods in 90 frames"):
        decays.decay_of(vibration(0.9, 0.05), "flick", 60.0, is_stepped=True)
    assert decays.decay_of(vibration(1.2, 0.05), "flick", 60.0, is_stepped=True).modes[0].frequency_Hz == pytest.approx(
        FREQUENCY_HZ, rel=1e-3
    )
    with pytest.raises(NoVibration, match=r"the recording of 0\.03 s is too short to show a vibration"):
        decays._first_frequency(vibration(0.04, 0.05), "flick")


def test_a_second_push_ends_the_part_that_is_fitted_one_and_a_half_periods_before_it() -> None:
    time = np.arange(600) / 100.0
    omega = 2 * np.pi * FREQUENCY_HZ
    since = np.where(time < 3.0, time, time - 3.0)
    pushed = signals(np.exp(-0.05 * omega * since) * np.cos(omega * time))
    first, last, (doubt,) = decays._segment(pushed, FREQUENCY_HZ, 60.0, "flick", True)
    at_s, size = decays._envelope(pushed, FREQUENCY_HZ)
    falling = np.minimum.accumulate(size)
    least = max(10 * np.quantile(size, 0.05), 0.1 * size.max())
    rises = np.flatnonzero((size > 2 * falling) & (size > least) & (at_s > 0.4))
    abrupt = next(k for k in rises if decays._rises_abruptly(size, int(k), 20.0))
    assert 2.7 < at_s[abrupt] < 3.05
    assert (first, last) == pytest.approx((0.0, at_s[abrupt - 31]))
    assert doubt == f"flick: something moves the beam again at {at_s[abrupt - 30]:.3g} s; later frames are not used"
