"""A moment of a run as a picture: the solid, what was touched, and the finger."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.tools.drawables import LAYERS, Lines, Mesh, Points
from palpate.tools.view.rasteriser import Canvas, Pixels, camera_on
from palpate.tools.view.timeline import Moment, Timeline

# All layers that are shown at first, without the finger, which a film draws as it moves.
DRAWN_LAYERS = frozenset(name for name, layer in LAYERS.items() if layer.shown) - {"finger"}


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureLayout:
    """Sizes of lines and points in a picture [pixels]."""

    line_width: float = 2.2
    touch_radius: float = 1.5  # of touched points before there is a solid
    recent_radius: float = 1.0  # of recent touched points on a solid
    place_radius: float = 3.0  # of places that no touch has closed


DEFAULT_LAYOUT = PictureLayout()


def still(line: Timeline, width: int, height: int) -> Pixels:
    """Picture (height, width, 3) of the end of a run: the solid and its contours."""
    canvas = Canvas(width, height, camera_on(*line.bounds()))
    draw_moment(canvas, line, line.at(np.inf))
    return canvas.image()


def draw_moment(
    canvas: Canvas,
    line: Timeline,
    moment: Moment,
    colours: Floats | None = None,
    n_recent: int = 0,
    layout: PictureLayout = DEFAULT_LAYOUT,
) -> None:
    """Draw a moment of a run.

    `colours` (n, 3) of the solid's vertices; None: that of its layer. Before there is a solid all
    touched points are drawn, afterwards the last `n_recent`.
    """
    touched = [np.zeros((0, 3))]
    for drawable in line.drawn(moment, DRAWN_LAYERS):
        colour = np.array(LAYERS[drawable.layer].rgb, np.float64)
        match drawable.shape:
            case Mesh() as mesh:
                solid = colour if colours is None else colours
                canvas.draw_mesh(mesh.vertices, mesh.faces, solid)
            case Lines() as lines:
                for strip in lines.strips:
                    canvas.draw_line(strip, colour, layout.line_width)
            case Points() as places if drawable.layer == "touched":
                touched.append(places.points)
            case Points() as places:
                canvas.draw_points(places.lifted(), colour, layout.place_radius)
    points, radius = np.concatenate(touched), layout.touch_radius
    if moment.models:
        points, radius = points[max(0, len(points) - n_recent) :], layout.recent_radius
    canvas.draw_points(points, np.array(LAYERS["touched"].rgb, np.float64), radius)


def finger_mesh(
    pose: Floats,
    n: int = 24,
    rings: Sequence[tuple[float, float]] = (
        (0.006, 0.03),
        (0.006, 0.004),
        (0.0048, 0.0015),
        (0.0027, 0.0003),
    ),
) -> tuple[Floats, NDArray[np.int32]]:
    """A rounded cylinder whose tip is at a pad's pose (7,): vertices (k, 3) and triangles (m, 3).

    `rings` of `n` vertices: the radius of each, and its distance behind the tip [m].
    """
    levels = len(rings)
    turns = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    circle = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(n)])
    circles = [radius * circle - [0.0, 0.0, back] for radius, back in rings]
    ends = np.array([[0.0, 0.0, -rings[0][1]], [0.0, 0.0, 0.0]])
    corners, after = np.arange(n), np.roll(np.arange(n), -1)
    faces = [np.column_stack([after, corners, np.full(n, levels * n)])]
    for first in range(0, (levels - 1) * n, n):
        a, b = corners + first, after + first
        faces += [np.column_stack([a, b, a + n]), np.column_stack([b, b + n, a + n])]
    last = (levels - 1) * n
    faces.append(np.column_stack([corners + last, after + last, np.full(n, levels * n + 1)]))
    vertices = Pose.from_array(pose).to_outer(np.concatenate([*circles, ends]))
    return vertices, np.concatenate(faces).astype(np.int32)


def png_bytes(picture: Pixels) -> bytes:
    """A picture as PNG in full colour: a palette would shift the colours of a scale."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(picture).save(data, "PNG", optimize=True)
    return data.getvalue()
