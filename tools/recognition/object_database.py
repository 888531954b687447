"""The objects that palpate recognises: a YAML file of them, and what is learned of each.

Each object stands in the file as in a scene, with a title. Learned numbers stand beside it, in
``NAME_learned.yaml``, with a fingerprint of the objects that they are of: whoever changes an object
learns again, which takes some seconds an object and gives the same numbers each time.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta, Struct, to_builtins

from palpate.core import recognition
from palpate.launch.files.file_access import file_within, write_atomically
from palpate.launch.files.mesh_file import MeshFile, read_mesh
from palpate.launch.files.source_map import InputError, SourceMapped
from palpate.launch.files.yaml_file import convert, read_yaml
from palpate.nodes.specs.objects import ObjectSpec, build_shape, encode_mesh

OBJECTS = Path(__file__).parent / "objects.yaml"  # The objects that come with palpate
MAX_DATABASE_VALUES = 40_000  # Some hundred objects, or what is learned of as many
LEVELS = (4, 5)  # Of the meshes that copies are taken of, in turns
COPIES = 12  # Of each object
DIGITS = 5  # Significant digits of what is learned
Values = str  # Numbers between blanks: one value for YAML, which takes 30 us for each


class ObjectEntry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One object of the file."""

    title: Annotated[str, Meta(min_length=1, max_length=100)]  # What people call it
    object: ObjectSpec  # As in a scene


class ObjectDatabase(NamedTuple):
    """Objects by their names."""

    path: Path
    entries: Mapping[str, ObjectEntry]

    def fingerprint(self) -> str:
        """SHA-256 of the objects, and of which features are learned of them."""
        told = [one.name for one in recognition.FEATURES], _given(to_builtins(dict(self.entries)))
        return hashlib.sha256(msgspec.json.encode(told)).hexdigest()


def _given(told: Any) -> Any:
    """A description without the keys that it leaves open: kinds that come later change nothing."""
    if isinstance(told, dict):
        return {key: _given(value) for key, value in told.items() if value is not None}
    return [_given(value) for value in told] if isinstance(told, list | tuple) else told


def load_objects(path: Path = OBJECTS) -> ObjectDatabase:
    """The objects in a file; InputError names file, line, key and value."""
    given = read_yaml(path, MAX_DATABASE_VALUES)
    unknown = [key for key in given.value if key != "objects"]
    if unknown or not isinstance(given.value.get("objects"), dict):
        where = (unknown[0],) if unknown else ()
        raise given.error(where, "must be a map named objects, from names to title and object")
    entries = {}
    for name in given.value["objects"]:
        if name == recognition.NONE:
            raise given.error(("objects", name), f"no object can be named {name!r}")
        part = _with_mesh(given.part(("objects", name)), path, name)
        entries[name] = convert(part, ObjectEntry, f"objects.{name}")
    if not entries:
        raise given.error(("objects",), "objects must hold at least one object")
    return ObjectDatabase(path, entries)


def _with_mesh(given: SourceMapped, path: Path, name: str) -> SourceMapped:
    """An object's description with the mesh file that it names read into it."""
    try:
        part = given.part(("object", "mesh"))
    except (KeyError, TypeError):
        return given
    where = f"objects.{name}.object.mesh"
    mesh = convert(part, MeshFile, where)
    try:
        file = file_within(path.resolve().parent, mesh.file, f"{where}.file")
        vertices, faces, _ = read_mesh(file, mesh.unit, mesh.up, mesh.size)
    except ValueError as error:
        raise part.error(("file",), str(error)) from None
    data = to_builtins(encode_mesh(vertices, faces), builtin_types=(bytes,))
    kept = {**given.value["object"], "mesh": data}
    return SourceMapped({**given.value, "object": kept}, given.source, given.places)


class LearnedObject(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How one object's features are distributed."""

    means: Values
    deviations: Values
    slopes: Values


class LearnedFile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is learned of all objects of a file."""

    fingerprint: str  # Of the objects
    scale: Annotated[float, Meta(gt=0)]
    freedom: Annotated[float, Meta(gt=0)]
    correlation: tuple[Values, ...]  # Rows of the lower triangle
    objects: dict[str, LearnedObject]


def learned_path(path: Path) -> Path:
    """Where what is learned of the objects in a file is kept."""
    return path.with_name(f"{path.stem}_learned.yaml")


def load_models(database: ObjectDatabase) -> recognition.ObjectModels | None:
    """What was learned of the objects; None if nothing was, or of other objects."""
    path = learned_path(database.path)
    if not path.is_file():
        return None
    found = convert(read_yaml(path, MAX_DATABASE_VALUES), LearnedFile)
    if found.fingerprint != database.fingerprint():
        return None
    names, count = tuple(database.entries), len(recognition.FEATURES)
    try:
        rows = [found.objects[name] for name in names]
        means, deviations, slopes = (
            np.array([getattr(row, key).split() for row in rows], np.float64)
            for key in LearnedObject.__struct_fields__
        )
        correlation = np.zeros((count, count))
        correlation[np.tril_indices(count)] = " ".join(found.correlation).split()
        np.stack([means, deviations, slopes]).reshape(3, len(names), count)
    except (KeyError, ValueError):
        raise InputError(f"{path}: is damaged; remove it, and it is learned again") from None
    correlation = correlation + np.tril(correlation, -1).T
    fit = found.scale, found.freedom
    return recognition.ObjectModels(names, means, deviations, correlation, slopes, *fit)


def learn_models(
    database: ObjectDatabase, say: Callable[[str], object] = lambda name: None
) -> recognition.ObjectModels:
    """Learn how the features of all objects are distributed; `say` is told each one's name."""
    scatters = {}
    for name in database.entries:
        say(name)
        scatters[name] = learn_object(database, name)
    return recognition.object_models(scatters)


def learn_object(database: ObjectDatabase, name: str) -> recognition.Scatter:
    """The features of an object's copies; the same numbers each time."""
    shape = build_shape(database.entries[name].object)
    meshes = [shape.mesh(level) for level in LEVELS]
    return recognition.learn_scatter(meshes, COPIES, seed=sum(map(ord, name)))


def write_models(database: ObjectDatabase, models: recognition.ObjectModels) -> Path:
    """Write what was learned beside the objects, whole or not at all; returns where."""
    lines = [
        "# Learned of the objects; remove this file to learn again.",
        f"fingerprint: {database.fingerprint()}",
        f"scale: {models.scale:.{DIGITS}g}",
        f"freedom: {models.freedom:.{DIGITS}g}",
        "correlation:",
        *(f"  - '{_row(one[: i + 1])}'" for i, one in enumerate(models.correlation)),
        "objects:",
    ]
    for i, name in enumerate(models.names):
        keys = LearnedObject.__struct_fields__
        lines += [f"  {name}:", *(f"    {key}: {_row(getattr(models, key)[i])}" for key in keys)]
    path = learned_path(database.path)
    text = "\n".join(lines) + "\n"
    write_atomically({path: lambda part: part.write_text(text, encoding="utf-8")})
    return path


def _row(values: Any) -> str:
    return " ".join(f"{float(value):.{DIGITS}g}" for value in values)
