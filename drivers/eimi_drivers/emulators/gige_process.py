"""Serve an emulated GigE Vision camera in a separate process."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.cameras.aravis_library import load_aravis
from eimi_drivers.emulators.gige_camera import serve_gige
from eimi_drivers.interfaces import InstrumentError, raised

START_WITHIN_S = 120.0
"""Time limit (s) for the start of the process, which includes the preparation of the first picture."""

END_WITHIN_S = 5.0
LOOK_EVERY_S = 0.1


class CameraProcess:
    """A separate process that serves an emulated camera."""

    def __init__(self, process: BaseProcess, line: Connection) -> None:
        self._process, self._line = process, line

    @property
    def alive(self) -> bool:
        """True if the process is running."""
        return self._process.is_alive()

    def lose_packets(self, share: float) -> None:
        """Lose a share (0 to 1) of the network packets of all further pictures."""
        self._line.send(share)
        self._line.recv()

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.join()

    def raise_failure(self) -> None:
        """Raise InstrumentError if the process has ended."""
        if self.alive:
            return
        failure = self._line.recv() if self._line.poll() else f"it ended with exit status {self._process.exitcode}"
        raise InstrumentError(f"the process of the emulated camera has ended: {failure}")


@contextmanager
def gige_process(
    prepare: Callable[[], Callable[[], NDArray[np.uint8]]], size_px: tuple[int, int], **camera: Any
) -> Iterator[CameraProcess]:
    """Serve an emulated camera from a new process while the `with` block runs, and yield the process.

    Parameters
    ----------
    prepare : callable
        A picklable function that is called once in the new process. It returns a second function, which is called at
        each exposure and returns the picture of the whole sensor, shape (height, width).
    size_px : tuple of int
        Width and height of the sensor, px.
    **camera
        Further keyword arguments of `serve_gige`.

    Raises
    ------
    InstrumentError
        The library Aravis is not installed, or the camera does not start.
    """
    load_aravis()
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there, prepare, size_px, camera), name="camera", daemon=True)
    process.start()
    there.close()
    try:
        try:
            began = here.recv() if here.poll(START_WITHIN_S) else f"no answer within {START_WITHIN_S:g} s"
        except EOFError:
            began = "its process ended"
        if began is not True:
            raise InstrumentError(f"the emulated camera could not be started: {began}")
        yield CameraProcess(process, here)
    finally:
        here.close()  # the process ends when this connection is closed
        process.join(END_WITHIN_S)
        if process.is_alive():
            process.kill()
            process.join()


def _serve(
    line: Connection,
    prepare: Callable[[], Callable[[], NDArray[np.uint8]]],
    size_px: tuple[int, int],
    options: dict[str, Any],
) -> None:
    # Ctrl-C ends the program that started this process, and this process then ends too.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with serve_gige(prepare(), size_px, **options) as camera:
            line.send(True)
            while camera.failure is None:
                if line.poll(LOOK_EVERY_S):
                    camera.lose_packets(line.recv())
                    line.send(True)
            line.send(raised(camera.failure))
    except (EOFError, BrokenPipeError):  # the program that started this process has ended
        return
    except InstrumentError as error:
        line.send(str(error))
    except Exception as error:  # the function of the caller can raise any exception
        line.send(raised(error))
