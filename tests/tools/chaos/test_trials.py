import pytest

from palpate.tools.chaos.trials import quantile


@pytest.mark.parametrize(("share", "time"), [(0.5, 50.0), (0.99, 99.0), (1.0, 100.0)])
def test_a_quantile_is_one_of_the_times(share, time):
    assert quantile([float(n) for n in range(100, 0, -1)], share) == time
    assert quantile([3.0], share) == 3.0
    assert quantile([], share) is None
