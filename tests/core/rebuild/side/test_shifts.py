from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours.contacts import ContactPoints
from palpate.core.rebuild.side import shifts as shifting
from palpate.core.rebuild.side.equations import AxisCurve, fit_axis_curve
from palpate.core.rebuild.side.radial import (
    RadialSpline,
    coverage_of,
    fit_radial_spline,
    radial_fit,
)
from palpate.core.rebuild.side.shifts import fit_shifted_spline

HEIGHT = 0.06
TURNS = np.linspace(0.0, 1.0, 24, endpoint=False)


def upright() -> AxisCurve:
    return fit_axis_curve(np.array([0.0]), np.zeros((1, 2)))


POSE, TAXEL = 1e-4, 1e-5


def patches(
    seed: int, touches: int = 120, pose: float = POSE, taxel: float = TAXEL
) -> ContactPoints:
    """Patches of 15 mm of a ball of 60 mm, each shifted as a whole, with noise on each taxel."""
    rng = np.random.default_rng(seed)
    centre = np.array([0.0, 0.0, 0.03])
    out = rng.normal(size=(touches, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    aside = rng.uniform(-0.25, 0.25, (touches, 80, 3))
    normals = out[:, None] + aside
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    shifts = pose * rng.normal(size=(touches, 1, 3))
    points = centre + 0.03 * normals + shifts + taxel * rng.normal(size=(touches, 80, 1)) * normals
    touch = np.repeat(np.arange(touches, dtype=np.int32), 80)
    return ContactPoints(points.reshape(-1, 3), normals.reshape(-1, 3), touch)


def error(spline: RadialSpline) -> float:
    heights = np.linspace(0.008, 0.052, 30)
    wanted = np.sqrt(0.03**2 - (heights - 0.03) ** 2)[:, None]
    off: Floats = (np.sqrt(spline.squared(heights, TURNS)) - wanted) * wanted / 0.03
    return float(np.sqrt(np.mean(off**2)))


def test_shifts_of_touches_are_found_with_the_surface():
    contacts = patches(0)
    plain = fit_radial_spline(contacts, upright(), 0.0, HEIGHT)
    shifted, sigma = fit_shifted_spline(contacts, plain)
    assert error(shifted) < 0.7 * error(plain)
    assert shifted.sigma < 2.0 * TAXEL
    assert sigma is not None
    assert 0.6 * POSE < sigma < 1.3 * POSE


@pytest.mark.parametrize("pose", [1.5e-5, 3e-4])
def test_no_noise_is_too_small_or_too_large_for_shifts(pose: float) -> None:
    # Whether shifts are believed is no gate that noise could flip.
    errors = []
    for seed in range(2):
        contacts = patches(seed, pose=pose, touches=60)
        plain = fit_radial_spline(contacts, upright(), 0.0, HEIGHT)
        shifted, sigma = fit_shifted_spline(contacts, plain)
        assert sigma is not None and 0.5 * pose < sigma < 1.4 * pose
        errors.append((error(shifted), error(plain)))
    before, after = np.mean(errors, axis=0)[::-1]
    assert after < 0.8 * before


def test_what_shifts_leave_is_in_the_deviation(monkeypatch: pytest.MonkeyPatch) -> None:
    # Taxels of a touch err together: as if each erred by itself, too little would be told.
    contacts = patches(0)
    plain = fit_radial_spline(contacts, upright(), 0.0, HEIGHT)
    heights = np.linspace(0.008, 0.052, 10)

    def told(spline: RadialSpline) -> float:
        return float(np.sqrt(np.mean(spline.deviation(heights, TURNS) ** 2)))

    shifted, _ = fit_shifted_spline(contacts, plain)
    alone = told(replace(shifted, drift=None))
    assert 1.5 * alone < error(shifted) < 1.5 * told(shifted)
    # Of many touches it is told along their normals.
    monkeypatch.setattr(shifting, "MOST_WHOLE", 100)
    assert alone < told(fit_shifted_spline(contacts, plain)[0]) < told(shifted)


@pytest.mark.parametrize("seeds", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_the_band_of_a_shifted_spline_holds_the_surface(seeds):
    within = []
    for seed in range(seeds):
        contacts = patches(seed)
        plain = fit_radial_spline(contacts, upright(), 0.0, HEIGHT)
        shifted, sigma = fit_shifted_spline(contacts, plain)
        x, y, z = contacts.points.T
        seen = coverage_of(z, np.arctan2(y, x) / (2 * np.pi))
        assert seen is not None
        fit = radial_fit(shifted, seen, sigma, (0.008, 0.052), False)
        wanted = np.sqrt(0.03**2 - (fit.band_heights - 0.03) ** 2)[:, None]
        off = np.sqrt(shifted.squared(fit.band_heights, TURNS)) - wanted
        within.append(np.abs(off * wanted / 0.03) < 1.96 * fit.band[:, None])
    assert 0.9 < np.mean(within) <= 1.0


def test_without_noise_no_shift_is_looked_for():
    exact = patches(1, pose=0.0, taxel=0.0)
    plain = fit_radial_spline(exact, upright(), 0.0, HEIGHT)
    shifted, sigma = fit_shifted_spline(exact, plain)
    assert shifted is plain and sigma is None


def test_edges_are_not_taken_for_shifts() -> None:
    # What a spline leaves of edges is no shift: waves within each touch.
    contacts = patches(2, pose=0.0)
    normals = np.asarray(contacts.normals)
    waves = 1e-4 * np.sin(4000.0 * contacts.points @ np.array([1.0, 0.3, 0.7]))
    rough = contacts._replace(points=contacts.points + waves[:, None] * normals)
    plain = fit_radial_spline(rough, upright(), 0.0, HEIGHT)
    assert fit_shifted_spline(rough, plain)[1] is None


def test_a_few_touches_are_not_shifted_but_smoothed():
    contacts = patches(3, touches=120)
    one = contacts._replace(touch=np.zeros(len(contacts.points), np.int32))
    plain = fit_radial_spline(one, upright(), 0.0, HEIGHT)
    shifted, sigma = fit_shifted_spline(one, plain)
    assert sigma is None and shifted.stiffness >= plain.stiffness
