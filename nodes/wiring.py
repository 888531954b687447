"""One node's place in a graph: who publishes what it hears, and who hears what it publishes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Literal

from palpate.nodes.node import LONGEST, AnyNode, Node, Sink, Source

OnExit = Literal["restart", "stop", "ignore"]
"""What is done when a node dies: it is started again, the run ends, or it goes on without."""


@dataclass(frozen=True, slots=True)
class Input:
    """One edge of the graph, seen from its hearing end."""

    publisher: str
    """Name of the node that publishes the topic."""
    topic: str
    """The topic on the wire, with namespace and remapping applied."""
    local: str
    """The topic as the node calls it."""
    type: str
    """Name of the message type."""
    schema: str = ""
    """JSON schema of a type that palpate does not have; empty of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wiring:
    """Everything that a process must know to run its node."""

    name: str
    """Name of the node in the graph."""
    module: str
    """Module that holds ``NODE``, ``SOURCE`` or ``SINK``."""
    params: Any
    """Parameters: an instance of the node's own type."""
    inputs: tuple[Input, ...]
    """What it hears."""
    outputs: Mapping[str, str]
    """The topic as the node calls it, to the topic on the wire."""
    listeners: Mapping[str, tuple[str, ...]]
    """Topic on the wire to the names of those who hear it."""
    types: Mapping[str, str] = field(default_factory=dict)
    """Topic on the wire to the name of its message type."""
    host: str = ""
    """Address of the machine on which it runs; empty for the launcher's."""
    nice: int = 0
    """How far its process stands back when the processor is busy, from 0 to 19."""
    on_exit: OnExit = "restart"
    """What is done when it dies."""
    longest: float = LONGEST
    """Longest time for which it may give no sign of life though it works, s."""
    keeps: bool = False
    """Whether what it says is kept beyond its death, for it could not say it again."""


def load_node(module: str) -> AnyNode:
    """The node that a module holds.

    Raises
    ------
    ValueError
        If there is no such module or it holds no node.
    """
    if not all(part.isidentifier() for part in module.split(".")):
        raise ValueError(f"{module!r} is no name of a module")
    try:
        found = import_module(module)
    except ModuleNotFoundError as error:
        raise ValueError(f"no module {module!r}: {error}") from None
    for name in ("NODE", "SOURCE", "SINK"):
        value = getattr(found, name, None)
        if isinstance(value, (Node, Source, Sink)):
            return value
    raise ValueError(f"module {module!r} holds no NODE, no SOURCE and no SINK")
