"""A picture with a fault raises the flag (warning) of this fault, and no picture raises an exception."""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.virtual.optics import expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.edges.overlay import CORNER_COLOUR, draw_overlay
from eimi_lab.vision.edges.quality import light_findings
from tests.shared.rendered_edges import CALIBRATION, NOMINAL, SIZE, SPECIMEN, bend, errors_px, make_bent_scene

BEAM = bend(SPECIMEN, 30.0)


@lru_cache
def photograph(**optics):
    scene = make_bent_scene(replace(NOMINAL, **optics), CALIBRATION, SPECIMEN, BEAM)
    return expose(scene, np.random.default_rng(0))


def flags(image, calibration=CALIBRATION, specimen=SPECIMEN):
    raised = {flag.name: flag for flag in find_edges(image, calibration, specimen).flags}
    for flag in raised.values():
        assert np.isfinite(flag.value)
        assert flag.remedy.endswith(".")
    return raised


def specimen(**changes):
    beam = SPECIMEN.specimen.model_copy(update=changes)
    return SpecimenFile(specimen=beam, magnet=SPECIMEN.magnet)


def test_a_clipped_back_light_is_flagged():
    raised = flags(photograph(background=1.2))
    assert set(raised) == {"SATURATED"}
    assert raised["SATURATED"].value > 0.9


def test_an_underexposed_picture_is_flagged():
    raised = flags(photograph(background=0.12))
    assert raised["LOW_CONTRAST"].value == pytest.approx(0.11, abs=0.02)


def test_a_picture_out_of_focus_is_flagged_with_its_blur():
    raised = flags(photograph(blur_px=4.0))
    assert set(raised) == {"DEFOCUS"}
    assert raised["DEFOCUS"].value == pytest.approx(4.0, abs=0.1)


def test_one_speck_on_an_edge_is_left_out_and_many_are_flagged():
    clean = photograph()
    frame = BeamFrame(CALIBRATION)
    speck = clean.copy()
    places = frame.to_px(BEAM.left[200:1300:140]).round().astype(int)
    cv2.circle(speck, places[3].tolist(), 6, 20, -1)
    edges = find_edges(speck, CALIBRATION, SPECIMEN)
    assert edges.flags == ()
    assert len(edges.left.points_mm) < len(find_edges(clean, CALIBRATION, SPECIMEN).left.points_mm)
    assert np.abs(errors_px(edges, BEAM, CALIBRATION)[0]).max() < 0.3
    for place in places:
        cv2.circle(speck, place.tolist(), 6, 20, -1)
    assert "EDGE_RESIDUAL" in flags(speck)


def test_a_beam_that_leaves_the_picture_is_flagged():
    assert "TOUCHES_FRAME" in flags(photograph()[:700])


def test_a_second_body_is_flagged():
    image = photograph().copy()
    cv2.circle(image, (950, 600), 40, 20, -1)
    raised = flags(image)
    assert set(raised) == {"MULTI_CONTOUR"}
    assert raised["MULTI_CONTOUR"].value == 1


def test_two_beams_in_one_clamp_give_no_edges():
    image = photograph()
    shifted = np.minimum(image, np.roll(image, 60, axis=1))  # four fifths of a width beside the first beam
    edges = find_edges(shifted, CALIBRATION, SPECIMEN)
    assert len(edges.left.points_mm) == 0
    assert "WIDTH_ANOMALY" in {flag.name for flag in edges.flags}


def test_a_clamp_that_is_hidden_or_elsewhere_is_flagged():
    outline = BeamFrame(CALIBRATION).to_px(BEAM.outline)
    bare = expose(make_scene(NOMINAL, SIZE, outline), np.random.default_rng(0))
    assert set(flags(bare)) == {"CLAMP_NOT_FOUND"}
    edges = find_edges(bare, CALIBRATION, SPECIMEN)
    assert max(np.abs(errors).max() for errors in errors_px(edges, BEAM, CALIBRATION)) < 0.1
    assert "CLAMP_NOT_FOUND" in flags(np.roll(photograph(), 40, axis=0))


def test_a_round_tip_is_flagged():
    angle = np.linspace(-np.pi / 2, np.pi / 2, 60)
    round_end = np.column_stack([28.5 + 1.5 * np.cos(angle), 1.5 * np.sin(angle)])
    outline = BeamFrame(CALIBRATION).to_px(np.vstack([[0.0, -1.5], round_end, [0.0, 1.5]]))
    clamp = BeamFrame(CALIBRATION).to_px([[0.0, -6.0], [0.0, 6.0], [-10.0, 6.0], [-10.0, -6.0]])
    image = expose(make_scene(NOMINAL, SIZE, outline, None, clamp), np.random.default_rng(0))
    assert "CORNER_AMBIGUOUS" in flags(image)


@pytest.mark.parametrize(
    ("change", "name", "value"),
    [
        ({"width_mm": 3.3}, "WIDTH_ANOMALY", 1 - 3.0 / 3.3),
        ({"length_mm": 34.0}, "LENGTH_ANOMALY", 1 - 30.0 / 34.0),
        ({"length_mm": 26.0}, "LENGTH_ANOMALY", 30.0 / 26.0 - 1),
    ],
)
def test_a_beam_of_another_size_than_in_its_file_is_flagged(change, name, value):
    raised = flags(photograph(), specimen=specimen(**change))
    assert set(raised) == {name}
    assert raised[name].value == pytest.approx(value, abs=0.01)


