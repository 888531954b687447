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

FORMAT_POINTS = "palpate.export_formats"  # Entry points of further formats
UNITS_FILE = "units.json"  # The file beside the tables that says the units of their columns
# Types of messages that are a mesh before anything else.
MESH_TYPES = frozenset(kind.__name__ for kind in (ShapeModel, Truth))
MAX_COLUMNS = 4096  # Of one array: a larger one is written into one cell
Values = NDArray[Any]


def format_of(kind: str) -> ExportFormat:
    """The format of a name: our own, or one of an entry point in `FORMAT_POINTS`.

    Raises InputError if there is no such format.
    """
    if kind in OWN_FORMATS:
        return OWN_FORMATS[kind]
    found = entry_points_of(FORMAT_POINTS)
    if kind not in found:
        known = hint(kind, [*OWN_FORMATS, *found])
        raise InputError(f"--format {kind}: there is no such format; {known}")
    loaded: ExportFormat = found[kind].load()
    return loaded


def export_bag(bag: Path, kind: str, out: Path, topics: Sequence[str] = ()) -> str:
    """Write a recording as a format of `FORMATS`; returns what was written, in a line.

    Tables are written of all topics but meshes, PLY files of meshes alone. Raises InputError if
    the recording is damaged, has other message types than today's, no such topic or none for this
    format, or there is something at `out` already.
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
    """The topics that a format takes, and those of meshes that it leaves to PLY."""
    types = source.recording.types
    meshes = tuple(topic for topic in source.topics if types[topic][0] in MESH_TYPES)
    others = tuple(topic for topic in source.topics if topic not in meshes)
    taken, left, why = {
        "csv": (others, meshes, "are meshes: take --format ply"),
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
    message has one, and all its other fields. An array that has the same shape in all rows takes a
    column for each element, ``pose.0``; one that has not, and a list, is one cell of JSON. Of a
    table each name has its column. Truth is 1 or 0, and nothing is an empty cell.
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
    units = {names[topic]: {"sent_s": "s", **units_of(one.cls)} for topic, one in surveys.items()}
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


def _columns(survey: FieldSurvey, field: str) -> tuple[int, ...] | None:
    """Shape of an array that has a column for each element; None for all else."""
    shape = survey.shapes.get(field)
    if shape is None or math.prod(shape) > MAX_COLUMNS or is_list(survey.cls, field):
        return None
    return shape


def write_npz(source: DecodedRecording, path: Path) -> int:
    """Write a new file that `numpy.load` reads without pickle; returns the number of arrays.

    Arrays are called ``touch_raw.pose``; beside them are ``touch_raw.seq``, and
    ``touch_raw.sent_s`` since the first message of the recording. Where messages differ in length
    they are joined, and ``touch_raw.array.lengths`` says how long each was; where they differ in
    other axes too they are flattened and joined, and ``.shapes`` says their shapes. Of a table each
    name is an array of its own. What is missing is NaN.
    """
    count = 0
    names = file_stems(source.topics)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        for topic, stem in names.items():  # one at a time: only its messages are in memory
            for name, values in _topic_arrays(source, topic).items():
                entry = zipfile.ZipInfo(f"{stem}.{name}.npy")  # without the time of day
                with file.open(entry, "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, values, allow_pickle=False)
                count += 1
    return count


def _topic_arrays(source: DecodedRecording, topic: str) -> dict[str, Values]:
    decoded = list(source.published([topic]))
    survey = FieldSurvey(type(decoded[0].message))
    for one in decoded:
        survey.add(one.message)
    found: dict[str, Values] = {
        "seq": np.array([one.seq for one in decoded], np.int64),
        "sent_s": 1e-9 * np.array([one.sent_ns - source.first_ns for one in decoded], np.float64),
    }
    for field in survey.fields():
        values = [getattr(one.message, field) for one in decoded]
        found |= {field + end: array for end, array in _arrays(survey, field, values).items()}
    return found


def _arrays(survey: FieldSurvey, field: str, values: list[Any]) -> dict[str, Values]:
    """One field of all messages, by what is added to its name."""
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
    """Write a new folder with a mesh for each message, m, world frame; returns their number.

    ``model_shape.12.ply`` is message 12 of its topic; what has no triangles is left out.
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
