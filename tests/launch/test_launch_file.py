import re
from pathlib import Path

import pytest

from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.graph import resolved_text
from palpate.launch.launch_file import arguments_table, describe, list_arguments
from palpate.launch.launch_source import EXPLORE, find_launch_file

TWO = """
args:
  loud: true
  turns: 3
  label: n$(turns)
nodes:
  a:
    kind: t.a
    params: {turns: $(turns), label: in $(out)/$(label)}
    remap: {/x: /z}
    namespace: one
  b:
    if: $(loud)
ends: a
"""


def described(path, **args):
    return describe(path, {k: SourceMapped(v, k) for k, v in args.items()}, Path("runs/here"))


def test_a_launch_file_becomes_a_graph_and_arguments_override_defaults(write):
    graph = described(write("f.yaml", TWO)).graph
    a, b = graph.entries
    assert (a.name, a.module, a.namespace, a.remap) == ("a", "t.a", "one", {"/x": "/z"})
    assert a.params == {"turns": 3, "label": "in runs/here/n3"}
    assert a.places["turns",].endswith("f.yaml:4")
    assert b.module == "palpate.nodes.b"
    assert b.source.endswith("f.yaml:12")
    assert graph.ends == "a"
    found = described(write("f.yaml", TWO), turns=7, loud=False)
    assert [entry.name for entry in found.graph.entries] == ["a"]
    assert found.graph.entries[0].params["turns"] == 7
    assert found.args["label"] == "n7"
    with pytest.raises(InputError, match="has no argument 'lout'; did you mean 'loud'"):
        described(write("f.yaml", TWO), lout=1)


def test_the_shipped_launch_file_takes_everything_from_the_scene():
    found = described(EXPLORE, scene="vase")
    assert found.scene is not None
    entries = {entry.name: entry for entry in found.graph.entries}
    params = entries["simulator"].params
    assert params["seed"] == found.scene.spec.seed == 7
    assert len(params["object"]["lattice"]) == 6
    assert params["reach"] == 0.15
    assert entries["recorder"].params == {"path": "runs/here/topics.mcap"}
    assert found.graph.ends == "evaluator"


def test_what_the_scene_tells_of_the_planner_is_placed_in_the_scene(write):
    scene = write(
        "s.yaml",
        "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"
        "explore:\n  tolerance: 0.5e-3\n",
    )
    entries = {e.name: e for e in described(EXPLORE, scene=str(scene)).graph.entries}
    assert entries["planner"].params == {"tolerance": 0.5e-3}
    assert entries["planner"].places["tolerance",] == f"{scene}:4"


@pytest.mark.parametrize(("text", "words"), [
    ("nodes: {}", "the document lacks the key 'ends'"),
    ("ends: a\nnoodes: {}", "f.yaml:2: unknown key 'noodes'; did you mean 'nodes'?"),
    ("ends: a\nnodes:\n  a: {parms: 1}",
     "f.yaml:3: unknown key 'parms' in nodes.a; did you mean 'params'?"),
    ("ends: a\nnodes:\n  a:\n    kind: 3", "f.yaml:4: nodes.a.kind is 3; expected text"),
    ("ends: a\nnodes: {a: {if: 3}}", "nodes.a.if is 3; expected true or false"),
    ("args: [x]\nends: a\nnodes: {}", "f.yaml:1: args must be a map"),
    ("args: {out: x}\nends: a\nnodes: {}", "f.yaml:1: $(out) is the run directory"),
    ("args: {finger: x}\nends: a\nnodes: {}", "f.yaml:1: $(finger) is the number of a finger"),
    ("ends: a\nnodes:\n  a:\n    fingers: 9", "f.yaml:4: fingers must be 1 to 8, got 9"),
    ("ends: a\nnodes: {a: {fingers: 0}}", "f.yaml:2: fingers must be 1 to 8, got 0"),
    ("ends: a\nnodes: {a: {fingers: 2.0}}", "fingers must be 1 to 8, got 2.0"),
    ("ends: a\nnodes: {a: {fingers: true}}", "fingers must be 1 to 8, got True"),
    ("ends: a\nnodes: {a: {fingers: }}", "fingers must be 1 to 8, got None"),
    ("ends: a\nnodes:\n  a:\n    fingers: 1\n    namespace: b",
     "f.yaml:5: node 'a': a node with fingers has its namespace from them"),
    ("ends: a\nnodes: {a: {fingers: 2, nise: 1}}",
     "f.yaml:2: unknown key 'nise' in nodes.a; did you mean 'nice'?"),
    ("ends: a\nnodes:\n  a:\n    on_exit: respawn", "f.yaml:4: "),
    ("ends: a\nnodes: {a: {on_exit: respawn}}", "respawn"),
    ("ends: a\nnodes: {a: {params: {n: $(finger)}}}", "f.yaml:2: $(finger) is not known"),
    ("args: {a: 1}\nends: $(b)\nnodes: {}", "f.yaml:2: $(b) is not known; known: a, out"),
    ("args: {a: {b: 1}}\nends: $(a.c)\nnodes: {}", "$(a.c): there is no 'c'; known: b"),
    ("args: {a: 1}\nends: $(a.c)\nnodes: {}", "$(a.c): there is no 'c'"),
    ("args: {a: [1]}\nends: x$(a)\nnodes: {}", "$(a) is more than a word"),
])  # fmt: skip
def test_a_wrong_launch_file_is_refused(write, text, words):
    with pytest.raises(InputError, match=re.escape(words)):
        described(write("f.yaml", text))


