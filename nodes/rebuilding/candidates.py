"""The solids of one set of contours, probes and touches, and which of them predicts better."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.core import Floats
from palpate.core.geometry import NearestSearch, nearest_points, nearest_search
from palpate.core.rebuild import Solid, surface
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general import touch_squares
from palpate.core.shapes import Mesh, TriangleShape

if TYPE_CHECKING:
    from palpate.core.rebuild import GeneralSolid

    AnySolid = Solid | GeneralSolid

COARSE_TOLERANCE = 5e-4  # Of the mesh that tells how fine the final one is, of the size
SURE = 1.64  # Standard errors by which a general solid must predict better: 95 of 100
MUCH = 0.5  # Of the slices' error: what a general solid's must be below
OVER = 0.5  # Cosine to a face's normal above which a place lies over it, not inside beside a crease
UPWARD, FARTHEST = np.array([0.0, 0.0, 1.0]), 1.0  # Rays out of a solid, and their length, m
_NONE = np.zeros(0)


class Quality(NamedTuple):
    """How finely the final model is meshed."""

    faces: int  # Triangles, about, if it takes as many
    tolerance: float  # Of the size: distance of the mesh from the surface, at least
    parts: int  # Pieces of a general solid's cell along each of its edges


# Faces cost computing here, in scoring and in files; they do not change the surface.
QUALITIES: Mapping[str, Quality] = {
    "draft": Quality(6_000, 5e-4, 1),
    "normal": Quality(45_000, 5e-5, 2),
    "fine": Quality(180_000, 1e-5, 4),
}


@dataclass(frozen=True, eq=False)
class MeshVolume:
    """What a closed mesh encloses."""

    mesh: Mesh | surface.SurfaceMesh

    @cached_property
    def search(self) -> NearestSearch:
        """Of its nearest points."""
        return nearest_search(self.mesh.vertices[self.mesh.faces])

    @cached_property
    def shape(self) -> TriangleShape:
        """The same, ready for rays."""
        return TriangleShape(self.mesh.vertices, self.mesh.faces)

    def depths(self, places: Floats) -> Floats:
        """How deep places (n, 3) lie in it, (n,), m; 0 outside."""
        depths = np.zeros(len(places))
        if not len(places):
            return depths
        nearest = nearest_points(self.search, places)
        edges = self.search.triangles.edges[nearest.faces]
        normals = np.cross(edges[:, 0], edges[:, 1])
        over = np.einsum("ni,ni->n", places - nearest.points, normals)
        # Who stands over the nearest face is outside; rays, which take long to prepare, tell of
        # whoever does not.
        left = np.flatnonzero(over <= OVER * nearest.distances * np.linalg.norm(normals, axis=1))
        if len(left):
            inside = left[np.isneginf(self.shape.cast(places[left], UPWARD, FARTHEST))]
            depths[inside] = nearest.distances[inside]
        return depths


@dataclass(frozen=True, eq=False)
class Candidates:
    """The solids of one set, one of each method."""

    sliced: Solid | None  # The final one as a control lattice; None: slices make no solid
    general: GeneralSolid | None  # None where nothing was touched, or slices do
    touched: ContactPoints  # Of what they are made
    why: str = ""  # Why slices make no solid, if they should
    whole: int = 0  # Touches of which the general solid was last fitted as a whole
    # How the touches of later sets were predicted, by the number of the set.
    predictions: dict[int, dict[str, Floats]] = field(default_factory=dict)

    @cached_property
    def volume(self) -> MeshVolume:
        """The slices' solid, meshed for a look."""
        assert self.sliced is not None
        return MeshVolume(surface.grid_mesh(self.sliced.surface))

    def predicted(self, number: int, touched: ContactPoints) -> dict[str, Floats]:
        """Mean square distance of each touch since from the solids, by method, m^2.

        `number` is that of the later set to which the touches belong.
        """
        if number not in self.predictions:
            self.predictions[number] = self._predicted(touched)
        return self.predictions[number]

    def _predicted(self, touched: ContactPoints) -> dict[str, Floats]:
        found = {}
        if self.sliced is not None:
            off = nearest_points(self.volume.search, touched.points).distances
            found["lattice"] = touch_squares(touched, off)
        if self.general is not None:
            found["general"] = touch_squares(touched, self.general.residuals(touched.points))
        return found

    def better(self, predicted: Mapping[str, Floats]) -> AnySolid | None:
        """The general solid if it surely predicted the same touches better, else slices."""
        if self.sliced is None or self.general is None:
            return self.sliced or self.general
        sliced, general = (predicted.get(name, _NONE) for name in ("lattice", "general"))
        if not len(general) or len(sliced) != len(general):
            return self.sliced
        gain = sliced - general
        sure = gain.mean() > SURE * gain.std() / np.sqrt(len(gain))
        much = general.mean() < MUCH**2 * sliced.mean()
        return self.general if sure and much else self.sliced

    def final_mesh(self, quality: Quality) -> surface.SurfaceMesh:
        """Of about as many triangles whatever the shape: a first mesh tells how fine."""
        assert self.sliced is not None
        coarse = COARSE_TOLERANCE * self.sliced.surface.size
        first = self.sliced.mesh(coarse)
        if len(first.faces) >= quality.faces:
            return first
        finer = coarse * len(first.faces) / quality.faces
        return self.sliced.mesh(max(finer, quality.tolerance * self.sliced.surface.size))
