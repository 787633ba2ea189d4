"""Reports take times of one core."""

import os

KEYS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "IGL_NUM_THREADS", "NUMBA_NUM_THREADS")


def one_thread() -> None:
    """Keep the libraries that are loaded from now on to one thread."""
    os.environ |= dict.fromkeys(KEYS, "1")
