"""The rebuilt solid as files that other programs read."""

from __future__ import annotations

import hashlib
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.messages.types import ShapeModel

MILLIMETRES = 1000.0
"""STL has no unit; programs that slice it for printing assume mm."""
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns z up, as everywhere here, into y up, as glTF demands."""


def export_model(model: ShapeModel, folder: Path) -> tuple[str, ...]:
    """Write the solid into a folder; without a surface, only what there is to say about it.

    Parameters
    ----------
    model : ShapeModel
        What was rebuilt.
    folder : Path
        Gets ``mesh.ply`` (m), ``mesh.stl`` (mm), ``mesh.glb`` (m, y up) and ``model.npz``
        (everything that the model says).

    Returns
    -------
    tuple of str
        Names of the files.
    """
    np.savez(folder / "model.npz", allow_pickle=False, **_arrays(model))
    if len(model.faces) == 0:
        return ("model.npz",)
    import trimesh

    meshes = {
        "mesh.ply": model.vertices,
        "mesh.stl": model.vertices * MILLIMETRES,
        "mesh.glb": model.vertices @ Y_UP.T,
    }
    for name, vertices in meshes.items():
        mesh = trimesh.Trimesh(vertices, model.faces, process=False)
        mesh.export(folder / name)
    return (*meshes, "model.npz")


def mesh_sha256(model: ShapeModel) -> str:
    """Fingerprint of the surface: SHA-256 of its vertices (float64) and faces (int32)."""
    data = model.vertices.astype("<f8").tobytes() + model.faces.astype("<i4").tobytes()
    return hashlib.sha256(data).hexdigest()


def _arrays(model: ShapeModel) -> dict[str, NDArray[np.generic]]:
    """Every field as an array that can be read without pickle."""
    found: dict[str, NDArray[np.generic]] = {}
    for field in fields(ShapeModel):
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
