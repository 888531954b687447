"""Who may import whom, read off the source without running it."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


# From below: nothing imports from a layer above its own.
LAYERS = ("core", "messages", "nodes", "launch", "tools", "bench")
BESIDE = ({"core", "messages"},)  # These know nothing of each other


# The longest prefix of a module's name decides what it may import besides palpate and Python.
LIBRARIES = {
    "palpate": {"lazy_loader"},
    "palpate.core": {"numpy", "scipy"},
    "palpate.core.shapes": {"numpy", "scipy", "trimesh", "embreex", "manifold3d"},
    "palpate.core.geometry": {"numpy", "scipy", "trimesh", "embreex"},
    "palpate.core.rebuild.protocol": {"numpy", "trimesh"},
    "palpate.messages": {"numpy", "msgpack", "msgspec"},
    "palpate.messages.bus": {"numpy", "msgspec", "zmq"},
    "palpate.messages.recording": {"numpy", "msgspec", "mcap", "lz4", "zstandard"},
    "palpate.nodes": {"numpy", "msgspec", "lazy_loader"},
    "palpate.nodes.runtime": {"numpy", "msgspec", "threadpoolctl"},
    "palpate.launch": {"numpy", "msgspec", "ruamel", "rich", "trimesh", "scipy", "zmq"},
    "palpate.launch.charts": {"matplotlib"},
    "palpate.launch.cost_chart": {"matplotlib"},
    "palpate.tools": {"numpy", "click", "msgspec", "ruamel", "rich", "scipy", "threadpoolctl"},
    "palpate.tools.cli": {"click", "rich"},
    "palpate.tools.showing": {"numpy", "matplotlib", "viser"},
    "palpate.tools.graph_drawing": {"matplotlib"},
    "palpate.tools.bag": {"numpy", "msgspec", "rich", "mcap"},
    "palpate.tools.exporters.rerun_export": {"numpy", "rerun"},
    "palpate.tools.bag.tables": {"numpy", "pandas"},
    "palpate.tools.exporters.ros2_bridge": {
        *("numpy", "click", "msgspec", "rclpy", "rosidl_runtime_py"),
    },
    "palpate.tools.exporters": {"numpy", "msgspec", "mcap"},
    "palpate.tools.film": {"numpy", "PIL", "click", "matplotlib"},
    "palpate.tools.report": {"numpy"},
    "palpate.tools.view": {"numpy", "scipy", "PIL", "matplotlib", "viser"},
    "palpate.tools.sweep": {"numpy", "msgspec", "click", "distributed", "matplotlib"},
    "palpate.tools.gallery": {"numpy", "click", "matplotlib", "PIL"},
    "palpate.tools.introspection": {"numpy", "msgspec", "rich", "zmq"},
    "palpate.bench": {
        *("numpy", "scipy", "click", "msgspec", "threadpoolctl", "matplotlib", "mpl_toolkits"),
        *("trimesh", "pymeshlab", "zmq"),
    },
}
CLOCKS = ("palpate.nodes.runtime", "palpate.messages.bus", *(f"palpate.{x}" for x in LAYERS[3:]))
CLOCK_MODULES = frozenset({"time", "datetime"})
BANNED = frozenset({"pickle", "marshal", "shelve", "dill"})


def modules() -> dict[str, Path]:
    """Every module of the layers by its name."""
    return {
        ".".join(("palpate", *path.relative_to(ROOT).with_suffix("").parts)): path
        for layer in LAYERS
        for path in sorted((ROOT / layer).rglob("*.py"))
        if "scenes" not in path.parts
    }


MODULES = modules()
ROOMS = frozenset(name.removesuffix(".__init__") for name in MODULES if name.endswith("__init__"))
# Rooms that are libraries: what others use of them stands in their ``__init__``. The modules of
# nodes, launch, tools and bench, and those directly in core, are imported by their own names.
DOORS = frozenset(room for room in ROOMS if room.split(".")[1] in ("core", "messages")) - {
    "palpate.core"
}


@cache
def imports(source: str) -> tuple[tuple[int, str, bool], ...]:
    """Line, full name, and whether it happens at once, of everything that a source imports."""
    return tuple(_imports_of(ast.parse(source), at_once=True))


def _imports_of(node: ast.AST, at_once: bool) -> Iterator[tuple[int, str, bool]]:
    if isinstance(node, ast.Import):
        yield from ((node.lineno, alias.name, at_once) for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        module = "." * node.level + (node.module or "")
        for alias in node.names:
            full = f"{module}.{alias.name}"
            yield node.lineno, full if full in MODULES or full in ROOMS else module, at_once
    elif not isinstance(node, ast.expr):
        at_once = at_once and not (isinstance(node, ast.FunctionDef) or _is_for_checkers(node))
        for inner in ast.iter_child_nodes(node):
            yield from _imports_of(inner, at_once)


def _is_for_checkers(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"


def faults(module: str, source: str) -> list[str]:
    """What a module imports although it may not."""
    return [
        f"{module}:{line}: imports {name}, {why}"
        for line, name, _ in imports(source)
        for why in reasons(module, name)
    ]


def reasons(module: str, name: str) -> Iterator[str]:
    """Why a module may not import what it does."""
    top = name.partition(".")[0]
    if name.startswith("."):
        yield "relatively; write palpate...."
    elif top in BANNED:
        yield "which runs what it reads"
    elif top in CLOCK_MODULES and not module.startswith(CLOCKS):
        yield "but only the runtime, the bus and what starts graphs read a clock"
    elif top == "palpate":
        yield from own_reasons(module, name)
    elif top not in sys.stdlib_module_names:
        home = max((home for home in LIBRARIES if within(module, home)), key=len)
        if top not in LIBRARIES[home]:
            yield f"which {home} may not"


def own_reasons(module: str, name: str) -> Iterator[str]:
    """Why a module may not import another of palpate's."""
    mine, other = layer_of(module), layer_of(name)
    if other in LAYERS and LAYERS.index(other) > LAYERS.index(mine):
        yield f"but nothing imports upwards from {mine} to {other}"
    if mine != other and {mine, other} in BESIDE:
        yield f"but {mine} and {other} know nothing of each other"
    room = name.rpartition(".")[0]
    if name not in ROOMS and room in DOORS and not within(module, room):
        yield f"past its room; take it from {room}"
    if is_node(name) and is_node(module) and name != module:
        yield "but a node never imports a node"


