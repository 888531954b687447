"""Figures of shapes and splines: what can be touched, and how a closed curve is closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from palpate.core.arrays import Floats
from palpate.core.shapes.protocol import Mesh
from palpate.core.splines.closed_curve import ClosedCurve, fit_closed_curve
from palpate.launch.bench_shapes_curves import COUNT, POINTS, SHAPES
from palpate.launch.scene import load_scene
from palpate.nodes.object import build_shape

MODELS = ("twisted", "hyperquadric", "dented", "bottle", "oblique", "notched", "gem", "from_mesh")
LEVEL = 5
LIGHT = np.array([0.15, -0.75, 0.65])
"""Towards the light, from over the viewer's shoulder."""
DPI = 110


def write_figures(folder: str | Path) -> None:
    """Write ``models.png`` and ``closed_curves.png``.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    draw_models(MODELS).savefig(folder / "models.png", dpi=DPI)
    draw_curves().savefig(folder / "closed_curves.png", dpi=DPI)


def draw_models(scenes: Sequence[str]) -> Figure:
    """The objects of scenes, four in a row, each in its own scale."""
    rows = -(-len(scenes) // 4)
    figure = Figure(figsize=(11.0, 3.0 * rows), layout="constrained")
    for i, scene in enumerate(scenes):
        axes = figure.add_subplot(rows, 4, i + 1, projection="3d")
        assert isinstance(axes, Axes3D)
        _draw_mesh(axes, build_shape(load_scene(scene).spec.object).mesh(LEVEL))
        axes.set_title(scene)
    return figure


def closed_curves() -> Mapping[str, tuple[Floats, ClosedCurve, ClosedCurve]]:
    """Points around plane figures, the thesis's curve and ours, with as many control points."""
    turns = np.arange(POINTS - 1) / (POINTS - 1)
    plane = {name: shape(turns) for name, shape in SHAPES.items()}
    return {
        name: (
            points,
            fit_closed_curve(points, count=COUNT, method="thesis"),
            fit_closed_curve(points, count=COUNT),
        )
        for name, points in plane.items()
    }


def draw_curves() -> Figure:
    """The thesis's clamped scheme and the periodic one, through the same points."""
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    found = closed_curves()
    for i, (name, (points, thesis, ours)) in enumerate(found.items()):
        axes = figure.add_subplot(1, len(found), i + 1)
        axes.plot(*points.T, ".", color="0.6", markersize=4, label="points")
        for curve, color, whose in ((thesis, "C3", "thesis"), (ours, "C0", "palpate")):
            # The last turn is left out by a hair: 1 is 0 again, and a gap would not show.
            line = curve.at(np.linspace(0.0, 1.0 - 1e-9, 800))
            label = f"{whose}: gap {curve.closure_gap / np.ptp(points):.3f}"
            axes.plot(*line.T, color, linewidth=2.4 if whose == "thesis" else 1.0, label=label)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(name)
        axes.legend(loc="center", fontsize=8, frameon=False)
    return figure


def _draw_mesh(axes: Axes3D, mesh: Mesh) -> None:
    corners = mesh.vertices[mesh.faces]
    shades = _shades(corners)
    surface = Poly3DCollection(corners, facecolors=shades, edgecolors=shades, linewidths=0.4)
    axes.add_collection3d(surface)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle, half = 0.5 * (low + high), 0.4 * float((high - low).max())
    axes.set(**{f"{name}lim": (m - half, m + half) for name, m in zip("xyz", middle, strict=True)})
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(elev=20, azim=-60)
    axes.set_axis_off()


def _shades(corners: Floats) -> Floats:
    """Colour of each face, (n, 4)."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    light = 0.3 + 0.7 * np.clip(normals @ LIGHT, 0.0, 1.0)
    blue = np.array([0.55, 0.75, 1.0])
    return np.column_stack([light[:, None] * blue, np.ones(len(corners))])
