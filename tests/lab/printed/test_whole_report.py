"""Every panel (part) of the report of a small measurement has the accepted sentences, tables and figures."""

# Read the differences before you copy a new description over `whole_report.txt` or `notebook_figures.txt`.

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_fitting.inference.doubts.causes import Cause
from eimi_fitting.laws import LAWS
from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.importing import import_frames
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.fit_figures import drawn_errors, drawn_errors_of_several, drawn_law, drawn_residuals
from eimi_lab.fits.prediction import predict_on_each
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.reporting.contents import DatasetContents, ReportContents
from eimi_lab.reporting.frames import load_words
from eimi_lab.reporting.panel import DatasetPanel, all_panels
from eimi_lab.reporting.sections import evidence_for_fits
from tests.lab.printed.described import described, differences

ACCEPTED = Path(__file__).parent


def check(lines: list[str], name: str, folder: Path, relative: float = 0.02, absolute: float = 2e-3) -> None:
    # Assert that the lines agree with the accepted description `name`; write the new description into `folder`.
    # `relative` and `absolute` are the largest differences between numbers.
    lines = [line.replace(version("eimi-lab"), "VERSION") for line in lines]
    (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    accepted = (ACCEPTED / name).read_text(encoding="utf-8").splitlines() if (ACCEPTED / name).exists() else []
    wrong = differences(lines, accepted, relative, absolute)
    assert not wrong, "\n".join([*wrong, f"the new description is {folder / name}"])


def photographed(folder: Path) -> Path:
    (folder / "specimen.toml").write_text(
        '[specimen]\nname = "drawn"\nmaterial = "soft"\nlength_mm = 10.0\nwidth_mm = 2.0\ndepth_mm = 2.0\n'
        'density_kg_m3 = 1070.0\nsection = "plane-stress"\n[magnet]\nlength_mm = 2.0\nwidth_mm = 2.0\n'
        "depth_mm = 1.0\nremanence_T = 1.2\ndensity_kg_m3 = 7500.0\n"
    )
    (folder / "calibration.toml").write_text(
        "pixels_per_mm = 8.0\ncoil_constant_mT_per_A = 4.7\nclamp_midpoint_px = [99.5, 39.5]\naxis_angle_deg = 90.0\n"
        "gravity_angle_deg = 90.0\nfield_angle_deg = 0.0\n"
    )
    (folder / "frames").mkdir()
    rows = ["frame,current_A"]
    for number, bend_px in enumerate((0.0, 4.0, 9.0)):
        fine = np.full((180 * 4, 200 * 4), 200.0, np.float32)
        fine[:160] = 40.0
        along = np.arange(160, 480)
        middles = 4 * (99.5 + bend_px * ((along - 160) / 320.0) ** 2)
        for row, middle in zip(along, middles, strict=True):
            fine[row, round(middle - 30) : round(middle + 34)] = 40.0
        image = cv2.resize(cv2.GaussianBlur(fine, (0, 0), 4.0), (200, 180), interpolation=cv2.INTER_AREA)
        image += np.random.default_rng(number).normal(0.0, 2.0, image.shape).astype(np.float32)
        cv2.imwrite(str(folder / "frames" / f"f_{number}.png"), np.clip(image, 0, 255).astype(np.uint8))
        os.utime(folder / "frames" / f"f_{number}.png", (1.7e9, 1.7e9))
        rows.append(f"f_{number}.png,{0.5 * number}")
    (folder / "states.csv").write_text("\n".join(rows) + "\n")
    specimen, calibration = load_specimen(folder / "specimen.toml"), load_calibration(folder / "calibration.toml")
    import_frames(folder / "frames", folder / "states.csv", specimen, calibration, folder / "photos.h5")
    return folder / "photos.h5"


def test_every_panel_of_a_report_is_as_accepted(
    fit: FitRecord,
    tensile: TensileRecord,
    evidence: Evidence,
    shown: Callable[..., Any],
    choices: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fits.json").write_text("{}")
    paths = [photographed(tmp_path), evidence.path]
    causes = (
        Cause("camera_roll", 0.83, 1.7, "deg", -2.3, "a plumb line"),
        Cause("none", 0.12, 0.0, "1", 0.0, ""),
    )
    history = tuple(replace(one, best_mm=0.5 / k, mean_mm=1.0 / k) for k, one in enumerate(fit.history[:6], 1))
    bending = shown(replace(fit, causes=causes, history=history), choices)
    stretched = replace(shown(tensile), origin="tensile 50 %")
    fits = (bending, stretched)
    evidences, on = zip(*(evidence_for_fits(path, fits, flagged=True) for path in paths), strict=True)
    predictions = dict(predict_on_each(on))
    with open_dataset(paths[0]) as photos, open_dataset(paths[1]) as points:
        datasets = tuple(
            DatasetContents(dataset, evidences[k], predictions[k], f"{k}.h5", bending)
            for k, dataset in enumerate((photos, points))
        )
        report = ReportContents(fits, datasets, datetime(2026, 3, 4, 5, 6, tzinfo=UTC), "eimi report")
        lines: list[str] = []
        for panel in all_panels():
            given: list[Any] = list(datasets) if isinstance(panel, DatasetPanel) else [report]
            for number, content in enumerate(given):
                lines += described(panel.values(content), f"{panel.title} {number}")
    for folder in (tmp_path, paths[1].parent):
        lines = [line.replace(str(folder), "FOLDER") for line in lines]
    lines = [re.sub(r"\b[0-9a-f]{64}\b", "SHA-256", " ".join(line.split())) for line in lines]
    lines = [line for line in lines if not re.search(r"\.versions| UTC$|\d s$", line)]  # of this computer and hour
    check(lines, "whole_report.txt", tmp_path)


def test_the_figures_of_a_notebook_are_as_accepted(tmp_path: Path) -> None:
    arc = np.array([[[0.0, 2.0, 1.0], [0.0, 1.0, 2.0]], [[0.5, 1.5, 2.5], [0.0, 1.2, 2.2]]])
    residuals = np.array([[[0.01, 0.03, 0.02], [-0.01, 0.0, 0.01]], [[0.02, 0.0, -0.02], [0.03, 0.01, 0.05]]])
    yeoh = np.array([50e3, 2e3, 100.0])
    figures = {
        "law": drawn_law(LAWS["yeoh"], yeoh, yeoh * np.array([[0.9], [1.0], [1.2]]), 1.4),
        "law without draws": drawn_law(LAWS["yeoh"], yeoh, np.zeros((0, 3)), 1.4),
        "errors": drawn_errors([0, 1, 2], [0.0, 2.0, 4.0], [0.01, 0.02, 0.03], [0.02, 0.01, 0.01]),
        "errors without a field": drawn_errors([3, 5], [1.0, 1.0], [0.01, 0.02], [0.0, 0.0]),
        "residuals": drawn_residuals(("left", "right"), np.array([1.0, 3.0]), arc, residuals),
        "residuals without a field": drawn_residuals(("left", "right"), np.zeros(2), arc, residuals),
        "several": drawn_errors_of_several({"a": ([0, 1], [0.1, 0.2]), "b": ([0, 2], [0.3, 0.1])}),
    }
    lines = [" ".join(line.split()) for name, drawing in figures.items() for line in described(drawing, name)]
    check(lines, "notebook_figures.txt", tmp_path)


@pytest.mark.parametrize(
    ("field_mT", "force_N", "words"),
    [
        (7.0512, 0.0, "7.05 mT"),
        (0.0, 0.0, "0 mT"),
        (0.0, 2e-3, "2 mN"),
        (-1.5, 0.0123456, "-1.5 mT, 12.3 mN"),
    ],
)
def test_the_load_of_a_state_in_words(field_mT: float, force_N: float, words: str) -> None:
    state: Any = SimpleNamespace(field_mT=field_mT, tip_force_N=force_N)
    assert load_words(state) == words
