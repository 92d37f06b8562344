"""Mutated files, each read to its end or refused in one line: `python -m benchmarks.fuzz_files --files 2000`.

Datasets (finished, and as a crash leaves them), TOML files, fits.json, tensile curves and images are changed at random:
bits, bytes, blocks, lengths. Every file is read as the suite's commands read it, and the outcomes are counted. A
process reads many files; one that dies or takes more than 10 s of processor time for a file is counted and replaced.

With --recover datasets alone are mutated, and each goes through what `eimi recover` does in a process of its own,
within the same limits of memory and time. A process that dies or hangs there is no fault: `recover` tells it in one
line.
"""

from __future__ import annotations

import argparse

from tests.shared.mutated_files import fuzz


def main() -> None:
    """Print how many were read, refused, or worse."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recover", action="store_true")
    options = parser.parse_args()
    counts = fuzz(options.files, options.seed, options.recover)
    print(", ".join(f"{outcome}: {count}" for outcome, count in sorted(counts.items())))


if __name__ == "__main__":
    main()
