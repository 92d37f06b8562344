"""The search that follows a beam in small pictures gives the numbers that are stored in this folder."""

# If a change of the search is wanted, read the differences before you copy a new description over the accepted one.

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import eimi_lab.vision.following
from eimi_lab.config.calibration import Picture
from eimi_lab.vision.edges.finding import find_edges, follow_beam
from eimi_lab.vision.following.explaining import draw_steps
from eimi_lab.vision.following.follow import FollowedBeam
from tests.shared.accepted_numbers import check, described
from tests.shared.small_pictures import CALIBRATION, SmallPicture, edge, specimen, within
from tests.shared.traced_results import TracedResults

ACCEPTED = Path(__file__).parent
FOLLOWING = Path(eimi_lab.vision.following.__file__).parent
SPECIMEN = specimen()
GREY = (170.0, 170.0, 170.0)


def helped(**given: Any) -> Any:
    return CALIBRATION.model_copy(update={"picture": Picture(**given)})


def bent_in_uneven_light() -> FollowedBeam:
    return follow_beam(SmallPicture(-0.4, slope=0.5).beam().exposed(), CALIBRATION, SPECIMEN)


def bent_in_grey() -> FollowedBeam:
    picture = SmallPicture(0.5, ground=(200.0,)).beam(colour=(60.0,))
    return follow_beam(picture.exposed(2.5)[..., 0], helped(polarity="dark"), SPECIMEN, spacing_mm=0.6)


def on_a_shadow() -> FollowedBeam:
    picture = SmallPicture(0.15)
    picture.dim(picture.beside(-4.0, 12.0, 1.5), 0.5).beam()
    return follow_beam(picture.exposed(), CALIBRATION, SPECIMEN)


def on_a_grey_shadow() -> FollowedBeam:
    picture = SmallPicture(ground=GREY)
    picture.dim(picture.beside(-4.0, 11.0, 0.6), 0.55).beam(colour=(45.0, 45.0, 45.0))
    return follow_beam(picture.exposed(), CALIBRATION, SPECIMEN)


def with_a_rim() -> FollowedBeam:
    picture = SmallPicture(0.1)
    picture.add(picture.beside(-9.0, 9.0), (20.0, 30.0, 100.0)).beam()
    return follow_beam(picture.exposed(), CALIBRATION, specimen(2.6))


def crossed_by_a_cable() -> FollowedBeam:
    picture = SmallPicture(0.05).beam(colour=(100.0, 120.0, 175.0))
    across = picture.y - 50.0 - 0.2 * (picture.x - 60.0)
    picture.add(within(across, -2.5, 2.5), (20.0, 25.0, 30.0))
    return follow_beam(picture.exposed(), CALIBRATION, SPECIMEN)


def with_a_reflection() -> FollowedBeam:
    picture = SmallPicture(0.2).beam()
    picture.add(picture.beside(-4.0, -1.5, 0.5) * within(picture.along, 25.0, 55.0), (255.0, 255.0, 255.0))
    picture.add(picture.beside(6.0, 8.0, 0.5) * within(picture.along, 50.0, 70.0), (255.0, 255.0, 255.0))
    return follow_beam(picture.exposed(), CALIBRATION, SPECIMEN)


def beside_clipped_light() -> FollowedBeam:
    picture = SmallPicture().beam()
    picture.add(edge(picture.aside - 7.0) * within(picture.along, 20.0, 70.0), (256.0, 256.0, 250.0))
    return follow_beam(picture.exposed(), CALIBRATION, SPECIMEN)


def hidden_between_clicks() -> FollowedBeam:
    picture = SmallPicture(0.1).beam()
    picture.add(within(picture.along, 30.0, 50.0), (30.0, 30.0, 30.0))
    clicks = ((61.0, 30.0), (60.0, 70.0), (66.0, 88.0))
    return follow_beam(picture.exposed(), helped(along_px=clicks), SPECIMEN)


def near_an_earlier_line() -> FollowedBeam:
    picture = SmallPicture(0.3).beam()
    along = np.linspace(0.5, 11.0, 12)
    line = np.column_stack([along, -0.02 * along**2])
    return follow_beam(picture.exposed(), CALIBRATION, SPECIMEN, expected_mm=line)


def between_two_lines() -> FollowedBeam:
    picture = SmallPicture(0.3).beam()
    along = np.linspace(0.5, 11.0, 12)
    lines = [np.column_stack([along, bend * along**2]) for bend in (-0.005, -0.03)]
    return follow_beam(picture.exposed(), CALIBRATION, SPECIMEN, expected_mm=lines[0], between_mm=lines[1])


def in_perspective() -> FollowedBeam:
    picture = SmallPicture()
    picture.add(picture.beside(-7.0, 11.5), (25.0, 35.0, 120.0)).beam()
    lens = ((420.0, 0.0, 90.0), (0.0, 420.0, 55.0), (0.0, 0.0, 1.0))
    near = {"stand_off_mm": 60.0, "camera_matrix": lens, "distortion": (0.0, 0.0, 0.0, 0.0, 0.0)}
    return follow_beam(picture.exposed(), CALIBRATION.model_copy(update=near), specimen(depth_mm=9.0))


