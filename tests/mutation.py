"""Change single lines of the product, one at a time, and count how many changes some test catches.

``python tests/mutation.py TREE --work DIR --sites SITES.json --out RESULTS.jsonl``

The tree is copied to the work folder, and nothing is ever written elsewhere. The suite runs
once there with coverage, one context a test: that says which tests execute which line. Each
change then runs at most 60 of them, narrow ones and those of the mirrored file before others, the
fastest first, until one fails. A line that no test executes in process falls back on the tests of
the mirrored folder.

The sites are drawn by seed when SITES.json does not exist, else read from it: a change is found
again in a tree whose files were moved, merged and renamed by the shape of its function, which
knows no names, then by the function's name, then by the text or shape of its statement.

Needs coverage, beside what the tests need. Lines that RESULTS.jsonl has already are not run again.
"""

from __future__ import annotations

import argparse
import ast
import copy
import hashlib
import json
import os
import random
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOMS = ("core", "messages", "nodes", "launch", "tools")
"""Folders whose functions are changed; benches and the public face are not among them."""

LEFT_OUT = ("bench", "cli", "damage", "fuzz", "scenes", "templates", "drawing")
"""Folders within them that measure, print or are templates."""

LEFT_OUT_FILES = ("bench_", "figures_", "testing")
LEFT_OUT_ENDS = ("_objects", "_objects_drawn", "_text", "_tables", "_peer", "_peers", "_examples")
LEFT_OUT_NAMES = ("closing", "display", "thesis_examples", "rebuild_shapes", "planner_trial")

MOST_TESTS = 60
CPU_LIMIT = 60
"""Of one change, s; one that comes so far hangs, and counts as caught."""
WALL_LIMIT = 240.0
"""The same on the clock: the machine may be shared."""
FOLDER_LIMIT = 90.0
"""On the clock, of a folder's tests on a line that none executes in process; then it survived."""
BUDGET = 20.0
"""Processor time that the chosen tests of one change take without it, s."""
SLOWEST = 15
"""A test that takes longer is none of those that are chosen from, s."""

GRAPH = "tests/graph"
IGNORED = (GRAPH, "tests/golden")
"""They start processes, or compare bytes: not what says what is wrong."""

PYTEST = ("-q", "-p", "no:cacheprovider", "-W", "ignore:Module already imported")
MARKS = ("-m", "not slow and not graph")

TURNED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
SIGNS: dict[type[ast.operator], type[ast.operator]] = {ast.Add: ast.Sub, ast.Sub: ast.Add}
SCALES: dict[type[ast.operator], type[ast.operator]] = {ast.Mult: ast.Div, ast.Div: ast.Mult}

Function = ast.FunctionDef | ast.AsyncFunctionDef


# ---- what can be changed -------------------------------------------------------------------


@dataclass(frozen=True)
class Point:
    """A node of the tree, and what it becomes."""

    node: ast.expr | ast.stmt
    statement: ast.stmt
    kind: str
    after: str


@dataclass(frozen=True)
class Body:
    """A top-level function or a method, with all that may be changed in it."""

    file: str
    name: str
    exact: str
    shape: str
    points: tuple[Point, ...]


@dataclass(frozen=True)
class Site:
    """A change, told in a way that outlives moving and renaming."""

    number: int
    file: str
    line: int
    function: str
    exact: str
    shape: str
    ordinal: int
    kind: str
    before: str
    after: str
    statement: str
    statement_shape: str
    statement_ordinal: int


def bodies_of(root: Path) -> list[Body]:
    """All functions of the product, in the order of files and lines."""
    found: list[Body] = []
    for path in sorted(p for room in ROOMS for p in (root / room).rglob("*.py")):
        name = path.relative_to(root).as_posix()
        for qualified, function in _functions(ast.parse(path.read_text("utf-8")), ""):
            points = tuple(_points(function))
            if points:
                exact, shape = _hash(function, names=True), _hash(function, names=False)
                found.append(Body(name, qualified, exact, shape, points))
    return found


def is_changed(file: str) -> bool:
    """Whether changes are drawn from a file."""
    *folders, last = Path(file).with_suffix("").parts
    return not (
        any(one in LEFT_OUT for one in folders)
        or last.startswith(LEFT_OUT_FILES)
        or last.endswith(LEFT_OUT_ENDS)
        or last in LEFT_OUT_NAMES
    )


