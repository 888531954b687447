"""What palpate computes stays the same, to the last bit."""

from __future__ import annotations

import pytest

from tests.golden.golden import GOLDENS, Workshop, differences, elsewhere

MARKS = (pytest.mark.graph, pytest.mark.timeout(600))
CASES = [
    pytest.param(one, id=one.name, marks=MARKS if one.quick else (*MARKS, pytest.mark.slow))
    for one in GOLDENS
]


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    """Where all runs of this file leave what others look at."""
    return Workshop(tmp_path_factory.mktemp("golden"))


@pytest.mark.parametrize("golden", CASES)
def test_golden(golden, shop):
    apart = differences(golden.stored(), golden.make(shop))
    if apart and (where := elsewhere()):
        pytest.skip(f"differs, but so does the machine: {where}")
    assert not apart, "\n".join(apart)
