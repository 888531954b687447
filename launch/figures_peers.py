"""Figure of the eight objects: as they are, as palpate and as a loft rebuild them from little."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from palpate.core.measure.nearest import nearest_points
from palpate.core.shapes.protocol import Mesh
from palpate.launch.bench_rebuild_peers import NOISE, felt_contours
from palpate.launch.rebuild_peers import loft
from palpate.launch.rebuild_shapes import HALF, SHAPES, truth_of

DPI = 90
SIZE = (9, 24)
"""Contours, and points of each."""
TOLERANCE = 0.1
"""Of the drawn meshes, mm."""
WORST = 1.5
"""Distance from the truth at which the colours end, mm."""
COLOURS = "viridis"
VIEW = (18.0, -60.0)
"""Elevation and azimuth from which is looked, degrees."""
LIGHT = np.array([0.4, -0.8, 0.45])
NAME = "rebuilt_shapes.png"


def write_figures(folder: str | Path) -> None:
    """Write ``rebuilt_shapes.png`` into a folder, made if it is not there."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    draw_shapes().savefig(folder / NAME, dpi=DPI)


def draw_shapes() -> Figure:
    """Three rows: contours on the object, palpate's solid and the loft, coloured by distance."""
    from palpate.core.rebuild.reconstruct import reconstruct

    figure = Figure(figsize=(2.0 * len(SHAPES), 7.4), layout="constrained")
    for column, (name, shape) in enumerate(SHAPES.items()):
        contours = felt_contours(shape, SIZE, NOISE, np.random.default_rng(0))
        tops = np.array([[0.0, 0.0, shape.low], [0.0, 0.0, shape.high]])
        mesh = reconstruct(list(contours), tops=tops).mesh(TOLERANCE)
        axes = [_space(figure, row * len(SHAPES) + column + 1) for row in range(3)]
        for ring in contours:
            axes[0].plot(*np.vstack([ring, ring[:1]]).T, color="k", linewidth=0.8)
        axes[0].set_title(name)
        _draw(axes[1], name, Mesh(mesh.vertices, mesh.faces))
        _draw(axes[2], name, loft(contours))
        if not column:
            for one, label in zip(axes, ("felt", "palpate", "loft"), strict=True):
                one.text2D(0.0, 0.9, label, transform=one.transAxes)
    scale = ScalarMappable(Normalize(0.0, WORST), COLOURS)
    figure.colorbar(scale, ax=figure.axes, shrink=0.5, label="distance from the object, mm")
    return figure


def _space(figure: Figure, number: int) -> Axes3D:
    axes = figure.add_subplot(3, len(SHAPES), number, projection="3d")
    assert isinstance(axes, Axes3D)
    low, high = -0.85 * HALF, 0.85 * HALF
    axes.set(xlim=(low, high), ylim=(low, high), zlim=(-HALF, HALF))
    axes.set_box_aspect((0.85, 0.85, 1.0), zoom=1.25)
    axes.set_proj_type("ortho")
    axes.view_init(elev=VIEW[0], azim=VIEW[1])
    axes.set_axis_off()
    return axes


def _draw(axes: Axes3D, name: str, mesh: Mesh) -> None:
    """Triangles, coloured by how far their middles are from the true surface."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(across, axis=1)
    corners, across = corners[lengths > 0.0], across[lengths > 0.0]
    far = nearest_points(truth_of(name).surface.search, corners.mean(axis=1)).distances
    shade = 0.75 + 0.25 * across @ LIGHT / np.linalg.norm(across, axis=1)
    colours = ScalarMappable(Normalize(0.0, WORST), COLOURS).to_rgba(far)
    colours[:, :3] *= np.clip(shade, 0.0, 1.0)[:, None]
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors="none"))
