import sys
from types import ModuleType

import pytest
from msgspec import Struct

from palpate.launch.files.yaml_file import parse_yaml
from palpate.nodes.runtime.node import Node


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
