"""Put faults into running explorations of a scene, and say what they survive.

The scene is explored undisturbed first. Then it is explored again and again, while nodes are
killed and stopped, the recorder has no more room, a source floods it, tools join late and hang,
and the launcher is interrupted and killed. Each run must come to the same solid and the same
messages, and leave a recording that holds every message once; whoever is ended must leave nothing
behind, and go on from its recording to the same end.

Kinds: kill, stop: SIGKILL or SIGSTOP to a node, in any phase. neighbours: SIGKILL to two nodes, of
which one subscribes to the other. recorder, full: SIGKILL to the recorder, whose file may not grow
until it is started again. flood: a source publishes 100,000 messages as fast as it can. late: a
tool joins by the taps and is stopped as soon as it has received something. ctrl_c, launcher: SIGINT
to all processes, SIGKILL to the launcher. A run meets up to eight faults, at most three on one
node, or one that ends it.

Independent code (history.py) checks recordings: messages of a topic are numbered from 0 without a
gap, nothing from before a restart is received after it, and each frame, patch, contour, model and
score follows what it answers.

Prints one line. Exits with 1 if anything did not survive; what it was, and the seed that repeats
it with --minutes 0, is on standard error. docs/bus.md has counts.
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
    parser.add_argument("--minutes", type=float, default=5.0, help="begin no run after that")
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
    for seed, what in tally.failed:
        print(f"dev.chaos --seed {seed} --minutes 0: {what}", file=sys.stderr)
    return 1 if tally.failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
