"""Contours out of a recording: what was traced, all that was touched, and what the plan took."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from palpate.core import split_pose
from palpate.core.rebuild.contours import ContactPoints, contact_points_of, stack_points
from palpate.core.touch import Jet
from palpate.launch.files.point_clouds import MeasuredContours
from palpate.launch.files.source_map import InputError
from palpate.messages import CodecError, decode
from palpate.messages.types import Contour, PlanDone, Probe, SensorInfo, SurfacePatch, World
from palpate.nodes import reconstructor as reconstructor_node
from palpate.nodes.specs import pad_of_info

# What is read, by the end of its topic: before it a finger may stand.
MESSAGE_TYPES: Mapping[str, type] = {
    "/contour/traced": Contour,
    "/probe/traced": Probe,
    "/touch/patch": SurfacePatch,
    "/touch/info": SensorInfo,
    "/plan/done": PlanDone,
    "/world": World,
}


@dataclass(slots=True)
class RecordedContours:
    """Messages of a recording, by kind."""

    contours: list[Contour] = field(default_factory=list)
    probes: list[Probe] = field(default_factory=list)
    patches: list[SurfacePatch] = field(default_factory=list)
    sensor: SensorInfo | None = None
    done: PlanDone | None = None
    world: World | None = None

    def take(self, message: object) -> None:
        """Keep one message."""
        match message:
            case Contour():
                self.contours.append(message)
            case Probe():
                self.probes.append(message)
            case SurfacePatch():
                self.patches.append(message)
            case SensorInfo():
                self.sensor = message
            case PlanDone():
                self.done = message
            case World():
                self.world = message


def read_recording(path: Path) -> MeasuredContours:
    """Closed contours of a recording with all taxels of their touches, in m.

    Raises
    ------
    InputError
        If it cannot be read, or holds no closed contour.
    """
    # Not for those who read a CSV file: mcap is imported with it.
    from palpate.messages.recording import open_recording

    heard = RecordedContours()
    try:
        for kept in open_recording(path).messages():
            kind = next(
                (kind for end, kind in MESSAGE_TYPES.items() if kept.topic.endswith(end)), None
            )
            if kind is not None:
                heard.take(decode(kind, kept.body))
    except CodecError as error:
        raise InputError(f"{path}: was recorded with other messages: {error}") from None
    except ValueError as error:
        raise InputError(str(error)) from None
    return contours_of(path, heard)


def contours_of(path: Path, heard: RecordedContours) -> MeasuredContours:
    """The closed contours that a plan ended with, or all, where probes hit, and all taxels.

    Raises
    ------
    InputError
        If no contour is closed, or they were not traced in one frame; it names the path.
    """
    contours, probes = heard.contours, heard.probes
    if heard.done is not None:
        contours = [one for one in contours if one.id in heard.done.contours]
        probes = [one for one in probes if one.id in heard.done.probes]
    closed = [one for one in contours if one.status == "closed"]
    if not closed:
        raise InputError(f"{path}: holds no closed contour, of {len(contours)} that were traced")
    hits = [one for one in probes if one.outcome == "hit"]
    touches = _touches(heard, {one.id for one in closed} | {one.id for one in hits})
    felt = stack_points([one for each in touches.values() for one in each]) if touches else None
    notes = [] if felt is None else [f"{len(felt.points)} taxels of {felt.touch.max() + 1} touches"]
    if len(closed) < len(contours):
        notes.append(f"left out {len(contours) - len(closed)} contours that were not closed")
    platform = None if heard.world is None else heard.world.platform
    try:
        frame = reconstructor_node.common_frame(closed)
        tops = reconstructor_node.touched_ends(closed, hits, touches, platform)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if not reconstructor_node.is_upright(frame):
        lean = np.degrees(np.arccos(np.clip(split_pose(frame)[1][2, 2], -1.0, 1.0)))
        notes.append(f"sliced along an axis that leans by {lean:.1f} deg")
    elif platform is not None:
        notes.append("the object stands on its platform, which is a touch of its lower end")
    return MeasuredContours(
        contours=tuple(np.array(one.points) for one in closed),
        places=tuple(f"contour {one.id}" for one in closed),
        normals=tuple(np.array(one.normals) for one in closed),
        felt=felt,
        tops=tops,
        frame=np.array(frame),
        notes=tuple(notes),
    )


def _touches(heard: RecordedContours, goals: set[int]) -> dict[int, list[ContactPoints]]:
    """What each touch of some goals felt, by goal, as the reconstructor takes it."""
    if heard.sensor is None:
        return {}
    pad = pad_of_info(heard.sensor)
    found: dict[int, list[ContactPoints]] = {}
    for patch in sorted(heard.patches, key=lambda patch: (patch.goal, patch.touch)):
        if patch.goal in goals and patch.mask.any():
            jet = Jet(patch.jet, patch.jet_scale) if len(patch.jet) else None
            points = contact_points_of(pad, patch.pose, patch.height, patch.mask, jet)
            found.setdefault(patch.goal, []).append(points)
    return found
