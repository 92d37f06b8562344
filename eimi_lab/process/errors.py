"""Define the error for wrong input and the error for a fault of the program, and print messages."""

from __future__ import annotations

import sys


class InputError(Exception):
    """The error that is raised if an input of the user cannot be used. The program then ends with exit status 2.

    The message is one line with the place of the fault (file, key or row), the value, and what would be right:
    ``protocol.toml: current.step_A = -0.1 must be greater than 0``.
    """


class OwnFault(Exception):
    """The error that is raised if the cause is a fault of this program, and not the input of the user."""

    def __init__(self, what: str, error: str) -> None:
        """Store what failed.

        ``what`` is the task and its file. ``error`` is the last line of the traceback.
        """
        super().__init__(f"{what}: {error}: a fault of this program; please report this line, and the file if you may")


def tell(message: str) -> None:
    """Print a message to the user as one line on standard error."""
    print("eimi: " + " ".join(message.split()), file=sys.stderr)
