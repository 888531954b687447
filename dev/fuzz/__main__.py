"""Damage sound messages and files, and read them: what is not refused in one sentence is a defect.

    python -m dev.fuzz                             100,000 messages and 6,500 files; some minutes
    python -m dev.fuzz --quick                     2,250 in all
    python -m dev.fuzz --only meshes               messages, recordings, meshes, scenes or solids
    python -m dev.fuzz --only meshes --number 42   a single one, and what came of it

Damage is made from seeds and by hand. An input is accepted and valid, refused in one sentence by
one error, or a defect that is told with its number. New hand-made files and new mutations may be
added at the end of their lists (a number is a seed: to put one in the middle changes what all
later numbers mean). Exits with 1 if there is a defect, or if one took too long or too much memory.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial


def main(argv: Sequence[str]) -> int:
    from dev.fuzz.trials import INPUT_KINDS, fuzz_rows, reproduce
    from palpate.bench.table import run_groups

    parser = argparse.ArgumentParser(
        prog="python -m dev.fuzz",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="few of each kind")
    parser.add_argument("--only", choices=INPUT_KINDS, help="one kind of input")
    parser.add_argument("--number", type=int, help="with --only: this one by itself")
    told = parser.parse_args(argv)
    if told.number is None:
        kinds = tuple(INPUT_KINDS) if told.only is None else (told.only,)
        return run_groups({"fuzz": partial(fuzz_rows, kinds=kinds)}, quick=told.quick, strict=True)
    if told.only is None or told.number < 0:
        parser.error(f"--number needs --only and is 0 or more, got {told.number}")
    outcome = reproduce(told.only, told.number)
    print(f"{outcome.verdict}, {outcome.seconds:.3f} s: {outcome.reason}".removesuffix(": "))
    return int(outcome.verdict == "defect")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
