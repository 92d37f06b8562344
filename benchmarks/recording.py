"""Count the recorded and lost frames of a fast camera in ten seconds: ``python -m benchmarks.recording``.

The emulated cameras send noisy frames: 1.3 megapixels at 120 Hz, and 640 x 480 pixels at 500 Hz. The frames are written
to the disk and compared with the sent frames. The load of the machine, which can cause lost frames, is printed too.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from pathlib import Path

from tests.shared.streamed_run import record

CASES = ((1280, 1024, 120.0), (640, 480, 500.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--folder", type=Path, help="folder on the disk to measure; default: a temporary folder")
    given = parser.parse_args()
    for width, height, rate_Hz in CASES:
        load = os.getloadavg()[0]
        with tempfile.TemporaryDirectory(dir=given.folder) as folder:
            path, busy_s = Path(folder) / "run.h5", time.process_time()
            streamed = record(path, width, height, rate_Hz, given.seconds)
            size = path.stat().st_size
        stored = streamed.stored
        peak_MB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(
            f"{width} x {height} at {rate_Hz:g} Hz for {given.seconds:g} s: {stored.frames} frames at "
            f"{stored.rate_Hz:.2f} Hz, {stored.lost} lost, read back "
            f"{'identical' if streamed.identical else 'DIFFERENT'}, {size / 1e6:.0f} MB, compression "
            f"{stored.frames * width * height / size:.2f}, peak memory {peak_MB:.0f} MB, processor time of the run and "
            f"of reading {time.process_time() - busy_s:.1f} s, load before {load:.1f} on {os.cpu_count()} processors"
        )


if __name__ == "__main__":
    main()
