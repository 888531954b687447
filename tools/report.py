"""What people are told of a scene before it is explored, and of a run when it is over."""

from __future__ import annotations

import json
import sys
from dataclasses import fields
from typing import Any, get_args, get_type_hints

import click

from palpate.core import ranges_of
from palpate.core.touch.effects import EFFECT_NAMES, effect_type
from palpate.launch import (
    EXPLORE,
    RUNS,
    Plan,
    SceneSpec,
    check_run,
    find_scene,
    open_display,
    perform,
)
from palpate.launch.files import SourceMapped
from palpate.nodes.specs import SensorSpec, describe_effects


def perform_and_print(plan: Plan, *, composed: bool, as_json: bool, quiet: bool) -> int:
    """Perform a plan and print what it came to; returns the exit code.

    `plan`: what to run; `composed`: all nodes in this process; `as_json`: print ``summary.json`` to
    standard output instead of a text; `quiet`: print nothing but what was asked for by `as_json`.
    """
    done = perform(plan, composed=composed, display=open_display(quiet=quiet or as_json))
    if as_json:
        click.echo(json.dumps(done.summary, indent=2, allow_nan=False))
    elif not quiet:
        click.echo(done.text)
    elif done.exit_code != 0:
        click.echo(f"palpate: {done.ending.status}: {done.ending.reason}", err=True)
    return done.exit_code


def check_scene(scene: str) -> str:
    """That a scene can be explored, the size of its object, and what is simulated.

    `scene`: path of a YAML file, or the name of a shipped scene. Raises InputError if it cannot be
    explored.
    """
    path = find_scene(scene)
    described, _ = check_run(EXPLORE, {"scene": SourceMapped(str(path), "")}, {}, RUNS)
    assert described.scene is not None
    size = " x ".join(f"{1000.0 * side:.1f}" for side in described.scene.size)
    said = f"{path}: can be explored; the object measures {size} mm"
    return f"{said}\n{simulation_text(described.scene.spec)}"


def simulation_text(scene: SceneSpec) -> str:
    """The sensor, and the effects in the order in which they act, one a line."""
    lines = [f"sensor     {_sensor(scene.sensor)}"]
    effects = describe_effects(scene.effects)
    if not effects:
        return "\n".join([*lines, "simulated  exact contact, and no effects"])
    lines.append(f"simulated  exact contact, and {_effect_count(len(effects))}, in this order:")
    width = max(len(name) for name in effects)
    for name, effect in effects.items():
        place = effect.phase.name.lower()
        lines.append(f"  {place:<7} {name:<{width}}  {_parameters(effect)}".rstrip())
    return "\n".join(lines)


def _sensor(sensor: SensorSpec) -> str:
    pad = sensor.pad
    face = "flat" if pad.radius is None else f"domed {_mm(pad.radius)}"
    sends = {"time": "times of flight", "force": "forces"}[sensor.signal]
    known = "as its data sheet says" if sensor.calibration is None else "calibrated"
    return (
        f"{sensor.rows} x {sensor.cols} taxels, pitch {_mm(sensor.pitch)}; pad {face}, "
        f"{_mm(pad.thickness)} thick; sends {sends}, {known}"
    )


def _mm(metres: float) -> str:
    return f"{1000.0 * metres:g} mm"


def _effect_count(effects: int) -> str:
    return "1 effect" if effects == 1 else f"{effects} effects"


def _parameters(effect: Any) -> str:
    units = {name: allowed.unit for name, allowed in ranges_of(type(effect)).items()}
    said = []
    for field in fields(effect):
        value, unit = getattr(effect, field.name), units.get(field.name, "1")
        if value is None:  # left out, and so without meaning
            continue
        text = f"{value:g}" if isinstance(value, float) else str(value)
        said.append(f"{field.name} {text}" + ("" if unit == "1" else f" {unit}"))
    return ", ".join(said)


def effects_text() -> str:
    """Every effect that palpate has, with its parameters, their ranges and defaults."""
    lines = []
    for name in EFFECT_NAMES:
        kind = effect_type(name)
        lines.append(f"{name}: {effect_title(name)}")
        allowed = ranges_of(kind)
        for field in fields(kind):  # type: ignore[arg-type]
            given = "" if field.default is None else f"{field.default}"
            span = str(allowed[field.name]) if field.name in allowed else _choices(kind, field.name)
            lines.append(f"  {field.name:<14}{given:<10}{span}".rstrip())
    return "\n".join(lines)


def effect_title(name: str) -> str:
    """What an effect is, in one line."""
    module = sys.modules[effect_type(name).__module__]
    return (module.__doc__ or "").strip().partition("\n")[0]


def _choices(kind: type, name: str) -> str:
    """What a parameter without a range may be."""
    hint = get_type_hints(kind)[name]
    return "true or false" if hint is bool else " or ".join(map(str, get_args(hint)))
