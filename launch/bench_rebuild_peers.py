"""Rebuilding compared with other ways, on the same contours and in the same run.

Eight objects 100 mm high; contours begin and end 0.5 % of the height inside. Ratios are of means
over the objects, unless a line names one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.shapes.protocol import Mesh
from palpate.launch.bench_row import Row
from palpate.launch.mesh_truth import Errors
from palpate.launch.one_thread import one_thread
from palpate.launch.poisson_peer import PACKAGE, poisson_installed
from palpate.launch.rebuild_peers import (
    Peer,
    loft,
    poisson_surface,
    radial_functions,
    shell_and_core,
    smoothed_loft,
)
from palpate.launch.rebuild_shapes import HEIGHT, SHAPES, RebuiltShape, truth_of

INSIDE = 0.005
"""Of the height: how far inside the first and the last contour lie."""
NOISE = 0.2
"""Standard deviation of a coordinate, mm."""
TOLERANCE = 0.02
"""Of the meshes that are compared, mm."""
SEEDS, QUICK_SEEDS = 2, 1
OURS, TOUCHED = "palpate", "palpate, ends touched"


class Case(NamedTuple):
    """Contours of one size and noise, and what is demanded."""

    size: tuple[int, int]
    """Contours, and points of each."""
    noise: float
    """mm."""
    peers: Sequence[Peer]
    """What it is compared with; the ratios are over the first."""
    most: float
    """Mean error over the first peer's; infinite for comparison only."""
    touched: float
    """The same with a touch at each end; 0 if that is not measured."""
    normals: float
    """Mean angle between normals, degrees."""


Found = Mapping[str, Mapping[str, Errors]]
"""Way to object to errors, means over seeds."""

LOFT, SMOOTHED = Peer("loft", loft), Peer("smoothed loft", smoothed_loft)
POISSON = Peer("Poisson surface", poisson_surface)
THESIS, RADIAL = Peer("thesis", shell_and_core), Peer("radial functions", radial_functions)
CASES = (
    Case((27, 81), 0.0, (LOFT, THESIS), 0.85, 0.45, 2.0),
    Case((27, 81), NOISE, (SMOOTHED, LOFT), 0.78, 0.65, 3.0),
    Case((24, 41), 0.0, (LOFT,), np.inf, 0.0, 2.0),
    Case((24, 41), NOISE, (SMOOTHED,), np.inf, 0.0, 3.0),
    Case((9, 24), 0.0, (LOFT, RADIAL, THESIS), np.inf, 0.0, np.inf),
    Case((9, 24), NOISE, (SMOOTHED, RADIAL), 0.72, 0.0, np.inf),
)


def peer_rows(quick: bool) -> Iterable[Row]:
    """Errors over those of other ways, object by object.

    Parameters
    ----------
    quick : bool
        One seed of the noise.
    """
    with one_thread():
        yield from _peer_rows(QUICK_SEEDS if quick else SEEDS)


def _peer_rows(noisy: int) -> Iterable[Row]:
    floor = float(np.mean([truth_of(name).floor for name in SHAPES]))
    yield Row("objects of 100 mm: sampling floor of the truth", f"{floor:.4f} mm", "", True)
    for case in CASES:
        seeds = noisy if case.noise else 1
        yield from case_rows(case, errors_of(case, SHAPES, seeds))
    if not poisson_installed():
        yield Row(f"Poisson surface of {PACKAGE}", "not installed", "for comparison", True)


def case_rows(case: Case, found: Found) -> Iterable[Row]:
    """The figures of one case."""
    first = case.peers[0].name
    head = f"{case.size[0]} by {case.size[1]}, {case.noise:g} mm"
    for way, most in ((OURS, case.most), (TOUCHED, case.touched)):
        if way not in found:
            continue
        for name, errors in found[way].items():
            ratio = errors.chamfer / found[first][name].chamfer
            told = f"{head}: {name}, {errors.chamfer:.3f} mm{_touched(way)}"
            yield Row(told, f"{ratio:.2f} x", "for comparison", True)
        ratio = _mean(found[way]).chamfer / _mean(found[first]).chamfer
        target = f"<= {most:g} x" if np.isfinite(most) else "for comparison"
        yield Row(
            f"{head}: mean over the {first}'s{_touched(way)}",
            f"{ratio:.3f} x",
            target,
            ratio <= most,
        )
    for way in found:
        yield Row(f"{head}: {way}: {_told(_mean(found[way]))}", "", "", True)
    angle = _mean(found[OURS]).normal_deg
    target = f"<= {case.normals:g}" if np.isfinite(case.normals) else "for comparison"
    yield Row(f"{head}: normals, degrees", f"{angle:.2f}", target, angle <= case.normals)


def errors_of(case: Case, shapes: Mapping[str, RebuiltShape], seeds: int) -> Found:
    """Errors of palpate and its peers, means over seeds of the noise."""
    runs: dict[str, dict[str, list[Errors]]] = {}
    for name, shape in shapes.items():
        truth = truth_of(name)
        for seed in range(seeds):
            for way, mesh in _meshes(case, shape, np.random.default_rng(seed)):
                runs.setdefault(way, {}).setdefault(name, []).append(truth.errors_of(mesh))
    return {
        way: {name: Errors(*np.mean(errors, axis=0)) for name, errors in of_way.items()}
        for way, of_way in runs.items()
    }


def felt_contours(
    shape: RebuiltShape, size: tuple[int, int], noise: float, rng: np.random.Generator
) -> Floats:
    """Contours (m, n, 3) with noise on every coordinate, mm."""
    margin = INSIDE * HEIGHT
    heights = np.linspace(shape.low + margin, shape.high - margin, size[0])
    exact = shape.contours(heights, size[1])
    return np.asarray(exact + noise * rng.normal(size=exact.shape))


def rebuilt(contours: Sequence[Floats], tops: Floats | None = None) -> Mesh:
    """The mesh of palpate's solid."""
    mesh = reconstruct(contours, tops=tops).mesh(TOLERANCE)
    return Mesh(mesh.vertices, mesh.faces)


def _meshes(
    case: Case, shape: RebuiltShape, rng: np.random.Generator
) -> Iterable[tuple[str, Mesh]]:
    contours = felt_contours(shape, case.size, case.noise, rng)
    yield OURS, rebuilt(list(contours))
    if case.touched:
        tops = np.array([[0.0, 0.0, shape.low], [0.0, 0.0, shape.high]])
        tops += case.noise * rng.normal(size=tops.shape)
        yield TOUCHED, rebuilt(list(contours), tops)
    for peer in (*case.peers, *((POISSON,) if poisson_installed() else ())):
        yield peer.name, peer.build(contours)


def _mean(errors: Mapping[str, Errors]) -> Errors:
    return Errors(*np.mean([[*one[:3], abs(one.volume)] for one in errors.values()], axis=0))


def _told(errors: Errors) -> str:
    return (
        f"mean {errors.chamfer:.3f} mm, max {errors.hausdorff:.2f} mm, "
        f"normals {errors.normal_deg:.2f} deg, volume {errors.volume:.2%}"
    )


def _touched(way: str) -> str:
    return ", ends touched" if way == TOUCHED else ""
