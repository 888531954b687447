"""Launch files: arguments, includes, conditions, fingers, Python; every fault with its line."""

import re
from pathlib import Path

import pytest

from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.graph import resolved_text
from palpate.launch.launch_file import arguments_table, describe, list_arguments
from palpate.launch.launch_source import EXPLORE, find_exploration, find_launch_file, named_modules

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


def entries(path, **args):
    return {entry.name: entry for entry in described(path, **args).graph.entries}


def test_launch_file_becomes_graph_and_arguments_override_defaults(write):
    graph = described(write("f.yaml", TWO)).graph
    a, b = graph.entries
    assert (a.name, a.module, a.namespace, a.remap) == ("a", "t.a", "one", {"/x": "/z"})
    assert a.params == {"turns": 3, "label": "in runs/here/n3"}
    assert a.places["turns",].endswith("f.yaml:4")
    assert b.module == "palpate.nodes.b" and b.source.endswith("f.yaml:12")
    assert graph.ends == "a"
    description = described(write("f.yaml", TWO), turns=7, loud=False)
    assert [entry.name for entry in description.graph.entries] == ["a"]
    assert description.graph.entries[0].params["turns"] == 7
    assert description.args["label"] == "n7"
    with pytest.raises(InputError, match="has no argument 'lout'; did you mean 'loud'"):
        described(write("f.yaml", TWO), lout=1)


def test_shipped_launch_file_takes_everything_from_the_scene_and_nothing_else(write):
    description = described(EXPLORE, scene="vase")
    assert description.scene is not None and description.graph.ends == "evaluator"
    by_name = {entry.name: entry for entry in description.graph.entries}
    params = by_name["simulator"].params
    assert params["seed"] == description.scene.spec.seed == 7
    assert len(params["object"]["lattice"]) == 6 and params["reach"] == 0.15
    assert by_name["recorder"].params == {"path": "runs/here/topics.mcap"}
    text = "object:\n  sphere: {radius: 0.04}\nexplore:\n  tolerance: 0.5e-3\n"
    scene = write("s.yaml", text)
    planner = entries(EXPLORE, scene=str(scene))["planner"]
    assert planner.params == {"tolerance": 0.5e-3}
    assert planner.places["tolerance",] == f"{scene}:4"
    for name in ("scene.", "scen.sensor.pitch", "seed.x"):
        with pytest.raises(InputError, match=f"typed: .*has no argument '{name}'"):
            describe(EXPLORE, {name: SourceMapped(1, "typed")}, Path("out"))


@pytest.mark.parametrize(("text", "words"), [
    ("ends: a\nnoodes: {}", "f.yaml:2: unknown key 'noodes'; did you mean 'nodes'?"),
    ("ends: a\nnodes: {a: {if: 3}}", "nodes.a.if is 3; expected true or false"),
    ("args: [x]\nends: a\nnodes: {}", "f.yaml:1: args must be a map"),
    ("args: {out: x}\nends: a\nnodes: {}", "f.yaml:1: $(out) is the run directory"),
    ("args: {finger: x}\nends: a\nnodes: {}", "f.yaml:1: $(finger) is the number of a finger"),
    ("ends: a\nnodes:\n  a:\n    fingers: 9", "f.yaml:4: fingers must be 1 to 8, got 9"),
    ("ends: a\nnodes: {a: {fingers: 0}}", "f.yaml:2: fingers must be 1 to 8, got 0"),
    ("ends: a\nnodes: {a: {fingers: true}}", "fingers must be 1 to 8, got True"),
    ("ends: a\nnodes:\n  a:\n    fingers: 1\n    namespace: b",
     "f.yaml:5: node 'a': a node with fingers has its namespace from them"),
    ("ends: a\nnodes: {a: {fingers: 2, nise: 1}}",
     "f.yaml:2: unknown key 'nise' in nodes.a; did you mean 'nice'?"),
    ("ends: a\nnodes: {a: {on_exit: respawn}}", "respawn"),
    ("ends: a\nnodes: {a: {params: {n: $(finger)}}}", "f.yaml:2: $(finger) is not known"),
    ("args: {a: 1}\nends: $(b)\nnodes: {}", "f.yaml:2: $(b) is not known; known: a, out"),
    ("args: {a: {b: 1}}\nends: $(a.c)\nnodes: {}", "$(a.c): there is no 'c'; known: b"),
    ("args: {a: [1]}\nends: x$(a)\nnodes: {}", "$(a) is more than a word"),
])  # fmt: skip
def test_wrong_launch_file_is_refused(write, text, words):
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


