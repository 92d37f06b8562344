"""The error for wrong input, which is printed as one line without a traceback, and the printing of messages."""

from __future__ import annotations

import sys


class InputError(Exception):
    """Input from the user cannot be used; the program ends with exit status 2.

    The message names in one line where the fault is (file, key or row), the value, and what would be right:
    ``protocol.toml: current.step_A = -0.1 must be greater than 0``.
    """


class OwnFault(Exception):
    """A fault of this program that is not caused by the user's input."""

    def __init__(self, what: str, error: str) -> None:
        """Create the error; ``what`` names the task and its file, ``error`` is the last line of the traceback."""
        super().__init__(f"{what}: {error}: a fault of this program; please report this line, and the file if you may")


def tell(message: str) -> None:
    """Print a message to the user in one line on standard error."""
    print("eimi: " + " ".join(message.split()), file=sys.stderr)
