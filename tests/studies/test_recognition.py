from __future__ import annotations

import pytest

from palpate.core.recognition import NONE
from tests.studies import recognition
from tests.studies.recognition import recognition_rows, stored_confusion, unknown_confusion


@pytest.fixture(autouse=True)
def coarse(request, monkeypatch):
    """Meshes coarser than all that were learned, which are described sooner."""
    if request.node.get_closest_marker("slow") is None:
        monkeypatch.setattr(recognition, "LEVEL", 4)
        monkeypatch.setattr(recognition, "EDGES", (4.2e-3, 4.8e-3))
        recognition.stored_mesh.cache_clear()
        yield
        recognition.stored_mesh.cache_clear()
    else:
        yield


def test_stored_objects_in_twenty_poses_are_recognised():
    found = stored_confusion(20)
    assert found.share(str.__eq__) >= 0.95
    assert all(told == NONE for (_, told), _ in found.worst())


def test_other_objects_in_some_poses_are_none_of_them():
    assert unknown_confusion(4).share(lambda _, told: told == NONE) == 1.0


@pytest.mark.slow
def test_every_demand_is_met_in_two_hundred_poses():
    rows = list(recognition_rows(quick=False))
    assert len({row.name for row in rows}) == len(rows)
    assert [str(row) for row in rows if not row.holds] == []
