"""Drawn objects that slices do badly on, as functions that are negative inside; mm, on z = 0."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from palpate.core import Floats
from palpate.core.shapes import Mesh, grid_surface

STEP = 1.0  # Of the grid on which they are meshed, mm
Field = Callable[[Floats], Floats]  # Places (n, 3) to (n,)


def mesh_of(field: Field, half: tuple[float, float, float]) -> Mesh:
    """The mesh (m) of a field within a box of half widths over the platform."""
    low = np.array([-half[0], -half[1], 0.0]) - 2.3 * STEP
    high = np.array([half[0], half[1], 2.0 * half[2]]) + 2.3 * STEP
    shape = np.ceil((high - low) / STEP).astype(int) + 1
    nodes = np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 3) * STEP + low
    found = grid_surface(field(nodes).reshape(shape))
    places = found.vertices * STEP + low
    return Mesh(1e-3 * (places - [0.0, 0.0, places[:, 2].min()]), found.faces)


def rounded_box(places: Floats, half: tuple[float, float, float], radius: float) -> Floats:
    """Distance from a box about the origin whose edges are rounded."""
    off = np.abs(places) - (np.array(half) - radius)
    outside = np.linalg.norm(np.maximum(off, 0.0), axis=1)
    return np.asarray(outside + np.minimum(off.max(axis=1), 0.0) - radius)


def tube(places: Floats, radius: float, thick: float) -> Floats:
    """Distance from a ring about the z axis."""
    around = np.hypot(places[:, 0], places[:, 1]) - radius
    return np.asarray(np.hypot(around, places[:, 2]) - thick)


def post(places: Floats, radius: float, height: float, rounding: float = 3.0) -> Floats:
    """Distance from an upright cylinder on z = 0 with rounded edges."""
    off = np.column_stack(
        [
            np.hypot(places[:, 0], places[:, 1]) - (radius - rounding),
            np.abs(places[:, 2] - 0.5 * height) - (0.5 * height - rounding),
        ]
    )
    outside = np.linalg.norm(np.maximum(off, 0.0), axis=1)
    return np.asarray(outside + np.minimum(off.max(axis=1), 0.0) - rounding)


def without(solid: Floats, hole: Floats) -> Floats:
    """A solid less another."""
    return np.maximum(solid, -hole)


def torus(places: Floats) -> Floats:
    """A ring that lies."""
    return tube(places - [0.0, 0.0, 13.0], 35.0, 13.0)


def c_tube(places: Floats) -> Floats:
    """Three quarters of a ring that lies, its ends round."""
    at = places - [0.0, 0.0, 13.0]
    turn = np.arctan2(at[:, 1], at[:, 0])
    open_ = np.abs(turn) < np.pi / 4
    ends = 35.0 * np.array([[np.cos(a), np.sin(a), 0.0] for a in (np.pi / 4, -np.pi / 4)])
    to_ends = np.linalg.norm(at[:, None] - ends, axis=2).min(axis=1) - 13.0
    return np.where(open_, to_ends, tube(at, 35.0, 13.0))


def mug(places: Floats) -> Floats:
    """A cup with walls of 6 mm and a handle."""
    cup = without(post(places, 35.0, 80.0), post(places - [0.0, 0.0, 8.0], 29.0, 100.0))
    at = (places - [38.0, 0.0, 40.0])[:, [0, 2, 1]]
    handle = np.where(np.hypot(places[:, 0], places[:, 1]) < 32.0, 9.0, tube(at, 22.0, 5.0))
    return np.minimum(cup, handle)


def two_towers(places: Floats) -> Floats:
    """Two posts on one base."""
    base = rounded_box(places - [0.0, 0.0, 10.0], (50.0, 25.0, 10.0), 4.0)
    posts = [post(places - [x, 0.0, 5.0], 14.0, 65.0) for x in (-32.0, 32.0)]
    return np.minimum(base, np.minimum(*posts))


def lying_bottle(places: Floats) -> Floats:
    """A bottle that lies, its neck along x."""
    at = places - [0.0, 0.0, 25.0]
    away, along = np.hypot(at[:, 1], at[:, 2]), at[:, 0]
    wanted = np.interp(along, [-70.0, 20.0, 40.0, 70.0], [25.0, 25.0, 11.0, 11.0])
    return np.asarray(np.maximum(0.8 * (away - wanted), np.abs(along) - 65.0))


def plate(places: Floats) -> Floats:
    """Upright, 3 mm thick."""
    return rounded_box(places - [0.0, 0.0, 35.0], (40.0, 1.5, 35.0), 1.4)


def brick(places: Floats, seed: int = 0) -> Floats:
    """With roundings of 6 mm, in one of many poses."""
    turned, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return rounded_box((places - [0.0, 0.0, 50.0]) @ turned, (38.0, 25.0, 18.0), 6.0)


def star(places: Floats) -> Floats:
    """Five rays of half the radius."""
    away, turn = np.hypot(places[:, 0], places[:, 1]), np.arctan2(places[:, 1], places[:, 0])
    wanted = 32.0 * (1.0 + 0.25 * np.cos(5.0 * turn)) / 1.25
    return np.asarray(np.maximum(0.6 * (away - wanted), np.abs(places[:, 2] - 30.0) - 30.0))


def undercut_cone(places: Floats) -> Floats:
    """A cone that stands on a stem."""
    away, height = np.hypot(places[:, 0], places[:, 1]), places[:, 2]
    wanted = np.interp(height, [0.0, 24.0, 30.0, 80.0], [16.0, 16.0, 38.0, 10.0])
    return np.asarray(np.maximum(0.6 * (away - wanted), np.abs(height - 40.0) - 40.0))


def with_bore(places: Floats) -> Floats:
    """A post with a bore from above, 8 mm wide and 15 mm deep."""
    return without(post(places, 25.0, 50.0), post(places - [0.0, 0.0, 35.0], 4.0, 40.0, 1.0))


def with_slit(places: Floats) -> Floats:
    """A box with a slit of 4 mm across its top."""
    box = rounded_box(places - [0.0, 0.0, 25.0], (30.0, 25.0, 25.0), 4.0)
    return without(box, rounded_box(places - [0.0, 0.0, 50.0], (2.0, 60.0, 15.0), 0.5))


def with_hump(places: Floats) -> Floats:
    """A box with a hump of 6 mm on its top."""
    box = rounded_box(places - [0.0, 0.0, 20.0], (30.0, 25.0, 20.0), 4.0)
    hump = np.linalg.norm(places - [8.0, 4.0, 40.0], axis=1) - 6.0
    return np.minimum(box, hump)


def thin_walls(places: Floats) -> Floats:
    """An open box whose walls are 3 mm thick."""
    box = rounded_box(places - [0.0, 0.0, 30.0], (30.0, 30.0, 30.0), 4.0)
    return without(box, rounded_box(places - [0.0, 0.0, 45.0], (27.0, 27.0, 40.0), 3.0))


# Each with the half widths of a box that holds it, and its genus.
HARD_OBJECTS: dict[str, tuple[Field, tuple[float, float, float], int]] = {
    "torus": (torus, (48.0, 48.0, 13.0), 1),
    "c tube": (c_tube, (48.0, 48.0, 13.0), 0),
    "mug": (mug, (67.0, 36.0, 40.0), 1),
    "two towers": (two_towers, (50.0, 25.0, 35.0), 0),
    "lying bottle": (lying_bottle, (66.0, 26.0, 25.0), 0),
    "thin plate": (plate, (40.0, 3.0, 35.0), 0),
    "star": (star, (34.0, 34.0, 30.0), 0),
    "undercut cone": (undercut_cone, (40.0, 40.0, 40.0), 0),
    "bore": (with_bore, (25.0, 25.0, 25.0), 0),
    "slit": (with_slit, (30.0, 25.0, 25.0), 0),
    "hump": (with_hump, (30.0, 25.0, 23.0), 0),
    "thin walls": (thin_walls, (30.0, 30.0, 30.0), 0),
    **{f"brick {n}": (partial(brick, seed=n), (50.0, 50.0, 50.0), 0) for n in range(20)},
}
