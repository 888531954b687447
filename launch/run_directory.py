"""The folder of a run: what is written there, and the figures of `summary.json`."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from palpate import __version__
from palpate.launch.files import InputError, mesh_sha256
from palpate.launch.printing import millimetres, text_table, titled
from palpate.launch.progress import Progress
from palpate.messages.recording import free_bytes
from palpate.messages.types import NodeStatus, PlanDone, Score
from palpate.nodes.runtime import Ending

RUNS = Path("runs")  # Where run directories are made, unless the user says otherwise
LATEST = "latest"  # Link to the last of them
RECORDING = "topics.mcap"  # Name of the recording in a run directory
VERSIONED_PACKAGES = ("numpy", "scipy", "trimesh", "pyzmq", "msgpack", "msgspec", "mcap", "lz4")
Summary = dict[str, Any]
TITLE_WIDTH = 11
ENDED = {"finished": "done", "died": "died", "stalled": "stalled", "interrupted": "stopped"}


@dataclass(frozen=True, slots=True)
class RunDirectory:
    """A folder of one's own, made when the run begins."""

    path: Path  # The folder
    linked: bool  # Whether ``latest`` beside it shall point to it

    def check_room(self, spare: int) -> None:
        """Refuse a disk that is too full for a recording, before anything is made.

        Parameters
        ----------
        spare : int
            Bytes that the recorder leaves free.

        Raises
        ------
        InputError
            If there are not even that many.
        """
        there = next(path for path in (self.path, *self.path.absolute().parents) if path.exists())
        left = free_bytes(there)
        if left < spare:
            raise InputError(
                f"{self.path}: only {left >> 20} MiB are free on its disk, and the recorder leaves "
                f"{spare >> 20} free; make room, or leave it out with --no-record"
            )

    def create(self) -> None:
        """Make the folder and show that it can be written.

        Raises
        ------
        InputError
            If that is not possible.
        """
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
        part = self.path / f".{name}.part"
        part.write_text(text, encoding="utf-8")
        part.replace(self.path / name)

    def write_json(self, name: str, value: Mapping[str, Any]) -> None:
        """Write a JSON file whole or not at all; infinity and NaN are refused."""
        self.write_text(name, json.dumps(value, indent=2, allow_nan=False) + "\n")

    def files(self) -> tuple[str, ...]:
        """Names of what lies in it."""
        return tuple(sorted(entry.name for entry in self.path.iterdir()))


def _link_latest(link: Path, target: str) -> None:
    part = link.with_name(f".{link.name}.{os.getpid()}")
    part.unlink(missing_ok=True)
    part.symlink_to(target)
    part.replace(link)


def choose_run_directory(name: str, out: Path | None) -> RunDirectory:
    """The folder for a run, not yet made.

    Parameters
    ----------
    name : str
        Name of the scene or launch file.
    out : Path or None
        The folder that the user asks for; None for a new one in ``runs/``.

    Raises
    ------
    InputError
        If the folder that the user asks for holds something already.
    """
    if out is None:
        stamp = time.strftime("%Y-%m-%dT%H-%M-%S")
        return RunDirectory(_free(RUNS / f"{stamp}_{name}"), linked=True)
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: is a file; it must be a new or an empty folder")
    if out.is_dir() and any(out.iterdir()):
        raise InputError(f"--out {out}: is not empty; choose a new or an empty folder")
    return RunDirectory(out, linked=False)


