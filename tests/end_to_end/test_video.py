"""A video of a coloured beam leads to its modulus, by the steps of a user."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.virtual.virtual_rig import open_virtual_rig
from tests.patience import PATIENCE_S

FRAMES, RATE_HZ = 6, 30.0  # number of frames in each state; the video is compressed and noisy
RED, WALL = np.array([50.0, 45.0, 205.0]), np.array([185.0, 200.0, 210.0])  # blue, green, red


def film(folder: Path) -> float:
    # Write run.mp4 of a red beam in four fields, and states.csv; return the hidden modulus (Pa).
    supply, camera, clock, truth = open_virtual_rig(load_rig("virtual"), load_specimen("type1"))
    supply.set_voltage(12.0)
    supply.set_output(True)
    rng = np.random.default_rng(0)
    rows, number, video = ["time_s,current_A"], 0, None
    for current_A in (0.0, 0.4, 0.8, 1.2):
        supply.set_current(current_A)
        clock.sleep(3.0)
        rows.append(f"{(number + FRAMES // 2) / RATE_HZ:.4f},{current_A}")
        for _ in range(FRAMES):
            light = np.clip(camera.grab(1.0).image / 200.0, 0.0, 1.2)[..., None]
            image = RED + (WALL - RED) * light + rng.normal(0.0, 2.0, (*light.shape[:2], 3))
            if video is None:
                size = light.shape[1::-1]
                video = cv2.VideoWriter(str(folder / "run.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, size)
            video.write(np.clip(image, 0, 255).astype(np.uint8))
            number += 1
    if video is not None:
        video.release()
    (folder / "states.csv").write_text("\n".join(rows) + "\n")
    return float(truth["parameters"]["mu_Pa"])


@pytest.mark.slow
def test_a_video_of_a_beam_gives_its_modulus(tmp_path: Path) -> None:
    modulus = film(tmp_path)
    for line in (
        "import run.mp4 --states states.csv --specimen type1 --calibration virtual_calibration -o run.h5",
        "segment run.h5",
        "fit run.h5 --model neo-hookean -o fits.json",
    ):
        command = [sys.executable, "-m", "eimi_lab", *line.split()]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert done.returncode == 0, done.stderr
    assert "4 of 4 states used" in done.stdout
    (fit,) = json.loads((tmp_path / "fits.json").read_text())["fits"]
    assert fit["initial_shear_modulus"]["value"] == pytest.approx(modulus, rel=0.01)
