"""Descriptions of kinds of nodes, parameters and message types: types, units, defaults, comments.

Comments are read from the source, beside or above a field; a type that is known only by its schema
has none.
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

OWN_PACKAGE = "palpate."  # of modules that may be imported for a description
_BOUNDS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}


class Parameter(NamedTuple):
    """One parameter of a node."""

    type: str  # in words, with its bounds
    unit: str  # empty without one
    default: str  # in YAML; empty if the parameter is required
    help: str  # comment in the source; empty without one


def parameters_of(params: type) -> dict[str, Parameter]:
    """Parameters by name, from the type of a node's parameters."""
    described, comments = msgspec.json.schema(params), comments_of(params)
    rules = described["$defs"][described["$ref"].rpartition("/")[2]]["properties"]
    parameters = {}
    for field in structs.fields(params):
        rule = rules[field.encode_name]
        default = field.default_factory() if callable(field.default_factory) else field.default
        text = "" if field.required else yaml_value(msgspec.to_builtins(default), TextStyle())
        parts = (rule, *rule.get("anyOf", ()))
        unit = next((str(part["description"]) for part in parts if "description" in part), "")
        comment = comments.get(field.name, "")
        parameters[field.encode_name] = Parameter(_in_words(rule), unit, text, comment)
    return parameters


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
    """Comments of the fields of a class and its base classes, by name, where there are any."""
    comments: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        with suppress(OSError, TypeError, SyntaxError):  # it has no source in Python
            comments |= _comments(textwrap.dedent(inspect.getsource(base)))
    return comments


def _comments(source: str) -> Iterator[tuple[str, str]]:
    lines = source.splitlines()
    (statement,) = ast.parse(source).body
    for field in statement.body if isinstance(statement, ast.ClassDef) else ():
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            _, mark, comment = lines[(field.end_lineno or 0) - 1].rpartition("  # ")
            above = takewhile(lambda line: line.lstrip()[:1] == "#", lines[field.lineno - 2 :: -1])
            words = [line.lstrip("# ") for line in above][::-1]
            yield field.target.id, comment if mark else " ".join(words)


def describe_kind(name: str) -> dict[str, Any]:
    """Description of a kind of node, its topics with their types, and its parameters.

    The topics of a sink and of a source are None. Raises InputError if there is no such kind.
    """
    entry = Entry(name=name, kind=name)
    node = load_entry(entry)
    summary, _, _ = (inspect.getdoc(sys.modules[entry.module]) or "").partition("\n\n")
    inputs, outputs = None, None
    if not isinstance(node, Sink | Source):
        inputs = {topic: kind.__name__ for topic, (kind, _) in node.inputs.items()}
        outputs = {topic: kind.__name__ for topic, kind in node.outputs.items()}
    return {
        "kind": name,
        "told": summary,
        "sink": isinstance(node, Sink),
        "subscribes": inputs,
        "publishes": outputs,
        "parameters": {
            param: about._asdict() for param, about in parameters_of(node.params).items()
        },
        "settable": list(getattr(node, "settable", ())),
    }


def kind_text(kind: Mapping[str, Any], indent: int = 8) -> str:
    """Lines about a kind of node; `indent` of comments."""
    lines = [kind["kind"], *_paragraph(kind["told"], 2)]
    if kind["sink"]:
        lines.append("  subscribes to everything")
    elif kind["subscribes"] is None:
        lines.append("  subscribes to nothing; its parameters define what it publishes")
    for what in ("subscribes", "publishes"):
        topics = kind[what] or {}
        lines += [f"  {what:<10} {topic}  {type_name}" for topic, type_name in topics.items()]
    for param, about in kind["parameters"].items():
        need = f"default {about['default']}" if about["default"] else "required"
        unit = f"  {about['unit']}" if about["unit"] else ""
        may = "  settable" if param in kind["settable"] else ""
        takes = f"  takes {param}  {about['type']}{unit}  {need}{may}"
        lines += textwrap.wrap(takes, TEXT_WIDTH, subsequent_indent=" " * indent)
        lines += _paragraph(about["help"], indent)
    return "\n".join(lines)


