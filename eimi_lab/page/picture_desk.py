"""The web addresses of the page for images that were taken without the instruments of this program."""

from __future__ import annotations

from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from eimi_lab.page import by_hand, choices
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.page.tabs import Tabs, body_of, table_of
from eimi_lab.page.worker import Worker


class PictureDesk:
    """The part of the web server for images. It lets only one browser tab write files."""

    def __init__(self, folder: DataFolder, worker: Worker, tabs: Tabs) -> None:
        self._folder, self._worker, self._steered = folder, worker, tabs.steered

    def routes(self) -> list[BaseRoute]:
        """Return the web addresses for the images, with the functions that answer."""
        return [
            Route("/api/pictures/folders", self._folders),
            Route("/api/pictures", self._opened),
            Route("/api/pictures/picture", self._picture),
            Route("/api/pictures/edges", self._edges, methods=["POST"]),
            Route("/api/pictures/save", self._steered(self._save), methods=["POST"]),
            Route("/api/pictures/dataset", self._steered(self._dataset), methods=["POST"]),
        ]

    async def _folders(self, request: Request) -> Response:
        return JSONResponse(await self._worker.do(by_hand.folders, self._folder))

    async def _opened(self, request: Request) -> Response:
        return JSONResponse(
            await self._worker.do(by_hand.opened, self._folder.inside(request.query_params.get("folder")))
        )

    async def _picture(self, request: Request) -> Response:
        path = self._folder.picture_in(request.query_params.get("folder"), request.query_params.get("picture"))
        return Response(await self._worker.do(by_hand.picture, path), media_type="image/jpeg")

    async def _edges(self, request: Request) -> Response:
        asked = await body_of(request)
        path = self._folder.picture_in(asked.get("folder"), asked.get("picture"))
        specimen = choices.chosen(self._folder, "specimen", asked.get("specimen"))
        return JSONResponse(await self._worker.do(by_hand.edges, path, table_of(asked, "calibration"), specimen))

    async def _save(self, asked: dict[str, Any]) -> Any:
        path, replace = self._folder.inside(asked.get("folder")), asked.get("replace") is True
        tables = table_of(asked, "calibration"), table_of(asked, "currents")
        return await self._worker.do(by_hand.saved, path, *tables, replace)

    async def _dataset(self, asked: dict[str, Any]) -> Any:
        path = self._folder.inside(asked.get("folder"))
        specimen = choices.chosen(self._folder, "specimen", asked.get("specimen"))
        target = path / f"{path.name}.h5"
        states = await self._worker.do(by_hand.dataset_of, path, specimen, target, asked.get("replace") is True)
        return {"dataset": self._folder.name_of(target), "states": states}
