"""Boolean combinations of solids, cast exactly: their trees, R-functions and meshes.

R-functions are the Boolean algebra of solids with f >= 0 inside: Fung, 1999, (2.33) to (2.37), in a
form without cancellation and overflow. With S the root of f1^2 + f2^2 - 2 omega f1 f2, the product
(f1 + f2 + S)(f1 + f2 - S) is 2 (1 + omega) f1 f2: of the two factors only the larger one is
computed from its sum.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry import signed_volume
from palpate.core.shapes.half_spaces import HalfSpace, polytope_box
from palpate.core.shapes.mending import arrays_of, as_manifold
from palpate.core.shapes.protocol import INSIDE, MISS, CsgSolid, ImplicitShape, Mesh

MAX_PARTS = 64  # solids and combinations of a tree
Leaf = CsgSolid | HalfSpace
LARGEST = float(np.finfo(np.float64).max)
SMALLEST = float(np.finfo(np.float64).smallest_subnormal)


@dataclass(frozen=True, slots=True, kw_only=True)
class BooleanSettings:
    """Tessellation of a combination of solids."""

    check_level: int = 3  # of the mesh whose volume is tested
    min_volume: float = 1e-9  # fraction of the box; smaller is rounding
    # With this number of solids or more, each is meshed one level coarser, with four times as many
    # two levels: the number of all facets hardly grows.
    many_solids: int = 8


class BooleanShape(ImplicitShape):
    """A tree of unions, intersections, differences and complements of solids.

    `tree`: of `Union`, `Intersection`, `difference` and `complement_of`. Raises ValueError if the
    tree has more than 64 parts, or the result is unbounded or empty. Fung, 1999, (2.31) to (2.35),
    regularised: parts without inside, as the face in which solids touch, are left out.
    """

    def __init__(self, tree: Tree, settings: BooleanSettings = BooleanSettings()):
        if has_more_parts(tree, MAX_PARTS):
            raise ValueError(f"the tree must have at most {MAX_PARTS} parts in all, got more")
        self._tree, self._settings = tree, settings
        self._leaves = tuple(tree_leaves(tree))
        self._box = tree_enclosure(tree)
        if not np.isfinite(self._box).all() and (self._box[0] < self._box[1]).all():
            raise ValueError(
                f"{unbounded_part(tree)} is unbounded; intersect it with a solid "
                "that is not, or take it out of a difference"
            )
        if not (self._box[0] < self._box[1]).all() or self._is_thin():
            raise ValueError("the tree leaves nothing: its solids have no inside in common")

    def enclosure(self) -> Floats:
        """A box around the result: see `ImplicitShape.enclosure`."""
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
        """Spans of parallel rays inside: see `CsgSolid.spans`."""
        places, inside = self._sections(origins, direction)
        ends = np.concatenate([places[:, 1:], np.full((len(places), 1), np.inf)], axis=1)
        places, ends = (np.where(inside, at, np.inf) for at in (places, ends))
        return np.asarray(np.sort(np.stack([places, ends], axis=2), axis=1))

    def mesh(self, level: int) -> Mesh:
        """The combination of the leaves' tessellations: see `Shape.mesh`."""
        many = self._settings.many_solids
        coarser = sum(len(self._leaves) >= count for count in (many, 4 * many))
        return combined_mesh(self._tree, self._box, max(level - coarser, 0))

    def _is_thin(self) -> bool:
        vertices, faces = combined_mesh(self._tree, self._box, self._settings.check_level)
        volume = signed_volume((vertices - self._box[0])[faces])
        whole = float(np.prod(self._box[1] - self._box[0]))
        return volume <= self._settings.min_volume * whole

    def _sections(self, origins: Floats, direction: Floats) -> tuple[Floats, Bools]:
        """Places (n, e) at which rays pass the leaves' surfaces, in order along each ray.

        Also (n, e): whether the ray is inside the result from each place to the next.
        """
        spans = [leaf.spans(origins, direction) for leaf in self._leaves]
        places = np.concatenate([span.reshape(len(origins), -1) for span in spans], axis=1)
        order = places.argsort(axis=1, kind="stable")
        places = np.take_along_axis(places, order, axis=1)
        leaf = np.repeat(np.arange(len(spans)), [2 * span.shape[1] for span in spans])
        turn = np.concatenate([np.tile([1, -1], span.shape[1]) for span in spans])
        leaf, turn = leaf[order], turn[order]
        states = (np.cumsum(np.where(leaf == n, turn, 0), axis=1) > 0 for n in range(len(spans)))
        inside = tree_membership(self._tree, iter(states))
        last = np.ones_like(inside)  # of several ends in one place the last decides
        last[:, :-1] = places[:, 1:] > places[:, :-1]
        return places, inside & last & (places < np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class _Joined:
    parts: tuple[Tree, ...]

    def __post_init__(self) -> None:
        if len(self.parts) < 2:
            name = type(self).__name__.lower()
            raise ValueError(f"{name} must have at least 2 parts, got {len(self.parts)}")


class Union(_Joined):
    """Points in any of the `parts`."""

    __slots__ = ()


class Intersection(_Joined):
    """Points in all of the `parts`."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, eq=False)
class Complement:
    """Points outside the part."""

    part: Tree


def difference(first: Tree, *removed: Tree) -> Intersection:
    """Points in the first part and in none of the removed ones."""
    if not removed:
        raise ValueError("difference must have at least 2 parts, got 1")
    return Intersection((first, *(complement_of(part) for part in removed)))


def with_inner_complement(tree: Tree) -> Tree:
    """Equivalent tree whose root is a complement only if it is that of a solid (De Morgan)."""
    if isinstance(tree, Complement) and isinstance(tree.part, _Joined):
        parts = tuple(complement_of(part) for part in tree.part.parts)
        return Intersection(parts) if isinstance(tree.part, Union) else Union(parts)
    return tree


def complement_of(part: Tree) -> Tree:
    """Points outside the part; of a complement its part, of a half-space the opposite one."""
    if isinstance(part, Complement):
        return part.part
    return part.complement() if isinstance(part, HalfSpace) else Complement(part)


def has_more_parts(tree: Tree, most: int) -> bool:
    """Whether a tree of any depth has more than `most` solids and combinations."""
    count, ahead = 0, [tree]
    while ahead and count <= most:
        count += 1
        ahead.extend(_parts(ahead.pop()))
    return count > most


def tree_leaves(tree: Tree) -> Iterator[Leaf]:
    """The solids of a tree, in the order of all functions here."""
    if isinstance(tree, (_Joined, Complement)):
        for part in _parts(tree):
            yield from tree_leaves(part)
    else:
        yield tree


def _parts(tree: Tree) -> tuple[Tree, ...]:
    if isinstance(tree, Complement):
        return (tree.part,)
    return tree.parts if isinstance(tree, _Joined) else ()


def tree_membership(tree: Tree, states: Iterator[Bools]) -> Bools:
    """Whether places are in the result, from whether they are in each leaf."""
    if isinstance(tree, Complement):
        return ~tree_membership(tree.part, states)
    if isinstance(tree, _Joined):
        combine = np.logical_or if isinstance(tree, Union) else np.logical_and
        return np.asarray(combine.reduce([tree_membership(part, states) for part in tree.parts]))
    return next(states)


def unbounded_part(tree: Tree, name: str = "the tree") -> str:
    """Name of the smallest part that makes a tree unbounded."""
    if isinstance(tree, Union):
        for number, part in enumerate(tree.parts):
            if not np.isfinite(tree_enclosure(part)).all():
                return unbounded_part(part, f"union[{number}] of {name}")
    kinds = {Union: "union", Intersection: "intersection", Complement: "complement"}
    return f"the {kinds.get(type(tree), 'half-space')} that is {name}"


def tree_enclosure(tree: Tree) -> Floats:
    """Corners of an upright box around the result, (2, 3) [m], infinite where it is unbounded."""
    tree = with_inner_complement(tree)
    if isinstance(tree, Complement):
        return np.array([[-np.inf] * 3, [np.inf] * 3])
    if not isinstance(tree, _Joined):
        return tree.enclosure()
    parts = tuple(_factors(tree)) if isinstance(tree, Intersection) else tree.parts
    boxes = np.array([tree_enclosure(part) for part in parts])
    if isinstance(tree, Union):
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    return _cut_box(np.stack([boxes[:, 0].max(axis=0), boxes[:, 1].min(axis=0)]), parts)


def _factors(tree: Tree) -> Iterator[Tree]:
    tree = with_inner_complement(tree)
    if isinstance(tree, Intersection):
        for part in tree.parts:
            yield from _factors(part)
    else:
        yield tree


def _cut_box(box: Floats, parts: tuple[Tree, ...]) -> Floats:
    cuts = [part for part in parts if isinstance(part, HalfSpace)]
    if not cuts:
        return box
    bounds = np.concatenate([-box[0], box[1]])
    known = np.isfinite(bounds)
    normals = np.concatenate([np.concatenate([-np.eye(3), np.eye(3)])[known],
                              [cut.normal for cut in cuts]])  # fmt: skip
    return polytope_box(normals, np.concatenate([bounds[known], [cut.offset for cut in cuts]]))


def combined_mesh(tree: Tree, box: Floats, level: int, room: float = 3.0) -> Mesh:
    """Closed mesh by the manifold library.

    `box` (2, 3): contains the result [m]. `room`: size of the cube to which unbounded parts are
    cut, over the box's diagonal.
    """
    extent = float(np.linalg.norm(box[1] - box[0]))
    solid = _combined(tree, box.mean(axis=0), room * extent, level)
    # A plane needs few facets, but more if it is deformed later.
    return Mesh(*arrays_of(solid.refine_to_length(extent / 2**level)))


def _combined(tree: Tree, middle: Floats, size: float, level: int) -> Any:
    from manifold3d import Manifold, OpType

    def joined(parts: Sequence[Tree], kind: Any) -> Any:
        solids = [_combined(part, middle, size, level) for part in parts]
        return Manifold.batch_boolean(solids, kind)

    tree = with_inner_complement(tree)
    cube = Manifold.cube((size, size, size), True).translate(tuple(middle))
    if isinstance(tree, Complement):
        return cube - _combined(tree.part, middle, size, level)
    if isinstance(tree, Union):
        return joined(tree.parts, OpType.Add)
    if isinstance(tree, Intersection):
        # A difference is subtracted, without the cube that a complement would need.
        kept = [part for part in tree.parts if not isinstance(part, Complement)]
        taken = [part.part for part in tree.parts if isinstance(part, Complement)]
        solid = joined(kept, OpType.Intersect) if kept else cube
        return solid - joined(taken, OpType.Add)
    if isinstance(tree, HalfSpace):
        return cube.trim_by_plane(tuple(-tree.normal), -tree.offset)
    solid = as_manifold(*tree.mesh(level))
    if solid is None:
        raise ValueError("a leaf's tessellation is not closed")
    return solid


def tree_function(tree: Tree, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """The R-function of the leaves, and its slope. Negative inside, unions are conjunctions."""
    if isinstance(tree, Complement):
        value, slope = tree_function(tree.part, points, directions)
        return -value, -slope
    if not isinstance(tree, _Joined):
        return tree.inside_out(points, directions)
    join, slopes = disjunction, disjunction_slopes
    if isinstance(tree, Union):
        join, slopes = conjunction, conjunction_slopes

    def joined(a: tuple[Floats, Floats], b: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        by_a, by_b = slopes(a[0], b[0])
        return join(a[0], b[0]), by_a * a[1] + by_b * b[1]

    return reduce(joined, (tree_function(part, points, directions) for part in tree.parts))


def conjunction(f1: ArrayLike, f2: ArrayLike, omega: float = 0.0, *, smoothness: int = 0) -> Floats:
    """Intersection of two solids.

    `f1` and `f2`: values of the defining functions, positive inside. `omega`: above -1, at most 1.
    With 1 it is the minimum; 0 is the usual choice. `smoothness`: order of the derivatives that
    exist where both functions vanish. The value is multiplied by this power of the functions' size:
    (2.37). The result is positive where both are. On overflow or underflow it is clipped and keeps
    its sign. Raises ValueError if a value is not finite, omega not in (-1, 1], or the smoothness
    negative.
    """
    return -disjunction(complement(f1), complement(f2), omega, smoothness=smoothness)


def disjunction(f1: ArrayLike, f2: ArrayLike, omega: float = 0.0, *, smoothness: int = 0) -> Floats:
    """Union of two solids; parameters, result and errors as of `conjunction`."""
    first, second, a, b, power, root = _scaled(f1, f2, omega, smoothness)
    total = a + b
    factor = np.abs(total) + root
    one_is_larger = np.abs(first) >= np.abs(second)
    smaller = np.where(one_is_larger, second, first)
    larger = np.abs(np.where(one_is_larger, a, b))
    safe = np.where(factor > 0.0, factor, 1.0)
    with np.errstate(over="ignore"):
        added = np.ldexp(factor / (1.0 + omega), power)
        # Unscaled, so that a value far smaller than the other one is kept.
        value = np.where(total >= 0.0, added, 2.0 * (larger / safe) * smaller)
        if smoothness:
            value = value * np.minimum(np.hypot(first, second) ** smoothness, LARGEST)
    sign = np.where(total >= 0.0, (factor > 0.0).astype(float), np.sign(smaller))
    return np.asarray(sign * np.clip(np.abs(value), SMALLEST, LARGEST))


def complement(f: ArrayLike) -> Floats:
    """Complement of a solid: -f."""
    return -_finite("f", f)


def conjunction_slopes(
    f1: ArrayLike, f2: ArrayLike, omega: float = 0.0, *, smoothness: int = 0
) -> tuple[Floats, Floats]:
    """Derivatives of `conjunction` by f1 and by f2; parameters and errors as there.

    Where there is no derivative (both functions vanish; with omega 1, they are equal) each is 1 /
    (1 + omega), the mean of nearby values; with a smoothness, 0.
    """
    first, second, a, b, _, root = _scaled(f1, f2, omega, smoothness)
    by_first, by_second = _slope(a, b, root, omega), _slope(b, a, root, omega)
    if not smoothness:
        return by_first, by_second
    size = np.hypot(a, b)
    safe = np.where(size > 0.0, size, 1.0)
    value = conjunction(a / safe, b / safe, omega)
    with np.errstate(over="ignore"):
        growth = np.minimum(np.hypot(first, second) ** smoothness, LARGEST)
        by_first = growth * (by_first + smoothness * value * a / safe)
        by_second = growth * (by_second + smoothness * value * b / safe)
    return np.clip(by_first, -LARGEST, LARGEST), np.clip(by_second, -LARGEST, LARGEST)


def disjunction_slopes(
    f1: ArrayLike, f2: ArrayLike, omega: float = 0.0, *, smoothness: int = 0
) -> tuple[Floats, Floats]:
    """Derivatives of `disjunction` by f1 and by f2; see `conjunction_slopes`."""
    return conjunction_slopes(complement(f1), complement(f2), omega, smoothness=smoothness)


def _slope(own: Floats, other: Floats, root: Floats, omega: float) -> Floats:
    """(1 - (own - omega other) / S) / (1 + omega), as a sum of terms of one sign."""
    # The exact difference comes first, for small rounding errors as omega nears 1 or -1.
    if omega > 0.0:
        lean = (own - other) + (1.0 - omega) * other
    else:
        lean = (own + other) - (1.0 + omega) * other
    safe = np.where(root > 0.0, root, 1.0)
    share, lean = other / safe, lean / safe
    small = (1.0 - omega) * share * share / (1.0 + np.maximum(lean, 0.0))
    large = (1.0 - np.minimum(lean, 0.0)) / (1.0 + omega)
    slope = np.where(lean > 0.0, small, large)
    return np.where(root > 0.0, slope, 1.0 / (1.0 + omega))


def _scaled(
    f1: ArrayLike, f2: ArrayLike, omega: float, smoothness: int
) -> tuple[Floats, Floats, Floats, Floats, Ints, Floats]:
    """Both values; both over 2^power, so that the larger is 1/2 to 1; the power; scaled S."""
    if not -1.0 < omega <= 1.0:
        raise ValueError(f"omega must be above -1 and at most 1, got {omega}")
    if smoothness < 0:
        raise ValueError(f"smoothness must be 0 or more, got {smoothness}")
    first, second = np.broadcast_arrays(_finite("f1", f1), _finite("f2", f2))
    power = np.frexp(np.maximum(np.abs(first), np.abs(second)))[1]
    a, b = np.ldexp(first, -power), np.ldexp(second, -power)
    apart, together = math.sqrt(0.5 * (1.0 + omega)), math.sqrt(0.5 * (1.0 - omega))
    return first, second, a, b, power, np.hypot(apart * (a - b), together * (a + b))


def _finite(name: str, value: ArrayLike) -> Floats:
    array = np.asarray(value, dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return array


Tree = Leaf | Union | Intersection | Complement
