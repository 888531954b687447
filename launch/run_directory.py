"""The folder of a run: what is written there, and the figures of `summary.json`."""

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

RUNS = Path(RUNS_FOLDER)  # Where run directories are made, unless the user wants another folder
LATEST = "latest"  # Link to the last of them
RECORDING = "topics.mcap"  # Name of the recording in a run directory
MESH = "mesh.ply"  # Name of the solid, in m
RESULT = "result.json"  # Name of what an exploratory procedure found
SUMMARY = "summary.json"  # Name of the figures
COST_PICTURE = "cost.svg"  # Name of the picture of what accuracy cost
VERSIONED_PACKAGES = ("numpy", "scipy", "trimesh", "pyzmq", "msgspec", "mcap", "lz4")
Summary = dict[str, Any]
# Keys of `summary.json`, and the fields of a score that they hold.
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
# Keys of `summary.json` for what was asked, by the names of limits.
_LIMIT_KEYS = {
    "tolerance": "tolerance_m",
    "feature": "feature_m",
    "unknown_share": "unknown_share",
    "underside_share": "underside_share",
}
# The same of what nobody touched, in a PlanDone, and of a node, in its status.
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
    """A folder of one's own, made when the run begins."""

    path: Path  # The folder
    linked: bool  # Whether ``latest`` beside it shall point to it

    def check_room(self, spare: int) -> None:
        """Refuse a disk without the bytes that the recorder leaves free; nothing is made yet."""
        there = next(path for path in (self.path, *self.path.absolute().parents) if path.exists())
        left = free_bytes(there)
        if left < spare:
            raise InputError(
                f"{self.path}: only {left >> 20} MiB are free on its disk, and the recorder leaves "
                f"{spare >> 20} free; make room, or leave it out with --no-record"
            )

    def create(self) -> None:
        """Make the folder and show that it can be written; InputError if that is not possible."""
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
        """Write a file whole or not at all."""
        write_atomically({self.path / name: lambda part: part.write_text(text, encoding="utf-8")})

    def copy_inputs(self, inputs: Mapping[str, Path]) -> None:
        """Copy the files that the run was made with, by their names in this folder."""
        for name, file in inputs.items():
            (self.path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, self.path / name)

    def write_json(self, name: str, value: Mapping[str, Any]) -> None:
        """Write a JSON file whole or not at all; infinity and NaN are refused."""
        self.write_text(name, json.dumps(value, indent=2, allow_nan=False) + "\n")

    def write_result(self, result: ProcedureResult, recovered: Any) -> None:
        """Write what an exploratory procedure found, and the model of its kind, as JSON."""
        told = {"result": asdict(result)}
        if recovered is not None:
            fields = asdict(recovered).items()
            told[type(recovered).__name__] = {name: _plain(value) for name, value in fields}
        self.write_json(RESULT, told)

    def write_summary(self, summary: Summary) -> None:
        """Write the figures, and what accuracy cost as a picture."""
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

    Raises InputError if the folder that the user asks for holds something already, or its path is
    no text, which nodes could not be told.
    """
    whole = (RUNS if out is None else out).absolute()
    try:
        str(whole).encode()
    except UnicodeEncodeError:
        coding = sys.getfilesystemencoding().upper()
        raise InputError(
            f"{whole}: its name is no text in {coding}, so that nodes could not be told where to "
            "write; choose another folder"
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
    """The first free one of a path and those numbered after it: two may share a second."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free


def find_run_path(path: Path) -> Path:
    """The run directory of the running graph that a name without a file means; else the path.

    Raises InputError if several running graphs are called so.
    """
    if path.exists() or path.suffix or path.parent != Path():
        return path
    found = [card for card in running_graphs() if card.folder and card.is_called(path.name)]
    if len(found) > 1:
        known = ", ".join(f"{card.run[:6]} in {card.folder}" for card in found)
        raise InputError(f"{path}: several running graphs are called so: {known}")
    return Path(found[0].folder) if found else path


