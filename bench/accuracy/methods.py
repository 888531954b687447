"""Methods that explore, and what is measured of each model that they make on the way.

A method yields models and is scored by what calls it: it never has the truth. It touches with the
finger of the problem, or runs the graph in its scene. palpate's planners and the Gaussian process
do so below; what rebuilds from the same touches gets those of the default planner.
"""

from __future__ import annotations

import importlib.util
import math
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import convert, to_builtins

from palpate.bench import harness
from palpate.bench.accuracy.gp_explorer import Explorer, GuardedFinger
from palpate.bench.accuracy.runs import Final, Point, Run
from palpate.bench.explored import EXPLORED_HEIGHT, EXPLORED_OBJECTS, ExploreObject
from palpate.core.arrays import Floats
from palpate.core.geometry import PreparedSurface, nearest_points, prepare_surface
from palpate.core.plugins import class_by_name
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.shapes import Mesh
from palpate.launch.files.mesh_file import MESH_UNITS, is_mesh_file, read_mesh
from palpate.launch.files.source_map import InputError
from palpate.launch.scene import load_scene
from palpate.messages.types import (
    Contour,
    PlanEstimate,
    Probe,
    ShapeModel,
    SurfacePatch,
    TactileFrame,
    Truth,
)
from palpate.nodes import simulator
from palpate.nodes.runtime.node import Finished
from palpate.nodes.specs.objects import build_shape
from palpate.tools.reconstruction import single_threaded

KEPT = (Contour, PlanEstimate, Probe, ShapeModel, SurfacePatch, TactileFrame)
PLACE_NOISE = 1e-4  # Standard deviation of a touch's place that the Gaussian process is told, m
NEARER = 0.01  # Deviation that a metre of its travel outweighs, m: it does better so than with 0
CHECKPOINTS = (5, 10, 15, 20, 30, 40, 60, 80, 100, 125, 150, 175, 200)  # Touches
NEAR, FAR = 1e-3, 5e-3  # Thresholds of the F-score, m; the latter also of what counts as touched
STAGES = (5, 10, 20, 50, 100, 200)  # Touches after which the touched share is told
PACKAGE = "pymeshlab"  # Of the Poisson surface
OCTREE_DEPTH = 8  # Of its octree: 256 cells along the object


class Model(NamedTuple):
    """A model on the way."""

    mesh: Mesh  # In the world, m
    touches: int  # Made so far
    robot_time: float  # s
    touched: Sequence[ContactPoints]  # What each touch met, in their order
    bound: float | None = None  # Of its root mean square error, stated, m
    compute: float | None = None  # Time of the processor so far, s; None: it is measured


@dataclass(frozen=True, slots=True)
class Problem:
    """What a method knows beforehand."""

    name: str  # Of the object
    scene: Path  # A scene file with it and the default noise, for whoever runs the graph
    box: Floats  # Smallest and largest coordinates of a box that holds it, (2, 3), m

    def finger(self) -> GuardedFinger:
        """The finger, which has touched nothing yet."""
        return GuardedFinger(self.scene)


Method = Callable[[Problem, float, int], Iterable[Model]]  # Of a problem, an error, m, and a seed


def predicted(problem: Problem, tolerance: float, seed: int) -> Iterator[Model]:
    """The default planner."""
    found = _explored(problem.scene)
    bounds = {one.number: one.rms_bound_95 for one in found.kept[PlanEstimate]}
    touched = found.contacts()
    for model, compute in zip(found.kept[ShapeModel], found.made, strict=True):
        if len(model.faces):
            mesh, bound = Mesh(model.vertices, model.faces), bounds.get(model.number)
            yield Model(mesh, model.touches, model.robot_time, touched, bound, compute)


@lru_cache(maxsize=1)
def _explored(scene: Path) -> TimedCollector:
    collector = TimedCollector()
    harness.compose_scene(scene, KEPT, collector, scored=False)
    if not (models := collector.kept[ShapeModel]) or not models[-1].final:
        raise RuntimeError("the exploration ended without a final model")
    return collector


