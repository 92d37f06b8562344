"""The points of a film lie at rest where the specimen file says that the beam is at rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.moving.film import Film
from eimi_lab.dataset.moving.filmed_motion import points_of_film
from eimi_lab.vision.beam_frame import BeamFrame


def arc_mm(along_mm: np.ndarray) -> np.ndarray:
    # Return points (x, y) of an arc with the radius 100 mm at distances from the clamp along the arc.
    turns = along_mm / 100.0
    return 100.0 * np.stack([np.sin(turns), 1 - np.cos(turns)], axis=1)


def test_an_unloaded_beam_that_is_cast_as_an_arc_is_filmed_at_its_places_at_rest(tmp_path: Path) -> None:
    rows = ", ".join(f"[{x:.6f}, {y:.6f}]" for x, y in arc_mm(np.linspace(0.0, 40.0, 21)))
    path = tmp_path / "arc.toml"
    path.write_text(
        '[specimen]\nname = "arc"\nmaterial = "silicone"\nlength_mm = 40.0\nwidth_mm = 4.0\ndepth_mm = 10.0\n'
        f"density_kg_m3 = 1070.0\nrest_shape = [{rows}]\n"
    )
    calibration = Calibration(
        pixels_per_mm=8.0, clamp_midpoint_px=(52.0, 41.0), axis_angle_deg=10.0, gravity_angle_deg=90.0
    )
    along_mm = np.linspace(2.0, 38.0, 12)
    middle_px = BeamFrame(calibration).to_px(arc_mm(along_mm))[None]
    points = points_of_film(
        Film(along_mm, middle_px, middle_px, middle_px), calibration, load_specimen(path), np.zeros(1)
    )
    np.testing.assert_allclose(points.points_mm[0], points.rest_mm, atol=2e-3)
