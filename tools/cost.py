"""Robot time that the moves of a recorded run would take with another robot.

Fingers work at once, so a run takes as long as the slowest of them. A finger waits until another
finger ends a move, which is found from the recorded times; with another robot that move ends at
another time, and so does the wait. Any other wait is kept.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.robot_time import (
    ROBOTS,
    MoveDurations,
    MoveGeometry,
    RobotPreset,
    SlidingPreset,
    move_durations,
)
from palpate.launch.files.file_access import write_or_print
from palpate.launch.files.source_map import InputError, hint
from palpate.launch.printing import counted, text_table, titled
from palpate.launch.run_directory import find_bag, read_summary
from palpate.messages import CodecError, decode
from palpate.messages.recording import Recording, open_recording
from palpate.messages.types import ContourGoal, GraspContacts, ProbeGoal, TactileFrame, Turned
from palpate.nodes.runtime.node import recorded_nodes

PARTS = ("travel", "approach", "dwell", "retract", "wait")  # of a time, in the order of the table
Phase = Literal["grasp", "contours", "probes", "other"]  # purpose of a move; other: without a goal
PHASES: tuple[Phase, ...] = get_args(Phase)
Costs = dict[str, Any]
TIME_TOLERANCE = 1e-9  # relative difference of equal times, from the rounding of sums
SIMULATOR = "palpate.nodes.simulator"
HAND_FINGER = 1  # number of the finger whose arm moves the hand
# Messages that are read, by type, since topics can be renamed.
KINDS: Mapping[str, type] = {
    kind.__name__: kind for kind in (ContourGoal, ProbeGoal, TactileFrame, GraspContacts, Turned)
}


def plot_cost(run: Path, path: Path) -> None:
    """Draw the cost of a run against its accuracy into an SVG file; ``-`` is standard output.

    Raises InputError if the run has no summary, or one of another version, or the file cannot be
    written.
    """
    if str(path) != "-" and path.suffix != ".svg":
        raise InputError(f"--plot {path}: must end in .svg")
    from palpate.launch.cost_chart import cost_svg  # matplotlib takes long to import

    summary = read_summary(run)
    try:
        text = cost_svg(summary)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        why = "its figures are not those of this version of palpate; run it again"
        raise InputError(f"{run}: {why}") from None
    write_or_print(path, text)


def robot_time(run: Path, names: Sequence[str] = ()) -> Costs:
    """Costs of a recorded run with some robots, or all if none is named; keys contain the unit.

    Raises InputError if the recording cannot be read or has no moves, or a robot is unknown.
    """
    for name in names:
        if name not in ROBOTS:
            raise InputError(f"there is no robot {name!r}; {hint(name, ROBOTS)}")
    return costs_of(read_moves(run), tuple(dict.fromkeys(names)) or tuple(ROBOTS))


def costs_of(run: RunMoves, names: Sequence[str]) -> Costs:
    """Costs of the moves of a run with some robots."""
    closings = sum(finger.phases.count("grasp") for finger in run.fingers)
    touches = sum(len(finger.phases) for finger in run.fingers) - closings
    return {
        "recording": str(run.path),
        "complete": run.closed,
        "fingers": len(run.fingers),
        "touches": touches,
        "closings": closings,
        "recorded": _recorded_figures(run),
        "robots": {name: _cost(run, name, touches) for name in names},
    }


def _recorded_figures(run: RunMoves) -> Costs:
    """Recorded time, and its difference from the sum of the moves with the recorded robot."""
    slowest = max(run.fingers, key=lambda finger: float(finger.ends[-1]))
    ended, missing = float(slowest.ends[-1]), None
    if all(finger.robot in ROBOTS for finger in run.fingers):
        missing = 0.0
        for finger in run.fingers:
            durations = move_durations(finger.moves, ROBOTS[str(finger.robot)]).total()
            missing = max(missing, abs(float(durations.sum() - finger.ends[-1])))
    return {
        "robot": slowest.robot,
        "robot_time_s": ended,
        "missing_s": missing,
        "agrees": None if missing is None else missing <= TIME_TOLERANCE * ended,
    }


def _cost(run: RunMoves, name: str, touches: int) -> Costs:
    robot = ROBOTS[name]
    moved = with_recomputed_waits(run.fingers, robot)
    durations = [move_durations(moves, robot) for moves in moved]
    totals = [float(of_finger.total().sum()) for of_finger in durations]
    slowest = int(np.argmax(totals))
    phases, figures = np.array(run.fingers[slowest].phases), dict[str, Costs]()
    for phase in PHASES:
        if phase != "other" or phase in phases:
            parts = _part_figures(durations[slowest], phases == phase)
            moves = int((phases == phase).sum())
            mean = parts["total_s"] / moves if moves else None
            figures[phase] = {"moves": moves, **parts, "per_move_s": mean}
    return {
        **_part_figures(durations[slowest], np.ones(len(phases), dtype=bool)),
        "per_touch_s": totals[slowest] / touches if touches else None,
        "slowest_finger": run.fingers[slowest].finger,
        "finger_s": {str(f.finger): total for f, total in zip(run.fingers, totals, strict=True)},
        "phases": figures,
    }


def with_recomputed_waits(
    fingers: Sequence[FingerMoves], robot: RobotPreset | SlidingPreset
) -> list[MoveGeometry]:
    """Moves of all fingers, with the waits that a robot would have."""
    unwaiting = [finger.moves._replace(wait=0.0 * finger.moves.wait) for finger in fingers]
    lasts = [move_durations(moves, robot).total() for moves in unwaiting]
    waits = [finger.moves.wait.copy() for finger in fingers]
    ends = [np.zeros(len(finger.ends)) for finger in fingers]
    # Moves are taken in the order of their ends: an awaited move before the one that waits.
    order = sorted((end, i, k) for i, f in enumerate(fingers) for k, end in enumerate(f.ends))
    for end, finger, move in order:
        before = ends[finger][move - 1] if move else 0.0
        if waits[finger][move] > TIME_TOLERANCE * end:
            awaited = _awaited(fingers, finger, move)
            if awaited is not None:
                waits[finger][move] = max(ends[awaited[0]][awaited[1]] - before, 0.0)
        ends[finger][move] = before + waits[finger][move] + lasts[finger][move]
    return [f.moves._replace(wait=wait) for f, wait in zip(fingers, waits, strict=True)]


def _awaited(fingers: Sequence[FingerMoves], finger: int, move: int) -> tuple[int, int] | None:
    """Finger and move, as indices, whose end ends the wait of a move; None for any other wait."""
    own = fingers[finger]
    start = float(own.moves.wait[move]) + (float(own.ends[move - 1]) if move else 0.0)
    for i, other in enumerate(fingers):
        near = int(np.argmin(np.abs(other.ends - start)))
        if i != finger and abs(float(other.ends[near]) - start) <= TIME_TOLERANCE * start:
            return i, near
    return None


def _part_figures(durations: MoveDurations, mask: Bools) -> Costs:
    parts = {f"{part}_s": float(getattr(durations, part)[mask].sum()) for part in PARTS}
    return {**parts, "total_s": float(durations.total()[mask].sum())}


# Simulator of a finger, and rows, goals and ends of its moves.
_Moved = tuple[str, list[Floats], list[int | None], list[float]]


def read_moves(run: Path) -> RunMoves:
    """Moves of a run; raises InputError if it cannot be read, or has none."""
    path = find_bag(run)
    try:
        recording = open_recording(path)
        robots = _robots(recording)
        phases, moved = _collected(recording)
    except CodecError as error:
        raise InputError(f"{path}: was recorded with other messages: {error}") from None
    except ValueError as error:
        raise InputError(str(error)) from None
    fingers = tuple(
        FingerMoves(
            number,
            robots.get(publisher),
            MoveGeometry.of_rows(np.array(rows)),
            tuple(phases.get(goal, "other") for goal in goals),
            np.array(ends),
        )
        for number, (publisher, rows, goals, ends) in sorted(moved.items())
    )
    # Frames of a sensor that no arm moves have moves of length zero.
    if not any((finger.moves.approach > 0.0).any() for finger in fingers):
        raise InputError(f"{path}: holds no moves of an arm, so no robot's time follows from it")
    return RunMoves(path, fingers, recording.closed)


def _collected(recording: Recording) -> tuple[dict[int | None, Phase], dict[int, _Moved]]:
    """Phase of each goal, None for closings of the hand; and moves by number of the finger."""
    phases: dict[int | None, Phase] = {None: "grasp"}
    moves: dict[int, _Moved] = {}
    seen = set[tuple[int, int, int]]()
    for kept in recording.messages():
        message: object = decode(KINDS[kept.type], kept.body) if kept.type in KINDS else None
        match message:
            case ContourGoal(id=goal):
                phases[goal] = "contours"
                continue
            case ProbeGoal(id=goal):
                phases[goal] = "probes"
                continue
            case GraspContacts() | Turned() as moved:
                number, named = HAND_FINGER, None
            case TactileFrame() as moved:
                number, named = moved.finger, moved.goal
                key = (moved.finger, moved.goal, moved.touch)
                if key in seen:  # a network link may deliver a frame twice
                    continue
                seen.add(key)
            case _:
                continue
        _, rows, goals, ends = moves.setdefault(number, (kept.publisher, [], [], []))
        rows.append(moved.move)
        goals.append(named)
        ends.append(moved.robot_time)
    return phases, moves


def _robots(recording: Recording) -> dict[str, str]:
    """Presets of the recorded simulators, by their names in the graph."""
    nodes = recorded_nodes(recording.graph) if recording.graph else ()
    simulators = [node for node in nodes if node.module == SIMULATOR]
    presets = {node.name: json.loads(bytes(node.params)).get("robot") for node in simulators}
    return {name: robot for name, robot in presets.items() if isinstance(robot, str)}


class FingerMoves(NamedTuple):
    """Moves of one finger."""

    finger: int  # its number, from 1
    robot: str | None  # preset that its recorded times follow from, if known
    moves: MoveGeometry  # in order
    phases: tuple[Phase, ...]  # purpose of each move
    ends: Floats  # (n,) recorded robot time at the end of each move [s]


class RunMoves(NamedTuple):
    """Moves of all fingers."""

    path: Path  # of the recording
    fingers: tuple[FingerMoves, ...]  # by number; at least one
    closed: bool  # whether the recording is complete


def robot_time_text(costs: Costs, title_width: int = 12) -> str:
    """Text of what `robot_time` returns; `title_width` of the first column [letters]."""
    fingers, closings = costs["fingers"], costs["closings"]
    counts = [counted(costs["touches"], "touch", "touches")]
    counts += [f"{counted(closings, 'closing')} of the hand"] if closings else []
    counts += [f"{fingers} fingers"] if fingers > 1 else []
    lines = titled("read", f"{costs['recording']}: {', '.join(counts)}", width=title_width)
    for title, text in _recorded_rows(costs):
        lines += titled(title, text, width=title_width)
    for name, cost in costs["robots"].items():
        lines += ["", *_phase_table(name, cost, title_width)]
        for title, text in _finger_rows(cost, costs["fingers"]):
            lines += titled(title, text, width=title_width)
    return "\n".join(lines)


def _recorded_rows(costs: Costs) -> Iterator[tuple[str, str]]:
    recorded = costs["recorded"]
    time, warnings = f"{recorded['robot_time_s']:.1f} s", []
    if recorded["agrees"] is None:
        warnings = ["which robot made that is not known, so it cannot be checked"]
    else:
        time = f"{recorded['robot']}, {time}"
    if recorded["agrees"]:
        time += ": its moves add up to that"
    elif recorded["agrees"] is False:
        warnings = [f"its moves miss that by {recorded['missing_s']:.3g} s: some are lost"]
    if not costs["complete"]:
        warnings.append("the recording was never closed: its end may be missing")
    yield "recorded", time
    yield from (("warning", text) for text in warnings)


def _phase_table(name: str, cost: Mapping[str, Any], title_width: int) -> list[str]:
    """Times of the parts of moves with a robot, for each phase; of the slowest finger."""
    phases = {phase: part for phase, part in cost["phases"].items() if part["moves"]}
    rows = [(f"{name}, s", *phases, "all")]
    for part in (*PARTS, "total"):
        rows.append((part, *(f"{times[f'{part}_s']:.1f}" for times in (*phases.values(), cost))))
    moves = [part["moves"] for part in phases.values()]
    rows.append(("moves", *map(str, (*moves, sum(moves)))))
    widths = (title_width, *[8] * len(moves), 8)
    return text_table(rows, right=range(1, len(rows[0])), min_widths=widths)


def _finger_rows(cost: Mapping[str, Any], fingers: int) -> Iterator[tuple[str, str]]:
    if fingers > 1:
        totals = ", ".join(f"{number} {total:.1f} s" for number, total in cost["finger_s"].items())
        yield "fingers", f"{totals}; the table is of the slowest"
    if cost["per_touch_s"] is not None:
        yield "a touch", f"{cost['per_touch_s']:.2f} s, all counted"
