"""Change single lines of the product, one at a time, and count the changes that a test catches.

``python -m dev.mutation TREE --work DIR --sites SITES.json --out RESULTS.jsonl``

The tree is copied to the work folder, and only that folder, SITES.json and RESULTS.jsonl are
written. The suite runs there once with coverage and a context for each test, which gives the tests
that execute each line. For each change at most 60 of these run, the fastest first, until one fails;
they are chosen from the mirrored file first, and those that execute few lines before others. For a
line that no test executes in process, the tests of the mirrored folder run.

The sites are drawn by seed if SITES.json does not exist, else read from it. After files and names
of the tree have changed, a site is located by the shape of its function (a hash without names),
then by the function's name, then by the text or shape of its statement.

Needs coverage, beside what the tests need. Sites with a row in RESULTS.jsonl are not run again.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dev.mutation.runs import confirm, copy_tree, environment, preload, restore, run_site
from dev.mutation.selection import GRAPH, Tests, measure
from dev.mutation.sites import Site, bodies_of, draw, find, target

# Tests that start processes or compare bytes, and do not say what is wrong.
IGNORED = (GRAPH, "tests/golden")
PYTEST_OPTIONS = ("-m", "not slow and not graph", "--timeout=15")  # Slower tests are not chosen


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Counts by result and kind, and the changes that no test catches."""
    counts = Counter(row["result"] for row in rows).most_common()
    lines = [f"{len(rows)} changes: " + ", ".join(f"{n} {result}" for result, n in counts)]
    for kind in sorted({row["kind"] for row in rows}):
        results = Counter(row["result"] for row in rows if row["kind"] == kind)
        lines.append(f"  {kind}: {results['caught']} of {sum(results.values())} caught")
    bare = [row for row in rows if row.get("covered") is False]
    caught = sum(row["result"] == "caught" for row in bare)
    lines.append(f"  on lines that no test executes in process: {caught} of {len(bare)} caught")
    ways = Counter(row["found_by"] for row in rows if "found_by" in row)
    lines.append("  located by " + ", ".join(f"{name} {n}" for name, n in ways.most_common()))
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
    options = _parser().parse_args(argv)
    tree, work, out = (path.resolve() for path in (options.tree, options.work, options.out))
    if options.measure:
        measure(work, [*(f"--ignore={path}" for path in options.ignore), *PYTEST_OPTIONS])
        return 0
    sites = _sites(options.sites, tree, options.count, options.seed)
    if options.find:
        _print_places(sites, tree)
        return 0
    _prepare_copy(tree, work, argv)
    tests = Tests(work, options.ignore)
    print(f"{len(tests.cpu)} tests to choose from, {len(tests.tests)} collected", flush=True)
    preload(tests.modules)
    _run_sites(sites, work, tests, out)
    confirm(work, out)
    print(report(_rows(out)))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tree", type=Path, help="checkout whose product is changed, in a copy")
    parser.add_argument("--work", type=Path, required=True, help="folder for copy and coverage")
    parser.add_argument(
        "--sites", type=Path, required=True, help="changes; drawn if there are none"
    )
    parser.add_argument("--out", type=Path, required=True, help="results, JSON lines")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ignore", action="append", default=list(IGNORED), help="tests left out")
    parser.add_argument("--find", action="store_true", help="only print where changes are located")
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    return parser


def _sites(path: Path, tree: Path, count: int, seed: int) -> list[Site]:
    """Sites of a file; they are drawn and written if it does not exist."""
    if not path.exists():
        drawn = [asdict(site) for site in draw(bodies_of(tree), count, seed)]
        path.write_text(json.dumps(drawn, indent=1, ensure_ascii=False) + "\n")
    return [Site(**fields) for fields in json.loads(path.read_text())]


def _print_places(sites: Sequence[Site], tree: Path) -> None:
    """Print where each site is located in the tree."""
    bodies, ways = bodies_of(tree), Counter[str]()
    for site in sites:
        hit, found_by = find(bodies, site), "not found"
        place = found_by
        if hit is not None:
            body, point, found_by = hit
            place = f"{body.file}:{target(point).lineno} {found_by}"
        ways[found_by] += 1
        print(f"{site.number} {site.file}:{site.line} {site.function} {site.kind}: {place}")
    print(ways)


def _prepare_copy(tree: Path, work: Path, argv: Sequence[str]) -> None:
    """Copy the tree, set the environment of tests, and measure coverage, unless that is done."""
    work.mkdir(parents=True, exist_ok=True)
    if not (work / "tree").exists():
        copy_tree(tree, work)
    restore(tree, work)
    os.environ |= environment(work)
    if not (work / "tests.json").exists():
        own = [sys.executable, "-m", "dev.mutation", *argv, "--measure"]
        subprocess.run(own, check=True, stdout=(work / "measure.txt").open("w"))
    sys.dont_write_bytecode = True
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"


def _run_sites(sites: Sequence[Site], work: Path, tests: Tests, out: Path) -> None:
    """Run the tests of each site that has no row yet; append a row for each."""
    done = {row["number"] for row in _rows(out)}
    bodies = bodies_of(work / "tree")
    for site in sites:
        if site.number in done:
            continue
        row = run_site(work, tests, bodies, site)
        with out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        place = row.get("now", f"{site.file}:{site.line}")
        effort = f"{row.get('tests', 0)} tests, {row.get('wall', 0.0):.0f} s"
        print(f"{site.number} {row['result']} {place} {site.kind} ({effort})", flush=True)


def _rows(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
