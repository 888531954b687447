"""The moves of a recording: what each finger did, in its order, and for what."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.robot_time import Moves
from palpate.launch.bag.bag_file import find_bag
from palpate.launch.located import InputError
from palpate.messages.codec import decode
from palpate.messages.fields import CodecError
from palpate.messages.recording.reader import Recording, open_recording
from palpate.messages.types import ContourGoal, GraspContacts, ProbeGoal, TactileFrame
from palpate.nodes.recording import recorded_wirings

Phase = Literal["grasp", "contours", "probes", "other"]
"""What a move was for; other where the recording has no goal for it."""
SIMULATOR = "palpate.nodes.simulator"
HAND = 1
"""The hand is moved by the arm of this finger."""
KINDS: Mapping[str, type] = {
    kind.__name__: kind for kind in (ContourGoal, ProbeGoal, TactileFrame, GraspContacts)
}
"""What is read, by type: topics may have been given other names."""


class FingerMoves(NamedTuple):
    """What one finger did."""

    finger: int
    """Its number, from 1."""
    robot: str | None
    """Preset by which its times were made, if the recording says so."""
    moves: Moves
    """In their order."""
    phases: tuple[Phase, ...]
    """What each move was for."""
    ends: Floats
    """Recorded robot time at the end of each move, (n,), s."""


class RunMoves(NamedTuple):
    """What all fingers did."""

    path: Path
    """The recording."""
    fingers: tuple[FingerMoves, ...]
    """By their numbers; at least one."""
    closed: bool
    """Whether the recording is complete."""


@dataclass(slots=True)
class _Finger:
    """One finger's moves as they come."""

    publisher: str
    rows: list[Floats] = field(default_factory=list)
    goals: list[int | None] = field(default_factory=list)
    """None where the hand closed."""
    ends: list[float] = field(default_factory=list)


@dataclass(slots=True)
class _Heard:
    """A recording as it comes."""

    fingers: dict[int, _Finger] = field(default_factory=dict)
    phases: dict[int | None, Phase] = field(default_factory=lambda: {None: "grasp"})
    """By goal."""
    seen: set[tuple[int, int, int]] = field(default_factory=set)

    def take(self, publisher: str, message: object) -> None:
        """Keep one message."""
        match message:
            case ContourGoal():
                self.phases[message.id] = "contours"
            case ProbeGoal():
                self.phases[message.id] = "probes"
            case GraspContacts():
                self._moved(publisher, HAND, None, message)
            case TactileFrame():
                key = (message.finger, message.goal, message.touch)
                if key not in self.seen:  # a link may deliver a frame twice
                    self._moved(publisher, message.finger, message.goal, message)
                self.seen.add(key)

    def _moved(
        self, publisher: str, number: int, goal: int | None, moved: TactileFrame | GraspContacts
    ) -> None:
        finger = self.fingers.setdefault(number, _Finger(publisher))
        finger.rows.append(moved.move)
        finger.goals.append(goal)
        finger.ends.append(moved.robot_time)


def read_moves(run: Path) -> RunMoves:
    """The moves of a run.

    Parameters
    ----------
    run : Path
        A recording, or the folder of a run.

    Raises
    ------
    InputError
        If it cannot be read, or does not tell its moves.
    """
    path = find_bag(run)
    heard = _Heard()
    try:
        recording = open_recording(path)
        robots = _robots(recording)
        for kept in recording.messages():
            if kept.type in KINDS:
                heard.take(kept.publisher, decode(KINDS[kept.type], kept.body))
    except CodecError as error:
        raise InputError(f"{path}: was recorded with other messages: {error}") from None
    except ValueError as error:
        raise InputError(str(error)) from None
    fingers = tuple(
        FingerMoves(
            number,
            robots.get(finger.publisher),
            Moves.of_rows(np.array(finger.rows)),
            tuple(heard.phases.get(goal, "other") for goal in finger.goals),
            np.array(finger.ends),
        )
        for number, finger in sorted(heard.fingers.items())
    )
    # The frame of a sensor that no arm moved has a move of nothing.
    if not any((one.moves.approach > 0.0).any() for one in fingers):
        raise InputError(f"{path}: holds no moves of an arm, so no robot's time follows from it")
    return RunMoves(path, fingers, recording.closed)


def _robots(recording: Recording) -> dict[str, str]:
    """The preset of each simulator that was recorded, by its name in the graph."""
    if not recording.graph:
        return {}
    found = {
        one.name: json.loads(bytes(one.params)).get("robot")
        for one in recorded_wirings(recording.graph)
        if one.module == SIMULATOR
    }
    return {name: robot for name, robot in found.items() if isinstance(robot, str)}
