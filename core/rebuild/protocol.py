"""The interface of all rebuilt solids.

A solid has a closed mesh; all other quantities are computed from its final mesh, in this file. A
class with an exact surface overrides `Solid.measures` and `Solid.closest`. `palpate.output` writes
files and shows solids, for core writes no file and opens no window.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.geometry import (
    NearestSearch,
    are_outside,
    are_slivers,
    areas_and_normals,
    corner_normals,
    has_paired_edges,
    is_closed,
    is_inside_out,
    nearest_points,
    nearest_search,
    normals_at,
    self_intersection,
    solidity,
    triangle_corners,
)
from palpate.reprs import readable

if TYPE_CHECKING:
    import trimesh


class HasTriangles(Protocol):
    """A closed mesh, as trimesh's or one of palpate's."""

    @property
    def vertices(self) -> NDArray[np.float64]:
        """Places (n, 3)."""

    @property
    def faces(self) -> NDArray[np.integer]:
        """Triangles (m, 3), counter-clockwise seen from outside."""


class SolidCheck(NamedTuple):
    """Whether the mesh of a solid is the surface of a body."""

    closed: bool  # each edge belongs to exactly two faces
    oriented: bool  # adjacent faces are oriented consistently, and all normals point outwards
    genus: int | None  # number of holes through it; None unless it is closed and oriented
    self_crossings: int  # pairs of triangles that intersect
    degenerate_faces: int  # triangles without area


@dataclass(frozen=True, eq=False)
class SolidMeasures:
    """Mass properties at density 1, in the powers of m that the names end in.

    Of a solid whose lengths are in another unit, they are in the powers of that unit.
    """

    volume_m3: float
    area_m2: float
    centroid_m: Floats  # (3,)
    inertia_m5: Floats  # about the centroid, (3, 3); times the density it is in kg m2
    extents_m: Floats  # sides of the upright box around the solid, (3,)

    def __repr__(self) -> str:
        def row(values: Floats) -> str:
            return f"[{', '.join(f'{value:.4g}' for value in values)}]"

        inertia = ", ".join(row(line) for line in self.inertia_m5)
        return (
            f"SolidMeasures(volume_m3={self.volume_m3:.6g}, area_m2={self.area_m2:.6g}, "
            f"centroid_m={row(self.centroid_m)}, inertia_m5=[{inertia}], "
            f"extents_m={row(self.extents_m)})"
        )


@readable
class Closest(NamedTuple):
    """Points of a surface that are closest to given points."""

    points: Floats  # (n, 3)
    normals: Floats  # outward unit normals there, (n, 3)
    distances: Floats  # (n,), negative inside


class Solid(ABC):
    """A closed solid. Lengths are in m, unless it was rebuilt from points in another unit."""

    @abstractmethod
    def mesh(self) -> HasTriangles:
        """The triangles of its surface."""

    def health(self) -> dict[str, float]:
        """Figures of the fit by name; empty for a solid that is only a mesh."""
        return {}

    @cached_property
    def final_mesh(self) -> MeshSolid:
        """The mesh that is measured, written and shown.

        Of a run it is the mesh that the run published and wrote; else the result of `mesh`.
        """
        mesh = self.mesh()
        return MeshSolid(mesh.vertices, np.asarray(mesh.faces, np.int32))

    def with_final_mesh(self, vertices: Floats, faces: Ints) -> Self:
        """The same solid with these vertices (n, 3) and faces (m, 3) as its final mesh."""
        other = copy(self)
        other.__dict__["final_mesh"] = MeshSolid(vertices, faces)
        return other

    def _size(self) -> str:
        """Sides of the box around it, as text."""
        return " x ".join(f"{side:.3g}" for side in np.ptp(self.bounds, axis=0))

    @property
    def volume(self) -> float:
        """Volume [m3], from `measures`."""
        return self.measures().volume_m3

    @property
    def area(self) -> float:
        """Area of the surface [m2], from `measures`."""
        return self.measures().area_m2

    @property
    def genus(self) -> int | None:
        """Number of holes through it: 1 for a torus; None if the final mesh is not closed."""
        mesh = self.final_mesh
        return solidity(mesh.vertices, mesh.faces).genus

    @property
    def bounds(self) -> Floats:
        """Smallest and largest coordinates of the final mesh, (2, 3) [m]."""
        vertices = self.final_mesh.vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])

    def distance(self, points: ArrayLike) -> Floats:
        """Distances (n,) [m] of points (n, 3) [m] from the surface, inside as outside.

        Raises ValueError if points have another shape or are not finite.
        """
        return np.abs(self.signed_distance(points))

    def signed_distance(self, points: ArrayLike) -> Floats:
        """Distances (n,) [m] of points (n, 3) [m] from the surface, negative inside.

        Raises ValueError if points have another shape, are not finite, or lie so far away that they
        are probably in another unit.
        """
        return self.closest(self._in_its_unit(points)).distances

    def normal(self, points: ArrayLike) -> Floats:
        """Outward unit normals (n, 3) of the surface where it is closest to points (n, 3) [m].

        Raises ValueError if points have another shape or are not finite.
        """
        return self.closest(self._in_its_unit(points)).normals

    def _in_its_unit(self, points: ArrayLike, max_ratio: float = 300.0) -> Floats:
        """Points (n, 3) that are at most `max_ratio` times as far from the origin as the solid."""
        places = finite_array("points", points, (None, 3))
        far, size = (float(np.abs(part).max(initial=0.0)) for part in (places, self.bounds))
        if far > max_ratio * size:
            raise ValueError(
                f"points lie up to {far:.4g} from the origin, and the solid up to {size:.3g}: they "
                "must be in its unit; multiply millimetres by 0.001 where that is the metre"
            )
        return places

    def closest(self, points: ArrayLike) -> Closest:
        """Closest points of the surface, their normals and signed distances [m].

        Raises ValueError if points have another shape or are not finite.
        """
        return self.final_mesh.closest(points)

    def measures(self) -> SolidMeasures:
        """Volume, area, centroid, inertia about it, and extents."""
        return self.final_mesh.measures()

    def check(self) -> SolidCheck:
        """Whether the final mesh is the surface of a body; takes about a second."""
        vertices, faces = self.final_mesh.vertices, self.final_mesh.faces
        return SolidCheck(
            closed=has_paired_edges(faces),
            oriented=is_closed(faces) and not is_inside_out(vertices, faces),
            genus=solidity(vertices, faces).genus,
            self_crossings=self_intersection(vertices, faces).count,
            degenerate_faces=int(are_slivers(vertices[faces]).sum()),
        )

    def to_trimesh(self) -> trimesh.Trimesh:
        """The final mesh as one of trimesh [m]."""
        import trimesh

        return trimesh.Trimesh(self.final_mesh.vertices, self.final_mesh.faces, process=False)

    def export(self, path: str | Path) -> None:
        """Write the final mesh to a file, which is replaced if it exists.

        The suffix selects the format and its unit: ``.ply``, ``.obj`` (m), ``.glb`` (m, y up),
        ``.stl``, ``.3mf`` (mm). Raises InputError if the suffix is another, or the file cannot be
        written.
        """
        from palpate.output import export_solid

        export_solid(self, Path(path))

    def show(self) -> Any:
        """Show it: in the browser if viser is installed, else in a window of matplotlib.

        Returns viser's server, which serves only this machine until it is stopped, or the figure.
        """
        from palpate.output import show_solid

        return show_solid(self)


@dataclass(frozen=True, eq=False)
class MeshSolid(Solid):
    """A solid that is only a mesh, for instance from a file or an exploratory procedure.

    Raises ValueError if a vertex is not finite, there is no face, or a face refers to no vertex.
    """

    vertices: Floats  # (n, 3) [m]
    faces: Ints  # (m, 3), counter-clockwise seen from outside

    def __post_init__(self) -> None:
        triangle_corners(self.vertices, self.faces)
        object.__setattr__(self, "vertices", np.array(self.vertices, np.float64))
        object.__setattr__(self, "faces", np.array(self.faces, np.int32))

    def __repr__(self) -> str:
        return f"<MeshSolid {self._size()} m, of {len(self.faces)} triangles>"

    def mesh(self) -> MeshSolid:
        """The solid itself, which is its mesh."""
        return self

    @property
    def final_mesh(self) -> MeshSolid:
        """The solid itself, which is its mesh."""
        return self

    def measures(self) -> SolidMeasures:
        """Volume, area, centroid, inertia about it, and extents; exact for the polyhedron.

        They are integrals over the tetrahedra between each face and the middle of the box.
        """
        low, high = self.bounds
        corners = (self.vertices - 0.5 * (low + high))[self.faces]
        volumes = np.linalg.det(corners) / 6.0
        sums = corners.sum(axis=1)
        volume = float(volumes.sum())
        centroid = volumes @ sums / (4.0 * volume)
        products = np.einsum("mij,mik->mjk", corners, corners) + np.einsum("mj,mk->mjk", sums, sums)
        second = np.einsum("m,mjk->jk", volumes, products) / 20.0
        about = second - volume * np.outer(centroid, centroid)
        return SolidMeasures(
            volume_m3=volume,
            area_m2=float(areas_and_normals(corners)[0].sum()),
            centroid_m=centroid + 0.5 * (low + high),
            inertia_m5=np.trace(about) * np.eye(3) - about,
            extents_m=high - low,
        )

    def closest(self, points: ArrayLike) -> Closest:
        """As `Solid.closest`; normals are smooth across blunt edges."""
        queries = finite_array("points", points, (None, 3))
        if not len(queries):
            return Closest(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
        nearest = nearest_points(self._search, queries)
        outside = are_outside(self.vertices, self.faces, queries, nearest)
        normals = normals_at(self.vertices[self.faces], self._corner_normals, nearest)
        return Closest(nearest.points, normals, np.where(outside, 1.0, -1.0) * nearest.distances)

    @cached_property
    def _search(self) -> NearestSearch:
        return nearest_search(self.vertices[self.faces])

    @cached_property
    def _corner_normals(self) -> Floats:
        return corner_normals(self.vertices, self.faces)
