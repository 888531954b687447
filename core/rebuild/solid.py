"""A rebuilt solid: an exact closed surface, how it came about, and figures of how far to trust it.

Its control lattice is carried along by the slicing frame, deformed and undeformed control points
alike. The shear of its ends moves the deformed ones alone, for it is part of the deformation:
exact where both ends are parallel, else as near as the knots are close together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.geometry import self_intersection, solidity
from palpate.core.poses import split_pose
from palpate.core.rebuild.closed_sides import ContourSolid, refine_solid
from palpate.core.rebuild.contours import Slices, into_frame
from palpate.core.rebuild.deviation import whole_deviation
from palpate.core.rebuild.ends import End, Shear
from palpate.core.rebuild.evidence import Evidence
from palpate.core.rebuild.lattice import LatticeFit
from palpate.core.rebuild.loft import Uncertainty
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.surface import (
    DEFAULT_TOLERANCE,
    EndPatch,
    SampledPatch,
    SolidMeasures,
    Surface,
    SurfaceMesh,
    SurfaceSearch,
    measure_surface,
    mesh_surface,
    placed,
    search_surface,
)
from palpate.core.splines import (
    Lattice,
    Parallelepiped,
    SplineVolume,
    evaluate_grid,
    interpolate_grid,
)
from palpate.core.thesis import ThesisSolid

Method = Literal["lattice", "skin", "thesis", "coarse"]
# Places of the side at which it is seen whether it swings out.
OVERSHOOT_ROWS, OVERSHOOT_TURNS = 97, 160
NOISE_SHARE = 0.2  # Of the noise: the tolerance of a mesh where none is asked for
Figures = dict[str, float]


class MeshCheck(NamedTuple):
    """What a solid's mesh is like as a body."""

    watertight: bool  # Each edge has two faces, which run along it in opposite directions
    genus: int | None  # 0 without a hole through it; None unless watertight
    self_intersections: int  # Pairs of triangles that cross


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Solid:
    """A closed solid, and how it came about; lengths in the unit of the contours.

    What it answers is in the world, but heights, which count along the z axis of the slicing
    frame; where ends are slanted, over its middle. What is kept of how it came about is seen from
    that frame: evidence, skin and ends, lattice, model.
    """

    # Exact at every place: points, normals, curvatures, in no resolution. In the world.
    surface: Surface
    method: Method  # How it was rebuilt
    evidence: Evidence  # From what
    closed: ContourSolid | None = None  # Skin and ends, with the methods "lattice" and "skin"
    # Control lattice and what it deforms, with the method "lattice"; see `control_lattice`.
    lattice: LatticeFit | None = None
    model: ThesisSolid | Recovery | None = None  # What the methods "thesis" and "coarse" found
    # Rebuilds it in the same way from other evidence.
    again: Callable[[Evidence], Solid] | None = None

    @property
    def slices(self) -> Slices:
        """The contours that were used, and those that were not, and why."""
        return self.evidence.slices

    @property
    def frame(self) -> Floats | None:
        """Pose (7,) of the slicing frame in the world; None if it is the world's own."""
        return self.evidence.frame

    @property
    def control_lattice(self) -> Lattice | None:
        """The control lattice in the world; None with the methods "skin" and "coarse"."""
        part = self.model if isinstance(self.model, ThesisSolid) else self.lattice
        shear = None if self.closed is None else self.closed.shear
        return None if part is None else moved_lattice(part.lattice, self.frame, shear)

    def update(self, contour: ArrayLike, *, height: float | None = None) -> Solid:
        """The solid with one contour more: that of all contours at once, in any order.

        Other contours need not be made into curves again, which is most of the work.

        Parameters
        ----------
        contour : (n, 3) array, or (n, 2) with `height`
            As for `reconstruct`, in the world.
        height : float, optional
            Of a plane contour, if there is no slicing frame.

        Raises
        ------
        ValueError
            As `reconstruct` does; or if the solid was not made by it.
        """
        if self.again is None:
            raise ValueError("solid must be rebuilt by reconstruct to be updated, got another")
        return self.again(self.evidence.more(contour, height))

    def mesh(self, tolerance: float | None = None) -> SurfaceMesh:
        """Triangles that leave the surface by at most a tolerance: see `mesh_surface`.

        If none is asked for, noise sets it as well: finer triangles would show nothing more.
        """
        if tolerance is None and self.closed is not None:
            noise = NOISE_SHARE * self.closed.skin.health.sigma
            tolerance = max(DEFAULT_TOLERANCE * self.surface.size, noise)
        return mesh_surface(self.surface, tolerance)

    def check(self) -> MeshCheck:
        """What the mesh is like as a body; looking for triangles that cross takes a while."""
        mesh = self.mesh()
        body = solidity(mesh.vertices, mesh.faces)
        crossings = self_intersection(mesh.vertices, mesh.faces).count
        return MeshCheck(body.watertight, body.genus, crossings)

    def measures(self) -> SolidMeasures:
        """Volume, centroid, second moments, inertia and area."""
        return measure_surface(self.surface)

    def search(self) -> SurfaceSearch:
        """Nearest points, signed distances and what lies inside: prepared once for many points."""
        return search_surface(self.surface)

    def refined(
        self, points: ArrayLike, *, sigma: float | None = None, weights: bool = False
    ) -> Solid:
        """The solid after its control lattice was changed so that the side passes points.

        Parameters
        ----------
        points : (n, 3) array
            Further points of the object, in the world. Those nearest to an end are counted, not
            passed.
        sigma : float, optional
            Their standard deviation: the side is drawn only as near as that lets it.
        weights : bool
            Whether weights of control points may change, too.

        Raises
        ------
        ValueError
            If the method was not "lattice", a point is not finite, or so far aside of slanted
            ends that these would have met before.
        """
        if self.lattice is None or self.closed is None:
            raise ValueError(f"method must be lattice for a solid to be refined, got {self.method}")
        seen = into_frame(self.frame, finite_array("points", points, (None, 3)))
        shear = self.closed.shear
        if shear is not None:
            if not shear.reaches(seen).all():
                raise ValueError("points must lie beside the object, got one far aside of it")
            seen = shear.straightened(seen)
        surface, lattice = refine_solid(
            self.lattice, self.closed, seen, sigma=sigma, weights=weights
        )
        return replace(self, surface=placed(surface, self.frame, shear), lattice=lattice)

    def deviation(self, heights: ArrayLike, turns: ArrayLike) -> Floats | None:
        """Standard deviation of the side along its normal, on a grid (a, b).

        None with the methods "thesis" and "coarse", which do not say. Ends are not in it: of
        them `uncovered` tells what nobody could know.

        Parameters
        ----------
        heights, turns : (a,), (b,) arrays
            Heights along the z axis of the slicing frame; a whole turn is 1.

        Raises
        ------
        ValueError
            If a number is not finite.
        """
        if self.closed is None:
            return None
        return self.closed.deviation(
            finite_array("heights", heights, (None,)), finite_array("turns", turns, (None,))
        )

    def uncertainty(self) -> Uncertainty | None:
        """What the error of the side stays below, and what is narrower than could be seen.

        None with the methods "thesis" and "coarse", which do not say.
        """
        return None if self.closed is None else self.closed.uncertainty()

    def whole_deviation(self) -> float | None:
        """Standard deviation of the whole surface, root mean square over its area, ends included.

        None with the methods "thesis" and "coarse", which do not say. See `whole_deviation` for
        what an end is thought to hide.
        """
        return None if self.closed is None else whole_deviation(self.closed, self.evidence.felt)

    @property
    def uncovered(self) -> tuple[float, float]:
        """By how much the object may go on below and above, and nobody can know.

        Along the slicing axis, of which "below" is the end that is smaller in z.
        """
        if self.closed is None:
            return 0.0, 0.0
        return self.closed.bottom.uncovered, self.closed.top.uncovered

    @property
    def overshoot(self) -> float:
        """How far the side leaves the box around its contours, as a share of the box's width.

        More than some hundredths: contours close together, too unlike for a smooth side.
        """
        if self.closed is None:
            return 0.0
        fine = self.slices.fine
        low, high = fine.min(axis=(0, 1)), fine.max(axis=(0, 1))
        heights = np.linspace(self.slices.heights[0], self.slices.heights[-1], OVERSHOOT_ROWS)
        turns = np.arange(OVERSHOOT_TURNS) / OVERSHOOT_TURNS
        side = self.closed.skin.at(heights[:, None], turns[None])
        beyond = np.maximum(low - side, side - high).max()
        return float(max(beyond, 0.0) / (high - low).max())

    def health(self) -> dict[str, float]:
        """Figures of the fit, by name; lengths in the unit of the contours.

        Of the contours: how many are used (`contours`) and not (`dropped`, see
        `Slices.dropped`); how many of the latter may have felt what no other did
        (`perhaps_features`); how many are used though they are unlike their neighbours
        (`suspicious`, see `Evidence.feature_candidates`); how many are `tilted`, `not_starlike` and
        `self_intersecting`; and single points that were left out (`outlying_points`).

        Of the side: the noise (`sigma`), `degrees_of_freedom`, `condition`, the `overshoot`, and
        the `swing`: how far it leaves the middle between contours, over how far these differ;
        more than a half is wild. `paced` is 1 where its parameter follows the way along the
        surface, for contours close together differ much. Of the ends: what nobody could know
        (`uncovered_below`, `uncovered_above`), how high they are beyond the contours or what was
        felt (`unseen_below`, `unseen_above`), and how much of a level end lies on itself, over
        its area (`folded_below`, `folded_above`): more than 0 where no place sees the last
        contour whole, so that the mesh has faces on faces there, and the area is too large.
        `apart_below` and `apart_above` are 1 where the touched point lies so far out that the
        side would have run through its own axis: the end is a piece of its own there.
        `slope_below` and `slope_above` tell how steep the space is there in which the solid was
        fitted: as the ends are, if these are planes but not level.

        Of everything that was felt, if it was given: see `FeltFit`; `felt_unused` is 1 where its
        sections cannot be told by one distance for each turn, so that the contours alone count.

        Of the lattice and of the other methods: see `LatticeFit`, `Recovery`, `ThesisSolid`.
        """
        return health_of(self.evidence, self.closed, self.lattice, self.model, self.surface) | {
            "overshoot": self.overshoot
        }


