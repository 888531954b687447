from dataclasses import replace

import msgpack
import numpy as np
import pytest

from palpate.core.poses import IDENTITY_POSE
from palpate.messages.codec import encode
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.model import PlanDone
from palpate.messages.types.touch import TactileFrame, TactileImage
from palpate.tools.replay.comparison import ChangeNote, TopicChanges, TopicComparison


def log(value):
    return encode(LogRecord(node="x", level="info", text="", robot_time=value))


def compared(then, now, *, closed=True):
    comparison = TopicComparison("/log", LogRecord)
    for value in then:
        comparison.recorded(log(value))
    for value in now:
        comparison.add_published(log(value))
    comparison.end(closed=closed)
    return comparison


def test_the_same_messages_are_identical():
    found = compared([1.0, 2.0], [1.0, 2.0])
    assert (found.compared, found.differ, found.fewer, found.more, found.first) == (2, 0, 0, 0, "")


def test_the_first_of_several_differences_is_told():
    found = compared([1.0, 2.0, 3.0], [1.0, 2.5, 4.0])
    assert (found.compared, found.differ) == (3, 2)
    assert found.first == "/log 1 robot_time: recorded 2.0, now 2.5"


def test_what_one_side_lacks_is_counted():
    fewer, more = compared([1.0, 2.0], []), compared([1.0], [1.0, 2.0, 3.0])
    assert (fewer.fewer, fewer.first) == (2, "/log 0: recorded, but not published again")
    assert (more.more, more.first) == (2, "/log 1: published now, but not recorded")


def test_what_a_recording_without_its_end_lacks_is_no_difference():
    found = compared([1.0, 2.0], [1.0], closed=False)
    assert (found.fewer, found.first) == (0, "")


def test_after_it_fell_silent_what_was_recorded_is_counted():
    comparison = TopicComparison("/log", LogRecord)
    comparison.recorded(log(1.0))
    comparison.fall_silent()
    comparison.recorded(log(2.0))
    comparison.end(closed=True)
    assert (comparison.compared, comparison.fewer) == (0, 2)


def test_what_was_published_before_the_silence_is_still_compared():
    comparison = TopicComparison("/log", LogRecord)
    comparison.add_published(log(1.0))
    comparison.fall_silent()
    comparison.recorded(log(1.0))
    comparison.recorded(log(2.0))
    comparison.end(closed=True)
    assert (comparison.compared, comparison.differ, comparison.fewer) == (1, 0, 1)


IMAGE = TactileImage(
    goal=0,
    touch=0,
    finger=1,
    direction=np.array([1.0, 0.0, 0.0]),
    pose=IDENTITY_POSE,
    outcome="hit",
    compression=np.zeros((2, 2)),
    mask=np.zeros((2, 2), np.bool_),
    impulses=0,
    robot_time=1.0,
)
DONE = PlanDone(
    number=1,
    contours=(1, 2),
    probes=(),
    touches=3,
    robot_time=1.0,
    reason="enough",
    reached=True,
    rms_bound_95=1e-3,
    largest_untouched=None,
    uncovered=0.0,
)


def changed(message, **fields):
    """What has changed if these fields of a message have, in message 7."""
    changes = TopicChanges(type(message))
    changes.add(7, encode(message), encode(replace(message, **fields)))
    return changes


def test_numbers_are_measured_in_their_unit():
    changes = changed(IMAGE, compression=np.array([[0.0, 3e-5], [0.0, -4e-5]]), impulses=2)
    compression, impulses = changes.fields["compression"], changes.fields["impulses"]
    assert list(changes.fields) == ["compression", "impulses"]
    assert (compression.unit, compression.differ, compression.first) == ("m", 1, 7)
    assert compression.largest == 4e-5
    assert compression.rms == pytest.approx(2.5e-5, rel=1e-12)
    assert (impulses.unit, impulses.largest, impulses.rms) == ("#", 2.0, 2.0)


def test_several_messages_add_up_to_one_change():
    changes = TopicChanges(TactileImage)
    for seq, time in ((4, 3.0), (9, -3.0)):
        changes.add(seq, encode(IMAGE), encode(replace(IMAGE, robot_time=time)))
    found = changes.fields["robot_time"]
    assert (found.differ, found.first, found.largest) == (2, 4, 4.0)
    assert found.rms == pytest.approx(np.sqrt((4 + 16) / 2), rel=1e-12)


