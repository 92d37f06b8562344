"""Start and end the two processes of `eye`, and receive their results. This is code of the server of the page.

The page is the live web page of `eimi dashboard`.

One process compresses the frames of a run or of the live camera. The other process finds the edges in these frames.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from eimi_lab.page.eye import EDGES, FRAMES, SIZES
from eimi_lab.process.detached import detached
from eimi_lab.process.pipes import handed_down

Seen = Callable[[dict[str, Any], bytes], None]


class OpenedEyes:
    """The two processes that read frames from shared memory: one compresses the frames, one finds their edges.

    Parameters
    ----------
    number : int
        Number of the run, which is sent with every frame; 0 for the live camera.
    seen : callable
        Function that is called with the description of a frame and its JPEG, or with the edges of a frame as a JSON
        object and empty bytes.
    """

    def __init__(self, number: int, seen: Seen) -> None:
        self._number, self._seen = number, seen
        self._processes: list[asyncio.subprocess.Process] = []

    async def open(self, memory: int, bell: int, rig: str, specimen: str) -> None:
        """Start the process for the frames and the process for the edges.

        Parameters
        ----------
        memory : int
            Descriptor of the shared memory.
        bell : int
            Reading end of the pipe that announces new frames.
        rig, specimen : str
            Paths of the rig file and the specimen file, or names of files of this package.
        """
        closed, self._open_while_seen = os.pipe()
        self._processes = [
            await self._started(FRAMES, memory, bell, rig),
            await self._started(EDGES, memory, closed, rig, specimen),
        ]
        os.close(closed)

    async def see(self) -> None:
        """Pass the results of both processes, which are frames and edges, to the function `seen` of this object.

        The method returns when both processes have ended. The process for the frames ends first, after the last frame.
        The method then asks the process for the edges to end.
        """
        frames, edges = self._processes
        finding = asyncio.create_task(self._see(edges))
        await self._see(frames)
        os.close(self._open_while_seen)
        await finding

    def kill(self) -> None:
        """End the process for the frames and the process for the edges at once."""
        for process in self._processes:
            with suppress(ProcessLookupError):
                process.kill()

    async def _started(self, what: str, memory: int, until: int, *files: str) -> asyncio.subprocess.Process:
        with handed_down(memory, until) as (names, inherited):
            return await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", "eimi_lab.page.eye", what, *names, *files),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.DEVNULL,
                **(inherited | detached()),
            )

    async def _see(self, eye: asyncio.subprocess.Process) -> None:
        assert eye.stdout is not None
        with suppress(asyncio.IncompleteReadError):
            while True:
                about_bytes, picture_bytes = SIZES.unpack(await eye.stdout.readexactly(SIZES.size))
                about = json.loads(await eye.stdout.readexactly(about_bytes)) | {"run": self._number}
                self._seen(about, await eye.stdout.readexactly(picture_bytes) if picture_bytes else b"")
        await eye.wait()
