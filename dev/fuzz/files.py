"""Damaged meshes, scenes and saved solids: valid and hand-made files, mutations, readers.

Mutations damage bytes, texts, or values of a tree. ``hostile.yaml`` has the hand-made files. The
readers check that an accepted mesh is valid.
"""

from __future__ import annotations

import io
import json
import os
import random
import struct
import zipfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML

from dev.fuzz.mutations import (
    BOUNDARY_FLOATS,
    BOUNDARY_NUMBERS,
    HOSTILE_WORDS,
    InputFile,
    Tree,
    mutate_bytes,
    mutate_text,
    tree_paths,
    value_at,
    with_value,
)
from palpate.core.archive import FORM_KEY, tree_to_arrays
from palpate.core.geometry import solidity
from palpate.core.shapes import Superquadric
from palpate.launch.files.mesh_file import (
    MAX_EXTENT,
    MAX_FACES,
    MIN_EXTENT,
    read_cloud,
    read_mesh,
    read_surface,
)
from palpate.launch.files.solid_file import load
from palpate.launch.files.yaml_file import parse_yaml
from palpate.launch.scene import SHIPPED_SCENES, shipped_scenes
from palpate.tools.scene_text import check_scene

Table = NDArray[Any]
Arrays = dict[str, Any]
SCENE_NAME, SOLID_NAME = "scene.yaml", "solid.npz"
_MARKS = (b"&a", b"*a", b"!!str", b"[", b"]", b"{", b"}", b"- ", b"? ", b"|", b"'", b'"', b"%")
# Files that are not text.
RAW = (b"", b"\0", b"\xff\xfeo\0b\0", b"object: \xff\n", b"object: \0\n", b"\x1f\x8b\x08\0")
# Replacements of values of a description.
OTHERS: list[Tree] = [None, True, "x", [], {}, -1, 2**31, 2**53, 1e308, "VEC3", [[]], 5126, 5123]
_PLY = """\
ply
format {form} 1.0
{about}element vertex {vertices}
property float x
property float y
property float z
{more}element face {faces}
property list {length} int vertex_indices
end_header
{rows}"""


@cache
def _hostile_descriptions() -> Any:
    text = (Path(__file__).parent / "hostile.yaml").read_text("utf-8")
    return YAML(typ="safe", pure=True).load(text)


def _assembled(part: Any) -> str:
    """The text of a part, by the rules in ``hostile.yaml``."""
    if isinstance(part, list):
        return "".join(map(_assembled, part))
    if not isinstance(part, dict):
        return str(part)
    [(times, inner)] = part.items()
    text: str = _assembled(inner)
    if "%" not in text:
        return text * int(times)
    turns = (text.replace("%d", str(i)).replace("%n", str(i + 1)) for i in range(times))
    return "".join(turn.replace("%m", str(i / 1000)) for i, turn in enumerate(turns))


def mutated_scenes(rng: random.Random) -> InputFile:
    """A shipped scene with damage."""
    scenes = [data for _, data in valid_scenes()]
    text = rng.choice(scenes)
    change = rng.random()
    if change < 0.15:
        return InputFile(SCENE_NAME, mutate_bytes(rng, text, rng.choice(scenes)))
    if change < 0.45:
        return InputFile(SCENE_NAME, mutate_text(rng, text, (*HOSTILE_WORDS, *_MARKS)))
    return InputFile(SCENE_NAME, _damaged_value(rng, text))


@cache
def hostile_scenes() -> list[InputFile]:
    """Scenes that are made by hand."""
    made, paths = _hostile_descriptions(), hostile_paths()
    texts = [f'object: {{mesh: {{file: "{name}", unit: mm}}}}\n' for name in paths]
    texts += [f'{made["object"]}sensor: {{calibration: "{name}"}}\n' for name in paths]
    indented = "".join("  " * i + "a:\n" for i in range(400))
    texts += [indented if part == "INDENTED" else _assembled(part) for part in made["scenes"]]
    return [InputFile(SCENE_NAME, data) for data in (*map(str.encode, texts), *RAW)]


def hostile_paths() -> list[str]:
    """File names that must not be given in a scene."""
    return [_assembled(name) for name in _hostile_descriptions()["paths"]]


