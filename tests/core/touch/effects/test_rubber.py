"""The pad's rubber: half-space, hardening, saturation, skirt and creep."""

import math
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.touch import Fingertip, SimulatedTouch
from palpate.core.touch.effects import effect_type
from palpate.core.touch.effects.rubber import ContactSolverSettings
from tests.core.touch.touches import DENT, X, Y, applied, finger, stage, touch

RADIUS, DEPTH = 0.03, 1e-3
STIFFNESS = 0.5e6 / (1.0 - 0.49**2)  # E / (1 - nu^2) [N/m2]
HERTZ_FORCE = 4 / 3 * STIFFNESS * math.sqrt(RADIUS) * DEPTH**1.5


def paraboloid(tip: Fingertip, radius: float = RADIUS, depth: float = DEPTH) -> Floats:
    x, y = tip.pad.grid()
    return depth - (x * x + y * y) / (2 * radius)


def solved(tip: Fingertip, indentation: Floats, **parameters: float) -> SimulatedTouch:
    """A touch of a half-space whose surface would enter the undeformed pad so far."""
    springs = np.maximum(indentation, 0.0)
    contact = touch(field=indentation, compression=springs, pressure=2e8 * springs)
    return applied("half_space", contact, tip, **parameters)


def displacement(tip: Fingertip, pressure: Floats, fine: int = 12) -> Floats:
    """Displacement of each taxel's middle by point loads on a fine grid (Boussinesq)."""
    pitch = tip.pad.pitch
    parts = ((np.arange(fine) + 0.5) / fine - 0.5) * pitch
    x, y = tip.pad.grid()
    result = np.zeros_like(pressure)
    for i, j in zip(*pressure.nonzero(), strict=True):
        dx = x[..., None, None] - x[i, j] - parts
        dy = y[..., None, None] - y[i, j] - parts[:, None]
        mean_inverse = (1.0 / np.hypot(dx, dy)).mean(axis=(2, 3))
        mean_inverse[i, j] = 4.0 * math.asinh(1.0) / pitch
        result += pressure[i, j] * pitch**2 * mean_inverse / (math.pi * STIFFNESS)
    return result


def test_ball_on_a_half_space_makes_the_contact_of_hertz():
    contact, away = solved(finger(), paraboloid(finger())), np.hypot(X, Y)
    radius = math.sqrt(RADIUS * DEPTH)
    assert contact.pressure.sum() * 1e-6 == pytest.approx(HERTZ_FORCE, rel=0.01)
    area = (contact.pressure > 0.0).sum() * 1e-6
    assert math.sqrt(area / math.pi) == pytest.approx(radius, rel=0.02)
    # A taxel's pressure is that of its square; away from the rim it is that of its middle.
    inside, outside = away < 0.8 * radius, away > 1.2 * radius
    peak = 3 * HERTZ_FORCE / (2 * math.pi * radius**2)
    expected = peak * np.sqrt(1 - (away[inside] / radius) ** 2)
    assert np.allclose(contact.pressure[inside], expected, rtol=0.03)
    # Outside the contact: Johnson, 1985, (3.42a).
    r = away[outside]
    free = (2 * radius**2 - r**2) * np.arcsin(radius / r)
    free += r * radius * np.sqrt(1 - (radius / r) ** 2)
    assert np.allclose(contact.compression[outside], free / (math.pi * RADIUS), rtol=0.01)


ROUGH = np.random.default_rng(1)
FACES = {
    "ball": paraboloid(finger()),
    "small ball": paraboloid(finger(), 0.004, 0.5e-3),
    "plane": np.full_like(X, 1e-3),
    "tilted plane": 1e-3 + 0.2 * X + 0.1 * Y,
    "pyramid": 1e-3 - 0.4 * np.maximum(np.abs(X), np.abs(Y)),
    "hole": np.where(np.hypot(X - 3e-3, Y) < 2e-3, -np.inf, 0.8e-3),
    "rough": ROUGH.normal(0.0, 1e-3, X.shape),
    "spikes": np.exp(ROUGH.normal(0.0, 3.0, X.shape)) * 1e-4,
    "pins": np.where(ROUGH.random(X.shape) < 0.02, 1e-3, -np.inf),
    "stripes": np.where((X + Y) * 1e3 % 2 == 0, 1e-3, 0.7e-3),
}


