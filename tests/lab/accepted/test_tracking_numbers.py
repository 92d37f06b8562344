"""The points of tracked beams, and the results of quality checks and of the conversion to grey, are as accepted."""

# If a change is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import eimi_lab.vision.tracking
from eimi_lab.config.calibration import Picture
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Check
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.flags import CHECKS
from eimi_lab.vision.projection import Projection, choose_projection
from eimi_lab.vision.tracking.beam_curve import curve_through
from eimi_lab.vision.tracking.beam_tracker import BeamTracker
from eimi_lab.vision.tracking.steady_view import SteadyView
from eimi_lab.vision.tracking.step_places import band_shifts, step_places
from tests.shared.accepted_numbers import check, described
from tests.shared.small_pictures import CALIBRATION, SmallPicture, within
from tests.shared.traced_results import TracedResults

ACCEPTED = Path(__file__).parent
TRACKING = Path(eimi_lab.vision.tracking.__file__).parent
FRAME = BeamFrame(CALIBRATION)
BENDS = (0.0, 0.05, 0.15, 0.3, 0.35, 0.3)


def drawn_edges(bend: float, wider_mm: float = 0.0) -> EdgeSet:
    # Return the edges of a bent beam.
    along = np.linspace(1.0, 11.0, 24)
    slope = 2.0 * bend * along / 12.0
    normal = np.column_stack([-slope, np.ones(24)]) / np.sqrt(1.0 + slope**2)[:, None]
    middle = np.column_stack([along, bend * along**2 / 12.0])
    sides = [EdgePoints(middle + side * (1.0 + wider_mm) * normal, np.full(24, 0.01)) for side in (-1.0, 1.0)]
    return EdgeSet(*sides, (), np.full((4, 2), np.nan))


def recording(bright: bool = False, colour: bool = False, hidden: int = -1) -> list[Any]:
    # Return frames of a beam that bends more and more; in the frame `hidden`, a plate covers the beam.
    frames = []
    for number, bend in enumerate(BENDS):
        picture = SmallPicture(bend, (60.0, 70.0, 50.0) if bright else (190.0, 200.0, 180.0), 0.2)
        picture.beam(colour=(200.0, 180.0, 220.0) if bright else (50.0, 40.0, 60.0))
        if number == hidden:
            picture.add(within(picture.y, 15.0, 200.0), (120.0, 120.0, 120.0))
        image = picture.exposed(seed=number)
        frames.append(image if colour else image[..., 1].copy())
    return frames


CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "dark": ({}, {}),
    "bright": ({"bright": True}, {}),
    "in colour": ({"colour": True}, {}),
    "in a weighted sum": ({"colour": True}, {"projection": Projection("drawn", (0.2, 0.5, 0.3))}),
    "hidden": ({"hidden": 3}, {}),
}


def tracked(name: str) -> Iterator[str]:
    # Yield the numbers that describe the tracked beam in each frame of a recording, as text.
    given, options = CASES[name]
    frames = recording(**given)
    tracker = BeamTracker(frames[0], drawn_edges(0.0, 0.05), FRAME, 12.0, **options)
    yield from described(tracker.along_mm, f"{name} along")
    yield from described(tracker.outline_px, f"{name} outline")
    for number, image in enumerate(frames):
        seen = tracker.follow(image)
        yield from described(seen, f"{name} {number}")
        yield from described(seen.is_seen, f"{name} {number} is seen")


@pytest.mark.parametrize("name", CASES)
def test_the_tracked_beam_has_the_accepted_numbers(name: str, tmp_path: Path) -> None:
    with TracedResults(TRACKING) as traced:
        lines = list(tracked(name))
    check([*lines, *traced.lines()], ACCEPTED / "tracked" / f"{name.replace(' ', '_')}.txt", tmp_path)


@pytest.mark.parametrize(("given", "from_frame"), [({}, 0), ({"bright": True}, 0), ({"hidden": 2}, 3)])
def test_the_tracked_beam_lies_on_the_drawn_one(given: dict[str, Any], from_frame: int) -> None:
    tracker = BeamTracker(recording(**given)[0], drawn_edges(0.0), FRAME, 12.0)
    for number, image in enumerate(recording(**given)):
        seen = tracker.follow(image)
        assert seen.is_seen == (number != given.get("hidden"))
        if seen.is_seen and number >= from_frame:
            for points, half in ((seen.middle_px, 0.0), (seen.left_px, -7.0), (seen.right_px, 7.0)):
                x, y = points[np.isfinite(points[:, 0])].T
                along = y - 10.0
                aside = (x - 60.0 - BENDS[number] * along**2 / 84.0) / np.sqrt(
                    1.0 + (2.0 * BENDS[number] * along / 84.0) ** 2
                )
                inner = (along > 8.0) & (along < 78.0)
                assert np.median(np.abs(aside - half)[inner]) < 0.25
                assert np.abs(aside - half)[inner].max() < 1.2


