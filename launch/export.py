"""The solid of a run as files that other programs read."""

from __future__ import annotations

import hashlib
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.core.archive_bytes import unpack
from palpate.launch.mesh_export import write_mesh
from palpate.messages.types import ShapeModel

MESHES = ("mesh.ply", "mesh.stl", "mesh.glb")
"""Files of the surface."""
PACKED = "archive"
"""The field that is unpacked, not kept as it is."""


def export_model(model: ShapeModel, folder: Path) -> tuple[str, ...]:
    """Write the solid into a folder; without a surface, only what there is to say about it.

    Parameters
    ----------
    model : ShapeModel
        What was rebuilt.
    folder : Path
        Gets ``mesh.ply`` (m), ``mesh.stl`` (mm), ``mesh.glb`` (m, y up) and ``model.npz``
        (everything that the model says, and the solid itself for `palpate.load`).

    Returns
    -------
    tuple of str
        Names of the files.
    """
    archived = unpack(model.archive) if len(model.archive) else {}
    np.savez(folder / "model.npz", allow_pickle=False, **_arrays(model), **archived)
    if len(model.faces) == 0:
        return ("model.npz",)
    for name in MESHES:
        write_mesh(folder / name, model.vertices, model.faces)
    return (*MESHES, "model.npz")


def mesh_sha256(model: ShapeModel) -> str:
    """Fingerprint of the surface: SHA-256 of its vertices (float64) and faces (int32)."""
    data = model.vertices.astype("<f8").tobytes() + model.faces.astype("<i4").tobytes()
    return hashlib.sha256(data).hexdigest()


def _arrays(model: ShapeModel) -> dict[str, NDArray[np.generic]]:
    """Every field as an array that can be read without pickle."""
    found: dict[str, NDArray[np.generic]] = {}
    for field in fields(ShapeModel):
        if field.name == PACKED:
            continue
        value = getattr(model, field.name)
        if isinstance(value, dict):
            found[f"{field.name}_names"] = np.array(list(value), dtype=np.str_)
            found[f"{field.name}_values"] = np.array(list(value.values()), dtype=np.float64)
        elif isinstance(value, tuple):
            kind = np.str_ if any(isinstance(item, str) for item in value) else np.int64
            found[field.name] = np.array(value, dtype=kind)
        else:
            found[field.name] = np.asarray(value)
    return found
