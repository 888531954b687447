"""Damaged scenes and saved solids.

Files that hold trees of values, hurt as bytes, as text, or in one of their values.
"""

from __future__ import annotations

import io
import json
import os
import random
import zipfile
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from palpate.bench.fuzz.meshes import valid_meshes
from palpate.bench.fuzz.mutations import (
    FLOATS,
    HOSTILE_WORDS,
    NUMBERS,
    InputFile,
    Tree,
    mutate_bytes,
    mutate_text,
    tree_paths,
    value_at,
    with_value,
)
from palpate.core import FORM_KEY, tree_to_arrays
from palpate.launch import SHIPPED_SCENES, shipped_scenes
from palpate.launch.files import load, parse_yaml
from palpate.tools import check_scene

SCENE_NAME = "scene.yaml"
_MARKS = (b"&a", b"*a", b"!!str", b"[", b"]", b"{", b"}", b"- ", b"? ", b"|", b"'", b'"', b"%")
_DEEP: Tree = json.loads("[" * 30 + "]" * 30)
# Files that a scene may name and should not.
HOSTILE_PATHS = (
    *("../outside.ply", "..", ".", "/etc/passwd", "//etc/passwd", "/dev/zero"),
    *("/proc/self/environ", "x/../../outside.ply", "passwd.ply", "loop.ply", "folder.ply"),
    *("pipe.ply", "empty.ply", "none.ply", "mesh.PLY", "mesh.ply/..", "a\\0b.ply"),
    *("a\\nb.ply", "\\ud800.ply", "~/mesh.ply", "file:///etc/passwd", "a" * 5000 + ".ply"),
    *("a/" * 3000 + "b.ply", "scene.yaml", ""),
)
# Files that are no text.
RAW = (b"", b"\0", b"\xff\xfeo\0b\0", b"object: \xff\n", b"object: \0\n", b"\x1f\x8b\x08\0")
BALL = "superquadric: {size: [0.03, 0.03, 0.03], exponents: [1.0, 1.0]}"
OBJECT = f"object: {{{BALL}}}\n"
SEEDS = ("0x" + "f" * 20_000, "9" * 4000, "9" * 5000, "1e400", "-1", "2001-01-01", "1:30", ".nan")
SIZES = (".inf", ".nan", "-1", "1e308", "1e-300", "'1'")
POWERS = ("0.02", "2.0", "1e-9", "1e9")
SOLID_NAME = "solid.npz"
Arrays = dict[str, Any]


def mutated_scenes(rng: random.Random) -> InputFile:
    """A shipped scene with damage."""
    scenes = [data for _, data in valid_scenes()]
    text = rng.choice(scenes)
    change = rng.random()
    if change < 0.15:
        return InputFile(SCENE_NAME, mutate_bytes(rng, text, rng.choice(scenes)))
    if change < 0.45:
        return InputFile(SCENE_NAME, mutate_text(rng, text, (*HOSTILE_WORDS, *_MARKS)))
    return InputFile(SCENE_NAME, _hurt_value(rng, text))


@cache
def hostile_scenes() -> list[InputFile]:
    """Scenes that were made to hurt."""
    texts = (*_paths(), *_forms(), *hostile_values())
    files = [*(one.encode(errors="surrogatepass") for one in texts), *RAW]
    return [InputFile(SCENE_NAME, data) for data in files]


def _paths() -> list[str]:
    meshes = [f'object: {{mesh: {{file: "{name}", unit: mm}}}}\n' for name in HOSTILE_PATHS]
    return meshes + [f'{OBJECT}sensor: {{calibration: "{name}"}}\n' for name in HOSTILE_PATHS]


