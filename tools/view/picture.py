"""A moment of a run as a picture: the solid, what was touched, and the finger."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.poses import transform_points
from palpate.launch.colours import rgb
from palpate.tools.view.rasteriser import Canvas, Pixels, camera_on
from palpate.tools.view.timeline import Moment, Timeline

SOLID, CONTOUR, TOUCHED, FINGER = (
    np.array(rgb(one), np.float64) for one in ("solid", "contour", "touch", "finger")
)
LINE_WIDTH = 2.2  # Pixels
FINGER_SIDES = 24
# Radii of the drawn finger, and how far behind its tip, m.
FINGER_RINGS = ((0.006, 0.03), (0.006, 0.004), (0.0048, 0.0015), (0.0027, 0.0003))


def still(line: Timeline, width: int, height: int) -> Pixels:
    """The end of a run (height, width, 3): the solid and its contours."""
    canvas = Canvas(width, height, camera_on(*line.bounds()))
    draw_moment(canvas, line, line.at(np.inf))
    return canvas.image()


def draw_moment(canvas: Canvas, line: Timeline, moment: Moment, colours: Floats = SOLID) -> None:
    """Draw the solid of a moment, with a colour or one for each vertex, contours and touches."""
    if moment.models:
        model = line.models[moment.models - 1]
        canvas.draw_mesh(model.vertices, model.faces, colours)
    else:
        points = [one.points for one in line.touches[: moment.touches]]
        points += [one.points for one in line.grasps[: moment.grasps]]
        canvas.draw_points(np.concatenate([np.zeros((0, 3)), *points]), TOUCHED, 1.5)
    for one in line.contours[: moment.contours]:
        canvas.draw_line(one.points, CONTOUR, LINE_WIDTH, closed=one.status == "closed")


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
    vertices = transform_points(pose, np.concatenate([*rings, ends]))
    return vertices, np.concatenate(faces).astype(np.int32)


def png_bytes(picture: Pixels) -> bytes:
    """A picture as PNG, in all its colours: fewer would shift those of a scale."""
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(picture).save(data, "PNG", optimize=True)
    return data.getvalue()
