"""Laws of Coons patches, and of the closed surface through contours."""

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.splines import Slopes, coons_patch, coons_surface, hermite_patch

U, V = np.linspace(0.0, 1.0, 9), np.linspace(0.0, 1.0, 7)
TURNS = 2.0 * np.pi * np.arange(400) / 400
HIGHEST = 1.2  # Latitude of the outermost contours [rad]


def saddle(v: Floats, u: Floats) -> tuple[Floats, ...]:
    """A surface that is cubic along u and v, with its derivatives by u, v and both."""
    u, v = np.broadcast_arrays(u, v)
    place = [u + 0.1 * v**3, v - 0.2 * u**2, u**3 * v**2 + 0.3 * u * v]
    by_u = [np.ones_like(u), -0.4 * u, 3 * u**2 * v**2 + 0.3 * v]
    by_v = [0.3 * v**2, np.ones_like(u), 2 * u**3 * v + 0.3 * u]
    both = [0.0 * u, 0.0 * u, 6 * u**2 * v + 0.3]
    return tuple(np.stack(one, axis=-1) for one in (place, by_u, by_v, both))


def boundaries(surface: Floats) -> tuple[Floats, ...]:
    return surface[0], surface[-1], surface[:, 0], surface[:, -1]


SLOPES = Slopes(
    saddle(np.array(0.0), U)[2],
    saddle(np.array(1.0), U)[2],
    saddle(V, np.array(0.0))[1],
    saddle(V, np.array(1.0))[1],
    saddle(np.array([[0.0], [1.0]]), np.array([[0.0, 1.0]]))[3],
)


def test_patches_interpolate_their_four_curves():
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(2, 2, 3))
    low, high = (np.linspace(*corners[i], 9) + np.sin(np.pi * U)[:, None] for i in (0, 1))
    left, right = (np.linspace(*corners[:, i], 7) for i in (0, 1))
    left[1:-1] += rng.normal(size=(5, 3))
    surface = saddle(V[:, None], U)[0]
    wild, cubic = (low, high, left, right), boundaries(surface)
    smooth = hermite_patch(*cubic, SLOPES)
    for curves, patch in (wild, coons_patch(*wild)), (cubic, coons_patch(*cubic)), (cubic, smooth):
        assert patch.shape == (7, 9, 3)
        for result, wanted in zip(boundaries(patch), curves, strict=True):
            assert np.abs(result - wanted).max() < 1e-14
    # Cubics are reproduced from their slopes.
    assert np.abs(smooth - surface).max() < 1e-15
    assert np.abs(coons_patch(*cubic) - surface).max() > 0.01
    low, high = np.stack([U, np.sin(3 * U), U**4], axis=1), np.stack([np.cos(U), U, 1 + U], axis=1)
    ruled = (1.0 - V)[:, None, None] * low + V[:, None, None] * high
    assert np.abs(coons_patch(*boundaries(ruled)) - ruled).max() < 2e-15


def one_sided(points: Floats, axis: int, side: int) -> Floats:
    """Derivative by the place at one end, to third order, of points with a spacing of 1."""
    near = [np.take(points, i if side > 0 else -1 - i, axis=axis) for i in range(4)]
    return side * (-11 * near[0] + 18 * near[1] - 9 * near[2] + 2 * near[3]) / 6.0


def gauge(points: Floats, size: tuple[float, ...], exponent: float) -> Floats:
    """1 on a superellipsoid that is round from pole to pole."""
    x, y, z = np.moveaxis(np.abs(points) / size, -1, 0)
    return np.sqrt((x ** (2 / exponent) + y ** (2 / exponent)) ** exponent + z**2)


def contours_of(count: int, size=(1.0, 0.8, 1.2), exponent=1.0, begin: int = 0) -> list[Floats]:
    """Closed contours, each begun elsewhere, and every other one reversed."""
    result = []
    for i, height in enumerate(np.sin(np.linspace(-HIGHEST, HIGHEST, count))):
        ring = np.column_stack([np.cos(TURNS), np.sin(TURNS), 0.0 * TURNS]) * size
        ring *= np.sqrt(1.0 - height**2) / gauge(ring, size, exponent)[:, None]
        ring += [0.0, 0.0, size[2] * height]
        result.append(np.roll(ring, begin * i, axis=0)[:: -1 if begin and i % 2 else 1])
    return result


