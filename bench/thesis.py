"""The thesis's reconstruction and palpate's, on its two examples and on recordings.

The examples stand in for the two objects of which the thesis only has drawings: a twisted and lobed
one, with 27 contours of 81 points at even heights, and a smoother one, with 24 contours of 41
points. As the thesis's program requires, each contour starts at azimuth -pi and its last point
repeats the first. Errors are fractions of the height, of the whole solid; `side` is that between
the first and the last contour, because the thesis does not measure the ends.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
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
from palpate.bench.table import Figure, best_seconds, figure_of
from palpate.core import thesis
from palpate.core.arrays import Floats
from palpate.core.explore.planners import PlannerTrial, Thesis, run_planner
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

EXAMPLE_HEIGHT = 2.0  # Of both examples, in a unit of their own: errors are over it
COLUMNS = ("chamfer", "rms", "side", "normals", "volume", "time")
HEAD = f"{'':<48}" + "".join(f"{name:>10}" for name in COLUMNS)
SCENES, QUICK_SCENES = ("egg", "vase", "notched"), ("vase",)  # Plain, featured, sharp


@dataclass(frozen=True, slots=True, kw_only=True)
class ThesisSettings:
    """Meshes and contours of the comparison, and the steps of example 2."""

    noise: float = 0.005  # [fraction of the height] along x and y
    mesh_size: tuple[int, int] = (161, 240)  # rows and columns of the solids
    true_size: tuple[int, int] = (401, 720)  # of the truth
    floor_size: tuple[int, int] = (301, 541)  # of its second mesh, whose error is the floor
    n_recorded_points: int = 80  # of a recorded contour for the thesis, at even azimuths
    n_rounds: int = 2  # of each method; the shortest time counts
    n_steps: int = 400  # largest steps that are tried for the contours of example 2
    step_range: tuple[float, float] = (0.03, 0.3)  # [fraction of the height] of the largest step
    min_step_ratio: float = 0.25  # smallest step / largest step
    tolerance: float = 0.5  # that every planner has to be given; the thesis's rule ignores it


DEFAULT_THESIS = ThesisSettings()


class ThesisFigures(NamedTuple):
    """Errors of one method's solid; as fractions of the height."""

    name: str  # Of the object and of the method
    errors: MeshErrors
    side: float | None = None  # Root mean square error between the outermost contours
    seconds: float | None = None  # From contours to mesh
    max_chamfer: float = np.inf  # Demand; infinite for none

    @property
    def holds(self) -> bool:
        """Whether the demand is met."""
        return self.errors.chamfer <= self.max_chamfer

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
        errors, missed = self.errors, "" if self.holds else f"  <= {self.max_chamfer:.2%}   MISSED"
        side = "" if self.side is None else f"{self.side:.3%}"
        time = "" if self.seconds is None else f"{1e3 * self.seconds:.0f} ms"
        lengths = f"{errors.chamfer:>10.3%}{errors.rms:>10.3%}{side:>10}"
        rest = f"{errors.normal_deg:>6.1f} deg{errors.volume:>+10.1%}{time:>10}"
        return f"{self.name:<48}{lengths}{rest}{missed}".rstrip()


class ThesisVariant(NamedTuple):
    """A method from contours to a mesh."""

    name: str  # In the table
    build: Callable[[Floats], Mesh]  # From contours (m, n, 3)
    max_chamfer: float = np.inf  # Demand; infinite for none


def thesis_rows(quick: bool) -> Iterator[ThesisFigures | str]:
    """Errors and times of both examples, of the second with its own steps, and with noise."""
    yield HEAD
    with single_threaded():
        for example in EXAMPLES:
            yield from _example_rows(example, example.contours(), VARIANTS)
        for is_short in (False, True):
            example = stepped_example(is_short=is_short)
            variants = tuple(variant._replace(max_chamfer=np.inf) for variant in VARIANTS)
            yield from _example_rows(example, example.contours(), variants)
        noisy = FIRST._replace(name=f"{FIRST.name}, noise")
        yield from _example_rows(noisy, with_noise(FIRST.contours()), NOISY_VARIANTS)