EACH = """
args:
  hands: 2
nodes:
  a:
    fingers: $(hands)
    params: {number: $(finger), of: $(hands), label: finger $(finger)}
    nice: 3
    on_exit: ignore
  b: {kind: t.b}
ends: b
"""


def test_there_is_a_node_for_each_finger_and_one_alone_has_no_namespace(write):
    one, two, b = described(write("f.yaml", EACH)).graph.entries
    assert (one.name, one.module, one.namespace) == ("a_1", "palpate.nodes.a", "finger_1")
    assert (two.name, two.module, two.namespace) == ("a_2", "palpate.nodes.a", "finger_2")
    assert [entry.finger for entry in (one, two, b)] == [1, 2, 0]
    assert [entry.group for entry in (one, two, b)] == ["a", "a", "b"]
    assert two.params == {"number": 2, "of": 2, "label": "finger 2"}
    assert (one.nice, two.nice) == (3, 3)
    assert (one.on_exit, two.on_exit, b.on_exit) == ("ignore", "ignore", "restart")
    assert one.source.endswith("f.yaml:5") and two.source.endswith("f.yaml:5")
    assert two.places["label",].endswith("f.yaml:7")
    assert (b.name, b.namespace) == ("b", "")
    a, _ = described(write("f.yaml", EACH), hands=1).graph.entries
    assert (a.name, a.namespace, a.finger) == ("a", "", 0)
    assert a.params == {"number": 1, "of": 1, "label": "finger 1"}
    with pytest.raises(InputError, match=r"^hands: fingers must be 1 to 8, got 12$"):
        described(write("f.yaml", EACH), hands=12)


def test_only_the_sensing_nodes_of_the_shipped_launch_file_are_there_for_each_finger():
    found = {
        entry.name: entry for entry in described(EXPLORE, scene="vase", fingers=3).graph.entries
    }
    each = ("simulator", "filter", "curvature", "tracer")
    assert set(found) == {f"{kind}_{n}" for kind in each for n in (1, 2, 3)} | {
        *("planner", "reconstructor", "evaluator", "recorder")
    }
    assert [found[f"tracer_{n}"].params["finger"] for n in (1, 2, 3)] == [1, 2, 3]
    assert (found["simulator_3"].params["finger"], found["simulator_3"].params["fingers"]) == (3, 3)


def test_the_resolved_graph_of_several_fingers_is_a_launch_file_of_the_same_graph(write):
    graph = described(EXPLORE, scene="sphere", fingers=2, record=False).graph
    text = resolved_text(graph, graph.wirings(), Path("out"))
    first, again = (
        {one.name: (one.module, one.params, set(one.inputs), one.outputs) for one in wirings}
        for wirings in (graph.wirings(), described(write("again.yaml", text)).graph.wirings())
    )
    assert again == first


def test_a_launch_file_is_found_by_path_and_the_shipped_one_by_name(write):
    path = write("f.yaml", TWO)
    assert find_launch_file(path) == path
    assert find_launch_file(Path("explore.yaml")) == EXPLORE
    assert find_launch_file(Path("explore")) == EXPLORE


@pytest.mark.parametrize(
    ("name", "words"), [("no.yaml", "does not exist"), ("f.txt", "must end in .yaml or .py")]
)
def test_what_is_no_launch_file_is_refused(name, words):
    with pytest.raises(InputError, match=words):
        find_launch_file(Path(name))


PYTHON = """
from palpate.launch.node_kinds import Entry
from palpate.launch.graph import Graph

def describe(turns, out="", size=1):
    return Graph((Entry(name="a", kind="t.a", params={"turns": turns, "out": out}),), "a")
"""


def test_a_python_file_describes_its_graph_itself_if_it_is_there(write, tmp_path):
    graph = described(write("f.py", PYTHON), turns=4).graph
    assert graph.entries[0].params == {"turns": 4, "out": "runs/here"}
    with pytest.raises(InputError, match="does not exist"):
        described(tmp_path / "none.py")


