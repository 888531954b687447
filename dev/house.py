"""Sizes of the repository, and the numbers of files that a frame, a rebuild and a plan run through.

Each of these is observed in a process of its own by profiling the calls of Python, on the vase and
through the public functions.

    python -m dev.house           sizes, and files that a frame, a rebuild and a plan run through
    python -m dev.house --quick   only the sizes
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
from dataclasses import dataclass
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
FRAME_NODES = ("simulator", "filter", "curvature", "tracer", "reconstructor")  # Of one frame
NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}


@dataclass(frozen=True, slots=True, kw_only=True)
class HouseSettings:
    """Which files are long or short, and when a rebuild is observed."""

    max_lines: int = 600  # of a file that is not long
    min_lines: int = 60  # of a file that is not short
    min_rebuild_calls: int = 1000  # function calls for one message; more: a rebuild took place
    min_frames: int = 10  # before a rebuild counts: earlier models are fits of a superquadric


HOUSE = HouseSettings()


class FolderSize(NamedTuple):
    """Files and lines of a folder."""

    name: str
    files: int
    lines: int
    code: int  # Lines that are neither blank nor comment nor docstring
    median: int  # Lines of a file
    long: int  # Number of files with more than `max_lines`
    short: int  # Number of files with fewer than `min_lines`

    @property
    def holds(self) -> bool:
        """True: nothing is demanded."""
        return True

    @property
    def figures(self) -> Sequence[Figure]:
        """Files and lines."""
        return tuple(figure_of(int(self[i]), name=self._fields[i]) for i in range(1, len(self)))

    def __str__(self) -> str:
        return f"{self.name:<10}" + "".join(f"{number:>10}" for number in self[1:])


def house_rows(quick: bool) -> Iterator[FolderSize | Row | str]:
    """Sizes of folders, and numbers of files and calls; only the sizes if quick."""
    package = Path(palpate.__file__).resolve().parent
    root = package.parent if (package.parent / "pyproject.toml").exists() else package
    heads = (
        "files",
        "lines",
        "code",
        "median",
        f"over {HOUSE.max_lines}",
        f"under {HOUSE.min_lines}",
    )
    yield f"{'':<10}" + "".join(f"{head:>10}" for head in heads)
    folders = {name: sources(root / name) for name in FOLDERS if (root / name).is_dir()}
    product = [path for name, paths in folders.items() if name != "tests" for path in paths]
    for name, paths in {"product": product, **folders}.items():
        yield folder_size(name, paths)
    if quick:
        return
    for name, counts in {**_probe("run"), "planning a run": _probe("plan")}.items():
        yield Row(name, ", ".join(f"{count} {what}" for what, count in counts.items()))


def sources(folder: Path) -> list[Path]:
    """Its Python files, without those behind links and scripts of scenes, which are data."""
    paths = (Path(parent) / name for parent, _, names in os.walk(folder) for name in names)
    return sorted(path for path in paths if path.suffix == ".py" and "scenes" not in path.parts)


def folder_size(name: str, paths: Iterable[Path]) -> FolderSize:
    """Count files, lines and lines of code."""
    texts = [path.read_text("utf-8") for path in paths]
    lines = [len(text.splitlines()) for text in texts]
    return FolderSize(
        name,
        files=len(lines),
        lines=sum(lines),
        code=sum(map(code_lines, texts)),
        median=round(median(lines or [0])),
        long=sum(n > HOUSE.max_lines for n in lines),
        short=sum(n < HOUSE.min_lines for n in lines),
    )


def code_lines(text: str) -> int:
    """Lines that are neither blank nor comment nor part of a docstring."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE and token.type != tokenize.ENDMARKER:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Expr(value=ast.Constant(value=str()), lineno=first, end_lineno=int(last)):
                lines.difference_update(range(first, last + 1))
    return len(lines)


def _probe(what: str) -> dict[str, Any]:
    """Observe a run or its plan in a process of its own."""
    command = [sys.executable, __file__, "--watch", what]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{what} failed: {done.stderr.strip()[-400:]}")
    counts: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return counts


class Call(NamedTuple):
    """A call of a function of the product, or the return from one."""

    begins: bool
    file: str
    name: str


Visit = tuple[str, tuple[Call, ...]]  # A node, and the calls from entering it to leaving it


class _Enough(BaseException):
    """Ends the observed program, when all that is needed has been observed."""


class CallWatch:
    """Observes all calls of the product's code while its context is entered."""

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
        """Keep the calls in nodes, by visit."""
        if not self._node and call.begins and call.name != "<module>":
            # A node's code is ``nodes/filter.py``, or all below ``nodes/filter``.
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
            has_rebuilt = node == FRAME_NODES[-1] and len(calls) > 2 * HOUSE.min_rebuild_calls
            if has_rebuilt and len(frames_of(self.visits)) >= HOUSE.min_frames:
                raise _Enough


def frames_of(visits: Sequence[Visit]) -> list[tuple[Call, ...]]:
    """Calls of each frame that passed all nodes, from one visit of the simulator to the next."""
    rounds: list[dict[str, tuple[Call, ...]]] = []
    for node, calls in visits:
        if node == FRAME_NODES[0]:
            rounds.append({})
        if rounds:
            rounds[-1].setdefault(node, calls)
    whole = [by_node for by_node in rounds if len(by_node) == len(FRAME_NODES)]
    return [tuple(call for node in FRAME_NODES for call in by_node[node]) for by_node in whole]


def call_counts(calls: Sequence[Call]) -> dict[str, int]:
    """Numbers of files, of calls from one file into another, and of calls of functions."""
    called = [call.file for call in calls if call.begins and not call.name.startswith("<")]
    changes = sum(before != after for before, after in pairwise(called))
    files = {call.file for call in calls if call.begins}
    return {"files": len(files), "changes of file": changes, "calls": len(called)}


def calls_within(calls: Sequence[Call], name: str) -> Sequence[Call]:
    """The calls from the first of a function to its return; all if it is not called."""
    first = next((i for i, call in enumerate(calls) if call.name == name), 0)
    depth = 0
    for last, call in enumerate(calls[first:], first):
        depth += 1 if call.begins else -1
        if depth == 0:
            return calls[first : last + 1]
    return calls[first:]


def watch_run(out: Path) -> dict[str, Any]:
    """A median frame and the first rebuild of an exploration with all nodes in this process."""
    with CallWatch() as watch:
        palpate.explore("vase", composed=True, record=False, out=out)
    frames = sorted(map(call_counts, frames_of(watch.visits)), key=lambda counts: counts["files"])
    rebuild = calls_within(watch.visits[-1][1], palpate.reconstruct.__name__)
    return {"one frame": frames[len(frames) // 2], "one rebuild": call_counts(rebuild)}


def watch_plan(out: Path) -> dict[str, Any]:
    """``palpate run vase`` until its first write: all is planned by then, and nothing started."""

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
    parser.add_argument("--quick", action="store_true", help="only the sizes")
    parser.add_argument("--watch", choices=("run", "plan"), help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.watch is None:
        return run_groups({"house": house_rows}, quick=options.quick)
    with tempfile.TemporaryDirectory() as folder:
        watched = watch_run if options.watch == "run" else watch_plan
        print(json.dumps(watched(Path(folder) / "out")))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
