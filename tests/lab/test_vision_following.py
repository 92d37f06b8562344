"""Beams are followed from their clamp in rendered photographs and in photographs of other laboratories."""

import cv2
import numpy as np
import pytest

from eimi_lab.config.calibration import load_calibration
from eimi_lab.config.size_along import SizeAlong
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset import segmentation
from eimi_lab.dataset.neighbouring_states import search_beside_neighbours
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.virtual.raster import coverage
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Severity
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from eimi_lab.vision.edges.finding import find_edges, follow_beam
from eimi_lab.vision.edges.overlay import FLAG_COLOUR, STATED_COLOUR, draw_overlay
from eimi_lab.vision.flags import judge
from eimi_lab.vision.following.centre_line import clicked_line, line_between
from eimi_lab.vision.following.edge_points import StripEdges
from eimi_lab.vision.following.ends import trim_ends
from eimi_lab.vision.following.explaining import draw_steps
from eimi_lab.vision.following.support import sure_share
from tests.shared import lab_photographs, photographs, real_pictures
from tests.shared.flag_pictures import CASES
from tests.shared.photographs import CALIBRATION, KINDS, SIZE, SPECIMEN, measured, photograph

DEVELOPMENT = list(real_pictures.pictures("development"))
REFUSAL = list(real_pictures.pictures("refusal"))

pictures_at_hand = pytest.mark.skipif(not DEVELOPMENT, reason="../shared/data/pictures does not exist")


def severities(edges):
    return {flag.severity for flag in edges.flags}


@pytest.mark.parametrize("kind", KINDS)
def test_a_coloured_beam_on_clutter_is_followed(kind):
    for seed in (0, 1):
        photo = photograph(kind, np.random.default_rng([7, seed]))
        edges = find_edges(photo.image, CALIBRATION, SPECIMEN)
        outcome = measured(photo, edges, 0.0)
        assert outcome.usable
        assert outcome.rms_px < 0.3
        assert outcome.coverage > 0.6


@pytest.mark.parametrize(
    "seed", [(5, 24), (11, 22)]
)  # the border of the shadow lies at least 4 px from the edge of the beam
def test_the_border_of_a_shadow_is_avoided_in_colour_and_doubtful_in_grey(seed):
    photo = photograph("own shadow", np.random.default_rng(seed))
    edges = find_edges(photo.image, CALIBRATION, SPECIMEN)
    outcome = measured(photo, edges, 0.0)
    assert outcome.usable
    assert outcome.rms_px < 0.3
    assert [flag.severity for flag in edges.flags if flag.name == "OWN_SHADOW"] == [Severity.DOUBTFUL]
    grey = find_edges(cv2.cvtColor(photo.image, cv2.COLOR_BGR2GRAY), CALIBRATION, SPECIMEN)
    outcome_in_grey = measured(photo, grey, 0.0)
    assert not outcome_in_grey.usable or (
        outcome_in_grey.rms_px > 1.0 and outcome_in_grey.doubtful
    )  # grey values do not distinguish beam and shadow


