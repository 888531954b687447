"""Real objects: a folder of meshes explored with noise; runs are kept in a file.

Without a folder a drawn set of thin, hollow and machined objects is explored. Each is explored as
it stands, with the underside taken for flat, and with the underside to be known, for which it is
turned over. Beside palpate's own distances stand those of trimesh, from fewer samples. *Covered* is
the share of the true surface within 5 mm of a touched point. Error and bound are also given for
parts of the rebuilt surface. A share of the size (the largest extent) is reached at the first model
whose stated error is at most that. A picture shows each surface coloured by its distance from the
other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import trimesh
from scipy.spatial import cKDTree
from trimesh import proximity

from palpate.bench.accuracy.runs import check_sources, sources_digest
from palpate.bench.explored import ExploreObject
from palpate.bench.harness import NOISY, Demand, Explored, explore_object
from palpate.bench.results import read_form, write_form
from palpate.bench.table import Figure, figure_of
from palpate.core.arrays import Floats
from palpate.core.explore.planners import DEFAULT_SURFACE
from palpate.core.geometry import areas_and_normals, nearest_points, nearest_search, sample_surface
from palpate.core.shapes import Mesh
from palpate.launch.files.mesh_file import read_mesh
from palpate.launch.files.source_map import InputError
from palpate.messages.types import ShapeModel
from palpate.nodes.specs.objects import ObjectSpec, object_extents

FORM, VERSION = "palpate real", 4
FOLDER, FILE = "bench-real", "runs.json"
SUFFIXES = (".ply", ".stl", ".obj", ".off", ".glb")
SHARES = (0.01, 0.005, 0.002)  # Of the size; columns of the table and of the file
TURNS = {0: "flat", 1: "known"}  # By how often an object may be turned over: its underside
LINE = "{:<24}{:>5}{:>6}{:>9}{:>9}{:>9}{:>9}{:>9}{:>8}{:>8}{:>7}{:>16}{:>8}{:>8}  {}"
PART_NAMES = ("touched", "near", "far", "underside")


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonSettings:
    """How surfaces are compared."""

    n_samples: int = 20_000  # points on each surface
    touched_distance: float = 5e-3  # [m] from a touched point, within which a surface is covered
    part_distances: tuple[float, float] = (2e-3, 5e-3)  # [m] largest of touched and of near parts
    n_independent: int = 400  # samples for trimesh on each surface
    n_at_once: int = 10  # of these samples, searched together; more take more memory
    min_uncovered: float = 0.01  # uncovered fraction of a surface beyond which a run is counted


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureSettings:
    """Views and colours of the pictures."""

    # [deg] elevation and azimuth
    views: tuple[tuple[float, float], ...] = (
        *((20.0, 35.0), (20.0, 215.0), (75.0, 35.0), (-60.0, 35.0)),
    )
    colour_range: tuple[float, float] = (0.01, 5.0)  # [mm] of distance, logarithmic


COMPARISON = ComparisonSettings()


def _cylinder(radius: float, height: float, z: float = 0.0) -> dict[str, Any]:
    solid = {"radius": radius, "height": height}
    return {"cylinder": solid, "pose": {"position": [0.0, 0.0, z + 0.5 * height]}}


def _without(*parts: Mapping[str, Any]) -> dict[str, Any]:
    return {"boolean": {"difference": list(parts)}}


BLOCK = {"box": {"size": [0.06, 0.05, 0.03]}, "pose": {"position": [0.0, 0.0, 0.015]}}
STEPS = (_cylinder(0.012, 0.03), _cylinder(0.018, 0.015, 0.03), _cylinder(0.01, 0.03, 0.045))
FOOT = {"box": {"size": [0.06, 0.04, 0.006]}, "pose": {"position": [0.0, 0.0, 0.003]}}
WALL = {"box": {"size": [0.006, 0.04, 0.05]}, "pose": {"position": [-0.027, 0.0, 0.025]}}
CAVITY = {"box": {"size": [0.036, 0.026, 0.02]}, "pose": {"position": [0.0, 0.0, 0.022]}}
# Thin, hollow and machined objects that stand on their lower end; lengths in [m].
DRAWN: Mapping[str, dict[str, Any]] = {
    "plate": {"box": {"size": [0.06, 0.008, 0.05]}},
    "ring": {"torus": {"radius": 0.03, "tube": 0.008}},
    "tube": _without(_cylinder(0.03, 0.05), _cylinder(0.022, 0.07, -0.01)),
    "mug": _without(_cylinder(0.035, 0.08), _cylinder(0.028, 0.08, 0.01)),
    "bored block": _without(BLOCK, _cylinder(0.009, 0.05, -0.01)),
    "stepped shaft": {"boolean": {"union": [*STEPS]}},
    "bracket": {"boolean": {"union": [FOOT, WALL]}},
    "pocket": _without(BLOCK, CAVITY),
    "countersunk block": _without(
        BLOCK,
        _cylinder(0.004, 0.05, -0.01),
        {
            "cone": {"radius": 0.004, "top": 0.0102, "height": 0.0062},
            "pose": {"position": [0.0, 0.0, 0.0271]},
        },
    ),
}


class PartError(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Error and stated bound of a part of the rebuilt surface."""

    name: str  # One of `PART_NAMES`
    share: float  # Of the surface
    rms_m: float  # Root mean square error [m]
    bound_m: float  # Stated bound of that error [m]