def _functions(tree: ast.AST, prefix: str) -> Iterator[tuple[str, Function]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, Function):
            yield prefix + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from _functions(node, f"{prefix}{node.name}.")


def _points(function: Function) -> Iterator[Point]:
    for statement in function.body:
        yield from _within(statement, statement)


def _within(node: ast.AST, statement: ast.stmt) -> Iterator[Point]:
    """What may be changed at a node and below it, in the order of the text."""
    if isinstance(node, ast.Raise | ast.Assert | ast.Import | ast.ImportFrom | ast.JoinedStr):
        return
    if isinstance(node, ast.stmt):
        statement = node
    if isinstance(node, ast.expr | ast.stmt):
        for kind, after in _changes(node):
            yield Point(node, statement, kind, after)
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "format_spec"):
            continue
        if isinstance(node, Function | ast.Lambda) and name == "args":
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _within(child, statement)


def _changes(node: ast.expr | ast.stmt) -> Iterator[tuple[str, str]]:
    """Kinds of change and the text that takes the node's place."""
    match node:
        case ast.BinOp(op=op) if type(op) in SIGNS and not _is_joined(node):
            yield "sign", _with(node, "op", SIGNS[type(op)]())
        case ast.BinOp(op=op) if type(op) in SCALES:
            yield "sign", _with(node, "op", SCALES[type(op)]())
        case ast.AugAssign(op=op) if type(op) in SIGNS and not _is_joined(node):
            yield "sign", _with(node, "op", SIGNS[type(op)]())
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            yield "sign", f"({ast.unparse(operand)})"
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield "comparison", f"(bool({ast.unparse(operand)}))"
        case ast.Constant(value=bool(value)):
            yield "constant", str(not value)
        case ast.Constant(value=int(value)):
            yield "constant", str(value + 1)
            if value > 0:
                yield "constant", str(value - 1)
        case ast.Constant(value=float(value)):
            yield "constant", repr(value * 2.0 if value else 1.0)
            if value:
                yield "constant", repr(value * 0.9)
        case ast.Compare(ops=[op, *rest]):
            for turned in TURNED[type(op)]:
                yield "comparison", _with(node, "ops", [turned(), *rest])
        case ast.BoolOp(op=op):
            yield (
                "comparison",
                _with(node, "op", ast.Or() if isinstance(op, ast.And) else ast.And()),
            )
        case ast.If(body=[*_, ast.Raise() | ast.Return() | ast.Continue() | ast.Break()]):
            yield "guard removed", "False"
            yield "guard negated", f"not ({ast.unparse(node.test)})"
        case ast.If() | ast.IfExp():
            yield "guard negated", f"not ({ast.unparse(node.test)})"


def _is_joined(node: ast.BinOp | ast.AugAssign) -> bool:
    """Whether a sum joins texts or lists: no other sign could even run."""
    sides = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.value]
    kinds = (ast.JoinedStr, ast.List, ast.Tuple, ast.ListComp)
    return any(
        isinstance(one, kinds) or (isinstance(one, ast.Constant) and isinstance(one.value, str))
        for one in sides
    )


def _with(node: ast.expr | ast.stmt, field: str, value: object) -> str:
    changed = copy.copy(node)
    setattr(changed, field, value)
    text = ast.unparse(changed)
    return text if isinstance(node, ast.stmt) else f"({text})"


def target(point: Point) -> ast.expr | ast.stmt:
    """The node whose text is replaced: of a guard only what it asks."""
    return point.node.test if isinstance(point.node, ast.If | ast.IfExp) else point.node


def header(statement: ast.stmt) -> ast.AST:
    """A statement without the statements within it."""
    if not hasattr(statement, "body"):
        return statement
    bare = copy.copy(statement)
    for name in ("body", "orelse", "finalbody", "handlers", "cases"):
        if hasattr(bare, name):
            setattr(bare, name, [])
    return bare


# ---- what makes a function the same --------------------------------------------------------


