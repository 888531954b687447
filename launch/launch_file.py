"""Launch files: descriptions of graphs in YAML or, where logic is needed, in Python.

A YAML file contains only data. A Python launch file is a module with ``describe(**args) -> Graph``:
a program that the user chooses to run, and trusts.
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

# Meanings of references ``$(name)`` that no argument may have.
RESERVED = {"out": "the run directory", "finger": "the number of a finger"}


class NodeSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One node of a launch file."""

    # A module of palpate.nodes, ``module:NODE`` or a user's dotted module; empty: the node's name
    kind: str = ""
    params: dict[str, Any] = {}  # parameters; of a list of maps in the file, the last value counts
    remap: dict[str, str] = {}  # topics on the wire by the node's names of topics
    # Number of fingers, each of which has such a node with its number in ``$(finger)``.
    fingers: int | None = None
    namespace: str = ""  # prefix of its topics
    host: str = ""  # address of the machine on which it runs; empty: this one
    nice: Annotated[int, Meta(ge=0, le=19)] = 0  # of its process, as in nice(1)
    on_exit: OnExit = "restart"  # if its process dies: restart, stop the run, or ignore it
    wanted: bool = field(default=True, name="if")  # key ``if`` in the file; False omits the node


class LaunchSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All keys of a launch file."""

    args: dict[str, Any] = {}  # arguments with defaults
    nodes: dict[str, Any]  # by name
    ends: str  # node whose Finished ends the graph
    # Robot time per wall time: 1 for a real robot; as fast as it is computed if None.
    rate: Annotated[float, Meta(gt=0, le=1000)] | None = None


@dataclass(frozen=True, slots=True)
class LaunchDescription:
    """The contents of a launch file with its arguments."""

    graph: Graph  # not checked yet
    scene: Scene | None  # that it explores, if it has an argument ``scene``
    args: Mapping[str, Any]  # values of its arguments


def describe(path: Path, args: Mapping[str, SourceMapped], out: Path) -> LaunchDescription:
    """The graph of a ``.yaml`` file, or of a ``.py`` file with ``describe(**args) -> Graph``.

    An argument ``scene.sensor.pitch`` replaces a value of the scene's file. `out`: the run
    directory, ``$(out)``, which need not exist. Raises InputError if a file cannot be used.
    """
    if path.suffix == ".py":
        plain = {name: value.value for name, value in args.items()}
        return LaunchDescription(describe_python(path, args, out), None, plain)
    search_inputs(path.parent)
    document = read_with_includes(path, find_launch_file)
    known, scene = _arguments(document, args, out, path.parent)
    graph = _graph(document, known)
    return LaunchDescription(graph, scene, {name: value.value for name, value in known.items()})


def _arguments(
    document: SourceMapped, args: Mapping[str, SourceMapped], out: Path, folder: Path
) -> tuple[dict[str, SourceMapped], Scene | None]:
    """Values of references: the run directory, and the arguments in the order declared."""
    declared = declared_args(document)
    paths = {name: key_path(f".{name}")[1:] for name in args if name.startswith("scene.")}
    for name, value in args.items():
        if name not in declared and not ("scene" in declared and paths.get(name)):
            text = f"{document.source} has no argument {name!r}; {hint(name, declared)}"
            raise value.error((), text)
    known = {"out": SourceMapped(str(out), "")}
    scene = None
    for name in declared:
        if name in RESERVED:
            raise document.error(
                ("args", name), f"$({name}) is {RESERVED[name]}; choose another name"
            )
        known[name] = args.get(name) or substitute(document.part(("args", name)), known)
        if name == "scene":
            changes = {path: args[arg] for arg, path in paths.items()}
            beside = folder / str(known[name].value)  # as in the folder of a run
            is_beside = name not in args and beside.is_file()
            scene = load_scene(str(beside if is_beside else known[name].value), changes)
            known[name] = scene.located
    return known, scene


def _graph(document: SourceMapped, known: Mapping[str, SourceMapped]) -> Graph:
    """The graph; references are replaced node by node, since ``$(finger)`` differs."""
    rest = {key: value for key, value in document.value.items() if key not in ("args", "nodes")}
    filled = substitute(replace(document, value=rest), known)
    nodes = {key: value for key, value in document.value.items() if key == "nodes"}
    spec = convert(replace(filled, value={**filled.value, **nodes}), LaunchSpec)
    entries = [
        entry
        for name in spec.nodes
        for entry in _entries(name, document.part(("nodes", name)), known)
    ]
    return Graph(tuple(entries), spec.ends, filled.place(("ends",)), spec.rate or 0.0)


def _entries(name: str, document: SourceMapped, known: Mapping[str, SourceMapped]) -> list[Entry]:
    """Entries of a node of the file: one, one for each finger, or none."""
    if not (isinstance(document.value, dict) and "fingers" in document.value):
        return _wanted_entries(name, name, substitute(document, known))
    if "namespace" in document.value:
        raise document.error(
            ("namespace",), f"node {name!r}: a node with fingers has its namespace from them"
        )
    count = substitute(document.part(("fingers",)), known)
    fingers = count.value
    if type(fingers) is not int or not 1 <= fingers <= MAX_FINGERS:
        raise count.error((), f"fingers must be 1 to {MAX_FINGERS}, got {fingers!r:.60}")
    entries = []
    for finger in range(1, fingers + 1):
        number = SourceMapped(finger, document.place(("fingers",)))
        node, node_name = substitute(document, {**known, "finger": number}), name
        if fingers > 1:
            node_name = f"{name}_{finger}"
            value = {"kind": name, **node.value, "namespace": f"finger_{finger}"}
            node = replace(node, value=value)
        entries += _wanted_entries(name, node_name, node)
    return entries


def _wanted_entries(key: str, name: str, document: SourceMapped) -> list[Entry]:
    """The entry of a node with key `key` in the file; none if the node is not wanted."""
    document = _with_merged_params(document, key)
    spec = NodeSpec() if document.value is None else convert(document, NodeSpec, f"nodes.{key}")
    places = document.part(("params",)).places if spec.params else {}
    own = {key: value for key, value in asdict(spec).items() if key not in ("fingers", "wanted")}
    return [Entry(name=name, source=document.source, places=places, **own)] if spec.wanted else []


def _with_merged_params(document: SourceMapped, key: str) -> SourceMapped:
    """A node whose list of maps of parameters is merged into one map; the last value counts."""
    listed = document.value.get("params") if isinstance(document.value, dict) else None
    if not isinstance(listed, list):
        return document
    merged: dict[str, Any] = {}
    places = {at: place for at, place in document.places.items() if at[:1] != ("params",)}
    for number, params in enumerate(listed):
        part = document.part(("params", number))
        if not isinstance(params, dict):
            raise part.error((), f"nodes.{key}.params has {params!r:.60}; expected a map")
        merged |= params
        places = {
            at: place for at, place in places.items() if at[1:2] not in {(key,) for key in params}
        }
        places |= {("params", *at): place for at, place in part.places.items() if at}
    return replace(document, value={**document.value, "params": merged}, places=places)


def describe_python(path: Path, args: Mapping[str, SourceMapped], out: Path) -> Graph:
    """The graph that the file's ``describe`` returns.

    A parameter ``out`` of ``describe`` gets the run directory. Raises InputError if there is no
    such file or function, an argument is unknown or missing, or it returns no Graph.
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
    """The arguments of a launch file, each with its default.

    An argument of a YAML file has the comment behind it as help. A Python file is run up to its
    ``describe``, and its arguments have types. Raises InputError if the file cannot be used.
    """
    is_python = path.suffix == ".py"
    keys = ("argument", "type", "default") if is_python else ("argument", "default", "help")
    rows = _python_rows(path) if is_python else _yaml_rows(path)
    return [dict(zip(keys, row, strict=True)) for row in rows]


