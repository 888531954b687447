"""Feels an unknown object with a simulated fingertip and rebuilds it as a solid."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from palpate.core.rebuild.felt.felt_points import FeltPoints as FeltPoints
    from palpate.core.rebuild.reconstruct import reconstruct as reconstruct
    from palpate.core.touch.feel import feel as feel
    from palpate.launch.explore import explore as explore
    from palpate.launch.run import Run as Run
    from palpate.launch.scene import Scene as Scene
    from palpate.launch.scene import load_scene as load_scene
    from palpate.launch.solid_file import load as load
    from palpate.launch.solid_file import save as save
    from palpate.nodes.frames_file import read_frames as read_frames

__version__ = "0.1.0"
__all__ = [
    "FeltPoints",
    "Run",
    "Scene",
    "__version__",
    "explore",
    "feel",
    "load",
    "load_scene",
    "read_frames",
    "reconstruct",
    "save",
]

# Imported when first asked for: a node that starts must not pay for what notebooks use.
_HOMES = {
    "FeltPoints": "palpate.core.rebuild.felt.felt_points",
    "Run": "palpate.launch.run",
    "Scene": "palpate.launch.scene",
    "explore": "palpate.launch.explore",
    "feel": "palpate.core.touch.feel",
    "load": "palpate.launch.solid_file",
    "load_scene": "palpate.launch.scene",
    "read_frames": "palpate.nodes.frames_file",
    "reconstruct": "palpate.core.rebuild.reconstruct",
    "save": "palpate.launch.solid_file",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'palpate' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
