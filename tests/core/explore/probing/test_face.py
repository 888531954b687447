from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.probing.face import Face, fit_face, is_plane
from palpate.core.explore.probing.known import Probed, Probing, Wall
from palpate.core.frames import IDENTITY

WIDTH = 0.015
FACE = Face(0.04, np.array([0.1, -0.05]))


def _made(place: tuple[float, float], normal: Floats | None = None, off: float = 0.0) -> Probed:
    height = FACE.at(np.array([place]))[0] + off
    probing = Probing(IDENTITY, 0.0, "face", np.zeros(3))
    at = np.array([*place, height])
    return Probed(probing, "hit", at, FACE.normal if normal is None else normal)


def test_a_touch_with_its_normal_tells_the_plane() -> None:
    found = fit_face([_made((0.005, -0.002))], WIDTH)
    assert found.height == pytest.approx(0.04, abs=1e-12)
    np.testing.assert_allclose(found.slopes, FACE.slopes, atol=1e-12)


def test_a_normal_from_an_edge_is_not_believed() -> None:
    places = [(0.0, 0.0), (0.02, 0.0), (0.0, 0.02)]
    touches = [_made(place, np.array([0.9, 0.0, 0.4])) for place in places]
    np.testing.assert_allclose(fit_face(touches, WIDTH).slopes, FACE.slopes, atol=1e-6)
    np.testing.assert_allclose(fit_face(touches[:1], WIDTH).slopes, 0.0, atol=1e-12)


def test_touches_in_a_plane_are_one(ring: Callable[..., Wall]) -> None:
    touches = [_made((0.0, 0.0)), _made((0.02, 0.0)), _made((0.0, 0.02), off=1e-4)]
    face = fit_face(touches, WIDTH)
    assert is_plane(face, touches, ring(0.025, 0.03), 2e-4)


@pytest.mark.parametrize(
    ("last", "above"),
    [
        (_made((0.0, 0.02), off=2e-3), 0.0),
        (_made((0.0, 0.02), np.array([0.0, 0.1, 0.995])), 0.0),
        (_made((0.0, 0.02)), 0.02),
    ],
    ids=["a step", "a lean", "a hollow"],
)
def test_what_is_no_plane_is_none(ring: Callable[..., Wall], last: Probed, above: float) -> None:
    touches = [_made((0.0, 0.0)), _made((0.02, 0.0)), last]
    wall = ring(0.025, 0.03, above=above)
    assert not is_plane(fit_face(touches, WIDTH), touches, wall, 2e-4)
