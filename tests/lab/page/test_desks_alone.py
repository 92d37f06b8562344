# The functions behind the addresses of the page, with replacements for processes, tabs and the network.

from __future__ import annotations

import asyncio
import json
import os
import signal
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlencode

import pytest
from starlette.requests import Request
from starlette.responses import PlainTextResponse

from eimi_fitting.laws import LAWS
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import OffConfirmed, OffNotConfirmed, OutputSwitched, PauseRequested
from eimi_lab.page import (
    admission,
    bench_run,
    by_hand,
    by_weights,
    camera_alone,
    camera_desk,
    choices,
    data_folder,
    fit_desk,
    opened_eyes,
    server,
    stored_fits,
    stored_runs,
    worker,
)
from eimi_lab.page.admission import Admission, new_token
from eimi_lab.page.bench_run import BenchRun, Order
from eimi_lab.page.camera_desk import CameraDesk
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.page.eye import SIZES
from eimi_lab.page.fit_desk import FitDesk, Fitting
from eimi_lab.page.opened_eyes import OpenedEyes
from eimi_lab.page.phone_desk import PhoneDesk
from eimi_lab.page.picture_desk import PictureDesk
from eimi_lab.page.redirect_file import redirect_file
from eimi_lab.page.report_links import ReportLinks
from eimi_lab.page.worker import Worker
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped
from tests.shared.changed_module import changed_module


def run(work: Awaitable[Any]) -> Any:
    # Wait for a coroutine in a new thread, because the browser of another test may have an event loop in this one.
    async def whole() -> Any:
        return await work

    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, whole()).result()


class Tabs:
    # A replacement for the open tabs of the page.

    def __init__(self) -> None:
        self.changes, self.shown, self.checked, self.open = 0, [], 0, True

    def steered(self, act: Any) -> Any:
        return act

    def changed(self) -> None:
        self.changes += 1

    def show(self, about: Any, picture: bytes) -> None:
        self.shown.append((about, picture))

    def any_open(self) -> bool:
        return self.open

    def check_control(self, request: Request) -> None:
        self.checked += 1


class Direct:
    # A replacement for the worker process, which records the calls and answers with `answer`.

    def __init__(self, answer: Any = None) -> None:
        self.calls: list[Any] = []
        self.answer = answer

    async def do(self, function: Any, *arguments: Any) -> Any:
        self.calls.append((function.__name__, *arguments))
        return self.answer


def asked(query: str = "", body: bytes = b"", *, content: str = "application/json") -> Request:
    # Return a request with this query and this body.
    parts = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> Any:
        return parts.pop(0)

    headers = [(b"content-type", content.encode())]
    scope = {"type": "http", "method": "POST", "path": "/", "query_string": query.encode(), "headers": headers}
    return Request(scope, receive)


@pytest.fixture
def folder(tmp_path: Path) -> DataFolder:
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "a.png").write_bytes(b"")
    (tmp_path / "run.h5").write_bytes(b"")
    return DataFolder(tmp_path.resolve())


def paths_of(routes: Any) -> list[str]:
    return [f"{'/'.join(sorted(route.methods - {'HEAD'}))} {route.path}" for route in routes]


def test_photographs_of_a_phone_reach_their_functions(folder: DataFolder) -> None:
    tabs, direct = Tabs(), Direct({"dataset": "pictures.h5", "x": 1})
    desk = PhoneDesk(folder, direct, tabs)  # type: ignore[arg-type]
    pictures = folder.root / "pictures"
    assert paths_of(desk.routes()) == [
        *("GET /api/phone", "GET /api/phone/picture", "POST /api/phone/receive", "POST /api/phone/edges"),
        "POST /api/phone/save",
    ]
    assert json.loads(run(desk._opened(asked("folder=pictures"))).body) == direct.answer
    assert direct.calls[-1] == ("opened", pictures)
    body = {"folder": "pictures", "picture": "a.png", "clicks": {"c": 1}, "beam": {"b": 2}}
    assert json.loads(run(desk._edges(asked(body=json.dumps(body).encode()))).body) == direct.answer
    assert direct.calls[-1] == ("edges", pictures / "a.png", {"c": 1}, {"b": 2})
    saved = run(desk._save({**body, "grams": {"g": 3}, "replace": True}))
    assert saved == {"dataset": "pictures/pictures.h5", "x": 1, "free": ["axis", "clamp", "tilt"]}
    assert direct.calls[-1] == ("saved", pictures, {"c": 1}, {"b": 2}, {"g": 3}, True)
    run(desk._save({**body, "grams": {}, "replace": "yes"}))
    assert direct.calls[-1][-1] is False
    direct.answer = b"jpeg"
    picture = run(desk._picture(asked("folder=pictures&picture=a.png")))
    assert (picture.body, picture.media_type) == (b"jpeg", "image/jpeg")
    assert direct.calls[-1] == ("picture", pictures / "a.png")
    for key in ("clicks", "beam"):
        with pytest.raises(InputError, match=f"{key} is missing"):
            run(desk._edges(asked(body=json.dumps({**body, key: 1}).encode())))


def test_a_photograph_is_received_under_a_temporary_name(folder: DataFolder) -> None:
    pictures = folder.root / "pictures"
    seen: list[Any] = []

    class Reading(Direct):
        async def do(self, function: Any, received: Path, target: Path) -> Any:  # type: ignore[override]
            seen.append((function.__name__, received.read_bytes(), received.parent, received.name, target))
            return {"ok": True}

    tabs = Tabs()
    desk = PhoneDesk(folder, Reading(), tabs)  # type: ignore[arg-type]
    assert json.loads(run(desk._receive(asked("folder=pictures&name=b.JPG", b"light"))).body) == {"ok": True}
    ((function, content, where, name, target),) = seen
    assert (function, content, where, target) == ("accepted", b"light", pictures, pictures / "b.JPG")
    assert (name[0], name[-4:], len(name), tabs.checked) == (".", ".JPG", 21, 1)
    assert [file.name for file in pictures.iterdir()] == ["a.png"]
    longest = "c" * 116 + ".jpg"
    run(desk._receive(asked(f"folder=pictures&name={longest}", b"")))
    for query, words in (
        ("folder=none&name=b.jpg", "none: is not a folder"),
        ("folder=pictures&name=b.txt", r"b\.txt: is not a picture that can be read \(.*\.jpg.*\); save the picture"),
        ("folder=pictures&name=.b.jpg", "should be a file name of at most 120 characters"),
        ("folder=pictures&name=b/c.jpg", "should be a file name of at most 120 characters"),
        (f"folder=pictures&name=c{longest}", "^c{117}.jp: should be a file name of at most 120 characters"),
    ):
        with pytest.raises(InputError, match=words):
            run(desk._receive(asked(query, b"")))
    assert len(seen) == 2


