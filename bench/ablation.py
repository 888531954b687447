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
from functools import cache
from importlib import import_module
from itertools import product
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from palpate.bench.contours import noisy_contours
from palpate.bench.explored import EXPLORED_HEIGHT, EXPLORED_OBJECTS
from palpate.bench.growth import SHAPES, students_reach
from palpate.bench.harness import NOISES, NOISY, Demand, Noise, explore_object
from palpate.bench.rebuilt import REBUILT_SHAPES, SHAPE_HEIGHT, truth_of
from palpate.bench.table import Figure, Row, at_most, figure_of
from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.side import ShiftSettings
from palpate.core.shapes import Mesh
from palpate.core.touch import Pad, Patch, fit_jet
from palpate.tools.reconstruction import single_threaded

OBJECTS, QUICK_OBJECTS = ("vase", "box", "tapered and bent"), ("vase",)
SEEDS, SHAPE_SEEDS = 2, 4
TOLERANCE, QUICK_TOLERANCE = 0.2, 0.5  # % of the height; what may stay untouched follows it
SALT, PEPPER, FAR_OFF, ROUGH, DISPLACED = (
    *("2 % of taxels salt and pepper", "5 % of taxels salt and pepper", "poses off by 0.3 mm"),
    *("contours alone, noise of 0.5 mm", "contours alone, one displaced by 5 mm"),
)
EXPLORED_CASES: Mapping[str, Noise] = {
    "": NOISY,
    SALT: (*NOISY, {"salt_and_pepper": {"rate": 0.02}}),
    PEPPER: (*NOISY, {"salt_and_pepper": {"rate": 0.05}}),
    FAR_OFF: ({"pose_error": {"sigma": 3e-4}}, NOISY[1]),
}
# Noise of the points, and by how much one contour is displaced, mm.
REBUILT_CASES: Mapping[str, tuple[float, float]] = {ROUGH: (0.5, 0.0), DISPLACED: (0.2, 5.0)}
SIZE, WHICH = (12, 48), 5  # Contours, and points of each, and which is displaced
SMOOTH, SHARP = ("sphere", "egg", "vase", "twist"), ("box", "step", "star")
COUNTS = (5, 9)  # Even contours with taxels and without
# Most error that all taxels may leave of the contours' own; the latter of sharp objects with noise.
MOST_SMOOTH, MOST_SHARP = 0.5, 0.8
LINE = "{:<42}{:>24}{:>9}{:>8}{:>7}{:>6}"
Replacement = Callable[[Any], Any]  # What stands in a part's place, given what stood there


class Part(NamedTuple):
    """Something that could be left out."""

    name: str
    off: Mapping[str, Replacement]  # What stands in its place, by ``module:name``
    case: str = ""  # What it is there for, of the `EXPLORED_CASES` or `REBUILT_CASES`
    uniform: bool = False  # Whether as many even slices stand in the planner's place


def _with(**changed: Any) -> Replacement:
    return lambda call: lambda *args, **more: call(*args, **{**more, **changed})


def _then(change: Callable[[Any], Any]) -> Replacement:
    return lambda call: lambda *args, **more: change(call(*args, **more))


def _always(value: Any) -> Replacement:
    return lambda call: lambda *args, **more: value


def _plain(call: object) -> Callable[..., object]:
    return lambda pad, height, touched, *more: fit_jet(pad, height, touched)


def _unmasked(fit: Callable[..., Patch]) -> Callable[..., Patch]:
    """Where nothing was touched the pad's own face counts as touched, once anything was."""

    def fitted(pad: Pad, height: Floats, touched: Bools, *more: Any) -> Patch:
        return fit(pad, np.where(touched, height, -pad.sag()), touched | touched.any(), *more)

    return fitted


