"""The following of a beam in a picture decides rightly just below and just above its thresholds."""

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
from eimi_fitting import Specimen
from eimi_lab.config.rig import load_rig
from eimi_lab.config.toml import check as parsed
from eimi_lab.virtual import beam as virtual_beam
from eimi_lab.virtual.beam import VirtualBeam, VirtualLoads
from eimi_lab.virtual.moving_beam import MovingBeam
from eimi_lab.virtual.rod import Stiffness
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.calibration.clicked_bench import ClickedBench, measure_bench
from eimi_lab.vision.calibration.exif_lens import focal_length
from eimi_lab.vision.edges.profiles import normals_of
from eimi_lab.vision.edges.silhouette import _tip_corners
from eimi_lab.vision.following import unrolled as unrolled_module
from eimi_lab.vision.following.beam_search import Strip
from eimi_lab.vision.following.clicks import with_clicks
from eimi_lab.vision.following.edge_points import StripEdges, estimate_scatter
from eimi_lab.vision.following.follow import FollowedBeam
from eimi_lab.vision.following.stated import StatedBeam
from eimi_lab.vision.following.texture import _averaged, _SmoothLine, average_texture
from eimi_lab.vision.following.working import WorkingPicture
from eimi_lab.vision.frame_checks import state_flags
from eimi_lab.vision.ruled_picture import MARGIN_PX, SUGGESTED, ruled_picture
from eimi_lab.vision.settling_statistic import Noise, measure_noise
from tests.shared.small_pictures import CALIBRATION

Array = np.ndarray


def rough_edge(scatter_px: float, count: int = 60, length_px: float = 240.0) -> StripEdges:
    # Return an edge along x whose points have exactly the given scatter about a polynomial of degree 7.
    x = np.linspace(0.0, length_px, count)
    offset = np.random.default_rng(4).normal(0.0, 1.0, count)
    offset = np.convolve(np.pad(offset, 4, mode="reflect"), np.hanning(9) / np.hanning(9).sum(), mode="valid")
    for _ in range(60):
        offset = scatter_px / _SmoothLine.through(np.column_stack([x, offset])).scatter * offset
    return StripEdges(np.column_stack([x, offset]), np.full(count, scatter_px), x / 40.0, 1.0)


@pytest.mark.parametrize(("scatter_px", "is_averaged"), [(0.498, False), (0.502, True)])
def test_an_edge_that_scatters_by_half_a_pixel_is_averaged(scatter_px: float, is_averaged: bool) -> None:
    edge = rough_edge(scatter_px)
    assert (average_texture(edge, 40.0) is not edge) is is_averaged


@pytest.mark.parametrize(("count", "is_averaged"), [(13, False), (14, True)])
def test_an_edge_of_14_points_is_averaged(count: int, is_averaged: bool) -> None:
    x = np.linspace(0.0, 130.0, count)
    edge = StripEdges(np.column_stack([x, 6.0 * (-1.0) ** np.arange(count)]), np.full(count, 6.0), x, 1.0)
    assert (average_texture(edge, 60.0) is not edge) is is_averaged


def test_the_average_is_the_longest_that_keeps_half_of_the_scatter() -> None:
    # Twelve lengths up to a quarter of the width are tried, until less than half of the scatter would remain.
    for width_px in (20.0, 60.0, 300.0):
        edge = rough_edge(1.5)
        line = _SmoothLine.through(edge.points)
        expected = None
        for number in range(1, 13):
            averaged = _averaged(line.along, line.offset, 0.25 * width_px * number / 12.0)
            if math.sqrt((averaged**2).sum() / (line.offset**2).sum()) < 0.5:
                break
            expected = averaged
        found = average_texture(edge, width_px)
        assert expected is not None
        assert found.points == pytest.approx(edge.points + (expected - line.offset)[:, None] * line.normal, abs=1e-12)
        left = _SmoothLine.through(found.points).scatter
        assert found.sigma == pytest.approx(np.full(60, min(1.5, left)))


