"""Tests run on one change after the other, in children that have imported all but the product."""

from __future__ import annotations

import ast
import json
import os
import resource
import shutil
import signal
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dev.mutation.selection import (
    PYTEST,
    Tests,
    file_of,
    folder_of,
    quiet_hypothesis,
    usual_signals,
)
from dev.mutation.sites import ROOMS, Body, Point, Site, changed, find, target

CPU_LIMIT = 60  # Of one change, s; one that comes so far hangs, and counts as caught
WALL_LIMIT = 240.0  # The same on the clock: the machine may be shared
# On the clock, of a folder's tests on a line that none executes in process; then it survived.
FOLDER_LIMIT = 90.0


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
        usual_signals()
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


def preload(modules: Iterable[str]) -> None:
    """Import what is not the product's, once for all children."""
    import importlib

    for name in modules:
        if name.partition(".")[0] in ("palpate", "tests", "coverage", "conftest", "xdist"):
            continue
        try:
            importlib.import_module(name)
        except Exception:
            continue
    quiet_hypothesis()


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
    wrong = run_tests(work, list(dict.fromkeys(map(file_of, tests))), tests)["failed"]
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
    files = list(dict.fromkeys(map(file_of, chosen)))
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
    ran = run_tests(work, list(dict.fromkeys(map(file_of, tests))), tests, confirming=True)
    wrong = set(ran["failed"])
    print(f"of {len(tests)} tests that caught something {len(wrong)} fail without a change, too")
    for row in rows:
        if row["result"] == "caught" and wrong & set(row.get("by", [])):
            row["result"] = "doubtful"
    out.write_text("".join(json.dumps(row) + "\n" for row in rows))
