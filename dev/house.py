"""The figures of the house: how much there is, in how many files, and how many files an act needs.

Acts are watched from outside, by the calls that Python makes, through the public face and on the
vase, each in a process of its own.

    python -m dev.house           sizes, and what a frame, a rebuild and a plan run through
    python -m dev.house --quick   the sizes alone
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import os
import subprocess
import sys
import tempfile
import tokenize
from collections.abc import Iterable, Iterator, Sequence
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from statistics import median
from types import FrameType
from typing import Any, NamedTuple

import palpate
from palpate.bench.table import Figure, Row, figure_of, run_groups

FOLDERS = (
    *("core", "messages", "nodes", "launch", "tools", "bench", "palpate"),
    *("dev", "examples", "tests"),
)
LONG, SHORT = 600, 60  # Lines from which a file is too long, and below which it is a scrap
FRAME_NODES = ("simulator", "filter", "curvature", "tracer", "reconstructor")  # Of one frame
REBUILT = 1000  # Calls in one visit of the reconstructor from which it rebuilds
FRAMES = 10  # Frames that come first: before them a superquadric is fitted
NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}


class FolderSize(NamedTuple):
    """Files and lines of a folder."""

    name: str
    files: int
    lines: int
    code: int  # Neither blank nor comment nor docstring
    median: int  # Lines of a file
    long: int  # Files of more than 600 lines
    short: int  # Files of fewer than 60

    @property
    def holds(self) -> bool:
        """Nothing is demanded of it."""
        return True

    @property
    def figures(self) -> Sequence[Figure]:
        """Files and lines."""
        return tuple(figure_of(int(self[i]), name=self._fields[i]) for i in range(1, len(self)))

    def __str__(self) -> str:
        return f"{self.name:<10}" + "".join(f"{number:>10}" for number in self[1:])


def house_rows(quick: bool) -> Iterator[FolderSize | Row | str]:
    """Sizes of the folders, and of what three acts run through; only the sizes if quick."""
    package = Path(palpate.__file__).resolve().parent
    root = package.parent if (package.parent / "pyproject.toml").exists() else package
    heads = ("files", "lines", "code", "median", f"over {LONG}", f"under {SHORT}")
    yield f"{'':<10}" + "".join(f"{head:>10}" for head in heads)
    folders = {name: sources(root / name) for name in FOLDERS if (root / name).is_dir()}
    product = [path for name, paths in folders.items() if name != "tests" for path in paths]
    for name, paths in {"product": product, **folders}.items():
        yield folder_size(name, paths)
    if quick:
        return
    for act, counts in {**_probe("run"), "planning a run": _probe("plan")}.items():
        yield Row(act, ", ".join(f"{count} {what}" for what, count in counts.items()))


def sources(folder: Path) -> list[Path]:
    """Its Python files; links are not followed, and scripts of scenes are data."""
    found = (Path(at) / one for at, _, names in os.walk(folder) for one in names)
    return sorted(one for one in found if one.suffix == ".py" and "scenes" not in one.parts)


def folder_size(name: str, paths: Iterable[Path]) -> FolderSize:
    """Count files, lines and lines of code."""
    texts = [path.read_text("utf-8") for path in paths]
    lines = [len(text.splitlines()) for text in texts]
    middle, ends = (
        median(lines or [0]),
        (sum(n > LONG for n in lines), sum(n < SHORT for n in lines)),
    )
    return FolderSize(
        name, len(lines), sum(lines), sum(map(code_lines, texts)), round(middle), *ends
    )


def code_lines(text: str) -> int:
    """Lines that are neither blank nor comment nor part of a docstring."""
    kept: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE and token.type != tokenize.ENDMARKER:
            kept.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Expr(value=ast.Constant(value=str()), lineno=first, end_lineno=int(last)):
                kept.difference_update(range(first, last + 1))
    return len(kept)


def _probe(act: str) -> dict[str, Any]:
    """Watch an act in a process of its own."""
    command = [sys.executable, __file__, "--watch", act]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{act} failed: {done.stderr.strip()[-400:]}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


class Call(NamedTuple):
    """A call of the product, or the return from one."""

    begins: bool
    file: str
    name: str


Visit = tuple[str, tuple[Call, ...]]  # The calls between entering a node and leaving it


class _Enough(BaseException):
    """All has been seen."""


class CallWatch:
    """Sees every call of the product's code while it is entered."""

    def __init__(self) -> None:
        self.modules: set[str] = set()
        self.files: set[str] = set()
        self.visits: list[Visit] = []
        self._folder = Path(palpate.__file__).resolve().parent.parent
        self._known: dict[str, str | None] = {__file__: None}
        self._node, self._depth, self._calls = "", 0, list[Call]()

    def __enter__(self) -> CallWatch:
        sys.setprofile(self._profile)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> bool:
        sys.setprofile(None)
        return kind is _Enough

    def _profile(self, frame: FrameType, event: str, _: Any) -> None:
        if event not in ("call", "return"):
            return
        file, name = self._file(frame.f_code.co_filename), frame.f_code.co_name
        if file is None:
            return
        if event == "call":
            (self.modules if name == "<module>" else self.files).add(file)
        self._visit(Call(event == "call", file, name))

    def _file(self, name: str) -> str | None:
        """Path of a file of the product, links resolved; None for any other."""
        if name not in self._known:
            path = Path(os.path.realpath(name))
            inside = path.is_relative_to(self._folder) and path.is_file()
            parts = path.relative_to(self._folder).parts if inside else ("",)
            self._known[name] = "/".join(parts) if parts[0] in FOLDERS else None
        return self._known[name]

    def _visit(self, call: Call) -> None:
        """Keep what happens in nodes, each visit for itself."""
        if not self._node and call.begins and call.name != "<module>":
            # The filter's is ``nodes/filter.py``, or all below ``nodes/filter``.
            parts = call.file.removesuffix(".py").split("/")
            names = (name for room, name in pairwise(parts) if room == "nodes")
            self._node = next((name for name in names if name in FRAME_NODES), "")
        if not self._node:
            return
        self._calls.append(call)
        self._depth += 1 if call.begins else -1
        if self._depth == 0:
            node, calls = self._node, tuple(self._calls)
            self.visits.append((node, calls))
            self._node, self._calls = "", []
            rebuilt = node == FRAME_NODES[-1] and len(calls) > 2 * REBUILT
            if rebuilt and len(frames_of(self.visits)) >= FRAMES:
                raise _Enough


