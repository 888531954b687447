"""Solids of eight objects, compared with those of other methods.

Objects are 100 mm high. Ratios are of means over the objects, unless a row names one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
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

OURS, TOUCHED = "palpate", "palpate, ends touched"
PeerErrors = Mapping[str, Mapping[str, MeshErrors]]  # By method and object


@dataclass(frozen=True, slots=True, kw_only=True)
class ContourSettings:
    """How contours and meshes of the objects are made."""

    margin: float = 0.005  # [fraction of the height] from the ends to the outermost contours
    noise: float = 0.2  # [mm] standard deviation of a coordinate, in the cases with noise
    mesh_tolerance: float = 0.02  # [mm] of the meshes that are compared
    n_seeds: int = 2  # of the noise


DEFAULT_CONTOURS = ContourSettings()
QUICK_CONTOURS = ContourSettings(n_seeds=1)


class PeerCase(NamedTuple):
    """Contours of one size and noise, and what is demanded of their solids."""

    size: tuple[int, int]  # Number of contours, and of points of each
    is_noisy: bool
    peers: Sequence[peers.Peer]  # Methods to compare with; ratios are over the first one's errors
    max_ratio: float  # Of the mean error over the first peer's; infinite: no demand
    max_touched_ratio: float  # The same with a touch at each end; 0: not measured
    max_normals: float  # [deg] mean angle between normals; infinite: no demand


def peer_rows(quick: bool, *, sheet: Path | None = None) -> Iterator[Row | str]:
    """Errors over those of other methods, object by object; fewer seeds of the noise if quick.

    `sheet`: folder for ``rebuilt_shapes.png``.
    """
    settings = QUICK_CONTOURS if quick else DEFAULT_CONTOURS
    if sheet is not None:
        from palpate.bench.pictures import draw_shapes
        from palpate.launch.charts import write_figure

        yield f"{write_figure(draw_shapes(), sheet / 'rebuilt_shapes.png')}"
    with single_threaded():
        floor = float(np.mean([truth_of(name).floor for name in REBUILT_SHAPES]))
        yield Row("objects of 100 mm: sampling floor of the truth", f"{floor:.4f} mm")
        for case in CASES:
            yield from case_rows(case, errors_of(case, REBUILT_SHAPES, settings), settings)
        if not poisson_installed():
            yield Row(f"Poisson surface of {PACKAGE}", "not installed", "for comparison")


def case_rows(case: PeerCase, errors: PeerErrors, settings: ContourSettings) -> Iterable[Row]:
    """The figures of one case."""
    noise = settings.noise if case.is_noisy else 0.0
    first, head = case.peers[0].name, f"{case.size[0]} by {case.size[1]}, {noise:g} mm"
    means = {method: _mean_errors(errors[method].values()) for method in errors}
    for method, most, suffix in (
        (OURS, case.max_ratio, ""),
        (TOUCHED, case.max_touched_ratio, ", ends touched"),
    ):
        if method not in errors:
            continue
        for name, mesh_errors in errors[method].items():
            ratio = mesh_errors.chamfer / errors[first][name].chamfer
            shown = f"{mesh_errors.chamfer:.3f} mm, {ratio:.2f} x"
            yield Row(f"{head}: {name}{suffix}", shown, "for comparison")
        ratio = means[method].chamfer / means[first].chamfer
        title = f"{head}: mean over the {first}'s{suffix}"
        yield _compared(title, f"{ratio:.3f} x", ratio, most, f"{most:g} x")
    for method, mean in means.items():
        lengths = f"{mean.chamfer:.3f} mm, {mean.hausdorff:.2f} mm"
        shown = f"{lengths}, {mean.normal_deg:.2f} deg, {mean.volume:.2%}"
        yield Row(f"{head}: {method}: mean, max, normals, volume", shown)
    angle, most = means[OURS].normal_deg, case.max_normals
    yield _compared(f"{head}: normals, degrees", f"{angle:.2f}", angle, most, f"{most:g}")


def _mean_errors(errors: Iterable[MeshErrors]) -> MeshErrors:
    """Means over objects, of the absolute value for the volume."""
    return MeshErrors(*np.mean([[*row[:4], abs(row.volume)] for row in errors], axis=0))


def _compared(title: str, shown: str, value: float, most: float, bound: str) -> Row:
    """A row with a demand, or for comparison if the demand is infinite."""
    target = f"<= {bound}" if np.isfinite(most) else "for comparison"
    return Row(title, shown, target, value <= most)


def errors_of(
    case: PeerCase, shapes: Mapping[str, RoundObject], settings: ContourSettings = DEFAULT_CONTOURS
) -> PeerErrors:
    """Errors of palpate and its peers, means over seeds of the noise."""
    runs: dict[str, dict[str, list[MeshErrors]]] = {}
    for name, shape in shapes.items():
        truth = truth_of(name)
        for seed in range(settings.n_seeds if case.is_noisy else 1):
            for method, mesh in _meshes(case, shape, np.random.default_rng(seed), settings):
                runs.setdefault(method, {}).setdefault(name, []).append(truth.errors_of(mesh))
    return {
        method: {name: MeshErrors(*np.mean(errors, axis=0)) for name, errors in by_name.items()}
        for method, by_name in runs.items()
    }


def _meshes(
    case: PeerCase, shape: RoundObject, rng: np.random.Generator, settings: ContourSettings
) -> Iterable[tuple[str, Mesh]]:
    noise = settings.noise if case.is_noisy else 0.0
    contours = noisy_contours(shape, case.size, noise, rng, settings.margin)
    yield OURS, rebuilt(list(contours), None, settings.mesh_tolerance)
    if case.max_touched_ratio:
        tops = ends_of(shape)
        tops += noise * rng.normal(size=tops.shape)
        yield TOUCHED, rebuilt(list(contours), tops, settings.mesh_tolerance)
    for peer in (*case.peers, *((peers.POISSON,) if poisson_installed() else ())):
        yield peer.name, peer.build(contours)


def ends_of(shape: RoundObject) -> Floats:
    """The two ends (2, 3) of an object on the axis [mm]."""
    return np.array([[0.0, 0.0, shape.low], [0.0, 0.0, shape.high]])


def noisy_contours(
    shape: RoundObject,
    size: tuple[int, int],
    noise: float,
    rng: np.random.Generator,
    margin: float = DEFAULT_CONTOURS.margin,
) -> Floats:
    """Contours (m, n, 3) with noise of a standard deviation [mm] on every coordinate.

    `margin`: distance of the outermost contours from the ends, as a fraction of the height.
    """
    inset = margin * SHAPE_HEIGHT
    heights = np.linspace(shape.low + inset, shape.high - inset, size[0])
    exact = shape.contours(heights, size[1])
    return np.asarray(exact + noise * rng.normal(size=exact.shape))


def rebuilt(
    contours: Sequence[Floats],
    tops: Floats | None = None,
    tolerance: float = DEFAULT_CONTOURS.mesh_tolerance,
) -> Mesh:
    """The mesh of palpate's solid, within a tolerance [mm]."""
    mesh = reconstruct(contours, tops=tops).mesh(tolerance)
    return Mesh(mesh.vertices, mesh.faces)


CASES = (
    PeerCase((27, 81), False, (peers.LOFT, peers.THESIS), 0.85, 0.45, 2.0),
    PeerCase((27, 81), True, (peers.SMOOTHED, peers.LOFT), 0.78, 0.65, 3.0),
    PeerCase((24, 41), False, (peers.LOFT,), np.inf, 0.0, 2.0),
    PeerCase((24, 41), True, (peers.SMOOTHED,), np.inf, 0.0, 3.0),
    PeerCase((9, 24), False, (peers.LOFT, peers.RADIAL, peers.THESIS), np.inf, 0.0, np.inf),
    PeerCase((9, 24), True, (peers.SMOOTHED, peers.RADIAL), 0.72, 0.0, np.inf),
)
