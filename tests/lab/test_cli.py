"""The command line prints one line for every mistake of a user; the exit status shows the kind of the mistake."""

from __future__ import annotations

import os
import platform
import re
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from packaging.version import Version
from typer.testing import CliRunner

import eimi_lab
from eimi_drivers import discovery
from eimi_drivers.emulators.coil_line import RemoteCoil
from eimi_drivers.interfaces import Limits
from eimi_drivers.supplies.supply_names import open_supply
from eimi_lab.acquisition.open_coil import attached
from eimi_lab.cli import app
from eimi_lab.commands.examples import EXAMPLES
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.points import Load, TrackedPoints, write_points
from eimi_lab.dataset.reading import open_dataset
from tests.patience import PATIENCE_S

Run = Callable[..., tuple[int, str]]


def eimi(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "eimi_lab", *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


ACQUIRE = ("acquire", "protocol.toml", "--specimen", "specimen.toml", "--rig")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("acqire",), "No such command 'acqire'"),
        (("acqire",), "eimi --help lists the commands"),
        (("acquire",), "Missing argument"),
        (("acquire",), "eimi acquire --help lists its arguments and options"),
        (("acquire", "p", "--rigg", "x"), "--rigg"),
        (("segment",), "Missing argument"),
        (("emulate", "kord"), "SUPPLY = 'kord' should be one of korad, scpi"),
        ((*ACQUIRE, "virtual"), "-o FILE.h5 is missing"),
        ((*ACQUIRE, "virtul", "-o", "x.h5"), "virtul: no such file"),
        (("acquire", "protocol", "--specimen", "type1", "--rig", "virtual", "-o", "x.h5"), "protocol: no such file"),
        (
            ("acquire", "protocol.toml", "--specimen", "protocol.toml", "--rig", "virtual"),
            "protocol.toml: is a protocol",
        ),
        ((*ACQUIRE, "virtual", "-o", "precious.h5"), "precious.h5: exists already"),
        ((*ACQUIRE, "virtual", "-o", "nowhere/x.h5"), "nowhere/x.h5: there is no folder nowhere"),
        ((*ACQUIRE, "virtual", "-o", "x.h5", "--resume", "--force"), "leave out --force and --note"),
        ((*ACQUIRE, "virtual", "-o", "x.h5", "--resume"), "x.h5: no such file to resume"),
        (("segment", "missing.h5"), "missing.h5: no such file"),
        (("segment", "."), ".: is a folder; a dataset is a file"),
        (("segment", "precious.h5"), "precious.h5: is not an HDF5 file"),
        (("segment", "other.h5"), "other.h5: is an HDF5 file, but not a dataset of eimi-lab"),
        (("segment", "points.h5"), "points.h5: holds tracked points"),
        (("recover", "precious.h5", "-o", "x.h5"), "precious.h5: is not an HDF5 file"),
        (("recover", "points.h5", "-o", "precious.h5"), "precious.h5: exists already"),
        (("report", "points.h5", "-o", "pipe", "--force"), "pipe: is a device or a pipe"),
        (("validate", "points.h5", "--fit", "pipe", "-o", "x"), "pipe: is a folder, a device or a pipe, not a file"),
        (("validate", "points.h5", "--fit", "precious.h5", "-o", "x"), "precious.h5: line 1: is not JSON (Expecting"),
        (("validate", "points.h5", "--fit", "precious.h5", "-o", "x"), "expected a file that `eimi fit` or `eimi tens"),
    ],
)
def test_a_mistake_gives_one_line_and_status_2(
    run: Run, files: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(files)
    Path("precious.h5").write_text("precious")
    os.mkfifo("pipe")
    with h5py.File("other.h5", "w") as file:
        file["numbers"] = [1, 2, 3]
    point = TrackedPoints(("a",), np.zeros((1, 2)), np.zeros((1, 2)), np.ones(1))
    write_points(Path("points.h5"), Header(load_specimen("specimen.toml")), 0.0, [Load(None, 1.0, 0.0)], [point])
    before = sorted(Path().iterdir())
    status, printed = run(*arguments)
    assert (status, printed.count("\n")) == (2, 1)
    assert message in printed
    assert sorted(Path().iterdir()) == before
    assert Path("precious.h5").read_text() == "precious"
    assert Path("pipe").is_fifo()


def test_a_misspelt_key_gives_one_line_that_names_the_right_one(files: Path) -> None:
    (files / "specimen.toml").write_text((files / "specimen.toml").read_text().replace("length_mm", "lenght_mm"))
    done = eimi(*ACQUIRE, "virtual", "-o", "x.h5", cwd=files)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "eimi: specimen.toml: specimen.lenght_mm is not a known key; did you mean length_mm?\n"
    assert eimi("--frobnicate", cwd=files).returncode == 2


def test_an_instrument_that_does_not_answer_gives_one_line_and_status_1(files: Path) -> None:
    absent = files / "not-there"
    (files / "rig.toml").write_text(f"""
name = "none"
calibration = "calibration.toml"
supply = {{ driver = "korad", address = "{absent}", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
camera = {{ driver = "opencv", source = 0 }}
""")
    done = eimi(*ACQUIRE, "rig.toml", "-o", "x.h5", cwd=files)
    assert done.returncode == 1
    assert done.stderr.startswith(f"eimi: {absent}: ")
    assert re.search(r"serial ports of this computer: .+; cameras: .+; `eimi instruments` shows more", done.stderr)
    assert done.stderr.count("\n") == 1
    assert not (files / "x.h5").exists()


def test_a_search_that_fails_does_not_hide_the_address_of_the_missing_supply(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> tuple[discovery.Found, ...]:
        raise OSError("this operating system does not list its serial ports")

    monkeypatch.setattr(discovery, "list_serial_ports", fail)
    assert attached().startswith(
        "serial ports of this computer: this operating system does not list its serial ports; cameras: "
    )


def test_a_dry_run_prints_steps_duration_limits_and_messages(files: Path) -> None:
    done = eimi(*ACQUIRE, "virtual", "--dry-run", "-v", cwd=files)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[1] == "limits of the supply: 1 A, 10 V; each ramp changes the current by 10 A/s"
    assert "state 3: 0.3 A, 1.41 mT, 2 frames" in lines
    assert re.fullmatch(r" +[0-9.]+ s  > ISET1:0\.300", next(line for line in lines if "ISET1:0.300" in line))
    assert lines[-2].endswith("> VOUT1?")  # at its end the run measures the current of the output that is off
    assert lines[-1].startswith("duration: ")
    assert sorted(path.suffix for path in files.iterdir()) == [".toml"] * 3


def test_an_emulated_supply_is_served_until_ctrl_c(files: Path) -> None:
    command = [sys.executable, "-m", "eimi_lab", "emulate", "scpi", "--tcp", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        assert server.stdout.readline() == 'driver = "scpi"\n'
        address = server.stdout.readline().split('"')[1]
        line = server.stdout.readline()
        coil = RemoteCoil(line.split('source = "')[1].split('"')[0])
        assert coil.coil_current_A() == 0.0
        coil.close()
        assert server.stdout.readline().endswith(line.split('source = "')[1].split('"')[0] + "\n")
        supply = open_supply("scpi", address, Limits(1.0, 10.0))
        supply.set_current(0.25)
        assert not supply.output_on()
        supply.close()
        server.send_signal(signal.SIGINT)
        assert server.wait(PATIENCE_S) == 130


def test_the_help_shows_every_command_once_in_its_group_with_a_complete_summary() -> None:
    def shown(*arguments: str) -> str:
        return CliRunner().invoke(app, [*arguments, "--help"]).output

    text = shown()
    groups = text[text.index("Measure:") :].split("\n\n")
    assert [group.splitlines()[0] for group in groups] == ["Measure:", "Prepare:", "Fit:", "Other:"]
    rows = [row.split(maxsplit=1) for group in groups for row in group.strip().splitlines()[1:]]
    assert sorted(name for name, _ in rows) == sorted(EXAMPLES)
    for name, summary in rows:
        assert summary.endswith("."), name
        assert "..." not in summary
        assert summary in shown(name)


def test_ctrl_c_while_the_package_is_imported_ends_in_one_line(tmp_path: Path) -> None:
    pressed = "import signal\nsignal.signal(2, signal.default_int_handler)\nsignal.raise_signal(2)\n"
    (tmp_path / "typer.py").write_text(pressed)  # this file is imported instead of the library
    done = eimi("--help", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "eimi: stopped by SIGINT\n")
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert project["scripts"] == {"eimi": "eimi_lab.__main__:main"}


def test_the_versions_of_the_project_and_of_the_packages_behind_results_are_printed(tmp_path: Path) -> None:
    first, second = eimi("--version", cwd=tmp_path).stdout.splitlines()
    assert first == f"eimi-lab {eimi_lab.__version__}" == f"eimi-lab {version('eimi-lab')}"
    release = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["tool"]["setuptools_scm"]
    changes = (Path(__file__).parents[2] / "CHANGELOG.md").read_text()
    newest, *before = re.findall(r"^## \[(\d+\.\d+\.\d+)\]", changes, re.MULTILINE)
    assert release["fallback_version"] == newest
    assert Version(eimi_lab.__version__) >= Version(before[0])  # the newest version may not have a tag yet
    for package in (f"python {platform.python_version()}", f"numpy {np.__version__}", f"h5py {h5py.__version__}"):
        assert package in second.split(", ")
    assert [words.split()[0] for words in second.split(", ")][3:] == ["cma", "h5py", "opencv-python-headless"]


@pytest.mark.parametrize(
    ("arguments", "option", "value", "right"),
    [
        (("emulate", "scpi", "--tcp", "70000"), "--tcp", "70000", "65535"),
        (("fit", "x.h5", "--model", "m", "-o", "x.json", "--workers", "0"), "--workers", "0", "1"),
        (("fit", "x.h5", "--model", "m", "-o", "x.json", "--seed", "7", "--seed", "-3"), "--seed", "-3", "1"),
        (("fit", "x.h5", "--model", "m", "-o", "x.json", "--restarts", "many"), "--restarts", "many", "integer"),
    ],
)
def test_a_number_out_of_range_is_reported_with_its_option_value_and_range(
    run: Run, arguments: tuple[str, ...], option: str, value: str, right: str
) -> None:
    status, message = run(*arguments)
    assert (status, message.count("\n")) == (2, 1)
    assert f"'{option}'" in message
    assert re.search(rf"(^|\W){value}\b", message.replace(option, ""))
    assert re.search(rf"\b{right}\b", message)


def test_instruments_prints_a_line_also_if_nothing_is_attached(tmp_path: Path) -> None:
    done = eimi("instruments", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert re.match(r"(supply|camera): driver = |no supply and no camera was found", done.stdout)


def test_segment_stores_the_edges_and_writes_them_as_files(run: Run, dataset: Path) -> None:
    folder = dataset.parent
    arguments = ("segment", dataset, "--csv", folder / "csv", "--overlay", folder / "overlay")
    status, message = run(*arguments)
    assert (status, message.count("\n")) == (0, 2)  # one line for each state
    table = np.loadtxt(folder / "csv" / "step_00_left.csv", delimiter=",", skiprows=1)
    assert (folder / "csv" / "step_01_right.csv").read_text().startswith("x_mm,y_mm,sigma_mm\n")
    assert np.all(np.diff(table[:, 0]) > 0)
    assert np.abs(np.abs(table[:, 1]) - (71.5 - 55.5) / 16).max() < 0.1
    quality = (folder / "csv" / "quality.json").read_text()
    assert '"NOT_SETTLED"' in quality
    picture = cv2.imread(str(folder / "overlay" / "step_01.png"))
    assert picture.shape[0] > 96  # the picture of the frame, with a text below
    assert picture.shape[1] >= 128
    with open_dataset(dataset) as stored:
        edges = stored.edges()
        assert edges is not None
        assert edges[0].left.points_mm == pytest.approx(table[:, :2], abs=1e-6)
        assert edges[1].flags[0].name == "NOT_SETTLED"
    status, message = run(*arguments)
    assert (status, "csv: is not empty" in message) == (2, True)
    assert run(*arguments, "--force")[0] == 0