class _Plain(ast.NodeTransformer):
    """Leaves what moving and renaming cannot change; text is dropped, names only if told so."""

    def __init__(self, names: bool) -> None:
        self.names = names

    def generic_visit(self, node: ast.AST) -> ast.AST:
        node = super().generic_visit(node)
        for field in ("annotation", "returns"):
            if hasattr(node, field) and not isinstance(node, ast.AnnAssign):
                setattr(node, field, None)
        if isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(0)
        if hasattr(node, "decorator_list"):
            node.decorator_list = []
        if isinstance(node, Function | ast.ClassDef):
            node.body = [one for one in node.body if not _is_text(one)] or [ast.Pass()]
        if not self.names:
            for field in ("id", "attr", "arg", "name", "asname"):
                if isinstance(getattr(node, field, None), str):
                    setattr(node, field, "_")
        return node

    def visit_Import(self, node: ast.Import) -> None:
        return None

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        return None

    def visit_Assert(self, node: ast.Assert) -> None:
        return None

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        return ast.Raise()

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        return ast.Constant("_")

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        return ast.Constant("_") if isinstance(node.value, str) else node


def _is_text(statement: ast.stmt) -> bool:
    if not isinstance(statement, ast.Expr) or not isinstance(statement.value, ast.Constant):
        return False
    return isinstance(statement.value.value, str)


def _hash(node: ast.AST, *, names: bool) -> str:
    plain = _Plain(names).visit(copy.deepcopy(node))
    if isinstance(plain, Function) and names:
        plain.name = "_"
    text = "" if plain is None else ast.dump(plain)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _statement_text(statement: ast.stmt) -> str:
    return ast.unparse(ast.fix_missing_locations(header(statement)))


# ---- drawing and finding again -------------------------------------------------------------


def draw(bodies: Sequence[Body], count: int, seed: int) -> list[Site]:
    """Draw lines, and on each of them one change."""
    lines: dict[tuple[str, int], list[tuple[Body, int]]] = defaultdict(list)
    for body in bodies:
        for i, point in enumerate(body.points):
            if is_changed(body.file):
                lines[body.file, target(point).lineno].append((body, i))
    chance = random.Random(seed)
    chosen = chance.sample(sorted(lines), min(count, len(lines)))
    return [_site(number, *_kind(chance, lines[one])) for number, one in enumerate(chosen)]


def _kind(chance: random.Random, on_line: Sequence[tuple[Body, int]]) -> tuple[Body, int]:
    """One change of a line; each kind as likely, however many numbers stand there."""
    kind = chance.choice(sorted({body.points[i].kind for body, i in on_line}))
    return chance.choice([one for one in on_line if one[0].points[one[1]].kind == kind])


def _site(number: int, body: Body, ordinal: int) -> Site:
    point = body.points[ordinal]
    mates = [i for i, other in enumerate(body.points) if other.statement is point.statement]
    return Site(
        number=number,
        file=body.file,
        line=target(point).lineno,
        function=body.name,
        exact=body.exact,
        shape=body.shape,
        ordinal=ordinal,
        kind=point.kind,
        before=ast.unparse(target(point)),
        after=point.after,
        statement=_statement_text(point.statement),
        statement_shape=_hash(header(point.statement), names=False),
        statement_ordinal=mates.index(ordinal),
    )


def find(bodies: Sequence[Body], site: Site) -> tuple[Body, Point, str] | None:
    """Where a change stands in a tree, and how it was found; None if nowhere, or unclear."""

    def best(candidates: list[Body]) -> Body | None:
        named = [one for one in candidates if one.name == site.function]
        last = [one for one in candidates if _last(one.name) == _last(site.function)]
        for some in (named, last, candidates):
            near = [one for one in some if one.file == site.file] or some
            if len(near) == 1:
                return near[0]
            if near and len({one.exact for one in near}) == 1:
                return near[0]
        return None

    for how, same in (
        ("body", [one for one in bodies if one.exact == site.exact]),
        ("shape", [one for one in bodies if one.shape == site.shape]),
    ):
        body = best(same)
        if body is not None and site.ordinal < len(body.points):
            point = body.points[site.ordinal]
            if point.kind == site.kind:
                return body, point, how
    named = [one for one in bodies if one.name == site.function]
    near = [one for one in named if one.file == site.file] or named
    others = [one for one in bodies if _last(one.name) == _last(site.function)]
    for how, some in (("name", near), ("last name", others), ("statement", list(bodies))):
        for exact in (True, False):
            if not exact and how == "statement":
                continue
            found = [hit for body in some if (hit := _in_body(body, site, exact)) is not None]
            if len(found) == 1:
                return (*found[0], how)
    return None


