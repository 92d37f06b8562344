"""Workers, signals, the log, progress, standard error and the terminal do what their callers rely on."""

from __future__ import annotations

import asyncio
import atexit
import ctypes
import errno
import gc
import io
import logging
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from eimi_lab.process import awake, console, detached, garbage, log, pipes, scope, stderr, stopping, threads, workers
from eimi_lab.process import progress as progress_module
from eimi_lab.process.errors import InputError, OwnFault, tell
from eimi_lab.process.progress import Report, progress, unseen
from eimi_lab.process.stderr import NeverBlocking, WrittenByThread
from eimi_lab.process.stopping import Stopped
from eimi_lab.process.workers import completed, executor_for
from tests.patience import PATIENCE_S
from tests.shared.changed_module import changed_module
from tests.shared.processes import wait_until

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs the signals and pipes of POSIX")


# The number of workers


@pytest.mark.parametrize(
    ("asked", "processors", "started"),
    [(1, 8, None), (2, 8, 2), (9, 8, 8), (2, None, None), (62, 100, 61), (61, 61, 61)],
)
def test_there_are_at_most_as_many_workers_as_processors_and_61(
    monkeypatch: pytest.MonkeyPatch, asked: int, processors: int | None, started: int | None
) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: processors)
    made = executor_for(asked, None)
    if started is None:
        assert made is None
    else:
        assert isinstance(made, partial)
        assert (made.func, made.args) == (workers.processes, (started,))


def test_a_cluster_is_tried_at_once_and_has_its_own_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []

    @contextmanager
    def cluster(address: str) -> Iterator[None]:
        tried.append(address)
        yield

    monkeypatch.setattr(workers, "cluster", cluster)
    made = executor_for(1, "tcp://host:8786")
    assert tried == ["tcp://host:8786"]
    assert isinstance(made, partial)
    assert made.args == ("tcp://host:8786",)
    with pytest.raises(InputError, match=r"^--workers 2: the cluster at --scheduler tcp://host:8786 has its own"):
        executor_for(2, "tcp://host:8786")


# Tasks


class Here(Executor):
    # An executor that runs each task at once in this process, and loses its workers at some submissions.

    def __init__(self, lost: Iterator[bool]) -> None:
        self.lost = lost

    def submit(self, function: Callable[..., Any], /, *_: Any, **named: Any) -> Future[Any]:
        if next(self.lost):
            raise BrokenProcessPool
        future: Future[Any] = Future()
        try:
            future.set_result(function(**named))
        except Exception as error:
            future.set_exception(error)
        return future


def square(number: int) -> int:
    if number < 0:
        raise ValueError(f"no square of {number}")
    return number * number


def squares(numbers: list[int], lost: list[int], **options: Any) -> list[tuple[int, Callable[[], int]]]:
    # Return numbers with functions that return their squares. The tasks with indices in `lost` kill their worker.
    submissions = iter(number in lost for number in range(100))
    return list(completed(square, lambda n: {"number": n}, numbers, lambda: Here(submissions), **options))


def test_workers_may_be_lost_twice_in_succession_but_not_three_times() -> None:
    assert [result() for _, result in squares([1, 2], [0, 1])] == [1, 4]
    with pytest.raises(ChildProcessError, match="worker processes were lost 3 times in succession"):
        squares([1], [0, 1, 2])


def test_a_finished_task_ends_a_succession_of_losses() -> None:
    # Two losses, a finished task, and two further losses are not three losses in succession.
    results = squares([2], [0, 1, 3, 4], further=lambda n, result: [n - 1] if n else [])
    assert [(task, result()) for task, result in results] == [(2, 4), (1, 1), (0, 0)]


def test_an_expected_error_is_raised_by_the_result_and_another_error_at_once() -> None:
    first, second = squares([-1, 3], [], expected=(ValueError,), further=lambda n, result: [])
    assert second[1]() == 9
    with pytest.raises(ValueError, match="no square of -1"):
        first[1]()
    with pytest.raises(ValueError, match="no square of -1"):
        squares([-1, 3], [], expected=(KeyError,))


def test_the_caller_works_meanwhile_once() -> None:
    done: list[str] = []
    squares([1, 2], [1], meanwhile=lambda: done.append("meanwhile"))
    assert done == ["meanwhile"]


def test_a_task_in_this_process_runs_once_and_in_order() -> None:
    ran: list[int] = []
    tasks = [3, 4]
    results = completed(lambda n: ran.append(n) or n, lambda n: {"n": n}, tasks, further=lambda n, result: [])
    assert [(task, result(), result()) for task, result in results] == [(3, 3, 3), (4, 4, 4)]
    assert ran == [3, 4]
    assert tasks == [3, 4]


