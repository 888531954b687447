"""Demands of a user on a run: read from the command line, and printed with their expected cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from palpate.core.explore import DEFAULT_SURVEY
from palpate.core.plugins import LENGTHS, TIMES, in_base_unit
from palpate.launch.files.mesh_file import is_mesh_file
from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.forecast import forecast, renewed_forecast
from palpate.launch.printing import titled
from palpate.messages.types import Superquadric
from palpate.nodes import planner, reconstructor
from palpate.nodes.runtime.node import Wiring
from palpate.nodes.specs.frames import MAX_TURNS


def read_quantity(text: str, units: Mapping[str, float], option: str) -> float:
    """A positive quantity in m or s, from a number with its unit: ``0.2mm``, ``5 min``.

    Raises InputError if the number or a known unit is missing, or the number is not positive.
    """
    try:
        value = in_base_unit(text, units)
        if not 0.0 < value < math.inf:
            raise ValueError(f"must be more than 0, as 0.2{'mm' if 'mm' in units else 's'}")
    except ValueError as error:
        raise InputError(f"{option} {text}: {error}") from None
    return value


def read_demand(
    tolerance: str | None,
    feature: str | None,
    budget: str | None,
    touches: int | None,
    underside: str | None,
    quality: str | None,
    procedure: str | None = None,
    turns: int | None = None,
) -> dict[str, SourceMapped]:
    """Settings of nodes for the options of the command line that are not None.

    `procedure`: the exploratory procedure, which accepts only `touches`. Raises InputError as
    `read_quantity` does, if `touches` or `turns` are out of their range, or if a procedure gets
    another option.
    """
    settings: dict[str, SourceMapped] = {}
    options: tuple[tuple[str, str | None, Mapping[str, float], str], ...] = (
        ("--tolerance", tolerance, LENGTHS, "planner.tolerance"),
        ("--feature", feature, LENGTHS, "planner.feature"),
        ("--budget", budget, TIMES, "planner.most_seconds"),
        ("--underside", underside, {}, "planner.underside"),
        ("--turns", None if turns is None else str(turns), {}, "planner.turns"),
        ("--quality", quality, {}, "reconstructor.quality"),
    )
    for name, text, units, target in options:
        if text is not None and procedure is not None:
            raise InputError(
                f"{name} {text}: --procedure {procedure} does not use it; of these options it "
                "uses only --touches"
            )
        if text is not None:
            value = read_quantity(text, units, name) if units else text
            settings[target] = SourceMapped(value, f"{name} {text}")
    if turns is not None:
        if not 0 <= turns <= MAX_TURNS:
            raise InputError(f"--turns {turns}: must be from 0 to {MAX_TURNS}")
        settings["planner.turns"] = SourceMapped(turns, f"--turns {turns}")
    if touches is not None:
        if touches < 1:
            raise InputError(f"--touches {touches}: must be at least 1")
        target = "planner.most_touches" if procedure is None else "procedure.most_touches"
        settings[target] = SourceMapped(touches, f"--touches {touches}")
    return settings


# Standard deviations of the presets of noise by keys of a scene: of fingertip poses and taxels [m].
NOISES: Mapping[str, Mapping[str, float]] = {
    "none": {},
    "low": {"pose_error.sigma": 3e-5, "gaussian_noise.sigma": 3e-6},
    "default": {"pose_error.sigma": 1e-4, "gaussian_noise.sigma": 1e-5},
    "high": {"pose_error.sigma": 3e-4, "gaussian_noise.sigma": 3e-5},
}


def read_setup(pose: str | None, noise: str | None) -> list[tuple[str, str, Any]]:
    """Options, keys of the scene and values for the pose of the object and the noise of touches.

    Raises InputError if the pose is not 3 or 7 numbers, or the noise is no preset.
    """
    if noise is not None and noise not in NOISES:
        raise InputError(f"--noise {noise}: must be one of {', '.join(NOISES)}")
    changes: list[tuple[str, str, Any]] = []
    if pose is not None:
        words = pose.split(",")
        try:
            numbers = [*map(_coordinate, words[:3]), *map(float, words[3:])]
        except ValueError:
            numbers = []
        if len(numbers) not in (3, 7):
            raise InputError(f"--pose {pose}: must be 3 or 7 numbers, as 0.01,0,0.05")
        changes.append((f"--pose {pose}", "scene.object.pose.position", numbers[:3]))
        if numbers[3:]:
            changes.append((f"--pose {pose}", "scene.object.pose.rotation", numbers[3:]))
    if noise == "none":
        changes.append(("--noise none", "scene.effects", []))
    levels = NOISES[noise] if noise is not None else {}
    changes += [
        (f"--noise {noise}", f"scene.effects.{key}", level) for key, level in levels.items()
    ]
    return changes


def read_mesh_setup(
    scene: Path, unit: str | None, size: str | None, up: str | None = None
) -> list[tuple[str, str, Any]]:
    """Options, keys of the scene and values for reading the file of a mesh.

    Raises InputError if the scene is no mesh, or if both unit and size are given.
    """
    changes: list[tuple[str, str, Any]] = []
    for key, value in {"unit": unit, "size": size, "up": up}.items():
        if value is None:
            continue
        if not is_mesh_file(scene):
            raise InputError(
                f"--{key} {value}: {scene.stem} is no mesh; a scene has object.mesh.{key}"
            )
        setting = read_quantity(value, LENGTHS, "--size") if key == "size" else value
        changes.append((f"--{key}", f"scene.object.mesh.{key}", setting))
    if unit is not None and size is not None:
        raise InputError("--unit and --size exclude each other: both set the size of the object")
    return changes


def _coordinate(text: str) -> float:
    """A length [m], from a number of metres or a number with its unit."""
    return in_base_unit(text, LENGTHS) if text.strip()[-1:].isalpha() else float(text)


class Demanded(NamedTuple):
    """The demand on the planner, and the quality of the mesh."""

    asked: planner.Params
    quality: str

    def expectation(self, coarse: Superquadric) -> str:
        """Lines on the expected cost after the grasp; empty if the coarse model is no solid."""
        cost = renewed_forecast(self.asked, coarse, self.quality)
        return "" if cost is None else "\n".join(titled("expected", *cost.texts(), "by the grasp"))


def demanded_of(wirings: Sequence[Wiring]) -> Demanded | None:
    """The demand on the planner of a graph; None if it does not have exactly one."""
    params = [wiring.params for wiring in wirings]
    demands = [item for item in params if isinstance(item, planner.Params)]
    if len(demands) != 1:
        return None
    qualities = [item.quality for item in params if isinstance(item, reconstructor.Params)]
    return Demanded(demands[0], qualities[0] if qualities else "normal")


def demand_text(
    wirings: Sequence[Wiring],
    settings: Mapping[str, SourceMapped],
    size: Sequence[float] | None,
) -> str:
    """Lines on the demand with sources, and on the expected cost; empty without a planner.

    `size`: of the object's box, (3,) [m]; None if the launch file has no scene.
    """
    demanded = demanded_of(wirings)
    if demanded is None:
        return ""
    lines = titled("asked", *_choices(demanded, settings))
    if size is not None:
        asked, height = demanded.asked, size[2]
        cost = forecast(asked, size, quality=demanded.quality)
        share = f"for {100.0 * asked.tolerance / height:.2g} % of {1e3 * height:.0f} mm"
        lines += titled("expected", *cost.texts(), share)
    return "\n".join(lines)


def _choices(demanded: Demanded, settings: Mapping[str, SourceMapped]) -> list[str]:
    """All limits of the exploration, each with its source."""

    def source(name: str, default: str = "default or scene") -> str:
        return settings[name].source if name in settings else default

    asked, limits = demanded.asked, demanded.asked.demand.limits
    derived = f"{DEFAULT_SURVEY.feature_ratio:g} times the tolerance"
    feature_source = derived if asked.feature is None else source("planner.feature")
    parts = [
        f"tolerance {1e3 * asked.tolerance:.3g} mm ({source('planner.tolerance')})",
        f"feature {1e3 * asked.demand.feature:.3g} mm ({feature_source})",
        f"unknown at most {100.0 * limits.unknown_share:.2g} % of the surface, over half a "
        "feature from any touch",
    ]
    if not asked.makes_single_touches:
        parts.append("gap between contours at most a feature")
    parts.append("a closed surface, no hole unentered")
    parts.append(f"the underside {asked.underside} ({source('planner.underside')})")
    turns = "never" if asked.turns == 0 else "once" if asked.turns == 1 else f"{asked.turns} times"
    turns = turns if asked.turns == 0 else f"at most {turns}, where that pays"
    parts.append(f"turned over {turns} ({source('planner.turns')})")
    if asked.most_touches is not None:
        parts.append(f"at most {asked.most_touches} touches ({source('planner.most_touches')})")
    if asked.most_seconds is not None:
        parts.append(f"at most {asked.most_seconds:g} s ({source('planner.most_seconds')})")
    return [*parts, f"quality {demanded.quality} ({source('reconstructor.quality', 'default')})"]
