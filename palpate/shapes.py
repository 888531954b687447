"""Shapes that rays can be cast at: see docs/shapes.md."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.shapes import Bend as Bend, BooleanShape as BooleanShape
    from palpate.core.shapes import DeformedShape as DeformedShape
    from palpate.core.shapes import DeformedSuperquadric as DeformedSuperquadric, Dent as Dent
    from palpate.core.shapes import GeneralisedCylinder as GeneralisedCylinder
    from palpate.core.shapes import HalfSpace as HalfSpace, Hyperquadric as Hyperquadric
    from palpate.core.shapes import Intersection as Intersection, MassMoments as MassMoments
    from palpate.core.shapes import Mesh as Mesh, Polyhedron as Polyhedron, PosedShape as PosedShape
    from palpate.core.shapes import Shape as Shape, Superquadric as Superquadric, Taper as Taper
    from palpate.core.shapes import TriangleShape as TriangleShape, Union as Union
    from palpate.core.shapes import WingedEdges as WingedEdges, area_samples as area_samples
    from palpate.core.shapes import complement_of as complement_of, difference as difference
    from palpate.core.shapes import inside_outside as inside_outside, isosurface as isosurface
    from palpate.core.shapes import regular_points as regular_points
    from palpate.core.shapes import sampled_surface as sampled_surface
    from palpate.core.shapes import superquadric_moments as superquadric_moments
    from palpate.core.shapes import superquadric_volume as superquadric_volume
    from palpate.core.shapes import trigonometric_points as trigonometric_points
else:
    __getattr__, __dir__ = lazy(__name__)
