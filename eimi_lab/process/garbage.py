"""What becomes of memory that is no longer used: cycles are seldom looked for, and workers keep what they free."""

import atexit
import gc
import sys

# Of objects, between two searches: modules make many that stay, and looking through these again and again takes 0.08 s
# of a fit's 1.3.
_BETWEEN = 50_000


def collect_seldom() -> None:
    """In this process, and not at its end, when all memory goes back at once: another search would take 0.3 s."""
    gc.set_threshold(_BETWEEN)
    atexit.register(gc.freeze)


# Of the C library's mallopt (mallopt(3)): what to set, and bytes. Larger blocks than the second are not kept, and more
# than the first is not kept at the heap's end.
_SETTINGS = ((-1, 256 << 20), (-3, 32 << 20))  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD


def keep_what_is_freed() -> None:
    """In this process memory that is freed is kept for what comes next, where the C library can be told so.

    Each step on a solid has megabytes of its own. Taken from the system and given back again and again, with a page
    fault for each 4 kB, they cost a tenth of a report's simulations.
    """
    import ctypes  # of no use to a program that has no workers

    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):
        for setting, size in _SETTINGS:
            library.mallopt(setting, size)
