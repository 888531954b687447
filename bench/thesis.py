"""The thesis's reconstruction and ours, on its two examples and on recordings.

The examples stand in for the two objects that the thesis only draws: one turned and lobed, with
27 contours of 81 points at even heights, one smoother, with 24 contours of 41 points. The first
point of each contour comes again at its end, and each begins at azimuth -pi, as the thesis's
program needs. Errors are over the height, of the whole solid; `side` counts from the first contour
to the last alone, for nobody has told the thesis where an end is.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.bench.explored import closed_mesh
from palpate.bench.rebuilt import (
    WAVY,
    MeshErrors,
    RoundObject,
    TrueSurface,
    loft_rings,
    truth_of_mesh,
)
from palpate.bench.table import MOST_SECONDS, Figure, best_seconds, figure_of
from palpate.core import thesis
from palpate.core.arrays import Floats
from palpate.core.explore.planners import TRIAL, PlannerTrial, Thesis, run_planner
from palpate.core.geometry import nearest_points, prepare_surface, solidity
from palpate.core.poses import Pose
from palpate.core.rebuild import reconstruct
from palpate.core.rebuild.contours import into_frame
from palpate.core.shapes import Mesh
from palpate.launch.files.point_clouds import MeasuredContours
from palpate.launch.files.points_file import read_points
from palpate.launch.files.source_map import InputError, as_input_errors
from palpate.launch.run_directory import find_bag
from palpate.messages import decode
from palpate.messages.recording import open_recording
from palpate.messages.types import Truth
from palpate.tools.reconstruction import single_threaded

EXAMPLE_NOISE = 0.005  # Of the object's height, along x and y
EXAMPLE_HEIGHT = 2.0  # Of both examples; all figures are over it, so its unit does not matter
MESH_ROWS, MESH_COLUMNS = 161, 240  # Of the meshes that are compared
TRUE_ROWS, TRUE_COLUMNS = 401, 720
FLOOR_ROWS, FLOOR_COLUMNS = 301, 541  # Of the truth, and of its other mesh: what measuring adds
COLUMNS = ("chamfer", "rms", "side", "normals", "volume", "time")
HEAD = f"{'':<48}" + "".join(f"{one:>10}" for one in COLUMNS)
SCENES, QUICK_SCENES = ("egg", "vase", "notched"), ("vase",)  # Plain, featured, sharp
AROUND = 80  # Points of a recorded contour as the thesis gets it, at even azimuths
ROUNDS = 2  # The better of which is the time
STEPS = np.geomspace(0.03, 0.3, 400)  # Largest steps among which the 24 contours are looked for
ANY_ERROR = 0.5  # The thesis's rule does not look at what is asked for
LEAST_SHARE = 0.25  # Of the largest step: the smallest


class ThesisFigures(NamedTuple):
    """One way from contours to a solid, against the truth."""

    name: str  # Of the object, and of the way
    errors: MeshErrors  # Over the height
    side: float | None = None  # Root mean square error between the outermost contours, the same
    seconds: float | None = None  # From contours to mesh
    most: float = np.inf  # Chamfer distance that is demanded

    @property
    def holds(self) -> bool:
        """Whether the demand is met."""
        return self.errors.chamfer <= self.most

    @property
    def figures(self) -> Sequence[Figure]:
        """Errors and time."""
        errors, side, unit = self.errors, self.side, "% of height"
        lengths = {"chamfer": errors.chamfer, "rms": errors.rms, "side": side}
        timed = [] if self.seconds is None else [figure_of(1e3 * self.seconds, "ms", name="time")]
        return (
            *(figure_of(100.0 * v, unit, name=n) for n, v in lengths.items() if v is not None),
            figure_of(errors.normal_deg, "deg", name="normals"),
            figure_of(100.0 * errors.volume, "%", name="volume"),
            *timed,
        )

    def __str__(self) -> str:
        errors, missed = self.errors, "" if self.holds else f"  <= {self.most:.2%}   MISSED"
        side = "" if self.side is None else f"{self.side:.3%}"
        time = "" if self.seconds is None else f"{1e3 * self.seconds:.0f} ms"
        lengths = f"{errors.chamfer:>10.3%}{errors.rms:>10.3%}{side:>10}"
        rest = f"{errors.normal_deg:>6.1f} deg{errors.volume:>+10.1%}{time:>10}"
        return f"{self.name:<48}{lengths}{rest}{missed}".rstrip()


class ThesisVariant(NamedTuple):
    """A way from contours to a mesh."""

    name: str  # What it is called in the table
    build: Callable[[Floats], Mesh]  # Contours (m, n, 3) to a mesh
    most: float = np.inf  # Chamfer distance that is demanded; infinite for comparison only


def thesis_rows(quick: bool) -> Iterator[ThesisFigures | str]:
    """Errors and times of both examples, of the second with its own steps, and with noise."""
    yield HEAD
    with single_threaded():
        for example in EXAMPLES:
            yield from _example_rows(example, example.contours(), VARIANTS)
        for short in (False, True):
            example = stepped_example(short=short)
            ways = (way._replace(most=np.inf) for way in VARIANTS)
            yield from _example_rows(example, example.contours(), tuple(ways))
        noisy = FIRST._replace(name=f"{FIRST.name}, noise")
        yield from _example_rows(noisy, with_noise(FIRST.contours()), NOISY_VARIANTS)


def _example_rows(
    example: Example, contours: Floats, ways: Sequence[ThesisVariant]
) -> Iterator[ThesisFigures]:
    truth = example_truth(example)
    floor = truth.errors_of(example.mesh(FLOOR_ROWS, FLOOR_COLUMNS))
    yield ThesisFigures(f"{example.name}: floor", floor)
    points = truth.surface.samples.points
    low, high = example.heights[[0, -1]]
    side = points[(points[:, 2] >= low) & (points[:, 2] <= high)]
    for way in ways:
        name, build = f"{example.name}: {way.name}", partial(way.build, contours)
        yield judge(name, truth, side, build)._replace(most=way.most)


def judge(name: str, truth: TrueSurface, side: Floats, build: Callable[[], Mesh]) -> ThesisFigures:
    """Errors and time of a way; `side` (n, 3): points of the truth between outermost contours."""
    meshes = []
    seconds = best_seconds(lambda: meshes.append(build()), ROUNDS)
    far = nearest_points(prepare_surface(*meshes[0]).search, side).distances
    rms = float(np.sqrt((far**2).mean())) / truth.unit
    return ThesisFigures(name, truth.errors_of(meshes[0]), rms, seconds)


def example_truth(example: Example) -> TrueSurface:
    """The example's own surface, finely meshed; errors are over its height."""
    return truth_of_mesh(example.mesh(TRUE_ROWS, TRUE_COLUMNS), EXAMPLE_HEIGHT)


