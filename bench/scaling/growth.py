"""Error and cost as the work grows, and the powers with which they do.

One number grows, all else stays: contours and the points of each, rebuilt from the points alone
or with all taxels beside them; control points; taxels; fingers; nodes. Costs are processor times,
of a ring of nodes the time of a lap, measured in turns.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.bench.bus import ring_times, token_ring
from palpate.bench.explore import NOISY, Demand, InProcessLoop, explore_object, touching_nodes
from palpate.bench.objects import EXPLORED_OBJECTS, REBUILT_SHAPES, SHAPE_HEIGHT, RoundObject
from palpate.bench.rebuild import truth_of
from palpate.bench.table import Figure, Kind, best_seconds, figure_of, in_turns
from palpate.bench.touch import touch_goals
from palpate.core import Floats
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.lattice import fit_lattice
from palpate.core.shapes import Mesh
from palpate.messages.types import SurfacePatch
from palpate.nodes import simulator, specs
from palpate.tools import single_threaded

SIZES: Mapping[str, tuple[int, ...]] = {
    "contours": (4, 6, 9, 14, 22, 36, 60),
    "points": (20, 50, 120, 300, 800, 2000),
    "lattice": (5, 8, 12, 20, 30, 40),
    "taxels": (8, 12, 16, 24, 32, 48, 64),
    "fingers": (1, 2, 3, 4, 5),
    "nodes": (2, 4, 8, 16, 28, 40),
}
SHAPES, QUICK_SHAPES = ("vase", "lobed zig-zag", "rounded box", "groove"), ("vase",)
SEEDS, TURNS, LAPS = 2, 3, 200
AROUND, STACKED = 80, 12  # Points of a contour where contours grow, contours where points do
# Heights about a contour's at which a pad touches, and the turns of the pads around it.
BAND: Floats = np.linspace(-4.0, 4.0, 5)  # mm
PADS = 16
POSE_NOISE, TAXEL_NOISE, MARGIN = 0.1, 0.01, 0.5  # mm; the last contours lie that far inside
TOLERANCE = 0.01  # Of the meshes that are compared, mm
BALL, WIDTH, FRAMES = 0.03, 15e-3, 60  # Radius and width of the array, m; touches of a turn
# Errors below so many sampling floors are left out of the power.
CLEAR = 2.0
FINGERED = "vase"
LABEL, CELL = 34, 9  # Widths in letters


class PowerLaw(NamedTuple):
    """With which power of a size a figure goes; the last two are its interval of 95 %."""

    exponent: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.exponent:+.2f} ({self.low:+.2f} to {self.high:+.2f})"


def fit_power_law(sizes: ArrayLike, values: ArrayLike) -> PowerLaw:
    """Least squares of the logarithms of values (n,), or (n, k) of k repeats, at sizes (n,).

    Repeats are averaged first, each may have a factor of its own: so the interval, Student's with
    n - 2 degrees of freedom, holds both their scatter and what is no power. Raises ValueError if
    there are fewer than 3 sizes, all are alike, or something is not positive.
    """
    x, y = np.asarray(sizes, float), np.asarray(values, float)
    if len(x) < 3 or len(y) != len(x) or not np.ptp(x) > 0.0:
        raise ValueError(f"sizes must be 3 or more, with as many values, got {len(x)}, {len(y)}")
    if not (np.isfinite(y).all() and (y > 0.0).all() and (x > 0.0).all()):
        raise ValueError("sizes and values must be positive and finite")
    away = np.log(x) - np.log(x).mean()
    logs = np.log(y).reshape(len(x), -1).mean(axis=1)
    spread = float(away @ away)
    exponent = float(away @ logs) / spread
    left = logs - logs.mean() - exponent * away
    reach = students_reach(len(x) - 2) * math.sqrt(float(left @ left) / (len(x) - 2) / spread)
    return PowerLaw(exponent, exponent - reach, exponent + reach)


def students_reach(freedom: int) -> float:
    """Deviations within which Student's variable is in 95 of 100 cases."""
    from scipy.stats import t

    return float(t.ppf(0.975, freedom))


class Curve(NamedTuple):
    """A figure at each size."""

    what: str  # With its unit
    values: tuple[float, ...]  # Geometric means over repeats
    law: PowerLaw | None  # None where too few values stand clear of the floor

    def __str__(self) -> str:
        cells = "".join(f"{value:>{CELL}.3g}" for value in self.values)
        return f"  {self.what:<{LABEL - 2}}{cells}  {self.law or ''}".rstrip()


class Growth(NamedTuple):
    """What becomes of error and cost as one number grows; nothing is demanded."""

    name: str  # What grows, and how it is measured
    sizes: tuple[int, ...]
    floor: float  # Sampling floor of the errors, in their unit; 0 if they are not sampled
    errors: tuple[Curve, ...]
    costs: tuple[Curve, ...]
    holds: bool = True

    @property
    def figures(self) -> Sequence[Figure]:
        """All of them, and the powers."""
        errors = (_numbers(one, self.sizes, "error") for one in self.errors)
        return [*chain(*errors, *(_numbers(one, self.sizes, "time") for one in self.costs))]

    def __str__(self) -> str:
        heads = "".join(f"{size:>{CELL}}" for size in self.sizes)
        floor = f", floor {self.floor:.3f}" if self.floor else ""
        lines = [f"{self.name + floor:<{LABEL}}{heads}  power", *self.errors, *self.costs]
        return "\n".join(map(str, lines))


