"""Error and cost as the work grows, and their powers.

One number grows and all others stay: of contours, rebuilt from their points or from all taxels; of
points of a contour; of control points; of taxels; of nodes. Costs are processor times, measured in
turns; of a ring of nodes, the time of a lap.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
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

SHAPES = ("vase", "lobed zig-zag", "rounded box")


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthSettings:
    """Sizes that grow, and repeats of each."""

    n_contours: tuple[int, ...] = (4, 6, 9, 14, 22, 36, 60)
    n_points: tuple[int, ...] = (20, 50, 120, 300, 800, 2000)  # of a contour
    n_control_points: tuple[int, ...] = (5, 8, 12, 20, 30, 40)  # along a side
    n_taxels: tuple[int, ...] = (8, 12, 16, 24, 32, 48, 64)  # along a side
    n_nodes: tuple[int, ...] = (2, 4, 8, 16, 28, 40)
    shapes: tuple[str, ...] = SHAPES  # errors are of all, costs of the first
    n_seeds: int = 2  # of the noise
    n_turns: int = 3  # measurements of each time
    n_laps: int = 200  # around a ring
    fixed_contours: int = 12  # where the number of points grows
    fixed_points: int = 80  # of a contour, where the number of contours grows
    mesh_tolerance: float = 0.01  # [mm] of the meshes that are compared
    ball_radius: float = 0.03  # [m] of the ball that is touched where the number of taxels grows
    array_width: float = 15e-3  # [m] between its outermost taxels
    ball_touches: int = 60  # with each array


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchSettings:
    """What pads touch about a contour; noise is the default noise of scenes."""

    margin: float = 0.5  # [mm] from the ends to the outermost contours
    half_height: float = 4.0  # [mm] of a pad
    n_rows: int = 5  # points over the height of a pad
    n_pads: int = 16  # around a contour
    pose_noise: float = 0.1  # [mm] standard deviation along each axis
    taxel_noise: float = 0.01  # [mm] standard deviation


DEFAULT_TOUCHES = TouchSettings()
QUICK_GROWTH = GrowthSettings(
    n_contours=(4, 9, 22, 60),
    n_points=(20, 120, 800, 2000),
    n_control_points=(5, 12, 30, 40),
    n_taxels=(8, 16, 32, 64),
    n_nodes=(2, 8, 28, 40),
    shapes=SHAPES[:1],
    n_seeds=1,
)


class PowerLaw(NamedTuple):
    """Power of the size with which a figure grows, and the ends of its interval of 95 %."""

    exponent: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.exponent:+.2f} ({self.low:+.2f} to {self.high:+.2f})"


def fit_power_law(sizes: ArrayLike, values: ArrayLike) -> PowerLaw:
    """Least squares of the logarithms of values (n,) at sizes (n,).

    The interval is Student's with n - 2 degrees of freedom: scatter and deviations from a power
    law widen it. Raises ValueError for fewer than 3 sizes, equal ones, or numbers <= 0.
    """
    x, y = np.asarray(sizes, float), np.asarray(values, float)
    if len(x) < 3 or len(y) != len(x) or not np.ptp(x) > 0.0:
        raise ValueError(f"sizes must be 3 or more, with as many values, got {len(x)}, {len(y)}")
    if not (np.isfinite(y).all() and (y > 0.0).all() and (x > 0.0).all()):
        raise ValueError("sizes and values must be positive and finite")
    offsets, logs = np.log(x) - np.log(x).mean(), np.log(y)
    spread = float(offsets @ offsets)
    exponent = float(offsets @ logs) / spread
    residuals = logs - logs.mean() - exponent * offsets
    half_width = student_half_width(len(x) - 2) * math.sqrt(
        float(residuals @ residuals) / (len(x) - 2) / spread
    )
    return PowerLaw(exponent, exponent - half_width, exponent + half_width)


def student_half_width(n_degrees: int) -> float:
    """Half width of Student's interval of 95 %, in standard deviations."""
    from scipy.stats import t

    return float(t.ppf(0.975, n_degrees))