def layer_of(module: str) -> str:
    return module.split(".")[1] if "." in module else module


def is_node(module: str) -> bool:
    """True of a module that is started by its name."""
    return module.rpartition(".")[0] == "palpate.nodes" and module not in ROOMS


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def circles(edges: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """Every way around that the edges leave open, each from one of its places back to it."""
    found: list[list[str]] = []
    done: set[str] = set()

    def follow(way: list[str]) -> None:
        for after in sorted(edges.get(way[-1], ())):
            if after in way:
                found.append([*way[way.index(after) :], after])
            elif after not in done:
                follow([*way, after])
        done.add(way[-1])

    for start in sorted(edges):
        if start not in done:
            follow([start])
    return found


def rooms_used(sources: Mapping[str, str]) -> dict[str, set[str]]:
    """For each room the other rooms that it imports when it is imported, but those that hold it."""
    edges: dict[str, set[str]] = {}
    for module, source in sources.items():
        room = module.rpartition(".")[0]
        for _, name, at_once in imports(source):
            other = name if name in ROOMS else name.rpartition(".")[0]
            apart = not within(room, other) and not within(other, room)
            if at_once and other in ROOMS and apart:
                edges.setdefault(room, set()).add(other)
    return edges


def test_no_module_imports_what_it_may_not() -> None:
    found = [fault for name, path in MODULES.items() for fault in faults(name, path.read_text())]

    assert found == []
    assert {layer_of(name) for name in MODULES} == set(LAYERS)


def test_no_rooms_import_each_other_in_a_circle() -> None:
    edges = rooms_used({name: path.read_text() for name, path in MODULES.items()})

    assert len(edges) > 20
    assert circles(edges) == []
    ring = ["a", "b", "c", "a"]  # is found
    assert circles({before: {after} for before, after in pairwise(ring)}) == [ring]
    assert circles({"a": {"b", "c"}, "b": {"c"}}) == []


def test_no_room_exports_the_name_of_one_of_its_modules() -> None:
    """Whichever is imported first would be what the name means."""
    for room in ROOMS:
        path = MODULES[f"{room}.__init__"]
        exported = {
            alias.name
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        inside = {path.stem for path in path.parent.glob("*.py")}
        assert not exported & inside, room


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("palpate.core.poses", "import palpate.messages.codec"),
        ("palpate.core.poses", "from palpate import nodes"),
        ("palpate.core.poses", "import zmq"),
        ("palpate.core.poses", "import trimesh"),
        ("palpate.core.poses", "def f():\n    import msgspec"),
        ("palpate.core.poses", "import time"),
        ("palpate.core.poses", "from datetime import datetime"),
        ("palpate.core.poses", "from .arrays import Floats"),
        ("palpate.core.splines.bases", "from palpate.core.shapes.polyhedra import Polyhedron"),
        ("palpate.messages.codec", "from palpate.core import poses"),
        ("palpate.messages.codec", "import zmq"),
        ("palpate.messages.codec", "import pickle"),
        ("palpate.nodes.filter", "from palpate.nodes.curvature import NODE"),
        ("palpate.nodes.filter", "from palpate.nodes import curvature"),
        ("palpate.nodes.filter", "from palpate.launch import graph"),
        ("palpate.nodes.filter", "import time"),
        ("palpate.nodes.filter", "import trimesh"),
        ("palpate.nodes.runtime.loop", "import zmq"),
        ("palpate.launch.graph", "import dill"),
        ("palpate.launch.graph", "from palpate.tools import cost"),
        ("palpate.tools.cost", "from palpate.bench import table"),
    ],
)
def test_each_rule_fires(module: str, source: str) -> None:
    assert len(faults(module, source)) >= 1


ALLOWED = (
    ("palpate.core.shapes.polyhedra", "import trimesh"),
    ("palpate.messages.bus.node_sockets", "import zmq, time"),
    ("palpate.nodes.filter", "from palpate.nodes.runtime import Node"),
    ("palpate.nodes.runtime.work", "from palpate.nodes.runtime.loop import run"),
    ("palpate.nodes.runtime.loop", "import time"),
    ("palpate.launch.graph", "from palpate.nodes import planner"),
    ("palpate.launch.launcher", "import zmq"),
)


def test_what_is_allowed_is_let_through() -> None:
    assert [fault for case in ALLOWED for fault in faults(*case)] == []
