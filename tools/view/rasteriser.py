"""Triangles, lines and points drawn into an image without a screen and without a GPU.

A z-buffer over arrays: every pixel that any triangle's box covers is tested at once, and the
nearest wins. matplotlib sorts whole triangles by their middles instead, so that contours behind a
solid are seen through it; VTK and OSMesa are larger than all else that palpate needs.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core import Floats

Pixels = NDArray[np.uint8]
AT_ONCE = 1 << 21  # Pixels that are tested at once
FINER = 2  # Times as many pixels are drawn along each side as the image will have
AMBIENT, DIFFUSE = 0.42, 0.58  # Of a lit surface
LIGHT = np.array([-0.35, 0.55, 0.76])  # Towards it: right, up, to the eye
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
    opening = np.radians(how.get("opening", Camera._field_defaults["opening"]))
    return Camera(0.5 * (low + high), 1.04 * half / np.sin(0.5 * opening), **how)


@dataclass(slots=True)
class Canvas:
    """A picture of so many pixels that something is drawn into."""

    width: int
    height: int
    camera: Camera
    background: tuple[int, int, int] = (255, 255, 255)
    _colours: Floats = field(init=False, repr=False)  # (rows * columns, 3)
    _depths: Floats = field(init=False, repr=False)  # Distance from the eye of each, m

    def __post_init__(self) -> None:
        count = FINER * self.width * FINER * self.height
        self._colours = np.tile(np.asarray(self.background, np.float32), (count, 1))
        self._depths = np.full(count, np.inf, np.float32)

    def project(self, points: Floats) -> Floats:
        """Column, row and distance (n, 3) of points (n, 3), in pixels of the canvas and m."""
        camera = self.camera
        seen = (points - camera.target) @ camera.axes().T
        distance = camera.distance - seen[:, 2]
        scale = 0.5 * FINER * self.height / np.tan(np.radians(0.5 * camera.opening))
        safe = np.maximum(distance, NEAREST)
        columns = 0.5 * FINER * self.width + scale * seen[:, 0] / safe
        rows = 0.5 * FINER * self.height - scale * seen[:, 1] / safe
        return np.column_stack([columns, rows, distance])

    def draw_mesh(
        self, vertices: Floats, faces: NDArray[np.int32], colours: Floats, *, lit: bool = True
    ) -> None:
        """Draw triangles (m, 3) of vertices (n, 3) with a colour each, (n, 3), or one, (3,).

        What is `lit` is brighter where it faces the light; both sides of a triangle are seen.
        """
        colours = np.broadcast_to(np.asarray(colours, np.float32), vertices.shape)
        shades = self._shades(vertices, faces) if lit else np.ones(len(faces), np.float32)
        flat = self.project(vertices)[faces]
        ends = np.ceil(flat[:, :, :2].max(axis=1)).astype(np.int64)
        starts = np.floor(flat[:, :, :2].min(axis=1)).astype(np.int64)
        sides = (FINER * self.width, FINER * self.height)
        starts, ends = np.clip(starts, 0, sides), np.clip(ends, 0, sides)
        sizes = ends - starts
        counts = sizes.prod(axis=1) * (flat[:, :, 2].min(axis=1) > NEAREST)
        batches = np.cumsum(counts) // AT_ONCE
        for batch in range(int(batches[-1]) + 1 if len(batches) else 0):
            some = np.flatnonzero((batches == batch) & (counts > 0))
            self._fill(flat[some], starts[some], sizes[some, 0], counts[some],
                       colours[faces[some]] * shades[some, None, None])  # fmt: skip

    def _shades(self, vertices: Floats, faces: NDArray[np.int32]) -> Floats:
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
        facing = normals @ (self.camera.axes().T @ LIGHT) / lengths
        return np.asarray(AMBIENT + DIFFUSE * np.clip(facing, 0.0, 1.0), np.float32)

    def _fill(
        self,
        corners: Floats,
        starts: NDArray[np.int64],
        widths: NDArray[np.int64],
        counts: NDArray[np.int64],
        colours: Floats,
    ) -> None:
        """Draw triangles of projected corners (m, 3, 3), each tested in so many pixels."""
        owner = np.repeat(np.arange(len(counts)), counts)
        place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        column = starts[owner, 0] + place % widths[owner]
        row = starts[owner, 1] + place // widths[owner]
        a, b, c = (corners[:, i, :2] for i in range(3))
        ab, ac = b - a, c - a
        area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
        area = np.where(area == 0.0, np.inf, area)
        dx, dy = column + 0.5 - a[owner, 0], row + 0.5 - a[owner, 1]
        v = (dx * ac[owner, 1] - dy * ac[owner, 0]) / area[owner]
        w = (dy * ab[owner, 0] - dx * ab[owner, 1]) / area[owner]
        inside = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)
        owner, v, w = owner[inside], v[inside], w[inside]
        shares = np.column_stack([1.0 - v - w, v, w]) / corners[owner, :, 2]
        total = shares.sum(axis=1)
        pixels = row[inside] * (FINER * self.width) + column[inside]
        won = self._nearer(pixels, 1.0 / total)
        mixed = np.einsum("nk,nkc->nc", shares[won] / total[won, None], colours[owner[won]])
        self._colours[pixels[won]] = mixed

    def _nearer(self, pixels: NDArray[np.int64], depths: Floats) -> NDArray[np.intp]:
        """Which of some pixels are the nearest that were drawn there; their depths are kept."""
        depths = depths.astype(np.float32)
        np.minimum.at(self._depths, pixels, depths)
        return np.flatnonzero(depths == self._depths[pixels])

    def draw_points(self, points: Floats, colours: Floats, radius: float) -> None:
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
        self, points: Floats, colour: Floats, width: float, *, closed: bool = False
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
        return np.rint(self._colours.reshape(shape).mean(axis=(1, 3))).astype(np.uint8)
