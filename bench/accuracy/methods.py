"""Methods that explore, and the figures of each model that they yield.

A method yields models and never has the truth: its caller scores them. It touches with the finger
of the problem, as the Gaussian process below, or runs the graph in its scene, as palpate's
planners. Methods that only rebuild get the touches of the default planner.
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
F_SCORE_NEAR, F_SCORE_FAR = 1e-3, 5e-3  # [m] thresholds of the F-score
TOUCHED_DISTANCE = 5e-3  # [m] from a touched point, within which the surface counts as touched
TOUCHED_STAGES = (5, 10, 20, 50, 100, 200)  # Touches after which the touched share is taken
PACKAGE = "pymeshlab"  # Of the Poisson surface


class Model(NamedTuple):
    """A model, and its costs so far."""

    mesh: Mesh  # In the world [m]
    touches: int  # Number of touches
    robot_time: float  # [s]
    touched: Sequence[ContactPoints]  # Contact points of each touch, in order
    bound: float | None = None  # Stated bound of its root mean square error [m]
    compute: float | None = None  # Processor time [s]; None: measured by the caller


@dataclass(frozen=True, slots=True)
class Problem:
    """What a method is given."""

    name: str  # Of the object
    scene: Path  # Scene file with the object and the default noise, for methods that run the graph
    box: Floats  # Smallest and largest coordinates of the object's bounding box (2, 3) [m]

    def finger(self) -> GuardedFinger:
        """A finger that has not touched anything."""
        return GuardedFinger(self.scene)


Method = Callable[[Problem, float, int], Iterable[Model]]  # Of a problem, tolerance [m] and seed


def predicted(problem: Problem, tolerance: float, seed: int) -> Iterator[Model]:
    """The default planner."""
    run = _explored(problem.scene)
    bounds = {estimate.number: estimate.rms_bound_95 for estimate in run.kept[PlanEstimate]}
    contacts = run.contacts()
    for model, compute in zip(run.kept[ShapeModel], run.compute_times, strict=True):
        if len(model.faces):
            mesh, bound = Mesh(model.vertices, model.faces), bounds.get(model.number)
            yield Model(mesh, model.touches, model.robot_time, contacts, bound, compute)


@lru_cache(maxsize=1)
def _explored(scene: Path) -> TimedCollector:
    collector = TimedCollector()
    harness.compose_scene(scene, KEPT, collector, is_scored=False)
    if not (models := collector.kept[ShapeModel]) or not models[-1].final:
        raise RuntimeError("the exploration ended without a final model")
    return collector


class TimedCollector(harness.MessageCollector):
    """Keeps messages, and the processor time [s] at which each model arrives."""

    def __init__(self) -> None:
        super().__init__()
        self.start, self.compute_times = time.process_time(), list[float]()

    def received(self, topic: str, message: object) -> None:
        """Keep a message."""
        if isinstance(message, ShapeModel):
            self.compute_times.append(time.process_time() - self.start)
        super().received(topic, message)

    def contacts(self) -> list[ContactPoints]:
        """Contact points of each touch."""
        patches = self.kept[SurfacePatch]
        return [ContactPoints.of_touch(patch.points, patch.normals) for patch in patches]


def contours_alone(problem: Problem, tolerance: float, seed: int) -> Iterator[Model]:
    """The skin through contours and ends of the default planner, without the other taxels."""
    run = _explored(problem.scene)
    probes = {probe.id: probe for probe in run.kept[Probe] if probe.outcome == "hit"}
    contours = {contour.id: contour for contour in run.kept[Contour]}
    contacts = run.contacts()
    for model, compute in zip(run.kept[ShapeModel], run.compute_times, strict=True):
        used = [contours[number] for number in model.contours if number in contours]
        ends = [probes[number].point for number in model.probes if number in probes]
        try:
            solid = reconstruct(
                [contour.points for contour in used],
                [contour.normals for contour in used],
                tops=np.array(ends) if ends else None,
                method="skin",
                frame=model.frame,
            ).mesh()
        except ValueError:  # too few contours so far
            continue
        mesh = Mesh(solid.vertices, solid.faces)
        yield Model(mesh, model.touches, model.robot_time, contacts, None, compute)


def poisson(problem: Problem, tolerance: float, seed: int) -> Iterator[Model]:
    """A Poisson surface of all taxels of the default planner."""
    run = _explored(problem.scene)
    contacts = run.contacts()
    for model, compute in zip(run.kept[ShapeModel], run.compute_times, strict=True):
        pairs = [(c.points, c.normals) for c in contacts[: model.touches] if c.normals is not None]
        points = np.concatenate([points for points, _ in pairs])
        normals = np.concatenate([normals for _, normals in pairs])
        mesh = poisson_surface(points[None], normals[None])
        yield Model(mesh, model.touches, model.robot_time, contacts, None, compute)


def poisson_surface(contours: Floats, normals: Floats, octree_depth: int = 8) -> Mesh:
    """A Poisson surface of points (m, n, 3) by PyMeshLab, which also closes the ends.

    Kazhdan and Hoppe, *Screened Poisson surface reconstruction*, 2013.
    `normals` (m, n, 3): outward. `octree_depth`: by default 256 cells along the object. Raises
    ImportError if the package is not installed.
    """
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    points = {"vertex_matrix": contours, "v_normals_matrix": normals}
    meshes.add_mesh(pymeshlab.Mesh(**{name: rows.reshape(-1, 3) for name, rows in points.items()}))
    meshes.generate_surface_reconstruction_screened_poisson(depth=octree_depth, threads=1)
    surface = meshes.current_mesh()
    vertices = np.asarray(surface.vertex_matrix(), np.float64)
    return Mesh(vertices, np.asarray(surface.face_matrix(), np.int32))


def poisson_installed() -> bool:
    """Whether the package of the Poisson surface is installed."""
    return importlib.util.find_spec(PACKAGE) is not None


def gaussian_process(problem: Problem, tolerance: float, seed: int) -> Iterator[Model]:
    """Touches where its surface is least certain, with a preference for short travel."""
    checkpoints = (*range(5, 21, 5), 30, 40, 60, 80, *range(100, 201, 25))  # touches
    finger = problem.finger()
    explorer = Explorer(finger, problem.box)
    for count in checkpoints:
        explorer.touch_until(count)
        yield Model(explorer.mesh(), len(finger.touched), finger.robot_time, finger.touched)


def even_count(share: float) -> int:
    """Number of even slices for an error [fraction of the height]: 3 (0.01 / error)^(1/3)."""
    return math.ceil(3.0 * math.cbrt(0.01 / share) - 1e-9)


class Contender(NamedTuple):
    """A method of the benchmark."""

    description: str
    explore: Method
    planner: str = "predicted"  # Of its scene
    has_tolerance: bool = True  # Whether it takes one
    # Of the planner, by the tolerance as a share of the height.
    settings: Callable[[float], Mapping[str, Any]] = lambda share: {}
    is_endless: bool = False  # Whether its caller ends it, after a number of touches


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
        "touches where its surface is least certain; is given the object's bounding box",
        *(gaussian_process, "predicted", False),
        is_endless=True,
    ),
}
TOGETHER = (OURS, "contours alone", POISSON)  # Of one exploration, in one process


class TrueObject(NamedTuple):
    """True surface of an object."""

    surface: PreparedSurface
    size: float  # Height [m]
    floor: float  # Chamfer distance between two tessellations [m]
    box: Floats  # (2, 3) [m]


@lru_cache(maxsize=4)
def object_of(name: str, meshes: Path | None) -> ExploreObject:
    """A drawn object, or a mesh of the user's, moved onto the origin of the platform."""
    if name in EXPLORED_OBJECTS:
        return EXPLORED_OBJECTS[name]
    assert meshes is not None
    path = meshes / name
    vertices, faces, _ = read_mesh(path, MESH_UNITS[path.suffix.lower()].partition(",")[0])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return Mesh(vertices - [*(0.5 * (low + high)[:2]), low[2]], faces)


