from __future__ import annotations

import random

import msgpack

from palpate.launch.damage.messages import damaged_packet, sound_packets
from palpate.launch.damage.packed import damaged_body
from palpate.launch.damage.trees import places, value_at, with_value
from palpate.messages.types import TYPES

BODY = {"a": 1, "pose": {"dtype": "<f8", "shape": [2], "data": bytes(16)}, "names": ["x", "y"]}


def test_a_place_can_be_found_and_filled() -> None:
    found = places(BODY)

    assert ("pose", "shape", 0) in found
    assert value_at(BODY, ("pose", "shape", 0)) == 2
    assert with_value(BODY, ("names", 1), 7)["names"] == ["x", 7]
    assert BODY["names"] == ["x", "y"]


def test_damage_to_a_body_reaches_types_shapes_depth_and_what_no_packer_makes() -> None:
    hurt = [damaged_body(random.Random(i), BODY) for i in range(4000)]
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


def test_messages_of_every_type_and_frames_and_words_are_damaged() -> None:
    readers = {damaged_packet(random.Random(i)).reader for i in range(2000)}

    assert readers == {packet.reader for packet in sound_packets()}
    assert readers > set(TYPES)
