"""Find the serial number in an identification text, and describe an identity for a message."""

from __future__ import annotations

import re

from eimi_drivers.interfaces import Identity


def serial_number_in(text: str) -> str:
    """Return the serial number in an answer to ``*IDN?`` (IEEE 488.2, 10.14); empty if the answer contains none."""
    if match := re.search(r"\bSN:\s*(\w+)", text):
        return match[1]
    fields = [field.strip() for field in text.split(",")]
    return fields[2] if len(fields) >= 4 and fields[2].strip("0") else ""


def in_words(identity: Identity) -> str:
    """Return the identification text and the serial number of an instrument, for a message."""
    serial_number = f" with serial number {identity.serial_number}" if identity.serial_number else ""
    return f"{identity.text!r}{serial_number}"
