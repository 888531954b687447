"""Writes messages into an MCAP file, undecoded.

Messages are in chunks, each of which is compressed and has a checksum. A chunk has at most 20 ms of
traffic, so that a recorder that is killed loses no more. Each write is complete or undone: a
partial write on a full disk would leave a hole that no reader can cross.
"""

from __future__ import annotations

import errno
import json
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, cast

import lz4.frame
from mcap.writer import CompressionType, Writer

from palpate.messages.codec import Header, schema
from palpate.messages.fields import MAX_MESSAGE_BYTES
from palpate.messages.recording.mcap_reading import (
    MAX_DECLARED_BYTES,
    SMALL_CHUNK_BYTES,
    max_chunk_bytes,
)
from palpate.messages.types import TYPES

PROFILE = "palpate"  # in the header of the file
# Names of metadata records: version and graph at the beginning, then at the end the numbers of
# messages and of missing messages by topic.
ABOUT = "palpate"
COUNTS = "counts"
MISSING = "missing"
OUTSIDE = "outside"  # in the metadata of a channel with messages that tools requested


class ChunkWriter(Writer):
    """Writes the records of a recording, packed by lz4, with checksums of each chunk and of all.

    A message that lz4 packs more densely than a reader accepts is stored unpacked, in its own
    chunk. Other chunks have at least `chunk_size` [bytes].
    """

    def __init__(self, file: AtomicFile, chunk_size: int = 1 << 16) -> None:
        self._min_chunk_size = chunk_size
        super().__init__(
            cast(IO[bytes], file),
            chunk_size=chunk_size,
            compression=CompressionType.LZ4,
            enable_data_crcs=True,
        )

    def add_message(
        self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0
    ) -> None:
        """Write a message; ValueError if it exceeds `MAX_MESSAGE_BYTES`."""
        if len(data) > MAX_MESSAGE_BYTES:
            raise ValueError(
                f"a message of {len(data)} bytes cannot be recorded; at most {MAX_MESSAGE_BYTES} "
                "are allowed"
            )
        message = channel_id, log_time, data, publish_time, sequence
        if _is_readable_packed(data, self._min_chunk_size):
            super().add_message(*message)
            return
        self.flush()  # type: ignore[no-untyped-call]
        # The library has no other way to choose the packing of one chunk.
        vars(self)["_Writer__compression"] = CompressionType.NONE
        try:
            super().add_message(*message)  # ends its chunk, since it is larger than `chunk_size`
        finally:
            vars(self)["_Writer__compression"] = CompressionType.LZ4


def _is_readable_packed(data: bytes, chunk_size: int) -> bool:
    """Whether a reader accepts the packed chunk of a message."""
    before = chunk_size + MAX_DECLARED_BYTES  # of other records in the chunk
    if len(data) + before <= SMALL_CHUNK_BYTES:
        return True
    return len(data) + before <= max_chunk_bytes(len(lz4.frame.compress(data)))


