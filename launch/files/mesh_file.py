"""Mesh files: untrusted ones are read and checked completely; others are written for programs.

palpate has its own readers, because on 400 damaged meshes trimesh took over 10 s twice and 161 MB
for a file of 1 MB, and raised RecursionError. STL and 3MF are written in mm, GLB in m with y up,
all others in m, from arrays of single precision. palpate has its own writers, because trimesh takes
longer to import than fitting a final model takes.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from palpate.core.archive import arrays_from_bytes
from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.core.shapes import Mesh, MeshFault, mend_mesh, wrap_mesh
from palpate.launch.files import glb, mesh_formats
from palpate.launch.files.file_access import read_bounded
from palpate.launch.files.ply import read_ply
from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.launch.files.units import METRES_PER_UNIT, OWN_UNITS, guess_unit
from palpate.messages.types import ShapeModel

MAX_MESH_BYTES = 64 << 20  # of a file
MAX_FACES = mesh_formats.MAX_TRIANGLES
MIN_EXTENT = 1e-4  # of an object along x, y and z [m]
MAX_EXTENT = 10.0  # the same [m]
# Readers by format.
READERS: Mapping[str, Callable[[bytes], mesh_formats.RawMesh]] = {
    "ply": read_ply,
    "stl": mesh_formats.read_stl,
    "obj": mesh_formats.read_obj,
    "off": mesh_formats.read_off,
    "glb": glb.read_glb,
}
Vertices = NDArray[np.float64]
Faces = NDArray[np.int32]
MESH_FILES = ("mesh.ply", "mesh.stl", "mesh.glb")  # names of the surface's files
MODEL_FILE = "model.npz"  # name of the file with all fields of a model
ARCHIVE_FIELD = "archive"  # field of a model that is unpacked in its file
# STL has no unit: programs that slice it for printing assume mm, which is the default of 3MF.
MILLIMETRES_PER_METRE = 1000.0
# Rotation from z up, as in palpate, to y up, as glTF requires.
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
# Units of the formats that are written.
MESH_UNITS: Mapping[str, str] = {
    **{".ply": "m", ".stl": "mm", ".glb": "m, y up", ".obj": "m", ".3mf": "mm"}
}
_PLY_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


class MeshFile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A mesh file in a scene."""

    file: str  # path, relative to the scene's folder
    # Unit of the file's coordinates, which the file does not state; guessed if only one is likely.
    unit: Literal["m", "cm", "mm", "um", "in", "ft"] | None = None
    up: Literal["z", "-z", "y", "-y", "x", "-x"] = "z"  # axis of the file that points up
    # Largest extent of the object in place of a unit [m].
    size: Annotated[float, Meta(ge=MIN_EXTENT, le=MAX_EXTENT, description="m")] | None = None

    def __post_init__(self) -> None:
        if self.unit is not None and self.size is not None:
            raise ValueError("unit and size exclude each other: both set the size of the object")


def is_mesh_file(path: Path) -> bool:
    """Whether a file is a mesh by its suffix."""
    return path.suffix.lower().lstrip(".") in READERS


def read_mesh(
    path: Path, unit: str | None = None, up: str = "z", size: float | None = None
) -> tuple[Vertices, Faces, str]:
    """The solid in a PLY, STL, OBJ, OFF or GLB file of at most 64 MiB.

    `up`: axis of the file that points up. `size`: largest extent of the solid in place of a unit
    [m]. The solid may be of any genus. Small faults are mended (`palpate.shapes.mend_mesh`); of a
    surface that bounds no solid, the outside is taken (`palpate.shapes.wrap_mesh`). Returns
    distinct vertices (n, 3) [m], triangles (m, 3), counter-clockwise seen from outside, and a
    sentence on what was guessed and mended. Raises InputError if the file cannot be read, is not
    one solid of suitable size, or might be in several units.
    """
    vertices, faces, read_notes = _read_whole(path)
    notes = list(read_notes)
    sides = _extents(vertices)
    if size is not None:
        scale = size / float(sides.max())
        notes.append(f"scaled by {scale:.4g} to {_millimetres(scale * sides)}")
    else:
        if unit is None:
            unit = _likely_unit(path, float(sides.max()))
            notes.append(f"taken to be in {unit}, {_millimetres(METRES_PER_UNIT[unit] * sides)}")
        scale = METRES_PER_UNIT[unit]
    vertices = _upright(vertices * scale, up)
    _check_size(path, vertices, unit)
    with as_input_errors(path):
        solid, mends = _closed_solid(vertices, faces)
    notes += mends
    return solid.vertices, solid.faces, f"{path.name}: {'; '.join(notes)}" if notes else ""


