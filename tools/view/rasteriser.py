"""Triangles, lines and points drawn into an image without a screen and without a GPU.

A z-buffer over arrays: every pixel that any triangle's box covers is tested at once, and the
nearest wins. matplotlib sorts whole triangles by their middles instead, so that contours behind a
solid are seen through it; VTK and OSMesa are larger than all else that palpate needs.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core import geometry
from palpate.core.arrays import Floats, Ints

Pixels = NDArray[np.uint8]
Reals = NDArray[np.float32 | np.float64]
Wholes = NDArray[np.int32 | np.int64]
AT_ONCE = 1 << 21  # Pixels that are tested at once
FINER = 2  # Times as many pixels are drawn along each side as the image will have
AMBIENT, DIFFUSE = 0.42, 0.58  # Of a lit surface
LIGHT = np.array([-0.35, 0.55, 0.76])  # Towards it: right, up, to the eye
SHARP = 0.75  # Cosine of the angle of two faces from which on an edge is not smoothed
BEFORE = 2e-3  # Of the distance, by which lines and points stand before what they lie on
NEAREST = 1e-4  # Least distance from the eye that is drawn, m
EDGE_SPACING = 0.7  # Pixels between the dots of a line


class Camera(NamedTuple):
    """From where a picture is taken."""

    target: Floats  # What stands in the middle, (3,)
    distance: float  # Of the eye from it, m
    azimuth: float = -50.0  # From where, degrees from x to y
    elevation: float = 18.0  # Degrees over the horizon
    opening: float = 28.0  # Of the whole height, degrees

    def axes(self) -> Floats:
        """Right, up and to the eye as rows (3, 3)."""
        turn, rise = np.radians([self.azimuth, self.elevation])
        right = np.array([-np.sin(turn), np.cos(turn), 0.0])
        back = np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
        return np.stack([right, np.cross(back, right), back])


def camera_on(low: Floats, high: Floats, **how: float) -> Camera:
    """A camera that has a box, with corners (3,) each, whole in the picture from any side."""
    half = 0.5 * float(np.linalg.norm(high - low))
    camera = Camera(0.5 * (low + high), 1.0, **how)
    away = 1.04 * half / float(np.sin(np.radians(0.5 * camera.opening)))
    return camera._replace(distance=away)


@dataclass(slots=True)
class Canvas:
    """A picture of so many pixels that something is drawn into."""

    width: int
    height: int
    camera: Camera
    background: tuple[int, int, int] = (255, 255, 255)
    _colours: Reals = field(init=False, repr=False)  # (rows * columns, 3)
    _depths: Reals = field(init=False, repr=False)  # Distance from the eye of each, m

    def __post_init__(self) -> None:
        count = FINER * self.width * FINER * self.height
        self._colours = np.tile(np.asarray(self.background, np.float32), (count, 1))
        self._depths = np.full(count, np.inf, np.float32)

    def project(self, points: Reals) -> Reals:
        """Column, row and distance (n, 3) of points (n, 3), in pixels of the canvas and m."""
        camera = self.camera
        seen = (points - camera.target) @ camera.axes().T
        distance = camera.distance - seen[:, 2]
        scale = 0.5 * FINER * self.height / np.tan(np.radians(0.5 * camera.opening))
        safe = np.maximum(distance, NEAREST)
        columns = 0.5 * FINER * self.width + scale * seen[:, 0] / safe
        rows = 0.5 * FINER * self.height - scale * seen[:, 1] / safe
        return np.column_stack([columns, rows, distance])

    def draw_mesh(self, vertices: Reals, faces: Ints, colours: Reals, *, lit: bool = True) -> None:
        """Draw triangles (m, 3) of vertices (n, 3) with a colour each, (n, 3), or one, (3,).

        What is `lit` is brighter where it faces the light. Both sides of a triangle are seen, but
        for a closed mesh, whose triangles must be counter-clockwise from outside.
        """
        colours = np.broadcast_to(np.asarray(colours, np.float32), vertices.shape)[faces]
        if lit:
            colours = colours * self._shades(vertices, faces)[:, :, None]
        flat = self.project(vertices)[faces].astype(np.float32)
        sides = np.array([FINER * self.width, FINER * self.height])
        starts = np.clip(np.floor(flat[:, :, :2].min(axis=1)).astype(np.int32), 0, sides)
        ends = np.clip(np.ceil(flat[:, :, :2].max(axis=1)).astype(np.int32), 0, sides)
        counts = (ends - starts).prod(axis=1) * (flat[:, :, 2].min(axis=1) > NEAREST)
        if geometry.is_closed(faces):
            counts *= _turn(flat) < 0.0  # rows count downwards
        some = np.flatnonzero(counts)
        batches = np.cumsum(counts[some]) // AT_ONCE
        for begun, ended in pairwise([*np.flatnonzero(np.diff(batches, prepend=-1)), len(some)]):
            one = some[begun:ended]
            self._fill(flat[one], starts[one], (ends - starts)[one, 0], counts[one], colours[one])

    def _shades(self, vertices: Reals, faces: Ints) -> Reals:
        """How bright each corner of each triangle is (m, 3): smooth but for sharp edges."""
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        flat = np.cross(b - a, c - a)
        smooth = np.zeros_like(vertices)
        for corner in range(3):
            np.add.at(smooth, faces[:, corner], flat)
        flat, smooth = (
            one / np.maximum(np.linalg.norm(one, axis=1, keepdims=True), 1e-30)
            for one in (flat, smooth)
        )
        corners = smooth[faces]
        bent = np.einsum("mkc,mc->mk", corners, flat) < SHARP
        corners[bent] = np.broadcast_to(flat[:, None], corners.shape)[bent]
        facing = corners @ (self.camera.axes().T @ LIGHT / np.linalg.norm(LIGHT))
        return np.asarray(AMBIENT + DIFFUSE * np.clip(facing, 0.0, 1.0), np.float32)

    def _fill(
        self,
        corners: Reals,
        starts: Wholes,
        widths: Wholes,
        counts: Wholes,
        colours: Reals,
    ) -> None:
        """Draw triangles of projected corners (m, 3, 3), each tested in so many pixels."""
        owner = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        place = np.arange(len(owner), dtype=np.int32)
        place -= np.repeat((np.cumsum(counts) - counts).astype(np.int32), counts)
        down, right = np.divmod(place, widths[owner])
        # Barycentric coordinates are linear over the image: one plane for each triangle.
        planes = self._planes(corners, starts)[owner]
        v = planes[:, 0] + planes[:, 1] * right + planes[:, 2] * down
        w = planes[:, 3] + planes[:, 4] * right + planes[:, 5] * down
        inside = np.flatnonzero((v >= 0.0) & (w >= 0.0) & (v + w <= 1.0))
        owner, v, w = owner[inside], v[inside], w[inside]
        pixels = (starts[owner, 1] + down[inside]) * (FINER * self.width)
        pixels += starts[owner, 0] + right[inside]
        nearness = 1.0 / corners[:, :, 2]
        a, b, c = nearness.T
        total = a[owner] + v * (b - a)[owner] + w * (c - a)[owner]
        won = self._nearer(pixels, 1.0 / total)
        owner, v, w = owner[won], v[won, None], w[won, None]
        scaled = colours * nearness[:, :, None]
        mixed = scaled[owner, 0] * (1.0 - v - w) + scaled[owner, 1] * v + scaled[owner, 2] * w
        self._colours[pixels[won]] = mixed / total[won, None]

    def _planes(self, corners: Reals, starts: Wholes) -> Reals:
        """Second and third barycentric coordinate at a box's first pixel, and their slopes."""
        a, ab, ac = corners[:, 0, :2], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = _turn(corners)
        over = np.divide(1.0, area, where=area != 0.0, out=np.zeros_like(area))
        x, y = (starts + np.float32(0.5) - a).T
        v = (ac[:, 1] * over, -ac[:, 0] * over)
        w = (-ab[:, 1] * over, ab[:, 0] * over)
        begin_v, begin_w = v[0] * x + v[1] * y, w[0] * x + w[1] * y
        begin_v = np.where(area == 0.0, -1.0, begin_v)  # seen edge-on: nothing of it is inside
        return np.column_stack([begin_v, *v, begin_w, *w]).astype(np.float32)

    def _nearer(self, pixels: Wholes, depths: Reals) -> NDArray[np.intp]:
        """Which of some pixels are the nearest that were drawn there; their depths are kept."""
        depths = depths.astype(np.float32, copy=False)
        np.minimum.at(self._depths, pixels, depths)
        return np.flatnonzero(depths == self._depths[pixels])

    def draw_points(self, points: Reals, colours: Reals, radius: float) -> None:
        """Draw discs of a radius, in pixels of the image, at points (n, 3), colours as a mesh's."""
        colours = np.broadcast_to(np.asarray(colours, np.float32), points.shape)
        reach = FINER * radius
        steps = np.arange(-np.ceil(reach), np.ceil(reach) + 1)
        dx, dy = (one.ravel() for one in np.meshgrid(steps, steps))
        near = dx * dx + dy * dy <= reach * reach
        flat = self.project(points)
        columns = np.rint(flat[:, 0, None] + dx[near]).astype(np.int64)
        rows = np.rint(flat[:, 1, None] + dy[near]).astype(np.int64)
        seen = (columns >= 0) & (columns < FINER * self.width) & (rows >= 0)
        seen &= (rows < FINER * self.height) & (flat[:, 2, None] > NEAREST)
        owner = np.nonzero(seen)[0]
        pixels = (rows * (FINER * self.width) + columns)[seen]
        won = self._nearer(pixels, flat[owner, 2] * (1.0 - BEFORE))
        self._colours[pixels[won]] = colours[owner[won]]

    def draw_line(
        self, points: Reals, colour: Reals, width: float, *, closed: bool = False
    ) -> None:
        """Draw a line through points (n, 3), of a width in pixels of the image."""
        if closed and len(points):
            points = np.concatenate([points, points[:1]])
        if len(points) < 2:
            return
        flat = self.project(points)[:, :2]
        lengths = np.linalg.norm(np.diff(flat, axis=0), axis=1)
        counts = np.clip(np.ceil(lengths / (EDGE_SPACING * FINER)), 1, 4 * FINER * self.width)
        owner = np.repeat(np.arange(len(counts)), counts.astype(np.int64))
        first = np.cumsum(counts) - counts
        share = ((np.arange(len(owner)) - first[owner]) / counts[owner])[:, None]
        dots = (1.0 - share) * points[:-1][owner] + share * points[1:][owner]
        self.draw_points(dots, colour, 0.5 * width)

    def blend(self, layer: Canvas, opacity: float) -> None:
        """Lay another canvas of the same size and camera over this one where it is nearer."""
        before = layer._depths < self._depths
        mixed = (1.0 - opacity) * self._colours[before] + opacity * layer._colours[before]
        self._colours[before] = mixed

    def image(self) -> Pixels:
        """The picture (height, width, 3), its edges smoothed."""
        shape = (self.height, FINER, self.width, FINER, 3)
        mean = self._colours.reshape(shape).mean(axis=(1, 3))
        return np.asarray(np.rint(mean), np.uint8)


def _turn(corners: Reals) -> Reals:
    """Twice the area of projected triangles (m, 3, 3), positive if clockwise in the image."""
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
