"""The search for edges decides correctly just below and above each threshold; without a beam, it tries other inputs."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import scipy

from eimi_lab.config.calibration import Picture
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges import passes, suggested_corrections
from eimi_lab.vision.edges.back_lit import _corners
from eimi_lab.vision.edges.clamp_line import ClampLine, find_clamp_line
from eimi_lab.vision.edges.curve import SmoothCurve
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.edges.overlay import FLAG_COLOUR, FOLLOWED_COLOUR, STATED_COLOUR, draw_overlay
from eimi_lab.vision.edges.profiles import Steps, stations
from eimi_lab.vision.edges.response import estimate_gamma
from eimi_lab.vision.edges.silhouette import BackLight, find_silhouette
from eimi_lab.vision.edges.stated_shape import StatedShape
from eimi_lab.vision.flags import judge
from eimi_lab.vision.following import support as support_module
from eimi_lab.vision.following.explaining import draw_steps
from eimi_lab.vision.following.follow import FollowedBeam, follow
from eimi_lab.vision.following.in_picture import stated_beam
from eimi_lab.vision.tracking.steady_view import SteadyView
from tests.shared.sampled_beam import EDGES, unrolled
from tests.shared.small_pictures import CALIBRATION, SmallPicture, specimen, within

Array = np.ndarray
NOTHING = EdgePoints(np.zeros((0, 2)), np.zeros(0))


def test_a_finding_or_a_limit_without_a_quality_check_is_refused() -> None:
    with pytest.raises(KeyError, match="no quality check has the key tall, wide"):
        judge({"wide": 1.0, "blur_px": 9.0}, {"tall": 2.0})


def found_edges(length_mm: float = 12.0) -> EdgeSet:
    x = np.linspace(0.0, length_mm, 9)
    sides = (EdgePoints(np.column_stack([x, np.full(9, y)]), np.zeros(9)) for y in (-1.0, 1.0))
    return EdgeSet(*sides, (), np.zeros((4, 2)))


def test_corrections_are_tried_in_order_until_a_beam_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    # A clamp that would lie outside the picture is not tried. The width changes the specimen, all else the calibration.
    tried: list[tuple[Any, ...]] = []
    convincing: list[int] = []

    def find(image: Array, calibration: Any, beam: Any, projection: Any) -> EdgeSet:
        tried.append(
            (
                beam.specimen.width_mm,
                calibration.pixels_per_mm,
                calibration.axis_angle_deg,
                calibration.clamp_midpoint_px,
                None if calibration.picture is None else calibration.picture.along_px,
                projection,
            )
        )
        return found_edges() if len(tried) in convincing else EdgeSet(NOTHING, NOTHING, (), np.zeros((4, 2)))

    monkeypatch.setattr(suggested_corrections, "find_edges", find)
    followed = {"followed_beyond": 0.0}
    monkeypatch.setattr(suggested_corrections, "follow_beam", lambda *_, **options: FollowedBeam(dict(followed)))
    clicked = CALIBRATION.model_copy(update={"picture": Picture(along_px=((60.0, 50.0), (60.0, 90.0)))})
    picture = SmallPicture().beam().exposed()[:, :100]
    words = suggested_corrections.suggest_correction(picture, clicked, specimen(), "weights").words  # type: ignore[arg-type]
    along = ((60.0, 50.0), (60.0, 90.0))
    plain = (2.0, 7.0, 90.0, (60.0, 10.0), along, "weights")
    assert tried == [
        (*plain[:4], None, "weights"),
        *((width, *plain[1:]) for width in (1.6, 2.5)),
        *((2.0, pytest.approx(scale), *plain[2:]) for scale in (3.5, 4.9, 9.8, 14.0)),
        *((2.0, 7.0, axis, *plain[3:]) for axis in (130.0, 50.0, -180.0, 0.0, -90.0)),
        *((2.0, 7.0, 90.0, clamp, *plain[4:]) for clamp in ((95.0, 10.0), (25.0, 10.0), (60.0, 45.0))),
    ]
    assert words == (
        "no body as wide as width_mm leaves the clamp at or near clamp_midpoint_px: check clamp_midpoint_px, "
        "axis_angle_deg and pixels_per_mm, or help the search by --region, --polarity or --beam-colour;"
    )
    tried.clear()
    convincing.append(5)
    third = suggested_corrections.suggest_correction(picture, clicked, specimen(), None)
    assert third.words == "a beam is found with pixels_per_mm = 4.9, 0.7 times the given value: is the scale right?"
    assert len(tried) == 5
    for side, x in zip(third.edges_px, (60.0 - 4.9, 60.0 + 4.9), strict=True):
        assert side[[0, -1]] == pytest.approx(np.array([[x, 10.0], [x, 10.0 + 12.0 * 4.9]]))
    tried.clear()
    followed.update(followed_beyond=0.9, followed_gain=0.6, followed_width=0.0, followed_sides=0.5)
    assert suggested_corrections.suggest_correction(picture, clicked, specimen(), None).words.startswith(
        "a body was followed from the clamp over 90 %"
    )
    assert tried == []


@pytest.mark.parametrize(
    ("given", "is_sound"),
    [
        ({}, True),
        ({"support": 0.51}, True),
        ({"support": 0.5}, False),
        ({"separation": 3.01}, True),
        ({"separation": 3.0}, False),
        ({"turn": 0.49}, True),
        ({"turn": 0.5}, False),
        ({"bump": 0.079}, True),
        ({"bump": -0.079}, True),
        ({"bump": 0.081}, False),
        ({"bump": -0.081}, False),
    ],
)
def test_an_edge_is_sure_by_its_support_separation_turn_and_place(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, float], is_sound: bool
) -> None:
    monkeypatch.setattr(support_module, "_turn", lambda side, arm: np.full(60, given.get("turn", 0.0)))
    edge = EDGES.copy()
    edge[:, 28:32] += given.get("bump", 0.0)
    projected: Any = tuple(SimpleNamespace(separation=np.full(60, given.get("separation", 9.0))) for _ in (0, 1))
    support = np.full((2, 60), given.get("support", 1.0))
    sound = support_module._sound(unrolled(np.zeros((60, 53, 3))), edge, support, projected)
    assert sound[:, 29].tolist() == [is_sound, is_sound]
    assert sound[:, 10].all() == (is_sound or "bump" in given)


def test_the_place_of_an_edge_is_compared_with_the_median_over_one_width(monkeypatch: pytest.MonkeyPatch) -> None:
    # One width has 12 rows: a part of 5 rows beside the others is an outlier, and one of 7 rows is not.
    arms = []
    monkeypatch.setattr(support_module, "_turn", lambda side, arm: arms.append(arm) or np.zeros(60))
    projected: Any = tuple(SimpleNamespace(separation=np.full(60, 9.0)) for _ in (0, 1))
    picture = unrolled(np.zeros((60, 53, 3)))
    for rows, is_kept in ((5, False), (7, True)):
        edge = EDGES.copy()
        edge[0, 25 : 25 + rows] += 0.2
        sound = support_module._sound(picture, edge, np.ones((2, 60)), projected)
        assert sound[0, 27] == is_kept
        assert sound[1].all()
    assert set(arms) == {3}  # a quarter of a width
    for rows, is_kept in ((1, False), (2, True)):  # a run shorter than 0.2 widths is rejected
        support = np.zeros((2, 60))
        support[1, 40 : 40 + rows] = 1.0
        assert support_module._sound(picture, EDGES, support, projected)[1, 40] == is_kept


def line_side(points: Array, sound: Array | None = None) -> passes.Side:
    count = len(points)
    curve = SmoothCurve(points, 1) if count > 3 else SimpleNamespace()
    usable = np.ones(count, bool) if sound is None else sound
    return passes.Side(curve, points, np.zeros(count), np.ones(count), np.zeros(count), usable, 1)  # type: ignore[arg-type]


def test_the_corner_at_the_clamp_is_extrapolated_by_a_line_through_4_points_and_by_a_parabola_through_more() -> None:
    clamp = ClampLine(np.array([3.0, 0.0]), np.array([0.0, 1.0]), 1.0)
    x = np.linspace(-8.0, 8.0, 9)
    tip = line_side(np.column_stack([x, np.full(9, 90.0)]))
    corners = []
    for count in (4, 5):
        y = 10.0 + 12.0 * np.arange(count)
        left = line_side(np.column_stack([-7.0 + 0.01 * y**2, y]))
        right = line_side(np.column_stack([9.0 + 0.0 * y, y]))
        corners.append(_corners(clamp, left, tip, right, 20.0))
        assert corners[-1][1] == pytest.approx([9.0, 0.0])
    y = 10.0 + 12.0 * np.arange(4)
    assert corners[0][0] == pytest.approx([np.polyfit(y, -7.0 + 0.01 * y**2, 1)[1], 0.0])
    assert corners[1][0] == pytest.approx([-7.0, 0.0], abs=1e-9)
    # The points within one width of the first count, and at the tip those within 0.75 widths of the last, at least 3.
    y = np.arange(5.0, 86.0, 4.0)
    bent = np.where(y < 24.9, -7.0, np.where(y > 70.1, -7.0 + 0.1 * (y - 85.0), 50.0))
    found = _corners(clamp, line_side(np.column_stack([bent, y])), tip, line_side(np.column_stack([0.0 * y, y])), 20.0)
    assert found[0] == pytest.approx([-7.0, 0.0], abs=1e-9)
    assert found[2] == pytest.approx([-6.5, 90.0], abs=1e-6)
    assert found[3] == pytest.approx([0.0, 90.0])


def locate(monkeypatch: pytest.MonkeyPatch, residual: Array, fewest: int = 8, **changed: Any) -> Any:
    # Return the result of `_locate` on two straight edges of 10 places each, for given fitted steps.
    places = np.linspace(0.0, 90.0, 10)
    curves = [SmoothCurve(np.column_stack([np.linspace(5.0, 95.0, 12), np.full(12, y)]), 1) for y in (20.0, 40.0)]
    values: dict[str, Any] = {
        "offset_px": np.full(20, 0.5),
        "dark": np.full(20, 20.0),
        "bright": np.full(20, 120.0),
        "blur_px": 1.0,
        "residual": residual,
        "sensitivity": np.full(20, 0.01),
        "common_px": np.arange(20) / 100.0,
        "sound": np.ones(20, bool),
    }
    steps = Steps(**{**values, **changed})
    monkeypatch.setattr(passes, "fit_steps", lambda *_: steps)
    image = np.full((60, 110), 100.0)
    return passes._locate(image, curves, [(places, 1), (places, 2)], (-1.0, 1.0), stations(3.0, 3.0), 1.2, fewest)


@pytest.mark.parametrize(
    ("usual", "dirt", "is_kept"),
    [(0.02, 0.079, True), (0.02, 0.081, False), (0.001, 0.0299, True), (0.001, 0.0301, False)],
)
def test_dirt_has_four_times_the_usual_residual(
    monkeypatch: pytest.MonkeyPatch, usual: float, dirt: float, is_kept: bool
) -> None:
    residual = np.full(20, usual)
    residual[4] = dirt
    found = locate(monkeypatch, residual)
    assert found.sides[0].sound.tolist() == [number != 4 or is_kept for number in range(10)]
    assert found.sides[1].sound.all()
    kept = np.where(np.arange(20) == 4, is_kept, True)
    noise = math.sqrt(((100.0 * residual)[kept] ** 2).mean())
    assert found.sides[1].sigma_px == pytest.approx(np.full(10, 0.01 * noise))
    assert found.sides[1].common_px.tolist() == [number / 100.0 for number in range(10, 20)]
    assert (found.sides[0].stride, found.sides[1].stride) == (1, 2)
    assert found.sides[0].points_px == pytest.approx(np.column_stack([np.linspace(5, 95, 10), np.full(10, 19.5)]))
    assert found.sides[1].points_px == pytest.approx(np.column_stack([np.linspace(5, 95, 10), np.full(10, 40.5)]))
    assert found.residual.tolist() == residual.tolist()


def test_an_edge_with_too_few_points_is_not_located(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = np.ones(20, bool)
    sound[10:12] = False
    found = locate(monkeypatch, np.full(20, 0.01), sound=sound)
    assert found.sides[1].sound.sum() == 8
    assert found.residual.tolist() == [0.01] * 10 + [1.0] * 2 + [0.01] * 8
    assert found.near_clamp.tolist() == [True] * 5 + [False] * 7 + [True] * 3 + [False] * 5
    sound[12] = False
    assert locate(monkeypatch, np.full(20, 0.01), sound=sound) is None
    assert locate(monkeypatch, np.full(20, 0.01), sound=np.zeros(20, bool), fewest=0) is None
    exact = locate(monkeypatch, np.zeros(20))
    assert exact.sides[0].sigma_px.tolist() == [1e-6] * 10


def short_silhouette(image: Array) -> Any:
    # Return the silhouette of a beam of 35 px, 14 px wide, whose clamp is at (60, 26).
    frame = BeamFrame(CALIBRATION.model_copy(update={"clamp_midpoint_px": (60.0, 26.0)}))
    light = BackLight(np.full((8, 8), 200.0, np.float32), 200.0, 20.0)
    clamp = ClampLine(np.array([60.0, 26.0]), np.array([0.0, 1.0]), 1.0)
    return find_silhouette(image, frame, clamp, light, StatedShape(specimen(length_mm=5.0).mechanics()))


@pytest.mark.parametrize(("top", "bodies"), [(85, 1), (94, 0), (100, 0)])
def test_bodies_are_searched_up_to_two_lengths_from_the_clamp(top: int, bodies: int) -> None:
    # Two lengths of 35 px below the clamp the search ends at the row 96.
    picture = SmallPicture(0.0, (200.0,), length_px=35.0, above_px=16)
    picture.add(within(picture.along, -99.0, 0.0), (20.0,))
    picture.add(within(picture.aside, -7.0, 7.0) * within(picture.along, -20.0, 35.0), (20.0,))
    image = picture.exposed(0.0)[..., 0]
    image[top : top + 10, 20:50] = 20
    assert short_silhouette(image).other_bodies == bodies


@pytest.mark.parametrize(("offset_mm", "is_found"), [(0.0, True), (0.47, True), (-0.47, True), (0.53, False)])
def test_the_edge_of_the_clamp_is_searched_half_a_millimetre_around_the_stated_line(
    offset_mm: float, is_found: bool
) -> None:
    # The scale is 30 px/mm: the search reaches 15 px.
    y, x = np.mgrid[0:140, 0:220].astype(float)
    edge = 60.0 + 30.0 * offset_mm
    dark = np.maximum(within(y, -99.0, edge), within(x - 110.0, -30.0, 30.0))
    image = np.rint(200.0 - 180.0 * dark).astype(np.uint8)
    frame = BeamFrame(CALIBRATION.model_copy(update={"clamp_midpoint_px": (110.0, 60.0), "pixels_per_mm": 30.0}))
    line = find_clamp_line(image, frame, 2.0, 200.0)
    assert line.visible_share == (1.0 if is_found else 0.0)
    assert line.point_px == pytest.approx([110.0, edge if is_found else 60.0], abs=0.05)
    assert line.ahead == pytest.approx([0.0, 1.0], abs=1e-3)


@pytest.mark.parametrize(("grey", "share"), [(136.0, 1.0), (144.0, 0.0)])
def test_a_faint_step_beside_the_beam_is_not_the_clamp(grey: float, share: float) -> None:
    # The step of a clamp has at least 0.3 of the back-light of 200.
    y, x = np.mgrid[0:112, 0:128].astype(float)
    image = np.where(y < 30.0, grey, 200.0)
    image[:, 53:68] = 20.0
    frame = BeamFrame(CALIBRATION.model_copy(update={"clamp_midpoint_px": (60.0, 30.0)}))
    found = find_clamp_line(image, frame, 2.0, 200.0)
    assert found.visible_share == share
    assert x.shape == image.shape


def stored(gamma: float, dark: float = 0.1, blur: float = 1.5, count: int = 24, scatter: float = 0.0) -> Any:
    # Return lines across an edge that a camera with a gamma has stored: stations, profiles and offsets.
    u = stations(9.0, 9.0)
    rng = np.random.default_rng(3)
    offset = rng.uniform(-0.5, 0.5, count)
    light = dark + (1.0 - dark) * scipy.special.ndtr((u - offset[:, None]) / blur)
    return u, 180.0 * light ** (1.0 / gamma) + rng.normal(0.0, scatter, (count, len(u))), offset


def test_gamma_is_estimated_from_enough_lines() -> None:
    u, profiles, offset = stored(1.7)
    assert estimate_gamma(u, profiles, offset, np.full(24, 180.0), 1.5) == pytest.approx(1.7, abs=0.02)
    grid = np.tile([0.0, 0.25], 4)
    few = 180.0 * (0.1 + 0.9 * scipy.special.ndtr((u - grid[:, None]) / 1.5))
    # Eight lines give 4 values at each place on a grid of 0.25 px: twelve such places are enough.
    assert estimate_gamma(u[12:24], few[:, 12:24], grid, np.full(8, 180.0), 1.5) is not None
    assert estimate_gamma(u[12:18], few[:, 12:18], grid, np.full(8, 180.0), 1.5) is not None
    assert estimate_gamma(u[12:17], few[:, 12:17], grid, np.full(8, 180.0), 1.5) is None
    assert estimate_gamma(u[12:24], few[:6, 12:24], grid[:6], np.full(6, 180.0), 1.5) is None
    straight, steps, off = stored(1.0)
    assert estimate_gamma(straight, steps, off, np.full(24, 180.0), 1.5) == pytest.approx(1.0, abs=1e-3)
    assert estimate_gamma(u, profiles[:3], offset[:3], np.full(3, 180.0), 1.5) is None  # 3 values at a place
    noisy = stored(1.3, scatter=25.0, count=12)
    assert estimate_gamma(*noisy, np.full(12, 180.0), 1.5) is None  # uncertain
    bright_side = u > 0.4
    half = estimate_gamma(u[bright_side], profiles[:, bright_side], offset, np.full(24, 180.0), 1.5)
    assert half is None or abs(half - 1.0) < 0.1  # no grey values of the dark side


def textured(shift: float = 0.0) -> Array:
    rng = np.random.default_rng(8)
    image = np.full((180, 240), 90.0)
    rows, columns = np.mgrid[0:180, 0:240]
    for x, y, bright in zip(rng.uniform(0, 240, 60), rng.uniform(0, 180, 60), rng.uniform(-60, 90, 60), strict=True):
        image += bright * np.exp(-0.5 * ((columns - x - shift) ** 2 + (rows - y) ** 2) / 9.0)
    return np.clip(np.rint(image), 0, 255)


@pytest.mark.parametrize(("kind", "scale"), [(np.uint8, 1), (np.uint16, 257)])
def test_the_motion_of_the_camera_is_measured_in_pictures_of_8_and_16_bits(kind: Any, scale: int) -> None:
    corner = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]])
    view = SteadyView((scale * textured()).astype(kind), corner)
    assert view.is_possible
    moved = view.steadied((scale * textured(2.0)).astype(kind))
    assert moved.dtype == kind
    assert view.moved_px == pytest.approx(2.0, abs=0.1)
    inner = (slice(20, -20), slice(20, -20))
    assert np.abs(moved[inner] / scale - textured()[inner]).mean() < 1.5


def test_a_followed_path_without_edges_is_drawn_over_the_stated_beam() -> None:
    picture = SmallPicture(0.4).beam()
    image = picture.exposed()
    followed = follow(image.astype(np.float32), stated_beam(BeamFrame(CALIBRATION), 12.0, 2.0))
    empty = EdgeSet(NOTHING, NOTHING, (), np.full((4, 2), np.nan))
    plain = draw_overlay(image, empty, CALIBRATION)
    assert (plain == image).all()
    stated = draw_overlay(image, empty, CALIBRATION, specimen())
    expected = image.copy()
    frame = BeamFrame(CALIBRATION)
    for line in ([[0, -2], [0, 2]], [[0, 0], [12, 0]], [[0, -1], [12, -1]], [[0, 1], [12, 1]]):
        ends = np.rint(frame.to_px(np.array(line, float)) * 16).astype(np.int32)
        cv2.polylines(expected, [ends], False, STATED_COLOUR, 1, cv2.LINE_AA, 4)
    assert (stated == expected).all()
    drawn = draw_overlay(image, empty, CALIBRATION, specimen(), followed)
    path = followed.path_px
    cv2.polylines(expected, [np.rint(path * 16).astype(np.int32)], False, FOLLOWED_COLOUR, 1, cv2.LINE_AA, 4)
    for edge in followed.sure_px:
        for x, y in np.rint(edge * 16).astype(int).tolist():
            cv2.circle(expected, (x, y), 16, FOLLOWED_COLOUR, -1, 8, 4)
    end = tuple(np.rint(path[-1]).astype(int).tolist())
    cv2.drawMarker(expected, end, FLAG_COLOUR, cv2.MARKER_TILTED_CROSS, 20, 2, cv2.LINE_AA)
    assert (drawn == expected).all()
    assert (drawn != stated).any()
    assert (STATED_COLOUR, FOLLOWED_COLOUR, FLAG_COLOUR) == ((255, 220, 80), (0, 230, 255), (0, 0, 255))
    nothing = draw_overlay(image, empty, CALIBRATION, specimen(), FollowedBeam({"followed_length": 0.0}))
    assert (nothing == stated).all()


def test_reliable_places_are_drawn_green_and_others_red() -> None:
    image = SmallPicture(0.2).beam().exposed().astype(np.float32)
    found = follow(image, stated_beam(BeamFrame(CALIBRATION), 12.0, 2.0))
    assert found.sides is not None
    assert found.unrolled is not None
    assert found.strip is not None
    assert found.working is not None
    sound = found.sides.sound.copy()
    sound[0, 20:30] = False
    drawn = draw_steps(replace(found, sides=replace(found.sides, sound=sound)))
    assert list(drawn) == ["strip", "unrolled"]
    high, wide = found.unrolled.colours.shape[:2]
    assert drawn["unrolled"].shape == (4 * high, 4 * 3 * wide, 3)
    step = found.unrolled.across[1] - found.unrolled.across[0]
    for row in (5, 25):
        for side in (0, 1):
            place = (found.sides.edge[side, row] - found.unrolled.across[0]) / step
            column = round((place + 0.5) * 4 - 0.5)
            colour = (0, 200, 0) if sound[side, row] else (0, 0, 255)
            for panel in range(3):
                assert tuple(drawn["unrolled"][4 * row + 2, 4 * wide * panel + column]) == colour
    share = drawn["unrolled"][4 * 5, 4 * wide : 8 * wide].reshape(wide, 4, 3)[:, 0]
    expected = np.clip(np.rint(255.0 * found.sides.projected[0].share[5]), 0, 255)
    away = np.abs(found.unrolled.across[:, None] - found.sides.edge[:, 5]).min(axis=1) > 0.1
    assert share[away].tolist() == [[value] * 3 for value in expected[away].tolist()]
    assert draw_steps(FollowedBeam({"followed_length": 0.0}, found.working)) == {}
    assert list(draw_steps(FollowedBeam({}, found.working, found.strip, found.unrolled))) == ["strip"]
    clear = replace(found.strip, gain=np.where(np.arange(len(found.strip.gain)) < 5, 1.5, -0.5))
    outline = draw_steps(FollowedBeam({}, found.working, clear))["strip"]
    assert outline.shape == (4 * found.working.pixels.shape[0], 4 * found.working.pixels.shape[1], 3)
    for number, colour in ((2, (0, 255, 0)), (9, (0, 0, 255))):
        normal = np.array([-math.sin(clear.angle[number]), math.cos(clear.angle[number])])
        for side in (-0.5, 0.5):
            x, y = (clear.place[number] + side * clear.width[number] * normal + 0.5) * 4 - 0.5
            assert tuple(outline[round(float(y)), round(float(x))]) == colour


@pytest.mark.parametrize("turn_deg", [20.0, 140.0, -75.0])
def test_the_corners_turn_with_the_beam(turn_deg: float) -> None:
    turn = math.radians(turn_deg)
    rotation = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    y = np.arange(5.0, 86.0, 4.0)
    x = np.linspace(-6.0, 7.0, 9)
    lines = (
        np.column_stack([-7.0 + 0.002 * y**2, y]),
        np.column_stack([x, np.full(9, 90.0)]),
        np.column_stack([8.0 + 0.03 * y, y]),
    )
    straight = _corners(ClampLine(np.zeros(2), np.array([0.0, 1.0]), 1.0), *map(line_side, lines), 20.0)
    assert straight[:2] == pytest.approx(np.array([[-7.0, 0.0], [8.0, 0.0]]), abs=1e-9)
    assert straight[3] == pytest.approx([10.7, 90.0])
    turned = ClampLine(np.array([30.0, 40.0]), np.array([0.0, 1.0]) @ rotation, 1.0)
    found = _corners(turned, *(line_side(line @ rotation + [30.0, 40.0]) for line in lines), 20.0)
    assert found == pytest.approx(straight @ rotation + [30.0, 40.0], abs=1e-6)
