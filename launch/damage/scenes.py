"""Damaged scenes: bombs, and the shipped ones, hurt as bytes, as text or as values."""

from __future__ import annotations

import json
import random
from functools import cache

from palpate.launch.damage.meshes import File
from palpate.launch.damage.scene_bombs import NAMES, scene_bombs
from palpate.launch.damage.spans import FLOATS, NUMBERS, damaged
from palpate.launch.damage.text import WORDS, damaged_text
from palpate.launch.damage.trees import Tree, places, value_at, with_value
from palpate.launch.damage.turns import bomb_of
from palpate.launch.scene import SHIPPED, shipped_scenes
from palpate.launch.yaml_file import parse_yaml

NAME = "scene.yaml"
_MARKS = (b"&a", b"*a", b"!!str", b"[", b"]", b"{", b"}", b"- ", b"? ", b"|", b"'", b'"', b"%")
_DEEP: Tree = json.loads("[" * 30 + "]" * 30)


def damaged_scene(rng: random.Random, number: int) -> File:
    """The bomb whose turn it is, or a shipped scene with damage."""
    if (bomb := bomb_of(number, scene_bombs())) is not None:
        return File(NAME, bomb)
    scenes = sound_scenes()
    text = rng.choice(scenes)
    change = rng.random()
    if change < 0.15:
        return File(NAME, damaged(rng, text, rng.choice(scenes)))
    if change < 0.45:
        return File(NAME, damaged_text(rng, text, (*WORDS, *_MARKS)))
    return File(NAME, _hurt_value(rng, text))


@cache
def sound_scenes() -> tuple[bytes, ...]:
    """The shipped scenes, with a mesh that is in the folder."""
    texts = ((SHIPPED / f"{name}.yaml").read_bytes() for name in shipped_scenes())
    return tuple(text.replace(b"pear.ply", b"mesh.ply") for text in texts)


def _hurt_value(rng: random.Random, text: bytes) -> bytes:
    """A scene that says something else somewhere; JSON is YAML, too."""
    tree = parse_yaml(text.decode(), NAME).value
    for _ in range(rng.choice((1, 1, 2))):
        path = rng.choice(places(tree))
        tree = with_value(tree, path, _other(rng, value_at(tree, path)))
    return json.dumps(tree, indent=rng.choice((None, 1))).encode()


def _other(rng: random.Random, old: Tree) -> Tree:
    """Near what was there more often than not, so that it comes far."""
    if isinstance(old, (int, float)) and rng.random() < 0.6:
        return old * rng.choice((-1.0, 0.0, 0.5, 0.9, 1.1, 2.0, 10.0, 1000.0))
    if isinstance(old, list) and old and rng.random() < 0.6:
        return rng.choice((old[:-1], [*old, old[0]], old[::-1], old * 2, old * 40, []))
    if isinstance(old, dict) and old and rng.random() < 0.6:
        key = rng.choice(list(old))
        rest = {name: item for name, item in old.items() if name != key}
        return rng.choice((rest, {**rest, f"{key}s": old[key]}, {**old, "more": 1}, {"x": old}))
    others: tuple[Tree, ...] = (
        None,
        True,
        "",
        "x",
        rng.choice(NAMES),
        [],
        {},
        _DEEP,
        [old] * 3,
        {"a": old},
        "x" * 5000,
        *NUMBERS,
        *FLOATS,
    )
    return rng.choice(others)