def test_the_caller_may_change_a_limit():
    edges = find_edges(photograph(), CALIBRATION, SPECIMEN, limits={"blur_px": 0.5})
    assert [flag.name for flag in edges.flags] == ["DEFOCUS"]


HEIGHT, WIDTH = SIZE[1], SIZE[0]
BAD_PICTURES = {
    "black": np.zeros((HEIGHT, WIDTH), dtype=np.uint8),
    "white": np.full((HEIGHT, WIDTH), 255, dtype=np.uint8),
    "noise": np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8),
    "clamp alone": np.where(np.arange(HEIGHT)[:, None] < 100, 0, 200).astype(np.uint8).repeat(WIDTH, axis=1),
    "dark half": np.where(np.arange(WIDTH)[None, :] < 640, 0, 200).astype(np.uint8).repeat(HEIGHT, axis=0),
    "one pixel": np.zeros((1, 1), dtype=np.uint8),
    "nothing": np.zeros((0, 0), dtype=np.uint8),
    "one row": np.zeros((1, WIDTH), dtype=np.uint16),
    "not a number": np.full((100, 100), np.nan),
    "four dimensions": np.zeros((4, 4, 4, 4)),
}


@pytest.mark.parametrize("name", BAD_PICTURES)
def test_a_picture_without_a_beam_gives_no_edges_and_a_flag(name):
    edges = find_edges(BAD_PICTURES[name], CALIBRATION, SPECIMEN)
    assert edges.left.points_mm.shape == edges.right.points_mm.shape == (0, 2)
    assert np.isnan(edges.corners_px).all()
    assert "LOW_CONTRAST" in {flag.name for flag in edges.flags}


SMALL = Calibration(
    pixels_per_mm=8.0,
    coil_constant_mT_per_A=4.7,
    clamp_midpoint_px=(32.0, 8.0),
    axis_angle_deg=90.0,
    gravity_angle_deg=90.0,
    field_angle_deg=0.0,
)
SHORT = SpecimenFile.model_validate(
    {
        "specimen": {
            "name": "short",
            "material": "silicone",
            "length_mm": 5.0,
            "width_mm": 2.0,
            "depth_mm": 2.0,
            "density_kg_m3": 1070.0,
            "section": "plane-stress",
        }
    }
)


@settings(max_examples=150)
@given(
    arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.sampled_from([0, 10, 90, 200, 255])),
    st.integers(1, 16),
)
@example(np.array([[0, 0, 90, 0], [0, 0, 90, 0], [0, 0, 0, 0]], dtype=np.uint8), 15)  # an edge with three points
def test_no_picture_raises_an_exception(tiles, enlarged):
    image = np.kron(tiles, np.ones((enlarged, enlarged), dtype=np.uint8))
    edges = find_edges(image, SMALL, SHORT)
    for side in (edges.left, edges.right):
        assert np.isfinite(side.points_mm).all()
        assert (side.sigma_mm > 0).all()
    assert len(edges.left.points_mm) or edges.flags


def test_the_overlay_shows_edges_and_corners():
    image = photograph()
    edges = find_edges(image, CALIBRATION, SPECIMEN)
    picture = draw_overlay(image, edges, CALIBRATION)
    assert picture.shape == (*image.shape, 3)
    assert picture.dtype == np.uint8
    for points, channel in ((edges.left.points_mm, 0), (edges.right.points_mm, 2)):
        x, y = BeamFrame(CALIBRATION).to_px(points[5:-5]).round().astype(int).T
        coloured = picture[y, x].astype(int)
        assert (coloured[:, channel] > coloured[:, 2 - channel] + 50).all()
    x, y = edges.corners_px[2].round().astype(int)
    green = np.array(CORNER_COLOUR) * 0.7
    assert (np.abs(picture[y - 6 : y + 7, x - 6 : x + 7] - green).sum(axis=2) < 150).any()


@pytest.mark.parametrize("name", ["black", "noise", "one pixel", "not a number"])
def test_the_overlay_of_a_bad_picture_names_its_flags(name):
    image = BAD_PICTURES[name]
    edges = find_edges(image, CALIBRATION, SPECIMEN)
    picture = draw_overlay(image, edges, CALIBRATION)
    height, width = image.shape
    assert picture.shape[1] == max(width, 560)
    assert (picture[height : height + 60, :300, 1] < 100).any()  # red text on white below the picture


def test_the_residual_of_a_picture_is_exceeded_by_a_twentieth_of_its_profiles_and_the_contrast_by_nine_tenths():
    steps = SimpleNamespace(dark=np.zeros(101), bright=np.linspace(0, 200, 101), sound=np.ones(101, bool), blur_px=1.5)
    edge_pass = SimpleNamespace(
        steps=steps, residual=np.linspace(0.0, 1.0, 101), plateau=lambda side: np.full(101, 300.0 if side > 0 else 0.0)
    )
    findings = light_findings(edge_pass, 255.0, False, None)
    assert findings["residual"] == pytest.approx(0.95)
    assert findings["contrast"] == pytest.approx(20.0 / 255.0)
    assert findings["saturated_share"] == 1.0  # gamma is therefore not measured
    assert findings["blur_px"] == 1.5
    assert light_findings(edge_pass, 255.0, True, None)["saturated_share"] == 1.0
