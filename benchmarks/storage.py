"""Measure how many frames are stored per second, and the speed of each step: ``python -m benchmarks.storage``."""

from __future__ import annotations

import tempfile
import time
import zlib
from pathlib import Path

import numpy as np

from eimi_drivers.interfaces import Frame
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.writing import DatasetWriter

HEIGHT, WIDTH = 1024, 1280
STATES, FRAMES_PER_STATE = 10, 5
NOISE_GREY = 1.3


def frames(count: int) -> list[Frame]:
    """Return `count` frames of the same dark beam with different noise."""
    random = np.random.default_rng(0)
    across = np.abs(np.arange(WIDTH) - WIDTH / 2)
    still = np.tile(30 + 170 / (1 + np.exp(-(across - 50) / 1.0)), (HEIGHT, 1))
    return [
        Frame(np.rint(still + random.normal(0, NOISE_GREY, still.shape)).clip(0, 255).astype(np.uint8), number, 0.0)
        for number in range(count)
    ]


def main() -> None:
    images = frames(FRAMES_PER_STATE)
    header = Header(load_specimen("type1"), load_calibration("virtual_calibration"))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "benchmark.h5"
        with DatasetWriter(path, header, images[0]) as writer:
            began = time.perf_counter()
            for state in range(STATES):
                writer.append_state(images, current_A=0.1 * state, field_mT=0.47 * state)
            stored_s = time.perf_counter() - began
        size = path.stat().st_size
    count = STATES * FRAMES_PER_STATE
    began = time.perf_counter()
    for frame in images:
        zlib.compress(frame.image.tobytes(), 1)
    compressing_s = (time.perf_counter() - began) / len(images)
    print(f"{count} frames of {WIDTH} x {HEIGHT} in {STATES} states, gzip 1 and fletcher32, stored on disk after each")
    print(f"{count / stored_s:.1f} frames/s, {1e3 * stored_s / count:.1f} ms a frame")
    print(f"compression {HEIGHT * WIDTH * count / size:.2f}; zlib alone takes {1e3 * compressing_s:.1f} ms a frame")


if __name__ == "__main__":
    main()