def test_parts_of_a_field_that_have_units_of_their_own_are_told_apart():
    frame = TactileFrame(
        goal=0,
        touch=0,
        finger=1,
        direction=np.zeros(3),
        pose=IDENTITY_POSE,
        outcome="hit",
        array=np.zeros((2, 2)),
        move=np.zeros(5),
        robot_time=0.0,
    )
    pose = IDENTITY_POSE + np.array([0, 0, 0.1, 0, 0.2, 0, 0])
    found = changed(frame, pose=pose, move=np.array([1.0, 0, 2.0, 3.0, 4.0])).fields
    units = {name: (change.unit, change.largest) for name, change in found.items()}
    assert units == {
        "pose[0:3]": ("m", 0.1),
        "pose[3:7]": ("1", 0.2),
        "move[0]": ("s", 1.0),
        "move[2]": ("rad", 2.0),
        "move[3:5]": ("m", 4.0),
    }


def test_what_has_no_size_is_counted():
    mask = np.array([[False, True], [True, True]])
    found = changed(IMAGE, mask=mask, outcome="miss").fields
    assert found["mask"].notes == {"element": ChangeNote(3, "False", "True")}
    assert found["outcome"].notes == {"value": ChangeNote(1, "'hit'", "'miss'")}
    assert found["mask"].numbers == 0


def test_the_first_of_many_is_shown():
    changes = TopicChanges(PlanDone)
    for seq, (then, now) in enumerate([(None, 0.5), (None, None), (0.5, None), (0.5, 0.25)]):
        one, other = replace(DONE, rms_bound_95=then), replace(DONE, rms_bound_95=now, number=2)
        changes.add(seq, encode(one), encode(other))
    bound = changes.fields["rms_bound_95"]
    assert bound.notes == {"value": ChangeNote(2, "None", "0.5")}
    assert (bound.differ, bound.first, bound.largest, bound.unit) == (3, 0, 0.25, "m")


def test_lists_and_truth_values_are_no_quantities():
    found = changed(DONE, contours=(1, 3), reached=False).fields
    assert found["contours"].notes == {"value": ChangeNote(1, "(1, 2)", "(1, 3)")}
    assert found["reached"].notes == {"value": ChangeNote(1, "True", "False")}


def test_arrays_of_another_shape_are_counted():
    found = changed(IMAGE, compression=np.zeros((2, 3))).fields["compression"]
    assert found.notes == {"shape": ChangeNote(1, "(2, 2)", "(2, 3)")}


def test_tables_are_compared_by_their_keys(tetrahedron):
    health = {"condition": 4.0, "folds": 0.0}
    found = changed(tetrahedron, health=health).fields
    assert list(found) == ["health", "health['condition']"]
    assert found["health"].notes == {"keys": ChangeNote(1, "['fallbacks']", "['folds']")}
    assert found["health['condition']"].largest == 0.5


def test_a_zero_that_changed_its_sign_differs_by_nothing():
    found = changed(IMAGE, compression=-IMAGE.compression, robot_time=-0.0).fields
    assert (found["compression"].differ, found["compression"].largest) == (1, 0.0)


def test_a_change_beyond_all_floats_is_infinite():
    changes = TopicChanges(TactileImage)
    far = replace(IMAGE, compression=np.full((2, 2), 1e308))
    changes.add(0, encode(far), encode(replace(far, compression=-far.compression)))
    assert changes.fields["compression"].largest == np.inf
    assert changes.fields["compression"].rms == np.inf


def test_bodies_that_differ_in_their_writing_alone_are_counted():
    body = encode(IMAGE)
    turned = msgpack.packb(dict(reversed(msgpack.unpackb(body).items())))
    changes = TopicChanges(TactileImage)
    changes.add(0, body, turned)
    assert changes.fields["bytes"].notes["byte"].count == 1


def test_a_body_that_is_no_message_is_counted():
    changes = TopicChanges(TactileImage)
    changes.add(0, b"\x80", encode(IMAGE))
    note = changes.fields["bytes"].notes["byte"]
    assert note.then == "1 bytes"
    assert note.now.startswith("not a TactileImage: missing field goal")
