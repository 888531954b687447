"""A new recording out of the records of another one, undecoded."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel, Message, Metadata, Schema

from palpate.messages.recording.reader import LocatedRecord, open_recording
from palpate.messages.recording.writer import COUNTS, PROFILE, AtomicFile, mcap_writer


class RecordingCopy:
    """A recording that is being copied, its parts into one file.

    Raises OSError if the file exists or cannot be written.
    """

    def __init__(
        self,
        path: Path,  # The new file; it must not exist
        library: str,  # What writes it
    ) -> None:
        self.counts: Counter[str] = Counter()  # Messages by topic, as far as taken
        self._path, self._file = path, AtomicFile(path)
        self._writer = mcap_writer(self._file)
        try:
            self._writer.start(profile=PROFILE, library=library)
        except OSError:
            self._file.close()
            raise
        self._schemas: dict[tuple[Path, int], int] = {}
        self._channels: dict[tuple[Path, int], tuple[str, int]] = {}
        self._registered: dict[object, int] = {}
        self._declared: set[str] = set()
        self._told: set[object] = set()
        self._logged = 0
        self._digest = hashlib.sha256()

    def take(self, found: Iterable[LocatedRecord]) -> None:
        """Write records in their order; how many messages of each topic, is written at the end."""
        for part, _, record in found:
            match record:
                case Schema():
                    self._schemas[part, record.id] = self._schema(record)
                case Channel():
                    schema_id = self._schemas[part, record.schema_id]
                    self._channels[part, record.id] = record.topic, self._channel(record, schema_id)
                case Message():
                    self._message(record, *self._channels[part, record.channel_id])
                case Metadata(name=name) if name == COUNTS:
                    self._declared |= record.metadata.keys()
                case Metadata():
                    self._metadata(record)

    def close(self, name: str, about: Mapping[str, str]) -> None:
        """Write the counts, what there is to say about the copy, and the index."""
        counts = {topic: str(self.counts[topic]) for topic in self._declared | self.counts.keys()}
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._writer.add_metadata(COUNTS, dict(sorted(counts.items())))
        self._writer.add_metadata(name, dict(about))
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def give_up(self) -> None:
        """Close the file as it is."""
        self._file.close()

    def check(self) -> None:
        """Read the closed copy again, by our own reader and by that of the MCAP project.

        Raises ValueError if one of them does not find exactly the messages that were taken.
        """
        ours, theirs = hashlib.sha256(), hashlib.sha256()
        recording = open_recording(self._path)
        for kept in recording.messages():
            _add(ours, kept.topic, kept.seq, kept.sent_ns, kept.body)
        counts: Counter[str] = Counter()
        with self._path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            for _, channel, message in reader.iter_messages(log_time_order=False):
                counts[channel.topic] += 1
                sequence, sent = message.sequence, message.publish_time
                _add(theirs, channel.topic, sequence, sent, message.data)
        same = ours.digest() == theirs.digest() == self._digest.digest()
        if not (same and recording.closed and recording.counts == counts == self.counts):
            raise ValueError(f"recording {self._path} does not hold what was written to it")

    def _schema(self, schema: Schema) -> int:
        key = (schema.name, schema.encoding, schema.data)
        if key not in self._registered:
            self._registered[key] = self._writer.register_schema(*key)
        return self._registered[key]

    def _channel(self, channel: Channel, schema_id: int) -> int:
        told = channel.metadata
        key = (channel.topic, channel.message_encoding, schema_id, tuple(sorted(told.items())))
        if key not in self._registered:
            self._registered[key] = self._writer.register_channel(*key[:3], told)
        return self._registered[key]

    def _metadata(self, record: Metadata) -> None:
        key = (record.name, tuple(sorted(record.metadata.items())))
        if key not in self._told:  # each part of a recording says the same
            self._told.add(key)
            self._writer.add_metadata(record.name, record.metadata)

    def _message(self, message: Message, topic: str, channel_id: int) -> None:
        sent, sequence = message.publish_time, message.sequence
        self._logged = max(self._logged, message.log_time)  # as if one recorder had written all
        self._writer.add_message(channel_id, self._logged, message.data, sent, sequence)
        self.counts[topic] += 1
        _add(self._digest, topic, sequence, sent, message.data)


def _add(digest: hashlib._Hash, topic: str, sequence: int, sent: int, body: bytes) -> None:
    digest.update(f"{topic} {sequence} {sent} {len(body)} ".encode())
    digest.update(body)