def frames_of(visits: Sequence[Visit]) -> list[tuple[Call, ...]]:
    """The calls of each frame that passed all its nodes: those of one round of the simulator."""
    rounds: list[dict[str, tuple[Call, ...]]] = []
    for node, calls in visits:
        if node == FRAME_NODES[0]:
            rounds.append({})
        if rounds:
            rounds[-1].setdefault(node, calls)
    whole = [one for one in rounds if len(one) == len(FRAME_NODES)]
    return [tuple(call for node in FRAME_NODES for call in one[node]) for one in whole]


def passed(calls: Sequence[Call]) -> dict[str, int]:
    """Files, calls into another file than the call before, and calls; comprehensions are none."""
    begun = [call.file for call in calls if call.begins and not call.name.startswith("<")]
    changes = sum(one != other for one, other in pairwise(begun))
    files = {call.file for call in calls if call.begins}
    return {"files": len(files), "changes of file": changes, "calls": len(begun)}


def within(calls: Sequence[Call], name: str) -> Sequence[Call]:
    """The calls from the first of a function to its return; all of them if it is not called."""
    first = next((i for i, call in enumerate(calls) if call.name == name), 0)
    depth = 0
    for last, call in enumerate(calls[first:], first):
        depth += 1 if call.begins else -1
        if depth == 0:
            return calls[first : last + 1]
    return calls[first:]


def watch_run(out: Path) -> dict[str, Any]:
    """A usual frame and the first rebuild of an exploration with all nodes in this process."""
    with CallWatch() as watch:
        palpate.explore("vase", composed=True, record=False, out=out)
    frames = sorted(map(passed, frames_of(watch.visits)), key=lambda one: one["files"])
    rebuild = within(watch.visits[-1][1], palpate.reconstruct.__name__)
    return {"one frame": frames[len(frames) // 2], "one rebuild": passed(rebuild)}


def watch_plan(out: Path) -> dict[str, Any]:
    """``palpate run vase`` until it begins to write: then all is planned and nothing started."""

    def stop(event: str, values: tuple[Any, ...]) -> None:
        if event == "os.mkdir" and str(values[0]) == str(out):
            raise _Enough

    sys.addaudithook(stop)
    with CallWatch() as watch:
        command_line = import_module("palpate.tools.cli.command_line")
        command_line.run(["run", "vase", "--composed", "--quiet", "--out", str(out)])
    return {"files run through": len(watch.files), "imported": len(watch.modules | watch.files)}


def main(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="the sizes alone")
    parser.add_argument("--watch", choices=("run", "plan"), help=argparse.SUPPRESS)
    told = parser.parse_args(argv)
    if told.watch is None:
        return run_groups({"house": house_rows}, quick=told.quick)
    with tempfile.TemporaryDirectory() as folder:
        watched = watch_run if told.watch == "run" else watch_plan
        print(json.dumps(watched(Path(folder) / "out")))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
