"""A bound on the lists and maps of a packed value.

One byte is enough for an empty list, which takes some seventy in memory. Lengths alone bound
nothing, for lists may lie within lists.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def at_most(number: int) -> Callable[[Any], Any]:
    """A hook for one value to unpack, which lets through so many lists and maps and no more.

    It raises ValueError then, in the midst of unpacking.
    """
    left = iter(range(number))

    def count(found: Any) -> Any:
        if next(left, None) is None:
            raise ValueError(f"more than {number} lists and maps")
        return found

    return count