def _forms() -> list[str]:
    """What is wrong with the text itself."""
    laughs = "a: &a [x, x, x, x, x, x, x, x, x]\n"
    for old, new in pairwise("abcdefghi"):
        laughs += f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n"
    return [
        laughs,
        "object: &o {o: *o}\n",
        f"base: &b {{{BALL}}}\nobject: {{<<: *b}}\n",
        f"object: {{<<: {{{BALL}}}}}\n",
        "object: !!python/object/apply:os.system ['true']\n",
        "object: !!binary aGVsbG8=\n",
        "object: !own {a: 1}\n",
        "%TAG ! tag:x,2000:\n---\nobject: 1\n",
        "%YAML 9.9\n---\nobject: 1\n",
        OBJECT + "---\n" + OBJECT,
        OBJECT + "...\n" + OBJECT,
        "object: " + "[" * 100_000,
        "object: " + "{a: " * 50_000,
        "".join("  " * i + "a:\n" for i in range(400)),
        "- " * 100_000,
        "? " * 100_000,
        "object: [" + "1," * 120_000 + "]\n",
        "object: {" + "".join(f"k{i}: 1, " for i in range(20_000)) + "}\n",
        "k" * 200_000 + ": 1\n",
        '"' + "k" * 200_000 + '": 1\n',
        'object: "' + "\\x41" * 60_000 + '"\n',
        "object: |\n" + "  x\n" * 60_000,
        "object: " + "a b " * 60_000,
        "# x\n" * 60_000,
        " " * 250_000,
        "\n" * 250_000,
        "\t" * 1000 + OBJECT,
        OBJECT + "object: 1\n",
        OBJECT.replace("size", "size: [1, 1, 1], size"),
        "\ufeff" + OBJECT,
        OBJECT + "\ufeff",
        OBJECT.replace("\n", "\r"),
        OBJECT + "\u0085seed: 1\u2028",
        OBJECT + '"\\ud800": 1\n',
        OBJECT + '"": 1\n',
        OBJECT + "? [1, 2]\n: 3\n",
        OBJECT + ".inf: 1\n",
        OBJECT + "x" * 300_000,
    ]


def hostile_values() -> list[str]:
    """What is wrong with its values."""
    return [
        *(f"{OBJECT}seed: {seed}\n" for seed in SEEDS),
        f"object: {{{BALL.replace('0.03', '0x' + 'f' * 400, 1)}}}\n",
        *(f"object: {{{BALL.replace('0.03', size)}}}\n" for size in SIZES),
        *(f"object: {{{BALL.replace('1.0', power)}}}\n" for power in POWERS),
        f"object: {{{BALL}, pose: {{position: [1e308, 1e308, 1e308]}}}}\n",
        f"object: {{{BALL}, lattice: [{', '.join(['{scale: 1.0}'] * 64)}]}}\n",
        f"object: {{{BALL}, lattice: [{', '.join(['{turn: 180}', '{scale: 0.1}'] * 8)}]}}\n",
        *_booleans(),
        "object: {polyhedron: {vertices: [" + "[0, 0, 0]," * 900 + "], faces: [[0, 1, 2]]}}\n",
        "object: {mesh: {file: mesh.ply, unit: mm}, " + BALL + "}\n",
        "object: {mesh: {file: mesh.ply, unit: ly}}\n",
        "object: {mesh: mesh.ply}\n",
        "object: {mesh: {file: [mesh.ply], unit: mm}}\n",
        OBJECT + "sensor: {calibration: gains.yaml}\n",
        OBJECT + "sensor: {calibration: 7}\n",
        OBJECT + "sensor: {rows: 64, cols: 64, pitch: 0.0002}\n",
        OBJECT + "effects: [" + "gaussian_noise, " * 1500 + "]\n",
        OBJECT + "effects: {gaussian_noise: 1}\n",
        OBJECT + "effects: [no_such_module_of_mine:Effect]\n",
        OBJECT + "effects: ['.:Effect', ':', 'a:', '..a:b']\n",
        OBJECT + "explore: {planner: 7}\n",
        OBJECT + "explore: {planner: no_such_module_of_mine:Planner}\n",
        OBJECT + "explore: {settings: [1]}\n",
        OBJECT + "explore: {axis: [0, 0, 0]}\n",
        OBJECT + "explore: {tolerance: .nan}\n",
        OBJECT + "explore: {" + ", ".join(f"a{i}: $(out)" for i in range(500)) + "}\n",
        "$(scene): 1\n",
        "object:\n",
        "object: $(scene)\n",
    ]


def _booleans() -> list[str]:
    small = BALL.replace("0.03", "0.01")
    row = ", ".join(f"{{{small}, pose: {{position: [0, 0, {i / 1000}]}}}}" for i in range(30))
    wide = ", ".join([f"{{union: [{row}]}}"] * 30)
    deep = BALL
    for _ in range(6):
        deep = f"complement: {{{deep}}}"
    trees = (
        f"union: [{row}]",
        f"union: [{wide}]",
        deep,
        f"intersection: [{{{BALL}}}, {{half_space: {{normal: [0, 0, 0]}}}}]",
    )
    return [f"object: {{boolean: {{{tree}}}}}\n" for tree in trees]


