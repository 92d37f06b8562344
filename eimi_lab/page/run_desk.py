"""The web addresses with which the page controls a run."""

from __future__ import annotations

from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute

from eimi_lab.page import choices
from eimi_lab.page.bench_run import BenchRun, Order
from eimi_lab.page.camera_desk import CameraDesk
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.page.tabs import Tabs
from eimi_lab.page.worker import Worker
from eimi_lab.process.errors import InputError


class RunDesk:
    """The runs that the live web page starts, one at a time.

    Only one browser tab may control a run. Every tab can stop it at once.
    """

    def __init__(self, folder: DataFolder, worker: Worker, tabs: Tabs) -> None:
        self._folder, self._worker, self.tabs = folder, worker, tabs
        self.run: BenchRun | None = None
        self.camera = CameraDesk(folder, tabs, self._going_on)
        self._number = 0

    def routes(self) -> list[BaseRoute]:
        """Return the web addresses of the run and of the live camera, with the functions that answer."""
        steered = {"dry": self._dry, "start": self._start, "pause": self._pause, "go-on": self._go_on, "end": self._end}
        return [
            WebSocketRoute("/live", self.tabs.serve),
            Route("/api/choices", self._choices),
            Route("/api/stop", self._stop, methods=["POST"]),
            *self.camera.routes(),
            *(Route(f"/api/run/{name}", self.tabs.steered(act), methods=["POST"]) for name, act in steered.items()),
        ]

    async def close(self) -> None:
        """End an active run, wait for its end, and close the camera."""
        if self.run is not None:
            await self.run.closed()
        await self.camera.close()

    def as_json(self) -> dict[str, Any]:
        """Return phase and progress of the run, and whether the live camera is open, as a JSON object."""
        return {"run": self.run.progress.as_json() if self.run else None, **self.camera.as_json()}

    async def _choices(self, request: Request) -> Response:
        return JSONResponse(await self._worker.do(choices.choices, self._folder))

    async def _dry(self, asked: dict[str, Any]) -> Any:
        return {"lines": await self._worker.do(choices.dry, *self._chosen(asked))}

    async def _start(self, asked: dict[str, Any]) -> Any:
        if self._going_on():
            raise InputError("a run is under way; wait for its end, or end it")
        protocol, specimen, rig = self._chosen(asked)
        name, resume = str(asked.get("dataset", "")), asked.get("resume") is True
        dataset = self._folder.inside(name)
        if not name or dataset.suffix.lower() != ".h5" or not dataset.parent.is_dir():
            raise InputError(f"{name!r}: the name of the dataset should end in .h5, and its folder should exist")
        if dataset.exists() and not resume:
            raise InputError(f"{name}: exists already; give another name, or continue the run in this dataset")
        order = Order(
            protocol=protocol,
            specimen=specimen,
            rig=rig,
            dataset=dataset,
            resume=resume,
            take_over=asked.get("take_over") is True,
            note="" if resume else str(asked.get("note", "")).strip(),
        )
        self._number += 1
        self.run = BenchRun(order, self._number, self._folder.name_of(dataset), self.tabs.changed, self.tabs.show)
        await self.camera.close()
        await self.run.begin()
        self.tabs.changed()
        return {}

    async def _pause(self, asked: dict[str, Any]) -> Any:
        self._under_way().pause()
        return {}

    async def _go_on(self, asked: dict[str, Any]) -> Any:
        self._under_way().go_on()
        return {}

    async def _end(self, asked: dict[str, Any]) -> Any:
        self._under_way().end()
        return {}

    async def _stop(self, request: Request) -> Response:
        if self.run is None:
            return JSONResponse(
                {"words": "no run was started from this page, so that the page has switched nothing on", "off": True}
            )
        words = await self.run.stop()
        return JSONResponse({"words": words, "off": self.run.progress.coil == "off"})

    def _going_on(self) -> bool:
        return self.run is not None and self.run.going_on

    def _under_way(self) -> BenchRun:
        if self.run is None or not self.run.going_on:
            raise InputError("no run is under way")
        return self.run

    def _chosen(self, asked: dict[str, Any]) -> tuple[str, str, str]:
        kinds = ("protocol", "specimen", "rig")
        protocol, specimen, rig = (choices.chosen(self._folder, kind, asked.get(kind)) for kind in kinds)
        return protocol, specimen, rig
