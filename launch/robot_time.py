"""What the moves of a run would have cost one robot or another.

Fingers work at once, so the run takes as long as the slowest of them does.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from palpate.core.arrays import Bools
from palpate.core.explore.robot_time import ROBOTS, Durations, durations
from palpate.launch.located import InputError
from palpate.launch.nearest import hint
from palpate.launch.robot_time_recording import FingerMoves, Phase, RunMoves, read_moves
from palpate.launch.robot_time_waits import SAME, rescheduled

PARTS = ("travel", "approach", "dwell", "retract", "wait")
"""Of a time, in the order in which they are told."""
PHASES: tuple[Phase, ...] = get_args(Phase)

Costs = dict[str, Any]


def robot_time(run: Path, names: Sequence[str] = ()) -> Costs:
    """What a recorded run would have cost, by stable names with the unit in them.

    Parameters
    ----------
    run : Path
        A recording, or the folder of a run.
    names : sequence of str
        Robots; all that palpate knows if none is named.

    Raises
    ------
    InputError
        If the recording cannot be read or tells no moves, or a robot is unknown.
    """
    for name in names:
        if name not in ROBOTS:
            raise InputError(f"there is no robot {name!r}; {hint(name, ROBOTS)}")
    return costs_of(read_moves(run), tuple(dict.fromkeys(names)) or tuple(ROBOTS))


def costs_of(run: RunMoves, names: Sequence[str]) -> Costs:
    """The same of moves that were read."""
    closings = sum(one.phases.count("grasp") for one in run.fingers)
    touches = sum(len(one.phases) for one in run.fingers) - closings
    return {
        "recording": str(run.path),
        "complete": run.closed,
        "fingers": len(run.fingers),
        "touches": touches,
        "closings": closings,
        "recorded": _recorded(run),
        "robots": {name: _cost(run, name, touches) for name in names},
    }


def _recorded(run: RunMoves) -> Costs:
    """The recorded times against the sum of the moves, as the same robot makes them."""
    slowest = max(run.fingers, key=lambda one: float(one.ends[-1]))
    ended = float(slowest.ends[-1])
    known = all(one.robot in ROBOTS for one in run.fingers)
    missing = max(map(_missing, run.fingers)) if known else None
    return {
        "robot": slowest.robot,
        "robot_time_s": ended,
        "missing_s": missing,
        "agrees": None if missing is None else missing <= SAME * ended,
    }


def _missing(finger: FingerMoves) -> float:
    """By how much its moves, as its own robot makes them, miss its recorded time, s."""
    made = durations(finger.moves, ROBOTS[str(finger.robot)]).total().sum()
    return abs(float(made - finger.ends[-1]))


def _cost(run: RunMoves, name: str, touches: int) -> Costs:
    robot = ROBOTS[name]
    made = [durations(moves, robot) for moves in rescheduled(run.fingers, robot)]
    totals = [float(one.total().sum()) for one in made]
    slowest = int(np.argmax(totals))
    phases = np.array(run.fingers[slowest].phases)
    total = totals[slowest]
    return {
        **_parts(made[slowest], np.ones(len(phases), dtype=bool)),
        "per_touch_s": total / touches if touches else None,
        "slowest_finger": run.fingers[slowest].finger,
        "finger_s": {str(one.finger): s for one, s in zip(run.fingers, totals, strict=True)},
        "phases": {
            phase: _phase(made[slowest], phases == phase)
            for phase in PHASES
            if phase != "other" or phase in phases
        },
    }


def _phase(made: Durations, which: Bools) -> Costs:
    parts, moves = _parts(made, which), int(which.sum())
    return {"moves": moves, **parts, "per_move_s": parts["total_s"] / moves if moves else None}


def _parts(made: Durations, which: Bools) -> Costs:
    parts = {f"{part}_s": float(getattr(made, part)[which].sum()) for part in PARTS}
    return {**parts, "total_s": float(made.total()[which].sum())}
