"""A small bench for the lab's tests: files that a person would write, frames drawn by hand."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from eimi_lab import cli

SPECIMEN = """
[specimen]
name = "small"
material = "Dragon Skin 10"
length_mm = 10.0
width_mm = 2.0
depth_mm = 2.0
density_kg_m3 = 1070.0
section = "plane-strain"
"""

CALIBRATION = """
pixels_per_mm = 8.0
coil_constant_mT_per_A = 4.7
clamp_midpoint_px = [64.0, 8.0]
axis_angle_deg = 90.0
gravity_angle_deg = 90.0
field_angle_deg = 0.0
"""

PROTOCOL = """
name = "short"
material = "Dragon Skin 10"
frames_per_state = 2

[current]
start_A = 0.0
stop_A = 0.3
step_A = 0.1

[ramp]
rate_A_per_s = 10.0
step_A = 0.1
tolerance_A = 0.02

[limits]
current_A = 1.0
voltage_V = 10.0

[settle]
noise_ratio = 1.5
pairs = 2
drift_window_s = 0.02
timeout_s = 5.0
"""


def draw(seed: int, shift_px: float = 0.0) -> NDArray[np.uint8]:
    """(96, 128): a dark beam, 16 px wide, before a bright noisy background."""
    rng = np.random.default_rng(seed)
    across = np.arange(128) - 64 - shift_px
    profile = 30 + 170 / (1 + np.exp(-(np.abs(across) - 8) / 0.7))
    image = np.tile(profile, (96, 1))
    return np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder with specimen.toml, calibration.toml and protocol.toml of the small bench."""
    for name, text in {"specimen": SPECIMEN, "calibration": CALIBRATION, "protocol": PROTOCOL}.items():
        (tmp_path / f"{name}.toml").write_text(text)
    return tmp_path


@pytest.fixture
def frame() -> Callable[..., NDArray[np.uint8]]:
    """Draws a frame from a seed and a shift in pixels."""
    return draw


@pytest.fixture
def pictures(files: Path) -> Path:
    """Four images in `frames/` and their states.csv, beside the TOML files."""
    folder = files / "frames"
    folder.mkdir()
    lines = ["frame,current_A"]
    for index in (1, 2, 10, 20):
        cv2.imwrite(str(folder / f"frame_{index}.png"), draw(index))
        lines.append(f"frame_{index}.png,{index / 10}")
    (files / "states.csv").write_text("\n".join(lines) + "\n")
    return files


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Runs the command line in this process; exit status and what it said on stderr."""

    def run(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["eimi", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_:
            cli.main()
        return int(exit_.value.code or 0), capsys.readouterr().err

    monkeypatch.setattr(cli, "unwind_on_termination", lambda: None)
    return run