class TimedCollector(harness.MessageCollector):
    """Remembers the processor's time at which each model was made, s."""

    def __init__(self) -> None:
        super().__init__()
        self.began, self.made = time.process_time(), list[float]()

    def received(self, topic: str, message: object) -> None:
        """Keep a message."""
        if isinstance(message, ShapeModel):
            self.made.append(time.process_time() - self.began)
        super().received(topic, message)

    def contacts(self) -> list[ContactPoints]:
        """What each touch met."""
        patches = self.kept[SurfacePatch]
        return [ContactPoints.of_touch(one.points, one.normals) for one in patches]


def contours_alone(problem: Problem, tolerance: float, seed: int) -> Iterator[Model]:
    """The skin through the contours and ends of the same exploration, without all taxels."""
    found = _explored(problem.scene)
    probes = {one.id: one for one in found.kept[Probe] if one.outcome == "hit"}
    contours = {one.id: one for one in found.kept[Contour]}
    touched = found.contacts()
    for model, compute in zip(found.kept[ShapeModel], found.made, strict=True):
        used = [contours[number] for number in model.contours if number in contours]
        ends = [probes[number].point for number in model.probes if number in probes]
        try:
            solid = reconstruct(
                [one.points for one in used],
                [one.normals for one in used],
                tops=np.array(ends) if ends else None,
                method="skin",
                frame=model.frame,
            ).mesh()
        except ValueError:  # too few of them as yet
            continue
        mesh = Mesh(solid.vertices, solid.faces)
        yield Model(mesh, model.touches, model.robot_time, touched, None, compute)


def poisson(problem: Problem, tolerance: float, seed: int) -> Iterator[Model]:
    """A Poisson surface of all taxels of the same touches."""
    found = _explored(problem.scene)
    touched = found.contacts()
    for model, compute in zip(found.kept[ShapeModel], found.made, strict=True):
        some = [one for one in touched[: model.touches] if one.normals is not None]
        points = np.concatenate([one.points for one in some])
        normals = np.concatenate([one.normals for one in some if one.normals is not None])
        mesh = poisson_surface(points[None], normals[None])
        yield Model(mesh, model.touches, model.robot_time, touched, None, compute)


def poisson_surface(contours: Floats, normals: Floats) -> Mesh:
    """A Poisson surface of points (m, n, 3) by PyMeshLab; its ends are what it makes them.

    Kazhdan and Hoppe, *Screened Poisson surface reconstruction*, 2013.
    `normals` (m, n, 3): outward, else from differences between neighbours. Raises ImportError if
    the package is not installed.
    """
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    points = {"vertex_matrix": contours, "v_normals_matrix": normals}
    meshes.add_mesh(pymeshlab.Mesh(**{name: one.reshape(-1, 3) for name, one in points.items()}))
    meshes.generate_surface_reconstruction_screened_poisson(depth=OCTREE_DEPTH, threads=1)
    found = meshes.current_mesh()
    vertices = np.asarray(found.vertex_matrix(), np.float64)
    return Mesh(vertices, np.asarray(found.face_matrix(), np.int32))


def poisson_installed() -> bool:
    """Whether the package is there."""
    return importlib.util.find_spec(PACKAGE) is not None


def gaussian_process(problem: Problem, tolerance: float, seed: int) -> Iterator[Model]:
    """Touches where its surface is least certain, and nearer places rather than farther ones."""
    finger = problem.finger()
    explorer = Explorer(finger, problem.box, PLACE_NOISE, NEARER)
    for count in CHECKPOINTS:
        explorer.touch_until(count)
        yield Model(explorer.mesh(), len(finger.touched), finger.robot_time, finger.touched)


def even_count(share: float) -> int:
    """Even slices for an error of this share of the height: three for 1 %, by its cube root."""
    return math.ceil(3.0 * math.cbrt(0.01 / share) - 1e-9)


class Contender(NamedTuple):
    """A method by its name in tables."""

    told: str  # What it is, in a sentence
    explore: Method
    planner: str = "predicted"  # Whose exploration the scene asks for
    asked: bool = True  # Whether it takes a tolerance
    # Numbers of the planner, by the share of the height that is asked for.
    settings: Callable[[float], Mapping[str, Any]] = lambda share: {}
    endless: bool = False  # Whether it is ended from outside, after so many touches


