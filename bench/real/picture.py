"""A picture of a real object beside its solid, each coloured by how far it is from the other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from palpate.bench.explore import Explored
from palpate.core import Floats
from palpate.core.geometry import areas_and_normals, nearest_points, nearest_search, sample_surface

SAMPLES = 20_000  # Places on each surface
NEAR = 5e-3  # Of a touched point, m
VIEWS = ((20.0, 35.0), (20.0, 215.0), (75.0, 35.0), (-60.0, 35.0))  # Elevation, azimuth, degrees
LEAST, MOST = 0.01, 5.0  # Ends of the colours, mm


class _Side(NamedTuple):
    """One of two surfaces that are compared."""

    name: str
    places: Floats  # (n, 3), m
    normals: Floats  # Outward, (n, 3)
    distances: Floats  # From the other, (n,), m


class Deviations(NamedTuple):
    """What a picture shows, in numbers."""

    touched_rms: float  # Root mean square distance of places near a touched point, m
    covered: float  # Share of the true surface near a touched point


def draw_run(found: Explored, path: Path, title: str) -> Deviations:
    """Draw the last model of an exploration and its truth into a PNG file."""
    last, truth = found.models[-1], found.truth
    solid, real = last.vertices[last.faces], truth.vertices[truth.faces]
    rng = np.random.default_rng(0)
    sides = []
    for name, one, other in (("truth", real, solid), ("rebuilt", solid, real)):
        places, faces = sample_surface(one, SAMPLES, rng)
        distances = nearest_points(nearest_search(other), places).distances
        sides.append(_Side(name, places, areas_and_normals(one)[1][faces], distances))
    _draw(path, title, sides)
    away = [_from_touch(last.vertices, last.vertex_distances, side.places) for side in sides]
    near = np.concatenate(away) <= NEAR
    every = np.concatenate([side.distances for side in sides])
    touched = float(np.sqrt(np.mean(every[near] ** 2))) if near.any() else 0.0
    return Deviations(touched, float(near[:SAMPLES].mean()))


def _from_touch(vertices: Floats, distances: Floats, places: Floats) -> Floats:
    """Distances (n,) of places from what was touched, at most: by way of the nearest vertex."""
    if not len(distances):
        return np.full(len(places), np.inf)
    way, number = cKDTree(vertices).query(places)
    return np.asarray(way + distances[number])


def _draw(path: Path, title: str, sides: Sequence[_Side]) -> None:
    """What of both faces the viewer, from all around and from below."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 8), layout="constrained")
    figure.suptitle(f"{title}: distance from the other, mm")
    norm, count = LogNorm(LEAST, MOST), len(VIEWS)
    for number, (side, (elevation, azimuth)) in enumerate(product(sides, VIEWS), start=1):
        up, turn = np.radians([elevation, azimuth])
        towards = np.array([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
        seen = side.normals @ towards > 0.0
        colours = np.clip(1e3 * side.distances[seen], LEAST, MOST)
        axes = figure.add_subplot(len(sides), count, number, projection="3d")
        drawn = axes.scatter(*1e3 * side.places[seen].T, c=colours, norm=norm, s=2, cmap="turbo")
        axes.view_init(elevation, azimuth)
        axes.set_aspect("equal")
        axes.set_title(side.name, fontsize=9)
        axes.tick_params(labelsize=6)
    figure.colorbar(drawn, ax=figure.axes, shrink=0.6)
    figure.savefig(path, dpi=80)
