"""A rebuilt solid: an exact closed surface, and how it came about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from palpate.core.rebuild.contour_solid import ContourSolid
from palpate.core.rebuild.evidence import Evidence
from palpate.core.rebuild.lattice.prism import PrismFit
from palpate.core.rebuild.recovery.recovery import Recovery
from palpate.core.rebuild.skin.contour_skin import Uncertainty
from palpate.core.rebuild.slices.slices import Slices
from palpate.core.rebuild.surface.sampled_patch import SampledPatch
from palpate.core.rebuild.surface.surface import Surface
from palpate.core.rebuild.surface.surface_measures import Measures, measure_surface
from palpate.core.rebuild.surface.surface_mesh import SurfaceMesh, mesh_surface
from palpate.core.rebuild.surface.surface_nearest import SurfaceSearch, search_surface
from palpate.core.rebuild.thesis.solid import ThesisSolid

Method = Literal["lattice", "skin", "thesis", "coarse"]

OVERSHOOT_ROWS, OVERSHOOT_TURNS = 97, 160
"""Places of the side at which it is seen whether it swings out."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Solid:
    """A closed solid, and how it came about; lengths in the unit of the contours."""

    surface: Surface
    """Exact at every place: points, normals, curvatures, in no resolution."""
    method: Method
    """How it was rebuilt."""
    evidence: Evidence
    """From what."""
    closed: ContourSolid | None = None
    """Skin and ends, with the methods "lattice" and "skin"."""
    lattice: PrismFit | None = None
    """Control lattice and what it deforms, with the method "lattice"."""
    model: ThesisSolid | Recovery | None = None
    """What the methods "thesis" and "coarse" found."""

    @property
    def slices(self) -> Slices:
        """The contours that were used, and those that were not, and why."""
        return self.evidence.slices

    def mesh(self, tolerance: float | None = None) -> SurfaceMesh:
        """Triangles that leave the surface by at most a tolerance: see `mesh_surface`."""
        return mesh_surface(self.surface, tolerance)

    def measures(self) -> Measures:
        """Volume, centroid, second moments, inertia and area."""
        return measure_surface(self.surface)

    def search(self) -> SurfaceSearch:
        """Nearest points, signed distances and what lies inside: prepared once for many points."""
        return search_surface(self.surface)

    def uncertainty(self) -> Uncertainty | None:
        """What the error of the side stays below, and what is narrower than could be seen.

        None with the methods "thesis" and "coarse", which do not say.
        """
        return None if self.closed is None else self.closed.skin.uncertainty()

    @property
    def uncovered(self) -> tuple[float, float]:
        """By how much the object may go on below and above, and nobody can know."""
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
        """Figures of the fit, by name."""
        slices = self.slices
        found = {
            "contours": float(len(slices.heights)),
            "dropped": float(len(slices.dropped)),
            "tilted": float(slices.tilted.sum()),
            "not_starlike": float((~slices.star).sum()),
            "self_intersecting": float(slices.self_intersecting.sum()),
            "uncovered_below": self.uncovered[0],
            "uncovered_above": self.uncovered[1],
        }
        if self.closed is not None:
            skin = self.closed.skin.health
            found |= {
                "outlying_points": float(skin.outlying),
                "sigma": skin.sigma,
                "degrees_of_freedom": skin.freedom,
                "condition": skin.condition,
                "overshoot": self.overshoot,
            }
        return found | _model_health(self.model) | _sampling(self.surface)


def _model_health(model: ThesisSolid | Recovery | None) -> dict[str, float]:
    if isinstance(model, Recovery):
        return {
            "rms": model.rms,
            "rank": float(model.rank),
            "condition": model.condition,
            "looseness": model.looseness,
            "uncovered_share": model.uncovered,
            "doubts": float(len(model.doubts)),
        }
    if isinstance(model, ThesisSolid):
        health = model.health
        return {
            "unmatched_contours": float((~health.one_to_one).sum()),
            "degenerate_contours": float(health.degenerate.sum()),
            "cores_moved": float(health.cores_moved.sum()),
            "core_points_outside": float(health.cores_outside.sum()),
            "widest_gap": float(health.gaps.max()),
        }
    return {}


def _sampling(surface: Surface) -> dict[str, float]:
    """How far splines through samples of a surface may leave it."""
    misses = [piece.miss for piece in surface.pieces if isinstance(piece, SampledPatch)]
    return {"sampling": max(misses)} if misses else {}