def with_noise(contours: Floats) -> Floats:
    """Contours (m, n, 3) with noise across the axis, still closed."""
    noisy = contours.copy()
    rng = np.random.default_rng(0)
    noisy[:, :-1, :2] += EXAMPLE_HEIGHT * EXAMPLE_NOISE * rng.normal(size=noisy[:, :-1, :2].shape)
    noisy[:, -1] = noisy[:, 0]
    return noisy


class Example(NamedTuple):
    """An object, and the contours that were traced of it."""

    name: str  # What it is called in tables and files
    shape: RoundObject
    heights: Floats  # Of its contours, (m,), upwards
    around: int  # Points of a contour, the first twice

    def contours(self) -> Floats:
        """What a perfect finger traces, (m, around, 3)."""
        return self.shape.rings(self.heights, np.linspace(-np.pi, np.pi, self.around))

    def mesh(self, rows: int, columns: int) -> Mesh:
        """The object itself, with plane ends."""
        azimuths = 2.0 * np.pi * np.arange(columns) / columns
        return closed_mesh(self.shape.rings(np.linspace(-1.0, 1.0, rows), azimuths))


@cache
def stepped_example(*, short: bool) -> Example:
    """Example 2 with the heights that the thesis's own planner chooses, (3.1) and (3.2).

    The text gives no constants: the largest step, with the smallest a quarter of it, is the first
    that comes to its 24 contours. (3.1) knows nothing of either; `short`: its eta is chosen so that
    the first step is no longer than the others, else it is 1.
    """
    count, eta = len(SECOND.heights), "eta fitted" if short else "eta 1"
    trial = PlannerTrial(lambda z, t: 0.5 * SECOND.shape.radius(2.0 * z - 1.0, t))
    for most in STEPS.tolist():
        caution = max(0.5 / most - 1.0, 0.0) if short else 1.0
        rule = Thesis(least=LEAST_SHARE * most, most=most, caution=caution)
        slices, _ = run_planner(rule, trial, ANY_ERROR, most=count + 1)
        if len(slices) == count:
            heights = 2.0 * np.sort([one.height for one in slices]) / TRIAL.extent - 1.0
            return SECOND._replace(name=f"{SECOND.name}, own steps, {eta}", heights=heights)
    raise ValueError(f"no step gives {count} contours of {SECOND.name}")


