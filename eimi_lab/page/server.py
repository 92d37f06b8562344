"""The page's routes, and the socket that they listen on."""

from __future__ import annotations

import ipaddress
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from types import FrameType

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from eimi_lab.page import stored_runs
from eimi_lab.page.admission import REPORT_POLICY, Admission, new_token
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.page.fit_desk import FitDesk
from eimi_lab.page.picture_desk import PictureDesk
from eimi_lab.page.report_links import REPORT, ReportLinks
from eimi_lab.page.run_desk import RunDesk
from eimi_lab.page.tabs import Tabs
from eimi_lab.page.worker import Worker
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import TERMINATION, Stopped
from eimi_lab.process.threads import one_thread_each

STATIC = Path(str(files("eimi_lab.page"))) / "static"
LARGEST_MESSAGE_BYTES = 1 << 16
CLOSE_WITHIN_S = 10


class Page:
    """What the routes share: the folder, and the process that does the work."""

    def __init__(self, folder: Path) -> None:
        """Raises InputError for what is no folder."""
        if not folder.is_dir():
            raise InputError(f"{folder}: is no folder; give the one in which datasets and pictures are")
        self.folder = DataFolder(folder.resolve())
        self.worker = Worker()
        self.tabs = Tabs(lambda: {**self.desk.told(), **self.fits.told()})
        self.desk = RunDesk(self.folder, self.worker, self.tabs)
        self.reports = ReportLinks()
        self.fits = FitDesk(self.folder, self.worker, self.tabs, self.reports)
        self.pictures = PictureDesk(self.folder, self.worker, self.tabs)

    def application(self) -> Starlette:
        """The routes, without whoever guards them."""
        routes = [
            Route("/", _index),
            Route("/api/folder", self._listing),
            Route("/api/dataset", self._dataset),
            Route("/api/dataset/picture", self._picture),
            Route("/api/dataset/edges", self._edges),
            Route("/api/dataset/modulus", self._modulus),
            Route("/api/figures", self._figures),
            Route(REPORT, self._report),
            *self.desk.routes(),
            *self.pictures.routes(),
            *self.fits.routes(),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        told = {InputError: _told, OSError: _told}
        return Starlette(routes=routes, exception_handlers=told, lifespan=self._lifespan)

    @asynccontextmanager
    async def _lifespan(self, application: Starlette) -> AsyncIterator[None]:
        yield
        await self.desk.close()
        await self.fits.close()
        self.worker.close()

    async def _listing(self, request: Request) -> Response:
        name = request.query_params.get("in", "")
        entries = [asdict(entry) for entry in self.folder.listed(name)]
        for entry in entries:
            if entry["kind"] == "report":
                entry["link"] = self.reports.link_to(entry["name"])
        return JSONResponse({"folder": name, "root": str(self.folder.root), "entries": entries})

    async def _dataset(self, request: Request) -> Response:
        return JSONResponse(await self.worker.do(stored_runs.described, self._file(request)))

    async def _picture(self, request: Request) -> Response:
        picture = await self.worker.do(stored_runs.picture, self._file(request), _number(request, "state"))
        return Response(picture, media_type="image/jpeg")

    async def _edges(self, request: Request) -> Response:
        return JSONResponse(await self.worker.do(stored_runs.edges, self._file(request), _number(request, "state")))

    async def _modulus(self, request: Request) -> Response:
        return JSONResponse(await self.worker.do(stored_runs.modulus, self._file(request), _number(request, "states")))

    async def _figures(self, request: Request) -> Response:
        """How old the last pictures were when a tab had shown them, its answer included."""
        return JSONResponse({"frame_to_screen_s": list(self.tabs.ages_s)})

    async def _report(self, request: Request) -> Response:
        """Answer with a report if the request has the key of the link to it."""
        if not self.reports.opens(request.query_params.get("file", ""), request.query_params.get("key", "")):
            return PlainTextResponse(
                "open the report from the page; links end with the `eimi dashboard` that gave them", 403
            )
        file = self._file(request)
        if file.suffix.lower() != ".html" or not file.is_file():
            raise InputError(f"{self.folder.name_of(file)}: is no report")
        return FileResponse(file, media_type="text/html", headers={"Content-Security-Policy": REPORT_POLICY})

    def _file(self, request: Request) -> Path:
        return self.folder.inside(request.query_params.get("file", ""))


def _number(request: Request, key: str) -> int:
    text = request.query_params.get(key, "")
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise InputError(f"{key} = {text!r} should be a whole number, 0 or more")
    return int(text)


async def _index(request: Request) -> Response:
    return FileResponse(STATIC / "index.html", media_type="text/html")


async def _told(request: Request, error: Exception) -> Response:
    """What a person gave and cannot be used, in one line."""
    return JSONResponse({"error": " ".join(str(error).split())}, 400)


def guarded(page: Page, hosts: frozenset[str], token: str) -> Admission:
    """The page's application behind its admission."""
    return Admission(page.application(), hosts, token)


def serve(folder: Path, host: str, port: int, say: Callable[[str], None]) -> None:
    """Serve the page until a signal comes; `say` gets the address to open. Raises InputError."""
    one_thread_each()  # in the processes begun from here, which share the machine with a run
    page = Page(folder)
    listening = _listen(host, port)
    bound = listening.getsockname()[1]
    names = {"127.0.0.1", "localhost", "[::1]"} if _is_loopback(host) else {_in_address(host)}
    token = new_token()
    app = guarded(page, frozenset(f"{name}:{bound}" for name in names), token)
    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,  # it would hold the keys of reports
        proxy_headers=False,
        server_header=False,
        ws_max_size=LARGEST_MESSAGE_BYTES,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=CLOSE_WITHIN_S,
    )
    say(f"http://{_in_address(host)}:{bound}/#token={token}")
    server = _Server(config)
    try:
        server.run(sockets=[listening])
    finally:
        page.worker.close()
    if server.asked:
        raise Stopped(server.asked[0])


class _Server(uvicorn.Server):
    """Closes in good order at every signal that asks the program to stop, which uvicorn does not at a hang-up.

    asked: the signals that came. A second one waits for the end of what the first began, for `CLOSE_WITHIN_S` at most.
    """

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.asked: list[int] = []

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        def close(number: int, frame: FrameType | None) -> None:
            self.asked.append(number)
            self.should_exit = True

        heeded = [n for n in (signal.SIGINT, *TERMINATION) if signal.getsignal(n) is not signal.SIG_IGN]
        before = {number: signal.signal(number, close) for number in heeded}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def _listen(host: str, port: int) -> socket.socket:
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        listening = socket.socket(family, socket.SOCK_STREAM)
        if os.name == "posix" and sys.platform != "cygwin":
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen()  # now: the address is told before the server runs
    except OSError as error:
        raise InputError(f"--host {host} --port {port}: cannot be listened on ({error.strerror})") from error
    return listening


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_host(host: str, open_to_network: bool) -> None:
    """Raise InputError for an address that others can reach, unless that was asked for."""
    if not _is_loopback(host) and not open_to_network:
        raise InputError(
            f"--host {host}: others could reach this page, see the pictures and, with the token, drive the coil; "
            "nothing on the way is encrypted. Better is a tunnel (ssh -L); --open-to-network says that it is meant"
        )
    if host in ("0.0.0.0", "::"):
        raise InputError(f"--host {host}: give one address of this machine, under which the page will be opened")


def _in_address(host: str) -> str:
    return f"[{host}]" if ":" in host else host
