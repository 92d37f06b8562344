"""A user may give values about pictures, such as clamp and colours; errors ask for missing values."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from eimi_lab.config.calibration import Calibration, changed_calibration, load_calibration
from eimi_lab.config.toml import parse
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.vision.projection import Projection, choose_projection

Run = Callable[..., tuple[int, str]]


def scene(beam: tuple[int, int, int], beside: tuple[int, int, int], seed: int = 0) -> np.ndarray:
    # Return a noisy picture, (96, 128, 3), of a beam of 16 x 80 px below the pixel (64, 8).
    # beam, beside: colours of the beam and of the background (blue, green, red).
    image = np.empty((96, 128, 3))
    image[:] = beside
    image[8:88, 56:72] = beam
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    return np.clip(image + np.random.default_rng(seed).normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def imported(run: Run, files: Path, image: np.ndarray, *more: object) -> tuple[int, str]:
    cv2.imwrite(str(files / "frame.png"), image)
    (files / "states.csv").write_text("frame,current_A\nframe.png,0\n")
    arguments = ["--states", files / "states.csv", "--specimen", files / "specimen.toml"]
    arguments += ["--calibration", files / "calibration.toml", "-o", files / "out.h5"]
    return run("import", files / "frame.png", *arguments, *more)


def stored(files: Path) -> Calibration:
    with open_dataset(files / "out.h5") as dataset:
        assert dataset.calibration is not None
        return dataset.calibration


def edge_points(files: Path) -> int:
    with open_dataset(files / "out.h5") as dataset:
        return sum(len(edges.left.sigma_mm) + len(edges.right.sigma_mm) for edges in dataset.edges() or ())


def test_values_that_a_user_gives_about_the_pictures_are_stored(run: Run, files: Path) -> None:
    # Values for keys that calibration.toml does not contain are stored too.
    with (files / "calibration.toml").open("a") as file:
        file.write('calibrated_on = 2026-01-02\n[picture]\npolarity = "dark"\nchannel = "green"\n')
    options = ("--clamp", "63.5,8", "--axis", "91", "--region", "10, 4, 100, 90", "--beam-colour", "200,30,40")
    assert imported(run, files, scene((40, 30, 200), (200, 200, 200)), *options)[0] == 0
    kept = stored(files)
    assert (kept.clamp_midpoint_px, kept.axis_angle_deg, kept.pixels_per_mm) == ((63.5, 8.0), 91.0, 8.0)
    assert kept.picture is not None
    assert kept.picture.region_px == (10, 4, 100, 90)
    assert (kept.picture.polarity, kept.picture.channel, kept.picture.beam_colour) == ("dark", None, (200, 30, 40))
    assert parse(Calibration, kept.text, "text") == kept


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--clamp", "60", "--clamp 60: should be 2 numbers, separated by commas"),
        ("--region", "1,2,3,x", "--region 1,2,3,x: should be 4 whole numbers"),
        ("--region", "1,2,0,4", "[picture] region_px = [1, 2, 0, 4] should be left and top"),
        ("--beam-colour", "1,2,300", "[picture] beam_colour = [1.0, 2.0, 300.0] should be red, green and blue from 0"),
        ("--polarity", "white", "picture.polarity = 'white' should be 'dark' or 'bright'"),
        ("--channel", "violet", "picture.channel = 'violet' should be 'red', 'green', 'blue' or 'grey'"),
        ("--along", "64,20", "--along '64,20': should be two to six points X,Y, such as '120,80 118,160"),
        ("--along", "64,20 64,400", "point 2, [64, 400], should lie in the pictures of 128 x 96 px"),
        ("--along", "64,70 64,40", "the line turns back before the point [64, 40]; give the points in the order from"),
        ("--along", "64,80 20,40 64,40", "the line turns back before the point [20, 40]"),
        ("--along", "120,30 20,70", "the line turns back before the point [20, 70]"),
        ("--along", "64,40 64,40", "two points are the same"),
        ("--axis", "190.5", "field_angle_deg = 0 should be across the beam"),
    ],
)
def test_a_wrong_value_about_the_pictures_is_refused_in_one_line(
    run: Run, files: Path, option: str, value: str, expected: str
) -> None:
    status, message = imported(run, files, scene((40, 30, 200), (200, 200, 200)), option, value)
    assert (status, message.count("\n"), expected in message) == (2, 1, True), message
    assert not (files / "out.h5").exists()


def test_the_error_about_a_missing_value_names_a_picture_in_which_to_read_it(run: Run, files: Path) -> None:
    text = (files / "calibration.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith(("clamp_midpoint_px", "axis_angle_deg"))]
    (files / "calibration.toml").write_text("\n".join(lines) + "\n")
    image = scene((40, 30, 200), (200, 200, 200))
    status, message = imported(run, files, image)
    assert (status, message.count("\n")) == (2, 1)
    assert "clamp_midpoint_px and axis_angle_deg are missing" in message
    assert "give --clamp X,Y and --axis DEG" in message
    assert f"{files / 'out_where.png'} shows frame.png with rulers in px" in message
    sheet = cv2.imread(str(files / "out_where.png"))
    shown = sheet[46 : 46 + 96, 46 : 46 + 128].astype(int)  # the picture is visible under thin lines
    assert np.median(np.abs(shown - image)) == 0
    assert (sheet[:40] < 128).any()  # the numbers are above the picture
    assert imported(run, files, image, "--clamp", "64,8")[0] == 2
    assert imported(run, files, image, "--clamp", "64,8", "--axis", "90") == (0, "")


def test_a_red_beam_on_white_is_detected_and_the_chosen_colour_has_a_name(run: Run, files: Path) -> None:
    # The brightest channel, red, shows no contrast (204 and 214), but green does (50 and 208).
    assert imported(run, files, scene((50, 50, 204), (208, 208, 214)))[0] == 0
    assert run("segment", files / "out.h5")[0] == 0
    points = edge_points(files)
    with open_dataset(files / "out.h5") as dataset:
        projection = dataset.projection()
    assert points > 30
    assert projection is not None
    assert abs(projection.weights[2]) < 0.3
    assert run("segment", files / "out.h5", "--channel", "red")[0] == 0
    with open_dataset(files / "out.h5") as dataset:
        assert (dataset.projection() or projection).name == "red"
    assert edge_points(files) < points
    assert run("segment", files / "out.h5", "--beam-colour", "204,50,50")[0] == 0
    assert edge_points(files) == pytest.approx(points, rel=0.1)
    assert stored(files).picture is not None


def test_one_mixture_of_colours_shows_the_beam_in_all_states(files: Path) -> None:
    # In the bright state, the beam and its background differ in red (120 and 55), and hardly in green (119 and 113).
    calibration = load_calibration(files / "calibration.toml")
    images = [
        scene((90, 119, 120), (60, 113, 55)).astype(np.float32),
        scene((72, 95, 96), (48, 90, 44)).astype(np.float32),
    ]
    chosen = choose_projection(images, calibration, 2.0, 10.0)
    shown = [chosen.apply(image) for image in images]
    steps = [abs(float(np.median(image[20:80, 58:70]) - np.median(image[20:80, 20:50]))) for image in shown]
    assert min(steps) > 20
    assert Projection.from_json(chosen.to_json()) == chosen
    full = np.full((4, 4, 3), 255, np.uint8)
    assert [float(chosen.apply(full * k).max()) <= 255.0 for k in (0, 1)] == [True, True]


@pytest.mark.parametrize("odd_one", [0, 5])
def test_the_mixture_of_colours_is_chosen_for_all_states_together(run: Run, files: Path, odd_one: int) -> None:
    # In five of six states the beam differs from its background in blue, and in the state `odd_one` in red.
    pictures = files / "pictures"
    pictures.mkdir()
    for index in range(6):
        beam, beside = ((60, 120, 40), (100, 120, 200)) if index == odd_one else ((60, 120, 100), (200, 120, 100))
        image = np.empty((128, 128, 3))
        image[:] = beside
        image[24:104, 56:72] = image[:24, 16:112] = beam
        noise = np.random.default_rng(index).normal(0, 2, image.shape)
        cv2.imwrite(str(pictures / f"{index}.png"), np.clip(cv2.GaussianBlur(image, (0, 0), 0.8) + noise, 0, 255))
    rows = [f"{index}.png,{0.1 * index}" for index in range(6)]
    (files / "states.csv").write_text("\n".join(["frame,current_A", *rows]) + "\n")
    arguments = ["--states", files / "states.csv", "--specimen", files / "specimen.toml", "--clamp", "63.5,23.5"]
    arguments += ["--calibration", files / "calibration.toml", "-o", files / "out.h5"]
    assert run("import", pictures, *arguments)[0] == 0
    assert run("segment", files / "out.h5")[0] == 0
    with open_dataset(files / "out.h5") as dataset:
        projection, edges = dataset.projection(), dataset.edges() or ()
    assert projection is not None
    assert projection.name == "blue"
    faint = [[flag.value for flag in points.flags if flag.name == "LOW_CONTRAST"] for points in edges]
    assert [len(values) for values in faint] == [int(index == odd_one) for index in range(6)]
    assert faint[odd_one][0] == pytest.approx(40 / 255, rel=0.1)


def test_edges_are_searched_only_in_the_given_region(run: Run, files: Path) -> None:
    image = scene((30, 30, 30), (200, 200, 200))
    image[:, 100:] = 10  # a black wall that does not touch the beam
    image[84:, :] = 10  # a floor on which the beam stands
    assert imported(run, files, image)[0] == 0
    assert run("segment", files / "out.h5", "--region", "30,0,60,84")[0] == 0
    with open_dataset(files / "out.h5") as dataset:
        edges = (dataset.edges() or ())[0]
    assert "MULTI_CONTOUR" not in {flag.name for flag in edges.flags}
    assert edges.calibration_digest == stored(files).digest
    status, message = run("segment", files / "out.h5", "--region", "80,0,40,84")
    assert (status, "should contain clamp_midpoint_px = [64.0, 8.0]" in message) == (2, True)
    status, message = run("segment", files / "out.h5", "--region", "0,0,400,84")
    assert (status, "should lie in the pictures of 128 x 96 px" in message) == (2, True)


def test_a_given_polarity_replaces_the_automatic_choice(run: Run, files: Path) -> None:
    assert imported(run, files, scene((200, 200, 200), (30, 30, 30)), "--polarity", "bright")[0] == 0
    assert run("segment", files / "out.h5")[0] == 0
    assert edge_points(files) > 30
    assert run("segment", files / "out.h5", "--polarity", "dark")[0] == 0
    assert edge_points(files) == 0


def test_a_changed_calibration_removes_the_edges_that_were_detected_with_it(run: Run, files: Path) -> None:
    assert imported(run, files, scene((30, 30, 30), (200, 200, 200)))[0] == 0
    before = stored(files)
    after = changed_calibration(before, {"axis_angle_deg": 89.0})
    assert (after.axis_angle_deg, after.digest == before.digest) == (89.0, False)
    assert run("segment", files / "out.h5", "--axis", "89")[0] == 0
    assert stored(files) == after


@pytest.mark.parametrize(
    ("level", "expected"), [(3, "of 255: raise the exposure"), (252, "of 255: lower the exposure")]
)
def test_a_picture_without_contrast_is_not_reported_as_a_wrong_clamp(
    run: Run, files: Path, level: int, expected: str
) -> None:
    assert imported(run, files, np.full((96, 128), level, np.uint8))[0] == 0
    status, message = run("segment", files / "out.h5")
    assert (status, f"the grey values of the picture lie between {level} and {level} {expected}" in message) == (
        0,
        True,
    ), message


def test_a_beam_too_narrow_for_its_edges_is_not_reported_as_a_wrong_clamp(run: Run, files: Path) -> None:
    specimen = files / "specimen.toml"
    lines = specimen.read_text().splitlines()
    specimen.write_text("\n".join("width_mm = 0.5" if line.startswith("width_mm") else line for line in lines) + "\n")
    empty = np.random.default_rng(0).integers(180, 220, (96, 128, 3)).astype(np.uint8)
    assert imported(run, files, empty)[0] == 0
    status, message = run("segment", files / "out.h5")
    assert (status, "no beam was found; the beam is 4 px wide and should be at least 6 px wide" in message) == (
        0,
        True,
    ), message


def test_if_one_edge_is_lost_the_error_names_it_and_proposes_no_other_clamp(run: Run, files: Path) -> None:
    # A body of the beam's colour touches the right side of the beam.
    image = scene((40, 60, 200), (120, 120, 120))
    image[40:76, 70:100] = np.clip(np.random.default_rng(2).normal((40, 60, 200), 2.0, (36, 30, 3)), 0, 255)
    assert imported(run, files, image)[0] == 0
    status, said = run("segment", files / "out.h5")
    told = "a body was followed from the clamp over 9"
    assert (status, told in said, "see in the overlay which edge is lost" in said) == (0, True, True), said
    assert "a beam is found with" not in said


def test_with_clicks_the_flags_of_a_grey_picture_are_those_of_following(run: Run, files: Path) -> None:
    # The picture shows no beam. Its only flag is NOT_FOLLOWED, and the advice names options that help the search.
    image = np.random.default_rng(0).integers(100, 140, (96, 128)).astype(np.uint8)
    assert imported(run, files, image, "--along", "64,40 64,80")[0] == 0
    status, said = run("segment", files / "out.h5")
    with open_dataset(files / "out.h5") as dataset:
        [edges] = dataset.edges() or ()
    assert {flag.name for flag in edges.flags} == {"NOT_FOLLOWED"}
    assert (status, "help the search by --region, --polarity" in said) == (0, True), said


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        (
            "pixels_per_mm",
            "4.0",
            "a beam is found with pixels_per_mm = 8, 2 times the given value: is the scale right?",
        ),
        ("clamp_midpoint_px", "[24.0, 8.0]", "a beam is found with clamp_midpoint_px = [64, 8]: is the clamp at"),
        ("clamp_midpoint_px", "[124.0, 8.0]", "an edge of the beam begins outside the picture"),
        (
            "clamp_midpoint_px",
            "[118.0, 80.0]",
            "no body as wide as width_mm leaves the clamp at or near clamp_midpoint_px",
        ),
    ],
)
def test_if_no_beam_is_found_the_error_names_the_possible_causes(
    run: Run, files: Path, key: str, value: str, expected: str
) -> None:
    lines = (files / "calibration.toml").read_text().splitlines()
    lines = [f"{key} = {value}" if line.startswith(key) else line for line in lines]
    (files / "calibration.toml").write_text("\n".join(lines) + "\n")
    assert imported(run, files, scene((30, 30, 30), (200, 200, 200)))[0] == 0
    status, message = run("segment", files / "out.h5")
    assert (status, expected in message) == (0, True), message
    assert f"{files / 'out_where.png'} shows where the program searched" in message
    drawn = cv2.imread(str(files / "out_where.png")).astype(int)
    assert (
        (drawn[..., 0] > 200) & (drawn[..., 1] < 60) & (drawn[..., 2] > 200)
    ).sum() > 50  # the beam in specimen.toml
    green = (drawn[..., 0] < 60) & (drawn[..., 1] > 140) & (drawn[..., 2] < 60)
    is_found = "a beam is found" in expected
    assert (green.sum() > 50, "(green in the picture)" in message) == (
        is_found,
        is_found,
    )  # the edges that another value gives
