"""A solid by slices: an exact closed surface, its side and ends, and how far to trust it.

Its control lattice, if it has one, is fitted to the side and says how far it leaves it; the surface
of the solid is the side's own. The lattice is carried along by the slicing frame, deformed and
undeformed control points alike. The shear of its ends moves the deformed ones alone, for it is part
of the deformation: exact where both ends are parallel, else as near as the knots are close
together.

The deviation of the whole is that of the side, how much farther than by their noise taxels lie off
it, and where it was not touched, what may bulge there. An end adds what nobody has touched of it:
the edge beyond the last height that was touched, the end's own height, how far what touched it lies
off it, and, where nobody touched, by how much the object may go on.
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
from palpate.core.rebuild.contours import ContactPoints, Slices, into_frame, taxel_pitch
from palpate.core.rebuild.ends import End, Shear, end_ways, levelled, on_end
from palpate.core.rebuild.evidence import Evidence
from palpate.core.rebuild.lattice import LatticeFit, LatticeSide, refine_lattice
from palpate.core.rebuild.protocol import Closest, Solid, SolidMeasures
from palpate.core.rebuild.recovery import Recovery
from palpate.core.rebuild.side import POSE_LEFT, ContourLoft, Side, Uncertainty
from palpate.core.rebuild.surface import (
    MeshSettings,
    EndPatch,
    Patch,
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
OVERSHOOT_ROWS, OVERSHOOT_TURNS = 97, 160  # Places of the side where it may swing out
NOISE_SHARE = 0.2  # Of the noise: the tolerance of a mesh where none is asked for
SIDE_ROWS, END_ROWS, TURNS = 32, 6, 16  # Of the side, and of each end piece: areas are taken
# Of the height of an edge that nobody touched: what its rounding may be wrong by, root mean square
# over the edge and as much of the end. With noise, a superellipse taken for an arc errs by that.
HIDES = 0.15
RING = 128  # Points of a rim
MIN_RISE = 0.1  # Of the error that is known: contours that rise by less count as level


class WholeModel(Protocol):
    """A model of the whole object, not of its side and ends."""

    @property
    def lattice(self) -> Lattice | None:
        """Its control lattice, seen from the slicing frame; None if it has none."""

    @property
    def figures(self) -> dict[str, float]:
        """How good its fit is, by name."""


def rms_of(values: Floats) -> float:
    """Root mean square of values (n,)."""
    return float(np.sqrt(np.mean(np.square(values))))


class RebuildOptions(NamedTuple):
    """How a method is to rebuild: see `reconstruct`."""

    size: tuple[int, int] | None = None
    grasp: Recovery | None = None
    faithful: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class LatticeSolid(Solid):
    """A closed solid, and how it came about; lengths in the unit of the contours.

    It answers in the world, but heights count along the z axis of the slicing frame; where ends are
    sheared, over its middle. How it came about is seen from that frame: evidence, side, lattice.
    """

    surface: Surface  # Exact everywhere: points, normals, curvatures. In the world.
    method: Method  # How it was rebuilt
    evidence: Evidence  # From what
    options: RebuildOptions | None = None  # And how; none if it was not made by `reconstruct`
    side: Side | None = None  # None with "thesis" and "coarse"
    ends: tuple[End, End] | None = None  # Below and above; likewise
    shear: Shear | None = None  # All this is seen where both ends are level, if they are not
    lattice: LatticeFit | None = None  # With the method "lattice"; see `control_lattice`
    model: WholeModel | None = None  # What the methods "thesis" and "coarse" found

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
        """The control lattice in the world; None but with the method "lattice"."""
        part = self.lattice or self.model
        if part is None or part.lattice is None:
            return None
        return moved_lattice(part.lattice, self.frame, self.shear)

    def update(self, contour: ArrayLike, *, height: float | None = None) -> LatticeSolid:
        """The solid with one contour more: that of all contours at once, in any order.

        Other contours need not be made into curves again, which is most of the work. `contour` is
        as for `reconstruct`, in the world: (n, 3), or (n, 2) with `height` if there is no slicing
        frame. Raises ValueError as `reconstruct` does; or if the solid was not made by it.
        """
        from palpate.core.rebuild.reconstruction import rebuilt  # Which makes such solids

        if self.options is None:
            raise ValueError("solid must be rebuilt by reconstruct to be updated, got another")
        return rebuilt(self.evidence.more(contour, height), self.method, self.options)

    def mesh(self, tolerance: float | None = None) -> SurfaceMesh:
        """Triangles that leave the surface by a tolerance, or as noise lets: `mesh_surface`."""
        if tolerance is None and self.side is not None:
            noise = NOISE_SHARE * self.side.sigma
            tolerance = max(MeshSettings().default_tolerance * self.surface.size, noise)
        return mesh_surface(self.surface, tolerance)

    def measures(self) -> SolidMeasures:
        """As `Solid.measures`, integrated over the exact surface; extents are of the mesh."""
        found = measure_surface(self.surface)
        low, high = self.bounds
        return SolidMeasures(
            volume_m3=found.moments.volume,
            area_m2=found.area,
            centroid_m=found.moments.centroid,
            inertia_m5=found.inertia(),
            extents_m=high - low,
        )

    def closest(self, points: ArrayLike) -> Closest:
        """As `Solid.closest`, on the exact surface."""
        found = self._search.nearest(points)
        normals = self.surface.normals(found.v, found.turns)
        return Closest(found.points, normals, found.distances)

    def __repr__(self) -> str:
        return f"<LatticeSolid {self._size()}, {self.method} of {len(self.slices.rows)} contours>"

    def search(self) -> SurfaceSearch:
        """Nearest points, signed distances and what lies inside: prepared once for many points."""
        return self._search

    @cached_property
    def _search(self) -> SurfaceSearch:
        return search_surface(self.surface)

    def refined(
        self, points: ArrayLike, *, sigma: float | None = None, weights: bool = False
    ) -> LatticeSolid:
        """The solid after its control lattice was changed so that the side passes points.

        They are further points (n, 3) of the object, in the world; those nearest to an end are
        counted, not passed. The surface is then that of the lattice, of no points, too. With their
        standard deviation `sigma` the side is drawn only as near as that lets it; `weights` lets
        weights of control points change, too. Raises ValueError if the method was not "lattice",
        `sigma` is not positive, a point is not finite, or so far aside of sloping ends that these
        would have met before.
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
        each = None if sigma is None else np.full(int(on_side.sum()), sigma)
        places = np.clip(places, 0.0, 1.0)
        found = refine_lattice(self.lattice, seen[on_side], places, sigma=each, weights=weights)
        assert found.refinement is not None
        beyond = int(np.count_nonzero(~on_side))
        found = replace(found, refinement=found.refinement._replace(beyond=beyond))
        surface = placed(close_surface(found.side, *caps), self.frame, self.shear)
        return replace(self, surface=surface, lattice=found)

    def deviation(self, heights: ArrayLike, turns: ArrayLike) -> Floats | None:
        """Standard deviation of the side along its normal, on a grid (a, b), without the ends.

        At heights (a,) along the z axis of the slicing frame and turns (b,), a whole one being 1.
        None with the methods "thesis" and "coarse". Raises ValueError if a number is not finite.
        """
        if self.side is None:
            return None
        places = finite_array("heights", heights, (None,)), finite_array("turns", turns, (None,))
        return self.side.deviation(*places)

    def uncertainty(self) -> Uncertainty | None:
        """What the error of the side stays below, and what is narrower than could be seen.

        None with the methods "thesis" and "coarse". No less than by how much points of contours
        that are not level lie off the solid.
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
        found = whole_deviation(self.surface.pieces, self.side, self.ends, contacts)
        missed = self._missed_by_tilt(found.whole)
        if not len(missed):
            return found
        return found._replace(whole=math.hypot(found.whole, rms_of(missed)))

    def _missed_by_tilt(self, known: float) -> Floats:
        """How far points of contours lie off the solid, (n,), m, if their own heights tell.

        Contours are used at their mean heights. None, (0,), if their points lie so near to these
        that it is little beside the error that is `known`, m, or if taxels count in their place.
        """
        loops = self.slices.loops
        rises = np.concatenate([loop.rises for loop in loops])
        if self.evidence.contacts is not None or rms_of(rises) <= MIN_RISE * known:
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
        """By how much it may go on below and above, along the slicing axis: nobody can know."""
        if self.ends is None:
            return 0.0, 0.0
        return self.ends[0].uncovered, self.ends[1].uncovered

    @property
    def overshoot(self) -> float:
        """How far the side leaves the box of its contours, over its width: hundredths are wild."""
        if self.side is None:
            return 0.0
        fine = self.slices.fine
        low, high = fine.min(axis=(0, 1)), fine.max(axis=(0, 1))
        heights = np.linspace(self.slices.heights[0], self.slices.heights[-1], OVERSHOOT_ROWS)
        turns = np.arange(OVERSHOOT_TURNS) / OVERSHOOT_TURNS
        side = self.side.patch.rings(heights, turns)
        beyond = np.maximum(low - side, side - high).max()
        return float(max(beyond, 0.0) / (high - low).max())

    def health(self) -> dict[str, float]:
        """dict[str, float] of the fit, by name; lengths in the unit of the contours.

        Of the contours: how many are used (`contours`) and not (`dropped`), of the latter may have
        touched what no other did (`perhaps_features`), are used though unlike their neighbours
        (`suspicious`, see `Evidence.feature_candidates`), are `tilted`, `not_starlike` and
        `self_intersecting`; single points that were left out (`outlying_points`),
        and how many leave much of their way around untouched (`gaping`).

        Of the side: the noise (`sigma`), `degrees_of_freedom`, `condition`, the `overshoot`; of a
        loft the `swing`: how far it leaves the middle between contours, over how far these differ;
        more than a half is wild. `reparametrised` is 1 where its parameter follows the way along
        the surface, for contours close together differ much.

        Of the ends, `..._below` and `..._above`: what nobody could know (`uncovered`); how high
        they are beyond what was touched (`unseen`); how much of a level end lies on itself, over
        its area (`folded`): more than 0 where no place sees the last contour whole, so that the
        mesh has faces on faces there, and the area is too large; whether it is a piece of its own
        (`apart`) though it closes in a point: set onto a radial side, or where a loft would have
        run through its own axis; how steep the space is in which the solid was fitted (`slope`), if
        ends are planes but not level.

        Of all contacts, if they were given: see `RadialSide`; `radial_unused` is 1 where sections
        cannot be told by one distance for each turn, so that the contours alone count. Of the
        lattice and of the other methods: see `LatticeFit`, `Recovery`, `ThesisSolid`.
        """
        found = self.evidence.health() | {"uncovered_below": 0.0, "uncovered_above": 0.0}
        if self.side is not None and self.ends is not None:
            found |= self.side.figures
            if isinstance(self.side, ContourLoft):
                found["outlying_points"] += self.side.health.outlying
            if self.evidence.contacts is not None:
                found["radial_unused"] = float(isinstance(self.side, ContourLoft))
            for name, end in zip(("below", "above"), self.ends, strict=True):
                told = {what: getattr(end, what) for what in ("uncovered", "unseen", "apart")}
                told["slope"] = 0.0 if self.shear is None else self.shear.steepness(end.height)
                found |= {f"{what}_{name}": float(value) for what, value in told.items()}
        if self.lattice is not None:
            names = ("rms", "most", "condition", "folded")
            health = self.lattice.health
            found |= {f"lattice_{name}": float(getattr(health, name)) for name in names}
            if (refined := self.lattice.refinement) is not None:
                moves = ("points", "beyond", "before", "after", "moved")
                found |= {f"refined_{name}": float(getattr(refined, name)) for name in moves}
                found["lattice_folded"] = refined.folded
        if self.model is not None:
            found |= self.model.figures
        pieces = self.surface.pieces
        for name, upper in (("below", False), ("above", True)):
            ends = [one for one in pieces if isinstance(one, EndPatch) and one.upper == upper]
            found[f"folded_{name}"] = sum(end.folded for end in ends)
        misses = [piece.miss for piece in pieces if isinstance(piece, SampledPatch)]
        if misses:
            found["sampling"] = max(misses)
        return found | {"overshoot": self.overshoot}


def moved_lattice(lattice: Lattice, frame: Floats | None, shear: Shear | None = None) -> Lattice:
    """The lattice sheared, and where a frame of this pose (7,) carries it."""
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
    """The volume where a shear carries it from level ends; its weights are kept."""
    sites = [basis.greville() for basis in volume.bases]
    places = volume.grid(*sites)
    moved = shear.sheared(places.reshape(-1, 3)).reshape(places.shape)
    if volume.weights is None:
        return SplineVolume(interpolate_grid(volume.bases, sites, moved).control, volume.bases)
    weights = evaluate_grid(volume.bases, volume.spline[..., 3:], sites)
    found = interpolate_grid(volume.bases, sites, weights * moved).control
    return SplineVolume(np.asarray(found / volume.weights[..., None]), volume.bases, volume.weights)


class Deviation(NamedTuple):
    """Standard deviations of a surface along its normal, root mean square over all its area, m."""

    whole: float  # Of all of it
    ends: float  # Of the whole, the part that its ends make


def whole_deviation(
    pieces: tuple[Patch, ...], side: Side, ends: tuple[End, End], contacts: ContactPoints | None
) -> Deviation:
    """Standard deviation of a surface along its normal, root mean square over its area, m.

    Of noise, and of what untouched edges of the ends may hide; what untouched stretches of the side
    may hide is predicted from slopes and curvatures beside them (`palpate.planning`).
    """
    number = next(i for i, piece in enumerate(pieces) if not isinstance(piece, EndPatch))
    cells = _cells(pieces[number], SIDE_ROWS)
    bottom, top = ends
    inside = (cells.heights > bottom.rim) & (cells.heights < top.rim)
    area = float(cells.areas[inside].sum())
    deviation = side.normal_deviation(cells.heights, np.arange(TURNS) / TURNS, cells.steep)
    total = float((cells.areas * np.square(deviation))[inside].sum())
    parts = (
        (bottom, False, pieces[:number], cells.heights <= bottom.rim),
        (top, True, pieces[number + 1 :], cells.heights >= top.rim),
    )
    of_ends = 0.0
    for end, upper, beyond, rounded in parts:
        covered = float(cells.areas[rounded].sum())
        covered += sum(float(_cells(piece, END_ROWS).areas.sum()) for piece in beyond)
        square, more = _of_end(side, end, upper, covered, contacts)
        area, of_ends = area + covered + more, of_ends + square
    return Deviation(math.sqrt((total + of_ends) / area), math.sqrt(of_ends / area))


def _cells(piece: Patch, count: int) -> _Cells:
    v, turns = (np.arange(count) + 0.5) / count, np.arange(TURNS) / TURNS
    heights = piece.on_grid(v, turns)[..., 2].mean(axis=1)
    normals = np.cross(piece.on_grid(v, turns, (0, 1)), piece.on_grid(v, turns, (1, 0)))
    lengths = np.linalg.norm(normals, axis=2)
    steep = np.hypot(normals[..., 0], normals[..., 1]) / np.where(lengths > 0.0, lengths, 1.0)
    return _Cells(heights, lengths / lengths.size, steep)


def _of_end(
    side: Side, end: End, upper: bool, area: float, contacts: ContactPoints | None
) -> tuple[float, float]:
    """Squared deviation times area, m^4, and area that the object may have besides, m^2."""
    ring = side.patch.rings(np.array([end.rim]), np.arange(RING) / RING)[0]
    around = float(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum())
    if end.uncovered > 0.0:
        more = 0.5 * around * end.uncovered
        return (area + more) * end.uncovered**2 / 3.0, more
    way, pitch = 1.0 if upper else -1.0, 0.0 if contacts is None else taxel_pitch(contacts)
    untouched = np.maximum(way * (end.height - side.reached(end.rim, upper)), 0.0)
    untouched = widest_untouched(untouched, around, pitch)
    hidden = around * float(np.mean(2.0 * untouched * np.square(HIDES * untouched)))
    off = 0.0 if contacts is None or end.pointed else _misfit(end, way, ring, contacts)
    level = (POSE_LEFT * side.scatter) ** 2 + max(off**2 - side.scatter**2, 0.0)
    level += 0.0 if end.relief is None else end.relief.deviation**2
    return hidden + area * level, 0.0


def widest_untouched(lengths: Floats, around: float, pitch: float) -> Floats:
    """Width of what fits between touches at even places (n,) of a rim `around` long, (n,), m.

    `lengths` (n,): how far nothing was touched there, across the rim, m. `pitch`: of the taxels, m;
    each stands for a cell of its width. What is wider than twice the way to the cell of another
    place lies there, too, and is no longer than what is untouched of it.
    """
    count = len(lengths)
    steps = np.minimum(np.arange(count), count - np.arange(count))
    # From the middle of a sector to the far border of another, on both sides.
    wide = np.where(steps > 0, 2.0 * (steps + 0.5) * around / count - pitch, 0.0)
    shifted = lengths[(np.arange(count)[:, None] + np.arange(count)) % count]
    return np.asarray(np.maximum(wide, shifted).min(axis=1))


def _misfit(end: End, way: float, ring: Floats, contacts: ContactPoints) -> float:
    """How far what touched an end lies off it along the axis, root mean square, m."""
    points = contacts.points[on_end(contacts, end.rim, way)]
    if not len(points):
        return 0.0
    ways = end_ways(end, ring, points)[0]
    heights = end.rim + ways * (end.height - end.rim)
    if end.relief is not None:
        heights += ways * end.relief.at(points[:, :2])
    return float(np.sqrt(np.mean((points[:, 2] - heights) ** 2)))


class _Cells(NamedTuple):
    """Cells of a piece of the surface, by rows upwards."""

    heights: Floats  # (a,), m
    areas: Floats  # (a, b), m^2
    steep: Floats  # Part of the normals across the axis, (a, b)