@posix
def test_a_process_begins_with_a_blocked_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    def masked() -> list[str]:
        return [name for name in ("SIGINT", "SIGHUP") if getattr(signal, name) in signal.pthread_sigmask(0, [])]

    seen: list[list[str]] = []
    monkeypatch.setattr(workers.ProcessPoolExecutor, "submit", lambda *given: seen.append(masked()) or given[1:])
    assert workers._Processes.submit(workers._Processes(1), square, 3) == (square, 3)
    monkeypatch.setattr(workers.resource_tracker, "ensure_running", lambda: seen.append(masked()))
    workers.start_resource_tracker()
    assert seen == [["SIGINT"], ["SIGHUP"]]
    assert masked() == []


def test_a_worker_ends_with_its_parent_and_collects_garbage_seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[object] = []
    ended = threading.Event()
    monkeypatch.setattr(signal, "signal", lambda *given: done.append(given))
    monkeypatch.setattr(workers, "collect_seldom", lambda: done.append("collect seldom"))
    monkeypatch.setattr(workers, "keep_freed_memory", lambda: done.append("keep"))
    monkeypatch.setattr(workers, "give_way", done.append)
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: SimpleNamespace(join=lambda: done.append("join")))
    monkeypatch.setattr(os, "_exit", lambda status: (done.append(f"exit {status}"), ended.set()))
    workers._begin_work()
    assert ended.wait(PATIENCE_S)
    assert {"collect seldom", "keep", 1, "exit 1", (signal.SIGINT, signal.SIG_IGN)} <= set(done)
    assert done.index("join") < done.index("exit 1")
    done.clear()
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: None)
    workers.leave_with_parent()
    assert done == [(signal.SIGINT, signal.SIG_IGN), "collect seldom"]


# A cluster


class Cluster:
    # A replacement for a dask cluster with two workers, whose answers a test can change.

    def __init__(self) -> None:
        self.versions = dict.fromkeys(workers.PACKAGES, "1.0")
        self.threads: dict[str, str | None] = {"a": "1", "b": "1"}
        self.python = {"a": "3.11.2", "b": "3.11.9"}
        self.others: dict[str, str] = {}
        self.done: list[object] = []

    def run(self, function: Callable[..., Any], *given: str) -> dict[str, Any]:
        if function is workers.version:
            return {worker: self.others.get(f"{worker} {given[0]}", self.versions[given[0]]) for worker in self.threads}
        return dict(self.python) if not given else dict(self.threads)

    def get_executor(self) -> Any:
        return SimpleNamespace(shutdown=lambda wait: self.done.append(("shut down", wait)))

    def __enter__(self) -> None:
        self.done.append("open")

    def __exit__(self, *error: object) -> None:
        self.done.append("close")


class Lost(Exception):
    pass


@pytest.fixture
def dask(monkeypatch: pytest.MonkeyPatch) -> Cluster:
    # A cluster at the address tcp://host:8786; no scheduler answers at other addresses.
    made = Cluster()

    class Greeting:
        async def close(self) -> None:
            made.done.append("greeted")

    async def connect(address: str) -> Greeting:
        if address != "tcp://host:8786":
            raise OSError("refused")
        return Greeting()

    def client(address: str, timeout: float) -> Cluster:
        assert (address, timeout) == ("tcp://host:8786", 10)
        return made

    package, comm = ModuleType("distributed"), ModuleType("distributed.comm")
    package.Client, package.KilledWorker, comm.connect = client, Lost, connect  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "distributed", package)
    monkeypatch.setitem(sys.modules, "distributed.comm", comm)
    monkeypatch.setattr(workers, "version", lambda name: made.versions[name])
    monkeypatch.setattr(workers.platform, "python_version", lambda: "3.11.4")
    monkeypatch.setattr(sys, "version_info", (3, 11, 4))
    return made


ADDRESS = "tcp://host:8786"


def use(address: str, error: BaseException | None = None) -> None:
    with workers.cluster(address) as pool:
        assert pool is not None
        if error is not None:
            raise error


def test_a_cluster_is_greeted_opened_and_closed(dask: Cluster) -> None:
    use(ADDRESS)
    assert dask.done == ["greeted", "open", ("shut down", False), "close"]


def test_a_cluster_is_opened_in_a_notebook_whose_event_loop_is_running(dask: Cluster) -> None:
    async def cell() -> None:
        use(ADDRESS)

    # Tests with a browser leave a running event loop in this thread.
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, cell()).result()
    assert dask.done == ["greeted", "open", ("shut down", False), "close"]


