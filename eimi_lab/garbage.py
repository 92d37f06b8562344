"""How seldom Python looks for cycles among its objects: there are few, and looking takes time."""

import atexit
import gc

# Of objects, between two searches: modules make many that stay, and looking through these again and again takes 0.08 s
# of a fit's 1.3.
_BETWEEN = 50_000


def collect_seldom() -> None:
    """In this process, and not at its end, when all memory goes back at once: another search would take 0.3 s."""
    gc.set_threshold(_BETWEEN)
    atexit.register(gc.freeze)