def _closed_solid(vertices: Vertices, faces: Faces) -> tuple[Mesh, tuple[str, ...]]:
    """The solid that triangles bound, mended or wrapped, and notes on that."""
    try:
        mended = mend_mesh(vertices, faces)
    except MeshFault as error:
        wrapped = wrap_mesh(vertices, faces)
        left = f", {wrapped.n_left_out} loose parts left out" if wrapped.n_left_out else ""
        note = (
            f"{error.fault}: its outside was taken, as rays from far away see it, at "
            f"{1e3 * wrapped.resolution:.2g} mm; its faces lie {1e3 * wrapped.offset:.2g} mm rms "
            f"off that, and {wrapped.closed_share:.1%} of it closes holes{left}"
        )
        return Mesh(wrapped.vertices, wrapped.faces), (note,)
    return Mesh(mended.vertices, mended.faces), mended.mends


def _extents(vertices: Vertices) -> Vertices:
    """Extents along x, y and z, (3,); infinite on overflow."""
    with np.errstate(over="ignore"):
        return np.asarray(np.ptp(vertices, axis=0))


def _millimetres(sides: Vertices) -> str:
    return " x ".join(f"{1e3 * side:.3g}" for side in sides) + " mm"


def _upright(vertices: Vertices, up: str) -> Vertices:
    """Vertices turned by quarter turns so that their axis `up` points up."""
    axis = "xyz".index(up[-1])
    turned = vertices[:, [(axis + 1) % 3, (axis + 2) % 3, axis]]
    return turned * [1.0, -1.0, -1.0] if up.startswith("-") else turned


def _likely_unit(path: Path, extent: float) -> str:
    unit = guess_unit(path.suffix.lower(), extent)
    if unit is None:
        raise InputError(
            f"{path}: measures {extent:.3g}, in a unit that the file does not state and that "
            f"cannot be guessed; give the unit: {', '.join(METRES_PER_UNIT)}; or its size"
        )
    return unit


def _check_size(path: Path, vertices: Vertices, unit: str | None) -> None:
    extents = _extents(vertices)
    if extents.min() < MIN_EXTENT or extents.max() > MAX_EXTENT:
        size = " x ".join(f"{extent:.3g}" for extent in extents)
        raise InputError(
            f"{path}: measures {size} m when {f'read in {unit}' if unit else 'scaled to size'}; "
            "each "
            f"side must be between {MIN_EXTENT:g} and {MAX_EXTENT:g} m; is the unit right?"
        )


def read_surface(path: Path, unit: str | None) -> tuple[Vertices, Faces, str]:
    """The surface in a file, closed or not, of any size; arguments and arrays as of `read_mesh`.

    Without a `unit` the likely one is used, or else the one in which palpate writes. GLB files,
    with y up, are turned to z up. Returns vertices, triangles and the unit. Raises InputError if
    the file cannot be read or has no triangles.
    """
    vertices, faces, _ = _read_whole(path)
    if unit is None:
        kind = path.suffix.lower()
        guessed = guess_unit(kind, float(_extents(vertices).max()))
        unit = guessed or OWN_UNITS.get(kind, "m")
    return vertices * METRES_PER_UNIT[unit], faces, unit


def _read_whole(path: Path) -> tuple[Vertices, Faces, tuple[str, ...]]:
    """The surface in a file's own unit, z up, and notes on what was ignored."""
    mesh = _load(path)
    if not len(mesh.faces) and len(mesh.vertices):
        raise InputError(f"{path}: holds points without triangles")
    vertices, faces = _merged(path, mesh)
    if path.suffix.lower() == ".glb":
        vertices = vertices @ Y_UP
    return vertices, faces, mesh.notes


