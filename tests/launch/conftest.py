"""Nodes that do nothing, YAML with its places, and a machine that is the same everywhere."""

import sys
from types import ModuleType

import pytest
from msgspec import Struct

from palpate.launch.files.yaml_file import parse_yaml
from palpate.nodes.runtime.node import Node


@pytest.fixture(autouse=True)
def _machine(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path_factory.mktemp("home")))
    monkeypatch.setenv("TERM", "dumb")
    for name in ("COLUMNS", "FORCE_COLOR", "NO_COLOR", "PALPATE_GRAPH"):
        monkeypatch.delenv(name, raising=False)


class NoParams(Struct, frozen=True, kw_only=True):
    pass


def _quiet(params, state, message):
    return state, []


@pytest.fixture
def make_node(monkeypatch):
    """Puts a node that does nothing where it can be imported; gives the module's name."""

    def make(module, inputs=None, outputs=None, params=NoParams, fan_in=(), shared=(), value=None):
        node = Node(
            params=params,
            start=lambda _: (None, []),
            inputs={topic: (told, _quiet) for topic, told in (inputs or {}).items()},
            outputs=outputs or {},
            fan_in=fan_in,
            shared=shared,
        )
        made = ModuleType(module)
        made.NODE = node if value is None else value  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module, made)
        return module

    return make


@pytest.fixture
def typed():
    """A YAML text as a document with places."""
    return lambda text: parse_yaml(text, "f.yaml")
