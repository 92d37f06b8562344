"""The search for edges in all load steps: its order, the earlier edges that it uses, and the files that it writes."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_lab.dataset import segmentation
from eimi_lab.process.errors import InputError
from eimi_lab.vision.check import Flag, Severity
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet

NAN = float("nan")


def flag(name: str, severity: Severity = Severity.UNUSABLE) -> Flag:
    return Flag(name, "finding", 1.0, 0.0, severity)


def edges(tip_mm: float | None, *flags: Flag) -> EdgeSet:
    # Return the edges of a beam whose tip is at (10, tip_mm) mm; no points for None.
    line = np.zeros((0, 2)) if tip_mm is None else np.array([[0.0, 0.0], [10.0, tip_mm]])
    sides = [EdgePoints(line, np.full(len(line), 0.1 * side)) for side in (1, 2)]
    return EdgeSet(*sides, flags, np.full((4, 2), NAN), "digest", 1.5)


def test_a_worker_leaves_a_guess_to_the_process_that_knows_the_earlier_state(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    found = edges(1.0)

    def find(frames: Any, index: int, projection: Any, earlier: Any) -> EdgeSet:
        asked.append((frames, index, projection))
        if index == 7:
            assert earlier() is None
        return found

    monkeypatch.setattr(segmentation, "_frames_of", lambda path: f"frames of {path}")
    monkeypatch.setattr(segmentation, "_edges_in", find)
    assert segmentation.find_alone(Path("run.h5"), 3, None) is found
    assert segmentation.find_alone(Path("run.h5"), 7, None) is None
    assert asked == [("frames of run.h5", 3, None), ("frames of run.h5", 7, None)]


def test_stored_edges_are_returned_and_missing_edges_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    stored = (edges(1.0), edges(2.0))
    dataset: Any = SimpleNamespace(edges=lambda: stored)
    assert segmentation.edges_of_state(dataset, 1) is stored[1]
    dataset = SimpleNamespace(edges=lambda: None, states=[SimpleNamespace(flags=(flag("A"),))])
    monkeypatch.setattr(segmentation, "Frames", lambda given: SimpleNamespace(projection=lambda: "projection"))
    monkeypatch.setattr(
        segmentation, "_edges_in", lambda frames, index, projection: edges(3.0, flag(f"{projection} {index}"))
    )
    assert [one.name for one in segmentation.edges_of_state(dataset, 0).flags] == ["A", "projection 0"]


def test_a_worker_opens_a_dataset_once(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Any] = []
    monkeypatch.setattr(segmentation, "open_dataset", lambda path: opened.append(path) or f"opened {path}")
    monkeypatch.setattr(segmentation, "Frames", lambda dataset: [dataset])
    segmentation._frames_of.cache_clear()
    one, other = Path("one.h5"), Path("other.h5")
    assert segmentation._frames_of(one) is segmentation._frames_of(one)
    assert segmentation._frames_of(other) == ["opened other.h5"]
    segmentation._frames_of(one)
    assert opened == [one, other, one]
    segmentation._frames_of.cache_clear()


def test_points_without_pictures_have_no_frames() -> None:
    with pytest.raises(InputError, match=r"^run\.h5: holds tracked points, which have no images$"):
        segmentation.Frames(SimpleNamespace(kind="points", path="run.h5"))  # type: ignore[arg-type]


def test_edges_in_a_region_are_moved_to_their_place_in_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    region = SimpleNamespace(left=30, top=20, calibration="of the region", cut=lambda image: image[20:, 30:])
    image = np.zeros((40, 60), np.float32)
    moves: list[Any] = []
    followed = SimpleNamespace(moved=lambda by: moves.append(by.tolist()) or "moved")
    given: list[Any] = []

    def follow(picture: Any, calibration: Any, specimen: Any, projection: Any) -> Any:
        given.append((picture.shape, calibration, specimen, projection))
        return followed

    dataset = SimpleNamespace(specimen="specimen", projection=lambda: "grey")
    frames: Any = SimpleNamespace(dataset=dataset, calibration="of the picture")
    monkeypatch.setattr(segmentation, "follow_beam", follow)
    monkeypatch.setattr(segmentation, "region_of", lambda calibration, shape: region)
    assert segmentation._followed(frames, image) == "moved"
    monkeypatch.setattr(segmentation, "region_of", lambda calibration, shape: None)
    assert segmentation._followed(frames, image) is followed
    assert given == [
        ((20, 30), "of the region", "specimen", "grey"),
        ((40, 60), "of the picture", "specimen", "grey"),
    ]
    assert moves == [[30.0, 20.0]]


class Opened:
    # A dataset of two load steps, as `open_dataset` yields it.

    states = (
        SimpleNamespace(index=0, field_mT=0.0, flags=()),
        SimpleNamespace(index=1, field_mT=1.25, flags=()),
    )
    specimen = "specimen"

    def __enter__(self) -> Opened:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def each_image(self, index: int) -> Any:
        return index


def test_a_picture_of_each_stage_and_of_each_state_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames = SimpleNamespace(calibration="calibration", mean=lambda index: f"mean {index}")
    sheets: list[Any] = []
    drawn: list[Any] = []

    def draw(image: Any, edge_set: EdgeSet, calibration: Any, specimen: Any, followed: Any) -> Any:
        drawn.append((image, calibration, specimen, followed))
        return np.full((1024, 4, 3), 50, np.uint8)

    monkeypatch.setattr(segmentation, "open_dataset", lambda path: Opened())
    monkeypatch.setattr(segmentation, "Frames", lambda dataset: frames)
    monkeypatch.setattr(segmentation, "_followed", lambda frames, image: f"followed in {image}")
    monkeypatch.setattr(
        segmentation, "draw_steps", lambda followed: {"strip": np.full((2, 3), int(followed[-1]) + 7, np.uint8)}
    )
    segmentation.write_explained(tmp_path, Path("run.h5"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["step_00_strip.png", "step_01_strip.png"]
    assert cv2.imread(str(tmp_path / "step_01_strip.png"), -1).tolist() == [[8] * 3] * 2
    monkeypatch.setattr(segmentation, "state_mean", lambda images: f"image {images}")
    monkeypatch.setattr(segmentation, "draw_overlay", draw)
    monkeypatch.setattr(
        segmentation, "contact_sheet", lambda small, captions: sheets.append((small, captions)) or small[0]
    )
    segmentation.write_overlays(tmp_path, Path("run.h5"), [edges(1.0, flag("A"), flag("B")), edges(None)])
    assert {"step_00.png", "step_01.png", "contact_sheet.png"} <= {path.name for path in tmp_path.iterdir()}
    ((small, captions),) = sheets
    assert captions == ["00: 0 mT A B", "01: 1.25 mT "]
    assert small[0].shape == (512, 2, 3)
    assert drawn == [
        ("image 0", "calibration", "specimen", None),
        ("image 1", "calibration", "specimen", "followed in image 1"),
    ]
    assert cv2.imread(str(tmp_path / "step_00.png")).shape == (1024, 4, 3)


def test_the_tables_of_edges_and_their_flags(tmp_path: Path) -> None:
    segmentation.write_csv(tmp_path, [edges(2.5, flag("A", Severity.NOTE)), edges(None)])
    assert (tmp_path / "step_00_left.csv").read_text() == (
        "x_mm,y_mm,sigma_mm\n0.000000,0.000000,0.100000\n10.000000,2.500000,0.100000\n"
    )
    assert (tmp_path / "step_00_right.csv").read_text().endswith("10.000000,2.500000,0.200000\n")
    assert (tmp_path / "step_01_right.csv").read_text() == "x_mm,y_mm,sigma_mm\n"
    first, second = json.loads((tmp_path / "quality.json").read_text())["steps"]
    assert (first["step"], first["flags"][0]["name"], first["calibration_digest"]) == (0, "A", "digest")
    assert (second["step"], second["flags"], second["calibration_age_days"]) == (1, [], 1.5)


def test_flags_are_told_before_notes() -> None:
    words = segmentation._in_words
    assert words(()) == "no flags"
    assert words((flag("N", Severity.NOTE), flag("A"), flag("B"))) == "A, B; notes: N"
    assert words((flag("N", Severity.NOTE),)) == "no flags; notes: N"


def test_the_results_of_workers_are_yielded_in_the_order_of_the_states(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def completed(function: Any, arguments: Any, tasks: Any, executor: Any, expected: Any) -> Any:
        asked.append((function, arguments(2), list(tasks), executor, expected))
        for index in (2, 0, 1):
            yield index, lambda index=index: f"edges {index}"

    monkeypatch.setattr(segmentation, "completed", completed)
    dataset: Any = SimpleNamespace(states=[0, 1, 2], path="run.h5")
    executor: Any = "executor"
    assert list(segmentation._found_by_workers(dataset, None, executor)) == ["edges 0", "edges 1", "edges 2"]
    assert asked == [
        (
            segmentation.find_alone,
            {"path": "run.h5", "index": 2, "projection": None},
            [0, 1, 2],
            "executor",
            (InputError,),
        )
    ]
    assert list(segmentation._found_by_workers(dataset, None, None)) == [None] * 3


@pytest.mark.parametrize("clicked", [False, True])
def test_each_search_knows_the_last_reliable_state(monkeypatch: pytest.MonkeyPatch, clicked: bool) -> None:
    # State 1 is not reliable. With clicks, state 1 is expected at state 0, and state 2 too.
    answers = [edges(0.0), edges(5.0, flag("WIDTH_ANOMALY")), edges(1.0, flag("N", Severity.NOTE))]
    asked: list[Any] = []

    def find(frames: Any, index: int, projection: Any, earlier: Any, expected: Any = None) -> EdgeSet:
        known = earlier()
        asked.append((index, None if known is None else answers.index(known), expected is not None))
        return answers[index]

    line = np.array([[0.0, 0.0], [10.0, 0.0]])
    monkeypatch.setattr(segmentation, "_edges_in", find)
    monkeypatch.setattr(segmentation, "_clicked_mm", lambda calibration: line if clicked else None)
    monkeypatch.setattr(segmentation, "search_beside_neighbours", lambda *given: asked.append(given[2]))
    states = [SimpleNamespace(index=k, flags=(flag("S"),) if k == 2 else ()) for k in range(3)]
    specimen = SimpleNamespace(specimen=SimpleNamespace(width_mm=3.0))
    frames: Any = SimpleNamespace(dataset=SimpleNamespace(states=states, specimen=specimen, path="p"), calibration=None)
    said: list[str] = []
    found = segmentation._find_all(frames, None, said.append, None)
    assert asked == [(0, None, False), (1, 0, clicked), (2, 0, clicked), 3.0]
    assert said == [
        "2 points on the left edge and 2 on the right, no flags",
        "2 points on the left edge and 2 on the right, WIDTH_ANOMALY",
        "2 points on the left edge and 2 on the right, S; notes: N",
    ]
    assert [[one.name for one in edge_set.flags] for edge_set in found] == [[], ["WIDTH_ANOMALY"], ["S", "N"]]


def test_the_straightest_beam_judges_the_clamp_for_the_curved_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    # A beam counts as curved from 10 degrees above the smallest angle; the sign of an angle does not matter.
    dark = flag("TOO_DARK")
    offset, larger = (Flag("CALIBRATION_STALE", value, 0.1, "move", widens_in="mm") for value in (0.2, 0.9))
    angles: dict[int, float] = {}

    def judged(*states: tuple[float, tuple[Flag, ...]]) -> list[tuple[Flag, ...]]:
        edge_sets = [edges(0.0, *flags) for _, flags in states]
        angles.update({id(one): angle for one, (angle, _) in zip(edge_sets, states, strict=True)})
        return [one.flags for one in segmentation.clamp_judged_when_straight(edge_sets)]

    monkeypatch.setattr(segmentation, "tip_angle_deg", lambda one: angles[id(one)])
    assert judged((-2.0, ()), (11.9, (larger,)), (-12.1, (dark, larger)), (NAN, (larger,))) == [
        *((), (larger,), (dark,), (larger,)),
    ]
    assert judged((40.0, (dark,)), (-41.0, (larger, dark)), (3.0, (offset, dark)), (-3.5, ())) == [
        *((dark,), (dark, offset), (offset, dark), ()),
    ]
    assert judged((NAN, (offset,)), (NAN, ())) == [(offset,), ()]