class Growth(NamedTuple):
    """Errors and costs as one number grows, without a demand."""

    name: str  # What grows, and how it is measured
    sizes: tuple[int, ...]
    errors: Mapping[str, ArrayLike]  # By name and unit: (n,) at each size, or (n, k) of k repeats
    costs: Mapping[str, ArrayLike]
    floor: float = 0.0  # Sampling floor of the errors, in their unit; 0 if they are not sampled
    holds: bool = True

    def means(self) -> Mapping[str, Floats]:
        """Geometric means of all figures over their repeats, (n,)."""
        rows = len(self.sizes), -1
        return {
            what: np.exp(np.log(np.reshape(figures, rows)).mean(axis=1))
            for what, figures in {**self.errors, **self.costs}.items()
        }

    def law(self, what: str, min_floors: float = 2.0) -> PowerLaw | None:
        """The power of a figure; None without 3 errors above `min_floors` sampling floors."""
        values = self.means()[what]
        clear = values > (min_floors * self.floor if what in self.errors else 0.0)
        if np.count_nonzero(clear) < 3:
            return None
        return fit_power_law(np.array(self.sizes)[clear], values[clear])

    @property
    def figures(self) -> Sequence[Figure]:
        """The means, and the powers."""
        figures = []
        for what, values in self.means().items():
            law = self.law(what)
            kind: Kind = "time" if what in self.costs else "error"
            for size, value in zip(self.sizes, values.tolist(), strict=True):
                figures.append(figure_of(value, kind=kind, name=f"{what} at {size}"))
            if law is not None:
                figures.append(figure_of(law[0], repeats=law[1:], name=f"{what}, power"))
        return figures

    def __str__(self) -> str:
        floor = f", floor {self.floor:.3f}" if self.floor else ""
        heads = "".join(f"{size:>9}" for size in self.sizes)
        lines = [f"{self.name + floor:<34}{heads}  power"]
        for what, values in self.means().items():
            cells = "".join(f"{value:>9.3g}" for value in values)
            lines.append(f"  {what:<32}{cells}  {self.law(what) or ''}".rstrip())
        return "\n".join(lines)


def growth_rows(quick: bool, *, sheet: Path | None = None) -> Iterator[Growth | str]:
    """Growth of each number in turn; fewer sizes if quick. `sheet`: folder for ``scaling.png``."""
    settings = QUICK_GROWTH if quick else GrowthSettings()
    growths: list[Growth] = []
    for grow in (rebuild_growth, taxel_growth, node_growth):
        with single_threaded():
            for growth in grow(settings):
                growths.append(growth)
                yield growth
    if sheet is not None:
        from palpate.bench.pictures import draw_growths
        from palpate.launch.charts import write_figure

        yield f"{write_figure(draw_growths(growths), sheet / 'scaling.png')}"


def rebuild_growth(settings: GrowthSettings) -> tuple[Growth, ...]:
    """Contours, from their points or from all taxels; points of each; control points."""
    series = (
        ("contours, their points only", "contours", settings.n_contours, False),
        ("contours, all taxels", "contours", settings.n_contours, True),
        (f"points of {settings.fixed_contours} contours", "points", settings.n_points, False),
        ("control points a side", "lattice", settings.n_control_points, True),
    )
    return tuple(_rebuilt(*growing, settings) for growing in series)


def _rebuilt(
    name: str, what: str, sizes: tuple[int, ...], has_taxels: bool, settings: GrowthSettings
) -> Growth:
    """Errors over shapes and seeds, without noise for the seed None; times of the first shape."""
    shapes, tolerance = settings.shapes, settings.mesh_tolerance

    def evidence(shape: str, size: int, seed: int | None) -> dict[str, Any]:
        return _evidence(shape, what, size, has_taxels, seed, settings)

    errors = {
        f"Chamfer, {noise}, % of height": [
            [
                _percent(shape, evidence(shape, size, seed), tolerance)
                for shape in shapes
                for seed in seeds
            ]
            for size in sizes
        ]
        for noise, seeds in (("exact", (None,)), ("noise", range(settings.n_seeds)))
    }
    calls: dict[int, Callable[[], object]] = {}
    for size in sizes:
        arguments = evidence(shapes[0], size, 0)
        calls[size] = partial(reconstruct, **arguments)
        if what == "lattice":  # its time, without that of the skin to which it is fitted
            side = reconstruct(arguments["contours"], method="skin").side
            assert side is not None
            calls[size] = partial(fit_lattice, side.patch, size=arguments["size"])
    floors = [truth_of(shape).floor for shape in shapes]
    costs = {"processor, ms": _turned(calls, 1e3, settings.n_turns)}
    return Growth(name, sizes, errors, costs, 100.0 * float(np.mean(floors)) / SHAPE_HEIGHT)


def _percent(name: str, arguments: Mapping[str, Any], tolerance: float) -> float:
    mesh = reconstruct(**arguments).mesh(tolerance)
    return 100.0 * truth_of(name).errors_of(Mesh(mesh.vertices, mesh.faces)).chamfer / SHAPE_HEIGHT


def _turned(calls: Mapping[int, Callable[[], object]], scale: float, n_turns: int) -> Floats:
    """Processor times (n, n_turns) of calls [s], multiplied by `scale`."""
    timed = {n: partial(best_seconds, call, 1, time.process_time) for n, call in calls.items()}
    return scale * np.array([*in_turns(timed, n_turns).values()])


