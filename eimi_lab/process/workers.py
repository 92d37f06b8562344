"""Distribute long tasks to processes of this computer or to a dask cluster.

If a worker is lost, another worker repeats the task. The results do not depend on the number of workers.
"""

from __future__ import annotations

import multiprocessing
import os
import platform
import signal
import struct
import sys
import threading
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import cache, partial
from importlib import import_module
from importlib.metadata import version
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from eimi_lab.process.detached import give_way
from eimi_lab.process.errors import InputError
from eimi_lab.process.garbage import collect_seldom, keep_freed_memory
from eimi_lab.process.threads import THREADS

T = TypeVar("T")
Task = TypeVar("Task")

_LOOK_EVERY_S = 0.5
LARGEST_NUMBER_OF_LOSSES = 3  # successive losses of workers without a finished task between them
PACKAGES = ("eimi-lab", "numpy", "scipy", "cma")  # numerical results depend on the versions of these packages
_ANSWER_S = 10


def executor_for(workers: int, scheduler: str | None) -> Callable[[], AbstractContextManager[Executor]] | None:
    """Return a function that creates the executor for the options ``--workers`` and ``--scheduler``.

    An executor (see the module `concurrent.futures`) runs tasks, here in other processes.

    Parameters
    ----------
    workers
        Number of processes.
    scheduler
        Address of a dask scheduler; None without a cluster.

    Returns
    -------
    callable or None
        The function; None if the tasks are to run in this process.

    Raises
    ------
    InputError
        If several workers and a scheduler are given, or if the cluster cannot be used.
    """
    if scheduler is None:
        # More workers than processors would only need more memory. Windows waits for at most 61 processes at once.
        workers = min(workers, os.cpu_count() or 1, 61)
        return partial(processes, workers) if workers > 1 else None
    if workers > 1:
        raise InputError(
            f"--workers {workers}: the cluster at --scheduler {scheduler} has its own workers; give only one of the "
            "two options"
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
    """Run tasks, and yield each task with its result in the order in which the tasks finish.

    Parameters
    ----------
    function
        Function that carries out a task.
    arguments
        Function that returns the keyword arguments of ``function`` for a task.
    tasks
        The tasks.
    executor
        Function that creates an executor (`concurrent.futures`) with other processes; None runs the tasks in this
        process.
    expected
        Types of errors of ``function`` that are raised only when the result of the task is requested.
    meanwhile
        Function that is called once after all tasks were given to an executor.
    further
        Function that returns new tasks, which follow from a task and its result.

    Yields
    ------
    task
        A task.
    result : callable
        Function that returns the result of the task or raises the error of the task.

    Raises
    ------
    ChildProcessError
        If workers are lost several times and no task finishes between two losses.
    """
    remaining, losses = list(tasks), 0
    while remaining:
        if executor is None:
            task = remaining.pop(0)
            result = cache(partial(function, **arguments(task)))  # cached, because it is called here and by the caller
            remaining += further(task, result()) if further else ()
            yield task, result
            continue
        # `concurrent.futures.wait` locks all futures in turn. If a signal raised an error at this moment, some futures
        # would stay locked, and the pool could not be shut down any more. A queue avoids this.
        finished: SimpleQueue[Future[T]] = SimpleQueue()
        with executor() as pool:
            submit = partial(_submitted, pool, function, arguments, finished)
            try:
                unfinished = submit(remaining)
                if meanwhile:
                    meanwhile()
                    meanwhile = None
                while unfinished:
                    future = _next(finished)
                    task, error = unfinished.pop(future), future.exception()
                    if error is not None and not isinstance(error, expected):
                        raise error
                    losses = 0
                    new = further(task, future.result()) if further and not error else ()
                    remaining.remove(task)
                    remaining += new
                    with suppress(BrokenProcessPool):  # the result is yielded, and the loss is noticed at the next task
                        unfinished |= submit(new)
                    yield task, future.result
            except BrokenProcessPool as error:
                losses += 1
                if losses == LARGEST_NUMBER_OF_LOSSES:
                    raise ChildProcessError(
                        f"worker processes were lost {losses} times in succession, probably because the memory did "
                        "not suffice; fewer --workers need less memory"
                    ) from error


def _submitted(
    pool: Executor,
    function: Callable[..., T],
    arguments: Callable[[Task], Mapping[str, object]],
    finished: SimpleQueue[Future[T]],
    tasks: Sequence[Task],
) -> dict[Future[T], Task]:
    """Give tasks to a pool of workers, and return the tasks by their futures (objects for the results).

    When a task is done, its future is put into the queue ``finished``.
    """
    futures = {pool.submit(function, **arguments(task)): task for task in tasks}
    for future in futures:
        future.add_done_callback(finished.put)
    return futures


def _next(finished: SimpleQueue[Future[T]]) -> Future[T]:
    """Wait until the next task is done, and return its future (its result) from the queue ``finished``."""
    while True:
        with suppress(Empty):
            return finished.get(timeout=_LOOK_EVERY_S)  # without a limit, Windows would not deliver Ctrl-C


class _Processes(ProcessPoolExecutor):
    """A pool of processes that start with Ctrl-C blocked."""

    def submit(self, function: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Give a task to the pool, and return the future, an object for the result of the task."""
        with _blocked("SIGINT"):  # a starting process that receives Ctrl-C would print a traceback
            return super().submit(function, *args, **kwargs)


@contextmanager
def _blocked(name: str) -> Iterator[None]:
    """Block the signal ``name`` within the context, in this process and in the processes that the context starts."""
    if sys.platform == "win32":
        yield
    else:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [getattr(signal, name)])
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def processes(workers: int) -> Iterator[Executor]:
    """Create and yield a pool of ``workers`` processes on this computer, which end at the end of the context."""
    before = set(multiprocessing.active_children())
    start_resource_tracker()
    pool = _Processes(workers, multiprocessing.get_context("spawn"), _begin_work)
    try:
        yield pool
    except BaseException:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
        raise
    finally:
        workers_of_pool = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        _wait_for_end(workers_of_pool)


def _wait_for_end(workers: Collection[BaseProcess]) -> None:
    """Wait until all workers have ended; end the others if one of them was killed."""
    # A worker that is killed while it waits for a task holds the lock of the queue of tasks. The others would wait for
    # this lock for ever.
    while running := [worker for worker in workers if worker.is_alive()]:
        if any(worker.exitcode for worker in workers):
            for worker in running:
                worker.terminate()
        running[0].join(_LOOK_EVERY_S)


@contextmanager
def started(
    executor: Callable[[], AbstractContextManager[Executor]] | None, workers: int, module: str
) -> Iterator[Callable[[], AbstractContextManager[Executor]] | None]:
    """Start an executor (`concurrent.futures`) with its worker processes before the tasks are known.

    Parameters
    ----------
    executor
        Function that creates the executor; None if the tasks run in this process.
    workers
        Number of workers.
    module
        Name of a module that the workers load meanwhile.

    Yields
    ------
    callable or None
        A function that returns the started executor at its first call, and a new executor at each later call; None if
        ``executor`` is None.
    """
    if executor is None:
        yield None
        return
    with executor() as pool:
        for _ in range(workers):
            pool.submit(import_module, module)
        unused = [pool]
        yield lambda: nullcontext(unused.pop()) if unused else executor()


def start_resource_tracker() -> None:
    """Start Python's resource tracker in such a way that the closing of the terminal (a hang-up) does not end it.

    The resource tracker is a process that removes the resources that processes share.
    """
    if sys.platform != "win32":  # Windows removes shared resources by itself
        with _blocked("SIGHUP"):  # the tracker itself ignores the other signals that end a program
            resource_tracker.ensure_running()


def leave_with_parent() -> None:
    """Let this worker process ignore Ctrl-C, and end it when its parent process ends for any reason."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    collect_seldom()
    parent = multiprocessing.parent_process()
    if parent is not None:

        def leave() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=leave, daemon=True).start()


def _begin_work() -> None:
    """Prepare this process for the tasks of a pool, with a lower priority than its parent process."""
    leave_with_parent()
    keep_freed_memory()
    give_way(1)


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Create and yield an executor for the workers of a dask cluster.

    Parameters
    ----------
    address
        Address of the scheduler of the cluster, such as tcp://host:8786.

    Raises
    ------
    InputError
        If dask.distributed is not installed, no scheduler answers, or the workers are missing or not suitable.
    ChildProcessError
        If the workers of the cluster are lost.
    """
    import asyncio  # imported here because it loads slowly and processes do not need it

    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        raise InputError(f"--scheduler {address}: needs dask.distributed: pip install 'eimi-lab[cluster]'") from error
    try:
        with ThreadPoolExecutor(1) as thread:  # in a notebook, this thread already runs an event loop
            thread.submit(asyncio.run, asyncio.wait_for(_greet(address), _ANSWER_S)).result()
        client = Client(address, timeout=_ANSWER_S)
    except (OSError, ValueError, MemoryError, struct.error) as error:  # another service may answer
        raise InputError(
            f"--scheduler {address}: no dask scheduler answers there; an address has the form tcp://host:8786"
        ) from error
    with client:
        _check_versions(client, address)
        pool = client.get_executor()
        try:
            yield pool
        except (KilledWorker, CancelledError) as error:
            raise ChildProcessError(
                f"--scheduler {address}: the cluster did not finish a task, because its workers were lost ({error})"
            ) from error
        finally:
            pool.shutdown(wait=False)


async def _greet(address: str) -> None:
    """Check that a dask scheduler answers at ``address``: connect to it and close the connection."""
    from distributed.comm import connect

    await (await connect(address)).close()


def _check_versions(client: object, address: str) -> None:
    if not client.run(version, "numpy"):  # type: ignore[attr-defined]
        raise InputError(f"--scheduler {address}: has no workers; start some with `dask worker {address}`")
    for package in PACKAGES:
        for worker, its_version in client.run(version, package).items():  # type: ignore[attr-defined]
            if its_version != version(package):
                raise InputError(
                    f"--scheduler {address}: worker {worker} has {package} {its_version}, this computer has "
                    f"{version(package)}; the two versions should be the same"
                )
    for worker, threads in client.run(os.environ.get, THREADS[0]).items():  # type: ignore[attr-defined]
        if threads != "1":
            raise InputError(
                f"--scheduler {address}: worker {worker} has {THREADS[0]}={threads or ''}, but should have "
                f"{THREADS[0]}=1; set this variable before you start `dask worker`"
            )
    for worker, its_python in client.run(platform.python_version).items():  # type: ignore[attr-defined]
        if its_python.split(".")[:2] != [str(part) for part in sys.version_info[:2]]:
            raise InputError(
                f"--scheduler {address}: worker {worker} has Python {its_python}, this computer has Python "
                f"{platform.python_version()}; the two versions should be the same"
            )
