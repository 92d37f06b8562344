"""The steps that find the two edges of a beam agree with plain loops and with calculations by hand."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eimi_lab.vision.following import support as support_module
from eimi_lab.vision.following.colour_seams import find_colour_seams
from eimi_lab.vision.following.crossings import leave_out_crossings
from eimi_lab.vision.following.discriminant import ColourProjection, project
from eimi_lab.vision.following.doubts import clipped_share, penumbra_px, reflection_share, shadow_px
from eimi_lab.vision.following.edge_points import StripEdges, _common, _slopes_of_lines, estimate_scatter
from eimi_lab.vision.following.seams import fall_across, find_seams
from eimi_lab.vision.following.support import Sides, _Chain, sure_share
from eimi_lab.vision.following.texture import _averaged
from eimi_lab.vision.following.unrolled import UnrolledPicture
from tests.shared.sampled_beam import ACROSS, EDGES, body, unrolled

Array = np.ndarray


def test_the_fall_is_the_difference_of_the_means_on_both_sides() -> None:
    # The fall agrees with a loop over the places: means over 0.12 widths, averaged over 0.35 widths along the beam.
    share = np.random.default_rng(3).uniform(0.0, 1.0, (9, 25))
    across = np.arange(25) / 24.0
    fall = fall_across(share, -1.0, across, 12.0)
    padded = np.pad(share, ((2, 2), (3, 3)), mode="edge")
    for station, place in itertools.product(range(9), range(25)):
        rows, at = padded[station : station + 4, :], place + 3
        near, far = rows[:, at - 3 : at].mean(), rows[:, at + 1 : at + 4].mean()
        assert fall[station, place] == pytest.approx(-(near - far), abs=1e-12)
    assert fall_across(share, 1.0, across, 12.0) == pytest.approx(-fall)
    wide = fall_across(share, 1.0, across, 1.0, 0.25)
    assert wide[4, 12] == pytest.approx(share[4, 6:12].mean() - share[4, 13:19].mean())
    assert fall_across(share[:, :3], 1.0, across[:3], 1.0, 0.01)[4, 1] == pytest.approx(
        share[4, [0, 0]].mean() - share[4, [2, 2]].mean()
    )


def test_the_seam_is_the_best_of_all_lines() -> None:
    # The seam agrees with a search through every line of 4 stations and 9 places that moves by at most 2 places.
    rng = np.random.default_rng(2)
    across = np.linspace(-0.4, 0.4, 9)
    for _ in range(4):
        fall, expected = rng.uniform(0.0, 0.6, (1, 4, 9)), rng.uniform(-0.2, 0.2, (1, 4))
        value = fall[0] - 0.25 * ((across - expected[0][:, None]) / 0.3) ** 2

        def total(line: tuple[int, ...], value: Array = value) -> float:
            moves = np.abs(np.diff(line))
            return float(value[range(4), line].sum() - 0.05 * moves.sum()) if moves.max() <= 2 else -np.inf

        best = max(itertools.product(range(9), repeat=4), key=total)
        [seam] = find_seams(fall, across, expected, 0.3)
        inner = np.clip(best, 1, 7)
        before, here, after = (value[range(4), inner + shift] for shift in (-1, 0, 1))
        bend = np.minimum(before - 2.0 * here + after, -1e-9)
        shift = np.clip(0.5 * (before - after) / bend, -0.5, 0.5)
        assert seam == pytest.approx(across[inner] + 0.1 * shift)


def test_a_steep_seam_of_two_places_a_station_is_found() -> None:
    across = np.linspace(-1.0, 1.0, 21)
    fall = np.zeros((2, 6, 21))
    fall[0, range(6), range(2, 14, 2)] = 1.0
    fall[1, range(6), range(14, 2, -2)] = 1.0
    seams = find_seams(fall, across, np.zeros((2, 6)), 10.0)
    assert seams[0] == pytest.approx(across[2:14:2], abs=0.01)
    assert seams[1] == pytest.approx(across[14:2:-2], abs=0.01)


@pytest.mark.parametrize(("outward", "band"), [(1.0, (0.08, 0.3)), (-1.0, (0.3, 0.7))])
def test_the_projection_is_fishers_discriminant(outward: float, band: tuple[float, float]) -> None:
    # Weight, level and separation agree with Fisher's formula for one window that contains the whole picture.
    colours = body((40.0, 60.0, 200.0), (150.0, 160.0, 130.0), stations=18)
    colours += np.random.default_rng(4).normal(0.0, 6.0, colours.shape)
    picture = unrolled(colours)
    picture.inside[:, :2] = False
    edge = np.full(18, 0.5 * outward)
    found = project(picture, edge, outward, 2.0, inside_band=band)
    distance = outward * (ACROSS - 0.5 * outward)
    rows = range(9 - 9, 9 + 9)  # 1.5 widths: 18 stations
    use = picture.inside[0]
    inside = colours[rows][:, (distance <= -band[0]) & (distance >= -band[1]) & use].reshape(-1, 3)
    outside = colours[rows][:, (distance >= 0.08) & (distance <= 0.55) & use].reshape(-1, 3)
    spread = 0.5 * (np.cov(inside.T, bias=True) + np.cov(outside.T, bias=True))
    spread += (2.0**2 + 1.0 + 0.02 * np.trace(spread) / 3.0) * np.eye(3)
    step = inside.mean(axis=0) - outside.mean(axis=0)
    weight = np.linalg.solve(spread, step)
    height = weight @ step
    assert found.step[9] == pytest.approx(step, rel=1e-4)
    assert found.weight[9] == pytest.approx(weight / height, rel=1e-3)
    assert found.separation[9] == pytest.approx(math.sqrt(height), rel=1e-3)
    assert found.level[9] == pytest.approx(outside.mean(axis=0) @ weight / height, rel=1e-3)
    linear = np.clip(colours[9] @ weight / height - found.level[9], -0.5, 1.5)
    assert np.abs(found.share[9] - 0.5 * linear).max() <= 0.5 + 1e-6  # the rest is a probability from 0 to 1
    assert np.median(np.abs(found.share[9] - 0.5 * linear - np.where(np.abs(ACROSS) < 0.5, 0.5, 0.0))) < 0.05


def test_a_shadow_is_invisible_in_a_shadowless_projection() -> None:
    # All multiples of the colour of the surroundings have the same value, and the beam has another one.
    ground = (150.0, 160.0, 130.0)
    picture = unrolled(body((40.0, 60.0, 200.0), ground, (0.6, 0.9, tuple(0.5 * value for value in ground))))
    found = project(picture, np.full(60, 0.5), 1.0, 1.0, shadowless=True)
    values = found.share[30]
    assert values[ACROSS > 0.95].mean() == pytest.approx(0.0, abs=0.06)
    assert values[(ACROSS > 0.62) & (ACROSS < 0.88)].mean() == pytest.approx(0.0, abs=0.06)
    assert values[(ACROSS > 0.2) & (ACROSS < 0.42)].mean() == pytest.approx(1.0, abs=0.06)
    covered = np.zeros((60, 53), dtype=bool)
    covered[20:25] = True
    left_out = project(
        replace(picture, covered=covered),
        np.full(60, 0.5),
        1.0,
        1.0,
    )
    assert (left_out.share[20:25] == 0.5).all()
    assert (left_out.share[26] != 0.5).all()


def test_the_support_is_that_of_a_step_at_the_edge_in_the_image() -> None:
    picture = unrolled(body((60.0,), (200.0,)))
    picture.inside[:10] = False
    seams = find_colour_seams(picture, EDGES + 0.05, 1.0, (0.3, 0.2))
    assert np.abs(seams.edge - np.outer([-0.5, 0.5], np.ones(60))).max() < 0.03
    assert seams.support[:, 12:].min() > 0.7
    assert (seams.support[:, :10] == 0.0).all()
    assert seams.support.max() <= 1.0
    assert (seams.shadow == 0.0).all()


def crossing(difference: float, rows: int, columns: slice = slice(None)) -> UnrolledPicture:
    # Return a grey picture with a brighter body across it, `rows` stations (places along the beam) long.
    colours = np.full((100, 53, 3), 100.0)
    colours[40 : 40 + rows, columns] += difference / math.sqrt(3.0)
    return leave_out_crossings(unrolled(colours))


def test_a_short_body_of_another_colour_across_the_picture_is_left_out() -> None:
    # A body across the whole picture is left out if it is clearly distinct and shorter than 0.8 widths.
    found = crossing(42.0, 9)
    assert found.covered is not None
    assert found.covered.any(axis=1).nonzero()[0].tolist() == list(range(39, 50))  # and the next stations
    assert (found.inside == ~found.covered).all()
    assert crossing(-42.0, 9).covered is not None
    assert crossing(38.0, 9).covered is None
    assert crossing(42.0, 10).covered is None
    assert crossing(42.0, 9, slice(1, None)).covered is None
    assert crossing(42.0, 9, slice(None, 52)).covered is None
    noisy = np.full((100, 53, 3), 100.0)
    noisy[::2] += 10.0 / math.sqrt(3.0)
    for difference, is_found in ((40.0, False), (80.0, True)):  # six median deviations are 60 grey levels
        colours = noisy.copy()
        colours[40:49] = 100.0 + difference / math.sqrt(3.0)
        assert (leave_out_crossings(unrolled(colours)).covered is not None) is is_found


def sides_of(**changed: Any) -> Sides:
    projections = tuple(
        ColourProjection(
            np.zeros((60, 53)), np.full(60, 9.0), np.ones((60, 3)), np.zeros(60), np.full((60, 3), -1.0) * 20.0
        )
        for _ in (0, 1)
    )
    values: dict[str, Any] = {
        "edge": EDGES,
        "support": np.ones((2, 60)),
        "sound": np.ones((2, 60), dtype=bool),
        "end": 60,
        "projected": projections,
        "shadow": np.zeros((2, 60)),
    }
    return Sides(**{**values, **changed})


def blurred(blur_px: float) -> StripEdges:
    return StripEdges(np.zeros((0, 2)), np.zeros(0), np.zeros(0), blur_px)


@pytest.mark.parametrize(
    ("blurs", "expected"),
    [((2.0, 2.4), 0.0), ((2.0, 2.6), 2.6), ((2.6, 2.0), 2.6), ((2.0, 5.0), 5.0), ((2.4, 2.0), 0.0)],
)
def test_a_more_blurred_edge_may_be_the_border_of_a_shadow(blurs: tuple[float, float], expected: float) -> None:
    assert penumbra_px(blurred(blurs[0]), blurred(blurs[1]), sides_of(), 20.0) == expected


def test_a_border_that_brightens_a_colour_is_no_shadow_unless_its_blur_is_double() -> None:
    sides = sides_of()
    sides.projected[1].step[:, 2] = 20.0
    assert penumbra_px(blurred(2.0), blurred(3.9), sides, 20.0) == 0.0
    assert penumbra_px(blurred(2.0), blurred(4.1), sides, 20.0) == 4.1
    assert penumbra_px(blurred(3.9), blurred(2.0), sides, 20.0) == 3.9  # the other edge darkens every colour
    sides.sound[1, :40] = False
    sides.projected[1].step[40:, 2] = -20.0
    assert penumbra_px(blurred(2.0), blurred(3.9), sides, 20.0) == 3.9  # only reliable places count


def test_the_doubt_about_a_shadow_is_the_larger_of_blur_and_excess_width() -> None:
    wide = sides_of(edge=np.outer([-0.5, 0.8], np.ones(60)))
    assert penumbra_px(blurred(2.0), blurred(3.0), wide, 20.0) == pytest.approx(6.0)
    assert penumbra_px(blurred(2.0), blurred(7.0), wide, 20.0) == pytest.approx(7.0)
    wide.sound[0] = False
    assert penumbra_px(blurred(2.0), blurred(3.0), wide, 20.0) == pytest.approx(3.0)
    sound = np.zeros((2, 60), dtype=bool)
    sound[:, :30], sound[0, 30:40] = True, True
    shadow = np.where(np.arange(60) < 15, 0.3, 0.0) * np.ones((2, 1))
    assert shadow_px(sides_of(shadow=shadow, sound=sound), 20.0) == pytest.approx(20.0 * 0.3 * math.sqrt(30.0 / 70.0))


def lit(*bands: tuple[float, float], level: float = 250.0, stations: int = 15, channels: int = 3) -> UnrolledPicture:
    # Return a picture of a beam with bright stripes along it; `bands` are their limits across the beam.
    colours = np.full((60, 53, 3), 90.0)
    for low, high in bands:
        colours[:stations, (low <= ACROSS) & (high >= ACROSS), :channels] = level
    return unrolled(colours)


@pytest.mark.parametrize(
    ("picture", "share"),
    [
        (lit((0.45, 0.55)), 0.25),
        (lit((-0.55, -0.45), stations=30), 0.5),
        (lit((0.66, 0.69)), 0.25),  # within 0.2 widths of the edge
        (lit((0.72, 0.8)), 0.0),
        (lit((0.31, 0.34)), 0.25),
        (lit((0.25, 0.29)), 0.0),
        (lit((0.45, 0.55), (0.16, 0.19)), 0.0),  # the beam itself is bright
        (lit((0.45, 0.55), (0.21, 0.25)), 0.25),
        (lit((0.45, 0.55), (0.75, 0.9)), 0.0),  # the surroundings are bright
        (lit((0.45, 0.55), (1.06, 1.09)), 0.25),
        (lit((0.45, 0.55), level=239.0), 0.0),
        (lit((0.45, 0.55), level=240.0), 0.25),
        (lit((0.45, 0.55), channels=1), 0.0),
        (lit((0.45, 0.55), channels=2), 0.25),
    ],
)
def test_the_share_of_an_edge_with_a_reflection(picture: UnrolledPicture, share: float) -> None:
    assert reflection_share(picture, sides_of()) == pytest.approx(share)


@pytest.mark.parametrize(
    ("picture", "share"),
    [
        (lit((0.6, 1.05), level=254.0), 0.25),
        (lit((0.6, 1.05), level=252.0), 0.0),
        (lit((0.6, 1.05), level=254.0, channels=1), 0.25),
        (lit((0.2, 0.42), level=254.0), 0.25),
        (lit((0.28, 0.42), level=254.0), 0.25),  # more than a half of the band inside the beam
        (lit((0.3, 0.42), level=254.0), 0.0),
        (lit((0.82, 1.05), level=254.0), 0.0),
        (lit((0.78, 1.05), level=254.0), 0.25),
        (lit((-1.05, -0.6), level=254.0, stations=30), 0.5),
    ],
)
def test_the_share_of_an_edge_beside_clipped_light(picture: UnrolledPicture, share: float) -> None:
    assert clipped_share(picture, sides_of()) == pytest.approx(share)


def test_only_reliable_places_count_for_reflections_and_clipping() -> None:
    sound = np.ones((2, 60), dtype=bool)
    sound[1, 30:] = False
    assert reflection_share(lit((0.45, 0.55)), sides_of(sound=sound)) == pytest.approx(0.5)
    assert clipped_share(lit((0.6, 1.05), level=254.0), sides_of(sound=sound)) == pytest.approx(0.5)
    sound[1] = False
    assert reflection_share(lit((0.45, 0.55)), sides_of(sound=sound)) == 0.0
    assert clipped_share(lit((0.6, 1.05), level=254.0), sides_of(sound=sound)) == 0.0


@pytest.mark.parametrize(
    ("sound", "expected"),
    [
        ((100, 0), {"followed_patches": 1.0}),
        ((95, 9), {"followed_patches": 0.91}),
        ((95, 10), {"followed_sides": 0.9}),
        ((20, 10), {"followed_sides": 0.9}),
        ((0, 9), {"followed_patches": 0.91}),
    ],
)
def test_gaps_of_a_tenth_of_the_length_are_long(sound: tuple[int, int], expected: dict[str, float]) -> None:
    begin, gap = sound
    row = np.ones(100, dtype=bool)
    row[np.arange(begin, begin + gap) % 100] = False
    if begin + gap > 100:  # the gap is split between both ends
        assert sure_share(np.stack([row, row]))["followed_patches"] == 1.0 - gap / 100
    else:
        assert sure_share(np.stack([np.ones(100, dtype=bool), row])) == expected


def test_the_end_is_where_one_edge_alone_continues_near_the_length_of_the_beam() -> None:
    along = np.arange(100) / 10.0
    both = np.zeros((2, 100), dtype=bool)
    both[:, :60] = True
    assert support_module._end(along, both, 6.0) == 60
    one = both.copy()
    one[0, 60:90] = True
    assert support_module._end(along, one, 6.0) == 60  # alone beyond 0.9 of the length
    assert support_module._end(along, one, 8.0) == 72
    assert support_module._end(along, one, 20.0) == 90
    assert support_module._end(along, np.vstack([one[0], np.zeros(100, dtype=bool)]), 6.0) == 90


def test_the_turn_of_an_edge_on_a_circle() -> None:
    angle = np.linspace(0.0, 2.0, 81)
    seam = 50.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    turn = support_module._turn(seam, 4)
    assert turn[4:-4] == pytest.approx(np.full(73, 4 * 2.0 / 80.0))
    assert support_module._turn(seam[::-1], 4)[10] == pytest.approx(0.1)


def chain(points: Array, width: float = 1.0) -> _Chain:
    stations = np.arange(len(points))
    return _Chain.through(points, np.full(len(points), width), stations, 10, 3)


def test_the_direction_at_the_end_of_an_edge_is_that_of_its_last_points() -> None:
    first = np.column_stack([np.zeros(20), np.arange(20.0)])
    last = np.array([0.0, 20.0]) + np.arange(10.0)[:, None] * np.array([0.6, 0.8])
    found = chain(np.vstack([first, last]))
    assert found.direction == pytest.approx([0.6, 0.8])
    assert found.end.tolist() == pytest.approx(last[-1].tolist())
    assert found.foot == pytest.approx(last[-1])
    assert (len(found), found.width) == (30, 1.0)
    assert chain(np.vstack([first, last])[::-1]).direction == pytest.approx([0.0, -1.0])
    assert math.isnan(_Chain.through(last, np.full(10, np.nan), np.arange(10), 10, 3).width)


@pytest.mark.parametrize(
    ("gap", "aside", "leads"),
    [
        (10.0, 4.7, True),
        (10.0, 5.1, False),
        (10.0, -4.7, True),
        (30.0, 9.7, True),
        (30.0, 10.1, False),
        (-5.0, 0.0, False),
    ],
)
def test_an_edge_leads_to_points_near_its_straight_continuation(gap: float, aside: float, leads: bool) -> None:
    # Largest distance from the straight continuation: 0.12 of the width of 20 px, plus a quarter of the gap.
    found = chain(np.column_stack([np.zeros(12), np.arange(12.0)]))
    ahead = np.array([[aside, 11.0 + gap]] * 3)
    assert found.leads_to(ahead, 20.0) is leads


def joined(gap: int, aside: float = 0.0, width: float = 1.0, beside: bool = True, first: int = 40) -> bool:
    # Return whether the points of an edge before and behind a gap of `gap` unreliable points count as one edge.
    # aside: distance (px) between the two parts of the edge. width: relative width of the beam behind the gap. beside:
    # whether the width is known in the gap. first: number of points before the gap.
    stations = first + gap + 30
    seam = np.column_stack([np.zeros(stations), 2.0 * np.arange(stations)])
    seam[first + gap :, 0] = aside
    widths = np.where(np.arange(stations) < first, 1.0, width)
    if not beside:
        widths[first : first + gap] = np.nan
    sound = np.ones(stations, dtype=bool)
    sound[first : first + gap] = False
    kept = support_module._longest_chain(seam, widths, sound, 24.0, 18)
    return bool(kept[:first].all() and kept[first + gap :].all())


@pytest.mark.parametrize(
    ("case", "is_joined"),
    [
        ({"gap": 12}, True),
        ({"gap": 12, "aside": 16.0, "width": 1.3}, False),  # another body
        ({"gap": 12, "aside": 16.0, "width": 1.2}, True),  # beside a reliable edge, about as wide
        ({"gap": 12, "aside": 16.0, "width": 1.22}, False),  # 0.15 + 0.25 * 0.25 widths
        ({"gap": 12, "aside": 16.0, "width": 1.2, "beside": False}, False),
        ({"gap": 12, "width": 1.36, "beside": False}, True),  # straight on: 0.1 + 0.25 * 1.08 widths
        ({"gap": 12, "width": 1.38, "beside": False}, False),
        ({"gap": 12, "aside": 12.5, "width": 1.3}, True),
        ({"gap": 12, "aside": 13.2, "width": 1.3}, False),
        ({"gap": 12, "aside": 16.0, "first": 6}, False),  # too short a piece
        ({"gap": 12, "aside": 16.0, "first": 7}, True),
        ({"gap": 2, "aside": 5.0, "first": 6, "width": 1.2}, False),
        ({"gap": 1, "aside": 4.0, "first": 6, "width": 1.1}, True),  # a notch
    ],
)
def test_an_edge_continues_behind_a_gap_if_it_leads_there_or_if_the_width_is_known(
    case: dict[str, Any], is_joined: bool
) -> None:
    assert joined(**case) is is_joined


def test_the_slope_of_light_along_lines() -> None:
    places = np.array([3.0, 3.5, 4.0, 4.5, 5.0])
    rng = np.random.default_rng(1)
    profiles = rng.normal(0.0, 1.0, (3, 5)) + 0.3 * places
    slope, residual = _slopes_of_lines(profiles, places)
    for row in range(3):
        line = np.polyfit(places, profiles[row], 1)
        assert slope[row] == pytest.approx(line[0])
        off = profiles[row] - np.polyval(line, places)
        assert residual[row] == pytest.approx(math.sqrt((off**2).mean()))


def test_the_common_slope_is_the_median_of_the_straight_lines_nearby() -> None:
    slope = np.linspace(-0.03, 0.03, 31)
    common = _common(slope, np.full(31, 0.01))
    assert common[15] == pytest.approx(np.median(slope[5:26]))
    assert common[0] == pytest.approx(np.median(slope[:11]))
    steep = np.where(np.arange(31) % 2 == 0, 0.039, 0.041)
    assert _common(steep, np.full(31, 0.01))[2:-2] == pytest.approx(np.full(27, 0.039))
    bent = np.where(np.arange(31) % 2 == 0, 0.02, 0.03)
    assert _common(bent, np.where(np.arange(31) % 2 == 0, 0.01, 0.031))[2:-2] == pytest.approx(np.full(27, 0.02))
    assert _common(bent, np.where(np.arange(31) % 2 == 0, 0.03, 0.05))[15] == pytest.approx(0.02, abs=0.011)
    few = np.where(np.isin(np.arange(31), np.arange(0, 31, 4)), 0.02, 1.0)
    assert _common(few, np.full(31, 0.01)).tolist() == [0.0] * 31  # fewer than 0.3 of the neighbours are straight
    third = np.where(np.arange(31) % 3 == 0, 0.02, 1.0)
    assert _common(third, np.full(31, 0.01))[15] == pytest.approx(0.02)


def test_the_scatter_of_points_is_shared_by_their_sensitivity() -> None:
    # The sum of the squared deviations over the degrees of freedom is the mean square of the stated deviations.
    rng = np.random.default_rng(2)
    along = np.linspace(0.0, 400.0, 80)
    sensitivity = rng.uniform(0.2, 5.0, 80)
    points = np.column_stack([along, 0.3 * rng.standard_normal(80)])
    points[40, 1] = 3.0
    same, sigma, kept = estimate_scatter(points, sensitivity)
    assert same is points
    assert not kept[40]
    assert kept.sum() >= 76
    relative = np.clip(sensitivity / np.median(sensitivity[kept]), 0.5, 3.0)
    assert sigma / sigma[0] == pytest.approx(relative / relative[0])
    assert math.sqrt((sigma[kept] ** 2).mean()) == pytest.approx(0.3, rel=0.2)
    exact = estimate_scatter(np.column_stack([along, np.zeros(80)]), sensitivity)
    assert exact[1].tolist() == [0.003] * 80
    assert exact[2].all()


def test_the_average_along_an_edge_is_a_local_line_with_gaussian_weights() -> None:
    rng = np.random.default_rng(5)
    along, values = np.sort(rng.uniform(0.0, 50.0, 30)), rng.normal(size=30)
    averaged = _averaged(along, values, 4.0)
    for place, value in zip(along, averaged, strict=True):
        root_of_weight = np.exp(-0.25 * ((along - place) / 4.0) ** 2)
        line = np.polyfit(along - place, values, 1, w=root_of_weight)
        assert value == pytest.approx(line[1], abs=1e-6)
    far = np.array([0.0, 100.0, 200.0])
    assert _averaged(far, np.array([1.0, 2.0, 4.0]), 4.0).tolist() == [1.0, 2.0, 4.0]


def test_the_width_of_the_sides_is_the_distance_of_the_edges() -> None:
    sides = sides_of(edge=np.array([[-0.4, -0.5], [0.5, 0.7]]))
    assert sides.width == pytest.approx([0.9, 1.2])
