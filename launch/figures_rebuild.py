"""Figures of the thesis's rebuilding: both examples as chapter 5 shows them, and a section."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from palpate.core.arrays import Floats
from palpate.core.rebuild.thesis.rebuild import rebuild_thesis
from palpate.core.shapes.protocol import Mesh
from palpate.core.splines.lattice import Lattice
from palpate.launch.thesis_examples import EXAMPLES, Example

DPI = 100
ROWS, COLUMNS = 100, 120
"""Of the meshes that are drawn."""
OBLIQUE, FROM_SIDE, FROM_TOP = (20, -60), (0, -90), (90, -90)
"""Elevation and azimuth from which is looked, degrees."""
SURFACE, SHELL, CORE = "#8cb8e6", "0.25", "C3"


def write_figures(folder: str | Path) -> None:
    """Write ``thesis_example_1.png`` and ``thesis_example_2.png``.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for example in EXAMPLES:
        name = f"thesis_{example.name.replace(' ', '_')}.png"
        draw_example(example).savefig(folder / name, dpi=DPI)


def draw_example(example: Example) -> Figure:
    """The object, the control lattice, the solid from three sides, and a section of it."""
    figure = Figure(figsize=(11.0, 7.4), layout="constrained")
    contours = example.contours()
    corrected, program = (rebuild_thesis(contours, faithful=faithful) for faithful in (False, True))
    truth, solid = example.mesh(ROWS, COLUMNS), corrected.mesh(ROWS, COLUMNS)
    _draw_mesh(_space(figure, 1, "object", OBLIQUE), truth)
    _draw_lattice(_space(figure, 2, "control lattice, corrected", OBLIQUE), corrected.lattice)
    _draw_mesh(_space(figure, 3, "solid, corrected", OBLIQUE), solid)
    for number, title, view in ((4, "from the side", FROM_SIDE), (5, "from the top", FROM_TOP)):
        axes = _space(figure, number, f"{title}, with the felt points", view)
        _draw_mesh(axes, solid)
        facing = contours[:, :, 2] >= 0.0 if view is FROM_TOP else contours[:, :, 1] <= 0.0
        axes.plot(*contours[facing].T, "k+", markersize=2.5, markeredgewidth=0.5, zorder=2)
    plane = figure.add_subplot(2, 3, 6)
    for mesh, color, name in (
        (truth, "0.6", "object"),
        (program.mesh(ROWS, COLUMNS), "C3", "program"),
        (solid, "C0", "corrected"),
    ):
        _draw_section(plane, mesh, color, name)
    return figure


def section_lines(mesh: Mesh) -> Floats:
    """Where a mesh meets the plane y = 0: segments (n, 2, 2) of x and z."""
    corners = mesh.vertices[mesh.faces]
    first, second = corners, np.roll(corners, -1, axis=1)
    below, above = first[:, :, 1], second[:, :, 1]
    crossing = (below >= 0.0) != (above >= 0.0)
    share = np.divide(below, below - above, out=np.zeros_like(below), where=crossing)
    places = first + share[:, :, None] * (second - first)
    # Of a triangle that the plane parts two edges cross it.
    return np.asarray(places[crossing].reshape(-1, 2, 3)[:, :, ::2])


def _space(figure: Figure, number: int, title: str, view: tuple[int, int]) -> Axes3D:
    axes = figure.add_subplot(2, 3, number, projection="3d")
    assert isinstance(axes, Axes3D)
    axes.set(xlim=(-0.8, 0.8), ylim=(-0.8, 0.8), zlim=(-0.8, 0.8), title=title)
    axes.set_box_aspect((1, 1, 1))
    axes.set_proj_type("ortho")
    axes.view_init(elev=view[0], azim=view[1])
    axes.computed_zorder = False  # the points lie on what they were felt of, never behind it
    axes.set_axis_off()
    return axes


def _draw_mesh(axes: Axes3D, mesh: Mesh) -> None:
    axes.plot_trisurf(
        *mesh.vertices.T, triangles=mesh.faces, color=SURFACE, linewidth=0, antialiased=False
    )


def _draw_lattice(axes: Axes3D, lattice: Lattice) -> None:
    control = lattice.control
    shell = np.concatenate(
        [_grid_lines(face) for face in (control[0], control[-1], control[:, 0], control[:, -1])]
    )
    core = np.concatenate(
        [_grid_lines(layer) for layer in control[1:-1, 1:-1].transpose(2, 0, 1, 3)]
    )
    axes.add_collection3d(Line3DCollection(core, colors=CORE, linewidths=0.3, alpha=0.6))
    axes.add_collection3d(Line3DCollection(shell, colors=SHELL, linewidths=0.4))


def _grid_lines(points: Floats) -> Floats:
    """Segments (n, 2, 3) between neighbours of a grid (a, b, 3)."""
    pairs = (points[:-1], points[1:]), (points[:, :-1], points[:, 1:])
    return np.concatenate(
        [np.stack([one.reshape(-1, 3), other.reshape(-1, 3)], axis=1) for one, other in pairs]
    )


def _draw_section(axes: Axes, mesh: Mesh, color: str, name: str) -> None:
    lines = LineCollection(
        list(section_lines(mesh)), colors=color, linewidths=3.0 if color == "0.6" else 0.9
    )
    lines.set_label(name)
    axes.add_collection(lines)
    axes.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.1), title="section in the plane y = 0")
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.legend(loc="center", fontsize=8, frameon=False)
