"""Recognition of objects of the database in any pose, meshed anew and with noise.

Objects that are not in the database, half of them similar to one that is, must be rejected.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from palpate.bench.table import Row, at_least, at_most
from palpate.core import recognition, shapes
from palpate.core.poses import Pose
from palpate.nodes.specs.objects import build_shape
from palpate.tools.recognition.object_database import ObjectDatabase, load_models, load_objects


@dataclass(frozen=True, slots=True, kw_only=True)
class RecognitionSettings:
    """How many copies are recognised, and how they are made."""

    n_poses: int = 200  # of stored objects together
    n_unknown_poses: int = 40  # of other objects together
    level: int = 5  # of subdivision of the meshes; models are learned from this and a coarser one
    edges: tuple[float, float] = (1.9e-3, 2.4e-3)  # [m] range of longest edge; finer than learned
    seed: int = 26  # other than those of the copies from which models are learned
    min_recognised: float = 0.95  # share of stored objects
    max_false: float = 0.10  # share of other objects that are taken for a stored one


DEFAULT_RECOGNITION = RecognitionSettings()
QUICK_RECOGNITION = RecognitionSettings(n_poses=40, n_unknown_poses=10)


class Confusion(NamedTuple):
    """Counts of what each object is taken for."""

    pairs: Counter[tuple[str, str]]  # Of the object and the result of recognition
    seconds: float  # Median processor time of a description

    def share(self, test: Callable[[str, str], bool]) -> float:
        """Share of the trials whose object and result pass a test."""
        total = sum(self.pairs.values())
        return sum(n for pair, n in self.pairs.items() if test(*pair)) / total

    def mistakes(self) -> list[tuple[tuple[str, str], int]]:
        """Pairs that differ, with their counts, the most frequent first."""
        return [entry for entry in self.pairs.most_common() if entry[0][0] != entry[0][1]]


def recognition_rows(quick: bool) -> Iterable[Row]:
    """Summary of the confusion matrix; fewer poses if quick."""
    settings = QUICK_RECOGNITION if quick else DEFAULT_RECOGNITION
    stored = stored_confusion(settings)
    count, recognised = sum(stored.pairs.values()), stored.share(str.__eq__)
    yield at_least("stored objects recognised", recognised, settings.min_recognised, ".1%")
    yield Row("poses, of objects", f"{count}, {len({name for name, _ in stored.pairs})}")
    rejected = stored.share(lambda _, result: result == recognition.NONE)
    yield Row("stored objects taken for none of them", f"{rejected:.1%}")
    wrong = stored.share(lambda name, result: result not in (name, recognition.NONE))
    yield Row("stored objects taken for another", f"{wrong:.1%}")
    for (name, result), times in stored.mistakes()[:6]:
        yield Row(f"mistaken: {name} for {result}", f"{times}")
    yield Row("processor time of a description", f"{1e3 * stored.seconds:.0f} ms")
    unknown = unknown_confusion(settings)
    false = unknown.share(lambda _, result: result != recognition.NONE)
    yield at_most("other objects taken for a stored one", false, settings.max_false, ".1%")
    for (name, result), times in unknown.pairs.items():
        if result != recognition.NONE:
            yield Row(f"mistaken: {name} for {result}", f"{times}")


def stored_confusion(settings: RecognitionSettings = DEFAULT_RECOGNITION) -> Confusion:
    """Recognition of stored objects, in random order and poses."""
    meshes = {name: partial(stored_mesh, name, settings.level) for name in models().names}
    return _confusion(meshes, settings.n_poses, settings.seed, settings.edges)


def unknown_confusion(settings: RecognitionSettings = DEFAULT_RECOGNITION) -> Confusion:
    """Recognition of objects that are not stored."""
    objects = unknown_objects(settings.seed)
    meshes = {name: partial(solid.mesh, settings.level) for name, solid in objects.items()}
    return _confusion(meshes, settings.n_unknown_poses, settings.seed + 1, settings.edges)


def _confusion(
    meshes: Mapping[str, Callable[[], shapes.Mesh]],
    n_poses: int,
    seed: int,
    edges: tuple[float, float],
) -> Confusion:
    names, order = list(meshes), np.random.default_rng(seed)
    rounds = -(-n_poses // len(names))
    chosen = [names[i] for _ in range(rounds) for i in order.permutation(len(names))][:n_poses]
    pairs: Counter[tuple[str, str]] = Counter()
    seconds = []
    for number, name in enumerate(chosen):
        rng = np.random.default_rng((seed, number))
        copy = recognition.noisy_copy(meshes[name](), rng, edges=edges)
        begin = time.process_time()
        features = recognition.feature_vector(recognition.describe(*copy))
        seconds.append(time.process_time() - begin)
        pairs[name, recognition.recognise(features, models()).name] += 1
    return Confusion(pairs, float(np.median(seconds)))


@cache
def models() -> recognition.ObjectModels:
    """The models of the objects that are shipped with palpate."""
    learned = load_models(database())
    assert learned is not None
    return learned


@cache
def stored_mesh(name: str, level: int) -> shapes.Mesh:
    """A mesh of a stored object."""
    return build_shape(database().entries[name].object).mesh(level)


@cache
def database() -> ObjectDatabase:
    """The objects that are shipped with palpate."""
    return load_objects()


class UnknownObject(NamedTuple):
    """A solid that is not in the database."""

    shape: shapes.Superquadric | shapes.DeformedSuperquadric | shapes.BooleanShape | shapes.Shape
    scale: float = 1.0

    def mesh(self, level: int) -> shapes.Mesh:
        """Its mesh."""
        vertices, faces = self.shape.mesh(level)
        return shapes.Mesh(self.scale * vertices, faces)


@cache
def unknown_objects(seed: int = DEFAULT_RECOGNITION.seed) -> Mapping[str, UnknownObject]:
    """Ten objects that are similar to stored ones, and ten that are not."""
    entries, rng = database().entries, np.random.default_rng(seed)
    box, can = (0.1, 0.1), (0.1, 1.0)
    near = {
        "box 74 x 50 x 90": UnknownObject(_superquadric((0.037, 0.025, 0.045), box)),
        "can 60 x 95": UnknownObject(_superquadric((0.03, 0.03, 0.0475), can)),
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
        shapes.PosedSolid(_superquadric(size, (0.1, 1.0)), still)
        for size in ((outer, outer, half), (inner, inner, 2.0 * half))
    ]
    return shapes.BooleanShape(shapes.difference(*parts))