def _last(name: str) -> str:
    return name.rpartition(".")[2].lstrip("_")


def _in_body(body: Body, site: Site, exact: bool) -> tuple[Body, Point] | None:
    """The change in a function whose body is another one, by the statement alone."""
    mates: dict[int, list[Point]] = defaultdict(list)
    for point in body.points:
        mates[id(point.statement)].append(point)
    hits = []
    for points in mates.values():
        if site.statement_ordinal >= len(points):
            continue
        point = points[site.statement_ordinal]
        if point.kind != site.kind:
            continue
        if exact and _statement_text(point.statement) != site.statement:
            continue
        if not exact and _hash(header(point.statement), names=False) != site.statement_shape:
            continue
        hits.append((body, point))
    return hits[0] if len(hits) == 1 else None


def changed(source: str, point: Point) -> str:
    """The text of a file with one change."""
    node = target(point)
    assert node.end_lineno is not None and node.end_col_offset is not None
    lines = source.encode().splitlines(keepends=True)
    begin = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    data = source.encode()
    return (data[:begin] + point.after.encode() + data[end:]).decode()


# ---- which test executes which line --------------------------------------------------------


class Contexts:
    """A plugin of pytest: a context of coverage for each test, and for each shared fixture."""

    def __init__(self, coverage: Any) -> None:
        self.coverage = coverage
        self.tests: dict[str, dict[str, Any]] = {}
        self.done = 0

    def pytest_collection_finish(self, session: Any) -> None:
        for item in session.items:
            info = getattr(item, "_fixtureinfo", None)
            of = {} if info is None else info.name2fixturedefs
            shared = [_fixture(one) for defs in of.values() for one in defs]
            self.tests[item.nodeid] = {"fixtures": [one for one in shared if one], "cpu": None}

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.coverage.switch_context(nodeid)
        self.tests[nodeid]["began"] = _cpu()

    def pytest_runtest_logreport(self, report: Any) -> None:
        test = self.tests[report.nodeid]
        test["failed"] = test.get("failed", False) or report.outcome != "passed"

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        test = self.tests[nodeid]
        test["cpu"] = round(_cpu() - test.pop("began"), 4)
        self.coverage.switch_context("")
        self.done += 1
        if self.done % 100 == 0:
            print(f"{self.done} of {len(self.tests)} tests", file=sys.__stderr__, flush=True)

    def wrap_fixture(self, pytest: Any) -> None:
        """Have shared fixtures, too, run in contexts of their own."""
        plugin = self

        @pytest.hookimpl(wrapper=True)  # type: ignore[untyped-decorator, unused-ignore]
        def pytest_fixture_setup(fixturedef: Any, request: Any) -> Any:
            name = _fixture(fixturedef)
            if name is None:
                return (yield)
            plugin.coverage.switch_context(name)
            try:
                return (yield)
            finally:
                plugin.coverage.switch_context(os.environ["PYTEST_CURRENT_TEST"].rpartition(" ")[0])

        self.pytest_fixture_setup = pytest_fixture_setup


def _fixture(fixturedef: Any) -> str | None:
    """Name of a fixture's context; None for one that every test has to itself."""
    if fixturedef.scope == "function" or not fixturedef.baseid:
        return None
    return f"fixture {fixturedef.baseid}::{fixturedef.argname}"


def _cpu() -> float:
    own, children = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def measure(work: Path, options: Sequence[str]) -> None:
    """Run the suite of the copy with coverage; in a process of its own."""
    import coverage
    import pytest

    tree = work / "tree"
    os.chdir(tree)
    sys.path.insert(0, str(tree))
    _quiet_hypothesis()
    _usual_signals()
    cover = coverage.Coverage(
        data_file=str(work / "coverage.sqlite"),
        config_file=False,
        source=[str(tree)],
        omit=["tests/*"],
    )
    cover.start()
    contexts = Contexts(cover)
    contexts.wrap_fixture(pytest)
    code = pytest.main([*PYTEST, *options], plugins=[contexts])
    cover.stop()
    cover.save()
    homes = tuple(str(Path(one)) for one in sys.path if "site-packages" in one)
    modules = [
        name
        for name, module in sys.modules.items()
        if (getattr(module, "__file__", None) or "").startswith(homes) and "editable" not in name
    ]
    result = {"code": int(code), "tests": contexts.tests, "modules": modules}
    (work / "tests.json").write_text(json.dumps(result))


