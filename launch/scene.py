"""A scene: object, sensor, effects, planner and world, from a YAML file.

Loading checks everything that can be wrong with it; a scene that loads can be explored. Also the
calibration that it may name, as `palpate calibrate` writes it.
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

LEAST_SLICED, LEAST_TOUCHED = 5.0e-3, 2.0e-3  # Smallest extents of objects in slices, or not, m
SHIPPED_SCENES = Path(__file__).parent / "scenes"  # Folder of the scenes that come with palpate
MESH, CALIBRATION = ("object", "mesh", "file"), ("sensor", "calibration")  # Keys of files
DIGITS = 6  # Significant digits of what is written: far more than any of it is sure of
MAX_CALIBRATION_VALUES = 20_000  # Four tables of 64 by 64, and what belongs to them


class WorldSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a robot knows before it touches anything."""

    # The finger reaches this far sideways from the axis and up from the platform on which the
    # object stands, m; as far as the object asks for if left out.
    reach: Length | None = None
    robot: str = "modern"  # Preset of the robot's speeds: modern or puma

    def __post_init__(self) -> None:
        if self.robot not in ROBOT_PRESETS:
            raise ValueError(f"robot must be one of {sorted(ROBOT_PRESETS)}, got {self.robot!r}")


class SceneSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that a scene file may hold."""

    object: ObjectSpec  # What stands there
    sensor: SensorSpec = SensorSpec()  # What touches it
    world: WorldSpec = WorldSpec()  # Where
    effects: EffectSpecs = {}  # What disturbs the sensor; in the file a list, here by name
    explore: dict[str, Any] = {}  # Parameters of the planner
    seed: Seed = 0  # Seed of all that is random


@readable
@dataclass(frozen=True, slots=True)
class Scene:
    """A checked scene."""

    name: str  # The file's name without its suffix; what cannot be seen in it is ``_``
    path: Path  # The file
    text: str  # The file's text
    spec: SceneSpec  # What it holds, with defaults filled in and the mesh read
    located: SourceMapped  # The same as plain values, with file and line
    size: tuple[float, float, float]  # Extents of the object along x, y and z, to 0.1 mm or so, m
    # Files that it names, by their places in the folder of a run; there `text` finds them.
    inputs: Mapping[str, Path] = field(default_factory=dict)
    told: str = ""  # A sentence on what was guessed and mended of its mesh; empty if nothing was


def load_scene(
    name: str | Path,
    changes: Mapping[KeyPath, SourceMapped] = {},
    *,
    untrusted: bool = False,
) -> Scene:
    """The scene in a YAML file, given by its path, or one that comes with palpate, by name.

    A mesh file is a scene in which nothing but its solid stands.
    `changes` are values in place of the file's, by their paths; of an effect it is that of its
    parameters, ``effects.gaussian_noise.sigma``. A scene below the current folder or that of the
    user may name any file; one from elsewhere, or an `untrusted` one, only those below its own
    folder, and an untrusted one no program. Raises InputError, which names file, line, key, value
    and what would be right.
    """
    path = find_scene(name)
    search_inputs(path.parent)
    is_mesh = is_mesh_file(path)
    own_name = plain_name(path.name)
    alone = SourceMapped({"object": {"mesh": {"file": own_name}}}, str(path))
    given = alone if is_mesh else read_yaml(path)
    for key, value in changes.items():
        given = _changed(given, key, value)
    if untrusted:
        _refuse_programs(given)
    folder = path.resolve().parent
    own = not untrusted and any(map(folder.is_relative_to, (Path.cwd(), Path.home())))
    named = _named_files(given, folder, confined=not (own or is_mesh))
    if is_mesh and MESH in named and given.part(MESH).value == own_name:
        named[MESH] = path.resolve()  # whatever it is called
    inputs = {f"{INPUTS}/{plain_name(one.name)}": one for one in named.values()}
    text = path.read_text(encoding="utf-8") if not is_mesh else ""
    if changes or inputs:
        text = yaml_text(_moved_files(given, named).value)
    given, told = _with_mesh(given, path, named)
    given = with_effects(_with_planner(given))
    given = with_calibration(given, named.get(CALIBRATION))
    check_planner(given)
    spec = convert(given, SceneSpec)
    if spec.world.reach is None:
        reach = fitted_reach(spec.object)
        spec = structs.replace(spec, world=structs.replace(spec.world, reach=reach))
    located = SourceMapped(to_builtins(spec, builtin_types=(bytes,)), given.source, given.places)
    _check_finger(spec, located)
    size = _check_reach(spec, located)
    name = plain_name(path.stem)
    return Scene(name, path, text, spec, located, size, inputs, told)


def _refuse_programs(given: SourceMapped) -> None:
    """InputError if a scene names a module, which is a program."""
    listed, explore = given.value.get("effects"), given.value.get("explore")
    named: dict[KeyPath, Any] = {}
    if isinstance(listed, list):
        named = {("effects", i): one for i, one in enumerate(listed)}
    if isinstance(explore, dict):
        named["explore", "planner"] = explore.get("planner")
    for key, one in named.items():
        name = next(iter(one), "") if isinstance(one, dict) else one
        if isinstance(name, str) and ":" in name:
            raise given.error(key, f"{name!r} is a program, which an untrusted scene may not name")


def _named_files(given: SourceMapped, folder: Path, *, confined: bool) -> dict[KeyPath, Path]:
    """The files that a scene names, by the keys that hold their names."""
    found: dict[KeyPath, Path] = {}
    keys: tuple[KeyPath, ...] = (MESH, CALIBRATION)
    for key in keys:
        name = None
        with suppress(KeyError, TypeError):
            name = given.part(key).value
        if name is None:
            continue
        what = path_text(key)
        if not isinstance(name, str):
            raise given.error(key, f"{what} must be the name of a file")
        try:
            found[key] = file_within(folder, name, what, confined=confined)
        except ValueError as error:
            raise given.error(key, str(error)) from None
    return found


def _moved_files(given: SourceMapped, named: Mapping[KeyPath, Path]) -> SourceMapped:
    """The scene as it stands in the folder of a run, with the files that it names."""
    for key, path in named.items():
        place = SourceMapped(f"{INPUTS}/{plain_name(path.name)}", "")
        given = replace(given, value=set_within(given.value, key, place))
    return given


def _changed(given: SourceMapped, path: KeyPath, value: SourceMapped) -> SourceMapped:
    """The document with another value at a path; an effect that is not listed is added."""
    listed = given.value.get("effects") or []
    if path[0] == "effects" and isinstance(path[-1], str) and len(path) > 1:
        names = [next(iter(one)) if isinstance(one, Mapping) and one else one for one in listed]
        at = names.index(path[1]) if path[1] in names else len(names)
        kept = {} if at == len(names) or isinstance(listed[at], str) else listed[at]
        effects = [*listed[:at], kept or {path[1]: {}}, *listed[at + 1 :]]
        given = replace(given, value={**given.value, "effects": effects})
        path = ("effects", at, *path[1:])
    places = {path[:end]: value.source for end in range(1, len(path))}
    places |= {(*path, *inner): place for inner, place in value.places.items()}
    changed = set_within(given.value, path, value, "the scene")
    return SourceMapped(changed, given.source, {**places, **given.places, path: value.source})


def with_effects(given: SourceMapped) -> SourceMapped:
    """The scene with its list of effects made into a map from name to parameters.

    An entry is a name, or a map from the name to the parameters. A user's own effect is named
    ``module:Class``; the module is looked for in the current folder as well. Raises InputError if
    the list is none, an effect is unknown or listed twice, or a parameter is unknown, of the wrong
    type, or out of its range.
    """
    listed = given.value.get("effects")
    if listed is None:  # the key is not there, or nothing stands behind it
        kept = {key: value for key, value in given.value.items() if key != "effects"}
        return replace(given, value=kept)
    if not isinstance(listed, list):
        raise given.error(("effects",), "effects must be a list: - gaussian_noise: {sigma: 1e-5}")
    effects: dict[str, Any] = {}
    kinds: dict[type, str] = {}
    places = dict(given.places)
    for i, entry in enumerate(listed):
        name, parameters = _listed_effect(given, i, entry)
        if name in effects:
            raise given.error(("effects", i), f"effects lists {name!r} twice; list it once")
        where: KeyPath = ("effects", i, name) if isinstance(entry, Mapping) else ("effects", i)
        part = replace(given.part(where), value=parameters)
        kind = _checked_effect(part, name)
        if kind in kinds:
            raise given.error(("effects", i), f"{name!r} and {kinds[kind]!r} are the same effect")
        kinds[kind] = name
        effects[name] = parameters
        places.update({("effects", name, *key): at for key, at in part.places.items()})
        places["effects", name] = part.source
    return replace(given, value={**given.value, "effects": effects}, places=places)


def _listed_effect(given: SourceMapped, i: int, entry: Any) -> tuple[str, dict[str, Any]]:
    if isinstance(entry, str):
        return entry, {}
    if isinstance(entry, Mapping) and len(entry) == 1:
        name, parameters = next(iter(entry.items()))
        if isinstance(name, str) and (parameters is None or isinstance(parameters, Mapping)):
            return name, dict(parameters or {})
    raise given.error(
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
    given: SourceMapped, scene: Path, named: Mapping[KeyPath, Path]
) -> tuple[SourceMapped, str]:
    """The scene with the mesh that it names read into it, and what is to be told of that.

    A mesh without a pose that stands beside the axis is set on it.
    """
    try:
        part = given.part(("object", "mesh"))
    except (KeyError, TypeError):
        return given, ""
    mesh = convert(part, MeshFile, "object.mesh")
    path = named[MESH]
    try:
        vertices, faces, told = read_mesh(path, mesh.unit, mesh.up, mesh.size)
    except ValueError as error:
        if is_mesh_file(scene):  # the sentence names it already
            raise
        raise part.error(("file",), str(error)) from None
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if "pose" not in given.value["object"] and ((low > 0.0) | (high < 0.0))[:2].any():
        shift = 0.0 - np.array([*0.5 * (low + high)[:2], low[2]])
        vertices = vertices + shift
        way = ", ".join(f"{1e3 * x:.4g}" for x in shift)
        told = f"{told}; moved" if told else f"{path.name}: moved"
        told += f" by {way} mm, from beside the axis onto it"
    data = to_builtins(encode_mesh(vertices, faces), builtin_types=(bytes,))
    kept = {**given.value["object"], "mesh": data}
    return replace(given, value={**given.value, "object": kept}), told


def _with_planner(given: SourceMapped) -> SourceMapped:
    """The scene with a planner: slices of a mesh may be no simple curves, as those of a torus."""
    explore, standing = given.value.get("explore", {}), given.value.get("object")
    if not isinstance(explore, Mapping) or {"planner", "settings", "axis"} & set(explore):
        return given
    if not isinstance(standing, Mapping) or not {"mesh", "torus"} & set(standing):
        return given
    return replace(given, value={**given.value, "explore": {**explore, "planner": "touches"}})


def with_calibration(given: SourceMapped, path: Path | None) -> SourceMapped:
    """The scene with the calibration file that its sensor names read into it, if there is one.

    Raises InputError if the file cannot be used.
    """
    if path is None:
        return given
    found = SourceMapped(to_builtins(read_calibration(path)), "")
    return replace(given, value=set_within(given.value, CALIBRATION, found))


def read_calibration(path: Path) -> CalibrationSpec:
    """The calibration in a file; InputError names file, line, key and value."""
    found = convert(read_yaml(path, MAX_CALIBRATION_VALUES), CalibrationFile, "calibration")
    names = CalibrationSpec.__struct_fields__
    return CalibrationSpec(**{name: getattr(found, name) for name in names})


def check_planner(given: SourceMapped) -> Planner | None:
    """Make the planner that a scene describes, ``explore: {planner: NAME, settings: {...}}``.

    A user's own is named ``module:Class``; the module is looked for in the current folder as well.
    None if the scene names neither. Raises InputError if there is no such planner, or a setting is
    unknown, of the wrong type, or out of its range.
    """
    explore = given.value.get("explore")
    if not isinstance(explore, Mapping) or not {"planner", "settings"} & set(explore):
        return None
    name, path = explore.get("planner", PLANNER_NAMES[0]), ("explore", "planner")
    if not isinstance(name, str):
        raise given.error(
            path, f"explore.planner is {name!r}; it must be a name, as {PLANNER_NAMES[0]}"
        )
    search_current_folder(name)
    try:
        kind = planner_type(name)
    except LookupError:
        known = hint(name, PLANNER_NAMES)
        raise given.error(path, f"there is no planner {name!r}; {known}") from None
    except ValueError as error:
        raise given.error(path, str(error)) from None
    return convert(_planner_settings(given, explore), kind, "explore.settings")


def _planner_settings(given: SourceMapped, explore: Mapping[str, object]) -> SourceMapped:
    """What stands behind ``settings``; nothing is no settings."""
    path = ("explore", "settings")
    if (settings := explore.get("settings")) is None:
        return SourceMapped({}, given.place(path))
    if not isinstance(settings, Mapping):
        raise given.error(path, f"explore.settings is {settings!r}; it must be a map of numbers")
    return given.part(path)


def _check_finger(spec: SceneSpec, located: SourceMapped) -> None:
    try:
        build_pipeline(spec.sensor, spec.effects, ROBOT_PRESETS[spec.world.robot])
    except ValueError as error:
        name = str(error).partition(" ")[0]
        where = ("effects", name) if name in spec.effects else ("effects",)
        raise located.error(where, str(error)) from None


def _check_reach(spec: SceneSpec, located: SourceMapped) -> tuple[float, float, float]:
    size, aside = object_extents(spec.object)
    least = LEAST_TOUCHED if spec.explore.get("planner") == "touches" else LEAST_SLICED
    if min(size) < least:
        raise located.error(
            ("object",),
            f"the object is only {min(size):.3g} m across; a pad of 15 mm can follow nothing "
            f"smaller than {least} m",
        )
    height, reach = size[2], spec.world.reach
    if reach is not None and max(aside, height) > reach:
        raise located.error(
            ("object",),
            f"the object reaches {aside:.3g} m sideways and is {height:.3g} m high, but the "
            f"finger reaches {reach:g} m; enlarge world.reach or leave it out, or move or shrink "
            "the object",
        )
    return size


def shipped_scenes() -> tuple[str, ...]:
    """Names of the scenes that come with palpate."""
    return tuple(sorted(path.stem for path in SHIPPED_SCENES.glob("*.yaml")))


def find_scene(scene: str | Path) -> Path:
    """Path of a scene given by name or path.

    Raises InputError if there is no such file and no shipped scene of this name.
    """
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
    """A calibration with its standard errors; nothing reads these but people."""

    errors: dict[str, Any] = msgspec.field(default_factory=dict)  # By the names of the fields


def write_calibration(path: Path, estimate: CalibrationEstimate, pad: Pad) -> None:
    """Write a calibration whole, or not at all.

    Raises InputError if the file is there already, or cannot be written.
    """

    def told(name: str) -> Any:
        value = getattr(estimate, name)
        if not isinstance(value, np.ndarray):
            return _rounded(value)
        rows = value.reshape(pad.rows, pad.cols).tolist()
        return [[_rounded(x) if math.isfinite(x) else None for x in row] for row in rows]

    document = {name: told(name) for name in ("sound_speed", "noise", "gain", "offset")}
    errors = {name: told(f"{name}_error") for name in ("sound_speed", "gain", "offset")}
    document["errors"] = errors
    text = io.StringIO()
    text.write("# Written by palpate calibrate. Gains: 0 is a taxel not to be trusted.\n")
    yaml = YAML(pure=True)
    yaml.default_flow_style = None
    yaml.width = 1000
    yaml.dump(document, text)
    write_new(path, lambda part: part.write_text(text.getvalue(), encoding="utf-8"))


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