def test_node_with_fingers_is_there_for_each_also_in_the_resolved_graph(write):
    file = write("f.yaml", EACH)
    first, second, b = described(file).graph.entries
    assert [entry.name for entry in (first, second, b)] == ["a_1", "a_2", "b"]
    assert [entry.namespace for entry in (first, second, b)] == ["finger_1", "finger_2", ""]
    assert [entry.finger for entry in (first, second, b)] == [1, 2, 0]
    assert [entry.group for entry in (first, second, b)] == ["a", "a", "b"]
    assert [entry.on_exit for entry in (first, second, b)] == ["ignore", "ignore", "restart"]
    assert second.params == {"number": 2, "of": 2, "label": "finger 2"}
    assert (first.module, first.nice, second.nice) == ("palpate.nodes.a", 3, 3)
    assert first.source.endswith("f.yaml:5") and second.source.endswith("f.yaml:5")
    assert second.places["label",].endswith("f.yaml:7")
    a, _ = described(file, hands=1).graph.entries
    assert (a.name, a.namespace, a.finger) == ("a", "", 0)
    assert a.params == {"number": 1, "of": 1, "label": "finger 1"}
    with pytest.raises(InputError, match=r"^hands: fingers must be 1 to 8, got 12$"):
        described(file, hands=12)
    graph = described(EXPLORE, scene="sphere", fingers=2, record=False).graph
    text = resolved_text(graph, graph.wirings(), Path("out"))
    first, again = (
        {one.name: (one.module, one.params, set(one.inputs), one.outputs) for one in wirings}
        for wirings in (graph.wirings(), described(write("again.yaml", text)).graph.wirings())
    )
    assert again == first
    sensing = ("simulator", "filter", "curvature", "tracer")
    alone = ("planner", "reconstructor", "evaluator")
    assert set(first) == {*alone, *(f"{kind}_{n}" for kind in sensing for n in (1, 2))}
    assert (first["simulator_2"][1].finger, first["simulator_2"][1].fingers) == (2, 2)


BASE = """
args:
  turns: 3
  box: {a: 1, b: 2}
nodes:
  a:
    kind: t.a
    params:
      turns: $(turns)
      box: {a: 1, b: 2}
    remap: {/x: /z}
  b:
    params: $(box)
ends: a
"""


def test_included_graph_and_listed_parameters_are_laid_over_each_other(write):
    base = write("base.yaml", BASE)
    assert entries(write("f.yaml", "include: base.yaml\n")) == entries(base)
    write("middle.yaml", "include: base.yaml\nargs: {turns: 5}\n")
    assert entries(write("f.yaml", "include: middle.yaml\n"))["a"].params["turns"] == 5
    own = """include: base.yaml
args: {turns: 4, box: {c: 3}, more: $(turns)}
nodes:
  a:
    params: {box: {c: 3}, more: $(more)}
  c:
    kind: t.c
ends: c
"""
    path = write("f.yaml", own)
    nodes = entries(path)
    assert list(nodes) == ["a", "b", "c"]
    assert nodes["a"].params == {"turns": 4, "box": {"c": 3}, "more": 4}
    assert (nodes["a"].kind, nodes["a"].remap) == ("t.a", {"/x": "/z"})
    assert nodes["b"].params == {"c": 3}
    assert (nodes["a"].places["turns",], nodes["a"].source) == (f"{path}:2", f"{path}:4")
    left = entries(write("g.yaml", "include: base.yaml\nnodes:\n  a:\n  b: {if: false}\n"))
    assert list(left) == ["a"] and left["a"].params["turns"] == 3
    assert left["a"].places["turns",] == f"{base}:3"
    assert left["a"].places["box", "a"] == f"{base}:10"
    write("base.yaml", BASE.replace("    params:\n", "    oops:\n"))
    with pytest.raises(InputError, match=rf"{base}:8: unknown key 'oops'"):
        entries(path)
    text = """args: {box: {a: 1, b: 2}}
nodes:
  a:
    kind: t.a
    params: [$(box), {b: 3, c: 4}]
ends: a
"""
    path = write("listed.yaml", text)
    node = entries(path)["a"]
    assert node.params == {"a": 1, "b": 3, "c": 4}
    assert (node.places["a",], node.places["b",]) == (f"{path}:1", f"{path}:5")
    write("base.yaml", text.replace("[$(box), {b: 3, c: 4}]", "$(box)"))
    path = write("f.yaml", "include: base.yaml\nnodes:\n  a:\n    params: {b: 5}\n")
    node = entries(path, box={"a": 7, "b": 8})["a"]
    assert node.params == {"a": 7, "b": 5} and node.places["b",] == f"{path}:4"
    with pytest.raises(InputError, match=r"nodes\.a\.params has 1; expected a map"):
        entries(write("f.yaml", text.replace("$(box)", "1")))


