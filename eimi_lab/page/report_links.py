"""Links to the reports of a folder: a browser opens a link in a new tab without the header that carries the token.

Each link holds a key that is computed from the name of the report and a secret of this page, so that it opens that
report alone. The key differs from the token and gives no other right.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from urllib.parse import urlencode

REPORT = "/report"


class ReportLinks:
    """Make links to reports, and check the keys of links."""

    def __init__(self) -> None:
        self._secret = secrets.token_bytes(32)

    def link_to(self, name: str) -> str:
        """Return the path and the query that open a report."""
        return f"{REPORT}?{urlencode({'file': name, 'key': self._key(name)})}"

    def opens(self, name: str, key: str) -> bool:
        """Return whether a key belongs to the report of this name."""
        return hmac.compare_digest(key.encode("utf-8", "replace"), self._key(name).encode())

    def _key(self, name: str) -> str:
        return hmac.new(self._secret, name.encode("utf-8", "replace"), hashlib.sha256).hexdigest()
