"""The functions that segment, correct and import datasets call each other in the right order."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import h5py
import matplotlib
import numpy as np
import pytest

from eimi_fitting.time.measured import Motion
from eimi_lab.config.calibration import Calibration, load_calibration
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset import (
    dark_and_flat,
    importing,
    plotting,
    restating,
    segmentation,
    sensor_logs,
    stored_edges,
)
from eimi_lab.dataset.layout import get_text
from eimi_lab.dataset.logged_sensor import LoggedSensor, SensorLog
from eimi_lab.dataset.moving import motion_import, recorded_motion, stored_motions
from eimi_lab.dataset.moving.film import Film
from eimi_lab.dataset.moving.filmed_motion import FilmedPoints
from eimi_lab.dataset.points import Load
from eimi_lab.dataset.steps import RingDownStep, SetPoint
from eimi_lab.process.errors import InputError
from eimi_lab.showing.palette import IN_ORDER
from eimi_lab.vision.check import Flag, Severity
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet
from tests.shared.noted import Noted, noted

NAN = float("nan")
PATH = Path("run.h5")
SPECIMEN = load_specimen("type1")
CALIBRATION = Calibration(
    pixels_per_mm=8.0, clamp_midpoint_px=(50.0, 40.0), axis_angle_deg=90.0, gravity_angle_deg=90.0
)


def edges(points: int) -> EdgeSet:
    line = np.arange(2.0 * points).reshape(points, 2)
    side = EdgePoints(line, np.ones(points))
    return EdgeSet(side, side, (), np.full((4, 2), NAN), "digest", None)


# Segmentation


def test_a_dataset_is_segmented_under_its_lock_and_written_after_it_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []

    @contextmanager
    def context(name: str, value: Any) -> Iterator[Any]:
        calls.append(name)
        yield value
        calls.append(f"end of {name}")

    dataset: Any = SimpleNamespace(
        kind="frames",
        specimen=SPECIMEN,
        recorded_ring_downs=lambda: ["step"],
        states=[],
        refuse_without_state=lambda: calls.append("check the states"),
    )
    frames = Noted(calls, "frames", projection=lambda: "projection")
    monkeypatch.setattr(segmentation, "only_writer", lambda path: context(f"lock {path}", None))
    monkeypatch.setattr(segmentation, "open_dataset", lambda path: context(f"open {path}", dataset))
    monkeypatch.setattr(segmentation, "Frames", noted(calls, "make", lambda given: frames))
    monkeypatch.setattr(segmentation, "_find_all", noted(calls, "find", "edges"))
    monkeypatch.setattr(segmentation, "recorded_motions", noted(calls, "motions", "moved"))
    monkeypatch.setattr(segmentation, "write_edges", noted(calls, "write"))
    assert segmentation.segment(PATH, "report", "executor") == "edges"  # type: ignore[arg-type, comparison-overlap]
    assert calls == [
        "lock run.h5",
        "open run.h5",
        "check the states",
        ("make", dataset),
        ("frames.projection",),
        ("find", frames, "projection", "report", "executor"),
        ("motions", dataset, "edges", "projection", "report"),
        "end of open run.h5",
        ("write", PATH, "edges", "projection", "moved", 30.0, ("ring_down",)),
        "end of lock run.h5",
    ]
    dataset.kind = "points"
    with pytest.raises(InputError, match=r"^run\.h5: holds tracked points, so there are no edges to find$"):
        segmentation.segment(PATH, "report")  # type: ignore[arg-type]


@pytest.mark.parametrize("corrected", [False, True])
@pytest.mark.parametrize("size", [(2, 3), (2, 3, 3)])
def test_the_frames_of_a_state_are_averaged_and_corrected(
    monkeypatch: pytest.MonkeyPatch, corrected: bool, size: tuple[int, ...]
) -> None:
    calls: list[Any] = []
    correction = SimpleNamespace(apply=lambda image: f"corrected {image}") if corrected else None
    states = [SimpleNamespace(index=4), SimpleNamespace(index=7)]
    dataset: Any = SimpleNamespace(
        kind="frames", calibration=CALIBRATION, specimen=SPECIMEN, states=states, correction=lambda: correction,
        path=PATH,
        each_image=lambda index: f"images {index}", frame_format=lambda: (size, np.dtype(np.uint8)),
    )  # fmt: skip
    monkeypatch.setattr(segmentation, "state_mean", lambda images: f"mean of {images}")
    monkeypatch.setattr(
        segmentation, "choose_projection", lambda images, *given: calls.append((list(images), *given)) or "chosen"
    )
    frames = segmentation.Frames(dataset)
    means = [f"{'corrected ' * corrected}mean of images {index}" for index in (4, 7)]
    assert frames.mean(7) == means[1]  # type: ignore[comparison-overlap]
    assert frames.projection() == ("chosen" if len(size) == 3 else None)
    assert calls == [(means, CALIBRATION, 3.0, 30.0)] * (len(size) == 3)


@pytest.mark.parametrize("in_region", [False, True])
def test_edges_are_found_in_the_mean_image_with_all_that_is_known(
    monkeypatch: pytest.MonkeyPatch, in_region: bool
) -> None:
    calls: list[Any] = []
    image = np.zeros((5, 6))
    region = SimpleNamespace(
        cut=lambda given: ("cut", given.shape), calibration="of the region", in_picture=lambda found: ("moved", found)
    )
    calibration = SimpleNamespace(age_days=lambda taken: f"age at {taken}")
    dataset = SimpleNamespace(specimen=SPECIMEN, start_time=lambda: "noon")
    frames: Any = SimpleNamespace(mean=lambda index: image, calibration=calibration, dataset=dataset)
    monkeypatch.setattr(segmentation, "region_of", noted(calls, "region", region if in_region else None))
    monkeypatch.setattr(segmentation, "find_edges", noted(calls, "find", "found"))
    given: Any = ("projection", "earlier", "expected", "between")
    found = segmentation._edges_in(frames, 3, *given)
    assert found == (("moved", "found") if in_region else "found")  # type: ignore[comparison-overlap]
    at, (name, picture, *more) = calls
    assert at == ("region", calibration, (5, 6))
    assert name == "find"
    assert picture == ("cut", (5, 6)) if in_region else picture is image
    assert more == [
        "of the region" if in_region else calibration,
        SPECIMEN,
        ("calibration_age_days", "age at noon"),
        ("projection", "projection"),
        ("earlier", "earlier"),
        ("expected_mm", "expected"),
        ("between_mm", "between"),
    ]


def test_clicked_points_are_on_the_beam() -> None:
    # At 8 px/mm, with the beam down from (50, 40) px, (50, 64) is 3 mm along it, and (58, 48) 1 mm along and beside it.
    assert segmentation._clicked_mm(CALIBRATION) is None
    assert segmentation._clicked_mm(CALIBRATION.model_copy(update={"picture": SimpleNamespace(along_px=None)})) is None
    clicked = CALIBRATION.model_copy(update={"picture": SimpleNamespace(along_px=((50.0, 64.0), (58.0, 48.0)))})
    np.testing.assert_allclose(np.abs(segmentation._clicked_mm(clicked)), [[3.0, 0.0], [1.0, 1.0]], atol=1e-9)


def test_a_state_is_searched_again_with_its_guide(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []

    def find(frames: Any, index: int, projection: Any, earlier: Any, *lines: Any) -> EdgeSet:
        calls.append((index, projection, earlier(), lines))
        return edges(1)

    def beside(edge_sets: Any, search_again: Any, width_mm: float) -> None:
        search_again(5, "guide", "line", "other line")

    monkeypatch.setattr(segmentation, "_edges_in", find)
    monkeypatch.setattr(segmentation, "search_beside_neighbours", beside)
    frames: Any = SimpleNamespace(
        dataset=SimpleNamespace(states=[], specimen=SPECIMEN, path=PATH), calibration=CALIBRATION
    )
    segmentation._find_all(frames, "projection", print, None)  # type: ignore[arg-type]
    assert calls == [(5, "projection", "guide", ("line", "other line"))]


@pytest.mark.parametrize("suggested", [None, "edges"])
def test_a_picture_without_a_beam_is_ruled_with_the_expected_beam(
    monkeypatch: pytest.MonkeyPatch, suggested: Any
) -> None:
    # The beam is 30 mm long and 3 mm wide; in pixels, 8 px/mm, from (50, 40) px down.
    calls: list[Any] = []
    dataset = SimpleNamespace(
        specimen=SPECIMEN, projection=lambda: "projection", images=lambda index: [f"first image of {index}", "second"]
    )
    frames = SimpleNamespace(mean=lambda index: f"mean of {index}", calibration=CALIBRATION)
    answer = SimpleNamespace(words="turn the axis", edges_px=suggested)
    monkeypatch.setattr(segmentation, "open_dataset", lambda path: nullcontext(dataset))
    monkeypatch.setattr(segmentation, "Frames", lambda given: frames)
    monkeypatch.setattr(segmentation, "suggest_correction", noted(calls, "suggest", answer))
    monkeypatch.setattr(segmentation, "ruled_picture", noted(calls, "rule", np.full((2, 3), 9, np.uint8)))
    words, png = segmentation.explain_missing_beam(PATH, 6)
    assert words == "turn the axis" + (" (green in the picture)" if suggested else "")
    assert cv2.imdecode(np.frombuffer(png, np.uint8), -1).tolist() == [[9, 9, 9]] * 2
    asked, (name, shown, lines, found) = calls
    assert asked == ("suggest", "mean of 6", CALIBRATION, SPECIMEN, "projection")
    assert (name, shown, found) == ("rule", "first image of 6", suggested)
    left, right, clamp = (np.array(line) for line in lines)
    np.testing.assert_allclose(sorted([left[0, 0], right[0, 0]]), [38.0, 62.0])
    np.testing.assert_allclose([left[:, 1], right[:, 1]], [[40.0, 280.0]] * 2)
    np.testing.assert_allclose(clamp[:, 1], [40.0, 40.0])
    np.testing.assert_allclose(np.ptp(clamp[:, 0]), 72.0)
    assert np.sign(left[0, 0] - 50.0) == np.sign(clamp[0, 0] - 50.0)


# Motions of a run


class Recorded:
    # A dataset with two ring-downs and creep in some of its states.

    def __init__(self, **creeping: float) -> None:
        self.path, self.creeping = PATH, creeping
        self.states = [SimpleNamespace(index=k, current_A=current) for k, current in enumerate((0.1, 0.2, None, 0.4))]

    def set_points(self) -> tuple[SetPoint, ...]:
        return SetPoint(1.0, 0.1, 0.01), SetPoint(5.0, 0.2, 0.02), SetPoint(9.0, 0.4, 0.03)

    def recorded_ring_downs(self) -> Any:
        steps = [RingDownStep(k, 0.4, 0.0, 20.0 + k, 0.05, 10, 3 + k, 50.0) for k in (0, 1)]
        return [(step, f"frames {step.ring_down}") for step in steps]

    def creep_frames(self, index: int) -> Any:
        begins_s = self.creeping.get(f"state{index}")
        return None if begins_s is None else SimpleNamespace(time_s=np.array([begins_s, 99.0]), name=index)


def moved(label: str, kind: Any = "ring_down") -> Motion:
    places = np.zeros((2, 1, 2))
    return Motion(kind, places, places[0], np.array([[0.1], [0.2]]), np.ones((2, 1)), label=label)


def test_each_ring_down_of_a_run_is_followed_from_its_step(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    said: list[str] = []
    monkeypatch.setattr(
        recorded_motion, "_followed", lambda dataset, *given: asked.append(given) or [moved(given[-1], given[1])]
    )
    dataset: Any = Recorded()
    found = recorded_motion.recorded_motions(dataset, [edges(0), edges(2)], None, said.append)
    points = dataset.set_points()
    assert asked == [
        ("frames 0", "ring_down", SetPoint(20.0, 0.0, 0.05), points, 0.4, None, "run.h5: ring-down 0"),
        ("frames 1", "ring_down", SetPoint(21.0, 0.0, 0.05), points, 0.4, None, "run.h5: ring-down 1"),
    ]
    assert [motion.lost_frames for motion in found] == [3, 4]
    assert said == ["run.h5: ring-down 0: 2 frames of ring-down", "run.h5: ring-down 1: 2 frames of ring-down"]
    assert recorded_motion.recorded_motions(dataset, [edges(0)], None, said.append) == ()
    assert len(asked) == 2


@pytest.mark.parametrize(
    ("state", "begins_s", "step", "held_A"),
    [
        (1, 5.0, 1, 0.1),  # from 0.1 A to 0.2 A, at the time of the step
        (1, 4.9, None, 0.1),  # before it: 0.1 A were held
        (0, 1.5, 0, 0.0),
        (0, 0.5, None, 0.0),  # before the first set-point
        (3, 10.0, None, None),  # the current before is not known
        (2, 10.0, 2, 0.2),
    ],
)
def test_creep_begins_with_the_last_change_of_the_current(
    monkeypatch: pytest.MonkeyPatch, state: int, begins_s: float, step: int | None, held_A: float
) -> None:
    asked: list[Any] = []
    said: list[str] = []
    monkeypatch.setattr(
        recorded_motion, "_followed", lambda dataset, *given: asked.append(given) or [moved(given[-1], given[1])]
    )
    dataset: Any = Recorded(**{f"state{state}": begins_s})
    monkeypatch.setattr(dataset, "recorded_ring_downs", list)
    found = recorded_motion.recorded_motions(dataset, [edges(2)], "projection", said.append)  # type: ignore[arg-type]
    if step is None:
        assert (found, asked, said) == ((), [], [])
        return
    ((frames, kind, at, points, from_A, projection, label),) = asked
    assert (frames.name, kind, from_A, projection) == (state, "creep", held_A, "projection")
    assert (at, points) == (dataset.set_points()[step], dataset.set_points())
    assert (label, said) == (f"run.h5: state {state}", [f"run.h5: state {state}: 2 frames of creep"])


@pytest.mark.parametrize("corrected", [False, True])
@pytest.mark.parametrize("row_time_s", [None, 0.001])
def test_a_recording_of_a_run_becomes_a_motion_after_its_step(
    monkeypatch: pytest.MonkeyPatch, corrected: bool, row_time_s: float | None
) -> None:
    asked: list[Any] = []
    middle = np.arange(16.0).reshape(4, 2, 2)
    along = np.array([1.0, 2.0])
    film = Film(along, middle, middle, middle)
    times = np.array([[-0.1, 0.1], [0.0, 0.1], [0.1, 0.2], [0.2, 0.3]])
    points = FilmedPoints(middle + 100.0, np.array([[1.0, 0.0], [2.0, 0.0]]), times, np.arange(8.0).reshape(4, 2))

    def follow(images: Any, *given: Any) -> Film:
        asked.append((list(images), *given))
        return film

    def place(*given: Any) -> FilmedPoints:
        asked.append(given)
        return points

    monkeypatch.setattr(recorded_motion, "follow_film", follow)
    monkeypatch.setattr(recorded_motion, "points_of_film", place)
    settings = {"row_time_s": row_time_s, "exposure_s": 0.004}
    correction = SimpleNamespace(apply=lambda image: image + 10) if corrected else None
    dataset: Any = SimpleNamespace(
        calibration=CALIBRATION, specimen=SPECIMEN, correction=lambda: correction, camera_setting=settings.get
    )
    frames: Any = SimpleNamespace(images=lambda: iter([1, 2, 3, 4, 5]), time_s=np.array([9.8, 9.9, 10.1, 10.2, 10.3]))
    points_before = (
        SetPoint(8.0, 0.1, 0.01),
        SetPoint(9.0, 0.2, 0.01),
        SetPoint(9.9, 0.4, 0.05),
        SetPoint(11.0, 0.0, 0),
    )
    step = points_before[2]
    given = (dataset, frames, "creep", step, points_before, 0.2, "projection", "a label")
    (motion,) = recorded_motion._followed(*given)  # type: ignore[arg-type]
    images, (placed_film, calibration, specimen, frame_s, row_s) = asked
    assert images == ([image + 10 * corrected for image in range(1, 6)], CALIBRATION, SPECIMEN, "a label", "projection")
    assert (placed_film, calibration, specimen, row_s) == (film, CALIBRATION, SPECIMEN, row_time_s or 0.0)
    np.testing.assert_allclose(frame_s, [-0.1, 0.0, 0.2, 0.3], atol=1e-12)
    np.testing.assert_array_equal(motion.points_mm, points.points_mm[2:])
    np.testing.assert_array_equal(motion.time_s, times[2:])
    np.testing.assert_array_equal(motion.sigma_mm, points.sigma_mm[2:])
    np.testing.assert_array_equal(motion.rest_mm, points.rest_mm)
    assert (motion.kind, motion.exposure_s, motion.label) == ("creep", 0.004, "a label")
    assert (motion.from_A, motion.to_A, motion.step_uncertainty_s) == (0.2, 0.4, 0.05)
    np.testing.assert_allclose(motion.history, [(-1.9, 0.1), (-0.9, 0.2)])
    points = replace(points, time_s=times - 0.2)
    assert list(recorded_motion._followed(*given)) == []  # type: ignore[arg-type]
    dataset.calibration = None
    assert list(recorded_motion._followed(*given)) == []  # type: ignore[arg-type]


def test_a_recording_without_a_beam_is_left_out_with_a_note(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*given: Any) -> None:
        raise InputError("run.h5: ring-down 0: no beam was found")

    monkeypatch.setattr(recorded_motion, "follow_film", fail)
    dataset: Any = SimpleNamespace(calibration=CALIBRATION, specimen=SPECIMEN, correction=lambda: None)
    frames: Any = SimpleNamespace(images=lambda: iter([]))
    step = SetPoint(1.0, 0.0, 0.0)
    assert list(recorded_motion._followed(dataset, frames, "ring_down", step, (), 0.4, None, "label")) == []
    assert capsys.readouterr().err == "eimi: note: run.h5: ring-down 0: no beam was found\n"


# Motions in a file


@pytest.mark.parametrize("calibrated", [False, True])
def test_a_dataset_of_motions_has_the_gravity_of_its_calibration(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, calibrated: bool
) -> None:
    calls: list[Any] = []

    def write(path: Path, *_: Any) -> None:
        with h5py.File(path, "w") as file:
            file.create_group("entry")

    monkeypatch.setattr(motion_import, "write_points", noted(calls, "points", write))
    monkeypatch.setattr(motion_import, "write_motions", noted(calls, "motions"))
    motions = [moved("a", "creep"), moved("b", "creep")]
    level = CALIBRATION.model_copy(update={"gravity_angle_deg": 0.0, "gravity": False}) if calibrated else None
    motion_import.write_motion_dataset(tmp_path / "m.h5", motions, SPECIMEN, level, 33.0, True)
    (_, _, header, angle_deg, loads, tracked, gravity), (_, _, kind, stored, length_mm) = calls
    assert (header.specimen, header.calibration, loads, tracked) == (SPECIMEN, level, [], [])
    assert abs(angle_deg) == pytest.approx(90.0 if calibrated else 33.0)
    assert gravity is not calibrated
    assert (kind, stored, length_mm) == ("creep", motions, 30.0)
    assert (tmp_path / "m.h5").is_file()
    calls.clear()
    with pytest.raises(InputError, match=r"m\.h5: exists"):
        motion_import.write_motion_dataset(tmp_path / "m.h5", motions, SPECIMEN)
    motion_import.write_motion_dataset(tmp_path / "m.h5", motions, SPECIMEN, force=True)
    assert calls[-2][3:] == (0.0, [], [], True)


def test_motions_are_added_with_room_for_their_arrays(monkeypatch: pytest.MonkeyPatch) -> None:
    # Two frames of one point: 4 coordinates of 8 bytes, and 2 times of 8 bytes, counted four times.
    calls: list[Any] = []
    monkeypatch.setattr(motion_import, "rewritten", noted(calls, "rewrite", lambda path, size: nullcontext("entry")))
    monkeypatch.setattr(motion_import, "write_motions", noted(calls, "motions"))
    motions = [moved("a"), moved("b")]
    motion_import.add_motions(PATH, motions, SPECIMEN)
    assert calls == [("rewrite", PATH, 2 * (32 + 4 * 16)), ("motions", "entry", "ring_down", motions, 30.0)]


def test_stored_motions_of_a_kind_are_replaced() -> None:
    with h5py.File("memory.h5", "w", driver="core", backing_store=False) as file:
        stored_motions.write_motions(file, "creep", [moved("a", "creep"), moved("b", "creep")], 30.0)
        stored_motions.write_motions(file, "ring_down", [moved("c")], 30.0)
        stored_motions.write_motions(file, "creep", [moved("d", "creep")], 30.0)
        assert [motion.label for motion in stored_motions.read_motions(file, "creep")] == ["d"]
        assert [motion.label for motion in stored_motions.read_motions(file, "ring_down")] == ["c"]
        exposed = [replace(moved("e"), exposure_s=exposure_s) for exposure_s in (None, 0.004)]
        stored_motions.write_motions(file, "ring_down", exposed, 30.0)
        read = stored_motions.read_motions(file, "ring_down")
        assert [motion.exposure_s for motion in read] == [None, 0.004]
        stored_motions.write_motions(file, "creep", [], 30.0)
        assert stored_motions.read_motions(file, "creep") == ()
        assert set(file) == {"ring_down_points"}


# Edges in a file


def test_edges_are_stored_with_room_for_edges_motions_and_flags(monkeypatch: pytest.MonkeyPatch) -> None:
    # Each side of 3 points has 6 coordinates and 3 deviations of 8 bytes, and is stored twice.
    calls: list[Any] = []
    entry = {"states/index": [0, 1]}
    monkeypatch.setattr(stored_edges, "rewritten", noted(calls, "rewrite", lambda path, size: nullcontext(entry)))
    for name in ("drop_edges", "_write", "write_plots", "_comply_with_definition", "write_motions", "note"):
        monkeypatch.setattr(stored_edges, name, noted(calls, name))
    monkeypatch.setattr(stored_edges, "group", lambda *given: given)
    both = [edges(3), edges(3)]
    motions = [moved("a", "creep"), moved("b"), moved("c", "creep")]
    projection: Any = SimpleNamespace(to_json=lambda: "{}")
    stored_edges.write_edges(PATH, both, projection, motions, 30.0)
    process = (entry, "segmentation", "NXprocess")
    assert calls == [
        ("rewrite", PATH, 2 * 4 * (48 + 24) + 3 * 3 * 32 + 512 * 2),
        ("drop_edges", entry),
        ("_write", process, both),
        ("write_plots", entry, process, both),
        ("_comply_with_definition", entry),
        ("write_motions", entry, "creep", [motions[0], motions[2]], 30.0),
        ("write_motions", entry, "ring_down", [motions[1]], 30.0),
        ("note", process, "projection", "{}", "application/json"),
    ]
    calls.clear()
    stored_edges.write_edges(PATH, both, None, motions[1:2], 30.0, ("creep",))
    assert [call for call in calls if call[0] == "write_motions"] == [
        ("write_motions", entry, "creep", [], 30.0),
        ("write_motions", entry, "ring_down", [motions[1]], 30.0),
    ]
    calls.clear()
    stored_edges.write_edges("run.h5", both)
    assert [call[0] for call in calls] == ["rewrite", "drop_edges", "_write", "write_plots", "_comply_with_definition"]
    with pytest.raises(ValueError, match=r"^run\.h5: 1 sets of edges are given for 2 states; give one set of"):
        stored_edges.write_edges(PATH, both[:1])


def test_the_default_plot_is_that_of_the_frames_after_the_edges_are_removed() -> None:
    with h5py.File("memory.h5", "w", driver="core", backing_store=False) as file:
        file.attrs["default"] = "segmentation"
        stored_edges.drop_edges(file)
        assert file.attrs["default"] == "segmentation"
        file.create_group("segmentation")
        stored_edges.drop_edges(file)
        assert (file.attrs["default"], list(file)) == ("data", [])


# Corrections of a dataset


class Restated:
    def __init__(self, calibration: Any = CALIBRATION, protocol: str | None = None) -> None:
        self.specimen, self.calibration, self.path, self.protocol = SPECIMEN, calibration, PATH, protocol
        self.kind = "frames"

    def refuse_without_state(self) -> None:
        pass

    def text(self, name: str) -> str | None:
        return {"protocol": self.protocol}[name]

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: Any) -> None:
        pass

    def frame_format(self) -> Any:
        return (400, 640), np.dtype(np.uint8)


@pytest.mark.parametrize("protocol", [None, "a protocol"])
@pytest.mark.parametrize("differs", ["", "specimen", "calibration"])
def test_changed_texts_are_replaced_with_the_fields_and_without_the_edges(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], protocol: str | None, differs: str
) -> None:
    calls: list[Any] = []
    old, new = SPECIMEN, "corrected calibration"
    other = replace(SPECIMEN.mechanics(), width_mm=2.9)
    beam = SimpleNamespace(text="new specimen", mechanics=lambda: other)
    corrected = SimpleNamespace(text=new, mT_per_A=3.0)
    entry = {
        "states/field": np.array([1.0, 2.0]), "data/field": np.array([4.0]),
        "states/current": np.array([0.5, 1.0]), "data/set_current": np.array([2.0]),
    }  # fmt: skip
    fields = {name: Column(values) for name, values in entry.items()}
    dataset = Restated(protocol=protocol)
    monkeypatch.setattr(restating, "open_dataset", lambda path: dataset)
    monkeypatch.setattr(restating, "_same_beam", noted(calls, "beam", beam))
    monkeypatch.setattr(restating, "_calibration", noted(calls, "calibration", corrected))
    monkeypatch.setattr(restating, "check_clicked_points", noted(calls, "clicks"))
    monkeypatch.setattr(restating, "_check_coil_constant", noted(calls, "constant"))
    monkeypatch.setattr(restating, "_imported_motions", lambda dataset: ["creep"])
    lines = {old.text: "specimen", CALIBRATION.text: "calibration"}
    monkeypatch.setattr(
        restating, "differences", lambda before, after: (f"to {after}",) if lines[before] == differs else ()
    )
    monkeypatch.setattr(restating, "rewritten", noted(calls, "rewrite", lambda path, size: nullcontext(fields)))
    monkeypatch.setattr(restating, "_replace", noted(calls, "replace"))
    monkeypatch.setattr(restating, "drop_edges", noted(calls, "drop"))
    monkeypatch.setattr(restating, "drop_motions", noted(calls, "drop motions"))
    monkeypatch.setattr(type(CALIBRATION), "text", property(lambda self: "old calibration"))
    lines["old calibration"] = "calibration"
    lines[old.text] = "specimen"
    changes = {"axis_angle_deg": 89.0}
    file: Any = Path("c.toml")
    said = restating.restate(PATH, specimen="s.toml", calibration=file, changes=changes)
    after = {"specimen": beam, "calibration": corrected}
    assert said == ((f"{differs}: to {after[differs].text}",) if differs else ())
    assert calls[:4] == [
        ("beam", dataset, "s.toml"),
        ("calibration", dataset, CALIBRATION, file, changes),
        ("clicks", corrected, beam, (400, 640)),
        ("constant", dataset, CALIBRATION, corrected, file),
    ]
    written = [
        ("rewrite", PATH, 65536), ("replace", fields, {differs: after.get(differs)}), ("drop", fields),
        ("drop motions", fields),
    ]  # fmt: skip
    assert calls[4:] == written * bool(differs)
    assert ("the imported creep is older than this correction" in capsys.readouterr().err) is bool(differs)
    computed = bool(protocol and differs)  # from the currents
    assert fields["states/field"].values.tolist() == ([1.5, 3.0] if computed else [1.0, 2.0])
    assert fields["data/field"].values.tolist() == ([6.0] if computed else [4.0])
    calls.clear()
    restating.restate(PATH)
    assert calls[:2] == [("beam", dataset, None), ("calibration", dataset, CALIBRATION, None, {})]


class Column:
    def __init__(self, values: Any) -> None:
        self.values = values

    def __getitem__(self, key: Any) -> Any:
        return self.values

    def __setitem__(self, key: Any, values: Any) -> None:
        self.values = values


def test_a_corrected_specimen_has_the_name_of_the_stored_one(monkeypatch: pytest.MonkeyPatch) -> None:
    dataset: Any = Restated()
    assert restating._same_beam(dataset, None) is SPECIMEN
    named = SimpleNamespace(specimen=SimpleNamespace(name=SPECIMEN.specimen.name))
    monkeypatch.setattr(restating, "load_specimen", lambda file: named)
    assert restating._same_beam(dataset, "s.toml") is named
    named.specimen.name = "other"
    words = r"^s\.toml: specimen\.name = 'other', but the specimen of run\.h5 is '(.*)'; .* specimen\.name = '\1'$"
    with pytest.raises(InputError, match=words):
        restating._same_beam(dataset, "s.toml")


def test_a_corrected_calibration_keeps_the_places_that_it_does_not_give(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    dataset: Any = Restated()
    monkeypatch.setattr(restating, "changed_calibration", noted(calls, "changed", "with changes"))
    monkeypatch.setattr(restating, "missing_places", noted(calls, "missing", ("axis_angle_deg",)))
    monkeypatch.setattr(restating, "load_calibration", noted(calls, "load", "loaded"))
    monkeypatch.setattr(restating, "region_of", noted(calls, "region"))
    file = Path("c.toml")
    size = (400, 640)
    assert restating._calibration(dataset, CALIBRATION, None, {}) is CALIBRATION
    assert restating._calibration(dataset, CALIBRATION, None, {"a": 1}) == "with changes"  # type: ignore[comparison-overlap]
    assert restating._calibration(dataset, CALIBRATION, file, {"a": 1}) == "loaded"  # type: ignore[comparison-overlap]
    assert calls == [
        ("region", CALIBRATION, size),
        ("changed", CALIBRATION, {"a": 1}),
        ("region", "with changes", size),
        ("missing", file, {"a": 1}),
        ("load", file, {"axis_angle_deg": 90.0, "a": 1}),
        ("region", "loaded", size),
    ]


def test_replaced_texts_are_kept_with_their_number_and_date(monkeypatch: pytest.MonkeyPatch) -> None:
    dates = iter(["noon", "one", "two"])
    monkeypatch.setattr(restating, "now", lambda: next(dates))
    calibration = load_calibration("virtual_calibration")
    thinner = SPECIMEN.model_copy(
        update={"specimen": SPECIMEN.specimen.model_copy(update={"name": "thin", "material": "Ecoflex"})}
    )
    with h5py.File("memory.h5", "w", driver="core", backing_store=False) as file:
        for name in ("calibration", "specimen", "title", "sample/description"):
            file[name] = f"old {name}"
        del file["calibration"], file["specimen"]
        file["calibration/data"], file["specimen/data"] = "first", "first"
        restating._replace(file, {"calibration": calibration})
        assert file["title"][()] == b"old title"
        restating._replace(file, {"calibration": calibration, "specimen": thinner})
        former = file["former"]
        assert sorted(former) == ["calibration_0", "calibration_1", "specimen_0"]
        assert [get_text(former[name], "data") for name in ("calibration_0", "specimen_0")] == ["first", "first"]
        assert get_text(former["calibration_1"], "data") == get_text(file["calibration"], "data") == calibration.text
        assert [get_text(former[name], "date") for name in sorted(former)] == ["noon", "one", "two"]
        assert get_text(file["specimen"], "type") == get_text(file["calibration"], "type") == "application/toml"
        assert former.attrs["NX_class"] == "NXcollection"
        assert (get_text(file, "title"), get_text(file["sample"], "description")) == ("thin, Ecoflex", "Ecoflex")


# Sensors


SENSORS = (
    LoggedSensor("beam", "PT100", "specimen_temperature", "degC", 1.0, None, None),
    LoggedSensor("hall", "F41", "field", "mT", -1.0, 0.05, 0.01),
    LoggedSensor("room", "SHT", "humidity", "%", 1.0, None, None),
)


def test_the_readings_of_sensors_are_stored_with_what_is_known_of_the_sensors() -> None:
    with h5py.File("memory.h5", "w", driver="core", backing_store=False) as file:
        entry = file.create_group("entry")
        entry["data/state"] = [0, 0, 1, 2]
        entry.create_group("sample")
        sensor_logs.make_sensor_logs(entry, ())
        assert "environment" not in entry["sample"]
        assert sensor_logs.sensor_names(entry) == ()
        sensor_logs.make_sensor_logs(entry, SENSORS)
        environment = entry["sample/environment"]
        assert environment.attrs["NX_class"] == "NXenvironment"
        assert get_text(environment, "name") == "sensors of the bench"
        assert sensor_logs.sensor_names(entry) == ("beam", "hall", "room")
        hall = environment["hall"]
        facts = {name: get_text(hall, name) for name in ("name", "model", "short_name", "measurement")}
        assert facts == {"name": "hall", "model": "F41", "short_name": "field", "measurement": "magnetic_field"}
        assert get_text(environment["beam"], "measurement") == "temperature"
        assert "measurement" not in environment["room"]
        kinds = {"": "NXsensor", "stated": "NXcollection", "value_log": "NXlog"}
        assert {name: (hall[name] if name else hall).attrs["NX_class"] for name in kinds} == kinds
        log = sensor_logs.log_of(entry, "hall")
        assert {name: column.attrs["units"] for name, column in log.items()} == {
            "time": "s", "value": "mT", "value_errors": "mT"
        }  # fmt: skip
        for number, column in enumerate(log.values()):
            column.resize(4, axis=0)
            column[:] = 10.0 * number + np.arange(4.0)
        sensor_logs.log_of(entry, "beam")["time"].resize(1, axis=0)
        found = {log.sensor.name: log for log in sensor_logs.read_sensor_logs(entry, 2)}
        assert tuple(log.sensor for log in found.values()) == SENSORS
        assert found["hall"].state.tolist() == [0, 0, 1]
        assert found["hall"].time_s.tolist() == [0.0, 1.0, 2.0]
        assert found["hall"].value.tolist() == [10.0, 11.0, 12.0]
        assert found["hall"].standard_uncertainty.tolist() == [20.0, 21.0, 22.0]
        assert isinstance(found["beam"], SensorLog)
        assert len(found["beam"].value) == 0


# Drawings


@pytest.mark.parametrize("lines", [False, True])
@pytest.mark.parametrize(("fields", "name"), [((0.0, 2.0), "field, mT"), ((3.0, 3.0), "state")])
def test_each_state_is_drawn_in_the_colour_of_its_field(lines: bool, fields: tuple[float, float], name: str) -> None:
    states: Any = [SimpleNamespace(field_mT=field, index=4 + k) for k, field in enumerate(fields)]
    first, second = np.array([[0.0, 1.0], [2.0, 3.0]]), np.array([[5.0, 6.0]])
    drawing = plotting.drawn_places(states, [[first, second], [second]], ("along", "across"), lines)
    axes, bar = drawing.axes
    found = axes.get_lines()
    assert [np.column_stack(line.get_data()).tolist() for line in found] == [
        first.tolist(), second.tolist(), second.tolist()
    ]  # fmt: skip
    assert {(line.get_linestyle(), line.get_marker()) for line in found} == {("-", "None") if lines else ("None", "o")}
    assert {line.get_markersize() for line in found} == {3.0}
    dark, bright = (matplotlib.colormaps[IN_ORDER](end) for end in (0.0, 1.0))
    assert [line.get_color() for line in found] == [dark, dark, bright]
    assert (axes.get_xlabel(), axes.get_ylabel(), bar.get_ylabel()) == ("along, mm", "across, mm", name)
    assert (axes.get_aspect(), axes.get_adjustable()) == (1.0, "datalim")
    assert drawing.get_figheight() == 4.5


# Imports


def test_states_are_imported_one_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    said: list[str] = []
    frames = [SimpleNamespace(path=Path(f"f{k}.png"), time_s=float(k)) for k in range(5)]
    by_state: Any = [(Load(None, 2.5, 0.1, None), frames[:3]), (Load(0.5, 4.0, 0.2, None), frames[3:])]
    images = [np.full((1, 2), k, np.uint8) for k in range(5)]
    monkeypatch.setattr(importing, "_flags", noted(calls, "flags", ("flag",)))
    writer: Any = Noted(calls, "writer")
    importing._append_states(writer, by_state, iter(images), images[0], False, said.append)
    (_, *of_first), (_, stored, *more), (_, *of_second), (_, later, *others) = calls
    assert of_first == [[frame.path for frame in frames[:3]], images[:3], None]
    assert (of_second[0], of_second[2] is images[2]) == ([frame.path for frame in frames[3:]], True)
    assert [frame.number for frame in (*stored, *later)] == [0, 1, 2, 3, 4]
    assert [frame.image is image for frame, image in zip((*stored, *later), images, strict=True)] == [True] * 5
    assert all(np.isnan(frame.timestamp_s) for frame in (*stored, *later))
    assert dict(more[1:]) == {"field_mT": 2.5, "tip_force_N": 0.1, "time_s": [0.0, 1.0, 2.0], "flags": ("flag",)}
    assert np.isnan(dict(more)["current_A"])
    assert dict(others) == {
        "current_A": 0.5, "field_mT": 4.0, "tip_force_N": 0.2, "time_s": [3.0, 4.0], "flags": ("flag",)
    }  # fmt: skip
    assert said == ["3 frames of the state at 2.5 mT", "2 frames of the state at 4 mT"]
    calls.clear()
    importing._append_states(writer, by_state, iter(images), images[0], True, said.append)
    _, (_, (mean,), *more), _, (_, (other,), *others) = calls
    assert (mean.number, other.number) == (0, 1)
    assert (mean.image.tolist(), mean.image.dtype) == ([[257, 257]], np.uint16)
    assert other.image.tolist() == [[round(3.5 * 257)] * 2]
    assert (dict(more)["time_s"], dict(others)["time_s"]) == ([1.0], [3.5])


@pytest.mark.parametrize(
    ("image", "remedy"),
    [
        (np.zeros((2, 1), np.uint8), r"rotate this picture by 90 degrees, or remove it from states\.csv$"),
        (np.zeros((2, 1), np.uint16), r"export all pictures in the same way, or remove this picture from states\.csv$"),
        (np.zeros((1, 3), np.uint8), "export all pictures in the same way"),
        (np.zeros((1, 2), np.uint16), "export all pictures in the same way"),
    ],
)
def test_a_picture_of_another_size_or_kind_is_named(image: Any, remedy: str) -> None:
    frames = [SimpleNamespace(path=Path(f"folder/f{k}.png"), time_s=NAN) for k in range(2)]
    by_state: Any = [(Load(None, 0.0, 0.0, None), frames)]
    first = np.zeros((1, 2), np.uint8)
    words = rf"f1\.png: is .*, but f0\.png is .*; all pictures of a dataset need the same size and bit depth: {remedy}"
    with pytest.raises(InputError, match=words):
        importing._append_states(None, by_state, iter([first, image]), first, False, print)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (("a_3.png", "a_5.png"), [3, 5]),
        (("a_5.png", "a_3.png"), [0, 1]),
        (("a_5.png", "b_5.png"), [0, 1]),
        (("a.png", "a_5.png"), [0, 1]),
    ],
)
@pytest.mark.parametrize(("last", "repeated"), [(None, False), (0, True), (1, False)])
def test_the_frames_of_a_state_are_judged_by_the_numbers_of_their_names(
    monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...], numbers: list[int], last: int | None, repeated: bool
) -> None:
    asked: list[Any] = []
    flag = Flag("A", "finding", 1.0, 0.0, Severity.NOTE)
    monkeypatch.setattr(importing, "state_flags", lambda *given: asked.append(given) or (flag,))
    images = [np.zeros((1, 2), np.uint8), np.ones((1, 2), np.uint8)]
    before = None if last is None else images[last].copy()
    found = importing._flags([Path(name) for name in names], images, before)
    ((frames, lossless),) = asked
    assert [frame.number for frame in frames] == numbers
    assert [frame.image is image for frame, image in zip(frames, images, strict=True)] == [True, True]
    assert lossless is True
    assert found[0] == flag
    assert [(one.name, one.value) for one in found[1:]] == [("DUPLICATE", 1.0)] * repeated
    assert [names[0] in one.remedy for one in found[1:]] == [True] * repeated
    importing._flags([Path("a.png"), Path("b.JPG")], images, None)
    assert asked[1][1] is False


def test_pictures_that_the_table_does_not_list_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    listing: Any = SimpleNamespace(left_out=[Path("x/a.png"), Path("x/b.png")])
    importing._report_unlisted(listing, Path("states.csv"))
    assert capsys.readouterr().err == "eimi: note: left out, because states.csv does not list them: a.png, b.png\n"
    listing.left_out = []
    importing._report_unlisted(listing, Path("states.csv"))
    assert capsys.readouterr().err == ""


def test_the_oldest_picture_gives_the_time_of_an_import(tmp_path: Path) -> None:
    for name, seconds in (("a.png", 1_000_000.0), ("b.png", 999_999.4)):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (seconds, seconds))
    listing: Any = SimpleNamespace(files=lambda: sorted(tmp_path.iterdir()))
    assert importing._oldest(listing) == "1970-01-12T13:46:39+00:00"


@pytest.mark.parametrize(("dark", "flat", "named"), [("d.png", None, "d.png"), ("d.png", "f.png", "f.png")])
def test_an_unsuitable_correction_is_named_by_its_file(
    monkeypatch: pytest.MonkeyPatch, dark: str | None, flat: str | None, named: str
) -> None:
    read: list[Any] = []

    def refuse(images: Any) -> None:
        read.append(images)
        raise ValueError("too bright")

    monkeypatch.setattr("eimi_lab.vision.image_files.read_image", lambda path: f"image {path}")
    monkeypatch.setattr(dark_and_flat, "correction_by", refuse)
    given = [None if name is None else Path(name) for name in (dark, flat)]
    with pytest.raises(InputError, match=rf"^{named}: too bright$"):
        dark_and_flat.read_correction_images(*given)
    names = {"dark": dark, "flat": flat}
    assert read == [{key: f"image {name}" for key, name in names.items() if name}]
    monkeypatch.setattr(dark_and_flat, "correction_by", read.append)
    assert dark_and_flat.read_correction_images(None, None) == {}
    assert read[1] == {}
