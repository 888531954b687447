"""What the three-dimensional view of a report draws, packed small: a run as JSON and bytes.

Places are whole numbers of 1/65535 of the box about everything, values of 1/255 of their scale's
top: both finer than a pixel. All arrays together are one gzip in base64.
"""

from __future__ import annotations

import base64
import gzip
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Floats, Ints
from palpate.core.touch import Pad
from palpate.launch.printing import millimetres
from palpate.messages.types import ShapeModel
from palpate.tools.drawables import (
    LAYERS,
    TAXEL_RADIUS,
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

STEPS = 65535  # Of the box about everything
SHADES = 255  # Of a scale
MOST_MODELS = 14  # On the way that can be shown, spread evenly over those that there are
MOST_FACES, LEAST_MODELS = 80_000, 3  # Of them together, but so many are shown whatever their size
PLAIN = "plain"  # The colouring that tells nothing
KINDS = {np.dtype(kind): kind.strip("<") for kind in ("u1", "<u2", "<u4", "<f4")}
PACKING = 6  # Of gzip: 9 takes three times as long and saves a hundredth


@dataclass(slots=True)
class ArrayPacker:
    """Arrays one after the other, and where each of them is."""

    low: Floats  # Corner of the box about everything (3,), m
    step: float  # m
    _parts: list[bytes] = field(default_factory=list)
    _size: int = 0

    def places(self, points: Floats) -> list[Any]:
        """Take points (n, 3)."""
        return self._add(np.clip(np.rint((points - self.low) / self.step), 0, STEPS), "<u2")

    def surface(self, vertices: Floats, faces: Ints) -> dict[str, Any]:
        """Take a mesh: vertices (n, 3) and triangles (m, 3)."""
        kind = "<u2" if len(vertices) <= STEPS else "<u4"
        return {"vertices": self.places(vertices), "faces": self._add(faces, kind)}

    def pad(self, pad: Pad) -> dict[str, Any]:
        """Take the mesh of a pad in its own frame."""
        vertices, faces = pad_body(pad)
        return {"vertices": self._add(vertices, "<f4"), "faces": self._add(faces, "<u4")}

    def shades(self, values: Floats, top: float) -> list[Any]:
        """Take values (n,), of which those from `top` on are alike."""
        return self._add(np.clip(np.rint(values / top * SHADES), 0, SHADES), "u1")

    def _add(self, values: ArrayLike, kind: str) -> list[Any]:
        """Take an array; returns its kind, offset in bytes and length."""
        array: NDArray[Any] = np.ascontiguousarray(values, np.dtype(kind))
        place = [KINDS[array.dtype], self._size, array.size]
        data = array.tobytes() + b"\0" * (-array.nbytes % 4)
        self._parts.append(data)
        self._size += len(data)
        return place

    def text(self) -> str:
        """All of them as base64 of gzip."""
        return base64.b64encode(gzip.compress(b"".join(self._parts), PACKING, mtime=0)).decode()


class ViewData(NamedTuple):
    """A run for the view."""

    described: str  # JSON
    packed: str  # The arrays
    tops: dict[str, float]  # Value of the last colour, m, of each colouring but the plain one
    layers: tuple[str, ...]  # Of which there is something to draw


def view_data(line: Timeline, places: Sequence[Place]) -> ViewData:
    """Pack what a timeline holds."""
    low, high = line.bounds()
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    drawn, models = _drawables(line), _shown(line.models)
    # Touches, lattice and space may lie outside of what is solid.
    far = [np.abs(_places(one) - middle).max(initial=0.6 * size) for one in drawn]
    half = max(far, default=0.6 * size)
    arrays = ArrayPacker(middle - half, 2.0 * half / STEPS)
    last = model_mesh(models[-1], line.surface).scalars() if models else {}
    tops = {name: scale_top(values) for name, values in last.items()}
    told: dict[str, Any] = {
        "low": arrays.low.tolist(),
        "step": arrays.step,
        "middle": middle.tolist(),
        "size": size,
        "end": math.ceil(1e3 * line.end) / 1e3,
        "colourings": [PLAIN, *tops],
        "layers": {name: layer._asdict() for name, layer in LAYERS.items()},
        "shades": [hex_colour(SHADES - shade, SHADES) for shade in range(SHADES + 1)],
        "models": [{"time": one.robot_time, "told": _told(line, one)} for one in models],
        "drawables": [_packed(one, arrays, tops) for one in drawn],
        "contours": [one.robot_time for one in line.contours if one.status in TRACED],
        "touches": _touches(line, arrays),
        "pad": line.known.pad and arrays.pad(line.known.pad),
        "places": [{"time": one.time, "point": one.point.tolist()} for one in places],
    }
    found = {one.layer for one in drawn} | ({"touched"} if line.touches else set())
    layers = tuple(name for name in LAYERS if name in found)
    return ViewData(json.dumps(told, allow_nan=False), arrays.text(), tops, layers)


def _drawables(line: Timeline) -> list[Drawable]:
    """All of a run but taxels, which are packed together, and contours that grow.

    The page stays small: it has some of the models, and the last space alone.
    """
    space = line.space_at(line.at(np.inf))
    kept = [line.truth, *_shown(line.models), *line.contours, *line.grasps, space]
    messages: list[Any] = [*kept, line.done]
    drawn = [one for message in messages if message is not None for one in line.of(message)]
    return drawn + [one.placed(line.known.pad) for one in line.touches]


def _packed(one: Drawable, arrays: ArrayPacker, tops: dict[str, float]) -> dict[str, Any]:
    """A drawable as the page's program reads it."""
    packed: dict[str, Any] = {"layer": one.layer, "path": one.path, "time": one.time or 0.0}
    match one.shape:
        case Mesh() as mesh:
            packed |= arrays.surface(mesh.vertices, mesh.faces)
            scalars = ((name, some) for name, some in mesh.scalars().items() if name in tops)
            packed["values"] = {name: arrays.shades(some, tops[name]) for name, some in scalars}
        case Lines():
            packed["pieces"] = arrays.places(_places(one))
        case Points(radius=radius):
            packed |= {"points": arrays.places(_places(one)), "radius": radius}
        case Finger(pose=pose):
            packed["pose"] = pose.round(6).tolist()
    return packed


def _places(one: Drawable) -> Floats:
    """All points of a drawable (n, 3) [m]."""
    match one.shape:
        case Mesh() as mesh:
            return mesh.vertices
        case Lines() as lines:
            return lines.pieces(lift=0.0).reshape(-1, 3)
        case Points() as points:
            return points.points
    return np.zeros((0, 3))


def _shown(models: Sequence[ShapeModel]) -> list[ShapeModel]:
    """The models that can be shown, the last always among them: fewer where they are large."""
    faces = sum(len(one.faces) for one in models[:-1]) / max(len(models) - 1, 1)
    count = min(len(models), MOST_MODELS, LEAST_MODELS + int(MOST_FACES / max(faces, 1.0)))
    chosen = np.unique(np.linspace(0, len(models) - 1, count).round())
    return [models[int(i)] for i in chosen]


def _told(line: Timeline, model: ShapeModel) -> str:
    score, known = line.scores.get(model.number), line.estimates.get(model.number)
    told = [f"model {model.number}"]
    if score is not None:
        told.append(f"rms error {millimetres(score.rms)}")
    if known is not None and known.rms_bound_95 is not None:
        told.append(f"bound {millimetres(known.rms_bound_95)}")
    return ", ".join(told)


def _touches(line: Timeline, arrays: ArrayPacker) -> dict[str, Any]:
    points = [one.points for one in line.touches]
    return {
        "times": [round(one.time, 3) for one in line.touches],
        "ends": np.cumsum([len(one) for one in points], dtype=int).tolist(),
        "points": arrays.places(np.concatenate([np.zeros((0, 3)), *points])),
        "radius": TAXEL_RADIUS,
    }
