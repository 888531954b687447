"""Where a GLB file's nodes put its mesh."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from palpate.launch.mesh_formats.raw import Floats

Four = tuple[float, float, float, float]
Three = tuple[float, float, float]


class Node(msgspec.Struct, frozen=True):
    """A place, within that of the node whose child it is."""

    mesh: int | None = None
    children: tuple[int, ...] = ()
    matrix: tuple[float, ...] | None = None
    translation: Three = (0.0, 0.0, 0.0)
    rotation: Four = (0.0, 0.0, 0.0, 1.0)
    scale: Three = (1.0, 1.0, 1.0)


def placed(vertices: Floats, nodes: Sequence[Node]) -> Floats:
    """Vertices (n, 3) of the only mesh, where the node that has it puts them.

    Raises
    ------
    ValueError
        If several nodes have it, or a node has several parents or is its own.
    """
    have = [number for number, node in enumerate(nodes) if node.mesh is not None]
    if len(have) > 1:
        raise ValueError(f"puts its mesh in {len(have)} places; there must be one")
    if not have:
        return vertices
    parents = _parents(nodes)
    number: int | None = have[0]
    whole = np.eye(4)
    for _ in range(len(nodes) + 1):
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is looked for later
            if number is None:
                return _moved(vertices, whole)
            whole = _motion(nodes[number]) @ whole
        number = parents.get(number)
    raise ValueError("has a node that is within itself")


def _parents(nodes: Sequence[Node]) -> dict[int, int]:
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.children:
            if child in parents:
                raise ValueError(f"has a node {child} that is within two others")
            parents[child] = number
    return parents


def _motion(node: Node) -> Floats:
    """The (4, 4) matrix from a node's frame to that around it."""
    if node.matrix is not None:
        if len(node.matrix) != 16:
            raise ValueError(f"has a node with a matrix of {len(node.matrix)} numbers")
        return np.array(node.matrix, np.float64).reshape(4, 4).T
    motion = np.eye(4)
    motion[:3, :3] = _axes(node.rotation) * np.array(node.scale)
    motion[:3, 3] = node.translation
    return motion


def _moved(vertices: Floats, motion: Floats) -> Floats:
    moved: Floats = vertices @ motion[:3, :3].T + motion[:3, 3]
    return moved


def _axes(rotation: Four) -> Floats:
    x, y, z, w = rotation
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
