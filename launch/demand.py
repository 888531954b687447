"""What a user asks of a run, in units, and what that is expected to cost before it begins.

Expected touches and robot seconds are medians over the shipped scenes, each explored at five shares
of its height; in brackets, the span in which the middle half of them lies. Another object may take
more: what a run really costs, and what a better one would, it tells itself.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from palpate.core.explore import FEATURE_SHARE
from palpate.launch.files import InputError, SourceMapped
from palpate.launch.printing import titled
from palpate.nodes import planner, reconstructor
from palpate.nodes.runtime import Wiring

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
TIMES = {"s": 1.0, "min": 60.0, "h": 3600.0}
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Zµ]*)\s*")


def read_quantity(text: str, units: Mapping[str, float], option: str) -> float:
    """A positive number with its unit, in m or s: ``0.2mm``, ``5 min``.

    Raises InputError if there is no number, no unit or another one, or it is not positive.
    """
    found = _QUANTITY.fullmatch(text)
    example = f"0.2{'mm' if 'mm' in units else 's'}"
    if found is None:
        raise InputError(f"{option} {text}: must be a number with a unit, as {example}")
    number, unit = found.groups()
    unit = unit.replace("µ", "u")
    if unit not in units:
        what = f"the unit {unit!r} is none of" if unit else "must have a unit:"
        raise InputError(f"{option} {text}: {what} {', '.join(units)}, as in {example}")
    value = float(number) * units[unit]
    if not 0.0 < value < math.inf:
        raise InputError(f"{option} {text}: must be more than 0, as {example}")
    return value


def read_demand(
    tolerance: str | None,
    feature: str | None,
    budget: str | None,
    touches: int | None,
    quality: str | None,
    procedure: str | None = None,
) -> dict[str, SourceMapped]:
    """Settings of nodes for what was asked on the command line; those not asked for are left out.

    `procedure`: the exploratory procedure, to which only `touches` means anything. Raises
    InputError as `read_quantity` does, if `touches` is not positive, or if a procedure is asked for
    what it cannot keep.
    """
    found: dict[str, SourceMapped] = {}
    asked: tuple[tuple[str, str | None, Mapping[str, float], str], ...] = (
        ("--tolerance", tolerance, LENGTHS, "planner.tolerance"),
        ("--feature", feature, LENGTHS, "planner.feature"),
        ("--budget", budget, TIMES, "planner.most_seconds"),
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

    Raises InputError if the pose is not 3 or 7 numbers.
    """
    found: list[tuple[str, str, Any]] = []
    if pose is not None:
        try:
            numbers = [float(one) for one in pose.split(",")]
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


class ExpectedCost(NamedTuple):
    """What shipped scenes took at one tolerance: lower quartile, median, upper quartile."""

    touches: tuple[float, float, float]
    seconds: tuple[float, float, float]  # Robot time, one finger of the preset ``modern``, s


# By the tolerance over the object's height, %: `python tests/studies tolerances`.
COSTS: Mapping[float, ExpectedCost] = {
    1.0: ExpectedCost((45, 65, 94), (156, 190, 238)),
    0.5: ExpectedCost((55, 76, 99), (172, 194, 248)),
    0.2: ExpectedCost((89, 98, 132), (212, 226, 292)),
    0.1: ExpectedCost((138, 144, 164), (274, 284, 318)),
    0.05: ExpectedCost((185, 198, 241), (344, 366, 395)),
}
# Processor time of a whole run over that of quality normal.
QUALITY_COST: Mapping[str, float] = {"draft": 0.85, "normal": 1.0, "fine": 1.5}
# Of a run of quality normal, s for each touch, on one core of a machine of 2020.
COMPUTE_PER_TOUCH = 0.05


def expected_cost(share: float) -> ExpectedCost:
    """For a tolerance over the height, between those that were measured by powers."""
    known = np.log(sorted(COSTS))
    rows = np.log([COSTS[one] for one in sorted(COSTS)])

    def between(which: int) -> tuple[float, float, float]:
        at, columns = math.log(100.0 * share), rows[:, which].T
        low, middle, high = (float(np.exp(np.interp(at, known, one))) for one in columns)
        return low, middle, high

    return ExpectedCost(touches=between(0), seconds=between(1))