def test_the_smooth_line_is_a_polynomial_of_degree_7_in_the_arc_length() -> None:
    edge = rough_edge(1.0, 30)
    line = _SmoothLine.through(edge.points)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(edge.points, axis=0).T))])
    assert line.along == pytest.approx(along)
    share = along / along[-1]
    smooth = np.column_stack([np.polyval(np.polyfit(share, axis, 7), share) for axis in edge.points.T])
    slope = np.column_stack([np.polyval(np.polyder(np.polyfit(share, axis, 7)), share) for axis in edge.points.T])
    normal = normals_of(slope / np.linalg.norm(slope, axis=1, keepdims=True))
    assert line.normal == pytest.approx(normal, abs=1e-6)
    assert line.offset == pytest.approx(((edge.points - smooth) * normal).sum(axis=1), abs=1e-6)
    assert line.scatter == pytest.approx(math.sqrt((line.offset**2).sum() / (30 - 8)))


@pytest.mark.parametrize(("widths", "pieces"), [(1.0, 1), (3.6, 2), (3.9, 3), (6.1, 4)])
def test_the_path_is_a_spline_with_intervals_of_one_and_a_half_widths(
    monkeypatch: pytest.MonkeyPatch, widths: float, pieces: int
) -> None:
    used = []
    before = unrolled_module.SmoothCurve

    def noted(points: Array, number: int) -> Any:
        used.append(number)
        return before(points, number)

    monkeypatch.setattr(unrolled_module, "SmoothCurve", noted)
    beam = StatedBeam(np.array([50.0, 5.0]), math.pi / 2.0, 20.0, 20.0 * widths)
    picture = WorkingPicture(np.zeros((150, 100, 3), np.float32), np.zeros(2), 1.0, beam)
    count = 30
    y = 5.0 + np.linspace(0.0, 20.0 * widths, count)
    strip = Strip(
        np.column_stack([np.full(count, 50.0), y]), np.full(count, math.pi / 2.0), np.full(count, 20.0),
        np.ones(count), 20.0 * widths / (count - 1), 1.0, 0.0,
    )  # fmt: skip
    found = unrolled_module.unroll(picture, picture, strip)
    assert used == [pieces]
    assert found is not None
    assert found.along[0] == pytest.approx(0.0, abs=1e-9)
    assert np.diff(found.along) == pytest.approx(np.full(len(found.along) - 1, 1.0 / 12.0))
    assert found.along[-1] == pytest.approx(widths + 0.6, abs=1.0 / 12.0 + 1e-9)
    assert found.across[[0, -1]] == pytest.approx([-26.0 / 24.0, 26.0 / 24.0])
    assert found.stations_in_width == pytest.approx(12.0)
    four = replace(strip, place=strip.place[:4], width=strip.width[:4])
    assert unrolled_module.unroll(picture, picture, four) is None
    five = replace(strip, place=strip.place[:5], width=strip.width[:5])
    assert unrolled_module.unroll(picture, picture, five) is not None


def test_the_bins_of_colours_lie_between_the_two_hundredths() -> None:
    rng = np.random.default_rng(2)
    for channels, bins in ((1, 36), (3, 12)):
        colours = rng.uniform(20.0, 200.0, (40, 53, channels)).astype(np.float32)
        colours[0, 0], colours[0, 1] = 0.0, 255.0
        found = unrolled_module.UnrolledPicture(
            colours, *(np.zeros(0) for _ in range(6)), inside=np.ones((40, 53), bool)
        ).bins
        assert found.shape == (bins,) * channels
        assert found.total == bins**channels
        index = np.zeros((40, 53), int)
        for channel in range(channels):
            low, high = np.percentile(colours[..., channel], (0.5, 99.5))
            share = (colours[..., channel] - low) / (high - low)
            index = index * bins + np.clip(np.floor(share * bins), 0, bins - 1).astype(int)
        assert (found.index == index).mean() > 0.999
        assert (found.index.min(), found.index.max()) == (0, bins**channels - 1)
    flat = unrolled_module.UnrolledPicture(
        np.full((4, 5, 1), 7.0, np.float32), *(np.zeros(0) for _ in range(6)), inside=np.ones((4, 5), bool)
    )
    assert (flat.bins.index == 0).all()


