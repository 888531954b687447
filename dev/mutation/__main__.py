"""Change single lines of the product, one at a time, and count how many changes some test catches.

``python -m dev.mutation TREE --work DIR --sites SITES.json --out RESULTS.jsonl``

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

# They start processes, or compare bytes: not what says what is wrong.
IGNORED = (GRAPH, "tests/golden")
SLOWEST = 15  # A test that takes longer is none of those that are chosen from, s
MARKS = ("-m", "not slow and not graph")


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
        own = [sys.executable, "-m", "dev.mutation", *argv, "--measure"]
        subprocess.run(own, check=True, stdout=(work / "measure.txt").open("w"))
    sys.dont_write_bytecode = True
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    tests = Tests(work, told.ignore)
    print(f"{len(tests.cpu)} tests to choose from, {len(tests.tests)} collected", flush=True)
    preload(tests.modules)
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