def _solid(contours: Floats, **how: Any) -> Mesh:
    return thesis.rebuild_thesis(contours, **how).mesh(MESH_ROWS, MESH_COLUMNS)


def _with_spline(contours: Floats) -> Mesh:
    solid = thesis.rebuild_thesis(contours)
    solid = dataclasses.replace(solid, triples=thesis.interpolated_parameters(solid.parameters))
    return solid.mesh(MESH_ROWS, MESH_COLUMNS)


def spline_loft(contours: Floats) -> Mesh:
    """The plain way: a loft of contours that end with their first point again; plane ends."""
    return closed_mesh(loft_rings(contours, contours[:, 0, 2], MESH_ROWS, MESH_COLUMNS))


def _ours(contours: Sequence[Floats] | Floats, *seen: Any, **how: Any) -> Mesh:
    mesh = reconstruct(list(contours), *seen, **how).mesh()
    return Mesh(mesh.vertices, mesh.faces)


def _skin(contours: Floats) -> Mesh:
    return _ours(contours[:, :-1], method="skin")


def _smooth(height: Floats, azimuth: Floats) -> Floats:
    outline = (1.02 - height**2) ** 0.35 * (0.8 + 0.1 * height)
    return np.asarray(outline * (1.0 + 0.15 * np.cos(2.0 * azimuth)))


def recorded_rows(quick: bool, runs: Sequence[Path] = ()) -> Iterator[ThesisFigures | str]:
    """The thesis's way and ours on the same recordings; a few are made here if none are given.

    Raises InputError if one cannot be read, holds too little, or does not hold the truth.
    """
    for run in runs:
        find_bag(run)
    yield HEAD
    with tempfile.TemporaryDirectory(prefix="palpate-bench-") as folder, single_threaded():
        for scene in () if runs else QUICK_SCENES if quick else SCENES:
            run_scene(scene, Path(folder) / scene)
            yield from rebuilt_rows(Path(folder) / scene)
        for run in runs:
            yield from rebuilt_rows(run)