@pytest.mark.parametrize(("off_px", "kept"), [(0.37, 80), (0.47, 79)])
def test_a_point_four_deviations_from_the_smooth_line_is_an_outlier(off_px: float, kept: int) -> None:
    # The points lie 0.1 / 1.4826 px on both sides of a line: the deviation is 0.1 px.
    x = np.linspace(0.0, 400.0, 80)
    y = 0.1 / 1.4826 * (-1.0) ** np.arange(80)
    y[41] = off_px
    points, sigma, inliers = estimate_scatter(np.column_stack([x, y]), np.ones(80))
    assert inliers.sum() == kept
    assert sigma.min() > 0.05
    assert points[:, 0].tolist() == x.tolist()


def test_few_points_are_never_outliers() -> None:
    x = np.linspace(0.0, 80.0, 8)
    y = 0.02 * (-1.0) ** np.arange(8)
    y[4] = 3.0
    assert estimate_scatter(np.column_stack([x, y]), np.ones(8))[2].all()


@pytest.mark.parametrize(("turn_deg", "is_corner"), [(29.0, False), (31.0, True)])
def test_a_corner_of_the_tip_turns_by_at_least_30_degrees(turn_deg: float, is_corner: bool) -> None:
    # The outline turns twice by the same angle, one width of 10 mm apart.
    directions = np.radians([0.0, turn_deg, 2.0 * turn_deg])
    lengths, place, points = (40.0, 10.0, 40.0), np.zeros(2), [np.zeros(2)]
    for direction, length in zip(directions, lengths, strict=True):
        for _ in range(int(length / 0.05)):
            place = place + 0.05 * np.array([math.cos(direction), math.sin(direction)])
            points.append(place)
    corners, turn = _tip_corners(np.array(points), 10.0)
    assert (corners is not None) is is_corner
    assert turn == (pytest.approx(turn_deg, abs=0.5) if is_corner else 0.0)


def test_a_click_may_be_up_to_99_widths_from_the_path() -> None:
    beam = StatedBeam(np.array([50.0, 0.0]), math.pi / 2.0, 10.0, 100.0)
    working = WorkingPicture(np.zeros((4, 4, 1), np.float32), np.zeros(2), 1.0, beam)
    strip: Any = SimpleNamespace(place=np.array([[50.0, 0.0], [50.0, 90.0]]))
    result = with_clicks(FollowedBeam({}, working, strip), np.array([[50.0 + 1005.0, 45.0]]), 10.0)
    assert result.findings["followed_click"] == 99.0
    result = with_clicks(FollowedBeam({}, working, strip), np.array([[50.0 + 995.0, 45.0]]), 10.0)
    assert result.findings["followed_click"] == pytest.approx(98.5)
    single: Any = SimpleNamespace(place=np.array([[50.0, 0.0]]))
    assert with_clicks(FollowedBeam({}, working, single), np.array([[50.0, 1.0]]), 10.0).findings == {
        "followed_click": 99.0
    }


def test_a_level_with_500_pixels_is_measured() -> None:
    # Two frames with three levels (the last two values share one): one level has 499 or 500 pixels.
    for few, levels in ((499, 2), (500, 3)):
        first = np.repeat([10.0, 50.0, 90.0, 130.0], [2000, few, 3000, 3000])
        half = np.where(np.arange(len(first)) % 2 == 0, 1.0, -1.0)
        noise = measure_noise([first - half, first + half])
        assert len(noise.levels) == levels
        assert noise.variances == pytest.approx(np.full(levels, 2.0))
    small = measure_noise([np.array([5.0, 4.0, 9.0]), np.array([5.0, 6.0, 9.0])])
    assert small.levels.tolist() == [5.0]
    assert small.variances.tolist() == [1.0]
    still = measure_noise([np.zeros(4), np.zeros(4)])
    assert still.variances.tolist() == [1.0 / 12.0]
    assert not still.exceeds_rounding
    assert Noise(np.zeros(1), np.array([0.084])).exceeds_rounding
    with pytest.raises(ValueError, match="at least two frames"):
        measure_noise([np.zeros(4)])