class RealRun(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One exploration of an object; lengths in [m], times in [s]."""

    object: str  # Name of the object or its file
    seed: int
    turns: int  # How often it may be turned over
    size_m: float  # Largest extent
    rms_m: float = 0.0  # Root mean square error of the last model
    exposed_rms_m: float = 0.0  # The same without the underside
    independent_rms_m: float = 0.0  # The same by trimesh
    touched_rms_m: float = 0.0  # The same near touched points
    sampling_floor_m: float = 0.0
    bound_m: float | None = None  # Stated bound of the error
    met: bool | None = None  # Whether the run states that its tolerance is met
    covered: float = 0.0  # Share of the true surface
    open_share: float | None = None  # Shares of the surface, as the run states them
    under_share: float | None = None
    genus: int = -1
    true_genus: int = -1
    touches: int = 0
    turned: int = 0  # How often it was turned over
    reached: tuple[int | None, ...] = (None,) * len(SHARES)  # Touches at each share of the size
    robot_time_s: float = 0.0
    compute_s: float = 0.0
    parts: tuple[PartError, ...] = ()
    reason: str = ""
    failed: str = ""  # Reason, without a model

    @property
    def held(self) -> bool:
        """Whether the error is at most the stated bound."""
        return self.bound_m is not None and self.error_m <= self.bound_m

    @property
    def error_m(self) -> float:
        """The error that is bounded: without the underside if that was taken for flat."""
        return self.rms_m if self.turned else self.exposed_rms_m


class RealRuns(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All runs of a file."""

    form: str
    version: int
    sources: str  # Digest of palpate's sources
    runs: tuple[RealRun, ...] = ()


class RealFigures(msgspec.Struct, frozen=True):
    """A line of the table."""

    run: RealRun

    @property
    def name(self) -> str:
        """Object, seed and turns."""
        return f"{self.run.object} {self.run.seed} {self.run.turns}"

    @property
    def figures(self) -> Sequence[Figure]:
        """The figures that are compared with those of another measurement."""
        run = self.run
        return (
            figure_of(1e3 * run.rms_m, "mm", name="rms"),
            figure_of(1e3 * (run.bound_m or 0.0), "mm", name="bound"),
            figure_of(run.touches, name="touches"),
        )

    @property
    def holds(self) -> bool:
        """Whether the bound holds if the run states that its tolerance is met."""
        return self.run.bound_m is None or self.run.held or not self.run.met

    def __str__(self) -> str:
        run = self.run
        if run.failed:
            return f"{run.object:<24}{run.seed:>5}{run.turns:>6}  no model: {run.failed}"
        reached = "/".join("-" if touches is None else str(touches) for touches in run.reached)
        stated = "none" if run.bound_m is None else f"{1e3 * run.bound_m:.3f}"
        lengths = (run.rms_m, run.exposed_rms_m, run.independent_rms_m, run.touched_rms_m)
        return LINE.format(
            run.object,
            run.seed,
            run.turns,
            *(f"{1e3 * length:.3f}" for length in lengths),
            stated,
            f"{run.covered:.1%}",
            "none" if run.open_share is None else f"{run.open_share:.1%}",
            f"{run.genus}/{run.true_genus}",
            reached,
            run.touches,
            f"{run.robot_time_s:.0f} s",
            "met" if run.met else "not met",
        )


def real_rows(
    quick: bool, *, meshes: Path | None = None, sheet: Path | None = None
) -> Iterator[RealFigures | str]:
    """Explore all meshes of the folder `meshes`, by default the drawn objects, by several seeds.

    One seed if quick. Runs of an earlier call are kept in the folder `sheet`, and not repeated.
    Raises InputError if there is no mesh in the folder.
    """
    targets = _drawn() if meshes is None else _scanned(meshes)
    folder, n_seeds = sheet or Path(FOLDER), 1 if quick else 5
    folder.mkdir(parents=True, exist_ok=True)
    kept = _kept(folder / FILE)
    yield "lengths in mm; touches at 1 %, 0.5 % and 0.2 % of the size, as far as stated"
    heads = (
        *("object", "seed", "turns", "rms", "exposed", "trimesh", "touched", "bound", "covered"),
        *("open", "genus", "touches at", "in all", "robot", ""),
    )
    yield LINE.format(*heads)
    made = []
    for target in targets:
        for seed, turns in product(range(n_seeds), TURNS):
            key = target.name, seed, turns
            runs = [run for run in kept.runs if (run.object, run.seed, run.turns) == key]
            if not runs:
                runs = [_run(target, seed, turns, folder)]
                kept = msgspec.structs.replace(kept, runs=(*kept.runs, *runs))
                write_form(folder / FILE, kept)
            made += runs
            yield RealFigures(runs[0])
    for turns, underside in TURNS.items():
        yield f"at most {turns} turns, the underside {underside}:"
        runs = [run for run in made if run.turns == turns]
        yield from _summary(runs)
        yield from _by_part(runs)


class _Target(NamedTuple):
    """An object that is explored."""

    name: str
    target: ExploreObject
    size: float  # Largest extent [m]


def _scanned(folder: Path) -> Iterator[_Target]:
    paths = sorted(path for path in folder.glob("*") if path.suffix.lower() in SUFFIXES)
    if not paths:
        raise InputError(f"--meshes: {folder} holds no mesh ({', '.join(SUFFIXES)})")
    return map(_read_target, paths)


def _read_target(path: Path) -> _Target:
    vertices, faces, _ = read_mesh(path)
    return _Target(path.name, Mesh(vertices, faces), float(np.ptp(vertices, axis=0).max()))


def _drawn() -> Iterator[_Target]:
    for name, description in DRAWN.items():
        spec = msgspec.convert(description, ObjectSpec)
        yield _Target(name, description, max(object_extents(spec)[0]))


def _kept(path: Path) -> RealRuns:
    if not path.exists():
        return RealRuns(FORM, VERSION, sources_digest())
    content: RealRuns = read_form(path, FORM, VERSION, RealRuns)
    check_sources(path, content.sources)
    return content


def _run(target: _Target, seed: int, turns: int, folder: Path) -> RealRun:
    """Explore, measure, and draw into a folder."""
    start, size = time.process_time(), target.size
    empty = RealRun(target.name, seed, turns, size)
    demand = Demand("touches", SHARES[-1] * size, feature=None, underside=TURNS[turns], turns=turns)
    try:
        explored = explore_object(target.target, NOISY, demand, seed=seed)
    except RuntimeError as error:
        return msgspec.structs.replace(empty, failed=str(error)[:300])
    compute, done = time.process_time() - start, explored.done
    if not len(explored.models[-1].faces):
        return msgspec.structs.replace(empty, failed=done.reason, touches=explored.touches)
    stem = Path(target.name).stem
    title = f"{stem}, seed {seed}, at most {turns} turns"
    return msgspec.structs.replace(
        empty,
        **_errors(explored, folder / f"{stem}-{seed}-{turns}.png", title),
        bound_m=done.rms_bound_95,
        met=done.reached,
        open_share=done.open_share,
        under_share=done.under_share,
        touches=explored.touches,
        turned=len(explored.models[-1].placements),
        reached=_reached(explored, size),
        robot_time_s=done.robot_time,
        compute_s=compute,
        reason=done.reason,
    )


def _errors(explored: Explored, path: Path, title: str) -> dict[str, Any]:
    """Fields of a run that compare the last model with the truth; draws both into a PNG file."""
    last, truth, score = explored.models[-1], explored.truth, explored.score
    solid = trimesh.Trimesh(last.vertices, last.faces, process=False)
    true_solid = trimesh.Trimesh(truth.vertices, truth.faces, process=False)
    picture = draw_run(explored, path, title)
    return {
        "rms_m": score.rms,
        "exposed_rms_m": score.exposed_rms,
        "independent_rms_m": _independent_rms(solid, true_solid),
        "touched_rms_m": picture.touched_rms,
        "sampling_floor_m": score.sampling_floor,
        "covered": picture.covered,
        "genus": score.genus,
        "true_genus": int(1 - true_solid.euler_number // 2),
        "parts": picture.parts,
    }


def _reached(explored: Explored, size: float) -> tuple[int | None, ...]:
    """Touches of the first model whose stated error is at most each share of the size."""
    stated = [
        (estimate.rms_bound_95, estimate.touches)
        for estimate in explored.estimates
        if estimate.rms_bound_95 is not None
    ]
    return tuple(
        next((touches for bound, touches in stated if bound <= share * size), None)
        for share in SHARES
    )


def _independent_rms(
    solid: trimesh.Trimesh, true_solid: trimesh.Trimesh, settings: ComparisonSettings = COMPARISON
) -> float:
    """Root mean square distance in both directions by trimesh, from fewer samples."""
    squares, count = [], settings.n_independent
    nearest: Callable[..., Any] = vars(proximity)["closest_point_naive"]  # it has no types
    for source, target in ((solid, true_solid), (true_solid, solid)):
        points = np.asarray(trimesh.sample.sample_surface(source, count, seed=0)[0])
        for part in np.array_split(points, len(points) // settings.n_at_once):
            _, distances, _ = nearest(target, part)
            squares.append(distances**2)
    return float(np.sqrt(np.concatenate(squares).mean()))


def _summary(runs: Sequence[RealRun]) -> Iterator[str]:
    """In how many runs the stated bound holds, and how much of the surface is not covered."""
    stated = [run for run in runs if run.bound_m is not None]
    if not stated:
        return
    held = sum(run.held for run in stated)
    shares = [run.error_m / (run.bound_m or np.inf) for run in stated]
    met, least = [run for run in stated if run.met], COMPARISON.min_uncovered
    wrong = sum(run.covered < 1.0 - (run.under_share or 0.0) - least for run in met)
    yield (
        f"the bound held in {held} of {len(stated)} runs, the error {np.median(shares):.2f} of it "
        f"in the median and at most {max(shares):.2f}; {len(met)} runs within tolerance, "
        f"{wrong} of them with more than 1 % of the surface over 5 mm from any touch, the "
        "underside apart"
    )


def _by_part(runs: Sequence[RealRun]) -> Iterator[str]:
    """Error over bound in each part of the rebuilt surfaces."""
    for name in PART_NAMES:
        parts = [part for run in runs for part in run.parts if part.name == name]
        if not parts:
            continue
        share, rms = (np.mean([getattr(part, key) for part in parts]) for key in ("share", "rms_m"))
        line = f"{name:<10} {share:6.1%} of the surface, rms {1e3 * rms:.3f} mm"
        ratios = [part.rms_m / part.bound_m for part in parts if part.bound_m > 0.0]
        if name == "underside" or not ratios:  # an underside, which may be hollow, has no bound
            yield line
        else:
            yield (
                f"{line}, error {np.median(ratios):.2f} of the bound in the median, above it in "
                f"{sum(ratio > 1.0 for ratio in ratios)} of {len(ratios)}"
            )


class _Side(NamedTuple):
    """Samples of one of two surfaces that are compared."""

    name: str
    places: Floats  # (n, 3) [m]
    normals: Floats  # Outward (n, 3)
    distances: Floats  # From the other surface (n,) [m]


class Deviations(NamedTuple):
    """Figures of a picture."""

    touched_rms: float  # Root mean square distance of places near a touched point [m]
    covered: float  # Share of the true surface near a touched point
    parts: tuple[PartError, ...]  # Of the rebuilt surface


def draw_run(
    explored: Explored, path: Path, title: str, settings: ComparisonSettings = COMPARISON
) -> Deviations:
    """Draw the last model of an exploration and its truth into a PNG file."""
    last, truth = explored.models[-1], explored.truth
    solid, true_solid = last.vertices[last.faces], truth.vertices[truth.faces]
    rng = np.random.default_rng(0)
    sides = []
    for name, own, other in (("truth", true_solid, solid), ("rebuilt", solid, true_solid)):
        places, faces = sample_surface(own, settings.n_samples, rng)
        distances = nearest_points(nearest_search(other), places).distances
        sides.append(_Side(name, places, areas_and_normals(own)[1][faces], distances))
    _draw(path, title, sides)
    from_touch = [_from_touch(last.vertices, last.vertex_distances, side.places) for side in sides]
    near = np.concatenate(from_touch) <= settings.touched_distance
    distances = np.concatenate([side.distances for side in sides])
    touched = float(np.sqrt(np.mean(distances[near] ** 2))) if near.any() else 0.0
    covered = float(near[: settings.n_samples].mean())
    parts = _parts(last, truth.platform, sides[1], settings.part_distances)
    return Deviations(touched, covered, tuple(parts))


def _parts(
    model: ShapeModel, platform: float | None, side: _Side, part_distances: tuple[float, float]
) -> Iterator[PartError]:
    """Error and bound of the parts of a rebuilt surface by their distance from touch."""
    if not len(model.vertex_distances):
        return
    nearest = cKDTree(model.vertices).query(side.places)[1]
    distances, bounds = model.vertex_distances[nearest], model.vertex_bounds[nearest]
    part = np.digitize(distances, part_distances)
    if platform is not None:
        lowest = platform + DEFAULT_SURFACE.places.standing_height
        part[side.places[:, 2] < lowest] = PART_NAMES.index("underside")
    for number, name in enumerate(PART_NAMES):
        own = part == number
        if own.any():
            rms, bound = (np.sqrt(np.mean(v[own] ** 2)) for v in (side.distances, bounds))
            yield PartError(name, float(own.mean()), float(rms), float(bound))


def _from_touch(vertices: Floats, distances: Floats, places: Floats) -> Floats:
    """Upper bounds (n,) of the distances of places from touched points, by the nearest vertex."""
    if not len(distances):
        return np.full(len(places), np.inf)
    to_vertex, number = cKDTree(vertices).query(places)
    return np.asarray(to_vertex + distances[number])


def _draw(
    path: Path, title: str, sides: Sequence[_Side], settings: PictureSettings = PictureSettings()
) -> None:
    """The samples of both surfaces that face the viewer, in several views."""
    from matplotlib.colors import LogNorm

    from palpate.launch import charts

    figure = charts.new_figure(1200.0, 640.0)
    figure.suptitle(f"{title}: distance from the other, mm")
    norm, count = LogNorm(*settings.colour_range), len(settings.views)
    panels = enumerate(product(sides, settings.views), start=1)
    for number, (side, (elevation, azimuth)) in panels:
        up, turn = np.radians([elevation, azimuth])
        towards = np.array([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
        seen = side.normals @ towards > 0.0
        colours = np.clip(1e3 * side.distances[seen], *settings.colour_range)
        axes = figure.add_subplot(len(sides), count, number, projection="3d")
        drawn = axes.scatter(*1e3 * side.places[seen].T, c=colours, norm=norm, s=2, cmap="turbo")
        axes.view_init(elevation, azimuth)
        axes.set_aspect("equal")
        axes.set_title(side.name, fontsize=9)
        axes.tick_params(labelsize=6)
    figure.colorbar(drawn, ax=figure.axes, shrink=0.6, format="%g")
    charts.write_figure(figure, path)