@cache
def valid_scenes() -> list[InputFile]:
    """The shipped scenes, with a mesh that is in the folder."""
    texts = ((SHIPPED_SCENES / f"{name}.yaml").read_bytes() for name in shipped_scenes())
    return [InputFile(SCENE_NAME, text.replace(b"pear.ply", b"mesh.ply")) for text in texts]


def _hurt_value(rng: random.Random, text: bytes) -> bytes:
    """A scene with other values somewhere; JSON is YAML, too."""
    tree = parse_yaml(text.decode(), SCENE_NAME).value
    for _ in range(rng.choice((1, 1, 2))):
        path = rng.choice(tree_paths(tree))
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
        rng.choice(HOSTILE_PATHS),
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


def fill_folder(folder: Path) -> None:
    """Put what scenes name into the folder where they lie."""
    (folder / "mesh.ply").write_bytes(dict(valid_meshes())["little.ply"])
    (folder / "empty.ply").touch()
    (folder / "folder.ply").mkdir()
    (folder / "passwd.ply").symlink_to("/etc/passwd")
    (folder / "loop.ply").symlink_to(folder / "loop.ply")
    os.mkfifo(folder / "pipe.ply")
    (folder / "gains.yaml").write_text(_calibration(16))


def _calibration(side: int) -> str:
    gain = [[1.0] * side] * side
    offset = [[0.0] * side] * side
    return f"gain: {gain}\noffset: {offset}\nsound_speed: 1000.0\nnoise: 1.0e-5\n"


def mutated_solids(rng: random.Random) -> InputFile:
    """A sound solid with damage."""
    arrays = _arrays()
    change = rng.random()
    if change < 0.3:
        return InputFile(SOLID_NAME, mutate_bytes(rng, npz(arrays)))
    if change < 0.65:
        return InputFile(SOLID_NAME, npz(_hurt_form(rng, arrays)))
    return InputFile(SOLID_NAME, npz(_hurt_array(rng, arrays)))


@cache
def hostile_solids() -> list[InputFile]:
    """Files that were made to hurt."""
    deep: Tree = None
    for _ in range(400):
        deep = {"tuple": [deep, None]}
    twice: list[Tree] = [{"tuple": [1, 1]}]
    twice += [{"tuple": [{"same": f"solid/{i}"}] * 2} for i in range(60)]
    files = [
        _form({"tuple": twice}),
        _form(deep),
        npz({FORM_KEY: np.array('{"version": 1' + "0" * 4000 + ', "tree": null}')}),
        npz({FORM_KEY: np.array("[" * 100_000)}),
        npz({FORM_KEY: np.array("9" * 5000)}),
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
    return [InputFile(SOLID_NAME, data) for data in files]


def _form(tree: Tree) -> bytes:
    return npz({FORM_KEY: np.array(json.dumps({"version": 1, "tree": tree}))})


def _packed(name: str, content: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as parts:
        parts.writestr(f"{name}.npy", content)
    return file.getvalue()


def _header(shape: str, kind: str = "<f8") -> bytes:
    text = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x02\x00" + len(text).to_bytes(4, "little") + text


def _hurt_form(rng: random.Random, arrays: Arrays) -> Arrays:
    form = json.loads(str(arrays[FORM_KEY]))
    path = rng.choice(tree_paths(form))
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
        value_at(form, rng.choice(tree_paths(form))),
    )
    text = json.dumps(with_value(form, path, rng.choice(others)))
    return {**arrays, FORM_KEY: np.array(text)}


def _hurt_array(rng: random.Random, arrays: Arrays) -> Arrays:
    name = rng.choice([name for name in arrays if name != FORM_KEY])
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


def valid_solids() -> list[InputFile]:
    """A saved solid."""
    return [InputFile(SOLID_NAME, npz(_arrays()))]


def npz(arrays: Arrays) -> bytes:
    """An NPZ file of arrays."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)
    return file.getvalue()


@cache
def _arrays() -> Arrays:
    from palpate.core.rebuild import reconstruct

    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    x, y = 0.03 * np.cos(turns), 0.02 * np.sin(turns)
    rings = [np.stack([x, y, np.full(24, z)], axis=1) for z in (0.0, 0.01, 0.02, 0.03)]
    return tree_to_arrays(reconstruct(rings))


def read_scenes(path: Path) -> None:
    """Check a scene as ``palpate scene check`` does; raises InputError if it is refused."""
    assert "can be explored" in check_scene(str(path)), "says nothing"


def read_solids(path: Path) -> None:
    """Read a saved solid, and take it apart again; raises InputError if it is refused."""
    assert len(tree_to_arrays(load(path))) > 1, "holds nothing"