@pytest.mark.parametrize(("size", "exponent", "order"), [
    ((1.0, 1.0, 1.0), 1.0, 4.0),  # contours at even distances on the surface
    ((1.0, 0.8, 1.2), 1.0, 3.0),
    ((1.0, 0.8, 1.2), 0.9, 3.0),
])  # fmt: skip
def test_error_between_contours_has_its_order(size: tuple, exponent: float, order: float):
    errors = []
    for count in (9, 17):
        surface = coons_surface(contours_of(count, size, exponent), 25)
        errors.append(float(np.abs(gauge(surface, size, exponent) - 1.0).max()))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)
    assert errors[1] < 1.5e-3


def test_surface_passes_through_contours_begun_anywhere():
    contours = contours_of(9)
    surface = coons_surface(contours, 20, rows=8, columns=4)
    assert surface.shape == (65, 80, 3)
    assert np.abs(surface - coons_surface(contours_of(9, begin=37), 20)).max() < 1e-6
    for ring, contour in zip(surface[::8], contours, strict=True):
        assert np.ptp(ring[:, 2]) < 1e-14
        assert ring[0] == pytest.approx(contour[0], abs=1e-12)
        assert ring[20] == pytest.approx(contour[100], abs=1e-9)
    doubled = [np.concatenate([one, one[:1]]) for one in contours]
    assert np.abs(surface - coons_surface(doubled, 20)).max() < 1e-9


def test_surface_is_smooth_across_contours_and_meridians():
    surface = coons_surface(contours_of(9), 12, rows=32, columns=16)
    bands = [surface[32 * i : 32 * i + 33] for i in range(8)]
    sizes = [np.linalg.norm(b[-1] - b[0], axis=-1)[:, None] for b in bands]
    for i in range(7):
        below = one_sided(bands[i], 0, -1) / sizes[i]
        above = one_sided(bands[i + 1], 0, 1) / sizes[i + 1]
        assert np.abs(below - above).max() < 1e-3 * np.abs(below).max() / 32
    around = np.concatenate([surface, surface[:, :1]], axis=1)
    for i in range(11):
        left, right = around[:, 16 * i : 16 * i + 17], around[:, 16 * i + 16 : 16 * i + 33]
        jump = one_sided(left, 1, -1) - one_sided(right, 1, 1)
        assert np.abs(jump).max() < 1e-3 * np.abs(one_sided(left, 1, -1)).max()


SQUARE = boundaries(np.stack([*np.meshgrid(U, V), np.zeros((7, 9))], axis=-1))


@pytest.mark.parametrize(("changes", "words"), [
    ({0: np.zeros((1, 3)), 1: np.zeros((1, 3))}, "low and high must have as many"),
    ({2: np.zeros((4, 3))}, "left and right must have as many points, 2 at least"),
    ({3: np.zeros((7, 3))}, "low and right must meet at a corner, but are 1 m apart"),
    ({0: np.full((9, 3), np.nan)}, "low must be finite"),
    ({1: np.zeros((9, 2))}, "high must have shape"),
])  # fmt: skip
def test_curves_that_do_not_fit_are_refused(changes: dict[int, Floats], words: str):
    curves = [changes.get(i, curve) for i, curve in enumerate(SQUARE)]
    with pytest.raises(ValueError, match=words):
        coons_patch(*curves)
    with pytest.raises(ValueError, match="slopes must have shape"):
        hermite_patch(*SQUARE, SLOPES._replace(high=np.zeros((3, 3))))


@pytest.mark.parametrize(("contours", "meridians", "words"), [
    (contours_of(2), 12, "3 contours and 3 meridians at least, got 2 and 12"),
    (contours_of(5), 2, "got 5 and 2"),
    ([*contours_of(3), np.zeros((5, 3))], 12, r"contours\[3\] must enclose"),
    ([*contours_of(3), np.zeros((5, 2))], 12, r"contours\[3\] must have shape"),
])  # fmt: skip
def test_contours_without_a_surface_are_refused(contours: list, meridians: int, words: str):
    with pytest.raises(ValueError, match=words):
        coons_surface(contours, meridians)