def truth_of_object(name: str, meshes: Path | None, scene: Path) -> TrueObject:
    """The truth of an object, from any scene with it."""
    if (name, meshes) in _truths:
        return _truths[name, meshes]
    spec = load_scene(scene).spec
    outputs = simulator.NODE.start(simulator.Params(object=spec.object))[1]
    [truth] = [out[1] for out in outputs if not isinstance(out, Finished) and out[0] == "/truth"]
    assert isinstance(truth, Truth)
    surface = prepare_surface(truth.vertices, truth.faces)
    other = prepare_surface(truth.floor_vertices, truth.floor_faces)
    floor = 0.5 * sum(float(distances.mean()) for distances in both_ways(surface, other))
    box = build_shape(spec.object).bounds()
    _truths.clear()  # units are made object by object
    _truths[name, meshes] = TrueObject(surface, float(truth.height), floor, box)
    return _truths[name, meshes]


_truths: dict[tuple[str, Path | None], TrueObject] = {}


def meshes_in(folder: Path) -> list[str]:
    """Names of the mesh files in a folder; raises InputError without any, or for a bad one."""
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder of meshes")
    suffixes = sorted(suffix for suffix in MESH_UNITS if is_mesh_file(Path(f"mesh{suffix}")))
    names = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in suffixes)
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
        tolerance_m=unit.share * truth.size if contender.has_tolerance else None,
        size_m=truth.size,
        sampling_floor_m=truth.floor,
    )
    try:
        curve, final = _measured_curve(contender, problem, truth, unit)
        return convert(to_builtins(made(curve=curve, final=final)), Run)
    except Exception as error:  # of any method: the others are still measured
        return made(curve=(), final=None, failed=f"{type(error).__name__}: {error}")


