"""One node as a launch file describes it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from palpate.launch.located import InputError, KeyPath, Located
from palpate.nodes.wiring import OnExit

KINDS = "palpate.nodes"
"""A kind without a dot is a module of this package."""


_FINGER = re.compile(r"finger_([1-9])")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A node's name, kind, parameters and place, not yet checked."""

    name: str
    """Name in the graph: lower case, digits and ``_``."""
    kind: str = ""
    """A module of ``palpate.nodes``, ``module:NODE`` (or SINK, SOURCE) or a dotted module of one's
    own; the name if empty."""
    params: Any = field(default_factory=dict)
    """Map of plain values, or an instance of the node's own parameter type."""
    remap: Mapping[str, str] = field(default_factory=dict)
    """Topic as the node calls it, to the topic on the wire; a namespace does not touch it."""
    namespace: str = ""
    """Put before the node's topics: ``finger_1`` makes ``/finger_1/touch/raw``, except of those
    that the node shares with the other fingers'."""
    host: str = ""
    """Address of the machine on which it runs, ``192.168.1.5`` or ``lab2:7447``; empty for this."""
    nice: int = 0
    """How far its process stands back when the processor is busy, from 0 to 19."""
    on_exit: OnExit = "restart"
    """What is done when its process dies: start it again, stop the run, or go on without it."""
    source: str = ""
    """``file:line`` of the description."""
    places: Mapping[KeyPath, str] = field(default_factory=dict)
    """``file:line``, or the option, of single parameters."""

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
    def settings(self) -> Located:
        """The parameters, each with the place at which it was set."""
        return Located(self.params, self.source, self.places)

    def error(self, text: str) -> InputError:
        """A complaint about this node."""
        place = f"{self.source}: " if self.source else ""
        return InputError(f"{place}node {self.name!r}: {text}")
