"""What each part of palpate is worth: error and cost without it over those with it, with noise.

A part is left out where it is called: a replacement is patched in while an object is explored, and
nothing else changes. Parts for a special case are measured in that case as well, such as impulses
or one displaced contour. Ratios are geometric means over objects and seeds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from itertools import product
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from palpate.bench.contours import noisy_contours
from palpate.bench.explored import EXPLORED_HEIGHT, EXPLORED_OBJECTS
from palpate.bench.growth import SHAPES, student_half_width
from palpate.bench.harness import NOISES, NOISY, Demand, Noise, explore_object
from palpate.bench.rebuilt import REBUILT_SHAPES, SHAPE_HEIGHT, truth_of
from palpate.bench.table import Figure, Row, at_most, figure_of
from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.side import ShiftSettings
from palpate.core.shapes import Mesh
from palpate.core.touch import Pad, Patch, fit_jet
from palpate.tools.reconstruction import single_threaded


@dataclass(frozen=True, slots=True, kw_only=True)
class AblationSettings:
    """What is explored and rebuilt with and without each part."""

    objects: tuple[str, ...] = ("vase", "box", "tapered and bent")
    n_seeds: int = 2  # of explorations
    tolerance: float = 0.2  # [% of the height] that is asked for
    n_shape_seeds: int = 4  # of rebuilds from contours alone
    size: tuple[int, int] = (12, 48)  # number of contours, and of points of each
    displaced: int = 5  # index of the contour that is displaced
    has_special_cases: bool = True  # whether parts are also explored in the case that they are for


@dataclass(frozen=True, slots=True, kw_only=True)
class TaxelSettings:
    """Objects on which all taxels are compared with contours alone, and limits."""

    smooth: tuple[str, ...] = ("sphere", "egg", "vase", "twist")
    sharp: tuple[str, ...] = ("box", "step", "star")
    counts: tuple[int, ...] = (5, 9)  # contours at even heights
    max_ratio: float = 0.5  # error with all taxels / error of contours alone
    max_sharp_ratio: float = 0.8  # the same for sharp objects with noise


QUICK_ABLATION = AblationSettings(
    objects=("vase",), n_seeds=1, tolerance=0.5, n_shape_seeds=1, has_special_cases=False
)
QUICK_TAXELS = TaxelSettings(smooth=("sphere",), sharp=("box",))
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
# Noise of the points, and displacement of one contour [mm].
REBUILT_CASES: Mapping[str, tuple[float, float]] = {ROUGH: (0.5, 0.0), DISPLACED: (0.2, 5.0)}
LINE = "{:<42}{:>24}{:>9}{:>8}{:>7}{:>6}"
Replacement = Callable[[Any], Any]  # From what is replaced to what replaces it


class Part(NamedTuple):
    """A part that can be left out."""

    name: str
    replacements: Mapping[str, Replacement]  # By ``module:name``
    case: str = ""  # Special case that it is for: key of `EXPLORED_CASES` or `REBUILT_CASES`
    is_uniform: bool = False  # Whether it is replaced by the same number of even slices


def _with_arguments(**changed: Any) -> Replacement:
    return lambda call: lambda *args, **more: call(*args, **{**more, **changed})


def _with_result(change: Callable[[Any], Any]) -> Replacement:
    return lambda call: lambda *args, **more: change(call(*args, **more))


def _returning(value: Any) -> Replacement:
    return lambda call: lambda *args, **more: value


def _plain_fit(call: object) -> Callable[..., object]:
    return lambda pad, height, touched, *more: fit_jet(pad, height, touched)


def _unmasked(fit: Callable[..., Patch]) -> Callable[..., Patch]:
    """A fit to all taxels: those without contact are taken for the pad's undeformed face."""

    def fitted(pad: Pad, height: Floats, touched: Bools, *more: Any) -> Patch:
        return fit(pad, np.where(touched, height, -pad.sag()), touched | touched.any(), *more)

    return fitted


