"""Checks of a solid before it is published: touches and swept space must not contradict it.

The rms distance of a final solid from the last draft must also be within the error bound that was
stated for the draft; otherwise the bound may be wrong for both.
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
    """Limits beyond which a solid is rejected; larger values accept more solids.

    A single touch may be wrong, since a pad bridges hollows and edges; so a solid is rejected only
    if a share of the touches contradicts it.
    """

    # How far the solid may reach beyond the contacts [fraction of their largest extent]. If it is
    # infinite, the solid may also reach beyond the explored space.
    max_overhang: float = 0.5
    max_swept_depth: float = 5.0e-3  # depth inside the solid to which a finger may have swept [m]
    min_touch_offset: float = 1.0e-3  # rms distance from the surface that any touch may have [m]
    max_deviations: float = 6.0  # allowed distance of a touch, if larger [stated deviations]
    max_contradicted: float = 0.05  # fraction of the touches that may lie farther off than both
    max_missing_offset: float = 5.0e-3  # beyond this distance a touch shows missing surface [m]
    touched_area: float = 1.0e-4  # area of missing surface that each such touch stands for [m^2]
    n_samples: int = 4000  # sampled points of each surface when two solids are compared


def faults_of(
    volume: MeshVolume,
    deviation: float | None,
    touched: ContactPoints,
    space: SpaceMap | None,
    settings: SoundnessSettings = SoundnessSettings(),
    swept: Floats | None = None,
) -> tuple[str, ...]:
    """Contradictions between a solid and the measurements, a sentence each; empty if none.

    `deviation`: stated standard deviation of the surface [m]; None if there is none. `touched`: all
    contacts. `space`: map of the swept space; None if unknown. `swept`: swept places (n, 3) that
    must lie outside the solid [m]; None for all places of `space`.
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
    overhang = _overhang(vertices, touched.points, space, settings) if is_bounded else 0.0
    if overhang > 0.0:
        yield f"it reaches {1e3 * overhang:.1f} mm beyond the space that was explored"
    if _is_swept(volume, swept, settings):
        yield "a finger has passed through what it encloses"
    allowed = max(settings.min_touch_offset, settings.max_deviations * (deviation or 0.0))
    share = _contradicted(volume, touched, allowed)
    if share > settings.max_contradicted:
        yield f"{100.0 * share:.0f} % of the touches lie over {1e3 * allowed:.1f} mm off it"


def _overhang(
    vertices: Floats, points: Floats, space: SpaceMap | None, settings: SoundnessSettings
) -> float:
    """Distance of vertices (n, 3) beyond the allowed box around contacts or the map [m], or 0."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    overhangs = [0.0]
    if len(points):
        lower, upper = points.min(axis=0), points.max(axis=0)
        margin = settings.max_overhang * float((upper - lower).max())
        overhangs += [float((lower - margin - low).max()), float((high - upper - margin).max())]
    if space is not None:
        top = space.low + space.step * np.array(space.states.shape)
        overhangs += [float((space.low - space.step - low).max()), float((high - top).max())]
    return max(overhangs)


def _is_swept(volume: MeshVolume, swept: Floats, settings: SoundnessSettings) -> bool:
    """Whether a finger has swept places deep inside the solid, which contradicts it."""
    deep, vertices = settings.max_swept_depth, volume.mesh.vertices
    low, high = vertices.min(axis=0) + deep, vertices.max(axis=0) - deep
    inner = swept[((swept > low) & (swept < high)).all(axis=1)]
    return bool(volume.depths(inner).max(initial=0.0) > deep)


def _contradicted(volume: MeshVolume, touched: ContactPoints, allowed: float) -> float:
    """Share of the touches with an rms distance from the surface above `allowed` [m]."""
    if not len(touched.points):
        return 0.0
    off = nearest_points(volume.search, touched.points).distances
    return float((touch_squares(touched, off) > allowed**2).mean())


def missing_error(
    volume: MeshVolume,
    touched: ContactPoints,
    settings: SoundnessSettings = SoundnessSettings(),
) -> float:
    """Root mean square error over the whole surface that missing parts of a solid cause [m].

    The expected errors of a solid do not cover parts that it lacks; touches far from it show them.
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


def lacks(
    volume: MeshVolume,
    touched: ContactPoints,
    bound: float,
    settings: SoundnessSettings = SoundnessSettings(),
) -> tuple[str, ...]:
    """A sentence if the error of missing parts exceeds the error bound [m]; empty if not."""
    missing = missing_error(volume, touched, settings)
    if missing <= bound:
        return ()
    return (
        f"touches show that missing parts cause an error of {1e3 * missing:.3g} mm rms, and the "
        f"error bound is {1e3 * bound:.3g} mm",
    )


def departure(
    mesh: Mesh | surface.SurfaceMesh,
    draft: Mesh | surface.SurfaceMesh,
    bound: float | None,
    settings: SoundnessSettings = SoundnessSettings(),
) -> tuple[str, ...]:
    """A sentence if the rms distance of a solid from its draft exceeds the draft's bound [m]."""
    if bound is None or not len(mesh.faces) or not len(draft.faces):
        return ()
    final, drafted = (
        prepare_surface(solid.vertices, solid.faces, settings.n_samples) for solid in (mesh, draft)
    )
    rms = compare_surfaces(final, drafted).rms
    if rms <= bound:
        return ()
    return (
        f"its rms distance from the last draft is {1e3 * rms:.3g} mm, "
        f"and the error bound of that is {1e3 * bound:.3g} mm",
    )
