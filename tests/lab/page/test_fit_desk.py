"""Fits that are asked for: which are refused, and what is read of the log of one under way."""

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
    """A socket whose tab steers, and the tab's name."""
    with served.socket() as tab:
        told = json.loads(tab.recv(timeout=PATIENCE_S))
        if told["control"] != "you":
            tab.send(json.dumps({"take": True}))
            while told["control"] != "you":
                told = json.loads(tab.recv(timeout=PATIENCE_S))
        yield tab, told["tab"]


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"dataset": "run.h5", "model": "hooke"}, "should be one of neo-hookean"),
        ({"dataset": "none.h5", "model": "yeoh"}, "no such file"),
        ({"dataset": "../none.h5", "model": "yeoh"}, "leads out of the folder"),
    ],
)
def test_a_fit_of_nothing_is_refused(served: Any, asked: dict[str, str], words: str) -> None:
    with in_control(served) as (_, name):
        answer = served.ask(
            "/api/fit/start", "POST", json.dumps(asked).encode(), Origin=f"http://{served.host}", X_Tab=name
        )
    assert answer.status == 400
    assert words in json.loads(answer.body)["error"]


def test_what_a_fit_cannot_explain_is_told_in_the_tab(served: Any) -> None:
    """The drawn beam has no magnet and no load that moves it. A fit writes edges: into a copy, as others look at it."""
    own = served.folder / "unfit"
    own.mkdir()
    shutil.copy(served.folder / "run.h5", own)
    with in_control(served) as (tab, name):
        asked = json.dumps({"dataset": "unfit/run.h5", "model": "neo-hookean"}).encode()
        assert served.ask("/api/fit/start", "POST", asked, Origin=f"http://{served.host}", X_Tab=name).status == 200
        told: dict[str, Any] = {"phase": ""}
        until = time.monotonic() + PATIENCE_S
        while told["phase"] != "failed" and time.monotonic() < until:
            told = json.loads(tab.recv(timeout=PATIENCE_S)).get("fit") or told
    assert told["phase"] == "failed"
    assert "run.h5" in told["last_words"]
    assert not (own / "run.fits.json").exists()


def test_a_fit_of_before_is_replaced_where_that_is_asked_for_alone(served: Any) -> None:
    fits = served.folder / "run.fits.json"
    fits.write_text("of before")
    try:
        with in_control(served) as (_, name):
            asked = json.dumps({"dataset": "run.h5", "model": "neo-hookean"}).encode()
            answer = served.ask("/api/fit/start", "POST", asked, Origin=f"http://{served.host}", X_Tab=name)
        assert answer.status == 400
        assert "run.fits.json: exists already" in json.loads(answer.body)["error"]
        assert fits.read_text() == "of before"
    finally:
        fits.unlink()


def test_one_run_at_a_time(served: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that goes on, in place of which another one is asked for."""

    class GoingOn:
        going_on = True
        progress = SimpleNamespace(told=dict)

        async def closed(self) -> None: ...

    monkeypatch.setattr(served.page.desk, "run", GoingOn())
    asked = {"protocol": "protocol.toml", "specimen": "specimen.toml", "rig": "virtual", "dataset": "new.h5"}
    with in_control(served) as (_, name):
        answer = served.ask(
            "/api/run/start", "POST", json.dumps(asked).encode(), Origin=f"http://{served.host}", X_Tab=name
        )
    assert answer.status == 400
    assert "a run is under way" in json.loads(answer.body)["error"]
    assert not (served.folder / "new.h5").exists()