_TOUCH, _REBUILD, _NODES = "palpate.core.touch", "palpate.core.rebuild", "palpate.nodes"
_CLEAN, _STACK = f"{_NODES}.filter:clean", f"{_NODES}.rebuilding.fitting:stack_points"
TAXELS = Part(
    "all taxels, not contour points",
    {f"{_NODES}.rebuilding.fitting:reconstruct": _with_arguments(patches=None)},
)
_robust = {f"{_TOUCH}.{room}:fit_robust_jet": _plain_fit for room in ("filters", "edges")}
_whole_pad = _with_result(lambda clean: clean._replace(touched=clean.touched | clean.touched.any()))
_no_shifts = ShiftSettings(min_touches=10**9)
_none_bad = _with_result(lambda test: test._replace(bad=test.bad & False, off=0.0 * test.off))
PARTS = (
    Part("filter", {_CLEAN: _with_arguments(order="none")}, SALT),
    Part("robust fit", _robust, PEPPER),
    Part("mask", {_CLEAN: _whole_pad}),
    Part("mask, in the fit alone", {f"{_TOUCH}:fit_patch": _unmasked}),
    Part("slopes", {_STACK: _with_result(lambda points: points._replace(normals=None))}),
    TAXELS,
    Part(
        "cross-validation",
        {
            f"{_REBUILD}.side.fitting:smooth": _with_arguments(noise=0.0),
            f"{_REBUILD}.side.shifts:stiffened": lambda _: lambda spline, _settings: spline,
        },
        ROUGH,
    ),
    Part("bad-contour test", {f"{_REBUILD}.evidence:inconsistent_contours": _none_bad}, DISPLACED),
    Part(
        "ends",
        {
            "palpate.core.explore.probing:next_probe": _returning(None),
            f"{_NODES}.rebuilding.fitting:touched_ends": _returning(None),
            f"{_REBUILD}.reconstruction:end_height": _returning(None),
        },
    ),
    Part(
        "pose offsets",
        {f"{_REBUILD}.reconstruction:fit_shifted_spline": _with_arguments(settings=_no_shifts)},
        FAR_OFF,
    ),
    Part("predicted planner, not even slices", {}, is_uniform=True),
)


@contextmanager
def without(part: Part) -> Iterator[None]:
    """Leave a part out until the end of the context."""
    with ExitStack() as stack:
        for place, replacement in part.replacements.items():
            module_name, _, name = place.partition(":")
            module = import_module(module_name)
            replaced = replacement(getattr(module, name))
            stack.enter_context(mock.patch.object(module, name, replaced))
        yield


class Outcome(NamedTuple):
    """Result of an exploration, or of a rebuild from contours alone."""

    error: float  # [% of the height] root mean square; of a rebuild the Chamfer distance
    touches: float = 1.0
    robot_time: float = 1.0  # [s]
    compute: float = 1.0  # Processor time [s]
    contours: int = 0
    floor: float = 0.0  # [% of the height] smallest error that sampling can measure


Pairs = list[tuple[Outcome, Outcome | None]]  # With a part and without it; None: no solid


class Worth(NamedTuple):
    """Geometric means of errors and costs without a part over those with it."""

    name: str
    error: tuple[float, float, float]  # Mean, and the ends of its interval of 95 %
    touches: float
    robot_time: float
    compute: float
    runs: int  # Number of pairs
    failed: int  # Pairs without a solid when the part was left out
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
        cells = (error, *(f"{ratio:.2f}" for ratio in self[2:5]))
        line = LINE.format(self.name, *(cell.replace("nan", "-") for cell in cells), self.runs)
        return f"{line}  {self.failed} FAILED" if self.failed else line


def part_rows(quick: bool) -> Iterator[Worth | str]:
    """A row for each part, then one in its special case if it has one; fewer objects if quick."""
    settings = QUICK_ABLATION if quick else AblationSettings()
    yield LINE.format("without the part, over with it", "error", "touches", "robot", "CPU", "runs")
    with single_threaded():
        for part in PARTS:
            yield worth_of(part.name, _explored_pairs(part, "", settings))
            if part.case in REBUILT_CASES:
                yield worth_of(f"  {part.case}", _rebuilt_pairs(part, settings))
            elif part.case and settings.has_special_cases:
                yield worth_of(f"  {part.case}", _explored_pairs(part, part.case, settings))


def worth_of(name: str, pairs: Pairs) -> Worth:
    """Ratios over pairs of an outcome with the part and one without."""
    ratios = [np.divide(reduced[:4], whole[:4]) for whole, reduced in pairs if reduced is not None]
    error, *costs = (mean_interval(column) for column in np.reshape(ratios, (-1, 4)).T)
    touches, robot_time, compute = (mean for mean, _, _ in costs)
    return Worth(name, error, touches, robot_time, compute, len(pairs), len(pairs) - len(ratios))


