"""Put small mistakes into a copy of the project, one at a time, and report which mistakes the tests detect.

``python -m benchmarks.mutants [--room NAME] [--only N] [--jobs N] [--results FILE]``
``python -m benchmarks.mutants --sample N --seed N [--room NAME] [--jobs N] [--results FILE]``

The first command tries the mistakes in ``benchmarks/mistakes/ROOM.toml``, where a room is a package, such as
"acquisition"; ``--only N`` tries one mistake. The second command makes random mistakes in N random lines
(`generated_mistakes`), and needs the map that `tests_by_line` records. A mistake is caught if a test fails. The script
prints the share of caught mistakes in each room, with its 95 % interval for random mistakes. With ``--results`` a run
continues an earlier run, and repeats the mistakes that were not caught.
"""

# With ``--sample`` a generator makes the mistakes instead (`generated_mistakes`), in lines that are drawn at random
# with the seed. Three groups of tests are run, one after another, until a test fails:
#
# 1. The tests that execute the line. They are read from a map, which `tests_by_line` must have recorded before. The map
#    does not contain processes that a test starts, and may not contain slow tests.
# 2. The files of tests that import the module of the mistake.
# 3. The tests that ``room_tests.toml`` lists for the folder of this module.
#
# A mistake is also caught if a file of these tests cannot be imported any more. A mistake counts as missed if no test
# fails, or if its tests end without a result. Mistakes that ``equivalent_mistakes.toml`` lists with a reason change no
# behaviour and are not counted. The script prints the share of caught mistakes in each room with its 95 % interval (E.
# B. Wilson, J. Am. Stat. Assoc. 22, 209, 1927), and the time.

from __future__ import annotations

import argparse
import compileall
import json
import math
import multiprocessing
import os
import queue
import re
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from benchmarks.generated_mistakes import asked_room, changed, room_of, sampled, unique_fragments
from benchmarks.tests_by_line import TestsByLine, files_that_import

PROJECT = Path(__file__).parents[1]
LISTS = Path(__file__).parent / "mistakes"
EQUIVALENT = Path(__file__).parent / "equivalent_mistakes.toml"
ROOM_TESTS = Path(__file__).parent / "room_tests.toml"
LEAST = 150  # smallest number of mistakes that the lists must contain
TEST_LIMIT_S = 300  # time limit (s) of one test, instead of the limit in pyproject.toml
RUN_LIMIT_S = 1800  # time limit (s) of all tests of one mistake; the mistake counts as survived after this time
# Time limit (s) of the tests of a generated mistake: LEAST_LIMIT_S plus SLOWER times the recorded duration of these
# tests.
SLOWER = 20
LEAST_LIMIT_S = 120

ROOM_LIMIT_S = 900.0
"""Time limit (s) of the tests that `ROOM_TESTS` lists for one mistake."""

# The first tests of a mistake run alone before the others. They catch most mistakes, and pytest reads the files of all
# tests that it is given before it runs one.
FIRST_TESTS = 8

CAUGHT, SURVIVED, BROKEN = "caught", "survived", "broken"
_PRELOADED = [  # third-party packages, which are loaded once for all processes
    *("cma", "cv2", "h5py", "hypothesis", "matplotlib.figure", "matplotlib.backends.backend_agg", "pydantic", "pytest"),
    *("pyvisa", "scipy.optimize", "scipy.spatial", "serial", "typer"),
]
_PROCESSES = multiprocessing.get_context("forkserver")
_PROCESSES.set_forkserver_preload(_PRELOADED)
_OUTCOMES = {0: SURVIVED, 1: CAUGHT, 5: SURVIVED}  # by pytest's status; 5: all tests deselected; others: a wrong entry


