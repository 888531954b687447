"""Solids of eight objects beside those of lofts, radial functions, Poisson surfaces, the thesis.

Objects are 100 mm high; contours begin and end 0.5 % of the height inside. Ratios are of means
over the objects, unless a line names one. Kazhdan and Hoppe, *Screened Poisson surface
reconstruction*, 2013, by PyMeshLab where that is installed.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator

from palpate.bench.objects import REBUILT_SHAPES, SHAPE_HEIGHT, ContouredShape, MeshErrors, truth_of
from palpate.bench.rebuild.thesis import loft_rings
from palpate.bench.table import Row, at_most, best_seconds
from palpate.core import Floats
from palpate.core.geometry import close_rings
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.lattice import fit_lattice
from palpate.core.shapes import Mesh
from palpate.core.thesis import rebuild_thesis
from palpate.tools import single_threaded

INSIDE = 0.005  # Of the height: how far inside the first and the last contour lie
CONTOUR_NOISE = 0.2  # Standard deviation of a coordinate, mm
TOLERANCE = 0.02  # Of the meshes that are compared, mm
SEEDS, QUICK_SEEDS = 2, 1
OURS, TOUCHED = "palpate", "palpate, ends touched"
PeerErrors = Mapping[str, Mapping[str, MeshErrors]]  # Way to object to errors, means over seeds
# Contours, and points of each; the larger has eight times as many points.
DISORDERED, LARGE = (27, 81), (108, 162)
# Contours and points, and control points each way, of the largest lattice.
HUGE, CONTROL = (200, 400), 40
COUNTS = 0.25  # By which the number of points differs from contour to contour
OUTLIER_SHARE, OUTLIER_DISTANCE = 0.02, 3.0  # Share of the points that are off, and by how much, mm
ROUNDS = 5
FIT_MS, UPDATE_MS, BAND_MS, LATTICE_S = 30.0, 10.0, 10.0, 1.0
Disorder = Callable[[ContouredShape, Floats, np.random.Generator], Sequence[Floats]]
LOFT_ROWS, LOFT_COLUMNS = 121, 180  # Of the lofts' meshes
HARMONICS = 16  # Of a contour that are kept by the smoothed loft
OFFSET = 0.02  # Of the size: by how much the points inside and outside lie off the surface
FIELD_ROWS, FIELD_COLUMNS = 81, 120  # Of the mesh of the radial functions
STEPS = 6  # Secant steps from the loft to the zero of the radial functions
PACKAGE = "pymeshlab"
OCTREE_DEPTH = 8  # Of the octree: 256 cells along the object


class PeerCase(NamedTuple):
    """Contours of one size and noise, and what is demanded."""

    size: tuple[int, int]  # Contours, and points of each
    noise: float  # mm
    peers: Sequence[Peer]  # What it is compared with; the ratios are over the first
    most: float  # Mean error over the first peer's; infinite for comparison only
    touched: float  # The same with a touch at each end; 0 if that is not measured
    normals: float  # Mean angle between normals, degrees


def peer_rows(quick: bool) -> Iterable[Row]:
    """Errors over those of other ways, object by object; one seed of the noise if quick."""
    noisy = QUICK_SEEDS if quick else SEEDS
    with single_threaded():
        floor = float(np.mean([truth_of(name).floor for name in REBUILT_SHAPES]))
        yield Row("objects of 100 mm: sampling floor of the truth", f"{floor:.4f} mm")
        for case in CASES:
            seeds = noisy if case.noise else 1
            yield from case_rows(case, errors_of(case, REBUILT_SHAPES, seeds))
        if not poisson_installed():
            yield Row(f"Poisson surface of {PACKAGE}", "not installed", "for comparison", True)


def case_rows(case: PeerCase, found: PeerErrors) -> Iterable[Row]:
    """The figures of one case."""
    first = case.peers[0].name
    head = f"{case.size[0]} by {case.size[1]}, {case.noise:g} mm"
    for way, most in ((OURS, case.most), (TOUCHED, case.touched)):
        if way not in found:
            continue
        for name, errors in found[way].items():
            ratio = errors.chamfer / found[first][name].chamfer
            title = f"{head}: {name}, {errors.chamfer:.3f} mm{_touched(way)}"
            yield Row(title, f"{ratio:.2f} x", "for comparison")
        ratio = _mean(found[way]).chamfer / _mean(found[first]).chamfer
        title = f"{head}: mean over the {first}'s{_touched(way)}"
        yield _compared(title, f"{ratio:.3f} x", ratio, most, " x")
    for way in found:
        yield Row(f"{head}: {way}: {_told(_mean(found[way]))}", "")
    angle = _mean(found[OURS]).normal_deg
    yield _compared(f"{head}: normals, degrees", f"{angle:.2f}", angle, case.normals)


def _compared(title: str, shown: str, value: float, most: float, unit: str = "") -> Row:
    target = f"<= {most:g}{unit}" if np.isfinite(most) else "for comparison"
    return Row(title, shown, target, value <= most)


def _touched(way: str) -> str:
    return ", ends touched" if way == TOUCHED else ""


def _mean(errors: Mapping[str, MeshErrors]) -> MeshErrors:
    return MeshErrors(*np.mean([[*one[:3], abs(one.volume)] for one in errors.values()], axis=0))


def _told(errors: MeshErrors) -> str:
    return (
        f"mean {errors.chamfer:.3f} mm, max {errors.hausdorff:.2f} mm, "
        f"normals {errors.normal_deg:.2f} deg, volume {errors.volume:.2%}"
    )


def errors_of(case: PeerCase, shapes: Mapping[str, ContouredShape], seeds: int) -> PeerErrors:
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
    case: PeerCase, shape: ContouredShape, rng: np.random.Generator
) -> Iterable[tuple[str, Mesh]]:
    contours = noisy_contours(shape, case.size, case.noise, rng)
    yield OURS, rebuilt(list(contours))
    if case.touched:
        tops = np.array([[0.0, 0.0, shape.low], [0.0, 0.0, shape.high]])
        tops += case.noise * rng.normal(size=tops.shape)
        yield TOUCHED, rebuilt(list(contours), tops)
    for peer in (*case.peers, *((POISSON,) if poisson_installed() else ())):
        yield peer.name, peer.build(contours)


def poisson_installed() -> bool:
    """Whether the package is there."""
    return importlib.util.find_spec(PACKAGE) is not None


def noisy_contours(
    shape: ContouredShape, size: tuple[int, int], noise: float, rng: np.random.Generator
) -> Floats:
    """Contours (m, n, 3) with noise on every coordinate, mm."""
    margin = INSIDE * SHAPE_HEIGHT
    heights = np.linspace(shape.low + margin, shape.high - margin, size[0])
    exact = shape.contours(heights, size[1])
    return np.asarray(exact + noise * rng.normal(size=exact.shape))


def disorder_rows(quick: bool) -> Iterable[Row]:
    """Figures of whole solids."""
    with single_threaded():
        yield from _disorders()
        yield from _times()


def _disorders() -> Iterable[Row]:
    for name, disorder, most in (
        ("random starts, directions and counts", shuffled, 1.03),
        (f"{OUTLIER_SHARE:.0%} of points off by {OUTLIER_DISTANCE:g} mm", with_outliers, 1.1),
    ):
        ratio = ratio_of(disorder)
        size = f"{DISORDERED[0]} by {DISORDERED[1]}"
        title = f"{size}, {CONTOUR_NOISE} mm: {name}, error over that without"
        yield at_most(title, ratio, most, ".3f", " x")


def shuffled(shape: ContouredShape, contours: Floats, rng: np.random.Generator) -> list[Floats]:
    """Other contours at the same heights: each begun anywhere, of any direction and count."""
    found = []
    for level in contours[..., 2].mean(axis=1):
        count = round(contours.shape[1] * rng.uniform(1.0 - COUNTS, 1.0 + COUNTS))
        exact = shape.contours(np.array([level]), count, rng.random())[0]
        noisy = exact + CONTOUR_NOISE * rng.normal(size=exact.shape)
        found.append(noisy[::-1] if rng.random() < 0.5 else noisy)
    return [found[i] for i in rng.permutation(len(found))]


def with_outliers(
    shape: ContouredShape, contours: Floats, rng: np.random.Generator
) -> list[Floats]:
    """The same contours with some points off, outwards or inwards."""
    changed = contours.copy()
    wrong = rng.random(contours.shape[:2]) < OUTLIER_SHARE
    away = contours - contours.mean(axis=1, keepdims=True)
    away[..., 2] = 0.0
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    changed[wrong] += (
        OUTLIER_DISTANCE * rng.choice([-1.0, 1.0], (int(wrong.sum()), 1)) * away[wrong]
    )
    return list(changed)


def ratio_of(disorder: Disorder, shapes: Mapping[str, ContouredShape] = REBUILT_SHAPES) -> float:
    """Mean error over objects from disordered contours, over that from plain ones.

    The ends are touched, lest what nobody can know of them hides the rest.
    """
    plain, other = 0.0, 0.0
    for name, shape in shapes.items():
        tops = np.array([[0.0, 0.0, shape.low], [0.0, 0.0, shape.high]])
        contours = noisy_contours(shape, DISORDERED, CONTOUR_NOISE, np.random.default_rng(0))
        changed = disorder(shape, contours, np.random.default_rng(1))
        plain += truth_of(name).errors_of(rebuilt(list(contours), tops)).chamfer
        other += truth_of(name).errors_of(rebuilt(changed, tops)).chamfer
    return other / plain


def rebuilt(contours: Sequence[Floats], tops: Floats | None = None) -> Mesh:
    """The mesh of palpate's solid."""
    mesh = reconstruct(contours, tops=tops).mesh(TOLERANCE)
    return Mesh(mesh.vertices, mesh.faces)


