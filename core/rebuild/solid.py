"""A solid by slices: an exact closed surface, its side and ends, and their uncertainty.

The surface is that of the side itself. A control lattice, if there is one, is fitted to the side,
and its misfit is reported. The slicing frame moves its deformed and undeformed control points
alike. The shear of the ends moves the deformed control points only, for it is part of the
deformation: exactly where both ends are parallel, else approximately, the better the closer the
knots.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.poses import Pose
from palpate.core.rebuild.contours import Slices, into_frame
from palpate.core.rebuild.deviation import Deviation, whole_deviation
from palpate.core.rebuild.ends import End, Shear, levelled
from palpate.core.rebuild.evidence import Evidence
from palpate.core.rebuild.lattice import LatticeFit, LatticeSide, refine_lattice
from palpate.core.rebuild.protocol import Closest, Solid, SolidMeasures
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.side import ContourLoft, Side, Uncertainty
from palpate.core.rebuild.surface import (
    EndPatch,
    MeshSettings,
    SampledPatch,
    Surface,
    SurfaceMesh,
    SurfaceSearch,
    close_surface,
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

Method = Literal["lattice", "skin", "draft", "thesis", "coarse"]


class WholeModel(Protocol):
    """A model of the whole object, instead of side and ends."""

    @property
    def lattice(self) -> Lattice | None:
        """Its control lattice in the slicing frame; None if it has none."""

    @property
    def figures(self) -> dict[str, float]:
        """Figures of the fit, by name."""


def rms_of(values: Floats) -> float:
    """Root mean square of values (n,)."""
    return float(np.sqrt(np.mean(np.square(values))))


class RebuildOptions(NamedTuple):
    """Options of a method, which `reconstruct` explains."""

    size: tuple[int, int] | None = None
    grasp: Recovery | None = None
    faithful: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class LatticeSolid(Solid):
    """A closed solid with its evidence and its fit; lengths in the unit of the contours.

    Results are in the world frame, but heights are along the z axis of the slicing frame; if ends
    are sheared, at its middle. Evidence, side and lattice are in the slicing frame.
    """

    surface: Surface  # exact points, normals and curvatures everywhere, in the world
    method: Method
    evidence: Evidence
    options: RebuildOptions | None = None  # None if it was not made by `reconstruct`
    side: Side | None = None  # None with "thesis" and "coarse"
    ends: tuple[End, End] | None = None  # below and above; None with "thesis" and "coarse"
    shear: Shear | None = None  # from level ends, between which side and ends are, to sloping ones
    lattice: LatticeFit | None = None  # with the method "lattice"; see `control_lattice`
    model: WholeModel | None = None  # with the methods "thesis" and "coarse"

    @property
    def slices(self) -> Slices:
        """The contours that are used, and those that are not, and why."""
        return self.evidence.slices

    @property
    def frame(self) -> Floats | None:
        """Pose (7,) of the slicing frame in the world; None for the world frame."""
        return self.evidence.frame

    @property
    def control_lattice(self) -> Lattice | None:
        """The control lattice in the world; None if the method has none."""
        part = self.lattice or self.model
        if part is None or part.lattice is None:
            return None
        return moved_lattice(part.lattice, self.frame, self.shear)

    def update(self, contour: ArrayLike, *, height: float | None = None) -> LatticeSolid:
        """The solid with one more contour, the same as of all contours at once, in any order.

        The curves of the other contours are reused, which saves most of the time. `contour` is as
        for `reconstruct`, in the world: (n, 3), or (n, 2) with `height` if there is no slicing
        frame. Raises ValueError as `reconstruct` does; or if the solid was not made by it.
        """
        from palpate.core.rebuild.reconstruction import rebuild_from_evidence

        if self.options is None:
            raise ValueError("solid must be rebuilt by reconstruct to be updated, got another")
        return rebuild_from_evidence(self.evidence.more(contour, height), self.method, self.options)

    def mesh(self, tolerance: float | None = None, noise_fraction: float = 0.2) -> SurfaceMesh:
        """Triangles that leave the surface by at most `tolerance`: `mesh_surface`.

        If left out, it is the default of `mesh_surface`, or a fraction of the noise if that is
        larger.
        """
        if tolerance is None and self.side is not None:
            noise = noise_fraction * self.side.sigma
            tolerance = max(MeshSettings().default_tolerance * self.surface.size, noise)
        return mesh_surface(self.surface, tolerance)

    def measures(self) -> SolidMeasures:
        """As `Solid.measures`, integrated over the exact surface; extents are of the mesh."""
        measures = measure_surface(self.surface)
        low, high = self.bounds
        return SolidMeasures(
            volume_m3=measures.moments.volume,
            area_m2=measures.area,
            centroid_m=measures.moments.centroid,
            inertia_m5=measures.inertia(),
            extents_m=high - low,
        )

    def closest(self, points: ArrayLike) -> Closest:
        """As `Solid.closest`, on the exact surface."""
        nearest = self._search.nearest(points)
        normals = self.surface.normals(nearest.v, nearest.turns)
        return Closest(nearest.points, normals, nearest.distances)

    def __repr__(self) -> str:
        return f"<LatticeSolid {self._size()}, {self.method} of {len(self.slices.rows)} contours>"

    def search(self) -> SurfaceSearch:
        """Search for nearest points, signed distances and points inside, prepared only once."""
        return self._search

    @cached_property
    def _search(self) -> SurfaceSearch:
        return search_surface(self.surface)

    def refined(
        self, points: ArrayLike, *, sigma: float | None = None, weights: bool = False
    ) -> LatticeSolid:
        """The solid with its control lattice changed so that the side passes further points.

        `points` (n, 3) are in the world; those nearest to an end are counted, but not passed. The
        surface is then that of the lattice, even without points. With their standard deviation
        `sigma` the side is drawn towards them only as far as that allows. `weights`: whether
        weights of control points change, too. Raises ValueError if the method is not "lattice",
        `sigma` is not positive, a point is not finite, or so far aside that sloping ends would
        intersect before it.
        """
        if self.lattice is None or self.ends is None:
            raise ValueError(f"method must be lattice for a solid to be refined, got {self.method}")
        seen = into_frame(self.frame, finite_array("points", points, (None, 3)))
        if self.shear is not None:
            if not self.shear.reaches(seen).all():
                raise ValueError("points must lie beside the object, got one far aside of it")
            seen = self.shear.levelled(seen)
        if sigma is not None:
            positive("sigma", sigma, "m")
        caps = [None if end.round else end for end in self.ends]
        surface = close_surface(self.lattice.side, *caps)
        nearest = search_surface(surface).nearest(seen)
        number = next(i for i, piece in enumerate(surface.pieces) if isinstance(piece, LatticeSide))
        low, high = surface.seams[number : number + 2]
        on_side = (nearest.v >= low) & (nearest.v <= high)
        places = np.column_stack([(nearest.v - low) / (high - low), nearest.turns])[on_side]
        sigmas = None if sigma is None else np.full(int(on_side.sum()), sigma)
        places = np.clip(places, 0.0, 1.0)
        fit = refine_lattice(self.lattice, seen[on_side], places, sigma=sigmas, weights=weights)
        assert fit.refinement is not None
        beyond = int(np.count_nonzero(~on_side))
        fit = replace(fit, refinement=fit.refinement._replace(beyond=beyond))
        surface = placed(close_surface(fit.side, *caps), self.frame, self.shear)
        return replace(self, surface=surface, lattice=fit)

    def deviation(self, heights: ArrayLike, turns: ArrayLike) -> Floats | None:
        """Standard deviation of the side along its normal, on a grid (a, b), without the ends.

        The grid has heights (a,) along the z axis of the slicing frame and turns (b,) from 0 to 1.
        None with the methods "thesis" and "coarse". Raises ValueError if a number is not finite.
        """
        if self.side is None:
            return None
        places = finite_array("heights", heights, (None,)), finite_array("turns", turns, (None,))
        return self.side.deviation(*places)

    def uncertainty(self) -> Uncertainty | None:
        """Bounds of the error of the side, and its resolution.

        None with the methods "thesis" and "coarse". It includes the distances of points of contours
        that are not level.
        """
        if self.side is None:
            return None
        known = self.side.uncertainty()
        missed = self._missed_by_tilt(known.rms)
        if not len(missed):
            return known
        rms = math.hypot(known.rms, rms_of(missed))
        return known._replace(rms=rms, most=max(known.most, float(np.abs(missed).max()), rms))

    def whole_deviation(self) -> Deviation | None:
        """Deviation of the whole surface; None with the methods "thesis" and "coarse"."""
        if self.side is None or self.ends is None:
            return None
        contacts = self.evidence.contacts
        contacts = None if contacts is None else levelled(self.shear, contacts)
        deviation = whole_deviation(self.surface.pieces, self.side, self.ends, contacts)
        missed = self._missed_by_tilt(deviation.whole)
        if not len(missed):
            return deviation
        return deviation._replace(whole=math.hypot(deviation.whole, rms_of(missed)))

    def _missed_by_tilt(self, known: float, min_rise: float = 0.1) -> Floats:
        """Distances (n,) [m] from the solid of points of contours at their own heights.

        Contours are used at their mean heights. Empty if their points rise by less than the
        fraction `min_rise` of the `known` error [m], or if contacts are used in their place.
        """
        loops = self.slices.loops
        rises = np.concatenate([loop.rises for loop in loops])
        if self.evidence.contacts is not None or rms_of(rises) <= min_rise * known:
            return np.zeros(0)
        heights = np.repeat(self.slices.heights, [len(loop.points) for loop in loops])
        plane = np.concatenate([loop.as_given for loop in loops])
        used = ~np.concatenate([loop.outlier | loop.off_height for loop in loops])
        places = np.column_stack([plane, heights + rises])[used]
        if self.frame is not None:
            places = Pose.from_array(self.frame).to_outer(places)
        return self.search().nearest(places).distances

    @property
    def uncovered(self) -> tuple[float, float]:
        """Heights by which it may extend beyond untouched ends, below and above."""
        if self.ends is None:
            return 0.0, 0.0
        return self.ends[0].uncovered, self.ends[1].uncovered

    @property
    def overshoot(self) -> float:
        """Largest distance of the side from the box of its contours, over its width.

        Some hundredths are a sign of oscillation.
        """
        if self.side is None:
            return 0.0
        n_rows, n_turns = 97, 160  # places of the side
        fine = self.slices.fine
        low, high = fine.min(axis=(0, 1)), fine.max(axis=(0, 1))
        heights = np.linspace(self.slices.heights[0], self.slices.heights[-1], n_rows)
        turns = np.arange(n_turns) / n_turns
        side = self.side.patch.rings(heights, turns)
        beyond = np.maximum(low - side, side - high).max()
        return float(max(beyond, 0.0) / (high - low).max())

    def health(self) -> dict[str, float]:
        """Figures of the fit, by name; lengths in the unit of the contours.

        Contours: numbers that are used (`contours`), not used (`dropped`), not used though they may
        have touched a feature that no other did (`perhaps_features`), used though unlike their
        neighbours (`suspicious`, see `Evidence.feature_candidates`), `tilted`, `not_starlike`,
        `self_intersecting`, and with a large gap between two points (`gaping`); number of outliers
        (`outlying_points`).

        Side: noise (`sigma`), `degrees_of_freedom`, `condition`, `overshoot`; of a loft the
        `swing`: its distance from the middle between contours, over the difference of these; more
        than a half is a sign of oscillation. `reparametrised` is 1 if its parameter is the length
        along the surface, as where contours close together differ much.

        Ends, `..._below` and `..._above`: height by which an untouched end may extend
        (`uncovered`); height beyond what was touched (`unseen`); area of a level end that lies on
        itself, over its area (`folded`): more than 0 where no place sees the whole last contour, so
        that the mesh has overlapping faces there, and the area is too large; whether an end that
        closes in a point is a piece of its own (`apart`), on a radial side, or where a loft would
        have run through its own axis; slope of the sheared space in which the solid was fitted
        (`slope`), if ends are planes but not level.

        Contacts: see `RadialSide`; `radial_unused` is 1 if the contours alone are used, as where a
        section has several radii at one turn. Lattice and other methods: see `LatticeFit`,
        `Recovery`, `ThesisSolid`.
        """
        figures = self.evidence.health() | {"uncovered_below": 0.0, "uncovered_above": 0.0}
        figures |= self._side_figures()
        if isinstance(self.side, ContourLoft):
            figures["outlying_points"] += self.side.health.outlying
        figures |= self._lattice_figures()
        if self.model is not None:
            figures |= self.model.figures
        pieces = self.surface.pieces
        for name, upper in (("below", False), ("above", True)):
            caps = [piece for piece in pieces if isinstance(piece, EndPatch)]
            figures[f"folded_{name}"] = sum(cap.folded for cap in caps if cap.upper == upper)
        misses = [piece.miss for piece in pieces if isinstance(piece, SampledPatch)]
        if misses:
            figures["sampling"] = max(misses)
        return figures | {"overshoot": self.overshoot}

    def _side_figures(self) -> dict[str, float]:
        if self.side is None or self.ends is None:
            return {}
        figures = dict(self.side.figures)
        if self.evidence.contacts is not None:
            figures["radial_unused"] = float(isinstance(self.side, ContourLoft))
        for name, end in zip(("below", "above"), self.ends, strict=True):
            of_end = {what: getattr(end, what) for what in ("uncovered", "unseen", "apart")}
            of_end["slope"] = 0.0 if self.shear is None else self.shear.steepness(end.height)
            figures |= {f"{what}_{name}": float(value) for what, value in of_end.items()}
        return figures

    def _lattice_figures(self) -> dict[str, float]:
        if self.lattice is None:
            return {}
        health, refined = self.lattice.health, self.lattice.refinement
        names = ("rms", "most", "condition", "folded")
        figures = {f"lattice_{name}": float(getattr(health, name)) for name in names}
        if refined is not None:
            moves = ("points", "beyond", "before", "after", "moved")
            figures |= {f"refined_{name}": float(getattr(refined, name)) for name in moves}
            figures["lattice_folded"] = refined.folded
        return figures


def moved_lattice(lattice: Lattice, frame: Floats | None, shear: Shear | None = None) -> Lattice:
    """The lattice sheared, and moved by a pose (7,)."""
    if shear is not None:
        lattice = Lattice(sheared_volume(lattice.volume, shear), lattice.undeformed)
    if frame is None:
        return lattice
    position, axes = Pose.from_array(frame)

    def moved(volume: SplineVolume) -> SplineVolume:
        return SplineVolume(volume.control @ axes.T + position, volume.bases, volume.weights)

    before = lattice.undeformed
    if not isinstance(before, Parallelepiped):
        return Lattice(moved(lattice.volume), moved(before))
    box = Parallelepiped(before.corner @ axes.T + position, before.edges @ axes.T)
    return Lattice(moved(lattice.volume), box)


def sheared_volume(volume: SplineVolume, shear: Shear) -> SplineVolume:
    """The volume after a shear from level ends; its weights are kept."""
    sites = [basis.greville() for basis in volume.bases]
    places = volume.grid(*sites)
    moved = shear.sheared(places.reshape(-1, 3)).reshape(places.shape)
    if volume.weights is None:
        return SplineVolume(interpolate_grid(volume.bases, sites, moved).control, volume.bases)
    weights = evaluate_grid(volume.bases, volume.spline[..., 3:], sites)
    weighted = interpolate_grid(volume.bases, sites, weights * moved).control
    control = np.asarray(weighted / volume.weights[..., None])
    return SplineVolume(control, volume.bases, volume.weights)