@dataclass(frozen=True)
class Mutant:
    """A mistake: a wrong fragment replaces a fragment of the code.

    Attributes
    ----------
    number : int
        Number of the mistake, from 1.
    room : str
        Name of the list of mistakes, or of the package for a random mistake.
    says : str
        Description.
    file : str
        Path in the project.
    right, wrong : str
        The right fragment, which occurs once in the file, and the wrong fragment.
    tests : tuple of str
        Tests that concern the mistake, as arguments of pytest.
    limit_s : float
        Time limit of all tests together, s.
    is_generated : bool
        Whether the mistake was generated at random, not listed in a file.
    """

    number: int
    room: str
    says: str
    file: str
    right: str
    wrong: str
    tests: tuple[str, ...]
    limit_s: float = RUN_LIMIT_S
    is_generated: bool = False

    def room_tests(self, project: Path) -> list[str]:
        # Return the files of tests that run if none of ``tests`` detects the mistake: the files that import the file of
        # the mistake, and the files that ``room_tests.toml`` lists for its folder. A mistake that was not generated has
        # no such files.
        if not self.is_generated:
            return []
        by_folder: dict[str, list[str]] = tomllib.loads(ROOM_TESTS.read_text(encoding="utf-8"))
        listed = [test for folder, tests in by_folder.items() if self.file.startswith(folder) for test in tests]
        every = dict.fromkeys([*files_that_import(self.file, project), *listed])
        return [test for test in every if (project / test).exists()]

    @property
    def key(self) -> str:
        """Return an identifier of the mistake, which is a hash of its contents."""
        tests = () if self.is_generated else self.tests
        return sha256("\0".join((self.file, self.right, self.wrong, *tests)).encode()).hexdigest()[:16]

    def applied(self, text: str) -> str:
        """Return the text of the source file with the mistake: ``wrong`` replaces ``right``.

        Raises ValueError unless ``right`` occurs exactly once.
        """
        if text.count(self.right) != 1:
            raise ValueError(f"{self.room}: {self.says}: {self.file} has {self.right!r} {text.count(self.right)} times")
        return text.replace(self.right, self.wrong)


def every_mutant() -> list[Mutant]:
    """Return all mistakes that the files ``benchmarks/mistakes/*.toml`` list."""
    mutants: list[Mutant] = []
    for path in sorted(LISTS.glob("*.toml")):
        for row in tomllib.loads(path.read_text(encoding="utf-8"))["mistake"]:
            row["tests"] = tuple(row["tests"])
            mutants.append(Mutant(number=len(mutants) + 1, room=path.stem, **row))
    return mutants


def copied(project: Path, folder: Path) -> Path:
    """Copy the project into a folder, compile its Python files, and return the path of the copy."""
    left_out = shutil.ignore_patterns(
        ".git", ".venv", "__pycache__", ".*_cache", ".hypothesis", "site", ".coverage*", ".tests_by_line*"
    )
    copy = folder / project.name
    shutil.copytree(project, copy, ignore=left_out, symlinks=True)
    compileall.compile_dir(copy, quiet=2)
    return copy


def tried(mutant: Mutant, copy: Path) -> tuple[str, str]:
    """Put a mistake into a copy of the project, run its tests, and restore the copy.

    Return "caught" (a test failed), "survived" (none failed) or "broken" (pytest failed), and a line of the output.
    """
    left_out: list[str] = []
    while True:
        outcome, line = _tried_without(left_out, mutant, copy)
        failed = line.removeprefix("FAILED ").partition(" - ")[0]
        if not (mutant.is_generated and outcome == CAUGHT and line.startswith("FAILED")):
            return outcome, line
        if run_tests((failed,), copy)[0] != CAUGHT:
            return outcome, line
        left_out.append(f"--deselect={failed}")


def _tried_without(left_out: Sequence[str], mutant: Mutant, copy: Path) -> tuple[str, str]:
    # The results are those of `tried`. `left_out`: options of pytest that deselect tests.
    file = copy / mutant.file
    right, stat = file.read_bytes(), file.stat()
    file.write_text(mutant.applied(right.decode("utf-8")), encoding="utf-8")
    os.utime(
        file, (stat.st_atime + 2, stat.st_mtime + 2)
    )  # a later time, so that Python does not use the compiled right code; Python compares whole seconds
    try:
        outcome, line = SURVIVED, ""
        for tests in (mutant.tests[:FIRST_TESTS], mutant.tests[FIRST_TESTS:]):
            if tests and outcome == SURVIVED:
                outcome, line = run_tests(tests, copy, mutant.limit_s, left_out)
        if outcome == SURVIVED and (room_tests := mutant.room_tests(copy)):
            outcome, line = run_tests(room_tests, copy, ROOM_LIMIT_S, left_out)
        whole = tuple(dict.fromkeys(test.partition("[")[0] for test in mutant.tests))
        if outcome == BROKEN and whole != mutant.tests and not _is_import_failure(line):
            outcome, line = run_tests(whole, copy, mutant.limit_s)  # the mistake changed the parameters of a test
    finally:
        file.write_bytes(right)
        os.utime(file, (stat.st_atime, stat.st_mtime))
    if outcome == BROKEN and _is_import_failure(line):
        # pytest names the file of tests that cannot be imported.
        unread = tuple(word for word in line.split()[1:2] if word.startswith("tests/"))
        tests = unread or mutant.tests or tuple(mutant.room_tests(copy))
        right_code, _ = run_tests(tests, copy, mutant.limit_s, ("--collect-only",))
        outcome = CAUGHT if right_code == SURVIVED else BROKEN
    return outcome, line


