"""Single steps of the search for a beam in a picture agree with calculations by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.following.centre_line import CentreLine, carried_line, clicked_line, line_between, off_clamp
from eimi_lab.vision.following.clicks import off_path, with_clicks
from eimi_lab.vision.following.edge_points import StripEdges
from eimi_lab.vision.following.ends import _as_wide_toward_last as as_wide_toward_last
from eimi_lab.vision.following.ends import trim_ends
from eimi_lab.vision.following.follow import FollowedBeam
from eimi_lab.vision.following.in_picture import in_255, stated_beam
from eimi_lab.vision.following.reflections import remove_reflections
from eimi_lab.vision.following.stated import StatedBeam
from eimi_lab.vision.following.working import WorkingPicture, working_picture
from tests.shared.small_pictures import CALIBRATION

Array = np.ndarray
DOWN = np.array([0.0, 1.0])


def straight(free_px: float = 5.0, evidence: float = 0.25, largest_cost: float = 2.0) -> CentreLine:
    # Return a vertical line of 100 px at x = 50, from y = 0.
    points = np.column_stack([np.full(101, 50.0), np.arange(101.0)])
    return CentreLine(points, 100.0, np.full(101, free_px), evidence, largest_cost)


def test_the_stated_beam_has_its_size_and_direction_in_px() -> None:
    for axis_deg in (90.0, 0.0, -150.0):
        frame = BeamFrame(CALIBRATION.model_copy(update={"axis_angle_deg": axis_deg}))
        beam = stated_beam(frame, 12.0, 2.0)
        assert beam.clamp_px == pytest.approx([60.0, 10.0])
        assert math.degrees(beam.axis_rad) == pytest.approx(axis_deg)
        assert beam.ahead == pytest.approx([math.cos(beam.axis_rad), math.sin(beam.axis_rad)])
        assert (beam.width_px, beam.length_px, beam.depth_px) == pytest.approx((14.0, 84.0, 0.0))
        assert beam.vanishing_px is None
        assert beam.clicked_px == 0.0


def test_the_far_face_is_shifted_toward_the_optical_axis_by_the_ratio_of_the_distances() -> None:
    # The far face of a beam of depth d at the distance D has the scale (D - d/2) / (D + d/2) of the near face.
    frame = BeamFrame(CALIBRATION.model_copy(update={"stand_off_mm": 60.0}))
    beam = stated_beam(frame, 12.0, 2.0, 8.0, frame.view(8.0, (128, 112)))
    assert beam.recession == pytest.approx(1.0 - (60.0 - 4.0) / (60.0 + 4.0))
    assert beam.vanishing_px == pytest.approx([63.5, 55.5])
    assert beam.depth_px == pytest.approx(8.0 * 7.0)


def test_a_stated_beam_is_scaled_like_the_centres_of_pixels() -> None:
    line = straight()
    beam = StatedBeam(
        clamp_px=np.array([10.0, 20.0]),
        axis_rad=0.4,
        width_px=5.0,
        length_px=40.0,
        line=line,
        widths=np.array([[0.0, 0.8], [0.5, 1.0], [1.0, 1.4]]),
        depth_px=6.0,
        vanishing_px=np.array([14.0, 16.0]),
        recession=0.1,
    )
    scaled = beam.scaled(2.0, np.array([4.0, 6.0]))
    assert scaled.clamp_px.tolist() == [12.5, 28.5]
    assert (scaled.width_px, scaled.length_px, scaled.depth_px, scaled.axis_rad) == (10.0, 80.0, 12.0, 0.4)
    assert scaled.vanishing_px.tolist() == [20.5, 20.5]
    assert scaled.recession == 0.1
    assert scaled.line.points[10].tolist() == [92.5, 8.5]
    assert (scaled.line.length_px, scaled.clicked_px, beam.clicked_px) == (200.0, 200.0, 100.0)
    assert scaled.line.free_px.tolist() == [10.0] * 101
    assert scaled.relative_width(np.array([0.0, 20.0, 40.0, 60.0])) == pytest.approx([0.8, 0.9, 1.0, 1.2])
    plain = StatedBeam(np.zeros(2), 0.0, 5.0, 40.0)
    assert plain.relative_width(np.array([0.0, 20.0])).tolist() == [1.0, 1.0]
    assert plain.scaled(2.0, np.zeros(2)).vanishing_px is None


def test_a_side_face_is_seen_on_the_side_of_the_optical_axis() -> None:
    beam = StatedBeam(np.zeros(2), 0.0, 4.0, 40.0, depth_px=10.0, vanishing_px=np.array([20.0, 8.0]), recession=0.5)
    places, aside = np.array([[0.0, 0.0], [0.0, 14.0], [0.0, 8.0]]), np.array([[0.0, 4.0], [0.0, 4.0], [0.0, 2.0]])
    faces, sigma = beam.side_faces(places, aside)
    assert faces.tolist() == [[0.0, 0.75, 0.0], [1.0, 0.0, 0.0]]
    uncertain = math.radians(2.0) * 10.0 / 4.0
    assert sigma == pytest.approx(np.array([[0.0, uncertain, 0.0], [uncertain, 0.0, 0.0]]))
    flat = StatedBeam(np.zeros(2), 0.0, 4.0, 40.0).side_faces(places, aside)
    assert [part.tolist() for part in flat] == [[[0.0] * 3] * 2] * 2


def test_a_step_of_the_search_gains_on_the_line_and_costs_beside_it() -> None:
    # The cost beside the line is half the square of the excess distance in half widths, up to the largest cost.
    line = straight()
    x = np.array([50.0, 54.9, 55.1, 65.0, 45.0 - 6.0, 90.0])
    gain = line.gain(x, np.full(6, 40.0), 40.0, 20.0)
    assert gain == pytest.approx([0.25, 0.25, -0.5 * 0.01**2, -0.5, -0.5 * 0.6**2, -2.0])
    assert line.gain(x, np.full(6, 40.0), 100.0, 20.0)[0] == -2.0  # the line is far before this place
    assert line.gain(x, np.full(6, 99.0), 100.0, 20.0)[0] == 0.25
    assert line.gain(x, np.full(6, 99.0), 100.1, 20.0).tolist() == [0.0] * 6


def test_a_step_is_compared_with_the_line_at_about_the_same_distance_from_the_clamp() -> None:
    # The compared part of the line is 0.15 of its length and one width longer and shorter than the path.
    line = straight(free_px=0.0)
    for y, distance in ((75.0, 0.0), (75.4, 0.4), (85.0, 10.0), (25.0, 0.0), (24.6, 0.4)):
        [gain] = line.gain(np.array([50.0]), np.array([y]), 50.0, 10.0)
        assert gain == pytest.approx(0.25 if distance == 0.0 else -min(0.5 * (distance / 5.0) ** 2, 2.0))


def test_the_line_through_one_click_is_the_most_probable_one() -> None:
    # The posterior of a Gaussian process with one measured value has this line and uncertainty.
    click = np.array([110.0, 130.0])
    line = clicked_line(np.array([100.0, 30.0]), DOWN, click[None])
    chord = math.hypot(10.0, 100.0)

    def covariance(one: float, other: float) -> float:
        near, far = min(one, other), max(one, other)
        return 9.0 + 0.01 * one * other + near**2 * (far / 2.0 - near / 6.0) / chord

    variance = covariance(chord, chord) + 25.0
    end = np.array([100.0, 30.0 + chord]) + covariance(chord, chord) / variance * (click - [100.0, 30.0 + chord])
    assert line.points[-1] == pytest.approx(end, abs=1e-6)
    at = 0.5 * chord
    middle = np.array([100.0, 30.0 + at]) + covariance(at, chord) / variance * (click - [100.0, 30.0 + chord])
    half = np.abs(line.points - middle).sum(axis=1).argmin()
    assert np.abs(line.points[half] - middle).max() < 0.5
    left_over = covariance(at, at) - covariance(at, chord) ** 2 / variance
    assert line.free_px[half] == pytest.approx(2.0 * math.sqrt(left_over), rel=0.02)
    assert line.free_px[[0, -1]] == pytest.approx([10.0, 10.0])
    assert (line.evidence, line.largest_cost, len(line.points)) == (0.25, 2.0, 120)
    assert line.clicked_px == line.length_px


def test_the_line_of_an_earlier_picture_is_free_by_a_quarter_of_the_distance() -> None:
    line = carried_line(np.array([[0.0, 0.0], [30.0, 40.0], [30.0, 90.0]]))
    assert line.length_px == 100.0
    assert line.free_px[[0, -1]].tolist() == [10.0, 35.0]
    assert line.points[0].tolist() == [0.0, 0.0]
    assert line.points[-1].tolist() == [30.0, 90.0]
    assert (line.evidence, line.largest_cost, line.clicked_px) == (0.0, 0.15, 0.0)
    between = line_between(line.points, line.points + np.array([6.0, 8.0]))
    assert between.free_px == pytest.approx(np.full(120, 15.0), abs=0.1)
    assert between.points == pytest.approx(line.points + np.array([3.0, 4.0]), abs=0.3)
    assert (between.evidence, between.largest_cost) == (0.25, 2.0)


@pytest.mark.parametrize(
    ("clicks", "left"),
    [
        ([[0.0, 19.9], [0.0, 20.1], [0.0, 19.0], [0.0, 60.0]], [1, 2, 3]),
        ([[0.0, 5.0], [0.0, 20.0]], [1]),
        ([[0.0, 21.0]], [0]),
        ([[0.0, 20.0], [0.0, 50.0]], [1]),
    ],
)
def test_clicks_within_20_px_of_the_clamp_are_left_out(clicks: list[list[float]], left: list[int]) -> None:
    kept = off_clamp(np.zeros(2), np.array(clicks))
    assert kept.tolist() == [[0.0, 0.0], *(clicks[place] for place in left)]


def test_clicks_less_than_40_px_apart_count_as_one_place() -> None:
    # Two clicks on both sides of the beam bend the line only if they are more than 40 px apart.
    bends = []
    for apart in (39.0, 41.0):
        clicks = np.array([[108.0, 130.0], [92.0, 130.0 + math.sqrt(apart**2 - 16.0**2)]])
        line = clicked_line(np.array([100.0, 30.0]), DOWN, clicks)
        bends.append(float(np.ptp(line.points[:, 0])))
    assert bends[0] < 0.01
    assert bends[1] > 5.0


def test_the_distance_of_clicks_from_a_path() -> None:
    path = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    clicks = np.array([[5.0, 3.0], [12.0, -1.0], [13.0, 5.0], [10.0, 14.0], [-3.0, 4.0]])
    assert off_path(path, clicks) == pytest.approx([3.0, math.hypot(2.0, 1.0), 3.0, 4.0, 5.0])


def followed(length_px: float = 90.0) -> FollowedBeam:
    # Return the result of following a vertical path at x = 50 px.
    beam = StatedBeam(np.array([50.0, 0.0]), math.pi / 2.0, 10.0, 100.0)
    working = WorkingPicture(np.zeros((4, 4, 1), np.float32), np.zeros(2), 1.0, beam)
    places = np.column_stack([np.full(10, 50.0), np.linspace(0.0, length_px, 10)])

    class _Strip:
        place = places

    return FollowedBeam({"followed_length": 0.9}, working, _Strip())  # type: ignore[arg-type]


def test_the_farthest_click_is_reported_in_widths_beyond_the_error_of_a_click() -> None:
    clicks = np.array([[53.0, 20.0], [65.0, 40.0], [41.0, 60.0]])
    result = with_clicks(followed(), clicks, 10.0)
    assert result.findings == {"followed_length": 0.9, "followed_click": pytest.approx(0.5)}
    assert result.words["clicks_off"] == "point 2 lies 15 px from the body that was followed"
    assert with_clicks(followed(), clicks[:1], 10.0).findings["followed_click"] == 0.0
    nothing = with_clicks(FollowedBeam({"followed_length": 0.0}), clicks, 10.0)
    assert nothing.findings["followed_click"] == 99.0
    assert nothing.words["clicks_off"] == "no body as wide as width_mm could be followed through the points"
    narrow = FollowedBeam({"followed_px": 3.0})
    assert with_clicks(narrow, clicks, 10.0) is narrow


def test_the_searched_part_of_the_image_contains_every_place_that_the_beam_can_reach() -> None:
    # The part reaches 1.25 lengths and two widths from the clamp.
    image = np.zeros((140, 220, 3), np.float32)
    beam = StatedBeam(np.array([100.2, 50.6]), 0.0, 8.0, 40.0)
    picture = working_picture(image, beam, 16.0)
    assert picture is not None
    assert picture.origin_px.tolist() == [34.0, 0.0]
    assert picture.factor == 2.0
    assert picture.pixels.shape == (2 * 118, 2 * (168 - 34), 3)
    assert picture.beam.clamp_px == pytest.approx([(66.2 + 0.5) * 2.0 - 0.5, (50.6 + 0.5) * 2.0 - 0.5])
    assert working_picture(image[..., :1], beam, 4.0).pixels.shape == (59, 67, 1)
    outside = StatedBeam(np.array([300.0, 50.0]), 0.0, 8.0, 50.0)  # 80 px left of it the picture ends
    assert working_picture(image, outside, 16.0) is None
    inside = StatedBeam(np.array([295.4, 50.0]), 0.0, 8.0, 50.0)
    assert working_picture(image, inside, 16.0).pixels.shape[1] == 2 * (220 - 216)


def test_noise_and_span_of_the_searched_picture() -> None:
    beam = StatedBeam(np.zeros(2), 0.0, 8.0, 40.0)
    rng = np.random.default_rng(0)
    noisy = rng.normal(100.0, 3.0, (200, 200, 1)).astype(np.float32)
    assert WorkingPicture(noisy, np.zeros(2), 1.0, beam).noise == pytest.approx(3.0, rel=0.03)
    ramp = np.tile(np.linspace(0.0, 200.0, 301, dtype=np.float32), (4, 1))[..., None]
    assert WorkingPicture(ramp, np.zeros(2), 1.0, beam).span == pytest.approx(0.98 * 200.0, abs=0.1)
    ramp[:, 150:] += 1000.0
    assert WorkingPicture(ramp, np.zeros(2), 1.0, beam).noise == pytest.approx(0.0, abs=1e-4)


def striped(level: float, around: float, wide: int, channels: int = 3) -> WorkingPicture:
    # Return a picture of the grey value `around`, with a line of the grey value `level` that is `wide` px wide. The
    # expected width of the beam is 16 px.
    pixels = np.full((40, 60, 3), around, np.float32)
    pixels[:, 30 : 30 + wide, :channels] = level
    return WorkingPicture(pixels, np.zeros(2), 1.0, StatedBeam(np.zeros(2), 0.0, 16.0, 40.0))


@pytest.mark.parametrize(
    ("line", "is_removed"),
    [
        ((241.0, 100.0, 4), True),
        ((239.0, 100.0, 4), False),  # not clipped
        ((241.0, 100.0, 5), False),  # wider than 0.3 widths
        ((241.0, 209.0, 4), True),
        ((241.0, 213.0, 4), False),  # hardly brighter than its surroundings
        ((241.0, 100.0, 4, 2), True),
        ((241.0, 100.0, 4, 1), False),  # one of three colours
    ],
)
def test_only_narrow_clipped_lines_are_removed(line: tuple[float, ...], is_removed: bool) -> None:
    picture = striped(*line)  # type: ignore[arg-type]
    removed = remove_reflections(picture).pixels
    assert (removed == line[1]).all() if is_removed else (removed == picture.pixels).all()


def test_the_halo_of_a_reflection_is_removed_too() -> None:
    # The pixels up to 0.12 widths, here 2 px, beside a reflection are replaced, and the next ones are kept.
    picture = striped(250.0, 100.0, 2)
    picture.pixels[:, 28:30] = 160.0
    removed = remove_reflections(picture).pixels
    assert removed.dtype == np.float32
    assert removed[20, 28:35, 0].max() == 100.0
    picture.pixels[:, 27:30, 0] = (160.0, 100.0, 100.0)
    assert remove_reflections(picture).pixels[20, 26:30, 0].tolist() == [100.0, 160.0, 100.0, 100.0]


def kept_of(change: float, begin: float, scatter: float = 0.0, spacing: float = 0.1) -> list[bool]:
    # Return which points of an edge are kept if the width of the beam changes at the distance `begin` from the clamp.
    # All lengths are in widths of the beam, and the edge is 10 widths long. scatter: deviation of the width.
    along = np.arange(0.0, 10.0 + 1e-9, spacing)
    widths = 1.0 + np.where(along > begin, change, scatter * (-1.0) ** np.arange(len(along)))
    return as_wide_toward_last(along, widths).tolist()


@pytest.mark.parametrize(
    ("change", "begin", "kept"),
    [
        (0.027, 9.45, 95),
        (-0.027, 9.45, 95),
        (0.023, 9.45, 101),  # a change by less than 0.025 widths may be noise
        (0.027, 9.25, 93),
    ],
)
def test_an_edge_ends_where_the_width_changes_by_a_fortieth(change: float, begin: float, kept: int) -> None:
    assert kept_of(change, begin) == [True] * kept + [False] * (101 - kept)


@pytest.mark.parametrize(("change", "kept"), [(0.055, 101), (-0.055, 101), (0.065, 95), (-0.065, 95)])
def test_a_change_within_the_scatter_of_the_width_is_kept(change: float, kept: int) -> None:
    # With a median deviation of 0.01 widths, a change of the width by more than 4 · 1.48 · 0.01 is clear.
    assert sum(kept_of(change, 9.45, 0.01)) == kept


@pytest.mark.parametrize(("place", "kept"), [(91, 101), (93, 93)])
def test_only_the_last_part_of_an_edge_is_examined(place: int, kept: int) -> None:
    # The last 0.8 widths are examined: a wrong point 0.9 widths before the end is kept, one at 0.7 widths is not.
    widths = np.ones(101)
    widths[place] = 1.04
    assert as_wide_toward_last(np.arange(101) / 10.0, widths).sum() == kept


def test_the_width_before_the_end_is_extrapolated_by_a_line_and_by_a_parabola() -> None:
    # A body whose width lies between the two continuations keeps its end; another body loses it.
    along = np.arange(101) / 10.0
    bulge = np.maximum(along - 6.5, 0.0) ** 2 * 0.01
    assert as_wide_toward_last(along, 1.0 + bulge).all()
    assert as_wide_toward_last(along, 1.0 + 0.05 * along).all()
    beside = np.where(along > 9.45, 1.0 + 2.0 * bulge, 1.0 + bulge)
    assert as_wide_toward_last(along, beside).sum() == 95


@pytest.mark.parametrize(("wider_before", "kept"), [(6.15, 95), (6.65, 101)])
def test_the_extrapolated_part_is_three_widths_long(wider_before: float, kept: int) -> None:
    # A body that is wider farther from its end does not change the extrapolation; a step in the part does.
    along = np.arange(101) / 10.0
    widths = np.where(along < wider_before, 1.6, 1.0) + np.where(along > 9.45, 0.03, 0.0)
    assert as_wide_toward_last(along, widths).sum() == kept


def test_few_points_do_not_determine_the_width() -> None:
    # Six points before the end are enough for the extrapolation.
    assert kept_of(0.3, 9.45, spacing=0.625)[-1]  # five points
    assert not kept_of(0.3, 9.45, spacing=0.5)[-1]  # six points


def test_both_edges_are_trimmed_at_both_ends_and_a_stated_change_of_the_width_is_kept() -> None:
    along = np.arange(0.0, 10.0 + 1e-9, 0.1)
    wider = np.where(np.abs(along - 5.0) > 4.65, 0.4, 0.0)
    left, right = (
        StripEdges(np.column_stack([x, 20.0 * along]), np.full(101, 0.1), along, 1.0)
        for x in (-10.0 - 5.0 * wider, 10.0 + 5.0 * wider)
    )
    for edge in trim_ends(left, right, 20.0):
        assert 0.2 < edge.along[0] < 0.6
        assert 9.4 < edge.along[-1] < 9.8
        assert edge.points[:, 1] == pytest.approx(20.0 * edge.along)
        assert len(edge.points) == len(edge.sigma) == len(edge.along)


def test_a_stated_change_of_the_width_is_kept() -> None:
    along = np.arange(0.0, 10.0 + 1e-9, 0.1)
    half = 10.0 * (1.0 + 0.02 * np.maximum(along - 9.0, 0.0))
    left, right = (
        StripEdges(np.column_stack([x, 20.0 * along]), np.full(101, 0.1), along, 1.0) for x in (-1.5 * half, 1.5 * half)
    )
    assert trim_ends(left, right, 30.0, lambda place: 1.0 + 0.02 * np.maximum(place - 9.0, 0.0))[0] is left
    half += np.where(along > 9.55, 0.5, 0.0)
    moved = StripEdges(np.column_stack([1.5 * half, 20.0 * along]), np.full(101, 0.1), along, 1.0)
    assert trim_ends(left, moved, 30.0)[1].along[-1] < 9.8


def test_images_of_any_kind_become_values_up_to_255() -> None:
    assert in_255(np.array([[0, 255], [128, 64]], np.uint8)).tolist() == [[[0.0], [255.0]], [[128.0], [64.0]]]
    assert in_255(np.full((2, 2), 65535, np.uint16)).max() == 255.0
    assert in_255(np.full((2, 2), 4095, np.uint16))[0, 0, 0] == 255.0
    assert in_255(np.array([[np.nan, np.inf], [-np.inf, 7.0]])).ravel().tolist() == [0.0, 0.0, 0.0, 7.0]
    assert in_255(np.zeros((2, 2, 4))).shape == (2, 2, 3)