def of_varying_width() -> FollowedBeam:
    picture = SmallPicture(0.2)
    share = np.linspace(0.0, 1.0, 7)
    widths = 2.0 * (1.2 - 0.4 * share)
    half = 3.5 * np.interp(picture.along, 84.0 * share, widths)
    rows = np.column_stack([12.0 * share, widths]).tolist()
    return follow_beam(picture.beam(half).exposed(), CALIBRATION, specimen(rows))


def with_rough_edges() -> FollowedBeam:
    picture = SmallPicture()
    half = 7.0 + 0.9 * np.sin(2.0 * np.pi * picture.along / 11.0)
    return follow_beam(picture.beam(half).exposed(0.5), CALIBRATION, SPECIMEN, spacing_mm=0.1)


def beside_its_like(earlier: Any = None) -> FollowedBeam:
    picture = SmallPicture()
    for low, high, colour in ((-15.0, -1.0, (60.0, 60.0, 200.0)), (1.0, 15.0, (200.0, 120.0, 60.0))):
        picture.add(picture.beside(low, high), colour)
    return follow_beam(picture.exposed(), CALIBRATION, SPECIMEN, earlier=earlier)


def beside_its_like_after_a_state() -> FollowedBeam:
    picture = SmallPicture()
    picture.add(picture.beside(-15.0, -1.0), (60.0, 60.0, 200.0))
    before = find_edges(picture.exposed(), CALIBRATION, SPECIMEN)
    return beside_its_like(lambda: before)


def beside_its_like_after_another_state() -> FollowedBeam:
    picture = SmallPicture()
    picture.add(picture.beside(1.0, 15.0), (200.0, 120.0, 60.0))
    before = find_edges(picture.exposed(), CALIBRATION, SPECIMEN)
    return beside_its_like(lambda: before)


def of_32_px() -> FollowedBeam:
    picture = SmallPicture(0.2, slope=-0.3).beam(16.0)
    return follow_beam(picture.exposed(), CALIBRATION, specimen(32.0 / 7.0))


def with_gaps() -> FollowedBeam:
    picture = SmallPicture(0.2)
    picture.beam()
    for begin in (20.0, 44.0, 60.0):
        picture.add(picture.beside(4.0, 20.0) * within(picture.along, begin, begin + 6.0), (150.0, 160.0, 130.0))
    picture.add(picture.beside(-20.0, -3.0) * within(picture.along, 30.0, 34.0), (150.0, 160.0, 130.0))
    return follow_beam(picture.exposed(), CALIBRATION, SPECIMEN)


def with_a_blurred_edge() -> FollowedBeam:
    picture = SmallPicture(ground=GREY)
    picture.add(
        edge(picture.aside + 7.0) * edge(8.0 - picture.aside, 2.5) * within(picture.along, 0.0, 84.0), (60.0,) * 3
    )
    return follow_beam(picture.exposed(), CALIBRATION, SPECIMEN)


CASES: tuple[Callable[[], FollowedBeam], ...] = (
    bent_in_uneven_light,
    bent_in_grey,
    on_a_shadow,
    on_a_grey_shadow,
    with_a_rim,
    crossed_by_a_cable,
    with_a_reflection,
    beside_clipped_light,
    hidden_between_clicks,
    near_an_earlier_line,
    between_two_lines,
    in_perspective,
    of_varying_width,
    with_rough_edges,
    beside_its_like,
    beside_its_like_after_a_state,
    beside_its_like_after_another_state,
    of_32_px,
    with_gaps,
    with_a_blurred_edge,
)


def steps_of(followed: FollowedBeam, name: str) -> Iterator[str]:
    # Yield the numbers of each step in which a beam was found in a picture, as text; `name` begins each line.
    yield from described(followed.findings, f"{name} findings")
    yield from described(followed.words, f"{name} words")
    if followed.working is not None:
        yield from described([followed.working.noise, followed.working.span], f"{name} noise and span")
    for part in ("working", "strip", "unrolled", "sides", "edges"):
        yield from described(getattr(followed, part), f"{name} {part}")
    if followed.unrolled is not None:
        yield from described(followed.unrolled.bins, f"{name} bins")
    yield from described([followed.path_px, followed.sure_px], f"{name} path and reliable points")
    for title, drawing in draw_steps(followed).items():
        yield from described(drawing, f"{name} drawing of {title}")


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_each_step_of_the_search_has_the_accepted_numbers(case: Callable[[], FollowedBeam], tmp_path: Path) -> None:
    name = case.__name__
    with TracedResults(FOLLOWING, ["_steps_of_channels", "_best_of_each_cell"]) as traced:
        lines = list(steps_of(case(), name))
    check([*lines, *traced.lines()], ACCEPTED / "followed" / f"{name}.txt", tmp_path)
