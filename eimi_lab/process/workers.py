"""Who does long work: this process, others, or a dask cluster. The last two are executors of the standard library.

A task is a whole fit, whose batches are its own, or the edges of one state: the same on any number of workers, and
again on another one when a worker is lost, each with one thread (`eimi_lab.process.threads`).
"""

from __future__ import annotations

import multiprocessing
import os
import platform
import signal
import struct
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache, partial
from importlib import import_module
from importlib.metadata import version
from multiprocessing import resource_tracker
from typing import Any, TypeVar

from eimi_lab.process.errors import InputError
from eimi_lab.process.garbage import collect_seldom, keep_what_is_freed
from eimi_lab.process.threads import THREADS

T = TypeVar("T")
Task = TypeVar("Task")

MOST_LOSSES = 3  # of workers, one after the other with no task finished between
PACKAGES = ("eimi-lab", "numpy", "scipy", "cma")  # that a number depends on
_ANSWER_S = 10


def executor_for(workers: int, scheduler: str | None) -> Callable[[], AbstractContextManager[Executor]] | None:
    """What `--workers` and `--scheduler` ask for; None is this process.

    Raises InputError for both at once, and as `cluster` does, before anything is written for a fit that cannot begin.
    """
    if scheduler is None:
        workers = min(workers, os.cpu_count() or 1)  # more would wait for each other, and need the memory
        return partial(processes, workers) if workers > 1 else None
    if workers > 1:
        raise InputError(
            f"--workers {workers}: the cluster at --scheduler {scheduler} has its own; give one of the two"
        )
    with cluster(scheduler):
        return partial(cluster, scheduler)


def completed(
    function: Callable[..., T],
    arguments: Callable[[Task], Mapping[str, object]],
    tasks: Sequence[Task],
    executor: Callable[[], AbstractContextManager[Executor]] | None = None,
    expected: tuple[type[Exception], ...] = (),
    meanwhile: Callable[[], None] | None = None,
    further: Callable[[Task, T], Sequence[Task]] | None = None,
) -> Generator[tuple[Task, Callable[[], T]]]:
    """Yields (task, a function that gives the result of function(**arguments(task)) or raises its error) as they come.

    In this process, one after the other, where there is no executor. Where a worker is lost, what is left is given to
    a new executor. Raises ChildProcessError when that does not help, and errors of the function that are not
    ``expected``.
    meanwhile: what this process does when all tasks are with the workers, before it waits for the first of them; not
    called where there is no executor. further: the tasks that a result asks for; the workers have them before it is
    yielded.
    """
    left, losses = list(tasks), 0
    while left:
        if executor is None:
            task = left.pop(0)
            result = cache(partial(function, **arguments(task)))  # asked for here and by the caller
            left += further(task, result()) if further else ()
            yield task, result
            continue
        with executor() as pool:
            try:
                futures = {pool.submit(function, **arguments(task)): task for task in left}
                if meanwhile:
                    meanwhile()
                    meanwhile = None
                while futures:
                    for future in wait(futures, return_when=FIRST_COMPLETED).done:
                        task, error = futures.pop(future), future.exception()
                        if error is not None and not isinstance(error, expected):
                            raise error
                        new = further(task, future.result()) if further and not error else ()
                        left.remove(task)
                        left += new
                        futures |= {pool.submit(function, **arguments(own)): own for own in new}
                        losses = 0
                        yield task, future.result
            except BrokenProcessPool as error:
                losses += 1
                if losses == MOST_LOSSES:
                    raise ChildProcessError(
                        f"worker processes were lost {losses} times, one after the other: is there memory enough for "
                        "so many? (fewer --workers need less)"
                    ) from error


class _Processes(ProcessPoolExecutor):
    """Its processes begin without heed of Ctrl-C, which would end them in many lines before they can be told."""

    def submit(self, function: Callable[..., T], /, *given: Any, **named: Any) -> Future[T]:
        """A process begins here where none is free."""
        with _blocked("SIGINT"):
            return super().submit(function, *given, **named)


