"""What each part is worth: error and cost without it over those with it, noise on.

A part is taken out at its seam, where others call it: what stands there is replaced while an
object is explored, and nothing else is changed. Parts that are there for a case which a plain
exploration does not have are measured in that case as well: with impulses, with one contour that
is displaced. Ratios are geometric means over objects and seeds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from itertools import product
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from palpate.bench.explore import NOISES, NOISY, Demand, Noise, explore_object, within_percent
from palpate.bench.objects import EXPLORED_OBJECTS, REBUILT_SHAPES, SHAPE_HEIGHT
from palpate.bench.rebuild import CONTOUR_NOISE, noisy_contours, truth_of
from palpate.bench.scaling.growth import students_reach
from palpate.bench.table import Figure, Row, at_most, figure_of
from palpate.core import Bools, Floats
from palpate.core.rebuild import reconstruct
from palpate.core.shapes import Mesh
from palpate.core.touch import Pad, Patch, fit_jet
from palpate.tools import single_threaded

OBJECTS, QUICK_OBJECTS = ("vase", "box", "tapered and bent"), ("vase",)
SHAPES = ("vase", "lobed zig-zag", "rounded box", "groove")
SEEDS, SHAPE_SEEDS = 2, 4
SMOOTH, SHARP = ("sphere", "egg", "vase", "twist"), ("box", "step", "star")
COUNTS = (5, 9)  # Even contours with taxels and without
# Most error that all taxels may leave of the contours' own; the latter of sharp objects with noise.
MOST_SMOOTH, MOST_SHARP = 0.5, 0.8
TOLERANCE, QUICK_TOLERANCE = 0.2, 0.5  # % of the height; what may stay untouched follows it
# The same noise of the arm thrice as large, and the default one with impulses.
FAR_OFF: Noise = ({"pose_error": {"sigma": 3e-4}}, NOISY[1])
SALTED, PEPPERED = ((*NOISY, {"salt_and_pepper": {"rate": rate}}) for rate in (0.02, 0.05))
SIZE = (12, 48)  # Contours, and points of each, that are rebuilt alone
DISPLACED, WHICH = 5.0, 5  # How far which of them is displaced, mm
ROUGH = 0.5  # Noise of a point where there is much, mm
LINE = "{:<46}{:>22}{:>9}{:>8}{:>7}{:>6}"
Replacement = Callable[[Any], Any]  # What stands in a part's place, given what stood there


class Outcome(NamedTuple):
    """What an exploration came to, or a rebuild without one."""

    error: float  # % of the height: root mean square, of a rebuild Chamfer
    touches: float = 1.0
    robot_time: float = 1.0  # s
    compute: float = 1.0  # Of the processor, s
    contours: int = 0
    floor: float = 0.0  # Sampling floor of the error


class Part(NamedTuple):
    """Something that could be left out."""

    name: str
    # What stands in its place, by ``module:name``
    off: Mapping[str, Replacement]
    case: str = ""  # What it is there for, in words
    noise: Noise = NOISY  # In that case, if objects are explored
    displaced: float | None = None  # If contours are rebuilt: how far one is displaced, mm,
    rough: float = CONTOUR_NOISE  # and the noise of their points, mm
    uniform: bool = False  # Whether as many even slices stand in the planner's place


def _with(**changed: Any) -> Replacement:
    return lambda call: lambda *args, **more: call(*args, **{**more, **changed})


def _then(change: Callable[[Any], Any]) -> Replacement:
    return lambda call: lambda *args, **more: change(call(*args, **more))


def _always(value: Any) -> Replacement:
    return lambda call: lambda *args, **more: value


def _unmasked(fit: Callable[..., Patch]) -> Callable[..., Patch]:
    """Where nothing was touched the pad's own face counts as touched, once anything was."""

    def fitted(pad: Pad, height: Floats, touched: Bools, *more: Any) -> Patch:
        whole = touched | touched.any()
        return fit(pad, np.where(touched, height, -pad.sag()), whole, *more)

    return fitted


