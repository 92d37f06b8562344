"""Measure the time from the start of the program to the first frame: `python -m benchmarks.first_frame`."""

from __future__ import annotations

import subprocess
import sys
import time

REPEATS = 5
# The steps of `eimi acquire` up to the first frame, with the files that are shipped with eimi-lab.
FIRST_FRAME = """
import eimi_lab.cli
from eimi_lab.acquisition.open_bench import open_bench
from eimi_lab.acquisition.run import check_request
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
protocol, specimen, rig = load_protocol("dragon_skin_10"), load_specimen("type1"), load_rig("virtual")
check_request(protocol, specimen, rig)
with open_bench(rig, specimen, protocol.limits) as bench:
    bench.camera.grab(1.0)
    print("frame", flush=True)
"""


def seconds_to_first_frame() -> float:
    """Start the program once, and return the time (s) from the start to the first frame."""
    began = time.perf_counter()
    with subprocess.Popen([sys.executable, "-c", FIRST_FRAME], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        if process.stdout.readline() != b"frame\n":
            sys.exit("no frame came")
        return time.perf_counter() - began


def main() -> None:
    seconds = [seconds_to_first_frame() for _ in range(REPEATS)]
    print(f"start to first frame: {min(seconds):.2f} to {max(seconds):.2f} s in {REPEATS} starts")


if __name__ == "__main__":
    main()
