"""The measured values of a followed beam agree with calculations by hand, also where nothing was found."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_lab.vision.following import follow as follow_module
from eimi_lab.vision.following.follow import FollowedBeam, _change, _findings, _is_at_border, _narrowing, follow
from eimi_lab.vision.following.stated import StatedBeam
from eimi_lab.vision.following.working import WorkingPicture
from tests.shared.small_pictures import SmallPicture

Array = np.ndarray
BEAM = StatedBeam(np.array([60.0, 10.0]), math.pi / 2.0, 14.0, 84.0)
NOTHING = {"followed_length": 0.0}


def picture() -> Array:
    return SmallPicture().beam().exposed().astype(np.float32)


def test_a_beam_narrower_than_6_px_is_not_followed() -> None:
    thin = StatedBeam(BEAM.clamp_px, BEAM.axis_rad, 5.99, 84.0)
    found = follow(picture(), thin)
    assert found.findings == {"followed_px": 5.99}
    assert found.words == {"narrow_px": "5.9", "clicks_off": ""}
    assert found.working is None
    just = StatedBeam(BEAM.clamp_px, BEAM.axis_rad, 6.0, 84.0)
    assert "followed_px" not in follow(picture(), just).findings


def test_the_length_is_zero_if_nothing_can_be_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    outside = follow(picture(), StatedBeam(np.array([900.0, 10.0]), 0.0, 14.0, 84.0))
    assert outside.findings == NOTHING
    assert (outside.working, outside.strip) == (None, None)
    blank = follow(np.full((112, 128, 3), 90.0, np.float32), BEAM)
    assert blank.findings == NOTHING
    assert blank.working is not None
    assert blank.strip is None
    with monkeypatch.context() as patch:
        patch.setattr(follow_module, "unroll", lambda *_: None)
        short = follow(picture(), BEAM)
        assert short.findings == NOTHING
        assert short.working is not None
        assert short.strip is not None
        assert short.unrolled is None
    with monkeypatch.context() as patch:
        asked = iter([follow_module.working_picture(picture(), BEAM, 16.0), None])
        patch.setattr(follow_module, "working_picture", lambda *_: next(asked))
        assert follow(picture(), BEAM).findings == NOTHING


@pytest.mark.parametrize("missing", [0, 1])
def test_an_edge_without_points_leaves_the_findings_of_the_search(
    monkeypatch: pytest.MonkeyPatch, missing: int
) -> None:
    before = follow_module.locate_edge
    monkeypatch.setattr(
        follow_module,
        "locate_edge",
        lambda image, unrolled, sides, side, spacing: (
            None if side == missing else before(image, unrolled, sides, side, spacing)
        ),
    )
    found = follow(picture(), BEAM)
    assert found.findings["followed_sides"] == 0.0
    assert found.findings["followed_tip"] == 1.0
    assert "followed_shadow" not in found.findings
    assert found.sides is not None
    assert found.edges is None


def test_the_picture_is_never_enlarged_for_the_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    widths: list[float] = []
    before = follow_module.working_picture

    def noted(image: Array, beam: StatedBeam, width_px: float) -> WorkingPicture | None:
        widths.append(width_px)
        return before(image, beam, width_px)

    monkeypatch.setattr(follow_module, "working_picture", noted)
    follow(picture(), BEAM)
    wide = SmallPicture().beam(16.0).exposed().astype(np.float32)
    follow(wide, StatedBeam(BEAM.clamp_px, BEAM.axis_rad, 32.0, 84.0))
    assert widths == [16.0, 14.0, 16.0, 24.0]


def test_a_followed_beam_is_moved_with_its_picture() -> None:
    found = follow(picture(), BEAM)
    by = np.array([100.0, 7.0])
    moved = found.moved(by)
    assert moved.path_px == pytest.approx(found.path_px + by)
    for one, other in zip(moved.sure_px, found.sure_px, strict=True):
        assert one == pytest.approx(other + by)
    assert moved.edges is found.edges
    empty = FollowedBeam(NOTHING).moved(np.ones(2))
    assert empty.working is None
    assert empty.unrolled is None
    assert empty.path_px.shape == (0, 2)
    assert empty.sure_px == ()
    assert FollowedBeam(NOTHING, found.working).path_px.shape == (0, 2)
    assert FollowedBeam(NOTHING, found.working, found.strip, found.unrolled).sure_px == ()
    assert FollowedBeam(NOTHING, sides=found.sides).sure_px == ()


ROWS = 50


def parts(
    sound: Any = None, gain: Any = 0.6, separation: Any = 7.0, edge: Any = None, end: int = 40, **changed: Any
) -> tuple[Any, Any, Any]:
    # Return a strip, a straightened picture and both sides of a beam 20 px wide and 100 px long, as stand-ins.
    both = np.ones((2, ROWS), dtype=bool) if sound is None else sound
    both[:, end:] = False
    edges = np.array([[-0.45], [0.55]]) * np.ones(ROWS) if edge is None else edge
    strip = SimpleNamespace(gain=np.ones(11) * gain, rival=0.3)
    unrolled = SimpleNamespace(
        stated=np.full(ROWS, 0.8),
        along=np.linspace(0.0, 4.9, ROWS),
        middle=np.column_stack([np.full(ROWS, 50.0), 2.0 * np.arange(ROWS) + 10.0]),
    )
    unrolled.__dict__.update(changed)
    separations = separation if isinstance(separation, tuple) else (separation, separation + 1.0)
    sides = SimpleNamespace(
        sound=both,
        end=end,
        width=edges[1] - edges[0],
        projected=tuple(SimpleNamespace(separation=np.ones(ROWS) * value) for value in separations),
    )
    return strip, unrolled, sides


STATED = StatedBeam(np.array([50.0, 10.0]), math.pi / 2.0, 20.0, 100.0)
SIZE = (100, 200)


def findings_of(**given: Any) -> dict[str, float]:
    return _findings(STATED, *parts(**given), SIZE)


def test_the_values_of_a_clear_beam() -> None:
    sound = np.ones((2, ROWS), dtype=bool)
    sound[0, :10] = sound[1, :6] = False
    assert findings_of(sound=sound) == pytest.approx(
        {
            "followed_stretch": 3.9 * 20.0 / 100.0,
            "followed_beyond": 0.78,
            "followed_patches": 1.0,
            "followed_contrast": 7.0,
            "followed_gain": 0.6,  # shorter than 0.8 of the length
            "followed_late": 1.0 - 0.39,
            "followed_width": math.log(1.0 / 0.8),
            "followed_narrowing": 0.0,
            "followed_change": 0.0,
            "followed_rival": 0.3,
            "followed_tip": 1.0,
            "followed_out": 0.0,
        }
    )


@pytest.mark.parametrize(
    ("given", "is_clear"),
    [
        ({}, True),
        ({"gain": 0.51}, True),
        ({"gain": 0.49}, False),
        ({"gain": 0.5}, False),
        ({"separation": 6.1}, True),
        ({"separation": 5.9}, False),
        ({"separation": 6.0}, False),
        ({"separation": (9.0, 5.0)}, False),
        ({"gain": np.array([0.9] * 6 + [0.1] * 5)}, True),  # the median counts
        ({"gain": np.array([0.4] * 6 + [3.0] * 5)}, False),
        ({"separation": np.array([9.0] * 21 + [0.0] * 29)}, True),  # the median before the end counts
    ],
)
def test_a_beam_is_clear_by_its_gain_and_contrast(given: dict[str, Any], is_clear: bool) -> None:
    found = findings_of(**given)
    assert ("followed_stretch" in found, "followed_length" in found) == (is_clear, not is_clear)
    assert ("followed_late" in found, "followed_begin" in found) == (is_clear, not is_clear)


@pytest.mark.parametrize(("gaps", "is_unbroken"), [(3, True), (4, False), (5, False)])
def test_a_beam_is_unbroken_if_either_edge_is_sure_on_nine_tenths(gaps: int, is_unbroken: bool) -> None:
    for row in (0, 1):
        sound = np.ones((2, ROWS), dtype=bool)
        sound[row, 10 : 10 + gaps] = False
        assert ("followed_stretch" in findings_of(sound=sound)) is is_unbroken


def test_a_long_unbroken_beam_may_be_faint() -> None:
    along = np.linspace(0.0, 4.9, ROWS)
    for end, key in ((41, "followed_gain"), (42, "followed_faint")):  # 0.8 and 0.82 of the length
        found = findings_of(end=end, along=along)
        assert {"followed_faint", "followed_gain"} & found.keys() == {key}
    broken = np.ones((2, ROWS), dtype=bool)
    broken[1, 10:20] = False
    assert "followed_gain" in findings_of(sound=broken, end=45)


def test_the_begin_is_counted_from_a_tenth_of_the_path() -> None:
    sound = np.ones((2, ROWS), dtype=bool)
    sound[:, :3] = False
    assert findings_of(sound=sound)["followed_late"] == 0.0
    sound[:, :4] = False
    assert findings_of(sound=sound)["followed_late"] == pytest.approx(0.4 - 0.39)


def test_nothing_is_measured_without_a_place_where_both_edges_are_sure() -> None:
    sound = np.ones((2, ROWS), dtype=bool)
    sound[0, 20:], sound[1, :20] = False, False
    assert findings_of(sound=sound) == NOTHING


def test_width_and_change_are_those_of_the_fifths() -> None:
    edge = np.array([[-0.4], [0.4]]) * np.repeat([1.0, 1.1, 1.2, 0.9, 1.05], 8)[None, :]
    edge = np.hstack([edge, np.full((2, 10), 9.0)])
    found = findings_of(edge=edge)
    assert found["followed_change"] == pytest.approx(1.2 / 0.9 - 1.0)
    assert found["followed_narrowing"] == pytest.approx(1.0 - 0.9 / 1.2)
    assert found["followed_width"] == pytest.approx(math.log(1.05))
    narrow = findings_of(edge=0.5 * edge)
    assert narrow["followed_width"] == pytest.approx(-math.log(0.5 * 1.05))


def test_the_change_of_the_width_is_limited_for_a_body_without_width() -> None:
    assert _change(np.repeat([1e-6, 2.0], 10)) == pytest.approx(2.0 / 1e-3 - 1.0)
    assert _change(np.array([2.0, 1.0])) == 1.0  # fewer places than fifths
    assert _narrowing(np.array([2.0, 1.0])) == 0.5
    assert _narrowing(np.array([1.0, 2.0])) == 0.0
    assert _narrowing(np.repeat([2.0, 1.5, 3.0, 2.7, 2.8], 4)) == pytest.approx(0.25)
    spikes = np.tile([1.0, 1.0, 9.0], 10)  # the median of each fifth counts
    assert (_change(spikes), _narrowing(spikes)) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("place", "is_near"),
    [
        ((50.0, 60.0), False),
        ((14.9, 60.0), True),
        ((15.0, 60.0), False),
        ((50.0, 14.9), True),
        ((84.0, 60.0), False),
        ((84.1, 60.0), True),
        ((50.0, 184.0), False),
        ((50.0, 184.1), True),
        ((50.0, 90.0), False),
    ],
)
def test_the_tip_is_at_the_border_within_three_quarters_of_the_width(place: tuple[float, float], is_near: bool) -> None:
    assert _is_at_border(np.array(place), 20.0, SIZE) is is_near
    middle = np.full((ROWS, 2), 50.0)
    middle[39] = place
    assert findings_of(middle=middle)["followed_out"] == float(is_near)
