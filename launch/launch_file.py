"""A launch file: the graph as a user writes it down, in YAML or, where logic is needed, in Python.

In YAML nothing but data is read. A Python launch file is a module with ``describe(**args) ->
Graph``: a program that the user chose to run, trusted like any other.
"""

from __future__ import annotations

import inspect
import json
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta, Struct, field
from msgspec.structs import asdict
from ruamel.yaml import YAML

from palpate.launch.files.source_map import InputError, SourceMapped, hint, key_path
from palpate.launch.files.yaml_file import convert, read_yaml
from palpate.launch.graph import Graph
from palpate.launch.launch_source import find_launch_file, read_with_includes, substitute
from palpate.launch.node_kinds import Entry, search_inputs
from palpate.launch.printing import text_table
from palpate.launch.scene import Scene, load_scene
from palpate.nodes.runtime.node import MAX_FINGERS, OnExit

# What ``$(name)`` stands for without an argument of that name.
RESERVED = {"out": "the run directory", "finger": "the number of a finger"}


class NodeSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One node of a launch file."""

    # A module of palpate.nodes, ``module:NODE`` or a dotted module of one's own; the node's name if
    # left out.
    kind: str = ""
    params: dict[str, Any] = {}  # Its parameters; a list of maps in the file, later ones count
    remap: dict[str, str] = {}  # Topic as the node calls it, to the topic on the wire
    # One such node for each of so many fingers, whose number is ``$(finger)``.
    fingers: int | None = None
    namespace: str = ""  # Put before its topics
    host: str = ""  # Address of the machine on which it runs; this one if left out
    # How far the process stands back when the processor is busy, as in nice(1).
    nice: Annotated[int, Meta(ge=0, le=19)] = 0
    # What is done when its process dies: restart, stop (the run) or ignore.
    on_exit: OnExit = "restart"
    wanted: bool = field(default=True, name="if")  # False leaves it out; written ``if`` in the file


class LaunchSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that a launch file may hold."""

    args: dict[str, Any] = {}  # What may be set from outside, and its default
    nodes: dict[str, Any]  # The nodes by name
    ends: str  # The node whose Finished ends the graph
    # Robot time that passes in a second, 1 for a robot's own pace; as fast as can be if left out.
    rate: Annotated[float, Meta(gt=0, le=1000)] | None = None


@dataclass(frozen=True, slots=True)
class LaunchDescription:
    """What a launch file comes to."""

    graph: Graph  # The graph, not yet checked
    scene: Scene | None  # The scene that it explores, if it has an argument of that name
    args: Mapping[str, Any]  # Its arguments as they came out


def describe(path: Path, args: Mapping[str, SourceMapped], out: Path) -> LaunchDescription:
    """The graph of a ``.yaml`` file, or of a ``.py`` file with ``describe(**args) -> Graph``.

    An argument ``scene.sensor.pitch`` is laid over what the scene's file says. `out` is the run
    directory, ``$(out)``, which need not exist. InputError if either cannot be used.
    """
    if path.suffix == ".py":
        plain = {name: value.value for name, value in args.items()}
        return LaunchDescription(describe_python(path, args, out), None, plain)
    search_inputs(path.parent)
    given = read_with_includes(path, find_launch_file)
    known, scene = _arguments(given, args, out, path.parent)
    graph = _graph(given, known)
    return LaunchDescription(graph, scene, {name: value.value for name, value in known.items()})


def _arguments(
    given: SourceMapped, args: Mapping[str, SourceMapped], out: Path, folder: Path
) -> tuple[dict[str, SourceMapped], Scene | None]:
    """What references may name: the run directory, and the arguments in the order declared."""
    declared = declared_args(given)
    paths = {name: key_path(f".{name}")[1:] for name in args if name.startswith("scene.")}
    for name, value in args.items():
        if name not in declared and not ("scene" in declared and paths.get(name)):
            text = f"{given.source} has no argument {name!r}; {hint(name, declared)}"
            raise value.error((), text)
    known = {"out": SourceMapped(str(out), "")}
    scene = None
    for name in declared:
        if name in RESERVED:
            raise given.error(("args", name), f"$({name}) is {RESERVED[name]}; choose another name")
        known[name] = args.get(name) or substitute(given.part(("args", name)), known)
        if name == "scene":
            changes = {path: args[one] for one, path in paths.items()}
            beside = folder / str(known[name].value)  # as in the folder of a run
            found = beside if name not in args and beside.is_file() else known[name].value
            scene = load_scene(str(found), changes)
            known[name] = scene.located
    return known, scene


