"""What stands in the scene, as data: the words with which scenes describe objects.

The structures check what they are given; `build_shape` turns an object into something that
can be touched.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.frames import rotation_matrix
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.protocol import Shape
from palpate.core.shapes.superquadric import Superquadric

if TYPE_CHECKING:  # what only some scenes need is imported where they need it
    from palpate.core.shapes.deformed import Deformation
    from palpate.core.splines.lattice import Lattice

Length = Annotated[float, Meta(gt=0, le=10, description="m")]
Exponent = Annotated[float, Meta(ge=0.02, le=2, description="1")]
TaperShare = Annotated[float, Meta(gt=-1, lt=1, description="1")]
Seed = Annotated[int, Meta(ge=0, le=1 << 53)]
Position = tuple[float, float, float]

LATTICE_SIDE = 4
"""Control points across a layer, each way: the fewest that a cubic basis takes."""


LEAST_CHANGE = 0.005
"""A lattice may shrink no part of its box to less than this share of its volume."""


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
    """Layers of 4 by 4 control points, from the bottom to the top."""
    mesh: MeshSpec | None = None
    """The solid as triangles."""
    pose: PoseSpec = PoseSpec()
    """Where it stands."""

    def __post_init__(self) -> None:
        if (self.superquadric is None) == (self.mesh is None):
            raise ValueError("an object is either a superquadric or a mesh: give exactly one")
        if self.mesh is not None and self.lattice is not None:
            raise ValueError("a lattice deforms a superquadric, not a mesh: leave one out")
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
    base = Superquadric(np.array(spec.superquadric.size), np.array(spec.superquadric.exponents))
    deformations = _deformations(spec)
    if not deformations:
        return base
    from palpate.core.shapes.deformed import DeformedShape

    return DeformedShape(base, deformations)


def _deformations(spec: ObjectSpec) -> tuple[Deformation, ...]:
    assert spec.superquadric is not None
    found: list[Deformation] = []
    if any(spec.superquadric.taper):
        from palpate.core.shapes.taper import Taper

        found.append(Taper(*spec.superquadric.taper, half_height=spec.superquadric.size[2]))
    if spec.lattice is not None:
        found.append(_lattice(spec).deform)
    return tuple(found)


def _lattice(spec: ObjectSpec) -> Lattice:
    """Control lattice over the superquadric's box, its layers scaled, turned and shifted."""
    from palpate.core.splines.lattice import Lattice, undeformed_control

    assert spec.superquadric is not None and spec.lattice is not None
    half = np.array(spec.superquadric.size)
    half[:2] *= 1.0 + np.abs(spec.superquadric.taper)
    control = undeformed_control(-half, 2 * half, (len(spec.lattice), LATTICE_SIDE, LATTICE_SIDE))
    for layer, said in zip(control, spec.lattice, strict=True):
        cosine, sine = np.cos(np.radians(said.turn)), np.sin(np.radians(said.turn))
        turn = np.array([[cosine, sine], [-sine, cosine]])
        layer[..., :2] = said.scale * layer[..., :2] @ turn + np.array(said.shift)
    return Lattice(control, -half, 2 * half)


def _check_folds(spec: ObjectSpec) -> None:
    """Refuse a lattice that turns a part of the solid inside out, or squeezes it flat."""
    lattice = _lattice(spec)
    across, along = np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 257)
    grid = np.stack(np.meshgrid(across, across, along, indexing="ij"), axis=-1).reshape(-1, 3)
    change = lattice.jacobian_determinant(lattice.low + grid * lattice.extent)
    if not (change > LEAST_CHANGE).all():
        share = float((change <= LEAST_CHANGE).mean())
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
