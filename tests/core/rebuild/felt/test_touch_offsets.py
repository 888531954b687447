from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.coverage import coverage_of
from palpate.core.rebuild.felt.felt_fit import felt_fit
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.felt_skin import FeltSkin, fit_skin
from palpate.core.rebuild.felt.spine import Spine, fit_spine
from palpate.core.rebuild.felt.touch_offsets import fit_shifted_skin, pose_sigma

HEIGHT, POSE, TAXEL = 0.06, 1e-4, 1e-5
TURNS = np.arange(48) / 48


def upright() -> Spine:
    return fit_spine(np.array([0.0]), np.zeros((1, 2)))


def patches(seed: int, touches: int = 120, pose: float = POSE) -> FeltPoints:
    """Patches of 15 mm of a ball of 60 mm, each shifted as a whole, with noise on each taxel."""
    rng = np.random.default_rng(seed)
    centre = np.array([0.0, 0.0, 0.03])
    out = rng.normal(size=(touches, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    aside = rng.uniform(-0.25, 0.25, (touches, 80, 3))
    normals = out[:, None] + aside
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    shifts = pose * rng.normal(size=(touches, 1, 3))
    points = centre + 0.03 * normals + shifts + TAXEL * rng.normal(size=(touches, 80, 1)) * normals
    touch = np.repeat(np.arange(touches, dtype=np.int32), 80)
    return FeltPoints(points.reshape(-1, 3), normals.reshape(-1, 3), touch)


def error(skin: FeltSkin) -> float:
    heights = np.linspace(0.008, 0.052, 30)
    wanted = np.sqrt(0.03**2 - (heights - 0.03) ** 2)[:, None]
    off: Floats = (np.sqrt(skin.squared(heights, TURNS)) - wanted) * wanted / 0.03
    return float(np.sqrt(np.mean(off**2)))


def test_shifts_of_touches_are_found_with_the_surface() -> None:
    felt = patches(0)
    plain = fit_skin(felt, upright(), 0.0, HEIGHT)
    shifted = fit_shifted_skin(felt, plain)
    assert shifted.shifts is not None
    assert error(shifted.skin) < 0.7 * error(plain)
    assert shifted.skin.sigma < 2.0 * TAXEL
    sigma = pose_sigma(shifted)
    assert sigma is not None
    assert 0.6 * POSE < sigma < 1.3 * POSE


def test_the_band_of_a_shifted_skin_holds_the_surface() -> None:
    within = []
    for seed in range(4):
        felt = patches(seed)
        shifted = fit_shifted_skin(felt, fit_skin(felt, upright(), 0.0, HEIGHT))
        x, y, z = felt.points.T
        seen = coverage_of(z, np.arctan2(y, x) / (2 * np.pi))
        assert seen is not None
        fit = felt_fit(shifted.skin, seen, pose_sigma(shifted), (0.008, 0.052), False)
        wanted = np.sqrt(0.03**2 - (fit.band_heights - 0.03) ** 2)[:, None]
        off = np.sqrt(shifted.skin.squared(fit.band_heights, TURNS)) - wanted
        within.append(np.abs(off * wanted / 0.03) < 1.96 * fit.band[:, None])
    assert 0.9 < np.mean(within) <= 1.0


def test_without_noise_no_shift_is_looked_for() -> None:
    felt = patches(1, pose=0.0)
    exact = felt._replace(points=np.array([0.0, 0.0, 0.03]) + 0.03 * np.asarray(felt.normals))
    plain = fit_skin(exact, upright(), 0.0, HEIGHT)
    shifted = fit_shifted_skin(exact, plain)
    assert shifted.shifts is None
    assert shifted.skin is plain
    assert pose_sigma(shifted) is None


def test_edges_are_not_taken_for_shifts() -> None:
    # What a spline leaves of edges is no shift: waves within each touch.
    felt = patches(2, pose=0.0)
    normals = np.asarray(felt.normals)
    waves = 1e-4 * np.sin(4000.0 * felt.points @ np.array([1.0, 0.3, 0.7]))
    rough = felt._replace(points=felt.points + waves[:, None] * normals)
    plain = fit_skin(rough, upright(), 0.0, HEIGHT)
    assert fit_shifted_skin(rough, plain).shifts is None


def test_a_few_touches_are_not_shifted_but_smoothed() -> None:
    felt = patches(3, touches=120)
    one = felt._replace(touch=np.zeros(len(felt.points), np.int32))
    plain = fit_skin(one, upright(), 0.0, HEIGHT)
    shifted = fit_shifted_skin(one, plain)
    assert shifted.shifts is None
    assert shifted.skin.stiffness >= plain.stiffness
