from __future__ import annotations

import pytest

from palpate.launch.looking.field_text import field_lines
from palpate.launch.looking.topics import (
    Topic,
    find_topic,
    find_topics,
    taps_of,
    topics_of,
    type_of,
)
from palpate.launch.processes.register import Card
from palpate.messages.types import TYPES, TactileFrame


def test_the_topics_are_those_of_the_nodes_and_their_own_words(card: Card) -> None:
    assert list(topics_of(card)) == ["/log", "/node/status", "/odd", "/t"]
    assert find_topic(card, "t") == Topic("/t", "TactileFrame", ("talker",), ("hearer",))
    assert find_topic(card, "/log").publishers == ("talker", "hearer")


def test_a_topic_without_publisher_is_refused_with_the_nearest(card: Card) -> None:
    with pytest.raises(ValueError, match=r"nobody publishes /logg; did you mean '/log'\?"):
        find_topic(card, "/logg")


def test_a_topic_that_is_named_twice_is_one(card: Card) -> None:
    assert [one.name for one in find_topics(card, ["/t", "t", "/log"])] == ["/t", "/log"]


def test_each_tap_is_asked_for_what_its_node_publishes(card: Card) -> None:
    topics = find_topics(card, ["/t", "/log"])
    assert taps_of(card, topics) == {"talker": ["/t", "/log"], "hearer": ["/log"]}


def test_a_type_that_is_not_known_is_refused(card: Card) -> None:
    assert type_of(find_topic(card, "/t")) is TactileFrame
    with pytest.raises(ValueError, match="/odd carries the type 'NoSuchType', which is not known"):
        type_of(find_topic(card, "/odd"))


def test_fields_have_their_units_and_shapes() -> None:
    lines = {line.split()[0]: " ".join(line.split()[1:]) for line in field_lines(TactileFrame)}
    assert lines["robot_time"] == "number s"
    assert lines["array"] == "any x any float64 s or N"
    assert lines["outcome"] == "hit | miss | inside | bottomed"


@pytest.mark.parametrize("name", TYPES)
def test_every_type_has_a_line_for_each_field(name: str) -> None:
    lines = field_lines(TYPES[name])
    assert [line.split()[0] for line in lines] == list(TYPES[name].__dataclass_fields__)  # type: ignore[attr-defined]
    assert not any("<f8" in line or "{" in line for line in lines)
