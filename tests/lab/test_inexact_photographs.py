"""Edges in photographs of other laboratories are right although photographs or typed values are inexact."""

import numpy as np
import pytest

from eimi_lab.config.calibration import Picture as Help
from eimi_lab.vision.check import Severity
from tests.shared.perturbed_pictures import CHANGES, perturbed
from tests.shared.real_pictures import pictures

PICTURES = {picture.name: picture for picture in pictures("development")}

pictures_at_hand = pytest.mark.skipif(not PICTURES, reason="../shared/data/pictures does not exist")


@pictures_at_hand
@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_photograph_is_never_wrong_without_a_doubt(change):
    # The changes are of the scale and of the light, noise, a mirror image, JPEG compression and blur.
    picture = PICTURES["diffcal_blue_1"]
    changed = perturbed(picture, change)
    edges = changed.edges()
    scored = picture.score(edges, picture.calibration)  # the coordinates in mm are those of the original picture
    assert not scored.silent(edges)
    assert scored.good
    if change == "mirrored":
        assert np.array_equal(changed.image[:, ::-1], picture.image)


@pictures_at_hand
def test_wrong_edges_without_a_doubt_count_as_silent():
    picture = PICTURES["highspeed_000"]
    edges = picture.edges()
    x, y = picture.calibration.clamp_midpoint_px
    beside = picture.calibration.model_copy(update={"clamp_midpoint_px": (x, y + 6.0)})
    assert not picture.score(edges, picture.calibration).silent(edges)
    assert picture.score(edges, beside).silent(edges)


WRONGLY_STATED = {
    "actuator_bent": ((1099.4, 1019.3), -90.8, 0.953, 0.952),  # a stain hides a part of one edge of the bend
    "cable_blue_tiles": ((152.7, 10.8), 84.9, 1.060, 0.994),  # a joint of the tiles lies beside the clamp
    "fabric_test": ((17.1, 134.1), 12.7, 1.060, 0.984),  # the silhouette of a grey picture is unusable
    "silicone_up": ((138.2, 309.4), -90.2, 1.048, 1.029),  # the border of the shadow is clearer than the edge
}
"""Clamp (px), axis (degrees), and the factors of width and length that a user may state."""


@pictures_at_hand
@pytest.mark.parametrize("name", WRONGLY_STATED)
def test_a_photograph_is_followed_although_clamp_axis_width_and_length_are_inexact(name):
    picture = PICTURES[name]
    clamp, axis_deg, wide, long = WRONGLY_STATED[name]
    beam = picture.specimen.specimen
    size = {"width_mm": wide * beam.width_mm, "length_mm": long * beam.length_mm}
    calibration = picture.calibration.model_copy(update={"clamp_midpoint_px": clamp, "axis_angle_deg": axis_deg})
    specimen = picture.specimen.model_copy(update={"specimen": beam.model_copy(update=size)})
    edges = picture.edges((calibration, specimen))
    assert all(flag.severity is not Severity.UNUSABLE for flag in edges.flags)
    assert picture.score(edges, calibration).good


@pictures_at_hand
def test_a_border_near_the_clamp_that_ends_before_the_edge_is_not_joined_to_the_edge():
    # The border of a tape ends a third of a beam's width before the visible edge of the beam begins.
    picture = PICTURES["silicone_curl"]
    clicks = ((236.3, 267.3), (234.9, 261.5), (425.2, 180.4))
    help_given = (picture.calibration.picture or Help()).model_copy(update={"along_px": clicks})
    calibration = picture.calibration.model_copy(update={"picture": help_given})
    scored = picture.score(picture.edges((calibration, picture.specimen)), calibration)
    assert scored.p95 < 4.0
    assert scored.rms < 3.0