@pytest.mark.parametrize("error", [Lost("worker a"), CancelledError("task 3")])
def test_the_loss_of_the_workers_of_a_cluster_is_told(dask: Cluster, error: BaseException) -> None:
    with pytest.raises(ChildProcessError, match=rf"^--scheduler {ADDRESS}: the cluster did not finish .*\({error}\)$"):
        use(ADDRESS, error)
    assert dask.done[-2:] == [("shut down", False), "close"]


def test_a_scheduler_that_does_not_answer_is_refused(dask: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"^--scheduler tcp://other:1: no dask scheduler answers there; .* tcp://host"):
        use("tcp://other:1")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"needs dask\.distributed: pip install 'eimi-lab\[cluster\]'$"):
        use(ADDRESS)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda made: made.threads.clear(), f"has no workers; start some with `dask worker {ADDRESS}`"),
        (lambda made: made.others.update({"b scipy": "1.1"}), "worker b has scipy 1.1, this computer has 1.0; the two"),
        (lambda made: made.others.update({"a cma": "2"}), "worker a has cma 2, this computer has 1.0; the two"),
        (lambda made: made.threads.update(b=None), "worker b has OMP_NUM_THREADS=, but should have OMP_NUM_THREADS=1;"),
        (lambda made: made.threads.update(a="2"), "worker a has OMP_NUM_THREADS=2, but should have"),
        (lambda made: made.python.update(b="3.12.4"), "worker b has Python 3.12.4, this computer has Python 3.11.4; "),
        (lambda made: made.python.update(a="4.11.4"), "worker a has Python 4.11.4"),
    ],
)
def test_a_worker_of_a_cluster_that_would_give_other_numbers_is_refused(
    dask: Cluster, change: Callable[[Cluster], None], words: str
) -> None:
    change(dask)
    with pytest.raises(InputError) as caught:
        use(ADDRESS)
    assert str(caught.value).startswith(f"--scheduler {ADDRESS}: {words}")
    assert dask.done[-1] == "close"


def test_the_packages_on_which_numbers_depend() -> None:
    assert set(workers.PACKAGES) == {"eimi-lab", "numpy", "scipy", "cma"}


# Pipes


@posix
def test_an_end_of_a_pipe_is_handed_down_to_a_child_and_never_waited_for() -> None:
    reads, writes = os.pipe()
    code = "import sys; from eimi_lab.process.pipes import received; open(received(sys.argv[1]), 'w').write('heard')"
    with pipes.handed_down(writes) as (names, options):
        assert options == {"pass_fds": (writes,)}
        subprocess.run([sys.executable, "-c", code, *names], check=True, timeout=PATIENCE_S, **options)
    assert pipes.readable(reads, PATIENCE_S)
    assert os.read(reads, 100) == b"heard"
    assert not pipes.readable(reads, 0.0)
    assert os.get_blocking(writes)
    pipes.never_wait_to_write(writes)
    assert not os.get_blocking(writes)
    os.close(writes)
    assert pipes.readable(reads, 0.0)
    os.close(reads)


# Memory and threads


def test_garbage_is_collected_seldom_and_memory_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    # M_TRIM_THRESHOLD is -1 and M_MMAP_THRESHOLD -3 (mallopt(3)); both get more than the megabytes of one step.
    done: list[object] = []
    monkeypatch.setattr(gc, "set_threshold", done.append)
    monkeypatch.setattr(atexit, "register", done.append)
    garbage.collect_seldom()
    assert done == [50_000, gc.freeze]
    settings: dict[int, int] = {}
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", lambda name: SimpleNamespace(mallopt=settings.__setitem__))
    garbage.keep_freed_memory()
    assert settings == {-1: 268435456, -3: 33554432}
    monkeypatch.setattr(ctypes, "CDLL", lambda name: SimpleNamespace())
    garbage.keep_freed_memory()  # a C library without mallopt


def test_linear_algebra_gets_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        monkeypatch.setenv(name, "7")
    threads.one_thread_each()
    assert [os.environ[name] for name in threads.THREADS] == ["1"] * 4


# Messages, log and progress


def test_messages_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    tell("run.h5: is\n  damaged ")
    assert capsys.readouterr().err == "eimi: run.h5: is damaged\n"
    assert str(OwnFault("fitting run.h5", "KeyError: 3")) == (
        "fitting run.h5: KeyError: 3: a fault of this program; please report this line, and the file if you may"
    )


