"""Damaged mesh files: bombs, and samples of every format, damaged by seeds."""

from __future__ import annotations

import json
import random
from typing import NamedTuple

from palpate.launch.damage.mesh_bombs import mesh_bombs
from palpate.launch.damage.mesh_samples import glb, gltf_of, sound_meshes
from palpate.launch.damage.spans import FLOATS, NUMBERS, damaged
from palpate.launch.damage.text import damaged_text
from palpate.launch.damage.trees import Tree, places, value_at, with_value
from palpate.launch.damage.turns import bomb_of

OTHERS: tuple[Tree, ...] = (
    None,
    True,
    "x",
    [],
    {},
    -1,
    2**31,
    2**53,
    1e308,
    "VEC3",
    [[]],
    5126,
    5123,
)
"""Put in the place of values of a description."""


class File(NamedTuple):
    """A file to read."""

    name: str
    data: bytes


def damaged_mesh(rng: random.Random, number: int) -> File:
    """The bomb whose turn it is, or a sample with damage."""
    if (bomb := bomb_of(number, list(mesh_bombs().items()))) is not None:
        return File(*bomb)
    samples = sound_meshes()
    name = rng.choice(list(samples))
    data = samples[name]
    if name.startswith(("text", "plain")) and not name.endswith("glb") and rng.random() < 0.7:
        return File(name, damaged_text(rng, data))
    if name.endswith("glb") and rng.random() < 0.6:
        return File(name, _damaged_glb(rng, data))
    if name.endswith("ply") and rng.random() < 0.5:
        return File(name, _damaged_head(rng, data))
    return File(name, damaged(rng, data, samples[rng.choice(list(samples))]))


def _damaged_head(rng: random.Random, data: bytes) -> bytes:
    """A PLY file whose header alone is hurt."""
    size = data.index(b"end_header\n") + len(b"end_header\n")
    return damaged_text(rng, data[:size]) + data[size:]


def _damaged_glb(rng: random.Random, data: bytes) -> bytes:
    """A GLB file whose description has another value somewhere, and whose lengths agree."""
    described, held = gltf_of(data)
    path = rng.choice(places(described))
    old = value_at(described, path)
    values = (*OTHERS, *NUMBERS, *FLOATS, [old, old], {"a": old})
    described = with_value(described, path, rng.choice(values))
    text = json.dumps(described).encode()
    return glb(damaged_text(rng, text) if rng.random() < 0.2 else text, held)
