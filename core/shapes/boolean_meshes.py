"""Meshes of boolean combinations, by the manifold library: closed whatever meets there."""

from __future__ import annotations

from typing import Any

import manifold3d
import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.boolean_solids import (
    Complement,
    Intersection,
    Tree,
    Union,
    with_inner_complement,
)
from palpate.core.shapes.half_spaces import HalfSpace
from palpate.core.shapes.protocol import Mesh

ROOM = 3.0  # All that is unbounded is cut to a box that is this many times as large as the whole


def combined_mesh(tree: Tree, box: Floats, level: int) -> Mesh:
    """The mesh of a tree of solids.

    `tree`: what is combined. `box` (2, 3): corners of a box that holds the whole, m. `level`: that
    of the leaves' tessellations. Raises ValueError if a leaf's tessellation is not closed.
    """
    extent = float(np.linalg.norm(box[1] - box[0]))
    solid = _combined(tree, box.mean(axis=0), ROOM * extent, level)
    # A plane needs few facets, but not if it is bent afterwards.
    mesh = solid.refine_to_length(extent / 2**level).to_mesh64()
    return Mesh(
        np.array(mesh.vert_properties[:, :3], np.float64), np.array(mesh.tri_verts, np.int32)
    )


def _combined(tree: Tree, middle: Floats, size: float, level: int) -> Any:
    tree = with_inner_complement(tree)
    if isinstance(tree, Complement):
        return _cube(middle, size) - _combined(tree.part, middle, size, level)
    if isinstance(tree, Union):
        return _joined(tree.parts, manifold3d.OpType.Add, middle, size, level)
    if isinstance(tree, Intersection):
        # A difference is taken as such, without the box in which a complement would be.
        kept = tuple(part for part in tree.parts if not isinstance(part, Complement))
        taken = tuple(part.part for part in tree.parts if isinstance(part, Complement))
        solid = _cube(middle, size)
        if kept:
            solid = _joined(kept, manifold3d.OpType.Intersect, middle, size, level)
        return solid - _joined(taken, manifold3d.OpType.Add, middle, size, level)
    if isinstance(tree, HalfSpace):
        return _cube(middle, size).trim_by_plane(tuple(-tree.normal), -tree.offset)
    vertices, faces = tree.mesh(level)
    mesh = manifold3d.Mesh64(
        np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.uint64)
    )
    solid = manifold3d.Manifold(mesh)
    if solid.status() != manifold3d.Error.NoError:
        raise ValueError(f"a leaf's tessellation is not closed: {solid.status()}")
    return solid


def _joined(parts: tuple[Tree, ...], kind: Any, middle: Floats, size: float, level: int) -> Any:
    solids = [_combined(part, middle, size, level) for part in parts]
    return manifold3d.Manifold.batch_boolean(solids, kind)


def _cube(middle: Floats, size: float) -> Any:
    return manifold3d.Manifold.cube((size, size, size), True).translate(tuple(middle))
