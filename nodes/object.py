"""What stands in the scene, as data: the words with which scenes describe objects.

The structures check what they are given; `build_shape` turns an object into something that
can be touched.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.frames import rotation_matrix
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.protocol import Shape
from palpate.core.shapes.superquadric import Superquadric

if TYPE_CHECKING:  # what only some scenes need is imported where they need it
    from palpate.core.shapes.protocol import ImplicitShape
    from palpate.core.splines.lattice import Lattice

Length = Annotated[float, Meta(gt=0, le=10, description="m")]
Exponent = Annotated[float, Meta(ge=0.02, le=2, description="1")]
TaperShare = Annotated[float, Meta(gt=-1, lt=1, description="1")]
Seed = Annotated[int, Meta(ge=0, le=1 << 53)]
Position = tuple[float, float, float]


class PoseSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the object's own frame stands in the world."""

    position: Position = (0.0, 0.0, 0.0)
    """x, y, z, m."""
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Unit quaternion x, y, z, w."""

    def __post_init__(self) -> None:
        if not np.isfinite([*self.position, *self.rotation]).all():
            raise ValueError("position and rotation must be finite")
        rotation_matrix(np.array(self.rotation))


class SuperquadricSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A superquadric about its frame's origin."""

    size: tuple[Length, Length, Length]
    """Semi-axes along x, y, z, m."""
    exponents: tuple[Exponent, Exponent]
    """e1 along z and e2 across: 0.02 nearly a box, 1 an ellipsoid, 2 an octahedron."""
    taper: tuple[TaperShare, TaperShare] = (0.0, 0.0)
    """Widening of x and y at the top, as a share."""
    bend: float = 0.0
    """Curvature to which the tapered solid's axis is bent, 1/m."""
    bend_direction: Annotated[float, Meta(ge=-360, le=360)] = 0.0
    """Azimuth towards which its ends are bent, degrees."""

    def __post_init__(self) -> None:
        if self.bend != 0.0:
            _superquadric(self)  # which refuses to fold it


class LayerSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What happens to one layer of a control lattice."""

    scale: Annotated[float, Meta(gt=0, le=10)] = 1.0
    """Widens the layer."""
    shift: tuple[float, float] = (0.0, 0.0)
    """Moves it along x and y, m."""
    turn: Annotated[float, Meta(ge=-180, le=180)] = 0.0
    """Turns it about z, degrees."""

    def __post_init__(self) -> None:
        if not np.isfinite(self.shift).all():
            raise ValueError("shift must be finite")


class MeshSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A closed triangle mesh, in m."""

    vertices: bytes
    """(n, 3) float64, little endian."""
    faces: bytes
    """(m, 3) int32, little endian."""


class ObjectSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One solid: a superquadric, perhaps deformed by a control lattice, or a mesh."""

    superquadric: SuperquadricSpec | None = None
    """The solid, or what the lattice deforms."""
    lattice: Annotated[tuple[LayerSpec, ...], Meta(min_length=4, max_length=64)] | None = None
    """Layers of 4 by 4 control points, from the bottom to the top; after taper and bend."""
    exact: bool = False
    """Whether rays meet the surface that a lattice deforms, not facets of it; some six times
    slower."""
    mesh: MeshSpec | None = None
    """The solid as triangles."""
    pose: PoseSpec = PoseSpec()
    """Where it stands."""

    def __post_init__(self) -> None:
        if (self.superquadric is None) == (self.mesh is None):
            raise ValueError("an object is either a superquadric or a mesh: give exactly one")
        if self.mesh is not None and self.lattice is not None:
            raise ValueError("a lattice deforms a superquadric, not a mesh: leave one out")
        if self.exact and self.lattice is None:
            raise ValueError(
                "exact is for an object with a lattice: leave it out, "
                + ("a mesh is cast as it is" if self.mesh else "a superquadric is exact anyway")
            )
        if self.lattice is not None:
            _check_folds(self)


def build_shape(spec: ObjectSpec) -> Shape:
    """The solid that a description stands for, where it stands."""
    pose = np.array([*spec.pose.position, *spec.pose.rotation])
    return PosedShape(_shape_in_its_frame(spec), pose)


def _shape_in_its_frame(spec: ObjectSpec) -> Shape:
    if spec.mesh is not None:
        from palpate.core.shapes.triangles import TriangleShape

        vertices = np.frombuffer(spec.mesh.vertices, "<f8").reshape(-1, 3)
        faces = np.frombuffer(spec.mesh.faces, "<i4").reshape(-1, 3)
        return TriangleShape(vertices, faces)
    assert spec.superquadric is not None
    base = _superquadric(spec.superquadric)
    if spec.lattice is None:
        return base
    from palpate.core.shapes.deformed import DeformedShape

    return DeformedShape(base, _lattice(base, spec.lattice), spec.exact)


def _superquadric(spec: SuperquadricSpec) -> ImplicitShape:
    base = Superquadric(np.array(spec.size), np.array(spec.exponents))
    if spec.bend == 0.0 and spec.taper == (0.0, 0.0):
        return base
    from palpate.core.shapes.bend import Bend
    from palpate.core.shapes.warped import WarpedSuperquadric

    return WarpedSuperquadric(
        base, np.array(spec.taper), Bend(spec.bend, math.radians(spec.bend_direction))
    )


def _lattice(base: ImplicitShape, layers: tuple[LayerSpec, ...]) -> Lattice:
    from palpate.core.splines.layers import Layer, layered_lattice

    made = [Layer(said.scale, math.radians(said.turn), said.shift) for said in layers]
    return layered_lattice(base.enclosure(), made)


def _check_folds(spec: ObjectSpec) -> None:
    """Refuse a lattice that turns a part of the solid inside out, or squeezes it flat."""
    from palpate.core.splines.layers import folded_share

    assert spec.superquadric is not None and spec.lattice is not None
    share = folded_share(_lattice(_superquadric(spec.superquadric), spec.lattice))
    if share > 0.0:
        raise ValueError(
            f"the lattice folds or flattens {share:.1%} of its box: bring the layers' scale, "
            "shift and turn closer to their neighbours'"
        )


def encode_mesh(vertices: np.ndarray, faces: np.ndarray) -> MeshSpec:
    """A mesh as the scene's data; vertices (n, 3) in m, faces (m, 3)."""
    return MeshSpec(
        vertices=np.ascontiguousarray(vertices, "<f8").tobytes(),
        faces=np.ascontiguousarray(faces, "<i4").tobytes(),
    )