def _example_rows(
    example: Example, contours: Floats, variants: Sequence[ThesisVariant]
) -> Iterator[ThesisFigures]:
    truth = example_truth(example)
    floor = truth.errors_of(example.mesh(*DEFAULT_THESIS.floor_size))
    yield ThesisFigures(f"{example.name}: floor", floor)
    points = truth.surface.samples.points
    low, high = example.heights[[0, -1]]
    side = points[(points[:, 2] >= low) & (points[:, 2] <= high)]
    for variant in variants:
        name, build = f"{example.name}: {variant.name}", partial(variant.build, contours)
        yield judge(name, truth, side, build)._replace(max_chamfer=variant.max_chamfer)


def judge(
    name: str,
    truth: TrueSurface,
    side: Floats,
    build: Callable[[], Mesh],
    n_rounds: int = DEFAULT_THESIS.n_rounds,
) -> ThesisFigures:
    """Errors and time of a method.

    `side` (n, 3): points of the truth between the outermost contours.
    """
    meshes = []
    seconds = best_seconds(lambda: meshes.append(build()), n_rounds)
    distances = nearest_points(prepare_surface(*meshes[0]).search, side).distances
    rms = float(np.sqrt((distances**2).mean())) / truth.unit
    return ThesisFigures(name, truth.errors_of(meshes[0]), rms, seconds)


def example_truth(example: Example) -> TrueSurface:
    """The example's own surface, finely meshed; errors are over its height."""
    return truth_of_mesh(example.mesh(*DEFAULT_THESIS.true_size), EXAMPLE_HEIGHT)


def with_noise(contours: Floats, noise: float = DEFAULT_THESIS.noise) -> Floats:
    """Contours (m, n, 3) with noise across the axis, still closed.

    `noise`: standard deviation as a fraction of the height.
    """
    noisy = contours.copy()
    rng = np.random.default_rng(0)
    noisy[:, :-1, :2] += EXAMPLE_HEIGHT * noise * rng.normal(size=noisy[:, :-1, :2].shape)
    noisy[:, -1] = noisy[:, 0]
    return noisy


class Example(NamedTuple):
    """An object and its contours."""

    name: str  # In tables and files
    shape: RoundObject
    heights: Floats  # Of its contours, (m,), from below upwards
    around: int  # Number of points of a contour, with the first one twice

    def contours(self) -> Floats:
        """Exact contours (m, around, 3)."""
        return self.shape.rings(self.heights, np.linspace(-np.pi, np.pi, self.around))

    def mesh(self, rows: int, columns: int) -> Mesh:
        """A mesh of the object, with plane ends."""
        azimuths = 2.0 * np.pi * np.arange(columns) / columns
        return closed_mesh(self.shape.rings(np.linspace(-1.0, 1.0, rows), azimuths))


@cache
def stepped_example(*, is_short: bool, settings: ThesisSettings = DEFAULT_THESIS) -> Example:
    """Example 2 with the heights that the thesis's own planner chooses, (3.1) and (3.2).

    The text gives no constants: the smallest step is a quarter of the largest, and the largest is
    the first one that gives the example's 24 contours. (3.1) depends on neither: if `is_short`, its
    eta is chosen so that the first step is no longer than the others, else it is 1.
    """
    count, eta = len(SECOND.heights), "eta fitted" if is_short else "eta 1"
    trial = PlannerTrial(lambda z, t: 0.5 * SECOND.shape.radius(2.0 * z - 1.0, t))
    for longest in np.geomspace(*settings.step_range, settings.n_steps).tolist():
        caution = max(0.5 / longest - 1.0, 0.0) if is_short else 1.0
        rule = Thesis(least=settings.min_step_ratio * longest, most=longest, caution=caution)
        slices, _ = run_planner(rule, trial, settings.tolerance, most=count + 1)
        if len(slices) == count:
            heights = 2.0 * np.sort([slice_.height for slice_ in slices])
            heights = heights / trial.settings.extent - 1.0
            return SECOND._replace(name=f"{SECOND.name}, own steps, {eta}", heights=heights)
    raise ValueError(f"no step gives {count} contours of {SECOND.name}")


def _solid(contours: Floats, **options: Any) -> Mesh:
    return thesis.rebuild_thesis(contours, **options).mesh(*DEFAULT_THESIS.mesh_size)


def _with_spline(contours: Floats) -> Mesh:
    solid = thesis.rebuild_thesis(contours)
    solid = dataclasses.replace(solid, triples=thesis.interpolated_parameters(solid.parameters))
    return solid.mesh(*DEFAULT_THESIS.mesh_size)


def spline_loft(contours: Floats) -> Mesh:
    """A loft of contours whose last point repeats the first; plane ends."""
    return closed_mesh(loft_rings(contours, contours[:, 0, 2], *DEFAULT_THESIS.mesh_size))


