"""A command prints its result as lines or as JSON, and its help shows valid examples."""

from __future__ import annotations

import json
import shlex
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import typer

from eimi_lab import cli
from eimi_lab.commands.examples import EXAMPLES
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.process.progress import progress, unseen
from tests.shared.changed_module import changed_module

Eimi = Callable[..., tuple[int, str, str]]


@pytest.fixture
def eimi(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Eimi:
    # Return a function that runs a command in this process; it returns exit status, standard output and error.
    def eimi(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["eimi", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_:
            cli.main()
        return (int(exit_.value.code or 0), *capsys.readouterr())

    monkeypatch.setattr(cli, "unwind_on_termination", lambda: None)
    return eimi


def test_a_result_is_printed_as_json_or_as_lines(eimi: Eimi, dataset: Path) -> None:
    status, message, progressed = eimi("segment", dataset)
    assert "segment 1/" in progressed
    assert (status, message.startswith(f"{dataset}: edges of ")) == (0, True)
    status, message, progressed = eimi("segment", dataset, "--json")
    result = json.loads(message)
    with open_dataset(dataset) as opened:
        assert result["states"] == len(opened.states) == len(result["flags"])
    assert result["dataset"] == str(dataset)
    assert "segment 1/" in progressed
    assert eimi("segment", dataset, "--quiet") == (0, "", "")
    status, message, progressed = eimi("segment", dataset, "--quiet", "--json")
    assert (status, json.loads(message), progressed) == (0, result, "")


def test_an_error_is_printed_even_with_quiet(eimi: Eimi, tmp_path: Path) -> None:
    status, stdout, stderr = eimi("segment", tmp_path / "none.h5", "--quiet", "--json")
    assert (status, stdout) == (2, "")
    assert stderr.startswith("eimi: ")
    assert len(stderr.splitlines()) == 1


def test_a_tensile_fit_prints_the_contents_of_its_file(eimi: Eimi, tmp_path: Path) -> None:
    rows = "".join(f"{0.02 * k},{3 * 15e3 * (1 + 0.02 * k - (1 + 0.02 * k) ** -2) / 3e6}\n" for k in range(60))
    (tmp_path / "curve.csv").write_text("strain,stress_MPa\n" + rows)
    arguments = ("--model", "neo-hookean", "--window", "50", "-o", tmp_path / "fits.json", "--json")
    status, stdout, stderr = eimi("tensile", tmp_path / "curve.csv", *arguments)
    assert status == 0, stderr
    assert json.loads(stdout) == json.loads((tmp_path / "fits.json").read_text())


@pytest.mark.parametrize(
    ("name", "example"), [(name, example) for name, examples in EXAMPLES.items() for example in examples]
)
def test_the_examples_in_the_help_are_commands_that_exist(name: str, example: str) -> None:
    program, command, *arguments = shlex.split(example)
    assert (program, command) == ("eimi", name)
    command_line = typer.main.get_command(cli.app).commands[name]  # type: ignore[attr-defined]
    with (
        suppress(typer.Exit),
        command_line.make_context(name, arguments) as context,
    ):  # an option that prints a list ends the program
        assert context.params


def test_every_command_has_an_example_and_the_option_h(eimi: Eimi) -> None:
    assert set(EXAMPLES) == set(typer.main.get_command(cli.app).commands)  # type: ignore[attr-defined]
    status, message, _ = eimi("fit", "-h")
    assert status == 0
    assert "\n    eimi fit run.h5 --model neo-hookean -o fits.json\n" in message


def test_the_estimated_time_counts_the_steps_only(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # The time before the first step, such as the conditioning of a beam (bending it before the run), does not count.
    now = iter([1000.0, 1010.0, 1020.0, 1030.0])
    times = changed_module(time, monotonic=lambda: next(now))
    monkeypatch.setattr("eimi_lab.process.progress.time", times)
    with progress("acquire", 4) as report:
        for _ in range(4):
            report("done")
    lines = capsys.readouterr().err.splitlines()
    assert lines[1:3] == ["acquire 2/4: done, about 20 s left", "acquire 3/4: done, about 10 s left"]
    assert [line.endswith("done") for line in lines] == [True, False, False, True]


def test_hidden_progress_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with unseen(), progress("fit", 1) as report:
        report.underway("half")
        report("done")
    assert capsys.readouterr().err == ""
