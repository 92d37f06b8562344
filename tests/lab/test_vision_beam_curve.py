"""When a beam is followed from frame to frame, errors near its tip do not add up."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_lab.vision.tracking.beam_curve import DEGREE, BeamCurve

ALONG_PX = np.linspace(18.0, 291.0, 24)


def test_errors_near_the_tip_do_not_add_up_from_frame_to_frame() -> None:
    usual = BeamCurve(np.zeros(2), np.zeros(DEGREE + 1), 300.0)
    rng, weight = np.random.default_rng(1), np.append(np.ones(22), [0.0, 0.0])
    free, held = usual, usual
    for _ in range(200):
        noise = 0.2 * rng.standard_normal(24)
        noise[21] += 3.0  # a finger in front of one edge
        wanted = [noise - curve.at(ALONG_PX)[0][:, 1] for curve in (free, held)]
        free, held = free.moved(ALONG_PX, wanted[0], weight), held.moved(ALONG_PX, wanted[1], weight, usual)
    assert abs(float(held.at(np.array([300.0]))[1][0, 0])) < 0.3
    assert np.hypot(*held.root_px) < 1.0
    assert held.at(ALONG_PX)[0][:20, 1] == pytest.approx(np.zeros(20), abs=1.5)
    assert np.abs(held.coefficients).max() < np.abs(free.coefficients).max()


def test_the_curve_still_follows_a_large_deflection() -> None:
    usual = BeamCurve(np.zeros(2), np.zeros(DEGREE + 1), 300.0)
    curve, deflection = usual, 30.0 * (ALONG_PX / 300.0) ** 2
    for _ in range(6):
        places, normals = curve.at(ALONG_PX)
        wanted = np.column_stack([places[:, 0], 30.0 * (places[:, 0] / 300.0) ** 2])
        curve = curve.moved(ALONG_PX, ((wanted - places) * normals).sum(axis=1), np.ones(24), usual)
    assert curve.at(ALONG_PX)[0][:, 1] == pytest.approx(deflection, abs=0.5)
