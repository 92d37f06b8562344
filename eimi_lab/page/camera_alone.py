"""The process that shows the camera before a run: it writes frames into memory that it shares with the page.

The process opens only the camera, not the supply of the coil.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress

from eimi_drivers.cameras.timed import TimedCamera
from eimi_drivers.clock import WallClock
from eimi_drivers.interfaces import Camera, InstrumentError
from eimi_lab.acquisition.cameras import open_rig_camera
from eimi_lab.acquisition.playback import Cue
from eimi_lab.config.rig import Rig, load_rig
from eimi_lab.config.specimen import SpecimenFile, load_specimen
from eimi_lab.page.frame_memory import FrameMemory
from eimi_lab.process.detached import give_way
from eimi_lab.process.errors import InputError, tell
from eimi_lab.process.pipes import never_wait_to_write, readable, received

EVERY_S = 0.25
"""Time (s) between two frames. This time is short enough for focusing, and leaves the processor free for a fit on the
same computer.
"""

FRAME_WITHIN_S = 5.0
GIVES_WAY = 5  # number that is added to the nice value
NO_CURRENT = {"state": None, "set_A": 0.0, "measured_A": 0.0, "on": False, "heat_share": None}


def show(memory: int, bell: int, rig: str, specimen: str) -> None:
    """Write frames of the camera into the shared memory until standard input closes.

    Parameters
    ----------
    memory, bell : int
        File descriptors of the shared memory, and of a pipe through which every frame is announced.
    rig, specimen : str
        Paths of the rig file (which lists the instruments) and the specimen file, or names of shipped files.

    Raises
    ------
    InputError, InstrumentError
        If a file cannot be used, or if the camera cannot be opened or gives no frames.
    """
    frames = FrameMemory(memory)
    never_wait_to_write(bell)
    now_s = time.monotonic()
    with _opened(load_rig(rig), load_specimen(specimen)) as camera:
        while not readable(sys.stdin.fileno(), EVERY_S):
            camera.flush()
            frame = camera.grab(FRAME_WITHIN_S)
            before_s, now_s = now_s, time.monotonic()
            about = {"at_s": now_s, "rate_Hz": 1 / (now_s - before_s), "number": frame.number}
            frames.write(frame.image, about | NO_CURRENT)
            with suppress(OSError):  # the page has ended, or the pipe is full of signals
                os.write(bell, b"\0")


@contextmanager
def _opened(rig: Rig, specimen: SpecimenFile) -> Iterator[Camera]:
    if rig.simulated:
        from eimi_lab.virtual.virtual_rig import open_virtual_rig

        supply, camera, _, _ = open_virtual_rig(rig, specimen)
        with closing(supply), closing(camera):
            yield camera
        return
    clock = WallClock()
    seconds = time.process_time if rig.virtual else time.monotonic
    name = f"camera {rig.camera.source}"
    with closing(TimedCamera(name, lambda: open_rig_camera(rig, specimen, clock, Cue()), seconds)) as opened:
        yield opened


if __name__ == "__main__":
    memory, bell, *files = sys.argv[1:]
    try:
        give_way(GIVES_WAY)
        show(received(memory), received(bell), *files)
    except (InputError, InstrumentError) as error:
        tell(str(error))
        sys.exit(1)
