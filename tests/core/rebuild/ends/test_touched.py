"""Ends determined by touches: heights, oblique planes, leaning tips, reliefs of faces."""

from collections.abc import Sequence

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import rotations_from_vectors
from palpate.core.rebuild import ends
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.core.rebuild.ends import End, Shear, end_height, levelled, shear_between
from palpate.core.rebuild.side import fit_axis_curve, fit_radial_spline
from palpate.core.rebuild.surface import EndPatch, close_surface, sampled_patch
from tests.core.rebuild import objects
from tests.core.rebuild.objects import assert_derivatives, at_height, circle, contacts, polar, rms

POSE = 1e-4
PLACES = [(0.0, 0.0), (0.012, 0.0), (-0.012, 0.0), (0.0, 0.012), (0.0, -0.012)]
SLOPES = np.array([0.1, -0.05])
NONE = np.zeros(2)


def touch(
    place: Sequence[float],
    height: float,
    slopes: Floats = NONE,
    sign: float = 1.0,
    bend: float = 0.0,
) -> ContactPoints:
    """49 taxels of a plane of slopes, or of a dome of a curvature; its height is on the axis."""
    grid = np.stack(np.meshgrid(*2 * (1e-3 * np.arange(-3, 4),)), axis=-1).reshape(-1, 2)
    at = grid + place
    leans = slopes - sign * bend * at
    normals = sign * np.column_stack([-leans, np.ones(49)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    heights = height + at @ slopes - 0.5 * sign * bend * (at**2).sum(axis=1)
    return contacts(np.column_stack([at, heights]), normals)


def sides(high: float = 0.08, radius: float = 0.02) -> ContactPoints:
    """A spiral of an upright column from height 0 on."""
    out = np.tile(circle(40), (10, 1))
    return contacts(np.column_stack([radius * out, np.linspace(0.0, high, 400)]), at_height(out, 0))


def column(slopes: Floats = NONE, pose: float = 0.0, noise: float = 0.0) -> ContactPoints:
    """A column of 80 mm touched beside and on its top."""
    rng = np.random.default_rng(0)
    parts = [touch(place, 0.08 + rng.normal(0.0, pose), slopes) for place in PLACES]
    parts = [one._replace(points=one.points + rng.normal(0.0, noise, (49, 3))) for one in parts]
    return stack_points([sides(), *parts])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("heights", "pose", "known", "expected"),
    [
        ([0.1, 0.1002, 0.0998, 0.0996, 0.097], 1.5e-4, None, 0.0999),  # those of one height
        ([0.1, 0.0999], None, 0.0999, 0.1),  # without noise the farthest is true
        ([0.1, 0.0999], None, 0.1001, 0.1001),
        ([0.097], 1e-4, 0.1, 0.1),  # an end known to lie farther stays there
        ([0.08], 1e-4, None, None),  # short of the last contour
        ([0.08], 1e-4, 0.1, 0.1),
    ],
)
def test_end_height_is_mean_of_highest_touches(heights, pose, known, expected, sign):
    # Touches of three taxels each, two a little short of the end.
    levels = sign * (np.array(heights)[:, None] - [0.0, 5e-4, 1e-3]).ravel()
    points, normals = np.outer(levels, [0, 0, 1]), np.tile([0.0, 0.0, sign], (len(levels), 1))
    touched = contacts(points, normals, np.arange(len(levels)) // 3)
    known_height = None if known is None else sign * known
    height = end_height(touched, sign * 0.09, sign, pose, known_height)
    assert height == (None if expected is None else pytest.approx(sign * expected))
    assert ends.on_end(touched, sign * 0.09, sign).any() == (max(heights) > 0.09)
    for blind in (touched._replace(normals=None), touched._replace(normals=-normals)):
        assert not ends.on_end(blind, sign * 0.09, sign).any()
        assert end_height(blind, sign * 0.09, sign, pose, known_height) == known_height


def domed(seed: int, bend: float) -> ContactPoints:
    """Touches of a dome of 100 mm height, each off along the axis."""
    shifts = POSE * np.random.default_rng(max(seed, 0)).normal(size=5) * (seed >= 0)
    low = contacts(np.array([[0.08, 0.0, -0.1]]), np.array([[1.0, 0.0, 0.0]]))
    pairs = zip(PLACES, shifts, strict=True)
    return stack_points([*(touch(at, 0.1 + off, NONE, 1.0, bend) for at, off in pairs), low])


@pytest.mark.parametrize("bend", [1 / 0.2, 1 / 0.6])
def test_pose_errors_of_dome_average_out(bend):
    heights = [end_height(domed(seed, bend), 0.09, 1.0, POSE, None) for seed in range(80)]
    errors = np.array(heights, np.float64) - 0.1
    assert abs(errors.mean()) < 0.2 * POSE
    exact = end_height(domed(-1, bend), 0.09, 1.0, 1e-6, None)
    assert exact == pytest.approx(0.1, abs=1e-5)
    assert errors.std() < 0.6 * POSE  # the highest touch has 0.67, and a bias of 1.2


@pytest.mark.parametrize(("pose", "noise"), [(0.0, 0.0), (1e-4, 0.0), (0.0, 1e-5)])
def test_shear_has_slopes_of_oblique_top(pose, noise):
    shear = shear_between(column(SLOPES, pose, noise), NONE, (-1e-3, None))
    assert shear.steepness(-1e-3) == pytest.approx(0.0, abs=1e-12)
    top = shear.slopes + 0.08 * shear.change
    assert top == pytest.approx(SLOPES, abs=1e-12 + 200.0 * noise + 0.05 * pose / 0.08)
    bottom = [touch(place, 0.0, SLOPES, -1.0) for place in PLACES]
    whole = stack_points([column(SLOPES, pose, noise), *bottom])
    alike = shear_between(whole, NONE, (None, None))
    assert alike.change == pytest.approx(NONE, abs=1e-12 + 3e3 * noise + pose)
    assert ends.is_known_untouched(column(SLOPES), -1.0, 0.0)
    for sign, known, is_untouched in ((1.0, 0.081, True), (1.0, 0.08, False), (-1.0, None, False)):
        assert ends.is_known_untouched(column(), sign, known) == is_untouched
    slight = shear_between(column(0.03 * SLOPES, noise=noise), NONE, (0.0, None))
    assert slight is not None  # taxels of little noise resolve a small slope
    if noise == pose == 0.0:
        level = shear.levelled_contacts(column(SLOPES)).points[400:, 2]
        assert np.ptp(level) < 1e-12


@pytest.mark.parametrize(
    "more",
    [
        stack_points([touch((0.01, 0.01), 0.04)] * 6),  # a ledge below the top
        touch((0.016, 0.0), 0.0784, SLOPES, 1.0, 40.0),  # across an edge
        contacts(np.array([[0.02, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])),  # on the platform
        contacts(np.array([[0.02, 0.0, -1e-5]]), np.array([[1.0, 0.0, 0.0]])),
    ],
)
def test_other_touches_do_not_change_plane_of_top(more):
    shear = shear_between(stack_points([column(SLOPES), more]), NONE, (0.0, None))
    assert shear.slopes + 0.08 * shear.change == pytest.approx(SLOPES, abs=1e-3)
    assert shear.steepness(0.0) == pytest.approx(0.0, abs=1e-12)


FLANKS = [
    touch((sign * away, 0.004 * k), 0.08, np.array([-0.3 * sign, 0.0]))
    for sign in (1.0, -1.0)
    for k, away in enumerate((0.006, 0.01, 0.014))
]


def leaning() -> ContactPoints:
    """A column that leans as a whole, by more than a slicing axis is off."""
    bottom = [touch(place, 0.0, NONE, -1.0) for place in PLACES]
    turn = rotations_from_vectors(np.array([[0.0, np.arctan(0.2), 0.0]]))[0]
    whole = stack_points([column(), *bottom])
    return whole._replace(points=whole.points @ turn.T, normals=np.asarray(whole.normals) @ turn.T)


@pytest.mark.parametrize(
    "touched",
    [
        column(),
        column(noise=1e-5),
        stack_points([sides(), *(touch(place, 0.08, NONE, 1.0, 25.0) for place in PLACES)]),
        stack_points(
            [sides(), touch(PLACES[0], 0.08, SLOPES)]
            + [touch(place, 0.08, SLOPES, 1.0, 7.0) for place in PLACES[1:]]
        ),
        stack_points([sides(), *FLANKS]),
        stack_points([column(SLOPES), sides(0.09, 0.004)]),
        leaning(),
    ],
    ids=["level", "noisy", "dome", "dome, flat in one touch", "gable", "knob", "leaning"],
)
def test_no_shear_without_oblique_plane(touched):
    known = (None, None) if touched.points[:, 2].min() < -1e-3 else (0.0, None)
    assert shear_between(touched, NONE, known) is None
    for scale in (1e-6, 1e6):
        there = touched._replace(points=scale * touched.points)
        assert shear_between(there, NONE, known) is None


SHEAR = Shear(np.array([0.01, -0.02]), np.array([0.2, -0.1]), np.array([1.5, 0.8]))


def ball_at(v: Floats, turns: Floats) -> Floats:
    """A grid of a ball of 30 mm radius."""
    rings = zip(0.03 * np.sin(np.pi * v), 0.05 - 0.03 * np.cos(np.pi * v), strict=True)
    return np.stack([at_height(polar(turns, radius), z) for radius, z in rings])


def test_shear_is_inverted_and_carries_derivatives_and_normals():
    rng = np.random.default_rng(0)
    v, turns = rng.uniform(0.1, 0.9, 40), rng.uniform(0.0, 1.0, 40)
    ball = close_surface(sampled_patch(ball_at)).pieces[0]
    points = ball.at(v, turns)
    assert SHEAR.sheared(SHEAR.levelled(points)) == pytest.approx(points, abs=1e-15)
    assert SHEAR.levelled(SHEAR.sheared(points)) == pytest.approx(points, abs=1e-15)
    assert np.array_equal(SHEAR.sheared(points)[:, :2], points[:, :2])
    level = at_height(rng.normal(0.0, 0.02, (30, 2)), 0.04)
    rows = np.column_stack([np.ones(30), level[:, :2]])
    plane, left = np.linalg.lstsq(rows, SHEAR.sheared(level)[:, 2], rcond=None)[:2]
    assert left == pytest.approx(0.0, abs=1e-28)
    assert plane[1:] == pytest.approx(SHEAR.slopes + 0.04 * SHEAR.change)
    assert np.hypot(*plane[1:]) == pytest.approx(SHEAR.steepness(0.04))

    def carried(v: Floats, turns: Floats, by: tuple[int, int]) -> Floats:
        return SHEAR.carried(lambda order: ball.at(v, turns, order), by)

    assert_derivatives(carried, v, turns, 1e-3)
    normals = np.cross(carried(v, turns, (0, 1)), carried(v, turns, (1, 0)))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    level = levelled(SHEAR, contacts(SHEAR.sheared(points), normals))
    assert level.points == pytest.approx(points, abs=1e-15)
    assert np.asarray(level.normals) == pytest.approx((points - [0, 0, 0.05]) / 0.03, abs=1e-4)
    blind = contacts(points, None)
    assert levelled(None, blind) is blind
    assert levelled(SHEAR, blind).normals is None


@pytest.mark.parametrize("lean", [(-0.005, 0.003), (0.0, 0.0)])
def test_middle_of_round_end_follows_touched_lean(lean):
    """A column of 30 mm radius that ends in half an ellipsoid, sheared by a lean."""
    count = 9000
    out, rise = polar(np.arange(count) * 0.618034, 1.0), (np.arange(count) + 0.5) / count * 3 - 2
    ratio, ahead = np.sqrt(1.0 - np.maximum(rise, 0.0) ** 2), np.maximum(rise, 0.0)
    level = 2.0 * ratio[:, None] * out / 0.03
    upward = np.where(rise > 0.0, (2.0 * ahead - level @ lean) / 0.03, 0.0)
    normals = np.column_stack([level, upward])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    place = np.array([0.1, -0.2])
    plane = place + 0.03 * ratio[:, None] * out + ahead[:, None] * lean
    touched = contacts(np.column_stack([plane, 0.06 + 0.03 * rise]), normals)
    axis = fit_axis_curve(np.array([0.0, 0.06]), np.tile(place, (2, 1)))
    spline = fit_radial_spline(touched, axis, 0.0, 0.09)
    turns = np.arange(48) / 48
    end = ends.end_from_contacts(touched, spline, turns, 0.062, -0.06, 0.09, 1e-6)
    assert (end.height, end.pointed, end.round) == (0.09, True, False)
    assert end.middle - place == pytest.approx(lean, abs=0.6e-3)
    free = ends.end_from_contacts(touched, spline, turns, 0.062, -0.06, None, 1e-6)
    assert free.height >= 0.062


RADIUS, RIM, HEIGHT = 0.03, 0.058, 0.06
ROW = RADIUS * circle(96)
BULGE = np.array([1e-3, 0.0, -1.5, 0.5])  # Height in the middle [m], and curvatures [1/m]
INSIDE = (np.sqrt((np.arange(9) + 0.5) / 9)[:, None, None] * ROW[::4]).reshape(-1, 2)


def face(plane: Floats, bulge: Floats = BULGE) -> Floats:
    x, y = plane.T
    return np.asarray(bulge[0] + bulge[1] * x + bulge[2] * x**2 + bulge[3] * y**2)


def pads(seed: int, pose: float = POSE, count: int = 10, bulge: Floats = BULGE) -> ContactPoints:
    """Touches of 12 mm width on the face, each off by its pose."""
    rng = np.random.default_rng(seed)
    azimuth, away = 2 * np.pi * rng.random(count), 0.023 * np.sqrt(rng.random(count))
    middles = np.column_stack([away * np.cos(azimuth), away * np.sin(azimuth)])
    grid = np.stack(np.meshgrid(*[np.linspace(-6e-3, 6e-3, 9)] * 2), axis=-1).reshape(-1, 2)
    plane, number = (middles[:, None] + grid).reshape(-1, 2), np.repeat(np.arange(count), 81)
    z = HEIGHT + face(plane, bulge) + pose * rng.normal(size=count)[number]
    points = np.column_stack([plane, z + 0.1 * pose * rng.normal(size=len(z))])
    on = np.hypot(*plane.T) < RADIUS
    return contacts(points[on], np.tile([0.0, 0.0, 1.0], (on.sum(), 1)), number[on])


def level_ends() -> tuple[End, End]:
    heights = np.linspace(0.0, RIM, 9)
    return ends.close_ends(heights, np.repeat(ROW[None], 9, axis=0), bottom=0.0, top=HEIGHT)


def relieved(touched: ContactPoints, pose: float | None = POSE) -> End:
    return ends.with_relief(level_ends()[1], touched, ROW, pose)


def test_bulging_face_is_height_field_with_true_error():
    squares = []
    for seed in range(12):
        relief = relieved(pads(seed, count=6)).relief
        squares.append([np.mean((relief.at(INSIDE) - face(INSIDE)) ** 2), relief.deviation**2])
        if seed < 3:
            exact = relieved(pads(seed, 0.0), None).relief
            assert rms(exact.at(INSIDE) - face(INSIDE)) < 1e-5
    error, stated = np.sqrt(np.mean(squares, axis=0))
    assert 0.5 * stated < error < 1.5 * stated
    assert error < 2.0 * POSE


def test_too_few_touches_determine_no_relief():
    flat = np.zeros(4)
    for seed in range(8):
        assert relieved(pads(seed, bulge=flat)).relief is None
        few = pads(seed, count=4)
        nth = np.concatenate([np.arange((few.touch == one).sum()) for one in range(4)])
        for taxels in (3, 4, 7):
            assert relieved(objects.only(few, nth < taxels)).relief is None
        half = pads(seed, count=5)
        kept = objects.only(half, half.points[:, 0] < -6e-3)
        relief = relieved(kept, None).relief  # nowhere far above what was touched
        if relief is not None:
            rise = np.abs(relief.at(kept.points[:, :2])).max()
            assert np.abs(relief.at(0.95 * ROW)).max() <= 2.0 * rise
    many = pads(0, count=40)
    beside = np.hypot(*many.points[:, :2].T) > 0.8 * RADIUS
    assert relieved(objects.only(many, beside)).relief is None


def test_relief_is_part_of_surface_and_its_derivatives():
    def column_at(v: Floats, turns: Floats) -> Floats:
        return np.stack([at_height(RADIUS * polar(turns, 1.0), RIM * one) for one in v])

    surface = close_surface(sampled_patch(column_at), level_ends()[0], relieved(pads(0)))
    pieces = [one for one in surface.pieces if isinstance(one, EndPatch) and one.upper]
    v, turns = np.array([0.2, 0.5, 0.9]), np.array([0.1, 0.45, 0.8])
    for piece in pieces:
        assert_derivatives(piece.at, v, turns, 1e-4, 1.0, piece.on_grid)
    middle = pieces[-1].at(np.ones(1), np.zeros(1))[0]  # at the face's height
    assert middle[2] == pytest.approx(HEIGHT + BULGE[0], abs=2.0 * POSE)
    assert pieces[0].at(np.zeros(1), np.zeros(1))[0, 2] == pytest.approx(RIM)  # unchanged