def run_directory_of(path: Path) -> Path:
    """The folder in which a recording lies; any other path as it is."""
    return path.parent if path.suffix == Path(RECORDING).suffix and path.is_file() else path


def find_run_mesh(path: Path) -> Path:
    """The solid of a run, given its directory or its recording; another file is itself.

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
    """The recording's first file, given that or a run directory; InputError if there is none."""
    bag = path / RECORDING if path.is_dir() else path
    if bag.is_file():
        return bag
    if path.is_dir():
        raise InputError(f"{path}: holds no recording: there is no {RECORDING} in it")
    why = "is no file" if path.exists() else "does not exist"
    raise InputError(f"{path}: the recording {why}")


def read_summary(run: Path) -> Summary:
    """The figures of a run, by its directory or recording; InputError if none can be read."""
    path = run_directory_of(run) / SUMMARY
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise InputError(f"{run}: is no directory of a run: there is no {SUMMARY} in it") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is no JSON: {error}") from None
    if not isinstance(found, dict):
        raise InputError(f"{path}: must hold a map, got {type(found).__name__}")
    return found


def versions_text() -> str:
    """Python and the packages that results and recordings depend on, in a line."""
    packages = (f"{name} {version(name)}" for name in VERSIONED_PACKAGES)
    return ", ".join((f"python {platform.python_version()}", *packages))


def summarise(ending: Ending, progress: Progress, scene: str | None, seed: int | None) -> Summary:
    """The figures of a run, ready for JSON."""
    model, done, score = progress.model, progress.done, progress.score
    known = done or progress.estimate  # an interrupted run has but estimates
    compute = sum(status.cpu for status in ending.statuses.values()) or None
    distances = {key: score and getattr(score, name) for key, name in SCORE_FIELDS.items()}
    verdict = _verdict(progress)
    summary = {
        "palpate": __version__,
        "status": ending.status,
        "reason": _reason(ending, done, verdict),
        "procedure": _procedure(progress.procedure),
        "scene": scene,
        "seed": seed,
        **distances,
        **_mesh_facts(model, score),
        "true_genus": _true_genus(score),
        "rms_bound_95_m": _error_bound(progress),
        "tolerance_m": (done.limits if done else {}).get("tolerance", progress.tolerance),
        "tolerance_met": next(
            (one.is_met for one in verdict.criteria if one.name == "error bound"), None
        ),
        "limits": done and {_LIMIT_KEYS[key]: value for key, value in done.limits.items()},
        "criteria": [{**one._asdict(), "is_met": one.is_met} for one in verdict.criteria],
        "reached": verdict.reached if done is not None else None,
        "largest_untouched_m": known and known.largest_untouched,
        **{key: done and _plain(getattr(done, name)) for key, name in OPEN_FIELDS.items()},
        "method": model and model.method,
        "rejected": [] if model is None else list(model.rejected),
        "predicted_m": {} if model is None else dict(sorted(model.predicted.items())),
        "turns": progress.turns,
        "placements": [] if model is None else model.placements.tolist(),
        "placement_errors_m": [] if model is None else model.placement_errors.tolist(),
        "placement_faults": [] if model is None else list(model.placement_faults),
        "contacts": progress.contacts,
        "contours": progress.contours,
        "contours_failed": progress.failed_contours,
        "uncovered_m": done and done.uncovered,
        "touches": progress.touches,
        "robot_time_s": progress.robot_time,
        "ready_s": progress.ready,
        "wall_s": progress.wall,
        "compute_s": compute,
        "touches_per_s": progress.touches_per_s,
        "mesh_sha256": mesh_sha256(model) if model is not None and len(model.faces) else None,
        "final": model is not None and model.final,
        "gaps": ending.gaps,
        "duplicates": ending.duplicates,
        "restarts": dict(ending.restarts),
        "nodes": {
            name: {key: getattr(status, field) for key, field in NODE_FIELDS.items()}
            for name, status in sorted(ending.statuses.items())
        },
        "steps": time_by_step(ending.statuses),
        "numerics": {} if model is None else dict(sorted(model.health.items())),
        "curve": cost_curve(progress, compute),
    }
    told = (done or progress.procedure) is not None and ending.status == "finished"
    return {**summary, "missed": missed_goals(summary) if told else []}


