"""Data of the three-dimensional view of a report, packed small: a run as JSON and bytes.

Points are 16-bit multiples of 1/65535 of the box of the run, values 8-bit multiples of 1/255 of
their scale's top: both finer than a pixel. All arrays together are one gzip in base64.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Floats, Ints
from palpate.core.touch import Pad
from palpate.launch.printing import millimetres
from palpate.messages.types import ShapeModel
from palpate.tools.drawables import (
    LAYERS,
    SIZES,
    Drawable,
    Finger,
    Lines,
    Mesh,
    Points,
    model_mesh,
    pad_body,
)
from palpate.tools.report.run_facts import Place
from palpate.tools.surfaces import hex_colour, scale_top
from palpate.tools.view.timeline import TRACED, Timeline

STEPS = int(np.iinfo(np.uint16).max)  # of the box of the run
SHADES = int(np.iinfo(np.uint8).max)  # of a scale
PLAIN = "plain"  # name of the colouring without values
KINDS = {np.dtype(kind): kind.strip("<") for kind in ("u1", "<u2", "<u4", "<f4")}


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewLimits:
    """How much of a run a page holds."""

    max_models: int = 14  # spread evenly over all models of the run
    max_faces: int = 80_000  # triangles of these models together, about
    min_models: int = 3  # also if they have more triangles
    compression_level: int = 6  # of gzip; 9 takes three times as long and saves 1 %


DEFAULT_LIMITS = ViewLimits()


@dataclass(slots=True)
class ArrayPacker:
    """Packs arrays one after the other, and says where each of them is."""

    low: Floats  # (3,) corner of the box of the run [m]
    step: float  # [m] of packed points
    _parts: list[bytes] = field(default_factory=list)
    _size: int = 0

    def points(self, points: Floats) -> list[Any]:
        """Pack points (n, 3) [m]."""
        return self._add(np.clip(np.rint((points - self.low) / self.step), 0, STEPS), "<u2")

    def surface(self, vertices: Floats, faces: Ints) -> dict[str, Any]:
        """Pack a mesh: vertices (n, 3) [m] and triangles (m, 3)."""
        kind = "<u2" if len(vertices) <= STEPS else "<u4"
        return {"vertices": self.points(vertices), "faces": self._add(faces, kind)}

    def pad(self, pad: Pad) -> dict[str, Any]:
        """Pack the mesh of a pad in its own frame."""
        vertices, faces = pad_body(pad)
        return {"vertices": self._add(vertices, "<f4"), "faces": self._add(faces, "<u4")}

    def shades(self, values: Floats, top: float) -> list[Any]:
        """Pack values (n,); all above `top` have the last shade."""
        return self._add(np.clip(np.rint(values / top * SHADES), 0, SHADES), "u1")

    def _add(self, values: ArrayLike, kind: str) -> list[Any]:
        """Pack an array; returns its kind, offset [bytes] and length."""
        array: NDArray[Any] = np.ascontiguousarray(values, np.dtype(kind))
        entry = [KINDS[array.dtype], self._size, array.size]
        data = array.tobytes() + b"\0" * (-array.nbytes % 4)
        self._parts.append(data)
        self._size += len(data)
        return entry

    def text(self, compression_level: int) -> str:
        """All packed arrays as base64 of gzip."""
        packed = gzip.compress(b"".join(self._parts), compression_level, mtime=0)
        return base64.b64encode(packed).decode()


class ViewData(NamedTuple):
    """A run for the view."""

    described: str  # JSON
    packed: str  # arrays
    tops: dict[str, float]  # value of the last colour [m] of each colouring except the plain one
    layers: tuple[str, ...]  # with something to draw


def view_data(
    line: Timeline, places: Sequence[Place], limits: ViewLimits = DEFAULT_LIMITS
) -> ViewData:
    """Pack a timeline, and the places that a reader may want to look at."""
    low, high = line.bounds()
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    models = _shown(line.models, limits)
    drawn = _drawables(line, models)
    # Touches, lattice and space may lie outside of the box of the solid.
    far = [np.abs(_points(drawable) - middle).max(initial=0.6 * size) for drawable in drawn]
    half = max(far, default=0.6 * size)
    arrays = ArrayPacker(middle - half, 2.0 * half / STEPS)
    last = model_mesh(models[-1], line.surface).scalars() if models else {}
    tops = {name: scale_top(values) for name, values in last.items()}
    described: dict[str, Any] = {
        "low": arrays.low.tolist(),
        "step": arrays.step,
        "middle": middle.tolist(),
        "size": size,
        "end": math.ceil(1e3 * line.end) / 1e3,
        "colourings": [PLAIN, *tops],
        "layers": {name: layer._asdict() for name, layer in LAYERS.items()},
        "shades": [hex_colour(SHADES - shade, SHADES) for shade in range(SHADES + 1)],
        "models": [{"time": model.robot_time, "told": _text(line, model)} for model in models],
        "drawables": [_packed(drawable, arrays, tops) for drawable in drawn],
        "contours": [some.robot_time for some in line.contours if some.status in TRACED],
        "touches": _touches(line, arrays),
        "pad": line.known.pad and arrays.pad(line.known.pad),
        "places": [{"time": place.time, "point": place.point.tolist()} for place in places],
    }
    present = {drawable.layer for drawable in drawn} | ({"touched"} if line.touches else set())
    layers = tuple(name for name in LAYERS if name in present)
    packed = arrays.text(limits.compression_level)
    return ViewData(json.dumps(described, allow_nan=False), packed, tops, layers)


def _drawables(line: Timeline, models: Sequence[ShapeModel]) -> list[Drawable]:
    """Drawables of a run with some of its models, and only its last map of space.

    Taxels are left out, as they are packed together, and growing contours.
    """
    space = line.space_at(line.at(np.inf))
    messages: list[Any] = [line.truth, *models, *line.contours, *line.grasps, space, line.done]
    kept = (line.drawables_of(message) for message in messages if message is not None)
    return [*chain.from_iterable(kept), *(touch.placed(line.known.pad) for touch in line.touches)]


def _packed(drawable: Drawable, arrays: ArrayPacker, tops: dict[str, float]) -> dict[str, Any]:
    """A drawable as the program of the page reads it."""
    time = drawable.time or 0.0
    packed: dict[str, Any] = {"layer": drawable.layer, "path": drawable.path, "time": time}
    match drawable.shape:
        case Mesh() as mesh:
            packed |= arrays.surface(mesh.vertices, mesh.faces)
            scalars = ((name, some) for name, some in mesh.scalars().items() if name in tops)
            packed["values"] = {name: arrays.shades(some, tops[name]) for name, some in scalars}
        case Lines():
            packed["pieces"] = arrays.points(_points(drawable))
        case Points(radius=radius):
            packed |= {"points": arrays.points(_points(drawable)), "radius": radius}
        case Finger(pose=pose):
            packed["pose"] = pose.round(6).tolist()
    return packed


def _points(drawable: Drawable) -> Floats:
    """All points of a drawable (n, 3) [m]."""
    match drawable.shape:
        case Mesh() as mesh:
            return mesh.vertices
        case Lines() as lines:
            return lines.pieces(lift=0.0).reshape(-1, 3)
        case Points() as points:
            return points.points
    return np.zeros((0, 3))


def _shown(models: Sequence[ShapeModel], limits: ViewLimits) -> list[ShapeModel]:
    """The models that are shown, with the last: fewer if they are large."""
    mean_faces = sum(len(model.faces) for model in models[:-1]) / max(len(models) - 1, 1)
    by_faces = limits.min_models + int(limits.max_faces / max(mean_faces, 1.0))
    count = min(len(models), limits.max_models, by_faces)
    chosen = np.unique(np.linspace(0, len(models) - 1, count).round())
    return [models[int(i)] for i in chosen]


def _text(line: Timeline, model: ShapeModel) -> str:
    """Number, error and bound of a model."""
    score, estimate = line.scores.get(model.number), line.estimates.get(model.number)
    parts = [f"model {model.number}"]
    if score is not None:
        parts.append(f"rms error {millimetres(score.rms)}")
    if estimate is not None and estimate.rms_bound_95 is not None:
        parts.append(f"bound {millimetres(estimate.rms_bound_95)}")
    return ", ".join(parts)


def _touches(line: Timeline, arrays: ArrayPacker) -> dict[str, Any]:
    points = [touch.points for touch in line.touches]
    return {
        "times": [round(touch.time, 3) for touch in line.touches],
        "ends": np.cumsum([*map(len, points)], dtype=int).tolist(),
        "points": arrays.points(np.concatenate([np.zeros((0, 3)), *points])),
        "radius": SIZES.taxel_radius,
    }
