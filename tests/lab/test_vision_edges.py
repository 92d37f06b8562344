"""The edges that are detected in rendered frames have small errors, and standard deviations that match the errors."""

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest

from eimi_lab.config.specimen import Magnet, SpecimenFile
from eimi_lab.virtual.optics import expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet, tip_angle_deg, tip_angle_sigma_deg
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.intensity import FieldCorrection, state_mean
from tests.shared.rendered_edges import (
    BESIDE,
    CALIBRATION,
    CONDITIONS,
    NOMINAL,
    SIZE,
    SPECIMEN,
    bend,
    errors_px,
    make_bent_scene,
    measure,
    off_middle,
    overall,
    with_silicone_beside,
)


@lru_cache
def photograph(angle_deg, condition="nominal", seed=0):
    beam = bend(SPECIMEN, angle_deg)
    scene = make_bent_scene(CONDITIONS[condition], CALIBRATION, SPECIMEN, beam)
    return expose(scene, np.random.default_rng(seed)), beam, scene


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


@pytest.mark.parametrize("angle_deg", [-75.0, -20.0, 0.0, 45.0, 90.0])
def test_the_error_is_small_in_a_nominal_image(angle_deg):
    image, beam, _ = photograph(angle_deg)
    edges = find_edges(image, CALIBRATION, SPECIMEN)
    for errors in errors_px(edges, beam, CALIBRATION):
        assert len(errors) > 85
        assert abs(errors.mean()) < 0.01
        assert rms(errors) < 0.02
        assert np.abs(errors).max() < 0.1
    assert edges.flags == ()


@pytest.mark.parametrize("condition", ["hard", "defocused"])
@pytest.mark.parametrize("angle_deg", [0.0, 60.0])
def test_the_error_is_limited_in_a_poor_image(condition, angle_deg):
    image, beam, _ = photograph(angle_deg, condition)
    edges = find_edges(image, CALIBRATION, SPECIMEN)
    for errors in errors_px(edges, beam, CALIBRATION):
        assert rms(errors) < 0.05
    assert {flag.name for flag in edges.flags} == ({"DEFOCUS"} if condition == "defocused" else set())


@pytest.mark.parametrize(
    ("condition", "angle_deg"), [("nominal", -110.0), ("nominal", 10.0), ("nominal", 110.0), ("hard", -30.0)]
)
def test_the_computed_deviation_matches_the_scatter(condition, angle_deg):
    [row] = measure(CONDITIONS[condition], (angle_deg,), frames=4, seed=3)
    assert 0.8 < row["pull"] < 1.25


@pytest.mark.parametrize("spacing_mm", [0.16, 0.5, 1.0, 1.5])
def test_the_computed_deviation_matches_the_scatter_at_other_spacings(spacing_mm):
    pulls = []
    for seed in range(4):
        image, beam, _ = photograph(-110.0, seed=seed)
        edges = find_edges(image, CALIBRATION, SPECIMEN, spacing_mm=spacing_mm)
        for errors, side in zip(errors_px(edges, beam, CALIBRATION), (edges.left, edges.right), strict=True):
            pulls.append(errors / (side.sigma_mm * CALIBRATION.pixels_per_mm))
    assert 0.8 < rms(np.concatenate(pulls)) < 1.25


def test_the_computed_deviation_of_a_slender_beam_matches_the_scatter():
    # The beam is 30 times as long as wide; each edge has a hundred points, more than a tenth of the width apart.
    sizes = {"length_mm": 60.0, "width_mm": 2.0}
    magnet = SPECIMEN.magnet.model_copy(update={"width_mm": 2.0})
    specimen = SpecimenFile(specimen=SPECIMEN.specimen.model_copy(update=sizes), magnet=magnet)
    calibration = CALIBRATION.model_copy(update={"pixels_per_mm": 14.0})
    beam = bend(specimen, -60.0)
    scene = make_bent_scene(NOMINAL, calibration, specimen, beam)
    pulls = []
    for seed in range(4):
        edges = find_edges(expose(scene, np.random.default_rng(seed)), calibration, specimen)
        for errors, side in zip(errors_px(edges, beam, calibration), (edges.left, edges.right), strict=True):
            assert len(errors) == 100
            pulls.append(errors / (side.sigma_mm * calibration.pixels_per_mm))
    assert 0.8 < rms(np.concatenate(pulls)) < 1.25


