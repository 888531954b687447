import subprocess
import sys
from pathlib import Path

import pytest

from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.launch_file import describe
from palpate.launch.launch_source import EXPLORE, named_modules

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


def entries(path, **args):
    given = {name: SourceMapped(value, name) for name, value in args.items()}
    found = describe(path, given, Path("out")).graph
    return {entry.name: entry for entry in found.entries}


def test_an_included_graph_is_taken_as_it_is_and_may_include(write):
    base = write("base.yaml", BASE)
    assert entries(write("f.yaml", "include: base.yaml\n")) == entries(base)
    write("base.yaml", BASE)
    write("middle.yaml", "include: base.yaml\nargs: {turns: 5}\n")
    assert entries(write("f.yaml", "include: middle.yaml\n"))["a"].params["turns"] == 5


def test_nodes_are_added_and_changed_and_left_out(write):
    write("base.yaml", BASE)
    own = """
include: base.yaml
args: {turns: 4, box: {c: 3}, more: $(turns)}
nodes:
  a:
    params: {box: {c: 3}, more: $(more)}
  c:
    kind: t.c
ends: c
"""
    found = entries(write("f.yaml", own))
    assert list(found) == ["a", "b", "c"]
    assert found["a"].params == {"turns": 4, "box": {"c": 3}, "more": 4}
    assert (found["a"].kind, found["a"].remap) == ("t.a", {"/x": "/z"})
    assert found["b"].params == {"c": 3}
    left = write("g.yaml", "include: base.yaml\nnodes:\n  a:\n  b: {if: false}\n")
    assert list(entries(left)) == ["a"]
    assert entries(left)["a"].params["turns"] == 3


def test_what_was_included_is_placed_in_its_own_file(write):
    base = write("base.yaml", BASE)
    path = write("f.yaml", "include: base.yaml\nnodes:\n  a:\n    params: {more: 1}\n")
    found = entries(path)["a"]
    assert found.places["turns",] == f"{base}:3"
    assert found.places["box", "a"] == f"{base}:10"
    assert found.places["more",] == f"{path}:4"
    assert found.source == f"{path}:3"
    with pytest.raises(InputError, match=rf"{base}:8: unknown key 'oops'"):
        write("base.yaml", BASE.replace("    params:\n", "    oops:\n"))
        entries(path)


def test_shipped_files_are_included_by_name_and_those_beside_come_first(write):
    path = write("f.yaml", "include: explore.yaml\nnodes:\n  extra: {kind: t.c}\n")
    assert entries(path, scene="sphere").keys() == {*entries(EXPLORE), "extra"}
    write("explore.yaml", BASE)
    assert list(entries(path)) == ["a", "b", "extra"]


@pytest.mark.parametrize(("text", "words"), [
    ("include: f.yaml", "f.yaml:1: includes f.yaml, which includes this file"),
    ("ends: a\ninclude: g.yaml", "g.yaml:1: includes f.yaml, which includes this file"),
    ("include: no.yaml", "no.yaml: the launch file does not exist"),
    ("include: [a]", r"f.yaml:1: include is \['a'\]; expected the name of a launch file"),
    ("include: ''", "f.yaml:1: include is ''; expected"),
    ("include: h.py", "f.yaml:1: includes h.py, which is no YAML"),
    ("include: base.yaml\nnoodes: {}", "f.yaml:2: unknown key 'noodes'"),
    ("include: base.yaml\nnodes: 3", "f.yaml:2: nodes is 3; expected map"),
    ("include: base.yaml\nargs: 3", "f.yaml:2: args must be a map"),
])  # fmt: skip
def test_a_wrong_include_is_refused(write, text, words):
    write("base.yaml", BASE)
    write("g.yaml", "include: f.yaml")
    write("h.py", "")
    with pytest.raises(InputError, match=words):
        entries(write("f.yaml", text))


def test_a_module_of_ones_own_is_a_kind(write, here):
    write("palpate_test_own.py", "from palpate.nodes.filter import NODE as NODE\n")
    path = write("f.yaml", "nodes: {a: {kind: 'palpate_test_own:NODE'}}\nends: a")
    graph = describe(path, {}, here).graph
    assert graph.entries[0].module == "palpate_test_own"
    with pytest.raises(
        InputError, match="node 'a': subscribes to /touch/info, which nobody publishes"
    ):
        graph.wirings()
    wrong = write("g.yaml", "nodes: {a: {kind: 'palpate_test_own:Node'}}\nends: a")
    with pytest.raises(InputError, match=r"is named as module:NODE"):
        describe(wrong, {}, here).graph.wirings()
    for text, words in {
        "NODE = 1/0": "module 'palpate_test_bad0' breaks: ZeroDivisionError: division by zero",
        "def": "module 'palpate_test_bad1' breaks: SyntaxError: invalid syntax",
        "import palpate_test_no": "no module 'palpate_test_bad2': No module named 'palpate_test_",
        "from palpate.nodes.driver import SOURCE": "module 'palpate_test_bad3' holds no NODE",
    }.items():
        name = words.split("'")[1]
        write(f"{name}.py", text)
        bad = write("b.yaml", f"nodes: {{a: {{kind: '{name}:NODE'}}}}\nends: a")
        with pytest.raises(InputError, match=f"b.yaml:1: node 'a': {words}"):
            describe(bad, {}, here).graph.wirings()
    none = write("h.yaml", "nodes: {a: {kind: 'palpate_test_no:NODE'}}\nends: a")
    with pytest.raises(InputError, match=r"no module 'palpate_test_no'"):
        describe(none, {}, here).graph.wirings()


def test_the_modules_of_the_shipped_graph_are_known_without_reading_it_whole():
    names = [name.removeprefix("palpate.nodes.") for name in named_modules(EXPLORE)]
    kinds = "simulator filter curvature tracer planner reconstructor evaluator recorder"
    assert names[0] == "simulator" and sorted(names) == sorted(kinds.split())


@pytest.mark.parametrize(("text", "modules"), [
    ("nodes: {a: {kind: filter}, b: {kind: my_lab.b}, tracer: }", "filter my_lab.b tracer"),
    ("nodes: {filter: {kind: 3}}", "filter"),
    ("nodes: [filter]", ""),
    ("ends: filter", ""),
    ("nodes: {filter", ""),
])  # fmt: skip
def test_a_fault_is_left_to_be_told_later(tmp_path, text, modules):
    path = tmp_path / "graph.yaml"
    path.write_text(text)
    names = [name if "." in name else f"palpate.nodes.{name}" for name in modules.split()]
    assert named_modules(path) == tuple(names)


def test_nothing_is_known_of_a_launch_file_in_python_or_of_none(tmp_path):
    path = tmp_path / "graph.py"
    path.write_text("raise SystemExit")
    assert named_modules(path) == named_modules(tmp_path / "none.yaml") == ()


def test_nothing_heavy_is_imported_before_the_server_is_woken():
    script = "import palpate.launch.launch_source, sys; print({'numpy', 'zmq'} & set(sys.modules))"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout == "set()\n"