def _palpate(contours: Sequence[Floats] | Floats, *evidence: Any, **options: Any) -> Mesh:
    mesh = reconstruct(list(contours), *evidence, **options).mesh()
    return Mesh(mesh.vertices, mesh.faces)


def _skin(contours: Floats) -> Mesh:
    return _palpate(contours[:, :-1], method="skin")


def _smooth(height: Floats, azimuth: Floats) -> Floats:
    outline = (1.02 - height**2) ** 0.35 * (0.8 + 0.1 * height)
    return np.asarray(outline * (1.0 + 0.15 * np.cos(2.0 * azimuth)))


def recorded_rows(quick: bool, runs: Sequence[Path] = ()) -> Iterator[ThesisFigures | str]:
    """The thesis's method and palpate's on the same recordings, by default of a few new runs.

    Raises InputError if one cannot be read, or holds too little or no truth.
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


def run_scene(scene: str, out: Path, timeout: float = 300.0) -> None:
    """Run a scene as a user does, in a process of its own.

    Raises RuntimeError, with what it printed, if it fails.
    """
    command = [sys.executable, "-m", "palpate", "run", scene, "--out", str(out), "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout)
    if done.returncode not in (0, 1):  # 1 is a missed demand
        raise RuntimeError(f"{scene} ended with {done.returncode}: {done.stderr.strip()}")


def rebuilt_rows(run: Path) -> Iterator[ThesisFigures]:
    """One recording rebuilt by four methods, and the error of measuring."""
    truth, recording = read_truth(run), read_points(run)
    true_surface = TrueSurface(
        prepare_surface(truth.vertices, truth.faces),
        solidity(truth.vertices, truth.faces).volume, 0.0, truth.height,
    )  # fmt: skip
    heights = [
        float(into_frame(recording.frame, contour)[:, 2].mean()) for contour in recording.contours
    ]
    samples = true_surface.surface.samples.points
    levels = into_frame(recording.frame, samples)[:, 2]
    side = samples[(levels >= min(heights)) & (levels <= max(heights))]
    floor = true_surface.errors_of(Mesh(truth.floor_vertices, truth.floor_faces))
    yield ThesisFigures(f"{run.name}: floor", floor)
    for name, build in RECORDED_METHODS.items():
        try:
            yield judge(f"{run.name}: {name}", true_surface, side, partial(build, recording))
        except ValueError as error:
            raise InputError(f"{run}: cannot be rebuilt by {name}: {error}") from None


def read_truth(run: Path) -> Truth:
    """The truth of a recording; raises InputError if it holds none."""
    path = find_bag(run)
    with as_input_errors():
        for message in open_recording(path).messages():
            if message.topic == "/truth":
                return decode(Truth, message.body)
    raise InputError(f"{run}: holds no /truth to compare with: the object was a real message")


def _recorded_thesis(recording: MeasuredContours, *, faithful: bool) -> Mesh:
    """Contours as the program needs them: level, from azimuth -pi, with as many points each."""
    n_points = DEFAULT_THESIS.n_recorded_points
    azimuths, rings = thesis.ray_azimuths(n_points), []
    for contour in recording.contours:
        points = into_frame(recording.frame, contour)
        ring = thesis.match_contour(points[:, :2], azimuths).points
        rings.append(np.column_stack([ring, np.full(n_points, points[:, 2].mean())]))
    stack = np.stack(rings)
    stack = stack[np.argsort(stack[:, 0, 2])]
    mesh = _solid(np.concatenate([stack, stack[:, :1]], axis=1), faithful=faithful)
    if recording.frame is None:
        return mesh
    return Mesh(Pose.from_array(recording.frame).to_outer(mesh.vertices), mesh.faces)


RECORDED_METHODS: dict[str, Callable[[MeasuredContours], Mesh]] = {
    "thesis, program": partial(_recorded_thesis, faithful=True),
    "thesis, corrected": partial(_recorded_thesis, faithful=False),
    "skin, contours alone": lambda recording: _palpate(
        recording.contours, tops=recording.tops, frame=recording.frame, method="skin"
    ),
    "lattice, all taxels": lambda recording: _palpate(
        *(recording.contours, recording.normals, recording.taxels, recording.tops),
        frame=recording.frame,
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
SECOND = Example(
    "example 2", RoundObject(_smooth), np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, 24)), 41
)
EXAMPLES = (FIRST, SECOND)
