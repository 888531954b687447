"""Contours out of a recording: what was traced, all that was touched, and what the plan took."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from palpate.core.rebuild.felt.felt_points import FeltPoints, felt_points, stack_points
from palpate.core.touch.jet import Jet
from palpate.launch.located import InputError
from palpate.launch.points_found import PointsFound
from palpate.messages.codec import decode
from palpate.messages.fields import CodecError
from palpate.messages.types import Contour, PlanDone, Probe, SensorInfo, SurfacePatch, World
from palpate.nodes.sensor import pad_of_info

KINDS: Mapping[str, type] = {
    "/contour/traced": Contour,
    "/probe/traced": Probe,
    "/touch/patch": SurfacePatch,
    "/touch/info": SensorInfo,
    "/plan/done": PlanDone,
    "/world": World,
}
"""What is read, by the end of its topic: before it a finger may stand."""


@dataclass(slots=True)
class Heard:
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


def read_recording(path: Path) -> PointsFound:
    """Closed contours of a recording with all taxels of their touches, in m.

    Raises
    ------
    InputError
        If it cannot be read, or holds no closed contour.
    """
    # Not for those who read a CSV file: mcap is imported with it.
    from palpate.messages.recording.reader import open_recording

    heard = Heard()
    try:
        for kept in open_recording(path).messages():
            kind = next((kind for end, kind in KINDS.items() if kept.topic.endswith(end)), None)
            if kind is not None:
                heard.take(decode(kind, kept.body))
    except CodecError as error:
        raise InputError(f"{path}: was recorded with other messages: {error}") from None
    except ValueError as error:
        raise InputError(str(error)) from None
    return found_in(path, heard)


def found_in(path: Path, heard: Heard) -> PointsFound:
    """The closed contours that a plan ended with, or all, where probes hit, and all taxels.

    Raises
    ------
    InputError
        If no contour is closed; it names the path.
    """
    contours, probes = heard.contours, heard.probes
    if heard.done is not None:
        contours = [one for one in contours if one.id in heard.done.contours]
        probes = [one for one in probes if one.id in heard.done.probes]
    closed = [one for one in contours if one.status == "closed"]
    if not closed:
        raise InputError(f"{path}: holds no closed contour, of {len(contours)} that were traced")
    hits = [one for one in probes if one.outcome == "hit"]
    felt = _felt(heard, {one.id for one in closed} | {one.id for one in hits})
    notes = [] if felt is None else [f"{len(felt.points)} taxels of {felt.touch.max() + 1} touches"]
    if len(closed) < len(contours):
        notes.append(f"left out {len(contours) - len(closed)} contours that were not closed")
    tops = [one.point for one in hits]
    if heard.world is not None:
        tops.append(np.array([0.0, 0.0, heard.world.platform]))
        notes.append("the object stands on its platform, which is a touch of its lower end")
    return PointsFound(
        contours=tuple(np.array(one.points) for one in closed),
        places=tuple(f"contour {one.id}" for one in closed),
        normals=tuple(np.array(one.normals) for one in closed),
        felt=felt,
        tops=np.array(tops) if tops else None,
        notes=tuple(notes),
    )


def _felt(heard: Heard, goals: set[int]) -> FeltPoints | None:
    """All taxels of the touches of some goals, as the reconstructor takes them."""
    if heard.sensor is None:
        return None
    pad = pad_of_info(heard.sensor)
    parts = []
    for patch in sorted(heard.patches, key=lambda patch: (patch.goal, patch.touch)):
        if patch.goal in goals and patch.mask.any():
            jet = Jet(patch.jet, patch.jet_scale) if len(patch.jet) else None
            parts.append(felt_points(pad, patch.pose, patch.height, patch.mask, jet))
    return stack_points(parts) if parts else None
