"""Walls: how thin they are, from points on both sides, and cells small enough for them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
import trimesh

from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.core.rebuild.general import rebuild_general, tears, wall_cell, wall_thickness
from palpate.core.shapes import Mesh
from tests.core.rebuild.objects import circle, contacts

CELL = 4.0e-3


def tube(
    thickness: float, outside: int = 60, inside: int = 50, azimuth: float = 3.0
) -> ContactPoints:
    """Points of a tube of 30 mm: all of its outer side, and its inner side up to an azimuth."""
    radius = np.array([0.03, 0.03 - thickness])
    points, normals = [], []
    for side, (count, last) in enumerate(((outside, 2.0 * np.pi), (inside, azimuth))):
        turn, height = np.meshgrid(np.linspace(0.0, last, count), np.linspace(0.0, 0.05, 26))
        out = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1).reshape(-1, 3)
        points.append(radius[side] * out + height.reshape(-1, 1) * [0.0, 0.0, 1.0])
        normals.append(out if side == 0 else -out)
    places = np.concatenate(points)
    return contacts(places, np.concatenate(normals), np.arange(len(places)))


def test_thickness_of_a_wall_is_found_where_both_sides_were_touched():
    for thickness in (1.5e-3, 3.0e-3, 6.0e-3):
        assert wall_thickness(tube(thickness), 8.0e-3) == pytest.approx(thickness, rel=0.1)
    outer_side, wall = tube(2.0e-3, inside=0), tube(2.0e-3)
    assert wall_thickness(outer_side, 8.0e-3) is None
    assert wall_cell(outer_side, CELL) == CELL
    slot = wall._replace(normals=-np.asarray(wall.normals))
    assert wall_thickness(slot, 8.0e-3) is None


def test_cells_are_no_larger_than_walls_and_change_by_steps():
    cells = [wall_cell(tube(thickness), CELL) for thickness in (1.9e-3, 2.0e-3, 3.0e-3, 6.0e-3)]
    assert cells[0] == cells[1] < cells[2] < cells[3] == CELL
    assert cells[1] <= 2.2e-3 and cells[2] <= 3.3e-3


def test_holes_and_parts_count_as_tears():
    ball, ring = trimesh.creation.icosphere(2), trimesh.creation.torus(1.0, 0.3)
    both = trimesh.util.concatenate([ring, ring.copy().apply_translation([5.0, 0.0, 0.0])])
    meshes = [Mesh(one.vertices, one.faces.astype(np.int32)) for one in (ball, ring, both)]
    assert [*map(tears, meshes)] == [0, 1, 3]


@pytest.mark.slow  # some 5,000 cells
def test_cup_with_a_wall_of_half_a_cell_is_one_smooth_piece():
    """A cup of 30 by 24 mm, touched on its rim and its bottom as well."""
    rim, thickness = 0.015, 2.0e-3
    inner = rim - thickness
    profile = [  # start, end and normal of each part of its section, radius and height
        ((0.0, 0.0), (rim, 0.0), (0.0, -1.0)),
        ((rim, 0.0), (rim, 0.024), (1.0, 0.0)),
        ((rim, 0.024), (inner, 0.024), (0.0, 1.0)),
        ((inner, 0.024), (inner, thickness), (-1.0, 0.0)),
        ((inner, thickness), (0.0, thickness), (0.0, 1.0)),
    ]
    parts = []
    for start, end, normal in profile:
        length = float(np.hypot(*np.subtract(end, start)))
        shares = np.linspace(0.0, 1.0, max(2, round(length / 1e-3)), endpoint=False)[1:]
        radius, height = (np.array(start) + shares[:, None] * np.subtract(end, start)).T
        for out in circle(40):
            points = np.column_stack([radius[:, None] * out, height])
            normals = np.broadcast_to([*(normal[0] * out), normal[1]], points.shape)
            parts.append(contacts(points, normals))
    points, normals, _ = stack_points(parts)
    inside = np.linspace(-0.008, 0.008, 9)
    free = np.stack(np.meshgrid(inside, inside, np.linspace(0.004, 0.03, 14)), -1).reshape(-1, 3)
    found = rebuild_general(points, normals, free=free, outward=True, cell=CELL)
    mesh = found.rough_mesh
    used = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert used.euler_number == 2 and used.body_count == 1
    assert found.cell < 2.2e-3
    off = scipy.spatial.cKDTree(mesh.vertices).query(points)[0]
    assert np.quantile(off, 0.95) < 1e-3  # The way to a vertex: they lie 1 mm apart


def test_cavity_that_fingers_entered_is_not_closed_by_a_lid():
    """A cup of 80 mm touched outside and on its rim; fingers came 20 mm deep and met nothing."""
    rng, rim, depth = np.random.default_rng(0), 0.07, 0.02
    touches = []
    for number in range(14 * 6):
        turn = 2.0 * np.pi * (number % 14) / 14 + rng.uniform(-0.1, 0.1, 30)
        out = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1)
        across = rng.uniform(-4e-3, 4e-3, (30, 1))
        up = np.broadcast_to([0.0, 0.0, 1.0], out.shape)
        level = number // 14
        side = 0.04 * out + (5e-3 + 15e-3 * level + across) * up
        points, normals = (side, out) if level < 5 else ((0.03 + across) * out + rim * up, up)
        touches.append(contacts(points + rng.normal(0.0, 1e-4, 3), normals))
    beside, above = np.arange(-0.0175, 0.018, 2.5e-3), np.arange(rim - depth, rim + depth, 2.5e-3)
    swept = np.stack(np.meshgrid(beside, beside, above), -1).reshape(-1, 3)
    swept = swept[np.linalg.norm(swept[:, :2], axis=1) < 0.018]
    draft = None
    for _ in range(2):  # without an earlier solid, and from one
        known = {"free": swept, "platform": 0.0, "outward": True, "cell": 5e-3}
        draft = rebuild_general(stack_points(touches), **known, start=draft, draft=True)
        vertices = draft.rough_mesh.vertices
        lid = vertices[np.linalg.norm(vertices[:, :2], axis=1) < 6e-3, 2].max()
        assert 0.5 * rim < lid < rim - depth + 2e-3
