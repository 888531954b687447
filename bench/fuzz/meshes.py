"""Damaged mesh files of every format.

Sound samples by hand, files made to hurt, mutations, and what an accepted mesh must be.
"""

from __future__ import annotations

import json
import random
import struct
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.bench.fuzz.mutations import (
    FLOATS,
    NUMBERS,
    InputFile,
    Tree,
    mutate_bytes,
    mutate_text,
    tree_paths,
    value_at,
    with_value,
)
from palpate.core.geometry import solidity
from palpate.core.shapes import Superquadric
from palpate.launch.files import (
    MAX_EXTENT,
    MAX_FACES,
    MIN_EXTENT,
    read_cloud,
    read_mesh,
    read_surface,
)

Table = NDArray[Any]
# Put in the place of values of a description.
OTHERS: list[Tree] = [None, True, "x", [], {}, -1, 2**31, 2**53, 1e308, "VEC3", [[]], 5126, 5123]
LEVEL = 2  # 320 faces
SIZE = (30.0, 25.0, 40.0)  # Semi-axes, mm
_ABOUT = b"ply\nformat %s 1.0\nelement vertex %s\nproperty float x\nproperty float y\n"
_FACES = b"property float z\nelement face %s\nproperty list %s %s vertex_indices\nend_header\n"
_TEXT = b"0 0 0\n10 0 0\n0 10 0\n0 0 10\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
_PLACES = struct.pack("<12f", 0, 0, 0, 10, 0, 0, 0, 10, 0, 0, 0, 10)
_CORNERS = struct.pack("<" + "B3i" * 4, 3, 0, 2, 1, 3, 0, 1, 3, 3, 0, 3, 2, 3, 1, 2, 3)
_LITTLE = b"binary_little_endian"


def mutated_meshes(rng: random.Random) -> InputFile:
    """A sample with damage."""
    samples = dict(valid_meshes())
    name = rng.choice(list(samples))
    data = samples[name]
    if name.startswith(("text", "plain")) and not name.endswith("glb") and rng.random() < 0.7:
        return InputFile(name, mutate_text(rng, data))
    if name.endswith("glb") and rng.random() < 0.6:
        return InputFile(name, _damaged_glb(rng, data))
    if name.endswith("ply") and rng.random() < 0.5:
        return InputFile(name, _damaged_head(rng, data))
    return InputFile(name, mutate_bytes(rng, data, samples[rng.choice(list(samples))]))


@cache
def hostile_meshes() -> list[InputFile]:
    """Files that were made to hurt; the suffix tells the format."""
    bombs = {**_ply_bombs(), **_stl_bombs(), **_obj_and_off_bombs(), **_glb_bombs()}
    return [InputFile(*one) for one in bombs.items()]


def _ply_bombs() -> dict[str, bytes]:
    rows = _PLACES + _CORNERS
    many = b"".join(b"property list uchar float a%d\n" % i for i in range(4000))
    return {
        "two_thousand_million_faces.ply": _ply(faces=b"2000000000"),
        "two_million_faces.ply": _ply(faces=b"2000000"),
        "minus_four_vertices.ply": _ply(vertices=b"-4"),
        "digits.ply": _ply(vertices=b"9" * 5000),
        "more_than_stated.ply": _ply(vertices=b"3"),
        "corner_beyond.ply": _ply(rows=_TEXT.replace(b"3 1 2 3", b"3 1 2 9")),
        "corner_below.ply": _ply(rows=_TEXT.replace(b"3 1 2 3", b"3 1 2 -1")),
        "corner_between.ply": _ply(rows=_TEXT.replace(b"3 1 2 3", b"3 1 2 2.5")),
        "long_polygon.ply": _ply(rows=_TEXT.replace(b"3 1 2 3", b"2000000000 1 2 3")),
        "nan.ply": _ply(rows=_TEXT.replace(b"10 0 0", b"nan 0 0")),
        "far.ply": _ply(
            rows=_TEXT.replace(b"10 0 0", b"1e308 0 0").replace(b"0 0 0", b"-1e308 0 0")
        ),
        "blank_lines.ply": _ply(rows=b"\n" * 1_000_000),
        "blanks.ply": _ply(rows=_TEXT + b" " * 1_000_000),
        "numbers.ply": _ply(vertices=b"4", faces=b"0", rows=b"0 " * 500_000),
        "many_properties.ply": _ply(_LITTLE, rows=rows).replace(
            b"element face", many + b"element face"
        ),
        "endless_header.ply": b"ply\nformat ascii 1.0\n" + b"comment x\n" * 100_000,
        "long_list.ply": _ply(_LITTLE, length=b"uint", rows=_PLACES + struct.pack("<I", 2**32 - 1)),
        "short_list.ply": _ply(_LITTLE, length=b"char", rows=_PLACES + b"\xff" * 100),
        "float_list.ply": _ply(_LITTLE, length=b"float", rows=rows),
        "empty_lists.ply": _ply(_LITTLE, faces=b"100000", rows=_PLACES + bytes(100_000)),
        "uneven_lists.ply": _ply(_LITTLE, faces=b"100000", rows=_PLACES + b"\1\0\0\0\0\0" * 50_000),
        "nothing.ply": _ply(vertices=b"0", faces=b"0", rows=b""),
        "no_properties.ply": b"ply\nformat ascii 1.0\nelement a 999999999999999999\nend_header\n",
        "two_formats.ply": _ply().replace(b"format", b"format ascii 1.0\nformat", 1),
        "texture.ply": _ply().replace(b"element", b"comment TextureFile ../x.png\nelement", 1),
    }