OURS, POISSON = "palpate", "Poisson, same touches"
CONTENDERS: Mapping[str, Contender] = {
    OURS: Contender("the default planner, the solid of all taxels", predicted),
    "contours alone": Contender(
        "the default planner, a skin of its contours and ends", contours_alone
    ),
    POISSON: Contender("Poisson surface of all taxels of the default planner", poisson),
    "uniform": Contender(
        "even slices, three at 1 % and their number by the cube root of the tolerance",
        *(predicted, "uniform", True, lambda share: {"count": even_count(share)}),
    ),
    "thesis": Contender(
        "steps by curvature, the constants of docs/planning.md", predicted, "thesis", False
    ),
    "fuzzy": Contender("steps by rules in words", predicted, "fuzzy", False),
    "Gaussian process": Contender(
        "touches where its surface is least certain; is told the object's box",
        *(gaussian_process, "predicted", False),
        endless=True,
    ),
}
TOGETHER = (OURS, "contours alone", POISSON)  # Of one exploration: made in turn in one process


class TrueObject(NamedTuple):
    """What a model is measured against."""

    surface: PreparedSurface
    size: float  # Height, m
    floor: float  # Chamfer distance between two tessellations, m
    box: Floats  # (2, 3), m


@lru_cache(maxsize=4)
def object_of(name: str, meshes: Path | None) -> ExploreObject:
    """A drawn object, or a mesh of the user's, brought to stand on z = 0 in the middle."""
    if name in EXPLORED_OBJECTS:
        return EXPLORED_OBJECTS[name]
    assert meshes is not None
    path = meshes / name
    vertices, faces, _ = read_mesh(path, MESH_UNITS[path.suffix.lower()].partition(",")[0])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return Mesh(vertices - [*(0.5 * (low + high)[:2]), low[2]], faces)


def truth_of_object(name: str, meshes: Path | None, scene: Path) -> TrueObject:
    """The truth of an object, from any scene in which it stands."""
    if (name, meshes) in _truths:
        return _truths[name, meshes]
    spec = load_scene(scene).spec
    begun = simulator.NODE.start(simulator.Params(object=spec.object))[1]
    [truth] = [one[1] for one in begun if not isinstance(one, Finished) and one[0] == "/truth"]
    assert isinstance(truth, Truth)
    surface = prepare_surface(truth.vertices, truth.faces)
    other = prepare_surface(truth.floor_vertices, truth.floor_faces)
    floor = 0.5 * sum(float(one.mean()) for one in both_ways(surface, other))
    box = build_shape(spec.object).bounds()
    _truths.clear()  # units come object by object
    _truths[name, meshes] = TrueObject(surface, float(truth.height), floor, box)
    return _truths[name, meshes]


_truths: dict[tuple[str, Path | None], TrueObject] = {}


def meshes_in(folder: Path) -> list[str]:
    """Names of the mesh files in a folder; raises InputError if there is none, or one is unfit."""
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder of meshes")
    suffixes = sorted(one for one in MESH_UNITS if is_mesh_file(Path(f"mesh{one}")))
    names = sorted(one.name for one in folder.iterdir() if one.suffix.lower() in suffixes)
    if not names:
        raise InputError(f"{folder}: has no mesh in it: no {', '.join(suffixes)}")
    for name in names:
        object_of(name, folder)
    return names


def measure_run(
    name: str, contender: Contender, problem: Problem, truth: TrueObject, unit: Unit
) -> Run:
    """One run of a method."""
    made = partial(
        Run,
        method=name,
        object=problem.name,
        seed=unit.seed,
        tolerance_m=unit.share * truth.size if contender.asked else None,
        size_m=truth.size,
        sampling_floor_m=truth.floor,
    )
    try:
        curve, final = _measured_curve(contender, problem, truth, unit)
        return convert(to_builtins(made(curve=curve, final=final)), Run)
    except Exception as error:  # of anybody's method: the others are measured all the same
        return made(curve=(), final=None, failed=f"{type(error).__name__}: {error}")


def _measured_curve(
    contender: Contender, problem: Problem, truth: TrueObject, unit: Unit
) -> tuple[tuple[Point, ...], Final | None]:
    curve, final, compute = list[Point](), None, 0.0
    models = iter(contender.explore(problem, unit.share * truth.size, unit.seed))
    while not (contender.endless and curve and curve[-1].touches >= unit.most):
        began = time.process_time()
        model = next(models, None)
        compute += time.process_time() - began
        if model is None:
            break
        ways = both_ways(truth.surface, prepare_surface(*model.mesh))
        curve.append(_point(model, compute, *ways))
        final = _final(truth.surface, model, *ways)
    if not curve:
        raise RuntimeError("the method made no model")
    return tuple(curve), final


