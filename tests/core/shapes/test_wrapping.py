"""Laws of the outside of any triangles: closed, where rays meet it, whatever the triangles are."""

import numpy as np
import pytest

from palpate.core.arrays import Floats, Ints
from palpate.core.geometry import self_intersection, solidity
from palpate.core.shapes import Superquadric, WrapSettings, wrap_mesh

RADIUS = 0.05
BALL = Superquadric(np.full(3, RADIUS), np.ones(2)).mesh(4)
VOLUME = solidity(*BALL).volume
COARSE = WrapSettings(n_voxels=48)


def wrong(kind: str) -> tuple[Floats, Ints]:
    """A ball that bounds no solid."""
    vertices, faces = BALL
    if kind == "open below":
        return vertices, faces[vertices[faces].mean(axis=1)[:, 2] > -0.8 * RADIUS]
    if kind == "turned at random":
        turned = np.random.default_rng(0).random(len(faces)) < 0.4
        return vertices, np.where(turned[:, None], faces[:, ::-1], faces)
    if kind == "doubled inside out":
        return vertices, np.concatenate([faces, faces[:, ::-1]])
    inner = 0.5 * vertices  # nobody sees it
    return np.concatenate([vertices, inner]), np.concatenate([faces, faces + len(vertices)])


@pytest.mark.parametrize("kind", [
    "turned at random", "doubled inside out", "with an inner ball",
    pytest.param("open below", marks=pytest.mark.slow),
])  # fmt: skip
def test_outside_is_closed_and_where_the_triangles_are(kind):
    result = wrap_mesh(*wrong(kind), COARSE)
    body = solidity(result.vertices, result.faces)
    assert body.watertight and body.genus == 0 and body.components == 1
    assert not self_intersection(result.vertices, result.faces).count
    seen = result.vertices[:, 2] > -0.7 * RADIUS
    assert np.abs(np.linalg.norm(result.vertices[seen], axis=1) - RADIUS).max() < 2e-4
    assert body.volume == pytest.approx(VOLUME, rel=0.06 if kind == "open below" else 2e-3)
    assert result.offset < 1e-4 and result.n_left_out == 0
    assert (result.closed_share > 0.05) == (kind == "open below")


@pytest.mark.slow
def test_overlapping_parts_are_joined_and_separate_parts_counted():
    vertices, faces = BALL
    for shift, parts in ((0.06, 0), (0.11, 1)):
        both = np.concatenate([vertices, vertices + [shift, 0.0, 0.0]])
        result = wrap_mesh(both, np.concatenate([faces, faces + len(vertices)]), COARSE)
        body = solidity(result.vertices, result.faces)
        assert body.watertight and body.components == 1 and result.n_left_out == parts
        lens = np.pi / 12.0 * (4.0 * RADIUS + shift) * (2.0 * RADIUS - shift) ** 2
        whole = VOLUME if parts else 2.0 * VOLUME - lens
        assert body.volume == pytest.approx(whole, rel=5e-3)


def test_surfaces_with_large_gaps_are_refused():
    vertices, faces = BALL
    half = faces[vertices[faces].mean(axis=1)[:, 2] > 0.0]
    with pytest.raises(ValueError, match=r"bounds no solid: \d+% of its outside would be a guess"):
        wrap_mesh(vertices, half, COARSE)
