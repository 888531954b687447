"""Toy nodes run again on what they had received: verdicts, shortages, settings, refusals."""

import tracemalloc
from dataclasses import replace

import msgspec
import pytest

from palpate.launch.graph import read_settings
from palpate.messages.types import LogRecord, World
from palpate.nodes.runtime.node import Finished, Node
from palpate.tools.replay.rerun import plan_resume, replay
from tests.tools.recordings import WORLD, log

from .conftest import NoParams, describe, wiring


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


def changed(place, message):
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
        (changed(4, ("/b", log(3.0))), "/b 2 robot_time: recorded 3.0, now 2.0"),
        (changed(0, ("/b", log(2.0, "go"))), "/b 0 text: recorded 'go', now 'start'"),
        (changed(6, ("/a", log(6.0))), "/b 4 robot_time: recorded 10.0, now 12.0"),
        (GOOD[:-1], "/b 4: published now, but not recorded"),
        ([*GOOD, ("/b", log(30.0))], "/b 5: recorded, but not published again"),
    ],
)
def test_first_difference_is_named(play, messages, line):
    code, lines = play(messages)
    assert (code, lines[0]) == (1, f"adder: differs, {line}")
    assert lines[1] == HEAD


def test_failed_node_publishes_nothing_more(play, chain):
    messages = changed(6, ("/a", log(1000.0)))
    for settings in ((), ["adder.gain=2"]):  # whatever is set
        code, (told, *_) = play(messages, settings=settings)
        assert code == 1 and told.endswith("in pass_on)")
        assert told.startswith("adder: fails, ArithmeticError handling /a 2 from source: no more (")
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
    assert lines[0].endswith("topics.mcap was never closed: replaying as far as it goes")
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


def test_subscribers_receive_what_is_published_now(chain):
    assert chain("first.gain=3") == (
        0,
        [
            "first: differs, /b 0 robot_time: recorded 2.0, now 3.0",
            "second: differs, /c 0 robot_time: recorded 4.0, now 6.0",
            HEAD,
            "/b robot_time 3 3 0 3 2.16 s",  # 1, 2 and 3
            "/c robot_time 3 3 0 6 4.32 s",
        ],
    )
    moved = [(topic, value + (topic == "/b")) for topic, value in PUBLISHED]
    told = "second: differs, /c 0 robot_time: recorded 4.0, now 6.0"  # of the recorded /b
    assert chain(published=moved, nodes=["second"])[1][0] == told


def test_shortages_and_surpluses_are_told(chain):
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


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("first.gain=3", "'first' is not among the nodes to run again: second; add it to"),
        ("frist.gain=3", "there is no node 'frist'; known: second"),
        ("gain=1", "must look like planner.tolerance=0.2e-3"),
        ("second.gian=1", "unknown key 'gian' in second; did you mean 'gain'?"),
        ("second.gain=much", "second.gain is 'much'; expected number"),
    ],
)
def test_settings_of_other_nodes_are_refused(chain, setting, words):
    with pytest.raises(ValueError) as caught:
        chain(setting, nodes=["second"])
    assert str(caught.value).startswith(f"--set {setting}: {words}")


@pytest.mark.parametrize(("setting", "both"), [("link_2.gain=3", False), ("link.gain=3", True)])
def test_setting_without_number_means_all_fingers(play, setting, both):
    heard, outs = [("source", "/a", "LogRecord")], ("/finger_1/out", "/finger_2/out")
    links = [
        wiring(f"link_{n}", "links", Params(), heard, out=out) for n, out in enumerate(outs, 1)
    ]
    messages = [("/a", log(1.0)), *((out, log(2.0)) for out in outs)]
    types = dict.fromkeys(("/a", *outs), "LogRecord")
    names = [one.name for one in links]
    code, lines = play(messages, names, [setting], describe(*links), types=types)
    differs = "differs, /finger_1/out" if both else "identical, 1"
    assert code == 0 and lines[0].startswith(f"link_1: {differs}")
    assert lines[1].startswith("link_2: differs")


@pytest.mark.parametrize(
    ("goals", "answers", "answered"),
    [
        ([10, 11, 12, 13], [5, 20, 30], 2),  # one answer came before any goal
        ([10, 11], [20, 21, 22, 23], 2),  # several answers to a goal
        ([], [5], 0),
        ([], [], 0),
    ],
)
def test_resumed_node_that_acts_repeats_only_unanswered_goals(
    record, module, goals, answers, answered
):
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
    found = [(one.publisher, one.topic, one.seq) for one in plan.before.consumed["actor"]]
    assert found == [("b", "/goal", seq) for seq in range(answered)]
    assert [one.sent_ns for one in plan.before.published["actor"]] == answers


def test_resumption_is_refused_in_one_sentence(record, refusal):
    path = record([("/a", log(1.0))], about=describe(CHAIN[0]))
    assert "does not say which graph made it" in refusal("replay --from end", path)
    path = record([("/a", log(1.0))], about={**describe(CHAIN[0]), "ends": "first"})
    told = refusal("replay --from end", path)
    assert "wants module 'links' for first, which is not palpate's own; name it if you" in told
    for words, why in (
        ("--from contour=x", "--from contour=x: must look like contour=12, or be the word end"),
        ("--from contour=0", "must look like contour=12"),
        ("--from end --set a.b=1", "--set and --from exclude each other"),
        ("--quiet", "--out and --quiet belong to --from"),
    ):
        assert why in refusal(f"replay {words}", path)
