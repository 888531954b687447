"""One node as a launch file describes it, and the kinds of node that there are.

A user's own modules are found where Python looks, and where palpate is started. Imports little.
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

INPUTS = "inputs"  # Folder in that of a run: the meshes and modules that it was made with
KINDS = "palpate.nodes"  # A kind without a dot is a module of this package
_FINGER = re.compile(r"finger_([1-9])")
NODE_ATTRIBUTES = ("NODE", "SOURCE", "SINK")  # What a module may hold a node as
_HOLDS_NODE = re.compile(rf"^({'|'.join(NODE_ATTRIBUTES)})\b.*=", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A node's name, kind, parameters and place, not yet checked."""

    name: str  # Name in the graph: lower case, digits and ``_``
    # A module of ``palpate.nodes``, ``module:NODE`` (or SINK, SOURCE) or a dotted module of one's
    # own; the name if empty.
    kind: str = ""
    params: Any = field(default_factory=dict)  # Map of plain values, or the node's own parameters
    # Topic as the node calls it, to the topic on the wire; a namespace does not touch it.
    remap: Mapping[str, str] = field(default_factory=dict)
    # Put before the node's topics: ``finger_1`` makes ``/finger_1/touch/raw``, except of those that
    # the node shares with the other fingers'.
    namespace: str = ""
    host: str = ""  # Machine on which it runs, ``192.168.1.5`` or ``lab2:7447``; empty for this
    nice: int = 0  # How far its process stands back when the processor is busy, from 0 to 19
    on_exit: OnExit = "restart"  # When its process dies: start it again, stop, or go on without it
    source: str = ""  # ``file:line`` of the description
    # ``file:line``, or the option, of single parameters.
    places: Mapping[KeyPath, str] = field(default_factory=dict)

    @property
    def module(self) -> str:
        """Module that holds the node."""
        kind = self.kind or self.name
        own, mark, _ = kind.partition(":")
        return own if mark or "." in own else f"{KINDS}.{kind}"

    @property
    def finger(self) -> int:
        """The finger in whose namespace it stands; 0 if in none."""
        found = _FINGER.fullmatch(self.namespace)
        return int(found[1]) if found else 0

    @property
    def group(self) -> str:
        """What it and its like of the other fingers are called together."""
        return self.name.removesuffix(f"_{self.finger}") if self.finger else self.name

    @property
    def settings(self) -> SourceMapped:
        """The parameters, each with the place at which it was set."""
        return SourceMapped(self.params, self.source, self.places)

    def error(self, text: str) -> InputError:
        """A complaint about this node."""
        place = f"{self.source}: " if self.source else ""
        return InputError(f"{place}node {self.name!r}: {text}")


def list_kinds() -> tuple[str, ...]:
    """Names of the nodes that palpate has, found without importing one."""
    names = (module.name for module in pkgutil.iter_modules(palpate.nodes.__path__))
    return tuple(sorted(name for name in names if _holds_node(f"{KINDS}.{name}")))


def _holds_node(module: str) -> bool:
    spec = find_spec(module)
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return False
    return _HOLDS_NODE.search(Path(spec.origin).read_text(encoding="utf-8")) is not None


def load_entry(entry: Entry) -> AnyNode:
    """The node that an entry asks for.

    Raises InputError if there is no such kind, or its module holds no node, or cannot be imported.
    """
    from palpate.nodes.runtime.node import load_node  # takes long: launch files need it not

    kind = entry.kind or entry.name
    _, mark, held = kind.partition(":")
    if mark and held not in NODE_ATTRIBUTES:
        raise entry.error(f"kind is {kind!r}; a module of one's own is named as module:NODE")
    search_current_folder(kind)
    try:
        node = load_node(entry.module)
    except ValueError as error:
        if mark or "." in kind or kind in list_kinds():
            raise entry.error(str(error)) from None
        known = hint(kind, list_kinds())
        raise entry.error(f"there is no kind of node {kind!r}; {known}") from None
    except Exception as error:  # a module of one's own may break in any way
        raise entry.error(f"module {entry.module!r} breaks: {describe_error(error)}") from None
    if mark and getattr(sys.modules[entry.module], held, None) is not node:
        raise entry.error(f"module {entry.module!r} holds no {held}")
    return node


def search_inputs(folder: Path) -> None:
    """Have modules that a run was made with looked for in its folder, too, after all others."""
    inputs = str((folder / INPUTS).resolve())  # the link ``latest`` moves on
    if Path(inputs).is_dir() and inputs not in sys.path:
        sys.path.append(inputs)


def own_modules(names: Iterable[str]) -> dict[str, Path]:
    """Files of imported modules of the user's own, by their places in a folder of modules.

    `names`: dotted, with or without ``:Class``. Own are those that are neither of palpate nor
    installed; what they have imported from the folder in which they were found goes with them.
    """
    named = [_own_file(name.partition(":")[0]) for name in names]
    folders = {folder for folder, _ in filter(None, named)}
    if not folders:
        return {}
    imported = filter(None, map(_own_file, [*sys.modules]))
    return {str(place): folder / place for folder, place in imported if folder in folders}


def _own_file(name: str) -> tuple[Path, Path] | None:
    """The folder in which an imported module was found, and its place there; None if not own."""
    file = Path(getattr(sys.modules.get(name), "__file__", None) or "")
    installed = {"site-packages", "dist-packages"} & set(file.parts)
    if installed or name.partition(".")[0] == "palpate" or not file.is_file():
        return None
    parents = name.split(".") if file.stem == "__init__" else name.split(".")[:-1]
    place = Path(*parents, file.name)
    folder = file.parents[len(parents)]
    return (folder, place) if folder / place == file else None  # it may have been run by its path


def search_current_folder(name: str) -> None:
    """Have the module of ``module:Class`` looked for in the current folder, too, after all others.

    Processes that are started later inherit it.
    """
    here = str(Path.cwd())
    if ":" in name and here not in sys.path:
        sys.path.append(here)