def test_a_curve_follows_points_and_keeps_its_length() -> None:
    # The points lie on an arc; the curve continues straight beyond the last point.
    angle = np.linspace(0.0, 1.2, 30)
    points = 80.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    curve = curve_through(points, 110.0)
    places, normals = curve.at(np.array([0.0, 40.0, 80.0, 96.0]))
    assert np.abs(np.hypot(places[:, 0], places[:, 1] - 80.0) - 80.0).max() < 0.3
    assert (places * normals).sum(axis=1)[:3] == pytest.approx(
        [0.0, *(80.0 * np.cos(along / 80.0) - 80.0 for along in (40.0, 80.0))], abs=0.3
    )
    dense = curve.at(np.linspace(0.0, 110.0, 400))[0]
    assert np.hypot(*np.diff(dense, axis=0).T).sum() == pytest.approx(110.0, rel=1e-3)
    straight = curve_through(np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]]), 30.0)
    moved = straight.moved(np.linspace(2.0, 28.0, 20), np.full(20, 0.6), np.ones(20))
    assert moved.at(np.array([15.0]))[0][0] == pytest.approx([15.0, 0.6], abs=0.05)
    further = moved.extrapolated(straight, 2.0)
    assert further.coefficients == pytest.approx(3.0 * moved.coefficients - 2.0 * straight.coefficients)
    assert further.root_px == pytest.approx(moved.root_px)
    unused = straight.moved(np.array([5.0, 15.0]), np.array([3.0, 3.0]), np.zeros(2))
    assert unused.at(np.array([15.0]))[0][0] == pytest.approx([15.0, 0.0], abs=1e-6)


def test_a_curve_returns_to_its_usual_shape_where_it_has_no_points() -> None:
    usual = curve_through(np.column_stack([np.linspace(0.0, 30.0, 20), np.zeros(20)]), 30.0)
    bent = curve_through(np.column_stack([np.linspace(0.0, 30.0, 20), 0.01 * np.linspace(0.0, 30.0, 20) ** 2]), 30.0)
    back = bent.moved(np.array([10.0]), np.zeros(1), np.zeros(1), usual)
    assert back.coefficients[1:] == pytest.approx(usual.coefficients[1:], abs=1e-6)
    assert back.coefficients[0] == pytest.approx(bent.coefficients[0], abs=1e-6)  # the mean direction is kept
    kept = bent.moved(np.array([10.0]), np.zeros(1), np.zeros(1))
    assert kept.at(np.array([30.0]))[0] == pytest.approx(bent.at(np.array([30.0]))[0], abs=1e-6)


def test_the_place_and_height_of_a_step() -> None:
    u = np.linspace(-6.0, 6.0, 49)
    steps = np.array([np.clip(0.5 + (u - place) / wide, 0.0, 1.0) for place, wide in ((0.8, 1.0), (-1.3, 4.0))])
    found = step_places(u, np.vstack([30.0 + 90.0 * steps, 120.0 - 90.0 * steps]))
    assert found.offset_px == pytest.approx([0.8, -1.3, 0.8, -1.3], abs=0.01)
    assert found.height == pytest.approx([90.0, 90.0, -90.0, -90.0])


def band_by_loop(profile: Any, u: Any, half: float, reach: float, polarity: float) -> tuple[float, float]:
    # Return the shift with the largest contrast of a stripe, and this contrast, by a loop over all shifts.
    best = (0.0, -np.inf)
    beside = max(4.0, 0.35 * half)

    def mean(low: float, high: float) -> float:
        begin = int(np.clip(np.rint(low - u[0] + 0.5), 0, len(u) - 1))
        end = int(np.clip(max(int(np.rint(high - u[0] + 0.5)), begin + 1), 1, len(u)))
        return polarity * float(np.mean(profile[begin:end]))

    for shift in np.arange(-np.ceil(reach), np.ceil(reach) + 1.0):
        left = mean(shift - half - beside, shift - half - 1.0)
        right = mean(shift + half + 1.0, shift + half + beside)
        contrast = min(left, right) - mean(shift - 0.8 * half, shift + 0.8 * half)
        if abs(shift) <= reach and contrast > best[1]:
            best = (float(shift), contrast)
    return best


def test_the_shift_of_a_band_is_the_one_with_the_largest_contrast() -> None:
    rng = np.random.default_rng(3)
    u = np.arange(-30.0, 31.0)
    half, reach = np.array([5.0, 6.5, 14.0, 5.0]), np.array([8.0, 3.3, 6.0, 8.0])
    profiles = rng.uniform(90.0, 110.0, (4, 61))
    for row, middle in enumerate((4.0, -2.0, 5.0, -7.0)):
        profiles[row, np.abs(u - middle) < half[row]] -= 40.0
    for polarity in (1.0, -1.0):
        shift, contrast = band_shifts(profiles, u, half, reach, polarity)
        for row in range(4):
            expected = band_by_loop(profiles[row], u, half[row], reach[row], polarity)
            assert (shift[row], contrast[row]) == pytest.approx(expected)


