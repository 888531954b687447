"""What kinds of node, their parameters and message types are: types, units, defaults, comments.

Comments are read from the source, beside or above a field, and are not there for a type that is
known by its schema alone.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec import structs

from palpate.core.plugins import UNITS, in_base_unit
from palpate.launch.files.source_map import InputError, as_input_errors, hint
from palpate.launch.files.yaml_file import parse_yaml
from palpate.launch.node_kinds import Entry, load_entry
from palpate.launch.printing import TEXT_WIDTH
from palpate.launch.processes.registry import RunCard, find_run, running_graphs
from palpate.launch.run_directory import find_bag
from palpate.messages import recording, type_of_schema
from palpate.messages.types import TYPES
from palpate.nodes.runtime.node import RecordedNode, Sink, Source, load_node
from palpate.tools.introspection.echo import TextStyle, field_lines, yaml_lines, yaml_value
from palpate.tools.introspection.requests import find_node, params_of, request

OWN_PACKAGE = "palpate."  # Modules that may be imported to look at what they hold
INDENT = 8  # Columns before the comment of a parameter
_BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}


class Parameter(NamedTuple):
    """One parameter of a node."""

    type: str  # In words, with its bounds
    unit: str  # Empty if it has none
    default: str  # In YAML; empty if it must be given
    help: str  # The comment in the source; empty if there is none


def parameters_of(params: type) -> dict[str, Parameter]:
    """The parameters of a node by name, given their type."""
    made, comments = msgspec.json.schema(params), comments_of(params)
    rules = made["$defs"][made["$ref"].rpartition("/")[2]]["properties"]
    found = {}
    for one in structs.fields(params):
        rule = rules[one.encode_name]
        default = one.default_factory() if callable(one.default_factory) else one.default
        text = "" if one.required else yaml_value(msgspec.to_builtins(default), TextStyle())
        parts = (rule, *rule.get("anyOf", ()))
        unit = next((str(part["description"]) for part in parts if "description" in part), "")
        told = comments.get(one.name, "")
        found[one.encode_name] = Parameter(_in_words(rule), unit, text, told)
    return found


def _in_words(rule: Mapping[str, Any]) -> str:
    """The type that a JSON schema describes."""
    if "$ref" in rule:
        return str(rule["$ref"]).rpartition("/")[2]
    if "enum" in rule:
        return " | ".join(map(str, rule["enum"]))
    if "anyOf" in rule:
        return " or ".join(map(_in_words, rule["anyOf"]))
    if rule.get("type") == "array":
        first: Mapping[str, Any] = next(iter(rule.get("prefixItems", ())), {})
        return f"list of {_in_words(rule.get('items') or first)}"
    if rule.get("type") == "object":
        values = rule.get("additionalProperties")
        return f"table of {_in_words(values)}" if isinstance(values, dict) else "table"
    bounds = [f"{sign} {rule[name]:g}" for name, sign in _BOUNDS.items() if name in rule]
    return " ".join([str(rule.get("type", "anything")), " and ".join(bounds)]).strip()


def comments_of(cls: type) -> dict[str, str]:
    """The comment of each field of a class and those that it rests on, as far as there are any."""
    found: dict[str, str] = {}
    for one in reversed(cls.__mro__):
        with suppress(OSError, TypeError, SyntaxError):  # it has no source in Python
            found |= _comments(textwrap.dedent(inspect.getsource(one)))
    return found


def _comments(source: str) -> Iterator[tuple[str, str]]:
    lines = source.splitlines()
    (made,) = ast.parse(source).body
    for field in made.body if isinstance(made, ast.ClassDef) else ():
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            _, mark, beside = lines[(field.end_lineno or 0) - 1].rpartition("  # ")
            above = takewhile(lambda line: line.lstrip()[:1] == "#", lines[field.lineno - 2 :: -1])
            told = [line.lstrip("# ") for line in above][::-1]
            yield field.target.id, beside if mark else " ".join(told)


def describe_kind(name: str) -> dict[str, Any]:
    """What a kind of node is, its topics with their types, and its parameters.

    Of a sink and of a source the topics are None. Raises InputError if there is no such kind.
    """
    entry = Entry(name=name, kind=name)
    node = load_entry(entry)
    told, _, _ = (inspect.getdoc(sys.modules[entry.module]) or "").partition("\n\n")
    inputs, outputs = None, None
    if not isinstance(node, Sink | Source):
        inputs = {topic: kind.__name__ for topic, (kind, _) in node.inputs.items()}
        outputs = {topic: kind.__name__ for topic, kind in node.outputs.items()}
    return {
        "kind": name,
        "told": told,
        "sink": isinstance(node, Sink),
        "subscribes": inputs,
        "publishes": outputs,
        "parameters": {one: about._asdict() for one, about in parameters_of(node.params).items()},
        "settable": list(getattr(node, "settable", ())),
    }


def kind_text(kind: Mapping[str, Any]) -> str:
    """The same for people."""
    lines = [kind["kind"], *_paragraph(kind["told"], 2)]
    if kind["sink"]:
        lines.append("  subscribes to everything")
    elif kind["subscribes"] is None:
        lines.append("  subscribes to nothing; its parameters tell what it publishes")
    for what in ("subscribes", "publishes"):
        topics = kind[what] or {}
        lines += [f"  {what:<10} {topic}  {type_name}" for topic, type_name in topics.items()]
    for param, about in kind["parameters"].items():
        need = f"default {about['default']}" if about["default"] else "required"
        unit = f"  {about['unit']}" if about["unit"] else ""
        may = "  settable" if param in kind["settable"] else ""
        takes = f"  takes {param}  {about['type']}{unit}  {need}{may}"
        lines += textwrap.wrap(takes, TEXT_WIDTH, subsequent_indent=" " * INDENT)
        lines += _paragraph(about["help"], INDENT)
    return "\n".join(lines)


def _paragraph(text: str, indent: int) -> list[str]:
    """A text as lines of 80 columns, so many of them blank."""
    blank = " " * indent
    return textwrap.wrap(
        " ".join(text.split()), TEXT_WIDTH, initial_indent=blank, subsequent_indent=blank
    )


def describe_param(card: RunCard, name: str, param: str) -> dict[str, Any]:
    """The value of a parameter, with type, unit, default and comment where they are known.

    ``a.b`` is an entry within a parameter. Raises ValueError if there is no such node or parameter.
    """
    node = find_node(card, name)
    value = params_of(node)
    for part in param.split("."):
        if not isinstance(value, dict) or part not in value:
            known = value if isinstance(value, dict) else ()
            raise ValueError(f"{node.name} has no parameter {param!r}; {hint(part, known)}")
        value = value[part]
    # One's own module is left be: it is not imported to be looked at.
    ours = node.module.startswith(OWN_PACKAGE)
    about = parameters_of(load_node(node.module).params).get(param) if ours else None
    return {"value": value, **{k: t for k, t in (about._asdict() if about else {}).items() if t}}


def param_text(described: Mapping[str, Any]) -> str:
    """The same in YAML, in which the default is already."""
    told = {key: value for key, value in described.items() if key != "default"}
    default = [f"default: {described['default']}"] if "default" in described else []
    return "\n".join([*yaml_lines(told), *default])


def set_parameter(card: RunCard, name: str, param: str, value: str) -> str:
    """Set a parameter between two messages; returns what it was and is.

    `value` is in YAML; a length or a time may have a unit, as ``0.1mm``, and is in SI without one.
    Raises ValueError if there is no such node, the parameter cannot be set while it runs, or the
    node refuses the value; InputError if the unit is none of the parameter's.
    """
    node = find_node(card, name)
    made = parse_yaml(value, "VALUE").value
    units = UNITS.get(_unit_of(node, param))
    if isinstance(made, str) and units is not None:
        try:
            made = in_base_unit(made, units)
        except ValueError as error:
            raise InputError(f"{param} {made}: {error}") from None
    request(card, "set", node=node.name, param=param, value=msgspec.json.encode(made).decode())
    was, now = (yaml_value(x, TextStyle(flow=True)) for x in (params_of(node)[param], made))
    return f"{node.name}.{param}: {was} -> {now}"


def _unit_of(node: RecordedNode, param: str) -> str:
    """The unit of a parameter, as far as it is known without importing the user's modules."""
    if not node.module.startswith(OWN_PACKAGE):
        return ""
    about = parameters_of(load_node(node.module).params).get(param)
    return "" if about is None else about.unit


