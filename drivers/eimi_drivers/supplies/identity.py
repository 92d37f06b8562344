"""Read the serial number from an identification, and state an identity in words."""

from __future__ import annotations

import re

from eimi_drivers.interfaces import Identity


def serial_number_in(text: str) -> str:
    """Return the serial number in an answer to ``*IDN?``, or "" if there is none.

    The serial number is the third of four fields, and "0" means that there is none (IEEE 488.2, 10.14). Some Korad
    supplies add ``SN:`` and the number instead.
    """
    if match := re.search(r"\bSN:\s*(\w+)", text):
        return match[1]
    fields = [field.strip() for field in text.split(",")]
    return fields[2] if len(fields) >= 4 and fields[2].strip("0") else ""


def in_words(identity: Identity) -> str:
    """Return the identity as words for a message."""
    serial_number = f" with serial number {identity.serial_number}" if identity.serial_number else ""
    return f"{identity.text!r}{serial_number}"
