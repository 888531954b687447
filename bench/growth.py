"""Error and cost as the work grows, and the powers with which they do.

One number grows, all else stays: contours and the points of each, rebuilt from the points alone
or with all taxels beside them; control points; taxels; nodes. Costs are processor times,
of a ring of nodes the time of a lap, measured in turns.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.bench.bus import ring_times
from palpate.bench.effects import touch_goals
from palpate.bench.loop import InProcessLoop, touching_nodes
from palpate.bench.rebuilt import REBUILT_SHAPES, SHAPE_HEIGHT, RoundObject, truth_of
from palpate.bench.table import Figure, Kind, best_seconds, figure_of, in_turns
from palpate.bench.toy_node import token_ring
from palpate.core.arrays import Floats
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.lattice import fit_lattice
from palpate.core.shapes import Mesh
from palpate.nodes import simulator
from palpate.nodes.specs.objects import ObjectSpec, SuperquadricSpec
from palpate.nodes.specs.sensors import SensorSpec
from palpate.tools.reconstruction import single_threaded

SIZES: Mapping[str, tuple[int, ...]] = {
    "contours": (4, 6, 9, 14, 22, 36, 60),
    "points": (20, 50, 120, 300, 800, 2000),
    "lattice": (5, 8, 12, 20, 30, 40),
    "taxels": (8, 12, 16, 24, 32, 48, 64),
    "nodes": (2, 4, 8, 16, 28, 40),
}
SHAPES, QUICK_SHAPES = ("vase", "lobed zig-zag", "rounded box"), ("vase",)
SEEDS, TURNS, LAPS = 2, 3, 200
AROUND, STACKED = 80, 12  # Points of a contour where contours grow, contours where points do
BAND, PADS = np.linspace(-4.0, 4.0, 5), 16  # Heights about a contour's, mm, and pads around it
POSE_NOISE, TAXEL_NOISE, MARGIN = 0.1, 0.01, 0.5  # mm; the last contours lie that far inside
TOLERANCE = 0.01  # Of the meshes that are compared, mm
BALL, WIDTH, FRAMES = 0.03, 15e-3, 60  # Radius and width of the array, m; touches of a turn
CLEAR = 2.0  # Errors below so many sampling floors are left out of the power
LABEL, CELL = 34, 9  # Widths in letters


class PowerLaw(NamedTuple):
    """With which power of a size a figure goes; the last two are its interval of 95 %."""

    exponent: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.exponent:+.2f} ({self.low:+.2f} to {self.high:+.2f})"


def fit_power_law(sizes: ArrayLike, values: ArrayLike) -> PowerLaw:
    """Least squares of the logarithms of values (n,) at sizes (n,).

    The interval is Student's with n - 2 degrees of freedom: it holds scatter and what is no power.
    Raises ValueError if there are fewer than 3 sizes, all are alike, or something is not positive.
    """
    x, y = np.asarray(sizes, float), np.asarray(values, float)
    if len(x) < 3 or len(y) != len(x) or not np.ptp(x) > 0.0:
        raise ValueError(f"sizes must be 3 or more, with as many values, got {len(x)}, {len(y)}")
    if not (np.isfinite(y).all() and (y > 0.0).all() and (x > 0.0).all()):
        raise ValueError("sizes and values must be positive and finite")
    away, logs = np.log(x) - np.log(x).mean(), np.log(y)
    spread = float(away @ away)
    exponent = float(away @ logs) / spread
    left = logs - logs.mean() - exponent * away
    reach = students_reach(len(x) - 2) * math.sqrt(float(left @ left) / (len(x) - 2) / spread)
    return PowerLaw(exponent, exponent - reach, exponent + reach)


def students_reach(freedom: int) -> float:
    """Deviations within which Student's variable is in 95 of 100 cases."""
    from scipy.stats import t

    return float(t.ppf(0.975, freedom))


