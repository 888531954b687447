"""Runs of tests on changes, in children that have imported all modules but the product's."""

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
from dataclasses import asdict, dataclass
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


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLimits:
    """Limits of the tests of one change; times in [s]."""

    cpu: int = 60  # processor time of chosen tests; beyond it a change counts as caught: it hangs
    wall: float = 240.0  # elapsed time of chosen tests; longer, since the machine may be shared
    folder_wall: float = 90.0  # elapsed time of a folder's tests; a change beyond it survives
    folder_test: int = 40  # elapsed time of each of these tests
    confirming_wall: float = 1800.0  # elapsed time of tests without a change
    poll_interval: float = 0.02  # between two checks whether the tests have ended


LIMITS = RunLimits()


class ChosenTests:
    """A plugin of pytest that runs the chosen tests in their order and records failures."""

    def __init__(self, tests: Sequence[str], distrusted: Iterable[str]) -> None:
        self.order = {test: i for i, test in enumerate(tests)}
        self.distrusted = set(distrusted)
        self.failed: list[str] = []
        self.passed = 0

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        if self.order:
            items[:] = [item for item in items if item.nodeid in self.order]
            items.sort(key=lambda item: self.order[item.nodeid])
        else:
            items[:] = [item for item in items if item.nodeid not in self.distrusted]

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
    """Run tests in a child of this process, which has imported all modules but the product's.

    Returns
    -------
    dict
        ``ended`` is ``passed``, ``failed``, ``crashed``, ``cpu limit`` or ``wall limit``;
        ``failed`` has names, ``passed`` a number, ``cpu`` and ``wall`` are times in s.
    """
    limit = LIMITS.confirming_wall
    if not confirming:
        limit = LIMITS.wall if tests else LIMITS.folder_wall
    result_file = work / "result.json"
    result_file.unlink(missing_ok=True)
    start = time.monotonic()
    pid = os.fork()
    if pid == 0:
        _child(work, files, tests, result_file, confirming)
    status, usage, has_timed_out = _wait(pid, start + limit)
    result: dict[str, Any] = {"failed": [], "passed": 0}
    ended = "wall limit"
    if result_file.exists():
        result = json.loads(result_file.read_text())
        is_broken = result["code"] not in (0, 1, 5)  # 5: there are no tests
        ended = "failed" if result["failed"] else "crashed" if is_broken else "passed"
    elif not has_timed_out:
        is_limited = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU
        ended = "cpu limit" if is_limited else "crashed"
    result["ended"] = ended
    result["cpu"] = round(usage.ru_utime + usage.ru_stime, 2)
    result["wall"] = round(time.monotonic() - start, 2)
    return result


def _wait(pid: int, deadline: float) -> tuple[int, resource.struct_rusage, bool]:
    """Wait for a child, and kill its session at the deadline and at its end.

    Returns its status and usage, and whether the deadline passed.
    """
    has_timed_out = False
    while True:
        done, status, usage = os.wait4(pid, os.WNOHANG)
        if done:
            break
        if time.monotonic() > deadline:
            has_timed_out = True
            os.killpg(pid, signal.SIGKILL)
        time.sleep(LIMITS.poll_interval)
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)  # processes that tests left behind
    return status, usage, has_timed_out


