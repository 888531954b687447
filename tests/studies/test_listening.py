from __future__ import annotations

import pytest

from tests.studies.listening import _share, introspection_rows


def test_a_share_is_that_in_the_rates_before_and_after_it():
    # One of the three was taken while the machine had other work.
    assert _share([50.0, 30.0, 45.0], [100.0, 100.0, 60.0, 40.0]) == pytest.approx(0.5)


@pytest.mark.graph
@pytest.mark.slow
def test_a_ring_turns_on_while_a_tool_is_stopped():
    alone, beside, stopped = introspection_rows(quick=False, turns=1)
    assert float(alone.value.split()[0]) > 0.0
    # Far below the demand, which is the bench's to judge on a quiet machine: a ring that is held up
    # turns not at all.
    assert float(beside.value) > 0.1
    assert float(stopped.value) > 0.1
