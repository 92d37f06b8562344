"""A whole run that is interrupted by a signal or killed leaves the coil off, and its states are stored."""

# The supply is emulated in this process: it outlives the run, and the tests can observe the current in the coil.

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.serve import emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_lab.dataset.reading import open_dataset
from tests.lab.conftest import NAMES, PICTURES, give_many_states
from tests.patience import PATIENCE_S

FOUR_STATES = [0.0, 0.1, 0.2, 0.3]
MANY_STATES = [k / 50 for k in range(50)]


@dataclass
class RunEnd:
    # The exit status of a run, its lines on standard error, and the number of states that were reported as stored.

    status: int
    lines: list[str]

    @property
    def acknowledged(self) -> int:
        return sum(line.startswith("acquire ") for line in self.lines)


def run(bench: Path, driver: str, address: str, after: int, act: Callable[[subprocess.Popen[str]], None]) -> RunEnd:
    # Run `eimi acquire` in another process; call `act` with this process after `after` stored states.
    (bench / "rig.toml").write_text(f"""
name = "emulated"
calibration = "calibration.toml"
supply = {{ driver = "{driver}", address = "{address}", limits = {{ current_A = 1.0, voltage_V = 10.0 }} }}
camera = {{ driver = "opencv", source = "{bench / "recording"}" }}
""")
    command = [sys.executable, "-m", "eimi_lab", "acquire", "protocol.toml", "--specimen", "specimen.toml"]
    lines = []
    with subprocess.Popen(
        [*command, "--rig", "rig.toml", "-o", "run.h5"], cwd=bench, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            lines.append(line.rstrip())
            if line.startswith(f"acquire {after}/"):
                act(process)
        return RunEnd(process.wait(PATIENCE_S), lines)


def assert_off(coil: CoilSupply) -> None:
    assert not coil.state.output
    assert coil.state.set_current_A == 0.0
    WallClock().sleep(0.5)  # wait ten time constants of the coil
    assert abs(coil.coil_current_A()) < 1e-3


def states(path: Path) -> list[float | None]:
    with open_dataset(path) as dataset:
        assert all(dataset.images(state.index).shape == (2, 96, 128) for state in dataset.states)
        return [state.current_A for state in dataset.states]


@pytest.mark.slow
def test_a_run_to_its_end_on_a_serial_port(bench: Path) -> None:
    coil = CoilSupply(WallClock())
    with serve_pty(emulate("korad", coil)) as port:
        ended = run(bench, "korad", port, 99, lambda process: None)
    assert (ended.status, ended.acknowledged) == (0, 4), ended.lines
    assert_off(coil)
    assert states(bench / "run.h5") == FOUR_STATES


@pytest.mark.parametrize(
    ("number", "after", "driver"),
    [
        (signal.SIGTERM, 1, "korad"),
        (signal.SIGINT, 2, "scpi"),
        *(
            pytest.param(number, after, driver, marks=pytest.mark.slow)
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
            for after in (1, 2, 3, 4)
            for driver in ("korad", "scpi")
        ),
    ],
)
def test_a_run_that_a_signal_ends_leaves_the_coil_off_and_every_acknowledged_state_stored(
    bench: Path, number: signal.Signals, after: int, driver: str
) -> None:
    give_many_states(bench)
    coil = CoilSupply(WallClock())
    instrument = emulate(driver, coil)
    with serve_pty(instrument) if driver == "korad" else serve_tcp(instrument) as address:

        def twice(process: subprocess.Popen[str]) -> None:
            process.send_signal(number)
            WallClock().sleep(0.1)
            process.send_signal(number)

        ended = run(bench, driver, address, after, twice)
    assert_off(coil)
    assert ended.acknowledged >= after
    assert states(bench / "run.h5") == MANY_STATES[: ended.acknowledged]
    # The second signal may arrive while the interpreter ends and the default handlers of the system are active again.
    assert ended.status in (128 + number, -number)
    assert ended.lines[-1].startswith(
        f"eimi: stopped by {number.name}: the coil is off, the measured current is below 0.02 A; "
        f"{ended.acknowledged} of 50 states are in run.h5"
    )


def test_a_run_whose_camera_has_no_more_images_ends_with_the_coil_off(bench: Path) -> None:
    give_many_states(bench)
    coil = CoilSupply(WallClock())

    def unplug(process: subprocess.Popen[str]) -> None:
        for number in range(PICTURES, NAMES):
            (bench / "recording" / f"f_{number}.png").unlink()

    with serve_tcp(emulate("scpi", coil)) as address:
        ended = run(bench, "scpi", address, 1, unplug)
    assert_off(coil)
    assert states(bench / "run.h5") == MANY_STATES[: ended.acknowledged]
    assert 1 <= ended.acknowledged < 50
    assert ended.status == 1
    assert "cannot be read as an image" in ended.lines[-1]


@pytest.mark.parametrize("after", [2, *(pytest.param(after, marks=pytest.mark.slow) for after in (1, 3, 4))])
def test_a_kill_loses_no_acknowledged_state(bench: Path, after: int) -> None:
    give_many_states(bench)
    coil = CoilSupply(WallClock())
    with serve_tcp(emulate("scpi", coil)) as address:
        ended = run(bench, "scpi", address, after, subprocess.Popen.kill)
    assert ended.status == -signal.SIGKILL
    assert_off(coil)
    how = "the coil was switched off, the measured current is below 0.02 A"
    assert ended.lines[-1] == f"eimi guardian: the run died; {address}: {how}"
    stored = states(bench / "run.h5")
    assert len(stored) >= ended.acknowledged >= after
    assert stored == MANY_STATES[: len(stored)]
    command = [sys.executable, "-m", "eimi_lab", "recover", "run.h5", "-o", "whole.h5"]
    done = subprocess.run(command, cwd=bench, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    assert done.stdout == f"whole.h5: {len(stored)} states\n"
    assert states(bench / "whole.h5") == stored
