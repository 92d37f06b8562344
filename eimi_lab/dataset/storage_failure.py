"""The error of a dataset that can no longer be written."""

from __future__ import annotations

CONTINUE_STORED = "`eimi acquire --resume` continues the run"
"""What a person at a terminal can do after a dataset could not be written any more."""


class StorageFailed(OSError):
    """The error that is raised if a dataset can no longer be written.

    The message says whether the stored states (load steps) are safe.
    """

    def __init__(self, message: str, reason: str = "") -> None:
        """Create the error with a message.

        ``reason`` is the error text of the operating system; empty if the operating system reported no error.
        """
        super().__init__(message)
        self.reason = reason