@contextmanager
def _blocked(name: str) -> Iterator[None]:
    """Processes that begin meanwhile begin with a signal blocked; here it comes when this is over."""
    if not hasattr(signal, name) or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [getattr(signal, name)])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def processes(workers: int) -> Iterator[Executor]:
    """That many processes of this machine; they go when this one goes, and when the block ends by an error."""
    before = set(multiprocessing.active_children())
    begin_resource_tracker()
    pool = _Processes(workers, multiprocessing.get_context("spawn"), _begin_work)
    try:
        yield pool
    except BaseException:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def begun(
    executor: Callable[[], AbstractContextManager[Executor]] | None, workers: int, module: str
) -> Iterator[Callable[[], AbstractContextManager[Executor]] | None]:
    """The same executor, which begins now: its workers load a module while this process loads what it needs itself.

    Where workers are lost the next ones begin when they are asked for.
    """
    if executor is None:
        yield None
        return
    with executor() as pool:
        for _ in range(workers):
            pool.submit(import_module, module)
        first = [pool]
        yield lambda: nullcontext(first.pop()) if first else executor()


def begin_resource_tracker() -> None:
    """Python's process that removes what is shared begins with the first pool, and ends when this process does.

    A hang-up would end it before, since it ignores the other signals alone, and it would be missed in many lines. So it
    begins with that signal blocked, which it inherits.
    """
    with _blocked("SIGHUP"):
        resource_tracker.ensure_running()


def leave_with_parent() -> None:
    """In a worker: do not outlive the parent, however it ends, and leave Ctrl-C to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    collect_seldom()
    parent = multiprocessing.parent_process()
    if parent is not None:

        def leave() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=leave, daemon=True).start()


def _begin_work() -> None:
    """In a worker of a pool: the parent has less to do, and what it shows is waited for."""
    leave_with_parent()
    keep_what_is_freed()
    if hasattr(os, "nice"):
        os.nice(1)


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """The workers of a dask cluster whose scheduler listens at `address`, such as tcp://host:8786.

    Raises InputError where dask.distributed is not installed, no scheduler answers, no worker is there or one has
    another version of a package that decides the last digits; ChildProcessError when the cluster is lost.
    """
    import asyncio  # slow to load, and of no use to processes

    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        raise InputError(f"--scheduler {address}: needs dask.distributed: pip install 'eimi-lab[cluster]'") from error
    try:
        asyncio.run(asyncio.wait_for(_greet(address), _ANSWER_S))
        client = Client(address, timeout=_ANSWER_S)
    except (OSError, ValueError, MemoryError, struct.error) as error:  # another service's answer read as dask's
        raise InputError(f"--scheduler {address}: no dask scheduler answers there (such as tcp://host:8786)") from error
    with client:
        _check_versions(client, address)
        pool = client.get_executor()
        try:
            yield pool
        except (KilledWorker, CancelledError) as error:
            raise ChildProcessError(
                f"{address}: the cluster gave a fit up after losing its workers ({error})"
            ) from error
        finally:
            pool.shutdown(wait=False)


async def _greet(address: str) -> None:
    """A client waits for ever for the greeting of a service that is none of dask's; this may be given up."""
    from distributed.comm import connect

    await (await connect(address)).close()


def _check_versions(client: object, address: str) -> None:
    found = client.run(version, "numpy")  # type: ignore[attr-defined]
    if not found:
        raise InputError(f"--scheduler {address}: has no workers; start some with `dask worker {address}`")
    for package in PACKAGES:
        for worker, there in client.run(version, package).items():  # type: ignore[attr-defined]
            if there != version(package):
                raise InputError(
                    f"--scheduler {address}: worker {worker} has {package} {there}, here is {version(package)}; "
                    "they should be the same"
                )
    for worker, there in client.run(os.environ.get, THREADS[0]).items():  # type: ignore[attr-defined]
        if there != "1":
            raise InputError(
                f"--scheduler {address}: worker {worker} has {THREADS[0]}={there or ''}; start it with 1, as "
                "`dask worker` does itself unless it is told --no-nanny"
            )
    for worker, there in client.run(platform.python_version).items():  # type: ignore[attr-defined]
        if there.split(".")[:2] != [str(part) for part in sys.version_info[:2]]:
            raise InputError(
                f"--scheduler {address}: worker {worker} has Python {there}, here is {platform.python_version()}"
            )
