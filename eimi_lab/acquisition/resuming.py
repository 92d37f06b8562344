"""Going on with a run that ended early: what it had stored, and whether everything is as it was."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import differences, parse
from eimi_lab.dataset.layout import Header, identity_text
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.dataset.recovery import recover
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import refuse_existing
from eimi_lab.process.writer_lock import only_writer


@dataclass(frozen=True)
class UnfinishedRun:
    """A run that ended early: the states that it acknowledged, and the seconds that its clock shows by now."""

    states: int
    elapsed_s: float


def refuse_taken(path: Path, force: bool) -> None:
    """Raise InputError where `path` cannot become the file of a new run; one that ended early wants to be resumed."""
    if path.is_file() and not force:
        with only_writer(path):  # a run that goes on is none that ended early
            if left := _left_of_a_run(path):
                raise InputError(f"{path}: {left}: --resume goes on with it; give another name to begin anew")
    refuse_existing(path, force)


def _left_of_a_run(path: Path) -> str:
    """What a file holds of a run that ended early, in words; empty for whatever else it is."""
    with suppress(InputError), open_dataset(path) as dataset:
        text = dataset.text("protocol")
        if dataset.kind == "frames" and dataset.resumable and text is not None:
            stored, asked = len(dataset.states), len(parse(Protocol, text, str(path)).currents_A)
            return f"holds {stored} of the {asked} states of a run that ended early" if stored < asked else ""
    return ""


def take_up(path: Path, header: Header, image: NDArray[Any]) -> UnfinishedRun:
    """See that a run may be resumed with frames like (H, W) `image`; recover its file in place where it crashed.

    Raises InputError naming the first difference between that run and this one.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file to resume; leave out --resume to begin a run")
    with open_dataset(path) as dataset:
        if dataset.kind != "frames" or not dataset.resumable:
            raise InputError(f"{path}: was not written by a run that can be resumed")
        difference = _difference(dataset, header) or _other_frames(dataset, image)
        if difference:
            raise InputError(f"{path}: cannot be resumed: {difference}")
        begun = UnfinishedRun(len(dataset.states), _elapsed_s(dataset))
        crashed = not dataset.finished
    if crashed:
        recover(path, path, force=True)
    return begun


def _difference(dataset: Dataset, header: Header) -> str:
    for name, document in header.documents.items():
        for line in differences(dataset.text(name) or "", document.text if document else ""):
            return f"the {name} differs: {line}"
    instruments = tuple(identity_text(identity) for identity in header.instruments)
    if dataset.instruments() != instruments:
        return f"the instruments differ: {', '.join(dataset.instruments())} before, {', '.join(instruments)} now"
    return ""


def _other_frames(dataset: Dataset, image: NDArray[Any]) -> str:
    size, dtype = dataset.frame_format()
    if (size, dtype) != (image.shape, image.dtype):
        return f"the frames differ: {size} {dtype} before, {image.shape} {np.dtype(image.dtype)} now"
    return ""


def _elapsed_s(dataset: Dataset) -> float:
    """Since the run began; a simulated clock may have run ahead of the host's."""
    host_s = (datetime.now(UTC) - dataset.start_time()).total_seconds()
    return max(host_s, dataset.last_time_s())