def _ply(
    form: bytes = b"ascii",
    vertices: bytes = b"4",
    faces: bytes = b"4",
    length: bytes = b"uchar",
    kind: bytes = b"int",
    rows: bytes = _TEXT,
) -> bytes:
    return _ABOUT % (form, vertices) + _FACES % (faces, length, kind) + rows


def _stl_bombs() -> dict[str, bytes]:
    solid = b"solid a\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendfacet\nendsolid\n"
    triangle = bytes(50)
    return {
        "four_thousand_million.stl": bytes(80) + b"\xff" * 4 + triangle,
        "none.stl": bytes(84),
        "all_nan.stl": bytes(80) + struct.pack("<I", 400) + b"\0\0\xc0\x7f" * 5000,
        "signalling_nan.stl": bytes(80) + struct.pack("<I", 4) + b"\1\0\xa0\x7f" * 50,
        "all_zero.stl": bytes(80) + struct.pack("<I", 20_000) + triangle * 20_000,
        "empty.stl": b"solid x\nendsolid x\n",
        "text_nan.stl": solid.replace(b"1 0 0", b"nan 0 0"),
        "many_solids.stl": solid * 10_000,
        "ends.stl": b"solid" + b"endsolid " * 100_000,
        "blanks.stl": b"solid" + b" " * 1_000_000,
        "tabs.stl": b"solid\n" + b"\t" * 500_000 + b"vertex",
        "no_end.stl": solid.replace(b"endsolid\n", b""),
        "unknown_encoding.stl": b"solid \xff\xfe\x81\n" + b"\x8f" * 1000,
    }


def _obj_and_off_bombs() -> dict[str, bytes]:
    corners = b"v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\n"
    return {
        "beyond.obj": corners + b"f 1 2 9\n",
        "zero.obj": corners + b"f 0 1 2\n",
        "back.obj": corners + b"f -1 -2 -9\n",
        "huge.obj": corners + b"f 1 2 " + b"9" * 5000 + b"\n",
        "polygon.obj": corners + b"f " + b"1 2 3 4 " * 100_000,
        "many_polygons.obj": corners + b"f 1 2 3 4\n" * 50_000,
        "groups.obj": corners
        + b"".join(b"o a%d\nusemtl b%d\nf 1 2 3\n" % (i, i) for i in range(9000)),
        "library.obj": b"mtllib ../../../../etc/passwd\nmtllib /dev/zero\n"
        + corners
        + b"f 1 2 3\n",
        "continued.obj": corners + b"f \\\n" * 100_000,
        "only_points.obj": corners,
        "only_places.obj": b"v 0 0 0\n" * 100_000 + b"f 1 2 3\n",
        "minus.off": b"OFF\n-1 -1 0\n" + corners,
        "too_many.off": b"OFF\n4 2000000000 0\n0 0 0\n",
        "digits.off": b"OFF\n" + b"9" * 5000 + b" 1 0\n",
        "polygon.off": b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n300000 " + b"0 1 2 " * 100_000,
        "comments.off": b"OFF\n" + b"# x\n" * 200_000,
        "blank.off": b"OFF\n" + b"\n" * 1_000_000,
        "no_counts.off": b"OFF",
        "word.off": b"OFF\n3 1 0\n0 0 0\n1 0 x\n0 1 0\n3 0 1 2\n",
    }