@pytest.mark.parametrize("silicone_px", [0.5, 1.5, 3.0, 6.0])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_thin_silicone_beside_the_magnet(silicone_px, share):
    # The edges have no bias, although every profile crosses the edges of the beam and of the magnet.
    specimen = with_silicone_beside(silicone_px)
    beam = bend(specimen, 30.0)
    beam = off_middle(beam, share * silicone_px / CALIBRATION.pixels_per_mm)
    scene = make_bent_scene(NOMINAL, CALIBRATION, specimen, beam)
    outer_errors, pulls = [], []
    for seed in range(3):
        edges = find_edges(expose(scene, np.random.default_rng(seed)), CALIBRATION, specimen)
        assert edges.flags == ()
        for errors, side in zip(errors_px(edges, beam, CALIBRATION), (edges.left, edges.right), strict=True):
            outer_errors.append(errors[-10:])
            pulls.append(errors[-10:] / (side.sigma_mm[-10:] * CALIBRATION.pixels_per_mm))
    assert abs(np.concatenate(outer_errors).mean()) < 0.01
    assert rms(np.concatenate(pulls)) < 1.25


@pytest.mark.parametrize("row", ["3 px, silicone 30 %", "0.5 px, hard, 40 000 electrons"])
def test_the_computed_deviation_beside_a_narrower_magnet_matches_the_scatter(row):
    optics, silicone_px, _ = BESIDE[row]
    magnet_mm = SPECIMEN.magnet.length_mm
    rows = measure(optics, (-75.0, -10.0, 20.0, 90.0), 2, 5, with_silicone_beside(silicone_px), 0.0, magnet_mm)
    summary = overall(rows)
    assert summary["worst"] < 0.1
    assert 0.75 < summary["pull"] < 1.35


def test_the_computed_deviation_covers_uneven_light_beside_the_magnet():
    optics = replace(NOMINAL, lumps=0.08, silicone_transmission=0.3)
    specimen = with_silicone_beside(0.5)
    pulls = []
    for angle in (-75.0, 0.0, 90.0):
        beam = bend(specimen, angle)
        scene = make_bent_scene(optics, CALIBRATION, specimen, beam)
        edges = find_edges(expose(scene, np.random.default_rng(11)), CALIBRATION, specimen)
        for errors, side in zip(errors_px(edges, beam, CALIBRATION), (edges.left, edges.right), strict=True):
            pulls.append(errors[-12:] / (side.sigma_mm[-12:] * CALIBRATION.pixels_per_mm))
    assert rms(np.concatenate(pulls)) < 1.25


def test_a_body_close_to_the_beam_does_not_count_as_uneven_light():
    # The body is a dark rod 19 px beside the beam.
    beam = bend(SPECIMEN, 0.0)
    scene = make_bent_scene(NOMINAL, CALIBRATION, SPECIMEN, beam)
    image = expose(scene, np.random.default_rng(0))
    alone = find_edges(image, CALIBRATION, SPECIMEN)
    left_px = round(BeamFrame(CALIBRATION).to_px(alone.left.points_mm)[:, 0].mean())
    toward = 1 if left_px > CALIBRATION.clamp_midpoint_px[0] else -1
    image[200:700, [left_px + toward * k for k in range(19, 30)]] = 3
    both = find_edges(image, CALIBRATION, SPECIMEN)
    assert {flag.name for flag in both.flags} <= {"MULTI_CONTOUR"}
    for errors in errors_px(both, beam, CALIBRATION):
        assert rms(errors) < 0.02


