"""The folder of a run: its files, and the figures of `summary.json`."""

from __future__ import annotations

import json
import os
import platform
import shutil
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from palpate import __version__
from palpate.core.explore.planners import Findings, Limits, Verdict, judge
from palpate.launch.exchange_rate import cost_curve, time_by_step
from palpate.launch.files.file_access import write_atomically
from palpate.launch.files.mesh_file import mesh_sha256
from palpate.launch.files.source_map import InputError
from palpate.launch.processes.registry import RUNS_FOLDER, running_graphs
from palpate.launch.progress import Progress
from palpate.launch.summary_text import criteria_texts
from palpate.messages.recording import free_bytes
from palpate.messages.types import PlanDone, ProcedureResult, Score, ShapeModel
from palpate.nodes.runtime.composed import Ending

RUNS = Path(RUNS_FOLDER)  # parent of run directories, unless the user chooses another folder
LATEST = "latest"  # link to the last run directory
# Names of files in a run directory: the recording, the solid in m, the result of an exploratory
# procedure, the figures, and the charts of what accuracy cost.
RECORDING = "topics.mcap"
MESH = "mesh.ply"
RESULT = "result.json"
SUMMARY = "summary.json"
COST_PICTURE = "cost.svg"
VERSIONED_PACKAGES = ("numpy", "scipy", "trimesh", "pyzmq", "msgspec", "mcap", "lz4")
Summary = dict[str, Any]
# Keys of `summary.json`, and the fields of a Score with their values.
SCORE_FIELDS = {
    "chamfer_m": "chamfer",
    "rms_m": "rms",
    "exposed_rms_m": "exposed_rms",
    "hausdorff_m": "hausdorff",
    "p95_m": "p95",
    "normal_deg": "normal",
    "volume_error": "volume_error",
    "sampling_floor_m": "sampling_floor",
    "size_m": "size",
}
# Names of limits, and their keys in `summary.json`.
_LIMIT_KEYS = {
    "tolerance": "tolerance_m",
    "feature": "feature_m",
    "unknown_share": "unknown_share",
    "underside_share": "underside_share",
}
# Keys of `summary.json`, and the fields of a PlanDone and of a NodeStatus with their values.
OPEN_FIELDS = {
    "open_share": "open_share",
    "open_width_m": "open_width",
    "open_places_m": "open_places",
    "open_normals": "open_normals",
    "open_touches": "open_touches",
    "under_share": "under_share",
}
NODE_FIELDS = {"messages": "messages", "sent": "sent", "p50_us": "p50", "p99_us": "p99"}
NODE_FIELDS |= {"cpu_s": "cpu"}


@dataclass(frozen=True, slots=True)
class RunDirectory:
    """The folder of one run, made when the run begins."""

    path: Path
    linked: bool  # whether the link ``latest`` beside it is to point to it

    def check_room(self, spare: int) -> None:
        """Raise InputError if fewer than `spare` bytes are free; nothing is made yet."""
        parents = self.path, *self.path.absolute().parents
        free = free_bytes(next(path for path in parents if path.exists()))
        if free < spare:
            raise InputError(
                f"{self.path}: only {free >> 20} MiB are free on its disk, and the recorder leaves "
                f"{spare >> 20} free; make room, or leave it out with --no-record"
            )

    def create(self) -> None:
        """Make the folder; InputError if it cannot be made or written."""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            probe = self.path / ".probe"
            probe.write_bytes(b"")
            probe.unlink()
            if self.linked:
                _link_latest(self.path.parent / LATEST, self.path.name)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None

    def write_text(self, name: str, text: str) -> None:
        """Write a file, whole or not at all."""
        write_atomically({self.path / name: lambda part: part.write_text(text, encoding="utf-8")})

    def copy_inputs(self, inputs: Mapping[str, Path]) -> None:
        """Copy the input files of the run, by their names in this folder."""
        for name, file in inputs.items():
            (self.path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, self.path / name)

    def write_json(self, name: str, value: Mapping[str, Any]) -> None:
        """Write a JSON file, whole or not at all; ValueError for infinity and NaN."""
        self.write_text(name, json.dumps(value, indent=2, allow_nan=False) + "\n")

    def write_result(self, result: ProcedureResult, recovered: Any) -> None:
        """Write the result of an exploratory procedure and its model as JSON."""
        document = {"result": asdict(result)}
        if recovered is not None:
            fields = asdict(recovered).items()
            document[type(recovered).__name__] = {name: _plain(value) for name, value in fields}
        self.write_json(RESULT, document)

    def write_summary(self, summary: Summary) -> None:
        """Write the figures, and the charts of what accuracy cost."""
        self.write_json(SUMMARY, summary)
        from palpate.launch.cost_chart import cost_svg  # matplotlib takes long to import

        self.write_text(COST_PICTURE, cost_svg(summary))


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _link_latest(link: Path, target: str) -> None:
    part = link.with_name(f".{link.name}.{os.getpid()}")
    part.unlink(missing_ok=True)
    part.symlink_to(target)
    part.replace(link)