@pytest.mark.parametrize("face", FACES)
def test_pressures_are_positive_and_only_in_contact(face):
    whole = FACES[face]
    for tip, indentation in ((finger(), whole), (finger(rows=10), whole[3:13])):
        contact = solved(tip, indentation)
        pressing = contact.pressure > 0.0
        assert pressing.any() and (contact.pressure >= 0.0).all()
        assert (contact.compression >= np.maximum(indentation, 0.0)).all()
        assert (contact.compression - indentation)[pressing].max() <= 2e-7 * indentation.max()
        # The pressures do make that face: independently of the kernel that found them.
        moved = displacement(tip, contact.pressure)
        assert np.allclose(moved, contact.compression, rtol=1e-3, atol=0.0)


def test_half_space_is_linear_in_modulus_and_depth():
    tip, field = finger(), paraboloid(finger())
    soft = solved(tip, field, modulus=1e6, poisson=0.0)
    hard = solved(tip, field, modulus=2e6, poisson=0.5)
    assert np.allclose(hard.pressure, soft.pressure * 2 / 0.75, rtol=1e-12)
    assert np.array_equal(hard.compression, soft.compression)
    for scale in (1e-12, 1e9):
        other = solved(tip, scale * field, modulus=1e6, poisson=0.0).pressure
        assert np.allclose(other, scale * soft.pressure, rtol=1e-4, atol=1e-3 * scale)
    free = solved(tip, np.full((16, 16), -np.inf))
    assert (free.compression == 0.0).all() and (free.pressure == 0.0).all()


def test_unconverged_contact_raises_error(monkeypatch):
    monkeypatch.setattr(effect_type("half_space"), "solver", ContactSolverSettings(max_steps=3))
    made = stage("half_space")
    with pytest.raises(ArithmeticError, match="half_space did not converge within 3 steps"):
        made.apply(touch(field=paraboloid(finger())), None)


def test_hardening_follows_its_formula():
    strain = np.linspace(0.0, 0.95, 256).reshape(16, 16)
    contact = touch(field=strain * 3e-3)
    expected = contact.pressure * (1.0 + 0.7 * strain**2 / (1.0 - strain))
    assert np.allclose(applied("hardening", contact, strength=0.7).pressure, expected, rtol=1e-13)
    assert np.array_equal(contact.compression, strain * 3e-3)
    beyond = np.linspace(0.9, 1.1, 256).reshape(16, 16)  # nothing of the pad is left at 1
    pressure = applied("hardening", touch(field=beyond * 3e-3)).pressure.ravel()
    assert np.isfinite(pressure).all() and (np.diff(pressure) > 0.0).all()


@pytest.mark.parametrize(
    ("deepest", "before", "after"),
    [
        (0.89e-3, "hit", "hit"),
        (0.91e-3, "hit", "bottomed"),
        (0.91e-3, "bottomed", "bottomed"),
        (0.0, "miss", "miss"),
        (0.0, "inside", "inside"),
    ],
)
def test_saturation_clips_compression_and_pressure_alike(deepest, before, after):
    field = DENT / DENT.max() * deepest
    contact = touch(field=field, pressure=7e8 * field**2, outcome=before)
    applied("saturation", contact, share=0.3)
    clipped = np.minimum(field, 0.9e-3)
    assert contact.outcome == after
    assert np.allclose(contact.compression, clipped, rtol=1e-15, atol=0.0)
    assert np.allclose(contact.pressure, 7e8 * field * clipped, rtol=1e-14)


def membrane(field: Floats, contact: Bools, stiffness: float) -> Floats:
    """The same equations, all taxels at once."""
    rows, cols = field.shape
    matrix, right = np.diag(np.where(contact, 1.0, stiffness).ravel()), np.where(contact, field, 0)
    for i, j in np.argwhere(~contact):
        for k, m in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
            if 0 <= k < rows and 0 <= m < cols:
                matrix[i * cols + j, i * cols + j] += 1.0
                matrix[i * cols + j, k * cols + m] = -1.0
    return np.linalg.solve(matrix, right.ravel()).reshape(rows, cols)


