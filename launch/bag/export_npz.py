"""A recording as arrays: one for each field of each topic, messages first."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.launch.bag.decoded import Source, stems
from palpate.launch.bag.survey import Survey
from palpate.messages.codec import schema

Values = NDArray[Any]


def write_npz(source: Source, path: Path) -> int:
    """Write a new file that `numpy.load` reads without pickle; returns the number of arrays.

    Notes
    -----
    Arrays are called ``touch_raw.pose``; beside them are ``touch_raw.seq``, and
    ``touch_raw.sent_s`` since the first message of the recording. Where messages differ in length
    they are joined, and ``touch_raw.array.lengths`` says how long each was; where they differ in
    other axes too they are flattened and joined, and ``.shapes`` says their shapes. Of a table each
    name is an array of its own. What is missing is NaN.
    """
    count = 0
    names = stems(source.topics)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        for topic, stem in names.items():  # one at a time: only its messages are in memory
            for name, values in _topic_arrays(source, topic).items():
                entry = zipfile.ZipInfo(f"{stem}.{name}.npy")  # without the time of day
                with file.open(entry, "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, values, allow_pickle=False)
                count += 1
    return count


def _topic_arrays(source: Source, topic: str) -> dict[str, Values]:
    said = list(source.said([topic]))
    survey = Survey(type(said[0].message))
    for one in said:
        survey.add(one.message)
    found: dict[str, Values] = {
        "seq": np.array([one.seq for one in said], np.int64),
        "sent_s": 1e-9 * np.array([one.sent_ns - source.first_ns for one in said], np.float64),
    }
    for field in survey.fields():
        values = [getattr(one.message, field) for one in said]
        found |= {field + end: array for end, array in _arrays(survey, field, values).items()}
    return found


def _arrays(survey: Survey, field: str, values: list[Any]) -> dict[str, Values]:
    """One field of all messages, by what is added to its name."""
    if field in survey.names:
        return {
            f".{name}": np.array([value.get(name, np.nan) for value in values])
            for name in survey.names[field]
        }
    if field not in survey.shapes:
        missing = [np.nan if value is None else value for value in values]
        return {"": np.array(missing if None in values else values)}
    arrays = [np.asarray(value, _item(survey.cls, field)) for value in values]
    if survey.shapes[field] is not None:
        return {"": np.stack(arrays)}
    if len({array.shape[1:] for array in arrays}) == 1:
        lengths = np.array([len(array) for array in arrays], np.int64)
        return {"": np.concatenate(arrays), ".lengths": lengths}
    shapes = np.array([array.shape for array in arrays], np.int64)
    return {"": np.concatenate([array.ravel() for array in arrays]), ".shapes": shapes}


def _item(cls: type, field: str) -> Any:
    """Type of the elements of an array or a list."""
    described = schema(cls)["properties"][field]
    if "dtype" in described:
        return described["dtype"]
    return np.int64 if described["items"].get("type") == "integer" else np.str_