def test_shipped_file_is_included_by_name_unless_one_lies_beside(write):
    path = write("f.yaml", "include: explore.yaml\nnodes:\n  extra: {kind: t.c}\n")
    assert entries(path, scene="sphere").keys() == {*entries(EXPLORE), "extra"}
    write("explore.yaml", BASE)
    assert list(entries(path)) == ["a", "b", "extra"]
    assert find_launch_file(path) == path
    assert {find_launch_file(Path(name)) for name in ("explore.yaml", "explore")} == {EXPLORE}
    assert find_exploration() == EXPLORE
    assert find_exploration("planar") == find_launch_file(Path("planar"))
    assert find_exploration(system="thesis") == find_launch_file(Path("thesis"))
    assert find_exploration(system="palpate") == EXPLORE
    for asked, words in (
        (("plane",), "--procedure plane: must be one of containment, planar"),
        ((None, "ours"), "--system ours: must be one of palpate, thesis"),
        (("planar", "thesis"), "--procedure planar and --system thesis exclude"),
    ):
        with pytest.raises(InputError, match=words):
            find_exploration(*asked)
    for name, words in (("no.yaml", "does not exist"), ("f.txt", "must end in .yaml or .py")):
        with pytest.raises(InputError, match=words):
            find_launch_file(Path(name))


@pytest.mark.parametrize(("text", "words"), [
    ("include: f.yaml", "f.yaml:1: includes f.yaml, which includes this file"),
    ("ends: a\ninclude: g.yaml", "g.yaml:1: includes f.yaml, which includes this file"),
    ("include: no.yaml", "no.yaml: the launch file does not exist"),
    ("include: [a]", r"f.yaml:1: include is \['a'\]; expected the name of a launch file"),
    ("include: h.py", "f.yaml:1: includes h.py, which is no YAML"),
    ("include: base.yaml\nnodes: 3", "f.yaml:2: nodes is 3; expected map"),
    ("include: base.yaml\nargs: 3", "f.yaml:2: args must be a map"),
])  # fmt: skip
def test_wrong_include_is_refused(write, text, words):
    for name, other in (("base.yaml", BASE), ("g.yaml", "include: f.yaml"), ("h.py", "")):
        write(name, other)
    with pytest.raises(InputError, match=words):
        entries(write("f.yaml", text))


@pytest.mark.parametrize(("text", "words"), [
    ("from palpate.nodes.filter import NODE as NODE", "subscribes to /touch/info, which no node"),
    ("NODE = 1/0", "module '{}' breaks: ZeroDivisionError: division by zero"),
    ("def", "module '{}' breaks: SyntaxError: invalid syntax"),
    ("import palpate_test_no", "no module '{}': No module named 'palpate_test_no'"),
    ("from palpate.nodes.driver import SOURCE", "module '{}' holds no NODE"),
    (None, "no module '{}'"),
])  # fmt: skip
def test_module_of_ones_own_is_a_kind_or_refused(write, here, text, words):
    name = f"palpate_test_{abs(hash(text))}"
    if text is not None:
        write(f"{name}.py", f"{text}\n")
    path = write("f.yaml", f"nodes: {{a: {{kind: '{name}:NODE'}}}}\nends: a")
    graph = describe(path, {}, here).graph
    assert graph.entries[0].module == name
    with pytest.raises(InputError, match=f"f.yaml:1: node 'a': {words.format(name)}"):
        graph.wirings()
    wrong = write("g.yaml", f"nodes: {{a: {{kind: '{name}:Node'}}}}\nends: a")
    with pytest.raises(InputError, match=r"is named as module:NODE"):
        describe(wrong, {}, here).graph.wirings()


