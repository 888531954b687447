"""Solids that can be touched.

One protocol (bounds, rays cast at it, a mesh), and a chapter a kind of solid.

A user adds a solid by writing a class that answers `Shape`, or `ImplicitShape` if it is to be
deformed, or `CsgSolid` if it is to be combined; nothing has to be registered here. Casting is
exact: the constants are tolerances and limits of work, not parameters. It rests on numpy and
`palpate.core.geometry`; Embree and the manifold library are imported only by those who ask for
them.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.shapes.boolean_solids import BooleanShape, Intersection, Tree, Union
    from palpate.core.shapes.boolean_solids import complement_of, difference
    from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric, FittedSuperquadric
    from palpate.core.shapes.deformed_superquadrics import largest_curvature
    from palpate.core.shapes.face_cutting import cut_faces
    from palpate.core.shapes.generalised_cylinders import GeneralisedCylinder, Section
    from palpate.core.shapes.generalised_cylinders import SplineSection, SuperellipseSection
    from palpate.core.shapes.global_deformations import Bend, Taper
    from palpate.core.shapes.half_spaces import HalfSpace
    from palpate.core.shapes.hyperquadrics import Dent, Hyperquadric
    from palpate.core.shapes.mending import mend_mesh
    from palpate.core.shapes.polyhedra import Polyhedron, WingedEdges
    from palpate.core.shapes.protocol import INSIDE, MISS, ImplicitShape, Mesh, PosedShape
    from palpate.core.shapes.protocol import PosedSolid, Shape
    from palpate.core.shapes.superquadric_measures import MassMoments, area_samples, sampled_surface
    from palpate.core.shapes.superquadric_measures import superquadric_moments, superquadric_volume
    from palpate.core.shapes.superquadrics import LARGEST_EXPONENT, LEAST_EXPONENT, PNorm
    from palpate.core.shapes.superquadrics import PNormCurvature, Superquadric, inside_outside
    from palpate.core.shapes.superquadrics import p_norm, p_norm_curvature, regular_points
    from palpate.core.shapes.superquadrics import trigonometric_points
    from palpate.core.shapes.tessellations import grid_surface, isosurface
    from palpate.core.shapes.triangle_meshes import DeformedShape, TriangleShape
else:
    __getattr__, __dir__ = lazy(__name__)
