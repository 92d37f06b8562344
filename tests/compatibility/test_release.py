"""Files of the release 0.1.0 (in the folder `release`) and its command lines still work."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from eimi_lab import cli
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.fits.records import package_versions

RELEASE = Path(__file__).parent / "release"
COMMANDS = (RELEASE / "commands.txt").read_text(encoding="utf-8").splitlines()
CURRENTS_A = [0.0, 0.3, 0.6, 0.9]
SAME = 1e-6

Run = Callable[..., tuple[int, str]]


@pytest.fixture
def release(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    # A working directory with a copy of the files of the release.
    folder = shutil.copytree(RELEASE, tmp_path / "release")
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def eimi(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[[str], None]:
    # Return a function that runs a command line in this process, and fails if the exit status is not 0.
    monkeypatch.setattr(cli, "unwind_on_termination", lambda: None)

    def run(line: str) -> None:
        monkeypatch.setattr(sys, "argv", shlex.split(line))
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert not ended.value.code, capsys.readouterr().err

    return run


def test_the_calibration_of_a_release_has_the_same_hash() -> None:
    # Stored edges refer to their calibration by this hash.
    with open_dataset(RELEASE / "run.h5") as dataset:
        edges, calibration = dataset.edges(), dataset.calibration
    assert edges is not None
    assert calibration is not None
    assert {edge_set.calibration_digest for edge_set in edges} == {calibration.digest}


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    # Yield every number and text of a JSON value with its path of keys, such as ".fits.0.model".
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(inner, f"{path}.{key}")
    else:
        yield path, value


def assert_same_numbers(now: Any, then: Any) -> None:
    # Assert that `now` contains every number of `then` under the same keys.
    today = dict(leaves(now))
    for path, value in leaves(then):
        if isinstance(value, float) and not path.endswith("wall_s"):
            assert today[path] == pytest.approx(value, rel=SAME, abs=1e-9), path
        else:
            assert path in today, path


def fitted(path: Path) -> Any:
    return json.loads(path.read_text())["fits"]


def test_the_toml_files_of_a_release_are_read(release: Path) -> None:
    assert load_rig("rig.toml").virtual is not None
    assert load_specimen("specimen.toml").specimen.length_mm == 30.0
    assert load_protocol("protocol.toml").currents_A == pytest.approx(CURRENTS_A)
    assert load_calibration(release / "calibration.toml").pixels_per_mm == 6.0


def test_the_dataset_of_a_release_is_opened_with_frames_and_edges(release: Path) -> None:
    with open_dataset(release / "run.h5") as dataset:
        assert [state.current_A for state in dataset.states] == pytest.approx(CURRENTS_A)
        assert all(dataset.images(state.index).shape == (1, 208, 176) for state in dataset.states)
        assert len(dataset.edges() or ()) == 4


def test_the_results_of_a_release_are_read(release: Path) -> None:
    (bending,) = read_fits_file(release / "fits.json").fits
    assert bending.initial_shear_modulus.value == pytest.approx(48245.45371789243)
    assert {fit.model for fit in read_fits_file(release / "tensile.json").fits} == {"neo-hookean", "yeoh"}


@pytest.mark.parametrize("name", ["fits.json", "tensile.json"])
def test_the_results_of_a_release_are_written_as_they_were(release: Path, name: str) -> None:
    read_fits_file(release / name).write(release / "again.json")
    assert (release / "again.json").read_text() == (release / name).read_text()


def test_the_dataset_of_a_release_is_fitted_to_the_same_numbers(release: Path, eimi: Callable[[str], None]) -> None:
    eimi("eimi fit run.h5 --model neo-hookean -o again.json --quiet")
    assert_same_numbers(fitted(release / "again.json"), fitted(release / "fits.json"))


def test_the_edges_in_frames_of_a_release_are_detected_at_the_same_positions(
    release: Path, eimi: Callable[[str], None]
) -> None:
    with open_dataset(release / "run.h5") as dataset:
        before = dataset.edges()
    eimi("eimi segment run.h5 --force --quiet")
    with open_dataset(release / "run.h5") as dataset:
        after = dataset.edges()
    assert before is not None
    assert after is not None
    for now, then in zip(after, before, strict=True):
        np.testing.assert_allclose(now.middle_mm, then.middle_mm, atol=1e-6)


def test_the_checkpoint_of_a_release_is_resumed(release: Path, eimi: Callable[[str], None]) -> None:
    # A checkpoint has one line for each generation of the search. The last generation and the result are removed, and
    # the header gets the present versions of the program.
    header, *logged = (release / "fits.log").read_text().splitlines()
    today = json.dumps(json.loads(header) | {"versions": package_versions()})
    (release / "fits.log").write_text("\n".join([today, *logged[:-2]]) + "\n")
    eimi("eimi fit run.h5 --model neo-hookean --checkpoint fits.log --resume -o resumed.json --quiet")
    assert_same_numbers(fitted(release / "resumed.json"), fitted(release / "fits.json"))


def test_the_fit_of_a_release_is_validated_to_the_same_numbers(release: Path, eimi: Callable[[str], None]) -> None:
    eimi("eimi validate run.h5 --fit fits.json -o again.json --quiet")
    assert_same_numbers(
        json.loads((release / "again.json").read_text()), json.loads((release / "validation.json").read_text())
    )


def test_the_fits_of_a_release_are_reported(release: Path, eimi: Callable[[str], None]) -> None:
    eimi("eimi report run.h5 --fit fits.json --fit tensile.json -o report.html --quiet")
    assert re.search(r"48\.2\s*kPa", (release / "report.html").read_text(encoding="utf-8"))


def test_the_fits_of_a_release_are_exported(release: Path, eimi: Callable[[str], None]) -> None:
    for results in ("fits", "tensile"):
        eimi(f"eimi export {results}.json --model neo-hookean --to abaqus --bulk-ratio 2000 -o {results}.inp --quiet")
        assert "*HYPERELASTIC, NEO HOOKE" in (release / f"{results}.inp").read_text().upper()


def test_the_tensile_curve_of_a_release_is_fitted_to_the_same_numbers(
    release: Path, eimi: Callable[[str], None]
) -> None:
    eimi("eimi tensile curve.csv --model neo-hookean --model yeoh --window full -o again.json --quiet")
    assert_same_numbers(fitted(release / "again.json"), fitted(release / "tensile.json"))


def test_the_killed_run_of_a_release_is_recovered(release: Path, eimi: Callable[[str], None]) -> None:
    eimi("eimi recover killed.h5 -o recovered.h5 --quiet")
    with open_dataset(release / "recovered.h5") as dataset:
        assert [state.current_A for state in dataset.states] == pytest.approx(CURRENTS_A[:2])


def test_the_killed_run_of_a_release_is_resumed(release: Path, eimi: Callable[[str], None]) -> None:
    eimi("eimi acquire protocol.toml --specimen specimen.toml --rig rig.toml -o killed.h5 --resume --quiet")
    with open_dataset(release / "killed.h5") as dataset:
        assert [state.current_A for state in dataset.states] == pytest.approx(CURRENTS_A)


@pytest.mark.parametrize("line", COMMANDS)
def test_the_command_lines_of_a_release_are_accepted(line: str) -> None:
    _, name, *arguments = shlex.split(line)
    command: Any = typer.main.get_command(cli.app).commands[name]  # type: ignore[attr-defined]
    command.make_context(name, arguments)


def test_a_command_line_that_no_release_accepts_is_refused() -> None:
    command: Any = typer.main.get_command(cli.app).commands["fit"]  # type: ignore[attr-defined]
    with pytest.raises(Exception, match="No such option"):
        command.make_context("fit", ["run.h5", "--model", "yeoh", "-o", "fits.json", "--mosel", "ogden"])
