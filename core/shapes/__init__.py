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
    from palpate.core.shapes.boolean_solids import BooleanShape as BooleanShape
    from palpate.core.shapes.boolean_solids import Intersection as Intersection
    from palpate.core.shapes.boolean_solids import Tree as Tree
    from palpate.core.shapes.boolean_solids import Union as Union
    from palpate.core.shapes.boolean_solids import complement_of as complement_of
    from palpate.core.shapes.boolean_solids import difference as difference
    from palpate.core.shapes.deformed_superquadrics import (
        DeformedSuperquadric as DeformedSuperquadric,
    )
    from palpate.core.shapes.deformed_superquadrics import FittedSuperquadric as FittedSuperquadric
    from palpate.core.shapes.deformed_superquadrics import largest_curvature as largest_curvature
    from palpate.core.shapes.generalised_cylinders import GeneralisedCylinder as GeneralisedCylinder
    from palpate.core.shapes.generalised_cylinders import Section as Section
    from palpate.core.shapes.generalised_cylinders import SplineSection as SplineSection
    from palpate.core.shapes.generalised_cylinders import SuperellipseSection as SuperellipseSection
    from palpate.core.shapes.global_deformations import Bend as Bend
    from palpate.core.shapes.global_deformations import Taper as Taper
    from palpate.core.shapes.half_spaces import HalfSpace as HalfSpace
    from palpate.core.shapes.hyperquadrics import Dent as Dent
    from palpate.core.shapes.hyperquadrics import Hyperquadric as Hyperquadric
    from palpate.core.shapes.mending import mend_mesh as mend_mesh
    from palpate.core.shapes.polyhedra import Polyhedron as Polyhedron
    from palpate.core.shapes.polyhedra import WingedEdges as WingedEdges
    from palpate.core.shapes.protocol import INSIDE as INSIDE
    from palpate.core.shapes.protocol import MISS as MISS
    from palpate.core.shapes.protocol import ImplicitShape as ImplicitShape
    from palpate.core.shapes.protocol import Mesh as Mesh
    from palpate.core.shapes.protocol import PosedShape as PosedShape
    from palpate.core.shapes.protocol import PosedSolid as PosedSolid
    from palpate.core.shapes.protocol import Shape as Shape
    from palpate.core.shapes.superquadric_measures import MassMoments as MassMoments
    from palpate.core.shapes.superquadric_measures import area_samples as area_samples
    from palpate.core.shapes.superquadric_measures import sampled_surface as sampled_surface
    from palpate.core.shapes.superquadric_measures import (
        superquadric_moments as superquadric_moments,
    )
    from palpate.core.shapes.superquadric_measures import superquadric_volume as superquadric_volume
    from palpate.core.shapes.superquadrics import LARGEST_EXPONENT as LARGEST_EXPONENT
    from palpate.core.shapes.superquadrics import LEAST_EXPONENT as LEAST_EXPONENT
    from palpate.core.shapes.superquadrics import PNorm as PNorm
    from palpate.core.shapes.superquadrics import PNormCurvature as PNormCurvature
    from palpate.core.shapes.superquadrics import Superquadric as Superquadric
    from palpate.core.shapes.superquadrics import inside_outside as inside_outside
    from palpate.core.shapes.superquadrics import p_norm as p_norm
    from palpate.core.shapes.superquadrics import p_norm_curvature as p_norm_curvature
    from palpate.core.shapes.superquadrics import regular_points as regular_points
    from palpate.core.shapes.superquadrics import trigonometric_points as trigonometric_points
    from palpate.core.shapes.tessellations import grid_surface as grid_surface
    from palpate.core.shapes.tessellations import isosurface as isosurface
    from palpate.core.shapes.triangle_meshes import DeformedShape as DeformedShape
    from palpate.core.shapes.triangle_meshes import TriangleShape as TriangleShape
else:
    __getattr__, __dir__ = lazy(__name__)