def on_its_shadow(widest: float, blur_px: float, tint: float):
    # Draw a yellow beam that hangs in front of a grey wall, with its shadow on its right.
    # widest: largest width of the shadow, in widths of the beam. blur_px: standard deviation. tint: share of the beam's
    # colour in the shadow.
    y, x = np.mgrid[0:280, 0:220].astype(float)
    wall, beam = np.array([152.0, 161.0, 167.0]), np.array([32.0, 89.0, 107.0])
    along = (y - 20.0) / 210.0
    behind = (x > 100.0) & (x < 110.5 + 21.0 * widest * np.clip(along, 0.0, 1.0)) & (along > 0.0) & (along < 1.0)
    image = np.where(behind[..., None], 0.35 * wall + tint * beam, wall)
    lit = 1.1 - 0.66 * np.clip((x - 100.0) / 10.5, 0.0, 1.0)[..., None] ** 2
    shows = (np.abs(x - 100.0) < 10.5) & (along > 0.0) & (along < 1.0)
    image = cv2.GaussianBlur(np.where(shows[..., None], beam * lit, image), (0, 0), blur_px)
    return np.clip(image + np.random.default_rng(0).normal(0.0, 1.5, image.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("shadow", [(0.5, 2.0, 0.25), (0.7, 2.0, 0.15), (0.7, 2.5, 0.15)])
def test_a_blurred_beam_is_followed_beside_a_shadow_that_has_a_tint_of_its_colour(shadow):
    # The edge beside the shadow is marked as doubtful.
    calibration = CALIBRATION.model_copy(update={"clamp_midpoint_px": (100.0, 20.0), "pixels_per_mm": 7.0})
    edges = find_edges(on_its_shadow(*shadow), calibration, SPECIMEN)
    assert {flag.severity for flag in edges.flags if flag.name == "OWN_SHADOW"} == {Severity.DOUBTFUL}
    assert Severity.UNUSABLE not in severities(edges)
    for edge, most_px in ((edges.left, 0.2), (edges.right, 2.2)):
        x, y = BeamFrame(calibration).to_px(edge.points_mm).T
        assert np.median(y) > 100.0
        assert y.max() > 200.0
        assert np.percentile(np.abs(np.abs(x - 100.0) - 10.5), 95) < most_px


def test_a_layer_of_another_hue_beside_the_beam_is_not_taken_for_its_shadow():
    # The layer is the brown side face of a beam that is cut from a green board.
    y, x = np.mgrid[0:280, 0:220].astype(float)
    image = np.full((280, 220, 3), 245.0)
    along = (y > 20.0) & (y < 230.0)
    image[along & (np.abs(x - 100.0) < 10.5)] = (125.0, 214.0, 171.0)
    image[along & (x > 106.5) & (x < 110.5)] = (100.0, 150.0, 190.0)
    image = cv2.GaussianBlur(image, (0, 0), 1.0) + np.random.default_rng(0).normal(0.0, 1.5, image.shape)
    calibration = CALIBRATION.model_copy(update={"clamp_midpoint_px": (100.0, 20.0), "pixels_per_mm": 7.0})
    edges = find_edges(np.clip(image, 0, 255).astype(np.uint8), calibration, SPECIMEN)
    x, _ = BeamFrame(calibration).to_px(edges.right.points_mm).T
    assert np.abs(x - 110.5).max() < 1.0


def test_an_inflated_beam_is_followed_if_the_specimen_file_gives_its_width_along_the_beam():
    # The beam is bent, and 1.6 times as wide in its middle as at its ends.
    y, x = np.mgrid[0:480, 0:360].astype(float)
    arc = (y - 40.0) / 400.0
    middle, factor = 160.0 + 60.0 * arc**2, 1.0 + 0.6 * np.exp(-0.5 * ((arc - 0.5) / 0.15) ** 2)
    aside = (x - middle) / np.sqrt(1.0 + (120.0 * arc / 400.0) ** 2)
    rng = np.random.default_rng(3)
    clutter = cv2.resize(rng.uniform(60.0, 190.0, (12, 9, 3)), (360, 480), interpolation=cv2.INTER_CUBIC)
    image = np.where(((np.abs(aside) < 15.0 * factor) & (arc > 0.0) & (arc < 1.0))[..., None], (70, 90, 215), clutter)
    image = cv2.GaussianBlur(image, (0, 0), 1.0) + rng.normal(0.0, 2.0, image.shape)
    calibration = CALIBRATION.model_copy(update={"clamp_midpoint_px": (160.0, 40.0), "pixels_per_mm": 10.0})
    share = np.linspace(0.0, 1.0, 11)
    widths = 3.0 * (1.0 + 0.6 * np.exp(-0.5 * ((share - 0.5) / 0.15) ** 2))
    rows = tuple(zip((40.7 * share).tolist(), widths.tolist(), strict=True))
    size = {"length_mm": 40.7, "width_mm": SizeAlong(rows)}
    stated = SPECIMEN.model_copy(update={"specimen": SPECIMEN.specimen.model_copy(update=size)})
    edges = find_edges(np.clip(image, 0, 255).astype(np.uint8), calibration, stated)
    assert not severities(edges) & {Severity.DOUBTFUL, Severity.UNUSABLE}
    for edge in (edges.left, edges.right):
        px, py = BeamFrame(calibration).to_px(edge.points_mm).T
        arc = (py - 40.0) / 400.0
        aside = (px - 160.0 - 60.0 * arc**2) / np.sqrt(1.0 + (120.0 * arc / 400.0) ** 2)
        off = np.abs(aside) - 15.0 * (1.0 + 0.6 * np.exp(-0.5 * ((arc - 0.5) / 0.15) ** 2))
        assert np.ptp(py) > 350.0
        assert np.sqrt(np.mean(off**2)) < 0.4
    mean = stated.specimen.model_copy(update={"width_mm": float(np.mean(widths))})
    alone = find_edges(
        np.clip(image, 0, 255).astype(np.uint8), calibration, stated.model_copy(update={"specimen": mean})
    )
    assert severities(alone) & {Severity.DOUBTFUL, Severity.UNUSABLE}


@pytest.mark.parametrize(("contrast", "points"), [(14.0, 80), (18.0, 80)])
def test_a_cable_that_crosses_a_faint_beam_does_not_hide_the_edges_beside_the_crossing(contrast, points):
    # The cable is a third as wide as the beam, and crosses it obliquely at the middle of its length.
    y, x = np.mgrid[0:460, 0:300].astype(float)
    image = np.full((460, 300, 3), (190.0, 185.0, 180.0))
    image[(np.abs(x - 150.0) < 21.0) & (y > 20.0) & (y < 440.0)] -= contrast * np.array([0.5, 0.7, 1.0])
    image[np.abs((y - 220.0) * np.cos(0.4) - (x - 150.0) * np.sin(0.4)) < 7.0] = (20.0, 25.0, 30.0)
    image = cv2.GaussianBlur(image, (0, 0), 1.0) + np.random.default_rng(0).normal(0.0, 1.5, image.shape)
    calibration = CALIBRATION.model_copy(update={"clamp_midpoint_px": (150.0, 20.0)})
    edges = find_edges(np.clip(image, 0, 255).astype(np.uint8), calibration, SPECIMEN)
    assert Severity.UNUSABLE not in severities(edges)
    for edge in (edges.left, edges.right):
        px, py = BeamFrame(calibration).to_px(edge.points_mm).T
        assert len(px) > points
        assert py.min() < 50.0
        assert py.max() > 400.0
        assert np.abs(np.abs(px - 150.0) - 21.0).max() < 1.0


def test_points_where_a_shadow_replaces_the_edge_are_left_out():
    along = np.linspace(0.0, 10.0, 100)
    aside = np.where(along > 9.5, 0.2 * (along - 9.5), 0.0)
    sigma = np.full(100, 0.1)
    left = StripEdges(np.column_stack([-20.0 * np.ones(100), 40.0 * along]), sigma, along, 1.0)
    right = StripEdges(np.column_stack([20.0 + 40.0 * aside, 40.0 * along]), sigma, along, 1.0)
    for side in trim_ends(left, right, 40.0):
        assert side.along[0] == 0.0
        assert 9.4 < side.along[-1] < 9.8
        assert len(side.points) == len(side.sigma) == len(side.along)


def test_a_clipped_reflection_on_an_edge_is_flagged():
    photo = photograph(
        "uneven light", np.random.default_rng(2), 0.0, np.array([[40.0, 60.0, 160.0], [90.0, 120.0, 90.0]])
    )
    x, y = np.rint(BeamFrame(CALIBRATION).to_px([[10.0, 1.2], [18.0, 1.5]])).astype(int).T
    shining = photo.image.copy()
    shining[y.min() : y.max(), x.min() : x.max()] = 255
    names = [[flag.name for flag in find_edges(image, CALIBRATION, SPECIMEN).flags] for image in (photo.image, shining)]
    assert "HOLE_OR_REFLECTION" not in names[0]
    assert "HOLE_OR_REFLECTION" in names[1]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_coloured_tape_near_the_clamp_does_not_hide_the_rest_of_the_beam(seed):
    colours = np.array([[110.0, 120.0, 100.0], [175.0, 180.0, 170.0]])
    photo = photograph("clutter", np.random.default_rng([7, seed]), colours=colours)
    tape = BeamFrame(CALIBRATION).to_px([[0.9, -1.6], [0.9, 1.6], [1.6, 1.6], [1.6, -1.6]])
    red = np.array([40.0, 40.0, 230.0])
    taped = photo.image + coverage(tape, SIZE)[..., None] * (red - photo.image)
    image = np.rint(cv2.GaussianBlur(taped, (0, 0), 0.8)).astype(np.uint8)
    outcome = measured(photo, find_edges(image, CALIBRATION, SPECIMEN), 0.0)
    assert outcome.usable
    assert outcome.rms_px < 0.3
    assert outcome.coverage > 0.8


@pytest.mark.parametrize("number", [0, 9])
def test_the_reflection_of_a_lamp_does_not_split_the_beam(number):
    kind = "glare amid it"
    rng = np.random.default_rng([2, list(lab_photographs.KINDS).index(kind), number])
    image, scene = lab_photographs.lab_photograph(kind, rng)
    calibration, specimen = lab_photographs.stated(scene, rng)
    edges = find_edges(image, calibration, specimen)
    assert lab_photographs.verdict(kind, scene, edges, calibration)[0] == "good"


def test_clipped_light_beside_an_edge_is_doubtful():
    colours = np.array([[40.0, 60.0, 110.0], [150.0, 160.0, 130.0]])
    photo = photograph("uneven light", np.random.default_rng(4), 20.0, colours)
    brighter = np.clip(2.2 * photo.image.astype(float), 0, 255).astype(np.uint8)
    flags_of_cases = [
        {flag.severity for flag in find_edges(image, CALIBRATION, SPECIMEN).flags if flag.name == "SATURATED"}
        for image in (photo.image, brighter)
    ]
    assert flags_of_cases == [set(), {Severity.DOUBTFUL}]


def test_an_edge_with_short_gaps_is_doubtful_and_an_edge_with_a_long_gap_is_unusable():
    # The edge is reliable on half of its length.
    place = np.arange(400)
    flags_of_cases = []
    for sure in (place % 20 < 10, place < 200):
        [flag] = judge(sure_share(np.stack([sure, np.ones(400, dtype=bool)])))
        flags_of_cases.append((flag.name, flag.value, flag.severity))
    assert flags_of_cases == [("NOT_FOLLOWED", 0.5, Severity.DOUBTFUL), ("NOT_FOLLOWED", 0.5, Severity.UNUSABLE)]


def test_a_mirrored_picture_gives_the_same_edges():
    photo = photograph("clutter", np.random.default_rng(3), 50.0)
    upright = find_edges(photo.image, CALIBRATION, SPECIMEN)
    x, y = CALIBRATION.clamp_midpoint_px
    changes = {
        "clamp_midpoint_px": (photo.image.shape[1] - 1 - x, y),
        "field_angle_deg": 180.0,
    }
    mirrored = find_edges(photo.image[:, ::-1].copy(), CALIBRATION.model_copy(update=changes), SPECIMEN)
    for edge, mirrored_edge in ((upright.left, mirrored.left), (upright.right, mirrored.right)):
        nearest = np.abs(edge.points_mm[:, None] - mirrored_edge.points_mm).sum(axis=2).min(axis=1)
        assert np.median(nearest) < 0.3
        assert np.sign(np.median(edge.points_mm[:8, 1])) == np.sign(np.median(mirrored_edge.points_mm[:8, 1]))


def test_nothing_is_followed_in_a_picture_without_a_beam():
    photo = photograph("clutter", np.random.default_rng(4), 0.0, np.array([[90.0, 90.0, 90.0]] * 2))
    edges = find_edges(photo.image, CALIBRATION, SPECIMEN)
    assert len(edges.left.points_mm) == len(edges.right.points_mm) == 0
    assert Severity.UNUSABLE in severities(edges)


def test_a_beam_that_is_too_narrow_is_flagged_with_its_width():
    photo = photograph("clutter", np.random.default_rng(0))
    thin = SPECIMEN.model_copy(update={"specimen": SPECIMEN.specimen.model_copy(update={"width_mm": 0.3})})
    remedies = [flag.remedy for flag in find_edges(photo.image, CALIBRATION, thin).flags if flag.name == "TOO_NARROW"]
    assert len(remedies) == 1
    assert "4.2 px wide and should be at least 6" in remedies[0]


def test_a_beam_that_leaves_the_picture_keeps_its_long_edges():
    photo = photograph("uneven light", np.random.default_rng(2), 10.0)
    edges = find_edges(photo.image[:400], CALIBRATION, SPECIMEN)
    outcome = measured(photo, edges, 0.0)
    assert outcome.rms_px < 0.3
    assert BeamFrame(CALIBRATION).to_px(edges.left.points_mm)[-1, 1] > 370.0
    assert {"TOUCHES_FRAME"} <= {flag.name for flag in edges.flags}
    assert Severity.UNUSABLE not in severities(edges)


def stripes(*shown, aside_px=0.0):
    # Draw a picture with stripes of the size of a beam: "red" is left of the clamp, and "blue" is right of it.
    # shown: names of the stripes to draw. aside_px: shift of the picture to the right.
    image = np.full((96, 128, 3), 120.0)
    for name, colour, columns in (("red", (40, 60, 200), slice(48, 63)), ("blue", (200, 170, 40), slice(66, 81))):
        if name in shown:
            image[8:88, columns] = colour
    image = cv2.GaussianBlur(image, (0, 0), 0.8) + np.random.default_rng(1).normal(0.0, 2.0, image.shape)
    moved = cv2.warpAffine(image, np.array([[1.0, 0.0, aside_px], [0.0, 1.0, 0.0]]), (128, 96), borderMode=1)
    return np.clip(moved, 0, 255).astype(np.uint8)


def followed_in(run, files, *states, aside_px=(0.0,) * 9, workers=1, along=()):
    # Segment pictures with two stripes; return the colour of the stripe that was taken as the beam in each state.
    # states: the stripes in each picture. aside_px: shift of the pictures to the right.
    pictures, dataset_file = files / f"pictures_{len(states)}{along}", files / f"{len(states)}{along}.h5"
    pictures.mkdir()
    for index, shown in enumerate(states):
        cv2.imwrite(str(pictures / f"{index}.png"), stripes(*shown, aside_px=aside_px[index]))
    rows = [f"{index}.png,{0.1 * index}" for index in range(len(states))]
    (files / "states.csv").write_text("\n".join(["frame,current_A", *rows]) + "\n")
    arguments = ["--states", files / "states.csv", "--specimen", files / "specimen.toml"]
    arguments += ["--calibration", files / "calibration.toml", "-o", dataset_file]
    status, message = run("import", pictures, *arguments)
    assert status == 0, message
    status, message = run("segment", dataset_file, "--workers", workers, *(("--along", along) if along else ()))
    assert status == 0, message
    with open_dataset(dataset_file) as dataset:
        frame = BeamFrame(dataset.calibration)
        edge_sets = dataset.edges()
    names = []
    for edges in edge_sets:
        assert len(edges.left.points_mm) > 5
        middle = frame.to_px(np.concatenate([edges.left.points_mm, edges.right.points_mm]))[:, 0].mean()
        doubt = any(flag.name == "ROOT_AMBIGUOUS" for flag in edges.flags)
        names.append(("red" if middle < 64 else "blue") + (", in doubt" if doubt else ""))
    return names


def test_an_earlier_state_decides_only_between_equally_likely_bodies(run, files):
    both = ("red", "blue")
    alone = followed_in(run, files, both)[0]
    assert alone.endswith(", in doubt")
    other = "blue" if alone.startswith("red") else "red"
    # The third state follows the first, unambiguous state, and not the second, ambiguous state. The last state has
    # one stripe only. A worker reads a single state, and leaves the decision to the main process.
    followed = followed_in(run, files, (other,), both, both, (alone.split(",")[0],), workers=2)
    assert followed == [other, f"{other}, in doubt", f"{other}, in doubt", alone.split(",")[0]]


@pytest.mark.parametrize(("stripe", "x"), [("red", 52), ("blue", 76)])
def test_clicked_points_decide_which_body_is_followed_in_all_states(run, files, stripe, x):
    both = ("red", "blue")
    along = f"{x},30 {x},55 {x},80"
    assert followed_in(run, files, both, both, both, along=along, workers=2)[0] == stripe
    with open_dataset(files / f"3{along}.h5") as dataset:
        assert dataset.calibration.picture.along_px == ((x, 30.0), (x, 55.0), (x, 80.0))
        middles = [edges.middle_mm[:, 1].mean() for edges in dataset.edges()]
    assert np.ptp(middles) < 0.1


def test_a_later_state_guides_the_search_in_the_states_before_it(run, files, monkeypatch):
    # The replaced search finds no beam in the first two states without the centre line of the third one.
    guides = []

    def find(image, *arguments, expected_mm=None, **more):
        guides.append(expected_mm)
        hidden = len(guides) < 3 or (expected_mm is None and len(guides) > 3)
        return find_edges(np.full_like(image, 120) if hidden else image, *arguments, expected_mm=expected_mm, **more)

    monkeypatch.setattr(segmentation, "find_edges", find)
    assert followed_in(run, files, ("red",), ("red",), ("red",)) == ["red", "red", "red"]
    assert [guide is None for guide in guides] == [True, True, True, False, False]
    assert np.median(np.abs(guides[-1][:, 1])) == pytest.approx(
        8.5 / 8.0, abs=0.1
    )  # the stripe is 8.5 px from the clamp


def test_the_states_on_both_sides_guide_the_search_in_the_state_between_them(run, files, monkeypatch):
    # The centre line of one neighbouring state alone does not help the search.
    found = []

    def find(image, *arguments, expected_mm=None, between_mm=None, **more):
        found.append((expected_mm is not None, between_mm is not None))
        hidden = len(found) == 2 or (expected_mm is not None and between_mm is None)
        lines = {"expected_mm": expected_mm, "between_mm": between_mm}
        return find_edges(np.full_like(image, 120) if hidden else image, *arguments, **lines, **more)

    monkeypatch.setattr(segmentation, "find_edges", find)
    assert followed_in(run, files, ("red",), ("red",), ("red",)) == ["red", "red", "red"]
    assert found == [(False, False)] * 3 + [(True, False)] * 2 + [(True, True)]


@pytest.mark.parametrize(("aside_mm", "kept"), [(0.0, True), (0.9, True), (2.5, False)])
def test_a_beam_that_does_not_lie_between_its_neighbours_is_not_used(aside_mm, kept):
    # The beam is 2 mm wide; its middle line is at 0 mm in the earlier state and at 1 mm in the later one.

    def at(y_mm):
        x = np.linspace(1.0, 20.0, 30)
        left, right = (EdgePoints(np.column_stack([x, np.full(30, y_mm + y)]), np.full(30, 0.01)) for y in (-1, 1))
        return EdgeSet(left, right, (), np.full((4, 2), np.nan), "", None)

    nothing = EdgeSet(*[EdgePoints(np.zeros((0, 2)), np.zeros(0))] * 2, (), np.full((4, 2), np.nan), "", None)
    edge_sets = [at(0.0), nothing, at(1.0)]
    search_beside_neighbours(edge_sets, lambda _, __, *lines: at(aside_mm) if len(lines) == 2 else nothing, 2.0)
    assert (len(edge_sets[1].middle_mm) > 0) == kept


def test_the_line_between_two_lines_is_uncertain_by_half_of_their_distance():
    first = np.column_stack([np.linspace(0.0, 200.0, 50), np.zeros(50)])
    second = np.column_stack([np.linspace(0.0, 160.0, 40), 0.002 * np.linspace(0.0, 160.0, 40) ** 2])
    line = line_between(first, second)
    length = line_between(second, second).length_px
    assert line.length_px == pytest.approx(length, rel=0.02)  # up to the end of the shorter line
    assert line.clicked_px == line.length_px
    assert line.free_px[0] == pytest.approx(10.0)
    assert line.points[-1, 1] == pytest.approx(0.5 * 51.2, abs=1.0)  # the second line ends 51.2 px beside the first one
    assert line.free_px[-1] == pytest.approx(10.0 + 0.5 * 51.2, abs=2.0)


@pytest.mark.parametrize("clicks", [[[100, 300], [102, 294]], [[98, 200], [103, 412], [96, 400], [104, 407]]])
def test_a_line_through_clicks_that_are_close_together_does_not_turn(clicks):
    # A click may be 10 px away from the beam.
    line = clicked_line(np.array([100.0, 50.0]), np.array([0.0, 1.0]), np.array(clicks, dtype=float))
    assert (np.diff(line.points[:, 1]) > 0).all()
    assert np.abs(line.points[:, 0] - 100.0).max() < 5.0
    halfway = len(line.free_px) // 4
    assert line.free_px[0] == pytest.approx(10.0)
    assert line.free_px[halfway] > 13.0  # between clicks the line is less certain


def test_a_strip_along_the_beam_has_no_cost_before_two_clicks_that_are_close_together():
    # One click is 8 px to the left of the beam, the other 8 px to its right.
    line = clicked_line(np.array([100.0, 50.0]), np.array([0.0, 1.0]), np.array([[92.0, 1050.0], [108.0, 1090.0]]))
    assert (np.abs(line.points[:, 0] - 100.0) < line.free_px).all()
    assert line.length_px == pytest.approx(1040.0, rel=0.02)


def test_a_clicked_line_follows_a_strongly_bent_beam():
    # Three clicks lie on a half circle of 300 px radius; the line passes within 10 px of them.
    angle = np.radians([60.0, 120.0, 180.0])
    clicks = 300.0 * np.column_stack([1.0 - np.cos(angle), np.sin(angle)])
    line = clicked_line(np.zeros(2), np.array([0.0, 1.0]), clicks)
    apart = np.linalg.norm(line.points[:, None] - clicks, axis=2).min(axis=0)
    assert apart.max() < 10.0
    off_circle = np.abs(np.linalg.norm(line.points - np.array([300.0, 0.0]), axis=1) - 300.0)
    assert (off_circle < line.free_px).all()


def test_a_beam_is_followed_to_the_last_click_behind_a_body_that_hides_it(files):
    # Without the clicks, the search would end at the hidden part.
    image = np.full((96, 128, 3), 120.0)
    image[8:88, 56:72] = (40, 60, 200)
    image[42:74] = (30, 30, 30)
    image = cv2.GaussianBlur(image, (0, 0), 0.8) + np.random.default_rng(1).normal(0.0, 2.0, image.shape)
    photo, specimen = np.clip(image, 0, 255).astype(np.uint8), load_specimen(files / "specimen.toml")
    farthest = []
    for clicks in ({}, {"picture": {"along_px": ((64.0, 30.0), (66.0, 84.0))}}):
        calibration = load_calibration(files / "calibration.toml", clicks)
        followed = follow_beam(photo, calibration, specimen)
        assert not followed.edges or followed.edges[0].points[:, 1].max() < 90.0
        farthest.append(followed.path_px[:, 1].max())
    assert farthest[0] < 52.0
    assert farthest[1] > 75.0


def test_clicked_points_off_the_beam_are_reported(files):
    clicks = {"picture": {"along_px": ((106.0, 40.0), (112.0, 70.0))}}
    calibration = load_calibration(files / "calibration.toml", clicks)
    edges = find_edges(stripes("red"), calibration, load_specimen(files / "specimen.toml"))
    assert len(edges.left.points_mm) == 0
    assert edges.flags[0].severity is Severity.UNUSABLE
    assert "Correct --along" in edges.flags[0].remedy


def test_an_ambiguous_state_does_not_guide_later_states(run, files):
    both = ("red", "blue")
    guessed = followed_in(run, files, both)[0]
    assert guessed.endswith(", in doubt")
    first, sure = followed_in(run, files, both, both, aside_px=(0.0, -0.1))
    assert sure == ("blue" if guessed.startswith("red") else "red")
    assert first == f"{sure}, in doubt"  # a later unambiguous state decides in the first state


@pictures_at_hand
@pytest.mark.parametrize("picture", [pytest.param(picture, id=picture.name) for picture in DEVELOPMENT])
def test_photographs_of_other_laboratories_are_followed(picture):
    edges = picture.edges()
    scored = picture.score(edges, picture.calibration)
    used = len(edges.left.points_mm) > 0 and Severity.UNUSABLE not in severities(edges)
    assert used
    assert scored.good


@pictures_at_hand
def test_an_edge_continues_beyond_a_reflection_near_the_clamp():
    picture = next(picture for picture in DEVELOPMENT if picture.name == "diffcal_red_2")
    beam = picture.specimen.specimen
    x, y = picture.calibration.clamp_midpoint_px
    changes = {"clamp_midpoint_px": (x - 1.0, y - 3.1), "axis_angle_deg": picture.calibration.axis_angle_deg - 2.4}
    size = {"width_mm": 0.965 * beam.width_mm, "length_mm": 0.963 * beam.length_mm}
    calibration = picture.calibration.model_copy(update=changes)
    specimen = picture.specimen.model_copy(update={"specimen": beam.model_copy(update=size)})
    edges = picture.edges((calibration, specimen))
    assert Severity.UNUSABLE not in severities(edges)
    assert picture.score(edges, calibration).good


@pytest.mark.parametrize(
    ("kind", "number", "expected"),
    [
        ("stripes behind", 1, "good"),  # one of the stripes continues where an edge of the beam ends
        ("lookalike, stripes", 4, "doubted"),  # a stripe as wide as the beam that has no end
        ("hard shadow", 0, "good"),
        ("7 px wide", 0, "good"),
    ],
)
def test_a_beam_is_followed_beside_objects_of_a_bench(kind, number, expected):
    rng = np.random.default_rng([1, list(lab_photographs.KINDS).index(kind), number])
    image, scene = lab_photographs.lab_photograph(kind, rng)
    calibration, specimen = lab_photographs.stated(scene, rng)
    edges = find_edges(image, calibration, specimen)
    assert lab_photographs.verdict(kind, scene, edges, calibration)[0] == expected


@pictures_at_hand
@pytest.mark.parametrize("picture", REFUSAL, ids=lambda picture: picture.name)
def test_pictures_without_a_beam_are_refused(picture):
    edges = picture.edges()
    assert len(edges.left.points_mm) == 0
    assert Severity.UNUSABLE in severities(edges)


def test_the_benchmark_of_photographs_reports_small_errors():
    outcomes = photographs.run(2, seed=3)
    assert [outcome.kind for outcome in outcomes] == list(KINDS[:2])
    assert all(outcome.rms_px < photographs.WRONG_PX for outcome in outcomes)


def test_the_overlay_of_a_failed_search_shows_the_expected_beam_and_the_followed_path():
    case = CASES["NOT_FOLLOWED"]()
    edges = case.edges()
    followed = follow_beam(case.image, case.calibration, case.specimen)
    picture = draw_overlay(case.image, edges, case.calibration, case.specimen, followed)
    height, width = case.image.shape[:2]
    assert picture.shape[0] > height + 40  # the text is below the picture
    assert picture.shape[1] == width
    changed = (picture[:height].astype(int) != case.image).any(axis=2)
    assert 0.002 < changed.mean() < 0.1  # the picture has lines and no text
    x, y = np.rint(followed.path_px[-1]).astype(int)
    assert (picture[y - 2 : y + 3, x - 2 : x + 3] == FLAG_COLOUR).all(axis=2).any()
    clamp_x, clamp_y = np.rint(case.calibration.clamp_midpoint_px).astype(int)
    assert (np.abs(picture[clamp_y - 2 : clamp_y + 3, clamp_x - 32] - np.array(STATED_COLOUR)) < 80).all(axis=1).any()


def test_the_intermediate_results_are_drawn():
    photo = photograph("clutter", np.random.default_rng(6), 20.0)
    pictures = draw_steps(follow_beam(photo.image, CALIBRATION, SPECIMEN))
    assert set(pictures) == {"strip", "unrolled"}
    assert all(picture.ndim == 3 and picture.dtype == np.uint8 for picture in pictures.values())
    sure = (pictures["unrolled"] == (0, 200, 0)).all(axis=2).sum()
    assert sure > (pictures["unrolled"] == (0, 0, 255)).all(axis=2).sum()
