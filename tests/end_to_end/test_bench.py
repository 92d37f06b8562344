"""The commands of a how-to page measure and fit a beam on an emulated bench."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import pytest

from eimi_lab.config.rig import load_rig
from eimi_lab.dataset.reading import open_dataset
from tests.patience import PATIENCE_S
from tests.shared.emulated_gige import needs_aravis, only_gige_camera

HOWTO = Path(__file__).parents[2] / "docs" / "howto" / "bench.md"
TRUE_PA, TRUE_MT_PER_A = 46390.0, 4.4
ENVIRONMENT = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}

pytestmark = needs_aravis


def commands() -> list[str]:
    # Return the commands of the how-to: serve the bench, measure, fit.
    return re.findall(r"```sh\n(.*?)```", HOWTO.read_text(encoding="utf-8"), re.S)


@contextmanager
def bench_served(command: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    # Run the command that serves a bench, yield when the bench is ready, and end it with Ctrl-C.
    with (
        only_gige_camera(),
        subprocess.Popen(
            ["bash", "-c", f"exec {command}"], cwd=folder, env=ENVIRONMENT, stdout=subprocess.PIPE, text=True
        ) as bench,
    ):
        assert bench.stdout is not None
        try:
            lines = iter(bench.stdout.readline, "")
            assert any("the rig of this bench" in line for line in lines), "the bench ended before it was ready"
            yield bench
        finally:
            bench.send_signal(signal.SIGINT)
            bench.communicate(timeout=PATIENCE_S)


def test_the_two_commands_of_the_howto_end_in_a_fit_with_the_measured_field(tmp_path: Path) -> None:
    serve, measure = commands()
    with bench_served(serve, tmp_path):
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", measure],
            cwd=tmp_path,
            env=ENVIRONMENT,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(
        r"run\.h5: the fit uses the field that hall \(LSCI,MODEL425,\S+\) measured at 6 currents, 4\.\d+ ± \S+ mT/A",
        done.stdout,
    )
    (fit,) = json.loads((tmp_path / "fits.json").read_text())["fits"]
    low_Pa, high_Pa = fit["initial_shear_modulus"]["interval_95"]
    assert low_Pa < TRUE_PA < high_Pa
    with open_dataset(tmp_path / "run.h5") as dataset:
        line, states = dataset.field_line, dataset.states
        assert line is not None
        assert line.mT_per_A == pytest.approx(TRUE_MT_PER_A, abs=4 * line.mT_per_A_sigma)
        assert len(states) == 6
        assert {flag.name for state in states for flag in state.flags} <= {"DROPPED"}  # a busy computer loses frames
        assert "aravis" in " ".join(dataset.instruments())
    rig = load_rig(tmp_path / "bench.toml")
    assert (rig.camera.driver, rig.virtual) == ("aravis", None)
    with h5py.File(tmp_path / "run.h5") as file:
        assert "truth" not in file["entry"]
        assert str(TRUE_PA).encode() not in (tmp_path / "run.h5").read_bytes()
        assert file["entry/instrument/detector/settings/trigger"][()] == b"software"
