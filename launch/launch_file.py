"""A launch file: the graph as a user writes it down, in YAML or, where logic is needed, in Python.

In YAML nothing but data is read. A Python launch file is a program and is run as one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta, Struct, field

from palpate.launch.convert import convert
from palpate.launch.entry import Entry
from palpate.launch.graph import Graph
from palpate.launch.include import read_with_includes
from palpate.launch.launch_path import find_launch_file
from palpate.launch.located import Located
from palpate.launch.nearest import hint
from palpate.launch.scene import Scene, load_scene
from palpate.launch.substitute import substitute
from palpate.nodes.node import MOST_FINGERS
from palpate.nodes.wiring import OnExit

RESERVED = {"out": "the run directory", "finger": "the number of a finger"}
"""What ``$(name)`` stands for without an argument of that name."""


class NodeSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One node of a launch file."""

    kind: str = ""
    """A module of palpate.nodes, ``module:NODE`` or a dotted module of one's own; the node's name
    if left out."""
    params: dict[str, Any] = {}
    """Its parameters."""
    remap: dict[str, str] = {}
    """Topic as the node calls it, to the topic on the wire."""
    fingers: int | None = None
    """One such node for each of so many fingers, whose number is ``$(finger)``."""
    namespace: str = ""
    """Put before its topics."""
    host: str = ""
    """Address of the machine on which it runs; this one if left out."""
    nice: Annotated[int, Meta(ge=0, le=19)] = 0
    """How far the process stands back when the processor is busy, as in nice(1)."""
    on_exit: OnExit = "restart"
    """What is done when its process dies: restart, stop (the run) or ignore."""
    wanted: bool = field(default=True, name="if")
    """False leaves the node out; written ``if`` in the file."""


class LaunchSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that a launch file may say."""

    args: dict[str, Any] = {}
    """What may be set from outside, and its default."""
    nodes: dict[str, Any]
    """The nodes by name."""
    ends: str
    """The node whose Finished ends the graph."""


@dataclass(frozen=True, slots=True)
class Described:
    """What a launch file comes to."""

    graph: Graph
    """The graph, not yet checked."""
    scene: Scene | None
    """The scene that it explores, if it has an argument of that name."""
    args: Mapping[str, Any]
    """Its arguments as they came out."""


def describe(path: Path, args: Mapping[str, Located], out: Path) -> Described:
    """The graph that a launch file describes.

    Parameters
    ----------
    path : Path
        A ``.yaml`` file, or a ``.py`` file with ``describe(**args) -> Graph``.
    args : map
        Arguments given from outside.
    out : Path
        The run directory, ``$(out)``; it need not exist.

    Raises
    ------
    InputError
        If the file or an argument cannot be used.
    """
    if path.suffix == ".py":
        from palpate.launch.python_file import describe_python

        plain = {name: value.value for name, value in args.items()}
        return Described(describe_python(path, args, out), None, plain)
    given = read_with_includes(path, find_launch_file)
    known, scene = _arguments(given, args, out)
    graph = _graph(given, known)
    return Described(graph, scene, {name: value.value for name, value in known.items()})


def declared_args(given: Located) -> dict[str, Any]:
    """The arguments that a launch file declares, and their defaults as written.

    Raises
    ------
    InputError
        If they are no map.
    """
    declared = given.value.get("args") or {}
    if not isinstance(declared, dict):
        raise given.error(("args",), "args must be a map of names to defaults")
    return declared


def _arguments(
    given: Located, args: Mapping[str, Located], out: Path
) -> tuple[dict[str, Located], Scene | None]:
    """What references may name: the run directory, and the arguments in the order declared."""
    declared = declared_args(given)
    for name, value in args.items():
        if name not in declared:
            text = f"{given.source} has no argument {name!r}; {hint(name, declared)}"
            raise value.error((), text)
    known = {"out": Located(str(out), "")}
    scene = None
    for name in declared:
        if name in RESERVED:
            raise given.error(("args", name), f"$({name}) is {RESERVED[name]}; choose another name")
        known[name] = args.get(name) or substitute(given.part(("args", name)), known)
        if name == "scene":
            scene = load_scene(str(known[name].value))
            known[name] = scene.located
    return known, scene


def _graph(given: Located, known: Mapping[str, Located]) -> Graph:
    """The graph; the nodes are filled in one by one, for each may mean another finger."""
    rest = {key: value for key, value in given.value.items() if key not in ("args", "nodes")}
    filled = substitute(Located(rest, given.source, given.places), known)
    nodes = {key: value for key, value in given.value.items() if key == "nodes"}
    spec = convert(Located({**filled.value, **nodes}, given.source, filled.places), LaunchSpec)
    entries = [
        entry for name in spec.nodes for entry in _entries(name, given.part(("nodes", name)), known)
    ]
    return Graph(tuple(entries), spec.ends, filled.place(("ends",)))


def _entries(name: str, given: Located, known: Mapping[str, Located]) -> list[Entry]:
    """What a node of the file comes to: one entry, one for each finger, or none."""
    if not (isinstance(given.value, dict) and "fingers" in given.value):
        return _wanted(name, name, substitute(given, known))
    if "namespace" in given.value:
        raise given.error(
            ("namespace",), f"node {name!r}: a node with fingers has its namespace from them"
        )
    fingers = _fingers(substitute(given.part(("fingers",)), known))
    entries = []
    for finger in range(1, fingers + 1):
        number = Located(finger, given.place(("fingers",)))
        one = substitute(given, {**known, "finger": number})
        if fingers > 1:
            own = {"kind": name, **one.value, "namespace": f"finger_{finger}"}
            one = Located(own, one.source, one.places)
        entries += _wanted(name, f"{name}_{finger}" if fingers > 1 else name, one)
    return entries


def _fingers(given: Located) -> int:
    value = given.value
    if type(value) is not int or not 1 <= value <= MOST_FINGERS:
        raise given.error((), f"fingers must be 1 to {MOST_FINGERS}, got {value!r:.60}")
    return value


def _wanted(key: str, name: str, given: Located) -> list[Entry]:
    """The entry of a filled-in node, unless it is left out; the file has it under the key."""
    spec = NodeSpec() if given.value is None else convert(given, NodeSpec, f"nodes.{key}")
    entry = Entry(
        name=name,
        kind=spec.kind,
        params=spec.params,
        remap=spec.remap,
        namespace=spec.namespace,
        host=spec.host,
        nice=spec.nice,
        on_exit=spec.on_exit,
        source=given.source,
        places=given.part(("params",)).places if spec.params else {},
    )
    return [entry] if spec.wanted else []
