"""Descriptions of a scene before it is explored, and of the available effects."""

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
    """Load a scene; raises InputError if it cannot be explored.

    `unit` of the coordinates of a mesh file, or its `size`, such as ``120mm``.
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
    """Facts of a scene: file, size of the object [m], guesses about a mesh, sensor and effects."""
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
    """Lines about a scene that can be explored: its size, and what is simulated."""
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
        lines += map(str.rstrip, titled(head, effect_parameters(effect), width=len(head)))
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
    """Parameters of an effect with units, without those that were left out."""
    units = {name: allowed.unit for name, allowed in ranges_of(type(effect)).items()}
    texts = []
    for field in fields(effect):
        value, unit = getattr(effect, field.name), units.get(field.name, "1")
        if value is None:
            continue
        text = f"{value:g}" if isinstance(value, float) else str(value)
        texts.append(f"{field.name} {text}" + ("" if unit == "1" else f" {unit}"))
    return ", ".join(texts)


def list_effects() -> list[dict[str, Any]]:
    """All effects with their parameters, the defaults and the allowed values."""
    effects = []
    for name in EFFECT_NAMES:
        kind = effect_type(name)
        allowed, hints, params = ranges_of(kind), get_type_hints(kind), {}
        for field in fields(kind):  # type: ignore[arg-type]
            hint = hints[field.name]
            span = "true or false" if hint is bool else " or ".join(map(str, get_args(hint)))
            span = str(allowed.get(field.name, span))
            params[field.name] = {"default": field.default, "allowed": span}
        summary = (kind.__doc__ or "").partition("\n")[0]
        effects.append({"name": name, "told": summary, "parameters": params})
    return effects


def effects_text(effects: list[dict[str, Any]]) -> str:
    """Lines about the effects of `list_effects`."""
    lines = []
    for effect in effects:
        head = f"{effect['name']}: {effect['told']}"
        lines += textwrap.wrap(head, TEXT_WIDTH, subsequent_indent="    ")
        for name, parameter in effect["parameters"].items():
            default = "" if parameter["default"] is None else f"{parameter['default']}"
            lines.append(f"  {name:<14}{default:<10}{parameter['allowed']}".rstrip())
    return "\n".join(lines)