def _child(
    work: Path, files: Sequence[str], tests: Sequence[str], result_file: Path, confirming: bool
) -> None:
    import pytest

    code = 1
    try:
        os.setsid()
        usual_signals()
        if tests and not confirming:
            resource.setrlimit(resource.RLIMIT_CPU, (LIMITS.cpu, LIMITS.cpu + 5))
        output = os.open(work / "output.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.chdir(work / "tree")
        sys.path.insert(0, str(work / "tree"))
        chosen = ChosenTests(tests, distrusted(work))
        limit = f"--timeout={0 if tests else LIMITS.folder_test}"
        options = [*PYTEST, "-m", "not slow", limit, "--tb=short", *([] if confirming else ["-x"])]
        code = int(pytest.main([*options, *files], plugins=[chosen]))
        result = {"failed": chosen.failed, "passed": chosen.passed, "code": code}
        result_file.write_text(json.dumps(result))
    finally:
        os._exit(code)


def preload(modules: Iterable[str]) -> None:
    """Import modules that are not the product's, once for all children."""
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
    """Copy the tree, links as links, without caches and environments."""
    skipped = (".git", ".venv", "runs", "*.egg-info", "__pycache__", ".*_cache")
    ignore = shutil.ignore_patterns(*skipped)
    shutil.copytree(source, work / "tree", symlinks=True, ignore=ignore)


def restore(source: Path, work: Path) -> None:
    """Undo a change that a killed run left in the copy."""
    for room in ROOMS:
        for path in (source / room).rglob("*.py"):
            own = work / "tree" / path.relative_to(source)
            if not own.exists() or own.read_bytes() != path.read_bytes():
                shutil.copy2(path, own)


def environment(work: Path) -> dict[str, str]:
    """The environment of the tests: the copy is first on the path, and one thread calculates."""
    path = [str(work / "tree"), *filter(None, [os.environ.get("PYTHONPATH")])]
    one_thread = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL")}
    return {**os.environ, **one_thread, "PYTHONPATH": os.pathsep.join(path)}


@contextmanager
def applied(path: Path, point: Point, number: int) -> Iterator[None]:
    """Apply a change to its file until the end of the context."""
    source, stat = path.read_text("utf-8"), path.stat()
    text = changed(source, point)
    compile(text, str(path), "exec")
    try:
        path.write_text(text, "utf-8")
        later = stat.st_mtime + 100 + number  # so that the compiled original is not used
        os.utime(path, (later, later))
        yield
    finally:
        path.write_text(source, "utf-8")
        os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def distrusted(work: Path) -> list[str]:
    """Tests that failed without a change, as far as known."""
    path = work / "distrusted.json"
    tests: list[str] = json.loads(path.read_text()) if path.exists() else []
    return tests


def distrust(work: Path, failed: Sequence[str]) -> bool:
    """Whether tests also fail on the unchanged copy; records those that do."""
    tests = [test for test in failed if not test.startswith("collecting")]
    if not tests:
        return False
    wrong = run_tests(work, list(dict.fromkeys(map(file_of, tests))), tests)["failed"]
    (work / "distrusted.json").write_text(json.dumps([*distrusted(work), *wrong]))
    return bool(wrong)


def run_site(work: Path, tests: Tests, bodies: Sequence[Body], site: Site) -> dict[str, Any]:
    """Apply one change, run its tests, and undo it."""
    row: dict[str, Any] = asdict(site) | {"result": "not found"}
    location = find(bodies, site)
    if location is None:
        return row
    body, point, found_by = location
    node = target(point)
    row |= {"found_by": found_by, "now": f"{body.file}:{node.lineno}", "now_function": body.name}
    row |= {"now_before": ast.unparse(node), "now_after": point.after}
    chosen = tests.choose(body.file, node, point.statement)
    files = list(dict.fromkeys(map(file_of, chosen)))
    files = files or folder_of(tests.tree, body.file, site.file)
    row |= {"covered": bool(chosen), "tests": len(chosen)}
    with applied(tests.tree / body.file, point, site.number):
        result = run_tests(work, files, chosen)
    while not chosen and result["failed"] and distrust(work, result["failed"]):
        with applied(tests.tree / body.file, point, site.number):
            result = run_tests(work, files, chosen)
    row |= {"ended": result["ended"], "by": result["failed"][:1], "passed": result["passed"]}
    row |= {"cpu": result["cpu"], "wall": result["wall"]}
    has_hung = result["ended"] in ("cpu limit", "wall limit") and bool(chosen)
    has_failed = result["ended"] in ("failed", "crashed")
    row["result"] = "caught" if has_hung or has_failed else "survived"
    return row


def confirm(work: Path, out: Path) -> None:
    """Run the tests that caught a change on the unchanged copy.

    Changes whose test also fails there are marked ``doubtful``.
    """
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    caught = [row for row in rows if row["result"] == "caught"]
    names = sorted({test for row in caught for test in row.get("by", [])})
    tests = [test for test in names if not test.startswith("collecting")]
    if not tests:
        return
    ran = run_tests(work, list(dict.fromkeys(map(file_of, tests))), tests, confirming=True)
    wrong = set(ran["failed"])
    print(f"of {len(tests)} tests that caught a change {len(wrong)} also fail without it")
    for row in caught:
        if wrong & set(row.get("by", [])):
            row["result"] = "doubtful"
    out.write_text("".join(json.dumps(row) + "\n" for row in rows))
