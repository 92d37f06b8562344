"""Collect garbage less often, and keep freed memory for reuse."""

import atexit
import gc
import sys

# Number of new objects between two collections. Modules create many permanent objects, and with Python's default
# threshold the collections take 0.08 s of a fit's 1.3 s.
_OBJECTS_BETWEEN_COLLECTIONS = 50_000


def collect_seldom() -> None:
    """Collect garbage less often in this process, and not at the end of the process."""
    gc.set_threshold(_OBJECTS_BETWEEN_COLLECTIONS)
    atexit.register(gc.freeze)


# Settings of the C library's mallopt (manual page mallopt(3)), in bytes: free memory at the end of the heap beyond
# M_TRIM_THRESHOLD, and blocks larger than M_MMAP_THRESHOLD, are returned to the system.
_SETTINGS = ((-1, 256 << 20), (-3, 32 << 20))  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD


def keep_freed_memory() -> None:
    """Keep freed memory in this process for reuse, if the C library supports this."""
    # The return and the new request of memory take a tenth of the time of a simulation of the beam as a solid.
    import ctypes  # imported here because only workers need it

    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):
        for setting, size in _SETTINGS:
            library.mallopt(setting, size)
