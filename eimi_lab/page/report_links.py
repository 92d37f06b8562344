"""Links that open a report in a new browser tab.

A link contains a key (a secret text), which opens only this report.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from urllib.parse import urlencode

REPORT = "/report"


class ReportLinks:
    """Links to reports. A link contains a key (a secret text) that opens only one report."""

    def __init__(self) -> None:
        self._secret = secrets.token_bytes(32)

    def link_to(self, name: str) -> str:
        """Return the link that opens the report ``name``. It contains a secret text that only opens this report."""
        return f"{REPORT}?{urlencode({'file': name, 'key': self._key(name)})}"

    def opens(self, name: str, key: str) -> bool:
        """Return whether ``key`` is the secret text that opens the report ``name``."""
        return hmac.compare_digest(key.encode("utf-8", "replace"), self._key(name).encode())

    def _key(self, name: str) -> str:
        return hmac.new(self._secret, name.encode("utf-8", "replace"), hashlib.sha256).hexdigest()
