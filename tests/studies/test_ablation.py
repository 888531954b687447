from __future__ import annotations

import math
from importlib import import_module

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.reconstruction import reconstruct
from palpate.core.rebuild.side import shifts
from palpate.core.rebuild.solid import LatticeSolid
from palpate.core.touch.curvature import ALONG_ROWS
from palpate.core.touch.pad import Pad
from palpate.nodes import curvature, filter
from palpate.nodes.planning import phases
from palpate.nodes.rebuilding import fitting
from tests.studies import ablation
from tests.studies.ablation import (
    PARTS,
    Outcome,
    Part,
    Worth,
    mean_interval,
    part_rows,
    rebuilt,
    without,
    worth_of,
)
from tests.studies.contours import noisy_contours
from tests.studies.growth import touched_contours
from tests.studies.rebuilt import REBUILT_SHAPES

PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
NAMED = {part.name: part for part in PARTS}
CASE = REBUILT_SHAPES["vase"]


def ball(share: float) -> Floats:
    """Compression under a ball of 20 mm with a share of impulses, m."""
    x, y = PAD.grid()
    image = np.maximum(1.0e-3 - (0.02 - np.sqrt(0.02**2 - x * x - y * y)), 0.0)
    hit = np.random.default_rng(1).random(image.shape) < share
    return np.where(hit, 2.4e-3, image)


def cleaned(share: float):
    return filter.clean(PAD, ball(share), 1e-5, contact=5e-5, order="auto")


def solid_of(noise: int | None, count: int = 12, *, taxels: bool = True) -> LatticeSolid:
    contours, contacts = touched_contours(CASE, count, 48, noise)
    tops = np.array([[0.0, 0.0, CASE.low], [0.0, 0.0, CASE.high]])
    patches = fitting.stack_points([contacts]) if taxels else None
    return reconstruct(contours, patches=patches, tops=tops, method="skin")


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_what_is_left_out_is_put_back_whatever_happens(part: Part):
    places = [place.split(":") for place in part.off]
    before = [getattr(import_module(module), name) for module, name in places]
    with pytest.raises(RuntimeError, match="on the way"), without(part):
        for (module, name), was in zip(places, before, strict=True):
            assert getattr(import_module(module), name) is not was
        raise RuntimeError("on the way")
    assert [getattr(import_module(module), name) for module, name in places] == before


def test_without_the_filter_impulses_stay():
    assert cleaned(0.05).impulses > 5
    with without(NAMED["filter"]):
        assert cleaned(0.05).impulses == 0
        assert np.array_equal(cleaned(0.05).compression, ball(0.05))


def test_without_the_robust_fit_impulses_pull():
    with_it = np.abs(cleaned(0.05).compression - ball(0.0)).max()
    with without(NAMED["robust fit"]):
        assert np.abs(cleaned(0.05).compression - ball(0.0)).max() > 3.0 * with_it


def test_without_the_mask_every_taxel_counts_once_one_is_touched():
    assert not cleaned(0.0).touched.all()
    with without(NAMED["mask"]):
        assert cleaned(0.0).touched.all()
        none = filter.clean(PAD, 0.0 * ball(0.0), 1e-5, contact=5e-5, order="auto")
        assert not none.touched.any()


def test_without_the_mask_in_the_fit_the_ball_is_flatter():
    found = cleaned(0.0)
    given = PAD.surface(found.compression, found.touched), found.touched, ALONG_ROWS, 1e-5
    assert curvature.touch.fit_patch(PAD, *given).principal[1] == pytest.approx(50.0, rel=0.05)
    with without(NAMED["mask, in the fit alone"]):
        off = curvature.touch.fit_patch(PAD, *given)
        assert off.kind != "smooth" or off.principal[1] < 40.0


def test_without_slopes_and_without_taxels_the_reconstructor_has_none():
    contacts = touched_contours(CASE, 5, 24, 0)[1]
    assert fitting.stack_points([contacts]).normals is not None
    with without(NAMED["slopes"]):
        found = fitting.stack_points([contacts])
        assert found.normals is None
        assert np.array_equal(found.points, contacts.points)
    with without(NAMED["all taxels, not contour points"]):
        assert fitting.stack_points([contacts]) is None


def test_without_pose_offsets_no_shift_is_believed():
    closed = solid_of(0).closed
    assert closed is not None
    assert closed.radial is not None
    assert closed.radial.pose_blocks
    with without(NAMED["pose offsets"]):
        closed = solid_of(0).closed
        assert closed is not None
        assert closed.radial is not None
        assert not closed.radial.pose_blocks


