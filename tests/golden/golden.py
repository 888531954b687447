"""What palpate computes, frozen: every figure of the command line against what is stored.

    python tests/golden/golden.py                 compare all; exits with 1 if any differs
    python tests/golden/golden.py --quick         those that take a few seconds
    python tests/golden/golden.py --only 'run/*'  those whose names match
    python tests/golden/golden.py --figures       leave sentences and help texts aside
    python tests/golden/golden.py --renew         store them anew

Figures lie in ``stored/`` as flat maps ``{"path.to.key": value}``, floats to the last bit, texts as
they were printed. Times, versions and hosts are not among them; all else is the same from run to
run. Other machines and other versions of numpy round differently: ``stored/made_on.json`` says
where these were made, and a line is printed if that was elsewhere.
"""

from __future__ import annotations

import argparse
import difflib
import fnmatch
import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from ruamel.yaml import YAML
from threadpoolctl import threadpool_info

import palpate
from palpate.tools.cli.command_line import palpate_group as command_tree
from palpate.tools.reconstruction import single_threaded

STORED = Path(__file__).parent / "stored"
MADE_ON = STORED / "made_on.json"
SCENES = (
    *("bottle", "box", "cylinder", "dented", "egg", "from_mesh", "gem", "hyperquadric"),
    *("notched", "oblique", "sphere", "twisted", "vase", "worn_sensor"),
)
RECORDED = "sphere"  # the run that replay, cost and score look at; a quick one
RECORD = ("run", RECORDED, "--out", RECORDED, "--json")
REPLAY = ("replay", RECORDED, "--nodes", "filter,curvature")
RESUME = ("replay", RECORDED, "--from", "contour=3", "--out", "resumed", "--json")
SCORE = ("score", f"{RECORDED}/model.npz", f"{RECORDED}/mesh.stl", "--json")  # STL rounds
METHODS = ("lattice", "skin", "thesis", "coarse")
VOLATILE = frozenset(
    (
        *("palpate", "wall_s", "ready_s", "compute_s", "touches_per_s", "cpu_s", "p50_us"),
        *("p99_us", "steps"),
    )
)
LIMITS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
FIXED = {**LIMITS, "COLUMNS": "80", "LC_ALL": "C.UTF-8", "NO_COLOR": "1"}
NUMBER = re.compile(r"-?\b\d+(?:\.\d+)?(?:e-?\d+)?\b")
SHOWN = 6  # differences that are shown of one golden

Array = np.ndarray[Any, np.dtype[Any]]
Flat = dict[str, str | int | float | bool | None]
Made = Flat | str