def test_pictures_reach_their_functions(folder: DataFolder) -> None:
    direct = Direct(["x"])
    desk = PictureDesk(folder, direct, Tabs())  # type: ignore[arg-type]
    pictures = folder.root / "pictures"
    assert paths_of(desk.routes()) == [
        *("GET /api/pictures/folders", "GET /api/pictures", "GET /api/pictures/picture", "POST /api/pictures/edges"),
        *("POST /api/pictures/save", "POST /api/pictures/dataset"),
    ]
    assert json.loads(run(desk._folders(asked())).body) == ["x"]
    assert direct.calls[-1] == ("folders", folder)
    assert json.loads(run(desk._opened(asked("folder=pictures"))).body) == ["x"]
    assert direct.calls[-1] == ("opened", pictures)
    body = {
        "folder": "pictures",
        "picture": "a.png",
        "specimen": "type1",
        "calibration": {"c": 1},
        "currents": {"a": 2},
    }
    assert json.loads(run(desk._edges(asked(body=json.dumps(body).encode()))).body) == ["x"]
    assert direct.calls[-1] == ("edges", pictures / "a.png", {"c": 1}, "type1")
    assert run(desk._save({**body, "replace": True})) == ["x"]
    assert direct.calls[-1] == ("saved", pictures, {"c": 1}, {"a": 2}, True)
    run(desk._save(body))
    assert direct.calls[-1][-1] is False
    assert run(desk._dataset(body)) == {"dataset": "pictures/pictures.h5", "states": ["x"]}
    assert direct.calls[-1] == ("dataset_of", pictures, "type1", pictures / "pictures.h5", False)
    run(desk._dataset({**body, "replace": True}))
    assert direct.calls[-1][-1] is True
    direct.answer = b"jpeg"
    picture = run(desk._picture(asked("folder=pictures&picture=a.png")))
    assert (picture.body, picture.media_type) == (b"jpeg", "image/jpeg")
    with pytest.raises(InputError, match=r"b\.png: no such picture in this folder"):
        run(desk._picture(asked("folder=pictures&picture=b.png")))


@pytest.mark.parametrize("name", ["..", "a/../../b", "/etc/passwd", "a\\b", "c:d", "a\0b"])
def test_no_name_leads_out_of_the_folder(folder: DataFolder, name: str) -> None:
    with pytest.raises(InputError, match="leads out of the folder of this page"):
        folder.inside(name)


def test_a_link_out_of_the_folder_is_not_followed(folder: DataFolder, tmp_path_factory: pytest.TempPathFactory) -> None:
    outside = tmp_path_factory.mktemp("outside")
    (folder.root / "link").symlink_to(outside)
    with pytest.raises(InputError, match="leads out of the folder"):
        folder.inside("link/file")
    assert [entry.name for entry in folder.listed()] == ["pictures", "run.h5"]
    (folder.root / ".hidden.h5").write_bytes(b"")
    (folder.root / "notes.txt").write_bytes(b"")
    for k, name in enumerate(("old.csv", "new.TOML", "newest.png", "b.json", "a.html")):
        (folder.root / name).write_bytes(b"x" * k)
        os.utime(folder.root / name, (1e9, 1e9 + min(k, 3)))
    os.utime(folder.root / "run.h5", (1e9, 1e9 - 5))
    assert [(entry.name, entry.kind, entry.size) for entry in folder.listed() if entry.kind != "folder"] == [
        *(("a.html", "report", 4), ("b.json", "json", 3), ("newest.png", "picture", 2), ("new.TOML", "toml", 1)),
        *(("old.csv", "table", 0), ("run.h5", "dataset", 0)),
    ]
    assert folder.listed()[0].kind == "folder"
    assert folder.inside(None) == folder.root
    with pytest.raises(InputError, match=r"run\.h5: is not a folder"):
        folder.listed("run.h5")


def test_many_pictures_do_not_hide_a_dataset(folder: DataFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data_folder, "MOST_ENTRIES", 4)
    for number in range(5):
        (folder.root / f"{number}.png").touch()
    os.utime(folder.root / "run.h5", (1e9, 1e9))
    listed = folder.listed()
    assert len(listed) == 4
    assert (listed[0].name, listed[-1].name) == ("pictures", "run.h5")


class Process:
    # A replacement for a process whose error output is `lines`, and which ends with a status.

    def __init__(self, lines: list[bytes] | None = None, status: int = 0) -> None:
        self.lines, self.status, self.signals, self.typed = lines or [], status, [], []
        self.closed = False
        self.ended = asyncio.Event()
        self.stdin = SimpleNamespace(write=self.typed.append, close=self._close)
        self.stderr = self

    def _close(self) -> None:
        self.closed = True
        self.ended.set()

    def __aiter__(self) -> Process:
        return self

    async def __anext__(self) -> bytes:
        if not self.lines:
            raise StopAsyncIteration
        return self.lines.pop(0)

    async def wait(self) -> int:
        return self.status

    def send_signal(self, number: int) -> None:
        self.signals.append(number)

    def terminate(self) -> None:
        self.signals.append("terminate")

    def kill(self) -> None:
        self.signals.append("kill")


def a_run(changes: list[str] | None = None) -> BenchRun:
    order = Order(protocol="a/p.toml", specimen="b/s.toml", rig="c/r.toml", dataset=Path("d.h5"))
    counted = [] if changes is None else changes
    one = BenchRun(order, 3, "d.h5", lambda: counted.append(""), lambda about, picture: None)
    one._run = Process()  # type: ignore[assignment]
    return one


def test_a_run_begins_with_its_names() -> None:
    async def work() -> None:
        progress = a_run().progress
        assert (progress.number, progress.dataset, progress.protocol, progress.specimen, progress.rig) == (
            *(3, "d.h5", "p", "s", "r"),
        )
        assert (progress.phase, progress.coil, progress.off_by, progress.coil_A, progress.states) == (
            *("beginning", "off", "", None, 0),
        )
        assert (progress.stored, progress.guardian, progress.left_s, progress.status) == (0, False, None, None)
        assert (progress.stopped, progress.last_words, progress.as_json()["said"]) == (False, "", [])

    run(work())


def test_a_run_is_paused_continued_ended_and_stopped() -> None:
    async def work() -> None:
        changes: list[str] = []
        one = a_run(changes)
        process: Any = one._run
        one.pause()
        one.go_on()
        assert (process.typed, changes, one.going_on) == ([], [], True)
        one.progress.phase = "running"
        one.pause()
        assert (process.typed, one.progress.phase) == ([b"p\n"], "running")
        one.heard(PauseRequested())  # the run sends no such event in its last state
        assert (one.progress.phase, len(changes)) == ("pausing", 1)
        one.progress.phase = "paused"
        one.go_on()
        assert (process.typed[1:], one.progress.phase, len(changes)) == ([b"\n"], "paused", 1)
        one.end()
        assert (process.signals, one.progress.phase, one.progress.stopped) == ([signal.SIGINT], "ending", True)
        one.progress.stopped = False
        one.heard(OutputSwitched(on=True))
        stopping = one.stop()
        assert process.signals[1:] == [signal.SIGINT, signal.SIGTERM]
        assert (one.progress.coil, one.progress.phase, one.progress.stopped) == ("switching off", "stopping", True)
        off = OffConfirmed(by="run", determined_by="measured", current_A=0.001, limit_A=0.02)
        one.heard(off)
        assert (await stopping).startswith("the coil is off")
        one._ended.set()
        assert not one.going_on
        process.signals.clear()
        one.end()
        await one.stop()
        assert process.signals == []

    run(work())


