"""Run `eimi` with a camera of 30 frames per second, and with faults of the camera and the clock.

    python -m benchmarks.spoilt_run acquire protocol.toml …

A fault begins when a file with its name appears in the present folder. With `grab`, `flush` or `close`, the camera's
method of this name never returns. With `grab-locked`, `grab` also holds Python's global lock, so that nothing else
runs. With `clock` the wall clock steps back by two minutes. The script writes the file `reached` when a method that
never returns is called.
"""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from pathlib import Path

from eimi_drivers.cameras.opencv import OpenCVCamera
from eimi_drivers.interfaces import Frame
from eimi_lab.cli import main

FRAME_S = 1 / 30
STEP_S = 120.0
FOR_EVER_S = 3600


def spoil(folder: Path) -> None:
    """Let the wall clock or a method of the camera fail while `folder` contains a file with the name of the fault."""
    grab, flush, close, wall = OpenCVCamera.grab, OpenCVCamera.flush, OpenCVCamera.close, time.time

    def block(what: str) -> None:
        if (folder / what).exists():
            (folder / "reached").touch()
            threading.Event().wait()

    def spoilt_grab(camera: OpenCVCamera, timeout_s: float) -> Frame:
        time.sleep(FRAME_S)
        block("grab")
        if (folder / "grab-locked").exists():
            (folder / "reached").touch()
            ctypes.PyDLL(None).sleep(FOR_EVER_S)
        return grab(camera, timeout_s)

    def spoilt_flush(camera: OpenCVCamera) -> None:
        block("flush")
        flush(camera)

    def spoilt_close(camera: OpenCVCamera) -> None:
        block("close")
        close(camera)

    OpenCVCamera.grab = spoilt_grab  # type: ignore[method-assign]
    OpenCVCamera.flush = spoilt_flush  # type: ignore[method-assign]
    OpenCVCamera.close = spoilt_close  # type: ignore[method-assign]
    time.time = lambda: wall() - (STEP_S if (folder / "clock").exists() else 0.0)


if __name__ == "__main__":
    spoil(Path.cwd())
    sys.exit(main())
