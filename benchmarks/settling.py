"""Measure the time of the check whether a beam still moves, for one frame: ``python -m benchmarks.settling``.

The check compares the pixels near the edges of the beam in two frames of 1.3 or 5 megapixels. In the first column these
pixels are selected for each frame, in the second column they are known from an earlier frame.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import fastest
from eimi_lab.vision.settling_statistic import edge_pixels, measure_noise

SIZES = {"1.3 MP": (1024, 1280), "5 MP": (2048, 2448)}
ELECTRONS = 10_000.0
REPEATS = 20


def frame(rng: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a noisy frame of a hanging beam, shape (height, width)."""
    rows, columns = shape
    across = np.abs(np.arange(columns) - columns / 2) - columns / 20
    beam = 0.06 + 0.94 / (1 + np.exp(-across / 0.6))
    light = np.full(shape, 0.8)
    light[: 3 * rows // 4] *= beam
    counted = rng.normal(light * ELECTRONS, np.sqrt(light * ELECTRONS))
    return np.clip(np.rint(counted / ELECTRONS * 255), 0, 255).astype(np.uint8)


def main() -> None:
    print(f"{'frame':8} {'new band':>10} {'kept band':>10} {'ratio':>8} {'the same':>9}")
    for name, shape in SIZES.items():
        rng = np.random.default_rng(1)
        noise = measure_noise([frame(rng, shape) for _ in range(4)])
        earlier, later = frame(rng, shape), frame(rng, shape)
        anew_s, ratio = fastest(lambda: noise.difference_ratio(earlier, later), REPEATS)  # noqa: B023
        band = edge_pixels(later)
        kept_s, again = fastest(lambda: noise.difference_ratio(earlier, later, band), REPEATS)  # noqa: B023
        print(f"{name:8} {1e3 * anew_s:7.2f} ms {1e3 * kept_s:7.2f} ms {ratio:8.4f} {ratio == again!s:>9}")


if __name__ == "__main__":
    main()
