"""What every solid can do for whoever looks at it: become a trimesh, and be shown.

The libraries for that are imported when they are asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints, finite_array

if TYPE_CHECKING:
    import trimesh

MAX_REMOTENESS = 300.0  # Of points over the solid's own distance from the origin
SHOWN_SIZE = 6.0  # Of a figure, inches
COLOUR = (0.35, 0.55, 0.75)


class HasTriangles(Protocol):
    """A closed mesh."""

    @property
    def vertices(self) -> Floats:
        """Places (n, 3)."""

    @property
    def faces(self) -> Ints:
        """Triangles (m, 3), counter-clockwise seen from outside."""


class ClosedBody:
    """A solid that has a mesh and a signed distance."""

    __slots__ = ()

    def mesh(self) -> HasTriangles:
        """Its triangles."""
        raise NotImplementedError

    def signed_distances(self, places: Floats) -> Floats:
        """Of places (n, 3) from its surface, (n,), negative inside."""
        raise NotImplementedError

    def distance(self, points: ArrayLike) -> Floats:
        """Signed distances (n,) of points (n, 3) from the surface, negative inside.

        In the unit of the solid. Raises ValueError if a point is not finite, or so far away that it
        is given in another unit.
        """
        places = finite_array("points", points, (None, 3))
        far = float(np.abs(places).max(initial=0.0))
        vertices = self.mesh().vertices if far > 0.0 else places
        size = float(np.abs(vertices).max(initial=0.0))
        if far > MAX_REMOTENESS * size:
            raise ValueError(
                f"points lie up to {far:.4g} from the origin, and the solid up to {size:.3g}: they "
                "must be in its unit; multiply millimetres by 0.001 where that is the metre"
            )
        return self.signed_distances(places)

    def to_trimesh(self) -> trimesh.Trimesh:
        """The mesh as trimesh has it, in the unit of the solid."""
        import trimesh

        mesh = self.mesh()
        return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)

    def show(self) -> Any:
        """Look at it: in the browser where viser is installed, else in a window of matplotlib.

        Returns viser's server, which serves this machine alone until it is stopped; or the figure.
        """
        mesh = self.mesh()
        try:
            import viser
        except ImportError:
            return _drawn(mesh, repr(self))
        server = viser.ViserServer(host="127.0.0.1")
        server.scene.add_mesh_simple("/solid", mesh.vertices, mesh.faces, color=COLOUR)
        return server


def _drawn(mesh: HasTriangles, title: str) -> Any:
    from matplotlib import pyplot as plt

    figure = plt.figure(figsize=(SHOWN_SIZE, SHOWN_SIZE))
    axes: Any = figure.add_subplot(projection="3d")
    x, y, z = mesh.vertices.T
    axes.plot_trisurf(x, y, z, triangles=mesh.faces, color=COLOUR)
    axes.set_box_aspect(np.ptp(mesh.vertices, axis=0))
    axes.set_title(title, fontsize="small")
    plt.show()
    return figure