@pytest.mark.parametrize("angle_deg", [-15.0, 10.0, 40.0, 75.0])
def test_the_tip_of_a_beam_16_px_wide_is_found(angle_deg):
    # Only six pixels of the edge of the tip are far enough from the two corners.
    calibration = CALIBRATION.model_copy(update={"pixels_per_mm": 16 / 3, "clamp_midpoint_px": (320.3, 50.6)})
    beam = bend(SPECIMEN, angle_deg)
    scene = make_bent_scene(replace(NOMINAL, background=0.7), calibration, SPECIMEN, beam, (640, 512))
    edges = find_edges(expose(scene, np.random.default_rng(0)), calibration, SPECIMEN)
    assert edges.flags == ()
    for errors in errors_px(edges, beam, calibration):
        assert len(errors) > 30
        assert rms(errors) < 0.03


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_clipping_is_measured_on_a_narrow_beam_out_of_focus():
    # The check for saturated grey values gives no numerical warning; the edges are located, and have the flag DEFOCUS.
    calibration = CALIBRATION.model_copy(update={"pixels_per_mm": 16 / 3, "clamp_midpoint_px": (320.3, 50.6)})
    optics = replace(NOMINAL, blur_px=3.5, background=0.7)
    scene = make_bent_scene(optics, calibration, SPECIMEN, bend(SPECIMEN, 0.0), (640, 512))
    for seed in range(3):
        edges = find_edges(expose(scene, np.random.default_rng(seed)), calibration, SPECIMEN)
        assert "DEFOCUS" in {flag.name for flag in edges.flags}
        assert len(edges.left.points_mm) > 25


@pytest.mark.parametrize("angle_deg", [-60.0, 0.0, 60.0])
def test_points_run_from_clamp_to_tip_on_the_right_sides(angle_deg):
    image, beam, _ = photograph(angle_deg)
    edges = find_edges(image, CALIBRATION, SPECIMEN)
    assert edges.left.points_mm[0, 1] < 0 < edges.right.points_mm[0, 1]
    for side, edge in ((edges.left, beam.left), (edges.right, beam.right)):
        steps = np.hypot(*np.diff(side.points_mm, axis=0).T)
        assert steps.max() < 1.1 * steps.min()
        # The points run from clamp to tip, and end a few pixels before both.
        assert 0.1 < np.linalg.norm(side.points_mm[0] - edge[0]) < 0.5
        assert 0.1 < np.linalg.norm(side.points_mm[-1] - edge[-1]) < 0.5
        assert side.sigma_mm.shape == (len(side.points_mm),)
    truth = BeamFrame(CALIBRATION).to_px([beam.left[0], beam.right[0], beam.left[-1], beam.right[-1]])
    np.testing.assert_allclose(edges.corners_px, truth, atol=0.15)


def test_the_given_spacing_of_points_is_obeyed_within_bounds():
    image, _, _ = photograph(0.0)
    coarse = find_edges(image, CALIBRATION, SPECIMEN, spacing_mm=1.0)
    assert np.hypot(*np.diff(coarse.left.points_mm, axis=0).T) == pytest.approx(1.0, rel=0.06)
    assert len(find_edges(image, CALIBRATION, SPECIMEN, spacing_mm=0.001).left.points_mm) == 100


def test_with_dirt_on_every_widely_spaced_point_other_points_are_detected():
    image, _, _ = photograph(0.0)
    clean = find_edges(image, CALIBRATION, SPECIMEN, spacing_mm=3.0).left.points_mm
    dirty = image.copy()
    for x, y in BeamFrame(CALIBRATION).to_px(clean).round().astype(int):
        dirty[y - 6 : y + 7, x - 6 : x + 7] = 20
    edges = find_edges(dirty, CALIBRATION, SPECIMEN, spacing_mm=3.0)
    assert "EDGE_RESIDUAL" in {flag.name for flag in edges.flags}
    assert len(edges.left.points_mm) > 0.6 * len(clean)


