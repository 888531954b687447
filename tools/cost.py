"""What the moves of a recorded run would have cost one robot or another.

Fingers work at once, so a run takes as long as the slowest of them. A finger that waits does so
until another one has come to the end of a move, which is seen from the recorded times; with
another robot that move ends at another time, and the wait with it. Any other wait stays as it was.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
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

PARTS = ("travel", "approach", "dwell", "retract", "wait")  # Of a time, in the order told
Phase = Literal["grasp", "contours", "probes", "other"]  # What a move was for; other without a goal
PHASES: tuple[Phase, ...] = get_args(Phase)
Costs = dict[str, Any]
TIME_TOLERANCE = 1e-9  # Times that differ by less of themselves are one: sums are rounded
SIMULATOR = "palpate.nodes.simulator"
HAND_FINGER = 1  # The hand is moved by the arm of this finger
# What is read, by type: topics may have been given other names.
KINDS: Mapping[str, type] = {
    kind.__name__: kind for kind in (ContourGoal, ProbeGoal, TactileFrame, GraspContacts, Turned)
}
TITLE_WIDTH = 12  # Letters


def plot_cost(run: Path, path: Path) -> None:
    """Draw what accuracy cost a run into an SVG file; ``-`` is standard output.

    Raises InputError if the run has no figures, or those of another version, or the file cannot be
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
    """What a recorded run would have cost robots, or all known, by names with the unit in them.

    Raises InputError if the recording cannot be read or tells no moves, or a robot is unknown.
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
        "recorded": _recorded_figures(run),
        "robots": {name: _cost(run, name, touches) for name in names},
    }


def _recorded_figures(run: RunMoves) -> Costs:
    """The recorded times against the sum of the moves, as the same robot makes them."""
    slowest = max(run.fingers, key=lambda one: float(one.ends[-1]))
    ended, missing = float(slowest.ends[-1]), None
    if all(one.robot in ROBOTS for one in run.fingers):
        missing = 0.0
        for one in run.fingers:
            made = move_durations(one.moves, ROBOTS[str(one.robot)]).total()
            missing = max(missing, abs(float(made.sum() - one.ends[-1])))
    return {
        "robot": slowest.robot,
        "robot_time_s": ended,
        "missing_s": missing,
        "agrees": None if missing is None else missing <= TIME_TOLERANCE * ended,
    }


def _cost(run: RunMoves, name: str, touches: int) -> Costs:
    robot = ROBOTS[name]
    moved = with_recomputed_waits(run.fingers, robot)
    made = [move_durations(moves, robot) for moves in moved]
    totals = [float(one.total().sum()) for one in made]
    slowest = int(np.argmax(totals))
    phases, figures = np.array(run.fingers[slowest].phases), dict[str, Costs]()
    for phase in PHASES:
        if phase != "other" or phase in phases:
            parts, moves = (
                _part_figures(made[slowest], phases == phase),
                int((phases == phase).sum()),
            )
            each = parts["total_s"] / moves if moves else None
            figures[phase] = {"moves": moves, **parts, "per_move_s": each}
    return {
        **_part_figures(made[slowest], np.ones(len(phases), dtype=bool)),
        "per_touch_s": totals[slowest] / touches if touches else None,
        "slowest_finger": run.fingers[slowest].finger,
        "finger_s": {str(one.finger): s for one, s in zip(run.fingers, totals, strict=True)},
        "phases": figures,
    }


def with_recomputed_waits(
    fingers: Sequence[FingerMoves], robot: RobotPreset | SlidingPreset
) -> list[MoveGeometry]:
    """The moves of all fingers, with the waits that this robot would have."""
    unwaiting = [one.moves._replace(wait=0.0 * one.moves.wait) for one in fingers]
    lasts = [move_durations(moves, robot).total() for moves in unwaiting]
    waits = [one.moves.wait.copy() for one in fingers]
    ends = [np.zeros(len(one.ends)) for one in fingers]
    # As they ended: who is waited for comes before who waits.
    order = sorted((end, i, k) for i, one in enumerate(fingers) for k, end in enumerate(one.ends))
    for end, finger, move in order:
        before = ends[finger][move - 1] if move else 0.0
        if waits[finger][move] > TIME_TOLERANCE * end:
            awaited = _awaited(fingers, finger, move)
            if awaited is not None:
                waits[finger][move] = max(ends[awaited[0]][awaited[1]] - before, 0.0)
        ends[finger][move] = before + waits[finger][move] + lasts[finger][move]
    return [one.moves._replace(wait=wait) for one, wait in zip(fingers, waits, strict=True)]


def _awaited(fingers: Sequence[FingerMoves], finger: int, move: int) -> tuple[int, int] | None:
    """The other finger, and its move at whose end this one began; None if there is none."""
    one = fingers[finger]
    begun = float(one.moves.wait[move]) + (float(one.ends[move - 1]) if move else 0.0)
    for i, other in enumerate(fingers):
        near = int(np.argmin(np.abs(other.ends - begun)))
        if i != finger and abs(float(other.ends[near]) - begun) <= TIME_TOLERANCE * begun:
            return i, near
    return None


def _part_figures(made: MoveDurations, which: Bools) -> Costs:
    parts = {f"{part}_s": float(getattr(made, part)[which].sum()) for part in PARTS}
    return {**parts, "total_s": float(made.total()[which].sum())}


# Of a finger: its simulator, and of its moves the figures, goals and ends.
_Moved = tuple[str, list[Floats], list[int | None], list[float]]


def read_moves(run: Path) -> RunMoves:
    """The moves of a run; raises InputError if it cannot be read, or does not tell them."""
    path = find_bag(run)
    try:
        recording = open_recording(path)
        robots = _robots(recording)
        phases, found = _collected(recording)
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
        for number, (publisher, rows, goals, ends) in sorted(found.items())
    )
    # The frame of a sensor that no arm moved has a move of nothing.
    if not any((one.moves.approach > 0.0).any() for one in fingers):
        raise InputError(f"{path}: holds no moves of an arm, so no robot's time follows from it")
    return RunMoves(path, fingers, recording.closed)


def _collected(recording: Recording) -> tuple[dict[int | None, Phase], dict[int, _Moved]]:
    """The phase of each goal, none where the hand closed; and by finger what moved it."""
    phases: dict[int | None, Phase] = {None: "grasp"}
    found: dict[int, _Moved] = {}
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
                if key in seen:  # a link may deliver a frame twice
                    continue
                seen.add(key)
            case _:
                continue
        _, rows, goals, ends = found.setdefault(number, (kept.publisher, [], [], []))
        rows.append(moved.move)
        goals.append(named)
        ends.append(moved.robot_time)
    return phases, found


def _robots(recording: Recording) -> dict[str, str]:
    """The preset of each simulator that was recorded, by its name in the graph."""
    nodes = recorded_nodes(recording.graph) if recording.graph else ()
    simulators = [one for one in nodes if one.module == SIMULATOR]
    found = {one.name: json.loads(bytes(one.params)).get("robot") for one in simulators}
    return {name: robot for name, robot in found.items() if isinstance(robot, str)}


class FingerMoves(NamedTuple):
    """What one finger did."""

    finger: int  # Its number, from 1
    robot: str | None  # Preset by which its times were made, if the recording says so
    moves: MoveGeometry  # In their order
    phases: tuple[Phase, ...]  # What each move was for
    ends: Floats  # Recorded robot time at the end of each move, (n,), s


class RunMoves(NamedTuple):
    """What all fingers did."""

    path: Path  # The recording
    fingers: tuple[FingerMoves, ...]  # By their numbers; at least one
    closed: bool  # Whether the recording is complete


def robot_time_text(costs: Costs) -> str:
    """The figures of `palpate.tools.robot_time`."""
    fingers, closings = costs["fingers"], costs["closings"]
    counts = [counted(costs["touches"], "touch", "touches")]
    counts += [f"{counted(closings, 'closing')} of the hand"] if closings else []
    counts += [f"{fingers} fingers"] if fingers > 1 else []
    lines = titled("read", f"{costs['recording']}: {', '.join(counts)}", width=TITLE_WIDTH)
    lines += _recorded_lines(costs)
    for name, cost in costs["robots"].items():
        lines += ["", *_phase_table(name, cost), *_finger_lines(cost, costs["fingers"])]
    return "\n".join(lines)


def _recorded_lines(costs: Costs) -> list[str]:
    recorded = costs["recorded"]
    told, warnings = f"{recorded['robot_time_s']:.1f} s", []
    if recorded["agrees"] is None:
        warnings = ["which robot made that is not known, so it cannot be checked"]
    else:
        told = f"{recorded['robot']}, {told}"
    if recorded["agrees"]:
        told += ": its moves add up to that"
    elif recorded["agrees"] is False:
        warnings = [f"its moves miss that by {recorded['missing_s']:.3g} s: some are lost"]
    if not costs["complete"]:
        warnings.append("the recording was never closed: its end may be missing")
    rows = [("recorded", told), *(("warning", text) for text in warnings)]
    return [line for row in rows for line in titled(*row, width=TITLE_WIDTH)]


def _phase_table(name: str, cost: Mapping[str, Any]) -> list[str]:
    """One robot: where its time goes, phase by phase; of several fingers, the slowest."""
    phases = {phase: one for phase, one in cost["phases"].items() if one["moves"]}
    rows = [(f"{name}, s", *phases, "all")]
    for part in (*PARTS, "total"):
        rows.append((part, *(f"{one[f'{part}_s']:.1f}" for one in (*phases.values(), cost))))
    moves = [one["moves"] for one in phases.values()]
    rows.append(("moves", *map(str, (*moves, sum(moves)))))
    widths = (TITLE_WIDTH, *[8] * len(moves), 8)
    return text_table(rows, right=range(1, len(rows[0])), min_widths=widths)


def _finger_lines(cost: Mapping[str, Any], fingers: int) -> list[str]:
    rows = []
    if fingers > 1:
        totals = ", ".join(f"{number} {total:.1f} s" for number, total in cost["finger_s"].items())
        rows.append(("fingers", f"{totals}; the table is of the slowest"))
    if cost["per_touch_s"] is not None:
        rows.append(("a touch", f"{cost['per_touch_s']:.2f} s, all counted"))
    return [line for row in rows for line in titled(*row, width=TITLE_WIDTH)]
