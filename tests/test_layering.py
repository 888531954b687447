"""Who may import whom, read off the source without running it."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LAYERS = ("core", "messages", "nodes", "launch")

CORE = {"palpate.core", "numpy", "scipy"}
MESSAGES = {"palpate.messages", "numpy", "msgpack"}
NODES = {"palpate.core", "palpate.messages", "palpate.nodes", "numpy", "msgspec"}
LAUNCH = {"palpate", "numpy", "msgspec", "ruamel", "click", "rich", "trimesh", "scipy"}

# The longest prefix of a module's name decides what it may import beside the standard library.
ALLOWED = {
    "palpate.core": CORE,
    "palpate.core.shapes": CORE | {"trimesh", "embreex", "manifold3d"},
    "palpate.core.measure": CORE | {"trimesh", "embreex"},
    "palpate.messages": MESSAGES,
    "palpate.messages.bus": MESSAGES | {"zmq"},
    "palpate.messages.recording": MESSAGES | {"mcap", "lz4", "zstandard"},
    "palpate.nodes": NODES,
    "palpate.nodes.composed": NODES | {"threadpoolctl"},
    "palpate.launch": LAUNCH,
    "palpate.launch.bag": LAUNCH | {"mcap"},
    "palpate.launch.replay": LAUNCH | {"threadpoolctl"},
    "palpate.launch.one_thread": LAUNCH | {"threadpoolctl"},
    "palpate.launch.launcher": LAUNCH | {"zmq"},
    "palpate.launch.processes": LAUNCH | {"zmq"},
    "palpate.launch.hosts": LAUNCH | {"zmq"},
    "palpate.launch.looking": LAUNCH | {"zmq"},
    "palpate.launch.chaos.history": LAUNCH | {"mcap"},
    "palpate.launch.chaos.causes": LAUNCH | {"msgpack"},
    "palpate.launch.chaos.injector": LAUNCH | {"zmq"},
    "palpate.launch.chaos.onlooker": LAUNCH | {"zmq"},
    "palpate.launch.bench_reliability": LAUNCH | {"zmq"},
    "palpate.launch.poisson_peer": LAUNCH | {"pymeshlab"},
    "palpate.launch.bench_bus": LAUNCH | {"zmq"},
    "palpate.launch.bench_bare": LAUNCH | {"zmq"},
    "palpate.launch.damage": LAUNCH | {"msgpack", "lz4"},
    "palpate.launch.figures_curvature": LAUNCH | {"matplotlib"},
    "palpate.launch.figures_peers": LAUNCH | {"matplotlib", "mpl_toolkits"},
    "palpate.launch.figures_rebuild": LAUNCH | {"matplotlib", "mpl_toolkits"},
    "palpate.launch.figures_shapes": LAUNCH | {"matplotlib", "mpl_toolkits"},
}

CLOCKS = (
    "palpate.nodes.runtime",
    "palpate.nodes.composed",
    "palpate.messages.bus",
    "palpate.launch",
)
"""Modules that may read a clock begin like this; for all others there is robot time alone."""
CLOCK_MODULES = frozenset({"time", "datetime"})

SHARED = (
    "node",
    "wiring",
    "ending",
    "object",
    "object_units",
    "object_superquadric",
    "object_models",
    "object_solid",
    "object_boolean",
    "sensor",
    "planner_decide",
    "planner_ends",
    "planner_grasp",
    "planner_state",
    "reconstructor_set",
    "shape_model",
    "effects",
    "composed",
    "recording",
    "testing",
    "testing_messages",
    "testing_recorded",
    "driver_frames",
    "frame_row",
    "frames_file",
)
"""Modules of ``nodes`` that are no node; any of them may be imported by a node."""

BANNED = frozenset({"pickle", "marshal", "shelve", "dill"})


def imports(source: str) -> Iterator[tuple[int, str]]:
    """Line and full name of everything that a source imports, wherever it does."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, name.name) for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.lineno, "." * node.level + (node.module or "")
            if node.module in ("palpate", *(f"palpate.{layer}" for layer in LAYERS)):
                yield from ((node.lineno, f"{node.module}.{name.name}") for name in node.names)


