from __future__ import annotations

import pytest

from tests.studies.hops import _full_and_bare
from tests.studies.locks import lock_rows


@pytest.mark.graph
@pytest.mark.slow
def test_a_hop_and_a_locked_hop_have_their_costs():
    rows = [*_full_and_bare(20, turns=1), *lock_rows(quick=True, turns=1)]
    assert len({row.name for row in rows}) == len(rows) == 13
    assert all(float(row.value.split()[0]) > 0.0 for row in rows if "hop" in row.name[:8])
