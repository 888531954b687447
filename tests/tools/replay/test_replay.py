"""Toy nodes run again on what they had received: verdicts, changes, shortages, refusals."""

import json
import sys
import tracemalloc
from dataclasses import replace
from types import ModuleType

import msgpack
import msgspec
import numpy as np
import pytest

from palpate.core.poses import IDENTITY_POSE
from palpate.launch.graph import read_settings
from palpate.messages import encode, schema_hash
from palpate.messages.types import LogRecord, PlanDone, TactileImage, World
from palpate.nodes.runtime.node import Finished, Input, Node, Wiring, describe_wirings
from palpate.nodes.runtime.testing import example
from palpate.tools.replay.rerun import plan_resume, replay
from tests.tools.recordings import WORLD, frame, log, write_recording


class NoParams(msgspec.Struct, frozen=True):
    """Parameters of a node that has none."""


@pytest.fixture
def module(monkeypatch):
    """Puts a node where it can be imported."""

    def put(name, node):
        made = ModuleType(name)
        made.NODE = node
        monkeypatch.setitem(sys.modules, name, made)

    return put


def wiring(name, kind, params, inputs, **outputs) -> Wiring:
    """A node whose inputs are a publisher, a topic and its type; its outputs by local name."""
    local = {"/a": "/in", "/b": "/in"}  # what a chain of nodes hands on
    heard = tuple(Input(who, topic, local.get(topic, topic), of) for who, topic, of in inputs)
    published = {f"/{name}": topic for name, topic in outputs.items()}
    how = {"inputs": heard, "outputs": published, "subscribers": {}}
    return Wiring(name=name, module=kind, params=params, **how)


def describe(*wirings: Wiring) -> dict[str, str]:
    """What a recording says of its graph."""
    return {"graph": describe_wirings(wirings).decode()}


