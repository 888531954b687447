"""palpate beside a Gaussian process that explores by greatest variance, touch for touch.

Both feel the same objects with the same finger and the same noise, and both solids are measured
the same way. ``palpate bench explore --only peer`` runs it; by itself: ``python
benchmarks/gp_peer.py [--quick]``. One line of JSON for each figure.

What `Tuning` holds was chosen on the two objects in `TUNED`, with noise and 6 m of way: of a
Matern and a thin-plate kernel, of lengths from 0.35 to 2 of the object's extent, of 5 and 9 points
for each touch, and of nearer places preferred or not. These two are shown and do not count.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from gp_explore import Explorer, Tuning
from gp_finger import Finger

from palpate.core.measure.distance import Prepared, compare, prepare
from palpate.launch.bench_explore_scene import NOISES, Demand, write_scene
from palpate.launch.bench_explore_trial import Explored, explore_scene
from palpate.launch.bench_row import Row
from palpate.launch.explore_objects import OBJECTS
from palpate.launch.one_thread import one_thread
from palpate.launch.scene import load_scene
from palpate.nodes.object import build_shape

TUNED = ("ellipsoid", "groove")
COMPARED = ("egg", "box", "vase", "bottle", "twist", "hourglass")
QUICK = ("egg", "vase")
PLACE = {"exact": 0.0, "noise": 1e-4}
"""Standard deviation of a touch's place that the peer is told, m."""
TUNINGS = {"largest variance": Tuning(travel=0.0), "nearer preferred": Tuning()}
"""As it is published, and with a travel that counts, which serves it better."""
DEMANDED = "largest variance"
LEAST = 2.0
"""Times palpate's error, at the same way of the finger."""


class Found(NamedTuple):
    """What the peer came to; errors are root mean square, % of the object's height."""

    way: float
    """After at least as long a way of the finger as palpate's."""
    touches: float
    """And after at least as many touches too."""
    made: int
    """Touches that it makes on that way."""


Pair = tuple[Explored, dict[str, Found]]
"""palpate's run on one object, and the peer's by how it chooses."""


def pair(name: str, noise: str) -> Pair:
    """Explore one object in all ways."""
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder:
        scene = write_scene(Path(folder), OBJECTS[name], NOISES[noise], Demand())
        ours = explore_scene(scene)
        box = build_shape(load_scene(scene).spec.object).bounds()
        peers = {
            how: Explorer(Finger(scene), box, PLACE[noise], tuning)
            for how, tuning in TUNINGS.items()
        }
    truth = prepare(ours.truth.vertices, ours.truth.faces)
    return ours, {how: _found(peer, truth, ours) for how, peer in peers.items()}


def _found(peer: Explorer, truth: Prepared, ours: Explored) -> Found:
    made = peer.until(lambda state: state.way >= ours.travel).touches
    at_way = percent_off(peer, truth, ours)
    peer.until(lambda state: state.touches >= ours.touches)
    return Found(at_way, percent_off(peer, truth, ours), made)


def percent_off(peer: Explorer, truth: Prepared, ours: Explored) -> float:
    """Root mean square error of the peer's surface so far, % of the object's height."""
    return 100.0 * compare(truth, prepare(*peer.mesh())).rms / ours.truth.height


def rows(names: Sequence[str]) -> Iterator[Row]:
    """Figures, object by object, and their means: the tuned objects do not count."""
    for noise in NOISES:
        ratios: dict[str, list[tuple[float, float]]] = {how: [] for how in TUNINGS}
        for name in (*TUNED, *names):
            ours, peers = pair(name, noise)
            shown = f"{ours.percent:.3f} %, {ours.travel:.1f} m, {ours.touches}"
            yield Row(f"peer, {name}, {noise}: ours, way, touches", shown, "", True)
            for how, found in peers.items():
                shown = f"{found.way:.3f}, {found.touches:.3f} %, {found.made}"
                title = f"{how}: by way, by touches, made on the way"
                yield Row(title, shown, "", True)
                if name not in TUNED:
                    both = found.way / ours.percent, found.touches / ours.percent
                    ratios[how].append(both)
        for how, some in ratios.items():
            yield from _means(f"{noise}, {how}: over ours", some, demanded=how == DEMANDED)


def _means(title: str, ratios: list[tuple[float, float]], *, demanded: bool) -> Iterator[Row]:
    """Geometric means over the objects."""
    way, touches = np.exp(np.mean(np.log(ratios), axis=0)).tolist()
    target = f">= {LEAST:g} x" if demanded else ""
    yield Row(f"{title}, same way", f"{way:.2f} x", target, way >= LEAST or not demanded)
    yield Row(f"{title}, same touches", f"{touches:.2f} x", "", True)


def main() -> None:
    """Print each figure as soon as it is known."""
    with one_thread():
        for row in rows(QUICK if "--quick" in sys.argv[1:] else COMPARED):
            print(json.dumps(row._asdict()), flush=True)


if __name__ == "__main__":
    main()