def _paragraph(text: str, indent: int) -> list[str]:
    """A text as lines of 80 columns, the first `indent` of them blank."""
    blank = " " * indent
    return textwrap.wrap(
        " ".join(text.split()), TEXT_WIDTH, initial_indent=blank, subsequent_indent=blank
    )


def describe_param(card: RunCard, name: str, param: str) -> dict[str, Any]:
    """The value of a parameter, with type, unit, default and comment where they are known.

    ``a.b`` is an entry of a parameter. Raises ValueError if there is no such node or parameter.
    """
    node = find_node(card, name)
    value = params_of(node)
    for part in param.split("."):
        if not isinstance(value, dict) or part not in value:
            known = value if isinstance(value, dict) else ()
            raise ValueError(f"{node.name} has no parameter {param!r}; {hint(part, known)}")
        value = value[part]
    # A module of a user is not imported for a description.
    ours = node.module.startswith(OWN_PACKAGE)
    about = parameters_of(load_node(node.module).params).get(param) if ours else None
    return {"value": value, **{k: t for k, t in (about._asdict() if about else {}).items() if t}}


def param_text(described: Mapping[str, Any]) -> str:
    """The description of a parameter in YAML; the default is in YAML already."""
    fields = {key: value for key, value in described.items() if key != "default"}
    default = [f"default: {described['default']}"] if "default" in described else []
    return "\n".join([*yaml_lines(fields), *default])


def set_parameter(card: RunCard, name: str, param: str, value: str) -> str:
    """Set a parameter between two messages; returns the old and the new value as text.

    `value` is in YAML; a length or a time may have a unit, such as ``0.1mm``, and is in SI units
    without one. Raises ValueError if there is no such node, the parameter cannot be set while it
    runs, or the node refuses the value; InputError if the unit does not fit the parameter.
    """
    node = find_node(card, name)
    parsed = parse_yaml(value, "VALUE").value
    units = UNITS.get(_unit_of(node, param))
    if isinstance(parsed, str) and units is not None:
        try:
            parsed = in_base_unit(parsed, units)
        except ValueError as error:
            raise InputError(f"{param} {parsed}: {error}") from None
    request(card, "set", node=node.name, param=param, value=msgspec.json.encode(parsed).decode())
    old, new = (yaml_value(x, TextStyle(flow=True)) for x in (params_of(node)[param], parsed))
    return f"{node.name}.{param}: {old} -> {new}"


def _unit_of(node: RecordedNode, param: str) -> str:
    """The unit of a parameter; empty for a node of a user, whose module is not imported."""
    if not node.module.startswith(OWN_PACKAGE):
        return ""
    about = parameters_of(load_node(node.module).params).get(param)
    return "" if about is None else about.unit


def known_interfaces(run: str | None, bag: Path | None) -> dict[str, str]:
    """Schemas of message types by name: of palpate, and of a graph or a recording.

    Without `run` and `bag`, those of the default running graph, if one runs. Raises InputError if
    there is no such graph or recording.
    """
    schemas: Mapping[str, str] = {}
    with as_input_errors():
        if bag is not None:
            schemas = recording.open_recording(find_bag(bag)).schemas
        elif run is not None or running_graphs():
            schemas = find_run(run).schemas
    return dict(sorted({**schemas, **dict.fromkeys(TYPES, "")}.items()))


def find_interface(name: str, known: Mapping[str, str]) -> type:
    """A message type by name; raises ValueError if it is unknown, or its schema is invalid."""
    if name not in known:
        raise ValueError(f"there is no type {name!r}; {hint(name, known)}")
    return TYPES.get(name) or type_of_schema(known[name])


def interface_text(cls: type, indent: int = 8) -> str:
    """Lines about a message type: each field with type and unit, and its comment below."""
    comments = comments_of(cls) if cls.__name__ in TYPES else {}
    lines = [cls.__name__]
    for part in (inspect.getdoc(cls) or "").split("\n\n"):
        lines += [*_paragraph(part, 2), ""]
    for line in field_lines(cls):
        lines += [f"  {line}", *_paragraph(comments.get(line.split()[0], ""), indent)]
    return "\n".join(lines)