class ObjectCost(NamedTuple):
    """What an object takes by its size; the rest of an exploration comes on top."""

    touches: float
    seconds: float  # Of computing, s
    gigabytes: float  # Of memory, of the node that takes the most


TOUCH_AREA = 1.54  # Of the square of the pad's width, that one touch covers: 717 on a ball of 0.3 m
TOUCH_BYTES = 40e3  # Of what is kept of a touch, and made of it at the end
FIT_BYTES = 1.5e9  # Most that one fit takes: `palpate.core.rebuild.general.GridSettings`
# Largest computing time and memory of a run that is begun.
MAX_SECONDS, MAX_GIGABYTES = 600.0, 2.0


def object_cost(
    asked: planner.Params, *, height: float, area: float, pad_width: float
) -> ObjectCost:
    """What an object of such a height [m] and area [m^2] takes with a pad of such a width [m]."""
    touches = expected_cost(asked.tolerance / height).touches[1]
    touches = max(touches, area / (TOUCH_AREA * pad_width**2))
    if asked.most_touches is not None:
        touches = min(touches, asked.most_touches)
    memory = FIT_BYTES + TOUCH_BYTES * touches
    return ObjectCost(touches, COMPUTE_PER_TOUCH * touches, 1e-9 * memory)


def demand_text(
    wirings: Sequence[Wiring], settings: Mapping[str, SourceMapped], height: float | None
) -> str:
    """What is asked, by whom, and what it is expected to cost; empty without a planner.

    `height`: of the object, m; None where the launch file has no scene.
    """
    params = [one.params for one in wirings]
    planners = [one for one in params if isinstance(one, planner.Params)]
    if len(planners) != 1:
        return ""
    asked = planners[0]
    qualities = [one.quality for one in params if isinstance(one, reconstructor.Params)]
    lines = titled("asked", *_choices(asked, qualities, settings))
    if height is not None:
        lines += titled("expected", *_expectation(asked, qualities, height))
    return "\n".join(lines)


def tolerance_of(wirings: Sequence[Wiring]) -> float | None:
    """The error that the planner is to reach, m; None without one planner."""
    found = [one.params.tolerance for one in wirings if isinstance(one.params, planner.Params)]
    return found[0] if len(found) == 1 else None


def _choices(
    asked: planner.Params, qualities: Sequence[str], settings: Mapping[str, SourceMapped]
) -> list[str]:
    def why(name: str, otherwise: str = "default or scene") -> str:
        return settings[name].source if name in settings else otherwise

    feature = asked.demand.feature
    follows = f"{FEATURE_SHARE:g} times the tolerance"
    reason = follows if asked.feature is None else why("planner.feature")
    parts = [
        f"tolerance {1e3 * asked.tolerance:.3g} mm ({why('planner.tolerance')})",
        f"untouched at most {1e3 * feature:.3g} mm ({reason})",
    ]
    if asked.most_touches is not None:
        parts.append(f"at most {asked.most_touches} touches ({why('planner.most_touches')})")
    if asked.most_seconds is not None:
        parts.append(f"at most {asked.most_seconds:g} s ({why('planner.most_seconds')})")
    parts += [f"quality {one} ({why('reconstructor.quality', 'default')})" for one in qualities]
    return parts


def _expectation(asked: planner.Params, qualities: Sequence[str], height: float) -> list[str]:
    touches, seconds = expected_cost(asked.tolerance / height)
    compute = COMPUTE_PER_TOUCH * touches[1] * max([QUALITY_COST[q] for q in qualities] or [1.0])
    return [
        f"about {touches[1]:.0f} touches ({touches[0]:.0f} to {touches[2]:.0f})",
        f"robot {seconds[1]:.0f} s ({seconds[0]:.0f} to {seconds[2]:.0f})",
        f"computing {compute:.0f} s",
        f"for {100.0 * asked.tolerance / height:.2g} % of {1e3 * height:.0f} mm",
    ]
