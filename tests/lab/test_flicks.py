"""A recording of a vibrating silicone strip is divided into ring-downs (free vibrations), one for each flick."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from eimi_lab.dataset.moving.flicks import parts_of
from eimi_lab.dataset.moving.free_motion import free_motions
from eimi_lab.dataset.moving.motion_facts import MotionFacts

RATE_HZ = 120.0


def points(deflection_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    places = np.zeros((len(deflection_mm), 2, 2))
    places[:, 1, 1] = deflection_mm
    return places


def swinging(time_s: NDArray[np.float64], begins_s: float, damping: float = 0.01) -> NDArray[np.float64]:
    after = np.maximum(time_s - begins_s, 0.0)
    return (time_s >= begins_s) * 10.0 * np.exp(-2 * np.pi * 8.0 * damping * after) * np.cos(2 * np.pi * 8.0 * after)


@pytest.mark.parametrize("other_Hz", [7.1, 7.5, 8.9])
def test_two_vibrations_whose_amplitude_beats_are_one_ring_down(other_Hz: float) -> None:
    time_s = np.arange(0.0, 6.0, 1.0 / RATE_HZ)
    decay = np.exp(-np.pi * 8.0 * 0.01 * time_s)
    moved = 10.0 * decay * (np.cos(2 * np.pi * 8.0 * time_s) + 0.8 * np.cos(2 * np.pi * other_Hz * time_s))
    assert parts_of(time_s, points(moved)) == [(0, len(time_s))]


def test_a_flick_near_the_end_does_not_hide_the_ring_down_before_it() -> None:
    time_s = np.arange(0.0, 12.0, 1.0 / RATE_HZ)
    moved = np.where(time_s < 10.2, swinging(time_s, 1.0), swinging(time_s, 10.2))
    (first, last), *rest = parts_of(time_s, points(moved))
    assert time_s[first] <= 1.0
    assert 9.0 < time_s[last - 1] < 10.3
    assert len(rest) == 1


def test_a_beam_that_is_held_aside_before_its_release_is_not_at_rest() -> None:
    time_s = np.arange(0.0, 14.0, 1.0 / RATE_HZ)
    moved = swinging(time_s, 1.0)
    pulled = (time_s >= 7.0) & (time_s < 8.5)
    moved[pulled] = 10.0 * np.minimum((time_s[pulled] - 7.0) / 0.15, 1.0)
    moved[time_s >= 8.5] = swinging(time_s, 8.5)[time_s >= 8.5]
    (_, last), _ = parts_of(time_s, points(moved))
    assert time_s[last - 1] <= 7.1


@pytest.mark.parametrize("seed", range(4))
def test_noise_after_a_small_vibration_is_no_flick(seed: int) -> None:
    time_s = np.arange(0.0, 5.0, 1.0 / RATE_HZ)
    moved = 0.02 * swinging(time_s, 0.5, damping=0.05) + 0.02 * np.random.default_rng(seed).standard_normal(600)
    assert parts_of(time_s, points(moved)) == [(0, len(time_s))]


@pytest.mark.parametrize("released_s", [0.95, 1.0, 1.5])
def test_the_motion_after_a_given_release_ends_at_the_next_flick(released_s: float) -> None:
    time_s = np.arange(0.0, 12.0, 1.0 / RATE_HZ)
    places = points(np.where(time_s < 6.0, swinging(time_s, 1.0), swinging(time_s, 6.0)))
    times, sigma = np.repeat(time_s[:, None], 2, axis=1), np.full((len(time_s), 2), 0.01)
    facts = MotionFacts(kind="ring_down", released_s=released_s)
    (motion,) = free_motions(places, np.zeros((2, 2)), times, sigma, facts, "flicks")
    assert motion.time_s.min() == pytest.approx(0.0, abs=1.0 / RATE_HZ)
    assert 5.5 < motion.time_s.max() + released_s < 6.0
