"""A closed surface given by a rule, exact at every place.

Points, normals, curvatures, meshes, integrals, nearest points. A new kind of piece needs only
the one method of `Patch`; tolerances of meshes and searches are named on top of their chapters.
It rests on `palpate.core.rebuild.ends` for what closes a side, and on `palpate.core.geometry`.
"""

from palpate.core.rebuild.surface.closed import (
    EndPatch,
    Patch,
    SampledPatch,
    Surface,
    close_surface,
    closed_surface,
    measure_surface,
    placed,
    sampled_patch,
)
from palpate.core.rebuild.surface.meshing import (
    DEFAULT_TOLERANCE,
    SurfaceMesh,
    SurfaceSearch,
    grid_mesh,
    mesh_surface,
    search_surface,
)
