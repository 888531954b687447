"""Draw the pictures of docs/figures: filters, estimators, models, closed curves, rebuilt shapes.

    python tests/figures.py curvature docs/figures   or shapes, rebuild, thesis, scaling
    python tests/figures.py all docs/figures         all of them

Figures 3.3 to 3.6 and those of chapter 5 of Fung, 1999, anew and with errors.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from palpate.core import Floats, touch
from palpate.core.geometry import nearest_points
from palpate.core.shapes import Mesh
from palpate.core.splines import ClosedCurve, Lattice, fit_closed_curve
from palpate.core.thesis import fit_closed_curve_thesis, rebuild_thesis
from palpate.launch import load_scene
from palpate.nodes.specs import build_shape
from tests.studies.contours import CONTOUR_NOISE, noisy_contours
from tests.studies.growth import GROWTHS, Growth
from tests.studies.peers import loft
from tests.studies.rebuilt import HALF, REBUILT_SHAPES, truth_of
from tests.studies.thesis import EXAMPLES, Example

if __name__ == "__main__":  # Not this folder: its modules are named as the tests name them
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from tests.studies.curvature import HEADS, TRIALS, EstimatorErrors, estimator_rows, noise_variance
from tests.studies.shapes import CLOSED_CURVES, CURVE_CONTROLS, CURVE_POINTS

FRAME_PAD = touch.Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
FRAME_NOISE = 40e-6  # m
IMPULSES = 0.05  # Share of the taxels
CONTACT = 200e-6  # Least compression that counts as touched, m: 5 deviations of the noise
DRAWS = 50  # Frames over which the error under each picture is taken; the first is shown
DPI = 110
MODELS = ("twisted", "hyperquadric", "dented", "bottle", "oblique", "notched", "gem", "from_mesh")
LEVEL = 5
LIGHT = np.array([0.15, -0.75, 0.65])  # Towards the light, from over the viewer's shoulder
THESIS_DPI = 100
ROWS, COLUMNS = 100, 120  # Of the meshes that are drawn
# Elevation and azimuth from which is looked, degrees.
OBLIQUE, FROM_SIDE, FROM_TOP = (20, -60), (0, -90), (90, -90)
SURFACE, SHELL, CORE = "#8cb8e6", "0.25", "C3"
PEER_DPI = 90
SIZE = (9, 24)  # Contours, and points of each
TOLERANCE = 0.1  # Of the drawn meshes, mm
WORST = 1.5  # Distance from the truth at which the colours end, mm
COLOURS = "viridis"
VIEW = (18.0, -60.0)  # Elevation and azimuth from which is looked, degrees
PEER_LIGHT = np.array([0.4, -0.8, 0.45])
NAME, GROWN = "rebuilt_shapes.png", "scaling.png"


def write_curvature_figures(folder: str | Path) -> None:
    """Write ``filters_corner.png``, ``filters_ball.png`` and ``estimators.png``."""
    _save(draw_filters(_corner(), "the corner of a box"), folder, "filters_corner.png", DPI)
    _save(draw_filters(_ball(), "a ball of 20 mm"), folder, "filters_ball.png", DPI)
    _save(draw_estimators(estimator_rows(TRIALS)), folder, "estimators.png", DPI)


def _save(figure: Figure, folder: str | Path, name: str, dpi: int) -> None:
    """Into a folder that is made if it is not there."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    figure.savefig(Path(folder) / name, dpi=dpi)


def draw_filters(truth: Floats, what: str) -> Figure:
    """Surfaces and heat maps of a frame after each filter, with the error of each."""
    frames = filtered(truth)
    errors = mean_errors(truth)
    figure = Figure(figsize=(14.0, 5.4), layout="constrained")
    noise = f"{1e6 * FRAME_NOISE:.0f} um of noise, {IMPULSES:.0%} impulses"
    figure.suptitle(f"{what}: compression, {noise}")
    x, y = (1e3 * axis for axis in FRAME_PAD.grid())
    for column, (name, frame) in enumerate(frames.items()):
        above = figure.add_subplot(2, len(frames), column + 1, projection="3d")
        above.plot_surface(x, y, 1e3 * frame, cmap="viridis", vmin=0.0, vmax=1.6)
        above.set_zlim(0.0, 2.4)
        above.set_axis_off()
        above.set_title(name, fontsize=9)
        below = figure.add_subplot(2, len(frames), len(frames) + column + 1)
        below.imshow(1e3 * frame, cmap="viridis", vmin=0.0, vmax=1.6)
        below.set(xticks=[], yticks=[])
        below.set_xlabel(f"rms error {1e6 * errors[name]:.0f} um", fontsize=9)
    return figure


