"""Topics of a running graph: names, fields, filters, messages, losses, rates and delays."""

import csv
import json
import math
import time
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from palpate.launch.processes.registry import find_run
from palpate.messages import HEADER_SIZE, encode
from palpate.messages.types import ShapeModel, TactileFrame
from palpate.tools.introspection.echo import TextStyle, read_filter, read_path, yaml_lines
from palpate.tools.introspection.topics import RateMonitor, find_topics, rate_text
from tests.tools.recordings import frame, log
from tests.tools.toy_graph import Bends


def documents(text):
    return [one for one in YAML(typ="safe", pure=True).load_all(text) if one is not None]


def plain(message: TactileFrame) -> dict:
    values = asdict(message).items()
    return {key: one.tolist() if isinstance(one, np.ndarray) else one for key, one in values}


def test_topics_are_listed_with_types_publishers_and_subscribers(graph, call, refusal):
    names = ["/log", "/m", "/node/status", "/odd", "/own", "/t"]
    assert call("topic list").out.split() == names
    assert call("topic list -c").out == "6\n"
    assert "/t [TactileFrame]" in call("topic list -t").out.splitlines()
    lines = call("topic list -v").out.splitlines()
    assert "/t [TactileFrame] from talker to hearer" in lines
    assert "/odd [NoSuchType] from talker to no node" in lines
    listed = {one["name"]: one for one in json.loads(call("topic list --json").out)}
    assert listed["/log"]["publishers"] == ["talker", "hearer", "cleaner", "player"]
    assert call("topic type t").out == "TactileFrame\n"
    assert call("topic find TactileFrame").out == "/t\n"
    message = refusal("topic find TactileFrme")
    assert "no topic carries TactileFrme; did you mean 'TactileFrame'" in message
    assert "no node publishes /logg; did you mean '/log'?" in refusal("topic type /logg")


def test_topic_info_shows_fields_with_units(graph, call, refusal):
    out = call("topic info /t -v").out
    assert out.startswith("Type: TactileFrame\nPublisher count: 1  talker\n")
    assert "Subscription count: 1  hearer" in out
    lines = {line.split()[0]: " ".join(line.split()[1:]) for line in out.splitlines()[4:]}
    assert list(lines) == list(TactileFrame.__dataclass_fields__)
    assert lines["robot_time"] == "number s"
    assert lines["array"] == "any x any float64 s or N"
    assert lines["outcome"] == "hit | miss | inside | bottomed"
    assert call("topic info /odd").code == 0
    message = refusal("topic info /odd -v")
    assert "/odd carries the type 'NoSuchType', which is not known" in message


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--field", "touch"], "3\n---\n"),
        (["--field", "touch", "--field", "pose[6]"], "touch: 3\npose[6]: 1.0\n---\n"),
        (["--field", "touch", "--field", "direction", "--csv"], "3,1.0,0.0,0.0\n"),
        (["--field", "touch", "--filter", "touch > 2"], "3\n---\n"),
        (["--field", "touch", "--filter", "touch > 3"], "4\n---\n"),
        (["--raw"], f"{encode(frame(3))!r}\n---\n"),
        (["--raw", "--filter", "touch > 3"], f"{encode(frame(4))!r}\n---\n"),
    ],
)
def test_echo_shows_only_requested_values(graph, call, options, text):
    graph.copy("/t", 0, frame(3))
    graph.copy("/t", 1, frame(4))
    graph.start()
    assert call("topic echo /t --once", *options) == (0, text, "")


def test_echo_is_yaml_that_reads_back_as_the_message(graph, call):
    messages = [frame(3), frame(4, array=np.linspace(0.0, 1.0, 256).reshape(16, 16))]
    for seq, message in enumerate(messages):
        graph.copy("/t", seq, message)
    graph.start()
    for options in ("-f", "-f --flow-style"):
        code, out, _ = call(f"topic echo /t -n 2 {options}")
        assert code == 0 and documents(out) == [plain(one) for one in messages]
    short = call("topic echo /t -n 2").out
    assert 'array: "16 x 16 float64: 0.0, 0.00392156862745098, ' in short
    rows = [*csv.reader(call("topic echo /t -n 2 --csv").out.splitlines())]
    for row, message in zip(rows, messages, strict=True):
        values = [np.ravel(one).tolist() for one in plain(message).values()]
        wanted = [cell for one in values for cell in one]
        assert [type(one)(cell) for one, cell in zip(wanted, row, strict=True)] == wanted
    # Last: a tool that joins after one that leaves early may be sent the second message first.
    assert documents(call("topic echo /t --once --no-arr").out)[0]["array"] == "2 x 3 float64"


