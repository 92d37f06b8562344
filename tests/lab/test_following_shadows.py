"""Shadows beside a followed beam are distinguished from its edges by hue, darkness and width."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_lab.vision.following import shadows
from eimi_lab.vision.following.colour_seams import Seams
from eimi_lab.vision.following.discriminant import ColourProjection, project
from eimi_lab.vision.following.shadows import _has_hue_of_surroundings, _is_rim, is_dimmed, merged, move_off_shadows
from eimi_lab.vision.following.stated_width import prefer_stated_width
from eimi_lab.vision.following.unrolled import UnrolledPicture
from tests.shared.sampled_beam import EDGES, body, unrolled

GROUND, BEAM = (150.0, 160.0, 130.0), (40.0, 60.0, 200.0)


def shaded(by: float, wide: float, tint: float = 0.0) -> UnrolledPicture:
    # Return a beam beside a region that is darker than the surroundings, with a share of the beam's hue.
    region = by * np.array(GROUND) + tint * np.array(BEAM)
    return unrolled(body(BEAM, GROUND, (0.5, 0.5 + wide, tuple(region))))


def on_border(picture: UnrolledPicture, wide: float) -> Seams:
    edges = EDGES.copy()
    edges[1] += wide
    left, right = (project(picture, edge, way, 1.0) for edge, way in zip(edges, (-1.0, 1.0), strict=True))
    return Seams(edges, np.ones((2, 60)), (left, right), np.zeros((2, 60)))


@pytest.mark.parametrize(
    ("by", "wide", "tint", "moved"),
    [
        (0.5, 0.25, 0.0, True),
        (0.5, 0.1, 0.0, True),
        (1.3, 0.25, 0.0, False),  # brighter than the surroundings
        (0.5, 0.25, 0.1, True),
        (0.3, 0.25, 0.5, False),  # of the hue of the beam
    ],
)
def test_an_edge_on_the_border_of_a_shadow_is_moved(by: float, wide: float, tint: float, moved: bool) -> None:
    picture = shaded(by, wide, tint)
    found = move_off_shadows(picture, on_border(picture, wide), 1.0)
    assert np.abs(found.edge[0] + 0.5).max() < 0.05
    assert np.median(found.edge[1]) == pytest.approx(0.5 if moved else 0.5 + wide, abs=0.05)
    if moved:
        assert np.median(found.shadow[1]) == pytest.approx(wide, abs=0.05)
        assert (found.shadow[0] == 0.0).all()


@pytest.mark.parametrize(("place", "moved"), [(0.53, False), (0.56, True)])
def test_an_edge_is_moved_by_at_least_one_and_a_half_pixels(place: float, moved: bool) -> None:
    # The edge of the body is at 0.48 widths of 24 px; a difference of less than 1.5 px is ignored.
    picture = shaded(0.5, 0.25)
    found = move_off_shadows(picture, on_border(picture, place - 0.5), 1.0)
    assert bool(np.median(found.edge[1]) < 0.5) is moved


def test_an_edge_on_the_border_of_a_side_face_is_kept() -> None:
    # A dark region that is not wider than the side face of the beam, with its uncertainty, belongs to the beam.
    for face, sigma, moved in ((0.0, 0.0, True), (0.3, 0.0, False), (0.12, 0.05, True), (0.15, 0.08, False)):
        picture = shaded(0.5, 0.25)
        picture = replace(picture, side_faces=np.array([[0.0], [face]]), side_sigma=np.array([[0.0], [sigma]]))
        found = move_off_shadows(picture, on_border(picture, 0.25), 1.0)
        assert np.median(found.edge[1]) == pytest.approx(0.5 if moved else 0.75, abs=0.05)


def test_a_short_dark_region_is_no_shadow() -> None:
    colours = shaded(0.5, 0.25).colours.astype(float)
    plain = shaded(1.0, 0.25).colours
    for dark, moved in ((9, False), (30, True)):  # a width has 12 stations
        mixed = colours.copy()
        mixed[dark:] = plain[dark:]
        picture = unrolled(mixed)
        border = on_border(picture, 0.0)
        border.edge[1, :dark] = 0.75
        found = move_off_shadows(picture, border, 1.0)
        assert bool(np.median(found.edge[1, : dark - 4]) < 0.6) is moved
    grey = unrolled(body((60.0,), (200.0,)))
    seams = on_border(grey, 0.2)
    assert move_off_shadows(grey, seams, 1.0) is seams


@pytest.mark.parametrize(("by", "is_dim"), [(0.9, True), (1.1, False)])
def test_a_region_is_dimmed_if_it_is_darker_than_the_surroundings(by: float, is_dim: bool) -> None:
    picture = shaded(by, 0.3)
    assert (is_dimmed(picture, EDGES[1], EDGES[1] + 0.3, 12) == is_dim).all()
    mirrored = unrolled(picture.colours[:, ::-1])
    assert (is_dimmed(mirrored, EDGES[0], EDGES[0] - 0.3, 12) == is_dim).all()


@pytest.mark.parametrize(("tint", "is_shadow"), [(0.65, True), (0.85, False)])
def test_a_region_with_less_than_half_of_the_hue_of_the_beam_may_be_a_shadow(tint: float, is_shadow: bool) -> None:
    picture = shaded(0.5, 0.3, tint)
    assert (_has_hue_of_surroundings(picture, EDGES[1], EDGES[1] + 0.3, 12) == is_shadow).all()


@pytest.mark.parametrize(("share", "is_rim"), [(0.1, True), (0.25, False)])
def test_a_rim_has_nearly_the_colour_of_the_beam(share: float, is_rim: bool) -> None:
    # The region is a rim if the step at the beam is less than a fifth of the step at its outer border.
    region = np.array(BEAM) + share / (1.0 + share) * (np.array(GROUND) - np.array(BEAM))
    picture = unrolled(body(BEAM, GROUND, (0.5, 0.8, tuple(region))))
    moved = np.ones(60, dtype=bool)
    moved[50:] = False
    assert _is_rim(picture, EDGES[1], EDGES[1] + 0.3, moved, 12) is is_rim


def test_merged_projections_are_chosen_at_each_place() -> None:
    one, other = (
        ColourProjection(*(np.full((4, *shape), value) for shape in ((5,), (), (3,), (), (3,)))) for value in (1.0, 2.0)
    )
    both = merged(np.array([True, False, False, True]), one, other)
    for part in (both.share, both.weight, both.step):
        assert part[:, 0].tolist() == [1.0, 2.0, 2.0, 1.0]
    assert both.separation.tolist() == both.level.tolist() == [1.0, 2.0, 2.0, 1.0]


@pytest.mark.parametrize(
    ("wide", "moved"),
    [(0.2, True), (0.13, False), (0.3, True)],  # the logarithm of the width must be at least 0.15
)
def test_a_wider_body_than_stated_is_searched_for_another_edge(wide: float, moved: bool) -> None:
    picture = unrolled(body((50.0,), (200.0,), (0.5, 0.5 + wide, (120.0,))))
    found = prefer_stated_width(picture, on_border(picture, wide), 1.0, 60)
    assert np.median(found.edge[1]) == pytest.approx(0.5 if moved else 0.5 + wide, abs=0.04)
    mirrored = unrolled(picture.colours[:, ::-1])
    seams = on_border(mirrored, 0.0)
    seams.edge[0] -= wide
    found = prefer_stated_width(mirrored, seams, 1.0, 60)
    assert np.median(found.edge[0]) == pytest.approx(-0.5 if moved else -0.5 - wide, abs=0.04)
    assert np.median(found.shadow[0]) == pytest.approx(wide if moved else 0.0, abs=0.04)


@pytest.mark.parametrize(("stated", "moved"), [(1.05, True), (0.89, True), (1.08, False), (0.86, False)])
def test_the_other_edge_must_give_the_stated_width_to_a_tenth(stated: float, moved: bool) -> None:
    picture = unrolled(body((50.0,), (200.0,), (0.5, 0.85, (120.0,))), stated)
    found = prefer_stated_width(picture, on_border(picture, 0.35), 1.0, 60)
    assert bool(np.median(found.edge[1]) < 0.6) is moved


@pytest.mark.parametrize(("dark", "is_along"), [(13, False), (20, True)])
def test_beside_a_shadow_along_a_fifth_of_the_edge_every_clear_place_is_moved(dark: int, is_along: bool) -> None:
    # The first 13 or 20 of 80 rows lie beside a shadow. Elsewhere the edge of the body differs a little from the other.
    shadowed = body(BEAM, GROUND, (0.5, 0.75, tuple(0.5 * value for value in GROUND)), stations=80)
    plain = body(BEAM, GROUND, stations=80)
    plain[:dark] = shadowed[:dark]
    picture = unrolled(plain)
    edges = np.outer([-0.5, 0.5], np.ones(80))
    edges[1, :dark] = 0.75
    left, right = (project(picture, edge, way, 1.0) for edge, way in zip(edges, (-1.0, 1.0), strict=True))
    found = move_off_shadows(picture, Seams(edges, np.ones((2, 80)), (left, right), np.zeros((2, 80))), 1.0)
    assert np.median(found.shadow[1, : dark - 2]) == pytest.approx(0.25, abs=0.05)
    assert bool((found.shadow[1, 40:] != 0.0).any()) is is_along
    assert bool((found.edge[1, 40:] != 0.5).any()) is is_along
    assert (found.shadow[0] == 0.0).all()


@pytest.mark.parametrize(("of_light", "is_moved"), [(0.13, False), (0.45, True)])
def test_a_dark_region_of_nearly_the_colour_of_a_dark_beam_stays_a_part_of_it(
    monkeypatch: pytest.MonkeyPatch, of_light: float, is_moved: bool
) -> None:
    # The region has the hue of the surroundings. It is a rim if it has nearly the darkness of the beam, else a shadow.
    dark_beam = (15.0, 16.0, 33.0)
    region = tuple(of_light * value for value in GROUND)
    picture = unrolled(body(dark_beam, GROUND, (0.5, 0.8, region)))
    inner = on_border(picture, 0.0)
    clear = tuple(replace(side, separation=np.full(60, 90.0)) for side in inner.projected)
    inner = replace(inner, projected=clear)
    monkeypatch.setattr(shadows, "find_colour_seams", lambda *_, **options: inner)
    found = move_off_shadows(picture, on_border(picture, 0.3), 1.0)
    assert np.median(found.edge[1]) == pytest.approx(0.5 if is_moved else 0.8, abs=0.05)
    assert np.median(found.shadow[1]) == pytest.approx(0.3, abs=0.05)  # the doubt remains in both cases


@pytest.mark.parametrize(
    ("of_colours", "shadowless", "is_moved"),
    [(10.0, 3.1, True), (10.0, 3.0, False), (100.0, 16.0, True), (100.0, 14.0, False)],
)
def test_an_edge_is_moved_where_the_shadowless_sum_is_clear(
    monkeypatch: pytest.MonkeyPatch, of_colours: float, shadowless: float, is_moved: bool
) -> None:
    picture = shaded(0.5, 0.25)

    def with_separation(seams: Seams, value: float) -> Seams:
        left, right = (replace(side, separation=np.full(60, value)) for side in seams.projected)
        return replace(seams, projected=(left, right))

    inner = with_separation(on_border(picture, 0.0), shadowless)
    monkeypatch.setattr(shadows, "find_colour_seams", lambda *_, **options: inner)
    border = with_separation(on_border(picture, 0.25), of_colours)
    found = move_off_shadows(picture, border, 1.0)
    assert (found is not border) is is_moved
    assert np.median(found.edge[1]) == (0.5 if is_moved else 0.75)
