"""Start and end two processes for the live web page: one compresses frames, the other finds edges in frames."""

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
    """Two processes that read frames from shared memory: one compresses frames, the other finds edges in frames.

    Parameters
    ----------
    number : int
        Number of the run; 0 for the live camera.
    seen : callable
        Receives the description of a frame with its JPEG, or the edges of a frame (a JSON object) with empty bytes.
    """

    def __init__(self, number: int, seen: Seen) -> None:
        self._number, self._seen = number, seen
        self._processes: list[asyncio.subprocess.Process] = []

    async def open(self, memory: int, bell: int, rig: str, specimen: str) -> None:
        """Start the process for the frames and the process for the edges.

        Parameters
        ----------
        memory : int
            File descriptor of the shared memory.
        bell : int
            Reading end of the pipe that announces new frames.
        rig, specimen : str
            Paths of the rig file (which lists the instruments) and the specimen file, or names of shipped files.
        """
        closed, self._open_while_seen = os.pipe()
        self._processes = [
            await self._started(FRAMES, memory, bell, rig),
            await self._started(EDGES, memory, closed, rig, specimen),
        ]
        os.close(closed)

    async def see(self) -> None:
        """Pass frames and edges to the function `seen` until the processes that produce them have ended."""
        frames, edges = self._processes
        finding = asyncio.create_task(self._see(edges))
        # The process for the frames ends first, after the last frame; then the other process is asked to end.
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
