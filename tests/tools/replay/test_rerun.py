import sys
from collections.abc import Mapping
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any

import msgspec
import pytest

from palpate.launch.files.source_map import InputError
from palpate.launch.graph import Graph, override, read_settings
from palpate.launch.node_kinds import Entry
from palpate.messages.codec import Header, encode, schema_hash
from palpate.messages.recording.reader import open_recording
from palpate.messages.recording.writer import RecordingWriter
from palpate.messages.types.catalogue import LogRecord
from palpate.messages.types.world import World
from palpate.nodes import tracer
from palpate.nodes.runtime.composed import run_composed
from palpate.nodes.runtime.node import (
    Finished,
    Input,
    Node,
    Outputs,
    Wiring,
    describe_wirings,
    load_node,
    with_description,
)
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.tools.bag.contents import compare_recordings
from palpate.tools.cli import command_line as cli
from palpate.tools.replay.comparison import ChangeNote, FieldChange, TopicComparison
from palpate.tools.replay.exchange import ReplayNode
from palpate.tools.replay.rerun import change_table, replay, with_settings

Message = tuple[str, int, object]  # Topic, sequence and message, as the recorder received it
Lines = list[str]


class Params(msgspec.Struct, frozen=True, kw_only=True):
    factor: float = 2.0


def log(value, text="sum"):
    return LogRecord(node="adder", level="info", text=text, robot_time=value)


def world(seed):
    return World(platform=0.0, reach=1.0, fingers=1, seed=seed)


def add(params, state, record):
    """The sum so far, in units of the world's seed; says nothing of negative numbers."""
    state += record.robot_time
    outputs: Outputs = [("/sum", log(state * params.factor))] if record.robot_time >= 0 else []
    if record.robot_time > 100.0:
        outputs.append(Finished("enough"))
    return state, outputs


def take_seed(params, state, message):
    return state + message.seed, []


ADDER = Node(
    params=Params,
    start=lambda params: (0.0, [("/sum", log(params.factor, "start"))]),
    inputs={"/world": (World, take_seed), "/number": (LogRecord, add)},
    outputs={"/sum": LogRecord},
    needs=("/world",),
)
INPUTS = (
    Input("simulator", "/world", "/world", "World"),
    Input("source", "/number", "/number", "LogRecord"),
)
TYPES = {"/world": "World", "/number": "LogRecord", "/sum": "LogRecord"}
THREE = read_settings(["adder.factor=3"])
GOOD: list[Message] = [
    ("/sum", 0, log(2.0, "start")),
    ("/number", 0, log(1.0)),  # received before the world, on which the adder waits
    ("/world", 0, world(10)),
    ("/sum", 1, log(22.0)),
    ("/number", 1, log(-1.0)),
    ("/number", 2, log(5.0)),
    ("/sum", 2, log(30.0)),
]


@pytest.fixture
def adder(monkeypatch):
    """Puts the adder where it can be imported; gives the module's name."""
    made = ModuleType("adding")
    made.NODE = ADDER
    monkeypatch.setitem(sys.modules, "adding", made)
    return "adding"


@pytest.fixture
def wiring(adder):
    return Wiring(
        name="adder",
        module=adder,
        params=Params(),
        inputs=INPUTS,
        outputs={"/sum": "/sum"},
        subscribers={},
    )


@pytest.fixture
def record(tmp_path, wiring):
    """Writes messages into a recording of the adder."""

    def write(messages, *, graph=None, schema=0):
        path = tmp_path / "topics.mcap"
        about = {"graph": (describe_wirings([wiring]) if graph is None else graph).decode()}
        path.unlink(missing_ok=True)
        writer = RecordingWriter(path, TYPES, {}, about)
        for topic, seq, message in messages:
            number = schema or schema_hash(type(message))
            writer.write(topic, Header(1, 0, seq, seq, 0.0, number), encode(message))
        writer.close()
        return path

    return write


def play(path, nodes=("adder",), **more):
    """Replay; the exit code, and what is printed."""
    lines = []
    return replay(path, nodes, lines.append, **more), lines