def test_the_noise_has_one_value_for_each_of_24_quantiles() -> None:
    rng = np.random.default_rng(5)
    light = rng.uniform(0.0, 200.0, 24_000)
    frames = [light + rng.normal(0.0, 1.0 + light / 100.0) for _ in range(5)]
    noise = measure_noise(frames)
    assert len(noise.levels) == 24
    mean = np.mean(frames, axis=0)
    assert noise.levels == pytest.approx(np.sort(mean).reshape(24, 1000).mean(axis=1), rel=1e-6)
    part = np.digitize(mean, np.quantile(mean, np.linspace(0, 1, 25))[1:-1])
    halves = [[((b - a) ** 2)[part == k].mean() / 2.0 for k in range(24)] for a, b in pairwise(frames)]
    assert noise.variances == pytest.approx(np.median(halves, axis=0), rel=1e-6)


def frames_of(images: list[Array], numbers: list[int]) -> list[Frame]:
    return [Frame(image, number, float(number)) for image, number in zip(images, numbers, strict=True)]


def names_of(flags: Any) -> dict[str, float]:
    return {flag.name: flag.value for flag in flags}


def test_missing_repeated_and_moving_frames_are_counted() -> None:
    rng = np.random.default_rng(3)
    light = np.tile(np.where(np.arange(120) < 60, 60.0, 180.0), (100, 1))

    def shot(shift: int = 0) -> Array:
        return np.clip(np.rint(np.roll(light, shift, axis=1) + rng.normal(0, 3.0, light.shape)), 0, 255).astype(
            np.uint8
        )

    still = [shot() for _ in range(5)]
    assert names_of(state_flags(frames_of(still, [3, 5, 7, 9, 11]), True)) == {}
    assert names_of(state_flags(frames_of(still, [3, 5, 7, 13, 15]), True)) == {"DROPPED": 2.0}
    repeated = [still[0], still[1], still[1], still[2], still[2]]
    assert names_of(state_flags(frames_of(repeated, [1, 2, 3, 4, 5]), False)) == {"DUPLICATE": 2.0}
    slow = [*still[:4], shot(2)]
    moved = names_of(state_flags(frames_of(slow, [1, 2, 3, 4, 5]), True))
    assert set(moved) == {"NOT_SETTLED"}
    assert names_of(state_flags(frames_of(slow, [1, 2, 3, 4, 5]), False)) == {}
    colour = [np.dstack([np.full_like(image, 90), image, np.full_like(image, 90)]) for image in slow]
    assert names_of(state_flags(frames_of(colour, [1, 2, 3, 4, 5]), True)) == pytest.approx(moved)
    assert state_flags(frames_of(still[:1], [1]), True) == ()


def test_a_ruled_picture_has_these_colours() -> None:
    image = np.full((60, 90), 100, np.uint8)
    image[0, 0] = 255
    line = np.array([[20.0, 12.0], [70.0, 12.0]])
    lower = np.array([[20.0, 33.0], [70.0, 33.0]])
    drawn = ruled_picture(image, [line], [lower])
    high, wide = 46 + 60 + 2 * 34 + 2 * 46, 46 + 90 + 46
    assert drawn.shape == (high, wide, 3)
    assert MARGIN_PX == 46
    assert tuple(drawn[46 + 55, 46 + 35]) == (100, 100, 100)
    assert tuple(drawn[46 + 12, 46 + 45]) == (255, 0, 255)
    assert tuple(drawn[46 + 33, 46 + 45]) == SUGGESTED == (0, 170, 0)
    assert tuple(drawn[46 + 40, 46 + 55]) == (int(60.0), int(60.0 + 0.4 * 200), int(60.0 + 0.4 * 255))
    assert tuple(drawn[46 + 55, 46 + 10]) == (60, 140, 162)
    assert tuple(drawn[-2, 3]) == (255, 255, 255)
    assert drawn[46:106, 46:136].min() >= 0
    assert (drawn == 0).all(axis=2).sum() > 50  # numbers and compass