def mean_errors(truth: Floats) -> Mapping[str, float]:
    """Root mean square error after each filter, over many frames, m."""
    squares: dict[str, float] = {}
    for seed in range(DRAWS):
        for name, frame in filtered(truth, seed).items():
            squares[name] = squares.get(name, 0.0) + float(np.mean((frame - truth) ** 2))
    return {name: math.sqrt(total / DRAWS) for name, total in squares.items()}


def filtered(truth: Floats, seed: int = 0) -> Mapping[str, Floats]:
    """A noisy frame with impulses, and what each filter makes of it; (rows, cols) each, m."""
    rng = np.random.default_rng(seed)
    raw = truth + FRAME_NOISE * rng.normal(size=truth.shape)
    hit, up = rng.random((2, *truth.shape))
    raw = np.where(hit < IMPULSES, np.where(up < 0.5, 0.0, 2.4e-3), raw)
    return {
        "raw (3.3)": raw,
        "Wiener (3.4)": touch.adaptive_wiener(raw, noise_variance(raw)),
        "median (3.4)": touch.median_filter(raw),
        "Wiener, then median (3.5)": touch.wiener_then_median(raw, noise_variance(raw)),
        "median, then Wiener (3.6)": touch.median_then_wiener(
            raw, noise_variance(touch.median_filter(raw))
        ),
        "palpate: impulses mended": touch.remove_impulses(
            FRAME_PAD, raw, CONTACT, FRAME_NOISE
        ).image,
    }


def _corner() -> Floats:
    """Compression under the corner of a box's flat top, pressed by 1.2 mm, a little askew."""
    x, y = FRAME_PAD.grid()
    turn = math.radians(12.0)
    along = x * math.cos(turn) + y * math.sin(turn) + 3.3e-3
    beside = y * math.cos(turn) - x * math.sin(turn) + 2.6e-3
    return np.where((along > 0.0) & (beside > 0.0), 1.2e-3 + 0.01 * x, 0.0)


def _ball() -> Floats:
    """Compression under a ball of 20 mm, pressed by 1.4 mm."""
    x, y = FRAME_PAD.grid()
    return np.maximum(1.4e-3 - (0.02 - np.sqrt(0.02**2 - x * x - y * y)), 0.0)


def draw_estimators(rows: list[EstimatorErrors]) -> Figure:
    """Errors of all estimators by column, on a logarithmic scale."""
    figure = Figure(figsize=(10.0, 6.0), layout="constrained")
    axes = figure.add_subplot()
    marks = "osv^<>Dph*XP8d"
    for row, mark in zip(rows, marks, strict=True):
        look = {"linewidth": 2.5, "color": "black"} if row is rows[-1] else {"linewidth": 1.0}
        axes.plot(HEADS, [1e3 * e for e in row.errors], marker=mark, label=row.name, **look)
    axes.set_yscale("log")
    axes.set_xlabel("noise in pitches, then noise .05 with impulses")
    axes.set_ylabel("error of k1 and k2, 1e-3/pitch")
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.grid(True, which="both", alpha=0.3)
    return figure


def write_shape_figures(folder: str | Path) -> None:
    """Write ``models.png`` and ``closed_curves.png``."""
    _save(draw_models(MODELS), folder, "models.png", DPI)
    _save(draw_curves(), folder, "closed_curves.png", DPI)