def changed(place, message):
    return [*GOOD[:place], message, *GOOD[place + 1 :]]


def test_a_node_that_says_the_same_is_identical(record):
    code, lines = play(record(GOOD))
    assert (code, lines) == (0, ["adder: identical, 3 on /sum"])


@pytest.mark.parametrize(
    ("messages", "line"),
    [
        (
            changed(6, ("/sum", 2, log(31.0))),
            "adder: differs, /sum 2 robot_time: recorded 31.0, now 30.0",
        ),
        (
            changed(0, ("/sum", 0, log(2.0, "begin"))),
            "adder: differs, /sum 0 text: recorded 'begin', now 'start'",
        ),
        (
            changed(4, ("/number", 1, log(1.0))),
            "adder: differs, /sum 2 robot_time: recorded 30.0, now 24.0",
        ),
        (GOOD[:-1], "adder: differs, /sum 2: published now, but not recorded"),
        (
            [*GOOD, ("/sum", 3, log(30.0))],
            "adder: differs, /sum 3: recorded, but not published again",
        ),
    ],
)
def test_the_first_difference_is_shown(messages, line, record):
    code, lines = play(record(messages))
    assert (code, lines[0]) == (1, line)
    assert lines[1].split()[:4] == ["topic", "field", "compared", "differ"]


def test_a_node_that_raises_now_has_failed_whatever_was_set(record, monkeypatch):
    def fail(params, state, message):
        raise ZeroDivisionError("the step is 0")

    inputs: Mapping[str, Any] = {**ADDER.inputs, "/number": (LogRecord, fail)}
    broken = Node(params=Params, start=ADDER.start, inputs=inputs, outputs=ADDER.outputs)
    monkeypatch.setattr(sys.modules["adding"], "NODE", broken)
    code, lines = play(record(GOOD))
    assert code == 1
    where = "handling /number 0 from source"
    told = " ".join(lines[0].split())  # which is folded at 80 columns
    assert told.startswith(f"adder: fails, ZeroDivisionError {where}: the step is 0 (")
    assert told.endswith(f"test_rerun.py:{fail.__code__.co_firstlineno + 1} in fail)")
    assert replay(record(GOOD), ["adder"], lines.append, settings=THREE) == 1


def test_with_another_parameter_the_table_is_what_was_asked_for(record):
    code, lines = play(record(GOOD), settings=THREE)
    assert code == 0
    assert lines == [
        "adder: differs, /sum 0 robot_time: recorded 2.0, now 3.0",
        "topic  field       compared  differ  first  largest   rms  unit",
        "/sum   robot_time         3       3      0       15  10.8  s",  # by half of 2, 22 and 30
    ]


def test_a_folder_stands_for_its_recording_and_a_node_that_is_named_twice_runs_once(record):
    code, lines = play(record(GOOD).parent, ["adder", "adder"])
    assert code == 0
    assert len(lines) == 1


def test_finishing_is_not_compared(record):
    more = [*GOOD, ("/number", 3, log(200.0)), ("/sum", 3, log(430.0))]
    assert replay(record(more), ["adder"], lambda line: None) == 0


def test_a_recording_that_was_never_closed_is_replayed_as_far_as_it_goes(tmp_path, wiring):
    path = tmp_path / "topics.mcap"
    about = {"graph": describe_wirings([wiring]).decode()}
    writer = RecordingWriter(path, TYPES, {}, about)
    for place, (topic, seq, message) in enumerate(GOOD):
        sent = 10**9 * (1 + place)  # far apart: each is written at once
        header = Header(1, 0, seq, sent, 0.0, schema_hash(type(message)))
        if place < len(GOOD) - 1:
            writer.write(topic, header, encode(message))
    code, lines = play(path)
    writer.close()
    assert code == 0
    assert lines[0].endswith("topics.mcap was never closed: replaying as far as it goes")
    assert lines[1] == "adder: identical, 2 on /sum"