def _usual_signals() -> None:
    """Undo what ``nohup`` and a shell's ``&`` leave to their children."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


def _quiet_hypothesis() -> None:
    """The same examples every time, however slow the machine."""
    try:
        from hypothesis import settings
    except ImportError:
        return
    settings.register_profile("mutation", deadline=None, database=None, derandomize=True)
    settings.load_profile("mutation")


class Tests:
    """Which tests there are, what they cost, and what they execute."""

    def __init__(self, work: Path, ignored: Sequence[str]) -> None:
        from coverage import CoverageData
        from coverage.numbits import numbits_to_nums

        kept = json.loads((work / "tests.json").read_text())
        self.tree = work / "tree"
        self.tests: dict[str, Any] = kept["tests"]
        self.modules: list[str] = kept["modules"]
        self.cpu = {
            name: one["cpu"]
            for name, one in self.tests.items()
            if one["cpu"] is not None
            and not one.get("failed", True)
            and not name.startswith(tuple(ignored))
        }
        self.users: dict[str, list[str]] = defaultdict(list)
        for name, one in self.tests.items():
            for fixture in one["fixtures"]:
                self.users[fixture].append(name)
        self.data = CoverageData(str(work / "coverage.sqlite"))
        self.data.read()
        self.breadth: Counter[str] = Counter()
        with closing(sqlite3.connect(work / "coverage.sqlite")) as db:
            rows = db.execute(
                "select context.context, numbits from line_bits join context"
                " on context.id = line_bits.context_id"
            )
            for context, bits in rows:
                self.breadth[context] += len(numbits_to_nums(bits))

    def executing(self, file: str, lines: Iterable[int]) -> set[str]:
        """The tests that execute one of some lines."""
        by_line = self.data.contexts_by_lineno(str((self.tree / file).resolve()))
        contexts = {one for line in lines for one in by_line.get(line, ())}
        tests = {user for one in contexts for user in self.users.get(one, ())} | contexts
        return {one for one in tests if one in self.cpu}

    def choose(self, file: str, node: ast.AST, statement: ast.stmt) -> list[str]:
        """At most 60 tests for a change, the fastest first; empty if none executes it."""
        covering = self.executing(file, _lines(node)) or self.executing(file, _lines(statement)[:1])
        if not covering:
            return []
        own = {one for one in self.cpu if _file_of(one) in mirrored(self.tree, file)}
        near = {_file_of(one) for one in covering}
        beside = {one for one in self.cpu if _file_of(one) in near} if len(covering) < 20 else set()
        chosen: list[str] = []
        spent = 0.0
        for some in (covering & own, covering - own, own - covering, beside - covering - own):
            for one in self._in_turn(some):
                if len(chosen) < MOST_TESTS and (spent + self.cpu[one] < BUDGET or not chosen):
                    chosen.append(one)
                    spent += self.cpu[one]
        return sorted(chosen, key=lambda one: (self.cpu[one], one))

    def _in_turn(self, tests: set[str]) -> list[str]:
        """Narrow tests first, and of each function one case before the second of any."""
        functions: dict[str, list[str]] = defaultdict(list)
        for one in sorted(tests, key=lambda one: (self.breadth[one], one)):
            functions[one.partition("[")[0]].append(one)
        rounds = [
            (i, self.breadth[one], one) for of in functions.values() for i, one in enumerate(of)
        ]
        return [one for *_, one in sorted(rounds)]


def _lines(node: ast.AST) -> range:
    first, last = getattr(node, "lineno", 1), getattr(node, "end_lineno", None)
    return range(first, (last or first) + 1)


def _file_of(test: str) -> str:
    return test.partition("::")[0]


def mirrored(tree: Path, file: str) -> list[str]:
    """The test files that bear the name of a product file."""
    path = Path("tests") / file
    begins = f"test_{path.stem}"
    folder = tree / path.parent
    found = sorted(folder.glob(f"{begins}*.py")) if folder.is_dir() else []
    return [one.relative_to(tree).as_posix() for one in found]


def folder_of(tree: Path, file: str, before: str) -> list[str]:
    """Test files for a line that no test executes in process.

    First those of the file's own name, then those that share a word with it or with its name
    before a move, and of these all that start graphs, then the rest of the mirrored folder.
    """
    folder = Path("tests") / Path(file).parent
    while not (tree / folder).is_dir():
        folder = folder.parent
    own = mirrored(tree, file)
    words = set(Path(file).stem.split("_")) | set(Path(before).stem.split("_"))

    def order(path: str) -> tuple[bool, int, str]:
        return path not in own, -len(words & set(Path(path).stem.split("_"))), path

    near = [one.relative_to(tree).as_posix() for one in (tree / folder).glob("test_*.py")]
    graph = [one.relative_to(tree).as_posix() for one in (tree / GRAPH).glob("test_*.py")]
    like = [one for one in (*near, *graph) if order(one)[1] < 0 or one in own]
    rest = sorted(set(near) - set(like)), sorted(set(graph) - set(like))
    starts = Path(file).parts[0] in ("nodes", "launch", "messages", "tools")
    return [*sorted(like, key=order), *(rest[1] if starts else []), *rest[0]]


# ---- running -------------------------------------------------------------------------------


class Chosen:
    """A plugin of pytest: keeps the chosen tests, in their order, and remembers what failed."""

    def __init__(self, tests: Sequence[str], distrusted: Iterable[str]) -> None:
        self.place = {one: i for i, one in enumerate(tests)}
        self.distrusted = set(distrusted)
        self.failed: list[str] = []
        self.passed = 0

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        if self.place:
            items[:] = [one for one in items if one.nodeid in self.place]
            items.sort(key=lambda one: self.place[one.nodeid])
        else:
            items[:] = [one for one in items if one.nodeid not in self.distrusted]

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self.failed.append(report.nodeid)
        elif report.when == "call":
            self.passed += 1

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed:
            self.failed.append(f"collecting {report.nodeid}")


def run_tests(
    work: Path, files: Sequence[str], tests: Sequence[str], *, confirming: bool = False
) -> dict[str, Any]:
    """Run tests in a child of this process, which has imported all but the product.

    Returns
    -------
    dict
        ``ended`` is ``passed``, ``failed``, ``cpu limit`` or ``wall limit``; ``failed`` has names.
    """
    limit = 1800.0 if confirming else WALL_LIMIT if tests else FOLDER_LIMIT
    told = work / "told.json"
    told.unlink(missing_ok=True)
    began = time.monotonic()
    pid = os.fork()
    if pid == 0:
        _child(work, files, tests, told, confirming)
    ended = ""
    while True:
        done, status, usage = os.wait4(pid, os.WNOHANG)
        if done:
            break
        if time.monotonic() - began > limit:
            ended = "wall limit"
            os.killpg(pid, signal.SIGKILL)
        time.sleep(0.02)
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)  # what the tests may have left behind
    result: dict[str, Any] = {"failed": [], "passed": 0}
    if told.exists():
        result = json.loads(told.read_text())
        broken = result["code"] not in (0, 1, 5)  # 5: there was no test
        ended = "failed" if result["failed"] else "crashed" if broken else "passed"
    elif not ended:
        limited = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU
        ended = "cpu limit" if limited else "crashed"
    result["ended"] = ended
    result["cpu"] = round(usage.ru_utime + usage.ru_stime, 2)
    result["wall"] = round(time.monotonic() - began, 2)
    return result


def _child(
    work: Path, files: Sequence[str], tests: Sequence[str], told: Path, confirming: bool
) -> None:
    import pytest

    code = 1
    try:
        os.setsid()
        _usual_signals()
        if tests and not confirming:
            resource.setrlimit(resource.RLIMIT_CPU, (CPU_LIMIT, CPU_LIMIT + 5))
        output = os.open(work / "output.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.chdir(work / "tree")
        sys.path.insert(0, str(work / "tree"))
        chosen = Chosen(tests, distrusted(work))
        limit = "--timeout=0" if tests else "--timeout=40"
        options = [*PYTEST, "-m", "not slow", limit, "--tb=short", *([] if confirming else ["-x"])]
        code = int(pytest.main([*options, *files], plugins=[chosen]))
        result = {"failed": chosen.failed, "passed": chosen.passed, "code": code}
        told.write_text(json.dumps(result))
    finally:
        os._exit(code)


def _preload(modules: Iterable[str]) -> None:
    """Import what is not the product's, once for all children."""
    import importlib

    for name in modules:
        if name.partition(".")[0] in ("palpate", "tests", "coverage", "conftest", "xdist"):
            continue
        try:
            importlib.import_module(name)
        except Exception:
            continue
    _quiet_hypothesis()


