"""The number of threads of linear algebra, which is one.

More threads do not help with matrices of this size, and wait for each other if there are few processors. They also add
numbers in a varying order, which changes the last digits of results.
"""

import os

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def one_thread_each() -> None:
    """Use one thread in this process and in its child processes; call this before numpy is loaded."""
    os.environ.update(dict.fromkeys(THREADS, "1"))
