"""Launch files before they are checked: their path, includes, references and nodes.

This module imports little: `prestart_fork_server` starts the fork server of the nodes while the
rest of palpate and the modules of the nodes are imported. Values get into a launch file only by
references ``$(name)``: a text that is one reference becomes the value itself, of any type.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from palpate.launch.files.source_map import InputError, KeyPath, SourceMapped, hint
from palpate.launch.files.yaml_file import read_yaml
from palpate.launch.node_kinds import Entry
from palpate.launch.processes.fork_server import start_fork_server

SHIPPED_LAUNCH_FILES = Path(__file__).parent  # folder of launch files that come with palpate
EXPLORE = SHIPPED_LAUNCH_FILES / "explore.yaml"  # explores a scene
# Exploratory procedures that have a launch file of their name.
PROCEDURES = ("containment", "planar", "follower", "fearing", "openings")
SYSTEMS = {"palpate": "explore", "thesis": "thesis"}  # launch files of complete sets of methods
INCLUDE = "include"
MERGE_DEPTH = 3  # to which maps of nodes are merged: nodes, a node, its params
_REFERENCE = re.compile(r"\$\(([^()]*)\)")
Places = Mapping[KeyPath, str]


def find_exploration(procedure: str | None = None, system: str | None = None) -> Path:
    """The launch file that explores a scene by an exploratory procedure, or by a set of methods.

    Raises InputError if there is no such procedure or system, or both are named.
    """
    for option, name, known in (("procedure", procedure, PROCEDURES), ("system", system, SYSTEMS)):
        if name is not None and name not in known:
            raise InputError(f"--{option} {name}: must be one of {', '.join(known)}")
    if procedure is not None and system is not None:
        raise InputError(f"--procedure {procedure} and --system {system} exclude each other")
    return SHIPPED_LAUNCH_FILES / f"{procedure or SYSTEMS[system or 'palpate']}.yaml"


def prestart_fork_server(path: Path) -> None:
    """Start the fork server of the nodes before the launch file is checked.

    It is not started for a launch file in Python, or with a fault.
    """
    if modules := named_modules(path):
        start_fork_server(modules)


def named_modules(path: Path) -> tuple[str, ...]:
    """Modules of the nodes in a launch file in YAML, unchecked; none if it has a fault."""
    if path.suffix == ".py":
        return ()
    try:
        nodes = read_with_includes(path, find_launch_file).value.get("nodes")
    except InputError:
        return ()
    if not isinstance(nodes, dict):
        return ()
    kinds = [node.get("kind") if isinstance(node, dict) else name for name, node in nodes.items()]
    return tuple(
        Entry(name=kind if isinstance(kind, str) else name).module
        for name, kind in zip(nodes, kinds, strict=True)
    )


def find_launch_file(path: Path) -> Path:
    """A launch file, given by path, or by the name of a shipped one.

    Raises InputError if there is no such file, or it is neither YAML nor Python.
    """
    shipped = SHIPPED_LAUNCH_FILES / f"{path.name.removesuffix('.yaml')}.yaml"
    if not path.is_file() and path.parent == Path() and shipped.is_file():
        return shipped
    if path.suffix not in (".yaml", ".yml", ".py"):
        raise InputError(f"{path}: is no launch file; its name must end in .yaml or .py")
    if not path.is_file():
        raise InputError(f"{path}: the launch file does not exist")
    return path


def read_with_includes(
    path: Path, find: Callable[[Path], Path], above: tuple[Path, ...] = ()
) -> SourceMapped:
    """A launch file in YAML merged over those that it includes; `above`: files that include it.

    Raises InputError if a file cannot be used, is no YAML, or includes itself.
    """
    own = read_yaml(path)
    if INCLUDE not in own.value:
        return own
    at, name = (INCLUDE,), own.value[INCLUDE]
    if not isinstance(name, str) or not name:
        raise own.error(at, f"include is {name!r:.60}; expected the name of a launch file")
    beside = path.parent / name
    included = beside if beside.is_file() else find(Path(name))
    if included.suffix == ".py":
        raise own.error(at, f"includes {name}, which is no YAML")
    seen = (*above, path.resolve())
    if included.resolve() in seen:
        raise own.error(at, f"includes {name}, which includes this file")
    return merged(read_with_includes(included, find, seen), own)


def merged(below: SourceMapped, own: SourceMapped) -> SourceMapped:
    """Arguments, nodes and their parameters of two files; where both have a value, `own` counts."""
    places = dict(below.places)
    rest = {key: value for key, value in own.value.items() if key != INCLUDE}
    value = _merged_values(below.value, rest, (), own.places, places)
    return SourceMapped(value, own.source, {**places, (): own.place()})


def _merged_values(
    below: Any, own: Any, path: KeyPath, own_places: Places, places: dict[KeyPath, str]
) -> Any:
    """A value merged over another; `places` is updated with the sources of its parts."""
    depth = MERGE_DEPTH if path[:1] == ("nodes",) else 1
    kept = below if isinstance(below, dict) and len(path) <= depth else {}
    if own is None and len(path) == 2 and path[0] == "nodes":
        own = {}  # a node without contents is unchanged
    if len(path) == MERGE_DEPTH and isinstance(own, dict) and isinstance(below, str):
        return _listed(below, own, path, own_places, places)
    if not (isinstance(own, dict) and kept):
        for key in [key for key in places if key[: len(path)] == path]:
            del places[key]
        places.update({key: at for key, at in own_places.items() if key[: len(path)] == path})
        return own
    if path in own_places:
        places[path] = own_places[path]
    merged = {
        key: _merged_values(kept.get(key), item, (*path, key), own_places, places)
        for key, item in own.items()
    }
    return {**kept, **merged}


def _listed(
    below: str, own: Any, path: KeyPath, own_places: Places, places: dict[KeyPath, str]
) -> list[Any]:
    """A map over a reference, whose value is not known yet: a list of both, merged later."""
    if path in places:
        places[*path, 0] = places[path]
    depth = len(path)
    places.update(
        {(*path, 1, *at[depth:]): place for at, place in own_places.items() if at[:depth] == path}
    )
    return [below, own]


def substitute(document: SourceMapped, known: Mapping[str, SourceMapped]) -> SourceMapped:
    """The document with all references replaced; inserted values keep their places.

    Raises InputError if a name is unknown, or a reference to a map or list is part of a text.
    """
    places = dict(document.places)
    return SourceMapped(
        _replaced(document, document.value, (), known, places), document.source, places
    )


def _replaced(
    document: SourceMapped,
    value: Any,
    path: KeyPath,
    known: Mapping[str, SourceMapped],
    places: dict[KeyPath, str],
) -> Any:
    if isinstance(value, dict):
        return {k: _replaced(document, v, (*path, k), known, places) for k, v in value.items()}
    if isinstance(value, list):
        return [_replaced(document, v, (*path, i), known, places) for i, v in enumerate(value)]
    if not isinstance(value, str):
        return value
    if whole := _REFERENCE.fullmatch(value):
        inserted = _look_up(document, whole[1], path, known)
        places.update({(*path, *key): at for key, at in inserted.places.items()})
        if () not in inserted.places and inserted.source:
            places[path] = inserted.source
        return inserted.value

    def as_text(match: re.Match[str]) -> str:
        word = _look_up(document, match[1], path, known).value
        if isinstance(word, (dict, list, tuple, bytes)):
            raise document.error(path, f"$({match[1]}) is more than a word; it must stand alone")
        return str(word)

    return _REFERENCE.sub(as_text, value)


def _look_up(
    document: SourceMapped, name: str, path: KeyPath, known: Mapping[str, SourceMapped]
) -> SourceMapped:
    first, *rest = name.split(".")
    if first not in known:
        raise document.error(path, f"$({name}) is not known; {hint(first, known)}")
    value = known[first]
    for key in rest:
        keys = value.value if isinstance(value.value, Mapping) else ()
        if key not in keys:
            raise document.error(path, f"$({name}): there is no {key!r}; {hint(key, keys)}")
        value = value.part((key,))
    return value
