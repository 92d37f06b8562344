"""Run all benchmarks, each in a separate process: ``python -m benchmarks [--short] [-o docs/benchmarks.md]``.

``--short`` uses reduced sizes and takes about a quarter of an hour. ``-o FILE`` writes all tables to a page. ``--only
NAME`` runs one benchmark and replaces only its table on the page.
"""

from __future__ import annotations

import argparse
import platform
import subprocess
import sys
import time
from dataclasses import dataclass
from datetime import date
from importlib.metadata import version
from pathlib import Path


@dataclass(frozen=True)
class Benchmark:
    """A benchmark script, and its section of the page docs/benchmarks.md.

    Attributes
    ----------
    name : str
        Title of the section.
    script : str
        Name of the module.
    words : str
        What the printed table shows.
    page : str
        Page that explains the results, relative to docs.
    arguments, short : tuple of str
        Command-line arguments of a full run and of a short run.
    """

    name: str
    script: str
    words: str
    page: str
    arguments: tuple[str, ...] = ()
    short: tuple[str, ...] = ()


ALL = (
    Benchmark(
        "forward",
        "speed",
        "Time of one curve of 16 field states, and its growth with candidates (sets of parameters), states, elements.",
        "why/speed.md",
    ),
    Benchmark(
        "mesh",
        "mesh_convergence",
        "Error of the tip position of a 30 x 3 mm beam on different meshes.",
        "why/verification.md",
    ),
    Benchmark(
        "solid",
        "solid",
        "The solid in three dimensions: patch tests, orders of convergence, sag under the weight compared with FElupe.",
        "why/section.md",
        short=("--short",),
    ),
    Benchmark("edges", "edges", "Error of the edges on rendered beams of known shape.", "why/edges.md"),
    Benchmark(
        "storage", "storage", "Acquisition: frames stored per second, with compression and checksum.", "why/safety.md"
    ),
    Benchmark(
        "start", "first_frame", "Acquisition: from the start of the program to the first frame.", "why/safety.md"
    ),
    Benchmark(
        "fit",
        "seeds",
        "Error of the identified modulus, in per cent of the truth, for each law and seed.",
        "why/statistics.md",
    ),
    Benchmark(
        "report",
        "report_cost",
        "Time and memory of `eimi report` for different numbers of datasets and fits.",
        "howto/report.md",
        short=("--repeats", "1"),
    ),
    Benchmark(
        "coverage",
        "coverage",
        "Share of the 95 % intervals that hold the truth, and their width divided by the one that would hold 95 %.",
        "why/statistics.md",
        short=("--experiments", "48"),
    ),
    Benchmark(
        "causes",
        "imperfect_rigs",
        "Error of the modulus on benches with mistakes that no file states, and the rank of the true cause.",
        "why/causes.md",
        arguments=("--short", "--both", "--measured"),
        short=("--short", "--both", "--measured", "--planar", "none", "scale", "creep"),
    ),
    Benchmark(
        "plan",
        "plan",
        "Half-width of the 95 % interval, in per cent of the modulus: predicted by a plan, and measured.",
        "why/planning.md",
        short=("--experiments", "1"),
    ),
    Benchmark(
        "discover",
        "discover",
        "How often the terms of hidden laws are right, not identifiable or wrong, with and without a tensile test.",
        "howto/discover.md",
        short=("--laws", "4"),
    ),
)


def section(benchmark: Benchmark, short: bool) -> tuple[str, bool]:
    """Run a benchmark; return its section of the page in Markdown, and whether the benchmark succeeded."""
    arguments = benchmark.short if short else benchmark.arguments
    command = ["-m", f"benchmarks.{benchmark.script}", *arguments]
    print(f"{benchmark.name}: python {' '.join(command)}", flush=True)
    start_s = time.perf_counter()
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True, check=False)
    print(f"{done.stdout}{done.stderr}  ({time.perf_counter() - start_s:.0f} s)\n", flush=True)
    table = done.stdout.strip()
    shown = table if table.startswith("|") else f"```text\n{table}\n```"
    caption = f"{benchmark.words} `python {' '.join(command)}`; {environment()}"
    return f"## {benchmark.name}\n\n{caption}\n\n{shown}\n", done.returncode == 0


def sections_of(page: Path) -> dict[str, str]:
    """Return the sections of an earlier page (Markdown), by the name of the benchmark; empty without a page."""
    if not page.is_file():
        return {}
    _, *parts = page.read_text(encoding="utf-8").split("\n## ")
    return {part.split("\n", 1)[0]: f"## {part.rstrip()}\n" for part in parts}


def heading() -> str:
    """Return the head of the page in Markdown: a list of all benchmarks."""
    rows = "".join(
        f"| {b.name} | {b.words} | `python -m benchmarks.{b.script}` | [{Path(b.page).stem}]({b.page}) |\n" for b in ALL
    )
    return (
        "# Benchmarks\n\n`python -m benchmarks -o docs/benchmarks.md` runs all benchmarks and writes this page.\n"
        "`--short` uses reduced sizes. `--only NAME` runs one benchmark and keeps the tables of the others. The pages\n"
        "in the last column explain the figures, and have the results of benchmarks without a section here.\n\n"
        "| name | what it measures | command | explained in |\n| --- | --- | --- | --- |\n" + rows
    )


def environment() -> str:
    """Return one line: the date, and the versions of Python and of the packages."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy"))
    return f"{date.today().isoformat()}, Python {platform.python_version()}, {packages}."


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="use reduced sizes")
    parser.add_argument(
        "--only", choices=[benchmark.name for benchmark in ALL], action="append", help="may be repeated"
    )
    parser.add_argument("-o", "--output", type=Path, help="page to write")
    options = parser.parse_args()
    chosen = [benchmark for benchmark in ALL if not options.only or benchmark.name in options.only]
    parts = sections_of(options.output) if options.output else {}
    failed = []
    for benchmark in chosen:
        parts[benchmark.name], well = section(benchmark, options.short)
        failed += [] if well else [benchmark.name]
        if options.output:  # written after each benchmark, because all together take long
            finished = [parts[b.name] for b in ALL if b.name in parts]
            options.output.write_text("\n".join([heading(), *finished]), encoding="utf-8")
    if failed:
        print(f"failed: {', '.join(failed)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