_SIDE, _CLOSED = "palpate.core.rebuild.side", "palpate.core.rebuild.closed_sides"
_CLEAN, _STACK = "palpate.nodes.filter:clean", "palpate.nodes.reconstructor:stack_points"
_PLAIN: Replacement = lambda _: lambda pad, height, touched, *more: fit_jet(pad, height, touched)  # noqa: E731
PARTS = (
    Part("filter", {_CLEAN: _with(order="none")}, "2 % of taxels salt and pepper", SALTED),
    Part(
        "robust fit",
        {f"palpate.core.touch.{room}:fit_robust_jet": _PLAIN for room in ("filters", "edges")},
        "5 % of taxels salt and pepper",
        PEPPERED,
    ),
    Part(
        "mask",
        {_CLEAN: _then(lambda one: one._replace(touched=one.touched | one.touched.any()))},
    ),
    Part("mask, in the fit alone", {"palpate.core.touch:fit_patch": lambda fit: _unmasked(fit)}),
    Part("slopes", {_STACK: _then(lambda points: points._replace(normals=None))}),
    Part("all taxels, not contour points", {_STACK: _always(None)}),
    Part(
        "cross-validation",
        {
            f"{_SIDE}.fitting:smooth": _with(noise=0.0),
            f"{_SIDE}.radial:stiffened": lambda _: lambda contacts, spline: spline,
        },
        "contours alone, noise of 0.5 mm",
        displaced=0.0,
        rough=ROUGH,
    ),
    Part(
        "bad-contour test",
        {
            "palpate.core.rebuild.evidence:inconsistent_contours": _then(
                lambda one: one._replace(bad=one.bad & False, off=0.0 * one.off)
            )
        },
        "contours alone, one displaced by 5 mm",
        displaced=DISPLACED,
    ),
    Part(
        "ends",
        {
            "palpate.nodes.planning.phases:next_probe": _always(None),
            "palpate.nodes.reconstructor:touched_ends": _always(None),
            f"{_CLOSED}:touched_end": _always(None),
        },
    ),
    Part(
        "pose offsets",
        {f"{_SIDE}.radial:FEWEST_TOUCHES": lambda _: 10**9},
        "poses off by 0.3 mm",
        FAR_OFF,
    ),
    Part("predicted planner, not even slices", {}, uniform=True),
)


@contextmanager
def without(part: Part) -> Iterator[None]:
    """Leave a part out; whatever happens, it stands in its place again afterwards."""
    with ExitStack() as stack:
        for place, replacement in part.off.items():
            module, _, name = place.partition(":")
            there = import_module(module)
            stack.enter_context(mock.patch.object(there, name, replacement(getattr(there, name))))
        yield


class Worth(NamedTuple):
    """A part's worth: geometric means of what is without it over what is with it."""

    name: str
    error: tuple[float, float, float]  # With the ends of the interval of 95 %
    touches: float
    robot_time: float
    compute: float
    runs: int  # Pairs of them
    failed: int  # Of these ended without a solid when the part was left out
    holds: bool = True

    @property
    def figures(self) -> Sequence[Figure]:
        """The ratios."""
        ends = self.error[1:]
        return (
            figure_of(self.error[0], "x", repeats=ends if self.runs > 1 else (), name="error"),
            figure_of(self.touches, "x", name="touches"),
            figure_of(self.robot_time, "x", name="robot time"),
            figure_of(self.compute, "x", kind="time", name="processor"),
        )

    def __str__(self) -> str:
        mean, low, high = self.error
        interval = f" ({low:.2f} to {high:.2f})" if low > 0.0 else ""
        error = f"{mean:.2f}{interval}".replace("nan", "-")
        costs = (
            f"{one:.2f}".replace("nan", "-")
            for one in (self.touches, self.robot_time, self.compute)
        )
        line = LINE.format(self.name, error, *costs, self.runs)
        return f"{line}  {self.failed} FAILED" if self.failed else line


def part_rows(quick: bool) -> Iterator[Worth | str]:
    """A row for each part, and one for each in its case; fewer objects if quick."""
    yield LINE.format("without the part, over with it", "error", "touches", "robot", "CPU", "runs")
    with single_threaded():
        for part in PARTS:
            yield worth_of(part.name, _pairs(part, NOISY, quick))
            if part.displaced is not None:
                yield worth_of(f"  {part.case}", _rebuilt_pairs(part, quick))
            elif part.case and not quick:
                yield worth_of(f"  {part.case}", _pairs(part, part.noise, quick))


