"""The search for a beam in a picture agrees with its formulas, and a mirrored picture gives a mirrored beam."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eimi_lab.vision.following import beam_search, hypotheses
from eimi_lab.vision.following.beam_search import (
    Strip,
    _best_of_each_cell,
    _best_strip,
    _Generation,
    _implausible,
    _index_of_best,
    _rival,
    find_strip,
)
from eimi_lab.vision.following.edge_points import locate_edge
from eimi_lab.vision.following.follow import FollowedBeam, follow
from eimi_lab.vision.following.hypotheses import Hypotheses, read_across, read_colours
from eimi_lab.vision.following.stated import StatedBeam
from eimi_lab.vision.following.support import find_sides
from eimi_lab.vision.following.texture import average_texture
from eimi_lab.vision.following.unrolled import unroll
from eimi_lab.vision.following.working import WorkingPicture, working_picture
from eimi_lab.vision.settling_statistic import Noise, measure_noise
from tests.shared.small_pictures import SmallPicture, within

Array = np.ndarray
BEAM = StatedBeam(np.array([60.0, 10.0]), math.pi / 2.0, 14.0, 84.0)


def strips(places: Array, angle: float = 0.0, score: Array | None = None, width: float = 10.0) -> Hypotheses:
    count = len(places)
    empty = np.zeros((count, 9, 1), np.float32)
    values = np.ones(count)
    return Hypotheses(
        places, np.full(count, angle), 0.0 * values, width * values, empty, 2.0 * values, 3.0 * values,
        values if score is None else score,
    )  # fmt: skip


def test_the_colours_across_a_strip_are_read_at_fifteen_places() -> None:
    # In a picture whose colour is linear in x and y, the colours follow from the places of the points.
    y, x = np.mgrid[0:60, 0:80].astype(np.float32)
    pixels = np.stack([2.0 * x, 3.0 * y], axis=2)
    picture = WorkingPicture(pixels, np.zeros(2), 1.0, BEAM)
    angle, width = 0.6, 16.0
    [read] = read_across(picture, np.array([40.0]), np.array([30.0]), np.array([angle]), np.array([width]))
    across = width * np.array([-0.8, -0.7, -0.6, *np.linspace(-0.4, 0.4, 9), 0.6, 0.7, 0.8])
    expected = np.column_stack([2.0 * (40.0 - math.sin(angle) * across), 3.0 * (30.0 + math.cos(angle) * across)])
    assert read == pytest.approx(expected, abs=0.15)  # on a grid of 1/32 px
    many = read_colours(pixels, np.full((30_001, 2), 5.0), np.full((30_001, 2), 7.0))
    assert many.shape == (30_001, 2, 2)
    assert np.ptp(many.reshape(-1, 2), axis=0).tolist() == [0.0, 0.0]
    assert many[0, 0].tolist() == many[-1, -1].tolist() == [10.0, 21.0]


def test_the_support_of_a_strip_grows_with_the_steps_at_its_sides() -> None:
    # The support of each side is d² / (d² + 9 v) for the step d and the variance v.
    colours = np.zeros((3, 15, 2), np.float32)
    colours[0, :3], colours[0, 12:] = (4.0, 3.0), (0.0, 6.0)
    colours[1, :] = 50.0
    colours[2, 3:12] = (1.0, 0.0)
    colours[2, 4] = (100.0, 0.0)  # the places near the edges count: three inside, three outside
    variance = np.array([2.0, 2.0, 0.5])
    left, right = 25.0 / (25.0 + 18.0), 36.0 / (36.0 + 18.0)
    third = ((100.0 + 2.0) / 3.0) ** 2
    expected = [left + right, 0.0, third / (third + 4.5) + 1.0 / (1.0 + 4.5)]
    assert hypotheses.side_support(colours, variance) == pytest.approx(expected, abs=1e-5)
    brightness = hypotheses.brightness_step(colours)
    steps = [(-4.0, -3.0), (0.0, -6.0)]
    assert brightness[0] == pytest.approx(np.mean(steps))
    assert brightness[1] == pytest.approx(0.0, abs=1e-5)
    assert brightness[2] == pytest.approx(np.mean([(34.0, 0.0), (1.0, 0.0)]), abs=1e-4)


def test_the_misfit_is_the_mean_square_of_the_difference_up_to_two() -> None:
    rng = np.random.default_rng(1)
    colours, template = rng.uniform(0, 9, (4, 15, 3)), rng.uniform(0, 9, (4, 9, 3))
    variance = np.array([5.0, 1.0, 0.05, 9.0])
    square = ((colours[:, 3:12] - template) ** 2).sum(axis=2).mean(axis=1)
    found = hypotheses.misfit(colours.astype(np.float32), template.astype(np.float32), variance)
    assert found == pytest.approx(np.minimum(square / (9.0 * variance), 2.0), rel=1e-4)
    assert found[2] == 2.0


def test_remembered_colours_follow_similar_ones_and_the_variance_never_rises() -> None:
    rng = np.random.default_rng(2)
    colours = rng.uniform(40, 46, (3, 15, 3)).astype(np.float32)
    template = rng.uniform(40, 46, (3, 9, 3)).astype(np.float32)
    colours[0, 5] += 60.0  # a spot
    tolerance, variance = np.array([6.0, 6.0, 0.001]), np.array([40.0, 9.0, 40.0])
    moved, after = hypotheses.updated_templates(colours, template, tolerance, variance, 4.0)
    for row in range(3):
        present = colours[row, 3:12].astype(float)
        squares = ((present - template[row]) ** 2).sum(axis=1)
        same = squares < 9.0 * tolerance[row]
        expected = template[row] + np.where(same[:, None], 0.12 * (present - template[row]), 0.0)
        assert moved[row] == pytest.approx(expected, abs=1e-3)
        scatter = squares[same].sum() / max(same.sum(), 1)
        assumed = 4.0 + scatter + 0.15 * present.var(axis=0).sum()
        assert after[row] == pytest.approx(variance[row] - 0.12 * max(variance[row] - assumed, 0.0), rel=1e-4)
    assert after[1] == 9.0
    assert (moved[0, 2] == template[0, 2]).all()


@pytest.mark.parametrize(("noise", "span", "least"), [(0.5, 10.0, 2.0), (3.0, 10.0, 6.0), (0.5, 400.0, 10.0)])
def test_the_least_variance_is_that_of_noise_of_two_levels_or_of_the_picture(
    noise: float, span: float, least: float
) -> None:
    picture = WorkingPicture(np.zeros((8, 8, 3), np.float32), np.zeros(2), 1.0, BEAM)
    picture.__dict__.update(noise=noise, span=span)
    assert hypotheses.least_variance(picture) == pytest.approx(3.0 * least**2)


def test_the_cost_of_bends_and_widths() -> None:
    cost = _implausible(
        np.array([0.0, 0.35, 0.0, 0.0]), np.array([1.0, 1.0, 1.1, 1.0]), np.array([0, 0, 0, 0.05]), 20.0
    )
    assert cost == pytest.approx([0.0, 0.6 * 0.35**2, 4.0 * math.log(1.1) ** 2, 0.03 * (1.0 / 0.6) ** 2])


def test_only_the_best_strip_of_each_cell_is_kept() -> None:
    # Strips 0.2 widths apart, or turned by 6 degrees, are different; a strip 4 behind the best one is dropped.
    x = np.array([0.1, 0.3, 2.3, 0.1, 0.1, 50.0, 60.0])
    angle = np.radians([1.0, 1.0, 1.0, 7.5, 2.0, 1.0, 1.0])
    score = np.array([5.0, 4.0, 4.5, 3.0, 4.9, 1.1, 0.9])
    kept = _best_of_each_cell(x, np.zeros(7), angle, score, 10.0)
    assert kept.tolist() == [0, 2, 3, 5]
    across = _best_of_each_cell(np.zeros(3), np.array([0.1, 1.9, 2.1]), np.zeros(3), np.array([1.0, 2.0, 1.5]), 10.0)
    assert across.tolist() == [1, 2]
    many = _best_of_each_cell(10.0 * np.arange(400), np.zeros(400), np.zeros(400), np.linspace(0.0, 1.0, 400), 10.0)
    assert many.tolist() == list(range(399, 99, -1))


def trail_of(*lines: tuple[Array, Array], gain: float = 0.5) -> list[_Generation]:
    # Return the possible strips after each step of a search.
    # lines: for each strip, its position (x, y) and score after each step, (steps, 2) and (steps,). gain: increase of
    # the score by the first step.
    steps = len(lines[0][0])
    trail = []
    for step in range(steps):
        places, scores = (np.array([line[part][step] for line in lines]) for part in (0, 1))
        trail.append(_Generation(strips(places, 0.1, scores), np.arange(len(lines)), gain + 0.01 * step + 0.0 * scores))
    return trail


def line_at(y: float) -> Array:
    return np.column_stack([5.0 * np.arange(6), np.full(6, y)])


def test_the_best_strip_ends_where_its_score_is_largest() -> None:
    rising = np.array([0.2, 0.9, 1.5, 2.0, 1.8, 1.7])
    found = _best_strip(trail_of((line_at(0.0), rising), (line_at(20.0), 0.5 * rising)), 5.0, 10.0, lambda: None, 0)
    assert found is not None
    assert found.place.tolist() == line_at(0.0)[:4].tolist()
    assert found.gain == pytest.approx([0.5, 0.51, 0.52, 0.53])
    assert (found.step_px, found.variance, found.length_px) == (5.0, 3.0, 15.0)
    assert found.width.tolist() == [10.0] * 4
    assert found.angle.tolist() == [0.1] * 4
    later = _best_strip(trail_of((line_at(0.0), rising)), 5.0, 10.0, lambda: None, 5)
    assert later is not None
    assert len(later.place) == 6
    assert _best_strip(trail_of((line_at(0.0), -rising)), 5.0, 10.0, lambda: None, 0) is None
    assert _best_strip(trail_of((line_at(0.0), rising[::-1])), 5.0, 10.0, lambda: None, 0) is not None
    falling = np.array([3.0, 2.0, 1.0, 0.5, 0.2, 0.1])
    assert _best_strip(trail_of((line_at(0.0), falling)), 5.0, 10.0, lambda: None, 0) is None


@pytest.mark.parametrize(
    ("second", "aside", "earlier", "chosen"),
    [
        (1.90, 20.0, 20.0, 1),  # an equally likely body, near the earlier line
        (1.90, 20.0, 0.0, 0),
        (1.90, 20.0, None, 0),
        (1.84, 20.0, 20.0, 0),  # less than 0.93 of the best score
        (1.90, 5.9, 20.0, 0),  # the same body
        (1.90, 6.1, 20.0, 1),
    ],
)
def test_an_earlier_line_decides_between_equally_likely_bodies(
    second: float, aside: float, earlier: float | None, chosen: int
) -> None:
    ramp = np.linspace(0.1, 1.0, 6)
    trail = trail_of((line_at(0.0), 2.0 * ramp), (line_at(aside), second * ramp))
    asked = []

    def line() -> Array | None:
        asked.append(True)
        return None if earlier is None else line_at(earlier)

    assert _index_of_best(trail, line, 10.0) == chosen
    assert len(asked) == (aside > 6.0 and second > 1.86)


def test_the_rival_is_the_best_strip_half_way_that_lies_beside_the_chosen_one() -> None:
    trail = trail_of((line_at(0.0), np.full(6, 2.0)), (line_at(5.9), np.full(6, 1.9)), (line_at(6.2), np.full(6, 0.9)))
    gain = np.full(6, 0.5)
    assert _rival(trail, line_at(0.0), np.zeros(6), gain, 10.0) == pytest.approx(0.9 / (4 * 0.5))
    assert _rival(trail[:5], line_at(0.0)[:5], np.zeros(5), gain[:5], 10.0) == pytest.approx(0.9 / (3 * 0.5))
    assert _rival(trail[:2], line_at(0.0)[:2], np.zeros(2), gain[:2], 20.0) == 0.0
    turned = np.full(6, math.pi / 2.0)  # the chosen strip runs along y: the others lie ahead of it
    assert _rival(trail, line_at(0.0), turned, gain, 10.0) == 0.0


def found_in(pixels: Array, beam: StatedBeam = BEAM, **changed: Any) -> Strip:
    picture = working_picture(pixels.astype(np.float32), replace(beam, **changed), 16.0)
    assert picture is not None
    strip = find_strip(picture, None, lambda: None)
    assert strip is not None
    return strip


def test_the_mirrored_picture_gives_the_mirrored_strip() -> None:
    pixels = SmallPicture(0.4).beam().exposed()[:, :121]
    strip, other = found_in(pixels), found_in(np.ascontiguousarray(pixels[:, ::-1]))
    middle = (60.0 + 0.5) * 16.0 / 14.0 - 0.5
    assert len(strip.place) == len(other.place)
    assert strip.place[:, 0] - middle == pytest.approx(middle - other.place[:, 0], abs=2.0)
    assert np.mean(strip.place[:, 0] + other.place[:, 0]) == pytest.approx(2.0 * middle, abs=0.7)
    assert strip.place[:, 1] == pytest.approx(other.place[:, 1], abs=2.5)
    assert strip.width.mean() == pytest.approx(other.width.mean(), rel=0.05)
    assert strip.gain.mean() == pytest.approx(other.gain.mean(), abs=0.05)


def test_the_turned_picture_gives_the_turned_strip() -> None:
    pixels = SmallPicture(0.3).beam().exposed()
    strip = found_in(pixels)
    turned = found_in(np.ascontiguousarray(np.swapaxes(pixels, 0, 1)), clamp_px=np.array([10.0, 60.0]), axis_rad=0.0)
    assert turned.place[:, ::-1] == pytest.approx(strip.place, abs=1.5)
    assert np.mean(turned.angle + strip.angle) == pytest.approx(math.pi / 2.0, abs=0.08)


def test_the_strip_begins_half_a_width_from_the_clamp_and_has_steps_of_a_third() -> None:
    strip = found_in(SmallPicture().beam().exposed())
    begin = (10.0 + 0.5) * 16.0 / 14.0 - 0.5
    assert strip.place[0] == pytest.approx([(60.5 * 16.0 / 14.0) - 0.5, begin + 8.0], abs=0.8)
    assert strip.step_px == pytest.approx(16.0 / 3.0)
    assert np.hypot(*np.diff(strip.place, axis=0).T) == pytest.approx(
        np.full(len(strip.place) - 1, 16.0 / 3.0), abs=0.3
    )
    long = found_in(SmallPicture().beam().exposed(), length_px=14.0 * 40.0)
    assert long.step_px == pytest.approx(16.0 * 40.0 / 90.0)


def test_no_strip_is_found_without_a_beam_and_the_wrong_polarity_is_refused() -> None:
    flat = np.full((112, 128, 3), 130.0, np.float32)
    picture = working_picture(flat + np.random.default_rng(0).normal(0, 2, flat.shape).astype(np.float32), BEAM, 16.0)
    assert picture is not None
    assert find_strip(picture, None, lambda: None) is None
    dark = working_picture(SmallPicture(ground=(200.0,)).beam(colour=(60.0,)).exposed().astype(np.float32), BEAM, 16.0)
    assert dark is not None
    assert find_strip(dark, "dark", lambda: None) is not None
    wrong = find_strip(dark, "bright", lambda: None)
    assert wrong is None or abs(float(np.median(wrong.place[:, 0])) - 60.5 * 16.0 / 14.0 + 0.5) > 5.0


def test_results_in_a_part_of_a_picture_are_moved_to_the_whole_picture() -> None:
    found = follow(SmallPicture().beam().exposed().astype(np.float32), BEAM)
    moved = found.moved(np.array([7.0, 11.0]))
    assert moved.path_px == pytest.approx(found.path_px + np.array([7.0, 11.0]))
    for one, other in zip(moved.sure_px, found.sure_px, strict=True):
        assert one == pytest.approx(other + np.array([7.0, 11.0]))
    assert moved.findings == found.findings
    nothing = FollowedBeam({"followed_length": 0.0}).moved(np.array([7.0, 11.0]))
    assert nothing.path_px.shape == (0, 2)
    assert nothing.sure_px == ()


@pytest.mark.parametrize(("width_px", "is_followed"), [(5.9, False), (6.0, True)])
def test_a_beam_of_six_pixels_is_followed(width_px: float, is_followed: bool) -> None:
    picture = SmallPicture().beam(0.5 * width_px)
    found = follow(picture.exposed().astype(np.float32), replace(BEAM, width_px=width_px))
    assert (found.strip is not None) is is_followed
    assert found.findings.get("followed_px") == (None if is_followed else width_px)
    assert found.words == {"narrow_px": "" if is_followed else "5.9", "clicks_off": ""}


def long_beam(length_px: int = 480) -> Any:
    # Return an image of a beam 16 px wide, the image after it is straightened along the beam, and its two sides.
    image = np.full((length_px + 40, 72, 1), 200.0, np.float32)
    y, x = np.mgrid[0 : length_px + 40, 0:72].astype(float)
    image[..., 0] -= 140.0 * within(x, 28.0, 44.0) * within(y, 20.0, 20.0 + length_px)
    image += np.random.default_rng(5).normal(0.0, 1.5, image.shape).astype(np.float32)
    beam = StatedBeam(np.array([36.0, 20.0]), math.pi / 2.0, 16.0, float(length_px))
    picture = working_picture(image, beam, 16.0)
    assert picture is not None
    strip = find_strip(picture, None, lambda: None)
    assert strip is not None
    sampled = unroll(picture, picture, strip)
    assert sampled is not None
    return image, sampled, find_sides(sampled, picture.noise, length_px / 16.0)


def test_an_edge_has_at_most_a_hundred_points_and_at_least_eight() -> None:
    image, sampled, sides = long_beam()
    dense = locate_edge(image, sampled, sides, 0, 0.0)
    assert dense is not None
    assert 95 <= len(dense.points) <= 100
    assert np.abs(dense.points[:, 0] - 44.0).max() < 0.3
    wide = locate_edge(image, sampled, sides, 1, 16.0)
    assert wide is not None
    assert len(wide.points) == pytest.approx(480.0 / 16.0, abs=2)
    assert np.median(np.diff(wide.points[:, 1])) == pytest.approx(16.0, rel=0.03)
    few = replace(sides, sound=sides.sound & (np.arange(sides.sound.shape[1]) < 7 + int(sides.sound[0].argmax())))
    assert few.sound[0].sum() == 7
    assert locate_edge(image, sampled, few, 0, 0.0) is None


def test_an_edge_whose_scatter_the_average_would_remove_is_returned_as_it_is() -> None:
    # Points that alternate by 1 px on both sides of a line would be averaged to less than half of their scatter.
    image, sampled, sides = long_beam()
    edge = locate_edge(image, sampled, sides, 0, 0.0)
    assert edge is not None
    along = np.linspace(0.0, 480.0, 100)
    zigzag = replace(edge, points=np.column_stack([(-1.0) ** np.arange(100), along]), sigma=np.ones(100), along=along)
    assert average_texture(zigzag, 200.0) is zigzag
    rough = np.random.default_rng(2).normal(0.0, 0.75, 100)
    somewhat = replace(zigzag, points=np.column_stack([rough, along]))
    assert average_texture(somewhat, 16.0) is not somewhat


@pytest.mark.parametrize(("variance", "exceeds"), [(0.082, False), (0.085, True)])
def test_noise_above_a_twelfth_of_a_grey_level_squared_exceeds_rounding(variance: float, exceeds: bool) -> None:
    assert Noise(np.array([0.0, 255.0]), np.array([0.0, variance])).exceeds_rounding is exceeds


def test_the_noise_of_equal_frames_is_that_of_rounding_and_of_noisy_frames_their_variance() -> None:
    image = np.tile(np.arange(0, 240, 2, dtype=np.uint8), (40, 1))
    assert measure_noise([image, image]).variances == pytest.approx(np.full(24, 1.0 / 12.0))
    rng = np.random.default_rng(3)
    frames = [100.0 + rng.normal(0.0, 2.0, (80, 80)) for _ in range(5)]
    assert np.average(measure_noise(frames).variances) == pytest.approx(4.0, rel=0.15)


@pytest.mark.parametrize(
    "dtypes", [(np.uint8, np.uint8), (np.uint8, np.float64), (np.float64, np.uint8), (np.uint16, np.uint16)]
)
def test_the_settling_ratio_is_the_mean_square_over_the_expected_one(dtypes: tuple[type, type]) -> None:
    noise = Noise(np.array([0.0, 200.0]), np.array([1.0, 5.0]))
    rng = np.random.default_rng(4)
    before = rng.integers(20, 200, (12, 15))
    after = before + rng.integers(-3, 4, before.shape)
    pixels = np.arange(0, 180, 3)
    a, b = before.ravel()[pixels], after.ravel()[pixels]
    variance = np.interp(0.5 * (a + b), [0.0, 200.0], [1.0, 5.0])
    expected = np.mean((b - a) ** 2) / np.mean(2.0 * variance)
    assert noise.difference_ratio(before.astype(dtypes[0]), after.astype(dtypes[1]), pixels) == pytest.approx(expected)


def test_the_constants_of_the_ways_are_symmetric() -> None:
    ways = list(zip(beam_search._MORE_BEND, beam_search._MORE_WIDTH, beam_search._MORE_ASIDE, strict=True))
    plain = [(bend, aside) for bend, width, aside in ways if width == 1.0]
    for bend, aside in plain:
        assert sum((-bend, -aside) == pytest.approx(way) for way in plain) == 1
    assert sorted(width for _, width, _ in ways if width != 1.0) == [0.96, 1.04]
    assert np.sort(np.unique(np.abs(beam_search._MORE_BEND))) == pytest.approx(0.35 * np.array([0.0, 0.12, 0.4, 1.0]))