def _measured_curve(
    contender: Contender, problem: Problem, truth: TrueObject, unit: Unit
) -> tuple[tuple[Point, ...], Final | None]:
    curve, final, compute = list[Point](), None, 0.0
    models = iter(contender.explore(problem, unit.share * truth.size, unit.seed))
    while not (contender.is_endless and curve and curve[-1].touches >= unit.max_touches):
        start = time.process_time()
        model = next(models, None)
        compute += time.process_time() - start
        if model is None:
            break
        distances = both_ways(truth.surface, prepare_surface(*model.mesh))
        curve.append(_point(model, compute, *distances))
        final = _final(truth.surface, model, *distances)
    if not curve:
        raise RuntimeError("the method made no model")
    return tuple(curve), final


def both_ways(truth: PreparedSurface, rebuilt: PreparedSurface) -> tuple[Floats, Floats]:
    """Distances [m] of samples of the truth and of the solid from the other: docs/distances.md."""
    from_truth = nearest_points(rebuilt.search, truth.samples.points).distances
    return from_truth, nearest_points(truth.search, rebuilt.samples.points).distances


def _point(model: Model, compute: float, from_truth: Floats, from_solid: Floats) -> Point:
    return Point(
        touches=int(model.touches),
        robot_time_s=float(model.robot_time),
        compute_s=float(compute if model.compute is None else model.compute),
        rms_m=math.sqrt(0.5 * (float(np.mean(from_truth**2)) + float(np.mean(from_solid**2)))),
        chamfer_m=0.5 * (float(from_truth.mean()) + float(from_solid.mean())),
        bound_m=None if model.bound is None else float(model.bound),
    )


def _final(truth: PreparedSurface, model: Model, from_truth: Floats, from_solid: Floats) -> Final:
    return Final(
        chamfer_sum_m=float(from_truth.mean()) + float(from_solid.mean()),
        f_score_1mm=f_score(from_truth, from_solid, F_SCORE_NEAR),
        f_score_5mm=f_score(from_truth, from_solid, F_SCORE_FAR),
        touched_5mm=touched_shares(truth.samples.points, model.touched),
    )


def f_score(from_truth: Floats, from_solid: Floats, threshold: float) -> float:
    """Harmonic mean of the shares of distances below a threshold [m], in both directions."""
    recall, precision = (
        float(np.mean(from_truth < threshold)),
        float(np.mean(from_solid < threshold)),
    )
    return 2.0 * precision * recall / max(precision + recall, 1e-12)


def touched_shares(samples: Floats, contacts: Sequence[ContactPoints]) -> dict[str, float]:
    """Share of samples near a touched point, by the number of touches until then."""
    from scipy.spatial import cKDTree

    is_near, shares, done = np.zeros(len(samples), bool), {}, 0
    for count in (stage for stage in TOUCHED_STAGES if stage <= len(contacts)):
        points = np.concatenate([contact.points for contact in contacts[done:count]])
        if len(points):
            left = samples[~is_near]
            distances, _ = cKDTree(points).query(left, distance_upper_bound=TOUCHED_DISTANCE)
            is_near[~is_near] = distances < TOUCHED_DISTANCE
        shares[str(count)], done = float(is_near.mean()), count
    return shares


def write_problem(folder: Path, contender: Contender, unit: Unit) -> Path:
    """Write the scene of a run into a folder."""
    target = object_of(unit.object, unit.meshes)
    height = float(np.ptp(target.vertices[:, 2])) if isinstance(target, Mesh) else EXPLORED_HEIGHT
    settings = contender.settings(unit.share)
    demand = harness.Demand(contender.planner, unit.share * height, settings, feature=None)
    return harness.write_scene(folder, target, harness.NOISY, demand, unit.seed)


def contender_of(name: str) -> Contender:
    """A method of this table, or a user's ``module:function``; raises InputError for any other."""
    if name in CONTENDERS:
        return CONTENDERS[name]
    try:
        method = class_by_name(name, what="method", names=tuple(CONTENDERS), package="")
    except (LookupError, ValueError) as error:
        raise InputError(str(error.args[0])) from None
    if not callable(method):
        raise InputError(f"the method {name!r} must be a function, got {method!r}")
    description = (method.__doc__ or name).strip().partition("\n")[0]
    return Contender(description, method, is_endless=True)


def runs_of(unit: Unit) -> list[Run]:
    """The runs of a unit of work, in this process."""
    with single_threaded(), tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        scene = write_problem(Path(folder), contender_of(unit.methods[0]), unit)
        truth = truth_of_object(unit.object, unit.meshes, scene)
        problem = Problem(unit.object, scene, truth.box)
        return [
            measure_run(name, contender_of(name), problem, truth, unit) for name in unit.methods
        ]


class Unit(NamedTuple):
    """Runs that one process makes one after the other, from one exploration."""

    methods: tuple[str, ...]
    object: str
    seed: int
    share: float  # Tolerance over the height
    max_touches: int  # At which an endless method is ended
    meshes: Path | None = None  # Folder of the user's meshes
