"""The server of the dashboard refuses wrong requests to fit a dataset, and a tab shows why a fit has failed."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from tests.patience import PATIENCE_S


@contextmanager
def in_control(served: Any) -> Iterator[tuple[Any, str]]:
    # Yield a WebSocket of the tab in control, which alone may start and stop runs, and the name of the tab.
    with served.socket() as tab:
        state = json.loads(tab.recv(timeout=PATIENCE_S))
        if state["control"] != "you":
            tab.send(json.dumps({"take": True}))
            while state["control"] != "you":
                state = json.loads(tab.recv(timeout=PATIENCE_S))
        yield tab, state["tab"]


@pytest.mark.parametrize(
    ("requested", "words"),
    [
        ({"dataset": "run.h5", "model": "hooke"}, "should be one of neo-hookean"),
        ({"dataset": "none.h5", "model": "yeoh"}, "no such file"),
        ({"dataset": "../none.h5", "model": "yeoh"}, "leads out of the folder"),
    ],
)
def test_a_fit_of_a_missing_file_or_law_is_refused(served: Any, requested: dict[str, str], words: str) -> None:
    with in_control(served) as (_, name):
        answer = served.ask(
            "/api/fit/start", "POST", json.dumps(requested).encode(), Origin=f"http://{served.host}", X_Tab=name
        )
    assert answer.status == 400
    assert words in json.loads(answer.body)["error"]


def test_the_tab_shows_why_a_fit_failed(served: Any) -> None:
    # A fit stores edges in its dataset; so the test uses a copy of the dataset.
    folder = served.folder / "unfit"
    folder.mkdir()
    shutil.copy(served.folder / "run.h5", folder)
    with in_control(served) as (tab, name):
        requested = json.dumps({"dataset": "unfit/run.h5", "model": "neo-hookean"}).encode()
        assert served.ask("/api/fit/start", "POST", requested, Origin=f"http://{served.host}", X_Tab=name).status == 200
        state: dict[str, Any] = {"phase": ""}
        until = time.monotonic() + PATIENCE_S
        while state["phase"] != "failed" and time.monotonic() < until:
            state = json.loads(tab.recv(timeout=PATIENCE_S)).get("fit") or state
    assert state["phase"] == "failed"
    assert "run.h5" in state["last_words"]
    assert not (folder / "run.fits.json").exists()


def test_an_earlier_fit_is_replaced_only_on_request(served: Any) -> None:
    fits = served.folder / "run.fits.json"
    fits.write_text("of before")
    try:
        with in_control(served) as (_, name):
            requested = json.dumps({"dataset": "run.h5", "model": "neo-hookean"}).encode()
            answer = served.ask("/api/fit/start", "POST", requested, Origin=f"http://{served.host}", X_Tab=name)
        assert answer.status == 400
        assert "run.fits.json: exists already" in json.loads(answer.body)["error"]
        assert fits.read_text() == "of before"
    finally:
        fits.unlink()


def test_one_run_at_a_time(served: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    class GoingOn:
        going_on = True
        progress = SimpleNamespace(as_json=dict)

        async def closed(self) -> None: ...

    monkeypatch.setattr(served.page.desk, "run", GoingOn())
    requested = {"protocol": "protocol.toml", "specimen": "specimen.toml", "rig": "virtual", "dataset": "new.h5"}
    with in_control(served) as (_, name):
        answer = served.ask(
            "/api/run/start", "POST", json.dumps(requested).encode(), Origin=f"http://{served.host}", X_Tab=name
        )
    assert answer.status == 400
    assert "a run is under way" in json.loads(answer.body)["error"]
    assert not (served.folder / "new.h5").exists()
