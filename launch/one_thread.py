"""Linear algebra on one processor.

Small systems gain nothing from more, and lose much on a busy computer.
"""

from __future__ import annotations

from contextlib import AbstractContextManager


def one_thread() -> AbstractContextManager[object]:
    """A context in which numpy and scipy calculate on one processor."""
    # Looks through all loaded libraries: after numpy and scipy are.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits
