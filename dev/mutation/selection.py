"""Which test executes which line, measured once with coverage, and which are run on a change."""

from __future__ import annotations

import ast
import json
import os
import resource
import signal
import sqlite3
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

MOST_TESTS = 60
BUDGET = 20.0  # Processor time that the chosen tests of one change take without it, s
GRAPH = "tests/graph"
PYTEST = ("-q", "-p", "no:cacheprovider", "-W", "ignore:Module already imported")


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
    quiet_hypothesis()
    usual_signals()
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


def usual_signals() -> None:
    """Undo what ``nohup`` and a shell's ``&`` leave to their children."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


def quiet_hypothesis() -> None:
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
        own = {one for one in self.cpu if file_of(one) in mirrored(self.tree, file)}
        near = {file_of(one) for one in covering}
        beside = {one for one in self.cpu if file_of(one) in near} if len(covering) < 20 else set()
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


def file_of(test: str) -> str:
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
