"""A rebuilt solid: an exact closed surface, and how it came about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.measure.self_intersection import self_intersection
from palpate.core.measure.solidity import solidity
from palpate.core.rebuild.contour_solid import ContourSolid
from palpate.core.rebuild.evidence import Evidence
from palpate.core.rebuild.lattice.lattice_fit import LatticeFit
from palpate.core.rebuild.lattice.lattice_solid import refine_solid
from palpate.core.rebuild.lattice.moved_lattice import moved_lattice
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.skin.contour_skin import Uncertainty
from palpate.core.rebuild.slices.slices import Slices
from palpate.core.rebuild.slicing import into_frame
from palpate.core.rebuild.solid_health import health_of
from palpate.core.rebuild.surface.surface import Surface, placed
from palpate.core.rebuild.surface.surface_measures import Measures, measure_surface
from palpate.core.rebuild.surface.surface_mesh import DEFAULT, SurfaceMesh, mesh_surface
from palpate.core.rebuild.surface.surface_nearest import SurfaceSearch, search_surface
from palpate.core.rebuild.thesis.solid import ThesisSolid
from palpate.core.rebuild.whole_deviation import whole_deviation
from palpate.core.splines.lattice import Lattice

Method = Literal["lattice", "skin", "thesis", "coarse"]

OVERSHOOT_ROWS, OVERSHOOT_TURNS = 97, 160
"""Places of the side at which it is seen whether it swings out."""
NOISE_SHARE = 0.2
"""Of the noise: the tolerance of a mesh where none is asked for."""


class Check(NamedTuple):
    """What a solid's mesh is like as a body."""

    watertight: bool
    """Each edge has two faces, which run along it in opposite directions."""
    genus: int | None
    """0 without a hole through it; None unless watertight."""
    self_intersections: int
    """Pairs of triangles that cross."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Solid:
    """A closed solid, and how it came about; lengths in the unit of the contours.

    What it answers is in the world, but heights, which count along the z axis of the slicing
    frame; where ends are slanted, over its middle. What is kept of how it came about is seen from
    that frame: evidence, skin and ends, lattice, model.
    """

    surface: Surface
    """Exact at every place: points, normals, curvatures, in no resolution. In the world."""
    method: Method
    """How it was rebuilt."""
    evidence: Evidence
    """From what."""
    closed: ContourSolid | None = None
    """Skin and ends, with the methods "lattice" and "skin"."""
    lattice: LatticeFit | None = None
    """Control lattice and what it deforms, with the method "lattice"; see `control_lattice`."""
    model: ThesisSolid | Recovery | None = None
    """What the methods "thesis" and "coarse" found."""
    again: Callable[[Evidence], Solid] | None = None
    """Rebuilds it in the same way from other evidence."""

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
        slant = None if self.closed is None else self.closed.slant
        return None if part is None else moved_lattice(part.lattice, self.frame, slant)

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
            tolerance = max(DEFAULT * self.surface.size, noise)
        return mesh_surface(self.surface, tolerance)

    def check(self) -> Check:
        """What the mesh is like as a body; looking for triangles that cross takes a while."""
        mesh = self.mesh()
        body = solidity(mesh.vertices, mesh.faces)
        crossings = self_intersection(mesh.vertices, mesh.faces).count
        return Check(body.watertight, body.genus, crossings)

    def measures(self) -> Measures:
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
        slant = self.closed.slant
        if slant is not None:
            if not slant.reaches(seen).all():
                raise ValueError("points must lie beside the object, got one far aside of it")
            seen = slant.straightened(seen)
        surface, lattice = refine_solid(
            self.lattice, self.closed, seen, sigma=sigma, weights=weights
        )
        return replace(self, surface=placed(surface, self.frame, slant), lattice=lattice)

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
        (`suspicious`, see `Evidence.suspects`); how many are `tilted`, `not_starlike` and
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
