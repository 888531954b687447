"""The planar explorer: polyhedra from their planes, and what is none."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.geometry import compare_surfaces, is_closed, prepare_surface
from palpate.core.procedures.planar import planar

from .conftest import EXACT, NOISES, NOISY, block, drive, posed, prism, wedge

SOLIDS = {
    "block": block(),
    "wedge": wedge(),
    "prism": prism(3, 0.035, 0.06),
    "six-sided prism": prism(6, 0.035, 0.06),
    "cut pyramid": prism(4, 0.04, 0.05, 0.6),
    "cut cone of five sides": prism(5, 0.04, 0.06, 0.3),
}


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("name", SOLIDS)
def test_a_polyhedron_closes_where_its_planes_meet(name, noise):
    solid = SOLIDS[name]
    found = drive(planar, solid, NOISES[noise]).findings
    assert found.status == "done", found.reason
    edges, true = found.shape.polyhedron.edges, solid.edges
    assert len(edges.ends) == len(true.ends) and edges.vertices == true.vertices
    assert edges.euler == 2 and found.mesh is not None and is_closed(found.mesh.faces)
    surfaces = [prepare_surface(*one) for one in (solid.mesh(0), found.mesh)]
    assert compare_surfaces(*surfaces).hausdorff < (5e-5 if noise == "exact" else 0.3e-3)


@pytest.mark.parametrize("noise", NOISES)
def test_a_block_is_as_exact_as_its_planes(noise):
    found = drive(planar, block(), NOISES[noise]).findings
    normals = np.array([plane.normal for plane in found.shape.planes])
    lean = np.degrees(np.arccos(np.abs(normals).max(axis=1).clip(max=1.0)))
    assert lean.max() < (1e-4 if noise == "exact" else 0.2)
    corners = np.abs(found.shape.vertices) - [0.03, 0.022, 0.0]
    corners[:, 2] = np.minimum(np.abs(found.shape.vertices[:, 2]),
                               np.abs(found.shape.vertices[:, 2] - 0.05))  # fmt: skip
    assert np.abs(corners).max() < (1e-7 if noise == "exact" else 0.3e-3)


@pytest.mark.slow
def test_normals_and_edges_of_a_block_hold_with_noise_of_many_seeds():
    for seed in range(10):
        found = drive(planar, block(), NOISY, seed=seed).findings
        assert found.status == "done", found.reason
        normals = np.array([plane.normal for plane in found.shape.planes])
        assert np.degrees(np.arccos(np.abs(normals).max(axis=1).clip(max=1.0))).max() < 0.2
        corners = np.abs(found.shape.vertices[:, :2]) - [0.03, 0.022]
        assert np.abs(corners).max() < 0.3e-3


def test_a_rounded_rim_has_no_say_in_where_an_edge_is():
    size = np.array([0.035, 0.025, 0.045])
    solid = posed(shapes.Superquadric(size, np.array([0.1, 0.1])), 0.045)
    found = drive(planar, solid, NOISY).findings
    assert found.status == "done" and found.figures["faces"] == 6
    assert np.abs(np.abs(found.shape.vertices[:, :2]) - size[:2]).max() < 0.4e-3


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("cut", [4, 8, 12])
def test_an_edge_that_is_cut_off_is_a_face(cut, noise):
    size = np.array([30.0, 22.0, 50.0])
    ring = [[-1, -1], [1, -1], [1, 1 - cut / size[1]], [1 - cut / size[0], 1], [-1, 1]]
    corners = [[x * size[0], y * size[1], z] for z in (0.0, size[2]) for x, y in ring]
    sides = [[i, (i + 1) % 5, 5 + (i + 1) % 5, 5 + i] for i in range(5)]
    solid = shapes.Polyhedron(1e-3 * np.array(corners), [[4, 3, 2, 1, 0], [5, 6, 7, 8, 9], *sides])
    found = drive(planar, solid, NOISES[noise]).findings
    assert found.status == "done" and found.figures["faces"] == 7, found.reason
    surfaces = [prepare_surface(*one) for one in (solid.mesh(0), found.mesh)]
    assert compare_surfaces(*surfaces).hausdorff < 0.3e-3


def test_rims_and_what_lies_between_touches_are_told():
    solid = posed(shapes.Superquadric(1e-3 * np.array([35, 25, 45]), np.array([0.1, 0.1])), 0.045)
    found = drive(planar, solid).findings
    # its edges lie 1.5 mm inside the faces' intersections, its corners 3.3 mm
    assert 1.2e-3 < found.figures["rim_gap_m"] < 3.4e-3 and "cut or rounded by" in found.reason
    assert 5e-3 < found.figures["farthest_untouched_m"] < 20e-3
    exact = drive(planar, block()).findings
    assert exact.figures["rim_gap_m"] < 1.2e-3 and "rounded" not in exact.reason


def test_every_face_but_the_one_on_which_it_stands_is_touched():
    found = drive(planar, block(), EXACT).findings
    touches = dict(zip([tuple(np.round(p.normal)) for p in found.shape.planes],
                       found.shape.touches, strict=True))  # fmt: skip
    assert touches.pop((0.0, 0.0, -1.0)) == 0
    assert min(touches.values()) >= 5


UNSUITED = {
    "ball": (posed(shapes.Superquadric(np.full(3, 0.035), np.ones(2)), 0.035), "curved"),
    "cylinder": (
        posed(shapes.Superquadric(np.array([0.03, 0.03, 0.045]), np.array([0.1, 1.0])), 0.045),
        "radius of 30 mm",
    ),
    "notched": (
        shapes.Polyhedron(
            1e-3 * np.array([[x, y, z] for z in (0.0, 50.0) for x, y in
                             ((-40, -40), (40, -40), (40, 0), (0, 0), (0, 40), (-40, 40))], float),
            [[5, 4, 3, 2, 1, 0], [6, 7, 8, 9, 10, 11],
             *[[i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i] for i in range(6)]],
        ),
        "not convex",
    ),
}  # fmt: skip


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("name", UNSUITED)
def test_what_is_no_convex_polyhedron_is_refused_with_the_reason(name, noise):
    solid, why = UNSUITED[name]
    found = drive(planar, solid, NOISES[noise]).findings
    assert found.status == "unsuited" and why in found.reason
    assert found.shape is None and found.mesh is None


def test_a_block_on_its_edge_is_not_closed_by_the_platform():
    found = drive(planar, posed(block(), 0.03, 0.35), EXACT).findings
    assert found.status in ("incomplete", "unsuited") and found.mesh is None


def test_nothing_within_reach_is_told():
    far = shapes.PosedShape(block(), np.array([1.0, 0, 0, 0, 0, 0, 1.0]))
    found = drive(planar, far).findings
    assert found.status == "incomplete" and "nothing was touched" in found.reason
