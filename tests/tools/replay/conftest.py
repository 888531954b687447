"""Toy nodes in the place of modules, and descriptions of the graphs that they make."""

import sys
from types import ModuleType

import msgspec
import pytest

from palpate.nodes.runtime.node import Input, Wiring, describe_wirings


class NoParams(msgspec.Struct, frozen=True):
    """Parameters of a node that has none."""


@pytest.fixture
def module(monkeypatch):
    """Puts a node where it can be imported."""

    def put(name, node):
        made = ModuleType(name)
        made.NODE = node
        monkeypatch.setitem(sys.modules, name, made)

    return put


def wiring(name, kind, params, inputs, **outputs) -> Wiring:
    """A node whose inputs are a publisher, a topic and its type; its outputs by local name."""
    local = {"/a": "/in", "/b": "/in"}  # what a chain of nodes hands on
    heard = tuple(Input(who, topic, local.get(topic, topic), of) for who, topic, of in inputs)
    published = {f"/{name}": topic for name, topic in outputs.items()}
    how = {"inputs": heard, "outputs": published, "subscribers": {}}
    return Wiring(name=name, module=kind, params=params, **how)


def describe(*wirings: Wiring) -> dict[str, str]:
    """What a recording says of its graph."""
    return {"graph": describe_wirings(wirings).decode()}
