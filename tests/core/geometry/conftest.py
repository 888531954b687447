import numpy as np
import pytest

from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.tessellations import icosphere

BOX_FACES = [
    [0, 2, 1], [0, 3, 2],  # bottom
    [4, 5, 6], [4, 6, 7],  # top
    [0, 1, 5], [0, 5, 4], [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7],
]  # fmt: skip


@pytest.fixture
def box():
    """Unit cube, from (0, 0, 0) to (1, 1, 1)."""
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    vertices = [[x, y, z] for z in (0, 1) for x, y in square]
    return Mesh(np.array(vertices, float), np.array(BOX_FACES, np.int32))


@pytest.fixture
def sphere():
    """1280 faces on a sphere of 40 mm."""
    directions, faces = icosphere(3)
    return Mesh(0.04 * directions, faces)


@pytest.fixture
def torus():
    """30 by 20 quadrangles, each cut in two."""
    u, v = np.meshgrid(np.arange(30), np.arange(20), indexing="ij")
    a, b = u * (2 * np.pi / 30), v * (2 * np.pi / 20)
    ring = 3 + np.cos(b)
    vertices = np.stack([ring * np.cos(a), ring * np.sin(a), np.sin(b)], axis=-1).reshape(-1, 3)
    here, right = u * 20 + v, (u + 1) % 30 * 20 + v
    up, both = u * 20 + (v + 1) % 20, (u + 1) % 30 * 20 + (v + 1) % 20
    faces = np.concatenate(
        [np.stack(f, axis=-1).reshape(-1, 3) for f in ((here, right, both), (here, both, up))]
    )
    return Mesh(vertices, faces.astype(np.int32))


def lobes(depth, count=3000):
    angle = 2 * np.pi * np.arange(count) / count
    radius = 1.0 + depth * np.cos(3 * angle)
    return np.asarray(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def fine(polygon, each=50):
    ends = np.roll(polygon, -1, axis=0)
    share = np.arange(each)[:, None] / each
    return np.concatenate([a + share * (b - a) for a, b in zip(polygon, ends, strict=True)])


@pytest.fixture
def three_lobes():
    """1 + depth cos 3a around the origin."""
    return lobes


@pytest.fixture
def u_shape():
    """A U, 5 wide and 4 high, of legs 1 wide; counter-clockwise."""
    return np.array([[0, 0], [5, 0], [5, 4], [4, 4], [4, 1], [1, 1], [1, 4], [0, 4.0]])


@pytest.fixture
def refined():
    """A polygon with further vertices on its edges."""
    return fine
