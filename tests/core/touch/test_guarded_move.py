"""Guarded moves onto solids of every kind, with presses at which a cast can go wrong."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import FACING_DOWN, Pose
from palpate.core.shapes import DeformedSuperquadric, Shape, Superquadric, TriangleShape
from palpate.core.touch import HITS, guarded_move
from tests.core.touch.touches import DOMED, FLAT, X, Y, above

REACH, EXACT = 0.1, 1e-12
NO_EMBREE = pytest.mark.skipif(find_spec("embreex") is None, reason="no Embree here")
KINDS: dict[str, Callable[[Superquadric], Shape]] = {
    "superquadric": lambda solid: solid,
    "warped": lambda solid: DeformedSuperquadric(solid, np.zeros(2)),
    "mesh, Embree": lambda solid: TriangleShape(*solid.mesh(5), embree=True),
    "mesh, z-buffer": lambda solid: TriangleShape(*solid.mesh(5), embree=False),
}
EACH_KIND = pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=NO_EMBREE) if "Embree" in k else k for k in KINDS]
)


@cache
def solid_of(kind: str, size: tuple[float, ...], exponent: float = 1.0) -> Shape:
    return KINDS[kind](Superquadric(np.array(size), np.full(2, exponent)))


BALL_MOVES = [
    # height, aside, reach and depth [m], and the outcome
    (0.05, 0.0, REACH, 1e-3, "hit"),
    (0.0329, 0.0, REACH, 0.1e-3, "hit"),
    (0.05, 0.0, REACH, 2.9e-3, "bottomed"),
    (0.05, 0.04, REACH, 1e-3, "miss"),
    (0.05, 0.0, 0.0199, 1e-3, "miss"),
    (-0.05, 0.0, REACH, 1e-3, "miss"),
    (0.0298, 0.0, REACH, 1e-3, "inside"),  # the face alone; the transducers are outside
    (0.026, 0.0, REACH, 1e-3, "inside"),
    (0.0, 0.0, REACH, 1e-3, "inside"),
    (-0.0295, 0.0, REACH, 1e-3, "inside"),  # in the far half, near the exit
]


@pytest.mark.parametrize("pad", [FLAT, DOMED], ids=["flat", "domed"])
@EACH_KIND
def test_a_move_onto_a_ball_ends_as_geometry_says(kind, pad):
    # The middle four taxels are half a pitch off the axis.
    first = np.sqrt(0.03**2 - X**2 - Y**2) - pad.sag()
    facets = 2e-5 if "mesh" in kind else EXACT
    for height, aside, reach, depth, outcome in BALL_MOVES:
        start = above(height, aside)
        end = guarded_move(solid_of(kind, (0.03,) * 3), pad, start, reach, depth)
        assert end.outcome == outcome, (height, aside)
        wanted = np.zeros((16, 16))
        if outcome in HITS:
            wanted = np.maximum(min(depth, 2.4e-3) - (first.max() - first), 0.0)
            assert end.compression.max() == pytest.approx(min(depth, 2.4e-3), abs=EXACT)
            assert end.advance == pytest.approx(height - first.max() + wanted.max(), abs=facets)
        else:
            assert end.advance == (reach if outcome == "miss" else 0.0)
        assert np.allclose(end.compression, wanted, rtol=0, atol=facets)
        assert np.allclose(end.pose.position, [aside, 0, height - end.advance], atol=1e-15)
        assert np.array_equal(np.maximum(end.indentation, 0.0), end.compression)


@EACH_KIND
def test_an_exit_out_of_reach_does_not_hide_a_start_inside(kind):
    deep = solid_of(kind, (0.05, 0.05, 0.5))
    assert guarded_move(deep, FLAT, above(0.4), 1e-3, 1e-3).outcome == "inside"


@EACH_KIND
def test_a_thin_plate_is_met_on_its_near_side(kind):
    plate = solid_of(kind, (0.03, 0.03, 0.0005), 0.05)
    end = guarded_move(plate, FLAT, above(0.05), REACH, 2e-3)
    assert end.outcome == "hit"
    assert np.allclose(end.compression, 2e-3, rtol=0, atol=1e-6)
    assert end.advance == pytest.approx(0.05 - 0.0005 + 2e-3, abs=1e-6)


@EACH_KIND
def test_a_pin_between_the_taxels_is_missed(kind):
    pin = solid_of(kind, (0.4e-3,) * 3)
    for aside, count in ((0.0, 0), (0.5e-3, 1)):
        start = Pose(np.array([aside, aside, 0.05]), FACING_DOWN)
        end = guarded_move(pin, FLAT, start, REACH, 0.3e-3)
        assert end.outcome == ("hit" if count else "miss")
        assert np.count_nonzero(end.compression) == count
        assert end.compression.max() == pytest.approx(0.3e-3 * count, abs=EXACT)


def ray_errors(solid: Superquadric, start: Floats) -> Floats:
    """Distances of what was measured from the surface along the rays [m], in long doubles."""
    end, axes = guarded_move(solid, FLAT, start, 10.0, 1e-3), start.axes
    assert end.outcome == "hit"
    wide = np.longdouble
    met = np.isfinite(end.indentation).ravel()
    ways = (end.advance - end.indentation.ravel()[met] + FLAT.thickness).astype(wide)
    origins = (FLAT.transducers() @ axes.T + start.position)[met].astype(wide)
    e1, e2 = solid.exponents.astype(wide)

    def height(ways: np.ndarray) -> np.ndarray:
        along = ways[:, None] * axes[:, 2].astype(wide)
        x, y, z = np.abs((origins + along) / solid.size.astype(wide)).T
        across = np.maximum(x, y)
        across = across * ((x / across) ** (2 / e2) + (y / across) ** (2 / e2)) ** (e2 / 2)
        most = np.maximum(across, z)
        gauge = most * ((across / most) ** (2 / e1) + (z / most) ** (2 / e1)) ** (e1 / 2)
        return np.asarray(gauge - 1)

    step = wide(1e-9)
    slope = np.maximum((height(ways - step) - height(ways)) / step, 1e-3 / solid.size.max())
    return np.asarray(np.abs(height(ways)) / slope, float)


@pytest.mark.parametrize("exponents", [(0.02, 0.02), (0.02, 2.0), (2.0, 0.02)])
def test_casts_from_afar_at_extreme_exponents_stay_exact(exponents):
    solid = Superquadric(np.array([0.03, 0.001, 0.04]), np.array(exponents))
    for far in (0.1, 9.0):
        assert ray_errors(solid, above(far)).max() < 1e-11  # 9 m has fewer digits left
        assert guarded_move(solid, FLAT, above(-far), 10.0, 1e-3).outcome == "miss"


@pytest.mark.parametrize("kind", ["superquadric", "warped"])
def test_rays_along_a_face_meet_only_what_lies_within_it(kind):
    solid = Superquadric(np.array([0.0075, 0.03, 0.04]), np.full(2, 0.05))
    start = above(0.06, 0.0075)  # over the edge of a box: half the rays run along its side
    end = guarded_move(KINDS[kind](solid), FLAT, start, REACH, 1e-3)
    over = end.pose.position[0] + X
    assert end.outcome == "hit"
    assert np.isfinite(end.indentation[np.abs(over) < 0.0074]).all()
    assert (end.indentation[np.abs(over) > 0.0076] == -np.inf).all()
    assert ray_errors(solid, start).max() < EXACT