def _numbers(curve: Curve, sizes: Sequence[int], kind: Kind) -> Iterator[Figure]:
    for size, value in zip(sizes, curve.values, strict=True):
        yield figure_of(value, kind=kind, name=f"{curve.what} at {size}")
    if curve.law is not None:
        yield figure_of(curve.law[0], repeats=curve.law[1:], name=f"{curve.what}, power")


Figures = Mapping[str, ArrayLike]


def grown(
    name: str, sizes: Sequence[int], errors: Figures, costs: Figures, floor: float = 0.0
) -> Growth:
    """Figures (n,) or (n, k) of k repeats at sizes (n,), with their powers.

    Errors that hardly differ from the sampling floor are left out of the power.
    """

    def curve(what: str, found: ArrayLike, least: float) -> Curve:
        values = np.exp(np.log(np.reshape(found, (len(sizes), -1))).mean(axis=1))
        clear = values > least
        enough = np.count_nonzero(clear) >= 3
        law = fit_power_law(np.array(sizes)[clear], values[clear]) if enough else None
        return Curve(what, tuple(map(float, values)), law)

    off = tuple(curve(what, found, CLEAR * floor) for what, found in errors.items())
    used = tuple(curve(what, found, 0.0) for what, found in costs.items())
    return Growth(name, tuple(sizes), floor, off, used)


def growth_rows(quick: bool) -> Iterator[Growth]:
    """What grows, one after the other; fewer sizes if quick."""
    for grow in GROWTHS:
        with single_threaded():
            yield from grow(quick)


@cache
def contour_growth(quick: bool) -> tuple[Growth, ...]:
    """Contours, alone and with all taxels about them, and the points of each."""
    series = (
        ("contours, their points only", "contours", False),
        ("contours, all taxels", "contours", True),
        (f"points of {STACKED} contours", "points", False),
    )
    return tuple(
        _rebuilt(name, what, quick, partial(_evidence, what, taxels))
        for name, what, taxels in series
    )


@cache
def lattice_growth(quick: bool) -> tuple[Growth, ...]:
    """Control points along each side of a lattice, of one skin."""

    def evidence(shape: RoundObject, size: int, seed: int | None) -> dict[str, Any]:
        return {**_evidence("points", True, shape, AROUND, seed), "size": (size, size)}

    def fitted(size: int, given: Mapping[str, Any]) -> Callable[[], object]:
        closed = reconstruct(given["contours"], tops=given["tops"], method="skin").closed
        assert closed is not None
        return partial(fit_lattice, closed.loft.surface, size=(size, size))

    return (_rebuilt("control points a side", "lattice", quick, evidence, fitted),)


def _whole(size: int, given: Mapping[str, Any]) -> Callable[[], object]:
    return partial(reconstruct, **given)


def _rebuilt(
    name: str,
    what: str,
    quick: bool,
    evidence: Callable[[RoundObject, int, int | None], dict[str, Any]],
    timed: Callable[[int, Mapping[str, Any]], Callable[[], object]] = _whole,
) -> Growth:
    """Errors over shapes and seeds, without noise for the seed None; times of the first shape."""
    sizes = _sizes(what, quick)
    shapes = {one: REBUILT_SHAPES[one] for one in (QUICK_SHAPES if quick else SHAPES)}
    errors = {
        f"Chamfer, {noise}, % of height": [
            [_percent(n, evidence(one, size, seed)) for n, one in shapes.items() for seed in some]
            for size in sizes
        ]
        for noise, some in (("exact", (None,)), ("noise", range(1 if quick else SEEDS)))
    }
    first = next(iter(shapes.values()))
    calls = {size: timed(size, evidence(first, size, 0)) for size in sizes}
    floor = 100.0 * float(np.mean([truth_of(one).floor for one in shapes])) / SHAPE_HEIGHT
    return grown(name, sizes, errors, {"processor, ms": _turned(calls, 1e3)}, floor)


def _percent(name: str, given: Mapping[str, Any]) -> float:
    mesh = reconstruct(**given).mesh(TOLERANCE)
    return 100.0 * truth_of(name).errors_of(Mesh(mesh.vertices, mesh.faces)).chamfer / SHAPE_HEIGHT


def _turned(calls: Mapping[int, Callable[[], object]], scale: float) -> Floats:
    """Processor times (n, turns) of calls."""
    timed = {n: partial(best_seconds, one, 1, time.process_time) for n, one in calls.items()}
    return scale * np.array([*in_turns(timed, TURNS).values()])


def _sizes(what: str, quick: bool) -> tuple[int, ...]:
    """Every other one if quick, and the largest."""
    sizes = SIZES[what]
    return tuple(dict.fromkeys((*sizes[::2], sizes[-1]))) if quick else sizes