def taxel_rows(quick: bool) -> Iterator[Row]:
    """Errors of solids from all taxels over those of their contours alone, object by object."""
    part = next(one for one in PARTS if one.name.startswith("all taxels"))
    with single_threaded():
        for name, count in product(("sphere", "box") if quick else (*SMOOTH, *SHARP), COUNTS):
            for noise, effects in NOISES.items():
                even = Demand("uniform", settings={"count": count})
                whole = explored(name, effects, even, 0)
                with without(part):
                    ratio = whole.error / explored(name, effects, even, 0).error
                most = MOST_SHARP if name in SHARP and noise != "exact" else MOST_SMOOTH
                title = f"{name}, {count} contours, {noise}: all taxels over contours"
                row = at_most(title, ratio, most, ".2f", " x")
                # What two tessellations of the truth differ by cannot be halved.
                yield row._replace(holds=row.holds or whole.error <= 2.0 * whole.floor)


def worth_of(name: str, pairs: Sequence[tuple[Outcome, Outcome | None]]) -> Worth:
    """Ratios over pairs of an outcome with the part and one without, None where that failed."""
    whole = [(one, other) for one, other in pairs if other is not None]
    ratios = np.array([np.divide(other[:4], one[:4]) for one, other in whole]).reshape(-1, 4)
    error, touches, robot_time, compute = (mean_interval(column) for column in ratios.T)
    costs = touches[0], robot_time[0], compute[0]
    return Worth(name, error, *costs, runs=len(pairs), failed=len(pairs) - len(whole))


def mean_interval(ratios: Floats) -> tuple[float, float, float]:
    """Geometric mean of ratios (n,) and its interval of 95 %, endless of one; NaN of none."""
    logs = np.log(ratios)
    mean = float(logs.mean()) if len(logs) else math.nan
    if len(logs) < 2:
        return math.exp(mean), 0.0, math.inf
    reach = students_reach(len(logs) - 1) * float(np.std(logs, ddof=1)) / math.sqrt(len(logs))
    return math.exp(mean), math.exp(mean - reach), math.exp(mean + reach)


def _pairs(part: Part, noise: Noise, quick: bool) -> list[tuple[Outcome, Outcome | None]]:
    demand, pairs = within_percent(QUICK_TOLERANCE if quick else TOLERANCE), []
    demand = demand._replace(feature=None)
    for name in QUICK_OBJECTS if quick else OBJECTS:
        for seed in range(1 if quick else SEEDS):
            plain = _whole(name, noise, demand, seed)
            even = demand._replace(planner="uniform", settings={"count": plain.contours})
            try:
                with without(part):
                    asked = even if part.uniform else demand
                    other = explored(name, noise, asked, seed)
            except RuntimeError:
                other = None
            pairs.append((plain, other))
    return pairs


def explored(name: str, noise: Noise, demand: Demand, seed: int) -> Outcome:
    """One exploration. Raises RuntimeError if it ends without a solid."""
    began = time.process_time()
    found = explore_object(EXPLORED_OBJECTS[name], noise, demand, seed=seed)
    used, score = time.process_time() - began, found.score
    floor = 100.0 * score.sampling_floor / score.size
    cost = found.touches, score.robot_time, used
    return Outcome(found.percent, *cost, contours=score.contours, floor=floor)


_KEPT: dict[Any, Outcome] = {}


def _whole(name: str, noise: Noise, demand: Demand, seed: int) -> Outcome:
    """With all parts, once for all of them."""
    key = name, repr(noise), repr(demand), seed
    if key not in _KEPT:
        _KEPT[key] = explored(name, noise, demand, seed)
    return _KEPT[key]


def _rebuilt_pairs(part: Part, quick: bool) -> list[tuple[Outcome, Outcome | None]]:
    pairs: list[tuple[Outcome, Outcome | None]] = []
    for name in SHAPES:
        for seed in range(1 if quick else SHAPE_SEEDS):
            plain = rebuilt(name, part, seed)
            with without(part):
                pairs.append((plain, rebuilt(name, part, seed)))
    return pairs


def rebuilt(name: str, part: Part, seed: int) -> Outcome:
    """One rebuild from contours alone, in the part's case."""
    shape = REBUILT_SHAPES[name]
    contours = noisy_contours(shape, SIZE, part.rough, np.random.default_rng(seed))
    contours[WHICH, :, 0] += part.displaced or 0.0
    tops = np.array([[*shape.axis(np.array(z)), z] for z in (shape.low, shape.high)])
    began = time.process_time()
    mesh = reconstruct(list(contours), tops=tops).mesh()
    used = time.process_time() - began
    error = truth_of(name).errors_of(Mesh(mesh.vertices, mesh.faces)).chamfer
    return Outcome(100.0 * error / SHAPE_HEIGHT, compute=used)
