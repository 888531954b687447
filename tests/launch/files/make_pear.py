"""Writes ``scenes/pear.ply``: a pear with five lobes, watertight, in mm, standing on z = 0.

Run it from anywhere: ``python tests/launch/files/make_pear.py``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

HEIGHT = 100.0  # mm
LOBES = 5
RINGS = 60
SIDES = 60


def pear() -> tuple[np.ndarray, np.ndarray]:
    """Vertices in mm, and triangles that are counter-clockwise seen from outside."""
    along = np.linspace(0.0, np.pi, RINGS + 2)[1:-1]
    z = HEIGHT * (1.0 - np.cos(along)) / 2.0
    share = z / HEIGHT
    radius = 30.0 * np.sin(along) ** 0.8 * (1.15 - 0.75 * share**1.5)
    lobe = 0.08 * np.sin(along) ** 2  # the lobes fade out towards the poles
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    wide = radius[:, None] * (1.0 + lobe[:, None] * np.cos(LOBES * angle))
    rings = np.stack(
        [wide * np.cos(angle), wide * np.sin(angle), np.broadcast_to(z[:, None], wide.shape)],
        axis=-1,
    )
    vertices = np.concatenate([rings.reshape(-1, 3), [[0.0, 0.0, 0.0], [0.0, 0.0, HEIGHT]]])
    return vertices, _triangles()


def _triangles() -> np.ndarray:
    here = np.arange(SIDES)
    onward = np.roll(here, -1)
    bottom, top = RINGS * SIDES, RINGS * SIDES + 1
    last = (RINGS - 1) * SIDES
    faces = [np.stack([np.full(SIDES, bottom), onward, here], axis=1)]
    for ring in range(RINGS - 1):
        low, high = ring * SIDES, (ring + 1) * SIDES
        faces.append(np.stack([low + here, low + onward, high + onward], axis=1))
        faces.append(np.stack([low + here, high + onward, high + here], axis=1))
    faces.append(np.stack([last + here, last + onward, np.full(SIDES, top)], axis=1))
    return np.concatenate(faces)


def write(path: Path) -> None:
    """Write the pear as a binary PLY file."""
    vertices, faces = pear()
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment a pear with five lobes, in mm\n"
        f"element vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + rows.tobytes())


if __name__ == "__main__":
    write(Path(__file__).parents[3] / "scenes" / "pear.ply")
