"""Write a file to the disk while the calling thread does something else."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait

EVERY_S = 0.02


def synchronise(descriptor: int, meanwhile: Callable[[], None]) -> None:
    """Write the contents of a file to the disk (fsync(2)), and call a function repeatedly until this is done.

    Parameters
    ----------
    descriptor
        File descriptor of the file.
    meanwhile
        Function that is called again and again.

    Raises
    ------
    OSError
        If the disk refuses the data.
    """
    # A busy disk may need seconds, and Python handles signals only in the main thread, between two operations.
    with ThreadPoolExecutor(1) as pool:
        written = pool.submit(os.fsync, descriptor)
        while not wait([written], EVERY_S).done:
            meanwhile()
        written.result()
