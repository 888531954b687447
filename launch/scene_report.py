"""What a scene simulates, in words."""

from __future__ import annotations

import sys
from dataclasses import fields
from typing import Any, get_args, get_type_hints

from palpate.core.ranges import ranges_of
from palpate.core.touch.effects.catalogue import NAMES, effect_type
from palpate.launch.scene import SceneSpec
from palpate.nodes.effects import describe_effects
from palpate.nodes.sensor import SensorSpec


def simulated(scene: SceneSpec) -> str:
    """The sensor, and the effects in the order in which they act, one a line."""
    lines = [f"sensor     {_sensor(scene.sensor)}"]
    effects = describe_effects(scene.effects)
    if not effects:
        return "\n".join([*lines, "simulated  exact contact, and no effects"])
    lines.append(f"simulated  exact contact, and {_counted(len(effects))}, in this order:")
    width = max(len(name) for name in effects)
    for name, effect in effects.items():
        place = effect.place.name.lower()
        lines.append(f"  {place:<7} {name:<{width}}  {_parameters(effect)}".rstrip())
    return "\n".join(lines)


def _counted(effects: int) -> str:
    return "1 effect" if effects == 1 else f"{effects} effects"


def _sensor(sensor: SensorSpec) -> str:
    pad = sensor.pad
    face = "flat" if pad.radius is None else f"domed {_mm(pad.radius)}"
    sends = {"time": "times of flight", "force": "forces"}[sensor.signal]
    known = "as its data sheet says" if sensor.calibration is None else "calibrated"
    return (
        f"{sensor.rows} x {sensor.cols} taxels, pitch {_mm(sensor.pitch)}; pad {face}, "
        f"{_mm(pad.thickness)} thick; sends {sends}, {known}"
    )


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


def _mm(metres: float) -> str:
    return f"{1000.0 * metres:g} mm"


def effects_known() -> str:
    """Every effect that palpate has, with its parameters, their ranges and defaults."""
    lines = []
    for name in NAMES:
        kind = effect_type(name)
        lines.append(f"{name}: {title_of(name)}")
        allowed = ranges_of(kind)
        for field in fields(kind):  # type: ignore[arg-type]
            given = "" if field.default is None else f"{field.default}"
            span = str(allowed[field.name]) if field.name in allowed else _choices(kind, field.name)
            lines.append(f"  {field.name:<14}{given:<10}{span}".rstrip())
    return "\n".join(lines)


def _choices(kind: type, name: str) -> str:
    """What a parameter without a range may be."""
    hint = get_type_hints(kind)[name]
    return "true or false" if hint is bool else " or ".join(map(str, get_args(hint)))


def title_of(name: str) -> str:
    """What an effect is, in one line."""
    module = sys.modules[effect_type(name).__module__]
    return (module.__doc__ or "").strip().partition("\n")[0]
