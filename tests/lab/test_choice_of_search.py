"""The program chooses between two searches for the edges of a beam in a picture."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_lab.config.calibration import Picture
from eimi_lab.process.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges import finding
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.edges.finding import _followed_edges, _is_in_doubt, _passes_beside, find_edges, follow_beam
from eimi_lab.vision.edges.region import region_of
from eimi_lab.vision.following.centre_line import carried_line, clicked_line, line_between
from eimi_lab.vision.following.edge_points import StripEdges
from eimi_lab.vision.following.follow import FollowedBeam
from eimi_lab.vision.projection import Projection
from tests.shared.small_pictures import CALIBRATION, specimen

Array = np.ndarray
FRAME = BeamFrame(CALIBRATION)
COLOUR, GREY = np.full((112, 128, 3), 90, np.uint8), np.full((112, 128), 90, np.uint8)
WORDS = {"even_turn": "", "twist_effect": ""}


def search_with(**findings: float) -> Any:
    return SimpleNamespace(findings=findings, limits=None, words=lambda: WORDS)


@pytest.mark.parametrize(
    ("image", "lit", "findings", "is_doubted"),
    [
        (COLOUR, False, {}, False),
        (COLOUR, False, {"other_bodies": 1.0}, True),
        (COLOUR, False, {"clamp_seen": 0.4}, True),
        (COLOUR, True, {"hole_share": 0.01}, True),
        (COLOUR, False, {"blur_px": 9.0, "contrast": 0.0}, False),  # not of the outline
        (GREY, False, {"other_bodies": 1.0, "residual": 0.5, "corner_turn_deg": 5.0}, False),
        (GREY, False, {"touches_frame": 1.0}, True),
        (GREY, True, {"other_bodies": 1.0}, False),
        (GREY, True, {"residual": 0.5}, True),
        (GREY, True, {"residual": 0.1}, False),  # doubtful, but not unusable
        (GREY, True, {"corner_turn_deg": 5.0}, True),
    ],
)
def test_the_silhouette_is_in_doubt_by_the_findings_of_its_outline(
    image: Array, lit: bool, findings: dict[str, float], is_doubted: bool
) -> None:
    assert _is_in_doubt(image, search_with(**findings), lit) is is_doubted


def edges_mm(half_mm: float = 1.0) -> tuple[EdgePoints, EdgePoints, Array]:
    x = np.linspace(0.0, 12.0, 25)
    left, right = (EdgePoints(np.column_stack([x, np.full(25, y)]), np.full(25, 0.01)) for y in (-half_mm, half_mm))
    return left, right, np.full((4, 2), 7.0)


@pytest.mark.parametrize(("x", "passes"), [(60.0, False), (76.9, False), (77.1, True), (43.1, False), (42.9, True)])
def test_a_click_ten_pixels_beside_the_edge_belongs_to_another_body(x: float, passes: bool) -> None:
    # The beam is 14 px wide: a click may lie 7 px + 10 px from its middle line at x = 60 px.
    assert _passes_beside(edges_mm(), FRAME, np.array([[60.0, 30.0], [x, 52.0]])) is passes


def followed_strips(**findings: float) -> FollowedBeam:
    y = np.linspace(10.0, 90.0, 20)
    left, right = (
        StripEdges(np.column_stack([np.full(20, x), y]), np.full(20, sigma), y, 1.0)
        for x, sigma in ((67.0, 0.7), (53.0, 1.4))
    )
    return FollowedBeam({"followed_stretch": 0.9, **findings}, edges=(left, right))


def test_followed_edges_are_given_in_mm_with_the_left_one_at_negative_y() -> None:
    # With the hand -1, the left side of the path is the side of positive y.
    assert FRAME.hand == -1.0
    found = _followed_edges(followed_strips(), FRAME, None)
    assert found is not None
    left, right, corners = found
    assert left.points_mm[:, 1] == pytest.approx(np.full(20, -1.0))
    assert right.points_mm[:, 1] == pytest.approx(np.full(20, 1.0))
    assert left.points_mm[[0, -1], 0] == pytest.approx([0.0, 80.0 / 7.0])
    assert left.sigma_mm == pytest.approx(np.full(20, 1.4 / 7.0))
    assert right.sigma_mm == pytest.approx(np.full(20, 0.7 / 7.0))
    assert np.isnan(corners).all()
    mirrored = BeamFrame(CALIBRATION.model_copy(update={"field_angle_deg": 180.0}))
    same = _followed_edges(followed_strips(), mirrored, None)
    assert same is not None
    assert same[0].sigma_mm == pytest.approx(np.full(20, 0.7 / 7.0))
    assert same[0].points_mm[:, 1] == pytest.approx(np.full(20, -1.0))
    assert _followed_edges(followed_strips(followed_sides=0.5), FRAME, None) is None
    assert _followed_edges(followed_strips(followed_sides=0.5), FRAME, {"followed_sides": 0.4}) is not None
    assert _followed_edges(FollowedBeam({"followed_stretch": 0.9}), FRAME, None) is None


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    # Replace the search along the beam, and return the list of its arguments.
    arguments: list[Any] = []

    def follow(*values: Any) -> FollowedBeam:
        arguments[:] = values
        return FollowedBeam({"followed_length": 0.2})

    monkeypatch.setattr(finding, "follow", follow)
    return arguments


def test_the_beam_is_followed_in_grey_values_up_to_255_from_its_stated_place(given: list[Any]) -> None:
    image = np.full((112, 128), 1023, np.uint16)
    found = follow_beam(image, CALIBRATION, specimen(), spacing_mm=0.4)
    pixels, stated, spacing_px, polarity, earlier = given
    assert (pixels.shape, pixels.max()) == ((112, 128, 1), 255.0)
    assert stated.clamp_px.tolist() == [60.0, 10.0]
    assert (stated.width_px, stated.length_px) == pytest.approx((14.0, 84.0))
    assert (stated.line, stated.vanishing_px, polarity) == (None, None, None)
    assert spacing_px == pytest.approx(2.8)
    assert earlier() is None
    assert found.findings == {"followed_length": 0.2}
    follow_beam(image, CALIBRATION, specimen())
    assert given[2] == pytest.approx(0.3 * 7.0)
    before = SimpleNamespace(middle_mm=np.array([[0.0, 0.0], [6.0, 1.0]]))
    follow_beam(image, CALIBRATION, specimen(), earlier=lambda: before)  # type: ignore[arg-type,return-value]
    assert given[4]() == pytest.approx(np.array([[60.0, 10.0], [67.0, 52.0]]))
    follow_beam(image, CALIBRATION, specimen(), earlier=lambda: None)
    assert given[4]() is None


@pytest.mark.parametrize(("shape", "is_followed"), [((16, 20), True), ((15, 20), False), ((20, 15, 3), False)])
def test_a_picture_smaller_than_16_px_is_not_searched(
    given: list[Any], shape: tuple[int, ...], is_followed: bool
) -> None:
    found = follow_beam(np.zeros(shape, np.uint8), CALIBRATION, specimen())
    assert bool(given) is is_followed
    assert found.findings == {"followed_length": 0.2 if is_followed else 0.0}
    assert follow_beam(np.zeros(40), CALIBRATION, specimen()).findings == {"followed_length": 0.0}


@pytest.mark.parametrize(("stand_off_mm", "in_perspective"), [(4.0, False), (4.1, True), (None, False)])
def test_a_lens_farther_than_the_depth_gives_a_perspective(
    given: list[Any], stand_off_mm: float | None, in_perspective: bool
) -> None:
    near = CALIBRATION.model_copy(update={"stand_off_mm": stand_off_mm})
    follow_beam(COLOUR, near, specimen(depth_mm=4.0))
    assert (given[1].vanishing_px is not None) is in_perspective
    if in_perspective:
        assert given[1].depth_px == pytest.approx(28.0)
        assert given[1].vanishing_px == pytest.approx([63.5, 55.5])


def test_clicks_an_earlier_line_or_two_lines_give_the_expected_centre_line(given: list[Any]) -> None:
    clicks = ((60.0, 50.0), (70.0, 90.0))
    clicked = CALIBRATION.model_copy(update={"picture": Picture(along_px=clicks, polarity="dark")})
    found = follow_beam(COLOUR, clicked, specimen())
    expected = clicked_line(np.array([60.0, 10.0]), np.array([0.0, 1.0]), np.array(clicks))
    assert given[1].line.points == pytest.approx(expected.points)
    assert given[1].line.evidence == 0.25
    assert given[3] == "dark"
    assert found.findings["followed_click"] == 99.0
    line = np.array([[1.0, 0.1], [6.0, 0.5], [11.0, 1.5]])
    later = line * [1.0, 2.0]
    carried = follow_beam(COLOUR, clicked, specimen(), expected_mm=line)
    in_px = FRAME.to_px(np.vstack([[0.0, 0.0], line]))
    assert given[1].line.points == pytest.approx(carried_line(in_px).points)
    assert given[1].line.evidence == 0.0
    assert "followed_click" not in carried.findings
    follow_beam(COLOUR, clicked, specimen(), expected_mm=line, between_mm=later)
    other = FRAME.to_px(np.vstack([[0.0, 0.0], later]))
    assert given[1].line.points == pytest.approx(line_between(in_px, other).points)


def test_weights_of_colours_are_used_if_the_calibration_asks_for_them(given: list[Any]) -> None:
    image = COLOUR.copy()
    image[..., 2] = 200
    red = Projection("red", (0.0, 0.0, 1.0))
    follow_beam(image, CALIBRATION, specimen(), projection=red)
    assert given[0].shape == (112, 128, 3)
    for asked in (Picture(channel="red"), Picture(beam_colour=(200, 40, 30))):
        follow_beam(image, CALIBRATION.model_copy(update={"picture": asked}), specimen(), projection=red)
        assert given[0].shape == (112, 128, 1)
        assert given[0].mean() == pytest.approx(200.0)
    follow_beam(image, CALIBRATION.model_copy(update={"picture": Picture(channel="red")}), specimen())
    assert given[0].shape == (112, 128, 3)
    plain = CALIBRATION.model_copy(update={"picture": Picture(polarity="bright")})
    follow_beam(image, plain, specimen(), projection=red)
    assert given[0].shape == (112, 128, 3)
    assert given[3] == "bright"


class Silhouettes:
    # Stand-in for the search for a silhouette; class attributes are its results.

    outlined: Any = None
    of_outline: dict[str, float]
    of_edges: dict[str, float]
    located: Any
    asked: list[Any]

    def __init__(self, frame: Any, scale: float, specimen_file: Any, findings: dict[str, float], limits: Any) -> None:
        self.frame, self.findings, self.limits = frame, findings, limits
        self.projection: Any = None
        self.polarity: Any = None

    def find_outline(self, image: Array) -> Any:
        self.findings.update(self.of_outline)
        return self.outlined

    def locate_edges(self, outlined: Any, spacing_mm: float) -> Any:
        self.asked.append((spacing_mm, self.projection, self.polarity))
        self.findings.update(self.of_edges)
        return self.located

    def words(self) -> dict[str, str]:
        return WORDS


DARK = SimpleNamespace(picture=SimpleNamespace(lit_beam=False))


@pytest.fixture
def searched(monkeypatch: pytest.MonkeyPatch) -> Any:
    def call(
        image: Array = COLOUR,
        outlined: Any = DARK,
        of_outline: Any = None,
        of_edges: Any = None,
        located: Any = "edges",
        followed: FollowedBeam | None = None,
        picture: Picture | None = None,
        **options: Any,
    ) -> tuple[Any, Any, int]:
        asked: list[Any] = []
        followings: list[Any] = []
        good = {"clamp_seen": 1.0, "contrast": 0.8}
        results = {
            "outlined": outlined,
            "of_outline": {**good, **(of_outline or {})} if outlined else {},
            "of_edges": of_edges or {},
            "located": edges_mm() if located == "edges" else located,
            "asked": asked,
        }
        monkeypatch.setattr(finding, "BackLitSearch", type("Search", (Silhouettes,), results))

        def follow(*_: Any, **given: Any) -> FollowedBeam:
            followings.append(given)
            return followed or FollowedBeam({"followed_length": 0.1})

        monkeypatch.setattr(finding, "follow_beam", follow)
        calibration = CALIBRATION.model_copy(update={"picture": picture})
        return find_edges(image, calibration, specimen(), **options), asked, len(followings)

    return call


def names(edges: Any) -> list[str]:
    return [flag.name for flag in edges.flags]


def test_a_silhouette_without_doubt_gives_the_edges(searched: Any) -> None:
    edges, asked, followings = searched(of_edges={"blur_px": 3.0}, spacing_mm=0.5, calibration_age_days=12.0)
    assert (names(edges), followings) == (["DEFOCUS"], 0)
    assert edges.left.points_mm[:, 1].tolist() == [-1.0] * 25
    assert (edges.corners_px == 7.0).all()
    assert asked == [(0.5, None, None)]
    assert (edges.calibration_digest, edges.calibration_age_days) == (CALIBRATION.digest, 12.0)
    old, _, _ = searched(calibration_age_days=91.0)
    assert names(old) == ["CALIBRATION_STALE"]
    weights = Projection("red", (0.0, 0.0, 1.0))
    _, asked, _ = searched(projection=weights, picture=Picture(polarity="dark"))
    assert asked == [(0.3, weights, "dark")]
    strict, _, _ = searched(of_edges={"blur_px": 2.0}, limits={"blur_px": 1.5})
    assert names(strict) == ["DEFOCUS"]


@pytest.mark.parametrize(
    "doubt", [{"of_outline": {"other_bodies": 1.0}}, {"of_edges": {"residual": 0.2}}, {"located": None}]
)
def test_followed_edges_replace_a_doubtful_silhouette(searched: Any, doubt: dict[str, Any]) -> None:
    edges, _, followings = searched(**doubt, followed=followed_strips(), calibration_age_days=100.0)
    assert followings == 1
    assert edges.left.sigma_mm == pytest.approx(np.full(20, 0.2))
    assert names(edges) == ["CALIBRATION_STALE"]
    hidden, _, _ = searched(of_outline={"clamp_seen": 0.3}, followed=followed_strips())
    assert "CLAMP_NOT_FOUND" in names(hidden)


def test_a_doubtful_silhouette_is_better_than_no_edges(searched: Any) -> None:
    edges, asked, followings = searched(of_outline={"other_bodies": 1.0})
    assert (len(asked), followings) == (1, 1)
    assert len(edges.left.points_mm) == 25
    assert names(edges) == ["MULTI_CONTOUR"]
    along = Picture(along_px=((60.0, 50.0), (60.0, 90.0)))
    clicked, asked, _ = searched(of_outline={"other_bodies": 1.0}, picture=along)
    assert asked == []
    assert not len(clicked.left.points_mm)


def test_clicks_beside_the_edges_reject_the_silhouette(searched: Any) -> None:
    for x, is_kept in ((70.0, True), (90.0, False)):
        picture = Picture(along_px=((x, 50.0), (x, 90.0)))
        edges, _, followings = searched(picture=picture)
        assert bool(len(edges.left.points_mm)) is is_kept
        assert followings == (0 if is_kept else 1)
        line = np.array([[1.0, 0.0], [10.0, 0.0]])
        expected, _, _ = searched(picture=picture, expected_mm=line)
        assert len(expected.left.points_mm) == 25  # an expected line replaces the clicks


def test_the_flags_without_edges_are_those_of_both_searches(searched: Any) -> None:
    # In a photograph, the grave flags of following replace those of the silhouette; in a grey picture they are added.
    lost = FollowedBeam({"followed_length": 0.1, "followed_sides": 0.2, "followed_tip": 1.0})
    colour, _, _ = searched(outlined=None, followed=lost)
    assert names(colour) == ["NOT_FOLLOWED"]
    grey, _, _ = searched(image=GREY, outlined=None, followed=lost)
    assert names(grey)[-1] == "NOT_FOLLOWED"
    assert {"LOW_CONTRAST", "CLAMP_NOT_FOUND"} <= set(names(grey))
    assert names(grey).count("NOT_FOLLOWED") == 1
    clicked, _, _ = searched(
        image=GREY, outlined=None, followed=lost, picture=Picture(along_px=((60.0, 50.0), (60.0, 90.0)))
    )
    assert names(clicked) == ["NOT_FOLLOWED"]
    for edges in (colour, grey, clicked):
        assert edges.left.points_mm.shape == edges.right.points_mm.shape == (0, 2)
        assert np.isnan(edges.corners_px).all()
        assert edges.corners_px.shape == (4, 2)
        first = next(flag for flag in edges.flags if flag.name == "NOT_FOLLOWED")
        assert first.value == 0.1  # the first grave flag of its name
    short, _, _ = searched(image=GREY, located=None, of_edges={"residual": 1.0}, followed=lost)
    assert "EDGE_RESIDUAL" in names(short)
    harmless, _, _ = searched(outlined=None, followed=FollowedBeam({"followed_tip": 1.0}))
    assert set(names(harmless)) == {"LOW_CONTRAST", "CLAMP_NOT_FOUND"}


def test_the_search_options_are_passed_on(monkeypatch: pytest.MonkeyPatch, searched: Any) -> None:
    line = np.array([[1.0, 0.0], [10.0, 0.0]])
    options = {"spacing_mm": 0.7, "earlier": lambda: None, "expected_mm": line, "between_mm": 2.0 * line}
    seen: list[Any] = []
    searched(of_outline={"other_bodies": 1.0})
    monkeypatch.setattr(finding, "follow_beam", lambda *_, **given: seen.append(given) or followed_strips())
    find_edges(COLOUR, CALIBRATION, specimen(), **options)  # type: ignore[arg-type]
    assert seen == [{**options, "projection": None}]


def in_region(region: tuple[int, int, int, int], **changed: Any) -> Any:
    picture = Picture(region_px=region, **{key: changed.pop(key) for key in ("along_px",) if key in changed})
    return CALIBRATION.model_copy(update={"picture": picture, **changed})


def test_the_calibration_of_a_region_counts_pixels_from_its_corner() -> None:
    clicks = ((60.0, 40.0), (70.5, 90.0))
    found = region_of(in_region((20, 5, 80, 100), along_px=clicks), (112, 128, 3))
    assert found is not None
    assert (found.left, found.top, found.width, found.height) == (20, 5, 80, 100)
    assert found.calibration.clamp_midpoint_px == (40.0, 5.0)
    assert found.calibration.picture.along_px == ((40.0, 35.0), (50.5, 85.0))
    assert found.calibration.picture.region_px == (20, 5, 80, 100)
    assert found.calibration.camera_matrix is None
    image = np.arange(112 * 128).reshape(112, 128)
    assert found.cut(image).tolist() == image[5:105, 20:100].tolist()
    edges = found.in_picture(EdgeSet(*edges_mm()[:2], (), np.full((4, 2), 7.0)))
    assert edges.corners_px.tolist() == [[27.0, 12.0]] * 4
    assert edges.calibration_digest == found.digest == in_region((20, 5, 80, 100), along_px=clicks).digest
    plain = region_of(in_region((20, 5, 80, 100)), (112, 128))
    assert plain is not None
    assert plain.calibration.picture.along_px is None
    assert region_of(CALIBRATION, (112, 128)) is None
    assert region_of(CALIBRATION.model_copy(update={"picture": Picture()}), (112, 128)) is None


def test_the_optical_axis_stays_where_it_was_in_the_picture() -> None:
    near = region_of(in_region((20, 5, 80, 100), stand_off_mm=60.0), (112, 128))
    assert near is not None
    assert near.calibration.camera_matrix == ((420.0, 0.0, 43.5), (0.0, 420.0, 50.5), (0.0, 0.0, 1.0))
    lens = ((400.0, 0.5, 70.0), (0.0, 401.0, 60.0), (0.0, 0.0, 1.0))
    of_lens = region_of(in_region((20, 5, 80, 100), stand_off_mm=60.0, camera_matrix=lens), (112, 128))
    assert of_lens is not None
    assert of_lens.calibration.camera_matrix == ((400.0, 0.5, 50.0), (0.0, 401.0, 55.0), (0.0, 0.0, 1.0))


def test_a_region_has_the_perspective_of_the_whole_picture() -> None:
    ruler = {"stand_off_mm": 60.0, "camera_tilt_deg": (2.0, -1.0), "ruler_px": ((30.0, 100.0), (100.0, 98.0))}
    whole = in_region((20, 5, 80, 100), **ruler)
    region = region_of(whole, (112, 128))
    assert region is not None
    seen, expected = BeamFrame(region.calibration).view(4.0, (80, 100)), BeamFrame(whole).view(4.0, (128, 112))
    assert seen is not None
    assert expected is not None
    for values, others in zip(vars(seen).values(), vars(expected).values(), strict=True):
        np.testing.assert_allclose(values, others)


@pytest.mark.parametrize(
    ("region", "clicks", "words"),
    [
        ((0, 0, 128, 112), None, ""),
        ((1, 0, 128, 112), None, "should lie in the pictures of 128 x 112 px"),
        ((0, 1, 128, 112), None, "should lie in the pictures"),
        ((60, 10, 20, 20), None, ""),
        ((61, 10, 20, 20), None, r"should contain clamp_midpoint_px = \[60.0, 10.0\], where the beam begins"),
        ((40, 10, 20, 20), None, "should contain clamp"),
        ((60, 11, 20, 20), None, "should contain clamp"),
        ((40, 0, 40, 10), None, "should contain clamp"),
        ((50, 0, 30, 60), ((50.0, 30.0), (79.9, 59.9)), ""),
        ((50, 0, 30, 60), ((49.9, 30.0), (60.0, 50.0)), "should contain all points of along_px"),
        ((50, 0, 30, 60), ((60.0, 30.0), (80.0, 50.0)), "should contain all points of along_px"),
        ((50, 0, 30, 60), ((60.0, 30.0), (60.0, 60.0)), r"= \[\[60.0, 30.0\], \[60.0, 60.0\]\]"),
    ],
)
def test_a_region_contains_the_clamp_and_every_click(region: Any, clicks: Any, words: str) -> None:
    calibration = in_region(region, **({} if clicks is None else {"along_px": clicks}))
    if words:
        with pytest.raises(InputError, match=words):
            region_of(calibration, (112, 128))
    else:
        assert region_of(calibration, (112, 128)) is not None
