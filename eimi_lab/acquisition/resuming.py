"""Resume a run that ended early: check its instruments and files, and count its stored states (load steps)."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.acquisition.event_words import missing_in_words
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import differences, parse
from eimi_lab.dataset.layout import Header, identity_text
from eimi_lab.dataset.reading import Dataset, open_dataset
from eimi_lab.dataset.recovery import recover
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import refuse_existing
from eimi_lab.process.writer_lock import only_writer

BEGIN_ANEW = "leave out --resume to begin a run"
"""What a person at a terminal can do if the dataset of a run to resume does not exist."""


@dataclass(frozen=True)
class UnfinishedRun:
    """A run that ended early: the number of stored states (load steps), and the time (s) since the run began.

    `ring_downs` is the number of stored ring-downs (free vibrations); None if the dataset has no place for them.
    """

    states: int
    elapsed_s: float
    ring_downs: int | None = 0


def missing_ring_downs(protocol: Protocol, stored: int | None) -> int:
    """Return the number of ring-downs (free vibrations) in a protocol that a dataset does not contain yet.

    `stored` is the number of ring-downs in the dataset. If it is None, the dataset has no place for ring-downs, and the
    result is zero.
    """
    return 0 if stored is None or protocol.ring_down is None else protocol.ring_down.repeats - stored


def refuse_taken(path: Path, force: bool) -> None:
    """Raise InputError if a new run must not write a dataset to `path`, for example because the file exists.

    If `force` is true, an existing file is not refused.
    """
    if path.is_file() and not force:
        with only_writer(path):  # raises an error for a run that is still writing
            if unfinished := _describe_unfinished(path):
                raise InputError(
                    f"{path}: {unfinished}; --resume continues this run; give another name to begin a new run"
                )
    refuse_existing(path, force)


def _describe_unfinished(path: Path) -> str:
    """Return a text with the number of states (load steps) that an unfinished run stored; empty for any other file.

    If all states are stored, the text contains the number of ring-downs (free vibrations) that are missing.
    """
    with suppress(InputError), open_dataset(path) as dataset:
        text = dataset.text("protocol")
        if dataset.kind == "frames" and dataset.resumable and text is not None:
            protocol = parse(Protocol, text, str(path))
            stored, asked = len(dataset.states), len(protocol.currents_A)
            if stored < asked:
                return f"holds {stored} of the {asked} states of a run that ended early"
            if missing := missing_ring_downs(protocol, dataset.stored_ring_downs):
                return f"holds all {asked} states of a run that ended early; {missing_in_words(missing)}"
    return ""


def take_up(path: Path, header: Header, image: NDArray[Any]) -> UnfinishedRun:
    """Check that a run can be resumed, and repair its dataset in place if the run crashed.

    Parameters
    ----------
    path : Path
        Dataset of the run that ended early.
    header : Header
        Files and instruments of the present run.
    image : ndarray, shape (H, W) or (H, W, 3)
        A frame of the present run, H by W pixels, grey or in three colours.

    Returns
    -------
    UnfinishedRun
        The numbers of stored states (load steps) and ring-downs, and the time (s) since the run began.

    Raises
    ------
    InputError
        If there is no such dataset, or if its files, instruments or frames differ from those of the present run.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file to resume; {BEGIN_ANEW}")
    with open_dataset(path) as dataset:
        if dataset.kind != "frames" or not dataset.resumable:
            raise InputError(f"{path}: was not written by a run that can be resumed")
        difference = _difference(dataset, header) or _other_frames(dataset, image)
        if difference:
            raise InputError(f"{path}: cannot be resumed: {difference}")
        crashed = not dataset.finished
    if crashed:
        recover(path, path, force=True)  # it removes damaged states and ring-downs, which are then taken again
    with open_dataset(path) as dataset:
        return UnfinishedRun(len(dataset.states), _elapsed_s(dataset), dataset.stored_ring_downs)


def _difference(dataset: Dataset, header: Header) -> str:
    for name, document in header.documents.items():
        for line in differences(dataset.text(name) or "", document.text if document else ""):
            return f"the {name} differs: {line}"
    instruments = tuple(identity_text(identity) for identity in header.instruments)
    if dataset.instruments() != instruments:
        return (
            f"the run began with other instruments: {', '.join(dataset.instruments())} then, {', '.join(instruments)} "
            "now; connect the instruments of the beginning again"
        )
    return ""


def _other_frames(dataset: Dataset, image: NDArray[Any]) -> str:
    size, dtype = dataset.frame_format()
    if (size, dtype) != (image.shape, image.dtype):
        return (
            f"the frames of the camera have another size or type: {size} {dtype} at the beginning of the run, "
            f"{image.shape} {np.dtype(image.dtype)} now; give the camera the same settings again"
        )
    return ""


def _elapsed_s(dataset: Dataset) -> float:
    """Return the time (s) since the beginning of a run."""
    # The clock of the computer may have been set back since the last frame.
    host_s = (datetime.now(UTC) - dataset.start_time()).total_seconds()
    return max(host_s, dataset.last_time_s())
