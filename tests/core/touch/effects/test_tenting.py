import numpy as np
import pytest

from palpate.core.touch.effects.rubber import Tenting


def tented(finger, make_touch, field, contact, decay=1e-3):
    touch = make_touch(field=field, pressure=np.where(contact, 1e4, 0.0))
    Tenting(decay=decay).prepare(finger).apply(touch, None)
    return touch.compression


def by_elimination(field, contact, stiffness):
    """The same equations, all taxels at once: slow and plain."""
    rows, cols = field.shape
    matrix, right = np.zeros((field.size, field.size)), np.zeros(field.size)
    for i in range(rows):
        for j in range(cols):
            here = i * cols + j
            if contact[i, j]:
                matrix[here, here], right[here] = 1.0, field[i, j]
                continue
            matrix[here, here] = stiffness
            for k, m in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                if 0 <= k < rows and 0 <= m < cols:
                    matrix[here, here] += 1.0
                    matrix[here, k * cols + m] = -1.0
    return np.array(np.linalg.solve(matrix, right), dtype=np.float64).reshape(rows, cols)


def contacts(size):
    rng = np.random.default_rng(2)
    rim = np.ones(size, dtype=bool)
    rim[2:-2, 2:-2] = False
    single = np.zeros(size, dtype=bool)
    single[0, -1] = True
    checks = np.indices(size).sum(axis=0) % 2 == 0
    return [rim, single, checks, ~single, rng.random(size) < 0.5, rng.random(size) < 0.05]


@pytest.mark.parametrize("which", range(6))
@pytest.mark.parametrize("decay", [0.2e-3, 1e-3, 20e-3])
@pytest.mark.parametrize("size", [(16, 16), (9, 14)])
def test_the_skirt_solves_equations_exactly(which, decay, size, make_finger, make_touch):
    finger = make_finger(rows=size[0], cols=size[1], pitch=0.9e-3)
    contact = contacts(size)[which]
    field = np.where(contact, np.random.default_rng(3).uniform(0.1e-3, 1e-3, size), 0.0)
    found = tented(finger, make_touch, field, contact, decay)
    expected = by_elimination(field, contact, (0.9e-3 / decay) ** 2)
    assert np.allclose(found, expected, rtol=0.0, atol=1e-15)
    assert np.array_equal(found[contact], field[contact])
    assert found.min() >= 0.0
    assert found.max() <= field.max()


@pytest.mark.parametrize("decay", [0.5e-3, 1e-3, 3e-3])
def test_beside_a_straight_edge_skirt_decays_exponentially(decay, make_finger, make_touch):
    finger = make_finger(rows=8, cols=40, pitch=0.5e-3)
    contact = np.zeros((8, 40), dtype=bool)
    contact[:, :11] = True
    found = tented(finger, make_touch, np.where(contact, 1e-3, 0.0), contact, decay)
    # u[j-1] - (2 + a) u[j] + u[j+1] = 0 with a level end half a pitch beyond the last taxel.
    per_taxel = np.arccosh(1.0 + 0.5 * (0.5e-3 / decay) ** 2)
    away = np.arange(30)
    expected = 1e-3 * np.cosh(per_taxel * (29.5 - away)) / np.cosh(per_taxel * 29.5)
    assert np.allclose(found[:, 10:], expected, rtol=1e-9)
    # And the continuous membrane, to second order in pitch over decay.
    smooth = np.exp(-away * 0.5e-3 / decay)
    near = away * 0.5e-3 < 2 * decay
    error = np.abs(found[0, 10:] - 1e-3 * smooth)[near].max()
    assert error < 1e-3 * (0.1 * (0.5e-3 / decay) ** 2 + 2 * np.exp(-29.5e-3 / decay))


def test_the_skirt_has_the_symmetry_of_the_contact(make_finger, make_touch):
    finger = make_finger()
    x, y = finger.pad.grid()
    field = np.maximum(1e-3 - (x * x + y * y) / 0.03, 0.0)
    found = tented(finger, make_touch, field, field > 0.0)
    for turned in (found[::-1], found[:, ::-1], found.T):
        assert np.allclose(turned, found, rtol=0.0, atol=1e-17)


def test_a_short_decay_leaves_hardly_any_skirt(make_finger, make_touch, dent):
    found = tented(make_finger(), make_touch, dent, dent > 0.0, 1e-5)
    assert np.allclose(found, dent, rtol=0.0, atol=dent.max() * 4 * 1e-4)


def test_pad_that_is_touched_everywhere_or_nowhere_stays_as_it_is(make_finger, make_touch):
    field = np.random.default_rng(0).uniform(0.1e-3, 1e-3, (16, 16))
    everywhere = tented(make_finger(), make_touch, field, field > 0.0)
    assert np.array_equal(everywhere, field)
    nowhere = tented(make_finger(), make_touch, 0.0 * field, field < 0.0)
    assert (nowhere == 0.0).all()
