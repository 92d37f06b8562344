"""A value that is equal to a limit is on the side of the limit that the documentation states."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import date
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from eimi_drivers.interfaces import Frame
from eimi_lab.config.toml import check as parsed
from eimi_lab.process.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.calibration import calibration_file
from eimi_lab.vision.calibration.board import Board
from eimi_lab.vision.calibration.calibration_file import BenchSetup, from_board, from_ruler
from eimi_lab.vision.calibration.clicked_bench import ClickedBench, MeasuredBench, measure_bench
from eimi_lab.vision.calibration.exif_lens import focal_length
from eimi_lab.vision.calibration.lens import BoardPose
from eimi_lab.vision.calibration.plumb_line import measure_plumb_line
from eimi_lab.vision.check import Check, Severity
from eimi_lab.vision.edges import back_lit, passes
from eimi_lab.vision.edges.back_lit import BackLitSearch, _is_brighter_than_beside
from eimi_lab.vision.edges.clamp_line import ClampLine, find_clamp_line
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet, tip_angle_deg, tip_angle_sigma_deg
from eimi_lab.vision.edges.overlay import contact_sheet
from eimi_lab.vision.edges.passes import SiliconeMargin, _clear_of_ends, _inner_reach_px
from eimi_lab.vision.edges.profiles import Cover, _SharedUnknowns
from eimi_lab.vision.edges.silhouette import BackLight
from eimi_lab.vision.edges.suggested_corrections import _cut_by_border, _is_convincing, _shows_nothing
from eimi_lab.vision.flags import judge
from eimi_lab.vision.following import stated_width
from eimi_lab.vision.following.beam_search import _best_of_each_cell, _best_strip, _Generation, _index_of_best, _rival
from eimi_lab.vision.following.centre_line import CentreLine, clicked_line
from eimi_lab.vision.following.colour_seams import Seams
from eimi_lab.vision.following.crossings import leave_out_crossings
from eimi_lab.vision.following.discriminant import ColourProjection, project
from eimi_lab.vision.following.doubts import penumbra_px
from eimi_lab.vision.following.edge_points import StripEdges, _common
from eimi_lab.vision.following.hypotheses import Hypotheses
from eimi_lab.vision.following.reflections import remove_reflections
from eimi_lab.vision.following.stated import StatedBeam
from eimi_lab.vision.following.support import Sides
from eimi_lab.vision.following.working import WorkingPicture
from eimi_lab.vision.frame_checks import frame_flags
from eimi_lab.vision.image_files import _is_transparent
from eimi_lab.vision.image_sizes import claimed_size, is_stack
from eimi_lab.vision.image_wholeness import is_whole
from eimi_lab.vision.intensity import FieldCorrection
from eimi_lab.vision.settling_statistic import Noise
from eimi_lab.vision.tracking.beam_tracker import BeamTracker, SeenBeam
from eimi_lab.vision.tracking.steady_view import SteadyView
from tests.shared.sampled_beam import EDGES, body, unrolled
from tests.shared.small_pictures import CALIBRATION, SmallPicture, specimen, within

Array = np.ndarray
DAY = date(2026, 3, 4)


def test_a_field_along_the_axis_leaves_y_clockwise_of_x() -> None:
    along = BeamFrame(CALIBRATION.model_copy(update={"axis_angle_deg": 0.0, "field_angle_deg": 0.0}))
    assert along.hand == 1.0
    near = BeamFrame(CALIBRATION.model_copy(update={"stand_off_mm": 3.0}))
    with pytest.raises(ValueError, match="should be more than half of depth_mm = 6"):
        near.view(6.0, (128, 112))
    assert near.view(5.9, (128, 112)) is not None
    assert BeamFrame(CALIBRATION).view(6.0, (128, 112)) is None
    telecentric = CALIBRATION.model_copy(update={"stand_off_mm": 3.0, "telecentric": True})
    assert BeamFrame(telecentric).view(5.0, (128, 112)) is None


def test_a_board_is_found_by_12_of_its_points(monkeypatch: pytest.MonkeyPatch) -> None:
    for count, is_found in ((11, False), (12, True)):
        points = 5.0 * np.column_stack(np.divmod(np.arange(count), 4)), np.ones((count, 2))
        monkeypatch.setattr(Board, "_checkerboard", lambda self, shown, points=points: points)
        found = Board("checkerboard", 4, 4, 5.0).find(np.zeros((20, 20), np.uint8))
        assert (found is points) is is_found


def from_poses(monkeypatch: pytest.MonkeyPatch, tilt_deg: float, views: int, telecentric: bool = False) -> list[str]:
    # Return the lines of a calibration from `views` pictures of a board with the given tilt.
    paths = [Path(f"{number}.png") for number in range(views)]
    view = (np.zeros((12, 2)), np.ones((12, 2)))
    lens = SimpleNamespace(
        undistort=lambda points: points, residual_px=0.1, focal_length_px=900.0, focal_length_sigma_px=2.0,
        matrix=np.eye(3), distortion=np.zeros(5),
    )  # fmt: skip
    monkeypatch.setattr(calibration_file, "_views_of", lambda board, given: (dict.fromkeys(given, view), (128, 112)))
    monkeypatch.setattr(calibration_file, "_lens_of", lambda *_: (lens, 200.0))
    monkeypatch.setattr(calibration_file, "_day_of", lambda _: DAY)
    pose = BoardPose(6.0, 0.01, 0.0, 0.02, tilt_deg, 0.1)
    monkeypatch.setattr(calibration_file, "fit_board_pose", lambda *_: pose)
    setup = BenchSetup(4.7, (60.0, 26.0), 90.0, 91.0, 0.0, telecentric)
    return from_board(paths[1:], paths[0], Board("charuco", 6, 5, 5.0), setup, 0.001)[1]


def test_four_views_and_a_tilt_of_5_degrees_suffice(monkeypatch: pytest.MonkeyPatch) -> None:
    assert from_poses(monkeypatch, 5.0, 4)[0] == "lens: residual of 0.100 px RMS over 4 views"
    assert from_poses(monkeypatch, 5.0, 3)[0].startswith("lens: not calibrated")
    assert from_poses(monkeypatch, 5.0, 3, telecentric=True) == [
        "board in the middle plane: residual of 0.100 px RMS, tilted by about 5.0 degrees"
    ]
    assert len(from_poses(monkeypatch, 5.0, 5, telecentric=True)) == 1
    with pytest.raises(InputError, match=r"tilted by 5.1 degrees \(at most 5\)"):
        from_poses(monkeypatch, 5.1, 4)


@pytest.mark.parametrize("length_mm", [0.0, math.inf, -1.0])
def test_a_ruler_has_a_finite_length_above_zero(monkeypatch: pytest.MonkeyPatch, length_mm: float) -> None:
    monkeypatch.setattr(calibration_file, "read_grey", lambda _: np.zeros((100, 120), np.uint8))
    with pytest.raises(InputError, match="--ruler-mm"):
        from_ruler(Path("a.png"), (0, 0, 50, 0), length_mm, BenchSetup(None, (60.0, 26.0), 90.0, 90.0, 0.0))


def clicked(size: tuple[int, int] = (4000, 3000), length_mm: float = 40.0, **changes: Any) -> MeasuredBench:
    given = {
        "clamp_px": [[1000, 1400]],
        "tip_px": [2600, 1500],
        "ruler_px": [[1000, 600], [3000, 600]],
        "ruler_mm": 50.0,
    }
    bench = parsed(ClickedBench, {**given, "stand_off_mm": 160.0, **changes}, "", "clicks")
    return measure_bench(bench, size, length_mm, 6.0, None, DAY)


def test_clicks_at_their_limits_are_accepted() -> None:
    # The tip is 44 mm from the clamp, 1.1 lengths; the lens is 12 mm from the beam, twice its depth.
    assert clicked(tip_px=[2760, 1400]).calibration.pixels_per_mm == 40.0
    with pytest.raises(InputError, match="the tip is 44"):
        clicked(tip_px=[2761, 1400])
    assert clicked(stand_off_mm=12.0).calibration.stand_off_mm == 12.0
    with pytest.raises(InputError, match="less than twice the beam's depth_mm = 6"):
        clicked(stand_off_mm=11.9)
    near = {"ruler_px": [[1000, 600], [1040, 600]], "ruler_mm": 1.0}
    assert clicked(**near).calibration.pixels_per_mm == 40.0
    with pytest.raises(InputError, match="39 px apart"):
        clicked(ruler_px=[[1000, 600], [1039, 600]], ruler_mm=1.0)
    ends = {"plumb": "clamp", "clamp_px": [[1000, 1390], [1000, 1410]]}
    assert clicked(**ends).calibration.gravity_angle_deg == 90.0
    with pytest.raises(InputError, match="at least 20 px apart"):
        clicked(plumb="clamp", clamp_px=[[1000, 1390], [1000, 1409]])


def test_a_click_is_uncertain_by_at_least_1_px() -> None:
    # In a picture of 1000 x 750 px, 4e-4 times the diagonal is half a pixel.
    small = clicked((1000, 750), clamp_px=[[250, 350]], tip_px=[650, 375], ruler_px=[[250, 150], [750, 150]])
    uncertainty = small.calibration.uncertainty
    assert uncertainty is not None
    scale = math.hypot(math.sqrt(2.0) / 500.0, 1.0 / 160.0) * 10.0
    assert uncertainty["pixels_per_mm"] == pytest.approx(scale, rel=0.05)
    aimed = math.hypot(0.5, math.degrees(math.sqrt(2.0) / 500.0))
    assert uncertainty["gravity_angle_deg"] == pytest.approx(aimed, abs=0.006)


def test_a_thread_is_searched_in_pictures_of_100_px() -> None:
    y, x = np.mgrid[0:140, 0:100].astype(float)
    image = np.rint(200.0 - 150.0 * within(x - 50.0, -1.2, 1.2) * within(y, 15.0, 125.0)).astype(np.uint8)
    assert measure_plumb_line(image, CALIBRATION, 90.0).gravity_angle_deg == pytest.approx(90.0, abs=0.1)
    with pytest.raises(ValueError, match="its shorter side is 99 px long"):
        measure_plumb_line(image[:, 1:], CALIBRATION, 90.0)


@pytest.mark.parametrize(("below", "beyond"), [(False, 8.1), (True, 7.9)])
def test_a_value_at_the_second_limit_is_not_unusable(below: bool, beyond: float) -> None:
    check = Check(
        name="A", finding="a", quantity="a", limit=5.0, remedy="b", below=below, severity=Severity.DOUBTFUL,
        unusable_beyond=8.0, widens=lambda value: 0.1 * value, widens_in="mm",
    )  # fmt: skip
    at = check.flag(8.0)
    assert (at.severity, at.limit, at.widens_in) == (Severity.DOUBTFUL, 5.0, "mm")
    assert at.widens == pytest.approx(0.8)
    assert (check.flag(beyond).severity, check.flag(beyond).widens) == (Severity.UNUSABLE, 0.0)
    assert check.flag(8.0, 6.0).limit == 6.0
    assert at.widens_mm(10.0, 3.0, 5.0) == pytest.approx(0.8)
    for unit, size in (("px", 0.1), ("width", 3.0), ("depth", 5.0)):
        assert replace(at, widens_in=unit).widens_mm(10.0, 3.0, 5.0) == pytest.approx(0.8 * size)


def search() -> BackLitSearch:
    return BackLitSearch(BeamFrame(CALIBRATION), 7.0, specimen(), {}, None)


@pytest.mark.parametrize(("rows", "is_searched"), [(15, False), (16, True)])
def test_a_silhouette_is_searched_in_pictures_of_16_px(rows: int, is_searched: bool) -> None:
    picture = search()._dark_beam_image(np.full((rows, 40), 90, np.uint8))
    assert (picture is not None) is is_searched
    assert search()._dark_beam_image(np.zeros(7)) is None


@pytest.mark.parametrize(("dark", "is_seen"), [(80.0, True), (80.1, False)])
def test_a_beam_is_darker_than_the_light_by_a_fifth(
    monkeypatch: pytest.MonkeyPatch, dark: float, is_seen: bool
) -> None:
    line = ClampLine(np.zeros(2), np.array([0.0, 1.0]), 0.7)
    found = SimpleNamespace(touches_frame=True, other_bodies=2, hole_share=0.1, turn_deg=80.0, corners=(1, 2))
    light = BackLight(np.full((8, 8), 100.0, np.float32), 100.0, dark)
    monkeypatch.setattr(back_lit, "measure_back_light", lambda *_: light)
    monkeypatch.setattr(back_lit, "find_clamp_line", lambda *_: line)
    monkeypatch.setattr(back_lit, "find_silhouette", lambda *_: found)
    asked = search()
    outlined = asked.find_outline(np.full((112, 128), 90, np.uint8))
    assert (outlined is not None) is is_seen
    seen = {"touches_frame": 1.0, "other_bodies": 2.0, "hole_share": 0.1, "corner_turn_deg": 80.0}
    contrast = (100.0 - dark) / 255.0 if is_seen else 0.0
    assert asked.findings == {"contrast": pytest.approx(contrast), "clamp_seen": 0.7, **(seen if is_seen else {})}
    found.corners = None
    assert search().find_outline(np.full((112, 128), 90, np.uint8)) is None
    monkeypatch.setattr(back_lit, "find_silhouette", lambda *_: None)
    lost = search()
    assert lost.find_outline(np.full((112, 128), 90, np.uint8)) is None
    assert lost.findings.get("length_deviation", 0.0) == (1.0 if is_seen else 0.0)


def test_a_beam_is_brighter_than_its_surroundings_by_a_fifth_and_a_grey_level() -> None:
    for inside, is_brighter in ((61, False), (62, True)):
        image = np.full((112, 128), 50, np.uint8)
        image[:, 53:68] = inside
        assert _is_brighter_than_beside(image, BeamFrame(CALIBRATION), 2.0) is is_brighter
        image[:, :50] = 56
        assert not _is_brighter_than_beside(image, BeamFrame(CALIBRATION), 2.0)


def test_a_clamp_seen_on_one_side_is_used_without_a_tilt() -> None:
    image = np.full((112, 128), 200.0)
    image[:33, :60] = 20.0
    image[:, 53:68] = 20.0
    frame = BeamFrame(CALIBRATION.model_copy(update={"clamp_midpoint_px": (60.0, 30.0)}))
    found = find_clamp_line(image, frame, 2.0, 200.0)
    assert found.visible_share == 0.5
    assert found.point_px == pytest.approx([60.0, 32.5], abs=0.05)
    assert found.ahead == pytest.approx([0.0, 1.0])


def test_three_points_determine_the_direction_of_the_tip() -> None:
    three = EdgePoints(np.array([[0.0, 0.0], [3.0, 4.0], [6.0, 8.0]]), np.full(3, 0.1))
    edges = EdgeSet(three, three, (), np.zeros((4, 2)))
    assert tip_angle_deg(edges) == pytest.approx(math.degrees(math.atan2(4.0, 3.0)))
    assert tip_angle_sigma_deg(edges) == pytest.approx(math.degrees(math.sqrt(2.0 * 0.01 / 50.0 / 4.0)))
    two = EdgePoints(three.points_mm[:2], three.sigma_mm[:2])
    assert math.isnan(tip_angle_deg(EdgeSet(two, three, (), np.zeros((4, 2)))))
    assert math.isnan(tip_angle_sigma_deg(EdgeSet(three, two, (), np.zeros((4, 2)))))
    back = EdgePoints(three.points_mm[::-1], three.sigma_mm)
    assert tip_angle_deg(EdgeSet(back, back, (), np.zeros((4, 2)))) == pytest.approx(
        math.degrees(math.atan2(-4.0, -3.0))
    )


def test_the_limits_of_profiles_and_blurs() -> None:
    assert _inner_reach_px(10.0, 3.0, 1.0) == 10.0
    assert _inner_reach_px(10.0, 3.1, 1.0) == pytest.approx(1.6)
    line = np.column_stack([np.arange(11.0), np.zeros(11)])
    assert _clear_of_ends(line, 2.0).tolist() == [False] * 2 + [True] * 7 + [False] * 2
    none = Cover(np.full(3, -1), np.zeros(0), np.zeros(0), 0.0)
    for span, most in ((40.0, 8.0), (10.0, 4.0)):
        shared = _SharedUnknowns(1.2, none, span)
        assert (shared._smallest.tolist(), shared._largest.tolist()) == ([0.3], [most])
    two = Cover(np.array([0, 1]), np.array([4.0, 6.0]), np.array([0.5, 2.0]), 0.1)
    shared = _SharedUnknowns(1.2, two, 12.0)
    assert shared.values.tolist() == [1.2, 2.0, 3.0]
    assert shared._prior.tolist() == [0.0, 4.0, 6.0]
    assert shared._precision.tolist() == [0.0, 4.0, 0.25]
    assert shared._smallest.tolist() == [0.3, 0.0, 0.0]
    assert shared._largest == pytest.approx([4.8, 12.0, 12.0])


@pytest.mark.parametrize("x", [6.5, 120.5])
def test_a_beam_that_begins_at_the_border_is_not_cut(x: float) -> None:
    at_border = CALIBRATION.model_copy(update={"clamp_midpoint_px": (x, 10.0)})
    assert _cut_by_border(np.zeros((112, 128)), at_border, specimen()) == ""


def generation(places: list[list[float]], scores: list[float]) -> _Generation:
    count = len(scores)
    values = np.ones(count)
    strips = Hypotheses(
        np.array(places), 0.0 * values, 0.0 * values, 10.0 * values, np.zeros((count, 9, 1), np.float32), values,
        values, np.array(scores),
    )  # fmt: skip
    return _Generation(strips, np.arange(count), 0.5 * values)


def test_strips_at_the_limits_of_the_search() -> None:
    far = 10.0 * np.arange(3)
    assert _best_of_each_cell(far, far, far, np.array([5.0, 1.0, 1.001]), 10.0).tolist() == [0, 2]
    flat = [generation([[5.0 * step, 0.0]], [0.0]) for step in range(3)]
    assert _best_strip(flat, 5.0, 10.0, lambda: None, 2) is None
    asked = []

    def earlier() -> Array:
        asked.append(True)
        return np.array([[0.0, 6.0], [5.0, 6.0]])

    for second, aside, count in ((0.93, 6.0, 1), (0.929, 6.0, 0), (0.93, 5.999, 0)):
        asked.clear()
        both = [generation([[5.0 * step, 0.0], [5.0 * step, aside]], [1.0, second]) for step in range(2)]
        assert _index_of_best(both, earlier, 10.0) == count
        assert len(asked) == count
    beside = [generation([[5.0 * step, 0.0], [5.0 * step, 6.0]], [1.0, 0.9]) for step in range(3)]
    path = np.array([[0.0, 0.0], [5.0, 0.0], [10.0, 0.0]])
    assert _rival(beside, path, np.zeros(3), np.full(3, 0.5), 10.0) == 0.0


def test_places_at_the_limits_of_a_centre_line() -> None:
    points = np.column_stack([np.full(101, 50.0), np.arange(101.0)])
    line = CentreLine(points, 100.0, np.full(101, 5.0), 0.25, 2.0)
    assert line.gain(np.array([55.0, 45.0]), np.full(2, 40.0), 40.0, 20.0).tolist() == [0.25, 0.25]
    assert replace(line, evidence=0.0).clicked_px == 0.0
    # Clicks 40 px apart are two places; nearer ones are one place.
    bends = [
        float(
            np.ptp(
                clicked_line(
                    np.array([100.0, 30.0]), np.array([0.0, 1.0]), np.array([[112.0, 130.0], [88.0, 130.0 + along]])
                ).points[:, 0]
            )
        )
        for along in (32.0, 31.9)
    ]
    assert bends[0] > 5.0
    assert bends[1] < 0.5


def test_a_crossing_body_differs_by_more_than_40_levels() -> None:
    for difference, is_found in ((40.0, False), (40.5, True)):
        colours = np.full((100, 53, 3), 100.0)
        colours[40:49, :, 1] += difference
        assert (leave_out_crossings(unrolled(colours)).covered is not None) is is_found


def test_blurs_at_the_limits_may_be_those_of_a_shadow() -> None:
    step = np.full((60, 3), -20.0)
    sides = tuple(
        ColourProjection(np.zeros((60, 53)), np.full(60, 9.0), np.ones((60, 3)), np.zeros(60), step.copy())
        for _ in (0, 1)
    )
    found = Sides(EDGES, np.ones((2, 60)), np.ones((2, 60), bool), 60, sides, np.zeros((2, 60)))  # type: ignore[arg-type]

    def blurred(blur_px: float) -> StripEdges:
        return StripEdges(np.zeros((0, 2)), np.zeros(0), np.zeros(0), blur_px)

    assert penumbra_px(blurred(2.0), blurred(2.5), found, 20.0) == 2.5
    sides[1].step[:, 0] = 20.0
    assert penumbra_px(blurred(2.0), blurred(4.0), found, 20.0) == 4.0
    sides[1].step[:, 0] = 0.0  # a colour that does not become darker
    assert penumbra_px(blurred(2.0), blurred(3.9), found, 20.0) == 0.0


def test_slopes_at_the_limits_are_not_even() -> None:
    assert _common(np.full(31, 0.04), np.full(31, 0.001)).tolist() == [0.0] * 31
    assert _common(np.full(31, -0.04), np.full(31, 0.001)).tolist() == [0.0] * 31
    rough = np.where(np.arange(31) % 2 == 0, 0.03, 0.001)
    assert _common(np.where(rough > 0.01, 0.01, 0.02), rough)[15] == pytest.approx(0.02)


@pytest.mark.parametrize(("level", "around", "is_removed"), [(240.0, 210.0, False), (240.0, 209.0, True)])
def test_a_reflection_is_brighter_by_more_than_30_levels(level: float, around: float, is_removed: bool) -> None:
    pixels = np.full((40, 60, 2), around, np.float32)
    pixels[:, 30:34] = level
    beam = StatedBeam(np.zeros(2), 0.0, 16.0, 40.0)
    found = remove_reflections(WorkingPicture(pixels, np.zeros(2), 1.0, beam)).pixels
    assert bool((found == around).all()) is is_removed
    pixels[:, 30:34] = (level, around)  # half of the colours
    assert (remove_reflections(WorkingPicture(pixels, np.zeros(2), 1.0, beam)).pixels == pixels).all()


@pytest.mark.parametrize(
    ("support", "separation", "inner", "is_moved"),
    [
        (0.71, 3.1, 0.5, True),
        (0.7, 3.1, 0.5, False),
        (0.71, 3.0, 0.5, False),
        (0.71, 3.1, 0.62, False),  # a width of 1.12
        (0.71, 3.1, 0.59, True),
    ],
)
def test_another_edge_is_clear_and_gives_the_stated_width(
    monkeypatch: pytest.MonkeyPatch, support: float, separation: float, inner: float, is_moved: bool
) -> None:
    picture = unrolled(body((50.0,), (200.0,), (0.5, 0.8, (120.0,))))
    projection = ColourProjection(
        np.zeros((60, 53)), np.full(60, separation), np.ones((60, 1)), np.zeros(60), np.ones((60, 1))
    )
    edges = EDGES.copy()
    edges[1] = 0.8
    before = Seams(edges, np.ones((2, 60)), (projection, projection), np.zeros((2, 60)))
    moved = edges.copy()
    moved[1] = inner
    other = Seams(moved, np.full((2, 60), support), (projection, projection), np.zeros((2, 60)))
    expected: list[Array] = []
    monkeypatch.setattr(
        stated_width, "find_colour_seams", lambda _, places, *__: expected.append(places.copy()) or other
    )
    found = stated_width.prefer_stated_width(picture, before, 1.0, 1)
    assert (found is not before) is is_moved
    assert expected[0][0] == pytest.approx(np.full(60, -0.2))  # each edge at the stated width from the other one
    assert expected[1][1] == pytest.approx(np.full(60, 0.5))
    if is_moved:
        assert found.edge[1] == pytest.approx(np.full(60, inner))
        assert found.shadow[1] == pytest.approx(np.full(60, 0.8 - inner))
        assert found.support[:, 0].tolist() == [1.0, support]
        assert (found.shadow[0] == 0.0).all()


def test_a_frame_with_the_number_of_the_frame_before_is_a_repetition() -> None:
    noise = Noise(np.zeros(1), np.array([2.0]))
    images = [np.full((4, 4), value, np.uint8) for value in (1, 2, 3)]
    frames = [Frame(image, number, 0.0) for image, number in zip(images, (5, 5, 6), strict=True)]
    assert [(flag.name, flag.value) for flag in frame_flags(frames, noise)] == [("DUPLICATE", 1.0)]
    same = [Frame(images[0], number, 0.0) for number in (5, 6)]
    assert [flag.name for flag in frame_flags(same, noise)] == ["DUPLICATE"]
    assert frame_flags(same, Noise(np.zeros(1), np.array([1.0 / 12.0]))) == ()
    gap = [Frame(images[0], 5, 0.0), Frame(images[1], 8, 0.0)]
    assert [(flag.name, flag.value) for flag in frame_flags(gap, noise)] == [("DROPPED", 2.0)]


def test_a_flat_field_without_light_is_refused() -> None:
    with pytest.raises(ValueError, match="the flat field is dark in places"):
        FieldCorrection(np.full((4, 4), 9.0), np.full((4, 4), 9.0))


def test_a_beam_is_seen_at_half_of_its_places() -> None:
    for seen, is_seen in ((11, False), (12, True)):
        places = np.full((24, 2), np.nan)
        places[:seen] = 1.0
        assert SeenBeam(places, places, places).is_seen is is_seen


def test_a_faint_beam_is_tracked() -> None:
    x = np.linspace(1.0, 11.0, 20)
    sides = [EdgePoints(np.column_stack([x, np.full(20, y)]), np.full(20, 0.01)) for y in (-1.0, 1.0)]
    image = np.full((112, 128), 100.0, np.float32)
    image[10:94, 53:68] = 99.5
    tracker = BeamTracker(image, EdgeSet(*sides, (), np.zeros((4, 2))), BeamFrame(CALIBRATION), 12.0)
    assert tracker.follow(image).is_seen


@pytest.mark.parametrize(("wide", "is_halved"), [(1400, False), (1401, True)])
def test_a_picture_wider_than_1400_px_is_halved(wide: int, is_halved: bool) -> None:
    view = SteadyView(SmallPicture().exposed()[:20, np.arange(wide) % 128], np.zeros((3, 2)))
    assert view._reference.shape[1] == (round(wide / 2) if is_halved else wide)


def test_twelve_corners_are_enough_for_the_motion_of_the_camera() -> None:
    for count, is_possible in ((11, False), (12, True)):
        image = np.full((120, 160), 60, np.uint8)
        for number in range(count):
            y, x = 15 + 30 * (number // 5), 15 + 30 * (number % 5)
            image[y : y + 1, x : x + 1] = 250
        view = SteadyView(image, np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]]))
        assert len(view._corners) == count
        assert view.is_possible is is_possible


def test_the_first_search_reads_up_to_the_magnet_inside_and_farther_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Any] = []
    monkeypatch.setattr(passes, "_locate", lambda *arguments: given.extend(arguments))
    corners = np.array([[0.0, 0.0], [0.0, 300.0], [60.0, 300.0], [60.0, 0.0]])
    parts = [np.linspace(a, b, int(np.linalg.norm(b - a)), endpoint=False) for a, b in pairwise(corners)]
    outline: Any = SimpleNamespace(outline_px=np.vstack([*parts, corners[-1:]]), corners=(300, 360))
    for cover_px, inner in ((6.0, 4.0), (3.5, 10.0), (20.0, 10.0)):
        given.clear()
        passes.first_pass(np.zeros((4, 4)), outline, 1.0, 12.0, 60.0, SiliconeMargin(cover_px, 0.1, 50.0))
        assert given[4][[0, -1]].tolist() == [-inner, 10.0]  # 1.5 times a blur of 1.2 px from the magnet
        assert given[3] == (-1.0, -1.0, 1.0)


@pytest.mark.parametrize(("deviation", "is_beam"), [(0.5, True), (0.501, False)])
def test_a_body_that_is_wider_by_more_than_half_is_not_the_beam(
    monkeypatch: pytest.MonkeyPatch, deviation: float, is_beam: bool
) -> None:
    monkeypatch.setattr(back_lit, "width_deviation", lambda *_: deviation)
    y = np.linspace(12.0, 90.0, 30)
    sides: Any = tuple(
        SimpleNamespace(points_px=np.column_stack([np.full(30, x), y]), sound=np.ones(30, bool)) for x in (52.0, 67.0)
    )
    corners = np.array([[52.0, 10.0], [67.0, 10.0], [52.0, 94.0], [67.0, 94.0]])
    asked = search()
    assert asked._measure_shape(SimpleNamespace(sides=sides), corners) is is_beam  # type: ignore[arg-type]
    assert asked.findings["width_deviation"] == deviation
    if is_beam:
        assert asked.findings["length_deviation"] == pytest.approx(0.0, abs=1e-9)
        assert asked.findings["clamp_offset_mm"] == pytest.approx(0.5 / 7.0)
        assert asked.findings["twist_deg"] == 0.0
        radius, beta = math.hypot(14.0, 28.0), math.atan2(14.0, 28.0)
        assert asked.even_turn_deg == pytest.approx(math.degrees(math.asin(15.0 / radius) - beta))
    else:
        assert "length_deviation" not in asked.findings


def test_an_answer_is_false_and_not_missing() -> None:
    assert _is_transparent(None) is False
    assert _is_transparent(np.zeros((4, 4, 3), np.uint8)) is False
    opaque = np.full((4, 4, 4), 255, np.uint8)
    assert _is_transparent(opaque) is False
    opaque[1, 1, 3] = 242
    assert _is_transparent(opaque) is True  # 0.95 * 255 is 242.25
    assert is_stack(b"") is False
    assert is_stack(b"II*\0\x08\0\0\0") is False
    assert is_whole(b"\x89PNG\r\n\x1a\n") is False
    nothing = EdgePoints(np.zeros((0, 2)), np.zeros(0))
    assert _is_convincing(EdgeSet(nothing, nothing, (), np.zeros((4, 2))), specimen()) is False
    serious = judge({"blur_px": 9.0})
    assert _is_convincing(EdgeSet(nothing, nothing, serious, np.zeros((4, 2))), specimen()) is False
    assert _shows_nothing(np.tile(np.arange(0, 200, 5, dtype=np.uint8), (40, 1))) == ""


def test_values_that_are_not_finite_do_not_change_the_scale_of_an_image() -> None:
    image = np.full((4, 4), 300.0)
    image[0, 0] = np.inf
    corrected = FieldCorrection(np.full((4, 4), -900.0), None).apply(image)
    assert corrected[1, 1] == 1023.0
    assert corrected[0, 0] == 900.0


def test_a_step_of_the_shared_unknowns_is_a_gauss_newton_step_with_priors() -> None:
    cover = Cover(np.array([0, 1]), np.array([4.0, 6.0]), np.array([0.5, 2.0]), 0.1)
    shared = _SharedUnknowns(1.2, cover, 12.0)
    rng = np.random.default_rng(6)
    reduced, residuals = rng.normal(0.0, 3.0, (4, 5, 3)), rng.normal(0.0, 1.0, (4, 5))
    before = shared.values.copy()
    jacobian = reduced.reshape(20, 3)
    noise = (residuals**2).mean()
    precision = np.array([0.0, 4.0, 0.25])
    normal = jacobian.T @ jacobian + noise * np.diag(precision)
    target = jacobian.T @ residuals.ravel() - noise * precision * (before - [0.0, 4.0, 6.0])
    expected = np.linalg.solve(normal, target)
    change = shared.step(reduced, residuals)
    assert np.abs(expected).max() < 0.6
    assert change == pytest.approx(expected, rel=1e-6)
    assert shared.values == pytest.approx(before + expected, rel=1e-6)
    assert shared.cover_variances() == pytest.approx(noise * np.diag(np.linalg.inv(normal))[1:], rel=1e-6)
    far = _SharedUnknowns(1.2, cover, 12.0)
    assert np.abs(far.step(0.01 * reduced, residuals)).max() == 0.6  # at most half of the blur
    none = _SharedUnknowns(0.5, Cover(np.zeros(0, int), np.zeros(0), np.zeros(0), 0.0), 12.0)
    none.step(-np.ones((1, 3, 1)), np.full((1, 3), 9.0))
    assert none.blur_px == 0.3  # the smallest blur
    idle = _SharedUnknowns(1.0, cover, 12.0)
    idle.step(np.zeros((0, 5, 3)), np.zeros((0, 5)))
    assert idle.values.tolist() == [1.0, 2.0, 3.0]


def test_a_picture_of_one_colour_has_no_separation() -> None:
    found = project(unrolled(np.full((60, 53, 3), 90.0)), EDGES[1], 1.0, 1.0)
    assert found.separation == pytest.approx(np.full(60, math.sqrt(1e-9)), rel=1e-6)
    assert not found.weight.any()
    assert not found.step.any()
    assert not found.level.any()


@pytest.mark.parametrize(
    ("unit", "unit_mm"), [(None, 25.4), (2, 25.4), (3, 10.0), (4, 1.0), (5, 1e-3), (1, 25.4), (9, 25.4)]
)
def test_the_resolution_of_a_sensor_is_given_in_inches_without_a_unit(
    tmp_path: Path, unit: int | None, unit_mm: float
) -> None:
    exif = Image.Exif()
    table = {"FocalLength": 4.0, "FocalPlaneXResolution": 5000.0, "ExifImageWidth": 4000, "ExifImageHeight": 3000}
    units = {} if unit is None else {"FocalPlaneResolutionUnit": unit}
    exif.get_ifd(IFD.Exif).update({Base[name]: value for name, value in {**table, **units}.items()})
    Image.new("RGB", (400, 300)).save(tmp_path / "a.jpg", exif=exif)
    lens = focal_length(tmp_path / "a.jpg", (400, 300))
    assert lens is not None
    assert lens.px == pytest.approx(4.0 * 5000.0 / unit_mm * 400.0 / 4000.0)
    assert lens.source == "focal length of 4 mm and resolution of the sensor from the Exif data of the picture"


def test_a_picture_on_a_sheet_is_at_least_1_px_wide() -> None:
    sheet = contact_sheet([np.zeros((2000, 4, 3), np.uint8), np.zeros((4, 2000, 3), np.uint8)], ["", ""])
    dark = (sheet == 0).all(axis=2)
    assert dark[:, :320].any(axis=0).nonzero()[0].tolist() == [0]
    assert dark[:, 320:].any(axis=1).nonzero()[0].tolist() == [20]
    assert dark[:, :320].sum() == 256  # 280 px without the caption and a margin
    assert dark[:, 320:].sum() == 316


def test_a_restart_marker_of_a_jpeg_has_no_size() -> None:
    after = b"\x00\x11\x08\x01\xe0\x02\x80\x03"
    assert claimed_size(b"\xff\xd8\xff\xcf" + after) == (640, 480)
    assert claimed_size(b"\xff\xd8\xff\xd0" + after) is None


def test_the_deviation_of_an_edge_point_is_at_least_a_thousandth_of_a_pixel() -> None:
    y = np.linspace(20.0, 80.0, 7)
    side: Any = SimpleNamespace(
        points_px=np.column_stack([np.full(7, 67.0), y]), sound=np.array([True] * 6 + [False]), stride=2,
        sigma_px=np.array([0.0, 0.0, 0.3, 0.3, 0.0, 0.0, 9.0]), common_px=np.array([0.0, 0.0, 0.4, 0.4, 0.0, 0.0, 9.0]),
    )  # fmt: skip
    found = search()._edge_points(side, 2.0)
    assert found.sigma_mm == pytest.approx(np.array([1e-3, 1.0, 1e-3]) / 7.0)
    assert found.points_mm == pytest.approx(np.column_stack([(y[[0, 2, 4]] - 10.0) / 7.0, np.ones(3)]))
