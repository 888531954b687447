"""Solids that can be touched.

One protocol (bounds, ray casting, a mesh), and a module for each kind of solid.

A user adds a solid as a class that implements `Shape`, or `ImplicitShape` if it is to be deformed,
or `CsgSolid` if it is to be combined; nothing has to be registered here. Casting is exact up to
tolerances and limits of work. It depends on numpy and `palpate.core.geometry`; Embree and the
manifold library are imported only where they are used.
"""

from palpate.core.shapes.boolean_solids import (
    BooleanShape as BooleanShape,
    Intersection as Intersection,
    Tree as Tree,
    Union as Union,
    complement_of as complement_of,
    difference as difference,
)
from palpate.core.shapes.deformed_superquadrics import (
    DeformedSuperquadric as DeformedSuperquadric,
    FittedSuperquadric as FittedSuperquadric,
    largest_curvature as largest_curvature,
)
from palpate.core.shapes.face_cutting import (
    cut_faces as cut_faces,
)
from palpate.core.shapes.generalised_cylinders import (
    GeneralisedCylinder as GeneralisedCylinder,
    Section as Section,
    SplineSection as SplineSection,
    SuperellipseSection as SuperellipseSection,
)
from palpate.core.shapes.global_deformations import (
    Bend as Bend,
    Taper as Taper,
)
from palpate.core.shapes.half_spaces import (
    HalfSpace as HalfSpace,
)
from palpate.core.shapes.hyperquadrics import (
    Dent as Dent,
    Hyperquadric as Hyperquadric,
)
from palpate.core.shapes.mending import (
    MeshFault as MeshFault,
    mend_mesh as mend_mesh,
)
from palpate.core.shapes.polyhedra import (
    Polyhedron as Polyhedron,
    WingedEdges as WingedEdges,
)
from palpate.core.shapes.protocol import (
    INSIDE as INSIDE,
    MISS as MISS,
    ImplicitShape as ImplicitShape,
    Mesh as Mesh,
    PosedShape as PosedShape,
    PosedSolid as PosedSolid,
    Shape as Shape,
)
from palpate.core.shapes.superquadric_measures import (
    MassMoments as MassMoments,
    area_samples as area_samples,
    sampled_surface as sampled_surface,
    superquadric_moments as superquadric_moments,
    superquadric_volume as superquadric_volume,
)
from palpate.core.shapes.superquadrics import (
    MAX_EXPONENT as MAX_EXPONENT,
    MIN_EXPONENT as MIN_EXPONENT,
    PNorm as PNorm,
    PNormCurvature as PNormCurvature,
    Superquadric as Superquadric,
    inside_outside as inside_outside,
    p_norm as p_norm,
    p_norm_curvature as p_norm_curvature,
    regular_points as regular_points,
    trigonometric_points as trigonometric_points,
)
from palpate.core.shapes.tessellations import (
    grid_surface as grid_surface,
    isosurface as isosurface,
)
from palpate.core.shapes.triangle_meshes import (
    DeformedShape as DeformedShape,
    TriangleShape as TriangleShape,
)
from palpate.core.shapes.wrapping import (
    WrappedMesh as WrappedMesh,
    WrapSettings as WrapSettings,
    without_crossings as without_crossings,
    wrap_mesh as wrap_mesh,
)