def draw_models(scenes: Sequence[str]) -> Figure:
    """The objects of scenes, four in a row, each in its own scale."""
    rows = -(-len(scenes) // 4)
    figure = Figure(figsize=(11.0, 3.0 * rows), layout="constrained")
    for i, scene in enumerate(scenes):
        axes = _axes_3d(figure, (rows, 4, i + 1), OBLIQUE)
        _draw_shaded(axes, build_shape(load_scene(scene).spec.object).mesh(LEVEL))
        axes.set_title(scene)
    return figure


def _draw_shaded(axes: Axes3D, mesh: Mesh) -> None:
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    light = 0.3 + 0.7 * np.clip(normals @ LIGHT, 0.0, 1.0)
    blue = np.array([0.55, 0.75, 1.0])
    shades = np.column_stack([light[:, None] * blue, np.ones(len(corners))])
    surface = Poly3DCollection(corners, facecolors=shades, edgecolors=shades, linewidths=0.4)
    axes.add_collection3d(surface)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle, half = 0.5 * (low + high), 0.4 * float((high - low).max())
    axes.set(**{f"{name}lim": (m - half, m + half) for name, m in zip("xyz", middle, strict=True)})
    axes.set_box_aspect((1, 1, 1))


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


def closed_curves() -> Mapping[str, tuple[Floats, ClosedCurve, ClosedCurve]]:
    """Points around plane figures, the thesis's curve and ours, with as many control points."""
    turns = np.arange(CURVE_POINTS - 1) / (CURVE_POINTS - 1)
    found = {}
    for name, shape in CLOSED_CURVES.items():
        points = shape(turns)
        thesis = fit_closed_curve_thesis(points, CURVE_CONTROLS)
        found[name] = points, thesis, fit_closed_curve(points, count=CURVE_CONTROLS)
    return found


def write_thesis_figures(folder: str | Path) -> None:
    """Write ``thesis_example_1.png`` and ``thesis_example_2.png``."""
    for example in EXAMPLES:
        name = f"thesis_{example.name.replace(' ', '_')}.png"
        _save(draw_example(example), folder, name, THESIS_DPI)


def draw_example(example: Example) -> Figure:
    """The object, the control lattice, the solid from three sides, and a section of it."""
    figure = Figure(figsize=(11.0, 7.4), layout="constrained")
    contours = example.contours()
    corrected, program = (rebuild_thesis(contours, faithful=faithful) for faithful in (False, True))
    truth, solid = example.mesh(ROWS, COLUMNS), corrected.mesh(ROWS, COLUMNS)
    _draw_plain(_thesis_axes(figure, 1, "object", OBLIQUE), truth)
    _draw_lattice(_thesis_axes(figure, 2, "control lattice, corrected", OBLIQUE), corrected.lattice)
    _draw_plain(_thesis_axes(figure, 3, "solid, corrected", OBLIQUE), solid)
    for number, title, view in ((4, "from the side", FROM_SIDE), (5, "from the top", FROM_TOP)):
        axes = _thesis_axes(figure, number, f"{title}, with the contact points", view)
        _draw_plain(axes, solid)
        facing = contours[:, :, 2] >= 0.0 if view is FROM_TOP else contours[:, :, 1] <= 0.0
        axes.plot(*contours[facing].T, "k+", markersize=2.5, markeredgewidth=0.5, zorder=2)
    plane = figure.add_subplot(2, 3, 6)
    for mesh, color, name in (
        (truth, "0.6", "object"),
        (program.mesh(ROWS, COLUMNS), "C3", "program"),
        (solid, "C0", "corrected"),
    ):
        width = 3.0 if color == "0.6" else 0.9
        lines = LineCollection(list(section_lines(mesh)), colors=color, linewidths=width)
        lines.set_label(name)
        plane.add_collection(lines)
    plane.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.1), title="section in the plane y = 0")
    plane.set_aspect("equal")
    plane.set_axis_off()
    plane.legend(loc="center", fontsize=8, frameon=False)
    return figure


def _draw_plain(axes: Axes3D, mesh: Mesh) -> None:
    look = {"color": SURFACE, "linewidth": 0, "antialiased": False}
    axes.plot_trisurf(*mesh.vertices.T, triangles=mesh.faces, **look)


def _thesis_axes(figure: Figure, number: int, title: str, view: tuple[int, int]) -> Axes3D:
    axes = _axes_3d(figure, (2, 3, number), view)
    axes.set(xlim=(-0.8, 0.8), ylim=(-0.8, 0.8), zlim=(-0.8, 0.8), title=title)
    axes.set_box_aspect((1, 1, 1))
    axes.set_proj_type("ortho")
    axes.computed_zorder = False  # the points lie on what was touched, never behind it
    return axes


def _axes_3d(figure: Figure, place: tuple[int, int, int], view: tuple[float, float]) -> Axes3D:
    """Axes without a frame; `view`: elevation and azimuth, degrees."""
    axes = figure.add_subplot(*place, projection="3d")
    assert isinstance(axes, Axes3D)
    axes.view_init(elev=view[0], azim=view[1])
    axes.set_axis_off()
    return axes


def _draw_lattice(axes: Axes3D, lattice: Lattice) -> None:
    control = lattice.control
    faces, layers = (control[0], control[-1], control[:, 0], control[:, -1]), control[1:-1, 1:-1]
    shell = np.concatenate([_grid_lines(face) for face in faces])
    core = np.concatenate([_grid_lines(layer) for layer in layers.transpose(2, 0, 1, 3)])
    axes.add_collection3d(Line3DCollection(core, colors=CORE, linewidths=0.3, alpha=0.6))
    axes.add_collection3d(Line3DCollection(shell, colors=SHELL, linewidths=0.4))


