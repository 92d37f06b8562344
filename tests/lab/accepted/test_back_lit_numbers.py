"""The search for back-lit edges in small pictures gives the numbers that are stored in the folder `back_lit`."""

# If a change of the search is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import eimi_lab.vision.edges
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.apparent_width import apparent_width_mm
from eimi_lab.vision.edges.back_lit import BackLitSearch
from eimi_lab.vision.edges.edge_set import tip_angle_deg, tip_angle_sigma_deg
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.edges.overlay import contact_sheet, draw_overlay
from eimi_lab.vision.projection import Projection
from eimi_lab.vision.ruled_picture import ruled_picture
from tests.shared.accepted_numbers import check, described
from tests.shared.small_pictures import CALIBRATION, SmallPicture, specimen, within
from tests.shared.traced_results import TracedResults

ACCEPTED = Path(__file__).parent / "back_lit"
EDGES = Path(eimi_lab.vision.edges.__file__).parent
SPECIMEN = specimen()
BELOW = CALIBRATION.model_copy(update={"clamp_midpoint_px": (60.0, 26.0)})
DARK = (20.0,)


@dataclass(frozen=True)
class Case:
    # A picture, with the calibration and the specimen for it, and the bend with which it was drawn.

    image: Any
    specimen: SpecimenFile = SPECIMEN
    calibration: Calibration = BELOW
    bend: float = 0.0
    projection: Projection | None = None


def back_lit(bend: float = 0.0, slope: float = 0.2, clamp: bool = True) -> SmallPicture:
    # Return a picture of a bright wall, and a dark clamp if required; tests add a beam that bends by `bend`.
    picture = SmallPicture(bend, (200.0,), slope, above_px=16)
    return picture.add(within(picture.along, -99.0, 0.0), DARK) if clamp else picture


def beam(picture: SmallPicture, colour: tuple[float, ...] = DARK, half_px: Any = 7.0) -> SmallPicture:
    picture.add(within(picture.aside, -half_px, half_px) * within(picture.along, -20.0, picture.length_px), colour)
    return picture


def plain() -> Case:
    return Case(beam(back_lit()).exposed()[..., 0])


def bent() -> Case:
    return Case(beam(back_lit(-0.45)).exposed(2.5)[..., 0], bend=-0.45)


def with_a_magnet() -> Case:
    picture = beam(back_lit(0.2), (70.0,))
    picture.add(picture.beside(-5.0, 5.0) * within(picture.along, 64.0, 90.0), (15.0,))
    magnet = {"length_mm": 2.8, "width_mm": 10.0 / 7.0, "depth_mm": 2.0, "remanence_T": 1.2, "density_kg_m3": 7500.0}
    changed = SpecimenFile.model_validate({**specimen().model_dump(exclude_none=True), "magnet": magnet})
    return Case(picture.exposed()[..., 0], changed, bend=0.2)


def lit() -> Case:
    picture = SmallPicture(0.1, (25.0,), 0.1, above_px=16)
    picture.add(within(picture.along, -99.0, 0.0), (190.0,))
    return Case(beam(picture, (190.0,)).exposed()[..., 0], bend=0.1)


def with_a_gamma() -> Case:
    picture = beam(back_lit(slope=0.0))
    return Case(np.rint(255.0 * (picture.exposed(0.5)[..., 0] / 255.0) ** (1.0 / 1.8)).astype(np.uint8))


def out_of_focus() -> Case:
    return Case(cv2.GaussianBlur(beam(back_lit(0.2)).exposed()[..., 0], (0, 0), 2.0), bend=0.2)


def with_a_hole_and_another_body() -> Case:
    picture = beam(back_lit())
    spot = within(np.hypot(picture.aside - 1.0, picture.along - 40.0), -9.0, 2.5)
    picture.add(spot, (150.0,))
    picture.add(within(picture.x, 90.0, 100.0) * within(picture.along, 20.0, 50.0), DARK)
    return Case(picture.exposed()[..., 0])


def touching_the_frame() -> Case:
    return Case(beam(back_lit()).exposed()[:96, :, 0])


def turned_about_its_axis() -> Case:
    picture = back_lit()
    return Case(beam(picture, half_px=7.2 + 0.5 * picture.along / 84.0).exposed()[..., 0])


def saturated() -> Case:
    picture = beam(back_lit(slope=0.0))
    picture.colours = picture.colours * 1.3
    return Case(picture.exposed()[..., 0])


def of_stepped_width() -> Case:
    picture = back_lit()
    wide = picture.along < 42.0
    rows = [[0.0, 2.0], [6.0, 2.0], [6.0, 1.6], [12.0, 1.6]]
    return Case(beam(picture, half_px=np.where(wide, 7.0, 5.6)).exposed()[..., 0], specimen(rows))


def through_a_lens() -> Case:
    lens = ((300.0, 0.0, 70.0), (0.0, 300.0, 50.0), (0.0, 0.0, 1.0))
    distorted = {"camera_matrix": lens, "distortion": (-0.05, 0.02, 0.001, -0.001, 0.0)}
    return Case(beam(back_lit(0.1)).exposed()[..., 0], calibration=BELOW.model_copy(update=distorted))


