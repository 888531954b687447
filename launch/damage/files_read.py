"""Reads files as palpate does, and looks whether what was accepted is valid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.core.archive import to_arrays
from palpate.core.measure.solidity import solidity
from palpate.launch.mesh_file import (
    LARGEST,
    MAX_FACES,
    SMALLEST,
    read_cloud,
    read_mesh,
    read_surface,
)
from palpate.launch.scene_check import checked
from palpate.launch.solid_file import load
from palpate.messages.recording.reader import open_recording


def read_recording(path: Path) -> None:
    """Read a recording from end to end.

    Raises
    ------
    ValueError
        If it is refused.
    AssertionError
        If it is accepted and has other messages than it says; or if the sentence is none.
    """
    recording = open_recording(path)
    counts = dict.fromkeys(recording.counts, 0)
    for kept in recording.messages():
        counts[kept.topic] += 1
    assert counts == recording.counts, "has other messages than it says"


def read_open(path: Path) -> None:
    """Read a mesh that need not be closed, or points; errors as of `read_closed`."""
    points = read_cloud(path, "mm")
    if points is not None and len(points):
        assert points.ndim == 2 and points.shape[1] == 3, "points without three coordinates"
        return
    _check(*read_surface(path, "mm"))


def read_closed(path: Path) -> None:
    """Read a mesh as a scene does.

    Raises
    ------
    InputError
        If it is refused.
    AssertionError
        If it is accepted and not finite, closed, and of fitting size.
    """
    vertices, faces = read_mesh(path, "mm")
    _check(vertices, faces)
    found, extents = solidity(vertices, faces), np.ptp(vertices, axis=0)
    assert found.watertight and found.components == 1 and found.volume > 0.0, "is not one solid"
    assert extents.min() >= SMALLEST and extents.max() <= LARGEST, "is too small or too large"


def read_scene(path: Path) -> None:
    """Check a scene as ``palpate scene check`` does; raises InputError if it is refused."""
    assert "can be explored" in checked(str(path)), "says nothing"


def read_solid(path: Path) -> None:
    """Read a saved solid, and take it apart again; raises InputError if it is refused."""
    assert len(to_arrays(load(path))) > 1, "holds nothing"


def _check(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
    assert np.isfinite(vertices).all(), "a vertex is not finite"
    assert 0 < len(faces) <= MAX_FACES, "has no triangles or too many"
    assert faces.min() >= 0 and faces.max() < len(vertices), "names a vertex that is not there"
