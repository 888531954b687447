"""Tests that execute each line, measured with coverage, and the choice of tests for a change."""

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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

GRAPH = "tests/graph"
PYTEST = ("-q", "-p", "no:cacheprovider", "-W", "ignore:Module already imported")


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectionSettings:
    """How many tests run on a change."""

    max_tests: int = 60
    max_time: float = 20.0  # [s] processor time of these tests without a change
    min_covering: int = 20  # tests that execute the line; with fewer, others of their files follow


class Contexts:
    """A plugin of pytest with a context of coverage for each test and each shared fixture."""

    def __init__(self, coverage: Any) -> None:
        self.coverage = coverage
        self.tests: dict[str, dict[str, Any]] = {}
        self.done = 0

    def pytest_collection_finish(self, session: Any) -> None:
        for item in session.items:
            info = getattr(item, "_fixtureinfo", None)
            by_name = {} if info is None else info.name2fixturedefs
            names = [_fixture(fixture) for fixtures in by_name.values() for fixture in fixtures]
            self.tests[item.nodeid] = {"fixtures": [name for name in names if name], "cpu": None}

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
        """Run shared fixtures in contexts of their own as well."""
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
    """Name of a shared fixture's context; None for a fixture that each test sets up."""
    if fixturedef.scope == "function" or not fixturedef.baseid:
        return None
    return f"fixture {fixturedef.baseid}::{fixturedef.argname}"


def _cpu() -> float:
    own, children = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def measure(work: Path, options: Sequence[str]) -> None:
    """Run the suite of the copy with coverage; this needs a process of its own."""
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
    homes = tuple(str(Path(entry)) for entry in sys.path if "site-packages" in entry)
    modules = [
        name
        for name, module in sys.modules.items()
        if (getattr(module, "__file__", None) or "").startswith(homes) and "editable" not in name
    ]
    result = {"code": int(code), "tests": contexts.tests, "modules": modules}
    (work / "tests.json").write_text(json.dumps(result))


def usual_signals() -> None:
    """Restore the signal handlers that ``nohup`` and a shell's ``&`` change."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


def quiet_hypothesis() -> None:
    """Make hypothesis deterministic, and without deadlines."""
    try:
        from hypothesis import settings
    except ImportError:
        return
    settings.register_profile("mutation", deadline=None, database=None, derandomize=True)
    settings.load_profile("mutation")


class Tests:
    """All tests, their costs, and the lines that they execute."""

    def __init__(self, work: Path, ignored: Sequence[str]) -> None:
        from coverage import CoverageData
        from coverage.numbits import numbits_to_nums

        stored = json.loads((work / "tests.json").read_text())
        self.tree = work / "tree"
        self.tests: dict[str, Any] = stored["tests"]
        self.modules: list[str] = stored["modules"]
        self.cpu = {
            name: test["cpu"]
            for name, test in self.tests.items()
            if test["cpu"] is not None
            and not test.get("failed", True)
            and not name.startswith(tuple(ignored))
        }
        self.users: dict[str, list[str]] = defaultdict(list)
        for name, test in self.tests.items():
            for fixture in test["fixtures"]:
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
        """The tests that execute one of the lines."""
        by_line = self.data.contexts_by_lineno(str((self.tree / file).resolve()))
        contexts = {context for line in lines for context in by_line.get(line, ())}
        users = {test for context in contexts for test in self.users.get(context, ())}
        return {test for test in users | contexts if test in self.cpu}

    def choose(
        self,
        file: str,
        node: ast.AST,
        statement: ast.stmt,
        settings: SelectionSettings = SelectionSettings(),
    ) -> list[str]:
        """Tests for a change, the fastest first; empty if no test executes it."""
        covering = self.executing(file, _lines(node)) or self.executing(file, _lines(statement)[:1])
        if not covering:
            return []
        own = {test for test in self.cpu if file_of(test) in mirrored(self.tree, file)}
        files = {file_of(test) for test in covering}
        is_few = len(covering) < settings.min_covering
        same_files = {test for test in self.cpu if file_of(test) in files} if is_few else set()
        chosen: list[str] = []
        spent = 0.0
        for tests in (covering & own, covering - own, own - covering, same_files - covering - own):
            for test in self._in_turn(tests):
                has_time = spent + self.cpu[test] < settings.max_time
                if len(chosen) < settings.max_tests and (has_time or not chosen):
                    chosen.append(test)
                    spent += self.cpu[test]
        return sorted(chosen, key=lambda test: (self.cpu[test], test))

    def _in_turn(self, tests: set[str]) -> list[str]:
        """Tests that execute few lines first, and one case of each function before its second."""
        functions: dict[str, list[str]] = defaultdict(list)
        for test in sorted(tests, key=lambda test: (self.breadth[test], test)):
            functions[test.partition("[")[0]].append(test)
        rounds = [
            (i, self.breadth[test], test)
            for cases in functions.values()
            for i, test in enumerate(cases)
        ]
        return [test for *_, test in sorted(rounds)]


def _lines(node: ast.AST) -> range:
    first, last = getattr(node, "lineno", 1), getattr(node, "end_lineno", None)
    return range(first, (last or first) + 1)


def file_of(test: str) -> str:
    return test.partition("::")[0]


def mirrored(tree: Path, file: str) -> list[str]:
    """The test files with the name of a product file."""
    mirror = Path("tests") / file
    folder = tree / mirror.parent
    paths = sorted(folder.glob(f"test_{mirror.stem}*.py")) if folder.is_dir() else []
    return [path.relative_to(tree).as_posix() for path in paths]


def folder_of(tree: Path, file: str, before: str) -> list[str]:
    """Test files for a line that no test executes in process.

    First those with the file's name, then those that share a word with it or with its name in
    `before`, also of the folder that starts graphs, then the rest of these folders.
    """
    folder = Path("tests") / Path(file).parent
    while not (tree / folder).is_dir():
        folder = folder.parent
    own = mirrored(tree, file)
    words = set(Path(file).stem.split("_")) | set(Path(before).stem.split("_"))

    def order(path: str) -> tuple[bool, int, str]:
        return path not in own, -len(words & set(Path(path).stem.split("_"))), path

    near = [path.relative_to(tree).as_posix() for path in (tree / folder).glob("test_*.py")]
    graph = [path.relative_to(tree).as_posix() for path in (tree / GRAPH).glob("test_*.py")]
    similar = [path for path in (*near, *graph) if order(path)[1] < 0 or path in own]
    rest = sorted(set(near) - set(similar)), sorted(set(graph) - set(similar))
    is_started = Path(file).parts[0] in ("nodes", "launch", "messages", "tools")
    return [*sorted(similar, key=order), *(rest[1] if is_started else []), *rest[0]]
