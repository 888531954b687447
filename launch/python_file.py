"""A launch file in Python: a module with ``describe(**args) -> Graph``.

It is a program that the user chose to run, and is trusted like any other.
"""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable, Mapping
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from palpate.launch.graph import Graph
from palpate.launch.located import InputError, Located
from palpate.launch.nearest import hint


def describe_python(path: Path, args: Mapping[str, Located], out: Path) -> Graph:
    """The graph that the file's ``describe`` returns.

    Parameters
    ----------
    path : Path
        The file.
    args : map
        Arguments of ``describe`` by name.
    out : Path
        The run directory, handed over if ``describe`` has a parameter ``out``.

    Raises
    ------
    InputError
        If there is no such file or function, an argument is unknown or missing, or what comes
        back is no Graph.
    """
    function = load_describe(path)
    signature = inspect.signature(function)
    values: dict[str, Any] = {name: value.value for name, value in args.items()}
    for name, value in args.items():
        if name not in signature.parameters or name == "out":
            raise value.error(
                (), f"{path} has no argument {name!r}; {hint(name, signature.parameters)}"
            )
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


def load_describe(path: Path) -> Callable[..., Any]:
    """The function ``describe`` of a launch file, which is run up to its end.

    Raises
    ------
    InputError
        If there is no such file or function, or running the file fails.
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
        lines = [
            f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)
        ]
        place = f"{path}:{lines[-1]}" if lines else str(path)
        raise InputError(f"{place}: {type(error).__name__}: {error}") from None
