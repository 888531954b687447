import math

import numpy as np
import pytest
from scipy.optimize import nnls

from palpate.core.touch.effects import rubber
from palpate.core.touch.effects.rubber import HalfSpace

RADIUS, DEPTH = 0.03, 1e-3
STIFFNESS = 0.5e6 / (1.0 - 0.49**2)  # E / (1 - nu^2), N/m2


def paraboloid(finger, radius=RADIUS, depth=DEPTH):
    x, y = finger.pad.grid()
    return depth - (x * x + y * y) / (2 * radius)


def solved(finger, make_touch, indentation):
    springs = np.maximum(indentation, 0.0)
    touch = make_touch(field=indentation, compression=springs, pressure=2e8 * springs)
    HalfSpace().prepare(finger).apply(touch, None)
    return touch


def displacement(finger, pressure, fine=12):
    """Displacement of each taxel's middle, by point loads on a fine grid (Boussinesq)."""
    pitch = finger.pad.pitch
    parts = ((np.arange(fine) + 0.5) / fine - 0.5) * pitch
    x, y = finger.pad.grid()
    found = np.zeros_like(pressure)
    for i, j in zip(*pressure.nonzero(), strict=True):
        dx = x[..., None, None] - x[i, j] - parts
        dy = y[..., None, None] - y[i, j] - parts[:, None]
        mean_inverse = (1.0 / np.hypot(dx, dy)).mean(axis=(2, 3))
        mean_inverse[i, j] = 4.0 * math.asinh(1.0) / pitch
        found += pressure[i, j] * pitch**2 * mean_inverse / (math.pi * STIFFNESS)
    return found


def test_a_ball_makes_the_contact_of_hertz(make_finger, make_touch):
    finger = make_finger()
    touch = solved(finger, make_touch, paraboloid(finger))
    radius = math.sqrt(RADIUS * DEPTH)
    force = 4 / 3 * STIFFNESS * math.sqrt(RADIUS) * DEPTH**1.5
    peak = 3 * force / (2 * math.pi * radius**2)
    x, y = finger.pad.grid()
    away = np.hypot(x, y)
    assert touch.pressure.sum() * 1e-6 == pytest.approx(force, rel=0.01)
    area = (touch.pressure > 0.0).sum() * 1e-6
    assert math.sqrt(area / math.pi) == pytest.approx(radius, rel=0.02)
    # A taxel's pressure is that of its square; away from the rim it is that of its middle.
    within = away < 0.8 * radius
    expected = peak * np.sqrt(1 - (away[within] / radius) ** 2)
    assert np.allclose(touch.pressure[within], expected, rtol=0.03)
    # Outside the contact: Johnson, 1985, (3.42a).
    outside = away > 1.2 * radius
    r = away[outside]
    free = (2 * radius**2 - r**2) * np.arcsin(radius / r) + r**2 * (radius / r) * np.sqrt(
        1 - (radius / r) ** 2
    )
    assert np.allclose(touch.compression[outside], free / (math.pi * RADIUS), rtol=0.01)


def test_the_error_of_the_force_falls_with_the_pitch(make_finger, make_touch):
    force = 4 / 3 * STIFFNESS * math.sqrt(RADIUS) * DEPTH**1.5
    errors = []
    for count, pitch in ((8, 2e-3), (16, 1e-3), (32, 0.5e-3)):
        finger = make_finger(rows=count, cols=count, pitch=pitch)
        touch = solved(finger, make_touch, paraboloid(finger))
        errors.append(abs(touch.pressure.sum() * pitch**2 / force - 1.0))
    assert errors[0] < 0.05
    assert errors[1] < 0.01
    assert errors[2] < 0.003


def shapes(finger):
    x, y = finger.pad.grid()
    rough = np.random.default_rng(1)
    hole = np.where(np.hypot(x - 3e-3, y) < 2e-3, -np.inf, 0.8e-3)
    return [
        paraboloid(finger),
        paraboloid(finger, 0.004, 0.5e-3),
        np.full_like(x, 1e-3),
        1e-3 + 0.2 * x + 0.1 * y,
        1e-3 - 0.4 * np.maximum(np.abs(x), np.abs(y)),
        hole,
        rough.normal(0.0, 1e-3, x.shape),
        np.exp(rough.normal(0.0, 3.0, x.shape)) * 1e-4,
        np.where(rough.random(x.shape) < 0.02, 1e-3, -np.inf),
        np.where((x + y) * 1e3 % 2 == 0, 1e-3, 0.7e-3),
    ]


