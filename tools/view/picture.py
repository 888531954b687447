"""A moment of a run as a picture: the solid, what was touched, and the finger."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.tools.drawables import LAYERS, Lines, Mesh, Points
from palpate.tools.view.rasteriser import Canvas, Pixels, camera_on
from palpate.tools.view.timeline import Moment, Timeline

# All that is shown at first but the finger, which a film draws as it moves.
DRAWN_LAYERS = frozenset(name for name, layer in LAYERS.items() if layer.shown) - {"finger"}
LINE_WIDTH, TOUCHED_PIXELS, RECENT_PIXELS, PLACE_PIXELS = 2.2, 1.5, 1.0, 3.0
FINGER_SIDES = 24
# Radii of the drawn finger, and how far behind its tip, m.
FINGER_RINGS = ((0.006, 0.03), (0.006, 0.004), (0.0048, 0.0015), (0.0027, 0.0003))


def still(line: Timeline, width: int, height: int) -> Pixels:
    """The end of a run (height, width, 3): the solid and its contours."""
    canvas = Canvas(width, height, camera_on(*line.bounds()))
    draw_moment(canvas, line, line.at(np.inf))
    return canvas.image()


def draw_moment(
    canvas: Canvas, line: Timeline, moment: Moment, colours: Floats | None = None, recent: int = 0
) -> None:
    """Draw what there is at a moment, the solid in the colours of its vertices if they are given.

    All touched points are drawn while there is no solid, and the last `recent` ones when there is.
    """
    touched = [np.zeros((0, 3))]
    for one in line.drawn(moment, DRAWN_LAYERS):
        colour = np.array(LAYERS[one.layer].rgb, np.float64)
        match one.shape:
            case Mesh() as mesh:
                solid = colour if colours is None else colours
                canvas.draw_mesh(mesh.vertices, mesh.faces, solid)
            case Lines() as lines:
                for strip in lines.strips:
                    canvas.draw_line(strip, colour, LINE_WIDTH)
            case Points() as places if one.layer == "touched":
                touched.append(places.points)
            case Points() as places:
                canvas.draw_points(places.lifted(), colour, PLACE_PIXELS)
    points, radius = np.concatenate(touched), TOUCHED_PIXELS
    if moment.models:
        points, radius = points[max(0, len(points) - recent) :], RECENT_PIXELS
    canvas.draw_points(points, np.array(LAYERS["touched"].rgb, np.float64), radius)


def finger_mesh(pose: Floats) -> tuple[Floats, NDArray[np.int32]]:
    """A rounded cylinder whose tip is at a pad's pose: vertices (n, 3) and triangles (m, 3)."""
    n, levels = FINGER_SIDES, len(FINGER_RINGS)
    turns = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    circle = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(n)])
    rings = [wide * circle - [0.0, 0.0, back] for wide, back in FINGER_RINGS]
    ends = np.array([[0.0, 0.0, -FINGER_RINGS[0][1]], [0.0, 0.0, 0.0]])
    here, there = np.arange(n), np.roll(np.arange(n), -1)
    faces = [np.column_stack([there, here, np.full(n, levels * n)])]
    for first in range(0, (levels - 1) * n, n):
        a, b = here + first, there + first
        faces += [np.column_stack([a, b, a + n]), np.column_stack([b, b + n, a + n])]
    last = (levels - 1) * n
    faces.append(np.column_stack([here + last, there + last, np.full(n, levels * n + 1)]))
    vertices = Pose.from_array(pose).to_outer(np.concatenate([*rings, ends]))
    return vertices, np.concatenate(faces).astype(np.int32)


def png_bytes(picture: Pixels) -> bytes:
    """A picture as PNG, in all its colours: fewer would shift those of a scale."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(picture).save(data, "PNG", optimize=True)
    return data.getvalue()