@pytest.mark.parametrize("between", [True, False])
def test_signals_are_sent_or_typed(monkeypatch: pytest.MonkeyPatch, between: bool) -> None:
    async def work() -> None:
        monkeypatch.setattr(bench_run, "SIGNALS_BETWEEN_PROCESSES", between)
        one = a_run()
        one._signal(signal.SIGTERM)
        process: Any = one._run
        assert (process.signals, process.typed) == (([15], []) if between else ([], [b"signal 15\n"]))

    run(work())


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (None, in_words(OffNotConfirmed(by="run", reason=""))),
        (OffNotConfirmed(by="run", reason="why", current_A=0.5, limit_A=0.02), None),
    ],
)
def test_a_run_that_confirms_nothing_is_killed(monkeypatch: pytest.MonkeyPatch, event: Any, words: str | None) -> None:
    async def work() -> None:
        monkeypatch.setattr(bench_run, "CONFIRMED_WITHIN_S", 0.01)
        monkeypatch.setattr(bench_run, "CLOSED_WITHIN_S", 0.01)
        one = a_run()
        one.heard(OutputSwitched(on=True))
        said = await one.stop() if event is None else None
        if event is None:
            assert (said, one._run.signals[-1]) == (words, "kill")  # type: ignore[attr-defined]
        else:
            one.heard(event)
            assert await one.stop() == in_words(event)
            assert one._run.signals == [signal.SIGINT, signal.SIGTERM]  # type: ignore[attr-defined]

    run(work())


@pytest.mark.parametrize(("guardian", "coil"), [(True, "unknown"), (False, "off")])
def test_the_end_of_a_run_without_a_word_about_its_coil(
    monkeypatch: pytest.MonkeyPatch, guardian: bool, coil: str
) -> None:
    async def work() -> None:
        changes: list[str] = []
        one = a_run(changes)
        one._run = Process([b"  \n", b"eimi: stopped by SIGTERM: the end \n", b"\n"], 143)  # type: ignore[assignment]
        reading, writing = os.pipe()
        with os.fdopen(writing, "wb") as pipe:
            pipe.write(b'not an event\n{"event": "output_switched", "on": true')  # a killed run
        one.progress.guardian = guardian
        one.heard(OutputSwitched(on=True))
        await one._hear(reading)
        progress = one.progress
        assert (progress.coil, progress.phase, progress.status, progress.last_words) == (coil, "ended", 143, "the end")
        assert not one.going_on
        assert one._answered.is_set()
        assert changes

    run(work())


@pytest.mark.parametrize("ends", [True, False])
def test_a_closed_page_ends_its_run(monkeypatch: pytest.MonkeyPatch, ends: bool) -> None:
    async def work() -> None:
        monkeypatch.setattr(bench_run, "CLOSED_WITHIN_S", 0.02 if not ends else 5.0)
        one = a_run()
        killed: list[str] = []
        one._eyes.kill = lambda: killed.append("eyes")  # type: ignore[method-assign]
        if ends:
            asyncio.get_running_loop().call_soon(one._ended.set)
        await one.closed()
        assert one._run.signals == [signal.SIGINT, *([] if ends else ["kill"])]  # type: ignore[attr-defined]
        assert killed == ["eyes"]
        if ends:
            await one.closed()
            assert one._run.signals == [signal.SIGINT]  # type: ignore[attr-defined]

    run(work())


def starting(monkeypatch: pytest.MonkeyPatch, module: Any, process: Any) -> list[Any]:
    # Replace the start of processes in a module, and return the list of their arguments.
    started: list[Any] = []

    async def start(*arguments: str, **how: Any) -> Any:
        started.append((list(arguments), how))
        return process

    monkeypatch.setattr(module, "asyncio", changed_module(asyncio, create_subprocess_exec=start))
    return started