class Growth(NamedTuple):
    """What becomes of errors and costs as one number grows; nothing is demanded."""

    name: str  # What grows, and how it is measured
    sizes: tuple[int, ...]
    errors: Mapping[str, ArrayLike]  # Figures (n,) or (n, k) of k repeats by name with unit
    costs: Mapping[str, ArrayLike]
    floor: float = 0.0  # Sampling floor of the errors, in their unit; 0 if they are not sampled
    holds: bool = True

    def means(self) -> Mapping[str, Floats]:
        """Geometric means of all figures over their repeats, (n,)."""
        rows = len(self.sizes), -1
        given = {**self.errors, **self.costs}.items()
        return {what: np.exp(np.log(np.reshape(one, rows)).mean(axis=1)) for what, one in given}

    def law(self, what: str) -> PowerLaw | None:
        """The power of a figure; None where too few errors stand clear of the sampling floor."""
        values = self.means()[what]
        clear = values > (CLEAR * self.floor if what in self.errors else 0.0)
        if np.count_nonzero(clear) < 3:
            return None
        return fit_power_law(np.array(self.sizes)[clear], values[clear])

    @property
    def figures(self) -> Sequence[Figure]:
        """The means, and the powers."""
        found = []
        for what, values in self.means().items():
            law = self.law(what)
            kind: Kind = "time" if what in self.costs else "error"
            for size, value in zip(self.sizes, values.tolist(), strict=True):
                found.append(figure_of(value, kind=kind, name=f"{what} at {size}"))
            if law is not None:
                found.append(figure_of(law[0], repeats=law[1:], name=f"{what}, power"))
        return found

    def __str__(self) -> str:
        floor = f", floor {self.floor:.3f}" if self.floor else ""
        heads = "".join(f"{size:>{CELL}}" for size in self.sizes)
        lines = [f"{self.name + floor:<{LABEL}}{heads}  power"]
        for what, values in self.means().items():
            cells = "".join(f"{value:>{CELL}.3g}" for value in values)
            lines.append(f"  {what:<{LABEL - 2}}{cells}  {self.law(what) or ''}".rstrip())
        return "\n".join(lines)


def growth_rows(quick: bool, *, sheet: Path | None = None) -> Iterator[Growth | str]:
    """What grows, in turn; fewer sizes if quick. `sheet`: folder for ``scaling.png``."""
    found: list[Growth] = []
    for grow in GROWTHS:
        with single_threaded():
            for growth in grow(quick):
                found.append(growth)
                yield growth
    if sheet is not None:
        from palpate.bench.pictures import draw_growths
        from palpate.launch.charts import write_figure

        yield f"{write_figure(draw_growths(found), sheet / 'scaling.png')}"


@cache
def rebuild_growth(quick: bool) -> tuple[Growth, ...]:
    """Contours, alone and with all taxels about them; the points of each; control points."""
    series = (
        ("contours, their points only", "contours", False),
        ("contours, all taxels", "contours", True),
        (f"points of {STACKED} contours", "points", False),
        ("control points a side", "lattice", True),
    )
    return tuple(_rebuilt(name, what, taxels, quick) for name, what, taxels in series)


def _rebuilt(name: str, what: str, taxels: bool, quick: bool) -> Growth:
    """Errors over shapes and seeds, without noise for the seed None; times of the first shape."""
    sizes, shapes = _sizes(what, quick), QUICK_SHAPES if quick else SHAPES
    errors = {
        f"Chamfer, {noise}, % of height": [
            [
                _percent(one, _evidence(one, what, size, taxels, seed))
                for one in shapes
                for seed in some
            ]
            for size in sizes
        ]
        for noise, some in (("exact", (None,)), ("noise", range(1 if quick else SEEDS)))
    }
    calls: dict[int, Callable[[], object]] = {}
    for size in sizes:
        given = _evidence(shapes[0], what, size, taxels, 0)
        calls[size] = partial(reconstruct, **given)
        if what == "lattice":  # it alone is timed, not the skin that it follows
            side = reconstruct(given["contours"], method="skin").side
            assert side is not None
            calls[size] = partial(fit_lattice, side.patch, size=given["size"])
    floor = 100.0 * float(np.mean([truth_of(one).floor for one in shapes])) / SHAPE_HEIGHT
    return Growth(name, sizes, errors, {"processor, ms": _turned(calls, 1e3)}, floor)


