"""Suggested corrections of inputs, and the measured width of a dark body, agree with calculations by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity
from eimi_lab.vision.edges.apparent_width import apparent_width_mm
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.edges.suggested_corrections import (
    SCALES,
    TURNS_DEG,
    _corrections,
    _cut_by_border,
    _is_convincing,
    _is_probably_the_beam,
    _reason_of,
    _shows_nothing,
)
from eimi_lab.vision.flags import judge
from eimi_lab.vision.following.follow import FollowedBeam
from tests.shared.small_pictures import CALIBRATION, SmallPicture, specimen

Array = np.ndarray
FRAME = BeamFrame(CALIBRATION)


@pytest.mark.parametrize(("half", "width"), [(7.0, 2.0), (10.5, 3.0)])
def test_the_apparent_width_is_that_of_the_body_on_the_axis(half: float, width: float) -> None:
    picture = SmallPicture(0.0, (200.0,))
    image = picture.beam(half, (30.0,)).exposed()[..., 0]
    assert apparent_width_mm(image, FRAME, 12.0) == pytest.approx(width, abs=0.05)
    assert apparent_width_mm(255 - image, FRAME, 12.0) == pytest.approx(width, abs=0.05)
    assert (
        apparent_width_mm(
            image[:, 54:], BeamFrame(CALIBRATION.model_copy(update={"clamp_midpoint_px": (6.0, 10.0)})), 12.0
        )
        is None
    )
    assert apparent_width_mm(image[:, :66], FRAME, 12.0) is None


@pytest.mark.parametrize("ends", [(-50.0, 7.0), (-7.0, 50.0)])
def test_a_body_wider_than_the_searched_lines_has_no_apparent_width(ends: tuple[float, float]) -> None:
    # The searched lines reach half a beam length (42 px) to both sides.
    picture = SmallPicture(0.0, (200.0,))
    picture.add(picture.beside(*ends), (30.0,))
    assert apparent_width_mm(picture.exposed()[..., 0], FRAME, 12.0) is None


def test_suggested_corrections_name_every_changed_value() -> None:
    every = list(_corrections(CALIBRATION, 2.0))
    words = [text for _, text in every]
    assert [change["width_mm"] for change, _ in every[:2]] == [1.6, 2.5]
    assert [change["pixels_per_mm"] for change, _ in every[2:6]] == pytest.approx([7.0 * scale for scale in SCALES])
    axes = [change["axis_angle_deg"] for change, _ in every[6:11]]
    assert axes == [130.0, 50.0, -180.0, 0.0, -90.0]
    assert len(TURNS_DEG) == 5
    clamps = [change["clamp_midpoint_px"] for change, _ in every[11:]]
    assert clamps == [(95.0, 10.0), (25.0, 10.0), (60.0, 45.0), (60.0, -25.0)]
    assert words[0] == "width_mm = 1.6, 0.8 times the given value: is the width right?"
    assert words[2] == "pixels_per_mm = 3.5, 0.5 times the given value: is the scale right?"
    assert words[6] == "axis_angle_deg = 130: is the given direction of the beam right?"
    assert words[11] == "clamp_midpoint_px = [95, 10]: is the clamp at the given place?"


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.full((40, 40), 30, np.uint8), "between 30 and 30 of 255: raise the exposure"),
        (np.full((40, 40), 220, np.uint8), "between 220 and 220 of 255: lower the exposure"),
        (np.tile(np.linspace(100, 112, 40), (40, 1)).astype(np.uint8), "raise the exposure"),
        (np.tile(np.linspace(100, 116, 40), (40, 1)).astype(np.uint8), ""),
    ],
)
def test_a_picture_of_one_brightness_needs_another_exposure(image: Array, words: str) -> None:
    assert words in _shows_nothing(image)
    assert bool(words) is bool(_shows_nothing(image))


@pytest.mark.parametrize(
    ("clamp", "cut"),
    [
        ((60.0, 10.0), False),
        ((6.6, 10.0), False),
        ((6.4, 10.0), True),
        ((120.6, 10.0), True),
        ((120.4, 10.0), False),
        ((60.0, 105.0), True),
    ],
)
def test_a_beam_that_begins_outside_the_picture_is_cut(clamp: tuple[float, float], cut: bool) -> None:
    # Both edges begin half a width, 7 px, beside the clamp and half a width ahead of it.
    stated = CALIBRATION.model_copy(update={"clamp_midpoint_px": clamp})
    assert bool(_cut_by_border(np.zeros((112, 128)), stated, specimen())) is cut


def test_a_body_of_nearly_the_length_without_serious_flags_is_convincing() -> None:
    x = np.linspace(0.5, 9.7, 40)
    sides = [EdgePoints(np.column_stack([x, np.full(40, y)]), np.full(40, 0.01)) for y in (-1.0, 1.0)]
    good = EdgeSet(*sides, (), np.zeros((4, 2)))
    assert _is_convincing(good, specimen())  # 9.7 of 12 mm
    cut = EdgeSet(sides[0], EdgePoints(sides[1].points_mm[:-2], np.full(38, 0.01)), (), np.zeros((4, 2)))
    assert not _is_convincing(cut, specimen())
    note = judge({"followed_tip": 1.0})
    assert [flag.severity for flag in note] == [Severity.NOTE]
    assert _is_convincing(replace(good, flags=note), specimen())
    assert not _is_convincing(
        replace(good, flags=judge({"blur_px": 3.0, "width_deviation": 0.07}, words={"even_turn": ""})), specimen()
    )


FINDINGS = {"followed_beyond": 0.85, "followed_gain": 0.6, "followed_width": 0.05, "followed_sides": 0.5}


@pytest.mark.parametrize(
    ("changed", "is_beam"),
    [
        ({}, True),
        ({"followed_beyond": 0.79}, False),
        ({"followed_beyond": 0.8}, True),
        ({"followed_gain": 0.49}, False),
        ({"followed_gain": 0.5}, True),
        ({"followed_width": 0.11}, False),
        ({"followed_click": 0.51}, False),
        ({"followed_click": 0.4}, True),
        ({"followed_sides": 0.9}, False),  # the edges are usable
    ],
)
def test_a_clear_body_of_the_right_size_is_probably_the_beam(changed: dict[str, float], is_beam: bool) -> None:
    followed = FollowedBeam({**FINDINGS, **changed})
    assert _is_probably_the_beam(followed) is is_beam


def test_the_reason_names_the_first_grave_check_of_a_body_that_was_followed() -> None:
    reason = _reason_of(FollowedBeam(FINDINGS))
    assert reason.startswith(
        "a body was followed from the clamp over 85 % of length_mm, but its edges are unusable "
        "(NOT_FOLLOWED 0.5, limit 0.7): see "
    )
    assert reason.endswith("there;")
    assert _reason_of(FollowedBeam({**FINDINGS, "followed_beyond": 0.09})) == ""
    assert _reason_of(FollowedBeam({**FINDINGS, "followed_beyond": 0.1})) != ""
    assert _reason_of(FollowedBeam({"followed_beyond": 0.9})) == ""
