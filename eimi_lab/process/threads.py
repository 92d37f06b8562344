"""Linear algebra on one thread: more do not help matrices this small, wait for each other where processors are few,
and add up in an order that changes the last digits.
"""

import os

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def one_thread_each() -> None:
    """Here and in the processes begun from here; in time only before numpy is loaded."""
    os.environ.update(dict.fromkeys(THREADS, "1"))