def test_a_drawn_picture_without_noise_has_a_positive_deviation():
    # A standard deviation of 0 would be an infinite weight in a fit.
    x, y = np.meshgrid(np.arange(1280.0), np.arange(1024.0))
    dark = ((np.abs(x - 640.0) < 38.0) & (y < 850.0)) | ((np.abs(x - 640.0) < 150.0) & (y < 100.0))
    drawn = cv2.GaussianBlur(np.where(dark, 20.0, 200.0), (0, 0), 1.2).astype(np.uint8)
    edges = find_edges(drawn, CALIBRATION, SPECIMEN)
    for side in (edges.left, edges.right):
        assert len(side.sigma_mm) > 90
        assert (side.sigma_mm * CALIBRATION.pixels_per_mm >= 0.999e-3).all()


@pytest.mark.parametrize(
    "change",
    [
        {"field_angle_deg": 180.0},
        {"axis_angle_deg": 0.0, "field_angle_deg": 90.0, "clamp_midpoint_px": (180.2, 500.7)},
        {"axis_angle_deg": -90.0, "field_angle_deg": 10.0, "clamp_midpoint_px": (640.0, 900.0)},
        {"axis_angle_deg": 78.0},
        {"pixels_per_mm": 10.0},
    ],
)
def test_the_error_is_small_in_any_orientation_hand_and_scale(change):
    calibration = CALIBRATION.model_copy(update=change)
    beam = bend(SPECIMEN, 50.0)
    image = expose(make_bent_scene(NOMINAL, calibration, SPECIMEN, beam), np.random.default_rng(0))
    edges = find_edges(image, calibration, SPECIMEN)
    for errors in errors_px(edges, beam, calibration):
        assert abs(errors.mean()) < 0.01
        assert rms(errors) < 0.02
    assert edges.flags == ()


@pytest.mark.parametrize("magnet_width_mm", [1.5, 2.4, None])
def test_the_error_is_small_with_a_narrow_magnet_and_without_one(magnet_width_mm):
    magnet = None
    if magnet_width_mm:
        magnet = Magnet.model_validate(SPECIMEN.magnet.model_dump() | {"width_mm": magnet_width_mm})
    specimen = SpecimenFile(specimen=SPECIMEN.specimen, magnet=magnet)
    beam = bend(specimen, 30.0)
    image = expose(make_bent_scene(NOMINAL, CALIBRATION, specimen, beam), np.random.default_rng(0))
    edges = find_edges(image, CALIBRATION, specimen)
    for errors in errors_px(edges, beam, CALIBRATION):
        assert rms(errors) < 0.02
    assert edges.flags == ()


def test_the_error_is_small_through_a_distorting_lens():
    calibration = CALIBRATION.model_copy(
        update={
            "camera_matrix": ((1500.0, 0.0, 640.0), (0.0, 1500.0, 512.0), (0.0, 0.0, 1.0)),
            "distortion": (-0.2, 0.08, 0.001, 0.001, 0.0),
        }
    )
    beam = bend(SPECIMEN, 50.0)
    image = expose(make_bent_scene(NOMINAL, calibration, SPECIMEN, beam), np.random.default_rng(0))
    for errors in errors_px(find_edges(image, calibration, SPECIMEN), beam, calibration):
        assert rms(errors) < 0.02