def _reason(ending: Ending, done: PlanDone | None, verdict: Verdict) -> str:
    """Why the exploration was over, and then the run; planners know neither mesh nor truth."""
    if done is None:
        return ending.reason
    is_missed = done.reached and verdict.reached is False
    why = "every limit that the planner knows of is kept" if is_missed else done.reason
    return f"{why}; {ending.reason}"


def _mesh_facts(model: ShapeModel | None, score: Score | None) -> dict[str, Any]:
    """What kind of surface the last model's mesh is: as its reconstructor says, or as measured."""
    closed = genus = crossings = None
    if model is not None and model.closed is not None:
        closed, genus, crossings = model.closed, model.genus, model.self_crossings
    elif score is not None:
        closed, genus = score.watertight, score.genus if score.watertight else None
    return {"watertight": closed, "genus": genus, "self_crossings": crossings}


def _verdict(progress: Progress) -> Verdict:
    """What was asked and reached, with what is known of the mesh and, in a simulation, the truth.

    Where no exploration has ended, nothing but the mesh is judged.
    """
    done, score, facts = progress.done, progress.score, _mesh_facts(progress.model, progress.score)
    known = {} if done is None else dict(done.findings)
    if "error_bound" in known:
        known["error_bound"] = _error_bound(progress) or 0.0
    found = Findings(
        **known,
        true_error=None if score is None else score.rms,
        closed=facts["watertight"],
        self_crossings=facts["self_crossings"],
        genus=facts["genus"],
        true_genus=_true_genus(score),
    )
    return judge(found, Limits() if done is None else Limits(**done.limits))


def _error_bound(progress: Progress) -> float | None:
    """What was stated of the solid, and at least what touches show the last model to lack [m]."""
    known = progress.done or progress.estimate
    if known is None or known.rms_bound_95 is None:
        return None
    return max(known.rms_bound_95, 0.0 if progress.model is None else progress.model.missing)


def _true_genus(score: Score | None) -> int | None:
    return score.true_genus if score is not None and score.true_genus >= 0 else None


def _procedure(found: ProcedureResult | None) -> dict[str, Any] | None:
    """What an exploratory procedure found; None of an exploration in slices."""
    if found is None:
        return None
    told = {"name": found.procedure, "status": found.status, "reason": found.reason}
    return {**told, **dict(sorted(found.figures.items()))}


def exit_code(summary: Mapping[str, Any], *, rebuilds: bool) -> int:
    """0 done, 1 the goal was missed, 3 a node died or all stood still, 130 interrupted.

    The goal is missed where a limit is not kept, whatever the budget that ended the run; and where
    it rebuilds, without a final model.
    """
    if summary["status"] == "interrupted":
        return 130
    if summary["status"] != "finished":
        return 3
    return int(bool(missed_goals(summary, rebuilds=rebuilds)))


def missed_goals(summary: Mapping[str, Any], *, rebuilds: bool = True) -> list[str]:
    """What a finished run was to reach and has not, in words: the limits that are not kept."""
    procedure = summary.get("procedure")
    if procedure is not None:  # it says itself what it was to find
        done = procedure["status"] == "done"
        return [] if done else [f"{procedure['status']}: {procedure['reason']}"]
    found = []
    if rebuilds and not summary["final"]:
        found.append("there is no final model")
    elif rebuilds and summary["mesh_sha256"] is None:
        found.append("there is no solid")
    return found + criteria_texts(summary, met=False)
