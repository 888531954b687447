from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from palpate.launch.launch_file import EXPLORE, Described, describe, find_launch_file
from palpate.launch.located import InputError, Located

Write = Callable[[str, str], Path]

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


def described(path: Path, **args: object) -> Described:
    return describe(path, {k: Located(v, k) for k, v in args.items()}, Path("runs/here"))


def test_a_launch_file_becomes_a_graph(write: Write) -> None:
    graph = described(write("f.yaml", TWO)).graph

    a, b = graph.entries
    assert (a.name, a.module, a.namespace, a.remap) == ("a", "t.a", "one", {"/x": "/z"})
    assert a.params == {"turns": 3, "label": "in runs/here/n3"}
    assert a.places["turns",].endswith("f.yaml:4")
    assert b.module == "palpate.nodes.b"
    assert b.source.endswith("f.yaml:12")
    assert graph.ends == "a"


def test_an_argument_overrides_its_default_and_keeps_its_type(write: Write) -> None:
    found = described(write("f.yaml", TWO), turns=7, loud=False)

    assert [entry.name for entry in found.graph.entries] == ["a"]
    assert found.graph.entries[0].params["turns"] == 7
    assert found.args["label"] == "n7"


def test_the_shipped_launch_file_takes_everything_from_the_scene() -> None:
    found = described(EXPLORE, scene="vase")

    assert found.scene is not None
    entries = {entry.name: entry for entry in found.graph.entries}
    params = entries["simulator"].params
    assert params["seed"] == found.scene.spec.seed == 7
    assert len(params["object"]["lattice"]) == 6
    assert params["reach"] == 0.15
    assert entries["recorder"].params == {"path": "runs/here/topics.mcap"}
    assert found.graph.ends == "evaluator"


def test_what_the_scene_says_of_the_planner_is_placed_in_the_scene(write: Write) -> None:
    scene = write(
        "s.yaml",
        "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"
        "explore:\n  contours: 5\n",
    )

    entries = {e.name: e for e in described(EXPLORE, scene=str(scene)).graph.entries}

    assert entries["planner"].params == {"contours": 5}
    assert entries["planner"].places["contours",] == f"{scene}:4"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nodes: {}", "the document lacks the key 'ends'"),
        ("ends: a\nnoodes: {}", "f.yaml:2: unknown key 'noodes'; did you mean 'nodes'?"),
        (
            "ends: a\nnodes:\n  a: {parms: 1}",
            "f.yaml:3: unknown key 'parms' in nodes.a; did you mean 'params'?",
        ),
        ("ends: a\nnodes:\n  a:\n    kind: 3", "f.yaml:4: nodes.a.kind is 3; expected text"),
        ("ends: a\nnodes: {a: {if: 3}}", "nodes.a.if is 3; expected true or false"),
        ("args: [x]\nends: a\nnodes: {}", "f.yaml:1: args must be a map"),
        ("args: {out: x}\nends: a\nnodes: {}", "f.yaml:1: $(out) is the run directory"),
        ("args: {a: 1}\nends: $(b)\nnodes: {}", "f.yaml:2: $(b) is not known; known: a, out"),
        ("args: {a: {b: 1}}\nends: $(a.c)\nnodes: {}", "$(a.c): there is no 'c'; known: b"),
        ("args: {a: 1}\nends: $(a.c)\nnodes: {}", "$(a.c): there is no 'c'"),
        ("args: {a: [1]}\nends: x$(a)\nnodes: {}", "$(a) is more than a word"),
    ],
)
def test_a_wrong_launch_file_is_refused(write: Write, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        described(write("f.yaml", text))

    assert words in str(caught.value)


def test_an_unknown_argument_is_refused_with_the_nearest(write: Write) -> None:
    with pytest.raises(InputError, match="has no argument 'lout'; did you mean 'loud'"):
        described(write("f.yaml", TWO), lout=1)


def test_a_launch_file_is_found_by_path_and_the_shipped_one_by_name(write: Write) -> None:
    path = write("f.yaml", TWO)

    assert find_launch_file(path) == path
    assert find_launch_file(Path("explore.yaml")) == EXPLORE
    assert find_launch_file(Path("explore")) == EXPLORE


@pytest.mark.parametrize(
    ("name", "words"), [("no.yaml", "does not exist"), ("f.txt", "must end in .yaml or .py")]
)
def test_what_is_no_launch_file_is_refused(name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        find_launch_file(Path(name))


PYTHON = """
from palpate.launch.graph import Entry, Graph

def describe(turns, out="", size=1):
    return Graph((Entry(name="a", kind="t.a", params={"turns": turns, "out": out}),), "a")
"""


def test_a_python_file_describes_its_graph_itself(write: Write) -> None:
    graph = described(write("f.py", PYTHON), turns=4).graph

    assert graph.entries[0].params == {"turns": 4, "out": "runs/here"}


@pytest.mark.parametrize(
    ("text", "args", "words"),
    [
        (PYTHON, {"turns": 1, "siz": 1}, "has no argument 'siz'; did you mean 'size'?"),
        (PYTHON, {"turns": 1, "out": 1}, "has no argument 'out'"),
        (PYTHON, {}, "missing a required argument: 'turns'"),
        ("x = 1", {}, "has no function describe"),
        ("def describe(): return 3", {}, "describe returned 3; it must return a Graph"),
        ("def describe(:", {}, "f.py:1: is not Python"),
    ],
)
def test_a_wrong_python_file_is_refused(
    write: Write, text: str, args: dict[str, object], words: str
) -> None:
    with pytest.raises(InputError) as caught:
        described(write("f.py", text), **args)

    assert words in str(caught.value)


def test_a_python_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        described(tmp_path / "none.py")


def test_what_a_python_launch_file_raises_is_told_with_its_line(tmp_path: Path) -> None:
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
