"""What people are told of a scene before it is explored, and of the effects that there are."""

from __future__ import annotations

import textwrap
from dataclasses import fields
from typing import Any, get_args, get_type_hints

import msgspec

from palpate.core.plugins import ranges_of
from palpate.core.touch.effects import EFFECT_NAMES, effect_type
from palpate.launch.demand import read_mesh_setup
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_source import EXPLORE
from palpate.launch.printing import TEXT_WIDTH, counted, titled
from palpate.launch.run import check_run
from palpate.launch.run_directory import RUNS
from palpate.launch.scene import Scene, SceneSpec, find_scene, load_scene
from palpate.nodes.specs.sensors import SensorSpec, describe_effects


def check_scene(
    scene: str, *, unit: str | None = None, size: str | None = None, untrusted: bool = False
) -> Scene:
    """The scene, which can be explored; else raises InputError.

    `unit` or `size`, as ``120mm``: of a mesh file, how large it is.
    """
    path = find_scene(scene)
    if untrusted:
        load_scene(path, untrusted=True)
    args = {"scene": SourceMapped(str(path), "")}
    for option, name, value in read_mesh_setup(path, unit, size):
        args[name] = SourceMapped(value, option)
    described, _ = check_run(EXPLORE, args, {}, RUNS)
    assert described.scene is not None
    return described.scene


def scene_figures(scene: Scene) -> dict[str, Any]:
    """A scene: its file, the object's size, m, what was guessed of a mesh, sensor and effects."""
    effects = describe_effects(scene.spec.effects).items()
    return {
        "scene": str(scene.path),
        "size_m": scene.size,
        "told": scene.mesh_notes,
        "sensor": msgspec.to_builtins(scene.spec.sensor),
        "effects": [
            {"name": name, "phase": effect.phase.name.lower(), **msgspec.to_builtins(effect)}
            for name, effect in effects
        ],
    }


def scene_text(scene: Scene) -> str:
    """That a scene can be explored, its size, and what is simulated."""
    size = " x ".join(f"{1000.0 * side:.1f}" for side in scene.size)
    measures = f"can be explored; the object measures {size} mm"
    lines = titled("scene", str(scene.path), measures)
    lines += titled("mesh", scene.mesh_notes) if scene.mesh_notes else []
    return "\n".join([*lines, simulation_text(scene.spec)])


def simulation_text(scene: SceneSpec) -> str:
    """The sensor, and the effects in the order in which they act."""
    lines = titled("sensor", *_sensor(scene.sensor))
    effects = describe_effects(scene.effects)
    if not effects:
        return "\n".join([*lines, "simulated  exact contact, and no effects"])
    count = counted(len(effects), "effect")
    lines.append(f"simulated  exact contact, and {count}, in this order:")
    width = max(len(name) for name in effects)
    for name, effect in effects.items():
        head = f"  {effect.phase.name.lower():<7} {name:<{width}}  "
        told = titled(head, effect_parameters(effect), width=len(head))
        lines += map(str.rstrip, told)
    return "\n".join(lines)


def _sensor(sensor: SensorSpec) -> tuple[str, ...]:
    pad = sensor.pad
    face = "flat" if pad.radius is None else f"domed {_mm(pad.radius)}"
    sends = {"time": "times of flight", "force": "forces"}[sensor.signal]
    known = "as its data sheet says" if sensor.calibration is None else "calibrated"
    return (
        f"{sensor.rows} x {sensor.cols} taxels, pitch {_mm(sensor.pitch)}; pad {face}, "
        f"{_mm(pad.thickness)} thick;",
        f"sends {sends}, {known}",
    )


def _mm(metres: float) -> str:
    return f"{1000.0 * metres:g} mm"


def effect_parameters(effect: Any) -> str:
    """What an effect was given, with units; what was left out is passed over."""
    units = {name: allowed.unit for name, allowed in ranges_of(type(effect)).items()}
    told = []
    for field in fields(effect):
        value, unit = getattr(effect, field.name), units.get(field.name, "1")
        if value is None:  # left out, and so without meaning
            continue
        text = f"{value:g}" if isinstance(value, float) else str(value)
        told.append(f"{field.name} {text}" + ("" if unit == "1" else f" {unit}"))
    return ", ".join(told)


def list_effects() -> list[dict[str, Any]]:
    """Every effect that palpate has, with its parameters, their defaults and what they may be."""
    found = []
    for name in EFFECT_NAMES:
        kind = effect_type(name)
        allowed, hints, params = ranges_of(kind), get_type_hints(kind), {}
        for field in fields(kind):  # type: ignore[arg-type]
            hint = hints[field.name]
            span = "true or false" if hint is bool else " or ".join(map(str, get_args(hint)))
            span = str(allowed.get(field.name, span))
            params[field.name] = {"default": field.default, "allowed": span}
        told = (kind.__doc__ or "").partition("\n")[0]
        found.append({"name": name, "told": told, "parameters": params})
    return found


def effects_text(effects: list[dict[str, Any]]) -> str:
    """The same for people."""
    lines = []
    for effect in effects:
        head = f"{effect['name']}: {effect['told']}"
        lines += textwrap.wrap(head, TEXT_WIDTH, subsequent_indent="    ")
        for name, one in effect["parameters"].items():
            given = "" if one["default"] is None else f"{one['default']}"
            lines.append(f"  {name:<14}{given:<10}{one['allowed']}".rstrip())
    return "\n".join(lines)
