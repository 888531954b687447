"""Damaged saved solids: an NPZ file hurt in its bytes, its arrays, or the text of its form."""

from __future__ import annotations

import io
import json
import random
import zipfile
from functools import cache
from typing import Any

import numpy as np

from palpate.core.archive import FORM, to_arrays
from palpate.launch.damage.meshes import File
from palpate.launch.damage.spans import FLOATS, NUMBERS, damaged
from palpate.launch.damage.trees import Tree, places, value_at, with_value
from palpate.launch.damage.turns import bomb_of

NAME = "solid.npz"

Arrays = dict[str, Any]


def damaged_solid(rng: random.Random, number: int) -> File:
    """The bomb whose turn it is, or a sound solid with damage."""
    if (bomb := bomb_of(number, solid_bombs())) is not None:
        return File(NAME, bomb)
    arrays = _arrays()
    change = rng.random()
    if change < 0.3:
        return File(NAME, damaged(rng, npz(arrays)))
    if change < 0.65:
        return File(NAME, npz(_hurt_form(rng, arrays)))
    return File(NAME, npz(_hurt_array(rng, arrays)))


def sound_solid() -> bytes:
    """A saved solid."""
    return npz(_arrays())


@cache
def _arrays() -> Arrays:
    from palpate.core.rebuild.reconstruct import reconstruct

    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    x, y = 0.03 * np.cos(turns), 0.02 * np.sin(turns)
    rings = [np.stack([x, y, np.full(24, z)], axis=1) for z in (0.0, 0.01, 0.02, 0.03)]
    return to_arrays(reconstruct(rings))


def npz(arrays: Arrays) -> bytes:
    """An NPZ file of arrays."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)
    return file.getvalue()


def _hurt_form(rng: random.Random, arrays: Arrays) -> Arrays:
    form = json.loads(str(arrays[FORM]))
    path = rng.choice(places(form))
    old = value_at(form, path)
    others: tuple[Tree, ...] = (
        None,
        True,
        "x",
        [],
        {},
        *NUMBERS,
        *FLOATS[:5],
        {"tuple": []},
        {"list": [old, old]},
        {"same": "solid"},
        {"array": rng.choice(list(arrays))},
        {"scalar": rng.choice(list(arrays))},
        {"class": "rebuild.solid.Solid", "fields": {}},
        value_at(form, rng.choice(places(form))),
    )
    text = json.dumps(with_value(form, path, rng.choice(others)))
    return {**arrays, FORM: np.array(text)}


def _hurt_array(rng: random.Random, arrays: Arrays) -> Arrays:
    name = rng.choice([name for name in arrays if name != FORM])
    old = arrays[name]
    with np.errstate(all="ignore"):
        others = (
            old.ravel(),
            old[..., None],
            old.T,
            old[:0] if old.ndim else old,
            old[: old.shape[0] // 2] if old.ndim else old,
            np.zeros_like(old),
            np.full(old.shape, np.nan),
            np.full(old.shape, np.inf),
            np.full(old.shape, 1e300),
            np.full(old.shape, -(2**31)),
            old.astype(np.complex128),
            old.astype("<U8"),
            old.astype(bool),
            np.array(1.0),
            arrays[rng.choice(list(arrays))],
        )
    return {**arrays, name: rng.choice(others)}


@cache
def solid_bombs() -> list[bytes]:
    """Files that were made to hurt."""
    deep: Tree = None
    for _ in range(400):
        deep = {"tuple": [deep, None]}
    twice: list[Tree] = [{"tuple": [1, 1]}]
    twice += [{"tuple": [{"same": f"solid/{i}"}] * 2} for i in range(60)]
    return [
        _form({"tuple": twice}),
        _form(deep),
        npz({FORM: np.array('{"version": 1' + "0" * 4000 + ', "tree": null}')}),
        npz({FORM: np.array("[" * 100_000)}),
        npz({FORM: np.array("9" * 5000)}),
        _packed("x", bytes(63 << 20)),
        _packed("x", _header("(1000000000000,)")),
        _packed("x", _header("(9223372036854775807, 9223372036854775807)")),
        _packed("x", _header("(-1,)")),
        _packed("x", _header("()", "|O")),
        _packed("x", _header("(1,)", "x" * 60_000)),
        _packed("x", _header("(" * 5000 + ")" * 5000)),
        _packed("form", b"\x93NUMPY\x09\x00"),
        b"PK\x05\x06" + bytes(18),
        b"",
    ]


def _form(tree: Tree) -> bytes:
    return npz({FORM: np.array(json.dumps({"version": 1, "tree": tree}))})


def _header(shape: str, kind: str = "<f8") -> bytes:
    text = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x02\x00" + len(text).to_bytes(4, "little") + text


def _packed(name: str, content: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as parts:
        parts.writestr(f"{name}.npy", content)
    return file.getvalue()