def moved_lattice(lattice: Lattice, frame: Floats | None, shear: Shear | None = None) -> Lattice:
    """The lattice slanted, and where a frame of this pose (7,) carries it; the same for None."""
    if shear is not None:
        lattice = Lattice(sheared_volume(lattice.volume, shear), lattice.undeformed)
    if frame is None:
        return lattice
    position, axes = split_pose(frame)

    def moved(volume: SplineVolume) -> SplineVolume:
        return SplineVolume(volume.control @ axes.T + position, volume.bases, volume.weights)

    before = lattice.undeformed
    if isinstance(before, Parallelepiped):
        return Lattice(
            moved(lattice.volume),
            Parallelepiped(before.corner @ axes.T + position, before.edges @ axes.T),
        )
    return Lattice(moved(lattice.volume), moved(before))


def sheared_volume(volume: SplineVolume, shear: Shear) -> SplineVolume:
    """The volume where a shear carries it.

    Parameters
    ----------
    volume : Volume
        In the straight space; its weights are kept.
    shear : Slant
        From there to where the object is.
    """
    sites = [basis.greville() for basis in volume.bases]
    places = volume.grid(*sites)
    moved = shear.slanted(places.reshape(-1, 3)).reshape(places.shape)
    if volume.weights is None:
        return SplineVolume(interpolate_grid(volume.bases, sites, moved).control, volume.bases)
    weights = evaluate_grid(volume.bases, volume.spline[..., 3:], sites)
    found = interpolate_grid(volume.bases, sites, weights * moved).control
    return SplineVolume(np.asarray(found / volume.weights[..., None]), volume.bases, volume.weights)


