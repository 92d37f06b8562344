"""Read people.toml, which lists the authors of an archive that `eimi publish` writes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field

from eimi_lab.config.toml import Document, Table, parse, read_text

_ORCID_DIGITS = 16


def _orcid(text: str) -> str:
    """Return an ORCID iD in its usual form, such as 0000-0002-1825-0097, after a check of the last digit (ISO 7064)."""
    digits = text.removeprefix("https://orcid.org/").replace("-", "")
    if len(digits) != _ORCID_DIGITS or not digits[:-1].isdecimal() or digits[-1] not in "0123456789X":
        raise ValueError("should be an ORCID iD such as 0000-0002-1825-0097")
    total = 0
    for digit in digits[:-1]:
        total = (total + int(digit)) * 2
    check = (12 - total % 11) % 11
    if digits[-1] != ("X" if check == 10 else str(check)):
        raise ValueError(
            "does not have the right check digit (the last character), so one of its characters is wrong; compare it "
            "with orcid.org"
        )
    return "-".join(digits[start : start + 4] for start in range(0, _ORCID_DIGITS, 4))


class Person(Table):
    """One author in people.toml."""

    given_name: Annotated[str, Field(min_length=1)]
    """First names."""
    family_name: Annotated[str, Field(min_length=1)]
    """Last name."""
    orcid: Annotated[str, AfterValidator(_orcid)] | None = None
    """ORCID iD. The program tests its last character, which is a check digit."""
    affiliation: str | None = None
    """Name of the institution."""
    email: str | None = None
    """E-mail address for questions. The archive shows it to everybody."""


class People(Document):
    """The contents of people.toml: the authors of a published archive."""

    person: Annotated[tuple[Person, ...], Field(min_length=1, strict=False)]
    """The authors in the order of the publication, each in a table [[person]]."""


def load_people(path: str | Path) -> People:
    """Read the authors from people.toml. Raises InputError if the file cannot be read, or if a value is wrong."""
    file = Path(path)
    return parse(People, read_text(file), file)
