"""The objects that palpate recognises: a YAML file of objects, and the learned models of them.

The file describes each object as in a scene, with a title. Learned numbers are kept in
``NAME_learned.yaml`` beside it, with a fingerprint of the objects. If an object is changed, all are
learned again, which takes some seconds for each object and gives the same numbers each time.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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

OBJECTS = Path(__file__).parent / "objects.yaml"  # the objects of palpate
MAX_DATABASE_VALUES = 40_000  # in a file: of about a hundred objects, or their learned models
Values = str  # numbers separated by blanks: one value for YAML, which takes 30 us for each


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningSettings:
    """Copies of an object from which the distribution of its features is learned."""

    levels: tuple[int, ...] = (4, 5)  # of subdivision of the meshes of copies, in turns
    n_copies: int = 12  # of each object


DEFAULT_LEARNING = LearningSettings()


class ObjectEntry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One object of the file."""

    title: Annotated[str, Meta(min_length=1, max_length=100)]  # for people
    object: ObjectSpec  # as in a scene


class ObjectDatabase(NamedTuple):
    """Objects by their names."""

    path: Path
    entries: Mapping[str, ObjectEntry]

    def fingerprint(self) -> str:
        """SHA-256 of the objects and of the names of the features."""
        names = [feature.name for feature in recognition.FEATURES]
        described = names, _stated(to_builtins(dict(self.entries)))
        return hashlib.sha256(msgspec.json.encode(described)).hexdigest()


def _stated(description: Any) -> Any:
    """A description without keys of None, so that later kinds of objects change no fingerprint."""
    if isinstance(description, dict):
        return {key: _stated(value) for key, value in description.items() if value is not None}
    if isinstance(description, list | tuple):
        return [*map(_stated, description)]
    return description


def load_objects(path: Path = OBJECTS) -> ObjectDatabase:
    """The objects in a file; raises InputError with file, line, key and value."""
    source = read_yaml(path, MAX_DATABASE_VALUES)
    unknown = [key for key in source.value if key != "objects"]
    if unknown or not isinstance(source.value.get("objects"), dict):
        where = (unknown[0],) if unknown else ()
        raise source.error(where, "must be a map named objects, from names to title and object")
    entries = {}
    for name in source.value["objects"]:
        if name == recognition.NONE:
            raise source.error(("objects", name), f"no object can be named {name!r}")
        part = _with_mesh(source.part(("objects", name)), path, name)
        entries[name] = convert(part, ObjectEntry, f"objects.{name}")
    if not entries:
        raise source.error(("objects",), "objects must hold at least one object")
    return ObjectDatabase(path, entries)


def _with_mesh(described: SourceMapped, path: Path, name: str) -> SourceMapped:
    """The description of an object, with the contents of its mesh file."""
    try:
        part = described.part(("object", "mesh"))
    except (KeyError, TypeError):
        return described
    where = f"objects.{name}.object.mesh"
    mesh = convert(part, MeshFile, where)
    try:
        file = file_within(path.resolve().parent, mesh.file, f"{where}.file")
        vertices, faces, _ = read_mesh(file, mesh.unit, mesh.up, mesh.size)
    except ValueError as error:
        raise part.error(("file",), str(error)) from None
    data = to_builtins(encode_mesh(vertices, faces), builtin_types=(bytes,))
    kept = {**described.value["object"], "mesh": data}
    return SourceMapped({**described.value, "object": kept}, described.source, described.places)


class LearnedObject(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Distribution of the features of an object."""

    means: Values  # of the features over copies
    deviations: Values  # standard deviations of the features over copies
    slopes: Values  # derivatives of the features by an offset of the surface [1/m]


class LearnedFile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Learned models of all objects of a file."""

    fingerprint: str  # of the objects
    scale: Annotated[float, Meta(gt=0)]  # of a squared distance, in units of chi-square
    freedom: Annotated[float, Meta(gt=0)]  # degrees of freedom of that chi-square
    correlation: tuple[Values, ...]  # of the features: rows of the lower triangle
    objects: dict[str, LearnedObject]


def learned_path(path: Path) -> Path:
    """Path of the learned models of the objects in a file."""
    return path.with_name(f"{path.stem}_learned.yaml")


def load_models(database: ObjectDatabase) -> recognition.ObjectModels | None:
    """Learned models of the objects; None if there are none, or they are of other objects."""
    path = learned_path(database.path)
    if not path.is_file():
        return None
    learned = convert(read_yaml(path, MAX_DATABASE_VALUES), LearnedFile)
    if learned.fingerprint != database.fingerprint():
        return None
    names, count = tuple(database.entries), len(recognition.FEATURES)
    try:
        rows = [learned.objects[name] for name in names]
        means, deviations, slopes = (
            np.array([getattr(row, key).split() for row in rows], np.float64)
            for key in LearnedObject.__struct_fields__
        )
        correlation = np.zeros((count, count))
        correlation[np.tril_indices(count)] = " ".join(learned.correlation).split()
        np.stack([means, deviations, slopes]).reshape(3, len(names), count)
    except (KeyError, ValueError):
        raise InputError(f"{path}: is damaged; remove it, and it is learned again") from None
    correlation = correlation + np.tril(correlation, -1).T
    fit = learned.scale, learned.freedom
    return recognition.ObjectModels(names, means, deviations, correlation, slopes, *fit)


def learn_models(
    database: ObjectDatabase,
    say: Callable[[str], object] = lambda name: None,
    settings: LearningSettings = DEFAULT_LEARNING,
) -> recognition.ObjectModels:
    """Learn the distribution of the features of all objects; `say` is called with each name."""
    scatters = {}
    for name in database.entries:
        say(name)
        scatters[name] = learn_object(database, name, settings)
    return recognition.object_models(scatters)


def learn_object(
    database: ObjectDatabase, name: str, settings: LearningSettings = DEFAULT_LEARNING
) -> recognition.Scatter:
    """Features of copies of an object; the same numbers each time."""
    shape = build_shape(database.entries[name].object)
    meshes = [shape.mesh(level) for level in settings.levels]
    return recognition.learn_scatter(meshes, settings.n_copies, seed=sum(map(ord, name)))


def write_models(
    database: ObjectDatabase, models: recognition.ObjectModels, digits: int = 5
) -> Path:
    """Write learned models beside the objects, with significant digits; returns the path."""
    lines = [
        "# Learned of the objects; remove this file to learn again.",
        f"fingerprint: {database.fingerprint()}",
        f"scale: {models.scale:.{digits}g}",
        f"freedom: {models.freedom:.{digits}g}",
        "correlation:",
        *(f"  - '{_row(row[: i + 1], digits)}'" for i, row in enumerate(models.correlation)),
        "objects:",
    ]
    for i, name in enumerate(models.names):
        rows = ((key, getattr(models, key)[i]) for key in LearnedObject.__struct_fields__)
        lines += [f"  {name}:", *(f"    {key}: {_row(row, digits)}" for key, row in rows)]
    path = learned_path(database.path)
    text = "\n".join(lines) + "\n"
    write_atomically({path: lambda part: part.write_text(text, encoding="utf-8")})
    return path


def _row(values: Any, digits: int) -> str:
    return " ".join(f"{float(value):.{digits}g}" for value in values)
