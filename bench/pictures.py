"""Pictures of what benches measure: growth, and rebuilt solids beside a loft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from palpate.bench.contours import DEFAULT_CONTOURS, ends_of, noisy_contours
from palpate.bench.growth import Growth
from palpate.bench.peers import loft
from palpate.bench.rebuilt import HALF_HEIGHT, REBUILT_SHAPES, truth_of
from palpate.core.geometry import nearest_points
from palpate.core.rebuild import reconstruct
from palpate.core.shapes import Mesh
from palpate.launch import charts


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureSettings:
    """What the picture of rebuilt shapes shows, and from where."""

    n_contours: int = 9  # of each shape
    n_points: int = 24  # of each contour
    noise: float = DEFAULT_CONTOURS.noise  # [mm] of a coordinate
    mesh_tolerance: float = 0.1  # [mm]
    max_distance: float = 1.5  # [mm] from the truth, at which the colours end
    view: tuple[float, float] = (18.0, -60.0)  # [deg] elevation and azimuth
    light: tuple[float, float, float] = (0.4, -0.8, 0.45)  # direction towards the light


@charts.styled
def draw_growths(growths: Sequence[Growth]) -> Figure:
    """A column for each, errors above and costs below, on logarithmic scales."""
    figure = charts.new_figure(320.0 * len(growths), 600.0)
    for column, growth in enumerate(growths):
        for row, names in enumerate((growth.errors, growth.costs)):
            if not names:
                continue
            axes = figure.add_subplot(2, len(growths), row * len(growths) + column + 1)
            for what in names:
                law = growth.law(what)
                power = "" if law is None else f", power {law.exponent:+.2f}"
                axes.loglog(growth.sizes, growth.means()[what], "o-", label=f"{what}{power}")
            if growth.floor and not row:
                axes.axhline(growth.floor, color=charts.GREY, linestyle=":", label="sampling floor")
            axes.set_xticks(growth.sizes, map(str, growth.sizes))
            axes.margins(y=0.3)  # for the legend
            charts.log_ticks(axes, "y")
            axes.minorticks_off()
            axes.legend()
            axes.set_title("" if row and growth.errors else growth.name)
    return figure


@charts.styled
def draw_shapes(settings: PictureSettings = PictureSettings()) -> Figure:
    """Three rows: contours on the object, palpate's solid and the loft, coloured by distance."""
    count = len(REBUILT_SHAPES)
    figure = charts.new_figure(200.0 * count, 740.0)
    for column, (name, shape) in enumerate(REBUILT_SHAPES.items()):
        size, rng = (settings.n_contours, settings.n_points), np.random.default_rng(0)
        contours = noisy_contours(shape, size, settings.noise, rng)
        solid = reconstruct(list(contours), tops=ends_of(shape)).mesh(settings.mesh_tolerance)
        touched, rebuilt, lofted = (
            _axes_3d(figure, (3, count, row * count + column + 1), settings.view)
            for row in range(3)
        )
        for ring in contours:
            touched.plot(*np.vstack([ring, ring[:1]]).T, color=charts.INK, linewidth=0.8)
        touched.set_title(name)
        _draw_distances(rebuilt, name, Mesh(solid.vertices, solid.faces), settings)
        _draw_distances(lofted, name, loft(contours), settings)
        if not column:
            for axes, label in ((touched, "touched"), (rebuilt, "palpate"), (lofted, "loft")):
                axes.text2D(0.0, 0.9, label, transform=axes.transAxes)
    scale = ScalarMappable(Normalize(0.0, settings.max_distance), "viridis")
    figure.colorbar(scale, ax=figure.axes, shrink=0.5, label="distance from the object, mm")
    return figure


def _axes_3d(figure: Figure, place: tuple[int, int, int], view: tuple[float, float]) -> Axes3D:
    """Axes without a frame for one of the shapes; `view`: elevation and azimuth [deg]."""
    axes = figure.add_subplot(*place, projection="3d")
    assert isinstance(axes, Axes3D)
    axes.view_init(elev=view[0], azim=view[1])
    axes.set_axis_off()
    limit = (-0.85 * HALF_HEIGHT, 0.85 * HALF_HEIGHT)
    axes.set(xlim=limit, ylim=limit, zlim=(-HALF_HEIGHT, HALF_HEIGHT))
    axes.set_box_aspect((0.85, 0.85, 1.0), zoom=1.25)
    axes.set_proj_type("ortho")
    return axes


def _draw_distances(axes: Axes3D, name: str, mesh: Mesh, settings: PictureSettings) -> None:
    """Triangles, coloured by the distance of their centres from the true surface."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(across, axis=1)
    corners, across = corners[lengths > 0.0], across[lengths > 0.0]
    distances = nearest_points(truth_of(name).surface.search, corners.mean(axis=1)).distances
    shade = 0.75 + 0.25 * across @ np.array(settings.light) / np.linalg.norm(across, axis=1)
    colours = ScalarMappable(Normalize(0.0, settings.max_distance), "viridis").to_rgba(distances)
    colours[:, :3] *= np.clip(shade, 0.0, 1.0)[:, None]
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors="none"))
