"""Solids of eight objects beside those of other ways, and what disorder costs.

Objects are 100 mm high; contours begin and end 0.5 % of the height inside. Ratios are of means
over the objects, unless a line names one. Below: how far the band of a loft can be trusted, and
whether a step swings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from palpate.bench.objects import (
    REBUILT_SHAPES,
    ROUND_HEIGHT,
    ROUND_OBJECTS,
    SHAPE_HEIGHT,
    WAVY,
    RoundObject,
)
from palpate.bench.rebuild import peers
from palpate.bench.table import Row, at_least, at_most
from palpate.core import Floats
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.side import ContourLoft, fit_contour_loft
from palpate.core.shapes import Mesh
from palpate.tools import single_threaded

INSIDE = 0.005  # Of the height: how far inside the first and the last contour lie
CONTOUR_NOISE = 0.2  # Standard deviation of a coordinate, mm
TOLERANCE = 0.02  # Of the meshes that are compared, mm
SEEDS, QUICK_SEEDS = 2, 1
OURS, TOUCHED = "palpate", "palpate, ends touched"
PeerErrors = Mapping[str, Mapping[str, peers.MeshErrors]]  # By way and object
DISORDERED = ((27, 81), (24, 41), (9, 24))  # Contours, and points of each
COUNTS = 0.25  # By which the number of points differs from contour to contour
OUTLIER_SHARE, OUTLIER_DISTANCE = 0.02, 3.0  # Share of the points that are off, and by how much, mm
Disorder = Callable[[RoundObject, Floats, np.random.Generator], Sequence[Floats]]
BAND_SIZES = ((6, 24), (9, 24), (14, 40), (24, 40), (27, 80))  # Contours, and points of each
FULL = (27, 80)
NOISES = (0.002, 0.005)  # Standard deviation of a coordinate over the height
BAND_SEEDS, QUICK_BAND_SEEDS = 13, 2
BEYOND = 0.04  # By which the ends lie beyond the contours, where no pole is known
POLE = float(np.sqrt(1.04))  # Height at which the lobed zig-zag closes
NORMAL_95 = 1.96
ROWS, COLUMNS = 181, 97  # Places of a surface that are compared with the truth, between contours
LAST = 0.99  # Height of the last contours, on either side
WIDE, NARROW, AT = 0.6, 0.36, 0.12  # Radii of a cylinder that steps, and where
STEPS = 16  # Random stacks of its contours


class PeerCase(NamedTuple):
    """Contours of one size and noise, and what is demanded."""

    size: tuple[int, int]  # Contours, and points of each
    noise: float  # mm
    peers: Sequence[peers.Peer]  # What it is compared with; the ratios are over the first
    most: float  # Mean error over the first peer's; infinite for comparison only
    touched: float  # The same with a touch at each end; 0 if that is not measured
    normals: float  # Mean angle between normals, degrees


def peer_rows(quick: bool) -> Iterable[Row]:
    """Errors over those of other ways, object by object; one seed of the noise if quick."""
    noisy = QUICK_SEEDS if quick else SEEDS
    with single_threaded():
        floor = float(np.mean([peers.truth_of(name).floor for name in REBUILT_SHAPES]))
        yield Row("objects of 100 mm: sampling floor of the truth", f"{floor:.4f} mm")
        for case in CASES:
            seeds = noisy if case.noise else 1
            yield from case_rows(case, errors_of(case, REBUILT_SHAPES, seeds))
        if not peers.poisson_installed():
            yield Row(
                f"Poisson surface of {peers.PACKAGE}", "not installed", "for comparison", True
            )


def case_rows(case: PeerCase, found: PeerErrors) -> Iterable[Row]:
    """The figures of one case."""
    first, head = case.peers[0].name, f"{case.size[0]} by {case.size[1]}, {case.noise:g} mm"
    means = {
        way: peers.MeshErrors(
            *np.mean([[*one[:4], abs(one.volume)] for one in of.values()], axis=0)
        )
        for way, of in found.items()
    }
    for way, most, how in ((OURS, case.most, ""), (TOUCHED, case.touched, ", ends touched")):
        if way not in found:
            continue
        for name, errors in found[way].items():
            ratio = errors.chamfer / found[first][name].chamfer
            shown = f"{errors.chamfer:.3f} mm, {ratio:.2f} x"
            yield Row(f"{head}: {name}{how}", shown, "for comparison")
        ratio = means[way].chamfer / means[first].chamfer
        title = f"{head}: mean over the {first}'s{how}"
        yield _compared(title, f"{ratio:.3f} x", ratio, most, f"{most:g} x")
    for way, errors in means.items():
        told = (
            f"{errors.chamfer:.3f} mm, {errors.hausdorff:.2f} mm, {errors.normal_deg:.2f} deg, "
            f"{errors.volume:.2%}"
        )
        yield Row(f"{head}: {way}: mean, max, normals, volume", told)
    angle, most = means[OURS].normal_deg, case.normals
    yield _compared(f"{head}: normals, degrees", f"{angle:.2f}", angle, most, f"{most:g}")


def _compared(title: str, shown: str, value: float, most: float, bound: str) -> Row:
    """A row with a demand, or for comparison if that is infinite."""
    target = f"<= {bound}" if np.isfinite(most) else "for comparison"
    return Row(title, shown, target, value <= most)


def errors_of(case: PeerCase, shapes: Mapping[str, RoundObject], seeds: int) -> PeerErrors:
    """Errors of palpate and its peers, means over seeds of the noise."""
    runs: dict[str, dict[str, list[peers.MeshErrors]]] = {}
    for name, shape in shapes.items():
        truth = peers.truth_of(name)
        for seed in range(seeds):
            for way, mesh in _meshes(case, shape, np.random.default_rng(seed)):
                runs.setdefault(way, {}).setdefault(name, []).append(truth.errors_of(mesh))
    return {
        way: {name: peers.MeshErrors(*np.mean(errors, axis=0)) for name, errors in of_way.items()}
        for way, of_way in runs.items()
    }


def _meshes(
    case: PeerCase, shape: RoundObject, rng: np.random.Generator
) -> Iterable[tuple[str, Mesh]]:
    contours = noisy_contours(shape, case.size, case.noise, rng)
    yield OURS, rebuilt(list(contours))
    if case.touched:
        tops = _ends(shape)
        tops += case.noise * rng.normal(size=tops.shape)
        yield TOUCHED, rebuilt(list(contours), tops)
    for peer in (*case.peers, *((peers.POISSON,) if peers.poisson_installed() else ())):
        yield peer.name, peer.build(contours)


def _ends(shape: RoundObject) -> Floats:
    return np.array([[0.0, 0.0, shape.low], [0.0, 0.0, shape.high]])


def noisy_contours(
    shape: RoundObject, size: tuple[int, int], noise: float, rng: np.random.Generator
) -> Floats:
    """Contours (m, n, 3) with noise on every coordinate, mm."""
    margin = INSIDE * SHAPE_HEIGHT
    heights = np.linspace(shape.low + margin, shape.high - margin, size[0])
    exact = shape.contours(heights, size[1])
    return np.asarray(exact + noise * rng.normal(size=exact.shape))


def disorder_rows(quick: bool) -> Iterable[Row]:
    """What disorder and outliers cost."""
    off = f"{OUTLIER_SHARE:.0%} of points off by {OUTLIER_DISTANCE:g} mm"
    cases = (("random starts, directions and counts", shuffled, 1.03), (off, with_outliers, 1.1))
    with single_threaded():
        for size, (name, disorder, most) in product(DISORDERED, cases):
            title = f"{size[0]} by {size[1]}, {CONTOUR_NOISE} mm: {name}, error over that without"
            yield at_most(title, ratio_of(disorder, size), most, ".3f", " x")


def shuffled(shape: RoundObject, contours: Floats, rng: np.random.Generator) -> list[Floats]:
    """Other contours at the same heights: each begun anywhere, of any direction and count."""
    found = []
    for level in contours[..., 2].mean(axis=1):
        count = round(contours.shape[1] * rng.uniform(1.0 - COUNTS, 1.0 + COUNTS))
        exact = shape.contours(np.array([level]), count, rng.random())[0]
        noisy = exact + CONTOUR_NOISE * rng.normal(size=exact.shape)
        found.append(noisy[::-1] if rng.random() < 0.5 else noisy)
    return [found[i] for i in rng.permutation(len(found))]


def with_outliers(shape: RoundObject, contours: Floats, rng: np.random.Generator) -> list[Floats]:
    """The same contours with some points off, outwards or inwards."""
    changed = contours.copy()
    wrong = rng.random(contours.shape[:2]) < OUTLIER_SHARE
    away = contours - contours.mean(axis=1, keepdims=True)
    away[..., 2] = 0.0
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    signs = rng.choice([-1.0, 1.0], (int(wrong.sum()), 1))
    changed[wrong] += OUTLIER_DISTANCE * signs * away[wrong]
    return list(changed)


def ratio_of(
    disorder: Disorder,
    size: tuple[int, int] = DISORDERED[0],
    shapes: Mapping[str, RoundObject] = REBUILT_SHAPES,
) -> float:
    """Mean error over objects from disordered contours, over that from plain ones.

    The ends are touched, lest what nobody can know of them hides the rest.
    """
    plain, other = 0.0, 0.0
    for name, shape in shapes.items():
        tops = _ends(shape)
        contours = noisy_contours(shape, size, CONTOUR_NOISE, np.random.default_rng(0))
        changed = disorder(shape, contours, np.random.default_rng(1))
        plain += peers.truth_of(name).errors_of(rebuilt(list(contours), tops)).chamfer
        other += peers.truth_of(name).errors_of(rebuilt(changed, tops)).chamfer
    return other / plain


def rebuilt(contours: Sequence[Floats], tops: Floats | None = None) -> Mesh:
    """The mesh of palpate's solid."""
    mesh = reconstruct(contours, tops=tops).mesh(TOLERANCE)
    return Mesh(mesh.vertices, mesh.faces)