@cache
def valid_scenes() -> list[InputFile]:
    """The shipped scenes, with the name of a mesh in the folder."""
    texts = ((SHIPPED_SCENES / f"{name}.yaml").read_bytes() for name in shipped_scenes())
    return [InputFile(SCENE_NAME, text.replace(b"pear.ply", b"mesh.ply")) for text in texts]


def _damaged_value(rng: random.Random, text: bytes) -> bytes:
    """A scene, as JSON, with other values in one or two places."""
    tree = parse_yaml(text.decode(), SCENE_NAME).value
    for _ in range(rng.choice((1, 1, 2))):
        path = rng.choice(tree_paths(tree))
        tree = with_value(tree, path, _other(rng, value_at(tree, path)))
    return json.dumps(tree, indent=rng.choice((None, 1))).encode()


def _other(rng: random.Random, old: Tree) -> Tree:
    """Another value, often similar to the old one, so that reading gets far."""
    if isinstance(old, (int, float)) and rng.random() < 0.6:
        return old * rng.choice((-1.0, 0.0, 0.5, 0.9, 1.1, 2.0, 10.0, 1000.0))
    if isinstance(old, list) and old and rng.random() < 0.6:
        return rng.choice((old[:-1], [*old, old[0]], old[::-1], old * 2, old * 40, []))
    if isinstance(old, dict) and old and rng.random() < 0.6:
        key = rng.choice(list(old))
        rest = {name: item for name, item in old.items() if name != key}
        return rng.choice((rest, {**rest, f"{key}s": old[key]}, {**old, "more": 1}, {"x": old}))
    path, deep = rng.choice(hostile_paths()), json.loads("[" * 30 + "]" * 30)
    values: tuple[Tree, ...] = (
        *(None, True, "", "x", path, [], {}, deep, [old] * 3, {"a": old}, "x" * 5000),
    )
    return rng.choice((*values, *BOUNDARY_NUMBERS, *BOUNDARY_FLOATS))


def fill_folder(folder: Path) -> None:
    """Write the files that scenes name into their folder."""
    (folder / "mesh.ply").write_bytes(dict(valid_meshes())["little.ply"])
    (folder / "empty.ply").touch()
    (folder / "folder.ply").mkdir()
    (folder / "passwd.ply").symlink_to("/etc/passwd")
    (folder / "loop.ply").symlink_to(folder / "loop.ply")
    os.mkfifo(folder / "pipe.ply")
    gain, offset = [[1.0] * 16] * 16, [[0.0] * 16] * 16
    text = f"gain: {gain}\noffset: {offset}\nsound_speed: 1000.0\nnoise: 1.0e-5\n"
    (folder / "gains.yaml").write_text(text)


def mutated_solids(rng: random.Random) -> InputFile:
    """A valid solid with damage."""
    arrays = _arrays()
    change = rng.random()
    if change < 0.3:
        return InputFile(SOLID_NAME, mutate_bytes(rng, npz(arrays)))
    damaged = _damaged_form if change < 0.65 else _damaged_array
    return InputFile(SOLID_NAME, npz(damaged(rng, arrays)))


