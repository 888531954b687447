"""Trees of solids: unions, intersections and complements, and what holds for them.

A tree is told what holds for its leaves, as arrays, and says what holds for the whole. A
difference is an intersection with a complement.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.shapes.half_space import HalfSpace
from palpate.core.shapes.polytope import polytope_box
from palpate.core.shapes.r_functions import (
    conjunction,
    conjunction_slopes,
    disjunction,
    disjunction_slopes,
)
from palpate.core.shapes.spans import BoundedSolid

Leaf = BoundedSolid | HalfSpace


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


Tree = Leaf | Union | Intersection | Complement


def difference(first: Tree, *others: Tree) -> Intersection:
    """All that is in the first and in none of the others."""
    _check_parts("difference", (first, *others))
    return Intersection((first, *(complement(other) for other in others)))


def complement(part: Tree) -> Tree:
    """All that is not in the part; twice that is the part, and a half-space has another."""
    if isinstance(part, Complement):
        return part.part
    return part.complement() if isinstance(part, HalfSpace) else Complement(part)


def turned_outwards(tree: Tree) -> Tree:
    """The same whole, outermost a complement only if it is that of a solid (De Morgan)."""
    if isinstance(tree, Complement) and isinstance(tree.part, (Union, Intersection)):
        parts = tuple(complement(part) for part in tree.part.parts)
        return Intersection(parts) if isinstance(tree.part, Union) else Union(parts)
    return tree


def leaves(tree: Tree) -> Iterator[Leaf]:
    """The solids of a tree, in the order in which all functions here take them."""
    if isinstance(tree, Complement):
        yield from leaves(tree.part)
    elif isinstance(tree, (Union, Intersection)):
        for part in tree.parts:
            yield from leaves(part)
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


def within(tree: Tree, states: Iterator[Bools]) -> Bools:
    """Whether places are in the whole, from whether they are in each leaf."""
    if isinstance(tree, Complement):
        return ~within(tree.part, states)
    if isinstance(tree, (Union, Intersection)):
        combine = np.logical_or if isinstance(tree, Union) else np.logical_and
        found: Bools = combine.reduce([within(part, states) for part in tree.parts])
        return found
    return next(states)


def value_and_slope(tree: Tree, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """The R-function of the leaves' functions, negative inside, and its slope, (n,) each.

    Notes
    -----
    Fung, 1999, (2.34) and (2.35). An R-function is positive inside, ours are negative: so
    the conjunction joins what the union wants.
    """
    if isinstance(tree, Complement):
        value, slope = value_and_slope(tree.part, points, directions)
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

    return reduce(joined, (value_and_slope(part, points, directions) for part in tree.parts))


def enclosure(tree: Tree) -> Floats:
    """Corners of an upright box about the whole, (2, 3), infinite where it is unbounded, m."""
    tree = turned_outwards(tree)
    if isinstance(tree, Complement):
        return np.array([[-np.inf] * 3, [np.inf] * 3])
    if not isinstance(tree, (Union, Intersection)):
        return tree.enclosure()
    parts = tuple(_factors(tree)) if isinstance(tree, Intersection) else tree.parts
    boxes = np.array([enclosure(part) for part in parts])
    if isinstance(tree, Union):
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    return _cut_box(np.stack([boxes[:, 0].max(axis=0), boxes[:, 1].min(axis=0)]), parts)


def unbounded_part(tree: Tree, name: str = "the tree") -> str:
    """Name of the smallest part to which it is due that a tree is unbounded."""
    if isinstance(tree, Union):
        for number, part in enumerate(tree.parts):
            if not np.isfinite(enclosure(part)).all():
                return unbounded_part(part, f"union[{number}] of {name}")
    kinds = {Union: "union", Intersection: "intersection", Complement: "complement"}
    return f"the {kinds.get(type(tree), 'half-space')} that is {name}"


def _factors(tree: Tree) -> Iterator[Tree]:
    """What is intersected in the whole, however it is nested."""
    tree = turned_outwards(tree)
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


def _check_parts(name: str, parts: tuple[Tree, ...]) -> None:
    if len(parts) < 2:
        raise ValueError(f"{name} must have at least 2 parts, got {len(parts)}")