def _grid_lines(points: Floats) -> Floats:
    """Segments (n, 2, 3) between neighbours of a grid (a, b, 3)."""
    pairs = (points[:-1], points[1:]), (points[:, :-1], points[:, 1:])
    return np.concatenate([np.stack([a.reshape(-1, 3), b.reshape(-1, 3)], 1) for a, b in pairs])


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


def write_growth_figures(folder: str | Path) -> None:
    """Write ``scaling.png``."""
    _save(draw_growths([one for grow in GROWTHS for one in grow(quick=False)]), folder, GROWN, DPI)


def draw_growths(found: Sequence[Growth]) -> Figure:
    """A column for each, errors above and costs below, on logarithmic scales."""
    figure = Figure(figsize=(3.2 * len(found), 6.0), layout="constrained")
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
                axes.axhline(one.floor, color="0.6", linestyle=":", label="sampling floor")
            axes.set_xticks(one.sizes, map(str, one.sizes))
            axes.minorticks_off()
            axes.margins(y=0.3)  # for the legend
            axes.legend(fontsize=7)
            axes.set_title("" if row and one.errors else one.name, fontsize=9)
    return figure


def write_peer_figures(folder: str | Path) -> None:
    """Write ``rebuilt_shapes.png`` into a folder, made if it is not there."""
    _save(draw_shapes(), folder, NAME, PEER_DPI)


def draw_shapes() -> Figure:
    """Three rows: contours on the object, palpate's solid and the loft, coloured by distance."""
    from palpate.core.rebuild import reconstruct

    figure = Figure(figsize=(2.0 * len(REBUILT_SHAPES), 7.4), layout="constrained")
    for column, (name, shape) in enumerate(REBUILT_SHAPES.items()):
        contours = noisy_contours(shape, SIZE, CONTOUR_NOISE, np.random.default_rng(0))
        tops = np.array([[0.0, 0.0, shape.low], [0.0, 0.0, shape.high]])
        mesh = reconstruct(list(contours), tops=tops).mesh(TOLERANCE)
        count, limit = len(REBUILT_SHAPES), (-0.85 * HALF, 0.85 * HALF)
        axes = [_axes_3d(figure, (3, count, row * count + column + 1), VIEW) for row in range(3)]
        for one in axes:
            one.set(xlim=limit, ylim=limit, zlim=(-HALF, HALF))
            one.set_box_aspect((0.85, 0.85, 1.0), zoom=1.25)
            one.set_proj_type("ortho")
        for ring in contours:
            axes[0].plot(*np.vstack([ring, ring[:1]]).T, color="k", linewidth=0.8)
        axes[0].set_title(name)
        _draw_distances(axes[1], name, Mesh(mesh.vertices, mesh.faces))
        _draw_distances(axes[2], name, loft(contours))
        if not column:
            for one, label in zip(axes, ("touched", "palpate", "loft"), strict=True):
                one.text2D(0.0, 0.9, label, transform=one.transAxes)
    scale = ScalarMappable(Normalize(0.0, WORST), COLOURS)
    figure.colorbar(scale, ax=figure.axes, shrink=0.5, label="distance from the object, mm")
    return figure


def _draw_distances(axes: Axes3D, name: str, mesh: Mesh) -> None:
    """Triangles, coloured by how far their middles are from the true surface."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(across, axis=1)
    corners, across = corners[lengths > 0.0], across[lengths > 0.0]
    far = nearest_points(truth_of(name).surface.search, corners.mean(axis=1)).distances
    shade = 0.75 + 0.25 * across @ PEER_LIGHT / np.linalg.norm(across, axis=1)
    colours = ScalarMappable(Normalize(0.0, WORST), COLOURS).to_rgba(far)
    colours[:, :3] *= np.clip(shade, 0.0, 1.0)[:, None]
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors="none"))


# What draws a bench's pictures into a folder.
WRITERS: Mapping[str, Callable[[Path], None]] = {
    "curvature": write_curvature_figures,
    "shapes": write_shape_figures,
    "rebuild": write_peer_figures,
    "thesis": write_thesis_figures,
    "scaling": write_growth_figures,
}


def main(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=(*WRITERS, "all"))
    parser.add_argument("folder", type=Path, help="made if it is not there")
    told = parser.parse_args(argv)
    for name, write in WRITERS.items():
        if told.what in (name, "all"):
            write(told.folder)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
