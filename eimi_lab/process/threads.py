"""Use one thread for linear algebra."""

import os

# The matrices are so small that more threads bring no gain. More threads also add numbers in a varying order, which
# changes the last digits of results.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def one_thread_each() -> None:
    """Use one thread for linear algebra in this process and its child processes.

    Call this function before numpy is imported.
    """
    os.environ.update(dict.fromkeys(THREADS, "1"))
