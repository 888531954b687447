from __future__ import annotations

import pytest

from palpate.bench.bus.cost import _full_and_bare, _share, introspection_rows, lock_rows


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


@pytest.mark.graph
@pytest.mark.slow
def test_a_hop_and_a_locked_hop_have_their_costs():
    rows = [*_full_and_bare(20, turns=1), *lock_rows(quick=True, turns=1)]
    assert len({row.name for row in rows}) == len(rows) == 13
    assert all(float(row.value.split()[0]) > 0.0 for row in rows if "hop" in row.name[:8])
