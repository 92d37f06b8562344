"""The web server of `eimi dashboard`: the addresses of the live web page, and the socket of the server."""

from __future__ import annotations

import ipaddress
import signal
import socket
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
from eimi_lab.page.phone_desk import PhoneDesk
from eimi_lab.page.picture_desk import PictureDesk
from eimi_lab.page.report_links import REPORT, ReportLinks
from eimi_lab.page.run_desk import RunDesk
from eimi_lab.page.tabs import Tabs
from eimi_lab.page.worker import Worker
from eimi_lab.process.errors import InputError
from eimi_lab.process.paths import followed, reachable
from eimi_lab.process.stopping import TERMINATION, Stopped
from eimi_lab.process.threads import one_thread_each

STATIC = Path(str(files("eimi_lab.page"))) / "static"
LARGEST_MESSAGE_BYTES = 1 << 16
CLOSE_WITHIN_S = 10
HTTP_PORT = 80
"""Port of addresses that state none."""


class Page:
    """The live web page of `eimi dashboard`: its addresses with the functions that answer."""

    def __init__(self, folder: Path) -> None:
        """Create the page for a data folder. Raises InputError if ``folder`` is not a folder."""
        if not folder.is_dir():
            raise InputError(f"{folder}: is not a folder; give the folder with datasets and pictures")
        self.folder = DataFolder(followed(reachable(folder)))
        self.worker = Worker()
        self.tabs = Tabs(lambda: {**self.desk.as_json(), **self.fits.as_json()})
        self.desk = RunDesk(self.folder, self.worker, self.tabs)
        self.reports = ReportLinks()
        self.fits = FitDesk(self.folder, self.worker, self.tabs, self.reports)
        self.pictures = PictureDesk(self.folder, self.worker, self.tabs)
        self.phone = PhoneDesk(self.folder, self.worker, self.tabs)

    def application(self) -> Starlette:
        """Return the application that answers the requests of a browser. It does not check the token."""
        routes = [
            Route("/", _index),
            Route("/api/folder", self._listing),
            Route("/api/dataset", self._dataset),
            Route("/api/dataset/picture", self._picture),
            Route("/api/dataset/edges", self._edges),
            Route("/api/dataset/modulus", self._modulus),
            Route("/api/figures", self._delays),
            Route(REPORT, self._report),
            *self.desk.routes(),
            *self.pictures.routes(),
            *self.phone.routes(),
            *self.fits.routes(),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        handlers = {InputError: _error_answer, OSError: _error_answer}
        return Starlette(routes=routes, exception_handlers=handlers, lifespan=self._lifespan)

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

    async def _delays(self, request: Request) -> Response:
        """Answer with the times (s) from the arrival of the last frames at the run to their display."""
        return JSONResponse({"frame_to_screen_s": list(self.tabs.ages_s)})

    async def _report(self, request: Request) -> Response:
        """Answer with a report if the request carries the key (the secret text) of this report."""
        if not self.reports.opens(request.query_params.get("file", ""), request.query_params.get("key", "")):
            return PlainTextResponse(
                "this link is not valid; a link is valid until `eimi dashboard` ends; open the report from the page",
                403,
            )
        file = self._file(request)
        if file.suffix.lower() != ".html" or not file.is_file():
            raise InputError(f"{self.folder.name_of(file)}: is not a report")
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


async def _error_answer(request: Request, error: Exception) -> Response:
    return JSONResponse({"error": " ".join(str(error).split())}, 400)


def guarded(page: Page, hosts: frozenset[str], token: str) -> Admission:
    """Return the web application, which answers only requests with the right Host and the right token.

    Parameters
    ----------
    page : Page
        The live web page.
    hosts : frozenset of str
        Allowed values of the header Host, with the port.
    token : str
        The secret text that every request must carry.
    """
    return Admission(page.application(), hosts, token)


def serve(folder: Path, host: str, port: int, say: Callable[[str], None], view: str = "") -> None:
    """Serve the live web page until a signal such as Ctrl-C comes.

    Parameters
    ----------
    folder : Path
        The data folder.
    host : str
        Address of this computer at which the page listens.
    port : int
        Port at which the page listens; 0 takes any free port.
    say : callable
        Receives the address to open in a browser.
    view : str
        The part of the page that the address opens, such as "phone". By default, the first part.

    Raises
    ------
    InputError
        If the folder does not exist, or if the program cannot listen at the address.
    Stopped
        After a signal has ended the page.
    """
    one_thread_each()  # the processes that are started here inherit this setting; they share the computer with a run
    page = Page(folder)
    listening = _listen(host, port)
    bound = listening.getsockname()[1]
    names = {"127.0.0.1", "localhost", "[::1]"} if _is_loopback(host) else {_in_address(host).lower()}
    token = new_token()
    hosts = {f"{name}:{bound}" for name in names}
    if bound == HTTP_PORT:
        hosts |= names  # a browser does not send this port
    app = guarded(page, frozenset(hosts), token)
    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,  # the access log would contain the keys of reports
        proxy_headers=False,
        server_header=False,
        ws_max_size=LARGEST_MESSAGE_BYTES,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=CLOSE_WITHIN_S,
    )
    say(f"http://{_in_address(host)}:{bound}/#token={token}{'#' if view else ''}{view}")
    server = _Server(config)
    try:
        server.run(sockets=[listening])
    finally:
        page.worker.close()
    if server.asked:
        raise Stopped(server.asked[0])


class _Server(uvicorn.Server):
    """A web server that shuts down in an orderly way after every signal that stops the program, also after SIGHUP.

    The attribute ``asked`` lists the received signals.
    """

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.asked: list[int] = []

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        def close(number: int, frame: FrameType | None) -> None:
            self.asked.append(number)
            self.should_exit = True

        handled = [n for n in (signal.SIGINT, *TERMINATION) if signal.getsignal(n) is not signal.SIG_IGN]
        before = {number: signal.signal(number, close) for number in handled}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def _listen(host: str, port: int) -> socket.socket:
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)  # before the server runs, to print the address
    except OSError as error:
        reason = str(error.strerror).partition(" (while")[0]  # Python adds the address, which the message gives
        raise InputError(
            f"--host {host} --port {port}: the program cannot listen there ({reason}); give another address or port"
        ) from error


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_host(host: str, open_to_network: bool) -> None:
    """Raise InputError if other computers can reach the address ``host``, unless ``open_to_network`` is true.

    An address that stands for all addresses of this computer is always refused.
    """
    if not _is_loopback(host) and not open_to_network:
        raise InputError(
            f"--host {host}: other computers could reach this page over a connection without encryption; a person "
            "with the token could then see the pictures and switch the coil; use a tunnel (ssh -L), or add "
            "--open-to-network"
        )
    if host in ("0.0.0.0", "::"):
        raise InputError(
            f"--host {host}: stands for all addresses of this computer; give the address that the browsers will use"
        )


def _in_address(host: str) -> str:
    return f"[{host}]" if ":" in host else host
