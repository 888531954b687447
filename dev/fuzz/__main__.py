"""Damage valid messages and files, and read them: each must be valid or refused in one sentence.

    python -m dev.fuzz                             100,000 messages and 6,500 files; some minutes
    python -m dev.fuzz --quick                     2,250 in all
    python -m dev.fuzz --only meshes               messages, recordings, meshes, scenes or solids
    python -m dev.fuzz --only meshes --number 42   a single input, and its result

Damage is random by seed, or made by hand. An input is accepted and valid, refused in one sentence
by one error, or a defect, which is reported with its number. Add hand-made files and mutations at
the end of their lists: a number is a seed, and an insertion changes all later inputs. Exits with 1
if there is a defect, or if an input takes too long or too much memory.
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
    parser.add_argument("--quick", action="store_true", help="fewer of each kind")
    parser.add_argument("--only", choices=INPUT_KINDS, help="one kind of input")
    parser.add_argument("--number", type=int, help="with --only: a single input")
    options = parser.parse_args(argv)
    if options.number is None:
        kinds = tuple(INPUT_KINDS) if options.only is None else (options.only,)
        return run_groups(
            {"fuzz": partial(fuzz_rows, kinds=kinds)}, quick=options.quick, strict=True
        )
    if options.only is None or options.number < 0:
        parser.error(f"--number needs --only and is 0 or more, got {options.number}")
    outcome = reproduce(options.only, options.number)
    print(f"{outcome.verdict}, {outcome.seconds:.3f} s: {outcome.reason}".removesuffix(": "))
    return int(outcome.verdict == "defect")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
