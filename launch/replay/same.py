"""Whether a run that went on with another one has the same past."""

from __future__ import annotations

from pathlib import Path

from palpate.launch.bag.bag_file import find_bag
from palpate.launch.bag.diff import compare
from palpate.launch.run_dir import RECORDING


def other_past(bag: Path, run: Path) -> str:
    """What of the earlier run came out otherwise, in a sentence; empty if nothing did.

    Parameters
    ----------
    bag : Path
        The earlier recording, or the folder of its run.
    run : Path
        The run directory of the run that went on with it.
    """
    if not (run / RECORDING).exists():
        return ""
    found = compare(bag, run).topics.items()
    differ = [f"{topic} ({one.differ} of {one.compared})" for topic, one in found if one.differ]
    if not differ:
        return ""
    return (
        f"{', '.join(differ)} came out otherwise than recorded: other code, or other versions; "
        f"palpate bag diff {find_bag(bag)} {run} shows it"
    )
