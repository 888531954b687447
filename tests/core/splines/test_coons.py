from __future__ import annotations

import numpy as np
import pytest

from palpate.core import geometry, shapes
from palpate.core.splines import Slopes, coons_patch, coons_surface, hermite_patch

U, V = np.linspace(0.0, 1.0, 9), np.linspace(0.0, 1.0, 7)
TURNS = 2.0 * np.pi * np.arange(400) / 400
HIGHEST = 1.2  # Latitude of the outermost contours, rad


def saddle(v, u):
    """A surface that is cubic both ways, with its derivatives by u, v and both."""
    u, v = np.broadcast_arrays(u, v)
    place = [u + 0.1 * v**3, v - 0.2 * u**2, u**3 * v**2 + 0.3 * u * v]
    by_u = [np.ones_like(u), -0.4 * u, 3 * u**2 * v**2 + 0.3 * v]
    by_v = [0.3 * v**2, np.ones_like(u), 2 * u**3 * v + 0.3 * u]
    both = [0.0 * u, 0.0 * u, 6 * u**2 * v + 0.3]
    return tuple(np.stack(one, axis=-1) for one in (place, by_u, by_v, both))


def boundaries(surface):
    return surface[0], surface[-1], surface[:, 0], surface[:, -1]


def slopes_of(first, last):
    """The saddle's slopes between heights `first` and `last`, in a patch of height 1."""
    height = last - first
    v = first + height * V
    twists = height * saddle(np.array([[first], [last]]), np.array([[0.0, 1.0]]))[3]
    return Slopes(
        height * saddle(first, U)[2],
        height * saddle(last, U)[2],
        saddle(v, 0.0)[1],
        saddle(v, 1.0)[1],
        twists,
    )


def test_a_patch_passes_through_its_four_curves():
    curves = boundaries(saddle(V[:, None], U)[0])
    for patch in (coons_patch(*curves), hermite_patch(*curves, slopes_of(0.0, 1.0))):
        assert patch.shape == (7, 9, 3)
        for found, wanted in zip(boundaries(patch), curves, strict=True):
            assert np.abs(found - wanted).max() < 1e-15


def test_curves_that_are_no_polynomials_are_met_as_well():
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(2, 2, 3))
    low, high = (np.linspace(*corners[i], 9) + np.sin(np.pi * U)[:, None] for i in (0, 1))
    left, right = (np.linspace(*corners[:, i], 7) for i in (0, 1))
    left[1:-1] += rng.normal(size=(5, 3))
    patch = coons_patch(low, high, left, right)
    for found, wanted in zip(boundaries(patch), (low, high, left, right), strict=True):
        assert np.abs(found - wanted).max() < 1e-14


def test_bilinear_surfaces_are_reproduced():
    corners = np.random.default_rng(1).normal(size=(2, 2, 3))
    sides = np.stack([1.0 - V, V], axis=1), np.stack([1.0 - U, U], axis=1)
    surface = np.einsum("mk,nl,klc->mnc", *sides, corners)
    assert np.abs(coons_patch(*boundaries(surface)) - surface).max() < 1e-15


def test_ruled_surfaces_are_reproduced():
    low = np.stack([U, np.sin(3 * U), U**4], axis=1)
    high = np.stack([np.cos(U), U, 1.0 + U], axis=1)
    ruled = (1.0 - V)[:, None, None] * low + V[:, None, None] * high
    assert np.abs(coons_patch(*boundaries(ruled)) - ruled).max() < 1e-15


def test_a_surface_of_cubics_is_reproduced_from_slopes_and_not_without():
    surface = saddle(V[:, None], U)[0]
    smooth = hermite_patch(*boundaries(surface), slopes_of(0.0, 1.0))
    assert np.abs(smooth - surface).max() < 1e-15
    assert np.abs(coons_patch(*boundaries(surface)) - surface).max() > 0.01


def one_sided(points, axis, way):
    """Derivative by the place at one end, to third order, of points with a spacing of 1."""
    near = [np.take(points, i if way > 0 else -1 - i, axis=axis) for i in range(4)]
    return way * (-11 * near[0] + 18 * near[1] - 9 * near[2] + 2 * near[3]) / 6.0


def test_patches_that_share_a_curve_and_slopes_join_smoothly():
    lower, upper = (
        (first, last, saddle(first + (last - first) * V[:, None], U)[0])
        for first, last in ((0.0, 0.4), (0.4, 1.0))
    )
    smooth = [hermite_patch(*boundaries(one), slopes_of(a, b)) for a, b, one in (lower, upper)]
    plain = [coons_patch(*boundaries(one)) for _, _, one in (lower, upper)]

    def jump(patches):
        below, above = one_sided(patches[0], 0, -1) / 0.4, one_sided(patches[1], 0, 1) / 0.6
        return float(np.abs(below - above).max())

    assert jump(smooth) < 1e-12
    assert jump(plain) > 0.02


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"low": np.zeros((1, 3)), "high": np.zeros((1, 3))}, "low and high must have as many"),
        ({"left": np.zeros((4, 3))}, "left and right must have as many points, 2 at least"),
        ({"right": np.zeros((7, 3))}, "low and right must meet at a corner, but are 1 m apart"),
        ({"low": np.full((9, 3), np.nan)}, "low must be finite"),
        ({"high": np.zeros((9, 2))}, "high must have shape"),
    ],
)
def test_curves_that_do_not_fit_are_refused(changes, words):
    names = ("low", "high", "left", "right")
    curves = dict(zip(names, boundaries(coons_patch(*square())), strict=True)) | changes
    with pytest.raises(ValueError, match=words):
        coons_patch(**curves)