def _merged(path: Path, mesh: mesh_formats.RawMesh) -> tuple[Vertices, Faces]:
    """The mesh with equal vertices merged, since STL repeats them for each face."""
    vertices, faces = mesh.vertices, mesh.faces
    if len(faces) == 0:
        raise InputError(f"{path}: holds no triangles")
    if len(faces) > MAX_FACES:
        raise InputError(f"{path}: has {len(faces)} triangles; at most {MAX_FACES} are taken")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{path}: a triangle names a vertex that does not exist")
    if not np.isfinite(vertices).all():
        bad = int(np.argmin(np.isfinite(vertices).all(axis=1)))
        raise InputError(f"{path}: vertex {bad} is not finite")
    kept, first = np.unique(vertices, axis=0, return_inverse=True)
    faces = first.reshape(-1)[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    if len(faces) == 0:
        raise InputError(f"{path}: all its triangles are flat: corners of each lie in one place")
    used, numbers = np.unique(faces, return_inverse=True)
    return kept[used], numbers.reshape(-1, 3).astype(np.int32)


def read_cloud(path: Path, unit: str) -> Vertices | None:
    """The points (n, 3) in a file without faces [m]; None if it has faces."""
    mesh = _load(path)
    return None if len(mesh.faces) else mesh.vertices * METRES_PER_UNIT[unit]


def read_oriented_cloud(path: Path) -> tuple[Vertices, Vertices]:
    """The points (n, 3) of a file without faces, and their normals (n, 3), in its own unit.

    Raises InputError if it cannot be read, holds a surface, or the points have no normals.
    """
    mesh = _load(path)
    if len(mesh.faces):
        raise InputError(f"{path}: holds a surface; palpate score measures it")
    if mesh.normals is None:
        raise InputError(f"{path}: has no normals nx, ny, nz; points in no order need them")
    return mesh.vertices, mesh.normals


def _load(path: Path) -> mesh_formats.RawMesh:
    kind = path.suffix.lower().lstrip(".")
    if kind not in READERS:
        known = ", ".join(READERS)
        raise InputError(f"{path}: {kind or 'no suffix'!r} is no mesh format; known: {known}")
    data = read_bounded(path, MAX_MESH_BYTES, "the mesh ")
    if not data:
        raise InputError(f"{path}: the mesh file is empty")
    try:
        return READERS[kind](data)
    except ValueError as error:
        raise InputError(f"{path}: is no mesh in {kind.upper()}: it {error}") from None


def export_model(model: ShapeModel, folder: Path) -> tuple[str, ...]:
    """Write the files of a model into a folder; without a surface, only ``model.npz``.

    The files are ``mesh.ply`` (m, with the uncertainty at each vertex if the model states one),
    ``mesh.stl`` (mm), ``mesh.glb`` (m, y up) and ``model.npz`` (all fields of the model, and the
    solid for `palpate.load`). Their names are returned.
    """
    archived = arrays_from_bytes(model.archive) if len(model.archive) else {}
    np.savez(folder / MODEL_FILE, allow_pickle=False, **_model_arrays(model), **archived)
    if len(model.faces) == 0:
        return (MODEL_FILE,)
    errors = uncertainties(model)
    scalars = {"uncertainty": errors} if errors.any() else {}
    for name in MESH_FILES:
        write_mesh(folder / name, model.vertices, model.faces, **scalars)
    return (*MESH_FILES, MODEL_FILE)


def uncertainties(model: ShapeModel) -> Floats:
    """Standard deviation of a model's surface at each vertex, (n,) [m].

    A general solid states it by vertex, a solid in slices by height; it is 0 if not stated.
    """
    if model.vertex_errors.any():
        return model.vertex_errors
    if not len(model.uncertainty):
        return np.zeros(len(model.vertices))
    heights = Pose.from_array(model.frame).to_local(model.vertices)[:, 2]
    return np.interp(heights, model.uncertainty_height, model.uncertainty)


def _model_arrays(model: ShapeModel) -> dict[str, NDArray[np.generic]]:
    arrays: dict[str, NDArray[np.generic]] = {}
    for field in fields(ShapeModel):
        if field.name == ARCHIVE_FIELD:
            continue
        value = getattr(model, field.name)
        if value is None:
            continue
        if isinstance(value, dict):
            arrays[f"{field.name}_names"] = np.array(list(value), dtype=np.str_)
            arrays[f"{field.name}_values"] = np.array(list(value.values()), dtype=np.float64)
        elif isinstance(value, tuple):
            kind = np.str_ if any(isinstance(item, str) for item in value) else np.int64
            arrays[field.name] = np.array(value, dtype=kind)
        else:
            arrays[field.name] = np.asarray(value)
    return arrays


def mesh_sha256(model: ShapeModel) -> str:
    """Fingerprint of the surface: SHA-256 of its vertices (float64) and faces (int32)."""
    data = model.vertices.astype("<f8").tobytes() + model.faces.astype("<i4").tobytes()
    return hashlib.sha256(data).hexdigest()


def write_mesh(
    path: Path, vertices: Floats, faces: NDArray[np.int32], **scalars: NDArray[np.generic]
) -> None:
    """Write vertices (n, 3), z up [m], and triangles (m, 3), counter-clockwise from outside.

    The suffix is one of `MESH_UNITS`. Only PLY files hold the `scalars` of `ply_bytes`.
    """
    kind = path.suffix.lower()
    if MESH_UNITS[kind] == "mm":
        vertices = vertices * MILLIMETRES_PER_METRE
    elif kind == ".glb":
        vertices = vertices @ Y_UP.T
    path.write_bytes(WRITERS[kind](vertices, faces, **(scalars if kind == ".ply" else {})))


def ply_bytes(vertices: mesh_formats.Floats, faces: Faces, **scalars: NDArray[np.generic]) -> bytes:
    """A mesh of vertices (n, 3) and triangles (m, 3) as PLY.

    `scalars` (n,) are properties of the vertices, of type uchar for bytes and float for others.
    """
    columns = dict(zip("xyz", vertices.T, strict=True)) | scalars
    kinds = {name: "u1" if c.dtype == np.uint8 else "<f4" for name, c in columns.items()}
    points = np.empty(len(vertices), [(name, kind) for name, kind in kinds.items()])
    for name, column in columns.items():
        points[name] = column
    rows = np.empty(len(faces), _PLY_FACE)
    rows["count"], rows["corners"] = 3, faces
    header = [
        *("ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"),
        *(f"property {'uchar' if kinds[name] == 'u1' else 'float'} {name}" for name in columns),
        *(f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header\n"),
    ]
    return "\n".join(header).encode() + points.tobytes() + rows.tobytes()


def stl_bytes(vertices: mesh_formats.Floats, faces: Faces) -> bytes:
    """The same as binary STL; degenerate triangles have the normal 0."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.zeros(len(faces), mesh_formats.STL_TRIANGLE)
    rows["normal"] = normals / np.where(lengths > 0.0, lengths, 1.0)
    rows["corners"] = corners
    return mesh_formats.STL_HEADER.pack(len(faces)) + rows.tobytes()


def glb_bytes(vertices: mesh_formats.Floats, faces: Faces) -> bytes:
    """The same as one file of glTF 2, with one node of one mesh of one piece."""
    corners, points = faces.astype("<u4").tobytes(), vertices.astype("<f4")
    parts = ((0, len(corners)), (len(corners), points.nbytes))
    views = [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in parts]
    bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
    numbers, floats = glb.UNSIGNED, glb.FLOAT
    accessors = [
        {"bufferView": 0, "componentType": numbers, "type": "SCALAR", "count": faces.size},
        {"bufferView": 1, "componentType": floats, "type": "VEC3", "count": len(points), **bounds},
    ]
    piece = {"attributes": {"POSITION": 1}, "indices": 0, "mode": glb.TRIANGLE_MODE}
    description = {
        "asset": {"version": "2.0", "generator": "palpate"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [piece]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(corners) + points.nbytes}],
    }
    return glb.glb_of(json.dumps(description).encode(), corners + points.tobytes())


def obj_bytes(vertices: mesh_formats.Floats, faces: Faces) -> bytes:
    """The same as OBJ, as text."""
    points = map("v %.9g %.9g %.9g\n".__mod__, map(tuple, vertices.tolist()))
    corners = map("f %d %d %d\n".__mod__, map(tuple, (faces + 1).tolist()))
    return "".join([*points, *corners]).encode()


def three_mf_bytes(vertices: mesh_formats.Floats, faces: Faces) -> bytes:
    """The same as 3MF, vertices in mm: a package of one object, with reproducible bytes.

    Source: 3MF Core Specification 1.3, sections 2 and 4.
    """
    place = '<vertex x="%.9g" y="%.9g" z="%.9g"/>'
    corner = '<triangle v1="%d" v2="%d" v3="%d"/>'
    mesh = "".join(
        [
            *("<mesh><vertices>", *map(place.__mod__, map(tuple, vertices.tolist()))),
            *("</vertices><triangles>", *map(corner.__mod__, map(tuple, faces.tolist()))),
            "</triangles></mesh>",
        ]
    )
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as package:
        for name, text in _THREE_MF_PARTS.items():
            part = zipfile.ZipInfo(name)  # without a time stamp
            part.compress_type = zipfile.ZIP_DEFLATED
            package.writestr(part, _XML + text.replace("MESH", mesh))
    return packed.getvalue()


_XML = '<?xml version="1.0" encoding="UTF-8"?>\n'
_PACKAGES = "http://schemas.openxmlformats.org/package/2006"
_THREE_MF = "http://schemas.microsoft.com/3dmanufacturing"
_THREE_MF_MODEL = "3D/3dmodel.model"
_THREE_MF_PARTS = {
    "[Content_Types].xml": f'<Types xmlns="{_PACKAGES}/content-types">'
    '<Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" '
    'ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>',
    "_rels/.rels": f'<Relationships xmlns="{_PACKAGES}/relationships"><Relationship Id="model" '
    f'Type="{_THREE_MF}/2013/01/3dmodel" Target="/{_THREE_MF_MODEL}"/></Relationships>',
    _THREE_MF_MODEL: f'<model unit="millimeter" xmlns="{_THREE_MF}/core/2015/02"><resources>'
    '<object id="1" type="model">MESH</object></resources>'
    '<build><item objectid="1"/></build></model>',
}
WRITERS: Mapping[str, Callable[..., bytes]] = {
    ".ply": ply_bytes,
    ".stl": stl_bytes,
    ".glb": glb_bytes,
    ".obj": obj_bytes,
    ".3mf": three_mf_bytes,
}
