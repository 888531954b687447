"""A recording in other formats: CSV (a table a topic), NPZ (an array a field), PLY and viewers'."""

from __future__ import annotations

import csv
import json
import math
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.core.plugins import entry_points_of
from palpate.launch.files.file_access import check_new, write_new
from palpate.launch.files.mesh_file import write_mesh
from palpate.launch.files.source_map import InputError, hint
from palpate.launch.printing import counted
from palpate.messages import schema
from palpate.messages.types import ShapeModel, Truth
from palpate.tools.bag.decoding import (
    DecodedRecording,
    FieldSurvey,
    file_stems,
    is_list,
    open_decoded,
    units_of,
)
from palpate.tools.bag.export_format import ExportFormat

FORMAT_POINTS = "palpate.export_formats"  # entry points of further formats
UNITS_FILE = "units.json"  # beside the tables: units of their columns
# Types of messages whose main content is a mesh.
MESH_TYPES = frozenset(kind.__name__ for kind in (ShapeModel, Truth))
Values = NDArray[Any]


def format_of(kind: str) -> ExportFormat:
    """A format by name: one of `OWN_FORMATS`, or of an entry point in `FORMAT_POINTS`.

    Raises InputError if there is no such format.
    """
    if kind in OWN_FORMATS:
        return OWN_FORMATS[kind]
    points = entry_points_of(FORMAT_POINTS)
    if kind not in points:
        known = hint(kind, [*OWN_FORMATS, *points])
        raise InputError(f"--format {kind}: there is no such format; {known}")
    loaded: ExportFormat = points[kind].load()
    return loaded


def export_bag(bag: Path, kind: str, out: Path, topics: Sequence[str] = ()) -> str:
    """Write a recording in a format; returns a line about what was written.

    Tables have all topics except meshes, PLY files have meshes only. Raises InputError if the
    recording is damaged or has other versions of message types, there is no such topic or none for
    this format, or `out` exists.
    """
    check_new(out)
    source = open_decoded(bag, topics)
    taken, left = _topics_of_format(source, kind)
    write, what, _ = format_of(kind)
    written: list[int] = []
    write_new(out, lambda part: written.append(write(source._replace(topics=taken), part)))
    text = f"{out}: {written[0]} {what} of {counted(len(taken), 'topic')}"
    if not source.recording.closed:
        text += "; the recording was never closed, it may lack its end"
    return text + (f"\nleft to --format ply, as meshes: {', '.join(left)}" if left else "")


