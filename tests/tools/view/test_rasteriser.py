"""Pictures drawn without a screen: perspective, occlusion, colours, light."""

import numpy as np
import pytest

from palpate.tools.view.rasteriser import FINER, Camera, Canvas, camera_on

SQUARE = np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])  # seen from the x axis
HALVES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
RED, GREEN = np.array([255, 0, 0]), np.array([0, 255, 0])
FRONT = Camera(np.zeros(3), 10.0, azimuth=0.0, elevation=0.0)


def drawn(*layers, size=(60, 60), camera=FRONT, lit=False):
    """A picture of squares, each with its colours."""
    canvas = Canvas(*size, camera)
    for vertices, colours in layers:
        canvas.draw_mesh(vertices, HALVES, colours, lit=lit)
    return canvas.image()


def turned(c, s):
    return SQUARE @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]).T


def test_square_covers_the_pixels_of_its_perspective():
    red = (drawn((SQUARE, RED), size=(200, 100)) == RED).all(axis=2)
    side = 100 / (2.0 * 10.0 * np.tan(np.radians(14.0))) * 2.0  # pixels of 2 m at 10 m
    assert red.sum(axis=1).max() == pytest.approx(side, abs=1.0)
    assert red.sum(axis=0).max() == pytest.approx(side, abs=1.0)
    rows, columns = np.nonzero(red)
    assert (rows.mean(), columns.mean()) == pytest.approx((49.5, 99.5), abs=0.6)


def test_camera_axes_are_a_right_handed_frame():
    axes = Camera(np.zeros(3), 1.0, azimuth=90.0, elevation=0.0).axes()
    assert axes == pytest.approx(np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0]]))  # right, up, back
    for azimuth, elevation in ((20.0, 50.0), (-170.0, -80.0)):
        axes = Camera(np.zeros(3), 1.0, azimuth=azimuth, elevation=elevation).axes()
        assert axes @ axes.T == pytest.approx(np.eye(3)) and np.linalg.det(axes) > 0.0


@pytest.mark.parametrize("order", [1, -1])
def test_nearer_surface_hides_the_farther_one(order):
    layers = [(SQUARE, RED), (SQUARE + [-1.0, 0, 0], GREEN)][::order]
    assert (drawn(*layers)[30, 30] == RED).all()
    picture = drawn(*[(SQUARE, RED), (turned(0.8, 0.6), GREEN)][::order], size=(80, 80))
    # Two squares that cross meet in the middle; the turned one comes nearer at the right.
    assert (picture[40, 36] == RED).all() and (picture[40, 44] == GREEN).all()


def test_colours_run_evenly_between_corners():
    colours = np.zeros((4, 3))
    colours[[1, 2], 0] = 200.0
    far = Camera(np.zeros(3), 1000.0, 0.0, 0.0, opening=0.12)
    row = drawn((SQUARE, colours), size=(200, 200), camera=far)[100].astype(float)
    inside = np.flatnonzero(row[:, 1] == 0)
    shares = (inside - inside[0]) / (inside[-1] - inside[0])
    assert np.abs(row[inside, 0] - 200.0 * shares).max() < 3.0


def test_back_faces_of_a_closed_mesh_change_nothing():
    vertices = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32)
    pictures = []
    for kept in (faces, np.concatenate([faces, faces[:1]])):  # an edge walked twice: not closed
        canvas = Canvas(90, 90, camera_on(vertices.min(axis=0), vertices.max(axis=0)))
        canvas.draw_mesh(vertices, kept, np.array([200, 100, 50]), lit=False)
        pictures.append(canvas.image())
    assert (pictures[0] == pictures[1]).all() and (pictures[0] != 255).any()


def test_lit_face_is_brighter_towards_the_light():
    grey = np.array([200, 200, 200])
    front, side = (drawn((one, grey), lit=True)[30, 30, 0] for one in (SQUARE, turned(0.2, -0.98)))
    assert side < front


@pytest.mark.parametrize(("depth", "seen"), [(0.0, True), (-0.5, False)])
def test_points_and_lines_are_hidden_behind_surfaces(depth, seen):
    place = np.array([[depth, 0.0, 0.0]])
    canvas = Canvas(60, 60, FRONT)
    canvas.draw_mesh(SQUARE, HALVES, RED, lit=False)
    canvas.draw_points(place, GREEN, 2.0)
    assert (canvas.image()[30, 30] == GREEN).all() == seen
    canvas.draw_line(place + [[0, -0.5, 0.3], [0, 0.5, 0.3]], GREEN, 2.0)
    assert bool((canvas.image()[24:28] == GREEN).all(axis=2).any()) == seen


def test_closed_line_has_one_side_more():
    counts = []
    for closed in (False, True):
        canvas = Canvas(80, 80, FRONT)
        canvas.draw_line(SQUARE * 0.5, RED, 1.0, closed=closed)
        counts.append(int((canvas.image() != 255).any(axis=2).sum()))
    assert counts[1] == pytest.approx(counts[0] * 4 / 3, rel=0.1)


def test_what_lies_outside_the_view_is_left_out():
    canvas = Canvas(40, 40, FRONT)
    for away in ([20.0, 0, 0], [0.0, 50, 0]):  # behind the eye, and beside the picture
        canvas.draw_mesh(SQUARE + away, HALVES, RED, lit=False)
        canvas.draw_points(np.array([away]), RED, 3.0)
    canvas.draw_line(np.zeros((1, 3)), RED, 2.0)
    assert (canvas.image() == 255).all()


def test_layer_is_blended_where_it_is_nearer():
    base, layer = Canvas(60, 60, FRONT), Canvas(60, 60, FRONT)
    base.draw_mesh(SQUARE, HALVES, RED, lit=False)
    layer.draw_mesh(SQUARE * 0.5 + [1.0, 0, 0], HALVES, GREEN, lit=False)
    base.blend(layer, 0.5)
    assert base.image()[30, 30].tolist() == [128, 128, 0]
    assert (base.image()[18, 18] == RED).all()


def test_camera_on_a_box_sees_all_of_it():
    low, high = np.array([0.0, 0, 0]), np.array([0.3, 0.1, 0.5])
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    for azimuth in range(0, 360, 30):
        for elevation in (-60.0, 0.0, 45.0):
            camera = camera_on(low, high, azimuth=float(azimuth), elevation=elevation)
            flat = Canvas(100, 100, camera).project(corners)[:, :2]
            assert flat.min() >= 0.0 and flat.max() <= 100 * FINER
