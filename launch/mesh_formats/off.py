"""OFF: counts, vertices one a line, and polygons one a line."""

from __future__ import annotations

import re

import numpy as np

from palpate.launch.mesh_formats.raw import Ragged, RawMesh, check_counts, numbers, triangles

_START = re.compile(rb"\s*(?:ST)?C?N?OFF\b")


def read_off(data: bytes) -> RawMesh:
    """The mesh of an OFF file; colours and normals are passed over.

    Raises
    ------
    ValueError
        If it does not begin with OFF, or has not what it states.
    """
    start = _START.match(data)
    if start is None:
        raise ValueError("does not begin with OFF")
    whole = (line.partition(b"#")[0].strip() for line in data[start.end() :].splitlines())
    lines = [line for line in whole if line]
    counts = lines[0].split() if lines else []
    try:
        vertices, faces = int(counts[0]), int(counts[1])
    except (IndexError, ValueError):
        raise ValueError("does not state how many vertices and faces it has") from None
    check_counts(vertices, faces)
    if len(lines) < 1 + vertices + faces:
        raise ValueError(
            f"states {vertices} vertices and {faces} faces, and has {len(lines) - 1} lines of them"
        )
    places = numbers(b"\n".join(b" ".join(row.split(None, 3)[:3]) for row in lines[1:][:vertices]))
    if len(places) != 3 * vertices:
        raise ValueError("has a vertex that is not three numbers")
    polygons = _polygons(lines[1 + vertices :][:faces])
    return RawMesh(places.reshape(-1, 3), triangles(polygons))


def _polygons(lines: list[bytes]) -> Ragged:
    lengths, rows = [], []
    for line in lines:
        words = line.split()
        length = int(words[0]) if words[0].isdigit() and len(words[0]) < 10 else -1
        if not 0 <= length < len(words):
            raise ValueError("has a face without the corners that it states")
        lengths.append(length)
        rows.append(b" ".join(words[1 : 1 + length]))
    items = numbers(b"\n".join(rows))
    if len(items) != sum(lengths):
        raise ValueError("has a face with a corner that is no whole number")
    return Ragged(np.array(lengths, np.int64), items)
