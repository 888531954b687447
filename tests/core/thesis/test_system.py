"""The system of 1999 as a graph: its parts, its solid, and the error bound that it lacks."""

from __future__ import annotations

import json

import numpy as np
import pytest

from palpate.launch.run import load_run
from palpate.launch.run_directory import SUMMARY
from palpate.nodes.runtime.testing import recorded
from tests.graph.conftest import palpate
from tests.recorded_run import make_run

pytestmark = pytest.mark.slow  # one run for all tests
HEIGHT = 0.08  # Of the egg [m]
SHAPES = {(1.0, 1.0), (0.2, 0.2), (0.2, 1.0)}  # Sphere, box, cylinder


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("thesis")
    done = palpate(
        *("run", "egg", "--system", "thesis", "--noise", "low", "--composed", "--quiet"),
        *("--out", folder / "run"),
        folder=folder,
    )
    assert done.code == 1 and "no error bound can be stated" in done.err, done.err
    return folder / "run"


def test_solid_is_of_thesis_without_bound(run):
    summary = json.loads((run / SUMMARY).read_text())
    assert (summary["method"], summary["rms_bound_95_m"]) == ("thesis", None)
    assert 0.1e-3 < summary["rms_m"] < 0.03 * HEIGHT
    assert "its method of rebuilding states no error bound" in summary["reason"]
    # The same holds for drafts, and with too few contours for a solid.
    assert {one.rms_bound_95 for one in recorded(run, "/plan/estimate")} == {None}
    assert {one.method for one in recorded(run, "/model/shape")} == {"thesis"}
    last = recorded(run, "/model/shape")[-1]
    assert (last.final, last.deviation, last.closed) == (True, None, True)
    assert last.control.shape[:2] == (5, 5) and last.control.shape[2] == len(last.contours)
    solid = load_run(run).solid
    assert solid is not None and solid.method == "thesis"
    # Touches are fitted by splines.
    patches = [one for one in recorded(run, "/touch/patch") if one.kind == "smooth"]
    assert len(patches) > 50 and {len(one.jet) for one in patches} == {6}


def test_search_goes_from_half_height_to_both_ends(run):
    [*coarse] = recorded(run, "/model/coarse")
    assert {tuple(one.exponents) for one in coarse} <= SHAPES
    assert all(one.taper.max() == one.bend == 0.0 for one in coarse)
    goals = recorded(run, "/contour/goal")
    heights = np.array([one.height for one in goals])
    assert np.allclose([one.frame[3:5] for one in goals], 0.0)  # the platform's axis
    up = heights > heights[0]
    turn = int(np.argmax(up[1:] != up[1])) + 1
    assert np.all(up[1:turn] == up[1]) and np.all(up[turn:] != up[1])
    for half in (heights[:turn], np.concatenate([heights[:1], heights[turn:]])):
        assert np.all(np.abs(np.diff(half)) <= 0.2 * HEIGHT + 2e-3) and len(half) > 2
    with pytest.raises(ValueError, match="has nothing on /probe/goal"):
        recorded(run, "/probe/goal")


def test_recording_is_replayed_and_compared(run, tmp_path):
    folder = run.parent
    assert palpate("replay", run, folder=folder).code == 0
    ours = make_run(tmp_path)
    done = palpate("report", run, ours, "--out", folder / "both.html", folder=folder)
    assert done.code == 0, done.err
    assert "thesis" in (folder / "both.html").read_text()
