"""OBJ: vertices and polygons; groups, materials, texture and normals are passed over."""

from __future__ import annotations

import numpy as np

from palpate.launch.mesh_formats.raw import Ragged, RawMesh, check_counts, numbers, triangles


def read_obj(data: bytes) -> RawMesh:
    """The vertices and faces of an OBJ file; no other file that it names is opened.

    Raises
    ------
    ValueError
        If a vertex has no three numbers, or a face names a vertex that is none.
    """
    places: list[bytes] = []
    lengths: list[int] = []
    corners: list[int] = []
    for line in data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines():
        words = line.split(None, 1)
        if len(words) < 2:
            continue
        if words[0] == b"v":
            places.append(b" ".join(words[1].split(None, 3)[:3]))
        elif words[0] == b"f":
            named = _corners(words[1], len(places))
            lengths.append(len(named))
            corners += named
    check_counts(len(places), len(lengths))
    found = numbers(b"\n".join(places))
    if len(found) != 3 * len(places):
        raise ValueError("has a vertex that is not three numbers")
    polygons = Ragged(np.array(lengths, np.int64), np.array(corners, np.int64))
    return RawMesh(found.reshape(-1, 3), triangles(polygons))


def _corners(text: bytes, vertices: int) -> list[int]:
    """Vertices, from 0, that ``1/2/3 -1 4`` names; negative ones count back from the last."""
    found = []
    for word in text.partition(b"#")[0].split():
        name = word.partition(b"/")[0]
        if not name.removeprefix(b"-").isdigit() or len(name) > 9:
            raise ValueError(f"has a face with the corner {word[:20].decode(errors='replace')!r}")
        number = int(name)
        found.append(number - 1 if number > 0 else vertices + number if number else -1)
    return found