def copy_tree(source: Path, work: Path) -> None:
    """Copy the tree, links as links, without what is no part of it."""
    skipped = (".git", ".venv", "runs", "*.egg-info", "__pycache__", ".*_cache")
    ignore = shutil.ignore_patterns(*skipped)
    shutil.copytree(source, work / "tree", symlinks=True, ignore=ignore)


def restore(source: Path, work: Path) -> None:
    """Take back a change that a killed run has left in the copy."""
    for room in ROOMS:
        for path in (source / room).rglob("*.py"):
            own = work / "tree" / path.relative_to(source)
            if not own.exists() or own.read_bytes() != path.read_bytes():
                shutil.copy2(path, own)


def environment(work: Path) -> dict[str, str]:
    """The environment of the tests: the copy comes first, and nothing is compiled to disk."""
    path = [str(work / "tree"), *filter(None, [os.environ.get("PYTHONPATH")])]
    one_thread = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL")}
    return {**os.environ, **one_thread, "PYTHONPATH": os.pathsep.join(path)}


@contextmanager
def standing(path: Path, point: Point, number: int) -> Iterator[None]:
    """Have a change stand in its file for a while."""
    source, stat = path.read_text("utf-8"), path.stat()
    text = changed(source, point)
    compile(text, str(path), "exec")
    try:
        path.write_text(text, "utf-8")
        later = stat.st_mtime + 100 + number  # or the compiled original would be taken for it
        os.utime(path, (later, later))
        yield
    finally:
        path.write_text(source, "utf-8")
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def distrusted(work: Path) -> list[str]:
    """Tests of no coverage, as those that start graphs, that were seen to fail without a change."""
    path = work / "distrusted.json"
    found: list[str] = json.loads(path.read_text()) if path.exists() else []
    return found


