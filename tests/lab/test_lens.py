"""If the calibration does not give the distance from the lens to the beam, it is estimated from the edges."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import edge_curves, outline, points_on
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.laws import LAWS
from eimi_lab.fits.perspective import seen_depth

DEPTH_MM, CENTRE_MM = 5.0, np.array([15.0, 0.0])


@pytest.fixture(scope="module")
def sides() -> np.ndarray:
    """The edges of the middle plane of a silicone beam in mm, (7 fields, left and right edge, n points, x and y)."""
    model = BeamModel(Specimen(30.0, 3.0, DEPTH_MM, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)))
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along(np.linspace(0, 8, 7)))
    return points_on(edge_curves(model, shapes)[0], 8)[:, :, 1:-1]


def edges_through_lens(sides: np.ndarray, stand_off_mm: float | None, noise_mm: float) -> EdgeObservation:
    """Return the outline of a beam, with noise, as a lens shows it.

    sides: edges of the middle plane in 7 states, (7, 2, n, 2) in mm. stand_off_mm: distance of the lens; None if
    telecentric.
    """
    if stand_off_mm:
        faces = [np.insert(sides, 2, z, axis=-1) for z in (-0.5 * DEPTH_MM, 0.5 * DEPTH_MM)]
        near, far = map(View(CENTRE_MM, stand_off_mm).seen, faces)
        ahead = np.gradient(sides, axis=2)
        outward = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1) * np.array([-1.0, 1.0])[:, None, None]
        sides = np.where(((near - far) * outward).sum(axis=-1, keepdims=True) > 0, near, far)
    noisy = sides + np.random.default_rng(0).normal(0, noise_mm, sides.shape)
    return EdgeObservation(noisy, np.full(sides.shape[:3], noise_mm))


@pytest.mark.parametrize("stand_off_mm", [150.0, 300.0])
def test_the_stand_off_of_an_ordinary_lens_is_measured(sides: np.ndarray, stand_off_mm: float) -> None:
    depth = seen_depth(edges_through_lens(sides, stand_off_mm, 0.003), CENTRE_MM, DEPTH_MM)
    assert depth is not None
    assert stand_off_mm < depth.stand_off_mm < 1.4 * stand_off_mm


@pytest.mark.parametrize("noise_mm", [0.001, 0.003, 0.02])
def test_a_telecentric_lens_is_not_mistaken_for_an_ordinary_one(sides: np.ndarray, noise_mm: float) -> None:
    assert seen_depth(edges_through_lens(sides, None, noise_mm), CENTRE_MM, DEPTH_MM) is None


def test_a_beam_that_is_wider_at_its_tip_is_not_mistaken_for_a_lens(sides: np.ndarray) -> None:
    tapered = sides.copy()
    middle = tapered.mean(axis=1, keepdims=True)
    tapered = middle + (tapered - middle) * np.linspace(1.0, 1.1, tapered.shape[2])[:, None]
    assert seen_depth(edges_through_lens(tapered, None, 0.003), CENTRE_MM, DEPTH_MM) is None


@pytest.mark.parametrize("stand_off_mm", [None, 200.0])
def test_a_solid_that_bows_across_its_depth_is_not_mistaken_for_a_lens(stand_off_mm: float | None) -> None:
    model = SolidBeside(Specimen(30.0, 3.0, DEPTH_MM, 1070.0, "solid", Magnet(4.0, 3.0, 3.0, 1.2, 7500.0)), 20, 2)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), Loads.along(np.linspace(0, 7, 16)))
    view = View(CENTRE_MM, stand_off_mm) if stand_off_mm else None
    depth = seen_depth(
        edges_through_lens(points_on(outline(model, shapes, view)[0], 8)[:, :, 1:-1], None, 0.001), CENTRE_MM, DEPTH_MM
    )
    if stand_off_mm is None:
        assert depth is None
    else:
        assert depth is not None
        assert 0.5 * stand_off_mm < depth.stand_off_mm < 1.5 * stand_off_mm