def _graph(given: SourceMapped, known: Mapping[str, SourceMapped]) -> Graph:
    """The graph; the nodes are filled in one by one, for each may mean another finger."""
    rest = {key: value for key, value in given.value.items() if key not in ("args", "nodes")}
    filled = substitute(replace(given, value=rest), known)
    nodes = {key: value for key, value in given.value.items() if key == "nodes"}
    spec = convert(replace(filled, value={**filled.value, **nodes}), LaunchSpec)
    entries = [
        entry for name in spec.nodes for entry in _entries(name, given.part(("nodes", name)), known)
    ]
    return Graph(tuple(entries), spec.ends, filled.place(("ends",)), spec.rate or 0.0)


def _entries(name: str, given: SourceMapped, known: Mapping[str, SourceMapped]) -> list[Entry]:
    """What a node of the file comes to: one entry, one for each finger, or none."""
    if not (isinstance(given.value, dict) and "fingers" in given.value):
        return _entry_unless_left_out(name, name, substitute(given, known))
    if "namespace" in given.value:
        raise given.error(
            ("namespace",), f"node {name!r}: a node with fingers has its namespace from them"
        )
    asked = substitute(given.part(("fingers",)), known)
    fingers = asked.value
    if type(fingers) is not int or not 1 <= fingers <= MAX_FINGERS:
        raise asked.error((), f"fingers must be 1 to {MAX_FINGERS}, got {fingers!r:.60}")
    entries = []
    for finger in range(1, fingers + 1):
        number = SourceMapped(finger, given.place(("fingers",)))
        one = substitute(given, {**known, "finger": number})
        if fingers > 1:
            one = replace(one, value={"kind": name, **one.value, "namespace": f"finger_{finger}"})
        entries += _entry_unless_left_out(name, f"{name}_{finger}" if fingers > 1 else name, one)
    return entries


def _entry_unless_left_out(key: str, name: str, given: SourceMapped) -> list[Entry]:
    """The entry of a filled-in node, unless it is left out; the file has it under the key."""
    given = _with_laid_params(given, key)
    spec = NodeSpec() if given.value is None else convert(given, NodeSpec, f"nodes.{key}")
    places = given.part(("params",)).places if spec.params else {}
    own = {key: value for key, value in asdict(spec).items() if key not in ("fingers", "wanted")}
    return [Entry(name=name, source=given.source, places=places, **own)] if spec.wanted else []


def _with_laid_params(given: SourceMapped, key: str) -> SourceMapped:
    """A node whose parameters are one map, where the file lists several: later ones count."""
    listed = given.value.get("params") if isinstance(given.value, dict) else None
    if not isinstance(listed, list):
        return given
    laid: dict[str, Any] = {}
    places = {at: place for at, place in given.places.items() if at[:1] != ("params",)}
    for number, params in enumerate(listed):
        part = given.part(("params", number))
        if not isinstance(params, dict):
            raise part.error((), f"nodes.{key}.params has {params!r:.60}; expected a map")
        laid |= params
        places = {
            at: place for at, place in places.items() if at[1:2] not in {(one,) for one in params}
        }
        places |= {("params", *at): place for at, place in part.places.items() if at}
    return replace(given, value={**given.value, "params": laid}, places=places)


def describe_python(path: Path, args: Mapping[str, SourceMapped], out: Path) -> Graph:
    """The graph that the file's ``describe`` returns.

    The run directory is handed over if ``describe`` has a parameter ``out``. Raises InputError if
    there is no such file or function, an argument is unknown or missing, or it gives no Graph.
    """
    function = load_describe(path)
    signature = inspect.signature(function)
    values: dict[str, Any] = {name: value.value for name, value in args.items()}
    for name, value in args.items():
        if name not in signature.parameters or name == "out":
            known = hint(name, signature.parameters)
            raise value.error((), f"{path} has no argument {name!r}; {known}")
    if "out" in signature.parameters:
        values["out"] = str(out)
    try:
        signature.bind(**values)
    except TypeError as error:
        raise InputError(f"{path}: describe: {error}; give it as NAME:=VALUE") from None
    graph = _call(path, lambda: function(**values))
    if not isinstance(graph, Graph):
        raise InputError(f"{path}: describe returned {graph!r:.60}; it must return a Graph")
    return graph


