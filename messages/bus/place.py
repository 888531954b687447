"""Where a node finds the others: the addresses of one run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

DEPTH = 1000
"""Most messages in a queue between two nodes, unless the launch says otherwise."""
LAUNCHER = "launcher"
"""Name under which the launcher hears topics; no node may bear it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """The addresses of one run, the same for all its nodes."""

    run: int
    """Number of the run, 64 bits."""
    epoch: int
    """Counts the starts of this node."""
    depth: int
    """Most messages in a queue between two nodes."""
    endpoints: Mapping[str, str]
    """Name of the node to the address of its reliable topics."""
    taps: Mapping[str, str]
    """Name of the node to the address of its tap."""
    control: str
    """Address at which the launcher listens to the nodes."""
    tools: str
    """Address at which the launcher answers tools."""
    journals: Mapping[str, str]
    """Name of the node to the file in which it puts down what it consumes."""
    times: Mapping[str, str]
    """Name of the node to the file in which it puts down when it said what."""
    pasts: Mapping[str, str]
    """Name of the node to the file in which it keeps what it said and has no memory for."""
    key: str = ""
    """File of the secret key with which all sockets are locked; empty within one machine."""
    ahead_ns: int = 0
    """How far the launcher's clock is ahead of this machine's, ns."""
    going: bool = False
    """Whether the graph had been started when this node was started again."""
