from dataclasses import replace

import numpy as np
import pytest

from palpate.core.explore.planners.protocol import Budget, Height, Stop, Wait
from palpate.core.explore.planners.uniform import Uniform, nested, sweep


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9, 10, 41])
@pytest.mark.parametrize("order", [sweep, nested])
def test_every_height_is_visited_once(count, order):
    assert sorted(order(count)) == list(range(count))


def test_a_sweep_goes_up_from_the_middle_and_then_down():
    assert sweep(5) == [2, 3, 4, 1, 0]


def test_the_beginnings_of_a_nested_order_are_even():
    for size in (3, 5, 9):
        begun = np.sort(nested(17)[:size])
        assert len(set(np.diff(begun).tolist())) == 1


@pytest.mark.parametrize("count", [1, 2, 5, 24, 45])
@pytest.mark.parametrize("order", ["sweep", "nested"])
def test_the_heights_are_even_whatever_their_number(count, order, sides, explored):
    planner = Uniform(count=count, order="sweep" if order == "sweep" else "nested")
    heights, stop = explored(planner, sides["vase"])
    assert stop is not None
    wanted = [0.5] if count == 1 else np.linspace(0.03, 0.97, count)
    np.testing.assert_allclose(sorted(heights), wanted, rtol=1e-12)


def test_a_height_that_fails_is_tried_once_more_nearer_to_the_middle(failed, observation):
    planner, asked = Uniform(count=3), []
    slices = []
    while isinstance(choice := planner.next(observation(slices)), Height):
        asked.append(choice.height / 0.09)
        slices.append(failed(choice.height))
    np.testing.assert_allclose(asked, [0.5, 0.3825, 0.97, 0.8525, 0.03, 0.1475])


def test_heights_near_other_fingers_wait(observation):
    busy_heights = Uniform(count=3).next(observation(busy_heights=(0.045,), finger_spacing=0.02))
    assert isinstance(busy_heights, Height)
    assert busy_heights.height == pytest.approx(0.97 * 0.09)
    assert isinstance(
        Uniform(count=3).next(observation(busy_heights=(0.045,), finger_spacing=0.05)), Wait
    )


def test_a_spent_budget_ends_the_plan(slice_of, observation):
    one = slice_of(lambda z: 0.3, 0.5, seconds=16.0)
    left = Budget(most_seconds=40.0, seconds=38.0)  # less than a slice: traced as far as it lasts
    assert isinstance(Uniform().next(observation([one], budget=left)), Height)
    stop = Uniform().next(observation([one], budget=replace(left, cut=True)))
    assert isinstance(stop, Stop)
    assert stop.reason == "the budget is spent: 38 of 40 s of robot time"
    begun = Budget(most_touches=40, touches=30)  # from above, before the first slice
    assert isinstance(Uniform().next(observation(budget=begun)), Height)
    ended = Budget(most_touches=40, touches=40)
    assert isinstance(Uniform().next(observation(budget=ended)), Stop)


def test_plans_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="count is 0; expected 1 to 1000"):
        Uniform(count=0)
    with pytest.raises(ValueError, match="order must be sweep or nested, got 'random'"):
        Uniform(order="random")
