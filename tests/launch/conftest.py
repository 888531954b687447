from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

import pytest
from msgspec import Struct

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.files.yaml_file import parse_yaml
from palpate.nodes.runtime.node import Node

MakeNode = Callable[..., str]


class NoParams(Struct, frozen=True, kw_only=True):
    pass


def _quiet(params: Any, state: Any, message: Any) -> tuple[Any, list[Any]]:
    return state, []


@pytest.fixture
def make_node(monkeypatch: pytest.MonkeyPatch) -> MakeNode:
    """Puts a node that does nothing where it can be imported; gives the module's name."""

    def make(
        module: str,
        inputs: Mapping[str, type] | None = None,
        outputs: Mapping[str, type] | None = None,
        params: type = NoParams,
        fan_in: tuple[str, ...] = (),
        shared: tuple[str, ...] = (),
        value: object = None,
    ) -> str:
        node = Node(
            params=params,
            start=lambda _: (None, []),
            inputs={topic: (said, _quiet) for topic, said in (inputs or {}).items()},
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
def typed() -> Callable[[str], SourceMapped]:
    """A YAML text as a document with places."""
    return lambda text: parse_yaml(text, "f.yaml")