def test_a_run_is_started_with_its_arguments(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        one = a_run()
        opened: list[Any] = []

        async def open_eyes(memory: int, bell: int, rig: str, specimen: str) -> None:
            opened.append((rig, specimen))
            os.fstat(memory), os.fstat(bell)
            opened.append((memory, bell))

        async def nothing(*given: Any) -> None:
            opened.append(given)

        one._eyes.open, one._eyes.see = open_eyes, nothing  # type: ignore[method-assign]
        one._hear = nothing  # type: ignore[method-assign]
        started = starting(monkeypatch, bench_run, "process")
        await one.begin()
        await asyncio.gather(*one._tasks)
        ((arguments, how),) = started
        names = arguments[6].removeprefix("--watched-by=").split(",")
        assert arguments[1:6] == ["-P", "-m", "eimi_lab", "acquire", "--quiet"]
        assert arguments[7:] == ["--specimen=b/s.toml", "--rig=c/r.toml", "--output=d.h5", "--", "a/p.toml"]
        assert (how["stdin"], how["stdout"], how["stderr"]) == (
            *(asyncio.subprocess.PIPE, asyncio.subprocess.DEVNULL, asyncio.subprocess.PIPE),
        )
        assert len(names) == len(how["pass_fds"]) == 3
        assert (one._run, opened[0], len(one._tasks), len(opened[2:])) == ("process", ("c/r.toml", "b/s.toml"), 2, 2)
        for descriptor in (*opened[1], *how["pass_fds"]):
            with pytest.raises(OSError):  # noqa: PT011
                os.fstat(descriptor)
        os.close(next(given[0] for given in opened[2:] if given))

    run(work())


def test_two_processes_read_the_frames_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        seen: list[Any] = []
        streams = []
        for number in range(2):
            stream = asyncio.StreamReader()
            text = json.dumps({"n": number}).encode()
            stream.feed_data(SIZES.pack(len(text), 4 * (1 - number)) + text + b"jpeg" * (1 - number))
            stream.feed_data(SIZES.pack(9, 0) + b"cut")
            stream.feed_eof()
            streams.append(stream)
        killed: list[str] = []
        processes = [
            SimpleNamespace(stdout=stream, wait=Process().wait, kill=lambda: killed.append("")) for stream in streams
        ]
        queue = list(processes)
        started: list[Any] = []

        async def start(*arguments: str, **how: Any) -> Any:
            started.append((list(arguments), how))
            return queue.pop(0)

        monkeypatch.setattr(opened_eyes, "asyncio", changed_module(asyncio, create_subprocess_exec=start))
        eyes = OpenedEyes(7, lambda about, picture: seen.append((about, picture)))
        memory, bell = os.pipe()
        await eyes.open(memory, bell, "rig", "specimen")
        await eyes.see()
        assert sorted(seen, key=str) == [({"n": 0, "run": 7}, b"jpeg"), ({"n": 1, "run": 7}, b"")]
        assert [arguments[1:5] for arguments, _ in started] == [
            *(["-P", "-m", "eimi_lab.page.eye", "frames"], ["-P", "-m", "eimi_lab.page.eye", "edges"]),
        ]
        assert [arguments[7:] for arguments, _ in started] == [["rig"], ["rig", "specimen"]]
        assert {how["stdout"] for _, how in started} == {asyncio.subprocess.PIPE}
        with pytest.raises(OSError):  # noqa: PT011
            os.fstat(eyes._open_while_seen)
        eyes.kill()
        assert len(killed) == 2
        os.close(memory)
        os.close(bell)

    run(work())


def a_camera(folder: DataFolder, in_use: bool = False) -> tuple[CameraDesk, Tabs]:
    tabs = Tabs()
    return CameraDesk(folder, tabs, lambda: in_use), tabs  # type: ignore[arg-type]


def test_the_live_camera_is_opened_watched_and_closed(folder: DataFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        desk, tabs = a_camera(folder)
        assert paths_of(desk.routes()) == ["POST /api/camera"]
        assert desk.as_json() == {"camera": None}
        done: list[Any] = []

        class Eyes:
            def __init__(self, number: int, seen: Any) -> None:
                done.append((number, seen))

            async def open(self, memory: int, bell: int, rig: str, specimen: str) -> None:
                done.append((rig, specimen))

            async def see(self) -> None:
                done.append("saw")

            def kill(self) -> None:
                done.append("killed")

        monkeypatch.setattr(camera_desk, "OpenedEyes", Eyes)
        process = Process([b" eimi: no light \n"])

        async def wait() -> int:
            await process.ended.wait()
            return 0

        process.wait = wait  # type: ignore[method-assign]
        started = starting(monkeypatch, camera_desk, process)
        assert await desk._show({"rig": "virtual", "specimen": "type1"}) == {}
        ((arguments, how),) = started
        assert arguments[1:4] == ["-P", "-m", "eimi_lab.page.camera_alone"]
        assert (len(arguments[4:-2]), arguments[-2:]) == (2, ["virtual", "type1"])
        assert (how["stdin"], how["stderr"]) == (asyncio.subprocess.PIPE, asyncio.subprocess.PIPE)
        assert (done[0][0], done[1]) == (0, ("virtual", "type1"))
        assert desk.as_json() == {"camera": {"rig": "virtual", "specimen": "type1", "open": True, "last_words": ""}}
        assert tabs.changes == 1
        await asyncio.sleep(0.01)
        await desk.close()
        assert (process.closed, process.signals) == (True, ["kill"])
        assert desk.view is not None
        assert (desk.view.open, desk.view.last_words, tabs.changes) == (False, "no light", 2)
        assert done[2:] == ["saw", "killed"]
        await desk.close()
        assert process.signals == ["kill"]

    run(work())


def test_the_live_camera_ends_without_tabs_and_gives_way_to_a_run(
    folder: DataFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def work() -> None:
        monkeypatch.setattr(camera_desk, "LOOK_EVERY_S", 0.001)
        desk, tabs = a_camera(folder)
        process: Any = Process()
        ending = asyncio.create_task(desk._end_without_tabs(process))
        await asyncio.sleep(0.01)
        assert not process.closed
        tabs.open = False
        await ending
        assert process.closed
        busy, _ = a_camera(folder, in_use=True)
        with pytest.raises(InputError, match="a run is under way and uses the camera"):
            await busy._show({"rig": "virtual", "specimen": "type1"})

    run(work())


def test_the_camera_alone_writes_its_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    from contextlib import nullcontext

    written: list[Any] = []
    times = iter([10.0, 12.0, 12.5])
    left = [False, False, True]
    flushed: list[float] = []
    camera = SimpleNamespace(
        flush=lambda: flushed.append(0.0), grab=lambda within_s: SimpleNamespace(image="image", number=within_s)
    )
    memory = SimpleNamespace(write=lambda image, about: written.append((image, about)))
    reading, bell = os.pipe()
    monkeypatch.setattr(camera_alone, "FrameMemory", lambda descriptor: memory)
    monkeypatch.setattr(camera_alone, "load_rig", lambda name: f"rig {name}")
    monkeypatch.setattr(camera_alone, "load_specimen", lambda name: f"beam {name}")
    monkeypatch.setattr(camera_alone, "_opened", lambda rig, beam: nullcontext(camera))
    monkeypatch.setattr(camera_alone, "readable", lambda descriptor, seconds: left.pop(0))
    monkeypatch.setattr(camera_alone, "time", changed_module(time, monotonic=lambda: next(times)))
    monkeypatch.setattr(camera_alone.sys, "stdin", SimpleNamespace(fileno=lambda: 0))
    camera_alone.show(3, bell, "r", "s")
    usual = {"state": None, "set_A": 0.0, "measured_A": 0.0, "on": False, "heat_share": None, "number": 5.0}
    assert written == [("image", {**usual, "at_s": at, "rate_Hz": rate}) for at, rate in ((12.0, 0.5), (12.5, 2.0))]
    assert len(flushed) == 2
    assert os.read(reading, 99) == b"\0\0"
    os.close(reading)
    os.close(bell)


def test_a_camera_is_opened_alone_and_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[str] = []
    virtual = [SimpleNamespace(close=lambda name=name: closed.append(name)) for name in ("supply", "camera")]
    monkeypatch.setattr("eimi_lab.virtual.virtual_rig.open_virtual_rig", lambda rig, beam: (*virtual, None, None))
    simulated: Any = SimpleNamespace(simulated=True)
    with camera_alone._opened(simulated, "beam") as camera:  # type: ignore[arg-type]
        assert camera is virtual[1]
        assert closed == []
    assert closed == ["camera", "supply"]
    opened: list[Any] = []

    def timed(name: str, open_it: Any, seconds: Any) -> Any:
        opened.append((name, open_it(), seconds))
        return virtual[1]

    monkeypatch.setattr(camera_alone, "TimedCamera", timed)
    monkeypatch.setattr(camera_alone, "open_rig_camera", lambda rig, beam, clock, cue: (rig, beam))
    for is_virtual in (True, False):
        rig: Any = SimpleNamespace(simulated=False, virtual=is_virtual, camera=SimpleNamespace(source=4))
        with camera_alone._opened(rig, "beam") as camera:  # type: ignore[arg-type]
            assert camera is virtual[1]
        seconds = time.process_time if is_virtual else time.monotonic
        assert opened[-1] == ("camera 4", (rig, "beam"), seconds)
    assert closed[2:] == ["camera", "camera"]


def a_fit(folder: DataFolder, answer: Any = None) -> tuple[FitDesk, Tabs, Direct]:
    tabs, direct = Tabs(), Direct(answer)
    return FitDesk(folder, direct, tabs, ReportLinks()), tabs, direct  # type: ignore[arg-type]


def test_a_fit_is_started_once_and_ended(folder: DataFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        desk, _, _ = a_fit(folder)
        assert paths_of(desk.routes()) == ["GET /api/fit", "POST /api/fit/start", "POST /api/fit/end"]
        assert desk.as_json() == {"fit": None}
        done = asyncio.Event()
        fitted: list[Any] = []

        async def fit(dataset: Path, fitting: Fitting) -> None:
            fitted.append((dataset, fitting))
            await done.wait()

        monkeypatch.setattr(desk, "_fit", fit)
        law = next(iter(LAWS))
        for wrong, words in (
            ({"dataset": "none.h5", "model": law}, r"none\.h5: no such file in the folder of this page"),
            ({"dataset": "run.h5", "model": "x"}, f"model = 'x' should be one of {law}"),
            ({"dataset": "run.h5", "model": law, "free": "clamp"}, "free = 'clamp' should be a list of uncertain"),
            ({"dataset": "run.h5", "model": law, "free": ["x"]}, r"free = \['x'\] should be a list of uncertain"),
        ):
            with pytest.raises(InputError, match=words):
                await desk._start(wrong)
        assert await desk._start({"dataset": "run.h5", "model": law, "free": ["width", "roll"]}) == {}
        await asyncio.sleep(0)
        ((dataset, fitting),) = fitted
        assert (dataset, fitting.number, fitting.dataset, fitting.model, fitting.free) == (
            *(folder.root / "run.h5", 1, "run.h5", law, ("width", "roll")),
        )
        assert desk.as_json()["fit"]["phase"] == "fitting"
        with pytest.raises(InputError, match="a fit is running"):
            await desk._start({"dataset": "run.h5", "model": law})
        process: Any = Process()
        assert await desk._end({}) == {}
        desk._process = process
        assert await desk._end({}) == {}
        assert process.signals == ["terminate"]
        done.set()
        await desk.close()
        assert process.signals == ["terminate"] * 2
        (folder.root / "run.fits.json").write_text("x")
        for replace in (None, "yes"):
            with pytest.raises(InputError, match=r"run\.fits\.json: exists already; .*Fit again and replace this fit"):
                await desk._start({"dataset": "run.h5", "model": law, "replace": replace})
        await desk._start({"dataset": "run.h5", "model": law, "replace": True})
        await desk.close()
        assert (fitted[-1][1].number, fitted[-1][1].free) == (2, ())

    run(work())


@pytest.mark.parametrize(("first", "second", "phase"), [(0, 0, "done"), (1, 0, "failed"), (0, 1, "failed")])
def test_a_fit_is_followed_by_its_report(
    folder: DataFolder, monkeypatch: pytest.MonkeyPatch, first: int, second: int, phase: str
) -> None:
    async def work() -> None:
        desk, tabs, _ = a_fit(folder)
        dataset = folder.root / "run.h5"
        processes = [Process([b"eimi: words \n"], first), Process([], second)]
        started: list[Any] = []

        async def start(*arguments: str, **how: Any) -> Any:
            started.append(list(arguments))
            return processes[len(started) - 1]

        monkeypatch.setattr(fit_desk, "asyncio", changed_module(asyncio, create_subprocess_exec=start))
        fitting = Fitting(1, "run.h5", "yeoh", ("width",))
        log = folder.root / "run.fits.log"
        log.write_text("old")
        report = folder.root / "run.report.html"
        report.write_text("old")
        await desk._fit(dataset, fitting)
        assert report.exists() == (first != 0)  # the report of a replaced fit is removed
        stem = str(folder.root / "run")
        assert started[0][1:] == [
            *("-P", "-m", "eimi_lab", "fit", "--model=yeoh", "--free=width", f"--output={stem}.fits.json"),
            *(f"--checkpoint={stem}.fits.log", "--force", "--", f"{stem}.h5"),
        ]
        if first == 0:
            assert started[1][4:] == [
                *("report", f"--fit={stem}.fits.json", f"--output={stem}.report.html", "--force", "--", f"{stem}.h5"),
            ]
        assert (len(started), fitting.phase, fitting.last_words) == (2 - first, phase, "words")
        assert not log.exists()
        assert tabs.changes == (2 if first else 3)

    run(work())


def test_a_fit_whose_files_cannot_be_used_says_why(folder: DataFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        desk, tabs, _ = a_fit(folder)
        fitting = Fitting(1, "run.h5", "yeoh")

        def fail(path: Path) -> None:
            raise OSError(28, "No space\nleft")

        monkeypatch.setattr(fit_desk, "remove", fail)
        await desk._fit(folder.root / "run.h5", fitting)
        assert (fitting.phase, fitting.last_words, tabs.changes) == ("failed", "[Errno 28] No space left", 1)

    run(work())


def generation(number: int) -> bytes:
    return json.dumps({"generation": number, "search": {"best_mm": 0.1 * number, "mean_mm": 0.2 * number}}).encode()


def test_the_progress_of_a_search_is_read_from_its_log(folder: DataFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    assert fit_desk._generation(generation(3)) == (3, 0.1 * 3, 0.2 * 3)
    assert [fit_desk._generation(line) for line in (b"", b"{", b"[]", b"1", b'{"generation": 1}')] == [None] * 5

    async def work() -> None:
        desk, tabs, _ = a_fit(folder)
        log, fitting = folder.root / "log", Fitting(1, "run.h5", "yeoh")
        steps: list[Callable[[], Any]] = [
            lambda: None,
            lambda: log.write_bytes(b'{"head": 1}\n' + generation(1) + b"\n" + generation(2)[:9]),
            lambda: log.write_bytes(log.read_bytes() + generation(2)[9:]),
            lambda: log.write_bytes(log.read_bytes() + b"\n" + generation(3) + b"\n"),
            lambda: None,
        ]
        found: list[Any] = []

        async def sleep(seconds: float) -> None:
            assert seconds == 0.4
            found.append((len(fitting.generations), tabs.changes))
            if not steps:
                raise asyncio.CancelledError
            steps.pop(0)()

        monkeypatch.setattr(fit_desk, "asyncio", changed_module(asyncio, sleep=sleep))
        with pytest.raises(asyncio.CancelledError):
            await desk._follow(log, fitting)
        assert found == [(0, 0), (0, 0), (1, 1), (2, 2), (3, 3), (3, 3)]
        assert [number for number, *_ in fitting.generations] == [1, 2, 3]
        log.write_bytes(b"\n".join(generation(k) for k in range(500)) + b"\n")
        steps.append(lambda: None)
        fitting.generations.clear()
        with pytest.raises(asyncio.CancelledError):
            await desk._follow(log, fitting)
        assert [number for number, *_ in fitting.generations] == list(range(100, 500))

    run(work())


def test_stored_fits_and_their_report_are_listed(folder: DataFolder) -> None:
    desk, _, direct = a_fit(folder, ["a fit"])
    assert json.loads(run(desk._stored(asked("file=run.h5"))).body) == {"fits": [], "report": None}
    (folder.root / "run.fits.json").write_text("x")
    (folder.root / "run.report.html").write_text("x")
    answer = json.loads(run(desk._stored(asked("file=run.h5"))).body)
    assert answer["fits"] == ["a fit"]
    assert answer["report"].startswith("/report?file=run.report.html&key=")
    assert direct.calls == [("summaries", folder.root / "run.fits.json")]


def test_a_stored_fit_is_summarised(monkeypatch: pytest.MonkeyPatch) -> None:
    from eimi_fitting.inference.evidence.quantity import Quantity

    modulus = Quantity(50e3, "Pa", (40e3, 65e3))
    fit = SimpleNamespace(
        **{"model": "yeoh", "initial_shear_modulus": modulus, "parameters": {"mu": modulus}},
        **{"summary": lambda words: f"summary {words}", "notes": lambda: ["n"], "doubts_in_words": lambda: ["d"]},
        by_state=[SimpleNamespace(field_mT=1.5, error_mm=0.002)],
        budget=[SimpleNamespace(source=str(k), effect_percent=9.0 - k) for k in range(8)],
        history=[SimpleNamespace(best_mm=0.1, mean_mm=0.2), SimpleNamespace(best_mm=0.05, mean_mm=0.1)],
    )
    monkeypatch.setattr(stored_fits, "FitRecord", SimpleNamespace)
    monkeypatch.setattr(stored_fits, "read_fits_file", lambda path: SimpleNamespace(fits=[fit, "of another kind"]))
    (summary,) = stored_fits.summaries(Path("x"))
    assert summary.pop("summary").replace("\N{NO-BREAK SPACE}", " ") == (
        "summary 50 kPa (95 % interval: 40 to 65 kPa, −20 % to +30 %)"
    )
    assert summary == {
        **{"model": "yeoh", "modulus": [50e3, "Pa", 40e3, 65e3], "parameters": {"mu": [50e3, "Pa", 40e3, 65e3]}},
        **{"notes": ["n"], "doubts": ["d"], "by_state": [[1.5, 2.0]]},
        **{"budget": [[str(k), 9.0 - k] for k in range(6)], "generations": [[1, 0.1, 0.2], [2, 0.05, 0.1]]},
    }


def test_a_link_opens_only_its_report() -> None:
    links, others = ReportLinks(), ReportLinks()
    link = links.link_to("a b.html")
    path, _, key = link.partition("&key=")
    assert path == "/report?file=a+b.html"
    assert len(key) == 64
    assert links.opens("a b.html", key)
    assert not links.opens("b.html", key)
    assert not links.opens("a b.html", key[:-1])
    assert not others.opens("a b.html", key)


def test_the_file_that_opens_the_page_is_private() -> None:
    with redirect_file("http://h/#token=a&b") as path:
        text = path.read_text(encoding="utf-8")
        if os.name == "posix":
            assert path.stat().st_mode & 0o777 == 0o600
        assert text.count("http://h/#token=a&amp;b") == 2
        assert '<meta http-equiv="refresh" content="0;url=' in text
        assert path.name == "open.html"
    assert not path.exists()


def test_a_task_of_the_worker_begins_when_the_task_before_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        begun: list[asyncio.Future[str]] = []

        def begin() -> asyncio.Future[str]:
            begun.append(asyncio.get_running_loop().create_future())
            return begun[-1]

        pool = SimpleNamespace(submit=lambda function: function(), _processes={}, shutdown=lambda **_: None)
        monkeypatch.setattr(worker, "ProcessPoolExecutor", lambda *_: pool)
        monkeypatch.setattr(worker, "start_resource_tracker", lambda: None)
        monkeypatch.setattr(worker, "asyncio", changed_module(asyncio, wrap_future=lambda future: future))
        one = Worker()
        tasks = [asyncio.create_task(one.do(begin)) for _ in range(2)]
        while not begun:
            await asyncio.sleep(0)
        for _ in range(20):  # the second task would begin in these turns of the event loop
            await asyncio.sleep(0)
        assert len(begun) == 1
        begun[0].set_result("first")
        assert await tasks[0] == "first"
        while len(begun) == 1:
            await asyncio.sleep(0)
        begun[1].set_result("second")
        assert await tasks[1] == "second"

    run(work())


def test_a_worker_that_crashes_or_is_too_slow_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        made: list[Any] = []

        class Pool:
            def __init__(self, *given: Any) -> None:
                self.killed: list[str] = []
                self._processes = {1: SimpleNamespace(kill=lambda: self.killed.append("killed"))}
                made.append((self, given))

            def submit(self, function: Any, *arguments: Any) -> Any:
                return function(*arguments)

            def shutdown(self, *, wait: bool, cancel_futures: bool) -> None:
                self.killed.append(f"{wait} {cancel_futures}")

        def answer(value: Any) -> Any:
            future = asyncio.get_running_loop().create_future()
            if isinstance(value, Exception):
                future.set_exception(value)
            elif value is not None:
                future.set_result(value)
            return future

        monkeypatch.setattr(worker, "ProcessPoolExecutor", Pool)
        monkeypatch.setattr(worker, "start_resource_tracker", lambda: made.append("tracker"))
        monkeypatch.setattr(worker, "asyncio", changed_module(asyncio, wrap_future=lambda future: future))
        monkeypatch.setattr(worker, "LONGEST_S", 0.01)
        one = Worker()
        one.close()
        assert [await one.do(answer, value) for value in (1, 2)] == [1, 2]
        assert (made[0], made[1][1][0], len(made)) == ("tracker", 1, 2)
        assert made[1][1][1].get_start_method() == "spawn"
        with pytest.raises(InputError, match="the process that read this file crashed"):
            await one.do(answer, BrokenProcessPool())
        assert made[1][0].killed == ["False True", "killed"]
        with pytest.raises(InputError, match=r"the request took more than 0\.01 s and was cancelled"):
            await one.do(answer, None)
        assert len(made) == 4
        assert made[3][0].killed == ["False True", "killed"]
        await one.do(answer, 1)
        one.close()
        assert made[5][0].killed == ["False True", "killed"]
        assert one._pool is None

    run(work())


TOKEN = "the token"
HOST = ("host", "127.0.0.1:80")


def answered(
    path: str = "/api", method: str = "GET", kind: str = "http", messages: Any = (), **headers: str
) -> tuple[list[Any], list[Any]]:
    # Return the messages that a request is answered with, and those that reach the application.
    sent: list[Any] = []
    reached: list[Any] = []
    waiting = [*([{"type": "websocket.connect"}] if kind == "websocket" else []), *messages]

    async def application(scope: Any, receive: Any, send: Any) -> None:
        if kind == "websocket":
            reached.append(await receive())
            reached.append(await receive())
            await send({"type": "websocket.accept"})
            await send({"type": "websocket.send", "text": "hello"})
        else:
            await PlainTextResponse("hello")(scope, receive, send)

    async def receive() -> Any:
        return waiting.pop(0)

    async def send(message: Any) -> None:
        sent.append(message)

    given = {"host": HOST[1], "x-eimi-token": TOKEN} | {key.replace("_", "-"): text for key, text in headers.items()}
    raw = [(key.encode(), text.encode()) for key, text in given.items() if text]
    scope = {"type": kind, "method": method, "path": path, "headers": raw, "query_string": b""}
    run(Admission(application, frozenset({HOST[1]}), TOKEN)(scope, receive, send))  # type: ignore[arg-type]
    return sent, reached


ORIGIN = {"origin": f"http://{HOST[1]}"}


@pytest.mark.parametrize(
    ("status", "request_"),
    [
        (200, {}),
        (403, {"x_eimi_token": ""}),
        (403, {"x_eimi_token": "another"}),
        (421, {"host": "evil:80"}),
        (421, {"host": "", "path": "/"}),
        (200, {"path": "/", "x_eimi_token": ""}),
        (200, {"path": "/", "x_eimi_token": "", "sec_fetch_site": "cross-site"}),
        (403, {"path": "/", "x_eimi_token": "", "method": "POST"}),
        (200, {"path": "/static/page.js", "x_eimi_token": ""}),
        (200, {"path": "/report", "x_eimi_token": "", "method": "HEAD"}),
        (403, {"path": "/reports", "x_eimi_token": ""}),
        (403, {"path": "/static/page.js", "sec_fetch_site": "same-site"}),
        (200, {"sec_fetch_site": "same-origin"}),
        (200, {"sec_fetch_site": "none"}),
        (403, {"sec_fetch_site": "cross-site"}),
        (403, {"method": "POST"}),
        (403, {"method": "POST", "origin": "http://evil"}),
        (200, {"method": "POST", **ORIGIN}),
        (200, {"method": "POST", **ORIGIN, "content_length": str(1 << 16)}),
        (413, {"method": "POST", **ORIGIN, "content_length": str((1 << 16) + 1)}),
        (413, {"content_length": str((1 << 16) + 1), "path": "/"}),
        (200, {"method": "POST", **ORIGIN, "content_length": str(1 << 26), "path": "/api/phone/receive"}),
        (413, {"method": "POST", **ORIGIN, "content_length": str((1 << 26) + 1), "path": "/api/phone/receive"}),
        (413, {"method": "POST", **ORIGIN, "transfer_encoding": "chunked"}),
    ],
)
def test_a_request_is_admitted_or_refused(status: int, request_: dict[str, str]) -> None:
    sent, _ = answered(**request_)  # type: ignore[arg-type]
    assert sent[0]["status"] == status
    headers = {key.decode(): text.decode() for key, text in sent[0]["headers"]}
    assert {key: headers[key.lower()] for key in admission.HEADERS} == admission.HEADERS


@pytest.mark.parametrize(
    ("text", "headers", "admitted"),
    [
        (f'{{"token": "{TOKEN}"}}', ORIGIN, True),
        ('{"token": "another"}', ORIGIN, False),
        (f'{{"token": "{TOKEN}"}}', {"origin": "http://evil"}, False),
        (f'{{"token": "{TOKEN}"}}', {**ORIGIN, "host": "evil"}, False),
        ("", ORIGIN, False),
        (None, ORIGIN, False),
        ("[1]", ORIGIN, False),
        ("{}", ORIGIN, False),
    ],
)
def test_a_websocket_is_admitted_by_its_first_message(
    text: str | None, headers: dict[str, str], admitted: bool
) -> None:
    messages = [{"type": "websocket.receive", "text": text}, {"type": "websocket.receive", "text": "later"}]
    sent, reached = answered("/live", kind="websocket", messages=messages, x_eimi_token="", **headers)
    if admitted:
        assert [message["type"] for message in reached] == ["websocket.connect", "websocket.receive"]
        assert reached[1]["text"] == "later"
        assert sent == [
            *({"type": "websocket.accept", "headers": []}, {"type": "websocket.send", "text": "hello"}),
        ]
    else:
        assert reached == []
        assert sent[-1] == {"type": "websocket.close", "code": 1008}
        assert len(sent) == 1 + (headers == ORIGIN)


def test_a_token_is_random_and_long() -> None:
    assert len({new_token() for _ in range(9)}) == 9
    assert len(new_token()) == 43  # 32 bytes in base 64


@pytest.mark.parametrize("text", ["", "-1", "1.5", "x", "\N{SUPERSCRIPT TWO}", "1234567890"], ids=range(6))
def test_a_number_in_a_request_is_whole(text: str) -> None:
    with pytest.raises(InputError, match=f"state = '{text}' should be a whole number, 0 or more"):
        server._number(asked(urlencode({"state": text})), "state")
    assert server._number(asked("state=123456789"), "state") == 123456789


@pytest.mark.parametrize(
    ("host", "loopback", "shown"),
    [
        *(("127.0.0.1", True, "127.0.0.1"), ("127.3.4.5", True, "127.3.4.5"), ("::1", True, "[::1]")),
        *(("localhost", True, "localhost"), ("10.0.0.1", False, "10.0.0.1"), ("lab.example", False, "lab.example")),
        ("fe80::1", False, "[fe80::1]"),
    ],
)
def test_an_address_that_others_reach_needs_a_permission(host: str, loopback: bool, shown: str) -> None:
    assert (server._is_loopback(host), server._in_address(host)) == (loopback, shown)
    server.check_host(host, True)
    if loopback:
        server.check_host(host, False)
    else:
        with pytest.raises(InputError, match="other computers could reach this page"):
            server.check_host(host, False)


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_an_address_for_all_is_refused(host: str) -> None:
    with pytest.raises(InputError, match="stands for all addresses of this computer"):
        server.check_host(host, True)


def test_the_page_answers_with_what_its_functions_return(folder: DataFolder) -> None:
    with pytest.raises(InputError, match="is not a folder; give the folder with datasets and pictures"):
        server.Page(folder.root / "none")
    page = server.Page(folder.root)
    direct = Direct({"a": 1})
    page.worker = direct  # type: ignore[assignment]
    path = folder.root / "run.h5"
    for act, query, call in (
        (page._dataset, "file=run.h5", ("described", path)),
        (page._edges, "file=run.h5&state=3", ("edges", path, 3)),
        (page._modulus, "file=run.h5&states=4", ("modulus", path, 4)),
    ):
        assert json.loads(run(act(asked(query))).body) == {"a": 1}
        assert direct.calls[-1] == call
    direct.answer = b"jpeg"
    picture = run(page._picture(asked("file=run.h5&state=2")))
    assert (picture.body, picture.media_type, direct.calls[-1]) == (b"jpeg", "image/jpeg", ("picture", path, 2))
    page.tabs.ages_s.extend([0.25, 0.5])
    assert json.loads(run(page._delays(asked())).body) == {"frame_to_screen_s": [0.25, 0.5]}
    (folder.root / "r.html").write_text("x")
    listing = json.loads(run(page._listing(asked(""))).body)
    assert (listing["folder"], listing["root"]) == ("", str(folder.root))
    assert {entry["name"]: "link" in entry for entry in listing["entries"]} == {
        **{"pictures": False, "run.h5": False, "r.html": True},
    }
    assert json.loads(run(page._listing(asked("in=pictures"))).body)["folder"] == "pictures"
    link = page.reports.link_to("r.html").partition("?")[2]
    shown = run(page._report(asked(link)))
    assert (Path(shown.path), shown.media_type) == (folder.root / "r.html", "text/html")
    assert shown.headers["content-security-policy"] == admission.REPORT_POLICY
    assert run(page._report(asked("file=r.html&key=wrong"))).status_code == 403
    for name in ("run.h5", "none.html"):
        with pytest.raises(InputError, match="is not a report"):
            run(page._report(asked(page.reports.link_to(name).partition("?")[2])))
    error = run(server._error_answer(asked(), OSError(5, "a\n b")))
    assert (error.status_code, json.loads(error.body)) == (400, {"error": "[Errno 5] a b"})
    assert run(server._index(asked())).path == server.STATIC / "index.html"


@pytest.mark.parametrize(
    ("host", "view", "hosts", "address"),
    [
        ("127.0.0.1", "", {"127.0.0.1", "localhost", "[::1]"}, "http://127.0.0.1:{}/#token={}"),
        ("::1", "phone", {"127.0.0.1", "localhost", "[::1]"}, "http://[::1]:{}/#token={}#phone"),
        ("Bench-PC", "", {"bench-pc"}, "http://Bench-PC:{}/#token={}"),
    ],
)
@pytest.mark.parametrize(("port", "at_port"), [(8765, {":8765"}), (80, {":80", ""})])
def test_the_page_is_served_until_a_signal(
    folder: DataFolder,
    monkeypatch: pytest.MonkeyPatch,
    host: str,
    view: str,
    hosts: set[str],
    address: str,
    port: int,
    at_port: set[str],
) -> None:
    said: list[str] = []
    made: list[Any] = []
    closed: list[str] = []

    class Server:
        def __init__(self, config: Any) -> None:
            made.append(config)
            self.asked: list[int] = []

        def run(self, sockets: list[Any]) -> None:
            made.append(sockets)
            self.asked.append(15)

    monkeypatch.setattr(server, "_Server", Server)
    monkeypatch.setattr(server, "one_thread_each", lambda: closed.append("threads"))
    monkeypatch.setattr(Worker, "close", lambda self: closed.append("worker"))
    monkeypatch.setattr(server, "new_token", lambda: "secret")
    monkeypatch.setattr(server, "_listen", lambda *_: SimpleNamespace(getsockname=lambda: (host, port)))
    with pytest.raises(Stopped) as stopped:
        server.serve(folder.root, host, 0, said.append, view)
    assert (stopped.value.number, closed, said) == (15, ["threads", "worker"], [address.format(port, "secret")])
    config = made[0]
    assert (config.app.hosts, config.app.token) == ({name + end for name in hosts for end in at_port}, "secret")
    settings = ("log_level", "access_log", "proxy_headers", "server_header", "ws_max_size", "ws_per_message_deflate")
    assert [getattr(config, key) for key in settings] == ["warning", False, False, False, 1 << 16, False]
    assert config.timeout_graceful_shutdown == 10


def test_a_port_that_is_in_use_is_named() -> None:
    listening = server._listen("127.0.0.1", 0)
    port = listening.getsockname()[1]
    with pytest.raises(
        InputError, match=rf"--host 127\.0\.0\.1 --port {port}: the program cannot listen there \([^(]*\);"
    ):
        server._listen("127.0.0.1", port)
    listening.close()


def test_signals_end_the_server_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    handlers: dict[int, Any] = {number: f"before {number}" for number in (signal.SIGINT, *server.TERMINATION)}
    last = server.TERMINATION[-1]
    handlers[last] = signal.SIG_IGN
    usual = dict(handlers)

    def set_handler(number: int, handler: Any) -> Any:
        before, handlers[number] = handlers[number], handler
        return before

    monkeypatch.setattr(server.signal, "getsignal", handlers.get)
    monkeypatch.setattr(server.signal, "signal", set_handler)
    one: Any = object.__new__(server._Server)
    one.asked, one.should_exit = [], False
    with one.capture_signals():
        assert handlers[last] is signal.SIG_IGN
        handlers[signal.SIGINT](signal.SIGINT, None)
        assert (one.asked, one.should_exit) == ([signal.SIGINT], True)
        assert all(callable(handlers[number]) for number in usual if number != last)
    assert handlers == usual


def test_only_frames_of_an_existing_state_are_shown() -> None:
    dataset: Any = SimpleNamespace(kind="points", path="d.h5", states=[1, 2])
    with pytest.raises(InputError, match=r"d\.h5: contains tracked points, which have no pictures"):
        stored_runs._check_state(dataset, 0)
    dataset.kind = "frames"
    stored_runs._check_state(dataset, 0)
    stored_runs._check_state(dataset, 1)
    for index in (-1, 2):
        with pytest.raises(InputError, match=f"d.h5: has no state {index}; it has 2 states, counted from 0"):
            stored_runs._check_state(dataset, index)


def test_a_choice_is_a_shipped_name_or_a_file(folder: DataFolder) -> None:
    assert choices.chosen(folder, "rig", "virtual") == "virtual"
    assert choices.chosen(folder, "rig", "run.h5") == str(folder.root / "run.h5")
    for name in (None, "", 3):
        with pytest.raises(InputError, match="rig is missing; choose a file"):
            choices.chosen(folder, "rig", name)
    with pytest.raises(InputError, match="none: no such file in the folder of this page, and no shipped rig"):
        choices.chosen(folder, "rig", "none")


def test_typed_numbers_are_read_with_a_point_or_a_comma() -> None:
    assert by_weights._number({"a": " 1,5 "}, "a") == 1.5
    assert by_weights._number({"a": 2}, "a") == 2.0
    assert [by_weights._typed({"a": value}, "a") for value in (None, 0, " x ")] == ["", "0", "x"]
    for value, words in (
        (None, "a is missing; type a number"),
        ("x", "a = 'x' should be"),
        ("nan", "a = 'nan' should be"),
    ):
        with pytest.raises(InputError, match=words):
            by_weights._number({"a": value}, "a")
    assert by_weights._words(1.25) == "1.25"
    assert by_weights._words((1.0, 2.5)) == "1, 2.5"
    assert by_hand._current("f", "0,25") == "0.25"
    for text in ("x", "inf"):
        with pytest.raises(InputError, match=f"f: current_A = '{text}' should be a number"):
            by_hand._current("f", text)
    assert by_hand._guess(640, 480) == {
        **{"pixels_per_mm": 8.0, "coil_constant_mT_per_A": 1.0, "clamp_midpoint_px": [320.0, 80.0]},
        **{"axis_angle_deg": 90.0, "gravity_angle_deg": 90.0, "field_angle_deg": 0.0},
    }
