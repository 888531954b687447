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
from palpate.launch.colours import COLOURS
from palpate.launch.printing import millimetres
from palpate.messages.types import Contour, ShapeModel
from palpate.tools.report.run_facts import UNTOUCHED, Place
from palpate.tools.surfaces import hex_colour, scale_top, vertex_scalars
from palpate.tools.view.timeline import TRACED, Timeline

STEPS = 65535  # Of the box about everything
SHADES = 255  # Of a scale
MOST_MODELS = 14  # On the way that can be shown, spread evenly over those that there are
MOST_FACES, LEAST_MODELS = 80_000, 3  # Of them together, but so many are shown whatever their size
DEVIATION, UNCERTAINTY, PLAIN = "deviation", "uncertainty", "plain"  # What colours may tell
KINDS = {np.dtype("u1"): "u1", np.dtype("<u2"): "u2", np.dtype("<u4"): "u4"}
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


def view_data(line: Timeline, places: Sequence[Place]) -> ViewData:
    """Pack what a timeline holds."""
    low, high = line.bounds()
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    # With room about it: touches may lie outside.
    arrays = ArrayPacker(middle - 0.6 * size, 1.2 * size / STEPS)
    models = _shown(line.models)
    scalars = [vertex_scalars(model, line.surface) for model in models]
    tops = {name: scale_top(some) for name, some in (scalars[-1] if scalars else {}).items()}
    told: dict[str, Any] = {
        "low": arrays.low.tolist(),
        "step": arrays.step,
        "middle": middle.tolist(),
        "size": size,
        "end": math.ceil(1e3 * line.end) / 1e3,
        "colourings": [PLAIN, *tops],
        "colours": COLOURS,
        "shades": [hex_colour(SHADES - shade, SHADES) for shade in range(SHADES + 1)],
        "models": [
            {
                "time": model.robot_time,
                "told": _told(line, model),
                **arrays.surface(model.vertices, model.faces),
                "values": {
                    name: arrays.shades(some[name], tops[name]) for name in tops if name in some
                },
            }
            for model, some in zip(models, scalars, strict=True)
        ],
        # Coarser than what errors are measured from: it is there to be seen.
        "truth": line.truth and arrays.surface(line.truth.floor_vertices, line.truth.floor_faces),
        "contours": [_contour(one, arrays) for one in line.contours],
        "touches": _touches(line, arrays),
        "places": [
            {"time": one.time, "point": one.point.tolist(), "untouched": one.kind == UNTOUCHED}
            for one in places
        ],
    }
    return ViewData(json.dumps(told, allow_nan=False), arrays.text(), tops)


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


def _contour(one: Contour, arrays: ArrayPacker) -> dict[str, Any]:
    return {
        "time": one.robot_time,
        "points": arrays.places(one.points),
        "closed": one.status == "closed",
        "traced": one.status in TRACED,
    }


def _touches(line: Timeline, arrays: ArrayPacker) -> dict[str, Any]:
    points = [one.points for one in line.touches]
    return {
        "times": [round(one.time, 3) for one in line.touches],
        "ends": np.cumsum([len(one) for one in points], dtype=int).tolist(),
        "points": arrays.places(np.concatenate([np.zeros((0, 3)), *points])),
    }
