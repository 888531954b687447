"""Normal and curvatures of one touch with their errors, and of shape operators."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core import touch
from palpate.core.arrays import Floats
from palpate.core.shapes import Superquadric
from tests.core.touch.parametric import normal_curvature, shape_operator
from tests.core.touch.touches import DOMED, FLAT, X, Y, above

PITCH = 1e-3
ALL, ALONG_Y = np.ones((16, 16), bool), np.array([0.0, 1.0, 0.0])
BALL = 0.5 * (X**2 + Y**2) / 0.02  # of 20 mm, up to the fourth power


def feel(
    height: Floats, direction: Floats = ALONG_Y, noise: float = 0.0, touched: Any = ALL
) -> touch.Patch:
    return touch.fit_patch(FLAT, height, touched, direction, noise)


def pressed(radii: tuple[float, float], depth: float = 1e-3, dome: float = 0.0) -> Floats:
    """Compression of a pad by a paraboloid with these radii along x and y [m]."""
    gap = 0.5 * (X**2 / radii[0] + Y**2 / radii[1] + dome * (X**2 + Y**2))
    return np.maximum(depth - gap, 0.0)


@pytest.mark.parametrize("seed", range(16))
def test_quartic_graph_has_its_exact_curvatures(seed):
    rng = np.random.default_rng(seed)
    p, q = rng.uniform(-0.5, 0.5, 2)
    r, s, t = rng.uniform(-50.0, 50.0, 3)
    height = p * X + q * Y + 0.5 * (r * X**2 + 2 * s * X * Y + t * Y**2)
    u, v = X / 8e-3, Y / 8e-3
    for i, j in ((3, 0), (2, 1), (1, 2), (0, 3), (4, 0), (2, 2), (1, 3), (0, 4)):
        height = height + 5e-5 * rng.normal() * u**i * v**j
    steps = np.array([1.0, 0.0, p]), np.array([0.0, 1.0, q])
    bends = [np.array([0.0, 0.0, bend]) for bend in (r, s, t)]
    shape = shape_operator(*steps, *bends, np.array([0.0, 0.0, -1.0]))
    (s11, s12, s22), tangents = shape.parts, shape.tangents
    (k2, k1), axes = np.linalg.eigh([[s11, s12], [s12, s22]])
    along = axes[:, 1] @ tangents
    direction = rng.normal(size=3)
    patch = feel(height, direction)
    assert patch.kind == "smooth" and patch.residual < 1e-14
    assert patch.normal == pytest.approx(shape.normal, abs=1e-12)
    assert patch.principal == pytest.approx((k1, k2), rel=1e-8, abs=1e-8)
    assert (patch.gaussian, patch.mean) == pytest.approx((k1 * k2, 0.5 * (k1 + k2)), rel=1e-8)
    assert abs(patch.principal_direction @ along) == pytest.approx(1.0, abs=1e-9)
    assert patch.across == pytest.approx(normal_curvature(shape, direction), rel=1e-8, abs=1e-8)
    assert not patch.umbilic
    assert np.allclose(patch.place, 0.0, atol=1e-12)
    assert feel(height, patch.normal).across == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("pad", [FLAT, DOMED], ids=["flat", "domed"])
@pytest.mark.parametrize(
    ("radius", "error"), [(0.01, 0.03), (0.02, 0.01), (0.03, 0.005), (0.1, 1e-4), (1.0, 1e-6)]
)
def test_ball_has_its_curvature_in_all_directions(radius, error, pad):
    end = touch.guarded_move(
        Superquadric(np.full(3, radius), np.ones(2)), pad, above(radius + 0.01), 0.05, 1e-3
    )
    touched = end.compression > 0.0
    patch = touch.fit_patch(pad, pad.surface(end.compression, touched), touched, ALONG_Y, 0.0)
    assert patch.kind == "smooth" and np.allclose(patch.normal, [0, 0, -1], atol=1e-9)
    # A quartic leaves out the sixth power, which goes with (width / radius)^4.
    assert (*patch.principal, patch.across) == pytest.approx((1 / radius,) * 3, rel=error)
    dome = None if pad.dome == 0.0 else 1.0 / pad.dome
    same = touch.surface_patch(end.compression, PITCH, radius=dome, contact=1e-9)
    assert same.principal == pytest.approx(patch.principal, rel=1e-9)


def test_umbilics_and_planes_have_equal_principal_curvatures():
    for radius in np.geomspace(0.02, 1e6, 30):
        patch = feel(0.5 * (X**2 + Y**2) / radius)
        k1, k2 = patch.principal
        assert 0.0 <= k1 - k2 < 1e-10 / radius + 1e-12 and patch.umbilic
    patch = feel(0.3 * X - 0.4 * Y)
    assert patch.kind == "smooth" and patch.umbilic
    assert patch.principal == pytest.approx((0.0, 0.0), abs=1e-9)
    assert np.allclose(patch.normal * math.sqrt(1.25), [0.3, -0.4, -1.0], atol=1e-12)


@pytest.mark.parametrize("count", [0, 1, 4, 7])
def test_fewer_than_eight_taxels_have_no_jet(count):
    touched = np.zeros((16, 16), bool)
    touched.ravel()[118 : 118 + count] = True
    patch = feel(np.zeros((16, 16)), touched=touched)
    assert patch == touch.Patch("insufficient" if count else "miss")
    assert patch.jet is None and patch.confidence == 0.0 and patch.normal_error == math.pi
    assert patch.normal.tolist() == [0.0, 0.0, -1.0]


def test_eight_or_isolated_taxels_have_normal_without_curvature():
    rows, cols = np.indices((16, 16))
    board = (rows + cols) % 2 == 0
    few = (np.abs(X) < 1.8e-3) & (np.abs(Y) < 1.2e-3)
    assert few.sum() == 8
    for touched in (few, board):
        patch = feel(0.2 * X, touched=touched)
        assert (patch.kind, patch.principal, patch.confidence) == ("insufficient", (0.0, 0.0), 0.0)
        assert patch.jet is not None
        assert np.allclose(patch.normal[:2] / -patch.normal[2], [0.2, 0.0], atol=1e-12)
    assert feel(0.0 * X, touched=board | (rows < 8)).kind == "smooth"  # half lie side by side


def test_confidence_falls_with_the_misfit_and_the_untouched_share():
    rough = BALL + 2e-5 * np.random.default_rng(0).normal(size=X.shape)
    assert feel(BALL).confidence == pytest.approx(1.0)
    assert feel(BALL, touched=X > 0).confidence == pytest.approx(0.5)
    result = feel(rough)
    # Half where the misfit is 0.04 pitches, or 4 deviations of a larger noise.
    assert result.confidence == pytest.approx(1.0 / (1.0 + (result.residual / 40e-6) ** 2))
    assert feel(rough, noise=2e-5).confidence == pytest.approx(
        1.0 / (1.0 + (feel(rough, noise=2e-5).residual / 80e-6) ** 2)
    )


@pytest.mark.parametrize("count", [32, 52, 112])
def test_partial_contact_is_within_5_percent(count):
    height, noise = 0.02 - np.sqrt(0.02**2 - X**2 - Y**2), 1e-5
    touched = np.zeros(256, bool)
    touched[np.argsort((X**2 + Y**2).ravel(), kind="stable")[:count]] = True
    mask = touched.reshape(16, 16)
    exact = feel(np.where(mask, height, 0.0), touched=mask)
    assert exact.principal == pytest.approx((50.0, 50.0), rel=0.04)
    frames = height + noise * np.random.default_rng(5).normal(size=(60, 16, 16))
    found = [feel(frame, noise=noise, touched=mask) for frame in frames]
    assert {one.kind for one in found} == {"smooth"}
    errors = np.array([one.principal for one in found]) / 50.0 - 1.0
    assert np.sqrt(np.mean(np.square(errors))) < 0.05


@pytest.mark.parametrize("seed", range(4))
def test_errors_equal_noise_times_numerical_jacobian(seed):
    # 29 taxels bear a quadric, which is not shrunk: the result is smooth in the heights.
    rng, noise, step = np.random.default_rng(seed), 1e-6, 1e-9
    mask = np.zeros((16, 16), bool)
    mask.flat[np.argsort(((X - 1e-3) ** 2 + Y**2).ravel())[:29]] = True
    p, q, r, s, t = rng.uniform(-0.5, 0.5, 5) * [1, 1, 60, 60, 60]
    height = p * X + q * Y + 0.5 * (r * X**2 + 2 * s * X * Y + t * Y**2)
    direction = rng.normal(size=3)

    def results(frame: Floats) -> Floats:
        patch = feel(frame, direction, noise, mask)
        gauss = [2.0 * patch.mean, patch.gaussian]
        return np.array([*patch.normal, *patch.principal, patch.across, *gauss])

    units = np.zeros((29, 16, 16))
    units[:, mask] = step * np.eye(29)
    slopes = [(results(height + one) - results(height - one)) / (2 * step) for one in units]
    spread = noise * np.linalg.norm(slopes, axis=0)
    patch = feel(height, direction, noise, mask)
    assert patch.normal_error == pytest.approx(np.linalg.norm(spread[:3]), rel=1e-5)
    assert patch.across_error == pytest.approx(spread[5], rel=1e-5)
    s11, s12, s22 = patch.shape.parts
    for row, wanted in (([1.0, 0.0, 1.0], spread[6]), ([s22, -2 * s12, s11], spread[7])):
        assert math.sqrt(row @ patch.shape_covariance @ row) == pytest.approx(wanted, rel=1e-5)
    # Second order counts where the principal curvatures are nearly equal, on the safe side.
    assert np.all(np.array(patch.principal_error) >= spread[3:5] * (1 - 1e-5))
    assert patch.principal_error == pytest.approx(spread[3:5], rel=1e-3)


def test_errors_do_not_depend_on_the_direction_of_a_vanishing_slope():
    # A lopsided contact near an umbilic; the steepest slope chooses the tangents inside.
    mask = (X + 2.0 * Y > 2e-3) & (X < 4e-3) & (Y < 6e-3)
    x, y = X - X[mask].mean(), Y - Y[mask].mean()
    height, result = 0.5 * (31.0 * x**2 + 0.6 * x * y + 30.0 * y**2), []
    for turn in np.linspace(0.0, 3.0, 7):
        slope = 1e-8 * (math.cos(turn) * x + math.sin(turn) * y)
        patch = feel(height + slope, noise=10e-6, touched=mask)
        assert patch.kind == "smooth"
        result.append([*patch.principal_error, patch.across_error, patch.normal_error])
    assert np.allclose(result, result[0], rtol=1e-5, atol=0.0)


@pytest.mark.parametrize("known", [1.0, 0.0], ids=["known noise", "unknown noise"])
@pytest.mark.parametrize(("noise", "apart"), [(20e-6, 45.0), (5e-6, 0.3), (5e-6, 0)])
def test_stated_errors_are_the_scatter_over_frames(noise, apart, known):
    height = 0.1 * X - 0.2 * Y + 0.5 * ((apart - 5) * X**2 + 10 * X * Y - 5 * Y**2)
    if apart < 1.0:  # near an umbilic
        height = 0.5 * ((30 + apart) * X**2 + 30 * Y**2)
    clean = feel(height)
    result = []
    for frame in height + noise * np.random.default_rng(1).normal(size=(100, 16, 16)):
        patch = feel(frame, noise=known * noise)
        result.append(
            [
                np.linalg.norm(np.cross(patch.normal, clean.normal)) / patch.normal_error,
                *np.subtract(patch.principal, clean.principal) / patch.principal_error,
                (patch.across - clean.across) / patch.across_error,
            ]
        )
    spread = np.sqrt(np.mean(np.square(result), axis=0))
    # Shrinking makes them a little smaller or larger than promised.
    assert (spread > 0.6).all() and (spread < 1.5).all()


@pytest.mark.parametrize(("apart", "low", "high"), [(0.0, 0, 5), (20.0, 100, 100)])
def test_principal_direction_needs_difference_beyond_noise(apart, low, high):
    height = 0.5 * ((30 + apart) * X**2 + 30 * Y**2)
    frames = height + 1e-5 * np.random.default_rng(0).normal(size=(100, 16, 16))
    assert low <= sum(not feel(frame, noise=1e-5).umbilic for frame in frames) <= high


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"compression": np.zeros((3, 16))}, r"must be at least 4 by 4, got \(3, 16\)"),
        ({"compression": np.zeros(256)}, r"compression must have shape \(any, any\), got \(256,\)"),
        ({"compression": np.full((8, 8), np.nan)}, "compression must be finite"),
        ({"pitch": 0.0}, "pitch must be positive and finite, got 0.0 m"),
        ({"radius": -1.0}, "radius must be positive"),
        ({"contact": 0.0}, "contact must be positive"),
        ({"noise": -1.0}, "noise must not be negative, got -1.0 m"),
        ({"noise": np.inf}, "noise must not be negative, got inf m"),
        ({"saturation": 0.0}, "saturation must be a fraction above 0 and at most 1, got 0.0"),
        ({"saturation": 1.1}, "saturation must be a fraction above 0 and at most 1, got 1.1"),
        ({"compression": 800.0 * pressed((0.02, 0.02))}, "compression is .* millimetres by"),
        ({"compression": np.full((16, 16), 0.8)}, "compression is .* millimetres by"),
        *[
            ({name: value}, rf"{name} is .* m.*; multiply millimetres by 0\.001")
            for name, value in {
                "pitch": 1.0,
                "thickness": 3.0,
                "radius": 15.0,
                "noise": 0.01,
                "contact": 0.05,
            }.items()
        ],
    ],
)
def test_invalid_images_and_lengths_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        touch.surface_patch(**{"compression": pressed((0.02, 0.02)), "pitch": PITCH, **options})


def test_images_of_another_pad_are_refused():
    with pytest.raises(ValueError, match=r"height must have shape \(16, 16\), got \(8, 8\)"):
        feel(np.zeros((8, 8)))
    small = touch.Pad(rows=3, cols=8, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
    with pytest.raises(ValueError, match="at least 4 by 4 taxels, got 3 by 8"):
        touch.fit_patch(small, np.zeros((3, 8)), np.ones((3, 8), bool), ALONG_Y, 0.0)


def test_arrays_of_any_size_and_pitch_are_fitted():
    patch = touch.surface_patch(pressed((0.04, 0.02)), PITCH)
    assert patch.kind == "smooth" and patch.principal == pytest.approx((50.0, 25.0), rel=1e-6)
    assert patch.across == pytest.approx(25.0, rel=1e-6)  # along the rows
    assert abs(patch.principal_direction[1]) == pytest.approx(1.0, abs=1e-9)
    domed = touch.surface_patch(pressed((0.02, 0.02), dome=1 / 0.015), PITCH, radius=0.015)
    assert domed.principal == pytest.approx((50.0, 50.0), rel=1e-6)
    small = replace(FLAT, rows=8, cols=12, pitch=2e-3)
    x, y = small.grid()
    patch = touch.surface_patch(2e-3 - 0.5 * (10 * x**2 + 5 * y**2), 2e-3)
    assert patch.principal == pytest.approx((10.0, 5.0), rel=1e-6)
    assert touch.surface_patch(np.full((4, 4), 1e-3), PITCH).kind == "smooth"  # the smallest
    assert touch.surface_patch(np.zeros((16, 16)), PITCH).kind == "miss"
    assert touch.surface_patch(pressed((0.02, 0.02), 4e-4), PITCH, contact=5e-4).kind == "miss"


# Shape operators of graphs, and the principal curvatures of any


@pytest.mark.parametrize("steep", [1e3, 1e6, 1e12, 1e160])
def test_wall_along_the_viewing_direction_is_finite(steep):
    # A cylinder of radius 2 about the z axis, seen almost along it.
    around = math.hypot(1.0, 1.0 / steep)  # z = steep (x - y^2 / 4) up to second order
    wall = touch.graph_shape_operator((steep, 0.0), (0.0, 0.0, -0.5 * steep))
    k1, k2, *_ = touch.principal_curvatures(wall)
    assert (k1, k2) == pytest.approx((0.0, -0.5 / around), abs=1e-12)
    for slopes in ((steep, 0.0), (0.0, -steep), (steep, steep)):
        shape = touch.graph_shape_operator(slopes, (1.0, 2.0, 3.0))
        assert np.isfinite([*touch.principal_curvatures(shape)[:2], *shape.normal]).all()
        assert np.linalg.norm(shape.normal) == pytest.approx(1.0)
