"""A recording as an RRD file that the Rerun viewer shows, along the timeline ``robot_time``.

The world has z up; touched points stay, models are coloured by how good they are, and error and
bound are curves in mm. It needs rerun-sdk, which palpate does not bring along: `palpate[rerun]`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.poses import transform_points
from palpate.launch.colours import rgb
from palpate.launch.files.source_map import InputError
from palpate.messages import types
from palpate.nodes.specs.sensors import pad_of_info
from palpate.tools.bag.decoding import DecodedRecording
from palpate.tools.bag.export_format import ExportFormat
from palpate.tools.surfaces import Colours, TruthSurface, vertex_colours, vertex_scalars

TIMELINE = "robot_time"
LEVELS = {"debug": "DEBUG", "info": "INFO", "warning": "WARN", "error": "ERROR"}
POINT_PIXELS, LINE_PIXELS = 1.5, 2.0
MILLIMETRES_PER_METRE = 1000.0
# Where a message is shown, and as what, an archetype of Rerun or several.
Shown = Iterator[tuple[str, tuple[Any, ...]]]


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
    converter, shown = RerunConverter(rerun), 0
    for decoded in source.published(also=ALSO_READ):
        message = decoded.message
        found = list(DRAWN[type(message)](converter, message))
        if decoded.topic not in source.topics:
            continue
        time = getattr(message, "robot_time", None)
        if time is not None:
            stream.set_time(TIMELINE, duration=time)
        for entity, archetypes in found:
            stream.log(entity, *archetypes, static=time is None)
        shown += bool(found)
    stream.disconnect()
    return shown


def _layout(blueprint: Any) -> Any:
    """Views side by side; all that was touched before stays, as its entity is logged anew."""
    past = blueprint.VisibleTimeRange(
        TIMELINE,
        start=blueprint.TimeRangeBoundary.infinite(),
        end=blueprint.TimeRangeBoundary.cursor_relative(),
    )
    rebuilt = blueprint.Spatial3DView(
        name="Touched and rebuilt",
        origin="world",
        contents=["$origin/**", "- $origin/truth"],
        overrides={"world/touched": blueprint.VisibleTimeRanges([past])},
    )
    beside = (
        blueprint.Spatial3DView(name="Truth", origin="world", contents="$origin/truth"),
        blueprint.Spatial2DView(name="Compression of the pad", origin="tactile"),
        blueprint.TimeSeriesView(name="Error and its bound, mm", origin="error_mm"),
        blueprint.TextLogView(name="Log", origin="log"),
    )
    columns = blueprint.Horizontal(rebuilt, blueprint.Vertical(*beside), column_shares=[2, 1])
    return blueprint.Blueprint(columns, blueprint.TimePanel(timeline=TIMELINE))


class RerunConverter:
    """Turns messages into what Rerun shows; remembers the sensor, the truth, and contours."""

    def __init__(self, rerun: Any) -> None:
        self._rerun = rerun
        self._sensor: types.SensorInfo | None = None
        self._truth: TruthSurface | None = None

    def sensor(self, info: types.SensorInfo) -> Shown:
        """Nothing: the sensor is remembered."""
        self._sensor = info
        return iter(())

    def finger(self, frame: types.TactileFrame) -> Shown:
        """The pad as a plate, in its pose."""
        place, turn = frame.pose[:3], self._rerun.Quaternion(xyzw=frame.pose[3:])
        shown = [self._rerun.Transform3D(translation=place, rotation=turn)]
        if self._sensor is not None:
            one = self._sensor
            half = np.array([one.cols * one.pitch, one.rows * one.pitch, one.thickness]) / 2.0
            shown.append(self._rerun.Boxes3D(half_sizes=[half]))
        yield f"world/finger_{frame.finger}", tuple(shown)

    def image(self, image: types.TactileImage) -> Shown:
        """Compression under each taxel, m."""
        values = np.where(image.mask, image.compression, 0.0).astype(np.float32)
        shown = self._rerun.DepthImage(values, meter=1.0, colormap="viridis")
        yield f"tactile/finger_{image.finger}", (shown,)

    def patch(self, patch: types.SurfacePatch) -> Shown:
        """Touched taxels in the world."""
        if self._sensor is None or patch.mask.shape != (self._sensor.rows, self._sensor.cols):
            return
        x, y = pad_of_info(self._sensor).grid()
        cells = np.column_stack([x[patch.mask], y[patch.mask], patch.height[patch.mask]])
        points = self._rerun.Points3D(
            transform_points(patch.pose, cells),
            colors=rgb("touch"),
            radii=self._rerun.Radius.ui_points(POINT_PIXELS),
        )
        yield "world/touched", (points,)

    def contour(self, contour: types.Contour) -> Shown:
        """A contour as a line."""
        points = contour.points
        if contour.status == "closed":
            points = np.concatenate([points, points[:1]])
        strip = self._rerun.LineStrips3D(
            [points],
            colors=rgb("contour"),
            radii=self._rerun.Radius.ui_points(LINE_PIXELS),
        )
        yield f"world/contours/{contour.id}", (strip,)

    def model(self, model: types.ShapeModel) -> Shown:
        """A model by its deviation from the truth, or else by its own uncertainty."""
        if not len(model.faces):
            yield "world/model", (self._rerun.Clear(recursive=False),)
            return
        shown = vertex_colours(vertex_scalars(model, self._truth))
        if shown is None:
            yield "world/model", (self._mesh(model.vertices, model.faces, None),)
            return
        told = self._rerun.AnyValues(coloured_by=shown.name, colours_end_m=shown.top)
        yield "world/model", (self._mesh(model.vertices, model.faces, shown.colours), told)

    def truth(self, truth: types.Truth) -> Shown:
        """The true surface, which is remembered."""
        self._truth = TruthSurface(truth)
        grey = np.full((len(truth.vertices), 3), rgb("truth"), np.uint8)
        yield "world/truth", (self._mesh(truth.vertices, truth.faces, grey),)

    def _mesh(self, vertices: Floats, faces: NDArray[np.int32], colours: Colours | None) -> Any:
        return self._rerun.Mesh3D(
            vertex_positions=vertices,
            triangle_indices=faces,
            vertex_normals=_vertex_normals(vertices, faces),
            vertex_colors=colours,
        )

    def score(self, score: types.Score) -> Shown:
        """The true error."""
        yield "error_mm/rms", (self._rerun.Scalars(MILLIMETRES_PER_METRE * score.rms),)

    def estimate(self, told: types.PlanEstimate) -> Shown:
        """Its bound, where one is stated."""
        if told.rms_bound_95 is not None:
            bound = MILLIMETRES_PER_METRE * told.rms_bound_95
            yield "error_mm/bound_95", (self._rerun.Scalars(bound),)

    def log(self, record: types.LogRecord) -> Shown:
        """A line of the log."""
        line = self._rerun.TextLog(record.text, level=LEVELS[record.level])
        yield f"log/{record.node}", (line,)


def _vertex_normals(vertices: Floats, faces: NDArray[np.int32]) -> Floats:
    """Unit normals (n, 3), by area, without which Rerun does not shade; 0 where there is none."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(vertices)
    np.add.at(total, faces, normals[:, None])
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(lengths > 0.0, lengths, 1.0)


DRAWN: Mapping[type, Callable[[RerunConverter, Any], Shown]] = {
    types.SensorInfo: RerunConverter.sensor,
    types.TactileFrame: RerunConverter.finger,
    types.TactileImage: RerunConverter.image,
    types.SurfacePatch: RerunConverter.patch,
    types.Contour: RerunConverter.contour,
    types.ShapeModel: RerunConverter.model,
    types.Truth: RerunConverter.truth,
    types.Score: RerunConverter.score,
    types.PlanEstimate: RerunConverter.estimate,
    types.LogRecord: RerunConverter.log,
}
DRAWN_TYPES = frozenset(kind.__name__ for kind in DRAWN)
# Types that are read though their topics are not wanted: others are drawn by what they say.
ALSO_READ = frozenset(kind.__name__ for kind in (types.SensorInfo, types.Truth))

FORMAT = ExportFormat(write_rerun, "messages", DRAWN_TYPES)