def test_messages_are_handed_over_in_the_order_in_which_they_were_sent(
    tmp_path, wiring, monkeypatch
):
    # Without needs, the world must come before the number, though it was recorded after it.
    hasty = Node(
        params=Params, start=ADDER.start, inputs=ADDER.inputs, outputs=ADDER.outputs, needs=()
    )
    monkeypatch.setattr(sys.modules["adding"], "NODE", hasty)
    path = tmp_path / "topics.mcap"
    writer = RecordingWriter(path, TYPES, {}, {"graph": describe_wirings([wiring]).decode()})
    for (topic, seq, message), sent in zip(GOOD[:4], (1, 3, 2, 4), strict=True):
        header = Header(1, 0, seq, sent, 0.0, schema_hash(type(message)))
        writer.write(topic, header, encode(message))
    writer.close()
    assert replay(path, ["adder"], lambda line: None) == 0


@pytest.mark.parametrize(
    ("nodes", "graph", "words"),
    [
        ("planner", None, r"has no node 'planner'; it has \['adder'\]"),
        ("", None, "has no node that can be replayed exactly"),  # the adder is not palpate's own
        ("adder", ("", ""), "does not say which nodes made it"),
        ("adder", ('"adding"', '"gone_away"'), "no module 'gone_away'"),
        ("adder", ('"adding"', '"palpate.nodes.recorder"'), "adder neither subscribes nor publish"),
        ("adder", ('"local":"/number"', '"local":"/in"'), "adder is wired to /in, which it does"),
        ("adder", ('{"/sum":', '{"/in":'), "adder is wired to /in, which it does not declare; it"),
    ],
)
def test_a_node_that_cannot_be_chosen_is_refused(nodes, graph, words, record, wiring):
    known = describe_wirings([wiring]).decode()
    if graph is not None:
        known = known.replace(*graph) if graph[0] else ""
    with pytest.raises(ValueError, match=words):
        play(record(GOOD, graph=known.encode()), nodes.split())


def test_a_recording_that_lacks_messages_or_is_of_another_version_is_refused(record, tmp_path):
    with pytest.raises(ValueError, match="lacks /number 1: it has 2 instead"):
        play(record([*GOOD[:4], *GOOD[5:]]))
    words = r"/sum was recorded with another version of LogRecord \(schema 0000002a,"
    with pytest.raises(ValueError, match=words):
        play(record(GOOD, schema=42))
    with pytest.raises(ValueError, match="the recording does not exist"):
        replay(tmp_path / "none.mcap")


KINDS = ["simulator", "filter", "curvature", "tracer", "planner", "reconstructor", "evaluator"]


class Deaf:
    """A watcher that does not listen."""

    def ready(self, seconds): ...

    def received(self, topic, message): ...

    def log(self, record): ...

    def tick(self, statuses): ...


def explore(path, contact=50e-6):
    """Recording of a whole exploration of a ball: one contour, and a probe or two."""
    ball = ObjectSpec(
        superquadric=SuperquadricSpec(size=(0.03,) * 3, exponents=(1.0, 1.0)),
        pose=PoseSpec(position=(0.0, 0.0, 0.03)),
    )
    params = {
        "simulator": {"object": msgspec.to_builtins(ball, builtin_types=(bytes,))},
        "filter": {"contact": contact},
        "planner": {"planner": "uniform", "settings": {"count": 1}, "most_touches": 22},
        "recorder": {"path": str(path)},
    }
    entries = tuple(Entry(name=kind, params=params.get(kind, {})) for kind in [*KINDS, "recorder"])
    wirings = with_description(Graph(entries, ends="evaluator").wirings(), {})
    ending = run_composed(wirings, ends="evaluator", watch=(), watcher=Deaf())
    assert ending.status == "finished", ending.reason
    return path


@pytest.fixture(scope="module")
def explored(tmp_path_factory):
    return explore(tmp_path_factory.mktemp("explored") / "topics.mcap")


def test_the_nodes_of_a_real_run_publish_the_same_again(explored):
    code, lines = play(explored, ())
    assert code == 0
    names = [line.partition(":")[0] for line in lines]
    assert names == ["filter", "curvature", "evaluator"]
    assert all(": identical, " in line for line in lines)


