"""Solids of eight objects beside those of other ways.

Objects are 100 mm high; contours begin and end 0.5 % of the height inside. Ratios are of means
over the objects, unless a line names one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.bench import peers
from palpate.bench.accuracy.methods import PACKAGE, poisson_installed
from palpate.bench.rebuilt import REBUILT_SHAPES, SHAPE_HEIGHT, MeshErrors, RoundObject, truth_of
from palpate.bench.table import Row
from palpate.core.arrays import Floats
from palpate.core.rebuild import reconstruct
from palpate.core.shapes import Mesh
from palpate.tools.reconstruction import single_threaded

INSIDE = 0.005  # Of the height: how far inside the first and the last contour lie
CONTOUR_NOISE = 0.2  # Standard deviation of a coordinate, mm
TOLERANCE = 0.02  # Of the meshes that are compared, mm
SEEDS, QUICK_SEEDS = 2, 1
OURS, TOUCHED = "palpate", "palpate, ends touched"
PeerErrors = Mapping[str, Mapping[str, MeshErrors]]  # By way and object


class PeerCase(NamedTuple):
    """Contours of one size and noise, and what is demanded."""

    size: tuple[int, int]  # Contours, and points of each
    noise: float  # mm
    peers: Sequence[peers.Peer]  # What it is compared with; the ratios are over the first
    most: float  # Mean error over the first peer's; infinite for comparison only
    touched: float  # The same with a touch at each end; 0 if that is not measured
    normals: float  # Mean angle between normals, degrees


def peer_rows(quick: bool, *, sheet: Path | None = None) -> Iterator[Row | str]:
    """Errors over those of other methods, object by object; one seed of the noise if quick.

    `sheet`: folder for ``rebuilt_shapes.png``.
    """
    if sheet is not None:
        from palpate.bench.pictures import draw_shapes
        from palpate.launch.charts import write_figure

        yield f"{write_figure(draw_shapes(), sheet / 'rebuilt_shapes.png')}"
    noisy = QUICK_SEEDS if quick else SEEDS
    with single_threaded():
        floor = float(np.mean([truth_of(name).floor for name in REBUILT_SHAPES]))
        yield Row("objects of 100 mm: sampling floor of the truth", f"{floor:.4f} mm")
        for case in CASES:
            seeds = noisy if case.noise else 1
            yield from case_rows(case, errors_of(case, REBUILT_SHAPES, seeds))
        if not poisson_installed():
            yield Row(f"Poisson surface of {PACKAGE}", "not installed", "for comparison")


def case_rows(case: PeerCase, found: PeerErrors) -> Iterable[Row]:
    """The figures of one case."""
    first, head = case.peers[0].name, f"{case.size[0]} by {case.size[1]}, {case.noise:g} mm"
    means = {
        way: MeshErrors(*np.mean([[*one[:4], abs(one.volume)] for one in of.values()], axis=0))
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
        lengths = f"{errors.chamfer:.3f} mm, {errors.hausdorff:.2f} mm"
        told = f"{lengths}, {errors.normal_deg:.2f} deg, {errors.volume:.2%}"
        yield Row(f"{head}: {way}: mean, max, normals, volume", told)
    angle, most = means[OURS].normal_deg, case.normals
    yield _compared(f"{head}: normals, degrees", f"{angle:.2f}", angle, most, f"{most:g}")


def _compared(title: str, shown: str, value: float, most: float, bound: str) -> Row:
    """A row with a demand, or for comparison if that is infinite."""
    target = f"<= {bound}" if np.isfinite(most) else "for comparison"
    return Row(title, shown, target, value <= most)


def errors_of(case: PeerCase, shapes: Mapping[str, RoundObject], seeds: int) -> PeerErrors:
    """Errors of palpate and its peers, means over seeds of the noise."""
    runs: dict[str, dict[str, list[MeshErrors]]] = {}
    for name, shape in shapes.items():
        truth = truth_of(name)
        for seed in range(seeds):
            for way, mesh in _meshes(case, shape, np.random.default_rng(seed)):
                runs.setdefault(way, {}).setdefault(name, []).append(truth.errors_of(mesh))
    return {
        way: {name: MeshErrors(*np.mean(errors, axis=0)) for name, errors in of_way.items()}
        for way, of_way in runs.items()
    }


def _meshes(
    case: PeerCase, shape: RoundObject, rng: np.random.Generator
) -> Iterable[tuple[str, Mesh]]:
    contours = noisy_contours(shape, case.size, case.noise, rng)
    yield OURS, rebuilt(list(contours))
    if case.touched:
        tops = ends_of(shape)
        tops += case.noise * rng.normal(size=tops.shape)
        yield TOUCHED, rebuilt(list(contours), tops)
    for peer in (*case.peers, *((peers.POISSON,) if poisson_installed() else ())):
        yield peer.name, peer.build(contours)


def ends_of(shape: RoundObject) -> Floats:
    """The two ends (2, 3) of an object on the axis, mm."""
    return np.array([[0.0, 0.0, shape.low], [0.0, 0.0, shape.high]])


def noisy_contours(
    shape: RoundObject, size: tuple[int, int], noise: float, rng: np.random.Generator
) -> Floats:
    """Contours (m, n, 3) with noise on every coordinate, mm."""
    margin = INSIDE * SHAPE_HEIGHT
    heights = np.linspace(shape.low + margin, shape.high - margin, size[0])
    exact = shape.contours(heights, size[1])
    return np.asarray(exact + noise * rng.normal(size=exact.shape))


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
