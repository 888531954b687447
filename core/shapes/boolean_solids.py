"""Boolean combinations of solids, cast exactly, so that edges stay sharp; and their trees."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.geometry import signed_volume
from palpate.core.shapes.half_spaces import HalfSpace, polytope_box
from palpate.core.shapes.protocol import INSIDE, MISS, BoundedCsgSolid, Mesh
from palpate.core.shapes.r_functions import (
    conjunction,
    conjunction_slopes,
    disjunction,
    disjunction_slopes,
)

CHECK_LEVEL = 3
LEAST_VOLUME = 1e-9  # Of the box about it; what has less is rounding
BOUNDS_LEVEL = 6
# Of so many solids and more, each is meshed a level coarser, and again for four times as many:
# together they have no more facets than a few.
MANY_LEAVES = 8
MOST_PARTS = 64  # Solids and combinations of a tree
Leaf = BoundedCsgSolid | HalfSpace


class BooleanShape:
    """A tree of unions, intersections, differences and complements of solids.

    `tree`: see `boolean_tree`. Raises ValueError if the tree has more than 64 parts, or the whole
    is unbounded or empty.

    Fung, 1999, (2.31) to (2.35). The combination is regularised: what has no inside, such as
    the face in which two solids touch, is left out.
    """

    def __init__(self, tree: Tree):
        if has_more_parts(tree, MOST_PARTS):
            raise ValueError(f"the tree must have at most {MOST_PARTS} parts in all, got more")
        self._tree = tree
        self._leaves = tuple(tree_leaves(tree))
        self._box = tree_enclosure(tree)
        if not np.isfinite(self._box).all() and (self._box[0] < self._box[1]).all():
            raise ValueError(
                f"{unbounded_part(tree)} is unbounded; intersect it with a solid "
                "that is not, or take it out of a difference"
            )
        if not (self._box[0] < self._box[1]).all() or self._is_thin():
            raise ValueError("the tree leaves nothing: its solids have no inside in common")

    def bounds(self) -> Floats:
        """Smallest and largest coordinates of a fine tessellation, (2, 3), m."""
        vertices = self.mesh(BOUNDS_LEVEL).vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])

    def enclosure(self) -> Floats:
        """A box about the whole: see `ImplicitShape.enclosure`."""
        return self._box

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """The R-function of the leaves' functions: see `ImplicitShape.inside_out`."""
        return tree_function(self._tree, points, directions)

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        places, inside = self._sections(origins, direction)
        ahead = places > 0.0
        entered = inside & ahead & (places <= reach)
        ranges: Floats = np.where(entered, places, MISS).min(axis=1)
        passed = np.count_nonzero(~ahead, axis=1)
        now = np.take_along_axis(inside, np.maximum(passed - 1, 0)[:, None], axis=1)[:, 0]
        ranges[(passed > 0) & now] = INSIDE
        return ranges

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays are inside: see `spans`."""
        places, inside = self._sections(origins, direction)
        ends = np.concatenate([places[:, 1:], np.full((len(places), 1), np.inf)], axis=1)
        places, ends = (np.where(inside, one, np.inf) for one in (places, ends))
        return np.asarray(np.sort(np.stack([places, ends], axis=2), axis=1))

    def mesh(self, level: int) -> Mesh:
        """The combination of the leaves' tessellations: see `Shape.mesh`."""
        from palpate.core.shapes.boolean_meshes import combined_mesh

        coarser = sum(len(self._leaves) >= many for many in (MANY_LEAVES, 4 * MANY_LEAVES))
        return combined_mesh(self._tree, self._box, max(level - coarser, 0))

    def _is_thin(self) -> bool:
        from palpate.core.shapes.boolean_meshes import combined_mesh

        vertices, faces = combined_mesh(self._tree, self._box, CHECK_LEVEL)
        volume = signed_volume((vertices - self._box[0])[faces])
        return volume <= LEAST_VOLUME * float(np.prod(self._box[1] - self._box[0]))

    def _sections(self, origins: Floats, direction: Floats) -> tuple[Floats, Bools]:
        """Places at which rays pass a leaf's surface, (n, e) in order, and what follows each.

        That is whether the ray is inside from there to the next place.
        """
        spans = [leaf.spans(origins, direction) for leaf in self._leaves]
        places = np.concatenate([one.reshape(len(origins), -1) for one in spans], axis=1)
        order = places.argsort(axis=1, kind="stable")
        places = np.take_along_axis(places, order, axis=1)
        leaf = np.repeat(np.arange(len(spans)), [2 * one.shape[1] for one in spans])
        turn = np.concatenate([np.tile([1, -1], one.shape[1]) for one in spans])
        leaf, turn = leaf[order], turn[order]
        states = (np.cumsum(np.where(leaf == n, turn, 0), axis=1) > 0 for n in range(len(spans)))
        inside = tree_membership(self._tree, iter(states))
        # Of ends in one place only the last says what comes then.
        last = np.ones_like(inside)
        last[:, :-1] = places[:, 1:] > places[:, :-1]
        return places, inside & last & (places < np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class Union:
    """All that is in any of the parts."""

    parts: tuple[Tree, ...]

    def __post_init__(self) -> None:
        _check_parts("union", self.parts)


@dataclass(frozen=True, slots=True, eq=False)
class Intersection:
    """All that is in each of the parts."""

    parts: tuple[Tree, ...]

    def __post_init__(self) -> None:
        _check_parts("intersection", self.parts)


@dataclass(frozen=True, slots=True, eq=False)
class Complement:
    """All that is not in the part."""

    part: Tree


def difference(first: Tree, *others: Tree) -> Intersection:
    """All that is in the first and in none of the others."""
    _check_parts("difference", (first, *others))
    return Intersection((first, *(complement_of(other) for other in others)))


def _check_parts(name: str, parts: tuple[Tree, ...]) -> None:
    if len(parts) < 2:
        raise ValueError(f"{name} must have at least 2 parts, got {len(parts)}")


def with_inner_complement(tree: Tree) -> Tree:
    """The same whole, outermost a complement only if it is that of a solid (De Morgan)."""
    if isinstance(tree, Complement) and isinstance(tree.part, (Union, Intersection)):
        parts = tuple(complement_of(part) for part in tree.part.parts)
        return Intersection(parts) if isinstance(tree.part, Union) else Union(parts)
    return tree


def complement_of(part: Tree) -> Tree:
    """All that is not in the part; twice that is the part, and a half-space has another."""
    if isinstance(part, Complement):
        return part.part
    return part.complement() if isinstance(part, HalfSpace) else Complement(part)


def tree_leaves(tree: Tree) -> Iterator[Leaf]:
    """The solids of a tree, in the order in which all functions here take them."""
    if isinstance(tree, Complement):
        yield from tree_leaves(tree.part)
    elif isinstance(tree, (Union, Intersection)):
        for part in tree.parts:
            yield from tree_leaves(part)
    else:
        yield tree


def has_more_parts(tree: Tree, most: int) -> bool:
    """Whether a tree has more solids and combinations than that, however deep it is."""
    count, ahead = 0, [tree]
    while ahead and count <= most:
        part = ahead.pop()
        count += 1
        if isinstance(part, Complement):
            ahead.append(part.part)
        elif isinstance(part, (Union, Intersection)):
            ahead.extend(part.parts)
    return count > most


def tree_membership(tree: Tree, states: Iterator[Bools]) -> Bools:
    """Whether places are in the whole, from whether they are in each leaf."""
    if isinstance(tree, Complement):
        return ~tree_membership(tree.part, states)
    if isinstance(tree, (Union, Intersection)):
        combine = np.logical_or if isinstance(tree, Union) else np.logical_and
        found: Bools = combine.reduce([tree_membership(part, states) for part in tree.parts])
        return found
    return next(states)


def tree_function(tree: Tree, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """The R-function of the leaves' functions, negative inside, and its slope, (n,) each.

    Fung, 1999, (2.34) and (2.35). An R-function is positive inside, ours are negative: so
    the conjunction joins what the union wants.
    """
    if isinstance(tree, Complement):
        value, slope = tree_function(tree.part, points, directions)
        return -value, -slope
    if not isinstance(tree, (Union, Intersection)):
        return tree.inside_out(points, directions)
    united = isinstance(tree, Union)
    join, slopes = (
        (conjunction, conjunction_slopes) if united else (disjunction, disjunction_slopes)
    )

    def joined(one: tuple[Floats, Floats], two: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        by_one, by_two = slopes(one[0], two[0])
        return join(one[0], two[0]), by_one * one[1] + by_two * two[1]

    return reduce(joined, (tree_function(part, points, directions) for part in tree.parts))


def unbounded_part(tree: Tree, name: str = "the tree") -> str:
    """Name of the smallest part to which it is due that a tree is unbounded."""
    if isinstance(tree, Union):
        for number, part in enumerate(tree.parts):
            if not np.isfinite(tree_enclosure(part)).all():
                return unbounded_part(part, f"union[{number}] of {name}")
    kinds = {Union: "union", Intersection: "intersection", Complement: "complement"}
    return f"the {kinds.get(type(tree), 'half-space')} that is {name}"


def tree_enclosure(tree: Tree) -> Floats:
    """Corners of an upright box about the whole, (2, 3), infinite where it is unbounded, m."""
    tree = with_inner_complement(tree)
    if isinstance(tree, Complement):
        return np.array([[-np.inf] * 3, [np.inf] * 3])
    if not isinstance(tree, (Union, Intersection)):
        return tree.enclosure()
    parts = tuple(_factors(tree)) if isinstance(tree, Intersection) else tree.parts
    boxes = np.array([tree_enclosure(part) for part in parts])
    if isinstance(tree, Union):
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    return _cut_box(np.stack([boxes[:, 0].max(axis=0), boxes[:, 1].min(axis=0)]), parts)


def _factors(tree: Tree) -> Iterator[Tree]:
    """What is intersected in the whole, however it is nested."""
    tree = with_inner_complement(tree)
    if isinstance(tree, Intersection):
        for part in tree.parts:
            yield from _factors(part)
    else:
        yield tree


def _cut_box(box: Floats, parts: tuple[Tree, ...]) -> Floats:
    """A box, cut by those of the parts that are half-spaces."""
    cuts = [part for part in parts if isinstance(part, HalfSpace)]
    if not cuts:
        return box
    bounds = np.concatenate([-box[0], box[1]])
    known = np.isfinite(bounds)
    normals = np.concatenate([np.concatenate([-np.eye(3), np.eye(3)])[known],
                              [cut.normal for cut in cuts]])  # fmt: skip
    return polytope_box(normals, np.concatenate([bounds[known], [cut.offset for cut in cuts]]))


Tree = Leaf | Union | Intersection | Complement