def test_nodes_that_receive_from_each_other_publish_the_same_again(explored):
    code, lines = play(explored, KINDS[:5])
    assert code == 0
    assert [line.split()[:2] for line in lines] == [[f"{one}:", "identical,"] for one in KINDS[:5]]


@pytest.mark.slow
def test_all_nodes_together_say_what_a_run_with_that_parameter_says(
    explored, tmp_path, monkeypatch
):
    published: dict[str, list[bytes]] = {}
    take = TopicComparison.add_published

    def keep(comparison, body):
        published.setdefault(comparison.topic, []).append(body)
        take(comparison, body)

    monkeypatch.setattr(TopicComparison, "add_published", keep)
    settings = read_settings(["filter.contact=300e-6"])
    assert replay(explored, KINDS, lambda line: None, settings=settings) == 0
    run: dict[str, list[bytes]] = {}
    other = explore(tmp_path / "topics.mcap", contact=300e-6)
    for kept in open_recording(other).messages():
        run.setdefault(kept.topic, []).append(kept.body)
    assert published == run
    assert compare_recordings(explored, other).topics["/contour/traced"].differ == 1


def test_curvature_receives_what_the_filter_publishes_with_its_new_parameter(explored):
    settings = read_settings(["filter.order=median-first"])
    code, lines = play(explored, ["filter", "curvature"], settings=settings)
    assert code == 0
    assert lines[1].startswith("curvature: differs, /touch/patch ")
    fields = {tuple(line.split()[:2]) for line in lines[3:]}
    assert ("/touch/image", "compression") in fields
    assert ("/touch/patch", "k1") in fields
    assert ("/touch/patch", "pose[0:3]") not in fields  # where the arm was does not depend on it


def test_a_parameter_of_a_node_that_is_not_run_again_is_refused(explored):
    lines = []
    with pytest.raises(InputError, match="'filter' is not among the nodes to run again: curvature"):
        replay(explored, ["curvature"], lines.append, settings=read_settings(["filter.order=none"]))
    assert lines == []


def test_the_verb_takes_the_folder_of_a_run_and_parameters(explored, capsys):
    verb = ["replay", str(explored.parent), "--nodes", "filter, curvature"]
    assert cli.run([*verb, "--set", "filter.order=auto"]) == 0
    assert capsys.readouterr().out.count(": identical, ") == 2
    assert cli.run([*verb, "--set", "filter.order=none", "--set", "filter.contact=100e-6"]) == 0
    assert "\n/touch/image  mask " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("filter.order=median-frist", "filter.order is 'median-frist'; expected one of auto, "),
        ("filter.oder=median", "unknown key 'oder' in filter; did you mean 'order'?"),
        ("planner.most_touches=9", "'planner' is not among the nodes to run again: filter; add"),
    ],
)
def test_a_setting_that_cannot_be_used_is_refused_in_one_sentence(setting, words, explored, capsys):
    assert cli.run(["replay", str(explored), "--nodes", "filter", "--set", setting]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"palpate: --set {setting}: {words}")
    assert err.count("\n") == 1


def test_a_changed_filter_is_found_out(explored, monkeypatch):
    from palpate.nodes import filter as filtering

    inputs = dict(filtering.NODE.inputs)
    cls, handler = inputs["/touch/raw"]

    def off_by_a_bit(params, state, message):
        state, outputs = handler(params, state, message)
        [(topic, image)] = outputs
        image.compression.flat[100] *= 1 + 2**-52
        return state, [(topic, image)]

    inputs["/touch/raw"] = (cls, off_by_a_bit)
    changed = Node(
        params=filtering.NODE.params,
        start=filtering.NODE.start,
        inputs=inputs,
        outputs=filtering.NODE.outputs,
        needs=filtering.NODE.needs,
    )
    monkeypatch.setattr(filtering, "NODE", changed)
    code, lines = play(explored, ["filter"])
    assert code == 1
    assert lines[0].startswith("filter: differs, /touch/image ")
    assert " compression[6, 4]: recorded " in " ".join(lines[0].split())