class Params(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    gain: float = 2.0
    copies: int = 1  # of each message
    late: int = 0  # inputs for which the node is silent before it publishes all at once


def pass_on(params, state, record):
    """Multiplies what comes; nothing of negative numbers is published."""
    if record.robot_time == 1000.0:
        raise ArithmeticError("no\nmore")
    state = (*state, params.gain * record.robot_time)
    if len(state) <= params.late or record.robot_time < 0.0:
        return state, []
    outputs = [("/out", log(value)) for value in state for _ in range(params.copies)]
    return (), [*outputs, Finished("enough")] if record.robot_time > 100.0 else outputs


LINK = {
    "params": Params,
    "start": lambda params: ((), []),
    "inputs": {"/in": (LogRecord, pass_on)},
    "outputs": {"/out": LogRecord},
}


def take_seed(params, state, world):
    return (*state, float(world.seed)), []


# The same with a start of its own, and a world for which it waits.
ADDER = {
    **LINK,
    "start": lambda params: ((), [("/out", log(params.gain, "start"))]),
    "inputs": {"/world": (World, take_seed), "/in": (LogRecord, pass_on)},
    "needs": ("/world",),
}
HEARD = [("simulator", "/world", "World"), ("source", "/a", "LogRecord")]
ADDING = wiring("adder", "adding", Params(), HEARD, out="/b")
TYPES = {"/world": "World", "/a": "LogRecord", "/b": "LogRecord"}
GOOD = [
    ("/b", log(2.0, "start")),
    ("/a", log(1.0)),  # recorded before the world, for which the adder waits
    ("/world", replace(WORLD, seed=10)),
    ("/b", log(10.0)),
    ("/b", log(2.0)),
    ("/a", log(-1.0)),
    ("/a", log(5.0)),
    ("/b", log(-2.0)),
    ("/b", log(10.0)),
]
CHAIN = [
    wiring("first", "links", Params(), [("source", "/a", "LogRecord")], out="/b"),
    wiring("second", "links", Params(), [("first", "/b", "LogRecord")], out="/c"),
]
DOUBLED = (("/a", 1.0), ("/b", 2.0), ("/c", 4.0))
PUBLISHED = [(topic, k * one) for k in (1.0, 2.0, 3.0) for topic, one in DOUBLED]
SAME = ["first: identical, 3 on /b", "second: identical, 3 on /c"]
HEAD = "topic field compared differ first largest rms unit"


@pytest.fixture
def play(record, module):
    """Replays the adder on a recording: exit code and lines, whose cells are one space apart."""
    module("adding", Node(**ADDER))
    module("links", Node(**LINK))

    def do(messages, nodes=("adder",), settings=(), about=None, **how):
        how = {"types": TYPES, "about": about or describe(ADDING), **how}
        path = record(messages, **how)
        lines: list[str] = []
        code = replay(path.parent, nodes, lines.append, settings=read_settings(settings))
        return code, [" ".join(line.split()) for line in lines]

    return do


@pytest.fixture
def chain(play):
    """Replays two nodes, each of which doubles what it receives."""

    def do(*settings, published=PUBLISHED, nodes=("first", "second")):
        messages = [(topic, log(value)) for topic, value in published]
        types = dict.fromkeys(("/a", "/b", "/c"), "LogRecord")
        return play(messages, nodes, settings, describe(*CHAIN), types=types)

    return do


def exchanged(place, message):
    return [*GOOD[:place], message, *GOOD[place + 1 :]]


def test_same_parameters_give_the_same_messages(play, chain):
    assert play(GOOD) == (0, ["adder: identical, 5 on /b"])
    assert play(GOOD, ["adder", "adder"])[1] == ["adder: identical, 5 on /b"]
    more = [*GOOD, ("/a", log(200.0)), ("/b", log(400.0))]
    assert play(more)[0] == 0  # that the node finishes is not compared
    assert chain() == (0, SAME)
    assert chain("first.late=2") == (0, SAME)  # later, and received then
    early = [("/b", 2.0), ("/c", 4.0), ("/a", 1.0)]  # recorded before their cause
    assert chain(published=early) == (0, [one.replace("3 on", "1 on") for one in SAME])


@pytest.mark.parametrize(
    ("messages", "line"),
    [
        (exchanged(4, ("/b", log(3.0))), "/b 2 robot_time: recorded 3.0, now 2.0"),
        (exchanged(0, ("/b", log(2.0, "go"))), "/b 0 text: recorded 'go', now 'start'"),
        (exchanged(6, ("/a", log(6.0))), "/b 4 robot_time: recorded 10.0, now 12.0"),
        (GOOD[:-1], "/b 4: published now, but not recorded"),
        ([*GOOD, ("/b", log(30.0))], "/b 5: recorded, but not published again"),
    ],
)
def test_first_difference_is_named(play, messages, line):
    code, lines = play(messages)
    assert (code, lines[0]) == (1, f"adder: differs, {line}")
    assert lines[1] == HEAD


def test_failed_node_publishes_nothing_more(play, chain):
    messages = exchanged(6, ("/a", log(1000.0)))
    for settings in ((), ["adder.gain=2"]):  # whatever is set
        code, (line, *_) = play(messages, settings=settings)
        assert code == 1 and line.endswith("in pass_on)")
        assert line.startswith("adder: fails, ArithmeticError handling /a 2 from source: no more (")
    published = [(topic, 1000.0 if (topic, k) == ("/a", 2.0) else k) for topic, k in PUBLISHED]
    assert chain(published=published)[1][1:] == [
        "second: differs, /c 1: recorded, but not published again",
        "second: received 2 fewer messages on /b than recorded: first publishes no more",
        HEAD,
        "/b messages 1 1 2 fewer than recorded",
        "/c messages 1 1 2 fewer than recorded",
    ]


def test_messages_are_handed_over_in_the_order_of_sending(play, module):
    code, lines = play(GOOD[:-1], sent=[10**9 * one for one in range(8)], closed=False)
    assert code == 0 and lines[1].startswith("adder: identical, ")
    assert lines[0].endswith("topics.mcap was never closed: replayed up to its end")
    # Without needs the world must come before the number, though it was recorded after it.
    module("adding", Node(**{**ADDER, "needs": ()}))
    assert play(GOOD[:5], sent=[1, 3, 2, 4, 5])[0] == 0
    assert play(GOOD[:5], sent=[1, 2, 3, 4, 5])[0] == 1


def test_recording_is_not_held_in_memory(play):
    size, number = 100_000, 100
    # The adder does not receive them; each was recorded before its predecessor.
    messages = [("/big", bytes(size), seq ^ 1) for seq in range(number)]
    times = [seq ^ 1 for seq in range(number)]
    tracemalloc.start()
    play(messages, types={**TYPES, "/big": "World"}, sent=times)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.3 * size * number


@pytest.mark.parametrize(
    ("nodes", "edit", "words"),
    [
        ("planner", None, r"has no node 'planner'; it has \['adder'\]"),
        ("", None, "has no node that can be replayed exactly"),  # a user's module
        ("adder", ("", ""), "does not say which nodes made it"),
        ("adder", ('"adding"', '"gone_away"'), "no module 'gone_away'"),
        ("adder", ('"adding"', '"palpate.nodes.recorder"'), "adder neither subscribes nor publish"),
        ("adder", ('"local":"/in"', '"local":"/x"'), "adder is wired to /x, which it does"),
        ("adder", ('{"/out":', '{"/in":'), "adder is wired to /in, which it does not declare; it"),
    ],
)
def test_nodes_that_cannot_be_replayed_are_refused(play, nodes, edit, words):
    graph = describe(ADDING)["graph"]
    about = {"graph": graph if edit is None else graph.replace(*edit) if edit[0] else ""}
    with pytest.raises(ValueError, match=words):
        play(GOOD, nodes.split(), about=about)


def test_recordings_that_cannot_be_replayed_are_refused(play, tmp_path):
    with pytest.raises(ValueError, match="lacks /a 1: it has 2 instead"):
        play([*GOOD[:5], ("/a", log(5.0), 2)])
    words = r"/b was recorded with another version of LogRecord \(schema 0000002a,"
    with pytest.raises(ValueError, match=words):
        play(GOOD, schema=42)
    with pytest.raises(ValueError, match="the recording does not exist"):
        replay(tmp_path / "none.mcap")


def test_subscribers_receive_what_is_published_now_and_miss_what_is_not(chain):
    code, lines = chain("first.gain=3")
    assert code == 0 and lines == [
        "first: differs, /b 0 robot_time: recorded 2.0, now 3.0",
        "second: differs, /c 0 robot_time: recorded 4.0, now 6.0",
        HEAD,
        "/b robot_time 3 3 0 3 2.16 s",  # 1, 2 and 3
        "/c robot_time 3 3 0 6 4.32 s",
    ]
    moved = [(topic, value + (topic == "/b")) for topic, value in PUBLISHED]
    difference = "second: differs, /c 0 robot_time: recorded 4.0, now 6.0"  # of the recorded /b
    assert chain(published=moved, nodes=["second"])[1][0] == difference
    assert chain("first.copies=0")[1][1:] == [
        "second: differs, /c 0: recorded, but not published again",
        "second: received 3 fewer messages on /b than recorded: first publishes no more",
        HEAD,
        "/b messages 0 0 3 fewer than recorded",
        "/c messages 0 0 3 fewer than recorded",
    ]
    # Now 2 2 4 4 6 6 are published, of which the first three stand in the places of 2 4 6.
    assert chain("first.copies=2")[1][1:] == [
        "second: differs, /c 1 robot_time: recorded 8.0, now 4.0",
        "second: received 3 more messages on /b, after those recorded: first publishes more",
        HEAD,
        "/b robot_time 3 2 1 2 2 s",
        "/b messages 3 3 3 more than recorded",
        "/c robot_time 3 2 1 4 4 s",
        "/c messages 3 3 3 more than recorded",
    ]


def test_settings_of_other_nodes_are_refused(chain):
    for setting, words in (
        ("first.gain=3", "'first' is not among the nodes to run again: second; add it to"),
        ("frist.gain=3", "there is no node 'frist'; known: second"),
        ("gain=1", "must look like planner.tolerance=0.2e-3"),
    ):
        with pytest.raises(ValueError) as caught:
            chain(setting, nodes=["second"])
        assert str(caught.value).startswith(f"--set {setting}: {words}")


def test_setting_without_number_means_all_fingers(play):
    heard, outs = [("source", "/a", "LogRecord")], {1: "/finger_1/out", 2: "/finger_2/out"}
    links = [wiring(f"link_{n}", "links", Params(), heard, out=out) for n, out in outs.items()]
    messages = [("/a", log(1.0)), *((out, log(2.0)) for out in outs.values())]
    types = dict.fromkeys(("/a", *outs.values()), "LogRecord")
    names, about = [one.name for one in links], describe(*links)
    for setting, first in (
        ("link_2.gain=3", "identical, 1"),
        ("link.gain=3", "differs, /finger_1"),
    ):
        code, lines = play(messages, names, [setting], about, types=types)
        assert code == 0 and lines[0].startswith(f"link_1: {first}")
        assert lines[1].startswith("link_2: differs")


@pytest.mark.parametrize(("goals", "answers", "answered"), [
    ([10, 11, 12, 13], [5, 20, 30], 2),  # one answer came before any goal
    ([10, 11], [20, 21, 22, 23], 2),  # several answers to a goal
    ([], [5], 0),
    ([], [], 0),
])  # fmt: skip
def test_resumed_node_repeats_only_unanswered_goals(record, module, goals, answers, answered):
    def quiet(params, state, message):
        return state, []

    made = {"params": NoParams, "start": lambda params: (None, [])}
    heard = {"/world": (LogRecord, quiet), "/goal": (LogRecord, quiet)}
    acting = {"needs": ("/world",), "has_side_effects": True}
    module("acting", Node(**made, **acting, inputs=heard, outputs={"/done": LogRecord}))
    module("speaking", Node(**made, inputs={}, outputs={"/world": LogRecord, "/goal": LogRecord}))
    inputs = [("a", "/world", "LogRecord"), ("b", "/goal", "LogRecord")]
    graph = describe(
        wiring("actor", "acting", NoParams(), inputs, done="/done"),
        wiring("a", "speaking", NoParams(), [], world="/world"),
        wiring("b", "speaking", NoParams(), [], goal="/goal"),
    )
    timed = [(1, "/world"), *((t, "/goal") for t in goals), *((t, "/done") for t in answers)]
    messages = [(topic, log(0.0)) for _, topic in timed]
    path = record(messages, about={**graph, "ends": "actor"}, sent=[when for when, _ in timed])
    plan = plan_resume(path, None, nodes=["actor", "a", "b"], out=path.with_name("on"))
    consumed = [(one.publisher, one.topic, one.seq) for one in plan.before.consumed["actor"]]
    assert consumed == [("b", "/goal", seq) for seq in range(answered)]
    assert [one.sent_ns for one in plan.before.published["actor"]] == answers


def test_resumption_is_refused_in_one_sentence(record, refusal):
    path = record([("/a", log(1.0))], about=describe(CHAIN[0]))
    assert "does not say which graph made it" in refusal("replay --from end", path)
    path = record([("/a", log(1.0))], about={**describe(CHAIN[0]), "ends": "first"})
    message = refusal("replay --from end", path)
    assert "wants module 'links' for first, which is not palpate's own; name it if you" in message
    for words, why in (
        ("--from contour=x", "--from contour=x: must look like contour=12, or be the word end"),
        ("--from contour=0", "must look like contour=12"),
        ("--from end --set a.b=1", "--set and --from exclude each other"),
        ("--quiet", "--out and --quiet belong to --from"),
    ):
        assert why in refusal(f"replay {words}", path)


@pytest.fixture
def compare(tmp_path, module):
    """Replays a node that publishes messages now where others were recorded."""

    def do(then, now, *, as_json=True):
        kind = type(now[0])
        node = Node(
            params=NoParams,
            start=lambda params: (0, []),
            inputs={"/in": (LogRecord, lambda params, k, _: (k + 1, [("/out", now[k])]))},
            outputs={"/out": kind},
        )
        module("speaker", node)
        speaker = wiring("speaker", "speaker", NoParams(), [("s", "/in", "LogRecord")], out="/out")
        pairs = [[("/in", log(0.0)), ("/out", one)] for one in then]
        messages = [one for pair in pairs for one in pair]
        types = {"/in": "LogRecord", "/out": kind.__name__}
        hashes = {"/in": schema_hash(LogRecord), "/out": schema_hash(kind)}
        path = tmp_path / "topics.mcap"
        write_recording(path, messages, types=types, about=describe(speaker), hashes=hashes)
        lines: list[str] = []
        replay(path, ["speaker"], lines.append, as_json=as_json)
        if not as_json:
            return lines
        return json.loads(lines[0])["nodes"]["speaker"]["topics"]["/out"]["fields"]

    return do


@pytest.fixture
def changed(compare):
    """The fields that change if these of one message have."""
    return lambda message, **fields: compare([message], [replace(message, **fields)])


IMAGE = example(TactileImage, compression=np.zeros((2, 2)), mask=np.zeros((2, 2), np.bool_),
                pose=IDENTITY_POSE, robot_time=1.0)  # fmt: skip
DONE = example(PlanDone, contours=(1, 2), reached=True, rms_bound_95=1e-3)


def note(count, then, now):
    return {"count": count, "then": then, "now": now}


def test_numbers_are_measured_in_their_unit_and_extreme_ones_too(compare, changed):
    changes = changed(IMAGE, compression=np.array([[0.0, 3e-5], [0.0, -4e-5]]), impulses=2)
    assert list(changes) == ["compression", "impulses"]
    assert changes["compression"] == {
        "unit": "m", "differ": 1, "first": 0, "largest": 4e-5, "notes": {},
        "rms": pytest.approx(2.5e-5, rel=1e-12),
    }  # fmt: skip
    assert [changes["impulses"][key] for key in ("unit", "largest", "rms")] == ["#", 2.0, 2.0]
    changes = changed(IMAGE, compression=-IMAGE.compression)  # zeros that change their sign
    assert (changes["compression"]["differ"], changes["compression"]["largest"]) == (1, 0.0)
    far = replace(IMAGE, compression=np.full((2, 2), 1e308))
    opposite = replace(far, compression=-far.compression)
    assert compare([far], [opposite])["compression"]["largest"] is None
    assert " inf  inf  m" in compare([far], [opposite], as_json=False)[-1]


def test_parts_with_units_of_their_own_are_kept_apart(changed):
    touched = frame(0, pose=IDENTITY_POSE, move=np.zeros(5))
    pose = IDENTITY_POSE + np.array([0, 0, 0.1, 0, 0.2, 0, 0])
    found = changed(touched, pose=pose, move=np.array([1.0, 0, 2.0, 3.0, 4.0]))
    assert {name: (one["unit"], one["largest"]) for name, one in found.items()} == {
        "pose[0:3]": ("m", 0.1),
        "pose[3:7]": ("1", 0.2),
        "move[0]": ("s", 1.0),
        "move[2]": ("rad", 2.0),
        "move[3:5]": ("m", 4.0),
    }


@pytest.mark.parametrize(
    ("message", "field", "value", "notes"),
    [
        (IMAGE, "mask", np.array([[False, True], [True, True]]),
         {"element": note(3, "False", "True")}),
        (IMAGE, "outcome", "miss", {"value": note(1, "'hit'", "'miss'")}),
        (IMAGE, "compression", np.zeros((2, 3)), {"shape": note(1, "(2, 2)", "(2, 3)")}),
        (DONE, "contours", (1, 3), {"value": note(1, "(1, 2)", "(1, 3)")}),
        (DONE, "reached", False, {"value": note(1, "True", "False")}),
        (DONE, "rms_bound_95", None, {"value": note(1, "0.001", "None")}),
    ],
)  # fmt: skip
def test_changes_without_a_size_are_counted(changed, message, field, value, notes):
    changes = changed(message, **{field: value})
    assert changes == {field: {"unit": "", "first": 0, "differ": 1, "largest": None, "rms": None,
                             "notes": notes}}  # fmt: skip


def test_several_messages_add_up_to_one_change_and_the_first_is_shown(compare):
    now = [replace(IMAGE, robot_time=time) for time in (1.0, 4.0, 1.0, -3.0)]
    change = compare([IMAGE] * 4, now)["robot_time"]
    assert (change["differ"], change["first"], change["largest"]) == (2, 1, 4.0)
    assert change["rms"] == pytest.approx(np.sqrt((9 + 16) / 2), rel=1e-12)
    then = [replace(DONE, rms_bound_95=one) for one in (None, None, 0.5, 0.5)]
    now = [replace(DONE, rms_bound_95=one, number=2) for one in (0.5, None, None, 0.25)]
    bound = compare(then, now)["rms_bound_95"]
    assert bound["notes"] == {"value": note(2, "None", "0.5")}
    values = [bound[key] for key in ("differ", "first", "largest", "unit")]
    assert values == [3, 0, 0.25, "m"]


def test_tables_are_compared_by_their_keys_and_odd_bodies_by_their_bytes(compare, changed,
                                                                         tetrahedron):  # fmt: skip
    changes = changed(tetrahedron, health={"condition": 4.0, "folds": 0.0})
    assert list(changes) == ["health", "health['condition']"]
    assert changes["health"]["notes"] == {"keys": note(1, "['fallbacks']", "['folds']")}
    assert changes["health['condition']"]["largest"] == 0.5
    turned = msgpack.packb(dict(reversed(msgpack.unpackb(encode(IMAGE)).items())))
    assert compare([turned], [IMAGE])["bytes"]["notes"]["byte"]["count"] == 1
    changes = compare([b"\x80"], [IMAGE])["bytes"]["notes"]["byte"]
    assert changes["then"] == "1 bytes"
    assert changes["now"].startswith("not a TactileImage: missing field goal")


def test_table_shows_sizes_units_and_notes(compare):
    shape = replace(IMAGE, compression=np.zeros((2, 3)))
    moved = replace(IMAGE, compression=IMAGE.compression + 0.5)
    now = [replace(shape, outcome="miss"), moved, replace(IMAGE, impulses=2)]
    _, *rows = compare([IMAGE, IMAGE, IMAGE], now, as_json=False)
    assert " ".join(" ".join(rows).split()) == (
        "topic field compared differ first largest rms unit "
        "/out outcome 3 1 0 1 changed, first 'hit' -> 'miss' "
        "/out compression 3 2 0 0.5 0.5 m 1 of another shape, first (2, 2) -> (2, 3) "
        "/out impulses 3 1 2 2 2 count"
    )