def run_scene(scene: str, out: Path) -> None:
    """Run a scene as a user does, in a process of its own.

    Raises RuntimeError, with what it printed, if it does not come to its end.
    """
    command = [sys.executable, "-m", "palpate", "run", scene, "--out", str(out), "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=MOST_SECONDS)
    if done.returncode not in (0, 1):  # 1 is a demand that was missed
        raise RuntimeError(f"{scene} ended with {done.returncode}: {done.stderr.strip()}")


def rebuilt_rows(run: Path) -> Iterator[ThesisFigures]:
    """One recording rebuilt in four ways, and what measuring alone adds."""
    truth, found = read_truth(run), read_points(run)
    whole = TrueSurface(
        prepare_surface(truth.vertices, truth.faces),
        solidity(truth.vertices, truth.faces).volume, 0.0, truth.height,
    )  # fmt: skip
    heights = [float(into_frame(found.frame, one)[:, 2].mean()) for one in found.contours]
    samples = whole.surface.samples.points
    levels = into_frame(found.frame, samples)[:, 2]
    side = samples[(levels >= min(heights)) & (levels <= max(heights))]
    floor = whole.errors_of(Mesh(truth.floor_vertices, truth.floor_faces))
    yield ThesisFigures(f"{run.name}: floor", floor)
    for name, build in RECORDED_WAYS.items():
        try:
            yield judge(f"{run.name}: {name}", whole, side, partial(build, found))
        except ValueError as error:
            raise InputError(f"{run}: cannot be rebuilt by {name}: {error}") from None


def read_truth(run: Path) -> Truth:
    """The truth of a recording; raises InputError if it holds none."""
    path = find_bag(run)
    with as_input_errors():
        for one in open_recording(path).messages():
            if one.topic == "/truth":
                return decode(Truth, one.body)
    raise InputError(f"{run}: holds no /truth to compare with: the object was a real one")


def _recorded_thesis(found: MeasuredContours, *, faithful: bool) -> Mesh:
    """Contours as its program takes them: level, from azimuth -pi on, as many points each."""
    azimuths, rings = thesis.ray_azimuths(AROUND), []
    for contour in found.contours:
        points = into_frame(found.frame, contour)
        ring = thesis.match_contour(points[:, :2], azimuths).points
        rings.append(np.column_stack([ring, np.full(AROUND, points[:, 2].mean())]))
    stack = np.stack(rings)
    stack = stack[np.argsort(stack[:, 0, 2])]
    mesh = _solid(np.concatenate([stack, stack[:, :1]], axis=1), faithful=faithful)
    if found.frame is None:
        return mesh
    return Mesh(Pose.from_array(found.frame).to_outer(mesh.vertices), mesh.faces)


RECORDED_WAYS: dict[str, Callable[[MeasuredContours], Mesh]] = {
    "thesis, program": partial(_recorded_thesis, faithful=True),
    "thesis, corrected": partial(_recorded_thesis, faithful=False),
    "skin, contours alone": lambda found: _ours(
        found.contours, tops=found.tops, frame=found.frame, method="skin"
    ),
    "lattice, all taxels": lambda found: _ours(
        found.contours, found.normals, found.taxels, found.tops, frame=found.frame
    ),
}
VARIANTS = (
    ThesisVariant("spline loft", spline_loft),
    ThesisVariant("palpate, skin", _skin),
    ThesisVariant("program", partial(_solid, faithful=True), 0.005),
    ThesisVariant("corrected", _solid, 0.0045),
    ThesisVariant("with 4.3", _with_spline, 0.0045),
    ThesisVariant("7 x 7 layers", partial(_solid, layer=(7, 7)), 0.004),
    ThesisVariant("ellipsoid", partial(_solid, exponents=(1.0, 1.0))),
)
NOISY_VARIANTS = (
    ThesisVariant("spline loft", spline_loft),
    ThesisVariant("palpate, skin", _skin),
    ThesisVariant("program", partial(_solid, faithful=True)),
    ThesisVariant("corrected", _solid, 0.005),
)
FIRST = Example("example 1", WAVY, np.linspace(-1.0, 1.0, 27), 81)
_HEIGHTS = np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, 24))
SECOND = Example("example 2", RoundObject(_smooth), _HEIGHTS, 41)
EXAMPLES = (FIRST, SECOND)
