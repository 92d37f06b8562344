"""A file that opens the page in a browser, so that the token does not appear in the command line of the browser.

The page is the live web page of `eimi dashboard`. The token is the secret text that every request must carry.

On most systems every user can list the command lines of all processes. The command line of the browser contains only
the name of this file, which no other user can read.
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
    """Write an HTML file that sends a browser on to an address, and yield the path of the file.

    The file is removed at the end of the context. Only the user can read the file (mode 0600, in a folder of mode
    0700).
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
