"""The web addresses of the page that show the live image of a camera before a run."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

from starlette.routing import BaseRoute, Route

from eimi_lab.page import choices
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.page.frame_memory import new_memory
from eimi_lab.page.instructions import at_the_page
from eimi_lab.page.opened_eyes import OpenedEyes
from eimi_lab.page.tabs import Tabs
from eimi_lab.process.detached import detached
from eimi_lab.process.errors import InputError
from eimi_lab.process.pipes import handed_down

OF_NO_RUN = 0
"""Number that is sent with the frames of the live camera, where frames of a run have the number of the run."""

CLOSED_WITHIN_S = 7.0  # a camera that hangs in a call gives up after 5.5 s
LOOK_EVERY_S = 1.0


@dataclass
class View:
    """The state of the live camera.

    `rig` and `specimen` are the names that a person chose. `open` tells whether the camera is open. `last_words` is the
    last line that the process of the camera wrote.
    """

    rig: str
    specimen: str
    open: bool = True
    last_words: str = ""


class CameraDesk:
    """The live image of a camera before a run.

    Parameters
    ----------
    folder : DataFolder
        The data folder.
    tabs : Tabs
        The open browser tabs of the page.
    in_use : callable
        Returns whether a run uses the camera.
    """

    def __init__(self, folder: DataFolder, tabs: Tabs, in_use: Callable[[], bool]) -> None:
        self._folder, self._tabs = folder, tabs
        self._in_use = in_use
        self._process: asyncio.subprocess.Process | None = None
        self._watching: asyncio.Task[None] | None = None
        self._changing = asyncio.Lock()
        self.view: View | None = None

    def routes(self) -> list[BaseRoute]:
        """Return the web addresses of the live camera, with the functions that answer."""
        return [Route("/api/camera", self._tabs.steered(self._show), methods=["POST"])]

    def as_json(self) -> dict[str, Any]:
        """Return the chosen rig and specimen, and whether the live camera is open, as a JSON object."""
        return {"camera": asdict(self.view) if self.view else None}

    async def close(self) -> None:
        """Close the camera if it is open, and wait until it is closed."""
        async with self._changing:
            await self._close()

    async def _show(self, asked: dict[str, Any]) -> Any:
        rig, specimen = (choices.chosen(self._folder, kind, asked.get(kind)) for kind in ("rig", "specimen"))
        async with self._changing:
            if self._in_use():
                raise InputError("a run is under way and uses the camera; wait for its end, or end it")
            await self._close()
            await self._open(rig, specimen, View(str(asked["rig"]), str(asked["specimen"])))
        return {}

    async def _open(self, rig: str, specimen: str, view: View) -> None:
        memory = new_memory()
        bell_read_end, bell = os.pipe()
        with handed_down(memory, bell) as (names, inherited):
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", "eimi_lab.page.camera_alone", *names, rig, specimen),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
                **(inherited | detached()),
            )
        eyes = OpenedEyes(OF_NO_RUN, self._tabs.show)
        await eyes.open(memory, bell_read_end, rig, specimen)
        for descriptor in (memory, bell, bell_read_end):
            os.close(descriptor)
        self.view = view
        self._tabs.changed()
        self._watching = asyncio.create_task(self._watch(self._process, eyes, view))

    async def _watch(self, process: asyncio.subprocess.Process, eyes: OpenedEyes, view: View) -> None:
        """Send the frames of the camera and their edges to all open tabs, until the process of the camera has ended."""
        without_tabs = asyncio.create_task(self._end_without_tabs(process))
        seeing = asyncio.create_task(eyes.see())
        assert process.stderr is not None
        async for line in process.stderr:
            view.last_words = at_the_page(line.decode("utf-8", "replace").strip().removeprefix("eimi: "))
        await process.wait()
        without_tabs.cancel()
        eyes.kill()
        await seeing
        view.open = False
        self._tabs.changed()

    async def _end_without_tabs(self, process: asyncio.subprocess.Process) -> None:
        while self._tabs.any_open():
            await asyncio.sleep(LOOK_EVERY_S)
        _let_go(process)

    async def _close(self) -> None:
        if self._process is None or self._watching is None:
            return
        _let_go(self._process)
        with suppress(TimeoutError):
            await asyncio.wait_for(self._process.wait(), CLOSED_WITHIN_S)
        with suppress(ProcessLookupError):
            self._process.kill()
        await self._watching
        self._process = self._watching = None


def _let_go(process: asyncio.subprocess.Process) -> None:
    """Tell the process of the camera to end, by closing its standard input."""
    assert process.stdin is not None
    process.stdin.close()
