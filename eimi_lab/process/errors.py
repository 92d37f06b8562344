"""The one error that a person's input can cause, printed as one line, exit status 2, no traceback; and the printing."""

from __future__ import annotations

import sys


class InputError(Exception):
    """Something a person gave cannot be used.

    The message names what is wrong, where (file, key or row), the value found and what would be right, in one
    line: ``protocol.toml: current.step_A = -0.1 must be greater than 0``.
    """


class OwnFault(Exception):
    """Something that this program should have thought of, and nobody's input is to blame for."""

    def __init__(self, what: str, error: str) -> None:
        """what: was being done, to which file. error: the last line of the traceback."""
        super().__init__(f"{what}: {error}: a fault of this program; please report this line, and the file if you may")


def tell(message: str) -> None:
    """Say something to the person in one line on stderr."""
    print("eimi: " + " ".join(message.split()), file=sys.stderr)