def _times() -> Iterable[Row]:
    shape = REBUILT_SHAPES["lobed zig-zag"]
    contours = list(noisy_contours(shape, DISORDERED, CONTOUR_NOISE, np.random.default_rng(0)))
    large = list(noisy_contours(shape, LARGE, CONTOUR_NOISE, np.random.default_rng(0)))
    solid = reconstruct([*contours[:13], *contours[14:]])
    closed = solid.closed
    assert closed is not None
    heights, turns = np.linspace(-49.0, 49.0, 241), np.arange(97) / 97
    calls: Sequence[tuple[str, Callable[[], object], float]] = (
        ("whole fit, method skin", partial(reconstruct, contours, method="skin"), FIT_MS),
        ("whole fit, method lattice", partial(reconstruct, contours, method="lattice"), FIT_MS),
        ("one contour more", partial(solid.update, contours[13]), UPDATE_MS),
        ("band", partial(closed.loft.deviation, heights, turns), BAND_MS),
    )
    head = f"{DISORDERED[0]} by {DISORDERED[1]}"
    for name, call, most in calls:
        yield at_most(f"{head}: {name}, ms", 1e3 * _processor_seconds(call), most, ".1f")
    ratio = _processor_seconds(partial(reconstruct, large, method="skin"), 2)
    ratio /= _processor_seconds(partial(reconstruct, contours, method="skin"))
    most = LARGE[0] * LARGE[1] / (DISORDERED[0] * DISORDERED[1])
    yield at_most(f"{LARGE[0]} by {LARGE[1]} over {head}: time", ratio, most, ".1f", " x")
    yield _largest(shape)


