"""Steps of long computations, which they announce to their caller by name."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

# Name of a step to a context that is open while it lasts; nested steps interrupt the outer one.
Steps = Callable[[str], AbstractContextManager[object]]


def no_steps(name: str) -> AbstractContextManager[object]:
    """Default: steps are ignored."""
    return nullcontext()
