"""An unfinished run is not overwritten by default, and continues only with the same files, instruments and frames."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_lab.acquisition import resuming
from eimi_lab.acquisition.resuming import UnfinishedRun
from eimi_lab.config.protocol import Protocol, RingDown
from eimi_lab.process.errors import InputError
from tests.shared.noted import noted


class Stored:
    # A dataset of a run: its protocol has four states, of which some are stored.

    def __init__(self, **changes: Any) -> None:
        frames = {"kind": "frames", "resumable": True, "finished": True, "states": [1, 2, 3], "stored_ring_downs": 0}
        vars(self).update(frames | changes)

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: Any) -> None:
        pass

    def text(self, name: str) -> str | None:
        return {"protocol": "a protocol", "specimen": "x = 1\n"}.get(name)

    def instruments(self) -> tuple[str, ...]:
        return ("supply A", "camera B")

    def frame_format(self) -> Any:
        return (2, 3), np.dtype(np.uint8)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "holds 3 of the 4 states of a run that ended early"),
        (
            {"states": [1, 2, 3, 4]},
            "holds all 4 states of a run that ended early; 3 ring-downs are missing",
        ),
        (
            {"states": [1, 2, 3, 4], "stored_ring_downs": 2},
            "holds all 4 states of a run that ended early; 1 ring-down is missing",
        ),
        ({"states": [1, 2, 3, 4], "stored_ring_downs": 3}, ""),
        ({"states": [1, 2, 3, 4], "stored_ring_downs": None}, ""),
        ({"kind": "points"}, ""),
        ({"resumable": False}, ""),
        ({"text": lambda name: None}, ""),
    ],
)
def test_a_run_that_can_be_resumed_is_not_replaced(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    path = tmp_path / "run.h5"
    calls: list[Any] = []
    protocol = SimpleNamespace(currents_A=(0.1, 0.2, 0.3, 0.4), ring_down=RingDown(seconds=1.0, repeats=3))
    monkeypatch.setattr(resuming, "open_dataset", lambda given: Stored(**changes))
    monkeypatch.setattr(resuming, "parse", noted(calls, "parse", protocol))
    monkeypatch.setattr(resuming, "refuse_existing", noted(calls, "existing"))
    assert resuming._describe_unfinished(path) == words
    assert calls == [("parse", Protocol, "a protocol", str(path))] * (not changes or "states" in changes)
    calls.clear()
    resuming.refuse_taken(path, False)
    assert calls == [("existing", path, False)]
    path.touch()
    resuming.refuse_taken(path, True)
    assert calls == [("existing", path, False), ("existing", path, True)]
    if words:
        with pytest.raises(InputError, match=rf"run\.h5: {words}; --resume continues this run; give another name to"):
            resuming.refuse_taken(path, False)
        assert len([call for call in calls if call[0] == "existing"]) == 2
    else:
        resuming.refuse_taken(path, False)
        assert calls[-1] == ("existing", path, False)


def header_of(specimen: str = "x = 1", **more: Any) -> Any:
    documents = {"specimen": SimpleNamespace(text=specimen)} | more
    return SimpleNamespace(documents=documents, instruments=("A", "B"))


IMAGE = np.zeros((2, 3), np.uint8)


@pytest.mark.parametrize("finished", [True, False])
def test_a_run_is_taken_up_after_its_stored_states_and_repaired_after_a_crash(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, finished: bool
) -> None:
    path = tmp_path / "run.h5"
    calls: list[Any] = []
    monkeypatch.setattr(resuming, "open_dataset", lambda given: Stored(finished=finished))
    monkeypatch.setattr(resuming, "identity_text", lambda name: {"A": "supply A", "B": "camera B"}[name])
    monkeypatch.setattr(resuming, "_elapsed_s", lambda dataset: 12.5)
    left = 2  # ring-downs after the repair

    def recover(*given: Any, **options: Any) -> None:
        noted(calls, "recover")(*given, **options)
        monkeypatch.setattr(resuming, "open_dataset", lambda given: Stored(finished=True, stored_ring_downs=left))

    monkeypatch.setattr(resuming, "recover", recover)
    with pytest.raises(InputError, match=r"run\.h5: no such file to resume; leave out --resume to begin a run$"):
        resuming.take_up(path, header_of(), IMAGE)
    path.touch()
    assert resuming.take_up(path, header_of(), IMAGE) == UnfinishedRun(3, 12.5, 0 if finished else left)
    assert calls == [("recover", path, path, ("force", True))] * (not finished)


@pytest.mark.parametrize(
    ("header", "image", "words"),
    [
        (header_of("x = 2"), IMAGE, "the specimen differs: x was 1, and is 2 now"),
        (header_of("x = 1", rig=SimpleNamespace(text="y = 3")), IMAGE, "the rig differs: y was absent, and is 3 now"),
        (
            SimpleNamespace(documents={"specimen": None}, instruments=("A", "B")),
            IMAGE,
            "the specimen differs: x was 1, and is absent now",
        ),
        (
            SimpleNamespace(documents={}, instruments=("A",)),
            IMAGE,
            "the run began with other instruments: supply A, camera B then, supply A now; connect the",
        ),
        (
            header_of(),
            np.zeros((3, 2), np.uint8),
            r"the frames of the camera have another size or type: \(2, 3\) uint8 at .*, \(3, 2\) uint8 now; give the",
        ),
        (header_of(), np.zeros((2, 3), np.uint16), r"the frames .*: \(2, 3\) uint8 at the .* run, \(2, 3\) uint16 now"),
    ],
)
def test_a_run_is_resumed_with_the_same_files_instruments_and_frames(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, header: Any, image: Any, words: str
) -> None:
    path = tmp_path / "run.h5"
    path.touch()
    monkeypatch.setattr(resuming, "open_dataset", lambda given: Stored())
    monkeypatch.setattr(resuming, "identity_text", lambda name: {"A": "supply A", "B": "camera B"}[name])
    with pytest.raises(InputError, match=rf"run\.h5: cannot be resumed: {words}"):
        resuming.take_up(path, header, image)


@pytest.mark.parametrize(("last_s", "elapsed_s"), [(5.0, 30.0), (31.0, 31.0)])
def test_the_time_of_a_run_goes_on_after_its_last_frame(
    monkeypatch: pytest.MonkeyPatch, last_s: float, elapsed_s: float
) -> None:
    start = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    monkeypatch.setattr(resuming, "datetime", SimpleNamespace(now=lambda zone: start + timedelta(seconds=30)))
    dataset: Any = SimpleNamespace(start_time=lambda: start, last_time_s=lambda: last_s)
    assert resuming._elapsed_s(dataset) == elapsed_s
