"""A recording as an RRD file that the Rerun viewer shows, along the timeline ``robot_time``.

The world has z up. Touched points accumulate, models are coloured by deviation or uncertainty, and
error and bound are curves [mm]. It needs rerun-sdk, an optional dependency: `palpate[rerun]`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.core.arrays import Floats
from palpate.launch.files.source_map import InputError
from palpate.tools.bag.decoding import DecodedRecording
from palpate.tools.bag.export_format import ExportFormat
from palpate.tools.drawables import (
    LAYERS,
    TYPES_DRAWN,
    TYPES_NEEDED,
    Drawable,
    Faces,
    Finger,
    Image,
    Known,
    Lines,
    Mesh,
    Nothing,
    Number,
    Points,
    Text,
    drawables,
    pad_size,
)
from palpate.tools.surfaces import vertex_colours

TIMELINE = "robot_time"
LEVELS = {"debug": "DEBUG", "info": "INFO", "warning": "WARN", "error": "ERROR"}


def write_rerun(source: DecodedRecording, path: Path) -> int:
    """Write a new file; returns the number of messages that are shown.

    Raises InputError if rerun-sdk is not installed.
    """
    try:
        import rerun
        import rerun.blueprint
    except ModuleNotFoundError:
        raise InputError("--format rerun needs rerun-sdk: pip install 'palpate[rerun]'") from None
    stream = rerun.RecordingStream("palpate")
    stream.save(path, default_blueprint=_layout(rerun.blueprint))
    stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    writer, known, shown = RerunWriter(rerun), Known(), 0
    for decoded in source.published(also=TYPES_NEEDED):
        known.take(decoded.message)
        if decoded.topic not in source.topics:
            continue
        drawn = drawables(decoded.message, known)
        for drawable in drawn:
            if drawable.time is not None:
                stream.set_time(TIMELINE, duration=drawable.time)
            entity = f"world/{drawable.path}" if drawable.layer in LAYERS else drawable.path
            stream.log(entity, *writer.archetypes(drawable), static=drawable.time is None)
        shown += bool(drawn)
    stream.disconnect()
    return shown


def _layout(blueprint: Any) -> Any:
    """Views side by side; layers that accumulate show all times up to the current one."""
    past = blueprint.VisibleTimeRange(
        TIMELINE,
        start=blueprint.TimeRangeBoundary.infinite(),
        end=blueprint.TimeRangeBoundary.cursor_relative(),
    )
    accumulating = [name for name, layer in LAYERS.items() if layer.accumulates]
    hidden = [name for name, layer in LAYERS.items() if not layer.shown]
    rebuilt = blueprint.Spatial3DView(
        name="Touched and rebuilt",
        origin="world",
        contents=["$origin/**", *(f"- $origin/{name}" for name in hidden)],
        overrides={f"world/{name}": blueprint.VisibleTimeRanges([past]) for name in accumulating},
    )
    side_views = (
        *(
            blueprint.Spatial3DView(
                name=LAYERS[name].label, origin="world", contents=f"$origin/{name}"
            )
            for name in hidden
        ),
        blueprint.Spatial2DView(name="Compression of the pad", origin="compression"),
        blueprint.TimeSeriesView(name="Error and its bound, mm", origin="error_mm"),
        blueprint.TimeSeriesView(name="Force on the pad, N", origin="force_N"),
        blueprint.TextLogView(name="Log", origin="log"),
    )
    columns = blueprint.Horizontal(rebuilt, blueprint.Vertical(*side_views), column_shares=[2, 1])
    return blueprint.Blueprint(columns, blueprint.TimePanel(timeline=TIMELINE))


@dataclass(frozen=True, slots=True)
class RerunWriter:
    """Turns drawables into archetypes of Rerun."""

    rerun: Any  # the module
    line_width: float = 2.0  # [pixels]

    def archetypes(self, drawable: Drawable) -> tuple[Any, ...]:
        """Archetypes of a drawable."""
        rerun, shape = self.rerun, drawable.shape
        colour = LAYERS[drawable.layer].rgb if drawable.layer in LAYERS else None
        match shape:
            case Mesh():
                return self._mesh(drawable, shape)
            case Points():
                return (rerun.Points3D(shape.points, colors=colour, radii=shape.radius),)
            case Lines():
                width = rerun.Radius.ui_points(self.line_width)
                return (rerun.LineStrips3D(list(shape.strips), colors=colour, radii=width),)
            case Finger():
                return self._finger(shape, colour)
            case Image():
                values = shape.values.astype(np.float32)
                return (rerun.DepthImage(values, meter=1.0, colormap="viridis"),)
            case Number():
                return rerun.Scalars(shape.value), rerun.SeriesLines(colors=shape.rgb)
            case Text():
                return (rerun.TextLog(shape.text, level=LEVELS[shape.level]),)
            case Nothing():
                return (rerun.Clear(recursive=False),)

    def _mesh(self, drawable: Drawable, mesh: Mesh) -> tuple[Any, ...]:
        """A mesh in the colour of its layer, or coloured by a scalar of its vertices."""
        layer, coloured = LAYERS[drawable.layer], vertex_colours(mesh.scalars())
        facts = dict(drawable.facts)
        if coloured is not None:
            facts |= {"coloured_by": coloured.name, "colours_end_m": coloured.top}
        shown = self.rerun.Mesh3D(
            vertex_positions=mesh.vertices,
            triangle_indices=mesh.faces,
            vertex_normals=_vertex_normals(mesh.vertices, mesh.faces),
            vertex_colors=None if coloured is None else coloured.colours,
            albedo_factor=(*layer.rgb, round(255 * layer.opacity)) if coloured is None else None,
        )
        return shown, self.rerun.AnyValues(**facts)

    def _finger(self, finger: Finger, colour: Any) -> tuple[Any, ...]:
        """The pose and, once the sensor is known, the pad as a plate."""
        turn = self.rerun.Quaternion(xyzw=finger.pose[3:])
        placed = self.rerun.Transform3D(translation=finger.pose[:3], rotation=turn)
        if finger.pad is None:
            return (placed,)
        half = 0.5 * np.array(pad_size(finger.pad))
        return placed, self.rerun.Boxes3D(half_sizes=[half], colors=colour)


def _vertex_normals(vertices: Floats, faces: Faces) -> Floats:
    """Unit normals (n, 3) weighted by area, which Rerun needs for shading; 0 without a face."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(vertices)
    np.add.at(total, faces, normals[:, None])
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(lengths > 0.0, lengths, 1.0)


FORMAT = ExportFormat(write_rerun, "messages", TYPES_DRAWN)
