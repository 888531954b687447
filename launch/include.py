"""``include`` in a launch file: another one, of which this one changes or adds something."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from palpate.launch.located import KeyPath, Located
from palpate.launch.yaml_file import read_yaml

INCLUDE = "include"
DEEPEST = 3
"""Depth to which maps of nodes are laid over one another: nodes, a node, its params."""


def read_with_includes(
    path: Path, find: Callable[[Path], Path], above: tuple[Path, ...] = ()
) -> Located:
    """A launch file laid over those that it includes.

    Parameters
    ----------
    path : Path
        A YAML file.
    find : function
        Finds a launch file by path, or by name if it is a shipped one.
    above : Paths
        The files that include it.

    Raises
    ------
    InputError
        If a file cannot be used, is no YAML, or includes itself.
    """
    own = read_yaml(path)
    if INCLUDE not in own.value:
        return own
    at, given = (INCLUDE,), own.value[INCLUDE]
    if not isinstance(given, str) or not given:
        raise own.error(at, f"include is {given!r:.60}; expected the name of a launch file")
    beside = path.parent / given
    found = beside if beside.is_file() else find(Path(given))
    if found.suffix == ".py":
        raise own.error(at, f"includes {given}, which is no YAML")
    seen = (*above, path.resolve())
    if found.resolve() in seen:
        raise own.error(at, f"includes {given}, which includes this file")
    return laid_over(read_with_includes(found, find, seen), own)


def laid_over(below: Located, own: Located) -> Located:
    """Arguments, nodes and their parameters of two files; where both say something, the own."""
    places = dict(below.places)
    rest = {key: value for key, value in own.value.items() if key != INCLUDE}
    value = _laid(below.value, rest, (), own, places)
    places[()] = own.place()
    return Located(value, own.source, places)


def _laid(below: Any, own: Any, path: KeyPath, said: Located, places: dict[KeyPath, str]) -> Any:
    """One value over another; `places` is changed to where each part now comes from."""
    depth = DEEPEST if path[:1] == ("nodes",) else 1
    kept = below if isinstance(below, dict) and len(path) <= depth else {}
    if own is None and len(path) == 2 and path[0] == "nodes":
        own = {}  # a node that is only named stays as it is
    if not (isinstance(own, dict) and kept):
        for key in [key for key in places if key[: len(path)] == path]:
            del places[key]
        places.update({key: at for key, at in said.places.items() if key[: len(path)] == path})
        return own
    if path in said.places:
        places[path] = said.places[path]
    laid = {key: _laid(kept.get(key), one, (*path, key), said, places) for key, one in own.items()}
    return {**kept, **laid}
