"""Everything that a report says of a run, read from its folder.

Whatever is missing, a recording say, leaves its section out; the rest stands.
"""

from __future__ import annotations

import json
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.touch import SimulatedTouch
from palpate.launch.files.source_map import InputError
from palpate.launch.launch_file import describe
from palpate.launch.printing import millimetres
from palpate.launch.run_directory import RECORDING, SUMMARY, read_summary, run_directory_of
from palpate.nodes import simulator
from palpate.nodes.specs.objects import build_shape
from palpate.nodes.specs.sensors import build_pipeline, describe_effects
from palpate.tools.graph_sketch import Sketch, sketch_of
from palpate.tools.scene_text import effect_parameters
from palpate.tools.view.timeline import Timeline, read_timeline

MOST_LOGGED = 40  # Warnings and errors that are shown
TRIED = 48  # Touches over which the cost of an effect is measured
RETRACTED, REACH, DEPTH = 5e-3, 10e-3, 0.5e-3  # How those begin before the surface, and go on, m
MOST_PLACES = 24  # Of one kind that lead to their place
UNTOUCHED = "unknown places"  # Kind of a place that is far from every touch
LEAST_OUTLIER = 5.0  # Times the median residual, from which a touch fits badly
SURE: dict[str, type | tuple[type, ...]] = {  # Of every summary; whatever else may be null
    "reason": str, "touches": int, "contours": int, "robot_time_s": (int, float),
    "nodes": dict, "curve": list, "missed": list, "criteria": list,
}  # fmt: skip
PALPATE_FILES = ("scene.yaml", "launch.yaml")  # What a run needs to be run again


class Place(NamedTuple):
    """Where something happened that a reader may want to look at."""

    kind: str  # What places of its kind have in common
    text: str
    time: float  # Robot time, s
    point: Floats  # (3,), m


class EffectCost(NamedTuple):
    """An effect of the scene, or a stage that every touch has."""

    name: str
    told: str  # Its parameters
    seconds: float  # Median processor time of a touch


@dataclass(frozen=True, slots=True)
class RunFacts:
    """A run, ready to be written about."""

    folder: Path
    summary: dict[str, Any]
    line: Timeline | None  # None without a recording
    places: tuple[Place, ...]
    contour_deviations: dict[int, Floats]  # Of each contour's points from the truth (n,), m
    effects: tuple[EffectCost, ...] | None  # None where nobody can tell what was simulated
    graph: Sketch | None  # The wiring; None where the launch file cannot be read any more
    files: dict[str, str]  # Scene and launch file as text, by name
    log: tuple[dict[str, Any], ...]  # Warnings and errors


def read_run(run: Path) -> RunFacts:
    """Read a run by its directory or recording.

    Raises InputError if it holds no figures, or its recording is damaged or of another version.
    """
    folder = run_directory_of(run)
    summary = read_summary(folder)
    for key, kind in SURE.items():
        if not isinstance(summary.get(key), kind):
            raise InputError(f"{folder / SUMMARY}: is of another version: no good {key!r}")
    line = read_timeline(folder) if (folder / RECORDING).is_file() else None
    effects, graph = _from_launch_file(folder, line)
    return RunFacts(
        folder,
        summary,
        line,
        tuple(places_of(line, summary)) if line is not None else (),
        {} if line is None else _deviations(line),
        effects,
        graph,
        {
            one: (folder / one).read_text("utf-8", "replace")
            for one in PALPATE_FILES
            if (folder / one).is_file()
        },
        tuple(_warnings(folder)),
    )


def _deviations(line: Timeline) -> dict[int, Floats]:
    points = [one.points for one in line.contours]
    if not points or line.surface is None:
        return {}
    found = line.surface.deviations(np.concatenate(points))
    parts = np.split(found, np.cumsum([len(one) for one in points])[:-1])
    return {one.id: part for one, part in zip(line.contours, parts, strict=True)}


def _warnings(folder: Path) -> Iterator[dict[str, Any]]:
    path = folder / "log.jsonl"
    lines = path.read_bytes().splitlines() if path.is_file() else []
    try:
        records = [json.loads(one) for one in lines]
        yield from [one for one in records if one["level"] in ("warning", "error")][:MOST_LOGGED]
    except (ValueError, TypeError, KeyError):
        raise InputError(
            f"{path}: is no log of a run: a line of it is cut off or foreign"
        ) from None