def _is_import_failure(line: str) -> bool:
    """Return whether a line of pytest's output says that a file of tests or a conftest.py cannot be imported."""
    return line.startswith(("ERROR tests", "ERROR test_", "ImportError while loading conftest"))


def run_tests(
    tests: Sequence[str], copy: Path, limit_s: float = RUN_LIMIT_S, options: Sequence[str] = ()
) -> tuple[str, str]:
    """Run tests in a copy of the project until a test fails; return the outcome and a line of pytest's output.

    The outcome is "caught" (a test failed), "survived" (none failed in `limit_s` seconds) or "broken" (pytest failed).
    """
    transcript = copy.with_suffix(".txt")
    arguments = (copy, transcript, (*options, *tests), min(TEST_LIMIT_S, limit_s / 2))
    child = _PROCESSES.Process(target=_pytest, args=arguments)
    child.start()
    child.join(limit_s)
    if child.exitcode is None:
        os.killpg(child.pid or 0, signal.SIGKILL)
        child.join()
        return SURVIVED, f"no end within {limit_s:.0f} s"
    lines = transcript.read_text(encoding="utf-8", errors="replace").strip().splitlines() or [""]
    failed = [line for line in lines if line.startswith("FAILED") or _is_import_failure(line)]
    outcome = _OUTCOMES.get(child.exitcode, BROKEN)
    # Without a line for the failed test, pytest itself has failed, unless it counts failed tests: a mistake may spoil
    # the output of the test that notices it.
    if outcome == CAUGHT and not failed and not re.match(r"\d+ failed", lines[-1]):
        outcome = BROKEN
    return outcome, (failed or lines)[-1]


def _pytest(copy: Path, transcript: Path, tests: Sequence[str], test_limit_s: float) -> None:
    """Run pytest on a copy of the project, and end the process with pytest's exit status.

    The file `transcript` receives the output. A test is stopped after `test_limit_s` (s).
    """
    os.setsid()
    folders = [str(copy), str(copy / "drivers"), str(copy / "fitting")]
    sys.path[:] = [*folders, *(path for path in sys.path if path not in ("", str(PROJECT)))]
    for name in [name for name in sys.modules if name.partition(".")[0] in ("benchmarks", "tests")]:
        del sys.modules[name]
    sys.dont_write_bytecode = True
    os.environ |= {"PYTHONPATH": os.pathsep.join(folders), "PYTHONDONTWRITEBYTECODE": "1"}
    os.chdir(copy)
    with transcript.open("wb") as output:
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
    import pytest

    options = ("-x", "-q", "-n0", "-p", "no:cacheprovider", f"--timeout={test_limit_s:.0f}", "--tb=no")
    options += ("-W", "ignore::pytest.PytestAssertRewriteWarning")  # caused by the packages that are preloaded
    sys.exit(int(pytest.main([*options, *tests])))


def generated(number: int, seed: int, rooms: Sequence[str]) -> list[Mutant]:
    """Return random mistakes in `number` random lines of the packages or folders `rooms`, with their tests.

    Without `rooms` the lines come from all packages.
    """
    tests = TestsByLine()
    mutants = []
    for place, (file, change) in enumerate(sampled(PROJECT, number, seed, rooms), 1):
        text = (PROJECT / file).read_text(encoding="utf-8")
        right, wrong = unique_fragments(text, changed(text, change), change)
        says, chosen = f"line {change.line}: {change.says}", tests.of(file, change.line)
        limit_s = LEAST_LIMIT_S + SLOWER * tests.seconds(chosen)
        room = asked_room(file, rooms) or room_of(file)
        mutants.append(Mutant(place, room, says, file, right, wrong, chosen, limit_s, is_generated=True))
    return mutants


def wilson_95(hits: int, number: int) -> tuple[float, float]:
    """Return Wilson's 95 % interval (lower, upper) of the share `hits` / `number`."""
    z, share = 1.959964, hits / number
    middle = (share + z * z / (2 * number)) / (1 + z * z / number)
    half = z / (1 + z * z / number) * math.sqrt(share * (1 - share) / number + z * z / (4 * number * number))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def equivalent_keys() -> dict[str, str]:
    """Return the reasons why some random mistakes change no behaviour, by the identifier of the mistake."""
    rows = tomllib.loads(EQUIVALENT.read_text(encoding="utf-8")).get("equivalent", [])
    return {row["key"]: row["reason"] for row in rows}