def _evidence(
    name: str, what: str, size: int, has_taxels: bool, seed: int | None, settings: GrowthSettings
) -> dict[str, Any]:
    """Arguments of `reconstruct`."""
    shape = REBUILT_SHAPES[name]
    count = size if what == "contours" else settings.fixed_contours
    around = size if what == "points" else settings.fixed_points
    contours, contacts = touched_contours(shape, count, around, seed)
    tops = np.array([[*shape.axis(np.array(z)), z] for z in (shape.low, shape.high)])
    arguments = {"contours": contours, "tops": tops, "patches": contacts if has_taxels else None}
    return {**arguments, "size": (size, size)} if what == "lattice" else arguments


def touched_contours(
    shape: RoundObject,
    count: int,
    around: int,
    seed: int | None,
    settings: TouchSettings = DEFAULT_TOUCHES,
) -> tuple[list[Floats], ContactPoints]:
    """Contours (around, 3) at even heights, and the bands that pads touch about them [mm].

    The contours are the middles of the bands. Noise shifts each pad as a whole, and each point by
    that of its taxel; `seed` None: no noise.
    """
    low, high = shape.low + settings.margin, shape.high - settings.margin
    band = np.linspace(-settings.half_height, settings.half_height, settings.n_rows)
    heights = np.clip(np.linspace(low, high, count)[:, None] + band, low, high).ravel()
    angles, step = 2.0 * np.pi * np.arange(around) / around, 1e-4
    upwards = shape.rings(heights + step, angles) - shape.rings(heights - step, angles)
    onwards = shape.rings(heights, angles + step) - shape.rings(heights, angles - step)
    normals = np.cross(onwards, upwards).reshape(-1, 3)
    n_pads = settings.n_pads
    pad = np.arange(around) * n_pads // around + n_pads * np.arange(count)[:, None, None]
    touch = np.broadcast_to(pad, (count, len(band), around))
    points = shape.rings(heights, angles).reshape(*touch.shape, 3)
    if seed is not None:
        rng = np.random.default_rng(seed)
        points = points + settings.pose_noise * rng.normal(size=(n_pads * count, 3))[touch]
        points += settings.taxel_noise * rng.normal(size=points.shape)
    contacts = ContactPoints(points.reshape(-1, 3), normals, touch.ravel().astype(np.int32))
    return list(points[:, len(band) // 2]), contacts


def taxel_growth(settings: GrowthSettings) -> tuple[Growth, ...]:
    """Taxels along each side of one array on a ball."""
    goals, radius, errors = list(touch_goals(settings.ball_touches)), settings.ball_radius, []
    ball = ObjectSpec(superquadric=SuperquadricSpec(size=(radius,) * 3, exponents=(1.0, 1.0)))
    noise = {"gaussian_noise": {"sigma": 1e-3 * DEFAULT_TOUCHES.taxel_noise}}
    calls: dict[int, Callable[[], object]] = {}
    for size in settings.n_taxels:
        sensor = SensorSpec(rows=size, cols=size, pitch=settings.array_width / (size - 1))
        params = simulator.Params(object=ball, sensor=sensor, effects=noise)
        touch = partial(InProcessLoop(touching_nodes(params)).publish, "/finger/goal")
        patches = [touch(goal)["/touch/patch"] for goal in goals]
        relative = np.array([[patch.k1, patch.k2] for patch in patches]) * radius - 1.0
        errors.append(100.0 * math.sqrt(float(np.mean(relative**2))))
        calls[size] = partial(lambda touch: [touch(goal) for goal in goals], touch)
    costs = {"processor, us a touch": _turned(calls, 1e6 / len(goals), settings.n_turns)}
    name = "taxels a side, a ball of 30 mm"
    return (Growth(name, settings.n_taxels, {"curvatures, rms %": errors}, costs),)


def node_growth(settings: GrowthSettings) -> tuple[Growth, ...]:
    """Nodes of a ring, each a process, around which one frame is passed."""
    laps = settings.n_laps
    calls = {n: partial(ring_times, token_ring(laps, nodes=n)) for n in settings.n_nodes}
    ring_times(token_ring(laps))  # so that the server that forks the nodes is up
    times = np.array([*in_turns(calls, settings.n_turns).values()])
    start, elapsed = np.moveaxis(times, 2, 0)
    costs = {"start, s": start, "a lap, ms": 1e3 * elapsed / (laps - 1)}
    return (Growth("nodes in a ring", settings.n_nodes, {}, costs),)