def test_echo_shows_own_types_and_refuses_what_it_cannot_read_or_compare(graph, call, refusal):
    graph.copy("/own", 0, Bends(goal=4, curvature=12.5))
    graph.copy("/odd", 0, log(0.0))
    graph.copy("/m", 0, b"", schema=1)
    graph.copy("/t", 0, frame(3))
    graph.start()
    assert documents(call("topic echo /own --once").out) == [{"goal": 4, "curvature": 12.5}]
    assert call("topic echo /odd --once --raw").out == f"{encode(log(0.0))!r}\n---\n"
    assert call("topic echo /m --once --raw").code == 0
    for words, why in (
        ("/odd", "'NoSuchType', which is not known here; --raw shows"),
        ("/m", "the graph was started by another version"),
    ):
        assert why in refusal("topic echo --once", words)
    for wanted, why in (
        ("pose > 3", "pose holds several values; name one, as pose[0]"),
        ("outcome > 3", "outcome is 'hit'; 3 is of another kind"),
    ):
        assert why in refusal("topic echo /t --once --filter", wanted)


def test_echo_reports_missing_values(graph, call, tetrahedron):
    graph.copy("/m", 0, tetrahedron)
    graph.start()
    code, out, err = call("topic echo /m --once --field health.fallback --field number")
    assert (code, out) == (2, "health.fallback: null\nnumber: 1\n---\n")
    remark, refused = err.splitlines()
    assert remark.startswith("palpate: null where there is none: ") and "'fallbacks'" in remark
    assert "--field health.fallback: no message that was shown has it" in refused
    for path, why in (
        ("vertices[4]", "from vertices[0] to vertices[3]"),
        ("health.x", "has no 'x'"),
    ):
        assert why in call("topic echo /m --once --field", path).err
    assert call("topic echo /m --once --field health.fallbacks").out == "0.0\n---\n"


