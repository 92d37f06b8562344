"""The settling statistic (difference of two frames divided by the noise) is 1 at rest and grows with motion."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from eimi_drivers.interfaces import Frame
from eimi_lab.acquisition.settling import wait_until_settled
from eimi_lab.config.protocol import Settle
from eimi_lab.vision.settling_statistic import edge_band, edge_pixels, measure_noise


def camera(rng: np.random.Generator, shift_px: float, electrons: float = 10_000.0) -> np.ndarray:
    # Return a frame, (200, 300), uint8, of a dark beam with blurred edges, with shot noise.
    # shift_px: displacement of the beam. electrons: number at full scale, which determines the noise.
    x = np.arange(300) - shift_px
    light = 0.8 * (1 - 0.2 * (x / 300) ** 2)
    beam = 0.06 + 0.94 / (1 + np.exp(-(np.abs(x - 150) - 37) / 0.6))
    share = np.tile(light * beam, (200, 1))
    counted = rng.normal(share * electrons, np.sqrt(share * electrons))
    return np.clip(np.rint(counted / electrons * 255), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("electrons", [2_500.0, 10_000.0])
def test_the_settling_ratio_is_one_at_rest(electrons: float) -> None:
    rng = np.random.default_rng(1)
    noise = measure_noise([camera(rng, 0.0, electrons) for _ in range(8)])
    ratios = [noise.difference_ratio(camera(rng, 5.3, electrons), camera(rng, 5.3, electrons)) for _ in range(10)]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)
    assert max(ratios) < 1.15


@pytest.mark.parametrize("number", [2, 3, 4])
def test_the_settling_ratio_is_one_at_rest_in_front_of_an_even_light(number: int) -> None:
    rng = np.random.default_rng(7)
    light = np.where(np.abs(np.arange(300) - 150) < 37, 20.0, 180.0)
    frames = [np.rint(light + rng.normal(0.0, 2.0, (200, 300))).astype(np.uint8) for _ in range(number + 2)]
    ratio = measure_noise(frames[:number]).difference_ratio(*frames[-2:], np.arange(frames[0].size))
    assert ratio == pytest.approx(1.0, abs=0.04)


def test_the_estimated_noise_is_the_shot_noise() -> None:
    rng = np.random.default_rng(2)
    noise = measure_noise([camera(rng, 0.0) for _ in range(8)])
    expected = (
        255 / 10_000 * noise.levels + 1 / 12
    )  # variance of the electron count in grey levels, and of the rounding
    assert noise.variances == pytest.approx(expected, rel=0.1)


def test_motion_increases_the_settling_ratio_above_one() -> None:
    rng = np.random.default_rng(3)
    noise = measure_noise([camera(rng, 0.0) for _ in range(8)])
    ratios = [noise.difference_ratio(camera(rng, 0.0), camera(rng, shift)) for shift in (0.05, 0.1, 0.2, 0.5)]
    assert ratios == sorted(ratios)
    assert ratios[1] > 1.2
    assert ratios[3] / ratios[2] == pytest.approx(0.5**2 / 0.2**2, rel=0.35)


def test_the_compared_band_of_pixels_lies_along_the_edges() -> None:
    rng = np.random.default_rng(4)
    band = edge_band(camera(rng, 0.0))
    columns = np.flatnonzero(band.mean(axis=0) > 0.5)
    assert set(columns) <= {*range(105, 122), *range(179, 196)}
    assert {113, 187} <= set(columns)


def band_of_the_whole_picture(image: np.ndarray) -> np.ndarray:
    # Return a mask of the pixels within 4 px of gradients above a quarter of the largest one.
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.5)
    steepness = cv2.magnitude(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
    steep = (steepness >= 0.25 * steepness.max()).astype(np.uint8)
    return cv2.dilate(steep, np.ones((9, 9), np.uint8)).astype(bool)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_the_band_is_that_of_the_whole_picture_although_parts_are_left_out(dtype: type) -> None:
    rng = np.random.default_rng(8)
    scale = {np.uint8: 1, np.uint16: 257, np.float32: 1 / 255}[dtype]
    for number in range(60):
        height, width = rng.integers(1, 300, 2)
        image = 120 + rng.normal(0.0, (0.5, 2.0, 20.0)[number % 3], (height, width))
        image += np.linspace(0, rng.integers(1, 40), width)
        for _ in range(number % 4):  # rectangles, also at the borders of the picture
            top, left = rng.integers(0, height), rng.integers(0, width)
            image[top : top + rng.integers(1, 150), left : left + rng.integers(1, 150)] += rng.integers(-90, 90)
        if number % 2:  # a bent beam
            middle = width * rng.uniform(0, 1) + rng.uniform(-1, 1) * np.arange(height)[:, None] ** 2 / 300
            image[np.abs(np.arange(width) - middle) < width / 20] -= 60
        image = (np.clip(image, 0, 255) * scale).astype(dtype)
        np.testing.assert_array_equal(edge_band(image), band_of_the_whole_picture(image), f"{image.shape}")
    assert edge_band(np.full((70, 70), 9, dtype)).shape == (70, 70)


def test_a_stored_band_of_pixels_gives_the_same_ratio() -> None:
    rng = np.random.default_rng(5)
    noise = measure_noise([camera(rng, 0.0) for _ in range(8)])
    earlier, later = camera(rng, 0.0), camera(rng, 0.1)
    exact = noise.difference_ratio(earlier, later)
    assert noise.difference_ratio(earlier, later, edge_pixels(later)) == exact
    assert noise.difference_ratio(earlier.astype(np.float32), later.astype(np.float32)) == pytest.approx(
        exact, rel=1e-12
    )


class Swinging:
    # A replacement for a camera and a clock; `shifts_px` is the displacement of the beam in each frame.

    def __init__(self, shifts_px: list[float]) -> None:
        self._rng, self._shifts_px, self.taken = np.random.default_rng(6), shifts_px, 0

    def now(self) -> float:
        return self.taken * 0.1

    def flush(self) -> None:
        """Do nothing, because no frame is buffered."""

    def grab(self, timeout_s: float) -> Frame:
        shift_px = self._shifts_px[min(self.taken, len(self._shifts_px) - 1)]
        self.taken += 1
        return Frame(camera(self._rng, shift_px), self.taken, self.now())


def test_a_beam_that_has_left_the_stored_band_of_pixels_does_not_count_as_at_rest() -> None:
    rng = np.random.default_rng(7)
    noise = measure_noise([camera(rng, 0.0) for _ in range(8)])
    moving = [0.0, 5.0, *(60.0 + 0.6 * step for step in range(30))]
    bench = Swinging([*moving, *[moving[-1]] * 20])
    rule = Settle(noise_ratio=1.3, pairs=3, drift_window_s=0.5, timeout_s=30.0)
    settled = wait_until_settled(bench, bench, rule, noise, lambda: None)
    assert bench.taken >= len(moving) + 5
    assert max(settled.ratio, settled.drift_ratio) <= 1.3
    assert not settled.flags


@pytest.mark.parametrize(("timeout_s", "not_before_s", "ends_s"), [(2.0, 0.0, 2.0), (4.0, 0.0, 4.0), (1.0, 3.0, 3.0)])
def test_a_beam_that_never_rests_is_waited_for_until_the_later_of_both_times(
    timeout_s: float, not_before_s: float, ends_s: float
) -> None:
    rng = np.random.default_rng(8)
    noise = measure_noise([camera(rng, 0.0) for _ in range(8)])
    bench = Swinging([float(shift) for shift in (0, 5) * 50])
    rule = Settle(noise_ratio=1.3, pairs=3, drift_window_s=0.5, timeout_s=timeout_s)
    settled = wait_until_settled(bench, bench, rule, noise, lambda: None, not_before_s=not_before_s)
    assert settled.waited_s == pytest.approx(ends_s, abs=0.11)  # a frame comes every 0.1 s
    (flag,) = settled.flags
    assert (flag.name, flag.limit) == ("NOT_SETTLED", 1.3)
    assert flag.value == max(settled.ratio, settled.drift_ratio if np.isfinite(settled.drift_ratio) else 0.0)


class Seen:
    def __init__(self) -> None:
        self.at_s: list[float] = []

    def __call__(self, frame: Frame, at_s: float) -> None:
        self.at_s.append(at_s)


@pytest.mark.parametrize("pairs", [2, 5])
def test_a_beam_at_rest_is_waited_for_until_all_pairs_and_the_drift_window_are_quiet(pairs: int) -> None:
    rng = np.random.default_rng(9)
    noise = measure_noise([camera(rng, 0.0) for _ in range(8)])
    for window_s, not_before_s in ((0.15, 0.0), (0.95, 0.0), (0.15, 1.5)):
        bench = Swinging([0.0])
        rule = Settle(noise_ratio=1.3, pairs=pairs, drift_window_s=window_s, timeout_s=30.0)
        recorder = Seen()
        settled = wait_until_settled(bench, bench, rule, noise, lambda: None, recorder, not_before_s)
        assert not settled.flags
        first_s = 0.1  # the time of the first frame
        expected_s = max(first_s + pairs * 0.1, first_s + window_s, not_before_s)
        assert settled.waited_s == pytest.approx(expected_s, abs=0.1)
        assert settled.waited_s >= expected_s - 1e-9
        assert recorder.at_s == pytest.approx([0.1 * k for k in range(1, bench.taken + 1)])


def test_a_beam_at_rest_is_judged_once_after_the_shortest_time_although_the_computation_takes_long() -> None:
    # The shortest time ends between the last frame of the wait and the end of the computation for this frame.
    rng = np.random.default_rng(10)
    noise = measure_noise([camera(rng, 0.0) for _ in range(8)])
    bench = Swinging([0.0])
    computed = [0.0]
    bench.now = lambda: bench.taken * 0.1 + computed[0]  # type: ignore[method-assign]

    def compute(frame: Frame, at_s: float) -> None:
        computed[0] += 0.06

    rule = Settle(noise_ratio=1.3, pairs=2, drift_window_s=0.15, timeout_s=0.5)
    for not_before_s in (0.7, 0.75, 0.8, 0.85):
        bench.taken, computed[0] = 0, 0.0
        settled = wait_until_settled(bench, bench, rule, noise, lambda: None, compute, not_before_s)
        assert not settled.flags, not_before_s


def test_the_noise_is_estimated_from_at_least_two_frames() -> None:
    with pytest.raises(ValueError, match="at least two"):
        measure_noise([np.zeros((4, 4), np.uint8)])
