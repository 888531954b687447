"""A picture of a real object beside its solid, each coloured by how far it is from the other."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from palpate.bench.explore import Explored
from palpate.core import Floats
from palpate.core.geometry import nearest_points, nearest_search, sample_surface

SAMPLES, EVERY = 20_000, 2  # Places, and of these drawn
NEAR = 5e-3  # Of a touched point, m
VIEWS = ((20.0, 35.0), (20.0, 215.0), (75.0, 35.0))  # Elevation and azimuth, degrees
LEAST, MOST = 0.01, 5.0  # Ends of the colours, mm


class Deviations(NamedTuple):
    """What a picture shows, in numbers."""

    touched_rms: float  # Root mean square distance of places near a touched point, m
    covered: float  # Share of the true surface near a touched point


def draw_run(found: Explored, path: Path, title: str) -> Deviations:
    """Draw the last model of an exploration and its truth into a PNG file."""
    last, truth = found.models[-1], found.truth
    solid, real = last.vertices[last.faces], truth.vertices[truth.faces]
    rng = np.random.default_rng(0)
    on_real, on_solid = (sample_surface(one, SAMPLES, rng).points for one in (real, solid))
    to_solid = nearest_points(nearest_search(solid), on_real).distances
    to_real = nearest_points(nearest_search(real), on_solid).distances
    away = np.concatenate([_from_touch(last.vertices, last.vertex_distances, places)
                           for places in (on_real, on_solid)])  # fmt: skip
    every = np.concatenate([to_solid, to_real])
    near = away <= NEAR
    _draw(path, title, ((on_real, to_solid, "truth"), (on_solid, to_real, "rebuilt")))
    return Deviations(
        float(np.sqrt(np.mean(every[near] ** 2))) if near.any() else 0.0,
        float(near[: len(on_real)].mean()),
    )


def _from_touch(vertices: Floats, distances: Floats, places: Floats) -> Floats:
    """Distances (n,) of places from what was touched, at most: by way of the nearest vertex."""
    if not len(distances):
        return np.full(len(places), np.inf)
    way, number = cKDTree(vertices).query(places)
    return np.asarray(way + distances[number])


def _draw(path: Path, title: str, parts: tuple[tuple[Floats, Floats, str], ...]) -> None:
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 8), layout="constrained")
    figure.suptitle(f"{title}: distance from the other, mm")
    norm = LogNorm(LEAST, MOST)
    for row, (places, distances, name) in enumerate(parts):
        millimetres, colours = 1e3 * places[::EVERY], np.clip(1e3 * distances[::EVERY], LEAST, MOST)
        for column, (elevation, azimuth) in enumerate(VIEWS):
            axes = figure.add_subplot(2, len(VIEWS), 1 + row * len(VIEWS) + column, projection="3d")
            drawn = axes.scatter(*millimetres.T, c=colours, norm=norm, s=2, cmap="turbo")
            axes.view_init(elevation, azimuth)
            axes.set_aspect("equal")
            axes.set_title(name, fontsize=9)
            axes.tick_params(labelsize=6)
    figure.colorbar(drawn, ax=figure.axes, shrink=0.6)
    figure.savefig(path, dpi=80)
