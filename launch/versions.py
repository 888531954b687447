"""Versions of what a result depends on."""

from __future__ import annotations

import platform
from importlib.metadata import version

MATTERS = ("numpy", "scipy", "trimesh", "pyzmq", "msgpack", "msgspec", "mcap", "lz4")


def versions() -> dict[str, str]:
    """Python and the packages that results and recordings depend on, by name."""
    return {"python": platform.python_version(), **{name: version(name) for name in MATTERS}}


def versions_text() -> str:
    """The same in a line."""
    return ", ".join(f"{name} {number}" for name, number in versions().items())
