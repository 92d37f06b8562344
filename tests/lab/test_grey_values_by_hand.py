"""Grey values, corrections, weights of colours and the noise of frames agree with calculations by hand."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from eimi_lab.virtual.simulation import _HEXAHEDRON, _QUADRILATERAL, _both_halves
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.intensity import (
    FieldCorrection,
    camera_grey,
    eight_bit,
    full_scale,
    grey,
    in_channels,
    is_coloured,
    mean_grey,
    state_mean,
)
from eimi_lab.vision.projection import Projection, _advantage, _Colours, _measured, _RootSampler
from eimi_lab.vision.settling_statistic import Noise
from tests.shared.small_pictures import CALIBRATION

Array = np.ndarray


def coloured(kind: Any, *values: int) -> Array:
    # Return a picture of 9 x 10 px that is zero but for the colours of one pixel.
    image = np.zeros((9, 10, 3), kind)
    image[4, 5] = values
    return image


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        (coloured(np.uint8, 100, 103, 100), False),  # 255 / 64 = 3.98
        (coloured(np.uint8, 100, 100, 96), True),
        (coloured(np.uint16, 1023, 0, 1023), False),  # 65535 / 64 = 1023.98
        (coloured(np.uint16, 1024, 0, 1024), True),
        (np.zeros((4, 5), np.uint8), False),
        (np.zeros((0, 5, 3), np.uint8), False),
    ],
)
def test_colours_that_differ_by_more_than_rounding_are_colours(image: Array, expected: bool) -> None:
    assert is_coloured(image) is expected


def test_images_are_converted_to_one_or_three_channels() -> None:
    flat = np.arange(20, dtype=np.uint8).reshape(4, 5)
    thrice = np.dstack([flat, flat, flat])
    assert in_channels(flat, True).tolist() == thrice.tolist()
    assert in_channels(thrice, True) is thrice
    assert in_channels(flat, False) is flat
    assert in_channels(thrice, False).tolist() == flat.tolist()
    mixed = coloured(np.uint8, 100, 0, 0)
    assert in_channels(mixed, False) is mixed
    assert mean_grey(flat) is flat
    assert mean_grey(coloured(np.uint8, 100, 0, 50))[4, 5] == 50.0
    assert mean_grey(thrice).dtype == np.float32
    assert camera_grey(coloured(np.uint16, 0, 7, 3)).dtype == np.uint16


def test_the_brightest_channel_is_chosen_on_every_eighth_pixel() -> None:
    image = np.zeros((16, 16, 4), np.uint8)
    image[..., 2] = 9
    image[::8, ::8, 1] = 40
    image[..., 3] = 255  # opacity
    assert grey(image).tolist() == image[..., 1].tolist()
    assert grey(image[..., 2:]).tolist() == image[..., 2].tolist()  # grey values and opacity
    with pytest.raises(ValueError, match=r"not \(3,\)"):
        grey(np.zeros(3))
    odd = np.array([[np.nan, np.inf], [-np.inf, 3.5]])
    assert grey(odd).tolist() == [[0.0, 0.0], [0.0, 3.5]]
    assert grey(odd).dtype == np.float32


def test_values_of_a_camera_are_scaled_by_its_bit_depth() -> None:
    for largest, below in ((255, 0), (1023, 255), (4095, 1023), (16383, 4095), (65535, 16383)):
        assert full_scale(np.array([largest])) == largest
        assert full_scale(np.array([below + 1])) == largest
    assert full_scale(np.array([70_000])) == 65535.0
    assert full_scale(np.zeros((0, 3))) == 255.0
    assert eight_bit(np.array([[0, 512], [1023, 514]], np.uint16)).tolist() == [[0, 128], [255, 128]]


def test_the_mean_of_a_state_counts_its_frames() -> None:
    frames = [np.full((2, 3), value, np.uint8) for value in (10, 20, 60)]
    assert state_mean(frames).tolist() == [[30.0] * 3] * 2
    assert state_mean(frames[:1]).dtype == np.float32
    assert frames[0].tolist() == [[10] * 3] * 2
    with pytest.raises(ValueError, match=r"frame 2 has the shape \(2, 2\), but earlier frames have \(2, 3\)"):
        state_mean([*frames[:2], np.zeros((2, 2))])
    with pytest.raises(ValueError, match="needs at least one frame"):
        state_mean([])


def test_an_image_is_corrected_by_a_dark_frame_and_a_flat_field() -> None:
    dark = np.full((10, 10), 5.0)
    flat = dark + np.linspace(50.0, 150.0, 100).reshape(10, 10)
    image = dark + 0.4 * (flat - dark)
    image[0, 0], image[9, 9] = 255.0, 2.0
    corrected = FieldCorrection(dark, flat).apply(image)
    assert corrected[1:9] == pytest.approx(np.full((8, 10), 40.0), rel=1e-5)
    assert (corrected[0, 0], corrected[9, 9]) == (255.0, 0.0)
    assert FieldCorrection(dark, None).apply(image)[5, 5] == pytest.approx(image[5, 5] - 5.0)
    assert FieldCorrection(None, flat).apply(image)[5, 5] == pytest.approx(image[5, 5] * 105.0 / flat[5, 5], rel=1e-5)
    hole = flat.copy()
    hole[3, 3] = 5.0 + 2.0  # a single dark pixel of a hundred counts as a twentieth of the median
    assert FieldCorrection(dark, hole).apply(image)[3, 3] == pytest.approx(
        min(255.0, (image[3, 3] - 5.0) / 0.05), rel=1e-4
    )
    hole[3, 4] = 7.0
    with pytest.raises(ValueError, match="the flat field is dark in places"):
        FieldCorrection(dark, hole)
    with pytest.raises(ValueError, match="the flat field is dark in places"):
        FieldCorrection(flat, dark)
    lamp = np.dstack([flat, 2.0 * flat, 0.5 * flat])
    kept = FieldCorrection(None, lamp).apply(0.5 * lamp)
    assert kept.reshape(-1, 3) == pytest.approx(np.tile(0.5 * 105.0 * np.array([1.0, 2.0, 0.5]), (100, 1)), rel=1e-5)


def test_a_weighted_sum_of_colours_is_shifted_to_values_from_zero() -> None:
    mixture = Projection("drawn", (0.5, -0.25, 0.25))
    image = np.array([[[255, 0, 255], [0, 255, 0], [100, 40, 20]]], np.uint8)
    expected = [255.0, 0.0, (50.0 - 10.0 + 5.0) + 0.25 * 255.0]
    assert mixture.apply(image)[0] == pytest.approx(expected, abs=1e-3)
    twice = Projection("drawn", (1.0, -0.5, 0.5))
    assert twice.apply(image)[0] == pytest.approx(expected, abs=1e-3)
    assert mixture.apply(image[..., 0]).tolist() == [[255.0, 0.0, 100.0]]
    assert str(mixture) == "drawn (+0.50 blue -0.25 green +0.25 red)"
    assert str(Projection("hue", (0.5, -0.25, 0.25), "CIELAB")) == "hue (+0.50 L -0.25 a +0.25 b)"
    assert str(Projection("red", (0.0, 0.0, 1.0))) == "red"
    light = Projection("light", (1.0, 0.0, 0.0), "CIELAB").apply(image)
    lab = cv2.cvtColor(image.astype(np.float32) / np.float32(255.0), cv2.COLOR_BGR2Lab)
    assert light[0] == pytest.approx(lab[0, :, 0] / 100.0 * 255.0, abs=0.01)
    hue = Projection("hue", (0.0, 1.0, 0.0), "CIELAB").apply(image)
    assert hue[0] == pytest.approx(np.clip(lab[0, :, 1] / 255.0 + 0.5, 0.0, 1.0) * 255.0, abs=0.01)


def test_a_mixture_must_separate_better_than_a_channel_by_a_quarter() -> None:
    red, grey_values = Projection("red", (0.0, 0.0, 1.0)), Projection("grey", (0.1, 0.6, 0.3))
    mixture, other = Projection("discriminant", (0.5, -0.2, 0.3)), Projection("hue", (0.5, -0.2, 0.3))
    assert _advantage(red, mixture) == 1.25
    assert _advantage(red, grey_values) == 1.0
    assert _advantage(mixture, red) == 1.0
    assert _advantage(mixture, other) == 1.0


def test_the_separation_is_a_low_percentile_of_the_steps_over_the_scatter() -> None:
    rng = np.random.default_rng(1)
    samples = [
        _Colours(rng.normal(0.5, 0.02, (40, 3)), tuple(rng.normal(level, 0.03, (40, 3)) for level in (0.2, 0.4)))
        for _ in range(3)
    ]
    weights = np.array([0.5, -0.2, 0.3])
    found = _measured("mixture", weights, "camera", samples)
    steps = []
    for sample in samples:
        inside = sample.inside @ weights
        for side in sample.sides:
            beside = side @ weights
            scatter = np.hypot(inside.std(), beside.std()) + np.sqrt(1.0 / 12.0) / 255.0
            steps.append(abs(np.median(inside) - np.median(beside)) / scatter)
    assert found.separation == pytest.approx(np.percentile(steps, 20))
    assert found.weights == tuple(weights)
    assert (found.name, found.space) == ("mixture", "camera")


@pytest.mark.parametrize(("length_mm", "last"), [(12.0, 1.5), (24.0, 2.4)])
def test_the_colours_of_the_beam_are_read_near_its_clamp(length_mm: float, last: float) -> None:
    # From 0.3 to 1.5 widths (or a fifth of the length) from the clamp: up to a quarter of a width beside the axis are
    # colours of the beam, from 0.75 to 1.25 widths those of its surroundings.
    y, x = np.mgrid[0:112, 0:128]
    image = np.dstack([x, y, np.full_like(x, 200)]).astype(np.uint8)
    sampler = _RootSampler(BeamFrame(CALIBRATION), 2.0, length_mm)
    [found] = sampler.read(image, 255.0, "camera")
    inside = 255.0 * found.inside
    assert inside.shape == (15 * 7, 3)
    assert inside[:, 0].min() == pytest.approx(60.0 - 3.5, abs=0.51)
    assert inside[:, 0].max() == pytest.approx(60.0 + 3.5, abs=0.51)
    assert inside[:, 1].min() == pytest.approx(10.0 + 0.3 * 14.0, abs=0.51)
    assert inside[:, 1].max() == pytest.approx(10.0 + last * 14.0, abs=0.51)
    assert inside[:, 2] == pytest.approx(np.full(105, 200.0))
    assert len(found.sides) == 2
    for side, sign in zip(found.sides, (-1.0, 1.0), strict=True):
        columns = np.sort(60.0 + sign * 14.0 * np.array([0.75, 1.25]))
        assert 255.0 * np.array([side[:, 0].min(), side[:, 0].max()]) == pytest.approx(columns, abs=0.51)
    near = BeamFrame(CALIBRATION.model_copy(update={"clamp_midpoint_px": (8.0, 10.0)}))
    [cut] = _RootSampler(near, 2.0, length_mm).read(image, 255.0, "camera")
    assert len(cut.sides) == 1
    outside = BeamFrame(CALIBRATION.model_copy(update={"clamp_midpoint_px": (8.0, 500.0)}))
    assert _RootSampler(outside, 2.0, length_mm).read(image, 255.0, "camera") == []


def test_the_difference_of_frames_is_divided_by_twice_the_variance_at_their_mean() -> None:
    noise = Noise(np.array([0.0, 100.0, 200.0]), np.array([1.0, 3.0, 2.0]))
    before, after = np.array([[10, 90], [150, 250]], np.uint8), np.array([[14, 90], [140, 251]], np.uint8)
    variances = np.interp((before.astype(float) + after) / 2.0, [0.0, 100.0, 200.0], [1.0, 3.0, 2.0])
    every = np.arange(4)
    expected = np.mean((after.astype(float) - before) ** 2) / np.mean(2.0 * variances)
    assert noise.difference_ratio(before, after, every) == pytest.approx(expected)
    deep = noise.difference_ratio(before.astype(np.uint16), after.astype(np.uint16), every)
    assert deep == pytest.approx(expected)
    chosen = np.array([0, 2])
    assert noise.difference_ratio(before, after, chosen) == pytest.approx(
        np.mean([16.0, 100.0]) / np.mean(2.0 * variances.ravel()[chosen])
    )
    assert len(noise._variances_by_sum) == 511


def test_the_nodes_of_elements_are_written_in_the_order_of_vtk() -> None:
    # Corners, middles of the sides, centres of the faces, and the centre (VTK User's Guide, quadratic cells).
    place = np.array([[a, b, c] for a in range(3) for b in range(3) for c in range(3)], float)[_HEXAHEDRON]
    assert place[:8].tolist() == [
        *([x, y, 0.0] for x, y in ((0, 0), (2, 0), (2, 2), (0, 2))),
        *([x, y, 2.0] for x, y in ((0, 0), (2, 0), (2, 2), (0, 2))),
    ]
    sides = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    assert place[8:20].tolist() == [place[list(side)].mean(axis=0).tolist() for side in sides]
    faces = [(0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7)]
    assert place[20:26].tolist() == [place[list(face)].mean(axis=0).tolist() for face in faces]
    assert place[26].tolist() == [1.0, 1.0, 1.0]
    flat = np.array([[a, b] for a in range(3) for b in range(3)], float)[_QUADRILATERAL]
    assert flat[:4].tolist() == [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]
    assert flat[4:8].tolist() == [flat[[k, (k + 1) % 4]].mean(axis=0).tolist() for k in range(4)]
    assert flat[8].tolist() == [1.0, 1.0]


def test_the_computed_half_of_a_solid_is_mirrored_at_the_middle_of_its_depth() -> None:
    place = np.array([[a, b, c] for a in range(3) for b in range(3) for c in range(3)], float)
    moved = np.random.default_rng(1).normal(0.0, 1.0, (27, 3))
    moved[::3, 2] = 0.0  # at mid-depth
    element = np.arange(27)[None]
    nodes, displacement, elements = _both_halves(place, moved, element)
    assert len(nodes) == len(displacement) == 27 + 18  # the nodes at mid-depth belong to both halves
    assert nodes[:27].tolist() == place.tolist()
    assert elements[0].tolist() == list(range(27))
    other = nodes[elements[1]]
    flipped = place.reshape(9, 3, 3)[:, ::-1].reshape(27, 3) * [1.0, 1.0, -1.0]
    assert other.tolist() == flipped.tolist()
    of_flipped = moved.reshape(9, 3, 3)[:, ::-1].reshape(27, 3) * [1.0, 1.0, -1.0]
    assert displacement[elements[1]] == pytest.approx(of_flipped)
    assert np.unique(nodes, axis=0).shape == nodes.shape
