"""Read randomly changed files: every file must be read completely or refused with one line.

    python -m benchmarks.fuzz_files --files 2000 [--recover]

The files are datasets, TOML files, fits.json, tensile curves and images. A process that dies, or that needs more than
10 s of processor time for a file, counts as a fault. With --recover, damaged datasets are recovered as by `eimi
recover`. A process that dies or is slow is then no fault, because `eimi recover` reads a file in a second process with
limits of time and memory.
"""

from __future__ import annotations

import argparse

from tests.shared.mutated_files import fuzz


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recover", action="store_true")
    options = parser.parse_args()
    counts = fuzz(options.files, options.seed, options.recover)
    print(", ".join(f"{outcome}: {count}" for outcome, count in sorted(counts.items())))


if __name__ == "__main__":
    main()