def faults(module: str, source: str) -> list[str]:
    """What a module imports although it may not."""
    home = max((home for home in ALLOWED if within(module, home)), key=len)
    found = []
    for line, name in imports(source):
        top = name.partition(".")[0]
        if name.startswith("."):
            found.append(f"{module}:{line}: imports relatively; write palpate....")
        elif top in BANNED:
            found.append(f"{module}:{line}: imports {name}, which runs what it reads")
        elif top in CLOCK_MODULES and not module.startswith(CLOCKS):
            found.append(f"{module}:{line}: imports {name}; only the runtime reads a clock")
        elif top in sys.stdlib_module_names or name in ("palpate", "palpate.__version__"):
            continue
        elif not any(within(name, allowed) for allowed in ALLOWED[home]):
            found.append(f"{module}:{line}: imports {name}, which {home} may not")
        elif is_other_node(module, name):
            found.append(f"{module}:{line}: imports {name}; a node never imports a node")
    return found


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def is_other_node(module: str, name: str) -> bool:
    if not within(module, "palpate.nodes") or not name.startswith("palpate.nodes."):
        return False
    wanted, own = name.split(".")[2], module.split(".")[2]
    runtime = wanted.startswith("runtime") and own.startswith(
        ("runtime", "composed", "replay", "testing")
    )
    return wanted not in SHARED and wanted != own and not runtime


def modules() -> list[tuple[str, Path]]:
    found = []
    for layer in LAYERS:
        for path in sorted((ROOT / layer).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            if "scenes" not in parts:
                found.append((".".join(("palpate", *parts)).removesuffix(".__init__"), path))
    return found


def test_no_module_imports_what_its_layer_may_not() -> None:
    found = [fault for name, path in modules() for fault in faults(name, path.read_text())]

    assert found == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("palpate.core.frames", "import palpate.messages.codec"),
        ("palpate.core.frames", "from palpate import nodes"),
        ("palpate.core.frames", "import zmq"),
        ("palpate.core.frames", "import trimesh"),
        ("palpate.core.frames", "def f():\n    import msgspec"),
        ("palpate.core.frames", "import time"),
        ("palpate.core.frames", "from datetime import datetime"),
        ("palpate.core.frames", "from .arrays import Floats"),
        ("palpate.messages.codec", "from palpate.core import frames"),
        ("palpate.messages.codec", "import zmq"),
        ("palpate.messages.codec", "import pickle"),
        ("palpate.nodes.filter", "from palpate.nodes.curvature import NODE"),
        ("palpate.nodes.filter", "from palpate.nodes import curvature"),
        ("palpate.nodes.filter", "from palpate.nodes.runtime import run"),
        ("palpate.nodes.filter", "from palpate.launch import graph"),
        ("palpate.nodes.filter", "import time"),
        ("palpate.nodes.filter", "import trimesh"),
        ("palpate.nodes.runtime", "import zmq"),
        ("palpate.launch.graph", "import zmq"),
        ("palpate.launch.graph", "import core.frames"),
        ("palpate.launch.graph", "import dill"),
    ],
)
def test_each_rule_fires(module: str, source: str) -> None:
    assert len(faults(module, source)) >= 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("palpate.core.shapes.mesh", "import trimesh"),
        ("palpate.messages.bus.tap", "import zmq, time"),
        ("palpate.nodes.filter", "from palpate.nodes.node import Node"),
        ("palpate.nodes.runtime_work", "from palpate.nodes.runtime import run"),
        ("palpate.nodes.runtime", "import time"),
        ("palpate.launch.graph", "from palpate.nodes.planner import Params"),
        ("palpate.launch.launcher", "import zmq"),
    ],
)
def test_what_is_allowed_is_let_through(module: str, source: str) -> None:
    assert faults(module, source) == []


def test_every_layer_has_modules_to_judge() -> None:
    assert {name.split(".")[1] for name, _ in modules()} == set(LAYERS)