def _glb_bombs() -> dict[str, bytes]:
    mesh = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]
    many = [
        {"componentType": 5126, "count": 10**9, "type": "VEC3"},
        {"componentType": 5125, "count": 10**9, "type": "SCALAR"},
    ]
    base: dict[str, Any] = {"meshes": mesh, "accessors": many}
    viewed = [{**one, "bufferView": 0} for one in many]
    small = [{**one, "count": 3} for one in viewed]
    view = [{"buffer": 0, "byteLength": 36}]
    tree = [{"children": [i + 1, i + 1]} for i in range(24)]
    chain = [{"children": [i + 1]} for i in range(20_000)]
    inside = {**base, "accessors": small, "bufferViews": view}
    minus = [{**one, "count": -1} for one in small]
    return {
        "zeros.glb": glb(base, b""),
        "sparse.glb": glb(
            {**base, "accessors": [{**one, "sparse": {"count": 1}} for one in many]}, b""
        ),
        "counts.glb": glb({**base, "accessors": viewed, "bufferViews": view}, bytes(36)),
        "minus.glb": glb({**inside, "accessors": minus}, bytes(36)),
        "instances.glb": glb({**inside, "nodes": [*tree, {"mesh": 0}]}, bytes(36)),
        "chain.glb": glb({**inside, "nodes": [*chain, {"mesh": 0}]}, bytes(36)),
        "circle.glb": glb({**inside, "nodes": [{"children": [0], "mesh": 0}]}, bytes(36)),
        "deep.glb": glb(b"[" * 100_000, b""),
        "deep_nodes.glb": glb(b'{"nodes":' + b"[" * 100_000, b""),
        "many.glb": glb({"meshes": mesh * 10_000}, b""),
        "stride.glb": glb({**inside, "bufferViews": [{**view[0], "byteStride": 2**62}]}, bytes(36)),
        "other_file.glb": glb({**inside, "buffers": [{"uri": "/etc/passwd"}]}, bytes(36)),
        "version.glb": b"glTF" + struct.pack("<II", 1, 12),
    }


def _damaged_glb(rng: random.Random, data: bytes) -> bytes:
    """A GLB file whose description has another value somewhere, and whose lengths agree."""
    described, held = gltf_of(data)
    path = rng.choice(tree_paths(described))
    old = value_at(described, path)
    values = (*OTHERS, *NUMBERS, *FLOATS, [old, old], {"a": old})
    described = with_value(described, path, rng.choice(values))
    text = json.dumps(described).encode()
    return glb(mutate_text(rng, text) if rng.random() < 0.2 else text, held)


