"""Scenes: object, sensor, effects, planner and world, from a YAML file.

A scene is checked completely when it is loaded, so that it can be explored. A scene may name a
calibration, which `palpate calibrate` writes.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct, structs, to_builtins
from ruamel.yaml import YAML

from palpate.core.explore.planners import PLANNER_NAMES, Planner, planner_type
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.touch import CalibrationEstimate, Effect, Pad
from palpate.core.touch.effects import EFFECT_NAMES, effect_type
from palpate.launch.files.file_access import file_within, plain_name, write_new
from palpate.launch.files.mesh_file import MeshFile, is_mesh_file, read_mesh
from palpate.launch.files.source_map import (
    InputError,
    KeyPath,
    SourceMapped,
    hint,
    path_text,
    set_within,
)
from palpate.launch.files.yaml_file import convert, read_yaml, yaml_text
from palpate.launch.node_kinds import INPUTS, search_current_folder, search_inputs
from palpate.nodes.specs.objects import ObjectSpec, Seed, encode_mesh, fitted_reach, object_extents
from palpate.nodes.specs.primitives import Length
from palpate.nodes.specs.sensors import CalibrationSpec, EffectSpecs, SensorSpec, build_pipeline
from palpate.reprs import readable

SHIPPED_SCENES = Path(__file__).parent / "scenes"  # folder of the scenes that come with palpate
MESH, CALIBRATION = ("object", "mesh", "file"), ("sensor", "calibration")  # keys of file names
MAX_CALIBRATION_VALUES = 20_000  # of a file: four tables of 64 by 64, and single values


class WorldSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The reach of the finger, and the speeds of the robot."""

    # Reach sideways from the axis and upwards from the platform [m]; fitted to the object if None.
    reach: Length | None = None
    robot: str = "modern"  # preset of the robot's speeds: modern or puma

    def __post_init__(self) -> None:
        if self.robot not in ROBOT_PRESETS:
            raise ValueError(f"robot must be one of {sorted(ROBOT_PRESETS)}, got {self.robot!r}")


class SceneSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All keys of a scene file."""

    object: ObjectSpec
    sensor: SensorSpec = SensorSpec()
    world: WorldSpec = WorldSpec()
    effects: EffectSpecs = {}  # disturbances of the sensor by name; in the file a list
    explore: dict[str, Any] = {}  # parameters of the planner
    seed: Seed = 0  # of all random numbers


@readable
@dataclass(frozen=True, slots=True)
class Scene:
    """A checked scene."""

    name: str  # of the file without its suffix; invisible characters are ``_``
    path: Path  # of the file
    text: str  # of the file
    spec: SceneSpec  # its contents, with defaults filled in and the mesh read
    located: SourceMapped  # the same as plain values, with file and line
    size: tuple[float, float, float]  # extents of the object along x, y, z, to about 0.1 mm [m]
    # Files that it names, by their paths in the folder of a run, as `text` names them.
    inputs: Mapping[str, Path] = field(default_factory=dict)
    mesh_notes: str = ""  # what was guessed and repaired of its mesh; empty if nothing


def load_scene(
    name: str | Path,
    changes: Mapping[KeyPath, SourceMapped] = {},
    *,
    untrusted: bool = False,
) -> Scene:
    """The scene in a YAML file, given by its path, or a scene that comes with palpate, by name.

    A mesh file is a scene that contains only its solid. `changes` replace values of the file by
    their paths; effects are named in them, as ``effects.gaussian_noise.sigma``. A scene below the
    current folder or the user's home may name any file; a scene from elsewhere, or an `untrusted`
    one, only files below its own folder, and an untrusted one no program. Raises InputError with
    file, line, key, value and what would be right.
    """
    path = find_scene(name)
    search_inputs(path.parent)
    is_mesh = is_mesh_file(path)
    own_name = plain_name(path.name)
    mesh_alone = SourceMapped({"object": {"mesh": {"file": own_name}}}, str(path))
    document = mesh_alone if is_mesh else read_yaml(path)
    for key, value in changes.items():
        document = _changed(document, key, value)
    if untrusted:
        _refuse_programs(document)
    folder = path.resolve().parent
    is_own = not untrusted and any(map(folder.is_relative_to, (Path.cwd(), Path.home())))
    named = _named_files(document, folder, confined=not (is_own or is_mesh))
    if is_mesh and MESH in named and document.part(MESH).value == own_name:
        named[MESH] = path.resolve()  # also where its name is not plain
    inputs = {f"{INPUTS}/{plain_name(file.name)}": file for file in named.values()}
    text = path.read_text(encoding="utf-8") if not is_mesh else ""
    if changes or inputs:
        text = yaml_text(_moved_files(document, named).value)
    document, mesh_notes = _with_mesh(document, path, named)
    document = with_effects(_with_planner(document))
    document = with_calibration(document, named.get(CALIBRATION))
    check_planner(document)
    spec = convert(document, SceneSpec)
    if spec.world.reach is None:
        reach = fitted_reach(spec.object)
        spec = structs.replace(spec, world=structs.replace(spec.world, reach=reach))
    located = SourceMapped(
        to_builtins(spec, builtin_types=(bytes,)), document.source, document.places
    )
    _check_finger(spec, located)
    size = _check_reach(spec, located)
    name = plain_name(path.stem)
    return Scene(name, path, text, spec, located, size, inputs, mesh_notes)


def _refuse_programs(document: SourceMapped) -> None:
    """Raise InputError if a scene names a module, which is a program."""
    listed, explore = document.value.get("effects"), document.value.get("explore")
    named: dict[KeyPath, Any] = {}
    if isinstance(listed, list):
        named = {("effects", i): entry for i, entry in enumerate(listed)}
    if isinstance(explore, dict):
        named["explore", "planner"] = explore.get("planner")
    for key, entry in named.items():
        name = next(iter(entry), "") if isinstance(entry, dict) else entry
        if isinstance(name, str) and ":" in name:
            raise document.error(
                key, f"{name!r} is a program, which an untrusted scene may not name"
            )


def _named_files(document: SourceMapped, folder: Path, *, confined: bool) -> dict[KeyPath, Path]:
    """The files that a scene names, by the keys of their names."""
    files: dict[KeyPath, Path] = {}
    keys: tuple[KeyPath, ...] = (MESH, CALIBRATION)
    for key in keys:
        name = None
        with suppress(KeyError, TypeError):
            name = document.part(key).value
        if name is None:
            continue
        label = path_text(key)
        if not isinstance(name, str):
            raise document.error(key, f"{label} must be the name of a file")
        try:
            files[key] = file_within(folder, name, label, confined=confined)
        except ValueError as error:
            raise document.error(key, str(error)) from None
    return files


def _moved_files(document: SourceMapped, named: Mapping[KeyPath, Path]) -> SourceMapped:
    """The scene with the names that its files have in the folder of a run."""
    for key, path in named.items():
        place = SourceMapped(f"{INPUTS}/{plain_name(path.name)}", "")
        document = replace(document, value=set_within(document.value, key, place))
    return document


def _changed(document: SourceMapped, path: KeyPath, value: SourceMapped) -> SourceMapped:
    """The scene with another value at a path; an effect that is not listed is added."""
    listed = document.value.get("effects") or []
    if path[0] == "effects" and isinstance(path[-1], str) and len(path) > 1:
        names = [next(iter(e)) if isinstance(e, Mapping) and e else e for e in listed]
        i = names.index(path[1]) if path[1] in names else len(names)
        entry = {} if i == len(names) or isinstance(listed[i], str) else listed[i]
        effects = [*listed[:i], entry or {path[1]: {}}, *listed[i + 1 :]]
        document = replace(document, value={**document.value, "effects": effects})
        path = ("effects", i, *path[1:])
    places = {path[:end]: value.source for end in range(1, len(path))}
    places |= {(*path, *inner): place for inner, place in value.places.items()}
    changed = set_within(document.value, path, value, "the scene")
    return SourceMapped(changed, document.source, {**places, **document.places, path: value.source})


def with_effects(document: SourceMapped) -> SourceMapped:
    """The scene with a map of effects, from name to parameters, in place of their list.

    An entry of the list is a name, or a map from the name to the parameters. A user's own effect is
    named ``module:Class``; the module may be in the current folder. Raises InputError if `effects`
    is no list, an effect is unknown or listed twice, or a parameter is unknown, of the wrong type,
    or out of its range.
    """
    listed = document.value.get("effects")
    if listed is None:  # the key is missing or empty
        rest = {key: value for key, value in document.value.items() if key != "effects"}
        return replace(document, value=rest)
    if not isinstance(listed, list):
        raise document.error(
            ("effects",), "effects must be a list: - gaussian_noise: {sigma: 1e-5}"
        )
    effects: dict[str, Any] = {}
    kinds: dict[type, str] = {}
    places = dict(document.places)
    for i, entry in enumerate(listed):
        name, parameters = _listed_effect(document, i, entry)
        if name in effects:
            raise document.error(("effects", i), f"effects lists {name!r} twice; list it once")
        key: KeyPath = ("effects", i, name) if isinstance(entry, Mapping) else ("effects", i)
        part = replace(document.part(key), value=parameters)
        kind = _checked_effect(part, name)
        if kind in kinds:
            raise document.error(
                ("effects", i), f"{name!r} and {kinds[kind]!r} are the same effect"
            )
        kinds[kind] = name
        effects[name] = parameters
        places.update({("effects", name, *inner): at for inner, at in part.places.items()})
        places["effects", name] = part.source
    return replace(document, value={**document.value, "effects": effects}, places=places)


def _listed_effect(document: SourceMapped, i: int, entry: Any) -> tuple[str, dict[str, Any]]:
    if isinstance(entry, str):
        return entry, {}
    if isinstance(entry, Mapping) and len(entry) == 1:
        name, parameters = next(iter(entry.items()))
        if isinstance(name, str) and (parameters is None or isinstance(parameters, Mapping)):
            return name, dict(parameters or {})
    raise document.error(
        ("effects", i),
        f"effects[{i}] must be one effect and its parameters: - gaussian_noise: {{sigma: 1e-5}}",
    )


def _checked_effect(parameters: SourceMapped, name: str) -> type[Effect]:
    search_current_folder(name)
    try:
        kind = effect_type(name)
    except LookupError:
        place = f"{parameters.source}: " if parameters.source else ""
        known = hint(name, EFFECT_NAMES)
        raise InputError(f"{place}there is no effect {name!r}; {known}") from None
    except ValueError as error:
        raise parameters.error((), str(error)) from None
    convert(parameters, kind, f"effects.{name}")
    return kind


def _with_mesh(
    document: SourceMapped, scene: Path, named: Mapping[KeyPath, Path]
) -> tuple[SourceMapped, str]:
    """The scene with the mesh that it names, and notes on reading it.

    A mesh without a pose that lies beside the axis is moved onto it.
    """
    try:
        part = document.part(("object", "mesh"))
    except (KeyError, TypeError):
        return document, ""
    mesh = convert(part, MeshFile, "object.mesh")
    path = named[MESH]
    try:
        vertices, faces, notes = read_mesh(path, mesh.unit, mesh.up, mesh.size)
    except ValueError as error:
        if is_mesh_file(scene):  # the error names the file already
            raise
        raise part.error(("file",), str(error)) from None
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if "pose" not in document.value["object"] and ((low > 0.0) | (high < 0.0))[:2].any():
        shift = 0.0 - np.array([*0.5 * (low + high)[:2], low[2]])
        vertices = vertices + shift
        offset = ", ".join(f"{1e3 * x:.4g}" for x in shift)
        notes = f"{notes}; moved" if notes else f"{path.name}: moved"
        notes += f" by {offset} mm, from beside the axis onto it"
    data = to_builtins(encode_mesh(vertices, faces), builtin_types=(bytes,))
    shape = {**document.value["object"], "mesh": data}
    return replace(document, value={**document.value, "object": shape}), notes


def _with_planner(document: SourceMapped) -> SourceMapped:
    """The scene with planner `touches` for a mesh or torus: its slices may be several curves."""
    explore, shape = document.value.get("explore", {}), document.value.get("object")
    if not isinstance(explore, Mapping) or {"planner", "settings", "axis"} & set(explore):
        return document
    if not isinstance(shape, Mapping) or not {"mesh", "torus"} & set(shape):
        return document
    return replace(document, value={**document.value, "explore": {**explore, "planner": "touches"}})


def with_calibration(document: SourceMapped, path: Path | None) -> SourceMapped:
    """The scene with the calibration in a file, if its sensor names one.

    Raises InputError if the file cannot be used.
    """
    if path is None:
        return document
    calibration = SourceMapped(to_builtins(read_calibration(path)), "")
    return replace(document, value=set_within(document.value, CALIBRATION, calibration))


def read_calibration(path: Path) -> CalibrationSpec:
    """The calibration in a file; InputError with file, line, key and value."""
    contents = convert(read_yaml(path, MAX_CALIBRATION_VALUES), CalibrationFile, "calibration")
    names = CalibrationSpec.__struct_fields__
    return CalibrationSpec(**{name: getattr(contents, name) for name in names})


def check_planner(document: SourceMapped) -> Planner | None:
    """The planner that a scene describes, ``explore: {planner: NAME, settings: {...}}``.

    A user's own planner is named ``module:Class``; the module may be in the current folder. None if
    the scene has neither key. Raises InputError if there is no such planner, or a setting is
    unknown, of the wrong type, or out of its range.
    """
    explore = document.value.get("explore")
    if not isinstance(explore, Mapping) or not {"planner", "settings"} & set(explore):
        return None
    name, path = explore.get("planner", PLANNER_NAMES[0]), ("explore", "planner")
    if not isinstance(name, str):
        raise document.error(
            path, f"explore.planner is {name!r}; it must be a name, as {PLANNER_NAMES[0]}"
        )
    search_current_folder(name)
    try:
        kind = planner_type(name)
    except LookupError:
        known = hint(name, PLANNER_NAMES)
        raise document.error(path, f"there is no planner {name!r}; {known}") from None
    except ValueError as error:
        raise document.error(path, str(error)) from None
    return convert(_planner_settings(document, explore), kind, "explore.settings")


def _planner_settings(document: SourceMapped, explore: Mapping[str, object]) -> SourceMapped:
    """The settings of the planner; an empty key means no settings."""
    path = ("explore", "settings")
    if (settings := explore.get("settings")) is None:
        return SourceMapped({}, document.place(path))
    if not isinstance(settings, Mapping):
        raise document.error(path, f"explore.settings is {settings!r}; it must be a map of numbers")
    return document.part(path)


def _check_finger(spec: SceneSpec, located: SourceMapped) -> None:
    try:
        build_pipeline(spec.sensor, spec.effects, ROBOT_PRESETS[spec.world.robot])
    except ValueError as error:
        name = str(error).partition(" ")[0]
        where = ("effects", name) if name in spec.effects else ("effects",)
        raise located.error(where, str(error)) from None


def _check_reach(
    spec: SceneSpec,
    located: SourceMapped,
    min_sliced_extent: float = 5.0e-3,
    min_touched_extent: float = 2.0e-3,
) -> tuple[float, float, float]:
    """Extents of the object [m]; InputError if it is too small, or out of reach of the finger.

    The smallest extents [m] are those of objects that are explored in slices, or by single touches.
    """
    size, radius = object_extents(spec.object)
    is_touched = spec.explore.get("planner") == "touches"
    min_extent = min_touched_extent if is_touched else min_sliced_extent
    if min(size) < min_extent:
        raise located.error(
            ("object",),
            f"the object is only {min(size):.3g} m across; a pad of 15 mm can follow nothing "
            f"smaller than {min_extent} m",
        )
    height, reach = size[2], spec.world.reach
    if reach is not None and max(radius, height) > reach:
        raise located.error(
            ("object",),
            f"the object reaches {radius:.3g} m sideways and is {height:.3g} m high, but the "
            f"finger reaches {reach:g} m; enlarge world.reach or leave it out, or move or shrink "
            "the object",
        )
    return size


def shipped_scenes() -> tuple[str, ...]:
    """Names of the scenes that come with palpate."""
    return tuple(sorted(path.stem for path in SHIPPED_SCENES.glob("*.yaml")))


def find_scene(scene: str | Path) -> Path:
    """Path of a scene, given by name or path; InputError if there is no such scene."""
    path = Path(scene)
    if path.is_file():
        return path
    known = shipped_scenes()
    if str(scene) in known:
        return SHIPPED_SCENES / f"{scene}.yaml"
    if len(path.parts) > 1 or path.suffix:
        kind = "is a folder" if path.is_dir() else "does not exist"
        raise InputError(f"{path}: the scene {kind}; a scene is a YAML file, or a mesh")
    raise InputError(f"there is no scene {str(scene)!r}; {hint(str(scene), known)}")


def scene_title(name: str) -> str:
    """The first comment of a shipped scene."""
    first = (SHIPPED_SCENES / f"{name}.yaml").read_text(encoding="utf-8").partition("\n")[0]
    return first.removeprefix("#").strip()


class CalibrationFile(CalibrationSpec, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A calibration file, with standard errors that are not used."""

    errors: dict[str, Any] = msgspec.field(default_factory=dict)  # by the names of the fields


def write_calibration(path: Path, estimate: CalibrationEstimate, pad: Pad) -> None:
    """Write a calibration, whole or not at all.

    Raises InputError if the file exists, or cannot be written.
    """

    def plain(name: str) -> Any:
        value = getattr(estimate, name)
        if not isinstance(value, np.ndarray):
            return _rounded(value)
        rows = value.reshape(pad.rows, pad.cols).tolist()
        return [[_rounded(x) if math.isfinite(x) else None for x in row] for row in rows]

    document = {name: plain(name) for name in ("sound_speed", "noise", "gain", "offset")}
    errors = {name: plain(f"{name}_error") for name in ("sound_speed", "gain", "offset")}
    document["errors"] = errors
    text = io.StringIO()
    text.write("# Written by palpate calibrate. A gain of 0 marks an unreliable taxel.\n")
    yaml = YAML(pure=True)
    yaml.default_flow_style = None
    yaml.width = 1000
    yaml.dump(document, text)
    write_new(path, lambda part: part.write_text(text.getvalue(), encoding="utf-8"))


def _rounded(value: float, digits: int = 6) -> float:
    """A value with fewer significant digits, far more than its standard error needs."""
    return float(f"{value:.{digits}g}")