def distrust(work: Path, failed: Sequence[str]) -> bool:
    """Whether tests fail on the unchanged copy, too; they are remembered then."""
    tests = [one for one in failed if not one.startswith("collecting")]
    if not tests:
        return False
    wrong = run_tests(work, list(dict.fromkeys(map(_file_of, tests))), tests)["failed"]
    (work / "distrusted.json").write_text(json.dumps([*distrusted(work), *wrong]))
    return bool(wrong)


def run_site(work: Path, tests: Tests, bodies: Sequence[Body], site: Site) -> dict[str, Any]:
    """Make one change, run its tests, take it back."""
    row: dict[str, Any] = asdict(site) | {"result": "not found"}
    found = find(bodies, site)
    if found is None:
        return row
    body, point, how = found
    node = target(point)
    row |= {"found_by": how, "now": f"{body.file}:{node.lineno}", "now_function": body.name}
    row |= {"now_before": ast.unparse(node), "now_after": point.after}
    chosen = tests.choose(body.file, node, point.statement)
    files = list(dict.fromkeys(map(_file_of, chosen)))
    files = files or folder_of(tests.tree, body.file, site.file)
    row |= {"covered": bool(chosen), "tests": len(chosen)}
    with standing(tests.tree / body.file, point, site.number):
        ran = run_tests(work, files, chosen)
    while not chosen and ran["failed"] and distrust(work, ran["failed"]):
        with standing(tests.tree / body.file, point, site.number):
            ran = run_tests(work, files, chosen)
    row |= {"ended": ran["ended"], "by": ran["failed"][:1], "passed": ran["passed"]}
    row |= {"cpu": ran["cpu"], "wall": ran["wall"]}
    hung = ran["ended"] in ("cpu limit", "wall limit") and bool(chosen)
    broke = ran["ended"] in ("failed", "crashed")
    row["result"] = "caught" if hung or broke else "survived"
    return row