def test_colours_and_bit_depths_keep_the_error_and_a_mean_of_frames_lowers_it():
    image, beam, scene = photograph(30.0)
    rng = np.random.default_rng(3)
    lone = rms(np.concatenate(errors_px(find_edges(image, CALIBRATION, SPECIMEN), beam, CALIBRATION)))
    for picture in (np.dstack([image // 4, image // 3, image]), image.astype(np.uint16) * 16):
        edges = find_edges(picture, CALIBRATION, SPECIMEN)
        assert rms(np.concatenate(errors_px(edges, beam, CALIBRATION))) == pytest.approx(lone, rel=0.1)
        assert edges.flags == ()
    mean = find_edges(state_mean(expose(scene, rng) for _ in range(8)), CALIBRATION, SPECIMEN)
    assert rms(np.concatenate(errors_px(mean, beam, CALIBRATION))) < 0.6 * lone
    assert mean.flags == ()


@pytest.mark.parametrize("angle_deg", [-40.0, 0.0, 70.0])
def test_a_bright_beam_in_front_of_a_dark_background_is_detected(angle_deg):
    image, beam, _ = photograph(angle_deg)
    edges = find_edges(230 - np.minimum(image, 230), CALIBRATION, SPECIMEN)
    for errors in errors_px(edges, beam, CALIBRATION):
        assert abs(errors.mean()) < 0.01
        assert rms(errors) < 0.02
    assert edges.flags == ()
    clipped = np.where(image < 60, 255, 230 - np.minimum(image, 230)).astype(np.uint8)
    assert "SATURATED" in {flag.name for flag in find_edges(clipped, CALIBRATION, SPECIMEN).flags}


def test_dark_frame_and_flat_field_correct_uneven_light_and_pixels():
    optics = replace(NOMINAL, gradient=0.6, vignette=0.4, full_well_e=1e6)
    beam = bend(SPECIMEN, 40.0)
    rows, columns = np.indices(SIZE[::-1])
    dark = 6.0 + 12.0 * (columns % 2)  # the columns of the sensor have different grey values without light
    gain = 1.0 + 0.15 * np.sin(columns / 7.0) * np.sin(rows / 11.0)
    image = dark + gain * make_bent_scene(optics, CALIBRATION, SPECIMEN, beam).mean * 0.8
    nothing = [[-9.0, -9.0], [-8.0, -9.0], [-8.0, -8.0]]
    flat = dark + gain * make_scene(optics, SIZE, nothing).mean * 0.8
    rng = np.random.default_rng(0)
    image = np.rint(image + rng.normal(0, 0.3, image.shape)).astype(np.uint8)
    raw = rms(np.concatenate(errors_px(find_edges(image, CALIBRATION, SPECIMEN), beam, CALIBRATION)))
    corrected = FieldCorrection(np.rint(dark).astype(np.uint8), np.rint(flat).astype(np.uint8)).apply(image)
    edges = find_edges(corrected, CALIBRATION, SPECIMEN)
    better = rms(np.concatenate(errors_px(edges, beam, CALIBRATION)))
    assert better < 0.02
    assert raw > 1.5 * better
    assert edges.flags == ()
    clipped = FieldCorrection(None, np.full(SIZE[::-1], 200, np.uint8)).apply(np.full(SIZE[::-1], 255, np.uint8))
    assert (clipped == 255).all()


def test_blur_does_not_move_a_curved_edge_inward():
    specimen = SpecimenFile(specimen=SPECIMEN.specimen.model_copy(update={"length_mm": 12.0}))
    beam = bend(specimen, 110.0)  # the beam is bent to a radius of 6 mm
    optics = replace(NOMINAL, blur_px=2.4, full_well_e=1e7, bits=16)
    image = expose(make_bent_scene(optics, CALIBRATION, specimen, beam), np.random.default_rng(0))
    for errors in errors_px(find_edges(image, CALIBRATION, specimen), beam, CALIBRATION):
        assert abs(np.median(errors)) < 0.004


def test_the_computed_deviation_of_the_tip_angle_is_that_of_many_draws_of_the_points():
    along = np.arange(100) * 0.1
    rng = np.random.default_rng(0)

    def drawn(noise_mm):
        sides = (np.column_stack([along, np.full(100, y) + noise_mm * rng.normal(size=100)]) for y in (-1.5, 1.5))
        return EdgeSet(*(EdgePoints(side, np.full(100, 0.01)) for side in sides), (), np.full((4, 2), np.nan))

    stated = tip_angle_sigma_deg(drawn(0.0))
    angles = [tip_angle_deg(drawn(0.01)) for _ in range(2000)]
    assert np.std(angles) == pytest.approx(stated, rel=0.06)
    assert np.isnan(
        tip_angle_sigma_deg(EdgeSet(*(EdgePoints(np.zeros((0, 2)), np.zeros(0)),) * 2, (), np.full((4, 2), np.nan)))
    )
