"""A closed surface in closed form: points, normals, curvatures, meshes, integrals, nearest points.

A new kind of piece implements the single method `Patch.at`. Tolerances of meshes and searches are
fields of settings classes. The package uses `palpate.core.rebuild.ends`, which close a side, and
`palpate.core.geometry`.
"""

from palpate.core.rebuild.surface.closed import (
    EndPatch as EndPatch,
    Patch as Patch,
    SampledPatch as SampledPatch,
    Surface as Surface,
    close_surface as close_surface,
    closed_surface as closed_surface,
    placed as placed,
    sampled_patch as sampled_patch,
)
from palpate.core.rebuild.surface.measuring import (
    measure_surface as measure_surface,
)
from palpate.core.rebuild.surface.meshing import (
    MeshSettings as MeshSettings,
    SurfaceMesh as SurfaceMesh,
    SurfaceSearch as SurfaceSearch,
    grid_mesh as grid_mesh,
    mesh_surface as mesh_surface,
    search_surface as search_surface,
)
