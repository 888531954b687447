from pathlib import Path

import numpy as np
import pytest

from palpate.launch.printing import TEXT_WIDTH
from palpate.launch.progress import Progress
from palpate.launch.run_directory import summarise
from palpate.launch.summary_text import details_text, headline_text
from palpate.messages.types.catalogue import NodeStatus
from palpate.messages.types.model import PlanDone
from palpate.messages.types.procedure import ProcedureResult
from palpate.nodes.runtime.composed import Ending

RUN = Path("runs/r")


def ending(status="finished", reason="all slices are traced"):
    counts = {"messages": 40, "sent": 40, "gaps": 0, "duplicates": 0}
    told = NodeStatus(
        node="filter", state="ending", p50=80.0, p99=120.0, cpu=1.5, steps={"filter": 1.0}, **counts
    )
    return Ending(status=status, reason=reason, statuses={"filter": told})


def planned(**changed):
    told = {
        "number": 3, "contours": (1, 2), "probes": (), "touches": 40, "robot_time": 20.0,
        "reason": "enough", "reached": True, "rms_bound_95": 28e-6,
        "largest_untouched": 2.5e-3, "uncovered": 0.0, "findings": {"error_bound": 28e-6},
        "limits": {"tolerance": 5e-4, "feature": 0.02, "unknown_share": 0.01},
    }  # fmt: skip
    return PlanDone(**{**told, **changed})


@pytest.fixture
def progress(tetrahedron, score):
    return Progress(
        contours=2, touches=40, robot_time=20.0, wall=4.0, tolerance=5e-4, model=tetrahedron,
        scores=[(3.0, score)], done=planned(),
    )  # fmt: skip


def summary_of(progress, *told):
    return summarise(ending(*told), progress, "vase", 7)


def test_what_was_found_asked_and_spent_is_said_in_few_lines(progress):
    lines = headline_text(summary_of(progress), ["mesh.glb", "topics.mcap"], RUN).splitlines()
    assert lines[0] == "found      a closed solid, 30 mm high  rms error 0.400 mm"
    assert lines[1].strip() == "sampling floor 0.050 mm"
    assert lines[2].startswith("reached    error bound 0.028 mm (limit 0.5 mm)")
    assert "cost       2 contours  40 touches  robot 20.0 s  wall 4.0 s  compute 1.5 s" in lines
    assert lines[-2] == "done       enough; all slices are traced"
    assert lines[-1] == "open       runs/r/mesh.glb  (all figures in summary.json)"


OPEN = {
    "open_share": 0.4, "open_width": 0.02, "under_share": 0.1, "open_touches": 99.4,
    "open_places": np.array([[0.01, 0.02, 0.03]]),
}  # fmt: skip


@pytest.mark.parametrize("status", ["finished", "died", "stalled", "interrupted"])
@pytest.mark.parametrize("folder", [RUN, Path("runs") / ("a_long_name_" * 8)])
def test_nothing_is_cut_off_however_long_it_is(progress, status, folder):
    progress.failed = 3
    reason = "why " * 100 + "indeed"
    progress.done = planned(reason=reason, findings={"error_bound": 1e-3}, **OPEN)
    text = headline_text(summary_of(progress, status, "so " * 90 + "there"), ["a"], folder)
    assert "..." not in text
    assert max(len(line) for line in text.splitlines() if str(folder) not in line) <= TEXT_WIDTH
    words = " ".join(text.split())
    assert f"{' '.join(reason.split())}; {'so ' * 90}there" in words
    assert (
        "40.0 % of the surface is unknown, the widest part 20.000 mm wide at (10, 20, 30)" in words
    )
    assert "10.0 % of the surface is the underside" in words
    assert "3 slices could not be traced" in words


def test_a_share_too_small_for_a_digit_is_not_called_nothing(progress):
    progress.done = planned(**OPEN | {"open_share": 4e-4})
    text = " ".join(headline_text(summary_of(progress), [], RUN).split())
    assert "under 0.1 % of the surface is unknown" in text


def test_a_true_error_beyond_the_bound_is_a_doubt(progress, score):
    bound = 0.5 * score.rms
    progress.done = planned(findings={"error_bound": bound}, rms_bound_95=bound)
    text = headline_text(summary_of(progress), [], RUN)
    assert "the rms error is larger than the stated bound" in text


def test_restarts_losses_and_failed_slices_are_doubts(progress):
    progress.failed = 1
    summary = summary_of(progress) | {"restarts": {"tracer": 2}, "gaps": 3}
    text = headline_text(summary, [], RUN)
    words = " ".join(text.split())
    assert "1 slice could not be traced restarted: tracer" in words
    assert "messages lost: 3, received twice: 0" in text


def test_a_procedure_tells_what_it_found_or_why_not(progress):
    figures = {"axis_error_deg": 0.1, "residual_rms_m": 1e-5, "volume_m3": 1e-4, "faces": 6.0}
    given = {
        "procedure": "planar",
        "figures": figures,
        "touches": 40,
        "contacts": 0,
        "robot_time": 9.0,
    }
    alone = Progress(touches=40)
    alone.procedure = ProcedureResult(status="done", reason="it closes", **given)
    text = headline_text(summary_of(alone), ["result.json"], RUN)
    assert text.splitlines()[0] == "planar      done: it closes  axis error 0.100 deg  faces 6"
    assert "residual rms 0.010 mm  volume 100.0 cm3" in text and "runs/r/result.json" in text
    alone.procedure = ProcedureResult(status="unsuited", reason="it is round", **given)
    lines = headline_text(summary_of(alone), [], RUN).splitlines()
    assert lines[0] == "found      no solid" and "missed     unsuited: it is round" in lines


def test_nothing_found_is_said(progress):
    summary = summarise(Ending(status="died", reason="boom"), Progress(), None, None)
    lines = headline_text(summary, ["log.jsonl"], RUN).splitlines()
    assert lines[0] == "found      no solid" and lines[-2] == "died       boom"
    assert "result     no model was measured" in details_text(summary, [])


def test_all_figures_are_told_on_request(progress):
    summary = summary_of(progress)
    files = [f"a_rather_long_name_{i}.json" for i in range(9)]
    lines = details_text(summary, files).splitlines()
    assert max(map(len, lines)) <= TEXT_WIDTH
    text = "\n".join(lines)
    assert "chamfer 0.300 mm (1.00 % of the height)" in text and "watertight yes" in text
    assert ["filter", "40", "80", "120", "1.50"] in [line.split() for line in lines]
    assert all(name in text for name in files)
    assert "steps      filter 67 %  rest 33 %  of 1.5 s" in lines
    assert any(line.startswith("curve  ") for line in lines)
