"""What a user asks of a run, in units, and in words with what that is expected to cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from palpate.core.explore import SURVEYING
from palpate.core.plugins import LENGTHS, TIMES, in_base_unit
from palpate.launch.files.mesh_file import is_mesh_file
from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.forecast import forecast, renewed_forecast
from palpate.launch.printing import titled
from palpate.messages.types import Superquadric
from palpate.nodes import planner, reconstructor
from palpate.nodes.runtime.node import Wiring


def read_quantity(text: str, units: Mapping[str, float], option: str) -> float:
    """A positive number with its unit, in m or s: ``0.2mm``, ``5 min``.

    Raises InputError if there is no number, no unit or another one, or it is not positive.
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
    """Settings of nodes for what was asked on the command line; those not asked for are left out.

    `procedure`: the exploratory procedure, to which only `touches` means anything. Raises
    InputError as `read_quantity` does, if `touches` is not positive or there are too many `turns`,
    or if a procedure is asked for what it cannot keep.
    """
    found: dict[str, SourceMapped] = {}
    asked: tuple[tuple[str, str | None, Mapping[str, float], str], ...] = (
        ("--tolerance", tolerance, LENGTHS, "planner.tolerance"),
        ("--feature", feature, LENGTHS, "planner.feature"),
        ("--budget", budget, TIMES, "planner.most_seconds"),
        ("--underside", underside, {}, "planner.underside"),
        ("--turns", None if turns is None else str(turns), {}, "planner.turns"),
        ("--quality", quality, {}, "reconstructor.quality"),
    )
    for name, text, units, target in asked:
        if text is not None and procedure is not None:
            raise InputError(
                f"{name} {text}: --procedure {procedure} explores in its own way; only --touches "
                "limits it"
            )
        if text is not None:
            value = read_quantity(text, units, name) if units else text
            found[target] = SourceMapped(value, f"{name} {text}")
    if turns is not None:
        if not 0 <= turns <= planner.MOST_TURNS:
            raise InputError(f"--turns {turns}: must be from 0 to {planner.MOST_TURNS}")
        found["planner.turns"] = SourceMapped(turns, f"--turns {turns}")
    if touches is not None:
        if touches < 1:
            raise InputError(f"--touches {touches}: must be at least 1")
        target = "planner.most_touches" if procedure is None else "procedure.most_touches"
        found[target] = SourceMapped(touches, f"--touches {touches}")
    return found


# Effects of the presets of noise, by their keys in a scene: of a finger's place and of a taxel, m.
NOISES: Mapping[str, Mapping[str, float]] = {
    "none": {},
    "low": {"pose_error.sigma": 3e-5, "gaussian_noise.sigma": 3e-6},
    "default": {"pose_error.sigma": 1e-4, "gaussian_noise.sigma": 1e-5},
    "high": {"pose_error.sigma": 3e-4, "gaussian_noise.sigma": 3e-5},
}


def read_setup(pose: str | None, noise: str | None) -> list[tuple[str, str, Any]]:
    """Options, keys of the scene and values for where the object stands and what disturbs touches.

    Raises InputError if the pose is not 3 or 7 numbers, or there is no such noise.
    """
    if noise is not None and noise not in NOISES:
        raise InputError(f"--noise {noise}: must be one of {', '.join(NOISES)}")
    found: list[tuple[str, str, Any]] = []
    if pose is not None:
        words = pose.split(",")
        try:
            numbers = [*map(_coordinate, words[:3]), *map(float, words[3:])]
        except ValueError:
            numbers = []
        if len(numbers) not in (3, 7):
            raise InputError(f"--pose {pose}: must be 3 or 7 numbers, as 0.01,0,0.05")
        found.append((f"--pose {pose}", "scene.object.pose.position", numbers[:3]))
        if numbers[3:]:
            found.append((f"--pose {pose}", "scene.object.pose.rotation", numbers[3:]))
    if noise == "none":
        found.append(("--noise none", "scene.effects", []))
    levels = NOISES[noise] if noise is not None else {}
    found += [(f"--noise {noise}", f"scene.effects.{key}", one) for key, one in levels.items()]
    return found


