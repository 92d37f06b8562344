"""Write the address of the live web page, which contains a secret token, to a file that a browser opens.

Every user of a computer can read an address in a command line. Only the owner can read this file.
"""

from __future__ import annotations

import html
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def redirect_file(address: str) -> Iterator[Path]:
    """Write a private HTML file that sends a browser to an address, and yield the path of the file.

    The file is removed at the end of the context.
    """
    with tempfile.TemporaryDirectory(prefix="eimi-page-") as folder:
        path = Path(folder) / "open.html"
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(descriptor, "w", encoding="utf-8") as file:
            file.write(
                '<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer"><title>eimi</title>\n'
                f'<meta http-equiv="refresh" content="0;url={html.escape(address)}">\n'
                f'<p><a href="{html.escape(address)}">Open the page</a></p>\n'
            )
        yield path