def places_of(line: Timeline, summary: dict[str, Any]) -> Iterator[Place]:
    """Where tracing met gaps, fits fell back to less, and nothing was touched."""
    for one in line.contours:
        for begins, ends, why in zip(one.gap_starts, one.gap_ends, one.gap_reasons, strict=True):
            wide = millimetres(float(np.linalg.norm(ends - begins)))
            text = f"contour {one.id}: {wide} {why}"
            yield Place("gaps in contours", text, one.robot_time, 0.5 * (begins + ends))
        if one.status not in ("closed", "occluded") and len(one.points):
            text = f"contour {one.id}: {one.status}"
            yield Place("contours that did not close", text, one.robot_time, one.points[-1])
    yield from _dropped(line)
    usual = statistics.median([one.residual for one in line.touches] or [0.0])
    for touch in line.touches:
        place = touch.points.mean(axis=0) if len(touch.points) else touch.pose[:3]
        text = f"touch {touch.number} of goal {touch.goal}"
        if touch.kind == "insufficient" or touch.outcome in ("inside", "bottomed"):
            told = touch.kind if touch.kind == "insufficient" else touch.outcome
            yield Place("touches too poor for a local fit", f"{text}: {told}", touch.time, place)
        elif touch.residual > LEAST_OUTLIER * usual > 0.0:
            text = f"{text}: residual {millimetres(touch.residual)}"
            yield Place("touches that fit badly", text, touch.time, place)
    for number, point in enumerate(summary.get("open_places_m") or (), 1):
        at = ", ".join(f"{1e3 * one:.0f}" for one in point)
        text = f"{number}: at ({at}) mm" if number > 1 else "1: the widest"
        yield Place(UNTOUCHED, text, line.end, np.array(point))


def _dropped(line: Timeline) -> Iterator[Place]:
    if not line.models:
        return
    last, known = line.models[-1], {one.id: one for one in line.contours}
    for number, why in zip(last.dropped, last.dropped_reasons, strict=True):
        if number in known and len(known[number].points):
            one = known[number]
            text = f"contour {number}: {why}"
            yield Place("contours left out of the fit", text, one.robot_time, one.points[0])
    for point in last.openings:
        yield Place("hollows", "a pad touched nothing there", last.robot_time, point)


def _from_launch_file(
    folder: Path, line: Timeline | None
) -> tuple[tuple[EffectCost, ...] | None, Sketch | None]:
    """What the effects cost, and the wiring, as far as the launch file can be read here."""
    path = folder / "launch.yaml"
    if not path.is_file():
        return None, None
    try:
        described = describe(path, {}, folder)
        wirings = described.graph.wirings()
        graph = sketch_of(described.graph)
    except InputError:  # it names files or modules that are no longer there
        return None, None
    hands = [one.params for one in wirings if isinstance(one.params, simulator.Params)]
    if not hands or (hands[0].effects and (line is None or not line.touches)):
        return None, graph  # no simulator, or no touch over which to measure
    return (() if line is None else tuple(effect_costs(hands[0], line))), graph


def effect_costs(hand: simulator.Params, line: Timeline) -> Iterator[EffectCost]:
    """What each stage of a touch costs here and now, over some touches of the run made again.

    Nothing is yielded of a scene without effects.
    """
    if not hand.effects:
        return
    pipeline = build_pipeline(hand.sensor, hand.effects, ROBOT_PRESETS[hand.robot])
    shape, states = build_shape(hand.object), list(pipeline.begin())
    spent: list[list[float]] = [[] for _ in pipeline.stages]
    pick = np.linspace(0, len(line.touches) - 1, min(TRIED, len(line.touches))).astype(int)
    for number, one in enumerate(pick):
        pose = Pose.from_array(line.touches[one].pose).advanced(-RETRACTED)
        touch = SimulatedTouch(
            shape=shape, number=number, believed=pose, actual=pose, reach=REACH,
            depth=DEPTH, begun=float(number), previous=float(number),
        )  # fmt: skip
        for i, stage in enumerate(pipeline.stages):
            begun = time.thread_time()
            states[i] = stage.apply(touch, states[i])
            spent[i].append(time.thread_time() - begun)
    listed = {
        type(effect).__name__: (name, effect_parameters(effect))
        for name, effect in describe_effects(hand.effects).items()
    }
    for stage_name, seconds in zip(pipeline.names, spent, strict=True):
        name, told = listed.get(stage_name, (stage_name, ""))
        yield EffectCost(name, told, statistics.median(seconds))


def ratio_rows(summaries: Sequence[dict[str, Any]]) -> Iterator[tuple[str, list[str]]]:
    """Figures of two runs beside each other, and the second over the first."""
    for key, (name, factor, unit) in COMPARED.items():
        values = [one.get(key) for one in summaries]
        if all(isinstance(one, int | float) for one in values):
            cells = [f"{factor * float(one or 0):.4g} {unit}".rstrip() for one in values]
            first, second = (float(one or 0) for one in values)
            yield name, [*cells, f"{second / first:.2f}" if first else ""]


# Figures that are compared: how they are called, what they are multiplied by, their unit.
COMPARED = {
    "rms_m": ("rms error", 1e3, "mm"),
    "rms_bound_95_m": ("error bound", 1e3, "mm"),
    "tolerance_m": ("tolerance", 1e3, "mm"),
    "largest_untouched_m": ("untouched gap", 1e3, "mm"),
    "p95_m": ("95 % quantile", 1e3, "mm"),
    "hausdorff_m": ("largest distance", 1e3, "mm"),
    "sampling_floor_m": ("sampling floor", 1e3, "mm"),
    "open_share": ("unknown share", 1e2, "%"),
    "touches": ("touches", 1.0, ""),
    "contours": ("contours", 1.0, ""),
    "robot_time_s": ("robot time", 1.0, "s"),
    "compute_s": ("compute time", 1.0, "s"),
}