def list_arguments(path: Path) -> list[dict[str, str]]:
    """The arguments that a launch file takes; nothing is started.

    Of a YAML file the comment behind an argument is its explanation; of a Python file, which is run
    up to its ``describe``, the type is told. Raises InputError if the file cannot be used.
    """
    python = path.suffix == ".py"
    keys = ("argument", "type", "default") if python else ("argument", "default", "help")
    rows = _python_rows(path) if python else _yaml_rows(path)
    return [dict(zip(keys, row, strict=True)) for row in rows]


def arguments_table(path: Path, arguments: Sequence[Mapping[str, str]]) -> str:
    """A table of the arguments that a launch file takes."""
    if not arguments:
        return f"{path} takes no arguments"
    head = ["" if key == "help" else key for key in arguments[0]]
    rows = [list(one.values()) for one in arguments]
    return "\n".join([f"{path} takes, each as NAME:=VALUE", *text_table([head, *rows])])


def _python_rows(path: Path) -> Iterator[tuple[str, str, str]]:
    for name, one in inspect.signature(load_describe(path)).parameters.items():
        if name != "out" and one.kind not in (one.VAR_POSITIONAL, one.VAR_KEYWORD):
            kind = inspect.formatannotation(one.annotation).strip("'")
            default = "required" if one.default is one.empty else repr(one.default)
            yield name, "" if one.annotation is one.empty else kind, default


def load_describe(path: Path) -> Callable[..., Any]:
    """The function ``describe`` of a launch file, which is run up to its end.

    Raises InputError if there is no such file or function, or running the file fails.
    """
    spec = spec_from_file_location("palpate_launch_file", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InputError(f"{path}: the launch file does not exist")
    module = module_from_spec(spec)
    loader = spec.loader
    try:
        _call(path, lambda: loader.exec_module(module))
    except SyntaxError as error:
        raise InputError(f"{path}:{error.lineno}: is not Python: {error.msg}") from None
    function = getattr(module, "describe", None)
    if not callable(function):
        raise InputError(f"{path}: has no function describe; it must return a Graph")
    return function  # type: ignore[no-any-return]


def _call(path: Path, act: Callable[[], Any]) -> Any:
    """Run the user's program; what it raises is told with its own line."""
    try:
        return act()
    except (InputError, SyntaxError, KeyboardInterrupt):
        raise
    except (Exception, SystemExit) as error:  # The edge of the user's program.
        frames = traceback.extract_tb(error.__traceback__)
        lines = [one.lineno for one in frames if one.filename == str(path)]
        place = f"{path}:{lines[-1]}" if lines else str(path)
        raise InputError(f"{place}: {type(error).__name__}: {error}") from None


def _yaml_rows(path: Path) -> Iterator[tuple[str, str, str]]:
    declared = declared_args(read_with_includes(path, find_launch_file))
    comments = _comments(path) if declared_args(read_yaml(path)) else {}
    for name, value in declared.items():
        plain = isinstance(value, str) and value
        text = plain or json.dumps(value, default=str, ensure_ascii=False)
        yield name, text, comments.get(name, "")


def declared_args(given: SourceMapped) -> dict[str, Any]:
    """The arguments that a launch file declares, and their defaults as written."""
    declared = given.value.get("args") or {}
    if not isinstance(declared, dict):
        raise given.error(("args",), "args must be a map of names to defaults")
    return declared


def _comments(path: Path) -> dict[str, str]:
    """What stands behind each argument of a file that was read and found harmless."""
    args = YAML(typ="rt", pure=True).load(path.read_text(encoding="utf-8"))["args"]
    found = {}
    for name, tokens in args.ca.items.items():
        text = next((token.value for token in tokens[2:] if hasattr(token, "value")), "")
        first = text.partition("\n")[0]
        found[name] = " ".join(first.lstrip("#").split())
    return found