@pytest.mark.parametrize("level", ["info", "debug"])
def test_the_log_has_its_level_and_is_inherited(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], level: str
) -> None:
    monkeypatch.setenv("EIMI_LOG", "nothing")
    made = {name: logging.Logger(name, logging.WARNING) for name in ("eimi_lab", "eimi_drivers", "eimi_fitting")}
    above = logging.Logger("above")
    above.addHandler(logging.StreamHandler(sys.stderr))
    for logger in made.values():
        logger.parent = above
    replaced = {"StreamHandler": logging.StreamHandler, "Formatter": logging.Formatter, "getLogger": made.__getitem__}
    monkeypatch.setattr(log, "logging", SimpleNamespace(**replaced))
    log.log_to_stderr("loud")
    assert os.environ["EIMI_LOG"] == "nothing"
    assert all(not logger.handlers for logger in made.values())
    log.log_to_stderr(level)
    assert os.environ["EIMI_LOG"] == level
    for name, logger in made.items():
        logger.debug("small")
        logger.info("large")
        lines = capsys.readouterr().err.splitlines()
        assert [line.split(" ", 2)[2] for line in lines] == [
            f"{os.getpid()} {name}: {text}" for text in (["small", "large"] if level == "debug" else ["large"])
        ]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_a_bar_with_the_number_of_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    with progress("acquire", 3) as report:
        report("0.1 A")
        report.underway("settling")
        report("0.2 A")
    assert "acquire" in terminal.getvalue()
    last = terminal.getvalue().split("acquire")[-1]
    assert "2/3" in last
    assert "0.2 A" in last
    with progress("acquire", 3) as report:
        report("0.1 A")
        report.underway("settling")
    last = terminal.getvalue().split("acquire")[-1]
    assert "1/3" in last
    assert "settling" in last


