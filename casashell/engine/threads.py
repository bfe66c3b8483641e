"""Threads of the dense linear algebra that NumPy and SciPy call.

The dense products here are small: a second thread gains little, and waiting threads take the
processor from whatever else runs (a solve on a busy machine was seen to use three times the
processor time and four times the seconds).
"""

from __future__ import annotations

from contextlib import AbstractContextManager


def one_thread() -> AbstractContextManager[object]:
    """A context in which dense linear algebra runs on the thread that calls it."""
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[object] = threadpool_limits(limits=1, user_api="blas")
    return limits
