"""A closed surface given by a rule, exact at every place.

Points, normals, curvatures, meshes, integrals, nearest points. A new kind of piece needs only
the one method of `Patch`; tolerances of meshes and searches are named on top of their chapters.
It rests on `palpate.core.rebuild.ends` for what closes a side, and on `palpate.core.geometry`.
"""

from palpate.core.rebuild.surface.closed import (
    EndPatch as EndPatch,
    Patch as Patch,
    SampledPatch as SampledPatch,
    Surface as Surface,
    close_surface as close_surface,
    closed_surface as closed_surface,
    measure_surface as measure_surface,
    placed as placed,
    sampled_patch as sampled_patch,
)
from palpate.core.rebuild.surface.meshing import (
    DEFAULT_TOLERANCE as DEFAULT_TOLERANCE,
    SurfaceMesh as SurfaceMesh,
    SurfaceSearch as SurfaceSearch,
    grid_mesh as grid_mesh,
    mesh_surface as mesh_surface,
    search_surface as search_surface,
)
