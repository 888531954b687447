"""Whether a solid may leave the reconstructor: what was touched and swept must not contradict it.

A final solid must also lie as near to the last solid on the way as the error bound says that was
stated for that one; otherwise the bound would hold for neither.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore import SpaceMap
from palpate.core.geometry import (
    areas_and_normals,
    compare_surfaces,
    nearest_points,
    point_tree,
    prepare_surface,
)
from palpate.core.rebuild import surface
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general import touch_squares
from palpate.core.shapes import Mesh
from palpate.nodes.rebuilding.volume import MeshVolume


@dataclass(frozen=True, slots=True)
class SoundnessSettings:
    """What a solid may contradict before it is rejected.

    Single touches err, for a pad bridges hollows and edges: so a solid is rejected for a share of
    them. The offset is compared with the solid's own stated deviation.
    """

    # Fraction of the touched extent; an end may go on where untouched; infinite: no limit, nor that
    # of the explored space.
    max_overhang: float = 0.5
    max_swept_depth: float = 5.0e-3  # [m] depth inside the solid at which a finger has been
    min_touch_offset: float = 1.0e-3  # [m] distance of a touch from the surface that is tolerated
    max_deviations: float = 6.0  # of the solid's stated deviation: the same
    max_contradicted: float = 0.05  # fraction of the touches that may lie farther off
    max_missing_offset: float = 5.0e-3  # [m] a touch farther off has met surface that is missing,
    touched_area: float = 1.0e-4  # [m^2] and this much of it
    n_samples: int = 4000  # places of each surface at which two solids are compared


def faults_of(
    volume: MeshVolume,
    deviation: float | None,
    touched: ContactPoints,
    space: SpaceMap | None,
    settings: SoundnessSettings = SoundnessSettings(),
    swept: Floats | None = None,
) -> tuple[str, ...]:
    """What contradicts a solid, a sentence each; empty if nothing does.

    `deviation`: standard deviation that the solid states of itself [m], None if it states none.
    `touched`: all that touched it. `space`: what fingers have swept; None where nobody knows.
    `swept`: the places (n, 3) of these that count [m]; None for all.
    """
    if swept is None:
        swept = np.zeros((0, 3)) if space is None else space.free_places()
    return tuple(_faults(volume, deviation, touched, space, settings, swept))


def _faults(
    volume: MeshVolume,
    deviation: float | None,
    touched: ContactPoints,
    space: SpaceMap | None,
    settings: SoundnessSettings,
    swept: Floats,
) -> Iterator[str]:
    vertices = volume.mesh.vertices
    if not np.isfinite(vertices).all() or not np.isfinite(deviation or 0.0):
        yield "its surface or its error is not finite"
        return
    is_bounded = math.isfinite(settings.max_overhang)
    beyond = _overhang(vertices, touched.points, space, settings) if is_bounded else 0.0
    if beyond > 0.0:
        yield f"it reaches {1e3 * beyond:.1f} mm beyond the space that was explored"
    if _is_swept(volume, swept, settings):
        yield "a finger has passed through what it encloses"
    allowed = max(settings.min_touch_offset, settings.max_deviations * (deviation or 0.0))
    share = _contradicted(volume, touched, allowed)
    if share > settings.max_contradicted:
        yield f"{100.0 * share:.0f} % of the touches lie over {1e3 * allowed:.1f} mm off it"


def _overhang(
    vertices: Floats, points: Floats, space: SpaceMap | None, settings: SoundnessSettings
) -> float:
    """How far vertices (n, 3) reach beyond what was touched, or a finger's reach [m]; 0 if not."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    beyond = [0.0]
    if len(points):
        least, most = points.min(axis=0), points.max(axis=0)
        margin = settings.max_overhang * float((most - least).max())
        beyond += [float((least - margin - low).max()), float((high - most - margin).max())]
    if space is not None:
        top = space.low + space.step * np.array(space.states.shape)
        beyond += [float((space.low - space.step - low).max()), float((high - top).max())]
    return max(beyond)


def _is_swept(volume: MeshVolume, swept: Floats, settings: SoundnessSettings) -> bool:
    """Whether a finger has been deep inside a solid, which is then hollow there."""
    deep, vertices = settings.max_swept_depth, volume.mesh.vertices
    low, high = vertices.min(axis=0) + deep, vertices.max(axis=0) - deep
    inner = swept[((swept > low) & (swept < high)).all(axis=1)]
    return bool(volume.depths(inner).max(initial=0.0) > deep)


def _contradicted(volume: MeshVolume, touched: ContactPoints, allowed: float) -> float:
    """Share of the touches whose points lie farther from the surface, root mean square [m]."""
    if not len(touched.points):
        return 0.0
    off = nearest_points(volume.search, touched.points).distances
    return float((touch_squares(touched, off) > allowed**2).mean())


def missing_error(
    volume: MeshVolume,
    touched: ContactPoints,
    settings: SoundnessSettings = SoundnessSettings(),
) -> float:
    """Root mean square error that surface makes which a solid lacks, over all of it [m].

    Distances from the solid tell nothing of a part that it has not; touches far off it do.
    """
    if not len(touched.points) or not len(volume.mesh.faces):
        return 0.0
    order = np.argsort(touched.touch, kind="stable")
    _, first, counts = np.unique(touched.touch[order], return_index=True, return_counts=True)
    middles = touched.points[order[first + counts // 2]]
    # A point near a vertex is near the surface: only the others need the exact distance.
    vertices, near = point_tree(volume.mesh.vertices), settings.max_missing_offset
    off = np.asarray(vertices.query(middles, distance_upper_bound=near)[0])
    if np.isinf(off).any():
        off = nearest_points(volume.search, middles[np.isinf(off)]).distances
    area = float(areas_and_normals(volume.mesh.vertices[volume.mesh.faces])[0].sum())
    squares = off[off > settings.max_missing_offset] ** 2
    return math.sqrt(float(squares.sum()) * settings.touched_area / area)


def lacks(volume: MeshVolume, touched: ContactPoints, bound: float) -> tuple[str, ...]:
    """Whether touches show a solid to lack more than its error bound [m] allows, in a sentence."""
    missing = missing_error(volume, touched)
    if missing <= bound:
        return ()
    return (
        f"touches show that it lacks surface of {1e3 * missing:.3g} mm rms, and the error bound is "
        f"{1e3 * bound:.3g} mm",
    )


def departure(
    mesh: Mesh | surface.SurfaceMesh,
    draft: Mesh | surface.SurfaceMesh,
    bound: float | None,
    settings: SoundnessSettings = SoundnessSettings(),
) -> tuple[str, ...]:
    """Whether a solid lies farther from its draft than the bound stated for that [m] allows."""
    if bound is None or not len(mesh.faces) or not len(draft.faces):
        return ()
    final, drafted = (
        prepare_surface(each.vertices, each.faces, settings.n_samples) for each in (mesh, draft)
    )
    rms = compare_surfaces(final, drafted).rms
    if rms <= bound:
        return ()
    return (
        f"it lies {1e3 * rms:.3g} mm rms from the last model on the way, "
        f"whose error bound is {1e3 * bound:.3g} mm",
    )
