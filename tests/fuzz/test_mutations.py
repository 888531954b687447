from __future__ import annotations

import random

import msgpack
import pytest

from palpate.messages.types.catalogue import TYPES
from tests.fuzz import mutations
from tests.fuzz.messages import mutated_packet, valid_packets
from tests.fuzz.mutations import (
    mutate_body,
    mutate_bytes,
    mutate_text,
    tree_paths,
    value_at,
    with_value,
)

DATA, OTHER = bytes(range(200)), b"x" * 50


def test_the_same_seed_gives_the_same_damage():
    first = [mutate_bytes(random.Random(f"a {i}"), DATA, OTHER) for i in range(50)]
    assert [mutate_bytes(random.Random(f"a {i}"), DATA, OTHER) for i in range(50)] == first
    assert len(set(first)) > 40


@pytest.mark.parametrize("kind", mutations.BYTE_MUTATIONS)
def test_every_kind_of_damage_hurts_bytes_and_bears_none(kind):
    results = {kind(random.Random(i), DATA, OTHER) for i in range(20)}
    assert results - {DATA}
    assert isinstance(kind(random.Random(1), b"", b""), bytes)


@pytest.mark.parametrize("kind", dict.fromkeys(mutations.TEXT_MUTATIONS))
def test_every_kind_of_damage_hurts_text_and_bears_none(kind):
    lines = b"".join(b"vertex %d 2.5 x\n" % i for i in range(20))
    results = {kind(random.Random(i), lines, mutations.HOSTILE_WORDS) for i in range(20)}
    assert results - {lines}
    assert isinstance(kind(random.Random(1), b"", mutations.HOSTILE_WORDS), bytes)


def test_hostile_words_come_into_a_text():
    hurt = [mutate_text(random.Random(i), b"element vertex 12\n" * 5) for i in range(60)]
    assert any(b"nan" in one for one in hurt)
    assert any(b"2000000000" in one for one in hurt)


BODY = {"a": 1, "pose": {"dtype": "<f8", "shape": [2], "data": bytes(16)}, "names": ["x", "y"]}


def test_a_place_can_be_found_and_filled():
    found = tree_paths(BODY)
    assert ("pose", "shape", 0) in found
    assert value_at(BODY, ("pose", "shape", 0)) == 2
    assert with_value(BODY, ("names", 1), 7)["names"] == ["x", 7]
    assert BODY["names"] == ["x", "y"]


def test_damage_to_a_body_reaches_types_shapes_depth_and_what_no_packer_makes():
    hurt = [mutate_body(random.Random(i), BODY) for i in range(4000)]
    read = []
    for one in hurt:
        try:
            read.append(msgpack.unpackb(one))
        except ValueError:
            continue
    assert 1000 < len(read) < 4000
    poses = [one["pose"] for one in read if isinstance(one, dict) and "pose" in one]
    assert any(isinstance(pose, dict) and pose.get("shape") == [0, 2**63 - 1] for pose in poses)
    kinds = [pose.get("dtype") for pose in poses if isinstance(pose, dict)]
    assert any(kind in ("<f4", "|O", "<M8", "") for kind in kinds)
    assert any(one.count(b"\x91") > 400 for one in hurt)


def test_messages_of_every_type_and_frames_and_words_are_damaged():
    readers = {mutated_packet(random.Random(i)).reader for i in range(2000)}
    assert readers == {packet.reader for packet in valid_packets()}
    assert readers > set(TYPES)
