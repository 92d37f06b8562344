"""Intermediate results of the search that follows a beam agree with the drawn pictures."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from eimi_lab.config.calibration import Picture
from eimi_lab.vision.check import Severity
from eimi_lab.vision.edges.finding import find_edges, follow_beam
from eimi_lab.vision.edges.region import region_of
from eimi_lab.vision.flags import judge
from eimi_lab.vision.following import follow as follow_module
from eimi_lab.vision.following.colour_seams import find_colour_seams
from eimi_lab.vision.following.edge_points import estimate_scatter
from eimi_lab.vision.following.in_picture import in_255
from eimi_lab.vision.following.stated import StatedBeam
from eimi_lab.vision.following.stated_width import prefer_stated_width
from eimi_lab.vision.following.support import find_sides
from eimi_lab.vision.following.unrolled import UnrolledPicture
from eimi_lab.vision.following.working import working_picture
from eimi_lab.vision.projection import Projection, choose_projection
from tests.shared.photographs import CALIBRATION, SPECIMEN, photograph
from tests.shared.rendered_edges import errors_px

Array = np.ndarray
COLOURS = np.array([[40.0, 50.0, 170.0], [150.0, 160.0, 130.0]])  # colours of a beam and of its background


def plain(angle_deg: float = 0.0, colours: Array = COLOURS, seed: int = 2) -> Array:
    return photograph("shadow beside", np.random.default_rng(seed), angle_deg, colours).image


def calibration_with(**help_given: object) -> object:
    return CALIBRATION.model_copy(update={"picture": Picture(**help_given)})


def scattered(along: Array, seed: int) -> Array:
    # Return n points of a wavy edge with a scatter of 0.5 px: (x, y) in px, shape (n, 2).
    # along: the n positions along the edge in px.
    rng = np.random.default_rng(seed)
    return np.column_stack([along, 25.0 * np.sin(along / 140.0) + 0.5 * rng.standard_normal(len(along))])


@pytest.mark.parametrize("few_of", [0.3, 0.0])
def test_the_shape_of_an_edge_does_not_count_as_scatter_where_points_are_few(few_of: float) -> None:
    # few_of: the part of the edge that has few points, as a share of the length.
    along = np.linspace(0.0, 1000.0, 120)
    along = along[(along > few_of * 1000.0) | (np.arange(120) % 10 == 0)]
    stated = [np.median(estimate_scatter(scattered(along, seed), np.ones(len(along)))[1]) for seed in range(12)]
    assert np.mean(stated) == pytest.approx(0.5, rel=0.12)


def test_points_of_another_body_are_left_out_and_do_not_add_scatter() -> None:
    along = np.linspace(0.0, 1000.0, 100)
    points = scattered(along, 1)
    points[40:44, 1] += 8.0
    _, sigma, kept = estimate_scatter(points, np.ones(100))
    assert not kept[40:44].any()
    assert kept.sum() > 90
    assert np.median(sigma) == pytest.approx(0.5, rel=0.25)


def test_a_point_that_is_more_sensitive_to_noise_has_a_larger_deviation() -> None:
    along = np.linspace(0.0, 1000.0, 100)
    _, sigma, _ = estimate_scatter(scattered(along, 2), np.where(along < 500.0, 1.0, 2.0))
    assert np.median(sigma[:50]) * 1.9 < np.median(sigma[50:]) < np.median(sigma[:50]) * 2.1


def test_positions_are_converted_between_the_scaled_picture_and_the_image() -> None:
    image = np.zeros((300, 400, 1), np.float32)
    y, x = np.mgrid[:300, :400]
    image[..., 0] = 200.0 * np.exp(-0.5 * ((x - 211.0) ** 2 + (y - 143.0) ** 2) / 6.0**2)
    for width_px in (4.0, 8.0):
        working = working_picture(image, StatedBeam(np.array([200.0, 120.0]), 0.0, width_px, 60.0), 16.0)
        assert working is not None
        rows, columns = np.mgrid[: working.pixels.shape[0], : working.pixels.shape[1]]
        light = working.pixels[..., 0] / working.pixels[..., 0].sum()
        middle = np.array([(light * columns).sum(), (light * rows).sum()])
        assert working.to_picture(middle) == pytest.approx([211.0, 143.0], abs=0.1)
        assert working.from_picture(np.array([211.0, 143.0])) == pytest.approx(middle, abs=0.1 * working.factor)


def sampled(colours: Array, turn_rad: float = 0.0) -> UnrolledPicture:
    # Return a noisy picture of a beam, as grey values at places along the beam and 53 points across it.
    # colours: grey values without noise, (n, 53). turn_rad: curvature of the beam times its width.
    stations = len(colours)
    along = np.arange(stations) / 12.0
    angle = turn_rad * along
    middle = 24.0 / 12.0 * np.cumsum(np.column_stack([np.cos(angle), np.sin(angle)]), axis=0)
    noise = np.random.default_rng(1).normal(0.0, 2.0, colours.shape)
    return UnrolledPicture(
        colours=(colours + noise).astype(np.float32)[..., None],
        across=np.arange(-26, 27) / 24.0,
        along=along,
        middle=middle,
        aside=24.0 * np.column_stack([-np.sin(angle), np.cos(angle)]),
        width=np.ones(stations),
        stated=np.ones(stations),
        inside=np.ones(colours.shape, dtype=bool),
    )


def bright_beam(stations: int) -> Array:
    # Return the grey values, (stations, 53), of a bright beam (200) on a dark background (50).
    return np.tile(np.where(np.abs(np.arange(-26, 27)) < 12, 200.0, 50.0), (stations, 1))


def test_a_long_edge_with_many_gaps_is_joined_with_one_direction_for_each_run(monkeypatch: pytest.MonkeyPatch) -> None:
    # If the direction were measured for each pair of pieces, an edge with 40 gaps would take long.
    measured_directions = []

    def svd(*arguments: object, **options: object) -> object:
        measured_directions.append(arguments)
        return decompose(*arguments, **options)

    decompose = np.linalg.svd
    monkeypatch.setattr(np.linalg, "svd", svd)
    colours = bright_beam(16 * 40 + 10)
    colours[np.arange(len(colours)) % 16 >= 10, :20] = 50.0  # 40 notches in the left edge
    sides = find_sides(sampled(colours), 2.0, 54.0)
    runs = int((np.diff(sides.sound[0].astype(int)) > 0).sum())
    assert runs >= 35
    assert len(measured_directions) <= 2 * 41
    left = sides.edge[0][sides.sound[0]]
    assert np.abs(left + 0.5).max() < 0.1


def test_an_edge_of_a_bent_beam_continues_behind_a_stain_beside_which_the_other_edge_is_sure() -> None:
    # The stain has the colour of the background, and hides the left edge along two widths of the beam.
    stained = bright_beam(120)
    stained[48:72, :21] = 50.0
    wider = stained.copy()
    wider[72:, 8:14] = 200.0
    for colours, turn_rad, behind in ((stained, 0.35, True), (stained, -0.35, True), (wider, 0.35, False)):
        sides = find_sides(sampled(colours, turn_rad), 2.0, 10.0)
        assert sides.sound[1][:100].all()
        assert not sides.sound[0][52:68].any()
        assert sides.sound[0][6:44].all()
        assert bool(sides.sound[0][80:112].all()) is behind


@pytest.mark.parametrize(("region", "moved"), [(130.0, True), (230.0, False)])
def test_the_stated_width_tells_an_edge_from_the_border_of_a_shadow_in_grey(region: float, moved: bool) -> None:
    # A region beside the beam that is brighter than the background is no shadow.
    colours = 250.0 - bright_beam(120)
    colours[:, 38:47] = region
    unrolled = sampled(colours)
    border = np.outer([-0.5, 0.88], np.ones(120))
    seams = find_colour_seams(unrolled, border, 2.0, (0.1,))
    assert np.median(seams.edge[1]) == pytest.approx(0.86, abs=0.04)
    found = prefer_stated_width(unrolled, seams, 2.0, 120)
    assert np.median(found.edge[1]) == pytest.approx(0.48 if moved else 0.86, abs=0.04)
    assert np.median(found.shadow[1]) == pytest.approx(0.38 if moved else 0.0, abs=0.04)
    assert np.median(found.edge[0]) == pytest.approx(-0.48, abs=0.04)


def test_a_picture_of_a_narrow_beam_is_not_enlarged_to_find_its_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    factors = []

    def working(*arguments: object) -> object:
        result = working_picture(*arguments)
        factors.append(result.factor)
        return result

    monkeypatch.setattr(follow_module, "working_picture", working)
    for width_mm, fine in ((3.0, 24.0 / 42.0), (1.0, 1.0)):
        thin = SPECIMEN.model_copy(update={"specimen": SPECIMEN.specimen.model_copy(update={"width_mm": width_mm})})
        image = np.full((720, 960), 200.0, np.float32)
        image[91:511, round(480 - 7 * width_mm) : round(480 + 7 * width_mm)] = 60.0
        followed = follow_beam(cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.uint8), CALIBRATION, thin)
        assert followed.edges is not None
        assert factors[-1] == pytest.approx(fine)


def test_blur_moves_neither_edge_of_a_bent_beam() -> None:
    # Without a correction, the blur of 6 px would move one edge outward and the other edge inward by 0.08 px.
    photo = photograph("uneven light", np.random.default_rng(3), 110.0, COLOURS)
    blurred = cv2.GaussianBlur(photo.image, (0, 0), 6.0)
    left, right = errors_px(find_edges(blurred, CALIBRATION, SPECIMEN), photo.beam, CALIBRATION)
    assert abs(left.mean() - right.mean()) < 0.1


@pytest.mark.parametrize("polarity", ["dark", "bright"])
def test_the_beam_of_the_given_polarity_is_followed(polarity: str) -> None:
    # A dark and a bright stripe are at equal distances from the clamp.
    image = np.full((720, 960), 120.0)
    image[90:510, 432:474] = 50.0
    image[90:510, 486:528] = 190.0
    image = cv2.GaussianBlur(image, (0, 0), 1.0) + np.random.default_rng(1).normal(0.0, 2.0, image.shape)
    followed = follow_beam(image.astype(np.uint8), calibration_with(polarity=polarity), SPECIMEN)
    assert (np.median(followed.path_px[:, 0]) > 480.0) == (polarity == "bright")


def test_an_earlier_state_does_not_outweigh_the_picture() -> None:
    # The stripe that was the beam has become too short; a longer one begins beside the clamp, too.

    def two(left_px: int, right_px: int) -> Array:
        image = np.full((720, 960, 3), 120.0)
        image[90 : 90 + left_px, 435:477] = (40.0, 60.0, 200.0)
        image[90 : 90 + right_px, 483:525] = (200.0, 170.0, 40.0)
        image = cv2.GaussianBlur(image, (0, 0), 0.8) + np.random.default_rng(1).normal(0.0, 2.0, image.shape)
        return np.clip(image, 0, 255).astype(np.uint8)

    before = find_edges(two(420, 0), CALIBRATION, SPECIMEN)
    edges_now = find_edges(two(390, 420), CALIBRATION, SPECIMEN, earlier=lambda: before)
    assert np.median(before.middle_mm[:, 1]) * np.median(edges_now.middle_mm[:, 1]) < 0.0


def test_pictures_of_other_bit_depths_are_scaled_to_the_same_values() -> None:
    image = plain(20.0)
    for scale, dtype in ((257, np.uint16), (16, np.uint16), (1, np.float32)):
        deep = (image.astype(np.float64) * scale).astype(dtype)
        if scale == 16:
            deep[0, 0] = 4095  # a picture of twelve bits
        assert np.abs(in_255(deep) - image)[1:].max() < 1.0  # the rounding of 12 bits, in grey levels from 0 to 255


def test_light_clipped_at_one_edge_is_measured() -> None:
    image = plain()
    beam = follow_beam(image, CALIBRATION, SPECIMEN)
    image[:, 510:] = 255
    clipped = follow_beam(image, CALIBRATION, SPECIMEN)
    assert beam.findings["followed_clipped"] < 0.05
    assert clipped.findings["followed_clipped"] > 0.8


def test_the_contrast_of_the_fainter_edge_is_reported() -> None:
    # The background on the right resembles the beam.
    image = plain(colours=np.array([[90.0, 90.0, 90.0], [190.0, 190.0, 190.0]]))
    even = follow_beam(image, CALIBRATION, SPECIMEN).findings["followed_contrast"]
    image[95:, 502:] = np.clip(image[95:, 502:].astype(int) - 60, 0, 255)
    assert follow_beam(image, CALIBRATION, SPECIMEN).findings["followed_contrast"] < 0.85 * even


def test_a_body_longer_than_the_given_length_is_doubtful() -> None:
    short = SPECIMEN.model_copy(update={"specimen": SPECIMEN.specimen.model_copy(update={"length_mm": 21.0})})
    names = {flag.name: flag.severity for flag in find_edges(plain(10.0), CALIBRATION, short).flags}
    assert names.get("LENGTH_ANOMALY") is Severity.DOUBTFUL


def test_each_named_channel_has_its_own_colour() -> None:
    image = np.zeros((8, 8, 3), np.uint8)
    image[:] = (10, 100, 200)  # blue, green, red
    for name, value in (("blue", 10), ("green", 100), ("red", 200)):
        chosen = choose_projection([image], calibration_with(channel=name), 3.0, 30.0)
        assert chosen.apply(image) == pytest.approx(value, abs=0.01)


def test_the_given_colour_of_a_beam_is_in_the_order_red_green_blue() -> None:
    # In the grey picture for this colour, a red beam is brighter than its grey background.
    image = plain()
    values = choose_projection([image], calibration_with(beam_colour=(170, 50, 40)), 3.0, 30.0).apply(image)
    assert float(values[300, 480]) > float(np.median(values)) + 40.0
    wrong = choose_projection([image], calibration_with(beam_colour=(40, 50, 170)), 3.0, 30.0)
    assert wrong.weights != choose_projection([image], calibration_with(beam_colour=(170, 50, 40)), 3.0, 30.0).weights


def test_the_beam_is_followed_in_the_given_channel() -> None:
    # The beam differs from its background only in blue.
    image = plain(colours=np.array([[40.0, 120.0, 120.0], [200.0, 120.0, 120.0]]))
    for channel, is_found in (("blue", True), ("red", False)):
        calibration = calibration_with(channel=channel)
        projection = choose_projection([image], calibration, 3.0, 30.0)
        followed = follow_beam(image, calibration, SPECIMEN, projection=projection)
        assert (followed.findings.get("followed_contrast", 0.0) > 6.0) is is_found


def test_edges_in_a_region_equal_the_edges_in_the_whole_picture() -> None:
    image = plain(15.0)
    matrix = ((2000.0, 0.0, 470.0), (0.0, 2000.0, 350.0), (0.0, 0.0, 1.0))
    calibration = calibration_with(region_px=(240, 20, 480, 600)).model_copy(
        update={"camera_matrix": matrix, "distortion": (0.05, 0.0, 0.0, 0.0, 0.0)}
    )
    region = region_of(calibration, image.shape)
    assert region is not None
    whole = find_edges(image, calibration.model_copy(update={"picture": None}), SPECIMEN)
    part = region.in_picture(find_edges(region.cut(image), region.calibration, SPECIMEN))
    assert len(part.left.points_mm) > 20
    for of_whole, of_part in ((whole.left, part.left), (whole.right, part.right)):
        aside = (
            np.interp(of_part.points_mm[:, 0], of_whole.points_mm[:, 0], of_whole.points_mm[:, 1])
            - of_part.points_mm[:, 1]
        )
        assert float(np.median(np.abs(aside))) < 0.01


def test_corners_found_in_a_region_are_in_pixels_of_the_whole_picture() -> None:
    image = np.full((720, 960), 200.0)
    image[91:511, 459:501] = image[:91, 300:660] = 30.0
    image = cv2.GaussianBlur(image, (0, 0), 1.0) + np.random.default_rng(3).normal(0.0, 2.0, image.shape)
    region = region_of(calibration_with(region_px=(240, 20, 480, 600)), image.shape)
    assert region is not None
    corners = region.in_picture(find_edges(region.cut(image), region.calibration, SPECIMEN)).corners_px
    assert sorted(map(tuple, corners.tolist())) == [
        pytest.approx(corner, abs=0.3) for corner in ((458.5, 90.5), (458.5, 510.5), (500.5, 90.5), (500.5, 510.5))
    ]


def shadowed(softness_px: float) -> Array:
    # Return a grey picture of a beam with the border of a shadow 6 px to its right, blurred by `softness_px`.
    image = np.full((720, 960), 200.0)
    image[95:516, 459:507] = 90.0
    image = cv2.GaussianBlur(image, (0, 0), softness_px)
    image[:91, 300:660] = 120.0
    image[91:511, 459:501] = 60.0
    image = cv2.GaussianBlur(image, (0, 0), 1.0) + np.random.default_rng(3).normal(0.0, 2.0, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def test_an_edge_that_may_be_the_border_of_a_shadow_is_doubtful_by_its_blur() -> None:
    # The flag of this doubt adds a standard deviation of at least the blur to the points.
    alone = find_edges(plain(colours=np.array([[60.0] * 3, [200.0] * 3]), seed=4)[..., 0].copy(), CALIBRATION, SPECIMEN)
    assert "OWN_SHADOW" not in {flag.name for flag in alone.flags}
    for softness_px in (2.0, 4.0):
        followed = follow_beam(shadowed(softness_px), CALIBRATION, SPECIMEN)
        assert followed.edges is not None
        blurs = sorted(edge.blur_px for edge in followed.edges)
        assert blurs[1] > 1.25 * blurs[0]
        assert followed.findings["followed_penumbra"] >= 0.999 * blurs[1]


@pytest.mark.parametrize(
    ("finding", "doubtful", "grave"),
    [
        ("contrast", 0.1, 0.02),
        ("blur_px", 3.0, 9.0),
        ("residual", 0.05, 0.2),
        ("width_deviation", 0.08, 0.2),
        ("twist_deg", 3.0, 12.0),
        ("length_deviation", 0.15, 0.3),
        ("corner_turn_deg", 30.0, 5.0),
        ("followed_patches", 0.5, 0.3),
        ("followed_width", 0.15, 0.3),
        ("settling_ratio", 3.0, 40.0),
        ("motion_ratio", 3.0, 40.0),
    ],
)
def test_a_state_is_unusable_beyond_the_second_limit(finding: str, doubtful: float, grave: float) -> None:
    words = {"even_turn": "", "twist_effect": ""}
    (used,), (left_out,) = judge({finding: doubtful}, words=words), judge({finding: grave}, words=words)
    assert used.severity is not Severity.UNUSABLE
    assert left_out.severity is Severity.UNUSABLE
    assert left_out.widens == 0.0


def test_a_projection_keeps_the_scale_of_the_camera() -> None:
    rng = np.random.default_rng(5)
    image = rng.integers(0, 4096, (20, 30, 3)).astype(np.uint16)
    image[0, 0] = 4095
    for weights in ((0.2, 0.5, 0.3), (-1.0, 0.5, 1.5)):
        grey = Projection("drawn", weights).apply(image)
        assert grey.min() >= 0.0
        assert grey.max() <= 4095.0
        low = sum(weight for weight in weights if weight < 0.0)
        size = sum(abs(weight) for weight in weights)
        assert grey == pytest.approx((image @ np.array(weights) - 4095.0 * low) / size, abs=1.0)


def findings_of(
    unsure: float = 0.0, gain: float = 0.8, deviations: float = 10.0, length: float = 1.0
) -> dict[str, float]:
    # Return the findings (values for the quality checks) of a straight beam with edges at 200 places.
    # unsure: share of the places at which the left edge is not reliable. gain: clarity of the edges (0 to 1).
    # deviations: contrast of the left edge, in standard deviations. length: share of the nominal length that is
    # followed.
    sound = np.ones((2, 200), dtype=bool)
    sound[0, 100 : 100 + round(200 * unsure)] = False
    sides = SimpleNamespace(
        sound=sound,
        width=np.full(200, 1.1),
        end=200,
        projected=[SimpleNamespace(separation=np.full(200, more)) for more in (deviations, deviations + 5.0)],
    )
    along = length * 10.0 * np.arange(1, 201) / 200  # in widths of the beam
    middle = np.column_stack([np.full(200, 150.0), 50.0 + 20.0 * along])
    unrolled = SimpleNamespace(along=along, middle=middle, stated=np.ones(200))
    strip = SimpleNamespace(gain=np.full(200, gain), rival=0.3)
    beam = SimpleNamespace(width_px=20.0, length_px=200.0)
    return follow_module._findings(beam, strip, unrolled, sides, (300, 400))


@pytest.mark.parametrize(
    ("picture", "is_clear", "is_faint"),
    [
        ({}, True, True),
        ({"unsure": 0.05}, True, True),
        ({"unsure": 0.15}, False, False),
        ({"gain": 0.55}, True, True),
        ({"gain": 0.45}, False, True),
        ({"deviations": 6.5}, True, True),
        ({"deviations": 5.5}, False, True),
        ({"length": 0.85}, True, True),
        ({"length": 0.75}, True, False),
    ],
)
def test_only_a_clear_and_whole_beam_is_judged_by_the_limits_of_clear_pictures(
    picture: dict[str, float], is_clear: bool, is_faint: bool
) -> None:
    findings = findings_of(**picture)
    length = picture.get("length", 1.0)
    assert findings["followed_stretch" if is_clear else "followed_length"] == pytest.approx(length)
    assert findings["followed_faint" if is_faint else "followed_gain"] == pytest.approx(picture.get("gain", 0.8))
    assert findings["followed_late" if is_clear else "followed_begin"] == 0.0
    assert len({"followed_stretch", "followed_length", "followed_faint", "followed_gain"} & findings.keys()) == 2
    assert findings["followed_contrast"] == picture.get("deviations", 10.0)
    assert findings["followed_width"] == pytest.approx(np.log(1.1))
    assert (findings["followed_change"], findings["followed_narrowing"], findings["followed_rival"]) == (0.0, 0.0, 0.3)
    assert findings["followed_out"] == 0.0


def test_a_beam_is_late_and_leaves_the_picture_by_what_is_missing_at_its_ends() -> None:
    assert findings_of(length=1.75)["followed_out"] == 1.0  # the last place is 400 px below the upper border
    sound = np.zeros((2, 200), dtype=bool)
    assert follow_module._findings(None, None, None, SimpleNamespace(sound=sound), (300, 400)) == {
        "followed_length": 0.0
    }