def _largest(shape: ContouredShape) -> Row:
    contours = list(noisy_contours(shape, HUGE, 0.0, np.random.default_rng(0)))
    closed = reconstruct(contours, method="skin").closed
    assert closed is not None
    surface = closed.loft.surface
    seconds = _processor_seconds(lambda: fit_lattice(surface, size=(CONTROL, CONTROL)), 2)
    name = f"{HUGE[0]} by {HUGE[1]}: lattice of {CONTROL} x {CONTROL} x {CONTROL}"
    return at_most(name, seconds, LATTICE_S, ".2f", " s")


def _processor_seconds(call: Callable[[], object], rounds: int = ROUNDS) -> float:
    """The best of some calls: what others do meanwhile is not counted."""
    return best_seconds(call, rounds, time.process_time)


class Peer(NamedTuple):
    """Another way of rebuilding."""

    name: str  # What it is called in tables
    # From contours (m, n, 3) whose points correspond by number, upwards, to a closed mesh.
    build: Callable[[Floats], Mesh]


def loft(contours: Floats) -> Mesh:
    """Cubic splines through points of one number: periodic around, then upwards; plane ends."""
    return _closed(_loft_rings(contours, LOFT_ROWS, LOFT_COLUMNS))


def smoothed_loft(contours: Floats) -> Mesh:
    """The same with no more than 16 harmonics of each contour."""
    waves = np.fft.rfft(contours, axis=1)
    waves[:, HARMONICS + 1 :] = 0.0
    return loft(np.fft.irfft(waves, contours.shape[1], axis=1))