# Numbers of starts and messages as they come; those that are shown, and how many were lost.
ORDERS = {
    "messages before the tool are not missing": ("/t", [(0, 500), (0, 501)], [0, 1], 0),
    "gaps are counted from the numbers": ("/t", [(0, 1), (0, 5), (0, 6)], [0, 1, 2], 3),
    "what a restarted node repeats is no news":
        ("/t", [(0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (1, 3)], [0, 1, 5], 0),
    "a late copy of an earlier start is no news": ("/t", [(1, 3), (0, 9), (1, 4)], [0, 2], 0),
    "a node speaking of itself counts anew": ("/log", [(0, 7), (1, 2), (1, 4)], [0, 1, 2], 1),
}  # fmt: skip


@pytest.mark.parametrize("case", ORDERS)
def test_losses_are_counted_from_sequence_numbers(graph, call, case):
    topic, copies, shown, lost = ORDERS[case]
    for place, (epoch, seq) in enumerate(copies):
        graph.copy(topic, seq, log(place) if topic == "/log" else frame(place), epoch=epoch)
    graph.copy(topic, 99, frame(50), run=1)  # of another run
    graph.start()
    field = "robot_time" if topic == "/log" else "touch"
    code, out, err = call(f"topic echo {topic} --field {field} -n {len(shown)}")
    assert code == 0
    assert [float(one) for one in out.split() if one != "---"] == shown
    remark = f"palpate: {topic}: {lost} messages lost on the way here so far\n"
    assert err == (remark if lost else "")
    assert call(f"topic echo {topic} -n {len(shown)} --no-lost-messages").err == ""


def test_rates_bandwidths_and_delays_are_printed_as_by_ros2(graph, call):
    ago = time.monotonic_ns()
    for seq, sent, size in ((0, 0, 1000), (1, 0.01, 1000), (5, 0.05, 1000), (6, 0.08, 1400)):
        graph.copy("/t", seq, bytes(size - HEADER_SIZE - 3), sent_ns=round(1e9 * sent))
    for seq, seconds in ((0, 3000), (1, 1000)):
        graph.copy("/own", seq, b"", sent_ns=ago - seconds * 10**9)
    graph.copy("/m", 0, b"")
    for epoch, seq, sent in ((0, 7, 0), (0, 8, 1), (1, 0, 5), (1, 1, 5.5)):
        graph.copy("/log", seq, log(0.0), epoch=epoch, sent_ns=round(1e9 * sent))
    graph.start()
    assert call("topic hz /t --duration 0.2").out == (
        "average rate: 75.000\n\tmin: 0.010000s max: 0.030000s std dev: 0.010000s "
        "window: 4 (3 sent, but not received)\n"
    )
    assert call("topic bw /t --duration 0.2").out == (
        "82.50 KB/s from 4 messages\n\tMessage size mean: 1.10 KB min: 1.00 KB max: 1.40 KB "
        "window: 4 (3 sent, but not received)\n"
    )
    line = call("topic hz /t --json --duration 0.2 --window 2").out.splitlines()[-1]
    figures = json.loads(line)
    assert figures.pop("delay_s")["least"] > 0.0
    period = {"mean": 0.03, "least": 0.03, "most": 0.03, "deviation": 0.0}
    size = {"mean": 1200.0, "least": 1000.0, "most": 1400.0, "deviation": 200.0}
    for key, value in (("period_s", period), ("size_bytes", size)):
        assert figures.pop(key) == pytest.approx(value)
    rates = {"rate_hz": pytest.approx(1 / 0.03), "bytes_per_s": pytest.approx(1200 / 0.03)}
    assert figures == {"topic": "/t", "publisher": "talker", "messages": 2, **rates}
    words = call("topic delay /own --duration 0.2").out.split()
    figures = [float(words[place].rstrip("s")) for place in (2, 4, 6, 9)]
    # The tool takes a message at most some seconds after it was sent.
    assert figures == pytest.approx([2000.0, 1000.0, 3000.0, 1000.0], abs=30.0)
    out = call("topic hz --all --duration 0.2").out
    assert "/t\naverage rate: 75.000\n" in out
    assert "only one message on /m\n" in out and "no messages on /odd\n" in out
    assert "/log" not in out
    lines = call("topic hz /log --json --duration 0.2").out.splitlines()
    figures = {one["publisher"]: one for one in map(json.loads, lines)}["talker"]
    # With the restart of a node its window begins anew.
    assert (figures["rate_hz"], figures["messages"]) == (pytest.approx(2.0), 2)


def test_rate_without_neighbouring_messages_has_no_period(graph, call, refusal):
    for seq in (0, 9):
        graph.copy("/t", seq, b"", sent_ns=10**7 * seq)
    graph.start()
    assert call("topic hz /t t --duration 0.2").out == (  # a topic named twice is one
        "average rate: 100.000\n\tno two neighbouring messages came "
        "window: 2 (8 sent, but not received)\n"
    )
    assert "no node publishes /rely" in refusal("topic hz /rely")


def test_measuring_ends_with_the_graph(graph):
    graph.start()
    graph.vanish()
    with pytest.raises(ValueError, match="no graph of yours is running"):
        find_run(None)
    topics, printed = find_topics(graph.card, ["/t"]), list[str]()
    RateMonitor(topics, 10, rate_text, printed.append).run(graph.card, topics, None)
    assert printed == ["no messages on /t"]


SEVENS = ("6", "7.0", "8")
FIELDS: dict[str, Any] = {
    "goal": 2,
    "touch": 7,
    "outcome": "hit",
    "pose": np.array([0.0, 0.5, -1.0, 0.0, 0.0, 0.0, 1.0]),
    "robot_time": 1.5,
}


@pytest.mark.parametrize(
    "text",
    [
        *(
            f"touch {sign} {value}"
            for sign in ("<", "<=", "==", "!=", ">=", ">")
            for value in SEVENS
        ),
        "pose[1] <= 5e-1",
        "pose[2] < -.5",
        "outcome == 'hit'",
        'outcome != "and"',
        "outcome < 'i'",
        "goal == 2 and touch == 0 or outcome == 'hit'",
        "goal == 2 and (touch == 0 or outcome == 'miss')",
        "goal == 0 or goal == 1 or goal == 2",
        "  ( ( touch == 7 ) )  ",
        "outcome == 3",
    ],
)
def test_filter_selects_as_python_compares(text):
    wanted = bool(eval(text.strip(), {}, FIELDS))  # noqa: S307
    assert read_filter(text, TactileFrame)(FIELDS) is wanted


def test_filter_knows_words_of_yaml_the_message_itself_and_entries_of_tables():
    cases = {"m.touch == 7": True, "goal != null": True, "goal < None": False}
    for text, holds in (cases | {"goal == true": False}).items():
        assert read_filter(text, TactileFrame)(FIELDS) is holds
    wanted = read_filter("health.condition > 2", ShapeModel)
    assert wanted({"health": {"condition": 3.0}}) and not wanted({"health": {}})


NO_VALUE = "expected a number, 'text', true, false or null; got "
NO_PATH = "is no field; expected something like"
SEVEN = "pose has 7 elements, from pose[0] to pose[6]"
BAD = {
    read_filter: (
        ("", "cannot read ''"),
        ("touch", "'touch' is no comparison; a filter looks like touch > 3 and"),
        ("touch >", "cannot read 'touch >'"),
        ("touch > goal", f"{NO_VALUE}'goal'"),
        ("touch > -goal", f"{NO_VALUE}'-goal'"),
        ("outcome == b'hit'", f"{NO_VALUE}\"b'hit'\""),
        ("touch > 3 4", "cannot read 'touch > 3 4'"),
        ("(touch > 3", "cannot read '(touch > 3'"),
        ("touch > 3 and goal", "'goal' is no comparison"),
        ("not touch > 3", "'not touch > 3' is no comparison"),
        ("1 < touch < 3", "'1 < touch < 3' is no comparison"),
        ("tuch > 3", "TactileFrame has no field 'tuch'; did you mean 'touch'?"),
        ("touch + 1 > 3", "'touch + 1' is no field"),
        ("__import__('os').system('ls')", "is no comparison"),
        ("touch.__class__() == 1", "'touch.__class__()' is no field"),
        ("touch = 3", "cannot read 'touch = 3'"),
        ("touch > 3\0", "cannot read"),
        ("lambda: 0", "'lambda: 0' is no comparison"),
        ("3 > touch", "'3' is no field"),
        ("(" * 400 + "touch > 3" + ")" * 400, "cannot read"),
        ("touch > " + "-" * 900 + "3", "--filter: "),
        ("+".join(["touch"] * 160) + " > 3", "is no field"),
        ("pose.x != 0", "pose holds several values by their indices: it has no field 'x'"),
        ("touch > 3 or " * 100 + "touch > 3", "at most 1000 characters, got 1309"),
    ),
    read_path: (
        *((text, NO_PATH) for text in ("", ".", "pose[]", "pose[-1]", "pose[0:3]", "pose[x]")),
        *((text, NO_PATH) for text in ("pose..x", "3", "a b")),
        ("pose[7]", f"'pose[7]': {SEVEN}"),
        ("pose[1000000000]", SEVEN),
        (f"pose[{'9' * 5000}]", SEVEN),
        ("touch[0]", "touch holds one value: it has no element [0]"),
        ("array[0][0][0]", "array[0][0] holds one value: it has no element [0]"),
        ("robot_tim", "has no field 'robot_tim'; did you mean 'robot_time'?"),
    ),
}


@pytest.mark.parametrize(
    ("read", "text", "words"), [(read, *case) for read, cases in BAD.items() for case in cases]
)
def test_other_filters_and_paths_are_refused_in_one_sentence(read, text, words):
    with pytest.raises(ValueError) as caught:
        read(text, TactileFrame)
    assert words in str(caught.value)


def test_path_leads_to_a_value_within_the_message():
    fields = {"pose": np.arange(7.0), "array": np.eye(2), "touch": 3}
    for text, value in (("touch", 3), ("m.pose[2]", 2.0), ("array[1][1]", 1.0)):
        assert read_path(text, TactileFrame).of(fields) == value
    assert type(read_path("pose[2]", TactileFrame).of(fields)) is float
    assert read_path("health.fallbacks", ShapeModel).of({"health": {"fallbacks": 1.0}}) == 1.0


def read_back(value: Any, style: TextStyle) -> Any:
    """A value written in YAML and read again."""
    return documents("\n".join(yaml_lines({"x": value}, style)))[0]["x"]


VALUES = [
    *(0, -(1 << 62), 0.1, 1e-6, 1e22, -2.5e-300, -math.inf, True, None),
    *("hit", "", "yes", "null", "3", "a: b", "- a", "# no comment", "two\nlines", " spaced ", "~"),
    *('with "quotes" and \\', "naïve \x85\u2028", "{a}", "..."),
    *({}, {"condition": 1.5, "12": 2.0}, {"deep": {"deeper": [1, 2]}}),
    *([], [{"a": 1}, {"b": "c, d"}]),
]


@pytest.mark.parametrize("flow", [False, True])
def test_every_value_is_read_back_as_it_was_written(flow):
    style = TextStyle(full=True, flow=flow)
    for value in VALUES:
        read = read_back(value, style)
        assert read == value and type(read) is type(value)
    assert math.isnan(read_back(math.nan, style))
    array = np.linspace(-1e-7, 1.0, 30).reshape(5, 3, 2)
    assert np.array_equal(np.array(read_back(array, style)), array)
    assert read_back(np.zeros((0, 3)), style) == []
    assert read_back(np.array([True, False]), style) == [True, False]


def test_long_arrays_are_shortened():
    short, shapes = TextStyle(), TextStyle(arrays=False)
    values = np.full((16, 16), 2e-6)
    assert read_back(values, short) == "16 x 16 float64: 2.0e-06, 2.0e-06, 2.0e-06, ..."
    assert read_back(tuple(range(17)), short) == "17 int: 0, 1, 2, ..."
    assert read_back(np.arange(16.0), short) == list(range(16))
    assert read_back(np.zeros(3), shapes) == "3 float64" and read_back((), shapes) == "0 values"
