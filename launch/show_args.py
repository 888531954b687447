"""The arguments of a launch file, with what they are if nobody sets them."""

from __future__ import annotations

import inspect
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from palpate.launch.include import read_with_includes
from palpate.launch.launch_file import declared_args
from palpate.launch.launch_path import find_launch_file
from palpate.launch.python_file import load_describe
from palpate.launch.yaml_file import read_yaml


def show_args(path: Path) -> str:
    """A table of the arguments that a launch file takes; nothing is started.

    Of a YAML file the comment behind an argument is its explanation; of a Python file, which is
    run up to its ``describe``, the type is shown.

    Raises
    ------
    InputError
        If the file cannot be used.
    """
    python = path.suffix == ".py"
    rows = _python_rows(path) if python else _yaml_rows(path)
    if not rows:
        return f"{path} takes no arguments"
    head = ("argument", "type", "default") if python else ("argument", "default", "")
    lines = _aligned([head, *rows])
    return "\n".join([f"{path} takes, each as NAME:=VALUE", *lines])


def _yaml_rows(path: Path) -> list[tuple[str, str, str]]:
    declared = declared_args(read_with_includes(path, find_launch_file))
    comments = _comments(path) if declared_args(read_yaml(path)) else {}
    return [(name, _plain(value), comments.get(name, "")) for name, value in declared.items()]


def _comments(path: Path) -> dict[str, str]:
    """What stands behind each argument of a file that was read and found harmless."""
    args = YAML(typ="rt", pure=True).load(path.read_text(encoding="utf-8"))["args"]
    found = {}
    for name, tokens in args.ca.items.items():
        text = next((token.value for token in tokens[2:] if hasattr(token, "value")), "")
        first = text.partition("\n")[0]
        found[name] = " ".join(first.lstrip("#").split())
    return found


def _python_rows(path: Path) -> list[tuple[str, str, str]]:
    rows = []
    for name, parameter in inspect.signature(load_describe(path)).parameters.items():
        several = parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
        if name != "out" and not several:
            rows.append((name, _type(parameter), _default(parameter)))
    return rows


def _type(parameter: inspect.Parameter) -> str:
    if parameter.annotation is parameter.empty:
        return ""
    return inspect.formatannotation(parameter.annotation).strip("'")


def _default(parameter: inspect.Parameter) -> str:
    return "required" if parameter.default is parameter.empty else repr(parameter.default)


def _plain(value: Any) -> str:
    return (
        value
        if isinstance(value, str) and value
        else json.dumps(value, default=str, ensure_ascii=False)
    )


def _aligned(rows: Sequence[tuple[str, str, str]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    return ["  ".join((*map(str.ljust, row[:2], widths), row[2])).rstrip() for row in rows]
