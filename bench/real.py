"""Real objects: a folder of meshes explored with noise, each run measured twice and kept.

Without a folder it is a drawn set of thin, hollow and machined things. Each is explored as it
stands, its underside taken for flat, and with the underside to be known, for which it is turned
over. Beside our own distances stand those of trimesh, from fewer samples. *Covered* is the share of
the true surface within 5 mm of a touched point. Error and bound are also told by part of the
rebuilt surface. A share of the size (the largest extent) is reached at the first
model of which the run states that its error is below it. A picture shows each surface coloured by
how far it is from the other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
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
from palpate.core.explore.planners import PLACES
from palpate.core.geometry import areas_and_normals, nearest_points, nearest_search, sample_surface
from palpate.core.shapes import Mesh
from palpate.launch.files.mesh_file import read_mesh
from palpate.launch.files.source_map import InputError
from palpate.messages.types import ShapeModel
from palpate.nodes.specs.objects import ObjectSpec, object_extents

FORM, VERSION = "palpate real", 4
FOLDER, FILE = "bench-real", "runs.json"
SUFFIXES = (".ply", ".stl", ".obj", ".off", ".glb")
SHARES = (0.01, 0.005, 0.002)  # Of the size
SEEDS, QUICK_SEEDS = 5, 1
TURNS = {0: "flat", 1: "known"}  # Times that it may be turned over, and what is asked below
INDEPENDENT, AT_ONCE = 400, 10  # Samples for trimesh, and of these at a time
LINE = "{:<24}{:>5}{:>6}{:>9}{:>9}{:>9}{:>9}{:>9}{:>8}{:>8}{:>7}{:>16}{:>8}{:>8}  {}"
SAMPLES = 20_000  # Places on each surface
NEAR = 5e-3  # Of a touched point, m
VIEWS = ((20.0, 35.0), (20.0, 215.0), (75.0, 35.0), (-60.0, 35.0))  # Elevation, azimuth, degrees
LEAST, MOST = 0.01, 5.0  # Ends of the colours, mm
PARTS = (2e-3, 5e-3, np.inf)  # Distances from touch up to which the surface is one part, m
PART_NAMES = ("touched", "near", "far", "underside")


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
# Thin, hollow and machined things that stand on their lower end; m.
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
    """Error of a part of the rebuilt surface, and what was stated of it; m."""

    name: str  # One of `PART_NAMES`
    share: float  # Of the surface
    rms_m: float
    bound_m: float


class RealRun(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One exploration of a mesh; lengths in m, times in s."""

    object: str  # Name of the file
    seed: int
    turns: int  # Times that it could be turned over, its underside then to be known
    size_m: float  # Largest extent
    rms_m: float = 0.0  # Our own distance, of the last model
    exposed_rms_m: float = 0.0  # The same without what stands on the platform
    independent_rms_m: float = 0.0  # The same by trimesh
    touched_rms_m: float = 0.0  # Of places within 5 mm of a touched point
    sampling_floor_m: float = 0.0
    bound_m: float | None = None  # What the run states of its error
    met: bool | None = None  # Whether it states that its tolerance was met
    covered: float = 0.0  # Share of the true surface
    open_share: float | None = None  # Of the surface, as the run states it
    under_share: float | None = None
    genus: int = -1
    true_genus: int = -1
    touches: int = 0
    turned: int = 0  # Times that it was turned over
    reached: tuple[int | None, ...] = (None,) * len(SHARES)  # Touches at each share of the size
    robot_time_s: float = 0.0
    compute_s: float = 0.0
    parts: tuple[PartError, ...] = ()
    reason: str = ""
    failed: str = ""  # Why there is no model, if there is none

    @property
    def held(self) -> bool:
        """Whether the error is below what was stated: without what is taken for flat."""
        return self.bound_m is not None and self.error_m <= self.bound_m

    @property
    def error_m(self) -> float:
        """The error of which something is stated."""
        return self.rms_m if self.turned else self.exposed_rms_m


