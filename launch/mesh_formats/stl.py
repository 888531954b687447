"""STL, in binary and in text: triangles, each with its own three corners."""

from __future__ import annotations

import re
import struct

import numpy as np

from palpate.launch.mesh_formats.raw import Floats, RawMesh, check_counts, doubles, numbers

_HEAD = struct.Struct("<80xI")
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_CORNER = re.compile(rb"^[ \t]*vertex[ \t]([^\r\n]*)", re.MULTILINE)


def read_stl(data: bytes) -> RawMesh:
    """The triangles of an STL file; those of several solids are put together.

    Raises
    ------
    ValueError
        If it is neither text with whole facets nor binary of the length that it states.
    """
    if len(data) >= _HEAD.size:
        (count,) = _HEAD.unpack_from(data)
        if len(data) == _HEAD.size + count * _TRIANGLE.itemsize:
            check_counts(0, count)
            found = np.frombuffer(data, _TRIANGLE, offset=_HEAD.size)["corners"]
            return _apart(doubles(found))
    if data[:100].lstrip()[:5].lower() != b"solid":
        raise ValueError("is cut short, or has not the triangles that it states")
    return _read_text(data.lower())


def _read_text(text: bytes) -> RawMesh:
    if text.rfind(b"endsolid") < text.rfind(b"facet"):
        raise ValueError("is cut short: its last solid has no end")
    corners = _CORNER.findall(text)
    check_counts(len(corners), 0)
    if len(corners) != 3 * text.count(b"endfacet"):
        raise ValueError(f"has {len(corners)} corners in {text.count(b'endfacet')} facets")
    found = numbers(b"\n".join(corners))
    if len(found) != 3 * len(corners):
        raise ValueError("has a corner that is not three numbers")
    return _apart(found)


def _apart(corners: Floats) -> RawMesh:
    """Triangles that share nothing yet."""
    vertices = corners.reshape(-1, 3)
    return RawMesh(vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3))