def tracers(*fingers):
    """Tracers of several fingers."""
    return [
        Wiring(
            name=f"tracer_{finger}",
            module="palpate.nodes.tracer",
            params=tracer.Params(finger=finger),
            inputs=(),
            outputs={"/finger/goal": f"/finger_{finger}/finger/goal"},
            subscribers={},
        )
        for finger in fingers
    ]


def chosen(wirings):
    return [ReplayNode(tracer.NODE, wiring) for wiring in wirings]


def test_a_setting_is_laid_over_the_recorded_parameters():
    wirings = tracers(1, 2)
    again = chosen(wirings)
    found = with_settings(
        again, describe_wirings(wirings), read_settings(["tracer_2.most_touches=90"])
    )
    assert found[0] == again[0]
    assert found[1].wiring.params == tracer.Params(finger=2, most_touches=90)


def test_a_setting_without_a_number_means_the_nodes_of_all_fingers():
    wirings = tracers(1, 2)
    found = with_settings(
        chosen(wirings), describe_wirings(wirings), read_settings(["tracer.most_touches=90"])
    )
    assert [one.wiring.params.most_touches for one in found] == [90, 90]
    assert [one.wiring.params.finger for one in found] == [1, 2]


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("tracer_1.x=1", "'tracer_1' is not among the nodes to run again: tracer_2; add it to"),
        ("tracr.x=1", "there is no node 'tracr'; did you mean 'tracer'?"),
        ("most_touches=1", "must look like planner.tolerance=0.2e-3"),
    ],
)
def test_a_setting_of_another_node_is_refused(setting, words):
    one, other = tracers(1, 2)
    with pytest.raises(InputError) as caught:
        with_settings(chosen([other]), describe_wirings([one, other]), read_settings([setting]))
    assert str(caught.value).startswith(f"--set {setting}: {words}")


@pytest.mark.parametrize(
    "setting", ["filter.oder=median", "filter.order=median-frist", "filter.contact=1"]
)
def test_what_run_refuses_is_refused_in_the_same_words(setting, tmp_path):
    node = load_node("palpate.nodes.filter")
    one = replace(tracers(1)[0], name="filter", module="palpate.nodes.filter", outputs={})
    plain = Graph((Entry(name="filter"),), ends="filter")
    with pytest.raises(InputError) as run:
        override(plain, read_settings([setting])).wirings()
    with pytest.raises(InputError) as again:
        wiring = replace(one, params=node.params())
        with_settings([ReplayNode(node, wiring)], describe_wirings([one]), read_settings([setting]))
    assert str(again.value) == str(run.value)
    assert str(run.value).startswith(f"--set {setting}: ")


def player(fields, *, fewer=0, more=0):
    """A node that says ``/x``, of which 20 messages were compared."""
    changes = SimpleNamespace(fields=fields)
    published = SimpleNamespace(topic="/x", compared=20, fewer=fewer, more=more, changes=changes)
    return SimpleNamespace(publications={"/x": published})


def test_a_field_without_a_size_has_its_note_at_the_end():
    height = FieldChange("m", 3, 12, 4, 0.5, 0.25, {"shape": ChangeNote(2, "(1,)", "(2,)")})
    kind = FieldChange("", 5, 1, notes={"value": ChangeNote(1, "'hit'", "'miss'")})
    count = FieldChange("#", 5, 1, 1, 2.0, 4.0)
    lines = list(change_table([player({"height": height, "kind": kind, "count": count}, fewer=3)]))
    assert lines == [
        "topic  field     compared  differ  first  largest   rms  unit",
        "/x     height          20      12      3      0.5  0.25  m  2 of another shape,",
        "                                                         first (1,) -> (2,)",
        "/x     kind            20       1      5                 1 changed, first 'hit'",
        "                                                         -> 'miss'",
        "/x     count           20       1      5        2     2  count",
        "/x     messages        20             20                 3 fewer than recorded",
    ]


def test_there_is_no_table_where_nothing_has_changed():
    assert list(change_table([player({})])) == []


def test_a_table_of_nothing_but_counts_has_all_heads():
    lines = list(change_table([player({}, more=1)]))
    assert lines == [
        "topic  field     compared  differ  first  largest  rms  unit",
        "/x     messages        20             20                1 more than recorded",
    ]