_TOUCH, _REBUILD, _NODES = "palpate.core.touch", "palpate.core.rebuild", "palpate.nodes"
_CLEAN, _STACK = f"{_NODES}.filter:clean", f"{_NODES}.rebuilding.fitting:stack_points"
TAXELS = Part(
    "all taxels, not contour points",
    {f"{_NODES}.rebuilding.fitting:reconstruct": _with(patches=None)},
)
_robust = {f"{_TOUCH}.{room}:fit_robust_jet": _plain for room in ("filters", "edges")}
_whole_pad = _then(lambda one: one._replace(touched=one.touched | one.touched.any()))
_no_shifts = ShiftSettings(min_touches=10**9)
_none_bad = _then(lambda one: one._replace(bad=one.bad & False, off=0.0 * one.off))
PARTS = (
    Part("filter", {_CLEAN: _with(order="none")}, SALT),
    Part("robust fit", _robust, PEPPER),
    Part("mask", {_CLEAN: _whole_pad}),
    Part("mask, in the fit alone", {f"{_TOUCH}:fit_patch": _unmasked}),
    Part("slopes", {_STACK: _then(lambda points: points._replace(normals=None))}),
    TAXELS,
    Part(
        "cross-validation",
        {
            f"{_REBUILD}.side.fitting:smooth": _with(noise=0.0),
            f"{_REBUILD}.side.shifts:stiffened": lambda _: lambda spline, _settings: spline,
        },
        ROUGH,
    ),
    Part("bad-contour test", {f"{_REBUILD}.evidence:inconsistent_contours": _none_bad}, DISPLACED),
    Part(
        "ends",
        {
            "palpate.core.explore.probing:next_probe": _always(None),
            f"{_NODES}.rebuilding.fitting:touched_ends": _always(None),
            f"{_REBUILD}.reconstruction:end_height": _always(None),
        },
    ),
    Part(
        "pose offsets",
        {f"{_REBUILD}.reconstruction:fit_shifted_spline": _with(settings=_no_shifts)},
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


class Outcome(NamedTuple):
    """What an exploration came to, or a rebuild without one."""

    error: float  # % of the height: root mean square, of a rebuild Chamfer
    touches: float = 1.0
    robot_time: float = 1.0  # s
    compute: float = 1.0  # Of the processor, s
    contours: int = 0
    floor: float = 0.0  # Sampling floor of the error


Pairs = list[tuple[Outcome, Outcome | None]]  # With a part and without it; None where that failed


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
        ends = self.error[1:] if self.runs > 1 else ()
        return (
            figure_of(self.error[0], "x", repeats=ends, name="error"),
            figure_of(self.touches, "x", name="touches"),
            figure_of(self.robot_time, "x", name="robot time"),
            figure_of(self.compute, "x", kind="time", name="processor"),
        )

    def __str__(self) -> str:
        mean, low, high = self.error
        error = f"{mean:.2f}" + (f" ({low:.2f} to {high:.2f})" if low > 0.0 else "")
        cells = (error, *(f"{one:.2f}" for one in self[2:5]))
        line = LINE.format(self.name, *(one.replace("nan", "-") for one in cells), self.runs)
        return f"{line}  {self.failed} FAILED" if self.failed else line


def part_rows(quick: bool) -> Iterator[Worth | str]:
    """A row for each part, and one for each in its case; fewer objects if quick."""
    yield LINE.format("without the part, over with it", "error", "touches", "robot", "CPU", "runs")
    with single_threaded():
        for part in PARTS:
            yield worth_of(part.name, _explored_pairs(part, "", quick))
            if part.case in REBUILT_CASES:
                yield worth_of(f"  {part.case}", _rebuilt_pairs(part, quick))
            elif part.case and not quick:
                yield worth_of(f"  {part.case}", _explored_pairs(part, part.case, quick))


def worth_of(name: str, pairs: Pairs) -> Worth:
    """Ratios over pairs of an outcome with the part and one without."""
    ratios = [np.divide(other[:4], one[:4]) for one, other in pairs if other is not None]
    error, *costs = (mean_interval(column) for column in np.reshape(ratios, (-1, 4)).T)
    touches, robot_time, compute = (one[0] for one in costs)
    return Worth(name, error, touches, robot_time, compute, len(pairs), len(pairs) - len(ratios))


def mean_interval(ratios: Floats) -> tuple[float, float, float]:
    """Geometric mean of ratios (n,) and its interval of 95 %, endless of one; NaN of none."""
    logs = np.log(ratios)
    mean = float(logs.mean()) if len(logs) else math.nan
    if len(logs) < 2:
        return math.exp(mean), 0.0, math.inf
    reach = students_reach(len(logs) - 1) * float(np.std(logs, ddof=1)) / math.sqrt(len(logs))
    return math.exp(mean), math.exp(mean - reach), math.exp(mean + reach)


def _explored_pairs(part: Part, case: str, quick: bool) -> Pairs:
    pairs: Pairs = []
    objects, seeds = (QUICK_OBJECTS, 1) if quick else (OBJECTS, SEEDS)
    for name, seed in product(objects, range(seeds)):
        plain, asked = _whole(name, case, quick, seed), _demand(quick)
        if part.uniform:
            asked = asked._replace(planner="uniform", settings={"count": plain.contours})
        try:
            with without(part):
                pairs.append((plain, explored(name, EXPLORED_CASES[case], asked, seed)))
        except RuntimeError:
            pairs.append((plain, None))
    return pairs


@cache
def _whole(name: str, case: str, quick: bool, seed: int) -> Outcome:
    """With all parts, once for all of them."""
    return explored(name, EXPLORED_CASES[case], _demand(quick), seed)


def _demand(quick: bool) -> Demand:
    percent = QUICK_TOLERANCE if quick else TOLERANCE
    return Demand(tolerance=0.01 * percent * EXPLORED_HEIGHT)._replace(feature=None)


def explored(name: str, noise: Noise, demand: Demand, seed: int) -> Outcome:
    """One exploration. Raises RuntimeError if it ends without a solid."""
    began = time.process_time()
    found = explore_object(EXPLORED_OBJECTS[name], noise, demand, seed=seed)
    used, score = time.process_time() - began, found.score
    cost = found.touches, score.robot_time, used, score.contours
    return Outcome(found.percent, *cost, 100.0 * score.sampling_floor / score.size)


def _rebuilt_pairs(part: Part, quick: bool) -> Pairs:
    pairs: Pairs = []
    for name, seed in product((*SHAPES, "groove"), range(1 if quick else SHAPE_SEEDS)):
        plain = rebuilt(name, part.case, seed)
        with without(part):
            pairs.append((plain, rebuilt(name, part.case, seed)))
    return pairs


def rebuilt(name: str, case: str, seed: int) -> Outcome:
    """One rebuild from contours alone."""
    shape, (noise, aside) = REBUILT_SHAPES[name], REBUILT_CASES[case]
    contours = noisy_contours(shape, SIZE, noise, np.random.default_rng(seed))
    contours[WHICH, :, 0] += aside
    tops = np.array([[*shape.axis(np.array(z)), z] for z in (shape.low, shape.high)])
    began = time.process_time()
    mesh = reconstruct(list(contours), tops=tops).mesh()
    used = time.process_time() - began
    error = truth_of(name).errors_of(Mesh(mesh.vertices, mesh.faces)).chamfer
    return Outcome(100.0 * error / SHAPE_HEIGHT, compute=used)


def taxel_rows(quick: bool) -> Iterator[Row]:
    """Errors of solids from all taxels over those of their contours alone, object by object."""
    objects = ("sphere", "box") if quick else (*SMOOTH, *SHARP)
    with single_threaded():
        for name, count, (noise, effects) in product(objects, COUNTS, NOISES.items()):
            even = Demand("uniform", settings={"count": count})
            whole = explored(name, effects, even, 0)
            with without(TAXELS):
                ratio = whole.error / explored(name, effects, even, 0).error
            most = MOST_SHARP if name in SHARP and noise != "exact" else MOST_SMOOTH
            title = f"{name}, {count} contours, {noise}: all taxels over contours"
            row = at_most(title, ratio, most, ".2f", " x")
            # What two tessellations of the truth differ by cannot be halved.
            yield row._replace(holds=row.holds or whole.error <= 2.0 * whole.floor)