class RecordingWriter:
    """A recording that is being written.

    The log time of a message is its send time, or the log time of the message before it if that is
    later: it increases in the order of arrival. A chunk has at most `flush_ns` of traffic.

    Raises ValueError if a type is unknown; OSError if the file exists or cannot be written.
    """

    def __init__(
        self,
        path: Path,  # of the file, which must not exist
        types: Mapping[str, str],  # names of message types by topic
        publishers: Mapping[str, str],  # known publishers by topic
        about: Mapping[str, str],  # description of the run: ``version``, ``graph`` and others
        spare: int = 0,  # that stay free on the disk, before the recording is closed [bytes]
        schemas: Mapping[str, str] | None = None,  # JSON schemas of types that are not palpate's
        flush_ns: int = 20_000_000,
    ) -> None:
        self._texts = dict(schemas or {})
        known = TYPES.keys() | self._texts.keys()
        unknown = sorted(f"{topic} as {name}" for topic, name in types.items() if name not in known)
        if unknown:
            raise ValueError(f"no message type to record {unknown[0]}; known are {sorted(known)}")
        self._path, self._types, self._publishers = path, types, publishers
        self._spare, self._flush_ns = spare, flush_ns
        self._file = AtomicFile(path)
        self._writer: ChunkWriter | None = ChunkWriter(self._file)
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, int, int, int, bool], int] = {}
        self._counts: Counter[str] = Counter()
        self._logged = self._flushed = 0
        with self._stopping():
            self._writer.start(profile=PROFILE, library=f"palpate {about.get('version', '')}")
            self._writer.add_metadata(ABOUT, dict(about))

    def write(self, topic: str, header: Header, body: bytes) -> None:
        """Write a message.

        Raises ValueError if the topic was not declared, or the recording is closed; OSError if it
        cannot be written; what was written before stays readable, and nothing more is written.
        """
        writer = self._open_writer()
        channel = self._channel(writer, topic, header)
        self._logged = max(self._logged, header.sent_ns)
        with self._stopping():
            writer.add_message(channel, self._logged, body, header.sent_ns, header.seq)
            self._counts[topic] += 1
            if self._logged - self._flushed >= self._flush_ns:
                self._flush(writer)

    def flush(self) -> None:
        """Write the current chunk. Raises OSError as `write` does."""
        with self._stopping():
            self._flush(self._open_writer())

    def close(self, missing: Mapping[str, int] | None = None) -> None:
        """Write the current chunk, the counts of messages and missing messages, and the index.

        Raises OSError if it cannot be written; what was written before stays readable.
        """
        if self._writer is None:
            return
        try:
            with self._stopping():
                self._writer.flush()  # type: ignore[no-untyped-call]
                for name, numbers in ((COUNTS, self._counts), (MISSING, missing or {})):
                    texts = {topic: str(numbers.get(topic, 0)) for topic in sorted(self._types)}
                    self._writer.add_metadata(name, texts)
                self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._give_up()

    def _flush(self, writer: ChunkWriter) -> None:
        writer.flush()  # type: ignore[no-untyped-call]
        self._flushed = self._logged
        left = free_bytes(self._path.parent)
        if left < self._spare:
            self.close()
            raise OSError(
                errno.ENOSPC,
                f"only {left >> 20} MiB are free on the disk, {self._spare >> 20} are to stay so",
            )

    def _open_writer(self) -> ChunkWriter:
        if self._writer is None:
            raise ValueError(f"recording {self._path} is closed")
        return self._writer

    def _channel(self, writer: ChunkWriter, topic: str, header: Header) -> int:
        """Channel of a topic; it changes with restarts of its publisher and for tools."""
        key = (topic, header.run, header.epoch, header.schema, header.outside)
        if key not in self._channels:
            if topic not in self._types:
                raise ValueError(f"{topic} is not among the topics to record: {list(self._types)}")
            about = {
                "publisher": self._publishers.get(topic, ""),
                "run": f"{header.run:016x}",
                "epoch": str(header.epoch),
                "schema_hash": f"{header.schema:08x}",
                **({OUTSIDE: "true"} if header.outside else {}),
            }
            schema_id = self._schema(writer, self._types[topic])
            self._channels[key] = writer.register_channel(topic, "msgpack", schema_id, about)
        return self._channels[key]

    def _schema(self, writer: ChunkWriter, name: str) -> int:
        if name not in self._schemas:
            text = (self._texts.get(name) or json.dumps(schema(TYPES[name]))).encode()
            self._schemas[name] = writer.register_schema(name, "jsonschema", text)
        return self._schemas[name]

    def _give_up(self) -> None:
        self._writer = None
        self._file.close()

    @contextmanager
    def _stopping(self) -> Iterator[None]:
        """Close the file if it cannot be written, and raise OSError."""
        try:
            yield
        except OSError as error:
            self._give_up()
            raise OSError(
                error.errno,
                f"recording stopped, {self._path} cannot be written: {error.strerror}; "
                f"what it held before stays readable",
            ) from error


class AtomicFile:
    """A new file without a buffer, in which each write is complete or undone.

    Raises FileExistsError if the file exists; OSError if it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._raw = path.open("xb", buffering=0)
        except FileExistsError as error:
            text = f"recording {path} exists already; it is not overwritten"
            raise FileExistsError(error.errno, text) from None
        except OSError as error:
            text = f"recording {path} cannot be made: {error.strerror}"
            raise OSError(error.errno, text) from None
        self._end = 0

    def write(self, data: bytes) -> int:
        """Write all of `data`; on an OSError the file is as it was before."""
        left = memoryview(data)
        try:
            while left:
                left = left[self._raw.write(left) :]
        except OSError:
            self._raw.seek(self._end)
            self._raw.truncate()
            raise
        self._end += len(data)
        return len(data)

    def tell(self) -> int:
        """Bytes written so far."""
        return self._end

    def flush(self) -> None:
        """Do nothing: there is no buffer."""

    def close(self) -> None:
        """Close the file."""
        self._raw.close()


def free_bytes(folder: Path) -> int:
    """Free space for this user on the disk of a folder [bytes]."""
    disk = os.statvfs(folder)
    return disk.f_bavail * disk.f_frsize
