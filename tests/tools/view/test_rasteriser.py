from __future__ import annotations

import numpy as np
import pytest

from palpate.tools.view.rasteriser import FINER, Camera, Canvas, camera_on

SQUARE = np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])  # Seen from the x axis
HALVES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
RED, GREEN, WHITE = (255, 0, 0), (0, 255, 0), [255, 255, 255]
FRONT = Camera(np.zeros(3), 10.0, azimuth=0.0, elevation=0.0)


def tetrahedron(size: float):
    """A closed mesh, counter-clockwise from outside."""
    vertices = size * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return vertices, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32)


def test_a_square_covers_the_pixels_that_perspective_says():
    canvas = Canvas(200, 100, FRONT)
    canvas.draw_mesh(SQUARE, HALVES, np.array(RED), lit=False)
    red = (canvas.image() == RED).all(axis=2)
    side = 100 / (2.0 * 10.0 * np.tan(np.radians(14.0))) * 2.0  # pixels of 2 m at 10 m
    assert red.sum(axis=1).max() == pytest.approx(side, abs=1.0)
    assert red.sum(axis=0).max() == pytest.approx(side, abs=1.0)
    rows, columns = np.nonzero(red)
    assert (rows.mean(), columns.mean()) == pytest.approx((49.5, 99.5), abs=0.6)


def test_axes_look_where_the_camera_says():
    right, up, back = Camera(np.zeros(3), 1.0, azimuth=90.0, elevation=0.0).axes()
    assert back == pytest.approx([0, 1, 0])
    assert up == pytest.approx([0, 0, 1])
    assert right == pytest.approx([-1, 0, 0])
    for azimuth, elevation in ((20.0, 50.0), (-170.0, -80.0)):
        axes = Camera(np.zeros(3), 1.0, azimuth=azimuth, elevation=elevation).axes()
        assert axes @ axes.T == pytest.approx(np.eye(3))
        assert np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_surface_hides_the_farther_whatever_comes_first(order):
    canvas = Canvas(60, 60, FRONT)
    layers = [(SQUARE, RED), (SQUARE + [-1.0, 0, 0], GREEN)]
    for one in order:
        canvas.draw_mesh(layers[one][0], HALVES, np.array(layers[one][1]), lit=False)
    assert canvas.image()[30, 30].tolist() == list(RED)


def test_two_squares_that_cross_meet_in_the_middle():
    canvas = Canvas(80, 80, FRONT)
    turned = SQUARE @ np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]]).T
    canvas.draw_mesh(SQUARE, HALVES, np.array(RED), lit=False)
    canvas.draw_mesh(turned, HALVES, np.array(GREEN), lit=False)
    left, right = canvas.image()[40, [36, 44]]  # the turned one comes nearer at the right
    assert (left.tolist(), right.tolist()) == (list(RED), list(GREEN))


def test_colours_run_evenly_between_corners():
    canvas = Canvas(200, 200, Camera(np.zeros(3), 1000.0, 0.0, 0.0, opening=0.12))
    colours = np.zeros((4, 3))
    colours[[1, 2], 0] = 200.0
    canvas.draw_mesh(SQUARE, HALVES, colours, lit=False)
    row = canvas.image()[100, :, 0].astype(float)
    inside = np.flatnonzero(canvas.image()[100, :, 1] == 0)
    shares = (inside - inside[0]) / (inside[-1] - inside[0])
    assert np.abs(row[inside] - 200.0 * shares).max() < 3.0


def test_a_closed_mesh_shows_the_same_whether_its_back_is_drawn_or_not():
    vertices, faces = tetrahedron(1.0)
    pictures = []
    for kept in (faces, np.concatenate([faces, faces[:1]])):  # an edge walked twice: not closed
        canvas = Canvas(90, 90, camera_on(vertices.min(axis=0), vertices.max(axis=0)))
        canvas.draw_mesh(vertices, kept, np.array([200, 100, 50]), lit=False)
        pictures.append(canvas.image())
    assert (pictures[0] == pictures[1]).all()
    assert (pictures[0] != 255).any()


def test_a_lit_face_is_brighter_towards_the_light():
    canvas = Canvas(60, 60, FRONT)
    turned = SQUARE @ np.array([[0.2, -0.98, 0], [0.98, 0.2, 0], [0, 0, 1]]).T
    canvas.draw_mesh(SQUARE, HALVES, np.array([200, 200, 200]))
    before = canvas.image()[30, 30, 0]
    canvas = Canvas(60, 60, FRONT)
    canvas.draw_mesh(turned, HALVES, np.array([200, 200, 200]))
    assert canvas.image()[30, 30, 0] < before


def test_points_and_lines_on_a_surface_are_seen_and_those_behind_it_are_not():
    for place, seen in (([0.0, 0, 0], True), ([-0.5, 0, 0], False)):
        canvas = Canvas(60, 60, FRONT)
        canvas.draw_mesh(SQUARE, HALVES, np.array(RED), lit=False)
        canvas.draw_points(np.array([place]), np.array(GREEN), 2.0)
        assert (canvas.image()[30, 30] == GREEN).all() == seen
        line = np.array([place, place]) + [[0, -0.5, 0.3], [0, 0.5, 0.3]]
        canvas.draw_line(line, np.array(GREEN), 2.0)
        assert bool((canvas.image()[24:28] == GREEN).all(axis=2).any()) == seen


def test_a_closed_line_has_one_side_more():
    corners = SQUARE * 0.5
    counts = []
    for closed in (False, True):
        canvas = Canvas(80, 80, FRONT)
        canvas.draw_line(corners, np.array(RED), 1.0, closed=closed)
        counts.append(int((canvas.image() != 255).any(axis=2).sum()))
    assert counts[1] == pytest.approx(counts[0] * 4 / 3, rel=0.1)


def test_what_lies_behind_the_eye_or_beside_the_picture_is_left_out():
    canvas = Canvas(40, 40, FRONT)
    canvas.draw_mesh(SQUARE + [20.0, 0, 0], HALVES, np.array(RED), lit=False)
    canvas.draw_mesh(SQUARE + [0.0, 50, 0], HALVES, np.array(RED), lit=False)
    canvas.draw_points(np.array([[20.0, 0, 0], [0, 30.0, 0]]), np.array(RED), 3.0)
    canvas.draw_line(np.zeros((1, 3)), np.array(RED), 2.0)
    assert (canvas.image() == 255).all()


def test_a_layer_is_mixed_in_where_it_is_nearer():
    base, layer = Canvas(60, 60, FRONT), Canvas(60, 60, FRONT)
    base.draw_mesh(SQUARE, HALVES, np.array(RED), lit=False)
    layer.draw_mesh(SQUARE * 0.5 + [1.0, 0, 0], HALVES, np.array(GREEN), lit=False)
    base.blend(layer, 0.5)
    assert base.image()[30, 30].tolist() == [128, 128, 0]
    assert base.image()[18, 18].tolist() == list(RED)


def test_a_camera_on_a_box_has_all_of_it_in_the_picture():
    low, high = np.array([0.0, 0, 0]), np.array([0.3, 0.1, 0.5])
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    for azimuth in range(0, 360, 30):
        for elevation in (-60.0, 0.0, 45.0):
            camera = camera_on(low, high, azimuth=float(azimuth), elevation=elevation)
            canvas = Canvas(100, 100, camera)
            flat = canvas.project(corners)[:, :2]
            assert flat.min() >= 0.0
            assert flat.max() <= 100 * FINER
