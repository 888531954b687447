"""Objects of the database in any pose, meshed anew, with noise: which they are taken for.

Beside them objects that are not in it, half of them near to one that is: to be none of them.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from palpate.bench.table import Row, at_least, at_most
from palpate.core import recognition, shapes
from palpate.core.poses import Pose
from palpate.nodes.specs.objects import build_shape
from palpate.tools.recognition.object_database import ObjectDatabase, load_models, load_objects

POSES, QUICK_POSES = 200, 40
UNKNOWN_POSES, QUICK_UNKNOWN_POSES = 40, 10
LEVEL = 5  # Of the meshes; learned are copies of this and of a coarser one
EDGES = (1.9e-3, 2.4e-3)  # Longest edges, m: all finer than those that were learned
SEED = 26  # Copies that are learned have others
LEAST_CORRECT, MOST_FALSE = 0.95, 0.10
BOX, CAN = (0.1, 0.1), (0.1, 1.0)


class Confusion(NamedTuple):
    """What objects were taken for."""

    pairs: Counter[tuple[str, str]]  # Of what it was and what it was taken for
    seconds: float  # Processor time of a description, median

    def share(self, test: Callable[[str, str], bool]) -> float:
        """Share of the trials of which this is true."""
        total = sum(self.pairs.values())
        return sum(n for pair, n in self.pairs.items() if test(*pair)) / total

    def worst(self) -> list[tuple[tuple[str, str], int]]:
        """Pairs that were mistaken, the most frequent first."""
        return [one for one in self.pairs.most_common() if one[0][0] != one[0][1]]


def recognition_rows(quick: bool) -> Iterable[Row]:
    """Summary of the matrix; fewer poses if quick."""
    found = stored_confusion(QUICK_POSES if quick else POSES)
    count = sum(found.pairs.values())
    yield at_least("stored objects recognised", found.share(str.__eq__), LEAST_CORRECT, ".1%")
    yield Row("poses, of objects", f"{count}, {len(set(one for one, _ in found.pairs))}")
    rejected = found.share(lambda _, told: told == recognition.NONE)
    yield Row("stored objects taken for none of them", f"{rejected:.1%}")
    wrong = found.share(lambda was, told: told not in (was, recognition.NONE))
    yield Row("stored objects taken for another", f"{wrong:.1%}")
    for (was, told), many in found.worst()[:6]:
        yield Row(f"mistaken: {was} for {told}", f"{many}")
    yield Row("processor time of a description", f"{1e3 * found.seconds:.0f} ms")
    found = unknown_confusion(QUICK_UNKNOWN_POSES if quick else UNKNOWN_POSES)
    false = found.share(lambda _, told: told != recognition.NONE)
    yield at_most("other objects taken for a stored one", false, MOST_FALSE, ".1%")
    for (was, told), many in found.pairs.items():
        if told != recognition.NONE:
            yield Row(f"mistaken: {was} for {told}", f"{many}")


def stored_confusion(poses: int, seed: int = SEED) -> Confusion:
    """The stored objects, in turns that chance orders, in so many poses."""
    meshes = {name: lambda name=name: stored_mesh(name) for name in models().names}
    return _confusion(meshes, poses, seed)


def unknown_confusion(poses: int, seed: int = SEED + 1) -> Confusion:
    """Objects that are not stored, in so many poses."""
    return _confusion({name: made.mesh_of for name, made in unknown_objects().items()}, poses, seed)


def _confusion(meshes: Mapping[str, Callable[[], shapes.Mesh]], poses: int, seed: int) -> Confusion:
    names, order = list(meshes), np.random.default_rng(seed)
    rounds = -(-poses // len(names))
    chosen = [names[i] for _ in range(rounds) for i in order.permutation(len(names))][:poses]
    pairs: Counter[tuple[str, str]] = Counter()
    seconds = []
    for number, name in enumerate(chosen):
        rng = np.random.default_rng((seed, number))
        copy = recognition.noisy_copy(meshes[name](), rng, edges=EDGES)
        begin = time.process_time()
        features = recognition.feature_vector(recognition.describe(*copy))
        seconds.append(time.process_time() - begin)
        pairs[name, recognition.recognise(features, models()).name] += 1
    return Confusion(pairs, float(np.median(seconds)))


@cache
def models() -> recognition.ObjectModels:
    """What is learned of the objects that come with palpate."""
    found = load_models(database())
    assert found is not None
    return found


@cache
def stored_mesh(name: str) -> shapes.Mesh:
    """A fine mesh of a stored object."""
    return build_shape(database().entries[name].object).mesh(LEVEL)


@cache
def database() -> ObjectDatabase:
    """The objects that come with palpate."""
    return load_objects()


class UnknownObject(NamedTuple):
    """A solid that is not in the database."""

    shape: shapes.Superquadric | shapes.DeformedSuperquadric | shapes.BooleanShape | shapes.Shape
    scale: float = 1.0

    def mesh_of(self) -> shapes.Mesh:
        """A fine mesh of it."""
        vertices, faces = self.shape.mesh(LEVEL)
        return shapes.Mesh(self.scale * vertices, faces)


@cache
def unknown_objects() -> Mapping[str, UnknownObject]:
    """Ten that are near to stored ones, ten that are not."""
    entries, rng = database().entries, np.random.default_rng(SEED)
    near = {
        "box 74 x 50 x 90": UnknownObject(_superquadric((0.037, 0.025, 0.045), BOX)),
        "can 60 x 95": UnknownObject(_superquadric((0.03, 0.03, 0.0475), CAN)),
        "ball of 77": UnknownObject(_superquadric((0.0385, 0.0385, 0.0385), (1.0, 1.0))),
        "cube of 53": UnknownObject(_superquadric((0.0265, 0.0265, 0.0265), (0.06, 0.06))),
        "tube with thicker walls": UnknownObject(_tube(0.025, 0.0175, 0.06)),
        "ring, wider": UnknownObject(_tube(0.027, 0.021, 0.015)),
    }
    for name in ("gem", "bottle", "mug", "vase"):
        larger = UnknownObject(build_shape(entries[name].object), 1.04)
        near[f"{name}, 4 % larger"] = larger
    far = {}
    for number in range(9):
        size, exponents = rng.uniform(0.015, 0.06, 3), rng.uniform(0.15, 1.6, 2)
        taper = rng.uniform(-0.5, 0.5, 2)
        base = shapes.Superquadric(size, exponents)
        solid = shapes.DeformedSuperquadric(base, taper, shapes.Bend(0.0))
        far[f"tapered superquadric {number}"] = UnknownObject(solid)
    far["thick ring"] = UnknownObject(_tube(0.05, 0.03, 0.02))
    return near | far


def _superquadric(
    size: tuple[float, float, float], exponents: tuple[float, float]
) -> shapes.Superquadric:
    return shapes.Superquadric(np.array(size), np.array(exponents))


def _tube(outer: float, inner: float, half: float) -> shapes.BooleanShape:
    still = Pose(np.zeros(3), np.eye(3))
    parts = [
        shapes.PosedSolid(_superquadric(size, CAN), still)
        for size in ((outer, outer, half), (inner, inner, 2.0 * half))
    ]
    return shapes.BooleanShape(shapes.difference(*parts))
