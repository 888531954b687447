"""What a look at the machine or at a graph has found: fine, doubtful, or broken."""

from __future__ import annotations

from typing import Literal, NamedTuple


class Finding(NamedTuple):
    """One thing that was looked at."""

    level: Literal["ok", "WARN", "FAIL"]
    """``WARN``: it works, but worse. ``FAIL``: it does not work."""
    text: str
    """What was found, and what to do about it, in one sentence."""

    def __str__(self) -> str:
        return f"{self.level:<5}{self.text}"


def ok(text: str) -> Finding:
    """It is as it should be."""
    return Finding("ok", text)


def warn(text: str) -> Finding:
    """It works, but worse than it could."""
    return Finding("WARN", text)


def fail(text: str) -> Finding:
    """It does not work."""
    return Finding("FAIL", text)
