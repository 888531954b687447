"""From contours to a closed solid: slices, what corresponds, a skin through them, its ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.plane.signed_area import signed_area
from palpate.core.rebuild.contour_solid import ContourSolid, close_contours
from palpate.core.rebuild.correspondence.correspondence import Correspondence, match_slices
from palpate.core.rebuild.lattice.prism import PrismFit, fit_prism
from palpate.core.rebuild.skin.contour_skin import Uncertainty
from palpate.core.rebuild.slices.bad_contours import bad_contours
from palpate.core.rebuild.slices.slices import Slices, slices_of
from palpate.core.rebuild.surface.surface import Surface
from palpate.core.rebuild.surface.surface_measures import Measures, measure_surface
from palpate.core.rebuild.surface.surface_mesh import SurfaceMesh, mesh_surface
from palpate.core.rebuild.surface.surface_nearest import SurfaceSearch, search_surface

FEWEST, MOST = 24, 160
"""Places around a contour that are matched: as many as it has points, within these."""
LATTICE_ROWS, LATTICE_COLUMNS = 97, 160
"""Places of the side for which a control lattice is solved."""
NO_AREA = 1e-6
"""Of the square of its perimeter: a contour that meets itself around less has no inside."""
LEAST_SIZE, MOST_SIZE = 1e-50, 1e50
"""Of what is rebuilt: the fifth power of a length, as in an inertia, must be a number."""


@dataclass(frozen=True, slots=True, eq=False)
class Rebuilt:
    """A closed solid, and how it came about; lengths in the unit of the contours."""

    surface: Surface
    """Exact at every place: points, normals, curvatures, in no resolution."""
    solid: ContourSolid
    """Its side and its ends."""
    slices: Slices
    """The contours that were used, and those that were not, and why."""
    correspondence: Correspondence
    """Which places of them belong together."""

    def mesh(self, tolerance: float | None = None) -> SurfaceMesh:
        """Triangles that leave the surface by at most a tolerance: see `mesh_surface`."""
        return mesh_surface(self.surface, tolerance)

    def measures(self) -> Measures:
        """Volume, centroid, second moments, inertia and area."""
        return measure_surface(self.surface)

    def search(self) -> SurfaceSearch:
        """Nearest points, signed distances and what lies inside: prepared once for many points."""
        return search_surface(self.surface)

    def uncertainty(self) -> Uncertainty:
        """What the error of the side stays below, and what is narrower than could be seen."""
        return self.solid.skin.uncertainty()

    @property
    def uncovered(self) -> tuple[float, float]:
        """By how much the object may go on below and above, and nobody can know."""
        return self.solid.bottom.uncovered, self.solid.top.uncovered

    @property
    def overshoot(self) -> float:
        """How far the side leaves the box around its contours, as a share of the box's width.

        More than some hundredths: contours close together, too unlike for a smooth side.
        """
        fine = self.slices.fine
        low, high = fine.min(axis=(0, 1)), fine.max(axis=(0, 1))
        heights = np.linspace(self.slices.heights[0], self.slices.heights[-1], LATTICE_ROWS)
        turns = np.arange(LATTICE_COLUMNS) / LATTICE_COLUMNS
        side = self.solid.skin.at(heights[:, None], turns[None])
        beyond = np.maximum(low - side, side - high).max()
        return float(max(beyond, 0.0) / (high - low).max())

    def control_lattice(self) -> PrismFit:
        """The control lattice that makes an elliptic prism of the side: Fung, 1999, 4.4."""
        surface = self.solid.skin.surface
        heights = np.linspace(self.slices.heights[0], self.slices.heights[-1], LATTICE_ROWS)
        turns = np.arange(LATTICE_COLUMNS) / LATTICE_COLUMNS
        return fit_prism(heights, turns, surface.at(heights[:, None], turns[None]))

    def health(self) -> dict[str, float]:
        """Figures of the fit, by name."""
        skin = self.solid.skin.health
        return {
            "contours": float(len(self.slices.heights)),
            "dropped": float(len(self.slices.dropped)),
            "tilted": float(self.slices.tilted.sum()),
            "not_starlike": float((~self.slices.star).sum()),
            "self_intersecting": float(self.slices.self_intersecting.sum()),
            "outlying_points": float(skin.outlying),
            "sigma": skin.sigma,
            "degrees_of_freedom": skin.freedom,
            "condition": skin.condition,
            "overshoot": self.overshoot,
            "uncovered_below": self.uncovered[0],
            "uncovered_above": self.uncovered[1],
        }


def reconstruct(
    contours: Sequence[ArrayLike],
    tops: ArrayLike | None = None,
    *,
    heights: ArrayLike | None = None,
    noise: float | None = None,
) -> Rebuilt:
    """Rebuild a solid from contours.

    Parameters
    ----------
    contours : sequence of (n, 3) arrays, or of (n, 2) arrays with `heights`
        At least 2 closed curves around the z axis, in any order, each begun anywhere, in either
        direction, of any number of points and in any unit. Rows that are not finite are left
        out.
    tops : (k, 3) array, optional
        Where single touches found the ends: those above the middle of the contours the upper
        one, those below it the lower one. An end that nobody touched is closed where the
        contours say where, else level on the last contour; see `Rebuilt.uncovered`.
    heights : (m,) array, optional
        Of plane contours.
    noise : float, optional
        Standard deviation of a coordinate; estimated if left out.

    Returns
    -------
    Rebuilt

    Raises
    ------
    ValueError
        If fewer than 2 contours can be used, or an argument has no use: the sentence says why.

    Notes
    -----
    Fung, 1999, 4.2 and 4.4, with a smoothed skin through the contours in place of the shell and
    core, which are kept in `rebuild_thesis`.
    """
    if noise is not None:
        positive("noise", noise, "in the unit of the contours")
    slices = slices_of(contours, heights)
    ends = _ends(tops, slices)
    _check_size(slices, ends)
    slices = _around_areas(slices)
    matched = _matched(slices)
    found = bad_contours(slices.heights, matched.grid)
    if found.bad.any():
        slices = slices.without(found.bad, "unlike its neighbours")
        matched = _matched(slices)
    if len(slices.heights) < 2:
        dropped = "; ".join(f"contour {one.which}: {one.why}" for one in slices.dropped)
        why = f" ({dropped})" if dropped else ""
        raise ValueError(f"contours must leave at least 2 to rebuild from, got 1{why}")
    bottom, top = ends
    solid = close_contours(slices.heights, matched.grid, bottom=bottom, top=top, noise=noise)
    return Rebuilt(solid.surface, solid, slices, matched)


def _matched(slices: Slices) -> Correspondence:
    usual = int(np.median([len(points) for points in slices.points]))
    return match_slices(slices, min(max(usual, FEWEST), MOST))


def _check_size(slices: Slices, ends: tuple[float | None, float | None]) -> None:
    reached = [float(slices.heights[0]), float(slices.heights[-1])]
    reached += [end for end in ends if end is not None]
    size = max(float(slices.perimeter.max()), max(reached) - min(reached))
    if not LEAST_SIZE <= size <= MOST_SIZE:
        raise ValueError(
            f"contours and tops must span from {LEAST_SIZE:g} to {MOST_SIZE:g}, got {size:g}"
        )


def _around_areas(slices: Slices) -> Slices:
    """Without figures of eight whose halves cancel: nobody can say which way they run."""
    areas = np.array([signed_area(one) for one in slices.fine])
    none = slices.self_intersecting & (np.abs(areas) < NO_AREA * slices.perimeter**2)
    if none.all():
        raise ValueError("contours must run around an area, got none but figures of eight")
    return slices.without(none, "around no area") if none.any() else slices


def _ends(tops: ArrayLike | None, slices: Slices) -> tuple[float | None, float | None]:
    """Heights of the touched ends, below and above."""
    if tops is None or (isinstance(tops, list | tuple) and not tops):
        return None, None
    touched: Floats = finite_array("tops", tops, (None, 3))[:, 2]
    middle = 0.5 * float(slices.heights[0] + slices.heights[-1])
    below, above = touched[touched < middle], touched[touched >= middle]
    return (
        float(below.min()) if len(below) else None,
        float(above.max()) if len(above) else None,
    )
