"""A closed surface given by a rule, exact at every place.

Points, normals, curvatures, meshes, integrals, nearest points. A new kind of piece needs only
the one method of `Patch`; tolerances of meshes and searches are named on top of their chapters.
It rests on `palpate.core.rebuild.ends` for what closes a side, and on `palpate.core.geometry`.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.surface.closed import EndPatch as EndPatch
    from palpate.core.rebuild.surface.closed import Patch as Patch
    from palpate.core.rebuild.surface.closed import SampledPatch as SampledPatch
    from palpate.core.rebuild.surface.closed import SolidMeasures as SolidMeasures
    from palpate.core.rebuild.surface.closed import Surface as Surface
    from palpate.core.rebuild.surface.closed import close_surface as close_surface
    from palpate.core.rebuild.surface.closed import closed_surface as closed_surface
    from palpate.core.rebuild.surface.closed import measure_surface as measure_surface
    from palpate.core.rebuild.surface.closed import placed as placed
    from palpate.core.rebuild.surface.closed import sampled_patch as sampled_patch
    from palpate.core.rebuild.surface.meshing import DEFAULT_TOLERANCE as DEFAULT_TOLERANCE
    from palpate.core.rebuild.surface.meshing import SurfaceMesh as SurfaceMesh
    from palpate.core.rebuild.surface.meshing import SurfaceSearch as SurfaceSearch
    from palpate.core.rebuild.surface.meshing import grid_mesh as grid_mesh
    from palpate.core.rebuild.surface.meshing import mesh_surface as mesh_surface
    from palpate.core.rebuild.surface.meshing import search_surface as search_surface
else:
    __getattr__, __dir__ = lazy(__name__)