def textured(x: float = 0.0, y: float = 0.0, wide: int = 240) -> Any:
    # Return a picture of many soft spots, shifted by x and y px, computed without interpolation.
    rng = np.random.default_rng(8)
    image = np.full((180, wide), 90.0)
    for px, py, bright in zip(rng.uniform(0, wide, 90), rng.uniform(0, 180, 90), rng.uniform(-60, 90, 90), strict=True):
        top, left = max(int(py) - 16, 0), max(int(px) - 16, 0)
        part = image[top : top + 36, left : left + 36]
        rows, columns = np.mgrid[0 : part.shape[0], 0 : part.shape[1]]
        part += bright * np.exp(-0.5 * ((columns + left - px - x) ** 2 + (rows + top - py - y) ** 2) / 3.0**2)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("wide", [240, 1404])
def test_the_motion_of_the_camera_is_removed(wide: int) -> None:
    # A picture is shifted by 3 px and 2 px; a wide picture is halved before.
    reference = textured(wide=wide)
    outline = np.array([[100.0, 60.0], [140.0, 60.0], [140.0, 120.0], [100.0, 120.0]])
    view = SteadyView(reference, outline)
    assert view.is_possible
    assert view.steadied(textured(0.1, 0.0, wide)).tolist() == textured(0.1, 0.0, wide).tolist()
    assert view.moved_px < 0.3
    steadied = view.steadied(textured(3.0, -2.0, wide))
    inner = (slice(20, -20), slice(20, -20))
    assert np.abs(steadied[inner].astype(float) - reference[inner]).mean() < 2.0
    assert view.moved_px == pytest.approx(np.hypot(3.0, 2.0), abs=0.3)
    again = view.steadied(textured(0.0, 0.0, wide))
    assert np.abs(again[inner].astype(float) - reference[inner]).mean() < 2.0
    assert view.moved_px == pytest.approx(np.hypot(3.0, 2.0), abs=0.3)
    colour = view.steadied(cv2.merge([textured(3.0, -2.0, wide)] * 3))
    assert np.abs(colour[inner][..., 1].astype(float) - reference[inner]).mean() < 2.0


def test_a_picture_without_texture_outside_the_outline_stays_as_it_is() -> None:
    everything = np.array([[-1.0, -1.0], [241.0, -1.0], [241.0, 181.0], [-1.0, 181.0]])
    view = SteadyView(textured(), everything)
    assert not view.is_possible
    image = textured(5.0)
    assert view.steadied(image) is image
    lost = SteadyView(textured(), np.zeros((3, 2)))
    blank = np.zeros_like(image)
    assert lost.steadied(blank) is blank
    assert lost.moved_px == 0.0


def row_of(check_of: Check) -> str:
    # Return a row of the table of quality checks as text.
    widens = "" if check_of.widens is None else " ".join(f"{check_of.widens(value):.5g}" for value in (0.1, 0.9, 3.0))
    return (
        f"{check_of.finding}: {check_of.name} {'below' if check_of.below else 'above'} {check_of.limit}, "
        f"{check_of.severity}, unusable beyond {check_of.unusable_beyond}, widens {widens} {check_of.widens_in}"
    )


def test_the_table_of_quality_checks_is_as_accepted(tmp_path: Path) -> None:
    check(map(row_of, CHECKS), ACCEPTED / "checks.txt", tmp_path)


def test_the_weights_of_colours_are_as_accepted(tmp_path: Path) -> None:
    # The weights also separate the beams of several colours from their grounds.
    cases = {
        "red on grey": ((40.0, 50.0, 200.0), (150.0, 150.0, 150.0), {}),
        "blue on red": ((200.0, 90.0, 60.0), (60.0, 70.0, 200.0), {}),
        "nearly grey": ((110.0, 100.0, 90.0), (120.0, 120.0, 120.0), {}),
        "of a given colour": ((40.0, 50.0, 200.0), (150.0, 150.0, 150.0), {"beam_colour": (200, 50, 40)}),
        "in a given channel": ((40.0, 50.0, 200.0), (150.0, 150.0, 150.0), {"channel": "green"}),
    }
    lines: list[str] = []
    for name, (colour, ground, given) in cases.items():
        picture = SmallPicture(0.1, ground, 0.2)
        picture.add(within(picture.aside, 20.0, 60.0), (90.0, 140.0, 90.0)).beam(colour=colour)
        calibration = CALIBRATION.model_copy(update={"picture": Picture(**given)})
        images = [picture.exposed(3.0, seed) for seed in (1, 2)]
        chosen = choose_projection(images, calibration, 2.0, 12.0)
        lines += described(chosen, name)
        lines += [f"{name}: {chosen}", *described(chosen.apply(images[0]), f"{name} grey values")]
        again = Projection.from_json(chosen.to_json())
        assert again == chosen
    outside = CALIBRATION.model_copy(update={"clamp_midpoint_px": (500.0, 10.0)})
    assert choose_projection([SmallPicture().exposed()], outside, 2.0, 12.0).name == "grey"
    check(lines, ACCEPTED / "weights.txt", tmp_path)
