from __future__ import annotations

import numpy as np
import pytest

from palpate.bench.table import run_groups
from palpate.core.geometry.nearest import nearest_points
from tests import figures
from tests.studies import growth
from tests.studies.growth import Growth, fit_power_law, taxel_growth, touched_contours
from tests.studies.rebuilt import REBUILT_SHAPES, truth_of

SIZES = np.array([4.0, 6.0, 9.0, 14.0, 22.0, 36.0, 60.0])


@pytest.mark.parametrize("exponent", [-2.0, 0.0, 1.5])
def test_the_power_of_a_power_is_found_exactly(exponent):
    law = fit_power_law(SIZES, 0.3 * SIZES**exponent)
    assert law == pytest.approx((exponent,) * 3, abs=1e-9)


def test_units_do_not_matter_to_the_power_nor_factors_of_repeats():
    values = SIZES[:, None] ** -1.0 * np.array([1.0, 7.0, 0.02])
    values[3] *= 1.3
    alone = fit_power_law(SIZES, values[:, 0])
    assert fit_power_law(10 * SIZES, 1e6 * values[:, 0]) == pytest.approx(alone)
    assert Growth("it", tuple(SIZES), {}, {"ms": values}).law("ms") == pytest.approx(alone)


def test_the_interval_holds_the_power_in_95_of_100_draws():
    rng = np.random.default_rng(0)
    values = SIZES[:, None] ** -1.0 * np.exp(0.3 * rng.normal(size=(7, 2000)))
    laws = [fit_power_law(SIZES, values[..., draw]) for draw in range(2000)]
    held = np.mean([one.low <= -1.0 <= one.high for one in laws])
    assert 0.93 < held < 0.97


@pytest.mark.parametrize(
    ("sizes", "values", "words"),
    [
        ([1, 2], [1.0, 2.0], "3 or more"),
        ([2, 2, 2], [1.0, 2.0, 3.0], "3 or more"),
        ([1, 2, 3], [1.0, 2.0], "as many values, got 3, 2"),
        ([1, 2, 3], [1.0, 0.0, 3.0], "positive"),
        ([0, 2, 3], [1.0, 1.0, 3.0], "positive"),
    ],
)
def test_what_has_no_power_is_refused(sizes, values, words):
    with pytest.raises(ValueError, match=words):
        fit_power_law(sizes, values)


def test_errors_at_the_floor_do_not_count_and_costs_always_do():
    error, cost = {"error": [8.0, 4.0, 2.0, 1.9]}, {"cost, ms": [1, 2, 4, 8]}
    found = Growth("it", (4, 8, 16, 32), error, cost, 0.95)
    assert found.law("error") == pytest.approx((-1.0, -1.0, -1.0))
    assert found.law("cost, ms") == pytest.approx((1.0, 1.0, 1.0))
    assert found._replace(floor=1.5).law("error") is None
    head, errors, costs = str(found).splitlines()
    assert head.split()[:3] == ["it,", "floor", "0.950"]
    assert "-1.00 (-1.00 to -1.00)" in errors
    assert costs.split()[2:6] == ["1", "2", "4", "8"]
    kinds = [figure.kind for figure in found.figures if "at" in figure.name]
    assert kinds == ["error"] * 4 + ["time"] * 4


def test_contacts_lie_on_the_object_with_its_normals():
    vase = REBUILT_SHAPES["vase"]
    contours, contacts = touched_contours(vase, 5, 48, None)
    assert [ring.shape for ring in contours] == [(48, 3)] * 5
    assert len(np.unique(contacts.touch)) == 5 * growth.PADS
    normals = contacts.normals / np.linalg.norm(contacts.normals, axis=1, keepdims=True)
    search = truth_of("vase").surface.search
    assert nearest_points(search, contacts.points).distances.max() < 0.02
    away = nearest_points(search, contacts.points + 0.3 * normals).distances
    assert away == pytest.approx(0.3, abs=0.03)
    noisy = touched_contours(vase, 5, 48, 0)[1]
    off = (noisy.points - contacts.points)[noisy.touch == 3]
    assert off.std(axis=0).max() < 3 * growth.TAXEL_NOISE < np.abs(off.mean(axis=0)).max()


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(growth, "SIZES", {"taxels": (8, 10, 12, 14, 16)})
    monkeypatch.setattr(growth, "FRAMES", 4)
    for module in (growth, figures):
        monkeypatch.setattr(module, "GROWTHS", (taxel_growth.__wrapped__,))


def test_growths_are_printed_and_drawn(small, tmp_path, capsys):
    place = "tests.studies.growth:growth_rows"
    assert run_groups({"growth": place}, quick=True) == 0
    assert "taxels a side" in capsys.readouterr().out
    assert run_groups({"growth": place}, quick=True, as_json=True) == 0
    assert '"name":"curvatures, rms % at 12"' in capsys.readouterr().out
    figures.write_growth_figures(tmp_path / "new")
    assert (tmp_path / "new" / "scaling.png").stat().st_size > 1000


@pytest.mark.slow
def test_more_contours_err_less_and_noise_limits_them(monkeypatch):
    monkeypatch.setattr(growth, "SIZES", {"contours": (5, 7, 9, 12, 14)})
    monkeypatch.setattr(growth, "TURNS", 1)
    alone = growth._rebuilt("it", "contours", False, True)
    exact, noisy = (alone.means()[what] for what in alone.errors)
    assert exact[0] > exact[-1]
    assert noisy[-1] > exact[-1]
    assert alone.floor > 0.0
