"""Triangles, lines and points drawn into an image without a screen and without a GPU.

A z-buffer over arrays: the pixels in the boxes of many triangles are tested at once, and the
nearest triangle wins. matplotlib sorts whole triangles by their middles instead, so that contours
behind a solid show through it; VTK and OSMesa are larger than all else that palpate needs.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class RasterSettings:
    """Resolution, light and order in depth of a drawn picture."""

    supersampling: int = 2  # drawn pixels per pixel of the image, along each side; larger: smoother
    batch_pixels: int = 1 << 21  # tested at once; more take more memory
    ambient: float = 0.42  # brightness of a lit surface that faces away from the light
    diffuse: float = 0.58  # added where it faces the light
    light: tuple[float, float, float] = (-0.35, 0.55, 0.76)  # towards it: right, up, to the eye
    min_smooth_cosine: float = 0.75  # of corner and face normal; below it an edge stays sharp
    depth_bias: float = 2e-3  # fraction of the distance by which points and lines are drawn nearer
    min_depth: float = 1e-4  # [m] from the eye, below which nothing is drawn
    dot_spacing: float = 0.7  # [pixels] between the dots of a line


DEFAULT_RASTER = RasterSettings()


class Camera(NamedTuple):
    """The eye of a picture, and the point that it looks at."""

    target: Floats  # (3,) point in the middle of the picture [m]
    distance: float  # [m] of the eye from it
    azimuth: float = -50.0  # [degrees] of the eye, from x to y
    elevation: float = 18.0  # [degrees] of the eye over the horizon
    opening: float = 28.0  # [degrees] vertical opening angle

    def axes(self) -> Floats:
        """Unit vectors to the right, up and to the eye, as rows (3, 3)."""
        turn, rise = np.radians([self.azimuth, self.elevation])
        right = np.array([-np.sin(turn), np.cos(turn), 0.0])
        back = np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
        return np.stack([right, np.cross(back, right), back])


def camera_on(low: Floats, high: Floats, **angles: float) -> Camera:
    """A camera that shows all of a box, with corners (3,), from any side.

    `angles` [degrees]: fields of `Camera` by name.
    """
    half = 0.5 * float(np.linalg.norm(high - low))
    camera = Camera(0.5 * (low + high), 1.0, **angles)
    distance = 1.04 * half / float(np.sin(np.radians(0.5 * camera.opening)))
    return camera._replace(distance=distance)


@dataclass(slots=True)
class Canvas:
    """A picture to draw into, `width` by `height` pixels."""

    width: int
    height: int
    camera: Camera
    background: tuple[int, int, int] = (255, 255, 255)
    settings: RasterSettings = DEFAULT_RASTER
    _colours: Reals = field(init=False, repr=False)  # (rows * columns, 3)
    _depths: Reals = field(init=False, repr=False)  # (rows * columns,) from the eye [m]
    _columns: int = field(init=False, repr=False)  # drawn, of which an image has fewer
    _rows: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._columns = self.settings.supersampling * self.width
        self._rows = self.settings.supersampling * self.height
        count = self._columns * self._rows
        self._colours = np.tile(np.asarray(self.background, np.float32), (count, 1))
        self._depths = np.full(count, np.inf, np.float32)

    def project(self, points: Reals) -> Reals:
        """Column and row [drawn pixels] and distance [m] of points (n, 3), as (n, 3)."""
        camera = self.camera
        seen = (points - camera.target) @ camera.axes().T
        distance = camera.distance - seen[:, 2]
        scale = 0.5 * self._rows / np.tan(np.radians(0.5 * camera.opening))
        safe = np.maximum(distance, self.settings.min_depth)
        columns = 0.5 * self._columns + scale * seen[:, 0] / safe
        rows = 0.5 * self._rows - scale * seen[:, 1] / safe
        return np.column_stack([columns, rows, distance])

    def draw_mesh(self, vertices: Reals, faces: Ints, colours: Reals, *, lit: bool = True) -> None:
        """Draw triangles (m, 3) of vertices (n, 3) with a colour each, (n, 3), or one, (3,).

        A `lit` mesh is brighter where it faces the light. Both sides of a triangle are drawn;
        of a closed mesh, whose triangles must be counter-clockwise from outside, only the outer.
        """
        colours = np.broadcast_to(np.asarray(colours, np.float32), vertices.shape)[faces]
        if lit:
            colours = colours * self._shades(vertices, faces)[:, :, None]
        flat = self.project(vertices)[faces].astype(np.float32)
        sides = np.array([self._columns, self._rows])
        starts = np.clip(np.floor(flat[:, :, :2].min(axis=1)).astype(np.int32), 0, sides)
        ends = np.clip(np.ceil(flat[:, :, :2].max(axis=1)).astype(np.int32), 0, sides)
        counts = (ends - starts).prod(axis=1) * (
            flat[:, :, 2].min(axis=1) > self.settings.min_depth
        )
        if geometry.is_closed(faces):
            counts *= _doubled_areas(flat) < 0.0  # rows count downwards
        seen = np.flatnonzero(counts)
        batches = np.cumsum(counts[seen]) // self.settings.batch_pixels
        for begin, end in pairwise([*np.flatnonzero(np.diff(batches, prepend=-1)), len(seen)]):
            own = seen[begin:end]
            self._fill(flat[own], starts[own], (ends - starts)[own, 0], counts[own], colours[own])

    def _shades(self, vertices: Reals, faces: Ints) -> Reals:
        """Brightness (m, 3) of the corners of triangles: smooth, except at sharp edges."""
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        flat = np.cross(b - a, c - a)
        smooth = np.zeros_like(vertices)
        for corner in range(3):
            np.add.at(smooth, faces[:, corner], flat)
        flat, smooth = (
            normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
            for normals in (flat, smooth)
        )
        corners = smooth[faces]
        bent = np.einsum("mkc,mc->mk", corners, flat) < self.settings.min_smooth_cosine
        corners[bent] = np.broadcast_to(flat[:, None], corners.shape)[bent]
        light, settings = np.array(self.settings.light), self.settings
        facing = np.clip(corners @ (self.camera.axes().T @ light / np.linalg.norm(light)), 0.0, 1.0)
        return np.asarray(settings.ambient + settings.diffuse * facing, np.float32)

    def _fill(
        self,
        corners: Reals,
        starts: Wholes,
        widths: Wholes,
        counts: Wholes,
        colours: Reals,
    ) -> None:
        """Draw triangles of projected corners (m, 3, 3), each with `counts` pixels in its box."""
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
        pixels = (starts[owner, 1] + down[inside]) * self._columns
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
        """Second and third barycentric coordinate at the first pixel of a box, and their slopes."""
        a, ab, ac = corners[:, 0, :2], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = _doubled_areas(corners)
        over = np.divide(1.0, area, where=area != 0.0, out=np.zeros_like(area))
        x, y = (starts + np.float32(0.5) - a).T
        v = (ac[:, 1] * over, -ac[:, 0] * over)
        w = (-ab[:, 1] * over, ab[:, 0] * over)
        begin_v, begin_w = v[0] * x + v[1] * y, w[0] * x + w[1] * y
        begin_v = np.where(area == 0.0, -1.0, begin_v)  # seen edge-on: it has no pixel inside
        return np.column_stack([begin_v, *v, begin_w, *w]).astype(np.float32)

    def _nearer(self, pixels: Wholes, depths: Reals) -> NDArray[np.intp]:
        """Indices of the pixels nearer than what was drawn there; keeps their depths."""
        depths = depths.astype(np.float32, copy=False)
        np.minimum.at(self._depths, pixels, depths)
        return np.flatnonzero(depths == self._depths[pixels])

    def draw_points(self, points: Reals, colours: Reals, radius: float) -> None:
        """Draw discs at points (n, 3), `colours` (n, 3) or (3,), `radius` [pixels of the image]."""
        colours = np.broadcast_to(np.asarray(colours, np.float32), points.shape)
        reach = self.settings.supersampling * radius
        steps = np.arange(-np.ceil(reach), np.ceil(reach) + 1)
        dx, dy = (offsets.ravel() for offsets in np.meshgrid(steps, steps))
        near = dx * dx + dy * dy <= reach * reach
        flat = self.project(points)
        columns = np.rint(flat[:, 0, None] + dx[near]).astype(np.int64)
        rows = np.rint(flat[:, 1, None] + dy[near]).astype(np.int64)
        seen = (columns >= 0) & (columns < self._columns) & (rows >= 0)
        seen &= (rows < self._rows) & (flat[:, 2, None] > self.settings.min_depth)
        owner = np.nonzero(seen)[0]
        pixels = (rows * self._columns + columns)[seen]
        won = self._nearer(pixels, flat[owner, 2] * (1.0 - self.settings.depth_bias))
        self._colours[pixels[won]] = colours[owner[won]]

    def draw_line(
        self, points: Reals, colour: Reals, width: float, *, closed: bool = False
    ) -> None:
        """Draw a line through points (n, 3); `width` in pixels of the image."""
        if closed and len(points):
            points = np.concatenate([points, points[:1]])
        if len(points) < 2:
            return
        flat = self.project(points)[:, :2]
        lengths = np.linalg.norm(np.diff(flat, axis=0), axis=1)
        spacing = self.settings.dot_spacing * self.settings.supersampling
        counts = np.clip(np.ceil(lengths / spacing), 1, 4 * self._columns)
        owner = np.repeat(np.arange(len(counts)), counts.astype(np.int64))
        first = np.cumsum(counts) - counts
        share = ((np.arange(len(owner)) - first[owner]) / counts[owner])[:, None]
        dots = (1.0 - share) * points[:-1][owner] + share * points[1:][owner]
        self.draw_points(dots, colour, 0.5 * width)

    def blend(self, layer: Canvas, opacity: float) -> None:
        """Blend another canvas of the same size and camera into this one where it is nearer."""
        nearer = layer._depths < self._depths
        mixed = (1.0 - opacity) * self._colours[nearer] + opacity * layer._colours[nearer]
        self._colours[nearer] = mixed

    def image(self) -> Pixels:
        """The picture (height, width, 3), its edges smoothed."""
        finer = self.settings.supersampling
        shape = (self.height, finer, self.width, finer, 3)
        mean = self._colours.reshape(shape).mean(axis=(1, 3))
        return np.asarray(np.rint(mean), np.uint8)


def _doubled_areas(corners: Reals) -> Reals:
    """Twice the area of projected triangles (m, 3, 3), positive if clockwise in the image."""
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