CASES = (
    PeerCase((27, 81), 0.0, (peers.LOFT, peers.THESIS), 0.85, 0.45, 2.0),
    PeerCase((27, 81), CONTOUR_NOISE, (peers.SMOOTHED, peers.LOFT), 0.78, 0.65, 3.0),
    PeerCase((24, 41), 0.0, (peers.LOFT,), np.inf, 0.0, 2.0),
    PeerCase((24, 41), CONTOUR_NOISE, (peers.SMOOTHED,), np.inf, 0.0, 3.0),
    PeerCase((9, 24), 0.0, (peers.LOFT, peers.RADIAL, peers.THESIS), np.inf, 0.0, np.inf),
    PeerCase((9, 24), CONTOUR_NOISE, (peers.SMOOTHED, peers.RADIAL), 0.72, 0.0, np.inf),
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
    most = max(step_swing(seed) for seed in range(STEPS))
    yield at_most("a step: side beyond its radii, over the width", most, 0.05, ".3g")


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


def _noisy(thing: RoundObject, size: tuple[int, int], noise: float, seeds: int) -> float:
    """Mean root mean square error over the height."""
    found = [judge_band(thing, _skin(thing, size, noise, seed)).rms for seed in range(seeds)]
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
    thing: RoundObject, size: tuple[int, int], noise: float, seed: int, poles: bool = False
) -> ContourLoft:
    """A loft of contours with noise."""
    rng = np.random.default_rng(seed)
    heights = np.linspace(-1.0, 1.0, size[0])
    grid = thing.rings(heights, 2.0 * np.pi * np.arange(size[1]) / size[1])[..., :2]
    grid = grid + noise * ROUND_HEIGHT * rng.normal(size=grid.shape)
    end = POLE if poles else 1.0 + BEYOND
    return fit_contour_loft(heights, grid, low=-end, high=end, pole=(poles, poles))


def step_swing(seed: int) -> float:
    """How far the side leaves the two radii of a step, over the width."""
    rng = np.random.default_rng(seed)
    near = AT + np.concatenate([rng.uniform(-0.06, 0.0, 2), 0.002 + rng.uniform(0.0, 0.06, 2)])
    heights = np.concatenate([rng.uniform(-LAST, LAST, 12), near])
    angle = 2.0 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(60)])
    contours = [(WIDE if z < AT + 0.001 else NARROW) * rim + [0.0, 0.0, z] for z in heights]
    closed = reconstruct(contours, method="skin", tops=[[0, 0, -1], [0, 0, 1]]).closed
    assert closed is not None
    side = closed.loft.at(np.linspace(-LAST, LAST, 997)[:, None], np.arange(COLUMNS) / COLUMNS)
    radius = np.linalg.norm(side, axis=2)
    return float(max(radius.max() - WIDE, NARROW - radius.min())) / (2.0 * WIDE)
