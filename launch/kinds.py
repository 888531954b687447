"""Which kinds of node there are, and the node behind a kind."""

from __future__ import annotations

import pkgutil
import re
import sys
from importlib.util import find_spec
from pathlib import Path

from msgspec import structs

import palpate.nodes
from palpate.launch.entry import KINDS, Entry
from palpate.launch.nearest import hint
from palpate.launch.own_modules import look_here
from palpate.nodes.node import AnyNode, Sink, Source
from palpate.nodes.wiring import load_node

HELD = ("NODE", "SOURCE", "SINK")
"""What a module may hold a node as."""
_HOLDS_NODE = re.compile(rf"^({'|'.join(HELD)})\b.*=", re.MULTILINE)


def kinds() -> tuple[str, ...]:
    """Names of the nodes that palpate has, found without importing one."""
    names = (module.name for module in pkgutil.iter_modules(palpate.nodes.__path__))
    return tuple(sorted(name for name in names if _holds_node(f"{KINDS}.{name}")))


def node_of(entry: Entry) -> AnyNode:
    """The node that an entry asks for.

    Raises
    ------
    InputError
        If there is no such kind, or its module holds no node, or cannot be imported.
    """
    kind = entry.kind or entry.name
    _, mark, held = kind.partition(":")
    if mark and held not in HELD:
        raise entry.error(f"kind is {kind!r}; a module of one's own is named as module:NODE")
    look_here(kind)
    try:
        node = load_node(entry.module)
    except ValueError as error:
        if mark or "." in kind or kind in kinds():
            raise entry.error(str(error)) from None
        raise entry.error(f"there is no kind of node {kind!r}; {hint(kind, kinds())}") from None
    except Exception as error:  # a module of one's own may break in any way
        what = next(iter(str(error).splitlines()), "")
        text = f"module {entry.module!r} breaks: {type(error).__name__}: {what}"
        raise entry.error(text) from None
    if mark and getattr(sys.modules[entry.module], held, None) is not node:
        raise entry.error(f"module {entry.module!r} holds no {held}")
    return node


def describe_kind(kind: str) -> str:
    """What a node of this kind hears, says and takes, as a text.

    Raises
    ------
    InputError
        If there is no such kind.
    """
    node = node_of(Entry(name=kind, kind=kind))
    lines = [kind]
    if isinstance(node, Sink):
        lines.append("  hears everything")
    elif isinstance(node, Source):
        lines.append("  hears nothing; its parameters say what it says")
    else:
        lines += [f"  hears {topic}  {said.__name__}" for topic, (said, _) in node.inputs.items()]
        lines += [f"  says  {topic}  {said.__name__}" for topic, said in node.outputs.items()]
    for field in structs.fields(node.params):
        need = "required" if field.required else f"default {_default(field)!r}"
        lines.append(f"  takes {field.encode_name}  {need}")
    return "\n".join(lines)


def _default(field: structs.FieldInfo) -> object:
    return field.default_factory() if callable(field.default_factory) else field.default


def _holds_node(module: str) -> bool:
    spec = find_spec(module)
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return False
    return _HOLDS_NODE.search(Path(spec.origin).read_text(encoding="utf-8")) is not None
