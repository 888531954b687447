import pytest

from palpate.messages.codec import Header
from palpate.messages.types.catalogue import TYPES
from palpate.messages.types.touch import TactileFrame
from palpate.tools.introspection import topics
from palpate.tools.introspection.echo import field_lines
from palpate.tools.introspection.topics import (
    SequenceTracker,
    TapSubscription,
    Topic,
    find_topic,
    find_topics,
    taps_of,
    topics_of,
    type_of,
)


def test_the_topics_are_those_of_the_nodes_and_their_own_words(card):
    assert list(topics_of(card)) == ["/log", "/node/status", "/odd", "/t"]
    assert find_topic(card, "t") == Topic("/t", "TactileFrame", ("talker",), ("hearer",))
    assert find_topic(card, "/log").publishers == ("talker", "hearer")


def test_a_topic_without_publisher_is_refused_with_the_nearest(card):
    with pytest.raises(ValueError, match=r"nobody publishes /logg; did you mean '/log'\?"):
        find_topic(card, "/logg")


def test_a_topic_that_is_named_twice_is_one(card):
    assert [one.name for one in find_topics(card, ["/t", "t", "/log"])] == ["/t", "/log"]


def test_each_tap_is_asked_for_what_its_node_publishes(card):
    wanted = find_topics(card, ["/t", "/log"])
    assert taps_of(card, wanted) == {"talker": ["/t", "/log"], "hearer": ["/log"]}


def test_a_type_that_is_not_known_is_refused(card):
    assert type_of(find_topic(card, "/t")) is TactileFrame
    with pytest.raises(ValueError, match="/odd carries the type 'NoSuchType', which is not known"):
        type_of(find_topic(card, "/odd"))


def test_fields_have_their_units_and_shapes():
    lines = {line.split()[0]: " ".join(line.split()[1:]) for line in field_lines(TactileFrame)}
    assert lines["robot_time"] == "number s"
    assert lines["array"] == "any x any float64 s or N"
    assert lines["outcome"] == "hit | miss | inside | bottomed"


@pytest.mark.parametrize("name", TYPES)
def test_every_type_has_a_line_for_each_field(name):
    lines = field_lines(TYPES[name])
    assert [line.split()[0] for line in lines] == list(TYPES[name].__dataclass_fields__)
    assert not any("<f8" in line or "{" in line for line in lines)


def places(order, *numbers):
    """What is missing before messages of these epochs and numbers."""
    return [order.place(Header(1, epoch, seq, 0, 0.0, 0)) for epoch, seq in numbers]


def test_what_came_before_the_tool_is_not_missing():
    assert places(SequenceTracker(anew=False), (0, 500), (0, 501)) == [0, 0]


def test_missing_messages_are_counted_from_the_numbers():
    assert places(SequenceTracker(anew=False), (0, 1), (0, 5), (0, 6)) == [0, 3, 0]


def test_what_a_node_says_again_after_a_restart_is_no_news():
    again = [(1, 0), (1, 1), (1, 2), (1, 3)]
    assert places(SequenceTracker(anew=False), (0, 1), (0, 2), *again) == [
        0,
        0,
        None,
        None,
        None,
        0,
    ]


def test_a_late_copy_of_an_earlier_start_is_no_news():
    assert places(SequenceTracker(anew=True), (1, 3), (0, 9)) == [0, None]


def test_who_counts_anew_after_a_restart_has_lost_nothing():
    assert places(SequenceTracker(anew=True), (0, 7), (1, 2), (1, 4)) == [0, 0, 1]


def test_batches_come_as_long_as_the_graph_runs(card, monkeypatch):
    alive = iter([True, True, False])
    monkeypatch.setattr(topics, "ALIVE_CHECK", 0.0)
    monkeypatch.setattr(topics, "is_running", lambda _: next(alive))
    with TapSubscription(card, find_topics(card, ["/t"])) as taps:
        assert list(taps.batches()) == [[], [], []]
