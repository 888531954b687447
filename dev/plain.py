"""Plain words are held: no tuned number stands at module level, no variable has an empty name.

What is tuned is a field of a settings class. Numbers at module level are left for what is no
choice, such as physical constants, formats and limits of protocols: `plain.toml` names them all.

    python -m dev.plain                 every place in the product; exits with 1 if there is any
    python -m dev.plain core/touch      only below these paths
"""

from __future__ import annotations

import argparse
import ast
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import palpate

ROOT = Path(palpate.__file__).resolve().parent.parent
FOLDERS = ("core", "messages", "nodes", "launch", "tools", "bench", "palpate", "dev", "examples")
EMPTY_NAMES = {"one", "way", "told", "found", "given", "within", "others", "every", "each"}


class Fault(NamedTuple):
    """A place that a stranger would stumble over."""

    path: str
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.text}"


def main() -> int:
    """Print the faults of the product, or of what lies below some paths."""
    parser = argparse.ArgumentParser(prog="python -m dev.plain", description=__doc__)
    parser.add_argument("paths", nargs="*", type=Path, help="files or folders; default: all")
    faults = list(plain_faults(parser.parse_args().paths or [ROOT / name for name in FOLDERS]))
    print(*faults, f"{len(faults)} faults", sep="\n")
    return bool(faults)


def plain_faults(paths: Iterable[Path]) -> Iterator[Fault]:
    """Faults of all Python files below the paths, and exceptions that are no longer needed."""
    exceptions = tomllib.loads((ROOT / "dev/plain.toml").read_text("utf-8"))["constants"]
    for file in sorted({file for path in paths for file in _sources(path)}):
        name = file.resolve().relative_to(ROOT).as_posix()
        yield from faults_of(name, file.read_text("utf-8"), exceptions.get(name, ()))


def _sources(path: Path) -> Iterator[Path]:
    """Python files at or below a path, without scripts of scenes, which are data."""
    files = [path] if path.is_file() else path.rglob("*.py")
    return (file for file in files if "scenes" not in file.parts)


def faults_of(path: str, source: str, exceptions: Sequence[str] = ()) -> Iterator[Fault]:
    """Faults of one file; `exceptions` are its constants that are no choice."""
    tree = ast.parse(source)
    numbers = dict(_module_numbers(tree))
    for name, line in numbers.items():
        if name not in exceptions:
            yield Fault(path, line, f"the number {name} stands at module level")
    for name in sorted(set(exceptions) - set(numbers)):
        yield Fault(path, 1, f"dev/plain.toml excepts {name}, which is no number at module level")
    for scope in ast.walk(tree):
        if isinstance(scope, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            for name, line in _empty_names(scope).items():
                yield Fault(path, line, f"the name {name!r} does not say what it is")


def _module_numbers(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """Names at module level that are bound to numbers, each with its line."""
    for statement in tree.body:
        match statement:
            case ast.Assign(targets=[target], value=value) if _is_number(value):
                pass
            case ast.AnnAssign(target=target, value=ast.expr() as value) if _is_number(value):
                pass
            case _:
                continue
        names = target.elts if isinstance(target, ast.Tuple) else [target]
        yield from ((name.id, name.lineno) for name in names if isinstance(name, ast.Name))


def _is_number(value: ast.expr) -> bool:
    """Whether an expression is made of literal numbers: alone, computed, or in a sequence."""
    match value:
        case ast.Constant(value=constant):
            return isinstance(constant, int | float) and not isinstance(constant, bool)
        case ast.UnaryOp(operand=operand):
            return _is_number(operand)
        case ast.BinOp(left=left, right=right):
            return _is_number(left) or _is_number(right)
        case ast.Tuple(elts=elements) | ast.List(elts=elements):
            return bool(elements) and all(map(_is_number, elements))
        case ast.Call(func=ast.Name(id=name), args=arguments) if name[:1].islower():
            return any(map(_is_number, arguments))
        case ast.Call(func=ast.Attribute(), args=arguments):
            return any(map(_is_number, arguments))
    return False


def _empty_names(scope: ast.AST) -> Mapping[str, int]:
    """Empty names that a function or a class binds for more than a line, each with its line."""
    bound: dict[str, int] = {}
    last: dict[str, int] = {}
    for node in _own_nodes(scope):
        if isinstance(node, ast.arg):
            name, line, used = node.arg, node.lineno, node.lineno + 1
        elif isinstance(node, ast.Name):
            name, line, used = node.id, node.lineno, node.lineno
        else:
            continue
        if name in EMPTY_NAMES:
            if isinstance(node, ast.arg) or isinstance(node.ctx, ast.Store):
                bound[name] = min(line, bound.get(name, line))
            last[name] = max(used, last.get(name, used))
    return {name: line for name, line in bound.items() if last[name] > line}


def _own_nodes(scope: ast.AST) -> Iterator[ast.AST]:
    """Nodes of a scope, without comprehensions, lambdas and scopes inside."""
    inner = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)
    comprehension = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
    waiting = list(ast.iter_child_nodes(scope))
    while waiting:
        node = waiting.pop()
        if not isinstance(node, inner + comprehension):
            yield node
            waiting.extend(ast.iter_child_nodes(node))


if __name__ == "__main__":
    raise SystemExit(main())
