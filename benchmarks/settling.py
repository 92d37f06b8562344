"""Measure the time that the settling statistic needs for a frame: `python -m benchmarks.settling`.

The settling statistic compares two frames near the edges of the beam, and thereby shows whether the beam still moves.
The frames have shot noise, a beam with two edges, and 1.3 or 5 million pixels. In the first column the band of pixels
along the edges is determined again for each frame. In the second column the band of an earlier frame is used, as in a
measurement while the beam is at rest.
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
    """Return a noisy frame of a hanging beam, with the shape (height, width).

    The beam covers a tenth of the width and three quarters of the height of the picture.
    """
    rows, columns = shape
    across = np.abs(np.arange(columns) - columns / 2) - columns / 20
    beam = 0.06 + 0.94 / (1 + np.exp(-across / 0.6))
    light = np.full(shape, 0.8)
    light[: 3 * rows // 4] *= beam
    counted = rng.normal(light * ELECTRONS, np.sqrt(light * ELECTRONS))
    return np.clip(np.rint(counted / ELECTRONS * 255), 0, 255).astype(np.uint8)


def main() -> None:
    """Print the time (ms) of the settling statistic for each size of the frames, on one line each."""
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
