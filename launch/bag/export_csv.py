"""A recording as tables: one CSV file a topic, one row a message."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from palpate.launch.bag.decoded import Said, Source, stems
from palpate.launch.bag.survey import Survey, is_list, units_of

UNITS = "units.json"
"""The file beside the tables that says the units of their columns."""
MOST_COLUMNS = 4096
"""Of one array: a larger one is written into one cell."""


def write_csv(source: Source, folder: Path) -> tuple[str, ...]:
    """Write a new folder with a table for each topic; returns the names of the files.

    Notes
    -----
    A row has ``seq``, ``sent_s`` (since the first message of the recording), ``robot_time`` if the
    message has one, and all its other fields. An array that has the same shape in all rows takes a
    column for each element, ``pose.0``; one that has not, and a list, is one cell of JSON. Of a
    table each name has its column. Truth is 1 or 0, and nothing is an empty cell.
    """
    surveys: dict[str, Survey] = {}
    for said in source.said():
        surveys.setdefault(said.topic, Survey(type(said.message))).add(said.message)
    surveys = dict(sorted(surveys.items()))
    names = {topic: f"{stem}.csv" for topic, stem in stems(surveys).items()}
    folder.mkdir()
    with ExitStack() as files:
        tables = {}
        for topic, survey in surveys.items():
            path = folder / names[topic]
            file = files.enter_context(path.open("w", encoding="utf-8", newline=""))
            tables[topic] = csv.writer(file, lineterminator="\n")
            tables[topic].writerow(["seq", "sent_s", *_head(survey)])
        for said in source.said():
            row = [said.seq, _seconds(said, source.first_ns)]
            tables[said.topic].writerow([*row, *_cells(surveys[said.topic], said.message)])
    units = {names[topic]: {"sent_s": "s", **units_of(one.cls)} for topic, one in surveys.items()}
    (folder / UNITS).write_text(json.dumps(units, indent=2) + "\n", encoding="utf-8")
    return (*names.values(), UNITS)


def _seconds(said: Said, first_ns: int) -> str:
    """Seconds since the first message, to the nanosecond."""
    whole, rest = divmod(said.sent_ns - first_ns, 1_000_000_000)
    return f"{whole}.{rest:09}"


def _head(survey: Survey) -> Iterator[str]:
    """Names of the columns, field by field."""
    for field in survey.fields():
        if field in survey.names:
            yield from (f"{field}.{name}" for name in survey.names[field])
        elif (shape := _columns(survey, field)) is not None:
            for place in product(*map(range, shape)):
                yield ".".join([field, *map(str, place)])
        else:
            yield field


def _cells(survey: Survey, message: Any) -> Iterator[object]:
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


def _columns(survey: Survey, field: str) -> tuple[int, ...] | None:
    """Shape of an array that has a column for each element; None for all else."""
    shape = survey.shapes.get(field)
    if shape is None or math.prod(shape) > MOST_COLUMNS or is_list(survey.cls, field):
        return None
    return shape
