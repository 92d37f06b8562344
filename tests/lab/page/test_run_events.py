"""The dashboard derives the state of the coil from events alone."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from eimi_lab.acquisition.events import Event, OffConfirmed, OffNotConfirmed, OutputSwitched, RunBegun, StateStored
from eimi_lab.acquisition.output_off import SWITCH_OFF_FIRST
from eimi_lab.page import bench_run
from eimi_lab.page.bench_run import BenchRun, Order
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.page.run_desk import RunDesk
from tests.patience import PATIENCE_S
from tests.shared.changed_module import changed_module

OTHER_WORDS = """
import eimi_lab.acquisition.event_words as words
words.in_words = lambda event: "xyzzy"
"""


def a_run(folder: Path) -> BenchRun:
    files = {name: str(folder / f"{name}.toml") for name in ("protocol", "specimen", "rig")}
    order = Order(dataset=folder / "words.h5", **files)
    return BenchRun(order, 1, "words.h5", lambda: None, lambda about, picture: None)


async def until(true: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not true():
            await asyncio.sleep(0.02)


async def stopped(run: BenchRun) -> str:
    return await run.stop()


async def killed(run: BenchRun) -> str:
    os.kill(run._run.pid, signal.SIGKILL)
    return ""


@pytest.mark.parametrize("end", [stopped, killed])
def test_the_page_derives_the_coil_from_events_whatever_the_messages_say(
    emulated_bench: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: Callable[..., Any]
) -> None:
    (tmp_path / "sitecustomize.py").write_text(OTHER_WORDS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    async def watch() -> BenchRun:
        run = a_run(emulated_bench.folder)
        await run.begin()
        await until(lambda: run.progress.coil == "on" or not run.going_on)
        assert run.progress.coil == "on", run.progress.last_words
        await end(run)
        await until(lambda: not run.going_on)
        await run.closed()
        return run

    with ThreadPoolExecutor(1) as thread:  # the browser of another test may have left an event loop in this thread
        run = thread.submit(asyncio.run, watch()).result()
    assert emulated_bench.is_off()
    assert (run.progress.coil, run.progress.phase) == ("off", "ended")
    assert "xyzzy" in run.progress.last_words or end is stopped


def heard(*events: Event) -> BenchRun:
    run = a_run(Path("nowhere"))
    for event in events:
        run.heard(event)
    return run


def test_the_coil_on_the_page_follows_the_events() -> None:
    on, off = OutputSwitched(on=True), OffConfirmed(by="guardian", determined_by="commanded", takeover="run_died")
    assert heard().progress.coil == "off"
    assert heard(on).progress.coil == "on"
    assert (
        heard(on, OutputSwitched(on=False)).progress.coil == "on"
    )  # the coil counts as on until it is confirmed as off
    assert heard(on, off).progress.coil == "off"
    assert heard(on, OffNotConfirmed(by="run", reason="")).progress.coil == "unknown"
    assert heard(on, OffNotConfirmed(by="run", reason=""), off).progress.coil == "off"


def test_the_current_on_the_page_is_the_one_that_confirmed_the_state_of_the_coil() -> None:
    on, flows = OutputSwitched(on=True), OffNotConfirmed(by="run", reason="", current_A=0.6, limit_A=0.02)
    off = OffConfirmed(by="run", determined_by="measured", current_A=0.003, limit_A=0.02)
    states = [heard(on).progress, heard(on, flows).progress, heard(on, flows, off).progress, heard(off, on).progress]
    assert [state.coil_A for state in states] == [None, 0.6, 0.003, None]
    assert [state.off_by for state in states] == ["", "", "measured", ""]


def test_the_page_counts_states_and_ignores_events_of_a_later_release() -> None:
    begun = RunBegun(
        dataset="run.h5",
        protocol="p",
        specimen="s",
        rig="r",
        states=4,
        currents_A=(0.0, 0.1, 0.2, 0.3),
        resumes=False,
        guardian=False,
        without_contact="",
        hottest_share=0.5,
    )
    states = [StateStored(state=k, current_A=k / 10, waited_s=1.0, flags=(), time_s=100.0 + 7.0 * k) for k in range(3)]
    run = heard(begun, *states)
    run.heard(None)
    assert (run.progress.states, run.progress.stored) == (4, 3)
    assert run.progress.left_s == pytest.approx(7.0)
    assert run.progress.without_contact == "nothing happens, because the coil is simulated"


def test_stop_does_not_call_a_coil_off_that_was_on_before_the_run() -> None:
    async def stopped_after(*events: Event) -> tuple[str, str]:
        run = heard(*events)
        run._ended.set()
        return await run.stop(), run.progress.coil

    refusal = OffNotConfirmed(by="run", reason=f"COM3: the output is on{SWITCH_OFF_FIRST}")
    words = (
        "THE COIL MAY STILL BE ON, switch it off by hand: COM3: the output is on; switch it off at the supply, then "
    )
    assert in_new_loop(stopped_after(refusal)) == (f"{words}press Start", "unknown")
    assert in_new_loop(stopped_after()) == ("this run has switched nothing on", "off")


def starts_with(monkeypatch: pytest.MonkeyPatch, start: Callable[[], Any]) -> None:
    # Let a run start its process with the function `start`.
    async def started(*arguments: str, **options: Any) -> Any:
        return start()

    monkeypatch.setattr(bench_run, "asyncio", changed_module(asyncio, create_subprocess_exec=started))


def in_new_loop(work: Any) -> Any:
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, work).result()


def test_a_run_that_is_stopped_while_the_live_camera_closes_is_not_started(
    files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    starts_with(monkeypatch, lambda: pytest.fail("the run was started"))
    tabs = SimpleNamespace(changed=lambda: None, show=lambda about, picture: None)
    desk = RunDesk(DataFolder(files.resolve()), None, tabs)  # type: ignore[arg-type]
    answers: list[Any] = []

    async def stop_while_closing() -> None:
        answers.append(await desk._stop(None))  # type: ignore[arg-type]

    desk.camera.close = stop_while_closing  # type: ignore[method-assign]
    in_new_loop(desk._start({"protocol": "protocol.toml", "specimen": "type1", "rig": "virtual", "dataset": "new.h5"}))
    assert desk.run is not None
    assert (desk.run.going_on, desk.run.progress.phase, desk.run.progress.stopped) == (False, "ended", True)
    assert [json.loads(answer.body) for answer in answers] == [
        {"words": "this run has switched nothing on", "off": True}
    ]


def test_a_run_that_is_ended_while_its_process_starts_receives_a_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    signals: list[int] = []

    async def nothing(*given: Any) -> None: ...

    async def closed(events: int) -> None:
        os.close(events)

    async def begin() -> None:
        run = a_run(Path("nowhere"))
        run._eyes.open, run._eyes.see, run._hear = nothing, nothing, closed  # type: ignore[method-assign]

        def started() -> Any:
            run.end()
            return SimpleNamespace(send_signal=signals.append)

        starts_with(monkeypatch, started)
        await run.begin()

    in_new_loop(begin())
    assert signals == [signal.SIGTERM]


def test_a_run_whose_process_cannot_be_started_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> Any:
        raise BlockingIOError("no more processes")

    async def begin() -> BenchRun:
        run = a_run(Path("nowhere"))
        starts_with(monkeypatch, refused)
        with pytest.raises(BlockingIOError):
            await run.begin()
        return run

    run = in_new_loop(begin())
    assert (run.going_on, run.progress.phase) == (False, "ended")


def test_a_run_that_cannot_be_started_leaves_no_pipe_open(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> Any:
        raise BlockingIOError("no more processes")

    made: list[int] = []

    def pipe() -> tuple[int, int]:
        made.extend(os.pipe())
        return made[-2], made[-1]

    async def begin() -> None:
        starts_with(monkeypatch, refused)
        monkeypatch.setattr(bench_run, "os", changed_module(os, pipe=pipe))
        with pytest.raises(BlockingIOError):
            await a_run(Path("nowhere")).begin()

    in_new_loop(begin())
    assert len(made) == 4
    for descriptor in made:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(descriptor)
