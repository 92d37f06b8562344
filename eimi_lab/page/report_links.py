"""Links to the reports of a folder.

A browser opens a link in a new tab without the header that carries the token (the secret text of the page). Each link
therefore contains a key, which is computed from the name of the report and a secret of this page. The key opens only
this report and gives no other right.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from urllib.parse import urlencode

REPORT = "/report"


class ReportLinks:
    """The links to reports: each link contains a key that opens only this report."""

    def __init__(self) -> None:
        self._secret = secrets.token_bytes(32)

    def link_to(self, name: str) -> str:
        """Return the link that opens the report ``name``: a path of this server with the name and the key as query."""
        return f"{REPORT}?{urlencode({'file': name, 'key': self._key(name)})}"

    def opens(self, name: str, key: str) -> bool:
        """Return whether a link with the secret text ``key`` may open the report ``name``."""
        return hmac.compare_digest(key.encode("utf-8", "replace"), self._key(name).encode())

    def _key(self, name: str) -> str:
        return hmac.new(self._secret, name.encode("utf-8", "replace"), hashlib.sha256).hexdigest()