def both_ways(truth: PreparedSurface, rebuilt: PreparedSurface) -> tuple[Floats, Floats]:
    """Distances of the samples of each surface from the other, m: see docs/distances.md."""
    there = nearest_points(rebuilt.search, truth.samples.points).distances
    return there, nearest_points(truth.search, rebuilt.samples.points).distances


def _point(model: Model, compute: float, there: Floats, back: Floats) -> Point:
    return Point(
        touches=int(model.touches),
        robot_time_s=float(model.robot_time),
        compute_s=float(compute if model.compute is None else model.compute),
        rms_m=math.sqrt(0.5 * (float(np.mean(there**2)) + float(np.mean(back**2)))),
        chamfer_m=0.5 * (float(there.mean()) + float(back.mean())),
        bound_m=None if model.bound is None else float(model.bound),
    )


def _final(truth: PreparedSurface, model: Model, there: Floats, back: Floats) -> Final:
    return Final(
        chamfer_sum_m=float(there.mean()) + float(back.mean()),
        f_score_1mm=f_score(there, back, NEAR),
        f_score_5mm=f_score(there, back, FAR),
        touched_5mm=touched_shares(truth.samples.points, model.touched),
    )


def f_score(there: Floats, back: Floats, threshold: float) -> float:
    """Harmonic mean of the shares of either way's distances that are below a threshold."""
    recall, precision = float(np.mean(there < threshold)), float(np.mean(back < threshold))
    return 2.0 * precision * recall / max(precision + recall, 1e-12)


def touched_shares(samples: Floats, touched: Sequence[ContactPoints]) -> dict[str, float]:
    """Share of the samples within 5 mm of a touched point, after so many touches as were made."""
    from scipy.spatial import cKDTree

    near, shares, done = np.zeros(len(samples), bool), {}, 0
    for count in (one for one in STAGES if one <= len(touched)):
        points = np.concatenate([one.points for one in touched[done:count]])
        if len(points):
            away, _ = cKDTree(points).query(samples[~near], distance_upper_bound=FAR)
            near[~near] = away < FAR
        shares[str(count)], done = float(near.mean()), count
    return shares


def write_problem(folder: Path, contender: Contender, unit: Unit) -> Path:
    """The scene of a run, in a folder."""
    target = object_of(unit.object, unit.meshes)
    tall = float(np.ptp(target.vertices[:, 2])) if isinstance(target, Mesh) else EXPLORED_HEIGHT
    settings = contender.settings(unit.share)
    demand = harness.Demand(contender.planner, unit.share * tall, settings, feature=None)
    return harness.write_scene(folder, target, harness.NOISY, demand, unit.seed)


def contender_of(name: str) -> Contender:
    """A method of this table, or a user's ``module:function``; raises InputError if it is none."""
    if name in CONTENDERS:
        return CONTENDERS[name]
    try:
        found = class_by_name(name, what="method", names=tuple(CONTENDERS), package="")
    except (LookupError, ValueError) as error:
        raise InputError(str(error.args[0])) from None
    if not callable(found):
        raise InputError(f"the method {name!r} must be a function, got {found!r}")
    told = (found.__doc__ or name).strip().partition("\n")[0]
    return Contender(told, found, endless=True)


def runs_of(unit: Unit) -> list[Run]:
    """The runs of a unit of work, in this process."""
    with single_threaded(), tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        scene = write_problem(Path(folder), contender_of(unit.methods[0]), unit)
        truth = truth_of_object(unit.object, unit.meshes, scene)
        problem = Problem(unit.object, scene, truth.box)
        return [measure_run(one, contender_of(one), problem, truth, unit) for one in unit.methods]


class Unit(NamedTuple):
    """Runs that are made one after the other in one process: they share an exploration."""

    methods: tuple[str, ...]
    object: str
    seed: int
    share: float  # Error that is asked for, over the height
    most: int  # Touches at which a method without an end is ended
    meshes: Path | None = None  # Folder of the user's meshes
