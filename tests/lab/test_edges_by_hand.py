"""The steps of the search for back-lit edges agree with calculations by hand and with a least-squares fit."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy

from eimi_fitting.beam.view import View
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges import passes
from eimi_lab.vision.edges.back_lit import _corners, _crossing, _line_through
from eimi_lab.vision.edges.clamp_line import ClampLine
from eimi_lab.vision.edges.curve import SmoothCurve, _with_points
from eimi_lab.vision.edges.dimensions import (
    anticlastic_bow,
    even_turn_deg,
    length_deviation,
    local_widths,
    stiffening_by_twist,
    twist_deg,
    width_deviation,
)
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet, tip_angle_deg, tip_angle_sigma_deg
from eimi_lab.vision.edges.passes import Side, SiliconeMargin, scatter_scale
from eimi_lab.vision.edges.profiles import Cover, fit_steps, stations
from eimi_lab.vision.edges.quality import describe_turn_effects
from eimi_lab.vision.edges.response import estimate_gamma
from eimi_lab.vision.edges.silhouette import (
    BackLight,
    _from_left_to_right,
    _tip_corners,
    find_silhouette,
    measure_back_light,
    root_places,
)
from eimi_lab.vision.edges.stated_shape import StatedShape
from tests.shared.small_pictures import CALIBRATION, SmallPicture, specimen, within

Array = np.ndarray
FRAME = BeamFrame(CALIBRATION)


def normal(z: Array) -> Array:
    return np.asarray(scipy.special.ndtr(z))


def covered(u: Array, dark: float, bright: float, offset: float, blur: float, wide: float, passes: float) -> Array:
    # Return grey values across the edge of a layer of silicone, `wide` px thick, beside a magnet.
    # passes: fraction of the light that passes through the silicone.
    inner, outer = normal((u - offset + wide) / blur), normal((u - offset) / blur)
    return dark * (1.0 - inner) + bright * (passes * inner + (1.0 - passes) * outer)


def test_the_fit_beside_a_magnet_is_the_least_squares_fit_with_a_prior_of_the_width() -> None:
    u, passing, rng = stations(9.0, 9.0), 0.35, np.random.default_rng(2)
    group = np.array([0] * 6 + [1] * 6 + [-1] * 6)
    wide = np.array([2.2, 3.1])
    profiles = np.stack([
        covered(u, 12.0, 200.0 + k, 0.1 * k - 0.5, 1.3, wide[side] if side >= 0 else 0.0, passing if side >= 0 else 0.0)
        for k, side in enumerate(group)
    ])  # fmt: skip
    profiles += rng.normal(0.0, 1.5, profiles.shape)
    cover = Cover(group, np.array([2.6, 2.6]), np.array([0.4, 0.4]), passing)
    steps = fit_steps(u, profiles, 1.2, None, cover)

    def residuals(unknowns: Array, noise: float) -> Array:
        blur, *widths = unknowns[:3]
        parts = []
        for row, side in enumerate(group):
            dark, bright, offset = unknowns[3 + 3 * row : 6 + 3 * row]
            of_side = (widths[side], passing) if side >= 0 else (0.0, 0.0)
            parts.append(profiles[row] - covered(u, dark, bright, offset, blur, *of_side))
        return np.concatenate([*parts, math.sqrt(noise) * (np.array(widths) - 2.6) / 0.4])

    start = [1.2, 2.6, 2.6, *np.column_stack([np.full(18, 12.0), np.full(18, 200.0), np.zeros(18)]).ravel()]
    noise = 1.5**2
    for _ in range(3):
        solved = scipy.optimize.least_squares(residuals, start, args=(noise,))
        noise = float((residuals(solved.x, 0.0)[:-2] ** 2).mean())
    assert steps.blur_px == pytest.approx(solved.x[0], abs=5e-3)
    assert steps.offset_px == pytest.approx(solved.x[5::3], abs=0.02)
    assert steps.bright == pytest.approx(solved.x[4::3], abs=0.1)
    assert steps.dark == pytest.approx(solved.x[3::3], abs=0.2)
    covariance = np.linalg.inv(solved.jac.T @ solved.jac)[3:, 3:] * noise
    common = np.sqrt(np.diag(covariance)[2::3])
    assert (steps.common_px[:12] > 0.0).all()
    assert (steps.common_px[12:] == 0.0).all()
    both = np.hypot(steps.common_px, steps.sensitivity * math.sqrt(noise))
    assert both == pytest.approx(common, rel=0.1)


def test_a_step_without_a_cover_is_the_least_squares_fit() -> None:
    u, rng = stations(6.0, 7.0), np.random.default_rng(3)
    offsets = np.array([-0.8, 0.0, 1.1])
    profiles = np.stack([30.0 + 150.0 * normal((u - offset) / 1.4) for offset in offsets])
    profiles += rng.normal(0.0, 2.0, profiles.shape)
    steps = fit_steps(u, profiles)

    def residuals(unknowns: Array) -> Array:
        rows = unknowns[1:].reshape(3, 3)
        return np.concatenate([
            row - (dark + (bright - dark) * normal((u - offset) / unknowns[0]))
            for row, (dark, bright, offset) in zip(profiles, rows, strict=True)
        ])  # fmt: skip

    solved = scipy.optimize.least_squares(residuals, [1.2, *np.array([[30.0, 180.0, 0.0]] * 3).ravel()])
    assert steps.blur_px == pytest.approx(solved.x[0], abs=1e-3)
    assert steps.offset_px == pytest.approx(solved.x[3::3], abs=1e-3)
    rms = np.sqrt((residuals(solved.x).reshape(3, -1) ** 2).mean(axis=1))
    assert steps.residual == pytest.approx(rms / (solved.x[2::3] - solved.x[1::3]), rel=1e-3)
    single = np.linalg.inv(solved.jac[: len(u), 1:4].T @ solved.jac[: len(u), 1:4])
    assert steps.sensitivity[0] == pytest.approx(math.sqrt(single[2, 2]), rel=1e-3)
    assert steps.sound.all()
    near_end = fit_steps(u, np.stack([30.0 + 150.0 * normal((u - 6.5) / 1.4)] * 3))
    assert not near_end.sound.any()


@pytest.mark.parametrize("gamma", [0.94, 1.06, 1.4, 1.7])
def test_the_gamma_of_a_stored_step_is_estimated(gamma: float) -> None:
    u = stations(8.0, 8.0)
    offset = np.linspace(-0.9, 0.9, 40)
    light = 0.1 + 0.9 * normal((u - offset[:, None]) / 1.5)
    stored = 200.0 * light ** (1.0 / gamma)
    profiles = stored + np.random.default_rng(1).normal(0.0, 0.2, stored.shape)
    found = estimate_gamma(u, profiles, offset, np.full(40, 200.0), 1.5)
    assert found == pytest.approx(gamma, abs=0.03 if abs(gamma - 1.0) < 0.1 else 0.08)
    assert estimate_gamma(u, profiles[:1], offset[:1], np.full(1, 200.0), 1.5) is None  # too few values in each bin


def curve_of(points: Array) -> SmoothCurve:
    return SmoothCurve(points, 4)


def side_of(offset: Array, sigma: Array, sound: Array | None = None) -> Side:
    points = np.column_stack([np.arange(len(offset)) * 1.0, offset])
    usable = np.ones(len(offset), bool) if sound is None else sound
    return Side(curve_of(points), points, offset, sigma, np.zeros(len(offset)), usable, 1)


def test_the_scatter_is_that_of_third_differences() -> None:
    rng = np.random.default_rng(4)
    smooth = 0.02 * np.arange(400.0) ** 1.5
    sides = [side_of(smooth + rng.normal(0.0, 0.3, 400), np.full(400, 0.1)) for _ in (0, 1)]
    assert scatter_scale(*sides) == pytest.approx(3.0, rel=0.1)
    ratios = []
    for side in sides:
        third = side.offset_px[:-3] - 3 * side.offset_px[1:-2] + 3 * side.offset_px[2:-1] - side.offset_px[3:]
        ratios.append(np.abs(third) / math.sqrt(20.0 * 0.1**2))
    assert scatter_scale(*sides) == pytest.approx(1.4826 * np.median(np.concatenate(ratios)))


@pytest.mark.parametrize(
    ("ends", "spacing", "widest", "count", "stride"),
    [
        ((10.0, 110.0), 10.0, 20.0, 11, 1),
        ((10.0, 110.0), 10.0, 4.9, 21, 2),  # an interval of 10 px in parts of at least 4 px
        ((10.0, 110.0), 10.0, 1.0, 21, 2),
        ((10.0, 110.0), 12.1, 1.0, 25, 3),
        ((0.0, 1000.0), 1.0, 100.0, 100, 1),  # at most a hundred points
    ],
)
def test_the_places_on_an_edge_are_evenly_spaced(
    ends: tuple[float, float], spacing: float, widest: float, count: int, stride: int
) -> None:
    places, every = passes._arc_lengths(*ends, spacing, widest)
    assert (len(places), every) == (count, stride)
    assert places[[0, -1]].tolist() == list(ends)
    assert passes._arc_lengths(10.0, 5.0, spacing, widest)[0].tolist() == [10.0]
    assert np.ptp(np.diff(places)) < 1e-9


def test_points_near_the_ends_of_an_outline_are_left_out() -> None:
    points = np.column_stack([np.arange(11.0), np.zeros(11)])
    assert passes._clear_of_ends(points, 3.0).nonzero()[0].tolist() == list(range(3, 8))
    assert passes._clear_of_ends(points, 2.9).nonzero()[0].tolist() == list(range(3, 8))
    assert passes._clear_of_ends(points, 3.1).nonzero()[0].tolist() == list(range(4, 7))


@pytest.mark.parametrize(("cover_px", "reach"), [(3.59, 10.0), (3.61, 1.81), (7.0, 5.2), (11.79, 9.99), (12.0, 10.0)])
def test_grey_values_are_read_up_to_the_magnet(cover_px: float, reach: float) -> None:
    # Silicone wider than three blurs is read up to one and a half blurs before the magnet.
    assert passes._inner_reach_px(10.0, cover_px, 1.2) == pytest.approx(reach)


def test_the_transmission_is_the_median_share_of_light_near_the_clamp() -> None:
    located: Any = SimpleNamespace(
        near_clamp=np.array([True, True, True, False]),
        steps=SimpleNamespace(dark=np.array([40.0, 50.0, 90.0, 200.0]), bright=np.array([200.0, 200.0, 200.0, 200.0])),
    )
    assert passes._transmission(located) == 0.25
    located.near_clamp[:] = False
    assert passes._transmission(located) == 0.0
    located.near_clamp[3], located.steps.dark[3] = True, 300.0
    assert passes._transmission(located) == 1.0


@pytest.mark.parametrize(("width_px", "is_covered"), [(0.0, False), (0.5, True), (6.9, True), (7.1, False)])
def test_thin_silicone_beside_the_magnet_gets_a_second_step(
    monkeypatch: pytest.MonkeyPatch, width_px: float, is_covered: bool
) -> None:
    # The profiles reach four blurs and a pixel; the magnet matters if it is nearer than this and two blurs.
    given: dict[str, Any] = {}
    monkeypatch.setattr(passes, "_locate", lambda *arguments: given.update(arguments=arguments))
    y = np.linspace(0.0, 200.0, 60)
    sides = []
    for x in (-20.0, 20.0):
        points = np.column_stack([np.full(60, x), y])
        sides.append(replace(side_of(np.zeros(60), np.ones(60)), curve=curve_of(points), points_px=points))
    steps = SimpleNamespace(blur_px=1.0, dark=np.full(120, 50.0), bright=np.full(120, 200.0))
    first: Any = SimpleNamespace(sides=tuple(sides), steps=steps, near_clamp=np.ones(120, bool))
    corners = np.array([[-20.0, -10.0], [20.0, -10.0], [-20.0, 210.0], [20.0, 210.0]])
    margin = SiliconeMargin(width_px, 0.7, 50.0)
    passes.second_pass(np.zeros((4, 4)), first, corners, -1.0, 5.0, 40.0, margin)
    _, curves, places, outward, across, blur, fewest, cover = given["arguments"]
    assert (len(curves), outward, blur, fewest) == (2, (1.0, -1.0), 1.0, 8)
    assert across[[0, -1]].tolist() == [-5.0, 5.0]
    place, _ = places[0]
    assert place[[0, -1]] == pytest.approx([-10.0 + 6.0, 210.0 - 6.0], abs=0.3)
    assert (cover is not None) is is_covered
    if is_covered:
        assert cover.width_px.tolist() == [width_px] * 2
        assert cover.tolerance_px.tolist() == [0.7] * 2
        assert cover.transmission == 0.25
        before = place[cover.group[: len(place)] == -1]
        assert before.max() < 210.0 - 50.0 - 4.0 + 0.3
        assert set(cover.group[: len(place)]) == {-1, 0}
        assert set(cover.group[len(place) :]) == {-1, 1}
        assert place[cover.group[: len(place)] == 0].min() > 210.0 - 50.0 - 4.0 - 0.3
    assert passes.second_pass(np.zeros((4, 4)), first, np.full((4, 2), np.nan), -1.0, 5.0, 40.0, margin) is None


@pytest.mark.parametrize(("width_px", "tip_spacing", "half", "margin"), [(60.0, 2.0, 10.0, 8.0), (16.0, 1.0, 6.4, 4.0)])
def test_the_first_pass_searches_near_the_outline(
    monkeypatch: pytest.MonkeyPatch, width_px: float, tip_spacing: float, half: float, margin: float
) -> None:
    # The search lines cross the outline between its corners. There are at least nine of them across the tip.
    given: dict[str, Any] = {}
    monkeypatch.setattr(passes, "_locate", lambda *arguments: given.update(arguments=arguments))
    corners = np.array([[0.0, 0.0], [0.0, 300.0], [width_px, 300.0], [width_px, 0.0]])
    parts = [np.linspace(a, b, int(np.linalg.norm(b - a)), endpoint=False) for a, b in pairwise(corners)]
    outline_px = np.vstack([*parts, corners[-1:]])
    silhouette: Any = SimpleNamespace(outline_px=outline_px, corners=(300, 300 + int(width_px)))
    passes.first_pass(np.zeros((4, 4)), silhouette, -1.0, 12.0, width_px, SiliconeMargin(0.0, 0.0, 0.0))
    _, curves, places, outward, across, blur, fewest = given["arguments"]
    assert (outward, blur, fewest) == ((1.0, 1.0, -1.0), 1.2, 3)
    assert across[[0, -1]] == pytest.approx([-half, half], abs=0.3)
    lengths = [300.0 - 2.0 * margin, width_px - 2.0 * margin, 300.0 - 2.0 * margin]
    assert [curve.length for curve in curves] == pytest.approx(lengths, abs=2.1)
    assert curves[0].at(np.zeros(1))[0][0] == pytest.approx([0.0, margin], abs=1.1)
    assert curves[2].at(np.zeros(1))[0][0] == pytest.approx([width_px, margin], abs=1.1)
    tip, _ = places[1]
    assert np.diff(tip) == pytest.approx(np.full(len(tip) - 1, tip_spacing), rel=0.15)
    assert len(places[0][0]) - 1 == places[0][1] * int(curves[0].length / 12.0)
    silhouette.corners = None
    assert passes.first_pass(np.zeros((4, 4)), silhouette, -1.0, 12.0, 16.0, SiliconeMargin(0.0, 0.0, 0.0)) is None


def test_the_corners_are_where_the_edges_meet_the_clamp_line_and_the_tip() -> None:
    y = np.linspace(4.0, 96.0, 40)
    left, right = (side_of(np.zeros(40), np.ones(40)) for _ in (0, 1))
    left = replace(left, points_px=np.column_stack([-10.0 - 0.02 * (y - 50.0), y]))
    right = replace(right, points_px=np.column_stack([10.0 + 0.0 * y, y]))
    x = np.linspace(-8.0, 8.0, 12)
    tip = replace(side_of(np.zeros(12), np.ones(12)), points_px=np.column_stack([x, 100.0 + 0.1 * x]))
    clamp = ClampLine(np.array([0.0, 0.0]), np.array([0.0, 1.0]), 1.0)
    found = _corners(clamp, left, tip, right, 20.0)
    assert found[:2] == pytest.approx(np.array([[-9.0, 0.0], [10.0, 0.0]]), abs=1e-6)
    assert found[3] == pytest.approx([10.0, 101.0])
    across = -10.0 - 0.02 * 50.0
    assert found[2] == pytest.approx([across, 100.0 + 0.1 * across], abs=0.05)
    assert clamp.distance_px(np.array([[3.0, 7.0]])).tolist() == [7.0]
    centre, direction = _line_through(np.array([[0.0, 0.0], [2.0, 2.0], [4.0, 4.0]]))
    assert centre.tolist() == [2.0, 2.0]
    assert np.abs(direction) == pytest.approx([math.sqrt(0.5)] * 2)
    parallel = (np.zeros(2), np.array([1.0, 0.0])), (np.ones(2), np.array([math.cos(0.09), math.sin(0.09)]))
    assert np.isnan(_crossing(*parallel)).all()
    oblique = (np.zeros(2), np.array([1.0, 0.0])), (np.ones(2), np.array([math.cos(0.12), math.sin(0.12)]))
    assert _crossing(*oblique) == pytest.approx([1.0 - 1.0 / math.tan(0.12), 0.0])


def test_widths_lengths_and_twists_by_hand() -> None:
    x = np.arange(0.0, 31.0)
    left, right = np.column_stack([x, np.full(31, -1.5)]), np.column_stack([x + 0.5, 1.5 + 0.02 * (x + 0.5)])
    widths = local_widths(left, right)
    assert widths == pytest.approx((3.0 + 0.02 * x) * math.cos(math.atan(0.02)), abs=1e-9)
    assert width_deviation(np.array([3.3] * 2 + [3.0] * 18), 3.0) == pytest.approx(0.1 * 0.1, abs=0.1)
    assert width_deviation(np.full(9, 2.7), 3.0) == pytest.approx(0.1)
    assert width_deviation(np.full(9, 3.6), 3.0, 0.3) == pytest.approx(0.1)
    assert width_deviation(np.full(9, 2.7), 3.0, 0.3) == pytest.approx(0.1)
    corners = np.array([[-1.0, -1.5], [-1.0, 1.5], [31.0, -1.5], [31.5, 1.5 + 0.02 * 31.5]])
    straight, slant = 32.0, math.hypot(1.5, 0.01) + 30.0 * math.hypot(1.0, 0.02) + math.hypot(1.0, 0.02)
    assert length_deviation(left, right, corners, 30.0) == pytest.approx(0.5 * (straight + slant) / 30.0 - 1.0)
    assert length_deviation(left, right, corners, 40.0) == pytest.approx(1.0 - 0.5 * (straight + slant) / 40.0)
    angle = np.linspace(0.0, 0.6, 40)
    arcs = [radius * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)]) for radius in (51.5, 48.5)]
    bow = anticlastic_bow(*arcs, 3.0, 5.0)
    expected = 0.5 * (1 / 51.5 + 1 / 48.5) * 25.0 / 16.0
    assert bow[5:-5] == pytest.approx(np.full(30, expected), rel=1e-2)
    assert anticlastic_bow(*arcs, 0.12, 5.0) == pytest.approx(np.full(40, 0.02), rel=1e-3)
    phi = math.radians(4.0)
    wider = 3.0 * math.cos(phi) + 5.0 * math.sin(phi)
    assert even_turn_deg(np.full(9, wider), 3.0, 5.0) == pytest.approx(4.0)
    assert even_turn_deg(np.full(9, 2.9), 3.0, 5.0) == 0.0
    assert twist_deg(np.full(20, 3.0), 3.0, 5.0) == 0.0
    turned = np.radians(np.linspace(0.0, 4.0, 101))
    grown = 3.0 * np.cos(turned) + 5.0 * np.sin(turned)
    assert twist_deg(grown, 3.0, 5.0) == pytest.approx(4.0, abs=0.3)
    root, tip = math.radians(3.0), math.radians(5.0)
    mean = (root**2 + root * tip + tip**2) / 3.0
    assert stiffening_by_twist(3.0, 5.0, 3.0, 5.0) == pytest.approx(1.0 / (1.0 - mean * (1.0 - 0.36)) - 1.0)
    words = describe_turn_effects(5.0, 4.0, 3.0, 5.0)
    effect = 100.0 * stiffening_by_twist(4.0, 4.0, 3.0, 5.0)
    assert words["even_turn"].startswith(": a turn of 4.0 degrees of the whole beam")
    assert words["even_turn"].endswith(f"changes a fitted modulus by {effect:+.2g} %")
    assert words["twist_effect"] == f"{100.0 * stiffening_by_twist(0.0, 5.0, 3.0, 5.0):+.2g}"
    assert describe_turn_effects(5.0, 0.0, 3.0, 5.0)["even_turn"] == ""
    assert describe_turn_effects(5.0, 15.0, 3.0, 5.0)["even_turn"] == ""
    assert describe_turn_effects(5.0, 14.9, 3.0, 5.0)["even_turn"] != ""


def stepped() -> StatedShape:
    rows = [[0.0, 3.0], [15.0, 3.0], [15.0, 2.0], [30.0, 2.0]]
    return StatedShape(specimen(rows, 30.0, 4.0).mechanics())


def test_the_stated_shape_has_the_widths_of_its_table() -> None:
    shape = stepped()
    assert (shape.length_mm, shape.at_clamp_mm, shape.at_tip_mm, shape.narrowest_mm) == (30.0, 3.0, 2.0, 2.0)
    even = StatedShape(specimen(3.0, 30.0, 4.0).mechanics())
    assert (even.edge_length_mm, even.at_magnet_mm) == (30.0, 3.0)
    x = np.arange(1.0, 30.0)
    edge, clamp = np.column_stack([10.0 * x, np.zeros(29)]), np.array([[0.0, -15.0], [0.0, 15.0]])
    assert not even.near_step(edge, clamp, 0).any()
    assert even.even_widths(edge, np.full(29, 30.0), clamp).tolist() == [30.0] * 29
    edge[:, 1] = np.where(x < 15.0, -15.0, -10.0)
    near = shape.near_step(edge, clamp, 0)
    assert near.nonzero()[0].tolist() == [13, 14, 15]
    widths = shape.even_widths(edge, np.where(x < 15.0, 30.0, 20.0), clamp)
    assert len(widths) == 29 - near.sum()
    assert widths == pytest.approx(np.full(len(widths), 10.0 * 2.5), rel=1e-3)


def outline() -> Array:
    # Return the points of the outline of a rectangular tip 3 mm wide at x = 20 mm, about 0.02 mm apart.
    corners = np.array([[0.0, -1.5], [20.0, -1.5], [20.0, 1.5], [0.0, 1.5]])
    parts = [np.linspace(a, b, max(2, int(np.linalg.norm(b - a) / 0.02))) for a, b in pairwise(corners)]
    return np.vstack(parts)


def test_the_corners_of_the_tip_turn_by_right_angles() -> None:
    found, turn = _tip_corners(outline(), 3.0)
    assert found is not None
    assert outline()[list(found)] == pytest.approx(np.array([[20.0, -1.5], [20.0, 1.5]]), abs=0.06)
    assert turn == pytest.approx(90.0, abs=1.0)
    assert _tip_corners(outline(), 2.2) == (None, 0.0)  # corners 1.36 widths apart
    assert _tip_corners(outline(), 4.4) == (None, 0.0)  # corners 0.68 widths apart
    assert _tip_corners(outline(), 2.4)[0] is not None
    assert _tip_corners(outline(), 3.9)[0] is not None
    assert _tip_corners(outline() * [1, -1], 3.0) == (None, 0.0)  # the outline turns the other way round
    angle = np.linspace(-math.pi / 2.0, math.pi / 2.0, 400)
    round_tip = np.column_stack([20.0 + 1.5 * np.cos(angle), 1.5 * np.sin(angle)])
    rounded = np.vstack(
        [[[x, -1.5] for x in np.arange(0, 20, 0.02)], round_tip, [[x, 1.5] for x in np.arange(20, 0, -0.02)]]
    )
    corners, turn = _tip_corners(rounded, 3.0)
    assert corners is None or turn < 50.0


def test_the_outline_runs_from_the_left_to_the_right_edge_outside_the_clamp() -> None:
    body = [(x, 5) for x in range(50, 71)] + [(70, y) for y in range(6, 60)] + [(x, 60) for x in range(70, 49, -1)]
    body += [(50, y) for y in range(59, 5, -1)]
    contour = np.array(body, float)
    clamp = ClampLine(np.array([60.0, 10.0]), np.array([0.0, 1.0]), 1.0)
    for turned in (contour, contour[::-1], np.roll(contour, 40, axis=0)):
        found = _from_left_to_right(turned, FRAME, clamp)
        assert found[:, 1].min() == 13.0  # more than 2.5 px from the clamp line
        left, right = FRAME.to_mm(found[[0, -1]])[:, 1]
        assert left < right
        assert len(found) == 2 * 47 + 21
    assert len(_from_left_to_right(contour + np.array([0.0, 50.0]), FRAME, clamp)) == 0
    assert len(_from_left_to_right(contour - np.array([0.0, 80.0]), FRAME, clamp)) == 0


def test_the_back_light_is_a_quadratic_surface_and_the_beam_is_measured_at_its_root() -> None:
    y, x = np.mgrid[0:160, 0:192].astype(float)
    light = 150.0 + 0.1 * x - 0.05 * y + 0.0005 * x * y
    found = measure_back_light(light, FRAME, 2.0)
    root = root_places(FRAME, 2.0)
    assert root[:, 1].min() == pytest.approx(10.0 + 0.3 * 14.0)
    assert root[:, 1].max() == pytest.approx(10.0 + 0.9 * 14.0)
    assert np.abs(root[:, 0] - 60.0).max() == pytest.approx(0.25 * 14.0)
    assert root_places(FRAME, 2.0, 1.5)[:, 0].mean() == pytest.approx(60.0 + 1.5 * 14.0)
    middle = np.median(150.0 + 0.1 * root[:, 0] - 0.05 * root[:, 1] + 0.0005 * root[:, 0] * root[:, 1])
    assert found.bright == pytest.approx(middle, abs=0.2)
    assert found.dark == pytest.approx(middle, abs=0.2)
    assert found.surface.shape == (10, 12)
    light[(np.abs(x - 60.0) < 7.0) & (y < 100.0)] = 30.0
    shown = measure_back_light(light, FRAME, 2.0)
    assert shown.dark == 30.0
    assert shown.bright == pytest.approx(middle, rel=0.05)
    inverse = measure_back_light(np.full((160, 192), 90.0), FRAME, 2.0)
    assert (inverse.bright, inverse.dark) == (pytest.approx(90.0), pytest.approx(90.0))


def silhouette_of(draw: Any = None, half: float = 7.0) -> Any:
    picture = SmallPicture(0.0, (200.0,), above_px=16)
    picture.add(within(picture.along, -99.0, 0.0), (20.0,))
    picture.add(within(picture.aside, -half, half) * within(picture.along, -20.0, 84.0), (20.0,))
    image = picture.exposed(0.0)[..., 0]
    if draw:
        draw(image)
    frame = BeamFrame(CALIBRATION.model_copy(update={"clamp_midpoint_px": (60.0, 26.0)}))
    light = BackLight(np.full((8, 8), 200.0, np.float32), 200.0, 20.0)
    clamp = ClampLine(np.array([60.0, 26.0]), np.array([0.0, 1.0]), 1.0)
    return find_silhouette(image, frame, clamp, light, StatedShape(specimen().mechanics()))


def rectangle(top: int, bottom: int, left: int, right: int, grey: int) -> Any:
    def draw(image: Array) -> None:
        image[top:bottom, left:right] = grey

    return draw


@pytest.mark.parametrize(
    ("draw", "expected"),
    [
        (None, {"other_bodies": 0, "hole_share": 0.0, "touches_frame": False}),
        (rectangle(50, 60, 90, 100, 20), {"other_bodies": 1}),
        (rectangle(50, 57, 90, 97, 20), {"other_bodies": 0}),  # smaller than a quarter of the squared width
        (rectangle(50, 60, 55, 65, 200), {"hole_share": pytest.approx(11 * 11 / 14.0**2, rel=0.12)}),
        (rectangle(110, 128, 53, 67, 20), {"touches_frame": True}),
        (rectangle(60, 70, 67, 128, 20), {"touches_frame": True}),
    ],
)
def test_other_bodies_holes_and_the_frame_are_noticed(draw: Any, expected: dict[str, Any]) -> None:
    found = silhouette_of(draw)
    assert {name: getattr(found, name) for name in expected} == expected


def test_no_silhouette_is_found_without_a_beam_or_of_a_short_one() -> None:
    assert silhouette_of().corners is not None
    assert silhouette_of(rectangle(26, 128, 0, 128, 200)) is None
    assert silhouette_of(rectangle(54, 128, 0, 128, 200)) is None  # an outline of 70 px is shorter than 84 px
    assert silhouette_of(rectangle(66, 128, 0, 128, 200)) is not None


def test_knots_without_three_points_in_their_interval_are_left_out() -> None:
    parameter = np.array([0.0, 1.0, 2.0, 3.0, 9.0, 10.0, 11.0, 12.0])
    assert _with_points(np.array([0.0, 3.0, 6.0, 9.0, 12.0]), parameter).tolist() == [0.0, 3.0, 12.0]
    assert _with_points(np.array([0.0, 2.0, 12.0]), parameter).tolist() == [0.0, 12.0]
    even = np.linspace(0.0, 12.0, 13)
    assert _with_points(np.array([0.0, 4.0, 8.0, 12.0]), even).tolist() == [0.0, 4.0, 8.0, 12.0]
    circle = 50.0 * np.column_stack([np.cos(even / 6.0), np.sin(even / 6.0)])
    curve = SmoothCurve(circle, 3, equal=True)
    assert curve.pieces == 3
    assert np.linalg.norm(curve.curvature(np.array([30.0, 50.0])), axis=1) == pytest.approx([0.02, 0.02], rel=0.05)
    inward = (curve.curvature(np.array([50.0])) * -curve.at(np.array([50.0]))[0]).sum()
    assert inward == pytest.approx(1.0, rel=0.05)


def edges_with(angle_deg: float, sigma: float = 0.01) -> EdgeSet:
    # Return two edges of 30 mm whose last 4 mm have the direction `angle_deg`.
    along = np.linspace(0.0, 30.0, 98)
    turn = math.radians(angle_deg)
    bent = np.maximum(along - 26.0, 0.0)
    sides = []
    for y in (-1.5, 1.5):
        points = np.column_stack([np.minimum(along, 26.0) + bent * math.cos(turn), y + bent * math.sin(turn)])
        sides.append(EdgePoints(points, np.full(98, sigma)))
    return EdgeSet(*sides, (), np.full((4, 2), np.nan))


def test_the_direction_of_the_tip_and_its_uncertainty() -> None:
    for angle in (0.0, 40.0, -75.0, 120.0):
        assert tip_angle_deg(edges_with(angle)) == pytest.approx(angle, abs=1e-9)
    spread = ((np.arange(10) - 4.5) ** 2 * (30.0 / 97.0) ** 2).sum()
    assert tip_angle_sigma_deg(edges_with(40.0)) == pytest.approx(math.degrees(0.01 / math.sqrt(2.0 * spread)))
    few = edges_with(0.0)
    short = EdgeSet(
        *(EdgePoints(side.points_mm[:2], side.sigma_mm[:2]) for side in (few.left, few.right)), (), np.zeros((4, 2))
    )
    assert math.isnan(tip_angle_deg(short))
    assert math.isnan(tip_angle_sigma_deg(short))
    three = EdgeSet(
        *(EdgePoints(side.points_mm[::45], side.sigma_mm[::45]) for side in (few.left, few.right)), (), np.zeros((4, 2))
    )
    assert tip_angle_deg(three) == pytest.approx(0.0, abs=1e-9)
    assert few.middle_mm == pytest.approx(np.column_stack([np.linspace(0.0, 30.0, 98), np.zeros(98)]))
    empty = EdgeSet(few.left, EdgePoints(np.zeros((0, 2)), np.zeros(0)), (), np.zeros((4, 2)))
    assert empty.middle_mm.shape == (0, 2)


def test_the_view_of_a_tilted_camera_is_given_in_the_beam_frame() -> None:
    # The beam hangs down in the picture: the tilt about the picture's axes (right, down) becomes (down, right).
    stated = CALIBRATION.model_copy(
        update={"stand_off_mm": 60.0, "camera_tilt_deg": (1.0, 2.0), "ruler_px": ((67.0, 10.0), (67.0, 80.0))}
    )
    view = BeamFrame(stated).view(8.0, (128, 112))
    assert isinstance(view, View)
    expected = View(np.array([45.5 / 7.0, 3.5 / 7.0]), 60.0, (2.0, 1.0), np.array([[0.0, 1.0], [10.0, 1.0]]))
    for name in expected.__dataclass_fields__:
        assert np.asarray(getattr(view, name), float) == pytest.approx(np.asarray(getattr(expected, name), float)), name
    assert (
        BeamFrame(stated.model_copy(update={"telecentric": True, "stand_off_mm": None})).view(8.0, (128, 112)) is None
    )
    assert BeamFrame(stated.model_copy(update={"stand_off_mm": 4.1})).view(8.0, (128, 112)) is not None
    with pytest.raises(ValueError, match=r"stand_off_mm = 4 .* should be more than half of depth_mm = 8"):
        BeamFrame(stated.model_copy(update={"stand_off_mm": 4.0})).view(8.0, (128, 112))