@cache
def hostile_solids() -> list[InputFile]:
    """Files that are made by hand."""
    deep: Tree = None
    for _ in range(400):
        deep = {"tuple": [deep, None]}
    twice: list[Tree] = [{"tuple": [1, 1]}]
    twice += [{"tuple": [{"same": f"solid/{i}"}] * 2} for i in range(60)]
    made = [
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
    return [InputFile(SOLID_NAME, data) for data in made]


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


def _damaged_form(rng: random.Random, arrays: Arrays) -> Arrays:
    form = json.loads(str(arrays[FORM_KEY]))
    path = rng.choice(tree_paths(form))
    old = value_at(form, path)
    replacements: tuple[Tree, ...] = (
        *(None, True, "x", [], {}, *BOUNDARY_NUMBERS, *BOUNDARY_FLOATS[:5], {"tuple": []}),
        {"list": [old, old]},
        {"same": "solid"},
        {"array": rng.choice(list(arrays))},
        {"scalar": rng.choice(list(arrays))},
        {"class": "rebuild.solid.Solid", "fields": {}},
        value_at(form, rng.choice(tree_paths(form))),
    )
    text = json.dumps(with_value(form, path, rng.choice(replacements)))
    return {**arrays, FORM_KEY: np.array(text)}


def _damaged_array(rng: random.Random, arrays: Arrays) -> Arrays:
    name = rng.choice([name for name in arrays if name != FORM_KEY])
    old = arrays[name]
    with np.errstate(all="ignore"):
        replacements = (
            old.ravel(),
            old[..., None],
            old.T,
            old[:0] if old.ndim else old,
            old[: old.shape[0] // 2] if old.ndim else old,
            np.zeros_like(old),
            *(np.full(old.shape, value) for value in (np.nan, np.inf, 1e300, -(2**31))),
            *(old.astype(kind) for kind in (np.complex128, "<U8", bool)),
            np.array(1.0),
            arrays[rng.choice(list(arrays))],
        )
    return {**arrays, name: rng.choice(replacements)}


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
    assert check_scene(str(path)).size, "has no size"


def read_solids(path: Path) -> None:
    """Read a saved solid and convert it back; raises InputError if it is refused."""
    assert len(tree_to_arrays(load(path))) > 1, "is empty"


def mutated_meshes(rng: random.Random) -> InputFile:
    """A valid mesh with damage."""
    samples = dict(valid_meshes())
    name = rng.choice(list(samples))
    data = samples[name]
    if name.startswith(("text", "plain")) and not name.endswith("glb") and rng.random() < 0.7:
        return InputFile(name, mutate_text(rng, data))
    if name.endswith("glb") and rng.random() < 0.6:
        return InputFile(name, _damaged_glb(rng, data))
    if name.endswith("ply") and rng.random() < 0.5:
        size = data.index(b"end_header\n") + len(b"end_header\n")  # of the header
        return InputFile(name, mutate_text(rng, data[:size]) + data[size:])
    return InputFile(name, mutate_bytes(rng, data, samples[rng.choice(list(samples))]))


@cache
def hostile_meshes() -> list[InputFile]:
    """Files that are made by hand; the suffix is that of the format."""
    made = _hostile_descriptions()
    return [InputFile(name, _mesh_of(part, made["ply"])) for name, part in made["meshes"].items()]


def _mesh_of(part: Any, valid: dict[str, str]) -> bytes:
    """Bytes of a mesh file; `valid` are the parts of a valid PLY file."""
    if isinstance(part, dict) and "glb" in part:
        return glb(_assembled(part["glb"]).encode(), bytes(part.get("held", 0)))
    if isinstance(part, dict) and all(isinstance(key, str) for key in part):
        texts = {**valid, **{key: _assembled(text) for key, text in part.items()}}
        return _PLY.format(**texts).encode("latin-1")
    return _assembled(part).encode("latin-1")


def _damaged_glb(rng: random.Random, data: bytes) -> bytes:
    """A GLB file with another value in its description, and consistent lengths."""
    described, held = gltf_of(data)
    path = rng.choice(tree_paths(described))
    old = value_at(described, path)
    values = (*OTHERS, *BOUNDARY_NUMBERS, *BOUNDARY_FLOATS, [old, old], {"a": old})
    described = with_value(described, path, rng.choice(values))
    text = json.dumps(described).encode()
    return glb(mutate_text(rng, text) if rng.random() < 0.2 else text, held)


def gltf_of(data: bytes) -> tuple[Any, bytes]:
    """Description and data of a GLB file made by `glb`."""
    (size,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def read_meshes(path: Path) -> None:
    """Read a mesh file as points or a surface, and then as the solid of a scene.

    Raises InputError if it is refused, and AssertionError if it is accepted but not finite, or as a
    solid not closed or of a wrong size.
    """
    points = read_cloud(path, "mm")
    if points is not None and len(points):
        assert points.ndim == 2 and points.shape[1] == 3, "points without three coordinates"
    else:
        _check(*read_surface(path, "mm")[:2])
    vertices, faces, _ = read_mesh(path, "mm")
    _check(vertices, faces)
    solid, extents = solidity(vertices, faces), np.ptp(vertices, axis=0)
    assert solid.watertight and solid.components == 1 and solid.volume > 0.0, "is not one solid"
    assert extents.min() >= MIN_EXTENT and extents.max() <= MAX_EXTENT, "is too small or too large"


def _check(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
    assert np.isfinite(vertices).all(), "a vertex is not finite"
    assert 0 < len(faces) <= MAX_FACES, "has no triangles or too many"
    assert faces.min() >= 0 and faces.max() < len(vertices), "has a corner without a vertex"


@cache
def valid_meshes() -> list[InputFile]:
    """Valid files; the suffix is that of the format."""
    shape = Superquadric(np.array([30.0, 25.0, 40.0]), np.array([1.0, 1.0]))  # [mm]
    vertices, faces = shape.mesh(2)
    places, corners = _rows(vertices.round(4)), _rows(faces, "3 ")
    off = f"OFF\n# by hand\n{len(vertices)} {len(faces)} 0\n{places}{corners}"
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    table = np.zeros(len(faces), kind)
    table["corners"] = vertices[faces]
    text = _ply_head("ascii", len(vertices), len(faces)) + (places + corners).encode()
    return [
        InputFile("text.ply", text),
        InputFile("little.ply", _ply_binary(vertices, faces, "<", "little")),
        InputFile("big.ply", _ply_binary(vertices, faces, ">", "big")),
        InputFile("mixed.ply", _ply_mixed(vertices, faces)),
        InputFile("text.stl", _stl_text(vertices, faces)),
        InputFile("binary.stl", bytes(80) + struct.pack("<I", len(faces)) + table.tobytes()),
        InputFile("plain.obj", _obj(vertices, faces)),
        InputFile("plain.off", off.encode()),
        InputFile("plain.glb", glb(*_gltf(vertices, faces))),
    ]


def _rows(table: Table, before: str = "") -> str:
    return "".join(f"{before}{' '.join(map(str, row))}\n" for row in table.tolist())


def _ply_binary(vertices: Table, faces: Table, order: str, name: str) -> bytes:
    listed = np.zeros(len(faces), np.dtype([("n", "u1"), ("corners", f"{order}i4", 3)]))
    listed["n"], listed["corners"] = 3, faces
    rows = vertices.astype(f"{order}f4").tobytes() + listed.tobytes()
    return _ply_head(f"binary_{name}_endian", len(vertices), len(faces)) + rows


def _ply_mixed(vertices: Table, faces: Table) -> bytes:
    """Triangles and a quadrilateral, so that lists have several lengths."""
    a, b, c = faces[0].tolist()
    other = next(i for i, face in enumerate(faces.tolist()) if i and {a, b} <= set(face))
    (d,) = set(faces[other].tolist()) - {a, b}
    rows = [[a, d, b, c], *np.delete(faces, [0, other], axis=0).tolist()]
    packed = b"".join(struct.pack(f"<B{len(row)}i", len(row), *row) for row in rows)
    coloured = np.zeros(len(vertices), np.dtype([("at", "<f4", 3), ("red", "u1")]))
    coloured["at"] = vertices
    head = _ply_head("binary_little_endian", len(vertices), len(rows), "property uchar red\n")
    return head + coloured.tobytes() + packed


def _ply_head(form: str, vertices: int, faces: int, more: str = "") -> bytes:
    about = {"form": form, "about": "comment by hand\n", "vertices": vertices, "faces": faces}
    return _PLY.format(**about, more=more, length="uchar", rows="").encode()


def _stl_text(vertices: Table, faces: Table) -> bytes:
    lines = ["solid by hand"]
    for face in vertices.round(4)[faces].tolist():
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in face]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid by hand", ""]).encode()


def _obj(vertices: Table, faces: Table) -> bytes:
    lines = ["mtllib none.mtl", "o by hand", *(f"v {x} {y} {z}" for x, y, z in vertices.tolist())]
    lines += ["vn 0 0 1", "usemtl red"]
    lines += [f"f {a}//1 {b}//1 {c}//1" for a, b, c in (faces + 1).tolist()]
    return "\n".join([*lines, ""]).encode()


def glb(described: Any, held: bytes) -> bytes:
    """A GLB file of a description and its data."""
    text = described if isinstance(described, bytes) else json.dumps(described).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(held), 0x004E4942) + held
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _gltf(vertices: Table, faces: Table) -> tuple[Any, bytes]:
    places, corners = vertices.astype("<f4").tobytes(), faces.astype("<u4").tobytes()
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
        {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
    ]
    views: list[dict[str, int]] = [
        {"buffer": 0, "byteLength": len(places)},
        {"buffer": 0, "byteOffset": len(places), "byteLength": len(corners)},
    ]
    described = {
        **{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]},
        "nodes": [{"children": [1]}, {"mesh": 0, "translation": [0.0, 0.0, 50.0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        **{"accessors": accessors, "bufferViews": views},
        "buffers": [{"byteLength": len(places) + len(corners)}],
    }
    return described, places + corners
