"""Small functions return the right value, also for empty or unusual arguments."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_drivers.interfaces import Identity, InstrumentError
from eimi_lab.acquisition import added_driver, guardian_process, interlocks, playback, resuming
from eimi_lab.acquisition.guardian import Guardian, Ward
from eimi_lab.config import coil_shape, toml
from eimi_lab.config.interlock import Interlock
from eimi_lab.process import limits, replacing, scope, writer_lock

WARD = Ward("korad", "COM3", 1.0, 10.0)
IMAGE = np.zeros((2, 3), np.uint8)
BOUNDS = Interlock(reading="hall", minimum=1.0, maximum=2.0, longest_silence_s=5.0)


def silent() -> Any:
    raise InstrumentError("no answer")


def run_of(text: str) -> Any:
    # Return the dataset of a run whose specimen is `text`.
    return SimpleNamespace(
        text=lambda name: text, instruments=lambda: ("A",), frame_format=lambda: (IMAGE.shape, IMAGE.dtype)
    )


def header(text: str) -> Any:
    return SimpleNamespace(documents={"specimen": SimpleNamespace(text=text)}, instruments=("A",))


def guardian_that_is_gone() -> Any:
    # Return a connection to a guardian process that has ended.
    made: Any = Guardian.__new__(Guardian)
    made._to = SimpleNamespace(fileno=lambda: -1)
    return made


def supply(text: str, on: Callable[[], bool] = lambda: False) -> Any:
    return SimpleNamespace(identify=lambda: Identity("s", text, "COM3", "7"), output_on=on)


KNOWN = Ward("korad", "COM3", 1.0, 10.0, identity=("KORAD", "7"))
ANSWERS: dict[str, tuple[Callable[[], Any], Any]] = {
    "a driver of this package is not packed": (lambda: added_driver.pack("korad"), ""),
    "a supply without a stored identity": (lambda: guardian_process._compare(WARD, supply("x")), ""),
    "the supply of the run": (lambda: guardian_process._compare(KNOWN, supply("KORAD")), ""),
    "an output that was off": (lambda: guardian_process._find_off(supply("x"), set()), True),
    "an output that is on": (lambda: guardian_process._find_off(supply("x", lambda: True), set()), False),
    "an output that was on before": (lambda: guardian_process._find_off(supply("x"), {True}), False),
    "a supply that does not answer": (lambda: guardian_process._find_off(supply("x", silent), set()), False),
    "a reading below its bounds": (lambda: interlocks._is_within(BOUNDS, 0.99), False),
    "a reading at its lower bound": (lambda: interlocks._is_within(BOUNDS, 1.0), True),
    "a reading at its upper bound": (lambda: interlocks._is_within(BOUNDS, 2.0), True),
    "a reading above its bounds": (lambda: interlocks._is_within(BOUNDS, 2.01), False),
    "a reading that is no number": (lambda: interlocks._is_within(BOUNDS, float("nan")), False),
    "a run with the same specimen": (lambda: resuming._difference(run_of("x = 1"), header("x = 1")), ""),
    "a run with the same frames": (lambda: resuming._other_frames(run_of(""), IMAGE), ""),
    "no file of a run": (lambda: resuming._describe_unfinished(Path("nothing.h5")), ""),
    "a rig without a recording": (
        lambda: playback.describe_recording_length(
            None,  # type: ignore[arg-type]
            SimpleNamespace(camera=SimpleNamespace(driver="opencv", source="x.mp4")),  # type: ignore[arg-type]
        ),
        "",
    ),
    "text without a decimal comma": (lambda: toml._decimal_comma("x = [1, 2]\ny = 1.5"), ""),
    "no file": (lambda: toml.is_dataset(Path("nothing.h5")), False),
    "a calibration without a field": (lambda: coil_shape.with_rows_of_map({}, Path("c.toml")), False),
    "a calibration without a map": (lambda: coil_shape.with_rows_of_map({"field": {}}, Path("c.toml")), False),
    "a file without a lock": (lambda: writer_lock.is_being_written(Path("nothing.h5")), False),
    "a message to a guardian that is gone": (lambda: guardian_that_is_gone()._send(b""), False),
    "memory of an unreadable file": (lambda: limits._linux(), 0),
    "a system without systemd": (lambda: scope.move_to_own_scope("name", "description"), False),
    "a user without a name": (lambda: scope._lasts_as_long_in_a_scope(), False),
    "an error of another system": (lambda: replacing._in_use(PermissionError(13, "x")), False),
}


@pytest.mark.parametrize("question", ANSWERS)
def test_a_question_has_a_plain_answer(question: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def unknown() -> str:
        raise KeyError("no name")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(limits, "Path", lambda name: tmp_path / "nothing")
    monkeypatch.setattr(scope.shutil, "which", lambda name: None)
    monkeypatch.setattr(scope.getpass, "getuser", unknown)
    monkeypatch.setattr(resuming, "identity_text", str)
    ask, answer = ANSWERS[question]
    found = ask()
    assert found == answer
    assert type(found) is type(answer)


def test_a_scope_is_asked_for_only_if_it_lasts(monkeypatch: pytest.MonkeyPatch) -> None:
    def late(*_: Any, **__: Any) -> Any:
        raise OSError("no such program")

    asked: list[Any] = []
    monkeypatch.setattr(scope.shutil, "which", lambda name: f"/bin/{name}")
    monkeypatch.setattr(scope, "_lasts_as_long_in_a_scope", lambda: False)
    monkeypatch.setattr(scope.subprocess, "run", late)
    assert scope.move_to_own_scope("name", "description") is False
    monkeypatch.setattr(scope, "_lasts_as_long_in_a_scope", lambda: True)
    assert scope.move_to_own_scope("name", "description") is False
    for status in (0, 1):
        monkeypatch.setattr(
            scope.subprocess,
            "run",
            lambda *given, status=status, **_: asked.append(given) or SimpleNamespace(returncode=status),
        )
        assert scope.move_to_own_scope("name", "a description") is (status == 0)
    ((command,), _) = asked
    assert command[:2] == ["/bin/busctl", "--user"]
    assert "a description" in command