class RealRuns(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All runs of a file."""

    form: str
    version: int
    sources: str  # Digest of the palpate that explored
    runs: tuple[RealRun, ...] = ()


class RealFigures(msgspec.Struct, frozen=True):
    """A line of the table."""

    run: RealRun

    @property
    def name(self) -> str:
        """Of object, seed and turns."""
        return f"{self.run.object} {self.run.seed} {self.run.turns}"

    @property
    def figures(self) -> Sequence[Figure]:
        """What is compared with another measurement."""
        run = self.run
        return (
            figure_of(1e3 * run.rms_m, "mm", name="rms"),
            figure_of(1e3 * (run.bound_m or 0.0), "mm", name="bound"),
            figure_of(run.touches, name="touches"),
        )

    @property
    def holds(self) -> bool:
        """Whether what the run states is true."""
        return self.run.bound_m is None or self.run.held or not self.run.met

    def __str__(self) -> str:
        run = self.run
        if run.failed:
            return f"{run.object:<24}{run.seed:>5}{run.turns:>6}  no model: {run.failed}"
        reached = "/".join("-" if one is None else str(one) for one in run.reached)
        stated = "none" if run.bound_m is None else f"{1e3 * run.bound_m:.3f}"
        lengths = (run.rms_m, run.exposed_rms_m, run.independent_rms_m, run.touched_rms_m)
        return LINE.format(
            run.object,
            run.seed,
            run.turns,
            *(f"{1e3 * one:.3f}" for one in lengths),
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
    """Explore every mesh of the folder that ``--meshes`` names, or what is drawn, by several seeds.

    What is there already is not made again. Raises InputError if there is no mesh in the folder.
    """
    things = _drawn() if meshes is None else _scanned(meshes)
    folder = sheet or Path(FOLDER)
    folder.mkdir(parents=True, exist_ok=True)
    kept = _kept(folder / FILE)
    yield "lengths in mm; touches at 1 %, 0.5 % and 0.2 % of the size, as far as stated"
    heads = (
        "object",
        "seed",
        "turns",
        "rms",
        "exposed",
        "trimesh",
        "touched",
        "bound",
        "covered",
        "open",
        "genus",
    )
    yield LINE.format(*heads, "touches at", "in all", "robot", "")
    made = []
    for thing in things:
        for seed, turns in product(range(QUICK_SEEDS if quick else SEEDS), TURNS):
            asked = thing.name, seed, turns
            known = [one for one in kept.runs if (one.object, one.seed, one.turns) == asked]
            if not known:
                known = [_run(thing, seed, turns, folder)]
                kept = msgspec.structs.replace(kept, runs=(*kept.runs, *known))
                write_form(folder / FILE, kept)
            made += known
            yield RealFigures(known[0])
    for turns, below in TURNS.items():
        yield f"at most {turns} turns, the underside {below}:"
        some = [one for one in made if one.turns == turns]
        yield from _summary(some)
        yield from _by_part(some)


class _Thing(NamedTuple):
    """What is explored."""

    name: str
    target: ExploreObject
    size: float  # Largest extent, m


def _scanned(folder: Path) -> Iterator[_Thing]:
    paths = sorted(one for one in folder.glob("*") if one.suffix.lower() in SUFFIXES)
    if not paths:
        raise InputError(f"--meshes: {folder} holds no mesh ({', '.join(SUFFIXES)})")
    return map(_read_thing, paths)


def _read_thing(path: Path) -> _Thing:
    vertices, faces, _ = read_mesh(path)
    return _Thing(path.name, Mesh(vertices, faces), float(np.ptp(vertices, axis=0).max()))


def _drawn() -> Iterator[_Thing]:
    for name, words in DRAWN.items():
        spec = msgspec.convert(words, ObjectSpec)
        yield _Thing(name, words, max(object_extents(spec)[0]))


def _kept(path: Path) -> RealRuns:
    if not path.exists():
        return RealRuns(FORM, VERSION, sources_digest())
    found: RealRuns = read_form(path, FORM, VERSION, RealRuns)
    check_sources(path, found.sources)
    return found


def _run(thing: _Thing, seed: int, turns: int, folder: Path) -> RealRun:
    begun, size = time.process_time(), thing.size
    nothing = RealRun(thing.name, seed, turns, size)
    asked = Demand("touches", SHARES[-1] * size, feature=None, underside=TURNS[turns], turns=turns)
    try:
        found = explore_object(thing.target, NOISY, asked, seed=seed)
    except RuntimeError as error:
        return msgspec.structs.replace(nothing, failed=str(error)[:300])
    compute = time.process_time() - begun
    last, truth = found.models[-1], found.truth
    if not len(last.faces):
        return msgspec.structs.replace(nothing, failed=found.done.reason, touches=found.touches)
    solid = trimesh.Trimesh(last.vertices, last.faces, process=False)
    real = trimesh.Trimesh(truth.vertices, truth.faces, process=False)
    stem = Path(thing.name).stem
    title = f"{stem}, seed {seed}, at most {turns} turns"
    picture = draw_run(found, folder / f"{stem}-{seed}-{turns}.png", title)
    return msgspec.structs.replace(
        nothing,
        rms_m=found.score.rms,
        exposed_rms_m=found.score.exposed_rms,
        independent_rms_m=_independent(solid, real),
        touched_rms_m=picture.touched_rms,
        sampling_floor_m=found.score.sampling_floor,
        bound_m=found.done.rms_bound_95,
        met=found.done.reached,
        covered=picture.covered,
        open_share=found.done.open_share,
        under_share=found.done.under_share,
        genus=found.score.genus,
        true_genus=int(1 - real.euler_number // 2),
        touches=found.touches,
        turned=len(last.placements),
        reached=_reached(found, size),
        robot_time_s=found.done.robot_time,
        compute_s=compute,
        parts=picture.parts,
        reason=found.done.reason,
    )


def _reached(found: Explored, size: float) -> tuple[int | None, ...]:
    """Touches of the first model whose stated error is below each share of the size."""
    stated = [one for one in found.estimates if one.rms_bound_95 is not None]
    return tuple(
        next((one.touches for one in stated if (one.rms_bound_95 or 0.0) <= share * size), None)
        for share in SHARES
    )


def _independent(solid: trimesh.Trimesh, real: trimesh.Trimesh) -> float:
    """Root mean square distance over both ways, of fewer samples and by trimesh."""
    squares = []
    nearest: Callable[..., Any] = vars(proximity)["closest_point_naive"]  # it has no types
    for source, target in ((solid, real), (real, solid)):
        points = np.asarray(trimesh.sample.sample_surface(source, INDEPENDENT, seed=0)[0])
        for part in np.array_split(points, len(points) // AT_ONCE):
            _, distances, _ = nearest(target, part)
            squares.append(distances**2)
    return float(np.sqrt(np.concatenate(squares).mean()))


def _summary(runs: Sequence[RealRun]) -> Iterator[str]:
    """In how many runs what was stated is true."""
    stated = [one for one in runs if one.bound_m is not None]
    if not stated:
        return
    held = sum(one.held for one in stated)
    shares = [one.error_m / (one.bound_m or np.inf) for one in stated]
    met = [one for one in stated if one.met]
    wrong = sum(one.covered < 1.0 - (one.under_share or 0.0) - 0.01 for one in met)
    yield (
        f"the bound held in {held} of {len(stated)} runs, the error {np.median(shares):.2f} of it "
        f"in the median and at most {max(shares):.2f}; {len(met)} runs within tolerance, "
        f"{wrong} of them with more than 1 % of the surface over 5 mm from any touch, the "
        "underside apart"
    )


def _by_part(runs: Sequence[RealRun]) -> Iterator[str]:
    """How error and bound compare in each part of the rebuilt surfaces."""
    for name in PART_NAMES:
        parts = [part for run in runs for part in run.parts if part.name == name]
        if not parts:
            continue
        share, rms = (np.mean([getattr(one, key) for one in parts]) for key in ("share", "rms_m"))
        line = f"{name:<10} {share:6.1%} of the surface, rms {1e3 * rms:.3f} mm"
        ratios = [one.rms_m / one.bound_m for one in parts if one.bound_m > 0.0]
        if name == "underside" or not ratios:  # no number bounds what may be hollow
            yield line
        else:
            yield (
                f"{line}, error {np.median(ratios):.2f} of the bound in the median, above it in "
                f"{sum(one > 1.0 for one in ratios)} of {len(ratios)}"
            )


class _Side(NamedTuple):
    """One of two surfaces that are compared."""

    name: str
    places: Floats  # (n, 3), m
    normals: Floats  # Outward, (n, 3)
    distances: Floats  # From the other, (n,), m


class Deviations(NamedTuple):
    """What a picture shows, in numbers."""

    touched_rms: float  # Root mean square distance of places near a touched point, m
    covered: float  # Share of the true surface near a touched point
    parts: tuple[PartError, ...]  # Of the rebuilt surface


def draw_run(found: Explored, path: Path, title: str) -> Deviations:
    """Draw the last model of an exploration and its truth into a PNG file."""
    last, truth = found.models[-1], found.truth
    solid, real = last.vertices[last.faces], truth.vertices[truth.faces]
    rng = np.random.default_rng(0)
    sides = []
    for name, one, other in (("truth", real, solid), ("rebuilt", solid, real)):
        places, faces = sample_surface(one, SAMPLES, rng)
        distances = nearest_points(nearest_search(other), places).distances
        sides.append(_Side(name, places, areas_and_normals(one)[1][faces], distances))
    _draw(path, title, sides)
    away = [_from_touch(last.vertices, last.vertex_distances, side.places) for side in sides]
    near = np.concatenate(away) <= NEAR
    every = np.concatenate([side.distances for side in sides])
    touched = float(np.sqrt(np.mean(every[near] ** 2))) if near.any() else 0.0
    covered = float(near[:SAMPLES].mean())
    return Deviations(touched, covered, tuple(_parts(last, truth.platform, sides[1])))


def _parts(model: ShapeModel, platform: float | None, side: _Side) -> Iterator[PartError]:
    """Error and bound of the parts of a rebuilt surface by their distance from touch."""
    if not len(model.vertex_distances):
        return
    nearest = cKDTree(model.vertices).query(side.places)[1]
    distances, bounds = model.vertex_distances[nearest], model.vertex_bounds[nearest]
    part = np.digitize(distances, PARTS[:-1])
    if platform is not None:
        part[side.places[:, 2] < platform + PLACES.standing_height] = len(PARTS)
    for number, name in enumerate(PART_NAMES):
        here = part == number
        if here.any():
            rms, bound = (np.sqrt(np.mean(one[here] ** 2)) for one in (side.distances, bounds))
            yield PartError(name, float(here.mean()), float(rms), float(bound))


def _from_touch(vertices: Floats, distances: Floats, places: Floats) -> Floats:
    """Distances (n,) of places from what was touched, at most: by way of the nearest vertex."""
    if not len(distances):
        return np.full(len(places), np.inf)
    way, number = cKDTree(vertices).query(places)
    return np.asarray(way + distances[number])


def _draw(path: Path, title: str, sides: Sequence[_Side]) -> None:
    """What of both faces the viewer, from all around and from below."""
    from matplotlib.colors import LogNorm

    from palpate.launch import charts

    figure = charts.new_figure(1200.0, 640.0)
    figure.suptitle(f"{title}: distance from the other, mm")
    norm, count = LogNorm(LEAST, MOST), len(VIEWS)
    for number, (side, (elevation, azimuth)) in enumerate(product(sides, VIEWS), start=1):
        up, turn = np.radians([elevation, azimuth])
        towards = np.array([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
        seen = side.normals @ towards > 0.0
        colours = np.clip(1e3 * side.distances[seen], LEAST, MOST)
        axes = figure.add_subplot(len(sides), count, number, projection="3d")
        drawn = axes.scatter(*1e3 * side.places[seen].T, c=colours, norm=norm, s=2, cmap="turbo")
        axes.view_init(elevation, azimuth)
        axes.set_aspect("equal")
        axes.set_title(side.name, fontsize=9)
        axes.tick_params(labelsize=6)
    figure.colorbar(drawn, ax=figure.axes, shrink=0.6, format="%g")
    charts.write_figure(figure, path)
