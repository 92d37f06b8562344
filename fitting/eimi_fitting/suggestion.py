"""Suggest an existing name in place of a name that does not exist."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def suggestion(name: object, names: Iterable[str]) -> str:
    """End an error message about an unknown name with the closest existing name, or with all existing names.

    Examples
    --------
    >>> suggestion("yeo", ["neo-hookean", "yeoh"])
    "did you mean 'yeoh'?"
    >>> suggestion("mooney", ["neo-hookean", "yeoh"])
    'there are neo-hookean, yeoh'
    """
    all_names = list(names)
    folded = {valid.casefold(): valid for valid in all_names}
    close = difflib.get_close_matches(str(name).casefold(), folded, n=1)
    return f"did you mean {folded[close[0]]!r}?" if close else f"there are {', '.join(all_names)}"