@pytest.mark.parametrize("which", range(10))
def test_nothing_pulls_nothing_enters_and_what_pushes_touches(
    which, make_finger, make_touch, monkeypatch
):
    monkeypatch.setattr(rubber, "MOST_STEPS", 60)  # of a thousand
    finger = make_finger()
    indentation = shapes(finger)[which]
    touch = solved(finger, make_touch, indentation)
    allowed = 1e-7 * indentation.max()
    pressing = touch.pressure > 0.0
    assert pressing.any()
    assert (touch.pressure >= 0.0).all()
    assert (touch.compression >= indentation).all()
    assert (touch.compression >= 0.0).all()
    assert np.abs(touch.compression - indentation)[pressing].max() <= 2 * allowed
    # The pressures do make that face: independently of the kernel that found them.
    face = displacement(finger, touch.pressure)
    assert np.allclose(face, touch.compression, rtol=1e-3, atol=0.0)


@pytest.mark.parametrize("seed", range(20))
def test_pressures_are_those_of_another_method(seed, make_finger, make_touch):
    """Lawson and Hanson's: least squares with a factor of the energy, x >= 0."""
    finger, rng = make_finger(rows=8, cols=10), np.random.default_rng(seed)
    units = np.eye(80).reshape(80, 8, 10)
    kernel = np.array([displacement(finger, unit, 60).ravel() for unit in units])
    indentation = rng.normal(0.2e-3, 1e-3, (8, 10)) * rng.uniform(0.01, 1.0, (8, 10)) ** 3
    factor = np.linalg.cholesky(kernel * 1e9)
    wanted = np.linalg.solve(factor, indentation.ravel() * 1e6)
    expected = nnls(factor.T, wanted)[0].reshape(8, 10) * 1e3
    touch = solved(finger, make_touch, indentation)
    assert np.allclose(touch.pressure, expected, rtol=0.0, atol=1e-3 * expected.max())


def test_displacements_under_a_square_are_those_of_point_loads_all_over_it(make_finger, make_touch):
    finger = make_finger(rows=5, cols=9)
    indentation = np.full((5, 9), -np.inf)
    indentation[1, 2] = 1e-3
    touch = solved(finger, make_touch, indentation)
    assert np.allclose(touch.compression, displacement(finger, touch.pressure, 200), rtol=1e-5)


def test_a_stiffer_pad_presses_harder_and_is_touched_alike(make_finger, make_touch):
    finger = make_finger()
    soft, hard = (make_touch(field=paraboloid(finger)) for _ in range(2))
    HalfSpace(modulus=1e6, poisson=0.0).prepare(finger).apply(soft, None)
    HalfSpace(modulus=2e6, poisson=0.5).prepare(finger).apply(hard, None)
    assert np.allclose(hard.pressure, soft.pressure * 2 / 0.75, rtol=1e-12)
    assert np.array_equal(hard.compression, soft.compression)


def test_contacts_of_all_sizes_are_found_alike(make_finger, make_touch):
    finger = make_finger()
    usual = solved(finger, make_touch, paraboloid(finger))
    for scale in (1e-12, 1e9):
        touch = solved(finger, make_touch, scale * paraboloid(finger))
        assert np.allclose(touch.pressure, scale * usual.pressure, rtol=1e-4, atol=1e-3 * scale)


def test_an_untouched_pad_stays_as_it_is(make_finger, make_touch):
    touch = solved(make_finger(), make_touch, np.full((16, 16), -np.inf))
    assert (touch.compression == 0.0).all()
    assert (touch.pressure == 0.0).all()


def test_a_contact_that_is_not_found_is_stated(make_finger, make_touch, monkeypatch):
    monkeypatch.setattr(rubber, "MOST_STEPS", 3)
    finger = make_finger()
    with pytest.raises(ArithmeticError, match="half_space found no contact within 3 steps"):
        solved(finger, make_touch, paraboloid(finger))