def radial_functions(contours: Floats) -> Mesh:
    """Zero of cubic radial functions that are known on the contours and a bit off them.

    The off-points lie along normals from differences between neighbours. Searched for outwards
    from the middle of each section, beginning at the loft; the ends are plane.
    """
    points = contours.reshape(-1, 3)
    size = float(np.ptp(points, axis=0).max())
    out = _normals(contours).reshape(-1, 3) * OFFSET * size
    places = np.concatenate([points, points + out, points - out])
    values = np.repeat([0.0, OFFSET * size, -OFFSET * size], len(points))
    field = RBFInterpolator(places, values, kernel="cubic")
    rings = _loft_rings(contours, FIELD_ROWS, FIELD_COLUMNS)
    outwards = rings - rings.mean(axis=1, keepdims=True)
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    return _closed(_zero(field, rings.reshape(-1, 3), outwards.reshape(-1, 3)).reshape(rings.shape))


def _loft_rings(contours: Floats, rows: int, columns: int) -> Floats:
    closed = np.concatenate([contours, contours[:, :1]], axis=1)
    return loft_rings(closed, contours[..., 2].mean(axis=1), rows, columns)


def _closed(rings: Floats) -> Mesh:
    return Mesh(*close_rings(rings[0].mean(axis=0), rings, rings[-1].mean(axis=0)))


def _zero(field: RBFInterpolator, start: Floats, way: Floats) -> Floats:
    """Where a field of about unit slope is 0 along ways (n, 3) from places (n, 3)."""
    before, value = np.zeros(len(start)), np.asarray(field(start))
    here = -value
    for _ in range(STEPS):
        found = np.asarray(field(start + here[:, None] * way))
        slope = np.divide(
            found - value, here - before, out=np.ones_like(here), where=here != before
        )
        before, value = here, found
        here = here - found / np.maximum(slope, 0.3)  # where it is flat, no wild step
    return start + here[:, None] * way


def shell_and_core(contours: Floats) -> Mesh:
    """The thesis's solid, corrected."""
    level = contours.copy()
    level[..., 2] = contours[..., 2].mean(axis=1, keepdims=True)
    return rebuild_thesis(level).mesh(LOFT_ROWS, LOFT_COLUMNS)


def poisson_surface(contours: Floats) -> Mesh:
    """A Poisson surface of the points, with normals from differences between neighbours."""
    return poisson(contours, _normals(contours))


def poisson(contours: Floats, normals: Floats) -> Mesh:
    """Surface of points (m, n, 3) with outward normals (m, n, 3); its ends are what it makes them.

    Raises
    ------
    ImportError
        If the package is not installed.
    """
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    cloud = pymeshlab.Mesh(
        vertex_matrix=contours.reshape(-1, 3), v_normals_matrix=normals.reshape(-1, 3)
    )
    meshes.add_mesh(cloud)
    meshes.generate_surface_reconstruction_screened_poisson(depth=OCTREE_DEPTH)
    found = meshes.current_mesh()
    return Mesh(
        np.asarray(found.vertex_matrix(), np.float64), np.asarray(found.face_matrix(), np.int32)
    )


def _normals(contours: Floats) -> Floats:
    around = np.roll(contours, -1, axis=1) - np.roll(contours, 1, axis=1)
    upwards = np.gradient(contours, axis=0)
    normals = np.cross(around, upwards)
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


LOFT, SMOOTHED = Peer("loft", loft), Peer("smoothed loft", smoothed_loft)
POISSON = Peer("Poisson surface", poisson_surface)
THESIS, RADIAL = Peer("thesis", shell_and_core), Peer("radial functions", radial_functions)
CASES = (
    PeerCase((27, 81), 0.0, (LOFT, THESIS), 0.85, 0.45, 2.0),
    PeerCase((27, 81), CONTOUR_NOISE, (SMOOTHED, LOFT), 0.78, 0.65, 3.0),
    PeerCase((24, 41), 0.0, (LOFT,), np.inf, 0.0, 2.0),
    PeerCase((24, 41), CONTOUR_NOISE, (SMOOTHED,), np.inf, 0.0, 3.0),
    PeerCase((9, 24), 0.0, (LOFT, RADIAL, THESIS), np.inf, 0.0, np.inf),
    PeerCase((9, 24), CONTOUR_NOISE, (SMOOTHED, RADIAL), 0.72, 0.0, np.inf),
)