def health_of(
    evidence: Evidence,
    closed: ContourSolid | None,
    lattice: LatticeFit | None,
    model: ThesisSolid | Recovery | None,
    surface: Surface,
) -> Figures:
    """All that is known of how a solid came about: see `Solid.health`."""
    found = evidence.health() | {"uncovered_below": 0.0, "uncovered_above": 0.0}
    if closed is not None:
        strays = found["outlying_points"]
        found |= _of_side(closed)
        found["outlying_points"] += strays
        if evidence.felt is not None:
            found |= _of_contacts(closed)
    if lattice is not None:
        found |= _of_lattice(lattice)
    if isinstance(model, Recovery):
        found |= _of_recovery(model)
    if isinstance(model, ThesisSolid):
        found |= _of_thesis(model)
    return found | _of_ends(surface) | _of_samples(surface)


def _of_side(closed: ContourSolid) -> Figures:
    skin = closed.skin.health
    return {
        "uncovered_below": closed.bottom.uncovered,
        "uncovered_above": closed.top.uncovered,
        "unseen_below": closed.bottom.unseen,
        "unseen_above": closed.top.unseen,
        "apart_below": float(closed.bottom.apart),
        "apart_above": float(closed.top.apart),
        "slope_below": _slope(closed, closed.bottom),
        "slope_above": _slope(closed, closed.top),
        "outlying_points": float(skin.outlying),
        "sigma": skin.sigma,
        "degrees_of_freedom": skin.freedom,
        "condition": skin.condition,
        "swing": skin.swing,
        "paced": float(closed.skin.surface.latitude.pace is not None),
    }


