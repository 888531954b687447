"""Descriptions of nodes in a launch file, and the kinds of nodes.

A user's own modules may be anywhere on Python's path, or in the folder in which palpate is started.
This module imports little.
"""

from __future__ import annotations

import pkgutil
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import palpate.nodes
from palpate.core.plugins import describe_error
from palpate.launch.files.source_map import InputError, KeyPath, SourceMapped, hint

if TYPE_CHECKING:
    from palpate.nodes.runtime.node import AnyNode, OnExit

INPUTS = "inputs"  # folder in a run directory: meshes and modules that the run uses
KINDS = "palpate.nodes"  # a kind without a dot is a module of this package
_FINGER = re.compile(r"finger_([1-9])")
NODE_ATTRIBUTES = ("NODE", "SOURCE", "SINK")  # names of a node in its module
_HOLDS_NODE = re.compile(rf"^({'|'.join(NODE_ATTRIBUTES)})\b.*=", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """The name, kind, parameters and place of a node, unchecked."""

    name: str  # in the graph: lower case, digits and ``_``
    # A module of ``palpate.nodes``, ``module:NODE`` (or SINK, SOURCE) or a user's dotted module;
    # the name if empty.
    kind: str = ""
    params: Any = field(default_factory=dict)  # map of plain values, or the node's own parameters
    # Topics on the wire by the node's names of topics; the namespace does not change them.
    remap: Mapping[str, str] = field(default_factory=dict)
    # Prefix of the node's topics: ``finger_1`` gives ``/finger_1/touch/raw``, except of topics that
    # the nodes of all fingers share.
    namespace: str = ""
    host: str = ""  # machine on which it runs, ``192.168.1.5`` or ``lab2:7447``; empty: this one
    nice: int = 0  # of its process, 0 to 19: larger values leave the processor to others
    on_exit: OnExit = "restart"  # if its process dies: restart, stop the run, or ignore it
    source: str = ""  # ``file:line`` of the description
    # ``file:line`` or option of single parameters.
    places: Mapping[KeyPath, str] = field(default_factory=dict)

    @property
    def module(self) -> str:
        """Module of the node."""
        kind = self.kind or self.name
        own, mark, _ = kind.partition(":")
        return own if mark or "." in own else f"{KINDS}.{kind}"

    @property
    def finger(self) -> int:
        """Number of the finger of its namespace; 0 if it has no finger."""
        match = _FINGER.fullmatch(self.namespace)
        return int(match[1]) if match else 0

    @property
    def group(self) -> str:
        """Common name of this node and those of other fingers."""
        return self.name.removesuffix(f"_{self.finger}") if self.finger else self.name

    @property
    def settings(self) -> SourceMapped:
        """The parameters, each with its source."""
        return SourceMapped(self.params, self.source, self.places)

    def error(self, text: str) -> InputError:
        """An error about this node."""
        place = f"{self.source}: " if self.source else ""
        return InputError(f"{place}node {self.name!r}: {text}")


def list_kinds() -> tuple[str, ...]:
    """Names of palpate's nodes, without importing them."""
    names = (module.name for module in pkgutil.iter_modules(palpate.nodes.__path__))
    return tuple(sorted(name for name in names if _holds_node(f"{KINDS}.{name}")))


def _holds_node(module: str) -> bool:
    spec = find_spec(module)
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return False
    return _HOLDS_NODE.search(Path(spec.origin).read_text(encoding="utf-8")) is not None


def load_entry(entry: Entry) -> AnyNode:
    """The node of an entry.

    Raises InputError if there is no such kind, or its module has no node or cannot be imported.
    """
    from palpate.nodes.runtime.node import load_node  # imported late: reading needs it not

    kind = entry.kind or entry.name
    _, mark, attribute = kind.partition(":")
    if mark and attribute not in NODE_ATTRIBUTES:
        raise entry.error(f"kind is {kind!r}; a module of one's own is named as module:NODE")
    search_current_folder(kind)
    try:
        node = load_node(entry.module)
    except ValueError as error:
        if mark or "." in kind or kind in list_kinds():
            raise entry.error(str(error)) from None
        known = hint(kind, list_kinds())
        raise entry.error(f"there is no kind of node {kind!r}; {known}") from None
    except Exception as error:  # a user's own module may raise anything
        raise entry.error(f"module {entry.module!r} breaks: {describe_error(error)}") from None
    if mark and getattr(sys.modules[entry.module], attribute, None) is not node:
        raise entry.error(f"module {entry.module!r} holds no {attribute}")
    return node


def search_inputs(folder: Path) -> None:
    """Append the modules in the folder of a run to Python's path."""
    inputs = str((folder / INPUTS).resolve())  # the link ``latest`` may change
    if Path(inputs).is_dir() and inputs not in sys.path:
        sys.path.append(inputs)


def own_modules(names: Iterable[str]) -> dict[str, Path]:
    """Files of the user's own imported modules, by their relative paths.

    `names`: dotted, with or without ``:Class``. A user's own modules are neither of palpate nor
    installed. Modules that they have imported from their own folder are included.
    """
    files = [_own_file(name.partition(":")[0]) for name in names]
    folders = {folder for folder, _ in filter(None, files)}
    if not folders:
        return {}
    imported = filter(None, map(_own_file, [*sys.modules]))
    return {str(path): folder / path for folder, path in imported if folder in folders}


def _own_file(name: str) -> tuple[Path, Path] | None:
    """Folder of an imported module and relative path of its file; None if not the user's own."""
    file = Path(getattr(sys.modules.get(name), "__file__", None) or "")
    installed = {"site-packages", "dist-packages"} & set(file.parts)
    if installed or name.partition(".")[0] == "palpate" or not file.is_file():
        return None
    parents = name.split(".") if file.stem == "__init__" else name.split(".")[:-1]
    path = Path(*parents, file.name)
    folder = file.parents[len(parents)]
    return (folder, path) if folder / path == file else None  # it may have been run by its path


def search_current_folder(name: str) -> None:
    """Append the current folder to Python's path for the name ``module:Class``.

    Processes that are started later inherit the path.
    """
    here = str(Path.cwd())
    if ":" in name and here not in sys.path:
        sys.path.append(here)