def _free(path: Path) -> Path:
    """The path, or the first one numbered after it that is free: two runs may share a second."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name}-{number}")
    return free


def find_bag(path: Path) -> Path:
    """The recording's first file; `path` is that, or a run directory.

    Raises
    ------
    InputError
        If there is none.
    """
    bag = path / RECORDING if path.is_dir() else path
    if bag.is_file():
        return bag
    if path.is_dir():
        raise InputError(f"{path}: holds no recording: there is no {RECORDING} in it")
    why = "is no file" if path.exists() else "does not exist"
    raise InputError(f"{path}: the recording {why}")


def versions_text() -> str:
    """The same in a line."""
    return ", ".join(f"{name} {number}" for name, number in versions().items())


def versions() -> dict[str, str]:
    """Python and the packages that results and recordings depend on, by name."""
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in VERSIONED_PACKAGES},
    }


def summarise(ending: Ending, progress: Progress, scene: str | None, seed: int | None) -> Summary:
    """The figures of a run.

    Parameters
    ----------
    ending : Ending
        How the graph ended.
    progress : Progress
        What was heard on the way.
    scene : str or None
        Name of the scene.
    seed : int or None
        The run's seed.

    Returns
    -------
    dict
        Ready for JSON.
    """
    model, wall = progress.model, progress.wall
    compute = sum(status.cpu for status in ending.statuses.values())
    return {
        "palpate": __version__,
        "status": ending.status,
        "reason": ending.reason if progress.done is None else _reason(ending, progress.done),
        "scene": scene,
        "seed": seed,
        **_distances(progress.score),
        "rms_bound_95_m": None if progress.done is None else progress.done.rms_bound_95,
        "tolerance_met": None if progress.done is None else progress.done.tolerance_met,
        "largest_untouched_m": None if progress.done is None else progress.done.largest_untouched,
        "contacts": progress.contacts,
        "contours": progress.contours,
        "contours_failed": progress.failed,
        "uncovered_m": None if progress.done is None else progress.done.uncovered,
        "touches": progress.touches,
        "robot_time_s": progress.robot_time,
        "ready_s": progress.ready,
        "wall_s": wall,
        "compute_s": compute if compute > 0.0 else None,
        "touches_per_s": progress.touches_per_s,
        "mesh_sha256": mesh_sha256(model) if model is not None and len(model.faces) else None,
        "final": model is not None and model.final,
        "gaps": ending.gaps,
        "duplicates": ending.duplicates,
        "restarts": dict(ending.restarts),
        "nodes": {name: _node(status) for name, status in sorted(ending.statuses.items())},
        "numerics": {} if model is None else dict(sorted(model.health.items())),
        "curve": [_point(seconds, score) for seconds, score in progress.scores],
    }


def _reason(ending: Ending, done: PlanDone) -> str:
    return f"{done.reason}; {ending.reason}"


def _distances(score: Score | None) -> Summary:
    names = {
        "chamfer_m": "chamfer",
        "rms_m": "rms",
        "hausdorff_m": "hausdorff",
        "p95_m": "p95",
        "normal_deg": "normal",
        "volume_error": "volume_error",
        "sampling_floor_m": "sampling_floor",
        "size_m": "size",
        "watertight": "watertight",
        "genus": "genus",
    }
    found = {key: None if score is None else getattr(score, name) for key, name in names.items()}
    if found["genus"] is not None and found["genus"] < 0:
        found["genus"] = None  # an open surface has no handles to count
    return found


def _node(status: NodeStatus) -> Summary:
    return {
        "messages": status.messages,
        "sent": status.sent,
        "p50_us": status.p50,
        "p99_us": status.p99,
        "cpu_s": status.cpu,
    }


def _point(seconds: float, score: Score) -> Summary:
    return {
        "contours": score.contours,
        "touches": score.touches,
        "robot_time_s": score.robot_time,
        "wall_s": seconds,
        "chamfer_m": score.chamfer,
        "rms_m": score.rms,
    }


def exit_code(summary: Mapping[str, Any], *, rebuilds: bool) -> int:
    """Exit code of a run.

    Parameters
    ----------
    summary : map
        The run's figures.
    rebuilds : bool
        Whether the graph has a node that rebuilds: then a run without a final, watertight model
        has missed its goal, and so has one that left a part of the object untraced.

    Returns
    -------
    int
        0 done, 1 the goal was missed, 3 a node died or all stood still, 130 interrupted.
    """
    if summary["status"] == "interrupted":
        return 130
    if summary["status"] != "finished":
        return 3
    solid = summary["mesh_sha256"] is not None and summary["watertight"] is not False
    covered = not summary["uncovered_m"]
    missed = rebuilds and not (summary["final"] and solid and covered)
    return 1 if missed else 0


def summary_text(summary: Mapping[str, Any], files: Sequence[str], folder: Path) -> str:
    """The figures as lines of at most 80 columns.

    Parameters
    ----------
    summary : map
        The run's figures.
    files : texts
        Names of what the run left behind.
    folder : Path
        Where it lies.
    """
    lines = [*_result(summary), *_time(summary), *_node_table(summary["nodes"])]
    lines += titled("numerics", *[f"{k} {v:.3g}" for k, v in summary["numerics"].items()])
    lines += titled("outputs", *files)
    lines += titled(ENDED[summary["status"]], summary["reason"])
    return "\n".join((*lines, *titled("run", str(folder))))


def _result(summary: Mapping[str, Any]) -> list[str]:
    if summary["chamfer_m"] is None:
        return titled("result", "no model was measured")
    share = 100.0 * summary["chamfer_m"] / summary["size_m"]
    near = [
        f"chamfer {millimetres(summary['chamfer_m'])} ({share:.2f} % of the height)",
        f"p95 {millimetres(summary['p95_m'])}",
        f"worst {millimetres(summary['hausdorff_m'])}",
    ]
    rest = [
        f"sampling floor {millimetres(summary['sampling_floor_m'])}",
        f"normals {summary['normal_deg']:.1f} deg",
        f"volume {100.0 * summary['volume_error']:+.2f} %",
        f"watertight {'yes' if summary['watertight'] else 'NO'}",
    ]
    return [*titled("result", *near), *titled("", *rest), *_error_bound(summary)]


def _error_bound(summary: Mapping[str, Any]) -> list[str]:
    """What the run says of its own error, beside the truth."""
    if summary["rms_bound_95_m"] is None:
        return []
    bound, truth = millimetres(summary["rms_bound_95_m"]), millimetres(summary["rms_m"])
    parts = [f"rms below {bound} (95 %), in truth {truth}"]
    if summary["largest_untouched_m"] is not None:
        parts.append(f"untouched at most {millimetres(summary['largest_untouched_m'])}")
    return titled("promise", *parts)


def _time(summary: Mapping[str, Any]) -> list[str]:
    parts = [
        f"{summary['contacts']} contacts",
        f"{summary['contours']} contours",
        f"{summary['touches']} touches",
        f"robot {summary['robot_time_s']:.1f} s",
        f"wall {summary['wall_s']:.1f} s",
    ]
    if summary["compute_s"] is not None:
        parts.append(f"compute {summary['compute_s']:.1f} s")
    if summary["touches_per_s"]:
        parts.append(f"{summary['touches_per_s']:.0f} touches/s")
    return titled("time", *parts)


def _node_table(nodes: Mapping[str, Mapping[str, Any]]) -> list[str]:
    if not nodes:
        return []
    rows = [("nodes", "node", "messages", "p50 us", "p99 us", "CPU s")]
    for name, one in nodes.items():
        timing = f"{one['p50_us']:.0f}", f"{one['p99_us']:.0f}", f"{one['cpu_s']:.2f}"
        rows.append(("", name, str(one["messages"]), *timing))
    return text_table(rows, right=range(2, 6), least=(TITLE_WIDTH - 2,))
