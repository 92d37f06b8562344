"""Put the name of a camera before the message of an error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from eimi_drivers.interfaces import InstrumentError


@contextmanager
def labelled(label: str) -> Iterator[None]:
    """Put `label` and a colon before the message of an InstrumentError that is raised in the `with` block."""
    try:
        yield
    except InstrumentError as error:
        if str(error).startswith(label):
            raise
        raise type(error)(f"{label}: {error}") from error