def _topics_of_format(
    source: DecodedRecording, kind: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Topics that a format takes, and topics of meshes that it leaves to PLY."""
    types = source.recording.types
    meshes = tuple(topic for topic in source.topics if types[topic][0] in MESH_TYPES)
    without_mesh = tuple(topic for topic in source.topics if topic not in meshes)
    taken, left, why = {
        "csv": (without_mesh, meshes, "are meshes: take --format ply"),
        "ply": (meshes, (), "are no meshes, so there is no ply"),
    }.get(kind, (source.topics, (), ""))
    if shown := format_of(kind).types:
        taken = tuple(topic for topic in source.topics if types[topic][0] in shown)
        why = f"hold nothing that {kind} would show"
    if not taken:
        raise InputError(f"{source.recording.path}: {', '.join(source.topics)} {why}")
    return taken, left


def write_csv(source: DecodedRecording, folder: Path) -> int:
    """Write a new folder with a table for each topic; returns the number of files.

    A row has ``seq``, ``sent_s`` (since the first message of the recording), ``robot_time`` if the
    message has one, and all other fields. An array of the same shape in all rows has a column for
    each element, ``pose.0``; another array, or a list, is one cell of JSON. A table has a column
    for each name. Booleans are 1 or 0, and None is an empty cell.
    """
    surveys: dict[str, FieldSurvey] = {}
    for decoded in source.published():
        surveys.setdefault(decoded.topic, FieldSurvey(type(decoded.message))).add(decoded.message)
    surveys = dict(sorted(surveys.items()))
    names = {topic: f"{stem}.csv" for topic, stem in file_stems(surveys).items()}
    folder.mkdir()
    with ExitStack() as files:
        tables = {}
        for topic, survey in surveys.items():
            path = folder / names[topic]
            file = files.enter_context(path.open("w", encoding="utf-8", newline=""))
            tables[topic] = csv.writer(file, lineterminator="\n")
            tables[topic].writerow(["seq", "sent_s", *_head(survey)])
        for decoded in source.published():
            whole, rest = divmod(decoded.sent_ns - source.first_ns, 1_000_000_000)
            cells = _cells(surveys[decoded.topic], decoded.message)
            tables[decoded.topic].writerow([decoded.seq, f"{whole}.{rest:09}", *cells])
    units = {
        names[topic]: {"sent_s": "s", **units_of(survey.cls)} for topic, survey in surveys.items()
    }
    (folder / UNITS_FILE).write_text(json.dumps(units, indent=2) + "\n", encoding="utf-8")
    return len(names) + 1


def _head(survey: FieldSurvey) -> Iterator[str]:
    """Names of the columns, field by field."""
    for field in survey.fields():
        if field in survey.names:
            yield from (f"{field}.{name}" for name in survey.names[field])
        elif (shape := _columns(survey, field)) is not None:
            for place in product(*map(range, shape)):
                yield ".".join([field, *map(str, place)])
        else:
            yield field


def _cells(survey: FieldSurvey, message: Any) -> Iterator[object]:
    """Values of one row, in the order of `_head`."""
    for field in survey.fields():
        value = getattr(message, field)
        if isinstance(value, dict):
            yield from (value.get(name, "") for name in survey.names[field])
        elif isinstance(value, tuple):
            yield json.dumps(value, ensure_ascii=False)
        elif not isinstance(value, np.ndarray):
            yield int(value) if isinstance(value, bool) else value
        elif _columns(survey, field) is None:
            yield json.dumps(value.tolist())
        else:
            yield from (value.astype(np.int8) if value.dtype == bool else value).ravel().tolist()


def _columns(survey: FieldSurvey, field: str, max_columns: int = 4096) -> tuple[int, ...] | None:
    """Shape of an array with a column for each element; None for other fields."""
    shape = survey.shapes.get(field)
    if shape is None or math.prod(shape) > max_columns or is_list(survey.cls, field):
        return None
    return shape


def write_npz(source: DecodedRecording, path: Path) -> int:
    """Write a new file that `numpy.load` reads without pickle; returns the number of arrays.

    Arrays are named ``touch_raw.pose``; beside them are ``touch_raw.seq``, and
    ``touch_raw.sent_s`` since the first message of the recording. Arrays of different lengths are
    concatenated, with their lengths in ``touch_raw.array.lengths``; those that differ in other axes
    are flattened first, with their shapes in ``.shapes``. A table has an array for each name.
    Missing numbers are NaN.
    """
    count = 0
    names = file_stems(source.topics)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        for topic, stem in names.items():  # only the messages of one topic are in memory at once
            for name, values in _topic_arrays(source, topic).items():
                entry = zipfile.ZipInfo(
                    f"{stem}.{name}.npy"
                )  # without a time, so that files are reproducible
                with file.open(entry, "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, values, allow_pickle=False)
                count += 1
    return count


def _topic_arrays(source: DecodedRecording, topic: str) -> dict[str, Values]:
    decoded = list(source.published([topic]))
    survey = FieldSurvey(type(decoded[0].message))
    for row in decoded:
        survey.add(row.message)
    arrays: dict[str, Values] = {
        "seq": np.array([row.seq for row in decoded], np.int64),
        "sent_s": 1e-9 * np.array([row.sent_ns - source.first_ns for row in decoded], np.float64),
    }
    for field in survey.fields():
        values = [getattr(row.message, field) for row in decoded]
        arrays |= {field + end: array for end, array in _arrays(survey, field, values).items()}
    return arrays


def _arrays(survey: FieldSurvey, field: str, values: list[Any]) -> dict[str, Values]:
    """Arrays of one field of all messages, by the suffix of their names."""
    if field in survey.names:
        return {
            f".{name}": np.array([value.get(name, np.nan) for value in values])
            for name in survey.names[field]
        }
    if field not in survey.shapes:
        missing = [np.nan if value is None else value for value in values]
        return {"": np.array(missing if None in values else values)}
    described = schema(survey.cls)["properties"][field]
    kind = described.get("dtype")  # of the elements of an array, or else of a list
    if kind is None:
        kind = np.int64 if described["items"].get("type") == "integer" else np.str_
    arrays = [np.asarray(value, kind) for value in values]
    if survey.shapes[field] is not None:
        return {"": np.stack(arrays)}
    if len({array.shape[1:] for array in arrays}) == 1:
        lengths = np.array([len(array) for array in arrays], np.int64)
        return {"": np.concatenate(arrays), ".lengths": lengths}
    shapes = np.array([array.shape for array in arrays], np.int64)
    return {"": np.concatenate([array.ravel() for array in arrays]), ".shapes": shapes}


def write_ply(source: DecodedRecording, folder: Path) -> int:
    """Write a new folder with a mesh for each message, world frame [m]; returns their number.

    ``model_shape.12.ply`` is message 12 of its topic; a mesh without triangles is left out.
    """
    folder.mkdir()
    names, count = file_stems(source.topics), 0
    for decoded in source.published():
        if len(decoded.message.faces):
            path = folder / f"{names[decoded.topic]}.{decoded.seq}.ply"
            write_mesh(path, decoded.message.vertices, decoded.message.faces)
            count += 1
    return count


OWN_FORMATS = {
    "csv": ExportFormat(write_csv, "files"),
    "ply": ExportFormat(write_ply, "meshes"),
    "npz": ExportFormat(write_npz, "arrays"),
}
