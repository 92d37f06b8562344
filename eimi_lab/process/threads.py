"""The number of threads for linear algebra, which is one.

The matrices in this program are so small that more threads bring no gain, and the threads wait for each other if there
are few processors. More threads also add numbers in a varying order, which changes the last digits of results.
"""

import os

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def one_thread_each() -> None:
    """Use one thread for linear algebra in this process and its child processes.

    Call this function before numpy is imported, because numpy reads the setting only then.
    """
    os.environ.update(dict.fromkeys(THREADS, "1"))
