"""The error of a dataset that can no longer be written."""

from __future__ import annotations

CONTINUE_STORED = "`eimi acquire --resume` continues the run"
"""What a person at a terminal can do after a dataset could not be written any more."""


class StorageFailed(OSError):
    """The error for a dataset that can no longer be written. The message says whether stored load steps are safe."""

    def __init__(self, message: str, reason: str = "") -> None:
        """Create the error. ``reason`` is the error text of the operating system, if any."""
        super().__init__(message)
        self.reason = reason
