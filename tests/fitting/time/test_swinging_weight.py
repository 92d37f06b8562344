"""A weight on a thread that swings with the beam does not disturb the analysis of the vibration."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.time.channels import signals_of
from eimi_fitting.time.decay import Decay, decay_of
from eimi_fitting.time.measured import Motion

LENGTH_MM, FREQUENCY_HZ, LOSS = 100.0, 4.3, 0.09
WEIGHT = 0.68  # mass of the weight over the mass that moves with the tip


def coupled(ratio: float, sideways: float, swing_mm: float = 0.0) -> np.ndarray:
    # Return the deflection (mm) of the tip of a beam with a weight on a thread, in 500 frames, 100 in a second.
    # ratio : frequency of the pendulum divided by the frequency of the beam
    # sideways : displacement of the upper end of the thread for each mm of deflection
    # swing_mm : displacement of the weight at the release
    beam = (2 * np.pi * FREQUENCY_HZ) ** 2 * (1 + 1j * LOSS)
    pendulum = (2 * np.pi * ratio * FREQUENCY_HZ) ** 2
    # In the coordinates y sqrt(M) and x sqrt(m) the matrix is symmetric.
    root = sideways * np.sqrt(WEIGHT)
    squares, vectors = np.linalg.eig(
        np.array([[beam + pendulum * root**2, -pendulum * root], [-pendulum * root, pendulum]])
    )
    amplitudes = np.linalg.solve(vectors, np.array([4.0, swing_mm * np.sqrt(WEIGHT)], complex))
    time = np.arange(500)[:, None] / 100.0
    waves = np.exp(1j * np.sqrt(squares) * time)  # the square roots have a positive imaginary part
    return np.asarray((waves * (amplitudes * vectors[0])).sum(axis=1).real)


def analysed(tip_mm: np.ndarray) -> Decay:
    places = np.array([[94.0, 9.0], [100.0, 9.0], [100.0, -9.0]])
    points = np.repeat(places[None], len(tip_mm), axis=0)
    points[..., 1] += tip_mm[:, None] * (places[:, 0] / LENGTH_MM) ** 1.5
    points += 0.03 * np.random.default_rng(4).standard_normal(points.shape)
    time = np.repeat(np.arange(len(tip_mm))[:, None] / 100.0, 3, axis=1)
    motion = Motion("ring_down", points, places, time, np.full(time.shape, 0.03), hanging_N=0.5)
    return decay_of(signals_of(motion), "flick", LENGTH_MM, is_stepped=False, hangs=True)


@pytest.mark.parametrize(
    ("ratio", "sideways", "swing_mm"), [(0.95, 0.08, 0.0), (1.0, 0.2, 0.0), (1.0, 0.08, 1.5), (1.2, 0.2, 1.0)]
)
def test_frequency_and_loss_of_the_beam_are_found_beside_a_pendulum(
    ratio: float, sideways: float, swing_mm: float
) -> None:
    found = analysed(coupled(ratio, sideways, swing_mm))
    (mode,) = found.modes
    assert mode.frequency_Hz == pytest.approx(FREQUENCY_HZ, rel=5e-3)
    assert mode.loss == pytest.approx(LOSS, rel=0.08)
    assert abs(np.log(mode.frequency_Hz / FREQUENCY_HZ)) < 2 * np.sqrt(mode.covariance[0, 0])
    assert any("swings like a pendulum at about the frequency of the beam" in words for words in found.doubts)


def test_a_weight_that_hangs_still_causes_no_doubt() -> None:
    found = analysed(coupled(0.3, 0.0))
    assert found.doubts == ()
    assert found.modes[0].frequency_Hz == pytest.approx(FREQUENCY_HZ, rel=2e-3)
