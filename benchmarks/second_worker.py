"""Measure how much time a second worker process saves in many fits of a dataset and of its resampled data.

    python -m benchmarks.second_worker DATASET.h5 [--fits 48]

The time with two processes includes their start.
"""

from __future__ import annotations

import argparse
import statistics
from functools import partial

from benchmarks.timing import timed
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.fits.fit_grid import fit_grid, grid
from eimi_lab.process.workers import processes

ROUNDS = 3


def main() -> None:
    parser = argparse.ArgumentParser(description="compute fits in one process and in two processes")
    parser.add_argument("dataset")
    parser.add_argument("--fits", type=int, default=48)
    options = parser.parse_args()
    tasks = grid(["neo-hookean"], [load_evidence(options.dataset)], [1], bootstrap=options.fits - 1)
    seconds: dict[int, list[float]] = {1: [], 2: []}
    results = []
    for _ in range(ROUNDS):
        for workers, executor in ((1, None), (2, partial(processes, 2))):
            took_s, (fit,) = timed(partial(fit_grid, tasks, {}, executor=executor))
            seconds[workers].append(took_s)
            results.append([fit.parameters, fit.bootstrap and [r.parameters for r in fit.bootstrap.replicates]])
            print(f"{workers} worker{'s' * (workers - 1)}: {seconds[workers][-1]:.1f} s", flush=True)
    one, two = statistics.median(seconds[1]), statistics.median(seconds[2])
    same = all(result == results[0] for result in results)
    print(f"{len(tasks)} fits: {one:.1f} s by one, {two:.1f} s by two: x {one / two:.2f}; the same results: {same}")


if __name__ == "__main__":
    main()