def confirm(work: Path, out: Path) -> None:
    """Run the tests that caught something on the unchanged copy: one that fails there proves none.

    What it caught is written as ``doubtful``.
    """
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    names = sorted({one for row in rows if row["result"] == "caught" for one in row.get("by", [])})
    tests = [one for one in names if not one.startswith("collecting")]
    if not tests:
        return
    ran = run_tests(work, list(dict.fromkeys(map(_file_of, tests))), tests, confirming=True)
    wrong = set(ran["failed"])
    print(f"of {len(tests)} tests that caught something {len(wrong)} fail without a change, too")
    for row in rows:
        if row["result"] == "caught" and wrong & set(row.get("by", [])):
            row["result"] = "doubtful"
    out.write_text("".join(json.dumps(row) + "\n" for row in rows))


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """The figures, and what survived."""
    counts = Counter(row["result"] for row in rows).most_common()
    lines = [f"{len(rows)} changes: " + ", ".join(f"{n} {what}" for what, n in counts)]
    for kind in sorted({row["kind"] for row in rows}):
        some = Counter(row["result"] for row in rows if row["kind"] == kind)
        lines.append(f"  {kind}: {some['caught']} of {sum(some.values())} caught")
    bare = [row for row in rows if row.get("covered") is False]
    caught = sum(row["result"] == "caught" for row in bare)
    lines.append(f"  on lines that no test executes in process: {caught} of {len(bare)} caught")
    how = Counter(row["found_by"] for row in rows if "found_by" in row)
    lines.append("  found by " + ", ".join(f"{name} {n}" for name, n in how.most_common()))
    for row in rows:
        if row["result"] != "caught":
            place = row.get("now", f"{row['file']}:{row['line']}")
            mark = "" if row.get("covered", True) else " (no test in process)"
            lines.append(
                f"{row['result']} {place} {row['function']}: {row['kind']},"
                f" {_short(row['before'])} -> {_short(row['after'])}{mark}"
            )
    return "\n".join(lines)


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) < 60 else line[:57] + "..."


def main(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tree", type=Path, help="checkout whose product is changed (in a copy)")
    parser.add_argument("--work", type=Path, required=True, help="folder for copy and coverage")
    parser.add_argument("--sites", type=Path, required=True, help="changes; drawn if not there")
    parser.add_argument("--out", type=Path, required=True, help="results, JSON lines")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ignore", action="append", default=list(IGNORED), help="tests left out")
    parser.add_argument("--find", action="store_true", help="only say what is found, and where")
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    told = parser.parse_args(argv)
    tree, work, out = told.tree.resolve(), told.work.resolve(), told.out.resolve()
    options = [f"--ignore={one}" for one in told.ignore]
    options += [*MARKS, f"--timeout={SLOWEST}"]
    if told.measure:
        measure(work, options)
        return 0
    bodies = bodies_of(tree)
    if not told.sites.exists():
        drawn = [asdict(site) for site in draw(bodies, told.count, told.seed)]
        told.sites.write_text(json.dumps(drawn, indent=1, ensure_ascii=False) + "\n")
    sites = [Site(**one) for one in json.loads(told.sites.read_text())]
    if told.find:
        hits = [(site, find(bodies, site)) for site in sites]
        for site, hit in hits:
            place = "not found"
            if hit is not None:
                place = f"{hit[0].file}:{target(hit[1]).lineno} {hit[2]}"
            print(f"{site.number} {site.file}:{site.line} {site.function} {site.kind}: {place}")
        print(Counter("not found" if hit is None else hit[2] for _, hit in hits))
        return 0
    work.mkdir(parents=True, exist_ok=True)
    if not (work / "tree").exists():
        copy_tree(tree, work)
    restore(tree, work)
    os.environ |= environment(work)
    if not (work / "tests.json").exists():
        own = [sys.executable, __file__, *argv, "--measure"]
        subprocess.run(own, check=True, stdout=(work / "measure.txt").open("w"))
    sys.dont_write_bytecode = True
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    tests = Tests(work, told.ignore)
    print(f"{len(tests.cpu)} tests to choose from, {len(tests.tests)} collected", flush=True)
    _preload(tests.modules)
    rows = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    done = {row["number"] for row in rows}
    bodies = bodies_of(work / "tree")
    for site in sites:
        if site.number in done:
            continue
        row = run_site(work, tests, bodies, site)
        with out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        place = row.get("now", f"{site.file}:{site.line}")
        ran = f"{row.get('tests', 0)} tests, {row.get('wall', 0.0):.0f} s"
        print(f"{site.number} {row['result']} {place} {site.kind} ({ran})", flush=True)
    confirm(work, out)
    print(report([json.loads(line) for line in out.read_text().splitlines()]))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
