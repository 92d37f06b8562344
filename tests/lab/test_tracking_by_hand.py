"""The search for a beam in successive frames, and the removal of the camera's motion, step by step."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.polynomial import chebyshev

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.projection import Projection
from eimi_lab.vision.tracking.beam_curve import DEGREE, BeamCurve, curve_through
from eimi_lab.vision.tracking.beam_tracker import STATIONS, BeamTracker, SeenBeam, _across, _nearest
from eimi_lab.vision.tracking.steady_view import SteadyView
from eimi_lab.vision.tracking.step_places import band_shifts, step_places
from tests.shared.small_pictures import CALIBRATION, SmallPicture

Array = np.ndarray
FRAME = BeamFrame(CALIBRATION)


def tracker(bend: float = 0.0, colour: bool = False, **options: Any) -> BeamTracker:
    # Return a tracker of the dark beam of a small picture; its first frame has the given bend.
    x = np.linspace(1.0, 11.0, 24)
    middle = bend * x**2 / 12.0
    sides = [EdgePoints(np.column_stack([x, middle + y]), np.full(24, 0.01)) for y in (-1.0, 1.0)]
    image = picture(bend)
    first = image if colour else image[..., 1]
    return BeamTracker(first, EdgeSet(*sides, (), np.full((4, 2), np.nan)), FRAME, 12.0, **options)


def picture(bend: float) -> Array:
    return SmallPicture(bend, (190.0, 200.0, 180.0)).beam(colour=(50.0, 40.0, 60.0)).exposed()


class Noted:
    # Stand-ins for two methods of a tracker, which note their arguments.

    def __init__(self, of: BeamTracker, monkeypatch: pytest.MonkeyPatch, found_at: int = 99) -> None:
        self.starts: list[tuple[BeamCurve, float]] = []
        self.reaches: list[float] = []
        self.found_at = found_at
        monkeypatch.setattr(of, "_near", self.near)
        monkeypatch.setattr(of, "_grey", self.grey)

    def near(self, grey: Array, start: BeamCurve, reach: float) -> BeamCurve | None:
        self.starts.append((start, reach))
        return start if len(self.starts) == self.found_at else None

    def grey(self, image: Array, widths: float) -> Array:
        self.reaches.append(widths)
        return image


def test_the_beam_is_searched_at_its_predicted_place_then_farther_and_at_last_where_it_was_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tracked = tracker()
    tracked.follow(picture(0.1)[..., 1])
    tracked.follow(picture(0.2)[..., 1])
    first, before, curve = tracked._first, tracked._before, tracked._curve
    assert before is not None
    noted = Noted(tracked, monkeypatch)
    lost = tracked.follow(picture(0.3)[..., 1])
    starts = [start for start, _ in noted.starts]
    assert starts[0].coefficients == pytest.approx(2.0 * curve.coefficients - before.coefficients)
    assert starts[1:] == [curve, curve, first]
    assert [reach for _, reach in noted.starts] == [1.0, 1.0, 3.0, 3.0]
    assert noted.reaches == [1.0, 3.0, 3.0]
    assert np.isnan(lost.middle_px).all()
    assert lost.middle_px.shape == lost.left_px.shape == lost.right_px.shape == (STATIONS, 2)
    assert tracked._before is None
    assert tracked._curve is curve
    again = Noted(tracked, monkeypatch)
    tracked.follow(picture(0.3)[..., 1])
    assert again.starts[0][0] is curve  # without an earlier curve, nothing is extrapolated


def test_the_search_ends_at_the_first_place_with_a_beam(monkeypatch: pytest.MonkeyPatch) -> None:
    tracked = tracker()
    image = picture(0.0)[..., 1]
    curve = tracked._curve
    for found_at, reaches in ((1, [1.0]), (2, [1.0]), (3, [1.0, 3.0]), (4, [1.0, 3.0, 3.0])):
        noted = Noted(tracked, monkeypatch, found_at)
        monkeypatch.setattr(tracked, "_curve", curve)
        monkeypatch.setattr(tracked, "_before", None)
        assert tracked.follow(image).is_seen
        assert (len(noted.starts), noted.reaches) == (found_at, reaches)


def test_a_beam_that_is_hidden_leaves_the_curve_and_no_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    tracked = tracker()
    tracked.follow(picture(0.1)[..., 1])
    assert tracked._before is not None
    curve = tracked._curve
    hidden = SeenBeam(*(np.full((STATIONS, 2), np.nan) for _ in range(3)))
    monkeypatch.setattr(tracked, "_on_edges", lambda *_: (hidden, tracked._first))
    assert tracked.follow(picture(0.1)[..., 1]) is hidden
    assert tracked._curve is curve
    assert tracked._before is None


def test_the_edges_are_searched_near_the_band_with_its_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    tracked = tracker()
    given: list[Any] = []
    before = tracked._on_edges
    monkeypatch.setattr(tracked, "_on_edges", lambda *values: given.append(values) or before(*values))
    band: list[BeamCurve] = []
    near = tracked._near
    monkeypatch.setattr(tracked, "_near", lambda *values: band.append(near(*values)) or band[-1])
    curve = tracked._curve
    image = picture(0.15)[..., 1]
    tracked.follow(image)
    [(grey, start, smear_px, usual)] = given
    assert grey is image
    assert start is band[-1]
    assert usual is tracked._first
    places, normals = curve.at(tracked._along_px)
    assert smear_px == pytest.approx(np.abs(_across(start.at(tracked._along_px)[0], places, normals)).max())


def test_only_colours_near_the_beam_are_converted() -> None:
    tracked = tracker(colour=True)
    image = np.full((400, 500, 3), 90, np.uint8)
    image[..., 2] = 30
    grey = tracked._grey(image, 1.0)
    half = float(tracked._half_px.max())
    reach = 4.0 * half + 30.0
    places = tracked._curve.at(tracked._along_px)[0]
    columns, rows = np.flatnonzero(grey.any(axis=0)), np.flatnonzero(grey.any(axis=1))
    low, high = np.floor(places.min(axis=0) - reach), np.ceil(places.max(axis=0) + reach)
    assert (columns[0], columns[-1] + 1) == (max(low[0], 0.0), high[0])
    assert (rows[0], rows[-1] + 1) == (0, high[1])
    assert grey[50, 60] == pytest.approx(70.0)
    wider = np.flatnonzero(tracked._grey(image, 3.0).any(axis=0))
    assert wider[-1] - columns[-1] == pytest.approx(4.0 * half, abs=1.01)
    deep = tracked._grey(image.astype(np.uint16), 1.0)
    assert (deep > 0.0).all()
    assert tracked._grey(image[..., 0], 1.0).tolist() == image[..., 0].tolist()
    far = BeamCurve(np.array([5000.0, 5000.0]), tracked._curve.coefficients, 84.0)
    tracked._first = tracked._curve = far
    assert not tracked._grey(image, 1.0).any()
    red = tracker(colour=True, projection=Projection("red", (0.0, 0.0, 1.0)))
    assert red._grey(image, 1.0)[50, 60] == pytest.approx(30.0)


def test_the_extrapolated_place_is_converted_too() -> None:
    tracked = tracker(colour=True)
    slow = np.flatnonzero(tracked._grey(np.full((112, 400, 3), 9, np.uint8), 1.0).any(axis=0))
    turned = tracked._curve.coefficients.copy()
    turned[0] += 0.4  # the beam turned by 0.4 rad since the frame before
    tracked._before = BeamCurve(tracked._curve.root_px, turned, 84.0)
    fast = np.flatnonzero(tracked._grey(np.full((112, 400, 3), 9, np.uint8), 1.0).any(axis=0))
    assert fast[-1] - slow[-1] > 20


def test_the_outline_has_a_margin_of_one_and_a_half_widths() -> None:
    tracked = tracker()
    outline = tracked.outline_px
    half = float(tracked._half_px.max())
    assert half == pytest.approx(7.0, abs=0.4)
    assert len(outline) == 2 * (2 * STATIONS) + 2
    assert outline[0] == pytest.approx([60.0 + 3.0 * half, 10.0], abs=0.5)
    assert outline[-1] == pytest.approx([60.0 - 3.0 * half, 10.0], abs=0.5)
    ends = outline[2 * STATIONS : 2 * STATIONS + 2]
    assert ends == pytest.approx(
        np.array([[60.0 + 3.0 * half, 94.0 + 3.0 * half], [60.0 - 3.0 * half, 94.0 + 3.0 * half]]), abs=0.6
    )


def test_half_of_the_width_is_at_least_half_of_its_median() -> None:
    x = np.linspace(1.0, 11.0, 24)
    near = np.where(x > 9.0, 0.2, 1.0)  # edge points on the middle line near the tip
    sides = [EdgePoints(np.column_stack([x, sign * near]), np.full(24, 0.01)) for sign in (-1.0, 1.0)]
    tracked = BeamTracker(picture(0.0)[..., 1], EdgeSet(*sides, (), np.full((4, 2), np.nan)), FRAME, 12.0)
    assert tracked._half_px.max() == pytest.approx(7.0, abs=0.01)
    assert tracked._half_px.min() == pytest.approx(3.5, abs=0.01)
    assert tracked.along_mm[[0, -1]] == pytest.approx([0.06 * 12.0, 0.97 * 12.0])
    assert len(tracked.along_mm) == STATIONS


@pytest.mark.parametrize("swapped", [False, True])
def test_the_left_edge_is_that_of_the_edge_set(swapped: bool) -> None:
    x = np.linspace(1.0, 11.0, 24)
    left, right = (EdgePoints(np.column_stack([x, np.full(24, y)]), np.full(24, 0.01)) for y in (-1.0, 1.0))
    pair = (right, left) if swapped else (left, right)
    tracked = BeamTracker(picture(0.0)[..., 1], EdgeSet(*pair, (), np.full((4, 2), np.nan)), FRAME, 12.0)
    seen = tracked.follow(picture(0.0)[..., 1])
    lower, upper = np.nanmedian(seen.left_px[:, 0]), np.nanmedian(seen.right_px[:, 0])
    assert (lower, upper) == pytest.approx((67.0, 53.0) if swapped else (53.0, 67.0), abs=0.3)
    assert np.nanmedian(seen.middle_px[:, 0]) == pytest.approx(60.0, abs=0.2)


def test_the_nearest_points_and_distances_across() -> None:
    line = np.array([[0.0, 0.0], [4.0, 0.0], [8.0, 1.0]])
    assert _nearest(line, np.array([[3.0, 2.0], [7.0, 9.0]])).tolist() == [[4.0, 0.0], [8.0, 1.0]]
    across = _across(np.array([[1.0, 2.0], [3.0, 5.0]]), np.zeros((2, 2)), np.array([[0.6, 0.8], [1.0, 0.0]]))
    assert across == pytest.approx([2.2, 3.0])


def of_direction(direction: Any, length: float = 60.0) -> BeamCurve:
    # Return the curve whose direction at the share s of the length is `direction(s)`.
    share = np.linspace(0.0, 1.0, 200)
    fitted = chebyshev.chebfit(2.0 * share - 1.0, [direction(value) for value in share], DEGREE)
    return BeamCurve(np.array([5.0, 7.0]), fitted, length)


def test_the_places_of_a_curve_are_the_integral_of_its_direction() -> None:
    curve = of_direction(lambda share: 0.4 + 0.9 * share**2)
    along = np.array([0.0, 11.0, 37.5, 60.0])
    places, normals = curve.at(along)
    for number, end in enumerate(along):
        steps = (np.arange(4000) + 0.5) / 4000 * end
        direction = 0.4 + 0.9 * (steps / 60.0) ** 2
        expected = np.array([5.0, 7.0]) + end * np.array([np.cos(direction).mean(), np.sin(direction).mean()])
        assert places[number] == pytest.approx(expected, abs=5e-3)
        turn = 0.4 + 0.9 * (end / 60.0) ** 2
        assert normals[number] == pytest.approx([-np.sin(turn), np.cos(turn)], abs=1e-3)


@pytest.mark.parametrize("usual", [False, True])
def test_a_moved_curve_solves_the_regularised_least_squares(usual: bool) -> None:
    # The derivatives of the offsets are computed by finite differences of the curve's parameters.
    curve = of_direction(lambda share: 0.3 + 0.5 * share)
    other = of_direction(lambda share: 0.1 + 0.2 * share**2)
    other = BeamCurve(np.array([6.0, 7.5]), other.coefficients, 60.0)
    nodes = np.linspace(0.0, 60.0, 129)
    along = nodes[[0, 20, 45, 70, 100, 128]]
    rng = np.random.default_rng(3)
    offset, weight = rng.normal(0.0, 1.0, 6), rng.uniform(0.2, 2.0, 6)
    places, normals = curve.at(along)
    root = float(chebyshev.chebval(-1.0, curve.coefficients))
    across = np.array([-np.sin(root), np.cos(root)])
    columns = [normals @ across]
    for degree in range(DEGREE + 1):
        more = curve.coefficients.copy()
        more[degree] += 1e-6
        changed = BeamCurve(curve.root_px, more, 60.0).at(along)[0]
        columns.append(((changed - places) * normals).sum(axis=1) / 1e-6)
    jacobian = np.column_stack(columns)
    scale = np.abs(jacobian).max(axis=0)
    degrees = np.arange(DEGREE + 1)
    if usual:
        stiff = weight.sum() * scale**2 * np.concatenate([[0.05], 2e-4 * degrees**3])
        wanted = np.concatenate([[(other.root_px - curve.root_px) @ across], other.coefficients - curve.coefficients])
    else:
        stiff = weight.sum() * scale**2 * 1e-4 * np.concatenate([[1.0], degrees**2])
        wanted = np.zeros(DEGREE + 2)
    normal = jacobian.T @ (weight[:, None] * jacobian) + np.diag(stiff + 1e-12)
    change = np.linalg.solve(normal, jacobian.T @ (weight * offset) + stiff * wanted)
    moved = curve.moved(along, offset, weight, other if usual else None)
    assert moved.root_px == pytest.approx(curve.root_px + change[0] * across, abs=1e-5)
    assert moved.coefficients == pytest.approx(curve.coefficients + change[1:], abs=1e-5)
    assert moved.length_px == 60.0
    light = curve.moved(along, offset, 1e-3 * weight)
    assert np.abs(light.coefficients - curve.coefficients).max() < np.abs(moved.coefficients - curve.coefficients).max()


def test_a_curve_through_points_begins_at_the_first_and_follows_their_direction() -> None:
    angle = np.linspace(0.0, 1.0, 25)
    points = np.array([3.0, 4.0]) + 50.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    curve = curve_through(points, 50.0)
    assert curve.root_px == pytest.approx([3.0, 4.0], abs=0.02)
    assert curve.length_px == 50.0
    found = curve.at(50.0 * angle)[0]
    assert found == pytest.approx(points, abs=0.03)
    backward = curve_through(points @ np.array([[-1.0, 0.0], [0.0, 1.0]]), 50.0)  # across the direction of 180 degrees
    assert backward.at(50.0 * angle)[0] == pytest.approx(points * [-1.0, 1.0], abs=0.03)


def test_a_step_is_measured_between_plateaus_of_a_sixth() -> None:
    rng = np.random.default_rng(2)
    u = np.linspace(-3.0, 3.0, 25)
    profiles = rng.uniform(0.0, 10.0, (4, 25)) + np.where(u > 0.4, 80.0, 20.0)
    found = step_places(u, profiles)
    for row in range(4):
        low, high = profiles[row, :4].mean(), profiles[row, -4:].mean()
        share = (profiles[row] - low) / (high - low)
        assert found.height[row] == pytest.approx(high - low)
        assert found.offset_px[row] == pytest.approx(3.0 - np.trapezoid(share, u))
    flat = step_places(u[:9], np.full((1, 9), 7.0))
    assert flat.height.tolist() == [0.0]
    assert flat.offset_px.tolist() == [u[8]]
    few = step_places(u[:6], np.array([[1.0, 3.0, 4.0, 5.0, 6.0, 8.0]]))
    assert few.height.tolist() == [5.0]  # at least two values at each end


def test_the_shift_of_a_band_stays_within_its_reach() -> None:
    u = np.arange(-30.0, 31.0)
    profile = np.where(np.abs(u - 9.0) < 5.0, 40.0, 100.0)[None]
    for reach, shift in ((12.0, 9.0), (9.0, 9.0), (8.9, 7.0)):
        found, contrast = band_shifts(profile, u, np.array([5.0]), np.array([reach]), 1.0)
        assert found.tolist() == [shift]
        assert (contrast > 20.0).all()


@pytest.mark.parametrize("wide", [240, 1500])
def test_a_frame_is_moved_by_the_measured_map(monkeypatch: pytest.MonkeyPatch, wide: int) -> None:
    # In a halved picture, the pixel x lies at 2 x + 0.5 of the frame.
    rng = np.random.default_rng(4)
    small = rng.uniform(0.0, 255.0, (30, wide // 20)).astype(np.float32)
    image = np.rint(cv2.resize(small, (wide, 120), interpolation=cv2.INTER_CUBIC)).clip(0, 255).astype(np.uint8)
    view = SteadyView(image, np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]))
    turn = 0.02
    measured = np.array([[np.cos(turn), -np.sin(turn), 2.5], [np.sin(turn), np.cos(turn), -1.5]])
    monkeypatch.setattr(view, "_follow", lambda _: measured)
    monkeypatch.setattr(SteadyView, "is_possible", True)
    steadied = view.steadied(image)
    full = measured.copy()
    if wide > 1400:
        full[:, 2] = 2.0 * measured[:, 2] + 0.5 - measured[:, :2] @ [0.5, 0.5]
    expected = cv2.warpAffine(
        image, full, (wide, 120), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
    )
    assert (steadied == expected).all()
    height, width = (60, 750) if wide > 1400 else (120, 240)
    corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]])
    moved = np.hypot(*(corners @ measured[:, :2].T + measured[:, 2] - corners).T).max()
    assert view.moved_px == pytest.approx(moved * (2.0 if wide > 1400 else 1.0))
    monkeypatch.setattr(view, "_follow", lambda _: None)
    assert (view.steadied(image) == expected).all()  # the last map is kept
    monkeypatch.setattr(view, "_follow", lambda _: np.eye(2, 3))
    assert view.moved_px == pytest.approx(moved * (2.0 if wide > 1400 else 1.0))  # the largest motion


@pytest.mark.parametrize(("shift", "moves"), [(0.29, False), (0.31, True)])
def test_a_camera_that_moves_by_less_than_a_third_of_a_pixel_is_fixed(
    monkeypatch: pytest.MonkeyPatch, shift: float, moves: bool
) -> None:
    image = picture(0.0)
    view = SteadyView(image, np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]))
    monkeypatch.setattr(SteadyView, "is_possible", True)
    monkeypatch.setattr(view, "_follow", lambda _: np.array([[1.0, 0.0, shift], [0.0, 1.0, 0.0]]))
    assert (view.steadied(image) is not image) is moves
    assert view.moved_px == pytest.approx(shift)


@pytest.mark.parametrize(("length", "turn"), [(20.0, 1.6), (20.0, 2.5), (40.0, -1.6)])
def test_the_curve_through_points_of_a_curve_is_this_curve(length: float, turn: float) -> None:
    curve = of_direction(lambda share: 0.3 + turn * share, length)
    found = curve_through(curve.at(np.linspace(0.0, length, 41))[0], length)
    along = np.linspace(0.0, length, 30)
    assert found.at(along)[0] == pytest.approx(curve.at(along)[0], abs=5e-4)


def test_a_place_far_from_the_smooth_band_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    # Eleven places are not sure. Of the others, one lies 4 px beside the others, more than 2 px from a smooth line.
    tracked = tracker()
    shift, contrast = np.zeros(STATIONS), np.full(STATIONS, tracked._contrast)
    shift[6], shift[13:], contrast[13:] = 4.0, 30.0, 0.3 * tracked._contrast
    reaches: list[float] = []

    def bands(grey: Array, curve: BeamCurve, reach: float, polarity: float) -> tuple[Array, Array]:
        reaches.append(reach)
        return shift, contrast

    monkeypatch.setattr(tracked, "_bands", bands)
    curve = tracked._curve
    found = tracked._near(picture(0.0)[..., 1], curve, 1.0)
    assert found is not None
    assert found.at(tracked._along_px)[0] == pytest.approx(curve.at(tracked._along_px)[0], abs=1e-6)
    assert reaches == [1.0]  # the places hardly moved
    shift[:13] = 3.6  # half of the half width is 3.5 px
    moved = tracked._near(picture(0.0)[..., 1], curve, 1.0)
    assert moved is not None
    assert reaches == [1.0, 1.0, 0.5]
    contrast[12] = 0.3 * tracked._contrast
    assert tracked._near(picture(0.0)[..., 1], curve, 1.0) is not None  # twelve of 24 places
    contrast[11] = 0.3 * tracked._contrast
    assert tracked._near(picture(0.0)[..., 1], curve, 1.0) is None


@pytest.mark.parametrize(("aside", "rounds"), [(0.9, 1), (1.1, 3)])
def test_the_edges_are_measured_again_if_the_curve_was_farther_than_a_pixel(
    monkeypatch: pytest.MonkeyPatch, aside: float, rounds: int
) -> None:
    tracked = tracker()
    sides: list[float] = []
    reaches: set[float] = set()

    def edge(grey: Array, places: Array, normals: Array, side: float, reach: float) -> Array:
        sides.append(side)
        reaches.add(reach)
        return places + (aside + 7.0 * side) * normals

    monkeypatch.setattr(tracked, "_edge", edge)
    curve = tracked._curve
    seen, moved = tracked._on_edges(picture(0.0)[..., 1], curve, 3.0, None)
    assert sides == [1.0, -1.0] * rounds
    assert reaches == {8.5}  # 7 px and half of the motion
    places, normals = curve.at(tracked._along_px)
    offset = _across(moved.at(tracked._along_px)[0], places, normals)
    assert offset == pytest.approx(np.full(STATIONS, rounds * aside), abs=0.02 * rounds)
    assert np.isfinite(seen.middle_px).all()


def test_an_edge_point_far_from_the_smooth_curve_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    tracked = tracker()
    curve = tracked._curve
    for off_px, is_kept in ((2.0, True), (5.0, False)):
        shift = np.zeros(STATIONS)
        shift[9] = off_px
        monkeypatch.setattr(
            tracked,
            "_edge",
            lambda grey, places, normals, side, reach, shift=shift: places + (shift[:, None] + 7.0 * side) * normals,
        )
        seen, _ = tracked._on_edges(picture(0.0)[..., 1], curve, 0.0, None)
        finite = np.isfinite(seen.middle_px[:, 0])
        assert finite.tolist() == [number != 9 or is_kept for number in range(STATIONS)]
        assert np.isfinite(seen.left_px[:, 0]).tolist() == np.isfinite(seen.right_px[:, 0]).tolist() == finite.tolist()
