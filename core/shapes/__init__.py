"""Solids that can be touched.

One protocol (bounds, rays cast at it, a mesh), and a chapter a kind of solid.

A user adds a solid by writing a class that answers `Shape`, or `ImplicitShape` if it is to be
deformed, or `CsgSolid` if it is to be combined; nothing has to be registered here. Casting is
exact: the constants are tolerances and limits of work, not parameters. It rests on numpy and
`palpate.core.geometry`; Embree and the manifold library are imported only by those who ask for
them.
"""

from palpate.core.shapes.boolean_solids import (
    BooleanShape,
    Intersection,
    Tree,
    Union,
    complement_of,
    difference,
)
from palpate.core.shapes.deformed_superquadrics import (
    DeformedSuperquadric,
    FittedSuperquadric,
    largest_curvature,
)
from palpate.core.shapes.face_cutting import cut_faces
from palpate.core.shapes.generalised_cylinders import (
    GeneralisedCylinder,
    Section,
    SplineSection,
    SuperellipseSection,
)
from palpate.core.shapes.global_deformations import Bend, Taper
from palpate.core.shapes.half_spaces import HalfSpace
from palpate.core.shapes.hyperquadrics import Dent, Hyperquadric
from palpate.core.shapes.mending import mend_mesh
from palpate.core.shapes.polyhedra import Polyhedron, WingedEdges
from palpate.core.shapes.protocol import (
    INSIDE,
    MISS,
    ImplicitShape,
    Mesh,
    PosedShape,
    PosedSolid,
    Shape,
)
from palpate.core.shapes.superquadric_measures import (
    MassMoments,
    area_samples,
    sampled_surface,
    superquadric_moments,
    superquadric_volume,
)
from palpate.core.shapes.superquadrics import (
    LARGEST_EXPONENT,
    LEAST_EXPONENT,
    PNorm,
    PNormCurvature,
    Superquadric,
    inside_outside,
    p_norm,
    p_norm_curvature,
    regular_points,
    trigonometric_points,
)
from palpate.core.shapes.tessellations import grid_surface, isosurface
from palpate.core.shapes.triangle_meshes import DeformedShape, TriangleShape