def gltf_of(data: bytes) -> tuple[Any, bytes]:
    """Description and data of a GLB file made by `glb`."""
    (size,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def _damaged_head(rng: random.Random, data: bytes) -> bytes:
    """A PLY file whose header alone is hurt."""
    size = data.index(b"end_header\n") + len(b"end_header\n")
    return mutate_text(rng, data[:size]) + data[size:]


def read_meshes(path: Path) -> None:
    """Read a mesh as one that need not be closed, or points; and then as a scene does.

    Raises InputError if it is refused. Raises AssertionError if it is accepted and not finite; by a
    scene, if it is not closed and of fitting size.
    """
    points = read_cloud(path, "mm")
    if points is not None and len(points):
        assert points.ndim == 2 and points.shape[1] == 3, "points without three coordinates"
    else:
        _check(*read_surface(path, "mm"))
    vertices, faces = read_mesh(path, "mm")
    _check(vertices, faces)
    found, extents = solidity(vertices, faces), np.ptp(vertices, axis=0)
    assert found.watertight and found.components == 1 and found.volume > 0.0, "is not one solid"
    assert extents.min() >= MIN_EXTENT and extents.max() <= MAX_EXTENT, "is too small or too large"


def _check(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
    assert np.isfinite(vertices).all(), "a vertex is not finite"
    assert 0 < len(faces) <= MAX_FACES, "has no triangles or too many"
    assert faces.min() >= 0 and faces.max() < len(vertices), "names a vertex that is not there"


@cache
def valid_meshes() -> list[InputFile]:
    """Sound files; the suffix tells the format."""
    shape = Superquadric(np.array(SIZE), np.array([1.0, 1.0]))
    vertices, faces = shape.mesh(LEVEL)
    return [
        InputFile("text.ply", _ply_text(vertices, faces)),
        InputFile("little.ply", _ply_binary(vertices, faces, "<")),
        InputFile("big.ply", _ply_binary(vertices, faces, ">")),
        InputFile("mixed.ply", _ply_mixed(vertices, faces)),
        InputFile("text.stl", _stl_text(vertices, faces)),
        InputFile("binary.stl", _stl_binary(vertices, faces)),
        InputFile("plain.obj", _obj(vertices, faces)),
        InputFile("plain.off", _off(vertices, faces)),
        InputFile("plain.glb", glb(*_gltf(vertices, faces))),
    ]


def _ply_text(vertices: Table, faces: Table) -> bytes:
    rows = _rows(vertices.round(4)) + _rows(faces, "3 ")
    return _ply_head("ascii", len(vertices), len(faces)) + rows.encode()


def _ply_binary(vertices: Table, faces: Table, order: str) -> bytes:
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    listed = np.zeros(len(faces), np.dtype([("n", "u1"), ("corners", f"{order}i4", 3)]))
    listed["n"], listed["corners"] = 3, faces
    rows = vertices.astype(f"{order}f4").tobytes() + listed.tobytes()
    return _ply_head(form, len(vertices), len(faces)) + rows


def _ply_mixed(vertices: Table, faces: Table) -> bytes:
    """Triangles beside a quadrilateral, so that lists are of several lengths."""
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
    return (
        f"ply\nformat {form} 1.0\ncomment by hand\nelement vertex {vertices}\n"
        f"property float x\nproperty float y\nproperty float z\n{more}"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


def _stl_text(vertices: Table, faces: Table) -> bytes:
    lines = ["solid by hand"]
    for face in vertices.round(4)[faces].tolist():
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in face]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid by hand", ""]).encode()


def _stl_binary(vertices: Table, faces: Table) -> bytes:
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    table = np.zeros(len(faces), kind)
    table["corners"] = vertices[faces]
    return bytes(80) + struct.pack("<I", len(faces)) + table.tobytes()


def _obj(vertices: Table, faces: Table) -> bytes:
    lines = ["mtllib none.mtl", "o by hand", *(f"v {x} {y} {z}" for x, y, z in vertices.tolist())]
    lines += ["vn 0 0 1", "usemtl red"]
    lines += [f"f {a}//1 {b}//1 {c}//1" for a, b, c in (faces + 1).tolist()]
    return "\n".join([*lines, ""]).encode()


def _off(vertices: Table, faces: Table) -> bytes:
    rows = _rows(vertices.round(4)) + _rows(faces, "3 ")
    return f"OFF\n# by hand\n{len(vertices)} {len(faces)} 0\n{rows}".encode()


def _rows(table: Table, before: str = "") -> str:
    return "".join(f"{before}{' '.join(map(str, row))}\n" for row in table.tolist())


def glb(described: Any, held: bytes) -> bytes:
    """A GLB file of a description and its data."""
    text = described if isinstance(described, bytes) else json.dumps(described).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(held), 0x004E4942) + held
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _gltf(vertices: Table, faces: Table) -> tuple[Any, bytes]:
    places, corners = vertices.astype("<f4").tobytes(), faces.astype("<u4").tobytes()
    described = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1]}, {"mesh": 0, "translation": [0.0, 0.0, 50.0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(places)},
            {"buffer": 0, "byteOffset": len(places), "byteLength": len(corners)},
        ],
        "buffers": [{"byteLength": len(places) + len(corners)}],
    }
    return described, places + corners
