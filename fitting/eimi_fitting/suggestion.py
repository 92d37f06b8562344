"""What a person may have meant by a name that does not exist."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def suggestion(name: object, names: Iterable[str]) -> str:
    """Return a question or a list that ends a message about an unknown name.

    Parameters
    ----------
    name : object
        What was given.
    names : iterable of str
        The names that exist.

    Returns
    -------
    str
        ``"did you mean 'yeoh'?"`` where one name is close, else ``"there are neo-hookean, yeoh"``.

    Examples
    --------
    >>> suggestion("yeo", ["neo-hookean", "yeoh"])
    "did you mean 'yeoh'?"
    >>> suggestion("mooney", ["neo-hookean", "yeoh"])
    'there are neo-hookean, yeoh'
    """
    every = list(names)
    folded = {one.casefold(): one for one in every}
    close = difflib.get_close_matches(str(name).casefold(), folded, n=1)
    return f"did you mean {folded[close[0]]!r}?" if close else f"there are {', '.join(every)}"
