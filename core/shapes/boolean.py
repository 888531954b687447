"""Boolean combinations of solids, cast exactly: edges stay sharp.

On each ray all leaves' spans are put in one order, and the tree is asked once for every place
between two of their ends whether it is inside there (Roth, 1982). The function of the whole is
the R-function of its leaves'; its zeros are those of the combination, but rays do not need it.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.shapes import boolean_tree
from palpate.core.shapes.boolean_tree import Tree
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh

CHECK_LEVEL = 3
LEAST_VOLUME = 1e-9
"""Of the box about it; what has less is rounding."""
BOUNDS_LEVEL = 6
MANY_LEAVES = 8
"""Of so many solids and more, each is meshed a level coarser, and again for four times as many:
together they have no more facets than a few."""
MOST_PARTS = 64
"""Solids and combinations of a tree."""


class BooleanShape:
    """A tree of unions, intersections, differences and complements of solids.

    Parameters
    ----------
    tree : Tree
        See `boolean_tree`.

    Raises
    ------
    ValueError
        If the tree has more than 64 parts, or the whole is unbounded or empty.

    Notes
    -----
    Fung, 1999, (2.31) to (2.35). The combination is regularised: what has no inside, such as
    the face in which two solids touch, is left out.
    """

    def __init__(self, tree: Tree):
        if boolean_tree.has_more_parts(tree, MOST_PARTS):
            raise ValueError(f"the tree must have at most {MOST_PARTS} parts in all, got more")
        self._tree = tree
        self._leaves = tuple(boolean_tree.leaves(tree))
        self._box = boolean_tree.enclosure(tree)
        if not np.isfinite(self._box).all() and (self._box[0] < self._box[1]).all():
            raise ValueError(
                f"{boolean_tree.unbounded_part(tree)} is unbounded; intersect it with a solid "
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
        return boolean_tree.value_and_slope(self._tree, points, directions)

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
        from palpate.core.shapes.boolean_mesh import combined_mesh

        coarser = sum(len(self._leaves) >= many for many in (MANY_LEAVES, 4 * MANY_LEAVES))
        return combined_mesh(self._tree, self._box, max(level - coarser, 0))

    def _is_thin(self) -> bool:
        from palpate.core.shapes.boolean_mesh import combined_mesh

        vertices, faces = combined_mesh(self._tree, self._box, CHECK_LEVEL)
        a, b, c = (vertices - self._box[0])[faces].transpose(1, 0, 2)
        volume = float(np.einsum("ni,ni->", a, np.cross(b, c))) / 6.0
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
        inside = boolean_tree.within(self._tree, iter(states))
        # Of ends in one place only the last says what comes then.
        last = np.ones_like(inside)
        last[:, :-1] = places[:, 1:] > places[:, :-1]
        return places, inside & last & (places < np.inf)
