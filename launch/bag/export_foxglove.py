"""A recording as an MCAP file in JSON that Foxglove shows."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from palpate import __version__
from palpate.launch.bag.decoded import Source
from palpate.launch.bag.foxglove_schemas import SCHEMAS
from palpate.launch.bag.foxglove_views import View, Views, replaced
from palpate.messages.codec import schema
from palpate.messages.types import SensorInfo


def write_foxglove(source: Source, path: Path) -> int:
    """Write a new file; returns the number of messages.

    Notes
    -----
    Models, the truth and log lines become Foxglove's own messages; contours, patches and the poses
    of fingers have them beside what was recorded. All else is JSON with the schema of our message,
    arrays as lists within lists.
    """
    with path.open("xb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(library=f"palpate {__version__}")
        channels, views, count = _Channels(writer), Views(), 0
        for said in source.said(also=frozenset({SensorInfo.__name__})):
            shown = views.of(said)
            if said.topic not in source.topics:
                continue
            cls = type(said.message)
            if not replaced(cls):
                shown = [View(said.topic, cls.__name__, plain(said.message)), *shown]
            for view in shown:
                data = json.dumps(view.content, allow_nan=False, ensure_ascii=False).encode()
                time = said.sent_ns
                writer.add_message(channels.of(view, cls), time, data, time, said.seq)
            count += len(shown)
        writer.finish()  # type: ignore[no-untyped-call]
    return count


class _Channels:
    """Channels and schemas that the file has already."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}

    def of(self, view: View, cls: type) -> int:
        """Channel of a view of a message of type `cls`."""
        key = (view.topic, view.schema)
        if key not in self._channels:
            if view.schema not in self._schemas:
                described = SCHEMAS.get(view.schema) or plain_schema(cls)
                text = json.dumps(described).encode()
                self._schemas[view.schema] = self._writer.register_schema(
                    view.schema, "jsonschema", text
                )
            schema_id = self._schemas[view.schema]
            self._channels[key] = self._writer.register_channel(view.topic, "json", schema_id)
        return self._channels[key]


def plain(message: Any) -> dict[str, Any]:
    """A message as JSON has it, its arrays as lists within lists."""
    found = {field.name: getattr(message, field.name) for field in dataclasses.fields(message)}
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in found.items()
    }


def plain_schema(cls: type) -> dict[str, Any]:
    """JSON schema of a message as `plain` gives it."""
    described = schema(cls)
    fields = {name: _plain_field(one) for name, one in described["properties"].items()}
    return {**described, "properties": fields}


def _plain_field(described: dict[str, Any]) -> dict[str, Any]:
    """Schema of a field, whose arrays are lists and no longer bytes."""
    if "dtype" not in described:
        return described
    kind = np.dtype(described["dtype"]).kind
    items: dict[str, Any] = {"type": {"f": "number", "b": "boolean"}.get(kind, "integer")}
    for length in reversed(described["shape"]):
        items = {"type": "array", "items": items}
        if length is not None:
            items |= {"minItems": length, "maxItems": length}
    return {**items, "unit": described["unit"]}
