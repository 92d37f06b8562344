"""The web addresses with which the page fits a dataset: the server runs `eimi fit`, and then `eimi report`."""

from __future__ import annotations

import asyncio
import json
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.laws import LAWS
from eimi_lab.page import stored_fits
from eimi_lab.page.data_folder import DataFolder
from eimi_lab.page.report_links import ReportLinks
from eimi_lab.page.tabs import Tabs
from eimi_lab.page.worker import Worker
from eimi_lab.process.detached import detached
from eimi_lab.process.errors import InputError
from eimi_lab.process.replacing import remove

LOOK_EVERY_S = 0.4
MOST_GENERATIONS = 400
LONGEST_LINE_BYTES = 1 << 24
FITS, LOG, REPORT = ".fits.json", ".fits.log", ".report.html"


@dataclass
class Fitting:
    """A fit that the live web page started, running or ended.

    Parameters
    ----------
    number : int
        Number of the fit on this page.
    dataset : str
        Name of the dataset in the data folder.
    model : str
        Name of the hyperelastic law.
    free : tuple of str
        Uncertain quantities, such as the clamp, that are fitted in addition to the law.
    phase : str
        "fitting", "reporting", "done" or "failed".
    generations : list of (int, float, float)
        For every generation (round of trial values) of the search: its number, and the smallest and the mean distance
        (mm) between simulated and measured edges.
    last_words : str
        The last line that the command wrote to standard error.
    """

    number: int
    dataset: str
    model: str
    free: tuple[str, ...] = ()
    phase: str = "fitting"
    generations: list[tuple[int, float, float]] = field(default_factory=list)
    last_words: str = ""


class FitDesk:
    """The fits that the live web page starts, one at a time."""

    def __init__(self, folder: DataFolder, worker: Worker, tabs: Tabs, reports: ReportLinks) -> None:
        self._reports = reports
        self._folder, self._worker, self._steered, self._changed = folder, worker, tabs.steered, tabs.changed
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None
        self._number = 0
        self.fitting: Fitting | None = None

    def routes(self) -> list[BaseRoute]:
        """Return the web addresses that start, end and show fits, with the functions that answer."""
        return [
            Route("/api/fit", self._stored),
            Route("/api/fit/start", self._steered(self._start), methods=["POST"]),
            Route("/api/fit/end", self._steered(self._end), methods=["POST"]),
        ]

    def as_json(self) -> dict[str, Any]:
        """Return phase and progress of the fit as a JSON object under the key "fit"; None before a fit."""
        return {"fit": asdict(self.fitting) if self.fitting else None}

    async def close(self) -> None:
        """End the fit if one is running, and wait for its end."""
        self._kill()
        if self._task is not None:
            await self._task

    async def _stored(self, request: Request) -> Response:
        dataset = self._folder.inside(request.query_params.get("file", ""))
        fits, report = dataset.with_suffix(FITS), dataset.with_suffix(REPORT)
        summaries = await self._worker.do(stored_fits.summaries, fits) if fits.is_file() else []
        link = self._reports.link_to(self._folder.name_of(report)) if report.is_file() else None
        return JSONResponse({"fits": summaries, "report": link})

    async def _start(self, asked: dict[str, Any]) -> Any:
        if self._task is not None and not self._task.done():
            raise InputError("a fit is running; wait for its end, or end it")
        name, model = str(asked.get("dataset", "")), str(asked.get("model", ""))
        dataset = self._folder.inside(name)
        if not dataset.is_file():
            raise InputError(f"{name}: no such file in the folder of this page")
        if model not in LAWS:
            raise InputError(f"model = {model!r} should be one of {', '.join(LAWS)}")
        free = asked.get("free", [])
        if not isinstance(free, list) or not all(name in SOURCES for name in free):
            raise InputError(
                f"free = {free!r} should be a list of uncertain quantities; known are {', '.join(SOURCES)}"
            )
        fits = dataset.with_suffix(FITS)
        if fits.exists() and asked.get("replace") is not True:
            raise InputError(
                f"{self._folder.name_of(fits)}: exists already; to replace it, open the dataset again on this page and "
                'press "Fit again and replace this fit"'
            )
        self._number += 1
        self.fitting = Fitting(self._number, self._folder.name_of(dataset), model, tuple(free))
        self._task = asyncio.create_task(self._fit(dataset, self.fitting))
        return {}

    async def _end(self, asked: dict[str, Any]) -> Any:
        self._kill()
        return {}

    def _kill(self) -> None:
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.terminate()

    async def _fit(self, dataset: Path, fitting: Fitting) -> None:
        """Run the fit and write the report, and send "done" or "failed" to all open tabs."""
        log = dataset.with_suffix(LOG)
        done = False
        try:
            remove(log)
            done = await self._fit_and_report(dataset, log, fitting)
            remove(log)
        except OSError as error:
            fitting.last_words = " ".join(str(error).split())
        finally:
            fitting.phase = "done" if done else "failed"
            self._changed()

    async def _fit_and_report(self, dataset: Path, log: Path, fitting: Fitting) -> bool:
        fits, report = dataset.with_suffix(FITS), dataset.with_suffix(REPORT)
        freed = [f"--free={name}" for name in fitting.free]
        fit = (f"--model={fitting.model}", *freed, f"--output={fits}", f"--checkpoint={log}", "--force")
        following = asyncio.create_task(self._follow(log, fitting))
        try:
            if not await self._eimi(fitting, "fit", *fit, "--", str(dataset)):
                return False
        finally:
            following.cancel()
        remove(report)  # it shows the replaced fit
        fitting.phase = "reporting"
        self._changed()
        return await self._eimi(fitting, "report", f"--fit={fits}", f"--output={report}", "--force", "--", str(dataset))

    async def _eimi(self, fitting: Fitting, *arguments: str) -> bool:
        """Run a command of `eimi`, and return whether it succeeded."""
        self._process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-P", "-m", "eimi_lab", *arguments),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            **detached(),
            limit=LONGEST_LINE_BYTES,
        )
        assert self._process.stderr is not None
        async for line in self._process.stderr:
            fitting.last_words = line.decode("utf-8", "replace").strip().removeprefix("eimi: ")
            self._changed()
        return await self._process.wait() == 0

    async def _follow(self, log: Path, fitting: Fitting) -> None:
        """Read the progress of the search from the log of the fit while the log grows."""
        read = 0
        while True:
            await asyncio.sleep(LOOK_EVERY_S)
            if not log.is_file():
                continue
            with log.open("rb") as file:
                file.seek(read)
                *whole, rest = file.read().split(b"\n")
            new = [generation for line in whole if (generation := _generation(line)) is not None]
            read += sum(len(line) + 1 for line in whole)
            if (generation := _generation(rest)) is not None:  # the newest line has no line end yet
                new, read = [*new, generation], read + len(rest)
            if new:
                fitting.generations = [*fitting.generations, *new][-MOST_GENERATIONS:]
                self._changed()


def _generation(line: bytes) -> tuple[int, float, float] | None:
    try:
        entry = json.loads(line)
        return entry["generation"], entry["search"]["best_mm"], entry["search"]["mean_mm"]
    except (ValueError, KeyError, TypeError, RecursionError):  # a line of another kind, or an incomplete line
        return None