def _sizes(what: str, quick: bool) -> tuple[int, ...]:
    """Every other one if quick, and the largest."""
    sizes = SIZES[what]
    return tuple(dict.fromkeys((*sizes[::2], sizes[-1]))) if quick else sizes


def _percent(name: str, given: Mapping[str, Any]) -> float:
    mesh = reconstruct(**given).mesh(TOLERANCE)
    return 100.0 * truth_of(name).errors_of(Mesh(mesh.vertices, mesh.faces)).chamfer / SHAPE_HEIGHT


def _turned(calls: Mapping[int, Callable[[], object]], scale: float) -> Floats:
    """Processor times (n, turns) of calls."""
    timed = {n: partial(best_seconds, one, 1, time.process_time) for n, one in calls.items()}
    return scale * np.array([*in_turns(timed, TURNS).values()])


def _evidence(name: str, what: str, size: int, taxels: bool, seed: int | None) -> dict[str, Any]:
    """What a solid is rebuilt from."""
    shape = REBUILT_SHAPES[name]
    count = size if what == "contours" else STACKED
    contours, contacts = touched_contours(shape, count, size if what == "points" else AROUND, seed)
    tops = np.array([[*shape.axis(np.array(z)), z] for z in (shape.low, shape.high)])
    given = {"contours": contours, "tops": tops, "patches": contacts if taxels else None}
    return {**given, "size": (size, size)} if what == "lattice" else given


def touched_contours(
    shape: RoundObject, count: int, around: int, seed: int | None
) -> tuple[list[Floats], ContactPoints]:
    """Even contours (around, 3), and the bands that pads touch about them, mm.

    The contours are the middles of the bands. Of noise, none if the seed is None, each pad's place
    is off as a whole, and each point by that of its taxel: the default noise.
    """
    low, high = shape.low + MARGIN, shape.high - MARGIN
    heights = np.clip(np.linspace(low, high, count)[:, None] + BAND, low, high).ravel()
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
    sizes, goals, errors = _sizes("taxels", quick), list(touch_goals(FRAMES)), []
    ball = SuperquadricSpec(size=(BALL,) * 3, exponents=(1.0, 1.0))
    noise = {"gaussian_noise": {"sigma": 1e-3 * TAXEL_NOISE}}
    calls: dict[int, Callable[[], object]] = {}
    for size in sizes:
        sensor = SensorSpec(rows=size, cols=size, pitch=WIDTH / (size - 1))
        made = ObjectSpec(superquadric=ball)
        params = simulator.Params(object=made, sensor=sensor, effects=noise)
        touch = partial(InProcessLoop(touching_nodes(params)).publish, "/finger/goal")
        found = [touch(goal)["/touch/patch"] for goal in goals]
        off = np.array([[one.k1, one.k2] for one in found]) * BALL - 1.0
        errors.append(100.0 * math.sqrt(float(np.mean(off**2))))
        calls[size] = partial(lambda touch: [touch(goal) for goal in goals], touch)
    costs = {"processor, us a touch": _turned(calls, 1e6 / FRAMES)}
    return (Growth("taxels a side, a ball of 30 mm", sizes, {"curvatures, rms %": errors}, costs),)


@cache
def node_growth(quick: bool) -> tuple[Growth, ...]:
    """Nodes of a ring, each a process, around which one frame is passed."""
    sizes = _sizes("nodes", quick)
    calls = {size: partial(ring_times, token_ring(LAPS, nodes=size)) for size in sizes}
    ring_times(token_ring(LAPS))  # the server that forks the nodes is up from here on
    start, laps = np.moveaxis(np.array([*in_turns(calls, TURNS).values()]), 2, 0)
    costs = {"start, s": start, "a lap, ms": 1e3 * laps / (LAPS - 1)}
    return (Growth("nodes in a ring", sizes, {}, costs),)


GROWTHS = (rebuild_growth, taxel_growth, node_growth)
