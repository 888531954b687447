"""Laws of the outside of any triangles: closed, where rays meet it, whatever the triangles are."""

import numpy as np
import pytest

from palpate.core.geometry import self_intersection, solidity
from palpate.core.shapes import Mesh, WrapSettings, wrap_mesh
from tests.core.geometry.bodies import ball, joined, moved

RADIUS = 0.05
BALL = ball(RADIUS, 4)
VOLUME = solidity(*BALL).volume
COARSE = WrapSettings(n_voxels=48)


TURNED = np.random.default_rng(0).random((len(BALL.faces), 1)) < 0.4
SEEN = BALL.vertices[BALL.faces].mean(axis=1)[:, 2] > -0.8 * RADIUS
WITHIN = Mesh(0.5 * BALL.vertices, BALL.faces)  # nobody sees it
WRONG = {  # a ball that bounds no solid
    "open below": BALL._replace(faces=BALL.faces[SEEN]),
    "turned at random": BALL._replace(faces=np.where(TURNED, BALL.faces[:, ::-1], BALL.faces)),
    "doubled inside out": BALL._replace(faces=np.vstack([BALL.faces, BALL.faces[:, ::-1]])),
    "with an inner ball": joined(BALL, WITHIN),
}


@pytest.mark.parametrize("kind", [
    "turned at random", "doubled inside out", "with an inner ball",
    pytest.param("open below", marks=pytest.mark.slow),
])  # fmt: skip
def test_outside_is_closed_and_where_the_triangles_are(kind):
    result = wrap_mesh(*WRONG[kind], COARSE)
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
    for shift, parts in ((0.06, 0), (0.11, 1)):
        result = wrap_mesh(*joined(BALL, moved(BALL, [shift, 0.0, 0.0])), COARSE)
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