def clicked(**changes: Any) -> Any:
    given = {
        "clamp_px": [[1000, 1400]],
        "tip_px": [2600, 1500],
        "ruler_px": [[1000, 600], [3000, 620]],
        "ruler_mm": 50.0,
    }
    bench = parsed(ClickedBench, {**given, "stand_off_mm": 160.0, **changes}, "", "clicks")
    return measure_bench(bench, (4000, 3000), 42.0, 6.0, None, date(2026, 3, 4))


def test_the_uncertainties_of_assumed_directions() -> None:
    upright = clicked(plumb="picture")
    assert upright.calibration.uncertainty["gravity_angle_deg"] == 1.5
    assert upright.sources["gravity_angle_deg"] == "the phone was upright (assumed to 1.5 degrees)"
    assert upright.calibration.uncertainty["axis_angle_deg"] == 0.5
    assert clicked(stand_off_mm=3000.0).calibration.uncertainty["stand_off_mm"] == 100.0  # 5 % would be 150 mm
    assert clicked(stand_off_mm=1900.0).calibration.uncertainty["stand_off_mm"] == 95.0


@pytest.mark.parametrize(("width", "is_same"), [(4000, True), (4035, True), (4045, False), (3965, True), (3955, False)])
def test_a_picture_whose_shape_differs_by_a_hundredth_was_cropped(tmp_path: Path, width: int, is_same: bool) -> None:
    exif = Image.Exif()
    table = {"FocalLengthIn35mmFilm": 26, "ExifImageWidth": width, "ExifImageHeight": 3000}
    exif.get_ifd(IFD.Exif).update({Base[name]: value for name, value in table.items()})
    Image.new("RGB", (400, 300)).save(tmp_path / "a.jpg", exif=exif)
    assert (focal_length(tmp_path / "a.jpg", (400, 300)) is not None) is is_same


def test_the_rod_of_a_moving_beam_comes_from_a_coarse_solid(monkeypatch: pytest.MonkeyPatch) -> None:
    meshes = []

    def noted(specimen: Any, law: str, values: Any, mesh: Any) -> Stiffness:
        meshes.append(mesh)
        return Stiffness(0.0296, math.inf, 1.0e-6, -2.5)

    monkeypatch.setattr(virtual_beam, "stiffness_of_solid", noted)
    shipped = load_rig("virtual").virtual
    assert shipped is not None
    material = shipped.materials.silicone["Dragon Skin 10"]
    solid = Specimen(30.0, 2.0, 5.0, 1500.0, section="solid", magnetisation_A_per_m=(20e3, 5e3))
    for mesh in ((40, 5, 3), (6, 1, 1), (16, 2, 1)):
        moving = VirtualBeam(solid, material, mesh, VirtualLoads(90.0, 80.0), 6.0).moving()
        assert isinstance(moving, MovingBeam)
    assert meshes == [(16, 2, 1), (6, 1, 1), (16, 2, 1)]


def test_the_steps_of_a_beam_at_rest_grow_to_5_s() -> None:
    magnetised = Specimen(30.0, 2.0, 5.0, 1500.0, section="plane-stress", magnetisation_A_per_m=(20e3, 5e3))
    moving = MovingBeam(
        magnetised,
        Stiffness(0.0296, math.inf, 1.0e-6, -2.5),
        50e3,
        None,
        lambda field_mT: (np.array([1e-3, 1e-3 * field_mT]), np.array([9.8, 0.5])),
        0.2,
    )
    moving.start(0.0, 1.0)
    assert moving._step_s == 2e-3
    moving.advance(200.0, lambda _: 1.0)
    assert moving._step_s == 5.0
    assert moving.time_s == 200.0


def test_the_frame_of_the_beam_has_both_hands() -> None:
    # The field points to the right of the axis (hand -1), or to its left (hand +1).
    for field_deg, hand in ((0.0, -1.0), (180.0, 1.0)):
        frame = BeamFrame(CALIBRATION.model_copy(update={"field_angle_deg": field_deg}))
        assert frame.hand == hand
        assert frame.to_px([[2.0, 1.0]])[0] == pytest.approx([60.0 - 7.0 * hand, 24.0])