class Workshop:
    """A temporary folder in which commands run, so that the names of their files are the same."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._recorded: Flat = {}

    def call(self, *words: str) -> tuple[int, str]:
        """Exit code, 0 or 1, and output of ``palpate WORDS``; any other code is an error."""
        done = subprocess.run(
            [sys.executable, "-m", "palpate", *words],
            cwd=self.folder,
            env={**os.environ, **FIXED},
            capture_output=True,
            text=True,
            timeout=600.0,
        )
        if done.returncode not in (0, 1):
            raise RuntimeError(f"palpate {' '.join(words)}: {done.returncode}: {done.stderr}")
        return done.returncode, done.stdout

    def figures(self, *words: str) -> Flat:
        """Exit code of ``palpate WORDS`` and what it printed, as JSON or in lines."""
        code, out = self.call(*words)
        found = json.loads(out) if "--json" in words else {"lines": out.splitlines()}
        return {"exit": code, **flatten(found)}

    def recorded(self) -> Flat:
        """The run in the folder `RECORDED`, done once."""
        with self._lock:
            self._recorded = self._recorded or self.figures(*RECORD)
            return dict(self._recorded)

    def write_table(self, name: str, header: str, rows: Array) -> None:
        """A CSV file as a measuring machine would write it."""
        path = self.folder / name
        np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=header, comments="")

    def write_contours(self, name: str) -> None:
        """An NPZ file of `ridged` contours."""
        arrays = {f"contour_{i}": one for i, one in enumerate(ridged()[0])}
        np.savez(self.folder / name, allow_pickle=False, **arrays)

    def sha256(self, *names: str) -> Flat:
        paths = {f"sha256.{name.replace('.', '_')}": self.folder / name for name in names}
        return {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in paths.items()}


def flatten(value: Any, path: str = "") -> Flat:
    """Figures by dotted keys, without those that are never the same; empty parts as themselves."""
    if isinstance(value, list | tuple):
        value = dict(enumerate(value)) or "[]"
    if not isinstance(value, dict):
        return {path: value}
    found: Flat = {} if value else {path: "{}"}
    for key, part in value.items():
        if key not in VOLATILE:
            found |= flatten(part, f"{path}.{key}" if path else str(key))
    return found


def sha256(*arrays: Array) -> str:
    """Fingerprint of arrays: whole numbers as int32, all else as float64."""
    kinds = ("<f8" if array.dtype.kind == "f" else "<i4" for array in arrays)
    parts = (array.astype(kind).tobytes() for array, kind in zip(arrays, kinds, strict=True))
    return hashlib.sha256(b"".join(parts)).hexdigest()


# What is measured: a body of 78 by 62 by 80 mm with three ridges, by formula.
TOPS = np.array([[0.0, 0.0, -0.047], [0.001, 0.0, 0.046]])
AXES = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])


def ridged(grown: int = 3) -> tuple[list[Array], list[Array]]:
    """Contours in m, begun elsewhere each, and outward normals; alike and as long if not grown."""
    contours, normals = [], []
    for number, height in enumerate(np.linspace(-0.04, 0.04, 13)):
        count, first, way = 48 + grown * number, 0.1 * grown * number, (-1) ** (grown * number)
        turn = 2.0 * np.pi * (np.arange(count) + first) / count
        radius = 0.03 * np.sqrt(1.0 - (height / 0.055) ** 2)
        wave, slope = 1.0 + 0.1 * np.cos(3.0 * turn), -0.3 * np.sin(3.0 * turn)
        x, y = 1.3 * radius * wave * np.cos(turn), radius * wave * np.sin(turn)
        by_x = 1.3 * radius * (slope * np.cos(turn) - wave * np.sin(turn))
        by_y = radius * (slope * np.sin(turn) + wave * np.cos(turn))
        rise = 1.3 * (0.03 * wave) ** 2 * height / 0.055**2
        outward = np.column_stack([by_y, -by_x, rise])
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        contours.append(np.column_stack([x, y, np.full(count, height)])[::way])
        normals.append(outward[::way])
    return contours, normals


def run(shop: Workshop, name: str, *options: str) -> Flat:
    """Of ``palpate run``: its summary, and the files that it leaves."""
    recorded = name == RECORDED and not options
    out = RECORDED if recorded else "_".join(["run", name, *options])
    words = ("run", name, *options, "--out", out, "--json")
    found = shop.recorded() if recorded else shop.figures(*words)
    found |= shop.sha256(*(f"{out}/mesh.{kind}" for kind in ("ply", "stl", "glb")))
    if not recorded:
        shutil.rmtree(shop.folder / out)
    return found


def of_recorded(shop: Workshop, *words: str) -> Flat:
    """Of a verb that looks at a run."""
    shop.recorded()
    return shop.figures(*words)


def resume(shop: Workshop) -> Flat:
    """An exploration that goes on from its sixth contour, without what hangs on the time it took.

    Scores that were not sent yet when that contour was known are lost: a known fault.
    """
    late = ("exit", "curve.", "nodes.evaluator.sent", "nodes.recorder.messages")
    found = of_recorded(shop, *RESUME) | shop.sha256("resumed/mesh.ply")
    return {key: value for key, value in found.items() if not key.startswith(late)}


def score_points(shop: Workshop) -> Flat:
    """A solid against the points that it was made of, moved elsewhere and in mm."""
    points = np.concatenate(ridged()[0]) @ AXES.T + (0.02, -0.01, 0.03)
    shop.write_table("moved.csv", "x,y,z", 1e3 * points)
    shop.write_contours("fixed.npz")
    shop.call("rebuild", "fixed.npz", "-o", "fixed.ply")
    words = ("fixed.ply", "moved.csv", "--reference-unit", "mm", "--align", "--json")
    return shop.figures("score", *words)


def calibrate(shop: Workshop) -> Flat:
    """Of the worn sensor: the numbers of the report, and of the file."""
    code, out = shop.call("calibrate", "worn_sensor", "--out", "worn.yaml", "--quiet")
    report = {line[:12].strip(): NUMBER.findall(line[12:]) for line in out.splitlines()}
    held = YAML(typ="safe", pure=True).load(shop.folder / "worn.yaml")
    return {"exit": code, **flatten({"report": report, "file": held})}


def rebuild(shop: Workshop, method: str) -> Flat:
    """Of contours alone."""
    source, mesh = f"ridged_{method}.npz", f"ridged_{method}.ply"
    shop.write_contours(source)
    found = shop.figures("rebuild", source, "--method", method, "-o", mesh, "--json")
    return found | shop.sha256(mesh)


def rebuild_table(shop: Workshop) -> Flat:
    """Of a table in mm with normals and touches, the ends touched; every kind of file written."""
    rows = [
        np.column_stack([1e3 * one, 0.0 * one[:, 0] + i, normal, np.arange(len(one)) // 6])
        for i, (one, normal) in enumerate(zip(*ridged(), strict=True))
    ]
    shop.write_table("table.csv", "x,y,z,contour,nx,ny,nz,touch", np.concatenate(rows))
    shop.write_table("tops.csv", "x,y,z", 1e3 * TOPS)
    outs = [f"table.{kind}" for kind in ("ply", "stl", "glb", "obj")]
    words = ["--unit", "mm", "--tops", "tops.csv", "--noise", "0.01", "--tolerance", "0.05"]
    words += ["--json", "--lattice", "table.vtk", *(word for out in outs for word in ("-o", out))]
    return shop.figures("rebuild", "table.csv", *words) | shop.sha256(*outs, "table.vtk")


def solid(shop: Workshop, method: Any, kind: str = "") -> Flat:
    """Rebuilt in Python and saved; "felt" with more than contours, "of_run" as a run left it."""
    if kind == "of_run":
        shop.recorded()
        return saved_solid(shop.folder / RECORDED / "model.npz")
    contours, normals = ridged(0 if kind == "faithful" else 3)
    given: dict[str, Any] = {"faithful": True} if kind == "faithful" else {}
    if kind == "felt":
        given = {"normals": normals, "tops": TOPS, "noise": 1e-5}
    path = shop.folder / f"solid_{method}_{kind}.npz"
    palpate.save(palpate.reconstruct(contours, method=method, **given), path)
    return saved_solid(path)


def saved_solid(path: Path) -> Flat:
    """Its mesh, and its surface where the mesh does not look."""
    solid = palpate.load(path)
    mesh, search = solid.mesh(), solid.search()
    v, turns = np.meshgrid(np.linspace(0.0, 1.0, 61), np.arange(48) / 48.0, indexing="ij")
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    places = low + (high - low) * (np.indices((5, 5, 5)).reshape(3, -1).T / 3.0 - 1.0 / 6.0)
    nearest = search.nearest(places)
    found: Flat = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "mesh_sha256": sha256(mesh.vertices, mesh.faces),
        "points_sha256": sha256(solid.surface.at(v, turns)),
        "normals_sha256": sha256(solid.surface.normals(v, turns)),
        "nearest_sha256": sha256(nearest.points, nearest.distances),
        "inside": int(np.count_nonzero(search.inside(places))),
        "area": solid.area,
    }
    return found | flatten({"health": solid.health()})


def help_texts(_: Workshop) -> str:
    """What ``--help`` of every verb prints in 80 columns."""
    return "\n".join(_help(command_tree, "palpate", None))


def _help(command: click.Command, name: str, parent: click.Context | None) -> Iterator[str]:
    # Two columns less than the terminal has, as click itself keeps free.
    settings = command.context_settings
    context = click.Context(command, info_name=name, parent=parent, terminal_width=78, **settings)
    yield f"$ {context.command_path} --help\n{command.get_help(context)}\n"
    if isinstance(command, click.Group):
        for verb in command.list_commands(context):
            found = command.get_command(context, verb)
            yield from _help(found, verb, context) if found else ()


def listings(shop: Workshop) -> str:
    """Scenes, effects and kinds of node, as they are listed."""
    verbs = (("scene", "list"), ("scene", "effects"), ("node", "kinds"))
    return "\n".join(f"$ palpate {' '.join(words)}\n{shop.call(*words)[1]}" for words in verbs)


class Golden(NamedTuple):
    """Something that must not change."""

    name: str
    make: Callable[[Workshop], Made]
    quick: bool = False

    @property
    def path(self) -> Path:
        return STORED / f"{self.name}.{'txt' if self.name.startswith('text/') else 'json'}"

    def stored(self) -> Made:
        text = self.path.read_text(encoding="utf-8")
        return text if self.path.suffix == ".txt" else dict(json.loads(text))

    def store(self, made: Made) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        text = made if isinstance(made, str) else json.dumps(made, indent=0) + "\n"
        self.path.write_text(text, encoding="utf-8")


GOLDENS = (
    Golden("text/help", help_texts, quick=True),
    Golden("text/listings", listings, quick=True),
    Golden(f"run/{RECORDED}", partial(run, name=RECORDED), quick=True),
    Golden("cost", lambda shop: of_recorded(shop, "cost", RECORDED, "--json"), quick=True),
    Golden("replay/nodes", lambda shop: of_recorded(shop, *REPLAY)),
    Golden("replay/from_contour_3", resume),
    Golden("score/mesh", lambda shop: of_recorded(shop, *SCORE)),
    Golden("score/points", score_points),
    Golden("calibrate", calibrate),
    *(Golden(f"rebuild/{m}", partial(rebuild, method=m), m == "lattice") for m in METHODS),
    Golden("rebuild/table", rebuild_table),
    *(Golden(f"solid/{m}", partial(solid, method=m), m == "skin") for m in METHODS),
    Golden("solid/lattice_felt", partial(solid, method="lattice", kind="felt")),
    Golden("solid/skin_felt", partial(solid, method="skin", kind="felt")),
    Golden("solid/thesis_faithful", partial(solid, method="thesis", kind="faithful")),
    Golden("solid/of_run", partial(solid, method="", kind="of_run")),
    *(Golden(f"run/{name}", partial(run, name=name)) for name in SCENES if name != RECORDED),
    Golden("run/vase_3_fingers", lambda shop: run(shop, "vase", "--fingers", "3")),
)


def differences(stored: Made, now: Made, *, figures: bool = False) -> list[str]:
    """Where two goldens differ, a line each; with `figures` sentences and texts do not count."""
    if isinstance(stored, str) or isinstance(now, str):
        lines = difflib.unified_diff(str(stored).splitlines(), str(now).splitlines(), n=0)
        return [] if figures else [line for line in lines if line[0] != "@"][2:]
    # repr tells floats to the last bit; of all that is stored, sentences alone have blanks in it.
    pairs = (
        (key, repr(stored.get(key, "none")), repr(now.get(key, "none"))) for key in stored | now
    )
    apart = [(key, a, b) for key, a, b in pairs if a != b and not (figures and " " in a + b)]
    return [f"{key}: {a} -> {b}" for key, a, b in apart]


def machine() -> Flat:
    """What decides how numbers round, and how help is laid out.

    Where BLAS takes the same kernels, how far it sums at a time still depends on the caches, and
    what the C library takes for a sine on the processor.
    """
    kernels = sorted({str(pool.get("architecture", "")) for pool in threadpool_info()} - {""})
    packages = ("numpy", "scipy", "trimesh", "manifold3d", "click")
    parts = [platform.system(), platform.machine(), *_processor(), *kernels, *platform.libc_ver()]
    found: Flat = {"machine": " ".join(parts)}
    return found | {"python": sys.version[:4]} | {name: version(name) for name in packages}


def _processor() -> list[str]:
    """Name of the processor, and the size of its second cache, where the system tells."""
    told = []
    names, cache = Path("/proc/cpuinfo"), Path("/sys/devices/system/cpu/cpu0/cache/index2/size")
    if names.is_file():
        told = re.findall(r"^model name\s*: (.*)$", names.read_text(), re.MULTILINE)[:1]
    return [*told, cache.read_text().strip()] if cache.is_file() else told


def elsewhere() -> str:
    """In what this machine differs from the one of the goldens; empty if in nothing."""
    return ", ".join(differences(json.loads(MADE_ON.read_text(encoding="utf-8")), machine()))


def attempt(golden: Golden, shop: Workshop, options: argparse.Namespace) -> bool:
    """Compare or renew one golden and print how that went; whether it went well."""
    begun, apart = time.monotonic(), list[str]()
    try:
        made = golden.make(shop)
        if options.renew:
            golden.store(made)
        else:
            apart = differences(golden.stored(), made, figures=options.figures)
    except Exception as error:  # one that fails must not keep the others from being compared
        apart = [f"{type(error).__name__}: {error}"]
    verdict = f"differs in {len(apart)}" if apart else "renewed" if options.renew else "same"
    told = f"{golden.name:<24} {verdict:<16} {time.monotonic() - begun:6.1f} s"
    print("\n    ".join([told, *apart[:SHOWN]]), flush=True)
    return not apart


def main() -> int:
    layout = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=layout)
    parser.add_argument("--only", default="*", metavar="PATTERN")
    parser.add_argument("-j", dest="jobs", type=int, default=1, metavar="N")
    for flag in ("--quick", "--figures", "--renew"):
        parser.add_argument(flag, action="store_true")
    options = parser.parse_args()
    named = [golden for golden in GOLDENS if fnmatch.fnmatch(golden.name, options.only)]
    chosen = [golden for golden in named if golden.quick or not options.quick]
    print(f"palpate of {Path(palpate.__file__).parent}")
    if options.renew:
        STORED.mkdir(exist_ok=True)
        MADE_ON.write_text(json.dumps(machine(), indent=0) + "\n", encoding="utf-8")
    elif where := elsewhere():
        print(f"not the machine of the goldens, figures may differ: {where}")
    with (
        tempfile.TemporaryDirectory(prefix="golden-") as folder,
        single_threaded(),  # threads change how sums round
        ThreadPoolExecutor(options.jobs) as pool,
    ):
        shop = Workshop(Path(folder))
        good = sum(pool.map(lambda golden: attempt(golden, shop, options), chosen))
    print(f"{good} of {len(chosen)} {'renewed' if options.renew else 'same'}")
    return 0 if 0 < good == len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