def test_the_last_line_of_progress_has_no_estimate(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = iter([5.0, 7.0, 11.0])
    monkeypatch.setattr(progress_module, "time", changed_module(time, monotonic=lambda: next(now)))
    with progress("fit", 3) as report:
        for words in ("a", "b", "c"):
            report(words)
            report.underway("not shown")
    assert capsys.readouterr().err == "fit 1/3: a\nfit 2/3: b, about 2 s left\nfit 3/3: c\n"


def test_a_line_of_progress_does_not_wait_in_a_buffer(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(written, encoding="utf-8", newline="\n"))
    with progress("fit", 1) as report:
        report("done")
        assert written.getvalue() == b"fit 1/1: done\n"


def test_progress_is_hidden_only_within_its_context(capsys: pytest.CaptureFixture[str]) -> None:
    try:
        with unseen():
            raise KeyError
    except KeyError:
        pass
    with progress("fit", 1) as report:
        report("done")
    assert capsys.readouterr().err == "fit 1/1: done\n"
    said: list[str] = []
    Report(said.append)("step")
    Report(said.append).underway("nothing")
    assert said == ["step"]


# Signals


@pytest.fixture
def handlers(monkeypatch: pytest.MonkeyPatch) -> dict[int, Any]:
    # A replacement for the handlers of the signals of this process.
    kept: dict[int, Any] = {signal.SIGINT: signal.default_int_handler}
    kept |= dict.fromkeys(stopping.TERMINATION, signal.SIG_DFL)
    monkeypatch.setattr(signal, "getsignal", kept.__getitem__)
    monkeypatch.setattr(signal, "signal", kept.__setitem__)
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    monkeypatch.setattr(stopping, "_received", [])
    return kept


@posix
def test_an_ignored_signal_stays_ignored_and_the_others_stop_the_program(
    handlers: dict[int, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    closing: list[object] = []
    monkeypatch.setattr(stopping, "when_closed", closing.append)
    handlers[signal.SIGHUP] = signal.SIG_IGN
    stopping.unwind_on_termination()
    assert closing == [stopping._leave_the_console]
    assert handlers[signal.SIGHUP] is signal.SIG_IGN
    stopping.raise_if_asked()
    for number in (signal.SIGINT, signal.SIGTERM):
        with pytest.raises(Stopped) as caught:
            handlers[number](number, None)
        assert caught.value.number == number
        assert str(caught.value) == f"stopped by {signal.Signals(number).name}"
    with pytest.raises(Stopped, match="SIGINT"):  # the first signal counts
        stopping.raise_if_asked()
    with stopping.leaving():
        assert [handlers[n] for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == [signal.SIG_IGN] * 3
        handlers[signal.SIGHUP] = "as it was"
    assert [handlers[n] for n in (signal.SIGINT, signal.SIGTERM)] == [signal.SIG_DFL] * 2
    assert handlers[signal.SIGHUP] == "as it was"


@posix
def test_a_dropped_stop_is_sent_again_and_another_dropped_error_is_reported(
    handlers: dict[int, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    reported: list[object] = []
    timers: list[tuple[Any, ...]] = []

    class Timer:
        def __init__(self, *given: Any) -> None:
            self.given = given

        def start(self) -> None:
            timers.append(self.given)

    monkeypatch.setattr(sys, "unraisablehook", reported.append)
    monkeypatch.setattr(threading, "Timer", Timer)
    stopping.unwind_on_termination()
    other = SimpleNamespace(exc_value=ValueError())
    sys.unraisablehook(other)  # type: ignore[arg-type]
    assert (reported, timers) == ([other], [])
    sys.unraisablehook(SimpleNamespace(exc_value=Stopped(signal.SIGTERM)))  # type: ignore[arg-type]
    assert reported == [other]
    ((after_s, act, arguments),) = timers
    assert 0.0 < after_s < 1.0
    assert (act, arguments) == (stopping.signal_main_thread, [signal.SIGTERM])


@posix
def test_the_main_thread_receives_a_signal_from_any_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[tuple[int, int]] = []
    monkeypatch.setattr(signal, "pthread_kill", lambda *given: sent.append(given))
    thread = threading.Thread(target=stopping.signal_main_thread, args=[signal.SIGTERM])
    thread.start()
    thread.join()
    assert sent == [(threading.main_thread().ident, signal.SIGTERM)]
    monkeypatch.delattr(signal, "pthread_kill")
    monkeypatch.setattr(signal, "raise_signal", lambda number: sent.append((0, number)))
    stopping.signal_main_thread(signal.SIGINT)
    assert sent[-1] == (0, signal.SIGINT)


def test_the_first_message_about_the_end_counts() -> None:
    first = Stopped(signal.SIGINT, "the coil is off")
    second, third = KeyError(), Stopped(signal.SIGTERM)
    second.__context__, third.__context__ = first, second
    assert third.in_words() == "stopped by SIGINT: the coil is off"
    assert first.in_words() == "stopped by SIGINT: the coil is off"
    first.left = ""
    assert third.in_words() == "stopped by SIGTERM"


# Detached processes


@posix
def test_the_process_that_started_this_one_is_watched_and_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    parent = {"number": 77}
    killed: list[tuple[int, int]] = []
    monkeypatch.setattr(os, "getppid", lambda: parent["number"])
    monkeypatch.setattr(os, "kill", lambda *given: killed.append(given))
    starter = detached.Starter()
    assert starter.runs()
    starter.kill()
    assert killed == [(77, signal.SIGKILL)]
    parent["number"] = 1  # the process has ended, and init adopts this one
    assert not starter.runs()
    starter.kill()
    assert len(killed) == 1

    def gone(number: int, kind: int) -> None:
        raise ProcessLookupError

    parent["number"] = 77
    monkeypatch.setattr(os, "kill", gone)
    starter.kill()
    assert not detached.ended_with_others()
    assert detached.detached() == {"start_new_session": True}
    sent: list[int] = []
    detached.resume(SimpleNamespace(send_signal=sent.append))  # type: ignore[arg-type]
    assert sent == [signal.SIGCONT]


@posix
@pytest.mark.parametrize(("refusals", "written"), [(0, 1), (4, 1), (5, 0)])
def test_the_priority_of_a_session_is_tried_five_times(
    monkeypatch: pytest.MonkeyPatch, refusals: int, written: int
) -> None:
    # Linux accepts one change in a tenth of a second (sched(7)); five trials span four tenths.
    tries: list[str] = []
    slept: list[float] = []
    accepted: list[str] = []

    def write(text: str) -> None:
        tries.append(text)
        if len(tries) <= refusals:
            raise BlockingIOError
        accepted.append(text)

    monkeypatch.setattr(detached, "Path", lambda name: SimpleNamespace(write_text=write))
    monkeypatch.setattr(detached, "time", changed_module(time, sleep=slept.append))
    monkeypatch.setattr(os, "nice", lambda steps: 3 + steps)
    monkeypatch.setattr(os, "getsid", lambda number: 44)
    monkeypatch.setattr(os, "getpid", lambda: 44)
    detached.give_way(4)
    assert accepted == ["7"] * written
    assert len(tries) == min(refusals + 1, 5)
    assert slept == [0.1] * refusals
    monkeypatch.setattr(os, "getpid", lambda: 45)  # not the leader of its session
    detached.give_way(4)
    assert len(tries) == min(refusals + 1, 5)


@posix
def test_a_system_without_autogroups_is_tried_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    tries: list[str] = []

    def write(text: str) -> None:
        tries.append(text)
        raise FileNotFoundError

    monkeypatch.setattr(detached, "Path", lambda name: SimpleNamespace(write_text=write))
    detached._lower_session(3)
    assert tries == ["3"]


# Sleep and scopes


def test_the_clock_continues_during_sleep(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "clock_gettime", lambda clock: 100.0 + clock)
    monkeypatch.setattr(time, "CLOCK_BOOTTIME", 7, raising=False)
    monkeypatch.setattr(time, "CLOCK_MONOTONIC", 1)
    for system, seconds in (("linux", 107.0), ("darwin", 101.0)):
        monkeypatch.setattr(sys, "platform", system)
        assert awake.awake_s() == seconds


@pytest.mark.parametrize(
    ("system", "command"),
    [
        ("darwin", ["caffeinate", "-i", "-s", "-w", str(os.getpid())]),
        ("linux", ["systemd-inhibit", "--what=sleep:idle", "--who=eimi", "--why=a run", "cat"]),
    ],
)
def test_the_program_that_inhibits_sleep_is_ended(
    monkeypatch: pytest.MonkeyPatch, system: str, command: list[str]
) -> None:
    # Options of caffeinate(8): -i idle sleep, -s system sleep, -w the process to wait for; systemd-inhibit(1).
    done: list[object] = []

    def close() -> None:
        done.append("close")
        raise BrokenPipeError

    def start(given: list[str], **options: Any) -> SimpleNamespace:
        done.append(given)
        assert options == {"stdin": -1, "stdout": -3, "stderr": -3, "start_new_session": True}
        return SimpleNamespace(
            stdin=SimpleNamespace(close=close),
            terminate=lambda: done.append("terminate"),
            wait=lambda: done.append("wait"),
        )

    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(awake.shutil, "which", lambda name: f"/bin/{name}")
    monkeypatch.setattr(subprocess, "Popen", start)
    with suppress(KeyError), awake.kept_awake("a run"):
        done.append("the run")
        raise KeyError
    assert done == [command, "the run", "close", "terminate", "wait"]

    def fail(*given: Any, **options: Any) -> None:
        raise PermissionError

    monkeypatch.setattr(subprocess, "Popen", fail)
    with awake.kept_awake("a run"):
        pass


@pytest.mark.parametrize(
    ("lingers", "group", "moved"),
    [
        (True, "0::/user.slice/session-3.scope", True),
        (False, "0::/user.slice/user@1000.service/app.slice/a.scope", True),
        (False, "0::/user.slice/session-3.scope", False),
        (False, None, False),
    ],
)
def test_a_process_moves_only_to_a_scope_that_lasts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, lingers: bool, group: str | None, moved: bool
) -> None:
    asked: list[dict[str, Any]] = []

    def run(call: list[str], **options: Any) -> SimpleNamespace:
        asked.append({"call": call, **options})
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(scope.getpass, "getuser", lambda: "ada")
    monkeypatch.setattr(scope, "_LINGER", tmp_path)
    monkeypatch.setattr(scope, "_OWN_GROUP", tmp_path / "group")
    monkeypatch.setattr(scope.shutil, "which", lambda name: f"/bin/{name}")
    monkeypatch.setattr(scope.subprocess, "run", run)
    if lingers:
        (tmp_path / "ada").touch()
    if group is not None:
        (tmp_path / "group").write_text(group)
    assert scope.move_to_own_scope("eimi", "does") is moved
    assert len(asked) == moved
    if moved:
        options = asked[0]
        names = ("org.freedesktop.systemd1", "/org/freedesktop/systemd1", "org.freedesktop.systemd1.Manager")
        assert tuple(options.pop("call")[:7]) == (
            *("/bin/busctl", "--user", "call"),
            *names,
            "StartTransientUnit",
        )
        assert options == {"capture_output": True, "timeout": 3.0, "check": False}


@pytest.mark.parametrize("error", [OSError(), subprocess.TimeoutExpired("busctl", 3.0)])
def test_a_systemd_that_does_not_answer_is_no_fault(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def run(*given: Any, **options: Any) -> None:
        raise error

    def no_name() -> str:
        raise KeyError

    monkeypatch.setattr(scope, "_lasts_as_long_in_a_scope", lambda: True)
    monkeypatch.setattr(scope.shutil, "which", lambda name: None)
    assert not scope.move_to_own_scope("eimi", "does")
    monkeypatch.setattr(scope.shutil, "which", lambda name: f"/bin/{name}")
    monkeypatch.setattr(scope.subprocess, "run", run)
    assert not scope.move_to_own_scope("eimi", "does")
    monkeypatch.undo()
    monkeypatch.setattr(scope.getpass, "getuser", no_name)
    assert scope._lasts_as_long_in_a_scope() is False


# The terminal


@posix
@pytest.mark.parametrize(
    ("typed", "foreground", "line"),
    [(b"  stop \n", True, "stop"), (b"", True, None), (b"stop\n", False, None), (b"\xff\n", True, "\ufffd")],
)
def test_a_typed_line_is_read_in_the_foreground_without_waiting(
    monkeypatch: pytest.MonkeyPatch, typed: bytes, foreground: bool, line: str | None
) -> None:
    reads, writes = os.pipe()
    os.write(writes, typed)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(fileno=lambda: reads))
    monkeypatch.setattr(os, "tcgetpgrp", lambda descriptor: os.getpgrp() if foreground else -1)
    assert console.typed_line() == line
    os.close(reads)
    os.close(writes)
    assert console.typed_line() is None
    monkeypatch.setattr(sys, "stdin", None)
    assert console.typed_line() is None
    console.when_closed(lambda: None)  # does nothing here


# Standard error


def everything(descriptor: int) -> bytes:
    # Return all that can be read from a pipe without waiting.
    os.set_blocking(descriptor, False)
    received = b""
    try:
        while piece := os.read(descriptor, 65536):
            received += piece
    except BlockingIOError:
        pass
    return received


@posix
def test_the_older_half_of_too_much_text_is_replaced_by_a_count(monkeypatch: pytest.MonkeyPatch) -> None:
    # Of 21 lines of 10 bytes, the last 10 fit into half of 200 bytes; at 31 lines, 10 more are dropped.
    reads, writes = os.pipe()
    monkeypatch.setattr(stderr, "MOST_BYTES", 200)
    stream = NeverBlocking(writes)
    monkeypatch.setattr(stderr.select, "select", lambda *given: ([], [], []))  # nobody reads
    for number in range(20):
        assert stream.write(f"line {number:04d}\n") == 10
    assert len(stream._waiting) == 200
    stream.write("line 0020\n")
    kept = bytes(stream._waiting)
    assert kept.startswith(b"\neimi: 12 lines were dropped: nobody read them\n" + b"line 0012\n")
    assert kept.endswith(b"line 0020\n")
    assert stream._left()
    for number in range(21, 40):
        stream.write(f"line {number:04d}\n")
    lines = bytes(stream._waiting).decode().splitlines()
    dropped = int(lines[1].split()[1])
    assert lines[2] == f"line {dropped:04d}"
    assert lines[-1] == "line 0039"
    assert (stream.encoding, stream.writable(), stream.fileno(), stream.isatty()) == ("utf-8", True, writes, False)
    monkeypatch.undo()
    stream.finish()
    assert everything(reads).endswith(b"line 0039\n")
    for end in (reads, writes):
        os.close(end)


@posix
def test_a_stream_that_nobody_reads_is_given_up_after_two_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    reads, writes = os.pipe()
    stream = NeverBlocking(writes)
    now = {"s": 0.0}
    monkeypatch.setattr(stderr.select, "select", lambda *given: ([], [], []))
    advance = changed_module(time, monotonic=lambda: now["s"], sleep=lambda seconds: now.update(s=now["s"] + seconds))
    monkeypatch.setattr(stderr, "time", advance)
    stream.write("waits\n")
    descriptor = stream._descriptor
    stream.finish()
    assert now["s"] == pytest.approx(2.0, abs=0.02)
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)
    for end in (reads, writes):
        os.close(end)


@posix
def test_a_text_is_sent_in_pieces_that_a_pipe_accepts_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    # POSIX guarantees 512 bytes (PIPE_BUF); a write that would block leaves the rest waiting.
    reads, writes = os.pipe()
    stream = NeverBlocking(writes)
    sizes: list[int] = []

    def write(descriptor: int, text: bytes) -> int:
        if len(sizes) == 2:
            raise BlockingIOError
        sizes.append(len(text))
        return len(text)

    with monkeypatch.context() as pipe:
        pipe.setattr(os, "write", write)
        stream.write("x" * 1300)
        assert sizes == [512, 512]
        assert len(stream._waiting) == 1300 - 1024
    stream.flush()
    assert everything(reads) == b"x" * 276
    stream.write("\udc80µ")
    assert everything(reads) == b"\\udc80\xc2\xb5"
    stream.finish()
    for end in (reads, writes):
        os.close(end)


@posix
def test_a_thread_writes_the_text_in_the_order_of_the_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    reads, writes = os.pipe()
    stream = WrittenByThread(writes)
    for number in range(50):
        stream.write(f"{number}\n")
    stream.finish()
    assert not stream._left()
    assert stream._raw.closed
    assert everything(reads) == b"".join(b"%d\n" % number for number in range(50))
    stream.write("after the end\n")  # is no error
    os.close(writes)
    os.close(reads)


@posix
def test_a_thread_that_waits_for_its_reader_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stderr, "FINISH_WITHIN_S", 0.05)
    reads, writes = os.pipe()
    stream = WrittenByThread(writes)
    stream.write("x" * 200_000)  # more than a pipe accepts
    stream.finish()
    assert stream._left()
    assert not stream._raw.closed
    received = b""
    while len(received) < 200_000:
        received += os.read(reads, 65536)
    wait_until(lambda: not stream._left(), "the thread has not written its text")
    os.close(reads)
    stream.write("nobody hears this")
    wait_until(lambda: not stream._left(), "the thread waits")
    os.close(writes)


@posix
def test_standard_error_is_replaced_within_the_context(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = tmp_path / "errors.txt"
    with path.open("w") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        stream.write("before\n")
        with stderr.never_blocking():
            assert isinstance(sys.stderr, NeverBlocking)
            sys.stderr.write("within\n")
        assert sys.stderr is stream
        stream.write("after\n")
    assert path.read_text() == "before\nwithin\nafter\n"
    in_memory = io.StringIO()
    monkeypatch.setattr(sys, "stderr", in_memory)
    with stderr.never_blocking():
        assert sys.stderr is in_memory


@posix
def test_the_words_of_a_library_are_collected(capfd: pytest.CaptureFixture[str]) -> None:
    os.write(2, b"before\n")
    lowest = os.dup(2)
    os.close(lowest)
    with stderr.library_words() as lines:
        os.write(2, b"one \xff\ntwo\n")
        assert lines == []
    os.write(2, b"after\n")
    assert (os.dup(2), os.close(lowest)) == (lowest, None)  # no descriptor was left open
    assert lines == ["one \ufffd", "two"]
    assert capfd.readouterr().err == "before\nafter\n"


@pytest.mark.parametrize(
    ("system", "terminal", "encoding"), [("linux", False, None), ("win32", False, "utf-8"), ("win32", True, None)]
)
def test_every_character_can_be_printed(
    monkeypatch: pytest.MonkeyPatch, system: str, terminal: bool, encoding: str | None
) -> None:
    asked: list[dict[str, Any]] = []

    class Stream(io.TextIOWrapper):
        def isatty(self) -> bool:
            return terminal

        def reconfigure(self, **options: Any) -> None:
            asked.append(options)

    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(sys, "stdout", Stream(io.BytesIO()))
    monkeypatch.setattr(sys, "stderr", Stream(io.BytesIO()))
    stderr.write_every_character()
    assert asked == [{"encoding": encoding, "errors": "backslashreplace"}] * 2
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    stderr.write_every_character()
    assert len(asked) == 3


def test_each_closed_stream_is_opened_on_its_descriptor(monkeypatch: pytest.MonkeyPatch) -> None:
    # Standard input and standard error are closed; the system assigns the lowest free descriptor.
    opened: list[Any] = []

    def state(descriptor: int) -> None:
        if descriptor != 1:
            raise OSError(errno.EBADF, "closed")

    system = SimpleNamespace(
        fstat=state, open=lambda *given: opened.append(given), fdopen=lambda *given, **named: (*given, named),
        devnull="null device", O_RDWR=2,
    )  # fmt: skip
    streams = SimpleNamespace(stdin=None, stdout="open", stderr=None)
    monkeypatch.setattr(stderr, "os", system)
    monkeypatch.setattr(stderr, "sys", streams)
    stderr.open_closed_streams()
    assert opened == [("null device", 2)] * 2
    assert vars(streams) == {
        "stdin": (0, "r", {"closefd": False}), "stdout": "open", "stderr": (2, "w", {"closefd": False})
    }  # fmt: skip


CLOSED = """
import os, sys
for number in (0, 1):
    os.close(number)
sys.stdin = sys.stdout = None
from eimi_lab.process.stderr import open_closed_streams
open_closed_streams()
assert os.fstat(0).st_rdev == os.fstat(1).st_rdev == os.stat(os.devnull).st_rdev
assert sys.stdin.read() == "" and sys.stdin.fileno() == 0
print("nobody reads this", flush=True)
assert sys.stdout.fileno() == 1 and not sys.stdout.closed
"""


@posix
def test_a_closed_stream_is_the_null_device() -> None:
    done = subprocess.run([sys.executable, "-c", CLOSED], capture_output=True, check=False, timeout=PATIENCE_S)
    assert (done.returncode, done.stderr) == (0, b"")
