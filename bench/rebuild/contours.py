"""How far the band of a loft can be trusted; what disorder costs, and what all taxels add."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from palpate.bench.explore import MessageCollector
from palpate.bench.objects import ROUND_HEIGHT, ROUND_OBJECTS, WAVY, RoundObject
from palpate.bench.table import Row, at_least, at_most
from palpate.core import Floats
from palpate.core.geometry import PreparedSurface, compare_surfaces, prepare_surface
from palpate.core.rebuild import Solid, reconstruct
from palpate.core.rebuild.contours import ContactPoints, contact_points_of, stack_points
from palpate.core.rebuild.side import ContourLoft, fit_contour_loft
from palpate.core.touch import Jet
from palpate.launch import EXPLORE, choose_run_directory, describe, find_scene, override
from palpate.launch.files import SourceMapped
from palpate.messages import types
from palpate.nodes import reconstructor as reconstructor_node
from palpate.nodes.runtime import run_composed
from palpate.nodes.specs import pad_of_info

BAND_SIZES = ((6, 24), (9, 24), (14, 40), (24, 40), (27, 80))  # Contours, and points of each
FULL = (27, 80)
NOISES = (0.002, 0.005)  # Standard deviation of a coordinate over the height
BAND_SEEDS, QUICK_BAND_SEEDS = 13, 2
BEYOND = 0.04  # By which the ends lie beyond the contours, where no pole is known
POLE = float(np.sqrt(1.04))  # Height at which the lobed zig-zag closes
NORMAL_95 = 1.96
OUTLIERS, BAND_OFF = 0.02, 0.03  # Share of the points that are off, and by how much of the height
# Places at which a surface is compared with the truth, from contour to contour.
ROWS, COLUMNS = 181, 97
SIZES = ((27, 81), (24, 41), (9, 24))  # Contours, and points of each
# Standard deviation of a coordinate, and how far which share of points is off; heights are 2.
POINT_NOISE, OFF, SHARE = 0.004, 0.06, 0.02
SEEDS, QUICK_SEEDS = 4, 1
SPREAD = 100  # Between the seeds of objects, so that they do not share their noise
LAST = 0.99  # Height of the last contours, on either side
WIDE, NARROW, AT = 0.6, 0.36, 0.12  # Radii of a cylinder that steps, and where
STEPS = 16  # Random stacks of its contours
SMOOTH = ("sphere", "egg", "dented", "twisted", "vase")
SHARP = ("box", "gem", "notched")
COUNTS = (5, 9)
# That of a sensor whose pose is known to 0.1 mm.
SENSOR_NOISE = {
    "pose_error": {"sigma": 1e-4, "rotation": 0.05},
    "gaussian_noise": {"sigma": 10e-6},
    "dead_taxels": {"rate": 0.01},
}
MESH_TOLERANCE = 1.5e-4  # Of the meshes that are compared, over the height
# Most error that may be left of the contours' own; the latter of sharp objects with noise.
MOST_SMOOTH, MOST_NOISY = 0.5, 0.8
KEPT_TOPICS = (
    *("/touch/info", "/touch/patch", "/contour/traced", "/probe/traced"),
    *("/world", "/plan/done", "/truth"),
)


class BandErrors(NamedTuple):
    """One surface against the truth; lengths over the height."""

    rms: float  # Root mean square error
    covered: float  # Share of the surface within the band of 95 %
    safe_rms: bool  # Whether the root mean square error stays below what was claimed
    safe_most: bool  # Whether the largest error does


def band_rows(quick: bool) -> Iterable[Row]:
    """Figures of surfaces through contours; fewer runs if quick."""
    for ends, poles in (("closed", True), ("open ends", False)):
        clean = judge_band(WAVY, _skin(WAVY, FULL, 0.0, 0, poles=poles)).rms
        yield at_most(f"lobed zig-zag, 27 by 80, {ends}: rms over height", clean, 1e-4, ".3g")
    seeds = QUICK_BAND_SEEDS if quick else BAND_SEEDS
    noisy = _noisy(WAVY, FULL, 0.005, seeds)
    yield at_most("the same with noise of 0.5 %: rms over height", noisy, 1.5e-3, ".3g")
    yield from _coverage_rows(seeds)
    yield at_most("2 % of points off: error over that without", _outliers(seeds), 1.1, ".3g")


def _coverage_rows(seeds: int) -> Iterable[Row]:
    for size in BAND_SIZES:
        found = [
            judge_band(thing, _skin(thing, size, noise, seed))
            for thing in ROUND_OBJECTS.values()
            for noise in NOISES
            for seed in range(seeds)
        ]
        name = f"{size[0]} by {size[1]}, {len(found)} runs"
        pooled = float(np.mean([one.covered for one in found]))
        holds = 0.90 <= pooled <= 0.98
        yield Row(f"{name}: within the 95 % band", f"{pooled:.1%}", "90 to 98 %", holds)
        for what, error in (("rms", "root mean square"), ("most", "largest")):
            safe = float(np.mean([getattr(one, f"safe_{what}") for one in found]))
            yield at_least(f"{name}: {error} error as claimed", safe, 0.9, ".1%")


def _outliers(seeds: int) -> float:
    """Error with points off over that without, pooled over objects."""
    things = ROUND_OBJECTS.values()
    errors = [[_noisy(one, FULL, 0.002, seeds, off) for off in (OUTLIERS, 0.0)] for one in things]
    return float(np.exp(np.mean(np.log([off / plain for off, plain in errors]))))


def _noisy(
    thing: RoundObject, size: tuple[int, int], noise: float, seeds: int, off: float = 0.0
) -> float:
    """Mean root mean square error over the height."""
    found = [judge_band(thing, _skin(thing, size, noise, seed, off)).rms for seed in range(seeds)]
    return float(np.mean(found))


def judge_band(thing: RoundObject, skin: ContourLoft) -> BandErrors:
    """Compare a surface with the object between its contours."""
    heights = np.linspace(-0.998, 0.998, ROWS)
    turns = (np.arange(COLUMNS) + 0.1) / COLUMNS
    places = skin.at(heights[:, None], turns)
    off, area = thing.distances(places, heights)
    deviation = skin.deviation(heights, turns)
    share = area / area.sum()
    rms = float(np.sqrt((share * off**2).sum()))
    most = float(np.abs(off).max())
    claimed = skin.uncertainty()
    covered = float(share[np.abs(off) <= NORMAL_95 * deviation].sum())
    safe = rms <= claimed.rms, most <= claimed.most
    return BandErrors(rms / ROUND_HEIGHT, covered, *safe)


def _skin(
    thing: RoundObject,
    size: tuple[int, int],
    noise: float,
    seed: int,
    off: float = 0.0,
    poles: bool = False,
) -> ContourLoft:
    """A loft of contours with noise, and with a share of points that are off along the radius."""
    rng = np.random.default_rng(seed)
    heights = np.linspace(-1.0, 1.0, size[0])
    grid = thing.rings(heights, 2.0 * np.pi * np.arange(size[1]) / size[1])[..., :2]
    outwards = grid - grid.mean(axis=1, keepdims=True)
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    grid = grid + noise * ROUND_HEIGHT * rng.normal(size=grid.shape)
    wrong = rng.random(grid.shape[:2]) < off
    signs = rng.choice([-1.0, 1.0], (wrong.sum(), 1))
    grid[wrong] += BAND_OFF * ROUND_HEIGHT * signs * outwards[wrong]
    end = POLE if poles else 1.0 + BEYOND
    return fit_contour_loft(heights, grid, low=-end, high=end, pole=(poles, poles))


def contour_rows(quick: bool) -> Iterable[Row]:
    """Figures of what contours may be like; fewer runs if quick."""
    seeds = QUICK_SEEDS if quick else SEEDS
    for size in SIZES:
        name = f"{size[0]} by {size[1]}"
        ratio = contour_ratio(size, seeds, anyhow=True)
        yield at_most(f"{name}, begun anywhere: error over as recorded", ratio, 1.03, ".3g")
        ratio = contour_ratio(size, seeds, share=SHARE)
        yield at_most(f"{name}, 2 % of points outlying: error over without", ratio, 1.1, ".3g")
    most = max(step_swing(seed) for seed in range(STEPS))
    yield at_most("a step: side beyond its radii, over the width", most, 0.05, ".3g")


def contour_ratio(
    size: tuple[int, int], seeds: int, *, anyhow: bool = False, share: float = 0.0
) -> float:
    """Geometric mean over objects of the error in one case over that of plain contours.

    `anyhow`: contours begun anywhere, in either direction, of any count. `share`: of the points
    that are far off.
    """
    logs = []
    for number, thing in enumerate(ROUND_OBJECTS.values()):
        plain, other = 0.0, 0.0
        for seed in range(SPREAD * number, SPREAD * number + seeds):
            plain += _side_error(thing, _contours(thing, size, seed, anyhow=False, share=0.0))
            other += _side_error(thing, _contours(thing, size, seed, anyhow=anyhow, share=share))
        logs.append(np.log(other / plain))
    return float(np.exp(np.mean(logs)))


def _side_error(thing: RoundObject, contours: list[Floats]) -> float:
    """Mean distance of the side from the object."""
    heights = np.linspace(-LAST, LAST, ROWS)
    off, area = thing.distances(_side(_rebuilt(contours), heights), heights)
    return float((np.abs(off) * area).sum() / area.sum())


def step_swing(seed: int) -> float:
    """How far the side leaves the two radii of a step, over the width."""
    rng = np.random.default_rng(seed)
    near = AT + np.concatenate([rng.uniform(-0.06, 0.0, 2), 0.002 + rng.uniform(0.0, 0.06, 2)])
    heights = np.concatenate([rng.uniform(-LAST, LAST, 12), near])
    angle = 2.0 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(60)])
    contours = [(WIDE if z < AT + 0.001 else NARROW) * rim + [0.0, 0.0, z] for z in heights]
    side = _side(_rebuilt(contours), np.linspace(-LAST, LAST, 997))
    radius = np.linalg.norm(side, axis=2)
    return float(max(radius.max() - WIDE, NARROW - radius.min())) / (2.0 * WIDE)


def _side(solid: Solid, heights: Floats) -> Floats:
    """Places (m, COLUMNS, 2) of the side at heights (m,)."""
    if solid.closed is None:
        raise ValueError("solid must have a skin, got none")
    return solid.closed.loft.at(heights[:, None], np.arange(COLUMNS) / COLUMNS)


def _contours(
    thing: RoundObject, size: tuple[int, int], seed: int, *, anyhow: bool, share: float
) -> list[Floats]:
    """Noisy contours (n, 3), the noise the same for one seed as far as counts are."""
    rng, other = np.random.default_rng(seed), np.random.default_rng(seed + 1000)
    found = []
    for z in np.linspace(-LAST, LAST, size[0]):
        many = int(size[1] * other.uniform(0.8, 1.25)) if anyhow else size[1]
        angle = 2.0 * np.pi * (np.arange(many) / many + (other.random() if anyhow else 0.0))
        points = thing.rings(np.array([z]), angle)[0]
        points += POINT_NOISE * rng.normal(size=points.shape)
        away = other.normal(size=points.shape)
        away *= OFF / np.linalg.norm(away, axis=1, keepdims=True)
        points += away * (other.random(many) < share)[:, None]
        found.append(points[:: other.choice([-1, 1]) if anyhow else 1])
    return found


def _rebuilt(contours: list[Floats]) -> Solid:
    return reconstruct(contours, method="skin", tops=[[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])


class TouchedScene(NamedTuple):
    """An exploration."""

    contours: list[Floats]  # Points (n, 3) each, m
    points: ContactPoints  # All touched taxels
    frame: Floats  # Pose of the slicing frame, (7,)
    tops: Floats | None  # Touches of the ends, (k, 3), m
    truth: PreparedSurface  # The object
    height: float  # Of it, m
    floor: float  # Chamfer distance between two tessellations of it, m


def taxel_rows(quick: bool) -> Iterable[Row]:
    """Errors of solids from all taxels over those of their contours alone."""
    scenes = ("sphere", "box") if quick else (*SMOOTH, *SHARP)
    for noisy in (False, True):
        for count in COUNTS:
            for scene in scenes:
                most = MOST_NOISY if noisy and scene in SHARP else MOST_SMOOTH
                yield _row(scene, explore_evenly(scene, count, noisy), count, noisy, most)


def _row(scene: str, touched: TouchedScene, count: int, noisy: bool, most: float) -> Row:
    error, without = _taxel_error(touched, touched.points), _taxel_error(touched, None)
    ratio, share = error / without, 100.0 / touched.height
    name = f"{scene}, {count} contours{', noise' if noisy else ''}: all taxels over contours"
    target = f"<= {most:g} x (% of height; floor {touched.floor * share:.4f})"
    # What two tessellations of the truth differ by cannot be halved.
    holds = ratio <= most or error <= 2.0 * touched.floor
    return Row(name, f"{error * share:.4f} {ratio:.2f} x", target, holds)


def _taxel_error(touched: TouchedScene, points: ContactPoints | None) -> float:
    """Chamfer distance from the object, m."""
    solid = reconstruct(
        touched.contours, patches=points, tops=touched.tops, frame=touched.frame, method="skin"
    )
    mesh = solid.mesh(MESH_TOLERANCE * touched.height)
    return compare_surfaces(touched.truth, prepare_surface(mesh.vertices, mesh.faces)).chamfer


def explore_evenly(scene: str, count: int, noisy: bool) -> TouchedScene:
    """Touch a shipped scene along so many contours, in this process."""
    given = {"scene": str(find_scene(scene)), "record": False}
    args = {name: SourceMapped(value, name) for name, value in given.items()}
    settings = {
        "planner.planner": SourceMapped("uniform", "planner"),
        "planner.settings": SourceMapped({"count": count}, "count"),
    }
    if noisy:
        settings["simulator.effects"] = SourceMapped(SENSOR_NOISE, "effects")
    folder = choose_run_directory("bench", None)  # chosen, never made
    graph = override(describe(EXPLORE, args, folder.path).graph, settings)
    wirings = [one for one in graph.wirings() if one.name != "evaluator"]
    collector = MessageCollector()
    run_composed(wirings, ends="planner", watch=KEPT_TOPICS, watcher=collector)
    return _touched_scene(collector.kept)


def _touched_scene(kept: Mapping[type, list[Any]]) -> TouchedScene:
    [done], [truth], [world] = (kept[name] for name in (types.PlanDone, types.Truth, types.World))
    pad = pad_of_info(kept[types.SensorInfo][-1])
    parts: dict[int, list[ContactPoints]] = {}
    for patch in kept[types.SurfacePatch]:
        if patch.goal in (*done.contours, *done.probes):
            jet = Jet(patch.jet, patch.jet_scale) if len(patch.jet) else None
            points = contact_points_of(pad, patch.pose, patch.height, patch.mask, jet)
            parts.setdefault(patch.goal, []).append(points)
    contours = [one for one in kept[types.Contour] if one.id in done.contours]
    probes = [one for one in kept[types.Probe] if one.id in done.probes]
    prepared = prepare_surface(truth.vertices, truth.faces)
    other = prepare_surface(truth.floor_vertices, truth.floor_faces)
    return TouchedScene(
        contours=[one.points for one in contours],
        points=stack_points([one for each in parts.values() for one in each]),
        frame=reconstructor_node.common_frame(contours),
        tops=reconstructor_node.touched_ends(contours, probes, parts, world.platform),
        truth=prepared,
        height=truth.height,
        floor=compare_surfaces(prepared, other).chamfer,
    )
