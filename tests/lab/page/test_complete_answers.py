"""Each answer of the dashboard's server has exactly the expected fields and values."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from eimi_fitting.inference.searching.modulus_range import NothingActs, NothingConverged
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import (
    OffNotConfirmed,
    OutputSwitched,
    Paused,
    PauseRequested,
    RunBegun,
    StateStored,
    StateStoredBefore,
    Warned,
)
from eimi_lab.page import run_desk, stored_runs
from eimi_lab.page.bench_run import KEPT_LINES, BenchRun, Order, Progress
from eimi_lab.page.choices import choices, chosen, dry
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.page.stored_runs import described, finite, jpeg, rounded, shown_flags
from eimi_lab.process.errors import InputError
from eimi_lab.vision.flags import CHECK_OF
from tests.lab.page.test_fit_desk import in_control

PROTOCOLS = Path(str(files("eimi_lab.protocols")))


def steered(served: Any, path: str, body: dict[str, Any]) -> tuple[int, Any]:
    # Send a request of the tab in control, which alone may start and stop runs; return the status and the answer.
    with in_control(served) as (_, name):
        answer = served.ask(path, "POST", json.dumps(body).encode(), Origin=f"http://{served.host}", X_Tab=name)
    return answer.status, json.loads(answer.body)


def test_a_stored_dataset_is_described_completely(data_folder: Path) -> None:
    begun = described(data_folder / "run.h5").pop("begun")
    assert described(data_folder / "run.h5") == {
        "kind": "frames",
        "specimen": "small",
        "material": "Dragon Skin 10",
        "begun": begun,
        "instruments": (),
        "states_asked": 2,
        "being_written": False,
        "size_px": [128, 96],
        "virtual": False,
        "segmented": False,
        "states": [
            {"index": 0, "current_A": 0.0, "measured_A": None, "field_mT": 0.0, "flags": []},
            {"index": 1, "current_A": 0.2, "measured_A": None, "field_mT": pytest.approx(0.94), "flags": []},
        ],
    }
    assert len(begun) == len("2026-01-01T00:00:00+00:00")  # whole seconds


def test_flags_and_points_are_written_as_json() -> None:
    blur = CHECK_OF["blur_px"].flag(3.25)
    (flag,) = shown_flags((blur,))
    assert flag == {**asdict(blur), "value": 3.25}
    (unknown,) = shown_flags((CHECK_OF["blur_px"].flag(float("nan")),))
    assert unknown["value"] is None
    assert [finite(value) for value in (1.5, float("inf"), float("-inf"), float("nan"))] == [1.5, None, None, None]
    assert rounded(np.array([[1.0049, 2.0051], [-3.456, 0.0]])) == [[1.0, 2.01], [-3.46, 0.0]]


@pytest.mark.parametrize(
    ("widest_px", "shape"), [(None, (30, 200)), (200, (30, 200)), (199, (30, 199)), (100, (15, 100))]
)
def test_a_picture_is_reduced_only_if_it_is_too_wide(widest_px: int | None, shape: tuple[int, int]) -> None:
    grey = np.tile(np.linspace(0, 255, 200).astype(np.uint8), (30, 1))
    for image in (grey, grey.astype(np.uint16) * 257, np.dstack([grey, grey, grey])):
        shown = cv2.imdecode(np.frombuffer(jpeg(image, widest_px), np.uint8), cv2.IMREAD_UNCHANGED)
        assert shown.shape == (shape if image.ndim == 2 else (*shape, 3))
        wide = shown if shown.ndim == 2 else shown[..., 0]
        assert wide[shape[0] // 2, [0, -1]].tolist() == pytest.approx([0, 255], abs=3)


def test_the_modulus_so_far_is_answered_with_all_its_values(data_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    estimate = SimpleNamespace(states=1, value_Pa=50e3, interval_95_Pa=(40e3, 61e3), limited_by="clamp", error_mm=0.02)
    asked: list[Any] = []
    monkeypatch.setattr(stored_runs, "_last_estimate", {})
    monkeypatch.setattr(stored_runs, "_edges", lambda path, identity, index: index)
    monkeypatch.setattr(stored_runs, "experiment_so_far", lambda dataset, edges: edges)
    monkeypatch.setattr(
        stored_runs, "modulus_so_far", lambda experiment, before: asked.append((experiment, before)) or estimate
    )
    answers = [stored_runs.modulus(data_folder / "run.h5", states) for states in (1, 2, 9)]
    assert asked == [([0], None), ([0, 1], estimate), ([0, 1], estimate)]
    for answer, states in zip(answers, (1, 2, 9), strict=True):
        assert answer is not None
        assert 0.0 <= answer.pop("seconds") < 60.0
        assert answer == {
            "states": states,
            "used": 1,
            "modulus_kPa": 50.0,
            "interval_95_kPa": [40.0, 61.0],
            "limited_by": "clamp",
            "error_mm": 0.02,
        }
    for error in (NothingActs("no load"), NothingConverged("no load")):

        def fails(experiment: Any, before: Any, error: Exception = error) -> None:
            raise error

        monkeypatch.setattr(stored_runs, "modulus_so_far", fails)
        with pytest.raises(InputError) as refused:
            stored_runs.modulus(data_folder / "run.h5", 1)
        assert str(refused.value) == "no modulus yet: no load"
    monkeypatch.setattr(stored_runs, "experiment_so_far", lambda dataset, edges: None)
    assert stored_runs.modulus(data_folder / "run.h5", 1) is None


def test_the_choices_are_the_files_of_each_kind_and_the_shipped_ones(files: Path) -> None:
    (files / "odd.toml").write_text("a = 1\n")
    (files / "broken.toml").write_text("a = \n")
    (files / "sub" / "below").mkdir(parents=True)
    shutil.copy(files / "protocol.toml", files / "sub" / "again.toml")
    shutil.copy(files / "protocol.toml", files / "sub" / "below" / "too_deep.toml")
    shutil.copy(PROTOCOLS / "first" / "specimen.toml", files / "sub" / "open.toml")
    kinds = choices(DataFolder(files))
    shipped = {
        "protocol": ["dragon_skin_10", "dragon_skin_10_quick", "ecoflex_00_50", "ecoflex_00_50_quick"],
        "specimen": ["bench_example", "type1", "type2", "type3", "type4"],
        "rig": ["bench_example", "emulated_bench", "virtual"],
    }
    assert kinds == {
        "protocol": ["protocol.toml", "sub/again.toml", *shipped["protocol"]],
        "specimen": ["specimen.toml", "sub/open.toml", *shipped["specimen"]],
        "rig": shipped["rig"],
        "calibration": ["calibration.toml"],
        "incomplete": ["sub/open.toml"],
    }


def test_a_chosen_file_is_a_path_or_the_name_of_a_shipped_file(files: Path) -> None:
    folder = DataFolder(files)
    assert chosen(folder, "specimen", "type2") == "type2"
    assert chosen(folder, "specimen", "specimen.toml") == str(files / "specimen.toml")
    for name, words in (
        (None, "rig is missing; choose a file"),
        ("", "rig is missing; choose a file"),
        (7, "rig is missing; choose a file"),
        ("type2", "type2: no such file in the folder of this page, and no shipped rig with this name"),
    ):
        with pytest.raises(InputError) as refused:
            chosen(folder, "rig", name)
        assert str(refused.value) == words


def test_a_dry_run_lists_the_steps_without_messages(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = dry("dragon_skin_10_quick", "type1", "virtual")
    assert len(lines) > 5
    assert not any("tcp:" in line for line in lines)
    with pytest.raises(InputError):
        dry("dragon_skin_10_quick", "nothing", "virtual")


def test_the_arguments_of_a_run_are_those_of_eimi_acquire(tmp_path: Path) -> None:
    order = Order(protocol="p.toml", specimen="s.toml", rig="virtual", dataset=tmp_path / "d.h5")
    given = ["acquire", "--specimen=s.toml", "--rig=virtual", f"--output={tmp_path / 'd.h5'}"]
    assert order.arguments() == [*given, "--", "p.toml"]
    order = Order(**{**vars(order), "resume": True, "take_over": True, "note": "a note"})
    assert order.arguments() == [*given, "--note=a note", "--resume", "--take-over", "--", "p.toml"]


BEGUN = RunBegun(
    dataset="run.h5",
    protocol="p",
    specimen="s",
    rig="r",
    states=5,
    currents_A=(0.0, 0.1),
    resumes=False,
    guardian=True,
    without_contact="it stays on",
    hottest_share=0.5,
)


def a_run(changed: list[str]) -> BenchRun:
    order = Order(protocol="a/p.toml", specimen="b/s.toml", rig="virtual", dataset=Path("d.h5"))
    return BenchRun(order, 3, "sub/d.h5", lambda: changed.append(""), lambda about, picture: None)


def test_the_progress_of_a_run_follows_its_events() -> None:
    changed: list[str] = []
    run = a_run(changed)
    expected = asdict(Progress(3, "sub/d.h5", "p", "s", "virtual")) | {"said": []}
    assert run.progress.as_json() == expected
    run.heard(BEGUN)
    expected |= {"states": 5, "currents_A": [0.0, 0.1], "guardian": True, "hottest_share": 0.5}
    expected |= {"without_contact": "it stays on"}
    assert run.progress.as_json() == expected
    run.heard(OutputSwitched(on=True))
    expected |= {"coil": "on", "phase": "running"}
    assert run.progress.as_json() == expected
    before = StateStoredBefore(state=0, current_A=0.0)
    stored = [
        StateStored(state=k, current_A=0.1 * k, waited_s=1.0, flags=(), time_s=at_s)
        for k, at_s in ((1, 100.0), (2, 108.0), (3, 112.0))
    ]
    run.heard(before)
    for number, (event, left_s) in enumerate(zip(stored, (None, 2 * 8.0, 6.0), strict=True), 2):
        run.heard(event)
        expected |= {"stored": number, "left_s": left_s}
        assert run.progress.as_json() | {"said": []} == expected
    assert list(run.progress.said) == [in_words(event) for event in (before, *stored)]
    assert len(changed) == 6


def test_a_run_pauses_only_on_request_or_to_swap_the_leads() -> None:
    run = a_run([])
    run.progress.phase = "running"
    pause, swap = (Paused(state=1, states=5, dataset="d.h5", swap_leads=swaps) for swaps in (False, True))
    run.heard(pause)
    assert run.progress.phase == "running"
    run.progress.phase = "pausing"
    run.heard(PauseRequested())
    run.heard(pause)
    assert run.progress.phase == "paused"
    run.heard(OutputSwitched(on=True))
    assert run.progress.phase == "running"
    run.heard(swap)
    assert run.progress.phase == "paused"
    run.progress.phase = "stopping"
    run.heard(OutputSwitched(on=True))
    assert (run.progress.phase, run.progress.coil) == ("stopping", "switching off")


def test_the_page_keeps_the_sentences_of_the_last_40_events() -> None:
    run = a_run([])
    for number in range(KEPT_LINES + 5):
        run.heard(Warned(message=f"warning {number}"))
    assert [line.rpartition(" ")[2] for line in run.progress.said] == [str(number) for number in range(5, 45)]
    assert run.progress.coil == "off"
    run.heard(OffNotConfirmed(by="run", reason="a reason"))
    assert (run.progress.coil, len(run.progress.said)) == ("unknown", 40)  # the coil has its own place on the page


class Recorded:
    going_on = True
    asked: list[Any] = []  # noqa: RUF012

    def __init__(self, order: Order, number: int, name: str, *listeners: Any) -> None:
        self.progress = Progress(number, name, "p", "s", "r")
        self.asked.append((order, number, name))

    async def begin(self) -> None:
        self.asked.append("begin")

    async def closed(self) -> None: ...

    def pause(self) -> None:
        self.asked.append("pause")

    def go_on(self) -> None:
        self.asked.append("go on")

    def end(self) -> None:
        self.asked.append("end")

    async def stop(self) -> str:
        self.asked.append("stop")
        return "the coil is off"


@pytest.fixture
def recorded(served: Any, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    # The list of the page's requests to a run; no real run is started.
    monkeypatch.setattr(run_desk, "BenchRun", Recorded)
    monkeypatch.setattr(Recorded, "asked", [])
    monkeypatch.setattr(Recorded, "going_on", True)
    monkeypatch.setattr(served.page.desk, "run", None)
    monkeypatch.setattr(served.page.desk, "_number", 4)
    return Recorded.asked


RUN = {"protocol": "protocol.toml", "specimen": "type1", "rig": "virtual", "dataset": "new.h5"}


def test_a_run_is_started_with_what_was_chosen_and_steered(served: Any, recorded: list[Any]) -> None:
    note = {"note": " a remark ", "take_over": True}
    assert steered(served, "/api/run/start", {**RUN, **note}) == (200, {})
    order = Order(
        protocol=str(served.folder / "protocol.toml"),
        specimen="type1",
        rig="virtual",
        dataset=served.folder / "new.h5",
        resume=False,
        take_over=True,
        note="a remark",
    )
    assert recorded == [(order, 5, "new.h5"), "begin"]
    for path, asked in (("pause", "pause"), ("go-on", "go on"), ("end", "end")):
        assert steered(served, f"/api/run/{path}", {}) == (200, {})
        assert recorded[-1] == asked
    stop = served.ask("/api/stop", "POST", b"", Origin=f"http://{served.host}")
    assert (json.loads(stop.body), recorded[-1]) == ({"words": "the coil is off", "off": True}, "stop")
    served.page.desk.run.progress.coil = "unknown"
    stop = served.ask("/api/stop", "POST", b"", Origin=f"http://{served.host}")
    assert json.loads(stop.body)["off"] is False


def test_an_existing_dataset_is_only_continued(served: Any, recorded: list[Any]) -> None:
    about = {**RUN, "dataset": "run.h5", "note": "a remark"}
    words = "run.h5: exists already; give another name, or continue the run in this dataset"
    assert steered(served, "/api/run/start", about) == (400, {"error": words})
    assert steered(served, "/api/run/start", {**about, "resume": True}) == (200, {})
    order = recorded[0][0]
    assert (order.dataset, order.resume, order.take_over, order.note) == (served.folder / "run.h5", True, False, "")


@pytest.mark.parametrize("name", ["", "new.txt", "none/new.h5"])
def test_a_dataset_needs_its_ending_and_its_folder(served: Any, recorded: list[Any], name: str) -> None:
    status, answer = steered(served, "/api/run/start", {**RUN, "dataset": name})
    assert (status, answer["error"].partition(": ")[2], recorded) == (
        400,
        "the name of the dataset should end in .h5, and its folder should exist",
        [],
    )


def test_without_a_run_there_is_nothing_to_steer_or_to_stop(served: Any, recorded: list[Any]) -> None:
    for path in ("pause", "go-on", "end"):
        assert steered(served, f"/api/run/{path}", {}) == (400, {"error": "no run is under way"})
    stop = served.ask("/api/stop", "POST", b"", Origin=f"http://{served.host}")
    assert json.loads(stop.body) == {
        "words": "no run was started from this page, so that the page has switched nothing on",
        "off": True,
    }
    assert recorded == []


def test_the_folder_is_listed_with_all_that_the_page_shows(served: Any) -> None:
    folder = served.folder / "listed"
    folder.mkdir()
    for name in ("a.png", "b.csv", "c.json", "d.txt", ".e.toml", "f.toml"):
        (folder / name).write_text(name)
    (folder / "sub").mkdir()
    answer = json.loads(served.ask("/api/folder?in=listed").body)
    assert (answer["folder"], answer["root"]) == ("listed", str(served.folder))
    about = {entry["name"]: (entry["kind"], entry["size"]) for entry in answer["entries"]}
    assert about.pop("listed/sub")[0] == "folder"
    assert about == {
        "listed/a.png": ("picture", 5),
        "listed/b.csv": ("table", 5),
        "listed/c.json": ("json", 6),
        "listed/f.toml": ("toml", 6),
    }
    assert answer["entries"][0]["name"] == "listed/sub"
    assert [set(entry) for entry in answer["entries"]] == [{"name", "kind", "changed_s", "size"}] * 5
    assert json.loads(served.ask("/api/figures").body).keys() == {"frame_to_screen_s"}
    assert served.ask("/api/folder?in=run.h5").status == 400