def without_a_clamp() -> Case:
    return Case(beam(back_lit(0.1, clamp=False)).exposed()[..., 0])


def seen_from_behind() -> Case:
    return Case(
        beam(back_lit(0.3)).exposed()[..., 0],
        calibration=BELOW.model_copy(update={"axis_angle_deg": 88.0, "field_angle_deg": 180.0}),
    )


def in_a_weighted_sum_of_colours() -> Case:
    picture = SmallPicture(0.2, (180.0, 190.0, 200.0), above_px=16)
    picture.add(within(picture.along, -99.0, 0.0), (20.0, 30.0, 60.0))
    beam(picture, (30.0, 30.0, 150.0))
    return Case(picture.exposed(), bend=0.2, projection=Projection("drawn", (0.2, 0.9, -0.1)))


def too_wide() -> Case:
    return Case(beam(back_lit(), half_px=12.0).exposed()[..., 0])


CASES: tuple[Callable[[], Case], ...] = (
    plain,
    bent,
    with_a_magnet,
    lit,
    with_a_gamma,
    out_of_focus,
    with_a_hole_and_another_body,
    touching_the_frame,
    turned_about_its_axis,
    saturated,
    of_stepped_width,
    through_a_lens,
    without_a_clamp,
    seen_from_behind,
    in_a_weighted_sum_of_colours,
    too_wide,
)


def steps_of(case: Case, name: str) -> Iterator[str]:
    # Yield the numbers of each step of the search for edges in a picture, as text; `name` begins each line.
    findings: dict[str, float] = {}
    search = BackLitSearch(BeamFrame(case.calibration), case.calibration.pixels_per_mm, case.specimen, findings, None)
    search.projection = case.projection
    outlined = search.find_outline(case.image)
    yield from described(outlined, f"{name} outlined")
    located = search.locate_edges(outlined, 0.4) if outlined else None
    yield from described(located, f"{name} located")
    yield from described(findings, f"{name} findings")
    yield from described(search.words(), f"{name} words")
    edges = find_edges(case.image, case.calibration, case.specimen, spacing_mm=0.4, projection=case.projection)
    yield from described(edges.flags, f"{name} flags")
    yield from described([edges.left, edges.right, edges.corners_px, edges.middle_mm], f"{name} edges")
    yield from described([tip_angle_deg(edges), tip_angle_sigma_deg(edges)], f"{name} tip")
    drawing = draw_overlay(case.image, edges, case.calibration, case.specimen)
    yield from described(drawing, f"{name} drawing")
    if case.image.ndim == 2:
        yield from described(apparent_width_mm(case.image, BeamFrame(case.calibration), 12.0), f"{name} width")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_each_step_of_the_search_has_the_accepted_numbers(case: Callable[[], Case], tmp_path: Path) -> None:
    name = case.__name__
    with TracedResults(EDGES) as traced:
        lines = list(steps_of(case(), name))
    check([*lines, *traced.lines()], ACCEPTED / f"{name}.txt", tmp_path)


@pytest.mark.parametrize("case", [plain, bent, with_a_magnet, lit, in_a_weighted_sum_of_colours])
def test_the_points_lie_on_the_true_edges(case: Callable[[], Case]) -> None:
    # The edges were drawn 1 mm on each side of the middle line x² bend / length.
    given = case()
    edges = find_edges(given.image, given.calibration, given.specimen, projection=given.projection)
    for edge in (edges.left, edges.right):
        along, across = 7.0 * edge.points_mm.T
        middle = given.bend * along**2 / 84.0
        aside = (across - middle) / np.sqrt(1.0 + (2.0 * given.bend * along / 84.0) ** 2)
        assert len(along) > 15
        assert np.abs(np.abs(aside) - 7.0).max() < 0.8
        assert np.median(np.abs(np.abs(aside) - 7.0)) < 0.15


def test_drawings_are_as_accepted(tmp_path: Path) -> None:
    # The description has the mean colours of the ruled picture, and of the sheet of several pictures, in 8 x 8 parts.
    image = plain().image
    line = np.array([[60.0, 26.0], [64.0, 70.0], [80.0, 110.0]])
    pictures = {
        "ruled": ruled_picture(image, [line], [line + np.array([20.0, 0.0])]),
        "ruled of 12 bits": ruled_picture(np.repeat(image[..., None].astype(np.uint16) * 16, 3, axis=2)),
        "sheet": contact_sheet([np.dstack([image] * 3)] * 3, ["first", "second", "third and more"], (100, 90)),
        "large sheet": contact_sheet([np.dstack([image] * 3)], ["alone"]),
    }
    lines = []
    for name, picture in pictures.items():
        parts = cv2.resize(picture.astype(np.float32), (8, 8), interpolation=cv2.INTER_AREA)
        lines += [f"{name}: {picture.shape}", *(f"{name} {row}: {describe_row(parts[row])}" for row in range(8))]
    check(lines, ACCEPTED / "drawings.txt", tmp_path, 0.01, 0.3)


def describe_row(parts: Any) -> str:
    return " ".join(f"{value:.1f}" for value in parts.ravel())
