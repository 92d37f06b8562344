"""The web addresses of the page "Weights and a phone": receive photographs, show edges, and write a dataset."""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from eimi_lab.page import by_weights
from eimi_lab.page.admission import RECEIVED_PICTURE
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.page.tabs import Tabs, body_of, table_of
from eimi_lab.page.worker import Worker
from eimi_lab.process.errors import InputError
from eimi_lab.process.replacing import remove
from eimi_lab.vision.image_files import ENDINGS

LONGEST_NAME = 120


class PhoneDesk:
    """The part of the web server for photographs that a phone took. It lets only one browser tab write files."""

    def __init__(self, folder: DataFolder, worker: Worker, tabs: Tabs) -> None:
        self._folder, self._worker, self._tabs = folder, worker, tabs

    def routes(self) -> list[BaseRoute]:
        """Return the web addresses for the photographs, with the functions that answer."""
        return [
            Route("/api/phone", self._opened),
            Route("/api/phone/picture", self._picture),
            Route(RECEIVED_PICTURE, self._receive, methods=["POST"]),
            Route("/api/phone/edges", self._edges, methods=["POST"]),
            Route("/api/phone/save", self._tabs.steered(self._save), methods=["POST"]),
        ]

    async def _opened(self, request: Request) -> Response:
        return JSONResponse(
            await self._worker.do(by_weights.opened, self._folder.inside(request.query_params.get("folder")))
        )

    async def _picture(self, request: Request) -> Response:
        path = self._folder.picture_in(request.query_params.get("folder"), request.query_params.get("picture"))
        return Response(await self._worker.do(by_weights.picture, path), media_type="image/jpeg")

    async def _receive(self, request: Request) -> Response:
        """Store the photograph in the body of a request. A different file with the same name is never replaced."""
        self._tabs.check_control(request)
        folder = self._folder.inside(request.query_params.get("folder"))
        name = request.query_params.get("name", "")
        if not folder.is_dir():
            raise InputError(f"{self._folder.name_of(folder)}: is not a folder")
        if Path(name).suffix.lower() not in ENDINGS:
            endings = ", ".join(sorted(ENDINGS))
            raise InputError(f"{name}: is not a picture that can be read ({endings}); save the picture as JPEG")
        if name.startswith(".") or "/" in name or len(name) > LONGEST_NAME:
            raise InputError(
                f"{name[:LONGEST_NAME]}: should be a file name of at most {LONGEST_NAME} characters, without / and "
                "without a dot at its beginning"
            )
        target = self._folder.inside(f"{self._folder.name_of(folder)}/{name}")
        received = folder / f".{secrets.token_hex(8)}{target.suffix}"
        try:
            with received.open("xb") as file:
                async for part in request.stream():
                    file.write(part)
            return JSONResponse(await self._worker.do(by_weights.accepted, received, target))
        finally:
            remove(received)

    async def _edges(self, request: Request) -> Response:
        body = await body_of(request)
        path = self._folder.picture_in(body.get("folder"), body.get("picture"))
        tables = table_of(body, "clicks"), table_of(body, "beam")
        return JSONResponse(await self._worker.do(by_weights.edges, path, *tables))

    async def _save(self, asked: dict[str, Any]) -> Any:
        folder, replace = self._folder.inside(asked.get("folder")), asked.get("replace") is True
        tables = table_of(asked, "clicks"), table_of(asked, "beam"), table_of(asked, "grams")
        saved = await self._worker.do(by_weights.saved, folder, *tables, replace)
        return {**saved, "dataset": self._folder.name_of(folder / saved["dataset"]), "free": list(by_weights.FREED)}
