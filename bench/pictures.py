"""Pictures of what benches measured: growth, and rebuilt solids beside a loft."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from palpate.bench.contours import CONTOUR_NOISE, noisy_contours
from palpate.bench.growth import Growth
from palpate.bench.peers import loft
from palpate.bench.rebuilt import HALF, REBUILT_SHAPES, truth_of
from palpate.core.geometry import nearest_points
from palpate.core.rebuild import reconstruct
from palpate.core.shapes import Mesh
from palpate.launch import charts

N_CONTOURS, N_POINTS = 9, 24  # Of each rebuilt shape, and of each contour
MESH_TOLERANCE = 0.1  # [mm]
MAX_DISTANCE = 1.5  # Distance from the truth at which the colours end [mm]
VIEW = (18.0, -60.0)  # Elevation and azimuth [deg]
LIGHT = np.array([0.4, -0.8, 0.45])  # Direction towards the light


@charts.styled
def draw_growths(found: Sequence[Growth]) -> Figure:
    """A column for each, errors above and costs below, on logarithmic scales."""
    figure = charts.new_figure(320.0 * len(found), 600.0)
    for column, one in enumerate(found):
        for row, names in enumerate((one.errors, one.costs)):
            if not names:
                continue
            axes = figure.add_subplot(2, len(found), row * len(found) + column + 1)
            for what in names:
                law = one.law(what)
                power = "" if law is None else f", power {law.exponent:+.2f}"
                axes.loglog(one.sizes, one.means()[what], "o-", label=f"{what}{power}")
            if one.floor and not row:
                axes.axhline(one.floor, color=charts.GREY, linestyle=":", label="sampling floor")
            axes.set_xticks(one.sizes, map(str, one.sizes))
            axes.margins(y=0.3)  # for the legend
            charts.log_ticks(axes, "y")
            axes.minorticks_off()
            axes.legend()
            axes.set_title("" if row and one.errors else one.name)
    return figure


@charts.styled
def draw_shapes() -> Figure:
    """Three rows: contours on the object, palpate's solid and the loft, coloured by distance."""
    figure = charts.new_figure(200.0 * len(REBUILT_SHAPES), 740.0)
    for column, (name, shape) in enumerate(REBUILT_SHAPES.items()):
        contours = noisy_contours(
            shape, (N_CONTOURS, N_POINTS), CONTOUR_NOISE, np.random.default_rng(0)
        )
        tops = np.array([[0.0, 0.0, shape.low], [0.0, 0.0, shape.high]])
        mesh = reconstruct(list(contours), tops=tops).mesh(MESH_TOLERANCE)
        count, limit = len(REBUILT_SHAPES), (-0.85 * HALF, 0.85 * HALF)
        axes = [_axes_3d(figure, (3, count, row * count + column + 1), VIEW) for row in range(3)]
        for one in axes:
            one.set(xlim=limit, ylim=limit, zlim=(-HALF, HALF))
            one.set_box_aspect((0.85, 0.85, 1.0), zoom=1.25)
            one.set_proj_type("ortho")
        for ring in contours:
            axes[0].plot(*np.vstack([ring, ring[:1]]).T, color=charts.INK, linewidth=0.8)
        axes[0].set_title(name)
        _draw_distances(axes[1], name, Mesh(mesh.vertices, mesh.faces))
        _draw_distances(axes[2], name, loft(contours))
        if not column:
            for one, label in zip(axes, ("touched", "palpate", "loft"), strict=True):
                one.text2D(0.0, 0.9, label, transform=one.transAxes)
    scale = ScalarMappable(Normalize(0.0, MAX_DISTANCE), "viridis")
    figure.colorbar(scale, ax=figure.axes, shrink=0.5, label="distance from the object, mm")
    return figure


def _axes_3d(figure: Figure, place: tuple[int, int, int], view: tuple[float, float]) -> Axes3D:
    """Axes without a frame; `view`: elevation and azimuth, degrees."""
    axes = figure.add_subplot(*place, projection="3d")
    assert isinstance(axes, Axes3D)
    axes.view_init(elev=view[0], azim=view[1])
    axes.set_axis_off()
    return axes


def _draw_distances(axes: Axes3D, name: str, mesh: Mesh) -> None:
    """Triangles, coloured by how far their middles are from the true surface."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(across, axis=1)
    corners, across = corners[lengths > 0.0], across[lengths > 0.0]
    far = nearest_points(truth_of(name).surface.search, corners.mean(axis=1)).distances
    shade = 0.75 + 0.25 * across @ LIGHT / np.linalg.norm(across, axis=1)
    colours = ScalarMappable(Normalize(0.0, MAX_DISTANCE), "viridis").to_rgba(far)
    colours[:, :3] *= np.clip(shade, 0.0, 1.0)[:, None]
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors="none"))
