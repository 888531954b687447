"""Wake the server of the nodes' processes before anything else, so that it is ready in time.

While the launch file is checked, which imports the modules of all nodes, the server imports
them on another core.
"""

from __future__ import annotations

from pathlib import Path

from palpate.launch.entry import Entry
from palpate.launch.include import read_with_includes
from palpate.launch.launch_path import find_launch_file
from palpate.launch.located import InputError
from palpate.launch.processes.server import wake


def wake_server(path: Path) -> None:
    """Wake the server of the nodes' processes, while the launch file is still to be checked.

    Of a launch file in Python, or one that cannot be used, nothing is known yet: then nothing
    is done.
    """
    modules = named_modules(path)
    if modules:
        wake(modules)


def named_modules(path: Path) -> tuple[str, ...]:
    """Modules of the nodes that a launch file in YAML names, unchecked; none if it has a fault."""
    if path.suffix == ".py":
        return ()
    try:
        nodes = read_with_includes(path, find_launch_file).value.get("nodes")
    except InputError:
        return ()
    if not isinstance(nodes, dict):
        return ()
    kinds = [_kind(name, node) for name, node in nodes.items()]
    return tuple(Entry(name=kind).module for kind in kinds)


def _kind(name: str, node: object) -> str:
    kind = node.get("kind", name) if isinstance(node, dict) else name
    return kind if isinstance(kind, str) else name
