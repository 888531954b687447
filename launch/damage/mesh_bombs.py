"""Mesh files that were made to hurt: counts that nobody sent, endless headers, lists in lists."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

from palpate.launch.damage.mesh_samples import glb

_ABOUT = b"ply\nformat %s 1.0\nelement vertex %s\nproperty float x\nproperty float y\n"
_FACES = b"property float z\nelement face %s\nproperty list %s %s vertex_indices\nend_header\n"
_TEXT = b"0 0 0\n10 0 0\n0 10 0\n0 0 10\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
_PLACES = struct.pack("<12f", 0, 0, 0, 10, 0, 0, 0, 10, 0, 0, 0, 10)
_CORNERS = struct.pack("<" + "B3i" * 4, 3, 0, 2, 1, 3, 0, 1, 3, 3, 0, 3, 2, 3, 1, 2, 3)
_LITTLE = b"binary_little_endian"


def _ply(
    form: bytes = b"ascii",
    vertices: bytes = b"4",
    faces: bytes = b"4",
    length: bytes = b"uchar",
    kind: bytes = b"int",
    rows: bytes = _TEXT,
) -> bytes:
    return _ABOUT % (form, vertices) + _FACES % (faces, length, kind) + rows


@cache
def mesh_bombs() -> dict[str, bytes]:
    """Files by name; the suffix tells the format."""
    return {**_ply_bombs(), **_stl_bombs(), **_obj_and_off_bombs(), **_glb_bombs()}


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