@pytest.mark.parametrize(("text", "modules"), [
    ("nodes: {a: {kind: filter}, b: {kind: my_lab.b}, tracer: }", "filter my_lab.b tracer"),
    ("nodes: {filter: {kind: 3}}", "filter"),
    ("nodes: [filter]", ""),
    ("ends: filter", ""),
    ("nodes: {filter", ""),
])  # fmt: skip
def test_modules_are_known_before_the_file_is_checked(write, tmp_path, text, modules):
    names = [name if "." in name else f"palpate.nodes.{name}" for name in modules.split()]
    assert named_modules(write("graph.yaml", text)) == tuple(names)
    python = write("graph.py", "raise SystemExit")
    assert named_modules(python) == named_modules(tmp_path / "none.yaml") == ()
    sensing = "simulator filter curvature tracer"
    kinds = f"{sensing} planner reconstructor evaluator recorder".split()
    assert sorted(named_modules(EXPLORE)) == sorted(f"palpate.nodes.{kind}" for kind in kinds)


PYTHON = """
from palpate.launch.node_kinds import Entry
from palpate.launch.graph import Graph

def describe(turns, out="", size=1):
    return Graph((Entry(name="a", kind="t.a", params={"turns": turns, "out": out}),), "a")
"""


def test_python_file_describes_its_graph_itself(write, tmp_path):
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
    ("def describe():\n    raise RuntimeError('no arm')\n", {}, "f.py:2: RuntimeError: no arm"),
    ("import a_module_that_is_not_there\n", {}, "f.py:1: ModuleNotFoundError"),
    ("raise SystemExit(9)\n", {}, "f.py:1: SystemExit: 9"),
])  # fmt: skip
def test_wrong_python_file_is_refused(write, text, args, words):
    with pytest.raises(InputError, match=re.escape(words)):
        described(write("f.py", text), **args)


def rows(path):
    """Lines of the table of arguments, with one blank between two words."""
    text = arguments_table(path, list_arguments(path))
    return [" ".join(line.split()) for line in text.splitlines()[2:]]


@pytest.mark.parametrize(("line", "row"), [
    ("a: 'x # y'  # real", "a x # y real"),
    ("a: it's # so", "a it's so"),
    ("a:  # empty", "a null empty"),
    ("a: ''", 'a ""'),
    ("a: 0.5\n  # of its own", "a 0.5"),
    ("{a: 1}  # all", "a 1"),
])  # fmt: skip
def test_arguments_are_shown_with_default_and_comment(write, line, row):
    assert rows(write("graph.yaml", f"args:\n  {line}\nnodes: {{}}\nends: x\n")) == [row]
    shown = rows(EXPLORE)
    assert "scene vase name of a shipped scene, or a path" in shown
    assert {"seed $(scene.seed)", "record true keep every message in topics.mcap"} < set(shown)
    path = write("graph.yaml", "nodes: {}\nends: x\n")
    assert arguments_table(path, list_arguments(path)) == f"{path} takes no arguments"
    text = "turns: int = 3, *, name, out: str, speed: 'float | None' = None, **more"
    shown = rows(write("graph.py", f"def describe({text}):\n    raise SystemExit('called')\n"))
    assert shown == ["turns int 3", "name required", "speed float | None None"]
    for name, text, words in (
        ("graph.yaml", "args: [1]\n", "args must be a map of names to defaults"),
        ("graph.py", "1 / 0", "ZeroDivisionError"),
    ):
        with pytest.raises(InputError, match=words):
            list_arguments(write(name, text))
