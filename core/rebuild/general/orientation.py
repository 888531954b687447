"""Normals turned outwards where they agree with each other, or refused where they do not.

Points whose normals vary little from neighbour to neighbour form a patch, and their normals should
point to one side of it (Hoppe et al., *Surface reconstruction from unorganized points*, 1992). The
convex hull decides which side is outside: normals of points on it must point out of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.contours import ContactPoints


@dataclass(frozen=True, slots=True)
class OrientationSettings:
    """How normals are compared; tuned on balls, boxes, cups and plates with turned normals."""

    n_neighbors: int = 8  # nearest points with which each is compared
    min_alignment: float = 0.7  # least |cosine| between normals of neighbours on one patch
    max_offset: float = 0.5  # largest |cosine| between a normal and the direction to a neighbour
    min_patch: int = 4  # points; those of smaller patches count as unaligned
    max_unaligned: float = 0.5  # fraction of unaligned points, beyond which normals are refused
    max_minority: float = 0.35  # fraction of a patch on its other side; more is unclear
    max_unclear: float = 0.05  # fraction of points on unclear patches; more are refused
    hull_distance: float = 0.01  # fraction of the extent, up to which points lie on the hull
    min_hull_cosine: float = 0.3  # least cosine of a normal and the hull's, to vote for a side
    min_votes: int = 3  # majority of votes that decides a side of a patch
    max_hull_points: int = 2000  # used for the hull and its votes


class Orientation(NamedTuple):
    """Normals that point outwards."""

    contacts: ContactPoints
    turned: int  # Number of normals that were turned


def oriented(
    contacts: ContactPoints, settings: OrientationSettings = OrientationSettings()
) -> Orientation:
    """The same points with their unit normals (n, 3) outwards.

    Raises ValueError if normals disagree so much that the outside cannot be determined.
    """
    points, normals = contacts.points, np.asarray(contacts.normals)
    if len(points) <= settings.n_neighbors:
        return Orientation(contacts, 0)
    patch, sign, alone = _patches(points, normals, settings)
    share = float(alone.mean())
    if share > settings.max_unaligned:
        raise ValueError(
            f"patches.normals must agree with those beside them, got {share:.0%} that agree with "
            "none: are they normals of these points?"
        )
    sign = _outward_signs(points, normals, patch, sign, settings)
    turned = int(np.count_nonzero(sign < 0.0))
    outward = contacts if not turned else contacts._replace(normals=normals * sign[:, None])
    return Orientation(outward, turned)


def _patches(
    points: Floats, normals: Floats, settings: OrientationSettings
) -> tuple[NDArray[np.int32], Floats, Bools]:
    """Of each point, its patch, the side of its normal, 1 or -1, and whether it is unaligned."""
    count = len(points)
    neighbors = scipy.spatial.cKDTree(points).query(points, k=settings.n_neighbors + 1)
    distances, near = np.asarray(neighbors[0]), np.asarray(neighbors[1])
    rows = np.repeat(np.arange(count), settings.n_neighbors)
    columns, lengths = near[:, 1:].ravel(), distances[:, 1:].ravel()
    cosine = (normals[rows] * normals[columns]).sum(axis=1)
    towards = points[columns] - points[rows]
    offset = np.maximum(
        *(np.abs((towards * normals[ends]).sum(axis=1)) for ends in (rows, columns))
    )
    joined = np.abs(cosine) >= settings.min_alignment
    joined &= offset <= settings.max_offset * lengths
    rows, columns, cosine = rows[joined], columns[joined], cosine[joined]
    cost = 1.0 + 1e-6 - np.abs(cosine)  # above 0: a sparse 0 is no edge
    tree = scipy.sparse.csgraph.minimum_spanning_tree(
        scipy.sparse.csr_array((cost, (rows, columns)), shape=(count, count))
    )
    n_patches, patch = scipy.sparse.csgraph.connected_components(tree, directed=False)
    sign = _tree_signs(tree, normals, np.unique(patch, return_index=True)[1])
    # The side that most of a patch point to is +1.
    total = np.bincount(patch, sign, n_patches)
    sign *= np.where(total < 0.0, -1.0, 1.0)[patch]
    sizes = np.bincount(patch, minlength=n_patches)
    return patch.astype(np.int32), sign, (sizes < settings.min_patch)[patch]


def _tree_signs(tree: scipy.sparse.csr_array, normals: Floats, first: NDArray[np.intp]) -> Floats:
    """The sign (n,) of each normal against that of the `first` (p,) of its patch, along trees."""
    count = len(normals)
    edges = tree.tocoo()
    rows = np.concatenate([edges.row, np.full(len(first), count)])  # one root joins all trees
    columns, ones = np.concatenate([edges.col, first]), np.ones(len(rows))
    joined = scipy.sparse.csr_array((ones, (rows, columns)), shape=(count + 1, count + 1))
    order, before = scipy.sparse.csgraph.breadth_first_order(joined, count, directed=False)
    before = before[order[1:]]
    agree = (normals[order[1:]] * normals[np.minimum(before, count - 1)]).sum(axis=1) >= 0.0
    sign = np.ones(count + 1)
    steps = zip(order[1:].tolist(), before.tolist(), agree.tolist(), strict=True)
    for here, other, same in steps:
        sign[here] = sign[other] if same or other == count else -sign[other]
    return sign[:count]


def _outward_signs(
    points: Floats,
    normals: Floats,
    patch: NDArray[np.int32],
    sign: Floats,
    settings: OrientationSettings,
) -> Floats:
    """The sign (n,) of each normal, by the side on which the hull of all points lies.

    A patch without enough votes takes the side of most points of the patches that have them.
    """
    sizes = np.bincount(patch)
    minority = np.bincount(patch, sign < 0.0) / sizes
    votes = np.bincount(patch, sign * _hull_votes(points, normals, settings), len(sizes))
    least = np.minimum(settings.min_votes, sizes)
    known = np.abs(votes) >= least
    unclear = ~known & (minority > settings.max_minority)
    share = float(sizes[unclear].sum() / sizes.sum())
    if share > settings.max_unclear:
        raise ValueError(
            f"patches.normals must point to one side of the surface, got {share:.0%} of them where "
            "those beside disagree"
        )
    outward = float((np.sign(votes) * sizes)[known].sum()) >= 0.0
    other = 1.0 if outward else -1.0
    side = np.where(known, np.where(votes < 0.0, -1.0, 1.0), other)
    return np.asarray(sign * side[patch])


def _hull_votes(points: Floats, normals: Floats, settings: OrientationSettings) -> Floats:
    """Votes (n,): 1 if a point on the hull has an outward normal, -1 if inward, else 0."""
    votes = np.zeros(len(points))
    stride = -(-len(points) // settings.max_hull_points)
    some = np.arange(0, len(points), stride)
    try:
        faces = np.unique(
            scipy.spatial.ConvexHull(points[some], qhull_options="QJ").equations, axis=0
        )
    except scipy.spatial.QhullError:
        return votes
    heights = points[some] @ faces[:, :3].T + faces[:, 3]
    near = heights >= -settings.hull_distance * float(np.ptp(points, axis=0).max())
    cosines = normals[some] @ faces[:, :3].T
    high = np.where(near, cosines, -np.inf).max(axis=1)
    low = np.where(near, cosines, np.inf).min(axis=1)
    least = settings.min_hull_cosine
    votes[some] = np.where((high > least) & (low > -least), 1.0, 0.0)
    votes[some] -= np.where((low < -least) & (high < least), 1.0, 0.0)
    return votes
