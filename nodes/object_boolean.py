"""The words with which scenes combine solids: a tree of unions, intersections, differences."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.frames import IDENTITY, compose, split_pose
from palpate.nodes.object_solid import SolidSpec, build_solid
from palpate.nodes.object_units import Coordinate, only_one, pose_array

if TYPE_CHECKING:  # what only some scenes need is imported where they need it
    from palpate.core.shapes.boolean import BooleanShape
    from palpate.core.shapes.boolean_tree import Tree
    from palpate.core.shapes.half_space import HalfSpace

WORDS = (
    "superquadric",
    "hyperquadric",
    "generalised_cylinder",
    "polyhedron",
    "half_space",
    "union",
    "intersection",
    "difference",
    "complement",
)


class HalfSpaceSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All that lies behind a plane."""

    normal: tuple[float, float, float]
    """Outwards, of any length."""
    offset: Coordinate = 0.0
    """Distance of the plane from the origin along the normal, m."""

    def __post_init__(self) -> None:
        _half_space(self)


class PartSpec(SolidSpec, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A solid of a tree, or a combination of others."""

    half_space: HalfSpaceSpec | None = None
    union: Parts | None = None
    """All that is in any of these."""
    intersection: Parts | None = None
    """All that is in each of these."""
    difference: Parts | None = None
    """All that is in the first and in no other."""
    complement: PartSpec | None = None
    """All that is not in this."""

    def __post_init__(self) -> None:
        word = only_one(self, "a part of a boolean", WORDS)
        if word in ("union", "intersection", "difference"):
            _refuse_twins(word, getattr(self, word))


Parts = Annotated[tuple[PartSpec, ...], Meta(min_length=2, max_length=32)]


def _refuse_twins(word: str, parts: tuple[PartSpec, ...]) -> None:
    """Refuse the same part in the same place, which says nothing and takes long to mesh."""
    for i, part in enumerate(parts):
        if part in parts[:i]:
            raise ValueError(
                f"{word}[{i}] is the same as {word}[{parts.index(part)}], in the same place; "
                "move one, or leave it out"
            )


@lru_cache(maxsize=8)  # each check of a scene builds it again, and looks whether it is empty
def build_boolean(spec: PartSpec) -> BooleanShape:
    """The solid that a tree stands for.

    Raises
    ------
    ValueError
        If it is unbounded or empty.
    """
    from palpate.core.shapes.boolean import BooleanShape

    return BooleanShape(_tree(spec, IDENTITY))


def _tree(spec: PartSpec, outer: np.ndarray) -> Tree:
    from palpate.core.shapes import boolean_tree

    pose = compose(outer, pose_array(spec.pose))
    if spec.union is not None:
        return boolean_tree.Union(tuple(_tree(part, pose) for part in spec.union))
    if spec.intersection is not None:
        return boolean_tree.Intersection(tuple(_tree(part, pose) for part in spec.intersection))
    if spec.difference is not None:
        return boolean_tree.difference(*(_tree(part, pose) for part in spec.difference))
    if spec.complement is not None:
        return boolean_tree.complement(_tree(spec.complement, pose))
    if spec.half_space is not None:
        return _half_space(spec.half_space, pose)
    from palpate.core.shapes.posed_solid import PosedSolid

    return PosedSolid(build_solid(spec), pose)


def _half_space(spec: HalfSpaceSpec, pose: np.ndarray = IDENTITY) -> HalfSpace:
    from palpate.core.shapes.half_space import HalfSpace

    own = HalfSpace(np.array(spec.normal), spec.offset)
    position, axes = split_pose(pose)
    normal = axes @ own.normal
    return HalfSpace(normal, own.offset + float(normal @ position))