def choose_run_directory(name: str, out: Path | None) -> RunDirectory:
    """The folder for a run of this name, not yet made: `out`, or a new one in ``runs/``.

    Raises InputError if `out` is a file or is not empty, or if its path cannot be encoded as text
    for the nodes.
    """
    parent = (RUNS if out is None else out).absolute()
    try:
        str(parent).encode()
    except UnicodeEncodeError:
        coding = sys.getfilesystemencoding().upper()
        raise InputError(
            f"{parent}: its name cannot be encoded in {coding} for the nodes; choose another folder"
        ) from None
    if out is None:
        stamp = time.strftime("%Y-%m-%dT%H-%M-%S")
        return RunDirectory(free_path(RUNS / f"{stamp}_{name}"), linked=True)
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: is a file; it must be a new or an empty folder")
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"--out {out}: is not empty; choose a new or an empty folder")
    return RunDirectory(out, linked=False)


def free_path(path: Path) -> Path:
    """`path`, or the first free one of those numbered after it: ``name-2``, ``name-3``."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free


def find_run_path(path: Path) -> Path:
    """The run directory of the running graph of this name; a path that exists is returned as is.

    Raises InputError if several running graphs have this name.
    """
    if path.exists() or path.suffix or path.parent != Path():
        return path
    cards = [card for card in running_graphs() if card.folder and card.is_called(path.name)]
    if len(cards) > 1:
        known = ", ".join(f"{card.run[:6]} in {card.folder}" for card in cards)
        raise InputError(f"{path}: several running graphs have this name: {known}")
    return Path(cards[0].folder) if cards else path


def run_directory_of(path: Path) -> Path:
    """The folder of a recording; any other path is returned as is."""
    return path.parent if path.suffix == Path(RECORDING).suffix and path.is_file() else path


def find_run_mesh(path: Path) -> Path:
    """The file of a run's solid, given its directory or recording; another file is returned as is.

    Raises InputError if there is no such file, or the run has no solid.
    """
    folder = run_directory_of(path)
    if not path.exists():
        raise InputError(f"{path}: does not exist; it must be a run or a file of a solid")
    if not folder.is_dir():
        return path
    if not (folder / MESH).is_file():
        raise InputError(f"{folder}: holds no rebuilt solid: there is no {MESH} in it")
    return folder / MESH


def find_bag(path: Path) -> Path:
    """The recording, given its file or a run directory; InputError if there is none."""
    bag = path / RECORDING if path.is_dir() else path
    if bag.is_file():
        return bag
    if path.is_dir():
        raise InputError(f"{path}: holds no recording: there is no {RECORDING} in it")
    why = "is no file" if path.exists() else "does not exist"
    raise InputError(f"{path}: the recording {why}")


def read_summary(run: Path) -> Summary:
    """The figures of a run, given its directory or recording; InputError if they cannot be read."""
    path = run_directory_of(run) / SUMMARY
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise InputError(f"{run}: is no directory of a run: there is no {SUMMARY} in it") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is no JSON: {error}") from None
    if not isinstance(summary, dict):
        raise InputError(f"{path}: must hold a map, got {type(summary).__name__}")
    return summary


def versions_text() -> str:
    """Versions of Python and of the packages on which results and recordings depend, in a line."""
    packages = (f"{name} {version(name)}" for name in VERSIONED_PACKAGES)
    return ", ".join((f"python {platform.python_version()}", *packages))


def summarise(ending: Ending, progress: Progress, scene: str | None, seed: int | None) -> Summary:
    """The figures of a run, ready for JSON."""
    model, done, score = progress.model, progress.done, progress.score
    compute = sum(status.cpu for status in ending.statuses.values()) or None
    verdict = _verdict(progress)
    summary = {
        "palpate": __version__,
        "status": ending.status,
        "reason": _reason(ending, done, verdict),
        "procedure": _procedure(progress.procedure),
        "scene": scene,
        "seed": seed,
        **{key: score and getattr(score, name) for key, name in SCORE_FIELDS.items()},
        **_mesh_facts(model, score),
        "true_genus": _true_genus(score),
        **_verdict_facts(progress, verdict),
        **_model_facts(model, progress.turns),
        **_cost_facts(progress, compute),
        "mesh_sha256": mesh_sha256(model) if model is not None and len(model.faces) else None,
        "final": model is not None and model.final,
        **_graph_facts(ending),
        "steps": time_by_step(ending.statuses),
        "numerics": {} if model is None else dict(sorted(model.health.items())),
        "curve": cost_curve(progress, compute),
    }
    has_result = (done or progress.procedure) is not None and ending.status == "finished"
    return {**summary, "missed": missed_goals(summary) if has_result else []}


def _verdict_facts(progress: Progress, verdict: Verdict) -> Summary:
    """Bound, limits and whether each is met, and what is untouched."""
    done = progress.done
    known = done or progress.estimate  # an interrupted run has only estimates
    met = (item.is_met for item in verdict.criteria if item.name == "error bound")
    return {
        "rms_bound_95_m": _error_bound(progress),
        "tolerance_m": (done.limits if done else {}).get("tolerance", progress.tolerance),
        "tolerance_met": next(met, None),
        "limits": done and {_LIMIT_KEYS[key]: value for key, value in done.limits.items()},
        "criteria": [{**item._asdict(), "is_met": item.is_met} for item in verdict.criteria],
        "reached": verdict.reached if done is not None else None,
        "largest_untouched_m": known and known.largest_untouched,
        **{key: done and _plain(getattr(done, name)) for key, name in OPEN_FIELDS.items()},
    }


def _model_facts(model: ShapeModel | None, turns: int) -> Summary:
    """How the last model was made, and how the object lay."""
    return {
        "method": model and model.method,
        "rejected": [] if model is None else list(model.rejected),
        "predicted_m": {} if model is None else dict(sorted(model.predicted.items())),
        "turns": turns,
        "placements": [] if model is None else model.placements.tolist(),
        "placement_errors_m": [] if model is None else model.placement_errors.tolist(),
        "placement_faults": [] if model is None else list(model.placement_faults),
    }


def _cost_facts(progress: Progress, compute: float | None) -> Summary:
    """Counts of contours and touches, and times."""
    return {
        "contacts": progress.contacts,
        "contours": progress.contours,
        "contours_failed": progress.failed_contours,
        "uncovered_m": progress.done and progress.done.uncovered,
        "touches": progress.touches,
        "robot_time_s": progress.robot_time,
        "ready_s": progress.ready,
        "wall_s": progress.wall,
        "compute_s": compute,
        "touches_per_s": progress.touches_per_s,
    }


def _graph_facts(ending: Ending) -> Summary:
    """Lost messages, restarts and the last counters of each node."""
    return {
        "gaps": ending.gaps,
        "duplicates": ending.duplicates,
        "restarts": dict(ending.restarts),
        "nodes": {
            name: {key: getattr(status, field) for key, field in NODE_FIELDS.items()}
            for name, status in sorted(ending.statuses.items())
        },
    }


def _reason(ending: Ending, done: PlanDone | None, verdict: Verdict) -> str:
    """Why the exploration ended, then why the run ended; planners know neither mesh nor truth."""
    if done is None:
        return ending.reason
    is_missed = done.reached and verdict.reached is False
    why = "every limit that the planner knows of is kept" if is_missed else done.reason
    return f"{why}; {ending.reason}"


def _mesh_facts(model: ShapeModel | None, score: Score | None) -> dict[str, Any]:
    """Closedness, genus and self-crossings of the mesh, from the reconstructor, else the score."""
    closed = genus = crossings = None
    if model is not None and model.closed is not None:
        closed, genus, crossings = model.closed, model.genus, model.self_crossings
    elif score is not None:
        closed, genus = score.watertight, score.genus if score.watertight else None
    return {"watertight": closed, "genus": genus, "self_crossings": crossings}


def _verdict(progress: Progress) -> Verdict:
    """The limits, judged with the mesh and, in a simulation, the truth.

    Before an exploration has ended, only the mesh is judged.
    """
    done, score, facts = progress.done, progress.score, _mesh_facts(progress.model, progress.score)
    known = {} if done is None else dict(done.findings)
    if "error_bound" in known:
        known["error_bound"] = _error_bound(progress) or 0.0
    findings = Findings(
        **known,
        true_error=None if score is None else score.rms,
        closed=facts["watertight"],
        self_crossings=facts["self_crossings"],
        genus=facts["genus"],
        true_genus=_true_genus(score),
    )
    return judge(findings, Limits() if done is None else Limits(**done.limits))


def _error_bound(progress: Progress) -> float | None:
    """The stated error bound, or the largest part that the last model lacks, if larger [m]."""
    known = progress.done or progress.estimate
    if known is None or known.rms_bound_95 is None:
        return None
    return max(known.rms_bound_95, 0.0 if progress.model is None else progress.model.missing)


def _true_genus(score: Score | None) -> int | None:
    return score.true_genus if score is not None and score.true_genus >= 0 else None


def _procedure(result: ProcedureResult | None) -> dict[str, Any] | None:
    """The result of an exploratory procedure; None if there was none."""
    if result is None:
        return None
    facts = {"name": result.procedure, "status": result.status, "reason": result.reason}
    return {**facts, **dict(sorted(result.figures.items()))}


def exit_code(summary: Mapping[str, Any], *, rebuilds: bool) -> int:
    """0 done, 1 the goal was missed, 3 a node died or all nodes stalled, 130 interrupted.

    The goal is missed if a limit is not met, even where a budget ended the run; and if the run
    `rebuilds` a solid and has no final model.
    """
    if summary["status"] == "interrupted":
        return 130
    if summary["status"] != "finished":
        return 3
    return int(bool(missed_goals(summary, rebuilds=rebuilds)))


def missed_goals(summary: Mapping[str, Any], *, rebuilds: bool = True) -> list[str]:
    """What a finished run has missed, in words: limits, and the solid if it `rebuilds` one."""
    procedure = summary.get("procedure")
    if procedure is not None:  # it judges itself
        is_done = procedure["status"] == "done"
        return [] if is_done else [f"{procedure['status']}: {procedure['reason']}"]
    missed = []
    if rebuilds and not summary["final"]:
        missed.append("there is no final model")
    elif rebuilds and summary["mesh_sha256"] is None:
        missed.append("there is no solid")
    return missed + criteria_texts(summary, met=False)