def arguments_table(path: Path, arguments: Sequence[Mapping[str, str]]) -> str:
    """A table of the arguments of a launch file."""
    if not arguments:
        return f"{path} takes no arguments"
    head = ["" if key == "help" else key for key in arguments[0]]
    rows = [list(argument.values()) for argument in arguments]
    return "\n".join([f"{path} takes, each as NAME:=VALUE", *text_table([head, *rows])])


def _python_rows(path: Path) -> Iterator[tuple[str, str, str]]:
    for name, parameter in inspect.signature(load_describe(path)).parameters.items():
        if name != "out" and parameter.kind not in (
            parameter.VAR_POSITIONAL,
            parameter.VAR_KEYWORD,
        ):
            kind = inspect.formatannotation(parameter.annotation).strip("'")
            default = (
                "required" if parameter.default is parameter.empty else repr(parameter.default)
            )
            yield name, "" if parameter.annotation is parameter.empty else kind, default


def load_describe(path: Path) -> Callable[..., Any]:
    """The function ``describe`` of a launch file, which is run.

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
    """Run the user's program; its exceptions become an InputError with its line."""
    try:
        return act()
    except (InputError, SyntaxError, KeyboardInterrupt):
        raise
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == str(path)]
        place = f"{path}:{lines[-1]}" if lines else str(path)
        raise InputError(f"{place}: {type(error).__name__}: {error}") from None


def _yaml_rows(path: Path) -> Iterator[tuple[str, str, str]]:
    declared = declared_args(read_with_includes(path, find_launch_file))
    comments = _comments(path) if declared_args(read_yaml(path)) else {}
    for name, value in declared.items():
        plain = isinstance(value, str) and value
        text = plain or json.dumps(value, default=str, ensure_ascii=False)
        yield name, text, comments.get(name, "")


def declared_args(document: SourceMapped) -> dict[str, Any]:
    """The declared arguments of a launch file, with defaults as written."""
    declared = document.value.get("args") or {}
    if not isinstance(declared, dict):
        raise document.error(("args",), "args must be a map of names to defaults")
    return declared


def _comments(path: Path) -> dict[str, str]:
    """The comment behind each argument of a file that is already checked."""
    args = YAML(typ="rt", pure=True).load(path.read_text(encoding="utf-8"))["args"]
    comments = {}
    for name, tokens in args.ca.items.items():
        text = next((token.value for token in tokens[2:] if hasattr(token, "value")), "")
        first = text.partition("\n")[0]
        comments[name] = " ".join(first.lstrip("#").split())
    return comments