def test_without_cross_validation_noise_is_followed():
    contours = list(noisy_contours(CASE, (12, 48), 0.5, np.random.default_rng(0)))
    smooth = reconstruct(contours, method="skin").health()["sigma"]
    with without(NAMED["cross-validation"]):
        assert shifts.stiffened(None, "as it is") == "as it is"
        assert reconstruct(contours, method="skin").health()["sigma"] < 0.2 * smooth


def test_without_the_test_a_displaced_contour_is_used():
    case = NAMED["bad-contour test"]
    contours = noisy_contours(CASE, (12, 48), 0.1, np.random.default_rng(0))
    contours[5, :, 0] += 5.0
    assert reconstruct(list(contours), method="skin").health()["dropped"] == 1.0
    with without(case):
        assert reconstruct(list(contours), method="skin").health()["dropped"] == 0.0


def test_without_ends_nothing_is_probed_and_nothing_said_of_them():
    with without(NAMED["ends"]):
        assert phases.next_probe("upper", None) is None
        assert fitting.touched_ends([], [], {}, 0.0) is None


def test_the_mean_of_ratios_is_geometric_and_holds_the_truth_in_95_of_100_draws():
    assert mean_interval(np.array([0.5, 2.0]))[0] == pytest.approx(1.0)
    assert mean_interval(np.array([3.0])) == pytest.approx((3.0, 0.0, math.inf))
    draws = np.exp(0.7 + 0.4 * np.random.default_rng(0).normal(size=(2000, 6)))
    found = np.array([mean_interval(one) for one in draws])
    held = np.mean((found[:, 1] <= math.exp(0.7)) & (math.exp(0.7) <= found[:, 2]))
    assert 0.93 < held < 0.97


def test_ratios_are_without_over_with_and_failures_are_told():
    one, half = Outcome(0.1, 100, 200.0, 10.0), Outcome(0.2, 50, 100.0, 5.0)
    found = worth_of("it", [(one, half), (one, half), (one, None)])
    assert found.error == pytest.approx((2.0, 2.0, 2.0))
    assert found[2:] == pytest.approx((0.5, 0.5, 0.5, 3, 1, True))
    line = "it 2.00 (2.00 to 2.00) 0.50 0.50 0.50 3 1 FAILED"
    assert str(found).split() == line.split()
    none = worth_of("it", [(one, None)])
    assert str(none).split() == ["it", "-", "-", "-", "-", "1", "1", "FAILED"]
    assert [figure.value for figure in none.figures] == [None] * 4


def test_even_slices_stand_in_the_planner_s_place_as_many_as_it_took(monkeypatch):
    asked = []

    def explored(name, noise, demand, seed):
        asked.append(demand)
        return Outcome(0.1, 90, 180.0, 9.0, contours=7)

    monkeypatch.setattr(ablation, "explored", explored)
    monkeypatch.setattr(ablation, "_whole", ablation._whole.__wrapped__)
    monkeypatch.setattr(ablation, "rebuilt", lambda name, case, seed: Outcome(0.1))
    rows = [row for row in part_rows(quick=True) if isinstance(row, Worth)]
    assert len({row.name for row in rows}) == len(rows) == len(PARTS) + 2
    assert [one.planner for one in asked] == ["predicted"] * (2 * len(PARTS) - 1) + ["uniform"]
    assert asked[-1].settings == {"count": 7}
    assert asked[0].feature is None


def test_an_exploration_that_ends_without_a_solid_is_counted(monkeypatch):
    outcomes = iter([Outcome(0.1, 90, 180.0, 9.0)])

    def explored(name, noise, demand, seed):
        if (found := next(outcomes, None)) is None:
            raise RuntimeError("nothing could be rebuilt")
        return found

    monkeypatch.setattr(ablation, "explored", explored)
    monkeypatch.setattr(ablation, "_whole", ablation._whole.__wrapped__)
    assert [other for _, other in ablation._explored_pairs(PARTS[0], "", True)] == [None]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cross-validation", "bad-contour test"])
def test_a_part_is_worth_something_in_its_case(name):
    part = NAMED[name]
    with_it = [rebuilt("vase", part.case, seed).error for seed in range(3)]
    with without(part):
        assert np.mean(
            [rebuilt("vase", part.case, seed).error for seed in range(3)]
        ) > 1.2 * np.mean(with_it)