def mean_interval(ratios: Floats) -> tuple[float, float, float]:
    """Geometric mean of ratios (n,) and its 95 % interval: infinite for n = 1, NaN for n = 0."""
    logs = np.log(ratios)
    mean = float(logs.mean()) if len(logs) else math.nan
    if len(logs) < 2:
        return math.exp(mean), 0.0, math.inf
    deviation = float(np.std(logs, ddof=1))
    half_width = student_half_width(len(logs) - 1) * deviation / math.sqrt(len(logs))
    return math.exp(mean), math.exp(mean - half_width), math.exp(mean + half_width)


def _explored_pairs(part: Part, case: str, settings: AblationSettings) -> Pairs:
    pairs: Pairs = []
    for name, seed in product(settings.objects, range(settings.n_seeds)):
        whole, demand = _explored_whole(name, case, settings, seed), _demand(settings)
        if part.is_uniform:
            demand = demand._replace(planner="uniform", settings={"count": whole.contours})
        try:
            with without(part):
                pairs.append((whole, explored(name, EXPLORED_CASES[case], demand, seed)))
        except RuntimeError:
            pairs.append((whole, None))
    return pairs


@cache
def _explored_whole(name: str, case: str, settings: AblationSettings, seed: int) -> Outcome:
    """An exploration with all parts, made once for all of them."""
    return explored(name, EXPLORED_CASES[case], _demand(settings), seed)


def _demand(settings: AblationSettings) -> Demand:
    """What is demanded; the largest untouched feature follows from the tolerance."""
    return Demand(tolerance=0.01 * settings.tolerance * EXPLORED_HEIGHT, feature=None)


def explored(name: str, noise: Noise, demand: Demand, seed: int) -> Outcome:
    """One exploration. Raises RuntimeError if it ends without a solid."""
    start = time.process_time()
    result = explore_object(EXPLORED_OBJECTS[name], noise, demand, seed=seed)
    compute, score = time.process_time() - start, result.score
    costs = result.touches, score.robot_time, compute, score.contours
    return Outcome(result.percent, *costs, 100.0 * score.sampling_floor / score.size)


def _rebuilt_pairs(part: Part, settings: AblationSettings) -> Pairs:
    pairs: Pairs = []
    for name, seed in product((*SHAPES, "groove"), range(settings.n_shape_seeds)):
        whole = rebuilt(name, part.case, seed, settings)
        with without(part):
            pairs.append((whole, rebuilt(name, part.case, seed, settings)))
    return pairs


def rebuilt(
    name: str, case: str, seed: int, settings: AblationSettings = AblationSettings()
) -> Outcome:
    """One rebuild from contours alone, of one of the `REBUILT_SHAPES` and `REBUILT_CASES`."""
    shape, (noise, displacement) = REBUILT_SHAPES[name], REBUILT_CASES[case]
    contours = noisy_contours(shape, settings.size, noise, np.random.default_rng(seed))
    contours[settings.displaced, :, 0] += displacement
    tops = np.array([[*shape.axis(np.array(z)), z] for z in (shape.low, shape.high)])
    start = time.process_time()
    mesh = reconstruct(list(contours), tops=tops).mesh()
    compute = time.process_time() - start
    error = truth_of(name).errors_of(Mesh(mesh.vertices, mesh.faces)).chamfer
    return Outcome(100.0 * error / SHAPE_HEIGHT, compute=compute)


def taxel_rows(quick: bool) -> Iterator[Row]:
    """Errors of solids from all taxels over those of their contours alone, object by object."""
    settings = QUICK_TAXELS if quick else TaxelSettings()
    objects = (*settings.smooth, *settings.sharp)
    with single_threaded():
        for name, count, (noise, effects) in product(objects, settings.counts, NOISES.items()):
            even = Demand("uniform", settings={"count": count})
            whole = explored(name, effects, even, 0)
            with without(TAXELS):
                ratio = whole.error / explored(name, effects, even, 0).error
            is_hard = name in settings.sharp and noise != "exact"
            most = settings.max_sharp_ratio if is_hard else settings.max_ratio
            title = f"{name}, {count} contours, {noise}: all taxels over contours"
            row = at_most(title, ratio, most, ".2f", " x")
            # An error near the difference between two tessellations of the truth cannot be halved.
            yield row._replace(holds=row.holds or whole.error <= 2.0 * whole.floor)