def sample_table(mutants: Sequence[Mutant], outcomes: dict[str, str]) -> list[str]:
    """Return a Markdown table: the share of caught random mistakes in each package, with its 95 % interval.

    `outcomes` contains "caught", "survived" or "broken" by the identifier of the mistake.
    """
    excused = equivalent_keys()
    counted = [m for m in mutants if m.key not in excused or outcomes[m.key] == CAUGHT]
    lines = ["| room | mistakes | caught | share | 95 % interval |", "| --- | ---: | ---: | ---: | --- |"]
    rooms = {room: [m for m in counted if m.room == room] for room in sorted({m.room for m in counted})}
    for name, group in [*rooms.items(), ("all", counted)]:
        caught = sum(outcomes[m.key] == CAUGHT for m in group)
        low, high = wilson_95(caught, len(group)) if group else (0.0, 1.0)
        share = 100 * caught / max(len(group), 1)
        lines.append(f"| {name} | {len(group)} | {caught} | {share:.0f} % | {100 * low:.0f} to {100 * high:.0f} % |")
    lines.append(f"{len(mutants) - len(counted)} of {len(mutants)} change no behaviour, each listed with its reason")
    return lines


def table(mutants: Sequence[Mutant], outcomes: dict[str, str]) -> list[str]:
    # Return a Markdown table: how many mistakes of each file in ``benchmarks/mistakes`` were tried and caught.
    # `outcomes` contains "caught", "survived" or "broken" by the identifier of the mistake.
    lines = ["| list | mistakes | caught | share |", "| --- | ---: | ---: | ---: |"]

    def row(name: str, group: Sequence[Mutant]) -> str:
        caught = sum(outcomes[m.key] == CAUGHT for m in group)
        return f"| {name} | {len(group)} | {caught} | {100 * caught / max(len(group), 1):.0f} % |"

    run = [m for m in mutants if m.key in outcomes]
    for room in dict.fromkeys(m.room for m in run):
        lines.append(row(room, [m for m in run if m.room == room]))
    return [*lines, row("all", run)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--room", action="append", help="name of a list, or of a room for a sample; may be repeated")
    parser.add_argument("--only", type=int, action="append", metavar="N", help="number of a mistake; may be repeated")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--results", type=Path, help="JSON file with outcomes, to continue from")
    parser.add_argument("--sample", type=int, metavar="N", help="generate N mistakes instead of using the lists")
    parser.add_argument("--seed", type=int, default=1, help="seed of the sample")
    parser.add_argument("--list", action="store_true", help="print the mistakes without running tests")
    options = parser.parse_args()
    began_s = time.perf_counter()
    if options.sample:
        drawn = generated(options.sample, options.seed, options.room or ())
    else:
        drawn = [m for m in every_mutant() if not options.room or m.room in options.room]
    if not drawn:
        parser.error(f"--room {' '.join(options.room or ())}: there is no mistake in a room of this name")
    chosen = [m for m in drawn if not options.only or m.number in options.only]
    for mutant in chosen:  # check before the first run that every right fragment occurs once
        mutant.applied((PROJECT / mutant.file).read_text(encoding="utf-8"))
    if options.list:
        print("\n".join(f"{m.number:4d} {m.room:12s} {m.says} ({m.file})" for m in chosen))
        return 0
    earlier = json.loads(options.results.read_text()) if options.results and options.results.exists() else {}
    outcomes = {m.key: earlier[m.key] for m in chosen if m.key in earlier}
    due = [m for m in chosen if outcomes.get(m.key) != CAUGHT]
    with tempfile.TemporaryDirectory(prefix="mutants") as folder, ThreadPoolExecutor(options.jobs) as pool:
        copies: queue.SimpleQueue[Path] = queue.SimpleQueue()
        for job in range(options.jobs):
            copies.put(copied(PROJECT, Path(folder) / str(job)))

        def one(mutant: Mutant) -> tuple[Mutant, str, str, float]:
            if not mutant.tests and not mutant.room_tests(PROJECT):
                return mutant, SURVIVED, "no test executes the line", 0.0
            copy, start_s = copies.get(), time.perf_counter()
            try:
                return mutant, *tried(mutant, copy), time.perf_counter() - start_s
            finally:
                copies.put(copy)

        for mutant, outcome, line, seconds in pool.map(one, due):
            outcomes[mutant.key] = earlier[mutant.key] = outcome
            where = f"{mutant.file}: " if options.sample else ""
            print(
                f"{mutant.number:4d} {mutant.room:12s} {outcome:8s} {where}{mutant.says} ({seconds:.0f} s)", flush=True
            )
            print(f"     {line} [{mutant.key}]", flush=True)
            if options.results:
                options.results.write_text(json.dumps(earlier, indent=1))
    print("\n".join((sample_table if options.sample else table)(chosen, outcomes)))
    print(f"{len(due)} tried in {(time.perf_counter() - began_s) / 60:.1f} minutes")
    return int(any(outcomes[m.key] != CAUGHT for m in chosen))


if __name__ == "__main__":
    sys.exit(main())
