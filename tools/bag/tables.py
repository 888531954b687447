"""The topics of a recording as numpy structured arrays, and as pandas frames, for notebooks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.launch.files.source_map import InputError, hint
from palpate.tools.bag.decoding import (
    DecodedMessage,
    DecodedRecording,
    FieldSurvey,
    open_decoded,
    units_of,
)

if TYPE_CHECKING:
    import pandas as pd


def open_recording(path: str | Path) -> RecordedTables:
    """A recording as tables: ``open_recording("runs/latest")["/touch/patch"]["k1"]``.

    `path`: a ``topics.mcap``, or the folder of a run. Types of a user need not be importable.
    Raises InputError if there is no such recording, or it is damaged.
    """
    return RecordedTables(open_decoded(Path(path)))


class Table(np.ndarray[Any, np.dtype[np.void]]):
    """The structured array of a topic, or one of its columns, with a repr of a few lines."""

    def __repr__(self) -> str:
        plain = self.view(np.ndarray)
        if self.dtype.names and self.ndim:
            return f"<table of {len(self)} messages: {_abridged(', '.join(self.dtype.names))}>"
        if self.dtype.names or self.ndim > 1 or self.dtype.hasobject:
            return f"<{'row' if self.dtype.names else self.dtype} {self.shape}>"
        with np.printoptions(threshold=20, edgeitems=3):
            return repr(plain)


@dataclass(frozen=True, slots=True)
class RecordedTables(Mapping[str, NDArray[np.void]]):
    """The topics of a recording by name; each is read at its first use.

    A table has a row for each message: ``seq``, ``sent_s`` since the first message of the
    recording, and the fields of the message in the units of `units`. Arrays of one shape in all
    messages are subarrays; other arrays, lists and tables are objects. Missing numbers are NaN.
    """

    source: DecodedRecording
    _read: dict[str, NDArray[np.void]] = field(default_factory=dict, repr=False)

    def __getitem__(self, topic: str) -> NDArray[np.void]:
        if topic not in self.source.topics:
            raise InputError(
                f"{self.source.recording.path}: has no topic {topic!r}; "
                f"{hint(topic, self.source.topics)}"
            )
        if topic not in self._read:
            table = _table(list(self.source.published([topic])), self.source.first_ns)
            self._read[topic] = table.view(Table)
        return self._read[topic]

    def __iter__(self) -> Iterator[str]:
        return iter(self.source.topics)

    def __len__(self) -> int:
        return len(self.source.topics)

    def __contains__(self, topic: object) -> bool:
        return topic in self.source.topics

    def __repr__(self) -> str:
        counts = self.source.recording.counts
        topics = _abridged(", ".join(f"{topic} {counts[topic]}" for topic in self))
        return f"<recording {self.source.recording.path}: {topics}>"

    def units(self, topic: str) -> dict[str, str]:
        """Units of the fields of a topic, by name; fields without a unit are left out."""
        cls = self.source.recording.type_of(topic)
        return {"sent_s": "s", **units_of(cls)}

    def frame(self, topic: str) -> pd.DataFrame:
        """A topic as a pandas frame; elements of arrays of one shape become columns, ``pose.0``.

        Raises InputError if pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise InputError("frames need pandas: pip install pandas") from None
        columns: dict[str, Any] = {}
        table = self[topic]
        for name in table.dtype.names or ():
            values = table[name]
            if values.ndim == 1:
                columns[name] = values
            for index in np.ndindex(values.shape[1:] if values.ndim > 1 else (0,)):
                columns[".".join([name, *map(str, index)])] = values[(slice(None), *index)]
        return pd.DataFrame(columns)


def _abridged(text: str, max_letters: int = 600) -> str:
    """A text for a repr, cut off if it is long."""
    return text if len(text) <= max_letters else f"{text[:max_letters]}..."


def _table(messages: list[DecodedMessage], first_ns: int) -> NDArray[np.void]:
    survey = FieldSurvey(type(messages[0].message))
    for row in messages:
        survey.add(row.message)
    columns = {
        "seq": np.array([row.seq for row in messages], np.int64),
        "sent_s": 1e-9 * np.array([row.sent_ns - first_ns for row in messages], np.float64),
    }
    for name in survey.fields():
        columns[name] = _column([getattr(row.message, name) for row in messages], survey, name)
    kinds = [(name, column.dtype, column.shape[1:]) for name, column in columns.items()]
    table = np.zeros(len(messages), kinds)
    for name, column in columns.items():
        table[name] = column
    return table


def _column(values: list[Any], survey: FieldSurvey, name: str) -> NDArray[Any]:
    """One field of all messages, (n, ...)."""
    if isinstance(values[0], np.ndarray) and survey.shapes[name] is not None:
        return np.stack(values)
    if all(isinstance(value, bool | int | float | str) for value in values):
        return np.array(values)
    if all(value is None or isinstance(value, bool | int | float) for value in values):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    column = np.empty(len(values), object)
    column[:] = values
    return column
