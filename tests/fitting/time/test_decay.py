"""Frequency and loss of a beam are found in recorded free vibrations, also with gaps, drift and higher modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.time.channels import TooFewFrames, signals_of
from eimi_fitting.time.decay import Decay, NoVibration, decay_of
from eimi_fitting.time.measured import Motion

LENGTH_MM = 60.0


def recorded(
    frequency_Hz: float = 5.48,
    loss: float = 0.1,
    seconds: float = 6.0,
    rate_Hz: float = 60.0,
    amplitude_mm: float = 2.5,
    sigma_mm: float = 0.01,
    begins_s: float = 0.0,
    drift_mm_s: float = 0.0,
    hidden: float = 0.0,
    row_s: float = 0.0,
    rising_loss: float = 0.0,
    seed: int = 0,
) -> Motion:
    # Return the motion of ten points on a cantilever that vibrates in its first mode, released at ``begins_s``.
    # loss : loss factor
    # hidden : share of the positions that are missing (NaN)
    # row_s : time between the exposures of the first and the last point (rolling shutter)
    # rising_loss : increase of the loss factor in each second, during the first two seconds
    rng, points = np.random.default_rng(seed), 10
    x = np.linspace(6, LENGTH_MM, points)
    omega = 2 * np.pi * frequency_Hz
    frames = np.arange(int(seconds * rate_Hz)) / rate_Hz
    time = frames[:, None] + row_s * np.linspace(0, 1, points)
    since = np.maximum(time - begins_s, 0.0)
    delta = 0.5 * omega * (loss + rising_loss * np.minimum(since, 2.0))
    y = amplitude_mm * np.exp(-delta * since) * np.cos(omega * since) * (x / LENGTH_MM) ** 2
    y = y + drift_mm_s * time
    places = np.stack([x - 0.5 * y**2 / LENGTH_MM, y], axis=-1) + sigma_mm * rng.standard_normal((*y.shape, 2))
    places[rng.random(y.shape) < hidden] = np.nan
    return Motion("ring_down", places, np.column_stack([x, 0 * x]), time, np.full(y.shape, sigma_mm), label="recording")


def decay(motion: Motion, hangs: bool = False) -> Decay:
    return decay_of(signals_of(motion), "recording", LENGTH_MM, is_stepped=False, hangs=hangs)


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"hidden": 0.15},
        {"drift_mm_s": 0.1},
        {"begins_s": 1.0, "amplitude_mm": 6.0},
        {"row_s": 0.012},
        {"loss": 0.02, "seconds": 12.0},
    ],
)
def test_frequency_and_loss_are_found_within_their_uncertainty(change: dict[str, float]) -> None:
    result = decay(recorded(**change)).modes[0]
    sigma = np.sqrt(np.diag(result.covariance))
    assert abs(np.log(result.frequency_Hz / 5.48)) < max(4 * sigma[0], 5e-4)
    assert abs(result.loss - change.get("loss", 0.1)) < max(4 * sigma[1], 0.01 * result.loss)
    assert sigma[0] < 1e-3
    assert sigma[1] < 0.02 * result.loss


def test_points_that_are_hidden_for_several_periods_do_not_change_the_loss() -> None:
    motion = recorded()
    places = motion.points_mm.copy()
    places[20:60, 9], places[30:90, 8], places[100:160, 5] = np.nan, np.nan, np.nan
    result = decay(replace(motion, points_mm=places))
    assert result.modes[0].loss == pytest.approx(decay(motion).modes[0].loss, rel=1e-2)
    assert not result.doubts


def without_frames(motion: Motion, first: int, last: int) -> Motion:
    # Return a recording in which no point is seen in the frames from `first` to before `last`.
    places = motion.points_mm.copy()
    places[first:last] = np.nan
    return replace(motion, points_mm=places)


@pytest.mark.parametrize(("first", "last"), [(5, 30), (20, 40), (20, 60), (60, 120)])
def test_the_frames_after_a_gap_of_a_recording_are_used(first: int, last: int) -> None:
    result = decay(without_frames(recorded(loss=0.06), first, last))
    assert result.modes[0].frequency_Hz == pytest.approx(5.48, rel=1e-3)
    assert result.modes[0].loss == pytest.approx(0.06, rel=0.02)
    assert result.to_s > 4.0
    assert not result.doubts


def test_a_push_in_a_gap_of_a_recording_ends_the_part_that_is_used() -> None:
    motion = recorded(loss=0.1, seconds=5.0)
    again = np.where(motion.time_s[:, 0] > 2.5, 1.0, 0.0)
    again[150:] *= recorded(loss=0.1, seconds=2.5, seed=1).points_mm[:, -1, 1]
    result = decay(without_frames(disturbed(motion, again), 150, 170))
    assert result.to_s < 2.5
    assert "something moves the beam again at" in result.doubts[0]
    assert result.modes[0].loss == pytest.approx(0.1, rel=0.02)


def test_amplitudes_above_five_per_cent_of_the_length_are_left_out_and_reported() -> None:
    result = decay(recorded(amplitude_mm=9.0))
    assert result.amplitude_mm < 0.055 * LENGTH_MM
    assert "above 5% of the length" in result.doubts[0]


def test_a_hanging_weight_that_swings_leaves_only_the_first_windows() -> None:
    result = decay(recorded(rising_loss=0.02, loss=0.04), hangs=True)
    used = [window for window in result.windows if window.is_used]
    assert 0 < len(used) < len(result.windows)
    assert any("hanging weight swings like a pendulum" in words for words in result.doubts)
    assert result.modes[0].loss < 0.1


def test_noise_alone_is_no_vibration() -> None:
    with pytest.raises(NoVibration):
        decay(recorded(amplitude_mm=0.0))


def test_a_recording_of_few_frames_is_refused() -> None:
    with pytest.raises(TooFewFrames, match="at least 8 are needed"):
        decay(recorded(seconds=0.1))


def test_the_displacement_for_a_figure_lies_within_the_envelope() -> None:
    motion = recorded(frequency_Hz=16.16, loss=0.024, seconds=1.9, rate_Hz=120.0, amplitude_mm=2.0, sigma_mm=0.005)
    decay = decay_of(signals_of(motion), "flick", LENGTH_MM, is_stepped=True)
    assert (np.abs(decay.displacement_mm) < 1.1 * decay.envelope_mm + 0.1).all()
    assert np.abs(decay.displacement_mm).max() > 0.7 * decay.envelope_mm.max()


def disturbed(motion: Motion, added_mm: np.ndarray) -> Motion:
    # Return a motion in which each point also moves by `added_mm` times (s / L)², shape (n,) for n frames.
    # s: distance of the point from the clamp; L: length of the beam.
    points = motion.points_mm.copy()
    points[..., 1] += added_mm[:, None] * (motion.rest_mm[:, 0] / LENGTH_MM) ** 2
    return replace(motion, points_mm=points)


def test_frames_in_which_a_hand_still_touches_the_beam_are_left_out_and_reported() -> None:
    motion = recorded(begins_s=0.0, loss=0.06)
    time = motion.time_s[:, 0]
    pushes = np.interp(time, np.arange(0.0, 0.9, 0.07), np.random.default_rng(2).standard_normal(13))
    found = decay(disturbed(motion, np.where(time < 0.8, pushes, 0.0)))
    assert found.modes[0].frequency_Hz == pytest.approx(5.48, rel=1e-3)
    assert found.modes[0].loss == pytest.approx(0.06, rel=0.02)
    assert any("are no free vibration" in words for words in found.doubts)


def touched(from_s: float, to_s: float, loss: float = 0.6) -> Motion:
    # Return a free vibration in which a hand adds stiffness and the loss factor `loss` between two times.
    motion = recorded(rate_Hz=100.0, seconds=4.0)
    time = motion.time_s[:, 0]
    is_held = (time >= from_s) & (time < to_s)
    omega = 2 * np.pi * np.where(is_held, 6.3, 5.48)
    phase = np.cumsum((1j - 0.5 * np.where(is_held, loss, 0.1)) * omega) / 100.0
    points = motion.points_mm.copy()
    rng = np.random.default_rng(5)
    points[..., 1] = 2.5 * np.exp(phase).real[:, None] * (motion.rest_mm[:, 0] / LENGTH_MM) ** 2
    points[..., 1] += 0.01 * rng.standard_normal(points.shape[:2])
    return replace(motion, points_mm=points)


@pytest.mark.parametrize(("from_s", "to_s", "loss"), [(0.0, 0.5, 0.4), (1.0, 1.5, 0.6), (0.8, 4.0, 0.3)])
def test_only_the_part_in_which_no_hand_touches_the_beam_is_used(from_s: float, to_s: float, loss: float) -> None:
    found = decay(touched(from_s, to_s, loss))
    sigma = np.sqrt(np.diag(found.modes[0].covariance))
    assert abs(np.log(found.modes[0].frequency_Hz / 5.48)) < max(3 * sigma[0], 2e-3)
    assert abs(found.modes[0].loss - 0.1) < max(3 * sigma[1], 0.005)
    assert any("touches the beam" in words for words in found.doubts)


def test_a_ring_down_is_never_a_difference_of_two_large_vibrations() -> None:
    found = decay(touched(1.2, 1.6, 0.9))
    assert len(found.modes) == 1


def test_a_weight_that_swings_widens_the_uncertainties_of_the_beam() -> None:
    motion = recorded(seconds=8.0, loss=0.03)
    time = motion.time_s[:, 0]
    swing = 0.6 * np.exp(-0.005 * time) * np.cos(2 * np.pi * 5.0 * time)
    quiet, swinging = (decay(one, hangs=True).modes[0] for one in (motion, disturbed(motion, swing)))
    assert abs(np.log(swinging.frequency_Hz / 5.48)) < 2 * np.sqrt(swinging.covariance[0, 0])
    assert abs(swinging.loss - 0.03) < 2 * np.sqrt(swinging.covariance[1, 1])
    assert swinging.covariance[1, 1] > 4 * quiet.covariance[1, 1]
    assert quiet.covariance[0, 0] > 0.005**2


def test_the_largest_of_two_close_vibrations_is_the_first_one() -> None:
    motion = recorded(loss=0.015, amplitude_mm=0.9)
    time = motion.time_s[:, 0]
    other = 2.0 * np.exp(-0.04 * 2 * np.pi * 6.5 * time) * np.cos(2 * np.pi * 6.5 * time)
    found = decay(disturbed(motion, other))
    assert [mode.frequency_Hz for mode in found.modes] == pytest.approx([6.5, 5.48], rel=5e-3)


def test_a_vibration_near_the_first_one_is_separated_and_named() -> None:
    motion = recorded(loss=0.03)
    time = motion.time_s[:, 0]
    other = 0.8 * np.exp(-0.015 * 2 * np.pi * 6.1 * time) * np.cos(2 * np.pi * 6.1 * time)
    found = decay(disturbed(motion, other))
    assert found.modes[0].frequency_Hz == pytest.approx(5.48, rel=1e-3)
    assert any("also vibrates at 6.1 Hz" in words for words in found.doubts)


def test_a_motion_that_is_mostly_no_vibration_is_refused() -> None:
    motion = recorded(frequency_Hz=8.5, loss=0.08, rate_Hz=120.0, seconds=2.6, amplitude_mm=1.5)
    with pytest.raises(NoVibration, match="no damped vibration"):
        decay(disturbed(motion, np.where(motion.time_s[:, 0] > 0.9, 2.0, 0.0)))


def test_a_vibration_that_a_slow_camera_may_show_at_a_wrong_frequency_is_doubted() -> None:
    found = decay(recorded(frequency_Hz=20.0, rate_Hz=30.0, loss=0.02))
    assert found.modes[0].frequency_Hz == pytest.approx(10.0, rel=1e-2)
    assert any("a vibration of 20 Hz would look the same" in words for words in found.doubts)


def test_a_weak_hum_that_does_not_decay_is_not_taken_for_the_vibration() -> None:
    motion = recorded(rate_Hz=120.0, loss=0.04)
    found = decay(disturbed(motion, 0.05 * np.sin(2 * np.pi * 40.0 * motion.time_s[:, 0])))
    assert found.modes[0].frequency_Hz == pytest.approx(5.48, rel=2e-3)