@pytest.mark.parametrize("size", [(16, 16), (9, 14)])
def test_skirt_solves_the_membrane_exactly(size):
    rng = np.random.default_rng(2)
    rim, single = np.ones(size, dtype=bool), np.zeros(size, dtype=bool)
    rim[2:-2, 2:-2], single[0, -1] = False, True
    checks = np.indices(size).sum(axis=0) % 2 == 0
    contacts = [rim, single, checks, ~single, rng.random(size) < 0.5, rng.random(size) < 0.05]
    contacts += [np.ones(size, bool), np.zeros(size, bool)]
    tip = finger(rows=size[0], cols=size[1], pitch=0.9e-3)
    for contact in contacts:
        field = np.where(contact, rng.uniform(0.1e-3, 1e-3, size), 0.0)
        for decay in (0.2e-3, 1e-3, 20e-3):
            made = touch(field=field, pressure=np.where(contact, 1e4, 0.0))
            result = applied("tenting", made, tip, decay=decay).compression
            expected = membrane(field, contact, (0.9e-3 / decay) ** 2)
            assert np.allclose(result, expected, rtol=0.0, atol=1e-15)
            assert np.array_equal(result[contact], field[contact])
            assert 0.0 <= result.min() <= result.max() <= field.max()


SHARE, TAU = 0.2, 0.5


def press(
    field: Floats, rest: float = 1.0, loading: float = 0.1, dwell: float = 0.3, back: float = 0.0
) -> SimulatedTouch:
    """A touch with these times [s], which begins at 0."""
    times = {"rest": rest, "loading": loading, "dwell": dwell, "previous": 0.0, "begun": 0.0}
    return touch(0, field, time=rest + loading + dwell + back, **times)


def crept(*touches: SimulatedTouch) -> list[Floats]:
    """What is measured in each of these touches, one after the other."""
    made = stage("creep", share=SHARE, tau=TAU)
    state = made.state
    for contact in touches:
        state = made.apply(contact, state)
    return [contact.compression for contact in touches]


def integrated(touches: list[Any], depths: list[float]) -> list[float]:
    """What is measured by small steps of the equation q' = -q / tau + c'."""
    result, q, step = [], 0.0, 1e-4
    for contact, depth in zip(touches, depths, strict=True):
        back = contact.time - contact.previous - contact.rest - contact.loading - contact.dwell
        for kind, duration in enumerate((contact.rest, contact.loading, contact.dwell, back)):
            if kind == 3:
                result.append((1 - SHARE) * depth + SHARE * q)
                q -= depth  # let go at once
            rate = depth / contact.loading if kind == 1 else 0.0
            for _ in range(round(duration / step)):  # midpoint rule
                middle = q + 0.5 * step * (rate - q / TAU)
                q += step * (rate - middle / TAU)
    return result


def test_creep_follows_its_equation_over_a_series():
    times = [(1, 0.1, 0.3, 0.2), (0.2, 0.05, 0.1, 0.1), (0.3, 0.2, 0, 0.4), (0.1, 0.1, 1, 0)]
    depths = [1e-3, 0.4e-3, 2e-3, 1.5e-3]
    touches = [press(np.full((16, 16), d), *t) for d, t in zip(depths, times, strict=True)]
    expected = integrated(touches, depths)
    assert np.allclose([field[0, 0] for field in crept(*touches)], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("loading", "dwell", "left"),
    [
        (0.25, 0.4, TAU / 0.25 * (1 - math.exp(-0.25 / TAU)) * math.exp(-0.4 / TAU)),
        (0.0, 0.0, 1.0),  # a sudden press is felt wholly
        (0.0, 0.4, math.exp(-0.4 / TAU)),
        (1e-12, 0.0, 1.0),
        (0.1, 50 * TAU, 0.0),  # of a long one the share has relaxed
    ],
)
def test_first_touch_relaxes_in_closed_form(loading, dwell, left):
    contact = press(DENT, loading=loading, dwell=dwell)
    contact.pressure = 3e9 * DENT**2
    ratio = 1 - SHARE + SHARE * left
    (result,) = crept(contact)
    assert np.allclose(result, DENT * ratio, rtol=1e-11, atol=0.0)
    assert np.allclose(contact.pressure, 3e9 * DENT**2 * ratio, rtol=1e-11, atol=0.0)


def test_free_face_reads_nothing_and_never_less():
    shallow = press(0.01 * DENT, rest=0.01)
    _, result = crept(press(DENT), shallow)
    assert (result >= 0.0).all() and (shallow.pressure >= 0.0).all()
    assert (result[DENT > 0.0] == 0.0).any() and (result[DENT == 0.0] == 0.0).all()
