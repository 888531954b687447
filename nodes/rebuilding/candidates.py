"""The solids of one set of contours, probes and touches, and which of them predicts better."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from palpate.core import Floats, rebuild
from palpate.core.geometry import nearest_points, nearest_search
from palpate.core.rebuild import surface
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general import touch_squares

AnySolid = rebuild.Solid | rebuild.GeneralSolid

COARSE_TOLERANCE = 5e-4  # Of the meshes on the way, of the size
SURE = 1.64  # Standard errors by which a general solid must predict better: 95 of 100
MUCH = 0.5  # Of the slices' error: what a general solid's must be below
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


class Candidates(NamedTuple):
    """The solids of one set, one of each method."""

    sliced: rebuild.Solid | None  # With its control lattice; None where slices make no solid
    general: rebuild.GeneralSolid | None  # None where nothing was touched, or slices do
    touched: ContactPoints  # Of what they are made
    why: str = ""  # Why slices make no solid, if they should
    whole: int = 0  # Touches of which the general solid was last fitted as a whole

    def predicted(self, touched: ContactPoints) -> dict[str, Floats]:
        """Mean square distance of each touch from the solids, by method, m^2."""
        found = {}
        if self.sliced is not None:
            mesh = slices_mesh(self.sliced, None)
            search = nearest_search(mesh.vertices[mesh.faces])
            off = nearest_points(search, touched.points).distances
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


def slices_mesh(solid: rebuild.Solid, quality: Quality | None) -> surface.SurfaceMesh:
    """At the end about as many triangles whatever the shape: a first mesh tells how fine."""
    coarse = COARSE_TOLERANCE * solid.surface.size
    first = solid.mesh(coarse)
    if quality is None or len(first.faces) >= quality.faces:
        return first
    finer = coarse * len(first.faces) / quality.faces
    return solid.mesh(max(finer, quality.tolerance * solid.surface.size))
