"""In perspective, a side face of the beam belongs to the beam, although it looks like a shadow."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eimi_lab.config.calibration import Calibration
from eimi_lab.page import by_weights
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.following.in_picture import stated_beam
from tests.shared.phone_photographs import RULER_MM, bent_bodies, clicks, drawn_scene, measured_sizes, photograph


def test_the_width_of_a_side_face_follows_from_depth_and_distance() -> None:
    # The beam is 6 mm deep, 15 mm above the axis of the lens, and its middle is 150 mm from the camera.
    calibration = Calibration(
        pixels_per_mm=10.0,
        clamp_midpoint_px=(500.0, 350.0),
        axis_angle_deg=0.0,
        gravity_angle_deg=90.0,
        stand_off_mm=150.0,
    )
    frame = BeamFrame(calibration)
    beam = stated_beam(frame, 40.0, 4.0, 6.0, frame.view(6.0, (1601, 1001)))
    faces, sigma = beam.side_faces(np.array([[600.0, 350.0], [900.0, 350.0]]), np.array([[0.0, 40.0]] * 2))
    assert faces[0] == pytest.approx([0.0, 0.0])
    assert faces[1] == pytest.approx([15.0 * 150.0 * (1.0 / 147.0 - 1.0 / 153.0) / 4.0] * 2, rel=0.03)
    assert sigma[1] == pytest.approx([np.radians(2.0) * 6.0 / 4.0] * 2)
    enlarged = beam.scaled(2.0, np.array([100.0, 50.0]))
    again, _ = enlarged.side_faces(np.array([[1000.5, 600.5]]), np.array([[0.0, 80.0]]))
    assert again[:, 0] == pytest.approx(faces[:, 0])


def test_a_dark_side_face_is_not_taken_for_a_shadow(tmp_path: Path) -> None:
    # The lower side face is as dark as the shadow behind the beam; the lower edge is at the far face.
    scene = replace(drawn_scene(38, 0.3), grams=(0.0,))
    body = bent_bodies(scene)[0]
    picture = tmp_path / "IMG_0.jpg"
    picture.write_bytes(photograph(scene, body, 0.0, 0))
    rng = np.random.default_rng(1)
    sizes = {key: str(value) for key, value in measured_sizes(scene, rng).items()}
    sizes |= {"length_mm_sigma": "0.2", "width_mm_sigma": "0.02", "depth_mm_sigma": "0.03"}
    found = by_weights.edges(picture, clicks(scene, body.tip, RULER_MM, rng, 0.5), sizes)
    assert "OWN_SHADOW" not in {flag["name"] for flag in found["flags"]}
    far = scene.to_px(body.around[-1])
    lower = max((np.array(found[side]) for side in ("left", "right")), key=lambda points: float(points[:, 1].mean()))
    off = np.linalg.norm(lower[:, None] - far, axis=2).min(axis=1)
    assert np.median(off) < 0.8  # px; the near face is 4 px away
