"""Inject faults into explorations of a scene, and check that they survive.

The scene is first explored without faults, then repeatedly while nodes are killed and stopped, the
disk of the recorder is full, a source floods it, tools join late and hang, and the launcher is
interrupted and killed. Each run must give the same solid and the same messages, and a recording
with every message once. A run that is ended must leave nothing behind, and give the same result
when it is resumed from its recording.

Kinds: kill, stop: SIGKILL or SIGSTOP to a node, in any phase. neighbours: SIGKILL to two nodes, of
which one subscribes to the other. recorder: SIGKILL to the recorder. full: its file cannot grow
until it is restarted. flood: a source publishes 100,000 messages as fast as it can. late: a tool
subscribes by the taps and is stopped when it has received something. ctrl_c, launcher: SIGINT to
all processes, SIGKILL to the launcher. A run gets up to eight faults, at most three on one node, or
one fault that ends it.

Independent code (history.py) checks recordings: messages of a topic are numbered from 0 without a
gap, no message from before a restart is received after it, and each frame, patch, contour, model
and score follows its cause.

Prints one line. Exits with 1 if a run did not survive; the reason, and the seed that repeats it
with --minutes 0, is on standard error. docs/bus.md has counts.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

from dev.chaos.fault_injection import FAULT_KINDS
from dev.chaos.trials import Exploration, run_trials
from palpate.launch.files.source_map import InputError
from palpate.launch.scene import find_scene


def main(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m dev.chaos",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seed", type=int, default=1, help="of the first run")
    parser.add_argument("--minutes", type=float, default=5.0, help="start no run after that")
    parser.add_argument("--scene", default="vase", help="a shipped scene's name or a YAML file")
    parser.add_argument("--fingers", type=int, default=1, choices=range(1, 9))
    parser.add_argument("--kinds", nargs="+", choices=FAULT_KINDS, default=FAULT_KINDS)
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(argv)
    try:
        scene = find_scene(options.scene).resolve()
    except InputError as error:
        parser.error(str(error))
    tally = run_trials(
        Exploration("explore", (f"scene:={scene}", f"fingers:={options.fingers}")),
        seed=options.seed,
        minutes=options.minutes,
        kinds=tuple(options.kinds),
        echo=lambda line: print(line, file=sys.stderr),
    )
    print(json.dumps(tally.figures) if options.json else tally)
    for seed, reason in tally.failed:
        print(f"dev.chaos --seed {seed} --minutes 0: {reason}", file=sys.stderr)
    return 1 if tally.failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