def read_mesh_setup(
    scene: Path, unit: str | None, size: str | None, up: str | None = None
) -> list[tuple[str, str, Any]]:
    """Options, keys of the scene and values for how the file of a mesh is to be read.

    Raises InputError if the scene is no mesh, or is given both a unit and a size.
    """
    asked = {"unit": unit, "size": size, "up": up}
    found: list[tuple[str, str, Any]] = []
    for key, value in asked.items():
        if value is None:
            continue
        if not is_mesh_file(scene):
            raise InputError(
                f"--{key} {value}: {scene.stem} is no mesh; a scene has object.mesh.{key}"
            )
        what = read_quantity(value, LENGTHS, "--size") if key == "size" else value
        found.append((f"--{key}", f"scene.object.mesh.{key}", what))
    if unit is not None and size is not None:
        raise InputError("--unit and --size exclude each other: either makes the object as large")
    return found


def _coordinate(text: str) -> float:
    """A length in m, or with its unit."""
    return in_base_unit(text, LENGTHS) if text.strip()[-1:].isalpha() else float(text)


class Demanded(NamedTuple):
    """What is asked of the planner, and how finely the solid is to be meshed."""

    asked: planner.Params
    quality: str

    def expectation(self, coarse: Superquadric) -> str:
        """What that is expected to cost by the grasp, in lines; empty if it gave no solid."""
        found = renewed_forecast(self.asked, coarse, self.quality)
        return (
            "" if found is None else "\n".join(titled("expected", *found.texts(), "by the grasp"))
        )


def demanded_of(wirings: Sequence[Wiring]) -> Demanded | None:
    """What is asked of the one planner; None without one."""
    params = [one.params for one in wirings]
    planners = [one for one in params if isinstance(one, planner.Params)]
    if len(planners) != 1:
        return None
    rebuilt = [one.quality for one in params if isinstance(one, reconstructor.Params)]
    return Demanded(planners[0], rebuilt[0] if rebuilt else "normal")


def demand_text(
    wirings: Sequence[Wiring],
    settings: Mapping[str, SourceMapped],
    size: Sequence[float] | None,
) -> str:
    """What is asked, by whom, and what it is expected to cost; empty without a planner.

    `size`: of the object's box, (3,), m; None where the launch file has no scene.
    """
    demanded = demanded_of(wirings)
    if demanded is None:
        return ""
    lines = titled("asked", *_choices(demanded, settings))
    if size is not None:
        asked, height = demanded.asked, size[2]
        found = forecast(asked, size, quality=demanded.quality)
        share = f"for {100.0 * asked.tolerance / height:.2g} % of {1e3 * height:.0f} mm"
        lines += titled("expected", *found.texts(), share)
    return "\n".join(lines)


def _choices(demanded: Demanded, settings: Mapping[str, SourceMapped]) -> list[str]:
    """All limits that the exploration has, and who has set them."""

    def why(name: str, otherwise: str = "default or scene") -> str:
        return settings[name].source if name in settings else otherwise

    asked, limits = demanded.asked, demanded.asked.demand.limits
    follows = f"{SURVEYING.feature_ratio:g} times the tolerance"
    reason = follows if asked.feature is None else why("planner.feature")
    parts = [
        f"tolerance {1e3 * asked.tolerance:.3g} mm ({why('planner.tolerance')})",
        f"feature {1e3 * asked.demand.feature:.3g} mm ({reason})",
        f"unknown at most {100.0 * limits.unknown_share:.2g} % of the surface, over half a "
        "feature from any touch",
    ]
    if not asked.makes_single_touches:
        parts.append("gap between contours at most a feature")
    parts.append("a closed surface, no hole unentered")
    parts.append(f"the underside {asked.underside} ({why('planner.underside')})")
    turned = "never" if asked.turns == 0 else "once" if asked.turns == 1 else f"{asked.turns} times"
    often = turned if asked.turns == 0 else f"at most {turned}, where that pays"
    parts.append(f"turned over {often} ({why('planner.turns')})")
    if asked.most_touches is not None:
        parts.append(f"at most {asked.most_touches} touches ({why('planner.most_touches')})")
    if asked.most_seconds is not None:
        parts.append(f"at most {asked.most_seconds:g} s ({why('planner.most_seconds')})")
    return [*parts, f"quality {demanded.quality} ({why('reconstructor.quality', 'default')})"]
