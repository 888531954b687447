"""A scene: the object, the sensor and the world to explore, from a YAML file.

Loading checks everything that can be wrong with it; a scene that loads can be explored.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct, to_builtins

from palpate.core.measure.robot_time import PRESETS
from palpate.launch.calibration_file import with_calibration
from palpate.launch.convert import convert
from palpate.launch.located import InputError, Located
from palpate.launch.mesh_file import MeshFile, read_mesh
from palpate.launch.nearest import hint
from palpate.launch.own_folder import file_in
from palpate.launch.scene_effects import with_effects
from palpate.launch.scene_planner import check_planner
from palpate.launch.yaml_file import read_yaml
from palpate.nodes.effects import EffectSpecs, build_pipeline
from palpate.nodes.object import ObjectSpec, Seed, build_shape, encode_mesh
from palpate.nodes.sensor import SensorSpec

LEAST_EXTENT = 5.0e-3
"""Smallest extent of an object, m."""
CHECK_LEVEL = 4
"""5k faces: enough to tell how far an object reaches."""
SHIPPED = Path(__file__).parent / "scenes"
"""Folder of the scenes that come with palpate."""


class WorldSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a robot knows before it touches anything."""

    reach: Annotated[float, Meta(gt=0, le=10)] = 0.15
    """The finger reaches this far sideways from the axis and up from the
    platform on which the object stands, m."""
    robot: str = "modern"
    """Preset of the robot's speeds: modern or puma."""

    def __post_init__(self) -> None:
        if self.robot not in PRESETS:
            raise ValueError(f"robot must be one of {sorted(PRESETS)}, got {self.robot!r}")


class SceneSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that a scene file may say."""

    object: ObjectSpec
    """What stands there."""
    sensor: SensorSpec = SensorSpec()
    """What feels it."""
    world: WorldSpec = WorldSpec()
    """Where."""
    effects: EffectSpecs = {}
    """What disturbs the sensor; in the file a list, here by name."""
    explore: dict[str, Any] = {}
    """Parameters of the planner."""
    seed: Seed = 0
    """Seed of all that is random."""


@dataclass(frozen=True, slots=True)
class Scene:
    """A checked scene."""

    name: str
    """The file's name without its suffix."""
    path: Path
    """The file."""
    text: str
    """The file's text."""
    spec: SceneSpec
    """What it says, with defaults filled in and the mesh read."""
    located: Located
    """The same as plain values, with file and line."""
    size: tuple[float, float, float]
    """Extents of the object along x, y and z, to 0.1 mm or so, m."""


def load_scene(name: str | Path) -> Scene:
    """The scene in a file, or one that comes with palpate.

    Parameters
    ----------
    name : str or Path
        Path of a YAML file, or the name of a shipped scene.

    Raises
    ------
    InputError
        If the file cannot be used; the sentence names file, line, key, value and what would
        be right.
    """
    path = find_scene(name)
    given = read_yaml(path)
    given = with_effects(_with_mesh(given, path))
    given = with_calibration(given, path.resolve().parent)
    check_planner(given)
    spec = convert(given, SceneSpec)
    located = Located(to_builtins(spec, builtin_types=(bytes,)), given.source, given.places)
    _check_finger(spec, located)
    size = _check_reach(spec, located)
    return Scene(path.stem, path, path.read_text(encoding="utf-8"), spec, located, size)


def shipped_scenes() -> tuple[str, ...]:
    """Names of the scenes that come with palpate."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.yaml")))


def find_scene(scene: str | Path) -> Path:
    """Path of a scene given by name or path.

    Raises
    ------
    InputError
        If there is no such file and no shipped scene of this name.
    """
    path = Path(scene)
    if path.is_file():
        return path
    known = shipped_scenes()
    if str(scene) in known:
        return SHIPPED / f"{scene}.yaml"
    if len(path.parts) > 1 or path.suffix:
        kind = "is a folder" if path.is_dir() else "does not exist"
        raise InputError(f"{path}: the scene {kind}; a scene is a YAML file")
    raise InputError(f"there is no scene {str(scene)!r}; {hint(str(scene), known)}")


def scene_title(name: str) -> str:
    """The first comment of a shipped scene."""
    first = (SHIPPED / f"{name}.yaml").read_text(encoding="utf-8").partition("\n")[0]
    return first.removeprefix("#").strip()


def _check_finger(spec: SceneSpec, located: Located) -> None:
    """Each effect must be one that this sensor can have."""
    try:
        build_pipeline(spec.sensor, spec.effects, PRESETS[spec.world.robot])
    except ValueError as error:
        name = str(error).partition(" ")[0]
        where = ("effects", name) if name in spec.effects else ("effects",)
        raise located.error(where, str(error)) from None


def _with_mesh(given: Located, scene: Path) -> Located:
    """The scene with its mesh file read into it."""
    try:
        part = given.part(("object", "mesh"))
    except (KeyError, TypeError):
        return given
    mesh = convert(part, MeshFile, "object.mesh")
    folder = scene.resolve().parent
    try:
        path = file_in(folder, mesh.file, "object.mesh.file")
        data = encode_mesh(*read_mesh(path, mesh.unit))
    except ValueError as error:
        raise part.error(("file",), str(error)) from None
    value = {
        **given.value,
        "object": {**given.value["object"], "mesh": to_builtins(data, builtin_types=(bytes,))},
    }
    return Located(value, given.source, given.places)


def _check_reach(spec: SceneSpec, located: Located) -> tuple[float, float, float]:
    """The object must be large enough to feel and lie within the finger's reach; its extents."""
    vertices = build_shape(spec.object).mesh(CHECK_LEVEL).vertices
    extents = np.ptp(vertices, axis=0)
    if extents.min() < LEAST_EXTENT:
        raise located.error(
            ("object",),
            f"the object is only {extents.min():.3g} m across; a pad of 15 mm can follow nothing "
            f"smaller than {LEAST_EXTENT} m",
        )
    aside, height = float(np.linalg.norm(vertices[:, :2], axis=1).max()), float(extents[2])
    reach = spec.world.reach
    if max(aside, height) > reach:
        raise located.error(
            ("object",),
            f"the object reaches {aside:.3g} m sideways and is {height:.3g} m high, but the "
            f"finger reaches {reach:g} m; enlarge world.reach, or move or shrink the object",
        )
    x, y, z = extents.tolist()
    return (x, y, z)
