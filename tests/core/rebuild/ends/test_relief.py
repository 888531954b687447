from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours.contacts import ContactPoints
from palpate.core.rebuild.ends.closing import End
from palpate.core.rebuild.ends.profiles import Flat
from palpate.core.rebuild.ends.relief import with_relief
from palpate.core.rebuild.surface.closed import EndPatch, Patch, close_surface

RADIUS, RIM, HEIGHT, POSE = 0.03, 0.058, 0.06, 1e-4
ANGLE = 2.0 * np.pi * np.arange(96) / 96
ROW = RADIUS * np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])
BULGE = np.array([1e-3, 0.0, -1.5, 0.5])  # Height in the middle, m, and curvatures, 1/m


def face(places: Floats, bulge: Floats) -> Floats:
    x, y = places.T
    return np.asarray(bulge[0] + bulge[1] * x + bulge[2] * x**2 + bulge[3] * y**2)


def touched(bulge: Floats, seed: int, pose: float = POSE, touches: int = 10) -> ContactPoints:
    """Pads of 12 mm on the face, each off by its pose."""
    rng = np.random.default_rng(seed)
    azimuth, away = 2 * np.pi * rng.random(touches), 0.023 * np.sqrt(rng.random(touches))
    middles = np.column_stack([away * np.cos(azimuth), away * np.sin(azimuth)])
    grid = np.stack(np.meshgrid(*[np.linspace(-6e-3, 6e-3, 9)] * 2), axis=-1).reshape(-1, 2)
    places = (middles[:, None] + grid).reshape(-1, 2)
    touch = np.repeat(np.arange(touches), len(grid))
    z = HEIGHT + face(places, bulge) + pose * rng.normal(size=touches)[touch]
    z += 0.1 * pose * rng.normal(size=len(z))
    on = np.hypot(*places.T) < RADIUS
    points = np.column_stack([places, z])[on]
    return ContactPoints(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), touch[on])


def level_end() -> End:
    return End("flat", RIM, HEIGHT, 0.0, Flat(0.0), np.zeros(2), True)


@pytest.mark.parametrize("pose", [POSE, 0.0])
def test_a_face_that_bulges_is_a_height_field(pose: float) -> None:
    inside = ROW[::4] * np.array([0.3, 0.8])[:, None, None]
    for seed in range(5):
        end = with_relief(level_end(), touched(BULGE, seed, pose), ROW, pose or None)
        assert end.relief is not None
        off = end.relief.at(inside.reshape(-1, 2)) - face(inside.reshape(-1, 2), BULGE)
        assert np.sqrt(np.mean(off**2)) < 0.8 * POSE if pose else 1e-5


def test_a_relief_tells_how_wrong_it_is_where_nobody_touched_too() -> None:
    """Over all of the face: root mean squares of error and of what it says of it are alike."""
    places = (np.sqrt((np.arange(9) + 0.5) / 9)[:, None, None] * ROW[::4]).reshape(-1, 2)
    truth = face(places, BULGE)
    squares = []
    for seed in range(24):
        relief = with_relief(level_end(), touched(BULGE, seed, touches=6), ROW, POSE).relief
        assert relief is not None
        squares.append([np.mean((relief.at(places) - truth) ** 2), relief.deviation**2])
    wrong, told = np.sqrt(np.mean(squares, axis=0))
    assert 0.5 * told < wrong < 1.5 * told


def test_a_level_face_stays_level() -> None:
    for seed in range(20):
        end = with_relief(level_end(), touched(np.zeros(4), seed), ROW, POSE)
        assert end.relief is None


def test_touches_beside_the_rim_alone_tell_of_no_relief() -> None:
    contacts = touched(BULGE, 0, touches=40)
    beside = np.hypot(*contacts.points[:, :2].T) > 0.8 * RADIUS
    kept = ContactPoints(*(each[beside] for each in contacts if each is not None))
    assert with_relief(level_end(), kept, ROW, POSE).relief is None


@pytest.mark.parametrize("pose", [POSE, 0.0])
@pytest.mark.parametrize("taxels", [3, 4, 7])
def test_fewer_taxels_than_unknowns_tell_of_no_relief(taxels: int, pose: float) -> None:
    for seed in range(10):
        contacts = touched(BULGE, seed, pose or POSE, touches=4)
        nth = np.concatenate([np.arange((contacts.touch == one).sum()) for one in range(4)])
        kept = ContactPoints(*(each[nth < taxels] for each in contacts if each is not None))
        assert with_relief(level_end(), kept, ROW, pose or None).relief is None


def test_a_relief_rises_nowhere_far_above_what_was_touched() -> None:
    """Touches of one half of the face: a polynomial would rise by metres over the other half."""
    for seed in range(10):
        contacts = touched(BULGE, seed, touches=5)
        near = contacts.points[:, 0] < -0.2 * RADIUS
        kept = ContactPoints(*(each[near] for each in contacts if each is not None))
        relief = with_relief(level_end(), kept, ROW, None).relief
        if relief is not None:
            touched_rise = np.abs(relief.at(kept.points[:, :2])).max()
            assert np.abs(relief.at(0.95 * ROW)).max() <= 2.0 * touched_rise


class Wall(Patch):
    """The side of a cylinder."""

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        angle = 2.0 * np.pi * (turns + 0.25 * by[1])
        level = RADIUS * (2.0 * np.pi) ** by[1] * (by[0] == 0)
        up = {(0, 0): RIM * v, (1, 0): np.full(len(v), RIM)}.get(by, np.zeros(len(v)))
        return np.column_stack([level * np.cos(angle), level * np.sin(angle), up])


def test_a_relief_is_part_of_the_surface_and_of_its_derivatives() -> None:
    end = with_relief(level_end(), touched(BULGE, 0), ROW, POSE)
    bottom = End("flat", 0.0, 0.0, 0.0, Flat(0.0), np.zeros(2), True)
    surface = close_surface(Wall(), bottom, end)
    pieces = [one for one in surface.pieces if isinstance(one, EndPatch) and one.upper]
    v, turns, step = np.array([0.2, 0.5, 0.9]), np.array([0.1, 0.45, 0.8]), 1e-4
    assert end.relief is not None
    for piece in pieces:
        points = piece.at(v, turns)
        way = (points[:, 2] - end.relief.at(points[:, :2]) - RIM) / (HEIGHT - RIM)
        assert (way <= 1.0 + 1e-9).all()
        for by in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2)):
            one = (1, 0) if by[0] else (0, 1)
            rest = (by[0] - one[0], by[1] - one[1])
            ahead, behind = (
                piece.at(v + sign * step * one[0], turns + sign * step * one[1], rest)
                for sign in (1.0, -1.0)
            )
            expected = (ahead - behind) / (2.0 * step)
            assert np.allclose(piece.at(v, turns, by), expected, rtol=1e-4, atol=1e-6)
    # It ends in the middle at the face's height, and leaves the rim where it was.
    disc = pieces[-1].at(np.ones(1), np.zeros(1))[0]
    assert disc[2] == pytest.approx(HEIGHT + BULGE[0], abs=2.0 * POSE)
    assert pieces[0].at(np.zeros(1), np.zeros(1))[0, 2] == pytest.approx(RIM)