def _evidence(
    what: str, taxels: bool, shape: RoundObject, size: int, seed: int | None
) -> dict[str, Any]:
    count, around = (size, AROUND) if what == "contours" else (STACKED, size)
    contours, contacts = touched_contours(shape, count, around, seed)
    tops = np.array([[*shape.axis(np.array(z)), z] for z in (shape.low, shape.high)])
    return {"contours": contours, "tops": tops, "patches": contacts if taxels else None}


def touched_contours(
    shape: RoundObject, count: int, around: int, seed: int | None
) -> tuple[list[Floats], ContactPoints]:
    """Even contours (around, 3), and the bands that pads touch about them, mm.

    The contours are the middles of the bands. Of noise, none if the seed is None, each pad's place
    is off as a whole, and each point by that of its taxel: the default noise.
    """
    levels = np.linspace(shape.low + MARGIN, shape.high - MARGIN, count)[:, None] + BAND
    heights = np.clip(levels, shape.low + MARGIN, shape.high - MARGIN).ravel()
    angles, step = 2.0 * np.pi * np.arange(around) / around, 1e-4
    upwards = shape.rings(heights + step, angles) - shape.rings(heights - step, angles)
    onwards = shape.rings(heights, angles + step) - shape.rings(heights, angles - step)
    normals = np.cross(onwards, upwards).reshape(-1, 3)
    pad = np.arange(around) * PADS // around + PADS * np.arange(count)[:, None, None]
    touch = np.broadcast_to(pad, (count, len(BAND), around))
    points = shape.rings(heights, angles).reshape(*touch.shape, 3)
    if seed is not None:
        rng = np.random.default_rng(seed)
        points = points + POSE_NOISE * rng.normal(size=(PADS * count, 3))[touch]
        points += TAXEL_NOISE * rng.normal(size=points.shape)
    contacts = ContactPoints(points.reshape(-1, 3), normals, touch.ravel().astype(np.int32))
    return list(points[:, len(BAND) // 2]), contacts


@cache
def taxel_growth(quick: bool) -> tuple[Growth, ...]:
    """Taxels along each side of one array on a ball."""
    round_ = specs.SuperquadricSpec(size=(BALL,) * 3, exponents=(1.0, 1.0))
    ball = specs.ObjectSpec(superquadric=round_)
    noise = {"gaussian_noise": {"sigma": 1e-3 * TAXEL_NOISE}}
    sizes, goals, errors = _sizes("taxels", quick), list(touch_goals(FRAMES)), []
    calls: dict[int, Callable[[], object]] = {}
    for size in sizes:
        sensor = specs.SensorSpec(rows=size, cols=size, pitch=WIDTH / (size - 1))
        loop = InProcessLoop(
            touching_nodes(simulator.Params(object=ball, sensor=sensor, effects=noise))
        )

        def touched(loop: InProcessLoop = loop) -> list[SurfacePatch]:
            return [loop.publish("/finger/goal", goal)["/touch/patch"] for goal in goals]

        off = np.array([[one.k1, one.k2] for one in touched()]) * BALL - 1.0
        errors.append(100.0 * math.sqrt(float(np.mean(off**2))))
        calls[size] = touched
    times = {"processor, us a touch": _turned(calls, 1e6 / FRAMES)}
    return (grown("taxels a side, a ball of 30 mm", sizes, {"curvatures, rms %": errors}, times),)


@cache
def finger_growth(quick: bool) -> tuple[Growth, ...]:
    """Fingers of whole explorations."""
    sizes, runs, target = _sizes("fingers", quick), [], EXPLORED_OBJECTS[FINGERED]
    for size in sizes:
        for seed in range(1 if quick else SEEDS):
            began = time.process_time()
            one = explore_object(target, NOISY, Demand(), seed=seed, fingers=size)
            used = time.process_time() - began
            runs.append((one.percent, one.touches, one.score.robot_time, used))
    found = np.reshape(runs, (len(sizes), -1, 4))
    floor = 100.0 * one.score.sampling_floor / one.score.size
    names = ("touches", "robot time, s", "processor, s")
    costs = {name: found[..., 1 + i] for i, name in enumerate(names)}
    errors = {"error, rms % of the height": found[..., 0]}
    return (grown(f"fingers, {FINGERED}", sizes, errors, costs, floor),)


@cache
def node_growth(quick: bool) -> tuple[Growth, ...]:
    """Nodes of a ring, each a process, around which one frame is passed."""
    sizes = _sizes("nodes", quick)
    calls = {size: partial(ring_times, token_ring(LAPS, nodes=size)) for size in sizes}
    ring_times(token_ring(LAPS))  # the server that forks the nodes is up from here on
    found = np.array([*in_turns(calls, TURNS).values()])  # (n, turns, 2)
    costs = {"start, s": found[..., 0], "a lap, ms": 1e3 * found[..., 1] / (LAPS - 1)}
    return (grown("nodes in a ring", sizes, {}, costs),)


GROWTHS = (contour_growth, lattice_growth, taxel_growth, finger_growth, node_growth)