@pytest.mark.parametrize(("text", "args", "words"), [
    (PYTHON, {"turns": 1, "siz": 1}, "has no argument 'siz'; did you mean 'size'?"),
    (PYTHON, {"turns": 1, "out": 1}, "has no argument 'out'"),
    (PYTHON, {}, "missing a required argument: 'turns'"),
    ("x = 1", {}, "has no function describe"),
    ("def describe(): return 3", {}, "describe returned 3; it must return a Graph"),
    ("def describe(:", {}, "f.py:1: is not Python"),
])  # fmt: skip
def test_a_wrong_python_file_is_refused(write, text, args, words):
    with pytest.raises(InputError, match=re.escape(words)):
        described(write("f.py", text), **args)


def test_what_a_python_launch_file_raises_is_told_with_its_line(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("def describe():\n    raise RuntimeError('no arm')\n")
    with pytest.raises(InputError, match=rf"{path}:2: RuntimeError: no arm"):
        describe(path, {}, tmp_path)
    path.write_text("import a_module_that_is_not_there\n")
    with pytest.raises(InputError, match=rf"{path}:1: ModuleNotFoundError"):
        describe(path, {}, tmp_path)
    path.write_text("raise SystemExit(9)\n")
    with pytest.raises(InputError, match=rf"{path}:1: SystemExit: 9"):
        describe(path, {}, tmp_path)


def written(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


def rows(text):
    """Lines of the table, with one blank between two words."""
    return [" ".join(line.split()) for line in text.splitlines()[2:]]


def test_arguments_are_shown_with_default_and_comment_if_there_are_any(tmp_path):
    shown = rows(arguments_table(EXPLORE, list_arguments(EXPLORE)))
    assert "scene vase name of a shipped scene, or a path" in shown
    assert "seed $(scene.seed)" in shown
    assert "record true keep every message in topics.mcap" in shown
    path = written(tmp_path, "graph.yaml", "nodes: {}\nends: x\n")
    assert arguments_table(path, list_arguments(path)) == f"{path} takes no arguments"


@pytest.mark.parametrize(
    ("line", "row"),
    [
        ("a: 'x # y'  # real", "a x # y real"),
        ("a: it's # so", "a it's so"),
        ("a:  # empty", "a null empty"),
        ("a: ''", 'a ""'),
        ("a: 0.5\n  # of its own", "a 0.5"),
        ("{a: 1}  # all", "a 1"),
    ],
)
def test_a_comment_is_what_stands_behind_the_argument(tmp_path, line, row):
    path = written(tmp_path, "graph.yaml", f"args:\n  {line}\nnodes: {{}}\nends: x\n")
    assert rows(arguments_table(path, list_arguments(path))) == [row]


def test_of_python_the_parameters_of_describe_are_shown_and_it_is_not_called(tmp_path):
    text = (
        "def describe(turns: int = 3, *, name, out: str, speed: 'float | None' = None, **more):\n"
    )
    path = written(tmp_path, "graph.py", text + "    raise SystemExit('called')\n")
    assert rows(arguments_table(path, list_arguments(path))) == [
        "turns int 3",
        "name required",
        "speed float | None None",
    ]


@pytest.mark.parametrize(("name", "text", "words"), [
    ("graph.yaml", "args: [1]\n", "args must be a map of names to defaults"),
    ("graph.yaml", "args: {a: &b 1}\n", "anchors and aliases"),
    ("graph.py", "describe = 3", "has no function describe"),
    ("graph.py", "1 / 0", "ZeroDivisionError"),
])  # fmt: skip
def test_a_file_that_cannot_be_used_is_refused(tmp_path, name, text, words):
    with pytest.raises(InputError, match=words):
        list_arguments(written(tmp_path, name, text))


def test_an_argument_within_the_scene_changes_one_of_its_values():
    args = {
        "scene.sensor.pitch": SourceMapped(1.2e-3, "typed"),
        "scene": SourceMapped("sphere", ""),
    }
    described = describe(EXPLORE, args, Path("out"))
    (simulator,) = (one for one in described.graph.entries if one.name == "simulator")
    assert simulator.params["sensor"]["pitch"] == 1.2e-3
    assert described.scene is not None and "pitch: 0.0012" in described.scene.text


@pytest.mark.parametrize("name", ["scene.", "scen.sensor.pitch", "seed.x"])
def test_what_is_within_no_scene_is_no_argument(name):
    with pytest.raises(InputError, match=f"typed: .*has no argument '{name}'"):
        describe(EXPLORE, {name: SourceMapped(1, "typed")}, Path("out"))