def _slope(closed: ContourSolid, end: End) -> float:
    """How steep an end is."""
    return 0.0 if closed.shear is None else closed.shear.steepness(end.height)


def _of_contacts(closed: ContourSolid) -> Figures:
    felt = closed.felt
    if felt is None:
        return {"felt_unused": 1.0}
    return {
        "felt_unused": 0.0,
        **felt.figures,
        "sigma": felt.sigma,
        "condition": felt.condition,
    }


def _of_lattice(lattice: LatticeFit) -> Figures:
    health, refined = lattice.health, lattice.refinement
    found = {
        "lattice_rms": health.rms,
        "lattice_most": health.most,
        "lattice_condition": health.condition,
        "lattice_folded": health.folded,
    }
    if refined is not None:
        found |= {
            "refined_points": float(refined.points),
            "refined_beyond": float(refined.beyond),
            "refined_before": refined.before,
            "refined_after": refined.after,
            "refined_moved": refined.moved,
            "lattice_folded": refined.folded,
        }
    return found


def _of_recovery(model: Recovery) -> Figures:
    return {
        "rms": model.rms,
        "rank": float(model.rank),
        "condition": model.condition,
        "looseness": model.looseness,
        "uncovered_share": model.uncovered,
        "doubts": float(len(model.doubts)),
    }


def _of_thesis(model: ThesisSolid) -> Figures:
    health = model.health
    return {
        "unmatched_contours": float((~health.one_to_one).sum()),
        "degenerate_contours": float(health.degenerate.sum()),
        "cores_moved": float(health.cores_moved.sum()),
        "core_points_outside": float(health.cores_outside.sum()),
        "widest_gap": float(health.gaps.max()),
    }


def _of_ends(surface: Surface) -> Figures:
    """How much of the level ends lies on itself."""
    ends = [piece for piece in surface.pieces if isinstance(piece, EndPatch)]
    return {
        f"folded_{name}": sum(end.folded for end in ends if end.upper == upper)
        for name, upper in (("below", False), ("above", True))
    }


def _of_samples(surface: Surface) -> Figures:
    """How far splines through samples of a surface may leave it."""
    misses = [piece.miss for piece in surface.pieces if isinstance(piece, SampledPatch)]
    return {"sampling": max(misses)} if misses else {}
