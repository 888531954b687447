"""Whether the tolerance decides cost and error: shipped scenes with five tolerances each.

The medians and quartiles that it prints at the end are the costs that `palpate run` predicts.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from palpate.bench.harness import NOISY, Explored, explore_scene, percent_of
from palpate.bench.speed import SCENES
from palpate.bench.table import Row, at_least, at_most, figure
from palpate.launch.scene import find_scene, load_scene
from palpate.tools.reconstruction import single_threaded

SMOOTH = ("vase", "sphere", "egg", "twisted", "hyperquadric", "dented", "bottle", "oblique")


@dataclass(frozen=True, slots=True, kw_only=True)
class ToleranceSettings:
    """Scenes, tolerances, and what is demanded."""

    scenes: tuple[str, ...] = SCENES
    percents: tuple[float, ...] = (1.0, 0.5, 0.2, 0.1, 0.05)  # [% of the height] rms errors
    min_share: float = 0.90  # smallest fraction of bounds that hold, and of tolerances met
    max_ratio: float = 0.45  # touches at the loosest tolerance / at the strictest
    max_touches: int = 90  # at the second tolerance, of smooth scenes
    # Error [% of the height] of the noisy vase, and robot time [s] with grasp until it is reached.
    deadlines: tuple[tuple[float, float], ...] = ((0.5, 200.0), (0.2, 280.0))


QUICK_TOLERANCES = ToleranceSettings(scenes=("vase", "egg"))


def explored(scene: str, settings: Mapping[str, Any]) -> Explored:
    """A shipped scene, explored with settings by ``node.param``."""
    with tempfile.TemporaryDirectory(prefix="palpate-study-") as folder:
        return explore_scene(find_scene(scene), settings=settings, out=Path(folder) / "run")


def tolerance_rows(quick: bool) -> Iterator[Row | str]:
    """Every scene at every tolerance; two scenes if quick."""
    settings = QUICK_TOLERANCES if quick else ToleranceSettings()
    by_scene: dict[str, list[Explored]] = {}
    with single_threaded():
        for scene in settings.scenes:
            by_scene[scene] = []
            for percent in settings.percents:
                run = explored(scene, tolerance_setting(scene, percent))
                by_scene[scene].append(run)
                shown = f"{run.touches} touches, {run.score.robot_time:.0f} s, {run.percent:.4f} %"
                floor = 100.0 * run.score.sampling_floor / run.score.size
                held = "" if run.held else ", bound NOT held"
                yield Row(f"{scene}, {percent:g} % asked for: floor {floor:.3f} %{held}", shown)
        yield from demand_rows(by_scene, settings)
        yield from timed_rows(settings.deadlines)
    yield from cost_rows(list(by_scene.values()), settings.percents)


def tolerance_setting(scene: str, percent: float) -> dict[str, Any]:
    """The planner's tolerance as a share of a scene's height."""
    return {"planner.tolerance": 0.01 * percent * load_scene(find_scene(scene)).size[2]}


def demand_rows(
    by_scene: Mapping[str, Sequence[Explored]], settings: ToleranceSettings
) -> Iterator[Row]:
    """What must hold over the tolerances, scene by scene."""
    for scene, runs in by_scene.items():
        for what, values in {
            "touches": [float(run.touches) for run in runs],
            "robot time": [run.score.robot_time for run in runs],
            "accuracy": [-run.percent for run in runs],
        }.items():
            rises = sum(after > before for before, after in pairwise(values))
            wanted = len(values) - 1
            yield Row(f"{scene}: {what} rises", f"{rises} of {wanted}", "all", rises == wanted)
    held = [run.held is True for runs in by_scene.values() for run in runs]
    yield at_least("bound held", float(np.mean(held)), settings.min_share)
    met = [
        run.percent <= percent
        for runs in by_scene.values()
        for run, percent in zip(runs, settings.percents, strict=True)
    ]
    yield at_least("tolerance honoured", float(np.mean(met)), settings.min_share)
    ratio = float(np.median([runs[0].touches / runs[-1].touches for runs in by_scene.values()]))
    yield at_most("touches at 1 % over those at 0.05 %, median", ratio, settings.max_ratio)
    for scene in (scene for scene in SMOOTH if scene in by_scene):
        touches = by_scene[scene][1].touches
        yield at_most(f"{scene}: touches at 0.5 %", touches, settings.max_touches, ".0f")


def timed_rows(deadlines: Sequence[tuple[float, float]]) -> Iterator[Row]:
    """Robot time, grasp included, until the noisy vase is within each error."""
    effects = {name: params for effect in NOISY for name, params in effect.items()}
    run = explored("vase", {**tolerance_setting("vase", 0.1), "simulator.effects": effects})
    for percent, most in deadlines:
        times = (score.robot_time for score in run.scores if percent_of(score) <= percent)
        yield at_most(f"vase, noise: {percent:g} % after", next(times, np.inf), most, ".0f", " s")


def cost_rows(runs: Sequence[Sequence[Explored]], percents: Sequence[float]) -> Iterator[Row]:
    """Quartiles of touches and robot time at each tolerance."""
    for i, percent in enumerate(percents):
        touches = np.quantile([of_scene[i].touches for of_scene in runs], (0.25, 0.5, 0.75))
        times = np.quantile([of_scene[i].score.robot_time for of_scene in runs], (0.25, 0.5, 0.75))
        for what, values in {"touches": touches, "robot s": times}.items():
            quartiles = f"{values[0]:.0f} to {values[2]:.0f}"
            yield figure(f"{percent:g} %: {what}, median ({quartiles})", float(values[1]), ".0f")
