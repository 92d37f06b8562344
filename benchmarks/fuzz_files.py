"""Read mutated files: each file must be read completely or refused with a message of one line.

    python -m benchmarks.fuzz_files --files 2000

Bits, bytes, blocks or lengths of files are changed at random. The files are datasets (finished datasets, and datasets
as a crash leaves them), TOML files, fits.json, tensile curves and images. Every file is read by the functions that the
commands of eimi-lab use, and the outcomes are counted. One process reads many files. A process that dies, or that takes
more than 10 s of processor time for a file, is counted and replaced.

With --recover, only datasets are mutated. A separate process then recovers each dataset in the way and with the limits
of memory and time of the command `eimi recover`. A process that dies or exceeds the time limit is then not a fault,
because `eimi recover` reports this in one line.
"""

from __future__ import annotations

import argparse

from tests.shared.mutated_files import fuzz


def main() -> None:
    """Print how many files were read, refused, and handled wrongly."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recover", action="store_true")
    options = parser.parse_args()
    counts = fuzz(options.files, options.seed, options.recover)
    print(", ".join(f"{outcome}: {count}" for outcome, count in sorted(counts.items())))


if __name__ == "__main__":
    main()