def square():
    grid = np.stack([*np.meshgrid(U, V), np.zeros((7, 9))], axis=-1)
    return boundaries(grid)


def superellipsoid_contours(count, size=(1.0, 0.8, 1.2), exponents=(1.0, 1.0), begin=0):
    """Closed contours, each begun elsewhere, and every other one run the other way."""
    base = shapes.Superquadric(np.array(size), np.array(exponents))
    found = []
    for i, height in enumerate(np.sin(np.linspace(-HIGHEST, HIGHEST, count))):
        ring = np.column_stack([np.cos(TURNS), np.sin(TURNS), 0.0 * TURNS]) * size
        share = (1.0 - abs(height) ** (2.0 / exponents[0])) ** (0.5 * exponents[0])
        ring = share * ring / base.gauge(ring)[:, None] + [0.0, 0.0, size[2] * height]
        found.append(np.roll(ring, begin * i, axis=0)[:: -1 if begin and i % 2 else 1])
    return base, found


@pytest.mark.parametrize(
    ("size", "exponents", "order"),
    [
        ((1.0, 1.0, 1.0), (1.0, 1.0), 4.0),  # contours at even distances on the surface
        ((1.0, 0.8, 1.2), (1.0, 1.0), 3.0),
        ((1.0, 0.8, 1.2), (1.0, 0.9), 3.0),
    ],
)
def test_the_error_between_contours_falls_with_a_power_of_their_distance(size, exponents, order):
    errors = []
    for count in (9, 17, 33):
        base, contours = superellipsoid_contours(count, size, exponents)
        surface = coons_surface(contours, 25, columns=4)
        errors.append(float(np.abs(base.gauge(surface.reshape(-1, 3)) - 1.0).max()))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    print(f"\nerrors {errors}, orders {orders}")
    assert orders == pytest.approx([order, order], abs=0.25)
    assert errors[-1] < 2e-4


def test_the_surface_passes_through_the_contours_wherever_they_begin():
    _, contours = superellipsoid_contours(9)
    _, turned = superellipsoid_contours(9, begin=37)
    surface = coons_surface(contours, 20, rows=8, columns=4)
    assert surface.shape == (65, 80, 3)
    assert np.abs(surface - coons_surface(turned, 20)).max() < 1e-6
    for ring, contour in zip(surface[::8], contours, strict=True):
        assert np.ptp(ring[:, 2]) < 1e-14
        assert ring[0] == pytest.approx(contour[0], abs=1e-12)
        assert ring[20] == pytest.approx(contour[100], abs=1e-9)


def test_the_surface_is_smooth_across_contours_and_meridians():
    _, contours = superellipsoid_contours(9)
    surface = coons_surface(contours, 12, rows=32, columns=16)
    bands = [surface[32 * i : 32 * i + 33] for i in range(8)]
    sizes = [np.linalg.norm(b[-1] - b[0], axis=-1)[:, None] for b in bands]
    for low, high, below, above in zip(bands, bands[1:], sizes, sizes[1:], strict=False):
        tangents = one_sided(low, 0, -1) / below, one_sided(high, 0, 1) / above
        assert np.abs(tangents[0] - tangents[1]).max() < 1e-3 * np.abs(tangents[0]).max() / 32
    around = np.concatenate([surface, surface[:, :1]], axis=1)
    for i in range(11):
        left, right = around[:, 16 * i : 16 * i + 17], around[:, 16 * i + 16 : 16 * i + 33]
        jump = one_sided(left, 1, -1) - one_sided(right, 1, 1)
        assert np.abs(jump).max() < 1e-3 * np.abs(one_sided(left, 1, -1)).max()


def test_it_closes_to_a_watertight_mesh():
    base, contours = superellipsoid_contours(17)
    surface = coons_surface(contours, 24)
    poles = np.array([[0.0, 0.0, -1.2], [0.0, 0.0, 1.2]])
    found = geometry.solidity(*geometry.close_rings(poles[0], surface, poles[1]))
    assert (found.watertight, found.components, found.genus) == (True, 1, 0)
    assert found.volume == pytest.approx(shapes.superquadric_volume(base.size, (1, 1)), rel=0.01)


@pytest.mark.parametrize(
    ("contours", "meridians", "words"),
    [
        (superellipsoid_contours(2)[1], 12, "3 contours and 3 meridians at least, got 2 and 12"),
        (superellipsoid_contours(5)[1], 2, "got 5 and 2"),
        ([*superellipsoid_contours(3)[1], np.zeros((5, 3))], 12, r"contours\[3\] must enclose"),
        ([*superellipsoid_contours(3)[1], np.zeros((5, 2))], 12, r"contours\[3\] must have shape"),
    ],
)
def test_what_makes_no_surface_is_refused(contours, meridians, words):
    with pytest.raises(ValueError, match=words):
        coons_surface(contours, meridians)
