"""Facts of a run for its report, read from its folder.

A missing file, such as a recording, leaves out the sections that need it.
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

REQUIRED: dict[str, type | tuple[type, ...]] = {  # keys of a summary that cannot be null
    "reason": str, "touches": int, "contours": int, "robot_time_s": (int, float),
    "nodes": dict, "curve": list, "missed": list, "criteria": list,
}  # fmt: skip
PALPATE_FILES = ("scene.yaml", "launch.yaml")  # needed to repeat a run


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectTiming:
    """Touches of a run that are simulated again to time its effects."""

    max_touches: int = 48  # spread evenly over the run
    retraction: float = 5e-3  # [m] by which a simulated touch starts before the recorded pose
    reach: float = 10e-3  # [m] longest move from there
    depth: float = 0.5e-3  # [m] that the pad moves on after contact


DEFAULT_TIMING = EffectTiming()


class Place(NamedTuple):
    """A place that a reader may want to look at."""

    kind: str
    text: str
    time: float  # robot time [s]
    point: Floats  # (3,) [m]


class EffectCost(NamedTuple):
    """Cost of an effect of the scene, or of a stage that all touches have."""

    name: str
    parameters: str
    seconds: float  # median processor time of a touch [s]


@dataclass(frozen=True, slots=True)
class RunFacts:
    """Facts of a run."""

    folder: Path
    summary: dict[str, Any]
    line: Timeline | None  # None without a recording
    places: tuple[Place, ...]
    contour_deviations: dict[int, Floats]  # (n,) of each contour's points from the truth [m]
    effects: tuple[EffectCost, ...] | None  # None if the simulated effects are unknown
    graph: Sketch | None  # the wiring; None if the launch file can no longer be read
    files: dict[str, str]  # scene and launch file as text, by name
    log: tuple[dict[str, Any], ...]  # warnings and errors


def read_run(run: Path) -> RunFacts:
    """Read a run from its directory or recording.

    Raises InputError if it has no summary, or its recording is damaged or of another version.
    """
    folder = run_directory_of(run)
    summary = read_summary(folder)
    for key, kind in REQUIRED.items():
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
            name: (folder / name).read_text("utf-8", "replace")
            for name in PALPATE_FILES
            if (folder / name).is_file()
        },
        tuple(_warnings(folder)),
    )


def _deviations(line: Timeline) -> dict[int, Floats]:
    points = [contour.points for contour in line.contours]
    if not points or line.surface is None:
        return {}
    deviations = line.surface.deviations(np.concatenate(points))
    parts = np.split(deviations, np.cumsum([*map(len, points)])[:-1])
    return {contour.id: part for contour, part in zip(line.contours, parts, strict=True)}


def _warnings(folder: Path, max_records: int = 40) -> Iterator[dict[str, Any]]:
    """The first warnings and errors of the log of a run."""
    path = folder / "log.jsonl"
    lines = path.read_bytes().splitlines() if path.is_file() else []
    try:
        records = map(json.loads, lines)
        warnings = [record for record in records if record["level"] in ("warning", "error")]
        yield from warnings[:max_records]
    except (ValueError, TypeError, KeyError):
        raise InputError(
            f"{path}: is no log of a run: a line of it is cut off or foreign"
        ) from None


def places_of(
    line: Timeline, summary: dict[str, Any], min_residual_ratio: float = 5.0
) -> Iterator[Place]:
    """Places with gaps in contours, with poor fits, and without touches.

    `min_residual_ratio`: a touch fits badly if its residual / the median residual is larger.
    """
    yield from _gaps(line)
    yield from _dropped(line)
    usual = statistics.median([touch.residual for touch in line.touches] or [0.0])
    for touch in line.touches:
        point = touch.points.mean(axis=0) if len(touch.points) else touch.pose[:3]
        text = f"touch {touch.number} of goal {touch.goal}"
        if touch.kind == "insufficient" or touch.outcome in ("inside", "bottomed"):
            fault = touch.kind if touch.kind == "insufficient" else touch.outcome
            yield Place("touches too poor for a local fit", f"{text}: {fault}", touch.time, point)
        elif touch.residual > min_residual_ratio * usual > 0.0:
            text = f"{text}: residual {millimetres(touch.residual)}"
            yield Place("touches that fit badly", text, touch.time, point)
    for number, point in enumerate(summary.get("open_places_m") or (), 1):
        coordinates = ", ".join(f"{1e3 * x:.0f}" for x in point)
        text = f"{number}: at ({coordinates}) mm" if number > 1 else "1: the widest"
        yield Place("unknown places", text, line.end, np.array(point))


def _gaps(line: Timeline) -> Iterator[Place]:
    """Gaps in contours, and ends of contours that did not close."""
    for contour in line.contours:
        name, time = f"contour {contour.id}", contour.robot_time
        gaps = zip(contour.gap_starts, contour.gap_ends, contour.gap_reasons, strict=True)
        for start, end, reason in gaps:
            text = f"{name}: {millimetres(float(np.linalg.norm(end - start)))} {reason}"
            yield Place("gaps in contours", text, time, 0.5 * (start + end))
        if contour.status not in ("closed", "occluded") and len(contour.points):
            text = f"{name}: {contour.status}"
            yield Place("contours that did not close", text, time, contour.points[-1])


def _dropped(line: Timeline) -> Iterator[Place]:
    """Contours that the last fit left out, and openings where a pad touched nothing."""
    if not line.models:
        return
    last, known = line.models[-1], {contour.id: contour for contour in line.contours}
    for number, reason in zip(last.dropped, last.dropped_reasons, strict=True):
        contour = known.get(number)
        if contour is not None and len(contour.points):
            text = f"contour {number}: {reason}"
            point, time = contour.points[0], contour.robot_time
            yield Place("contours left out of the fit", text, time, point)
    for point in last.openings:
        yield Place("hollows", "a pad touched nothing there", last.robot_time, point)


def _from_launch_file(
    folder: Path, line: Timeline | None
) -> tuple[tuple[EffectCost, ...] | None, Sketch | None]:
    """Costs of the effects, and the wiring; None each if the launch file cannot be read."""
    path = folder / "launch.yaml"
    if not path.is_file():
        return None, None
    try:
        described = describe(path, {}, folder)
        wirings = described.graph.wirings()
        graph = sketch_of(described.graph)
    except InputError:  # it names files or modules that no longer exist
        return None, None
    hands = [node.params for node in wirings if isinstance(node.params, simulator.Params)]
    if not hands or (hands[0].effects and (line is None or not line.touches)):
        return None, graph  # no simulator, or no touch to time
    return (() if line is None else tuple(effect_costs(hands[0], line))), graph


def effect_costs(
    hand: simulator.Params, line: Timeline, settings: EffectTiming = DEFAULT_TIMING
) -> Iterator[EffectCost]:
    """Cost of each stage of a touch on this machine, from touches of the run simulated again.

    A scene without effects has none.
    """
    if not hand.effects:
        return
    pipeline = build_pipeline(hand.sensor, hand.effects, ROBOT_PRESETS[hand.robot])
    shape, states = build_shape(hand.object), list(pipeline.begin())
    spent: list[list[float]] = [[] for _ in pipeline.stages]
    count = len(line.touches)
    chosen = np.linspace(0, count - 1, min(settings.max_touches, count)).astype(int)
    for number, index in enumerate(chosen):
        pose = Pose.from_array(line.touches[index].pose).advanced(-settings.retraction)
        touch = SimulatedTouch(
            shape=shape, number=number, believed=pose, actual=pose, reach=settings.reach,
            depth=settings.depth, begun=float(number), previous=float(number),
        )  # fmt: skip
        for i, stage in enumerate(pipeline.stages):
            start = time.thread_time()
            states[i] = stage.apply(touch, states[i])
            spent[i].append(time.thread_time() - start)
    listed = {
        type(effect).__name__: (name, effect_parameters(effect))
        for name, effect in describe_effects(hand.effects).items()
    }
    for stage_name, seconds in zip(pipeline.names, spent, strict=True):
        name, parameters = listed.get(stage_name, (stage_name, ""))
        yield EffectCost(name, parameters, statistics.median(seconds))


def ratio_rows(summaries: Sequence[dict[str, Any]]) -> Iterator[tuple[str, list[str]]]:
    """Figures of two runs, and the ratio of the second to the first."""
    for key, (name, factor, unit) in COMPARED.items():
        values = [summary.get(key) for summary in summaries]
        if all(isinstance(value, int | float) for value in values):
            first, second = (float(value or 0) for value in values)
            cells = [f"{factor * value:.4g} {unit}".rstrip() for value in (first, second)]
            yield name, [*cells, f"{second / first:.2f}" if first else ""]


# Compared figures, by key of the summary: name, factor to the unit, and the unit.
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
