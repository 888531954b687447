"""Places in values that are made of maps and lists, and other values put there."""

from __future__ import annotations

from typing import Any

Tree = Any
"""Maps, lists, texts, bytes and numbers."""
Place = tuple[str | int, ...]
FIRST = 8
"""Entries of a list that are looked at."""


def places(tree: Tree, path: Place = ()) -> list[Place]:
    """Paths of a value and of all within it."""
    found: list[Place] = [path]
    if isinstance(tree, dict):
        for key, item in tree.items():
            found += places(item, (*path, key))
    elif isinstance(tree, list):
        for i, item in enumerate(tree[:FIRST]):
            found += places(item, (*path, i))
    return found


def value_at(tree: Tree, path: Place) -> Tree:
    """The value in a place."""
    for key in path:
        tree = tree[key]
    return tree


def with_value(tree: Tree, path: Place, new: Tree) -> Tree:
    """The tree with another value in this place."""
    if not path:
        return new
    if isinstance(tree, dict):
        return {**tree, path[0]: with_value(tree[path[0]], path[1:], new)}
    return [with_value(one, path[1:], new) if i == path[0] else one for i, one in enumerate(tree)]