def known_interfaces(run: str | None, bag: Path | None) -> dict[str, str]:
    """Message types by name with their schemas: palpate's, and those of a graph or a recording.

    Without `run` and `bag` they are those of the graph that is meant, if one runs. Raises
    InputError if there is no such graph or recording.
    """
    found: Mapping[str, str] = {}
    with as_input_errors():
        if bag is not None:
            found = recording.open_recording(find_bag(bag)).schemas
        elif run is not None or running_graphs():
            found = find_run(run).schemas
    return dict(sorted({**found, **dict.fromkeys(TYPES, "")}.items()))


def find_interface(name: str, known: Mapping[str, str]) -> type:
    """A message type; ValueError if it is not among those that are known, or has no schema."""
    if name not in known:
        raise ValueError(f"there is no type {name!r}; {hint(name, known)}")
    return TYPES.get(name) or type_of_schema(known[name])


def interface_text(cls: type) -> str:
    """What a message type is: a line for each field, with type and unit, and its comment below."""
    comments = comments_of(cls) if cls.__name__ in TYPES else {}
    lines = [cls.__name__]
    for part in (inspect.getdoc(cls) or "").split("\n\n"):
        lines += [*_paragraph(part, 2), ""]
    for line in field_lines(cls):
        lines += [f"  {line}", *_paragraph(comments.get(line.split()[0], ""), INDENT)]
    return "\n".join(lines)
