"""Solids of eight objects beside those of other ways, and what disorder costs.

Objects are 100 mm high; contours begin and end 0.5 % of the height inside. Ratios are of means
over the objects, unless a line names one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from palpate.bench.objects import REBUILT_SHAPES, SHAPE_HEIGHT, RoundObject
from palpate.bench.rebuild import peers
from palpate.bench.table import Row, at_most
from palpate.core import Floats
from palpate.core.rebuild import reconstruct
from palpate.core.shapes import Mesh
from palpate.tools import single_threaded

INSIDE = 0.005  # Of the height: how far inside the first and the last contour lie
CONTOUR_NOISE = 0.2  # Standard deviation of a coordinate, mm
TOLERANCE = 0.02  # Of the meshes that are compared, mm
SEEDS, QUICK_SEEDS = 2, 1
OURS, TOUCHED = "palpate", "palpate, ends touched"
PeerErrors = Mapping[
    str, Mapping[str, peers.MeshErrors]
]  # Way to object to errors, means over seeds
DISORDERED = ((27, 81), (24, 41), (9, 24))  # Contours, and points of each
COUNTS = 0.25  # By which the number of points differs from contour to contour
OUTLIER_SHARE, OUTLIER_DISTANCE = 0.02, 3.0  # Share of the points that are off, and by how much, mm
Disorder = Callable[[RoundObject, Floats, np.random.Generator], Sequence[Floats]]


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
